"""Drawings by templates: SVG whose words are escaped."""

from __future__ import annotations

from functools import cache
from math import log10
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from fracid.report.sentences import letter, number, raised, said

if TYPE_CHECKING:
    from jinja2 import Environment


def drawn(template: str, **what: Any) -> Markup:
    """An element ``<svg>`` by a template beside this file."""
    return Markup(_templates().get_template(template).render(**what))  # it escapes all that is not marked


@cache
def _templates() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    jinja = Environment(loader=PackageLoader("fracid.report", "."), autoescape=True, undefined=StrictUndefined,
                        trim_blocks=True, lstrip_blocks=True)  # fmt: skip
    jinja.filters |= {"letter": letter, "number": number, "said": said, "short": "{:g}".format,
                      "tenth": "{:.1f}".format, "tick": tick, "whole": "{:.0f}".format}  # fmt: skip
    return jinja


def tick(value: float, log: bool = False) -> str:
    """``0.5``; of a logarithmic axis ``10⁻⁴``."""
    if log and abs(log10(value)) > 2.5:
        return f"10{raised(round(log10(value)))}"
    return number(value, ".6g")
