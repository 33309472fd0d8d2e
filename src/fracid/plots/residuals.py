"""The paper's Figure 3: the residual over time, over the fitted value, its distribution; and all that is tested of it.

:func:`residual_plots` is the paper's, four panels.  :func:`residual_diagnostics` adds what its tests look at
(:mod:`fracid.validation.residuals`): the residual against the fitted speed, its autocorrelation, its spectrum.

References
----------
.. [Filliben1975] The probability plot correlation coefficient test for normality, Technometrics 17, 111-117.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fracid.arrays import FloatArray, Quanta
from fracid.errors import refuse_unknown
from fracid.estimation.records import RecordingFit
from fracid.figures import Style
from fracid.plots.appearance import (
    BLUE,
    CLOUD,
    FITTED,
    GREEN,
    INK,
    ORANGE,
    RESIDUAL,
    SMALL,
    VERMILLION,
    angle_label,
    axis_unit,
    encoder_band,
    encoder_step,
    extent,
    finish,
    goodness,
    label,
    line,
    new,
    note,
    plain,
    symbol,
    title,
)
from fracid.units import shown_unit, with_unit
from fracid.validation.residual_records import ResidualAnalysis
from fracid.validation.residual_sentences import DRIFT
from fracid.validation.residual_tests import normal_probability
from fracid.validation.residuals import residual_analysis


def residual_plots(
    recording: RecordingFit, output: str, *, resolution: Quanta = None, style: str | Style = "screen"
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
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

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
    >>> from fracid.estimation.records import RecordingFit
    >>> t, rng = np.arange(0, 20, 1e-3), np.random.default_rng(1)
    >>> twin = RecordingFit("twin", "fit", t, {"alpha": 0.01 * rng.normal(size=t.size)}, {"alpha": 0 * t}, 0.01, {}, {})
    >>> [axes.get_title() for axes in residual_plots(twin, "alpha").axes]
    ['over time', 'against the fitted value', 'distribution', 'normal probability, PPCC = 1.000']
    """
    refuse_unknown(f"output of {recording.name}", recording.measured, output)
    figure = new(9.5, 7, style)
    panels: dict[str, Axes] = figure.subplot_mosaic([["time", "fitted"], ["normal", "probability"]])
    return finish(figure, _figure_3(panels, recording, output, step=encoder_step(resolution, output)))


def residual_diagnostics(
    recording: RecordingFit, output: str, *, resolution: Quanta = None, analysis: ResidualAnalysis | None = None,
    style: str | Style = "screen",
) -> Figure:  # fmt: skip
    """Draw Figure 3 with all that the tests of :func:`fracid.residual_analysis` look at, in seven panels.

    Beside those of :func:`residual_plots`: against the fitted speed; the autocorrelation with the band in which 95 % of
    white noise's lie, and the correlation time; the density of the power over the frequency, with the swing, its
    multiples, and what an encoder's rounding would leave.

    Parameters
    ----------
    recording : RecordingFit
        As in :func:`residual_plots`.
    output : str
        Which output.
    resolution : mapping, optional
        As in :func:`fitted_over_time`.
    analysis : ResidualAnalysis, optional
        Of that output; made if left out.
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If the recording has no such output.

    Examples
    --------
    >>> from fracid.estimation.records import RecordingFit
    >>> t, rng = np.arange(0, 20, 1e-3), np.random.default_rng(1)
    >>> swing, noise = 0.2 * np.cos(6 * t), 0.01 * rng.normal(size=t.size)
    >>> twin = RecordingFit("twin", "fit", t, {"alpha": swing + noise}, {"alpha": swing}, 0.01, {}, {})
    >>> [axes.get_title() for axes in residual_diagnostics(twin, "alpha").axes[5:]]
    ['autocorrelation: all of 20,000 samples count', 'spectrum: no frequency stands out']
    """
    a = residual_analysis(recording, output, resolution) if analysis is None else analysis
    step, residual = encoder_step(resolution, output), recording.residual(output)
    figure = new(9.5, 13, style)
    rows = [["time", "time"], ["fitted", "speed"], ["normal", "probability"], ["lags", "spectrum"]]
    panels: dict[str, Axes] = figure.subplot_mosaic(rows)
    unit, (display_unit, factor) = recording.unit(output), axis_unit(recording.unit(output))
    if (mask := np.isfinite(residual)).any():
        speed = np.asarray(np.gradient(recording.fitted[output], recording.time))
        _over_fitted(panels["speed"], factor * speed[mask], factor * residual[mask], step, unit=unit)
        _in_time(panels["lags"], panels["spectrum"], a, factor)
    name = symbol(output)
    speeds, value = f"fitted speed of {name} [{_per(display_unit, 's')}]", f"residual of {name} [{display_unit}]"
    label(panels["speed"], "against the fitted speed", speeds, value)
    label(panels["lags"], _of_lags(a), "lag [s]", "autocorrelation [–]", ticks=None)
    density = f"density of the power [{'1' if display_unit == '–' else f'{display_unit}²'}/Hz]"
    label(panels["spectrum"], _of_spectrum(a), "frequency [Hz]", density, ticks=None)
    return finish(figure, _figure_3(panels, recording, output, step=step))


