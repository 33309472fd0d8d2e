"""The sentences of a residual analysis."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from fracid.arrays import FloatArray
from fracid.findings import Words
from fracid.signals.left_over import ROUNDING, SIGNIFICANT, TESTABLE
from fracid.units import plain, signed, with_time_unit, with_unit
from fracid.validation.residual_records import Contrast, Spectrum, Variance, Whiteness

SAYS = Words("validation/residual_sentences.toml")

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

FAST = 0.05
"""Of the swing's period: a correlation shorter than that is not of what swings."""


def words_of(unit: str) -> dict[str, str]:
    """What reads a signal of this unit, and what else an angle has."""
    return dict(SAYS.table["angle" if unit == "rad" else "other"])


def untestable_reason(e: FloatArray, size: float, whole: int, unit: str) -> str:
    """Why there is nothing to test, or nothing."""
    if not e.size:
        return SAYS("no-residual")
    if e.size < TESTABLE:
        return SAYS("few-fitted" if e.size < whole else "few", count=e.size, least=TESTABLE)
    if np.abs(e).max() <= 1e-12 * size:
        return SAYS("nothing-left")
    if np.ptp(e) <= 1e-9 * np.abs(e).max():
        return SAYS("constant", count=e.size, value=with_unit(e[0], unit, ".2g"), of=words_of(unit))
    return ""


def correlation_cause(found: Whiteness, step: float, swing: float | None, use: str, *, rounding: bool) -> str:
    """Where a correlation comes from, most likely."""
    T = found.correlation_time / step
    if found.lag_one < 0 and T < 10:
        return SAYS("alternates")
    if rounding:
        return SAYS("at-floor")
    if swing and found.correlation_time * swing < FAST:
        return SAYS("short", period=with_time_unit(1 / swing, ".2g"))
    return SAYS(f"lacks-{use}", times=plain(math.sqrt(T)))


def whiteness_sentence(found: Whiteness, n: int, cause: str) -> str:
    """What the autocorrelation shows, and how many samples count."""
    code = "white" if found.p_value >= SIGNIFICANT else "next-to-white" if found.white else "autocorrelated"
    return SAYS(code, n=n, p=_p(found.p_value), lag_one=signed(found.lag_one), count=found.effective_samples,
                time=with_time_unit(found.correlation_time, ".2g"), cause=cause)  # fmt: skip


def spectrum_sentences(spectrum: Spectrum, unit: str, use: str, *, simulated: bool) -> Iterator[str]:
    """What the spectrum shows: drift, the swing's band, a line, which the simulated motion may have too."""
    line, slow = spectrum.line, SAYS("slow", share=_percent(spectrum.slow_share), below=spectrum.slow_below)
    if spectrum.slow_share >= DRIFT:
        yield SAYS("drift", slow=slow, of=words_of(unit))
    elif line is None and spectrum.swing and spectrum.swing_share >= BROAD:
        what = SAYS("harmonic-1") + SAYS(f"remedy-{use}", of=words_of(unit))
        yield SAYS("swing", share=_percent(spectrum.swing_share), swing=spectrum.swing, what=what, slow=slow)
    elif line is None:
        yield SAYS("no-line", slow=slow)
    if line is None:
        return
    if line.harmonic is None:
        where = SAYS("own-peak" if simulated else "no-multiple" if spectrum.swing else "no-peak", swing=spectrum.swing)
        code = "harmonic-1" if simulated else "other-part"
    else:
        where = SAYS("own-frequency" if line.harmonic == 1 else "multiple", times=line.harmonic)
        code = f"harmonic-{line.harmonic if line.harmonic < 4 else line.harmonic - 2}"
    what = SAYS(code, of=words_of(unit)) + SAYS(f"remedy-{use}", of=words_of(unit)) * (code == "harmonic-1")
    yield SAYS("line", share=_percent(line.share), frequency=line.frequency, where=where, what=what)


