"""A value as a dot, its 95 % interval as a whisker: the orders over one axis with a line at 1, others a row each."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isfinite
from typing import Any

from markupsafe import Markup

from fracid.report.charts import Axis
from fracid.report.drawing import drawn
from fracid.report.sentences import said
from fracid.units import letter

REACH = 0.12
"""Least half-width of the orders' axis: a whisker that fills it would look uncertain."""

SHORT = 3
"""Letters of an order's name that have room beside its interval; a longer one stands above it."""

WIDTH = 400
"""Of the drawing of the orders [px]."""

LETTER = 8.6
"""Of a value beside its whisker, its width [px]."""


def order_axis(orders: list[Mapping[str, Any]]) -> tuple[float, float]:
    """From the least to the greatest that is to be seen: values, intervals within reason, integer values.

    All orders of a page, or of an index, share it.

    Examples
    --------
    >>> order_axis([{"value": 0.9, "interval95": [0.89, 0.91], "integer": 1.0}])
    (0.825, 1.065)
    """
    low, high = _ends(orders, REACH)
    return round(low, 4), round(high, 4)


def _ends(estimates: list[Mapping[str, Any]], least: float) -> tuple[float, float]:
    centres = [v for e in estimates for v in (e["value"], e["integer"]) if v is not None and isfinite(v)]
    if not centres:
        return 0.0, 2.0
    low, high = min(centres), max(centres)
    most = 3 * max(high - low, least) or inf  # of an interval: one that is wider ends with an arrow
    ends = [min(max(v, low - most), high + most) for e in estimates for v in e["interval95"] or () if isfinite(v)]
    low, high = min(low, *ends, high), max(low, *ends, high)
    low, high = low - 0.06 * (high - low), high + 0.06 * (high - low)
    short = (max(least, 1e-6 * max(abs(low), abs(high))) or 1.0) - (high - low) / 2
    return low - max(0.0, short), high + max(0.0, short)


def orders_drawn(orders: Mapping[str, Mapping[str, Any]], ends: tuple[float, float] | None = None) -> Markup:
    """The orders in rows over one axis, each with its interval as a whisker, and a line at its integer value.

    Examples
    --------
    >>> text = orders_drawn({"mu": {"value": 0.9, "interval95": [0.89, 0.91], "integer": 1.0, "free": True}})
    >>> "0.900 ± 0.010" in text, "μ" in text
    (True, True)
    """
    longest = max((len(said(e)) for e in orders.values()), default=0)
    low, high = ends or order_axis(list(orders.values()))
    above = 18 if max((len(letter(n)) for n in orders), default=0) > SHORT else 0
    axis = Axis(low, high, 8.0 if above else 34.0, WIDTH - max(166.0, 16 + LETTER * longest))
    integers = {e["integer"] for e in orders.values()} - {None}
    return drawn("orders.svg.j2", orders=orders, axis=axis, width=WIDTH, above=above,
                 foot=(30 + above) * len(orders) + 4, integers=integers)  # fmt: skip


def whisker(e: Mapping[str, Any], width: int = 180) -> Markup:
    """One value over an axis from zero on, an order from its integer value: an interval that includes that is seen to.

    Examples
    --------
    >>> 'class="zero"' in whisker({"name": "b", "value": 1.0, "interval95": [-0.5, 2.5], "free": True})
    True
    >>> whisker({"name": "b", "value": None, "interval95": None, "free": True})
    Markup('')
    """
    if e["value"] is None or not isfinite(e["value"]):
        return Markup("")
    origin: float = e.get("integer") or 0.0
    axis = Axis(*_ends([{**e, "integer": origin}], 0.1 if "integer" in e else 0.0), 6.0, width - 6.0)
    return drawn("whisker.svg.j2", axis=axis, e=e, width=width, origin=origin)
