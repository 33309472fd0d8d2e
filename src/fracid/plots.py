"""Figures.  Each function returns a matplotlib Figure; :func:`save` writes it.

==========================  ============================================================================
figure                      shows
==========================  ============================================================================
:func:`recording_overview`  a recording: each signal whole, and close up about its release
:func:`fitted_over_time`    the paper's Figure 2: measured and fitted, close up where it is fast, residual below
:func:`residual_plots`      the paper's Figure 3: residual over time, over the fitted value, its distribution
:func:`cost_plane`          the cost over the two orders: a point, or a gorge?
:func:`profiles`            the cost's rise over each unknown, all others following, and its threshold
:func:`waterfall`           where each start of a search ended, sorted: is the lowest minimum found again?
==========================  ============================================================================

What they keep to: angles in degrees and a unit on every axis; measured pale and broad under fitted dark and
thin, so that both are told apart in grey and by every eye (the colours are Okabe and Ito's); a simulation
that failed is drawn as missing and said to be, never left out.

A line of many samples is drawn through the least and the greatest of each of some thousand bins: the same
ink, in a file of a few hundred kilobytes.  Clouds of points are rasterised.

Matplotlib is imported within the functions: it takes longer than everything else of ``fracid check``.
No function touches pyplot, so they need no display and may run on threads.

References
----------
.. [Filliben1975] The probability plot correlation coefficient test for normality, Technometrics 17, 111-117.
.. [Okabe2008] Color Universal Design, https://jfly.uni-koeln.de/color/
"""

from __future__ import annotations

import io
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fracid.errors import InputError
from fracid.profiles import THRESHOLD, THRESHOLD_2
from fracid.runs import write_whole
from fracid.uncertainty import NORMAL_95

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fracid.identify import RecordingFit
    from fracid.profiles import JointProfile, Profile, Profiles
    from fracid.recording import Recording
    from fracid.search import Start

__all__ = ["cost_plane", "fitted_over_time", "profiles", "recording_overview", "residual_plots", "save", "waterfall"]

FloatArray = NDArray[np.float64]

BLUE, ORANGE, VERMILLION, GREEN = "#0072B2", "#E69F00", "#D55E00", "#009E73"
INK = "0.25"

MEASURED: dict[str, Any] = {"color": "0.68", "lw": 2.6, "solid_capstyle": "round"}
FITTED: dict[str, Any] = {"color": BLUE, "lw": 0.9}
RESIDUAL: dict[str, Any] = {"color": "0.4", "lw": 0.6}

SMALL, MEDIUM, LARGE = 8, 9.5, 11
"""Sizes of text [pt]: ticks and legends, labels and titles, the figure's title."""

BINS = 900
"""Bins of a line; each shows two samples."""

CLOUD = 1500
"""Points from which on a scatter is rasterised."""

SHOWN_UNITS = {"rad": ("°", 180 / np.pi), "rad/s": ("°/s", 180 / np.pi)}
"""Unit of a signal: how it is shown, and the factor to it."""

SYMBOLS = {"theta": r"$\theta$", "alpha": r"$\alpha$", "lambda": r"$\lambda$", "mu": r"$\mu$"}

MARKS: dict[str, dict[str, Any]] = {
    "best": {"marker": "*", "ms": 15, "mfc": VERMILLION, "mec": "black", "mew": 0.8, "zorder": 5, "clip_on": False},
    "true": {"marker": "+", "ms": 20, "mec": "black", "mew": 1.5, "zorder": 6, "clip_on": False},
    "tried": {"marker": "o", "ms": 2.5, "mfc": "white", "mec": "black", "mew": 0.4, "zorder": 3},
}
"""Told apart by shape as well as by colour."""

COST_UNITS = {"rmse": "rad", "huber": "rad²", "iae": "rad s", "ise": "rad² s", "itae": "rad s²", "itse": "rad² s²"}
"""Of :data:`fracid.costs.COSTS`; a user's own cost has none that we know."""

MULTIPLES = (1.2, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)
"""Of the least cost, where lines are drawn."""

SWINGS = 6
"""That a close-up shows."""


# --- a recording -----------------------------------------------------------------------------------


def recording_overview(recording: Recording) -> Figure:
    """Draw a recording: each signal whole (left) and about its release, or its start (right).

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    matplotlib.figure.Figure
        Angles in degrees; gaps and missing samples shaded, the release and the rest value as lines.

    Examples
    --------
    >>> from fracid.recording import Recording
    >>> t = np.linspace(0, 10, 501)
    >>> twin = Recording.of("twin", t, {"theta": 0 * t, "alpha": np.cos(6 * t)})
    >>> len(recording_overview(twin).axes)
    4
    """
    count = len(recording.signals)
    figure = _figure(11, 1.2 + 2.0 * count)
    grid = figure.subplots(count, 2, squeeze=False, sharex="col", width_ratios=(2, 1))
    near = _about_release(recording)
    inside = (recording.time >= near[0]) & (recording.time <= near[1])
    for (whole, close), name in zip(grid, recording.signals, strict=True):
        unit = SHOWN_UNITS.get(recording.units[name], (recording.units[name], 1))[0]
        _signal(whole, recording, name, np.full(inside.shape, True))
        _signal(close, recording, name, inside)
        whole.set_ylabel(f"{_symbol(name)} [{_plain(unit)}]")
    release = recording.report.release
    _title(grid[0][0], "whole recording")
    _title(grid[0][1], "its start" if release is None else f"about the release at {release:.3f} s")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    grid[0][1].set_xlim(*near)
    _finish(figure, f"{_plain(recording.name)}: {_plain(recording.report.verdict, 200)}")
    return figure