def normality_sentence(ppcc: float, shape_and_cure: tuple[str, str], p: float, independent: int, unit: str) -> str:
    """What the distribution shows, and what to do."""
    tested = SAYS("tested" if math.isfinite(p) else "too-few", p=_p(p), count=independent)
    if ppcc >= NORMAL:
        return SAYS("normal-but" if p < SIGNIFICANT else "normal", ppcc=ppcc, tested=tested, of=words_of(unit))
    shape, cure = shape_and_cure
    return SAYS("not-normal" if p < SIGNIFICANT else "perhaps", ppcc=ppcc, shape=shape, tested=tested, cure=cure)


def shape_phrases(lean: float, tails: float, variance: Variance, unit: str) -> tuple[str, str]:
    """In what a distribution differs most from the normal one, and what to do."""
    if abs(lean) > 0.5 and lean**2 > 0.5 * tails:  # of gamma's family tails = 1.5 lean²
        return f"longer {'above' if lean > 0 else 'below'} than on the other side", SAYS("cure-lean")
    if tails > 0:
        return "with heavy tails", SAYS("cure-spread" if any(c.sure for c in variance.contrasts) else "cure-far")
    return "with cut tails", SAYS("cure-cut", of=words_of(unit))


CONTRASTS = ("late", "far", "fast")
"""Of each the words say where it is, what a residual suggests that is larger there, and one that is smaller."""


def variance_sentence(contrasts: tuple[Contrast, ...], effective_samples: float, unit: str, use: str) -> str:
    """What the spread over time, size and speed shows."""
    pairs = [(c, name) for c, name in zip(contrasts, CONTRASTS, strict=True) if math.isfinite(c.ratio)]
    uneven = [(c, name) for c, name in pairs if c.uneven]
    if not uneven:
        return SAYS("even", worst=max((max(c.ratio, 1 / c.ratio) for c, _ in pairs), default=1.0))
    sure = [(c, name) for c, name in uneven if c.sure]
    text = ", ".join(f"{plain(c.ratio)} times as large {SAYS(name)}{_tail(c)}" for c, name in sure or uneven)
    if not sure:
        return SAYS("by-chance", text=text, worth=effective_samples)
    most, name = _telling(sure)
    cause = SAYS(f"{name}-{'larger' if most.ratio > 1 else 'smaller'}", of=words_of(unit))
    return SAYS("uneven", text=text, cause=cause, allowed=SAYS(f"allowed-{use}"))


def _telling(sure: list[tuple[Contrast, str]]) -> tuple[Contrast, str]:
    """Which contrast's hint to give.

    Where a motion dies away early is far and fast too, so the record's beginning has the word.  Where a swing is far it
    is slow: of two contrasts that say the same, the one that says where the residual is larger.
    """
    first, name = sure[0]
    if name == "late" and first.ratio < 1:
        return first, name
    return max(sure, key=lambda found: found[0].ratio)


def _tail(c: Contrast) -> str:
    return f" ({_p(c.p_value)})" if math.isfinite(c.p_value) else ""


def level_sentence(mean: float, rms: float, step: float, unit: str, white: bool) -> str:
    """What the size of the residual shows beside the encoder's step."""
    floor, of, rest = step / math.sqrt(12), words_of(unit), "noise" if white else "the model or a disturbance"
    steps = f"{plain(rms / step)} steps of the {of['reader']}"
    text = f"rms {with_unit(rms, unit, '.2g')}, {steps}{offset_phrase(mean, rms, unit)}"
    if rms < ROUNDING * floor:
        return SAYS("rounding", text=text, least=floor / step, of=of)
    return SAYS("beyond-rounding", text=text, times=plain(rms / floor), rest=rest, of=of)


def offset_phrase(mean: float, rms: float, unit: str) -> str:
    """Said where a tenth of the power is the mean."""
    text = f", of which a constant {with_unit(mean, unit, '.2g')}: {words_of(unit)['whose']} is off"
    return text if mean**2 > 0.1 * rms**2 else ""


# --- words -----------------------------------------------------------------------------------------


def _p(p: float) -> str:
    return "p < 0.001" if p < 1e-3 else f"p = {p:.2g}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.01 else "less than 1 %"
