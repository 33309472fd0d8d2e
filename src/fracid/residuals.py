r"""What a fit leaves over, and what that says of the model.

The residual :math:`e_t`, measured minus simulated, of a good model is white noise as small as the encoder allows.
:func:`residual_analysis` asks in this order, since each answer decides what the next is worth:

==========  =============================================  =======================================================
question    test                                           size of the effect, which decides
==========  =============================================  =======================================================
whiteness   Ljung-Box [LB]_, up to 10 lags                 correlation time T, effective samples n/(T/step), lag-1
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
.. [LB] G. Ljung, G. Box, Biometrika 65 (1978) 297.
.. [BH] G. Bayley, J. Hammersley, J. Roy. Statist. Soc. Suppl. 8 (1946) 184: the two numbers of effective samples.
.. [S] A. Sokal, in Functional Integration: Basics and Applications, NATO ASI B 361 (1997) 131: where to stop the sum.
.. [AD] T. Anderson, D. Darling, J. Amer. Statist. Assoc. 49 (1954) 765.
.. [F] J. Filliben, Technometrics 17 (1975) 111.
.. [BP] T. Breusch, A. Pagan, Econometrica 47 (1979) 1287; R. Koenker, J. Econometrics 17 (1981) 107.
.. [MW] H. Mann, D. Whitney, Ann. Math. Statist. 18 (1947) 50, of the sizes |e|: powerful also with some ten samples.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fracid.errors import InputError
from fracid.recording import resolution as lattice
from fracid.units import with_unit

if TYPE_CHECKING:
    from fracid.identify import RecordingFit

__all__ = ["Level", "Line", "Normality", "ResidualAnalysis", "Spectrum", "Variance", "Whiteness", "autocorrelation",
           "correlation_time", "longest_stretch", "power_spectrum", "residual_analysis"]  # fmt: skip

FloatArray = NDArray[np.float64]

SHORT = 30
"""Samples below which nothing is asked."""

ENOUGH = 20
"""Independent samples below which a p-value is not given."""

SIGNIFICANT = 0.05
"""A p-value below this is said to be no chance."""

NEXT_TO_WHITE = 0.75
"""Where so large a part of the samples counts, correlation does not matter: it widens intervals by a seventh."""

NORMAL = 0.985
"""PPCC from which on a shape is normal enough: Laplace's has 0.981, the uniform 0.977, a sine 0.949."""

UNEQUAL = 1.5
"""Ratio of two spreads that is worth naming."""

STANDS_OUT = 0.1
"""Share of the power at one frequency that is worth naming."""

DENSER = 4.0
"""As its neighbours, at least: noise that fades reaches it in one record of a hundred."""

DRIFT = 0.5
"""Share of the power slower than a third of the swing that is a drift; fading noise has less."""

AT_THE_FLOOR = 1.3
"""Of rounding's own rms: below it the encoder is all there is to see."""

FAST = 0.05
"""Of the swing's period: a correlation shorter than that is not of what swings."""

NAN = math.nan


@dataclass(frozen=True)
class Whiteness:
    """Whether the residual is correlated in time, and how much of it counts."""

    sentence: str
    """What it means and what to do."""
    white: bool = False
    """No correlation is seen, or too little to matter."""
    lags: int = 0
    """Of the Ljung-Box test."""
    statistic: float = NAN
    """Its Q."""
    p_value: float = NAN
    """On all samples; of whiteness itself, so it needs no thinning."""
    lag_one: float = NAN
    """Correlation of neighbours."""
    correlation_time: float = NAN
    """T [s]."""
    effective_samples: float = NAN
    """As many independent ones would know as much."""
    thinning: int = 0
    """k: the tests below have every k-th sample."""
    thinned_samples: int = 0
    thinned_p_value: float = NAN
    """Of Ljung-Box on the thinned residual: a small one says that it is not thin enough."""