def _about_release(recording: Recording) -> tuple[float, float]:
    """Return the span shown close up: about the release, else a tenth of the recording from its start."""
    time, release = recording.time, recording.report.release
    if not time.size:
        return 0.0, 1.0
    if release is None:
        return float(time[0]), float(time[0] + max(0.1 * np.ptp(time), 1e-9))
    return max(float(time[0]), release - 0.5), min(float(time[-1]), release + 1.5)


def _signal(axes: Axes, recording: Recording, name: str, part: NDArray[np.bool_]) -> None:
    _, factor = SHOWN_UNITS.get(recording.units[name], ("", 1.0))
    report = next(s for s in recording.report.signals if s.name == name)
    _line(axes, recording.time[part], factor * recording.signals[name][part], **FITTED)
    for start, length in recording.report.clock.gaps:
        axes.axvspan(start, start + length, color=VERMILLION, alpha=0.3, lw=0.5, label="gap")
    for moment in report.missing[:200]:  # a thousand lines are a block of colour, and slow
        axes.axvline(moment, color=VERMILLION, alpha=0.3, lw=0.5, label="missing")
    if recording.report.release is not None:
        axes.axvline(recording.report.release, color=GREEN, lw=1.2, label="release")
    if report.at_rest:
        axes.axhline(factor * report.rest, color="0.6", lw=0.8, ls="--", label="rest")


# --- Figure 2 --------------------------------------------------------------------------------------


def fitted_over_time(
    recording: RecordingFit, *, zero: str = "hanging", resolution: Mapping[str, float | None] | None = None
) -> Figure:
    """Draw the paper's Figure 2: measured and fitted over time, the residual in a strip below.

    Parameters
    ----------
    recording : RecordingFit
        One of ``fit.recordings``; values that are not finite are shown as missing.
    zero : str
        Where the pendulum angle is zero: the model's ``zero``; "" where that has no meaning.
    resolution : mapping, optional
        Output → step of its encoder [rad], None where unknown; drawn as a band one step high.

    Returns
    -------
    matplotlib.figure.Figure
        A panel and a strip per output; where the whole shows no single swing, beside them the
        six swings with the fastest motion.

    Examples
    --------
    >>> from fracid.identify import RecordingFit
    >>> t = np.arange(0, 20, 1e-3)
    >>> swing = np.exp(-0.2 * t) * np.cos(7 * t)
    >>> twin = RecordingFit("twin", "fit", t, {"alpha": swing}, {"alpha": 0.98 * swing}, 0.01, {}, {})
    >>> [axes.get_title(loc="left") for axes in fitted_over_time(twin).axes][0]
    '$\\\\alpha$: fit 98.0 %, RMSE 0.287°'
    """
    outputs, time = tuple(recording.measured), recording.time
    steps = {n: _encoder_step(resolution, n) for n in outputs}
    spans = [slice(0, time.size), *_fast_part(time, recording.measured)]
    figure = _figure(11 if len(spans) > 1 else 8, 1.1 + 2.9 * len(outputs))
    shape = {"height_ratios": [3, 1] * len(outputs), "width_ratios": (2, 1.3)[: len(spans)]}
    grid = figure.subplots(2 * len(outputs), len(spans), squeeze=False, sharex="col", gridspec_kw=shape)
    for (panels, strips), name in zip(grid.reshape(len(outputs), 2, -1), outputs, strict=True):
        for panel, strip, span in zip(panels, strips, spans, strict=True):
            _measured_and_fitted(panel, recording, name, span)
            _residual_strip(strip, recording, name, span, steps[name])
        _title(panels[0], f"{_symbol(name)}: {_goodness(recording, name, steps[name])}", loc="left")
        panels[0].set_ylabel(f"{_symbol(name)} [°]" + (f"\n0 = {_plain(zero)}" if name == "alpha" and zero else ""))
        strips[0].set_ylabel("residual\n[°]")
        if len(spans) > 1:
            first, last = time[spans[1]][[0, -1]]
            panels[0].axvspan(first, last, color="0.93", zorder=0, label="shown close up")
            _title(panels[1], f"close up, {first:.2f} to {last:.2f} s", loc="left")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    _finish(figure, f"{_plain(recording.name)}, {_role(recording)}")
    return figure


def _role(recording: RecordingFit) -> str:
    if recording.use == "validate":
        return "validation: not fitted; at most its initial state and its own parameters were found again"
    return "measured and fitted"


def _goodness(recording: RecordingFit, name: str, step: float | None) -> str:
    """Fit and RMSE in words, or why there are none."""
    missing = np.count_nonzero(~np.isfinite(recording.residual(name)))
    if missing:
        return f"no fit; the simulation has no value at {missing} of {recording.time.size} samples"
    rmse, percent = recording.rmse[name], recording.fit_percent[name]
    if np.ptp(recording.measured[name]) == 0:
        fit = "fit undefined (constant signal)"
    else:
        fit = f"fit {_number(percent, 1)} %" if percent > -1e4 else "fit below −10 000 %"
    counts = rmse / step if step else np.inf
    return f"{fit}, RMSE {_degrees(rmse)}" + (
        f" ({counts:.{1 if counts < 10 else 0}f} encoder steps)" if counts < 1e3 else ""
    )


