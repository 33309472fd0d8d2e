"""The sentences of a residual analysis."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from fracid.arrays import FloatArray
from fracid.signals.left_over import NEXT_TO_WHITE
from fracid.units import with_unit
from fracid.validation.residual_records import SHORT, SIGNIFICANT, Contrast, Spectrum, Variance

NORMAL = 0.985
"""PPCC from which on a shape is normal enough: Laplace's has 0.981, the uniform 0.977, a sine 0.949."""

STANDS_OUT = 0.1
"""Share of the power at one frequency that is worth naming."""

DENSER = 4.0
"""As its neighbours, at least: noise that fades reaches it in one record of a hundred."""

DRIFT = 0.5
"""Share of the power slower than a third of the swing that is a drift; fading noise has less."""

BROAD = 0.5
"""Share of the power around the swing, beyond that of white noise, which says that the swing is missed."""

AT_THE_FLOOR = 1.3
"""Of rounding's own rms: below it the encoder is all there is to see."""

FAST = 0.05
"""Of the swing's period: a correlation shorter than that is not of what swings."""


def untestable_reason(e: FloatArray, size: float, whole: int, unit: str) -> str:
    """Why there is nothing to test, or nothing."""
    if not e.size:
        return "There is no residual: the simulation failed. Look at the warnings of the fit."
    if e.size < SHORT:
        cut = " have a fitted value, and these" if e.size < whole else ""
        return f"{e.size} samples{cut} are too few to test; {SHORT} are the least."
    if np.abs(e).max() <= 1e-12 * size:
        return "The fitted values are the measured ones but for the rounding of numbers: nothing is left to test."
    if np.ptp(e) <= 1e-9 * np.abs(e).max():
        text = f"All {e.size} residuals are {with_unit(e[0], unit, '.2g')}: the simulation is off by a constant and by "
        if unit != "rad":
            return f'{text}nothing else, so the zero of the signal is: use zero = "rest", or free what it rests at.'
        return (
            f"{text}nothing else, so the zero of the angle or the rest angle is; free it (theta_rest, alpha_rest), or "
            'use zero = "rest".'
        )
    return ""


def correlation_cause(
    power: float, lag_one: float, T: float, step: float, quantum: float | None, swing: float | None
) -> str:
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
        "the model lacks something. Intervals that take the samples for independent would be "
        f"{_times(math.sqrt(T))} times too narrow; those of fracid fit allow for it."
    )


def whiteness_sentence(n: int, T: float, seconds: float, lag_one: float, p: float, cause: str) -> str:
    """What the autocorrelation shows, and how many samples count."""
    count = n / T
    if p >= SIGNIFICANT:
        return f"White: no autocorrelation in {n:,} samples (Ljung-Box {_p(p)})."
    if count >= NEXT_TO_WHITE * n:
        return (
            f"Next to white: neighbours correlate by {_signed(lag_one)}, which shows because there are {n:,} "
            f"(Ljung-Box {_p(p)}); {count:,.0f} of them count, and nothing need be done."
        )
    return (
        f"Autocorrelated over {_seconds(seconds)}: {n:,} samples are worth {count:,.0f} independent ones "
        f"(Ljung-Box {_p(p)}); {cause}"
    )


MISSING = {
    1: "the simulated swing is too large, too small or out of phase: its damping or period differs from the "
       "recording's. Free Coulomb friction, drag, the cable's spring, presliding (presliding_...) or an inertia, if "
       "they are fixed (fracid compare tries them)",
    2: "something differs between left and right: a rest angle, the encoder's zero or centre, friction by direction",
    3: "it bends within each swing, left and right alike: friction that switches at the turning points "
       "(coulomb_...), or the geometry of large swings (C-constants)",
}  # fmt: skip
"""What a multiple of the swing's frequency says of the model; 4 says what 2 says, 5 what 3 says."""


def spectrum_sentences(spectrum: Spectrum) -> Iterator[str]:
    """What the spectrum shows: drift, the swing's band, a line."""
    if spectrum.slow_share >= DRIFT:
        yield (
            f"{_percent(spectrum.slow_share)} of its power is slower than {spectrum.slow_below:.2g} Hz: a drift. "
            "The rest angle creeps or is wrong, the axis is tilted, or the cable or friction holds the rig where the "
            "model does not."
        )
    if spectrum.line is None:
        if spectrum.slow_share < DRIFT:
            slow = f"{_percent(spectrum.slow_share)} of its power is slower than {spectrum.slow_below:.2g} Hz"
            if spectrum.swing and spectrum.swing_share >= BROAD:
                yield (
                    f"{_percent(spectrum.swing_share)} of its power lies around the swing's {spectrum.swing:.2g} Hz, "
                    f"with no frequency that stands out: {MISSING[1]}. There is no drift: {slow}."
                )
                return
            yield f"No frequency stands out, and there is no drift: {slow}."
        return
    line = spectrum.line
    text = f"{_percent(line.share)} of its power lies at {line.frequency:.3g} Hz, "
    if line.harmonic is None:
        other = (
            f"no multiple of the swing's {spectrum.swing:.3g} Hz" if spectrum.swing else "where nothing is simulated"
        )
        yield f"{text}{other}: another part that moves (bench, link, mains), or a motion that the model has not."
    else:
        what = "the swing's own frequency" if line.harmonic == 1 else f"{line.harmonic} times the swing's"
        yield f"{text}{what}: {MISSING[line.harmonic if line.harmonic < 4 else line.harmonic - 2]}."


