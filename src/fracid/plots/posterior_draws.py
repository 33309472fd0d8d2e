"""A posterior: each parameter's, each pair's, and the simulations that come of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fracid.arrays import FloatArray, spacing
from fracid.errors import Failure, InputError, refuse_unknown
from fracid.figures import Style
from fracid.plots.appearance import BLUE, VERMILLION, axis_unit, finish, label, line, new, plain, symbol, unknown_label

if TYPE_CHECKING:
    from fracid.bayes.result import Posterior

MOST = 8
"""Parameters of one figure."""

SHOWN = 4
"""Parameters that are drawn if none are named, with the orders among them."""

BINS = 40
"""Of a histogram; half as many along each side of a pair."""

SIMULATIONS = 40
"""Draws that a predictive figure simulates."""

DRAWN = 100_000
"""Samples of a recording that it shows: more of them are a bar of ink."""


def posterior_corner(posterior: Posterior, *names: str, style: str | Style = "screen") -> Figure:
    """Draw the posterior of each parameter on the diagonal, and that of each pair below it.

    Parameters
    ----------
    posterior : fracid.Posterior
    *names : str
        Which parameters, eight at most; the orders, and others up to four, if left out.
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure
        The 95 % interval is shaded, the fitted value is marked.  A pair shows the regions that hold 50 and 95 % of the
        draws.

    Raises
    ------
    InputError
        If there is no such parameter.
    """
    chosen = names or _most_important(posterior)
    refuse_unknown("free parameter", posterior.names, *chosen)
    if len(chosen) > MOST:
        raise InputError(f"{len(chosen)} parameters are too many for one figure; name {MOST} at most.")
    n = len(chosen)
    figure = new(max(5.0, 2.3 * n), max(3.6, 0.9 + 2.0 * n), style)
    grid = figure.subplots(n, n, squeeze=False)
    units = {u.name: u.unit for u in posterior.problem.unknowns}
    labels, factors = zip(*(unknown_label(n, units[n], posterior.problem.model) for n in chosen), strict=True)
    columns = [factor * posterior.points[:, posterior.names.index(name)]
               for name, factor in zip(chosen, factors, strict=True)]  # fmt: skip
    for axes in grid[np.triu_indices(n, 1)]:
        axes.remove()
    for i, j in zip(*np.tril_indices(n), strict=True):
        if j < i:
            _pair(grid[i, j], columns[j], columns[i], posterior.weights)
        else:
            _alone(grid[i, i], posterior, chosen[i], columns[i], factor=factors[i])
        _few_ticks(grid[i, j], below=i == n - 1, beside=bool(j == 0 and i > 0))
        beside = labels[i] if j < i else "density [–]"
        label(grid[i, j], "", labels[j] if i == n - 1 else "", beside if j == 0 else "")
    trust = "" if posterior.trusted else "; the draws cannot be trusted"
    return finish(figure, f"Posterior of {posterior.problem.model.name}{trust}")


def posterior_predictive(posterior: Posterior, *, style: str | Style = "screen") -> Figure:
    """Draw what is left of each recording by simulations with draws of the posterior.

    Parameters
    ----------
    posterior : fracid.Posterior
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure
        For each output of the first recording the residual of the fit, and by how much simulations with forty draws
        differ from the fitted one: where that is broad, the posterior leaves the motion undetermined.  Of a long
        recording its first 100,000 samples.

    Raises
    ------
    InputError
        If the run at the minimum fails.
    """
    problem, whole = posterior.problem, posterior.problem.experiments[0]
    if len(whole.measured) > DRAWN:
        problem = problem.until(DRAWN * whole.step)
    e = problem.experiments[0]
    fitted = problem.fitted(posterior.x, e)
    if isinstance(fitted, Failure):
        raise InputError(f"There is nothing to draw: the run at the minimum fails: {fitted}.")
    runs = [problem.fitted(x, e) for x in posterior.resampled(SIMULATIONS)]
    curves = np.array([run - fitted for run in runs if not isinstance(run, Failure)])
    outputs = problem.outputs
    figure = new(8.0, 0.9 + 2.3 * len(outputs), style)
    panels = figure.subplots(len(outputs), 1, squeeze=False)[:, 0]
    for o, (axes, output) in enumerate(zip(panels, outputs, strict=True)):
        unit, factor = axis_unit(e.units.get(output, "rad"))
        time, own = e.start + e.time, e.scored[:, o]
        residual = np.where(own, e.measured[:, o] - fitted[:, o], np.nan)
        shown = own if spacing(own) > 1 else np.ones_like(own)  # what is measured now and then from sample to sample
        line(axes, time[shown], factor * residual[shown], color="0.7", lw=0.8, label="residual (measured − fitted)")
        if len(curves):
            low, high = (factor * np.quantile(curves[:, :, o], q, axis=0) for q in (0.025, 0.975))
            axes.fill_between(time, low, high, color=BLUE, alpha=0.7, lw=0, zorder=3,
                              label=f"95 % of {len(curves)} draws, less the fitted")  # fmt: skip
        label(axes, "", "time [s]" if o == len(outputs) - 1 else "", f"residual of {symbol(output)} [{unit}]")
    part = "" if problem is posterior.problem else f"the first {e.time[-1]:.3g} s of "
    return finish(figure, f"What the posterior leaves undetermined: {part}{plain(e.name)}")


def _few_ticks(axes: Axes, *, below: bool, beside: bool) -> None:
    """Two or three numbers, slanting, at the figure's edge alone: those of narrow posteriors are long."""
    axes.locator_params(axis="both" if beside else "x", nbins=3)
    axes.ticklabel_format(axis="both" if axes.get_yticks().size else "x", useOffset=False)
    axes.tick_params(axis="x", labelrotation=30, labelbottom=below)
    axes.tick_params(axis="y", labelleft=beside)