def _measured_and_fitted(axes: Axes, recording: RecordingFit, name: str, span: slice) -> None:
    time = recording.time[span]
    measured, fitted = np.degrees(recording.measured[name][span]), np.degrees(recording.fitted[name][span])
    _line(axes, time, measured, label="measured", **MEASURED)
    _line(axes, time, fitted, label="fitted", **FITTED)
    if not np.isfinite(fitted).any():
        _note(axes, "the simulation failed: no fitted values", 0.85)
        return
    # A simulation that runs away would press the measurement into a straight line.
    low, high = _extent(measured)
    reach = 1.5 * (high - low)
    least, greatest = _extent(fitted)
    if reach > 0 and (least < low - 2 * reach or greatest > high + 2 * reach):
        axes.set_ylim(low - reach, high + reach)
        _note(axes, f"fitted leaves the picture: {least:.3g}° to {greatest:.3g}°".replace("-", "−"), 0.93)


def _residual_strip(axes: Axes, recording: RecordingFit, name: str, span: slice, step: float | None) -> None:
    residual = np.degrees(recording.residual(name)[span])
    if not np.isfinite(residual).any():
        _note(axes, "no residual")
        axes.set_yticks([])
        return
    axes.axhline(0, color="0.6", lw=0.8)
    _encoder_band(axes, step)
    _line(axes, recording.time[span], residual, label="residual (measured − fitted)", **RESIDUAL)