@dataclass(frozen=True)
class Line:
    """A frequency that stands out."""

    frequency: float
    """[Hz]"""
    share: float
    """Of the power, within a tenth of the frequency, less what white noise has there."""
    harmonic: int | None
    """Which multiple of the swing's frequency it is, 1 to 5; None if it is none."""


@dataclass(frozen=True)
class Spectrum:
    """At which frequencies the residual has its power."""

    sentence: str
    """What it means and what to do."""
    swing: float | None = None
    """Where the fitted motion has its peak [Hz]; None if it does not swing."""
    slow_share: float = NAN
    """Of the power, slower than :attr:`slow_below`."""
    slow_below: float = NAN
    """A third of the swing, or three periods a record [Hz]."""
    peak: float = NAN
    """The strongest frequency above that [Hz]."""
    peak_share: float = NAN
    """Its share of the power."""
    line: Line | None = None
    """The strongest frequency, if it stands out."""


@dataclass(frozen=True)
class Normality:
    """Whether the residual is distributed normally."""

    sentence: str
    """What it means and what to do."""
    ppcc: float = NAN
    """Of all samples: 1 for normal."""
    skewness: float = NAN
    excess_kurtosis: float = NAN
    """0 for normal; −1.2 for rounding, −1.5 for a sine, 3 for Laplace's."""
    anderson_darling: float = NAN
    """A² of the thinned residual."""
    p_value: float = NAN
    """Of A²; NaN where too few samples are independent."""


@dataclass(frozen=True)
class Contrast:
    """The residual's spread where something is large, beside that where it is small."""

    ratio: float = NAN
    """rms about the mean in the upper third, divided by that in the lower."""
    p_value: float = NAN
    """On the thinned residual; where it is too short, of F with as many degrees of freedom as samples count."""

    @property
    def uneven(self) -> bool:
        """Whether it is large enough to be named."""
        return max(self.ratio, 1 / self.ratio) > UNEQUAL

    @property
    def sure(self) -> bool:
        """Whether it is, and is no chance."""
        return self.uneven and self.p_value < SIGNIFICANT


@dataclass(frozen=True)
class Variance:
    """Whether the residual scatters alike throughout."""

    sentence: str
    """What it means and what to do."""
    late_to_early: Contrast = Contrast()
    """Last third of the record to its first; Mann and Whitney's test of the sizes."""
    far_to_near: Contrast = Contrast()
    """By the distance of the fitted value from its mean; Breusch-Pagan."""
    fast_to_slow: Contrast = Contrast()
    """By the size of the fitted speed; Breusch-Pagan."""

    @property
    def contrasts(self) -> tuple[Contrast, Contrast, Contrast]:
        """The three, in that order."""
        return self.late_to_early, self.far_to_near, self.fast_to_slow


@dataclass(frozen=True)
class Level:
    """How large the residual is, beside the encoder."""

    sentence: str
    """What it means and what to do."""
    mean: float = NAN
    """[rad]"""
    rms: float = NAN
    """[rad]"""
    encoder_step: float | None = None
    """[rad]; None if there is none, or none is seen."""
    steps: float = NAN
    """rms in steps of the encoder."""
    floor: float = NAN
    """What rounding alone leaves, step/√12 [rad]."""