def _figure_3(panels: Mapping[str, Axes], recording: RecordingFit, output: str, step: float | None) -> str:
    """Over time, against the fitted value, the distribution, the probability plot; gives the heading."""
    recording = recording.of(output)
    whole, mask = recording.residual(output), np.isfinite(recording.residual(output))
    unit, (display_unit, factor) = recording.unit(output), axis_unit(recording.unit(output))
    residual, fitted = factor * whole[mask], factor * recording.fitted[output][mask]
    if residual.size:
        ends = recording.time[[0, -1]]  # as long as the recording, the residual may end before
        panels["time"].plot(ends, [0, 0], color="0.6", lw=0.8)
        encoder_band(panels["time"], step, unit)
        line(panels["time"], recording.time, factor * whole, **RESIDUAL)
        _over_fitted(panels["fitted"], fitted, residual, step, unit=unit)
        _distribution(panels["normal"], residual, step, unit)
        _normal_probability(panels["probability"], residual)
    left = f"residual of {symbol(output)} [{display_unit}]"
    value = f"fitted {angle_label(output, display_unit, recording.zero_of(output))}"
    heading = panels["probability"].get_title() or "normal probability"
    label(panels["time"], "over time", "time [s]", left)
    label(panels["fitted"], "against the fitted value", value, left)
    label(panels["normal"], "distribution", left, f"density [{_per('1', display_unit)}]")
    label(panels["probability"], heading, "standard normal quantile [–]", left)
    _blank(() if residual.size else [*panels.values()], "no residual: the simulation failed")
    use = ", validation" if recording.use == "validate" else ""
    what = f"{plain(recording.name)}{use}: residual of {symbol(output)}"
    return f"{what}; {goodness(recording, output, step)}"


def _per(over: str, under: str) -> str:
    """A quotient of units, of which the one below may be none: ``°/s``, ``1/V``, ``–``."""
    return f"{'1' if over == '–' else over}/{under}" if under != "–" else "–"


def _blank(panels: Sequence[Axes], why: str) -> None:
    for axes in panels:
        axes.set(xticks=[], yticks=[])
        note(axes, why)


def _in_time(lags: Axes, spectrum: Axes, analysis: ResidualAnalysis, factor: float) -> None:
    """What shows in the order of the samples, as on the page; `factor` is from SI to the unit shown."""
    curves, whiteness, swing = analysis.curves, analysis.whiteness, analysis.spectrum.swing
    if curves is None:
        _blank((lags, spectrum), "nothing that can be tested")
        return
    lags.axhspan(-curves.white, curves.white, color=BLUE, alpha=0.25, lw=0, label="95 % of white noise")
    lags.axhline(0, color="0.6", lw=0.8)
    line(lags, curves.lag, curves.correlation, color=INK, lw=1.0)
    if not whiteness.white and whiteness.correlation_time <= curves.lag[-1]:
        lags.axvline(whiteness.correlation_time, color=VERMILLION, lw=1.2, ls=":", label="correlation time")
    f = curves.frequency
    if not f.size:
        _blank((spectrum,), "uneven samples have none")
        return
    spectrum.loglog(f, factor**2 * curves.power, color=INK, lw=1.2)
    spectrum.set_ylim(bottom=factor**2 * np.quantile(curves.power, 0.1) / 30)
    if analysis.level.encoder_step:  # spread evenly up to half the sampling rate
        floor = 2 * analysis.step * (factor * analysis.level.floor) ** 2
        spectrum.axhline(floor, color=ORANGE, lw=1.5, ls="--", label="rounding of the encoder alone")
    for m in range(1, 4) if swing else ():
        spectrum.axvline(m * (swing or 0.0), color=GREEN, lw=1.0, ls=":", label="the swing and its multiples")


def _of_lags(analysis: ResidualAnalysis) -> str:
    w = analysis.whiteness
    if not np.isfinite(w.correlation_time):
        return "autocorrelation"
    count = "all" if w.effective_samples > 0.995 * analysis.samples else f"{w.effective_samples:,.0f}"
    return f"autocorrelation: {count} of {analysis.samples:,} samples count"


