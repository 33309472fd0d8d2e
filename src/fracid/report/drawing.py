"""What templates are filled with: pages, and drawings as SVG; texts are escaped."""

from __future__ import annotations

from functools import cache
from math import isfinite, log10
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from fracid.estimation.records import in_words
from fracid.report.sentences import (
    counted,
    digits,
    interval,
    joined,
    linked,
    said,
    search_sentence,
    unbroken,
    with_error,
)
from fracid.safety.text import printable
from fracid.units import in_letters, letter, number, raised, typeset_unit, with_time_unit


def drawn(template: str, **what: Any) -> Markup:
    """An element ``<svg>`` by a template beside this file."""
    return Markup(filled(template, **what))  # it escapes all that is not marked


def filled(template: str, **what: Any) -> str:
    """A template beside this file, filled."""
    return _templates().get_template(template).render(**what)


@cache
def _templates() -> Environment:
    """Jinja, which escapes all that is not marked."""
    jinja = Environment(loader=PackageLoader("fracid.report", "."), autoescape=True, undefined=StrictUndefined,
                        trim_blocks=True, lstrip_blocks=True, finalize=_seen)  # fmt: skip
    words = (counted, digits, in_letters, in_words, interval, joined, letter, linked, number, said,
             search_sentence, tick, unbroken, with_error, with_time_unit)  # fmt: skip
    jinja.filters |= {word.__name__: word for word in words}
    jinja.tests["finite"] = isfinite
    jinja.filters |= {"short": "{:g}".format, "unit": typeset_unit, "tenth": "{:.1f}".format, "whole": "{:.0f}".format}
    return jinja


def _seen(value: Any) -> Any:
    """A text of a run's without what cannot be seen: it could turn the direction of what stands beside it."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def tick(value: float, log: bool = False) -> str:
    """``0.5``; of a logarithmic axis ``10⁻⁴``."""
    if log and abs(log10(value)) > 2.5:
        return f"10{raised(round(log10(value)))}"
    return number(value, ".6g")
