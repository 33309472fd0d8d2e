"""How values and names are shown to people: angles in degrees, all else in its own unit; ``alpha`` as α.

Inside, everything is SI, angles in radians.  A recording says the unit of each of its signals; where nothing says
otherwise a signal is an angle.

>>> with_unit(0.0038, "rad"), with_unit(0.0038, "V"), with_unit(0.0038, "1")
('0.218°', '0.0038 V', '0.0038')
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ",
    "iota": "ι", "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ",
    "tau": "τ", "upsilon": "υ", "phi": "φ", "chi": "χ", "psi": "ψ", "omega": "ω",
}  # fmt: skip
"""The letter of an angle or an order that is called by its name."""

SHOWN_UNITS = {"rad": ("°", 180 / math.pi), "rad/s": ("°/s", 180 / math.pi)}
"""Unit of a signal: how it is shown, and the factor to it; what is not here is shown as it is."""

LAST_PLACE, FIRST_PLACE = -7, 4
"""Powers of ten at which an interval may end for it to be written without one."""

BESIDE = -10
"""The same for one beside a value without a power of ten: 0.00013361 ± 0.00000091."""

LOPSIDED = 1.15
"""An interval whose longer side is more than this part of its half-width is shown by its ends."""

PLAIN = 0.01
"""A value from here on is written without a power of ten, however narrow its interval."""

MOST = 15
"""Digits that a number has."""


def letter(name: str) -> str:
    """The Greek letter of an angle or an order, other names as they are.

    Examples
    --------
    >>> letter("lambda"), letter("C1")
    ('λ', 'C1')
    """
    return GREEK.get(name, name)


def in_letters(text: str) -> str:
    """A sentence with the Greek letters of angles and orders; names that are typed stay.

    Examples
    --------
    >>> in_letters("theta 0.72°, nu 0.94 ± 0.17; b_theta, order lambda=0.9")
    'θ 0.72°, ν 0.94 ± 0.17; b_theta, order lambda=0.9'
    """
    named = r"(?<![\w.])(?:lambda|mu|nu|theta|alpha|beta|gamma|phi|omega)(?![\w=])"
    return re.sub(named, lambda found: GREEK[found[0]], text)


def shown_unit(unit: str) -> tuple[str, float]:
    """In which unit values of that unit are shown, "" for a pure number, and the factor to it.

    Examples
    --------
    >>> shown_unit("V"), shown_unit("1")
    (('V', 1.0), ('', 1.0))
    """
    return SHOWN_UNITS.get(unit, ("" if unit == "1" else unit, 1.0))


def with_unit(value: float, unit: str = "rad", form: str = ".3g") -> str:
    """Write a value with the unit in which it is shown.

    Parameters
    ----------
    value : float
        [unit]
    unit : str
        SI, as of a recording's signal.
    form : str
        Python's format of the number.

    Examples
    --------
    >>> with_unit(0.5, "rad/s", ".1f"), with_unit(-2.0, "m")
    ('28.6°/s', '-2 m')
    """
    display_unit, factor = shown_unit(unit)
    return f"{factor * value:{form}}{display_unit if display_unit.startswith('°') else f' {display_unit}'.rstrip()}"


def plain(value: float, digits: int = 2) -> str:
    """A size in a sentence: so many digits, and no power of ten before a hundred thousand.

    Examples
    --------
    >>> plain(8.53), plain(132.7), plain(5187.0), plain(0.00123)
    ('8.5', '130', '5,200', '0.0012')
    """
    short = float(f"{value:.{digits}g}")
    return f"{short:,.0f}" if 100 <= abs(short) < 1e5 else f"{short:g}"


def to_second_digit(value: float, half: float) -> str:
    """A value to the second digit of a half-width above 0: both end at the same decimal.

    Examples
    --------
    >>> to_second_digit(0.99996, 0.037), to_second_digit(7e-5, 4e-4), to_second_digit(2274.0, 640.0)
    ('1.000', '0.00007', '2270')
    >>> to_second_digit(0.9800026, 5.2e-06), to_second_digit(9.05e-09, 1.2e-07)
    ('0.9800026', '1e-08')
    """
    place = _last_place(half)
    short = round(value, -place) + 0.0  # no -0
    if LAST_PLACE <= place <= FIRST_PLACE or (BESIDE <= place < LAST_PLACE and abs(short) >= PLAIN):
        return f"{short:.{max(0, -place)}f}"
    digits = math.floor(math.log10(abs(short) or 1.0)) - place + 1
    return f"{short:.{min(max(1, digits), MOST)}g}"


def _last_place(half: float) -> int:
    """The power of ten of a half-width's second digit."""
    return math.floor(math.log10(float(f"{half:.1e}"))) - 1


def typeset_unit(unit: str) -> str:
    """A unit with raised exponents.

    Examples
    --------
    >>> typeset_unit("kg m^2"), typeset_unit("N m s^2/rad^2"), typeset_unit("m s^-2")
    ('kg m²', 'N m s²/rad²', 'm s⁻²')
    """
    return re.sub(r"\^(-?\d)", lambda found: raised(int(found[1])), unit.replace("^nu", "^ν"))


