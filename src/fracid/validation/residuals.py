r"""What a fit leaves over, and what that says of the model.

The residual :math:`e_t`, measured minus simulated, of a good model is white noise as small as the encoder allows.
:func:`residual_analysis` asks in this order, since each answer decides what the next is worth:

==========  =============================================  =======================================================
question    test                                           size of the effect, which decides
==========  =============================================  =======================================================
whiteness   Box-Pierce, robust [LNS]_, up to 10 lags       correlation time T, effective samples n/(T/step), lag-1
spectrum    \                                              share of the power at one frequency, or slower than the swing
normality   Anderson-Darling [AD]_                         PPCC, the correlation of the normal probability plot [F]_
variance    Breusch-Pagan [BP]_, Mann-Whitney [MW]_        spread late to early, far to near, fast to slow
level       \                                              rms in steps of the encoder, beside 1/√12 of rounding alone
==========  =============================================  =======================================================

**What a p-value is worth here.**  A test takes samples for independent.  A recording of 20,000 samples at 1 kHz may
hold some hundred independent ones, and on all of them every test of normality or of constant variance rejects: the
noise of a good model as surely as a bad one's.  So p-values of these two are those of the *thinned* residual, every
k-th sample, k = 2 T/step; below :data:`ENOUGH` of those there is none of normality, and that of a ratio of spreads is
Fisher's, with as many degrees of freedom as samples count.  And with very many samples any departure is
significant: what it matters is told by its size, and the sentence says so.

The correlation time T is the longer one of two [BH]_,

.. math::  T_1 = h\,(1 + 2\sum_k ρ_k), \qquad T_2 = h\,(1 + 2\sum_k ρ_k^2),

with autocorrelations :math:`ρ_k` at lags kh, summed up to the first lag that is five times the sum [S]_, at most a
quarter of the record.  :math:`n h/T_1` independent samples would know the mean as well, :math:`n h/T_2` the variance.
Noise that fades has :math:`T_1` the longer, AR(1) for example (1 + ρ)/(1 − ρ) samples; a residual that swings has
:math:`ρ_k` of both signs, so that its :math:`T_1` is next to nothing, and only :math:`T_2` tells that one swing knows
the next.

A frequency f stands out where a tenth of the power lies within a tenth of f, four times as dense as on both sides:
the spectrum of noise that fades has a largest bin too, but not that much larger than its neighbours.

References
----------
.. [LNS] I. Lobato, J. Nankervis, N. Savin, Int. Economic Review 42 (2001) 187: each lag by its own variance, for
   residuals whose size changes.
.. [BH] G. Bayley, J. Hammersley, J. Roy. Statist. Soc. Suppl. 8 (1946) 184: the two numbers of effective samples.
.. [S] A. Sokal, in Functional Integration: Basics and Applications, NATO ASI B 361 (1997) 131: where to stop the sum.
.. [AD] T. Anderson, D. Darling, J. Amer. Statist. Assoc. 49 (1954) 765.
.. [F] J. Filliben, Technometrics 17 (1975) 111.
.. [BP] T. Breusch, A. Pagan, Econometrica 47 (1979) 1287; R. Koenker, J. Econometrics 17 (1981) 107.
.. [MW] H. Mann, D. Whitney, Ann. Math. Statist. 18 (1947) 50, of the sizes |e|: powerful also with some ten samples.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray, Quanta
from fracid.errors import InputError, refuse_unknown
from fracid.estimation.records import RecordingFit
from fracid.signals.correlation import autocorrelation, box_pierce, correlation_time, longest_stretch, power_spectrum
from fracid.signals.left_over import NEXT_TO_WHITE, SIGNIFICANT
from fracid.signals.resolution import resolution as lattice
from fracid.units import with_unit
from fracid.validation.residual_curves import residual_curves
from fracid.validation.residual_records import (
    NAN,
    Contrast,
    Level,
    Line,
    Normality,
    ResidualAnalysis,
    Spectrum,
    Variance,
    Whiteness,
)
from fracid.validation.residual_sentences import (
    DENSER,
    SAYS,
    STANDS_OUT,
    correlation_cause,
    level_sentence,
    normality_sentence,
    offset_phrase,
    shape_phrases,
    spectrum_sentences,
    untestable_reason,
    variance_sentence,
    whiteness_sentence,
)
from fracid.validation.residual_tests import (
    anderson_darling,
    breusch_pagan,
    fisher,
    harmonic_number,
    is_testable,
    mann_whitney,
    normal_probability,
    spread_ratio,
    swing_band,
)


def residual_analysis(recording: RecordingFit, output: str, resolution: Quanta = None) -> ResidualAnalysis:
    """Test the residual of one output, whiteness first, each result with a line of plain words.

    Parameters
    ----------
    recording : RecordingFit
        Samples without a finite residual are left out; of what they tear apart the longest piece is looked at.  Those
        of an output that is measured now and then are taken one after the other (:meth:`RecordingFit.of`).  Uneven
        ones are taken one after the other, their median step for all, and are not asked for frequencies.  Where samples
        have standard deviations, the tests are those of the residual in these.
    output : str
        Which output.
    resolution : mapping of signals to steps of their encoders [rad], optional
        Looked for in the measured samples if left out.

    Returns
    -------
    ResidualAnalysis
        Of a residual that cannot be tested (none, too short, constant) with a sentence, and NaN for the figures.

    Raises
    ------
    InputError
        If the recording has no such output, or its samples are uneven and nobody said that they are meant so.

    References
    ----------
    Those of :mod:`fracid.validation.residuals`.

    Examples
    --------
    >>> from fracid.estimation.records import RecordingFit
    >>> t, rng = np.arange(0, 20, 1e-3), np.random.default_rng(1)
    >>> swing, hum = 0.2 * np.cos(6 * t), 0.005 * np.sin(12 * t)
    >>> noise = 0.002 * rng.normal(size=t.size)
    >>> twin = RecordingFit("twin", "fit", t, {"alpha": swing + hum + noise}, {"alpha": swing}, 0.01, {}, {})
    >>> found = residual_analysis(twin, "alpha")
    >>> found.spectrum.line.harmonic, round(found.spectrum.line.share, 2), found.whiteness.effective_samples < 100
    (2, 0.74, True)
    >>> print(found.sentences["spectrum"])
    74 % of its power lies at 1.9 Hz, 2 times the swing's: something differs between left and right: ...
    """
    refuse_unknown(f"output of {recording.name}", recording.measured, output)
    recording = recording.of(output)
    (step, even), unit = _step(recording), recording.unit(output)
    whole, raw = recording.standardised(output), recording.residual(output)
    part = longest_stretch(np.isfinite(whole))
    e, fitted = whole[part], np.asarray(recording.fitted[output])[part]
    quantum = lattice(np.asarray(recording.measured[output])) if resolution is None else resolution.get(output)
    size = float(np.abs(np.asarray(recording.measured[output])[part]).max(initial=0.0))
    head = (recording.name, output, recording.use, e.size, whole.size - e.size, step)
    if because := untestable_reason(e, size, whole.size, unit):
        none = (Whiteness(because), Spectrum(""), Normality(""), Variance(""))
        return ResidualAnalysis(*head, *none, _level(raw[part], quantum, unit, white=False), unit)
    ρ, speed = autocorrelation(e), np.gradient(fitted, step if even else np.asarray(recording.time)[part])
    spectrum = _spectrum(e, speed, step, unit, recording.use) if even else Spectrum("")
    figures = _whiteness(e, ρ, step)
    level = _level(raw[part], quantum, unit, white=figures.white)
    cause = correlation_cause(figures, step, spectrum.swing, recording.use, rounding=level.rounding)
    whiteness = replace(figures, sentence=whiteness_sentence(figures, e.size, cause))
    contrasts = _contrasts(e, fitted, speed, whiteness)
    variance = Variance(variance_sentence(contrasts, whiteness.effective_samples, unit, recording.use), *contrasts)
    return ResidualAnalysis(
        *head, whiteness, spectrum, _normality(e, e[:: whiteness.thinning], variance, unit), variance,
        level, unit, residual_curves(e, ρ, step, whiteness.correlation_time, even=even),
    )  # fmt: skip


def _step(recording: RecordingFit) -> tuple[float, bool]:
    """The median sampling interval [s], and whether all are about that."""
    intervals = np.diff(recording.time)
    step = float(np.median(intervals)) if intervals.size else NAN
    even = bool(np.all(np.abs(intervals - step) <= 0.02 * step))
    if not even and not recording.uneven:
        raise InputError(SAYS("apart", name=recording.name, least=intervals.min(), most=intervals.max()))
    return step, even


def _whiteness(e: FloatArray, ρ: FloatArray, step: float) -> Whiteness:
    T, (lags, Q, p) = correlation_time(ρ), box_pierce(e)
    k = max(2, round(2 * T))
    thin = e[::k]
    return Whiteness(
        "", p >= SIGNIFICANT or T * NEXT_TO_WHITE <= 1, lags, Q, p_value=p, lag_one=float(ρ[1]),
        correlation_time=T * step, effective_samples=e.size / T, thinning=k, thinned_samples=thin.size,
        thinned_p_value=box_pierce(thin)[2] if is_testable(thin) else NAN,
    )  # fmt: skip


def _spectrum(e: FloatArray, speed: FloatArray, step: float, unit: str, use: str) -> Spectrum:
    f, S = power_spectrum(e, step)
    band = swing_band(speed, step)
    swing = band[1] if band else None
    slow = float(max(3.5 * f[1], (swing or 0.0) / 3))
    share, faster = S / np.sum(S), f >= slow
    peak = float(f[np.argmax(np.where(faster, S, -1.0))])
    width = max(2.5 * f[1], 0.1 * peak)
    near, beside = np.abs(f - peak) <= width, (np.abs(f - peak) > width) & (np.abs(f - peak) <= 3 * width)
    part = _beyond_white(share, near)
    denser = [np.mean(P[near]) > DENSER * np.mean(P[beside]) for P in (share, power_spectrum(speed, step)[1])]
    line = Line(peak, part, harmonic_number(peak, band, f[1])) if part >= STANDS_OUT and denser[0] else None
    around = NAN if band is None else _beyond_white(share, (f >= band[0] - band[1] / 2) & (f <= band[2] + band[1] / 2))
    spectrum = Spectrum("", swing, float(np.sum(share[~faster])), slow, peak=peak, peak_share=part, line=line,
                        swing_share=around)  # fmt: skip
    return replace(spectrum, sentence=" ".join(spectrum_sentences(spectrum, unit, use, simulated=bool(denser[1]))))


def _beyond_white(share: FloatArray, near: NDArray[np.bool_]) -> float:
    """The share of the power at some frequencies, less what white noise has there."""
    return float(np.sum(share[near]) - np.mean(near))


# --- normality -------------------------------------------------------------------------------------


def _normality(e: FloatArray, thin: FloatArray, variance: Variance, unit: str) -> Normality:
    _, _, ppcc = normal_probability(e)
    A2, p = anderson_darling(thin) if is_testable(thin) else (NAN, NAN)
    z = (e - e.mean()) / e.std()
    lean, tails = float(np.mean(z**3)), float(np.mean(z**4)) - 3
    return Normality(
        normality_sentence(ppcc, shape_phrases(lean, tails, variance, unit), p, thin.size, unit), ppcc, lean, tails,
        anderson_darling=A2, p_value=p,
    )  # fmt: skip


# --- constant variance -----------------------------------------------------------------------------


def _contrasts(e: FloatArray, fitted: FloatArray, speed: FloatArray, whiteness: Whiteness) -> tuple[Contrast, ...]:
    by = (np.arange(e.size, dtype=np.float64), np.abs(fitted - fitted.mean()), np.abs(speed))
    ratios, few = [spread_ratio(e, z) for z in by], e[:: whiteness.thinning]
    if is_testable(few):
        p = [mann_whitney(few), *(breusch_pagan(few, z[:: whiteness.thinning]) for z in by[1:])]
    else:
        p = [fisher(ratio, whiteness.effective_samples / 3) for ratio in ratios]
    return tuple(Contrast(*pair) for pair in zip(ratios, p, strict=True))


# --- level -----------------------------------------------------------------------------------------


def _level(e: FloatArray, step: float | None, unit: str, *, white: bool) -> Level:
    if not e.size:
        return Level("")
    mean, rms = float(np.mean(e)), float(np.sqrt(np.mean(e**2)))
    if step is None or not 0 < step < math.inf:
        text = f"rms {with_unit(rms, unit, '.2g')}{offset_phrase(mean, rms, unit)}. No rounding is seen."
        return Level(text, mean, rms)
    said = level_sentence(mean, rms, step, unit, white=white)
    return Level(said, mean, rms, step, steps=rms / step, floor=step / math.sqrt(12))
