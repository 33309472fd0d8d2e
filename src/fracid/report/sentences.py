"""What the report says in words: numbers with the digits that they are worth, and the verdict in six lines.

Each of the six lines answers one question that decides whether the next is worth asking:

==========  ==================================================================
claim       is the rig fractional, as far as the recordings tell?
fit         how near does the model come to what it was fitted to?
orders      are they fractional, and does an integer-order rival do as well?
prediction  how near to recordings that it was not fitted to?
values      which of them do the recordings tell, and which not?
checks      did the search end, does the step matter, what is left over?
==========  ==================================================================
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import floor, isfinite, log10
from typing import Any

from fracid.units import GREEK

__all__ = ["digits", "half_width", "joined", "letter", "number", "unit"]


def letter(name: str) -> str:
    """The Greek letter of an angle or an order, other names as they are.

    Examples
    --------
    >>> letter("lambda"), letter("C1")
    ('λ', 'C1')
    """
    return GREEK.get(name, name)


def number(value: float | None, form: str = ".4g") -> str:
    """A number with a true minus; a dash for none.

    Examples
    --------
    >>> number(-0.00123, ".2g"), number(None), number(1.2e-05)
    ('−0.0012', '–', '1.2·10⁻⁵')
    """
    if value is None or not isfinite(value):
        return "–"
    mantissa, _, exponent = f"{value:{form}}".partition("e")
    raised = "·10" + str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")) if exponent else ""
    return mantissa.replace("-", "−") + raised


def digits(estimate: Mapping[str, Any]) -> str:
    """A value of result.json down to the second digit of its 95 % half-width.

    One that lies at a bound is that bound: the search stops a little before it.

    Examples
    --------
    >>> digits({"value": 0.0042925934, "interval95": [0.0037, 0.0049]}), digits({"value": 1.0})
    ('0.00429', '1')
    >>> digits({"value": 2.7e-20, "standard_error": None, "bound": 0.0})
    '0'
    """
    if estimate.get("bound") is not None:
        return number(estimate["bound"], ".6g")
    value, half = estimate.get("value"), half_width(estimate)
    if value is None or not half or value == 0:
        return number(value, ".6g")
    precision = floor(log10(abs(value))) - floor(log10(float(f"{half:.1e}"))) + 2
    return number(value, f".{min(10, max(2, precision))}g")


def half_width(estimate: Mapping[str, Any]) -> float | None:
    """Half of the 95 % interval; None where there is none.

    Examples
    --------
    >>> half_width({"interval95": [0.9, 1.1]})
    0.1
    """
    ends = estimate.get("interval95")
    return None if ends is None else round((ends[1] - ends[0]) / 2, 15)


def unit(text: str) -> str:
    """A unit with raised exponents.

    Examples
    --------
    >>> unit("kg m^2"), unit("N m s^2/rad^2")
    ('kg m²', 'N m s²/rad²')
    """
    return re.sub(r"\^(\d)", lambda found: "⁰¹²³⁴⁵⁶⁷⁸⁹"[int(found[1])], text.replace("^nu", "^ν"))


def joined(words: list[str], last: str = "and") -> str:
    """Words in a row.

    Examples
    --------
    >>> joined(["a", "b", "c"])
    'a, b and c'
    """
    return f" {last} ".join(filter(None, (", ".join(words[:-1]), words[-1] if words else "")))