def with_half_width(value: float, half: float) -> str:
    """A value to the second digit of a half-width, and that: with one power of ten, if any; alone where none is known.

    Examples
    --------
    >>> with_half_width(0.914578, 0.00016), with_half_width(0.00013361, 9.1e-07), with_half_width(0.914578, math.inf)
    ('0.91458 ± 0.00016', '(1.3361 ± 0.0091)e-04', '0.9146')
    >>> with_half_width(0.99998674, 1.7e-08)
    '0.999986740 ± 0.000000017'
    """
    if not 0 < half < math.inf:
        return f"{value:.4f}"
    texts = to_second_digit(value, half), shown_half_width(half, value if abs(value) >= PLAIN else 0.0)
    if not any("e" in text for text in texts):
        return " ± ".join(texts)
    power = math.floor(math.log10(max(abs(float(text)) for text in texts)))
    scale = 10.0**-power
    return f"({to_second_digit(scale * value, scale * half)} ± {shown_half_width(scale * half)})e{power:+03d}"


def interval_beside(value: float, low: float, high: float, *, cut: bool = False) -> str:
    """The interval of a value: half of its width, or both ends, where a side is longer or a bound, as 0 is, cuts it.

    Examples
    --------
    >>> interval_beside(0.0042, 0.0037, 0.0047), interval_beside(0.0, 0.0, 1.3e-4), interval_beside(1.0, 1.0, 1.0)
    ('± 0.00050', '0.000000 … 0.000130', '± 0')
    """
    half = (high - low) / 2
    if not half > 0:
        return "± 0"
    if low and high and not cut and max(high - value, value - low) <= LOPSIDED * half:  # ± would reach beyond a bound
        return f"± {shown_half_width(half, value)}"
    return f"{to_second_digit(low, half)} … {to_second_digit(high, half)}"


def with_interval(value: float, low: float, high: float, *, cut: bool = False) -> str:
    """A value and its interval, on whichever side of it that is longer.

    Examples
    --------
    >>> with_interval(0.00013361, 0.0001327, 0.00013452), with_interval(2.5e-7, 0.0, 5.69e-7)
    ('(1.3361 ± 0.0091)e-04', '2.5e-07, 0 … 5.7e-07')
    >>> with_interval(0.91, 0.87, 0.95, cut=True)
    '0.910, 0.870 … 0.950'
    """
    half, beside = (high - low) / 2, interval_beside(value, low, high, cut=cut)
    return f"{to_second_digit(value, half)}, {beside}" if "…" in beside else with_half_width(value, half)


def with_time_unit(seconds: float, spec: str = ".6g") -> str:
    """A duration in the unit that people would use.

    Examples
    --------
    >>> [with_time_unit(t) for t in (0.002, 20.0, 150.0, 21600.0)], with_time_unit(1e4, ".2g")
    (['2 ms', '20 s', '2.5 min', '6 h'], '2.8 h')
    """
    units = (("h", 3600.0, 7200.0), ("min", 60.0, 120.0), ("s", 1.0, 0.1), ("ms", 1e-3, 0.0))
    unit, size = next((unit, size) for unit, size, least in units if seconds >= least)
    return f"{seconds / size:{spec}} {unit}"


def half_of(ends: Sequence[float] | None) -> float:
    """Half the width of an interval; 0 where there is none.

    Examples
    --------
    >>> half_of((0.5, 1.0)), half_of(None)
    (0.25, 0.0)
    """
    return 0.0 if ends is None else (ends[1] - ends[0]) / 2


def shown_half_width(half: float, value: float = 0.0) -> str:
    """The half-width of an interval, to two digits; without a power of ten where the value beside it has none.

    Examples
    --------
    >>> tuple(map(shown_half_width, (0.04, 3.0, 640.0, 8e-5, 5.2e-8)))
    ('0.040', '3.0', '640', '0.000080', '5.2e-08')
    >>> shown_half_width(9.1e-07, 0.00013361), shown_half_width(9.1e-07, 1.3e-05)
    ('0.00000091', '9.1e-07')
    """
    place = _last_place(half)
    if BESIDE <= place < LAST_PLACE and value and "e" not in to_second_digit(value, half):
        return f"{half:.{-place}f}"
    return to_second_digit(half, half)


def number(value: float | None, form: str = ".4g") -> str:
    """A number with a true minus, without a power of ten from 0.0001 up to 100 000; a dash for none.

    Examples
    --------
    >>> number(-0.00123, ".2g"), number(None), number(1.2e-05), number(131.0, ".2g"), number(1e-7)
    ('−0.0012', '–', '1.2×10⁻⁵', '130', '10⁻⁷')
    """
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:{form}}"
    if "e" in text and 1 <= abs(float(text)) < 1e5:
        text = f"{float(text):.0f}"
    return typeset(text)


def typeset(text: str) -> str:
    """Numbers as Python writes them, with a true minus and a raised exponent.

    Examples
    --------
    >>> typeset("-1.2e-05 … 1e+06")
    '−1.2×10⁻⁵ … 10⁶'
    """
    raise_exponent = lambda found: f"×10{raised(int(found[1]))}"  # noqa: E731
    return re.sub(r"(?<![\d.])1×", "", re.sub(r"(?<=\d)e([-+]\d+)", raise_exponent, text)).replace("-", "−")


def signed(value: float, half: float = 0.0) -> str:
    """With its sign, a true minus, to two digits, or to the second of a half-width above 0; an exponent keeps the
    hyphen that it is read back with.

    Examples
    --------
    >>> signed(-0.0123), signed(0.5), signed(0.5, 0.0012)
    ('−0.012', '+0.5', '+0.5000')
    """
    return ("−" if value < 0 else "+") + (to_second_digit(abs(value), half) if half else f"{abs(value):.2g}")


def raised(exponent: int) -> str:
    """An exponent in small figures.

    Examples
    --------
    >>> raised(-12)
    '⁻¹²'
    """
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