def normality_sentence(ppcc: float, shape_and_cure: tuple[str, str], p: float, independent: int) -> str:
    """What the distribution shows, and what to do."""
    tested = f"Anderson-Darling {_p(p)} on {_apart(independent)}" if math.isfinite(p) else _too_few(independent)
    if ppcc >= NORMAL:
        note = "; the deviation, for instance the encoder's steps, is too small to matter" if p < SIGNIFICANT else ""
        return f"Normal enough: PPCC {ppcc:.3f} ({tested}){note}."
    shape, cure = shape_and_cure
    if not p < SIGNIFICANT:
        return f"Perhaps not normal: PPCC {ppcc:.3f}, {shape}; it may be chance ({tested})."
    return f"Not normal: PPCC {ppcc:.3f}, {shape} ({tested}). {cure}"


def shape_phrases(lean: float, tails: float, variance: Variance) -> tuple[str, str]:
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
    return "with cut tails", "Rounding or a residual swing looks like this: see the spectrum and the encoder's step."


def _too_few(independent: int) -> str:
    return f"{_apart(independent)} are too few to test"


def _apart(samples: int) -> str:
    return f"{samples:,} samples two correlation times apart"


GROWS: tuple[tuple[str, str, str], ...] = (
    (
        "in the last third of the record as in the first",
        "the swing's phase or damping runs off: look at an inertia, or at a joint that gives before it slides "
        "(presliding_...)",
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
        "sticking at the turning points: Coulomb friction, or a joint that gives before it slides (presliding_...)",
    ),
)
"""For each contrast: where, what a residual suggests that is larger there, and one that is smaller."""


def variance_sentence(contrasts: tuple[Contrast, ...], effective_samples: float) -> str:
    """What the spread over time, size and speed shows."""
    pairs = [(c, texts) for c, texts in zip(contrasts, GROWS, strict=True) if math.isfinite(c.ratio)]
    uneven = [(c, texts) for c, texts in pairs if c.uneven]
    if not uneven:
        worst = max((max(c.ratio, 1 / c.ratio) for c, _ in pairs), default=1.0)
        same = "The residual has the same rms early and late, near and far, slow and fast"
        return f"{same}, within a factor of {worst:.2f}."
    sure = [(c, texts) for c, texts in uneven if c.sure]
    text = ", ".join(f"{_times(c.ratio)} times as large {where}{_tail(c)}" for c, (where, _, _) in sure or uneven)
    if not sure:
        worth = f"{effective_samples:,.0f} independent samples"
        return f"The residual's rms is {text}; that may be chance: the residual is worth {worth}."
    most, (_, larger, smaller) = _telling(sure)
    cause = larger if most.ratio > 1 else smaller
    return f"The residual's rms is {text}. That suggests {cause}. The intervals allow for it."


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


def level_sentence(mean: float, rms: float, step: float, unit: str, white: bool) -> str:
    """What the size of the residual shows beside the encoder's step."""
    floor = step / math.sqrt(12)
    text = (
        f"rms {with_unit(rms, unit, '.2g')}, {_times(rms / step)} steps of the encoder{offset_phrase(mean, rms, unit)}"
    )
    if rms < AT_THE_FLOOR * floor:
        return f"{text}: rounding alone leaves {floor / step:.2g}. This encoder cannot distinguish a better model."
    rest = "noise" if white else "the model or a disturbance"
    if rms < 2 * floor:
        return f"{text}: rounding has {_percent((floor / rms) ** 2)} of its power, the rest is {rest}."
    return f"{text}, {_times(rms / floor)} times what rounding leaves: it is {rest}, not the encoder."


def offset_phrase(mean: float, rms: float, unit: str) -> str:
    """Said where a tenth of the power is the mean."""
    whose = "an angle's zero or rest" if unit == "rad" else "the signal's zero or rest"
    text = f", of which a constant {with_unit(mean, unit, '.2g')}: {whose} is off"
    return text if mean**2 > 0.1 * rms**2 else ""


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