def _of_spectrum(analysis: ResidualAnalysis) -> str:
    peak, slow = analysis.spectrum.line, analysis.spectrum.slow_share
    parts = [f"{100 * slow:.0f} % below {analysis.spectrum.slow_below:.2g} Hz"] if slow >= DRIFT else []
    parts += [f"{100 * peak.share:.0f} % at {peak.frequency:.3g} Hz"] if peak else []
    if not np.isfinite(slow):
        return "spectrum"
    return f"spectrum: {', '.join(parts) or 'no frequency stands out'}"


def _over_fitted(axes: Axes, fitted: FloatArray, residual: FloatArray, step: float | None, unit: str) -> None:
    """Every sample, and the mean in each of twenty bins of the fitted value."""
    axes.axhline(0, color="0.6", lw=0.8)
    encoder_band(axes, step, unit)
    many = fitted.size > CLOUD
    style: dict[str, Any] = {"ms": 1.5, "alpha": 0.25, "rasterized": True} if many else {"ms": 4}
    axes.plot(fitted, residual, ls="", marker="o", mew=0, color=INK, **style)
    low, high = extent(fitted)
    if not many or high <= low:
        return
    at = np.minimum((20 * (fitted - low) / (high - low)).astype(int), 19)
    count = np.bincount(at, minlength=20)
    full = count >= 20
    means = [np.bincount(at, weights=x, minlength=20)[full] / count[full] for x in (fitted, residual)]
    axes.plot(*means, color=VERMILLION, lw=1.5, marker="o", ms=3, label="mean of each bin")


def _distribution(axes: Axes, residual: FloatArray, step: float | None, unit: str) -> None:
    factor = shown_unit(unit)[1]
    if _all_equal(residual):
        axes.axvline(residual[0], **FITTED)
        note(axes, f"all {residual.size} residuals are {with_unit(residual[0] / factor, unit)}")
        return
    encoder_band(axes, step, unit, upright=True)
    mean, deviation = residual.mean(), residual.std()
    density, edges = np.histogram(residual, bins=_bins(residual, factor * (step or 0.0)), density=True)
    axes.stairs(density, edges, fill=True, color="0.72")
    x = np.linspace(min(edges[0], mean - 3.5 * deviation), max(edges[-1], mean + 3.5 * deviation), 300)
    normal = np.exp(-0.5 * ((x - mean) / deviation) ** 2) / (deviation * np.sqrt(2 * np.pi))
    axes.plot(x, normal, color=VERMILLION, lw=1.5, ls="--", label="normal distribution")
    shown = 0.0 if abs(mean) < 1e-3 * deviation else mean / factor  # what is left of it is rounding
    text = f"mean {with_unit(shown, unit, '.2g')}\ndeviation {with_unit(deviation / factor, unit)}"
    axes.text(0.98, 0.97, text.replace("-", "−"), transform=axes.transAxes, ha="right", va="top", fontsize=SMALL)


def _normal_probability(axes: Axes, residual: FloatArray) -> None:
    """Ordered residuals against the medians of normal order statistics [Filliben1975]_, with their regression line."""
    if residual.size < 3 or _all_equal(residual):
        note(axes, "too few different values")
        return
    quantiles, ordered, ppcc = normal_probability(residual)
    slope, mean = np.polyfit(quantiles, ordered, 1)
    # Some hundred points, evenly over the quantiles: the thousands in the middle lie on each other.
    indices = np.unique(np.searchsorted(quantiles, np.linspace(quantiles[0], quantiles[-1], 400)))
    size, ends = 2.5 if residual.size > 100 else 4, quantiles[[0, -1]]
    axes.plot(quantiles[indices], ordered[indices], ls="", marker="o", ms=size, color=INK, mew=0)
    axes.plot(ends, mean + slope * ends, color=VERMILLION, lw=1.5, ls="--", label="normal distribution")
    title(axes, f"normal probability, PPCC = {ppcc:.3f}")


def _bins(x: FloatArray, step: float) -> int | FloatArray:
    """As many as suit the samples, but none narrower than the encoder's step where several steps are seen.

    At rest a residual has the encoder's steps alone; in narrower bins that would be a comb.
    """
    quarter, three_quarters = np.percentile(x, (25, 75))
    width = 2 * (three_quarters - quarter) / np.cbrt(x.size)  # Freedman and Diaconis'
    count = int(np.clip(np.ceil(np.ptp(x) / max(width, np.ptp(x) / 80)), 5, 80))
    if step <= 0 or x.std() < step or np.ptp(x) / count >= step:
        return count
    return np.asarray((np.arange(np.floor(x.min() / step + 0.5), np.floor(x.max() / step + 0.5) + 2) - 0.5) * step)


def _all_equal(x: FloatArray) -> bool:
    """Whether the values differ by no more than rounding."""
    return bool(np.ptp(x) <= 1e-9 * np.abs(x).max())
