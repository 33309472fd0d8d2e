"""The paper's Figure 3: the residual over time, over the fitted value, its distribution; and all that is tested of it.

:func:`residual_plots` is the paper's, four panels.  :func:`residual_diagnostics` adds what its tests look at
(:mod:`fracid.validation.residuals`): the residual against the fitted speed, its autocorrelation, its spectrum.

References
----------
.. [Filliben1975] The probability plot correlation coefficient test for normality, Technometrics 17, 111-117.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import InputError
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
    outline,
    plain,
    symbol,
    title,
)
from fracid.signals.correlation import autocorrelation, longest_stretch, power_spectrum
from fracid.units import shown_unit, with_unit
from fracid.validation.residual_curves import log_bins
from fracid.validation.residual_records import ResidualAnalysis
from fracid.validation.residual_sentences import DRIFT
from fracid.validation.residual_tests import normal_probability
from fracid.validation.residuals import residual_analysis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fracid.estimation.records import RecordingFit
    from fracid.figures import Style

FAILED = "no residual: the simulation failed"


def residual_plots(
    recording: RecordingFit,
    output: str,
    *,
    resolution: Mapping[str, float | None] | None = None,
    style: str | Style = "screen",
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
    if output not in recording.measured:
        raise InputError(f"{recording.name} has no output {output!r}; it has {', '.join(recording.measured)}.")
    step = encoder_step(resolution, output)
    figure = new(9.5, 7, style)
    _panels(figure.subplots(2, 2).flat, recording, output, step)
    _blank(() if np.isfinite(recording.residual(output)).any() else figure.axes, FAILED)
    return finish(figure, _headline(recording, output, step))


def residual_diagnostics(
    recording: RecordingFit,
    output: str,
    *,
    resolution: Mapping[str, float | None] | None = None,
    analysis: ResidualAnalysis | None = None,
    style: str | Style = "screen",
) -> Figure:
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
    diagnosis = residual_analysis(recording, output, resolution) if analysis is None else analysis
    step = encoder_step(resolution, output)
    whole, mask = recording.residual(output), np.isfinite(recording.residual(output))
    unit, (display_unit, factor) = recording.unit(output), axis_unit(recording.unit(output))
    figure = new(9.5, 13, style)
    rows = [["time", "time"], ["fitted", "speed"], ["normal", "probability"], ["lags", "spectrum"]]
    panels: dict[str, Axes] = figure.subplot_mosaic(rows)
    _panels([panels[name] for name in ("time", "fitted", "normal", "probability")], recording, output, step)
    if mask.any():
        _over_fitted(panels["speed"], factor * _speed(recording, output)[mask], factor * whole[mask], step, unit)
        _in_time(panels["lags"], panels["spectrum"], factor * whole, factor, diagnosis)
    name = symbol(output)
    speed, value = f"fitted speed of {name} [{_per(display_unit, 's')}]", f"residual of {name} [{display_unit}]"
    label(panels["speed"], "against the fitted speed", speed, value)
    label(panels["lags"], _of_lags(diagnosis), "lag [s]", "autocorrelation [–]", None)
    density = f"density of the power [{'1' if display_unit == '–' else f'{display_unit}²'}/Hz]"
    label(panels["spectrum"], _of_spectrum(diagnosis), "frequency [Hz]", density, None)
    _blank(() if mask.any() else figure.axes, FAILED)
    return finish(figure, _headline(recording, output, step))


def _panels(panels: Iterable[Axes], recording: RecordingFit, output: str, step: float | None) -> None:
    """The four of Figure 3: over time, against the fitted value, the distribution, the probability plot."""
    over_time, over_fitted, distribution, probability = panels
    whole, mask = recording.residual(output), np.isfinite(recording.residual(output))
    unit, (display_unit, factor) = recording.unit(output), axis_unit(recording.unit(output))
    residual, fitted = factor * whole[mask], factor * recording.fitted[output][mask]
    if residual.size:
        ends = recording.time[[0, -1]]  # as long as the recording, the residual may end before
        over_time.plot(ends, [0, 0], color="0.6", lw=0.8)
        encoder_band(over_time, step, unit)
        line(over_time, recording.time, factor * whole, **RESIDUAL)
        _over_fitted(over_fitted, fitted, residual, step, unit)
        _distribution(distribution, residual, step, unit)
        _normal_probability(probability, residual)
    left = f"residual of {symbol(output)} [{display_unit}]"
    value = f"fitted {angle_label(output, display_unit, recording.zero_of(output))}"
    heading = probability.get_title() or "normal probability"
    label(over_time, "over time", "time [s]", left)
    label(over_fitted, "against the fitted value", value, left)
    label(distribution, "distribution", left, f"density [{_per('1', display_unit)}]")
    label(probability, heading, "standard normal quantile [–]", left)


def _per(over: str, under: str) -> str:
    """A quotient of units, of which the one below may be none: ``°/s``, ``1/V``, ``–``."""
    return f"{'1' if over == '–' else over}/{under}" if under != "–" else "–"


def _blank(panels: Sequence[Axes], why: str) -> None:
    for axes in panels:
        axes.set(xticks=[], yticks=[])
        note(axes, why)


def _headline(recording: RecordingFit, output: str, step: float | None) -> str:
    use = ", validation" if recording.use == "validate" else ""
    what = f"{plain(recording.name)}{use}: residual of {symbol(output)}"
    return f"{what}; {goodness(recording, output, step)}"


def _speed(recording: RecordingFit, output: str) -> FloatArray:
    """Of the simulation [rad/s]; NaN where it has no value, and beside."""
    return np.asarray(np.gradient(recording.fitted[output], recording.time))


def _in_time(lags: Axes, spectrum: Axes, whole: FloatArray, factor: float, analysis: ResidualAnalysis) -> None:
    """What shows in the order of the samples: on the stretch without a gap that was tested.

    `factor` is from SI to the unit shown, in which `whole` is.
    """
    if not np.isfinite(analysis.whiteness.correlation_time):
        _blank((lags, spectrum), "nothing that can be tested")
        return
    part = longest_stretch(np.isfinite(whole))
    _autocorrelation(lags, whole[part], analysis)
    if analysis.spectrum.sentence:
        _spectrum(spectrum, whole[part], factor, analysis)
    else:
        _blank((spectrum,), "uneven samples have none")


def _autocorrelation(axes: Axes, residual: FloatArray, analysis: ResidualAnalysis) -> None:
    """As far as it takes to see it fade, or to see four swings."""
    w, step, ρ = analysis.whiteness, analysis.step, autocorrelation(residual)
    reach = max(50 * step, 3 * w.correlation_time, 4 / analysis.spectrum.swing if analysis.spectrum.swing else 0.0)
    n = min(ρ.size, round(reach / step) + 1)
    band = 1.96 / np.sqrt(residual.size)
    axes.axhspan(-band, band, color=BLUE, alpha=0.25, lw=0, label="95 % of white noise")
    axes.axhline(0, color="0.6", lw=0.8)
    line(axes, step * np.arange(n, dtype=np.float64), ρ[:n], color=INK, lw=1.0)
    if not w.white and w.correlation_time <= (n - 1) * step:
        axes.axvline(w.correlation_time, color=VERMILLION, lw=1.2, ls=":", label="correlation time")


def _spectrum(axes: Axes, residual: FloatArray, factor: float, analysis: ResidualAnalysis) -> None:
    """Every frequency pale, and the mean of some hundred bins that are even on the logarithmic axis."""
    f, S = power_spectrum(residual, analysis.step)
    f, S = f[1:], S[1:]
    centre, mean = log_bins(f, S)
    indices = outline(np.log(np.maximum(S, 1e-300)))
    axes.plot(f[indices], S[indices], color="0.8", lw=0.5, rasterized=True)
    axes.plot(centre, mean, color=INK, lw=1.2)
    if analysis.level.encoder_step:
        floor = (factor * analysis.level.floor) ** 2 / f[-1]  # spread evenly up to half the sampling rate
        axes.axhline(floor, color=ORANGE, lw=1.5, ls="--", label="rounding of the encoder alone")
    for m in range(1, 4) if analysis.spectrum.swing else ():
        axes.axvline(m * (analysis.spectrum.swing or 0.0), color=GREEN, lw=1.0, ls=":",
                     label="the swing and its multiples" if m == 1 else None)  # fmt: skip
    axes.set(xscale="log", yscale="log", ylim=(np.quantile(mean, 0.1) / 30, S.max() * 3))


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
