"""The paper's Figure 3: the residual over time, over the fitted value, its distribution.

References
----------
.. [Filliben1975] The probability plot correlation coefficient test for normality, Technometrics 17, 111-117.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fracid.errors import InputError
from fracid.plots import look

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fracid.identify import RecordingFit

__all__ = ["residual_plots"]

FloatArray = NDArray[np.float64]


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
    whole, step = recording.residual(output), look.encoder_step(resolution, output)
    known = np.isfinite(whole)
    residual, fitted = np.degrees(whole[known]), np.degrees(recording.fitted[output][known])
    figure = look.new(9.5, 7)
    over_time, over_fitted, distribution, probability = figure.subplots(2, 2).flat
    if residual.size:
        _over_time(over_time, recording.time, np.degrees(whole), step)
        _over_fitted(over_fitted, fitted, residual, step)
        _distribution(distribution, residual, step)
        _normal_probability(probability, residual)
    label = f"residual of {look.symbol(output)} [°]"
    look.label(over_time, "over time", "time [s]", label)
    look.label(over_fitted, "against the fitted value", f"fitted {look.symbol(output)} [°]", label)
    look.label(distribution, "distribution", label, "density [1/°]")
    look.label(probability, probability.get_title() or "normal probability", "standard normal quantile [–]", label)
    for axes in () if residual.size else figure.axes:
        axes.set(xticks=[], yticks=[])
        look.note(axes, "no residual: the simulation failed")
    use = ", validation" if recording.use == "validate" else ""
    look.finish(figure, f"{look.plain(recording.name)}{use}: residual of {look.symbol(output)}; "
                    f"{look.goodness(recording, output, step)}")  # fmt: skip
    return figure


def _over_time(axes: Axes, time: FloatArray, residual: FloatArray, step: float | None) -> None:
    axes.plot(time[[0, -1]], [0, 0], color="0.6", lw=0.8)  # as long as the recording, the residual may end before
    look.encoder_band(axes, step)
    look.line(axes, time, residual, **look.RESIDUAL)


def _over_fitted(axes: Axes, fitted: FloatArray, residual: FloatArray, step: float | None) -> None:
    """Every sample, and the mean in each of twenty bins of the fitted value."""
    axes.axhline(0, color="0.6", lw=0.8)
    look.encoder_band(axes, step)
    many = fitted.size > look.CLOUD
    style: dict[str, Any] = {"ms": 1.5, "alpha": 0.25, "rasterized": True} if many else {"ms": 4}
    axes.plot(fitted, residual, ls="", marker="o", mew=0, color=look.INK, **style)
    low, high = look.extent(fitted)
    if not many or high <= low:
        return
    at = np.minimum((20 * (fitted - low) / (high - low)).astype(int), 19)
    count = np.bincount(at, minlength=20)
    full = count >= 20
    means = [np.bincount(at, weights=x, minlength=20)[full] / count[full] for x in (fitted, residual)]
    axes.plot(*means, color=look.VERMILLION, lw=1.5, marker="o", ms=3, label="mean of each bin")


def _distribution(axes: Axes, residual: FloatArray, step: float | None) -> None:
    if _all_equal(residual):
        axes.axvline(residual[0], **look.FITTED)
        look.note(axes, f"all {residual.size} residuals are {residual[0]:.3g}°")
        return
    look.encoder_band(axes, step, upright=True)
    mean, deviation = residual.mean(), residual.std()
    density, edges = np.histogram(residual, bins=_bin_count(residual), density=True)
    axes.stairs(density, edges, fill=True, color="0.72")
    x = np.linspace(min(edges[0], mean - 3.5 * deviation), max(edges[-1], mean + 3.5 * deviation), 300)
    normal = np.exp(-0.5 * ((x - mean) / deviation) ** 2) / (deviation * np.sqrt(2 * np.pi))
    axes.plot(x, normal, color=look.VERMILLION, lw=1.5, ls="--", label="normal distribution")
    look.corner(axes, f"mean {mean:.2g}°\ndeviation {deviation:.3g}°".replace("-", "−"))


def _normal_probability(axes: Axes, residual: FloatArray) -> None:
    """Ordered residuals against the medians of normal order statistics, with their regression line."""
    if residual.size < 3 or _all_equal(residual):
        look.note(axes, "too few different values")
        return
    quantiles, ordered = _normal_quantiles(residual.size), np.sort(residual)
    # Some hundred points, evenly over the quantiles: the thousands in the middle lie on each other.
    shown = np.unique(np.searchsorted(quantiles, np.linspace(quantiles[0], quantiles[-1], 400)))
    slope = float(quantiles @ ordered / (quantiles @ quantiles))  # the quantiles have mean zero
    axes.plot(
        quantiles[shown], ordered[shown], ls="", marker="o", ms=2.5 if residual.size > 100 else 4, color=look.INK, mew=0
    )
    ends = quantiles[[0, -1]]
    axes.plot(ends, residual.mean() + slope * ends, color=look.VERMILLION, lw=1.5, ls="--", label="normal distribution")
    look.title(axes, f"normal probability, PPCC = {np.corrcoef(quantiles, ordered)[0, 1]:.3f}")


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