@dataclass(frozen=True)
class ResidualAnalysis:
    """What :func:`residual_analysis` found."""

    recording: str
    """Its name."""
    output: str
    use: str
    """``fit`` or ``validate``."""
    samples: int
    """Looked at: the longest stretch without a gap."""
    missing: int
    """Samples that were not: without a simulated value, or beyond a gap of such."""
    step: float
    """Between samples [s]."""
    whiteness: Whiteness
    spectrum: Spectrum
    normality: Normality
    variance: Variance
    level: Level
    unit: str = "rad"
    """Of the residual."""

    @property
    def sentences(self) -> dict[str, str]:
        """Each question's line of plain words, in the order in which they should be read."""
        said = {
            "whiteness": self.whiteness.sentence,
            "spectrum": self.spectrum.sentence,
            "normality": self.normality.sentence,
            "variance": self.variance.sentence,
            "level": self.level.sentence,
        }
        return {name: sentence for name, sentence in said.items() if sentence}

    def to_json(self) -> dict[str, Any]:
        """Everything as plain JSON values, what is not known as null; angles in radians.

        Examples
        --------
        >>> nothing = ResidualAnalysis("r", "alpha", "fit", 0, 3, 0.01, Whiteness("none"), Spectrum(""),
        ...                            Normality(""), Variance(""), Level(""))
        >>> nothing.to_json()["whiteness"]["p_value"] is None, nothing.sentences
        (True, {'whiteness': 'none'})
        """
        return dict(_plain(asdict(self)))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {n: _plain(v) for n, v in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def residual_analysis(
    recording: RecordingFit, output: str, resolution: Mapping[str, float | None] | None = None
) -> ResidualAnalysis:
    """Test the residual of one output, whiteness first, each result with a line of plain words.

    Parameters
    ----------
    recording : RecordingFit
        On a uniform grid.  Samples without a finite residual are left out; of what they tear apart the longest piece
        is looked at.
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
        If the recording has no such output, or its samples are not evenly spaced.

    References
    ----------
    Those of :mod:`fracid.residuals`.

    Examples
    --------
    >>> from fracid.identify import RecordingFit
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
    if output not in recording.measured:
        raise InputError(f"{recording.name} has no output {output!r}; it has {', '.join(recording.measured)}.")
    step, unit = _step(recording), recording.unit(output)
    whole = recording.residual(output)
    part = longest_stretch(np.isfinite(whole))
    e, fitted = whole[part], np.asarray(recording.fitted[output])[part]
    quantum = lattice(np.asarray(recording.measured[output])) if resolution is None else resolution.get(output)
    size = float(np.abs(np.asarray(recording.measured[output])[part]).max(initial=0.0))
    head = (recording.name, output, recording.use, e.size, whole.size - e.size, step)
    because = _untestable(e, size, whole.size, unit)
    if because:
        none = (Whiteness(because), Spectrum(""), Normality(""), Variance(""))
        return ResidualAnalysis(*head, *none, _level(e, quantum, unit, white=False), unit)
    ρ, speed = autocorrelation(e), np.gradient(fitted, step)
    spectrum = _spectrum(e, speed, step)
    whiteness = _whiteness(e, ρ, step, quantum, spectrum.swing)
    thin = slice(None, None, whiteness.thinning)
    variance = _variance(e, fitted, speed, whiteness)
    return ResidualAnalysis(
        *head, whiteness, spectrum, _normality(e, e[thin], variance), variance,
        _level(e, quantum, unit, white=whiteness.white), unit,
    )  # fmt: skip


def _step(recording: RecordingFit) -> float:
    """The sampling interval [s]."""
    intervals = np.diff(recording.time)
    step = float(np.median(intervals)) if intervals.size else NAN
    if intervals.size and not np.all(np.abs(intervals - step) <= 0.02 * step):
        raise InputError(
            f"The samples of {recording.name} are {intervals.min():.3g} … {intervals.max():.3g} s apart; a residual's "
            "correlation in time needs them evenly spaced: resample the recording (resample = true)."
        )
    return step


def longest_stretch(known: NDArray[np.bool_]) -> slice:
    """The longest stretch without a gap.

    Examples
    --------
    >>> longest_stretch(np.array([True, False, True, True, False]))
    slice(2, 4, None)
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
    starts, ends = edges[::2], edges[1::2]
    if not starts.size:
        return slice(0, 0)
    at = int(np.argmax(ends - starts))
    return slice(int(starts[at]), int(ends[at]))


def _untestable(e: FloatArray, size: float, whole: int, unit: str) -> str:
    """Why there is nothing to test, or nothing."""
    if not e.size:
        return "There is no residual: the simulation failed. Look at the warnings of the fit."
    if e.size < SHORT:
        cut = " have a fitted value, and these" if e.size < whole else ""
        return f"{e.size} samples{cut} are too few to test; {SHORT} are the least."
    if np.abs(e).max() <= 1e-12 * size:
        return "The fitted values are the measured ones but for the rounding of numbers: nothing is left to test."
    if np.ptp(e) <= 1e-9 * np.abs(e).max():
        said = f"All {e.size} residuals are {with_unit(e[0], unit, '.2g')}: the simulation is off by a constant and by "
        if unit != "rad":
            return f'{said}nothing else, so the zero of the signal is: use zero = "rest", or free what it rests at.'
        return (
            f"{said}nothing else, so the zero of the angle or the rest angle is; free it (theta_rest, alpha_rest), or "
            'use zero = "rest".'
        )
    return ""


# --- whiteness -------------------------------------------------------------------------------------


def autocorrelation(x: FloatArray) -> FloatArray:
    """ρ at lags 0 … n/4, about the mean, shape (n//4 + 1,).

    Examples
    --------
    >>> ρ = autocorrelation(np.sin(2 * np.pi * np.arange(4000) / 100))
    >>> round(float(ρ[50]), 1), round(float(ρ[100]), 1)
    (-1.0, 1.0)
    """
    from statsmodels.tsa.stattools import acf  # type: ignore[import-untyped]

    return np.asarray(acf(x, nlags=x.size // 4, fft=True))


def correlation_time(ρ: FloatArray) -> float:
    """The longer of T₁ and T₂, in samples, at least 1; see the module's first screen.

    Parameters
    ----------
    ρ : array, shape (n_lags + 1,)
        From :func:`autocorrelation`.

    Examples
    --------
    >>> fading = 0.9 ** np.arange(1000)  # T₁ = (1 + 0.9)/(1 − 0.9) = 19 samples
    >>> swinging = np.cos(np.arange(1000))  # T₁ is nothing, T₂ as long as you look: 1 + 999/1
    >>> round(correlation_time(fading), 1), round(correlation_time(swinging))
    (19.0, 1000)
    """
    lags = np.arange(ρ.size)

    def time(terms: FloatArray) -> float:
        sums = 2 * np.cumsum(terms) - 1
        wide_enough = np.flatnonzero(lags >= 5 * sums)
        return float(sums[wide_enough[0] if wide_enough.size else -1])

    return max(1.0, time(ρ), time(ρ**2))


def _whiteness(e: FloatArray, ρ: FloatArray, step: float, quantum: float | None, swing: float | None) -> Whiteness:
    T = correlation_time(ρ)
    cause = _cause(float(np.mean(e**2)), float(ρ[1]), T, step, quantum, swing)
    lags, Q, p = _ljung_box(ρ, e.size)
    k = max(2, round(2 * T))
    thin = e[::k]
    return Whiteness(
        _of_whiteness(e.size, T, T * step, float(ρ[1]), p, cause), p >= SIGNIFICANT or T * NEXT_TO_WHITE <= 1,
        lags, Q, p, float(ρ[1]), T * step, e.size / T, k, thin.size,
        _ljung_box(autocorrelation(thin), thin.size)[2] if _enough(thin) else NAN,
    )  # fmt: skip


def _enough(thin: FloatArray) -> bool:
    """Whether a thinned residual can be tested."""
    return thin.size >= ENOUGH and bool(np.ptp(thin) > 0)


def _ljung_box(ρ: FloatArray, n: int) -> tuple[int, float, float]:
    """Lags, Q and p-value.  From ρ by FFT: acorr_ljungbox takes n² steps for it, ten seconds at 20,000 samples."""
    from statsmodels.tsa.stattools import q_stat  # type: ignore[import-untyped]

    lags = min(10, n // 5, ρ.size - 1)
    Q, p = q_stat(ρ[1 : lags + 1], n)
    return lags, float(Q[-1]), float(p[-1])


def _cause(power: float, lag_one: float, T: float, step: float, quantum: float | None, swing: float | None) -> str:
    """Where a correlation comes from, most likely."""
    if lag_one < 0 and T < 10:
        return "neighbours alternate, as after differentiating or sharpening: look at how it was recorded."
    if power < AT_THE_FLOOR**2 * (quantum or 0.0) ** 2 / 12:
        return "at the encoder's floor that is the rounding of a slow motion, and no fault of the model."
    if swing and T * step * swing < FAST:
        return (
            f"beside the swing's {_seconds(1 / swing)} that is so short that it is rather the sensor, its filter or a "
            "vibration than the model."
        )
    return (
        "the model lacks something. Were every sample taken for an independent one, intervals would be "
        f"{_times(math.sqrt(T))} times too narrow; those of fracid fit are not."
    )


def _of_whiteness(n: int, T: float, seconds: float, lag_one: float, p: float, cause: str) -> str:
    count = n / T
    if p >= SIGNIFICANT:
        return f"White, as far as {n:,} samples tell (Ljung-Box {_p(p)}): the model leaves nothing that repeats."
    if count >= NEXT_TO_WHITE * n:
        return (
            f"Next to white: neighbours correlate by {_signed(lag_one)}, which shows because there are {n:,} "
            f"(Ljung-Box {_p(p)}); {count:,.0f} of them count, and nothing need be done."
        )
    return f"Correlated over {_seconds(seconds)}: of {n:,} samples {count:,.0f} count (Ljung-Box {_p(p)}); {cause}"


# --- spectrum --------------------------------------------------------------------------------------


def power_spectrum(x: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies [Hz] and the density of the power about the mean [unit²/Hz], each of shape (n//2 + 1,).

    Without a window, which would hide the first swings after a release: the densities add up to the variance.

    Examples
    --------
    >>> f, S = power_spectrum(np.random.default_rng(1).normal(size=10_000), 1e-3)
    >>> round(float(np.sum(S) * f[1]), 1)  # the variance
    1.0
    """
    from scipy.signal import periodogram

    f, S = periodogram(x, fs=1 / step, detrend="constant")
    return np.asarray(f), np.asarray(S)


def _spectrum(e: FloatArray, speed: FloatArray, step: float) -> Spectrum:
    f, S = power_spectrum(e, step)
    band = _swing(speed, step)
    swing = band[1] if band else None
    slow = float(max(3.5 * f[1], (swing or 0.0) / 3))
    share, faster = S / np.sum(S), f >= slow
    peak = float(f[np.argmax(np.where(faster, S, -1.0))])
    width = max(2.5 * f[1], 0.1 * peak)
    near, beside = np.abs(f - peak) <= width, (np.abs(f - peak) > width) & (np.abs(f - peak) <= 3 * width)
    part = float(np.sum(share[near]) - np.mean(near))
    stands_out = part >= STANDS_OUT and np.mean(share[near]) >= DENSER * np.mean(share[beside])
    line = Line(peak, part, _harmonic(peak, band, f[1])) if stands_out else None
    found = Spectrum("", swing, float(np.sum(share[~faster])), slow, peak, part, line)
    return replace(found, sentence=" ".join(_of_spectrum(found)))


def _swing(speed: FloatArray, step: float) -> tuple[float, float, float] | None:
    """Where the fitted speed has its peak [Hz], between the ends of the band that has half its density and more.

    The speed knows nothing of a plateau; a peak below three periods a record is no swing.
    """
    if np.ptp(speed) <= 1e-12:
        return None
    f, S = power_spectrum(speed, step)
    at = int(np.argmax(S))
    strong = f[S[at] <= 2 * S]
    return (float(strong[0]), float(f[at]), float(strong[-1])) if at >= 3 else None


def _harmonic(f: float, band: tuple[float, float, float] | None, bin_width: float) -> int | None:
    """Which multiple of the swing a frequency is; a damped swing is a band, and so are its multiples."""
    if band is None:
        return None
    low, swing, high = band
    m, margin = round(f / swing), max(1.5 * bin_width, 0.1 * swing)
    return m if 1 <= m <= 5 and m * low - margin <= f <= m * high + margin else None


MISSING = {
    1: "the swing comes out too large, too small or at the wrong time, its damping or period changes otherwise than "
       "the model's. Free Coulomb friction, drag, the cable's spring or an inertia, if they are not (fracid compare "
       "tries them)",
    2: "something differs between left and right: a rest angle, the encoder's zero or centre, friction by direction",
    3: "it bends within each swing, left and right alike: friction that switches at the turning points "
       "(coulomb_...), or the geometry of large swings (C-constants)",
}  # fmt: skip
"""What a multiple of the swing's frequency says of the model; 4 says what 2 says, 5 what 3 says."""


def _of_spectrum(found: Spectrum) -> Iterator[str]:
    if found.slow_share >= DRIFT:
        yield (
            f"{_percent(found.slow_share)} of its power is slower than {found.slow_below:.2g} Hz: a drift. The rest "
            "angle creeps or is off, or the cable or friction holds the rig where the model lets go."
        )
    if found.line is None:
        if found.slow_share < DRIFT:
            slow = f"{_percent(found.slow_share)} of its power is slower than {found.slow_below:.2g} Hz"
            yield f"No frequency stands out, and there is no drift: {slow}."
        return
    line = found.line
    said = f"{_percent(line.share)} of its power lies at {line.frequency:.3g} Hz, "
    if line.harmonic is None:
        other = f"no multiple of the swing's {found.swing:.3g} Hz" if found.swing else "where nothing is simulated"
        yield f"{said}{other}: another part that moves (bench, link, mains), or a motion that the model has not."
    else:
        what = "the swing's own frequency" if line.harmonic == 1 else f"{line.harmonic} times the swing's"
        yield f"{said}{what}: {MISSING[line.harmonic if line.harmonic < 4 else line.harmonic - 2]}."


# --- normality -------------------------------------------------------------------------------------


def _normality(e: FloatArray, thin: FloatArray, variance: Variance) -> Normality:
    from scipy.stats import kurtosis, probplot, skew
    from statsmodels.stats.diagnostic import normal_ad  # type: ignore[import-untyped]

    ppcc = float(probplot(e)[1][2])
    A2, p = map(float, normal_ad(thin)) if _enough(thin) else (NAN, NAN)
    lean, tails = float(skew(e)), float(kurtosis(e))
    return Normality(_of_normality(ppcc, _shape(lean, tails, variance), p, thin.size), ppcc, lean, tails, A2, p)


def _of_normality(ppcc: float, shape_and_cure: tuple[str, str], p: float, independent: int) -> str:
    tested = f"Anderson-Darling {_p(p)} on {_apart(independent)}" if math.isfinite(p) else _too_few(independent)
    if ppcc >= NORMAL:
        seen = "; what the test sees, be it the encoder's steps, is too small to matter" if p < SIGNIFICANT else ""
        return f"Normal enough: PPCC {ppcc:.3f} ({tested}){seen}."
    shape, cure = shape_and_cure
    if not p < SIGNIFICANT:
        return f"Of a shape that is not normal, PPCC {ppcc:.3f}, {shape}; it may be chance ({tested})."
    return f"Not normal: PPCC {ppcc:.3f}, {shape} ({tested}). {cure}"


def _shape(lean: float, tails: float, variance: Variance) -> tuple[str, str]:
    """In what a distribution differs most from the normal one, and what to do."""
    if abs(lean) > 0.5 and lean**2 > 0.5 * tails:  # of gamma's family tails = 1.5 lean²
        side = "above" if lean > 0 else "below"
        return (
            f"longer {side} than on the other side",
            "Look for an offset that comes and goes, or a stop that it hits.",
        )
    if tails > 0 and any(c.sure for c in variance.contrasts):
        return "with heavy tails", "A spread that changes looks so: see the variance."
    if tails > 0:
        return "with heavy tails", (
            'Some samples lie far off: see over time where; if it is the sensor, cost = "huber" gives them less weight.'
        )
    return "with cut tails", "Rounding or a swing left over looks so: see the spectrum and the encoder's step."


def _too_few(independent: int) -> str:
    return f"{_apart(independent)} are too few to test"


def _apart(samples: int) -> str:
    return f"{samples:,} samples two correlation times apart"


# --- constant variance -----------------------------------------------------------------------------


def _variance(e: FloatArray, fitted: FloatArray, speed: FloatArray, whiteness: Whiteness) -> Variance:
    by = (np.arange(e.size, dtype=np.float64), np.abs(fitted - fitted.mean()), np.abs(speed))
    ratios, few = [_ratio(e, z) for z in by], e[:: whiteness.thinning]
    if _enough(few):
        p = [_mann_whitney(few), *(_breusch_pagan(few, z[:: whiteness.thinning]) for z in by[1:])]
    else:
        p = [_fisher(ratio, whiteness.effective_samples / 3) for ratio in ratios]
    contrasts = tuple(Contrast(*pair) for pair in zip(ratios, p, strict=True))
    return Variance(_of_variance(contrasts, whiteness.effective_samples), *contrasts)


def _mann_whitney(e: FloatArray) -> float:
    """The p-value of |e| being larger in the last third than in the first, or smaller."""
    from scipy.stats import mannwhitneyu

    size, third = np.abs(e - np.median(e)), e.size // 3
    return float(mannwhitneyu(size[:third], size[-third:])[1])


def _fisher(ratio: float, freedom: float) -> float:
    """The p-value of a ratio of spreads, each of as many independent samples: Fisher's F."""
    from scipy.stats import f

    return float(2 * f.sf(max(ratio, 1 / ratio) ** 2, freedom, freedom)) if math.isfinite(ratio) else NAN


def _ratio(e: FloatArray, by: NDArray[Any]) -> float:
    """Spread where `by` is in its upper third, divided by that in its lower; NaN where `by` does not vary."""
    if np.ptp(by) <= 1e-12:
        return NAN
    low, high = np.quantile(by, (1 / 3, 2 / 3))
    small, large = e[by <= low] - e.mean(), e[by >= high] - e.mean()
    return float(np.sqrt(np.mean(large**2) / max(np.mean(small**2), 1e-300)))


def _breusch_pagan(e: FloatArray, by: FloatArray) -> float:
    """The p-value of e² rising or falling with `by`; Koenker's form, which needs no normal errors."""
    from statsmodels.stats.diagnostic import het_breuschpagan  # type: ignore[import-untyped]

    if not _enough(e) or np.ptp(by) <= 1e-12:
        return NAN
    return float(het_breuschpagan(e - e.mean(), np.column_stack([np.ones_like(by), by / by.max()]))[1])


GROWS: tuple[tuple[str, str, str], ...] = (
    (
        "in the last third of the record as in the first",
        "the swing's phase or damping runs off: look at an inertia or at friction",
        "what is missing shows while the swing is large: friction (drag, Coulomb), or a term of large angles",
    ),
    (
        "far from the middle as near it",
        "the scale of the encoder, or a term of large angles",
        "friction at the small end, or dead play",
    ),
    (
        "when fast as when slow",
        "the recording's clock or a delay, or friction that grows with speed (drag)",
        "sticking at the turning points: Coulomb friction",
    ),
)
"""For each contrast: where, what a residual suggests that is larger there, and one that is smaller."""


def _of_variance(contrasts: tuple[Contrast, ...], effective_samples: float) -> str:
    known = [(c, texts) for c, texts in zip(contrasts, GROWS, strict=True) if math.isfinite(c.ratio)]
    uneven = [(c, texts) for c, texts in known if c.uneven]
    if not uneven:
        worst = max((max(c.ratio, 1 / c.ratio) for c, _ in known), default=1.0)
        return f"It scatters alike early and late, near and far, slow and fast: within a factor of {worst:.2f}."
    sure = [(c, texts) for c, texts in uneven if c.sure]
    said = ", ".join(f"{_times(c.ratio)} times as large {where}{_tail(c)}" for c, (where, _, _) in sure or uneven)
    if not sure:
        return f"It is {said}; that may be chance, of {effective_samples:,.0f} samples that count."
    most, (_, larger, smaller) = _telling(sure)
    return f"It is {said}. It suggests {larger if most.ratio > 1 else smaller}. The intervals allow for it."


def _telling(sure: list[tuple[Contrast, tuple[str, str, str]]]) -> tuple[Contrast, tuple[str, str, str]]:
    """Which contrast's hint to give.

    Where a motion dies away early is far and fast too, so the record's beginning has the word.  Where a swing is far it
    is slow: of two contrasts that say the same, the one that says where the residual is larger.
    """
    first, texts = sure[0]
    if texts is GROWS[0] and first.ratio < 1:
        return first, texts
    return max(sure, key=lambda found: found[0].ratio)


def _tail(c: Contrast) -> str:
    return f" ({_p(c.p_value)})" if math.isfinite(c.p_value) else ""


# --- level -----------------------------------------------------------------------------------------


def _level(e: FloatArray, step: float | None, unit: str, *, white: bool) -> Level:
    if not e.size:
        return Level("")
    mean, rms = float(np.mean(e)), float(np.sqrt(np.mean(e**2)))
    if step is None or not 0 < step < math.inf:
        said = f"rms {with_unit(rms, unit, '.2g')}{_offset(mean, rms, unit)}. No step of an encoder is seen."
        return Level(said, mean, rms)
    floor = step / math.sqrt(12)
    return Level(_of_level(mean, rms, step, unit, white), mean, rms, step, rms / step, floor)


def _of_level(mean: float, rms: float, step: float, unit: str, white: bool) -> str:
    floor = step / math.sqrt(12)
    said = f"rms {with_unit(rms, unit, '.2g')}, {_times(rms / step)} steps of the encoder{_offset(mean, rms, unit)}"
    if rms < AT_THE_FLOOR * floor:
        return f"{said}: rounding alone leaves {floor / step:.2g}. A better model cannot be seen with this encoder."
    rest = "noise" if white else "the model or a disturbance"
    if rms < 2 * floor:
        return f"{said}: rounding has {_percent((floor / rms) ** 2)} of its power, the rest is {rest}."
    return f"{said}, {_times(rms / floor)} times what rounding leaves: it is {rest}, not the encoder."


def _offset(mean: float, rms: float, unit: str) -> str:
    """Said where a tenth of the power is the mean."""
    whose = "an angle's zero or rest" if unit == "rad" else "the signal's zero or rest"
    said = f", of which a constant {with_unit(mean, unit, '.2g')}: {whose} is off"
    return said if mean**2 > 0.1 * rms**2 else ""


# --- words -----------------------------------------------------------------------------------------


def _p(p: float) -> str:
    return "p < 0.001" if p < 1e-3 else f"p = {p:.2g}"


def _times(factor: float) -> str:
    return f"{factor:,.0f}" if factor >= 100 else f"{factor:.2g}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.01 else "less than 1 %"


def _signed(value: float) -> str:
    return f"{value:+.2g}".replace("-", "−")


def _seconds(t: float) -> str:
    return f"{t:.2g} s" if t >= 0.1 else f"{1e3 * t:.2g} ms"