def _fast_part(time: FloatArray, signals: Mapping[str, FloatArray]) -> tuple[slice, ...]:
    """Return the span of some swings where the motion is fastest; none where the whole shows it as well."""
    x = np.array([y - y.mean() for y in signals.values()])
    moving = x[np.ptp(x, axis=1) > 0.1 * np.ptp(x, axis=1).max()]  # what only jitters has no swings
    if time.size < 100 or not moving.size or not np.isfinite(x).all():
        return ()
    swings = int(np.abs(np.fft.rfft(moving, axis=1))[:, 1:].argmax(axis=1).max()) + 1
    length = max(SWINGS * time.size // swings, 50)
    if 2 * length > time.size:
        return ()
    # Speed over a tenth of a swing: an encoder's single counts are faster than any motion.
    lag = max(length // (10 * SWINGS), 1)
    speed2 = ((moving[:, lag:] - moving[:, :-lag]) ** 2).sum(axis=0)
    total = np.concatenate([[0.0], np.cumsum(speed2)])
    windows = total[length - lag :] - total[: total.size - length + lag]
    start = int(np.argmax(windows >= (1 - 1e-9) * windows.max()))  # the first, whatever the rounding
    return (slice(start, start + length),)


# --- Figure 3 --------------------------------------------------------------------------------------


def residual_plots(
    recording: RecordingFit, output: str, *, resolution: Mapping[str, float | None] | None = None
) -> Figure:
    """Draw the paper's Figure 3: what the fit leaves over, in four panels.

    Over time (is it bounded?), against the fitted value (does it bend?), its distribution beside the
    normal one of the same mean and deviation, and its ordered values against normal quantiles.
    With thousands of correlated samples no residual passes for normal; what counts is the shape.

    Parameters
    ----------
    recording : RecordingFit
        Samples without a finite residual are left out, and their number is said.
    output : str
        Which output.
    resolution : mapping, optional
        As in :func:`fitted_over_time`.

    Returns
    -------
    matplotlib.figure.Figure
        The probability plot prints PPCC, the correlation of its points [Filliben1975]_: 1 for normal.

    Raises
    ------
    InputError
        If the recording has no such output.

    Examples
    --------
    >>> from fracid.identify import RecordingFit
    >>> t, rng = np.arange(0, 20, 1e-3), np.random.default_rng(1)
    >>> twin = RecordingFit("twin", "fit", t, {"alpha": 0.01 * rng.normal(size=t.size)}, {"alpha": 0 * t}, 0.01, {}, {})
    >>> [axes.get_title() for axes in residual_plots(twin, "alpha").axes]
    ['over time', 'against the fitted value', 'distribution', 'normal probability, PPCC = 1.000']
    """
    if output not in recording.measured:
        raise InputError(f"{recording.name} has no output {output!r}; it has {', '.join(recording.measured)}.")
    whole, step = recording.residual(output), _encoder_step(resolution, output)
    known = np.isfinite(whole)
    residual, fitted = np.degrees(whole[known]), np.degrees(recording.fitted[output][known])
    figure = _figure(9.5, 7)
    over_time, over_fitted, distribution, probability = figure.subplots(2, 2).flat
    if residual.size:
        _over_time(over_time, recording.time, np.degrees(whole), step)
        _over_fitted(over_fitted, fitted, residual, step)
        _distribution(distribution, residual, step)
        _normal_probability(probability, residual)
    label = f"residual of {_symbol(output)} [°]"
    _label(over_time, "over time", "time [s]", label)
    _label(over_fitted, "against the fitted value", f"fitted {_symbol(output)} [°]", label)
    _label(distribution, "distribution", label, "density [1/°]")
    _label(probability, probability.get_title() or "normal probability", "standard normal quantile [–]", label)
    for axes in () if residual.size else figure.axes:
        axes.set(xticks=[], yticks=[])
        _note(axes, "no residual: the simulation failed")
    use = ", validation" if recording.use == "validate" else ""
    _finish(figure, f"{_plain(recording.name)}{use}: residual of {_symbol(output)}; "
                    f"{_goodness(recording, output, step)}")  # fmt: skip
    return figure


def _over_time(axes: Axes, time: FloatArray, residual: FloatArray, step: float | None) -> None:
    axes.plot(time[[0, -1]], [0, 0], color="0.6", lw=0.8)  # as long as the recording, the residual may end before
    _encoder_band(axes, step)
    _line(axes, time, residual, **RESIDUAL)


def _over_fitted(axes: Axes, fitted: FloatArray, residual: FloatArray, step: float | None) -> None:
    """Every sample, and the mean in each of twenty bins of the fitted value."""
    axes.axhline(0, color="0.6", lw=0.8)
    _encoder_band(axes, step)
    many = fitted.size > CLOUD
    style: dict[str, Any] = {"ms": 1.5, "alpha": 0.25, "rasterized": True} if many else {"ms": 4}
    axes.plot(fitted, residual, ls="", marker="o", mew=0, color=INK, **style)
    low, high = _extent(fitted)
    if not many or high <= low:
        return
    at = np.minimum((20 * (fitted - low) / (high - low)).astype(int), 19)
    count = np.bincount(at, minlength=20)
    full = count >= 20
    means = [np.bincount(at, weights=x, minlength=20)[full] / count[full] for x in (fitted, residual)]
    axes.plot(*means, color=VERMILLION, lw=1.5, marker="o", ms=3, label="mean of each bin")


def _distribution(axes: Axes, residual: FloatArray, step: float | None) -> None:
    if _all_equal(residual):
        axes.axvline(residual[0], **FITTED)
        _note(axes, f"all {residual.size} residuals are {residual[0]:.3g}°")
        return
    _encoder_band(axes, step, upright=True)
    mean, deviation = residual.mean(), residual.std()
    density, edges = np.histogram(residual, bins=_bin_count(residual), density=True)
    axes.stairs(density, edges, fill=True, color="0.72")
    x = np.linspace(min(edges[0], mean - 3.5 * deviation), max(edges[-1], mean + 3.5 * deviation), 300)
    normal = np.exp(-0.5 * ((x - mean) / deviation) ** 2) / (deviation * np.sqrt(2 * np.pi))
    axes.plot(x, normal, color=VERMILLION, lw=1.5, ls="--", label="normal distribution")
    _corner(axes, f"mean {mean:.2g}°\ndeviation {deviation:.3g}°".replace("-", "−"))


def _normal_probability(axes: Axes, residual: FloatArray) -> None:
    """Ordered residuals against the medians of normal order statistics, with their regression line."""
    if residual.size < 3 or _all_equal(residual):
        _note(axes, "too few different values")
        return
    quantiles, ordered = _normal_quantiles(residual.size), np.sort(residual)
    # Some hundred points, evenly over the quantiles: the thousands in the middle lie on each other.
    shown = np.unique(np.searchsorted(quantiles, np.linspace(quantiles[0], quantiles[-1], 400)))
    slope = float(quantiles @ ordered / (quantiles @ quantiles))  # the quantiles have mean zero
    axes.plot(
        quantiles[shown], ordered[shown], ls="", marker="o", ms=2.5 if residual.size > 100 else 4, color=INK, mew=0
    )
    ends = quantiles[[0, -1]]
    axes.plot(ends, residual.mean() + slope * ends, color=VERMILLION, lw=1.5, ls="--", label="normal distribution")
    _title(axes, f"normal probability, PPCC = {np.corrcoef(quantiles, ordered)[0, 1]:.3f}")


def _normal_quantiles(n: int) -> FloatArray:
    """Medians of the order statistics of n normal samples [Filliben1975]_."""
    from scipy.special import ndtri

    median = (np.arange(1, n + 1) - 0.3175) / (n + 0.365)
    median[-1] = 0.5 ** (1 / n)
    median[0] = 1 - median[-1]
    return np.asarray(ndtri(median))


def _bin_count(x: FloatArray) -> int:
    """Bins of the Freedman-Diaconis width, but at least 5 and at most 80."""
    quarter, three_quarters = np.percentile(x, (25, 75))
    width = 2 * (three_quarters - quarter) / np.cbrt(x.size)
    return int(np.clip(np.ceil(np.ptp(x) / max(width, np.ptp(x) / 80)), 5, 80))


def _all_equal(x: FloatArray) -> bool:
    """Whether the values differ by no more than rounding."""
    return bool(np.ptp(x) <= 1e-9 * np.abs(x).max())


# --- the cost over the orders ----------------------------------------------------------------------


def cost_plane(
    lambda_values: ArrayLike,
    mu_values: ArrayLike,
    cost: ArrayLike,
    *,
    best: tuple[float, float] | None = None,
    evaluations: ArrayLike | None = None,
    cost_name: str = "cost",
    true: tuple[float, float] | None = None,
    names: tuple[str, str] = ("lambda", "mu"),
) -> Figure:
    """Draw the cost over the plane of two orders: filled by its logarithm, lines at multiples of the least.

    Parameters
    ----------
    lambda_values, mu_values : array_like, shapes (n_lambda,), (n_mu,)
        Increasing; at least two each.
    cost : array_like, shape (n_lambda, n_mu)
        Infinite or NaN where the simulation diverges: hatched, and said to be.
    best, true : (lambda, mu), optional
        What was found; and, for a twin, what it was made with.
    evaluations : array_like, shape (k, 2), optional
        Where the search has been.
    cost_name : str
        For the colour bar.
    names : (str, str)
        Of the two orders.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        For shapes that do not fit together, or values that do not increase.

    Examples
    --------
    >>> orders = np.linspace(0.8, 1.0, 9)
    >>> valley = 1e-3 + (orders[:, None] - 0.86) ** 2 + 9 * (orders - 0.91) ** 2
    >>> figure = cost_plane(orders, orders, valley, best=(0.86, 0.91), cost_name="itae")
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['order $\\\\mu$ [–]', 'ITAE [rad s²]']
    """
    first, second, values = _checked_plane(lambda_values, mu_values, cost)
    figure = _figure(7, 5.8)
    axes = figure.subplots()
    if not np.isfinite(values).all():
        grey = {"fc": "0.88", "ec": "0.6", "hatch": "///", "lw": 0, "zorder": 0}
        axes.fill(first[[0, -1, -1, 0]], second[[0, 0, -1, -1]], label="diverges", **grey)
    if np.isfinite(values).any():
        _filled(figure, axes, (first, second, values), cost_name)
    else:
        _note(axes, "every simulation diverges", 0.93)
    _search(axes, evaluations, (first[[0, -1]], second[[0, -1]]))
    marks = {what: point for what, point in (("true", true), ("best", best)) if point is not None}
    for what, point in marks.items():
        where = ", ".join(f"{_symbol(n)} = {v:.4f}" for n, v in zip(names, point, strict=True))
        axes.plot(*point, ls="", label=f"{what}: {where}", **MARKS[what])
    axes.set_xlim(_extent(np.append(first, [point[0] for point in marks.values()])))
    axes.set_ylim(_extent(np.append(second, [point[1] for point in marks.values()])))
    _label(axes, "", f"order {_symbol(names[0])} [–]", f"order {_symbol(names[1])} [–]")
    _finish(figure, f"{_cost_label(cost_name)[0]} over the orders", grid=False)
    return figure


def _checked_plane(
    lambda_values: ArrayLike, mu_values: ArrayLike, cost: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    first, second, values = (np.asarray(x, float) for x in (lambda_values, mu_values, cost))
    for name, x in (("lambda_values", first), ("mu_values", second)):
        if x.ndim != 1 or x.size < 2 or not np.all(np.diff(x) > 0):
            raise InputError(f"{name} has shape {x.shape}; expected at least two values that increase, in one row.")
    if values.shape != (first.size, second.size):
        raise InputError(f"cost has shape {values.shape}; expected (n_lambda, n_mu) = {(first.size, second.size)}.")
    return first, second, values


def _filled(figure: Figure, axes: Axes, plane: tuple[FloatArray, FloatArray, FloatArray], cost_name: str) -> None:
    """Colours by log10 of the cost, lines at multiples of its least; by the cost itself where it has no logarithm."""
    import matplotlib as mpl

    first, second, values = plane
    logarithmic = not (values <= 0).any()
    depth = np.ma.masked_invalid(np.log10(values) if logarithmic else values).T
    least, (low, high) = float(depth.min()), _depths(depth.compressed(), logarithmic)
    shades = mpl.colormaps["Blues_r"](np.linspace(0.3, 1, 26))  # light enough for black lines
    colours = axes.contourf(first, second, depth, levels=np.linspace(low, high, 25), colors=shades, extend="both")
    beyond = (0.03 * (low > least), 0.03 * (high < depth.max()))  # arrows, where the colours end before the costs do
    bar = figure.colorbar(colours, ax=axes, pad=0.02, extendfrac=beyond)
    ticks = {f"{10**v if logarithmic else v:.3g}": v for v in reversed(_ticks(low, high, logarithmic))}
    bar.set_ticks(list(ticks.values()), labels=list(ticks))
    bar.ax.tick_params(labelsize=SMALL)
    bar.set_label(" ".join(_cost_label(cost_name)), fontsize=MEDIUM)
    texts, legend = {v: text for text, v in ticks.items()}, "lines of equal cost"
    if logarithmic and low == least:
        texts, legend = {least + float(np.log10(m)): f"×{m:g}" for m in MULTIPLES}, "multiples of the least cost"
    _lines(axes, (first, second, depth), {v: text for v, text in texts.items() if low < v < high}, legend)


def _depths(depth: FloatArray, logarithmic: bool) -> tuple[float, float]:
    """Return where the colours begin and end: neither an exact twin's bottomless minimum nor runs that nearly
    diverge may take them from the valley."""
    low, high = float(depth.min()), float(depth.max())
    if logarithmic:
        median = float(np.median(depth))
        low = max(low, median - 3)
        high = min(high, max(low + 2, median + 0.5))
    return low, max(high, low + 1e-3 * max(1, abs(low)))  # a flat plane has one colour


def _lines(axes: Axes, plane: tuple[FloatArray, FloatArray, Any], texts: Mapping[float, str], legend: str) -> None:
    """Draw lines of equal depth with their texts: at most seven of those that lie on the plane."""
    inside = [v for v in sorted(texts) if plane[2].min() < v < plane[2].max()]
    if inside:
        some = {v: texts[v] for v in inside[:: -(-len(inside) // 7)]}
        lines = axes.contour(*plane, levels=list(some), colors=INK, linewidths=0.7, linestyles="solid")
        axes.clabel(lines, fmt=some, fontsize=7, zorder=3.5)
        axes.plot([], [], color=INK, lw=0.7, label=legend)


def _ticks(low: float, high: float, logarithmic: bool) -> list[float]:
    """Logarithms of 1, 2, 5, 10 ... between the two; evenly spaced values where these are few."""
    from matplotlib.ticker import LogLocator

    even = np.linspace(low, high, 5)
    if not logarithmic:
        return list(map(float, even))
    ticks = np.log10(LogLocator(subs=(1, 2, 5), numticks=8).tick_values(10**low, 10**high))
    ticks = ticks[(ticks >= low) & (ticks <= high)]
    return list(map(float, ticks if ticks.size > 2 else even))


def _cost_label(name: str) -> tuple[str, str]:
    """Name and unit of a cost, as shown; no unit for one that is not ours."""
    return (name.upper(), f"[{COST_UNITS[name]}]") if name in COST_UNITS else (_plain(name), "")


def _search(axes: Axes, evaluations: ArrayLike | None, window: tuple[FloatArray, FloatArray]) -> None:
    """Draw where the search has been; what lies outside the plane is counted only."""
    tried = np.asarray([] if evaluations is None else evaluations, float).reshape(-1, 2)
    corners = np.transpose(window)
    inside = ((tried >= corners[0]) & (tried <= corners[1])).all(axis=1)
    if tried.size:
        label = f"evaluations ({np.count_nonzero(inside)} of {len(tried)} in this window)"
        axes.plot(*tried[inside].T, ls="", rasterized=bool(len(tried) > CLOUD), label=label, **MARKS["tried"])


# --- writing ---------------------------------------------------------------------------------------

_salting = threading.Lock()


def save(figure: Figure, folder: str | Path, stem: str, formats: Sequence[str] = ("svg", "png")) -> tuple[Path, ...]:
    """Write a figure in each format, whole or not at all, and empty it.

    The same figure gives the same bytes: an SVG has no date and its identifiers are not random.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Is cleared, to give its memory back.
    folder : path
        Made if it is not there.
    stem : str
        File name without its ending.
    formats : sequence of str
        Of ``svg``, ``png``, ``pdf`` and whatever else matplotlib knows.

    Returns
    -------
    tuple of Path
        ``folder/stem.svg``, ...

    Raises
    ------
    InputError
        For an unknown format, a stem that is no file name, or a folder that cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> flat = cost_plane([0.8, 1.0], [0.8, 1.0], np.ones((2, 2)))
    >>> [path.name for path in save(flat, tempfile.mkdtemp(), "plane")]
    ['plane.svg', 'plane.png']
    """
    known = figure.canvas.get_supported_filetypes()
    for ending in formats:
        if ending not in known:
            raise InputError(f"Figures cannot be written as {ending!r}; expected some of {', '.join(sorted(known))}.")
    if not stem or Path(stem).name != stem:
        raise InputError(f"{stem!r} is no name for a file; expected one without a folder and an ending: 'figure2'.")
    contents = {Path(folder) / f"{stem}.{ending}": _rendered(figure, ending) for ending in formats}
    figure.clear()
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        for path, content in contents.items():
            write_whole(path, content)
    except OSError as error:
        raise InputError(f"{folder} cannot be written: {error.strerror or error}. Give another folder.") from None
    return tuple(contents)


def _rendered(figure: Figure, ending: str) -> bytes:
    with io.BytesIO() as content, _fixed_salt():
        figure.savefig(content, format=ending, dpi=150, metadata={"Date": None} if ending == "svg" else None)
        figure.set_layout_engine("none")  # laid out once, all formats alike; it takes as long as the drawing
        return content.getvalue()


@contextmanager
def _fixed_salt() -> Iterator[None]:
    """Matplotlib takes the salt of an SVG's identifiers from its global settings alone; one thread at a time."""
    import matplotlib as mpl

    with _salting:
        before = mpl.rcParams["svg.hashsalt"]
        mpl.rcParams["svg.hashsalt"] = "fracid"
        try:
            yield
        finally:
            mpl.rcParams["svg.hashsalt"] = before


# --- the look --------------------------------------------------------------------------------------


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", facecolor="white")


def _finish(figure: Figure, title: str, *, grid: bool = True) -> None:
    """Give all panels one look, and the figure its title and one legend for all."""
    legend: dict[str, Any] = {}
    for axes in figure.axes:
        if axes.get_label() != "<colorbar>":
            _dress(axes, grid)
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                legend.setdefault(label, handle)
    if legend:
        widths = [0.6 + 0.07 * len(label.replace("$", "")) for label in legend]  # [inch], about
        row = figure.get_figwidth()
        columns = len(legend) if sum(widths) < row else max(1, int(row / max(widths)))
        figure.legend(legend.values(), legend, loc="outside lower center", ncols=columns,
                      fontsize=SMALL, frameon=False)  # fmt: skip
    figure.suptitle(title, fontsize=LARGE, wrap=True)


def _dress(axes: Axes, grid: bool) -> None:
    axes.spines[["top", "right"]].set_visible(not grid)
    axes.tick_params(labelsize=SMALL)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set_fontsize(MEDIUM)
    if grid:
        axes.grid(alpha=0.25, lw=0.6)
        axes.set_axisbelow(True)
        if axes.get_autoscalex_on():
            axes.margins(x=0.02)


def _title(axes: Axes, text: str, loc: Literal["left", "center"] = "center") -> None:
    axes.set_title(text, fontsize=MEDIUM, loc=loc)


def _label(axes: Axes, title: str, x: str, y: str) -> None:
    _title(axes, title)
    axes.locator_params(axis="x", nbins=6)
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def _line(axes: Axes, time: FloatArray, y: FloatArray, **style: Any) -> None:
    """Draw samples as a line; few as dots too."""
    dots: dict[str, Any] = {"marker": "o", "ms": 3} if y.size <= 100 else {}
    shown = _outline(y)
    axes.plot(time[shown], y[shown], **dots, **style)


def _outline(y: FloatArray) -> NDArray[np.intp]:
    """Return indices of the samples that draw the same line: least and greatest of each bin, first and last."""
    size = -(-y.size // BINS)
    if size <= 2:
        return np.arange(y.size)
    padded = np.append(y, np.full(-y.size % size, np.nan)).reshape(-1, size)
    known = np.isfinite(padded)  # a bin without any keeps its first: a gap in the line
    extremes = (np.where(known, padded, np.inf).argmin(axis=1), np.where(known, padded, -np.inf).argmax(axis=1))
    offset = size * np.arange(len(padded))
    return np.unique(np.concatenate([[0, y.size - 1], *(offset + at for at in extremes)]))


def _encoder_band(axes: Axes, step: float | None, *, upright: bool = False) -> None:
    """Shade where an error of the encoder alone would lie; its edges lie over the residual, which would hide them."""
    if step:
        half = np.degrees(step) / 2
        span, line = (axes.axvspan, axes.axvline) if upright else (axes.axhspan, axes.axhline)
        span(-half, half, color=ORANGE, alpha=0.3, lw=0, zorder=0.5, label=f"one encoder step, {2 * half:.3g}°")
        for edge in (-half, half):
            line(edge, color=ORANGE, lw=0.8, zorder=3)


def _encoder_step(resolution: Mapping[str, float | None] | None, name: str) -> float | None:
    step = (resolution or {}).get(name)
    return step if step is not None and 0 < step < np.inf else None


def _note(axes: Axes, text: str, height: float = 0.5) -> None:
    """Write across a panel."""
    axes.text(0.5, height, text, transform=axes.transAxes, ha="center", va="center", fontsize=MEDIUM,
              bbox={"fc": "white", "ec": "0.7", "boxstyle": "round"})  # fmt: skip


def _corner(axes: Axes, text: str) -> None:
    axes.text(0.98, 0.97, text, transform=axes.transAxes, ha="right", va="top", fontsize=SMALL)


def _extent(x: FloatArray) -> tuple[float, float]:
    """Least and greatest of the finite values; two zeros where there are none."""
    known = x[np.isfinite(x)]
    return (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)


def _degrees(angle: float) -> str:
    return f"{np.degrees(angle):.3g}°"


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".replace("-", "−")


def _symbol(name: str) -> str:
    return SYMBOLS.get(name, _plain(name))


def _plain(text: str, length: int = 60) -> str:
    """Return a user's words as matplotlib can show them: on one line, no formulas, only glyphs of the font."""
    from matplotlib.font_manager import findfont, get_font

    glyphs = get_font(findfont("DejaVu Sans")).get_charmap()
    line = "".join(c if ord(c) in glyphs else "□" for c in " ".join(str(text).split()))
    return (line if len(line) <= length else line[: length - 1] + "…").replace("$", r"\$")


# --- where the starts ended ------------------------------------------------------------------------


def waterfall(starts: Sequence[Start], *, cost_name: str = "cost") -> Figure:
    """Draw the final cost of each start of a search, sorted: a broad lowest step is a minimum found again and again.

    Parameters
    ----------
    starts : sequence of fracid.search.Start
        A start that was left in another's minimum is drawn hollow, at that one's cost; one that was left for its
        cost, or whose runs failed, has no place and is counted only.
    cost_name : str
        For the axis.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If there is no start.

    Examples
    --------
    >>> from fracid.search import Start
    >>> at = np.zeros(1)
    >>> figure = waterfall([Start("given", at, 1.0, at, 0.1, "converged", 9),
    ...                     Start("Sobol 1", at, 2.0, at, None, "left", 5, "given")])
    >>> figure.axes[0].get_xlabel()
    'start, sorted by its final cost'
    """
    if not starts:
        raise InputError("There is no start to draw; expected those of a multistart search, Fit.starts.")
    from matplotlib.ticker import MaxNLocator

    from fracid.search import SAME_COST, final_cost

    costs = [(final_cost(s, starts), s) for s in starts]
    ended = sorted(((cost, s) for cost, s in costs if cost is not None), key=lambda pair: float(f"{pair[0]:.4g}"))
    figure = _figure(7, 4.6)
    axes = figure.subplots()
    kinds = {"given": ("o", BLUE), "regression": ("s", VERMILLION), "Sobol": ("D", GREEN)}
    for kind, (marker, colour) in kinds.items():
        for joined in (False, True):
            mine = [(i + 1, cost) for i, (cost, s) in enumerate(ended)
                    if s.origin.split()[0] == kind and (s.joined is not None) == joined]  # fmt: skip
            label = f"{kind}, left in another's minimum" if joined else kind
            if mine:
                axes.plot(*np.transpose(mine), ls="", marker=marker, ms=7, mec=colour, mew=1.4,
                          mfc="white" if joined else colour, label=label, zorder=3)  # fmt: skip
    axes.step([i + 1 for i in range(len(ended))], [cost for cost, _ in ended], where="mid", color="0.7", lw=1, zorder=1)
    if ended and ended[0][0] > 0:
        axes.set_yscale("log")
        _few_decades(axes)
    best = sum(cost <= SAME_COST * ended[0][0] for cost, _ in ended) if ended else 0
    lost = f"; {len(starts) - len(ended)} left for their cost" if len(ended) < len(starts) else ""
    _corner(axes, f"{best} of {len(starts)} starts at the lowest cost{lost}")
    name, unit = _cost_label(cost_name)
    _label(axes, "", "start, sorted by its final cost", f"final {name} {unit}".rstrip())
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(0.5, len(starts) + 0.5)
    _finish(figure, "where the starts ended")
    return figure


def _few_decades(axes: Axes) -> None:
    """Plain numbers at a logarithmic axis that spans less than two decades: no lone power of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_ylim()
    if high < 100 * low:
        low, high = min(low, high / 1.3), max(high, 1.3 * low)
        axes.set_ylim(low, high)
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 5, 7)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())


# --- profiles --------------------------------------------------------------------------------------

CEILING = 12.0
"""Rises above this are beyond the panel of a profile."""


def profiles(found: Profiles) -> Figure:
    """Draw each profile: the rise of the cost over the value, its threshold, and the parabola of the sandwich.

    Parameters
    ----------
    found : fracid.Profiles
        Its joint profile, where there is one, has a panel of its own, with the limit of its 95 % region.

    Returns
    -------
    matplotlib.figure.Figure
        Where the two curves part, the interval of the sandwich is wrong; where the rise stays below the threshold
        the data do not know the value.

    Raises
    ------
    InputError
        If there is no profile.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=1e-2, end=2.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((201, 2))
    >>> swing = Experiment("twin", 1e-2, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> problem = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}, initial_state="held")
    >>> len(profiles(fracid.profile(problem, points=4)).axes)
    1
    """
    panels = list(found.profiles.values())
    count = len(panels) + (found.joint is not None)
    if not count:
        raise InputError("There is no profile to draw.")
    columns = min(count, 3)
    rows = -(-count // columns)
    figure = _figure(max(6.4, 3.9 * columns), 0.9 + 3.2 * rows)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[count:]:
        axes.remove()
    calibrated = found.problem.cost_function.loss is not None
    for axes, panel in zip(grid, panels, strict=False):
        _profile(axes, panel, calibrated)
    if found.joint is not None:
        _joint_profile(grid[count - 1], found.joint)
    _finish(figure, f"Profiles of the cost, {_cost_label(found.problem.cost_function.name)[0]}")
    return figure


def _profile(axes: Axes, panel: Profile, calibrated: bool) -> None:
    label, factor = _unknown_label(panel.name, panel.unit)
    values, rise = factor * panel.values, np.maximum(panel.rise, 0.0)
    top = float(np.clip(1.15 * np.max(rise[np.isfinite(rise)], initial=0.0), 1.3 * THRESHOLD, CEILING))
    axes.plot(values, rise, color=BLUE, lw=1.6, marker="o", ms=3.5, label="profile", zorder=3)
    shown = axes.get_xlim()
    if calibrated:
        axes.axhline(THRESHOLD, color=VERMILLION, lw=1.1, label="95 % threshold, 3.84")
        ends = [factor * end if end is not None else edge for end, edge in
                zip(panel.interval95, panel.values[[0, -1]] * factor, strict=True)]  # fmt: skip
        axes.axvspan(*ends, color=BLUE, alpha=0.10, lw=0, label="95 % interval")
    if panel.wald95 is not None:
        se = factor * (panel.wald95[1] - panel.wald95[0]) / (2 * NORMAL_95)
        v = np.linspace(*shown, 200)
        parabola = ((v - factor * panel.best) / se) ** 2
        axes.plot(v, parabola, color="black", lw=1.1, ls=(0, (4, 3)), label="parabola of the sandwich", zorder=2)
    axes.plot(factor * panel.best, 0.0, ls="", label="best", **(MARKS["best"] | {"ms": 11}))
    axes.set_xlim(*shown)
    axes.set_ylim(-0.04 * top, top)
    axes.ticklabel_format(axis="x", useOffset=False)  # 0.94998, not -2 and far off 1e-5+9.5e-1
    _label(axes, panel.verdict, label, "rise of the cost, W [–]" if calibrated else "rise, 3.84 where it doubled")
    axes.locator_params(axis="x", nbins=4)


def _joint_profile(axes: Axes, joint: JointProfile) -> None:
    labels, factors = zip(*(_unknown_label(n, u) for n, u in zip(joint.names, joint.units, strict=True)), strict=True)
    first, second = factors[0] * joint.first, factors[1] * joint.second
    first, second, rise = _smoothed(first, second, joint.rise)
    axes.contourf(first, second, np.minimum(rise, 50.0).T, levels=[0, 1, 2, 4, THRESHOLD_2], cmap="Blues_r", alpha=0.6)
    axes.contour(first, second, rise.T, levels=[THRESHOLD_2], colors=[VERMILLION], linewidths=1.4)
    axes.plot([], [], color=VERMILLION, lw=1.4, label="95 % region, 5.99")
    axes.plot(
        factors[0] * joint.best[0], factors[1] * joint.best[1], ls="", label="best", **(MARKS["best"] | {"ms": 11})
    )
    axes.ticklabel_format(useOffset=False)
    _label(axes, f"together; correlation {_number(joint.correlation, 2)}", *labels)
    axes.locator_params(axis="x", nbins=4)


def _smoothed(first: FloatArray, second: FloatArray, rise: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A rise on a fine grid, by a spline that is exact for a parabola: a narrow valley falls between coarse points."""
    if not np.isfinite(rise).all() or min(rise.shape) < 4:
        return first, second, np.where(np.isfinite(rise), np.maximum(rise, 0.0), 1e3)
    from scipy.interpolate import RectBivariateSpline

    fine = np.linspace(first[0], first[-1], 200), np.linspace(second[0], second[-1], 200)
    return *fine, np.maximum(RectBivariateSpline(first, second, rise)(*fine), 0.0)


def _unknown_label(name: str, unit: str) -> tuple[str, float]:
    """What stands at the axis of an unknown, and the factor to its unit there."""
    shown, factor = SHOWN_UNITS.get(unit, (unit or "–", 1.0))
    order = "order " if name in ("lambda", "mu") else ""
    return f"{order}{_symbol(name)} [{_plain(shown)}]", factor