def _most_important(posterior: Posterior) -> tuple[str, ...]:
    """The orders, then the others in their order."""
    ranked = sorted(posterior.problem.unknowns, key=lambda u: u.kind != "order")
    orders = sum(u.kind == "order" for u in ranked)
    return tuple(u.name for u in ranked[: max(SHOWN, min(orders, MOST))])


def _alone(axes: Axes, posterior: Posterior, name: str, values: FloatArray, factor: float) -> None:
    low, high = (factor * end for end in posterior.interval(name))
    reach = _reach(values, posterior.weights)
    axes.hist(values, bins=BINS, range=reach, weights=posterior.weights, density=True, color=BLUE, alpha=0.55)
    axes.axvspan(low, high, color=BLUE, alpha=0.12, lw=0, label="95 % interval")
    axes.axvline(factor * posterior.x[posterior.names.index(name)], color=VERMILLION, lw=1.2, label="fitted")
    axes.set(xlim=reach, yticks=[])


def _pair(axes: Axes, x: FloatArray, y: FloatArray, weights: FloatArray) -> None:
    reach: Any = [_reach(x, weights), _reach(y, weights)]
    from scipy.ndimage import gaussian_filter

    counts, across, up = np.histogram2d(x, y, bins=BINS // 2, range=reach, weights=weights)
    density = gaussian_filter(counts, 1.0)
    ordered = np.sort(density.ravel())[::-1]
    mass = np.cumsum(ordered) / max(float(np.sum(ordered)), 1e-300)
    levels = sorted({float(ordered[np.searchsorted(mass, part)]) for part in (0.95, 0.5)})
    if len(levels) == 2 and levels[0] > 0:
        middle = [0.5 * (edges[1:] + edges[:-1]) for edges in (across, up)]
        axes.contourf(*middle, density.T, levels=[*levels, max(float(density.max()), levels[1] * 1.01)],
                      colors=[BLUE], alpha=0.4)  # fmt: skip
        axes.contour(*middle, density.T, levels=levels, colors=[BLUE], linewidths=1.0)
    axes.set(xlim=reach[0], ylim=reach[1])


def _reach(values: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """Where all but 0.4 % lie, with a margin."""
    order = np.argsort(values)
    low, high = np.interp([0.002, 0.998], np.cumsum(weights[order]), values[order])
    margin = 0.05 * (high - low) or 0.05 * (abs(low) or 1.0)
    return float(low - margin), float(high + margin)
