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
import tomllib
from collections.abc import Mapping
from math import isfinite
from typing import Any

from markupsafe import Markup, escape

from fracid.optimise.base import Outcome
from fracid.safety.door import own_text
from fracid.safety.text import printable
from fracid.units import half_of, interval_beside, letter, number, to_second_digit, typeset

SEE: dict[str, str] = tomllib.loads(own_text("report/sentences.toml"))
"""Headings that a claim refers to → where they stand on the page."""


def state_letter(name: str) -> str:
    r"""The letters of a state's name, which no line ends within.

    Examples
    --------
    >>> state_letter("D^lambda theta"), state_letter("z_theta")
    ('D^λ\xa0θ', 'z_θ')
    """

    def shown(part: str) -> str:
        return f"D^{letter(part[2:])}" if part.startswith("D^") else letter(part)

    return "\xa0".join("_".join(map(shown, word.split("_"))) for word in name.split())


def in_unit(value: float, shown: tuple[str, float], form: str = ".2g") -> str:
    """A value in the unit that it is shown in, of which the factor is given.

    Examples
    --------
    >>> in_unit(0.5, ("°", 57.3)), in_unit(5.1e-06, ("m", 1.0))
    ('29°', '5.1×10⁻⁶ m')
    """
    unit, factor = shown
    return f"{number(factor * value, form)}{unit if unit.startswith('°') else f' {unit}'.rstrip()}"


def counted(value: float | None) -> str:
    """A count, or a difference of BIC: its thousands apart, below a hundred three figures of it.

    Examples
    --------
    >>> counted(57501.3), counted(12.34), counted(-1840.2)
    ('57,501', '12.3', '−1,840')
    """
    if value is None or not isfinite(value) or abs(value) < 100:
        return number(value, ".3g")
    return f"{value:,.0f}".replace("-", "−")


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
    value, half = estimate.get("value"), half_width_of(estimate)
    return number(value, ".6g") if value is None or not half else typeset(to_second_digit(value, half))


def interval(estimate: Mapping[str, Any]) -> str:
    """The 95 % interval beside its value: ± half of it, or both ends.

    Examples
    --------
    >>> interval({"value": 0.005, "interval95": [-0.015, 0.025]}), interval({"value": 0.0, "interval95": None})
    ('± 0.020', '–')
    """
    ends = estimate.get("interval95")
    if ends is None or estimate.get("value") is None:
        return number(None)
    return typeset(interval_beside(estimate["value"], *ends, cut=estimate.get("cut", False)))


def said(e: Mapping[str, Any]) -> str:
    """``0.86252 ± 0.00046``; what there is in its place, where there is no interval."""
    if half_width_of(e) is not None:
        beside = interval(e)
        return f"{digits(e)}{' ' if beside.startswith('±') else ', '}{beside}"
    return f"{digits(e)} (given)" if not e["free"] else f"{number(e['value'])} (no interval)"


def with_error(value: float | None, error: float | None) -> str:
    """A value to the second digit of its error, and that error.

    Examples
    --------
    >>> with_error(0.000348, 0.002), with_error(12345.6, 2000.0), with_error(9.05e-09, 1.2e-07), with_error(1.0, None)
    ('0.0003 ± 0.0020', '12300 ± 2000', '10⁻⁸ ± 1.2×10⁻⁷', '1 ± –')
    """
    if value is None or not error or not isfinite(error):
        return f"{number(value)} ± {number(error)}"
    return typeset(f"{to_second_digit(value, error)} {interval_beside(value, value - error, value + error)}")


def half_width_of(estimate: Mapping[str, Any]) -> float | None:
    """Half of the 95 % interval; None where there is none.

    Examples
    --------
    >>> half_width_of({"interval95": [0.9, 1.1]})
    0.1
    """
    ends = estimate.get("interval95")
    return None if ends is None else round(half_of(ends), 15)


def described(text: str) -> str:
    """A description of a constant with true minus signs, Greek letters and indices.

    Examples
    --------
    >>> described("C2 - I2xx"), described("tau_C = -f tanh(rate / slip_speed), half-open")
    ('C2 − I₂ₓₓ', 'τ_C = −f tanh(rate / slip_speed), half-open')
    """
    text = re.sub(r"(?<!\w)-(?=[\s\w])", "−", text.replace("I2xx", "I₂ₓₓ"))
    return re.sub(r"\b([a-z]+)_(?=[A-Z]\b)", lambda found: f"{letter(found[1])}_", text)


def search_sentence(outcome: str) -> str:
    """How a search ended.

    Examples
    --------
    >>> search_sentence("all generations done")
    'The search did not converge: all generations done.'
    """
    return "The search converged." if outcome == Outcome.CONVERGED else f"The search did not converge: {outcome}."


def joined(words: list[str], last: str = "and") -> str:
    """Words in a row.

    Examples
    --------
    >>> joined(["a", "b", "c"])
    'a, b and c'
    """
    return f" {last} ".join(filter(None, (", ".join(words[:-1]), words[-1] if words else "")))


def unbroken(sentence: str) -> str:
    """A sentence that breaks at no space before a unit, its powers of ten raised where they are not to be typed.

    Examples
    --------
    >>> unbroken("b fell from 2.4e-03 to 3e-5; type tolerance = 1e-8")
    'b fell from 2.4×10⁻³ to 3×10⁻⁵; type tolerance = 1e-8'
    >>> unbroken("a fit of 95.7 %, 55.79 s at 500 Hz, and 3 sentences").split(" ")
    ['a', 'fit', 'of', '95.7\xa0%,', '55.79\xa0s', 'at', '500\xa0Hz,', 'and', '3', 'sentences']
    """
    raised = re.sub(r"(?<![\w.])(?<!= )\d+(?:\.\d+)?e[-+]?\d+(?!\w|\.\d)", lambda found: typeset(found[0]), sentence)
    return re.sub(r"(?<=\d) (?=(?:%|s|ms|min|h|Hz|V|mV|m|A|N|steps?|times)\b|%)", "\N{NO-BREAK SPACE}", raised)


def linked(sentence: str) -> Markup:
    """A sentence whose ``(see Fit)`` leads there.

    Examples
    --------
    >>> linked("It swings < 1°, but b is off (see Each recording alone).")
    Markup('It swings &lt; 1°, but b is off (<a href="#alone">see Each recording alone</a>).')
    """
    text = str(escape(unbroken(printable(sentence))))
    for heading, at in SEE.items():
        text = text.replace(f"(see {heading})", f'(<a href="#{at}">see {heading}</a>)')
    return Markup(text)  # escaped above
