"""A value as a dot, its 95 % interval as a whisker: the orders over one axis with a line at 1, others a row each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil, floor, isfinite
from typing import Any

from markupsafe import Markup, escape

from fracid.report.charts import round_step
from fracid.report.sentences import digits, half_width, interval, letter, number

REACH = 0.12
"""Least half-width of the orders' axis: a whisker that fills it would look uncertain."""

LETTER = 8.6
"""Of a value beside its whisker, its width [px]."""


@dataclass(frozen=True)
class OrderAxis:
    """The axis that all orders of a page, or of an index, share."""

    low: float
    high: float


def _numbers(e: Mapping[str, Any]) -> list[float]:
    integer = e.get("integer", 1.0)
    shown = [e["value"], *(e["interval95"] or ()), *([] if integer is None else [integer])]
    return [v for v in shown if v is not None and isfinite(v)]


def order_axis(orders: list[Mapping[str, Any]]) -> OrderAxis:
    """From the least to the greatest that is to be seen: values, intervals within reason, integer values.

    Examples
    --------
    >>> order_axis([{"value": 0.9, "interval95": [0.89, 0.91]}])
    OrderAxis(low=0.825, high=1.065)
    """
    centres = [v for e in orders for v in (e["value"], e.get("integer", 1.0)) if v is not None and isfinite(v)]
    if not centres:
        return OrderAxis(0.0, 2.0)
    low, high = min(centres), max(centres)
    most = 3 * max(high - low, REACH)  # of an interval: one that is wider ends with an arrow
    ends = [min(max(v, low - most), high + most) for e in orders for v in _numbers(e)]
    low, high = min(ends), max(ends)
    low, high = low - 0.06 * (high - low), high + 0.06 * (high - low)
    short = max(0.0, max(REACH, 1e-6 * abs(high)) - (high - low) / 2)
    return OrderAxis(round(low - short, 4), round(high + short, 4))


def orders_drawn(orders: Mapping[str, Mapping[str, Any]], axis: OrderAxis | None = None, width: int = 400) -> Markup:
    """The orders in rows over one axis, each with its interval as a whisker, and a line at its integer value.

    Examples
    --------
    >>> drawn = orders_drawn({"mu": {"value": 0.9, "interval95": [0.89, 0.91], "standard_error": 0.005, "free": True}})
    >>> "0.900 ± 0.010" in drawn, "μ" in drawn
    (True, True)
    """
    axis = axis or order_axis(list(orders.values()))
    longest = max((len(said(e)) for e in orders.values()), default=0)
    start, end, row = 34.0, width - max(166.0, 16 + LETTER * longest), 30
    foot = row * len(orders) + 4
    scale = (end - start) / (axis.high - axis.low)

    def at(v: float) -> float:
        return start + (v - axis.low) * scale

    step = round_step((axis.high - axis.low) * 38 / (end - start))
    ticks = [k * step for k in range(ceil(axis.low / step - 1e-9), floor(axis.high / step + 1e-9) + 1)]
    parts = [f'<path class="axis" d="M{start} {foot}H{end}{"".join(f"M{at(v):.1f} {foot}v4" for v in ticks)}"/>']
    parts += [f'<text x="{at(v):.1f}" y="{foot + 17}" text-anchor="middle">{number(v, ".6g")}</text>' for v in ticks]
    integers = {e.get("integer", 1.0) for e in orders.values()} - {None}
    parts += [f'<path class="one" d="M{at(v):.1f} 2V{foot}"/>' for v in integers if axis.low <= v <= axis.high]
    for k, (name, e) in enumerate(orders.items()):
        y = row * k + 18
        parts.append(f'<text class="name" x="{start - 10}" y="{y + 5}" text-anchor="end">{escape(letter(name))}</text>')
        parts.append(_drawn(e, at, (start, end), y))
        parts.append(f'<text class="value" x="{end + 12}" y="{y + 5}">{escape(said(e))}</text>')
    sentence = "; ".join(f"{letter(n)} = {said(e)}" for n, e in orders.items())
    name = escape(f"Orders with their 95 % intervals: {sentence}. The line is at the integer value.")
    opened = f'<svg class="whiskers" viewBox="0 0 {width} {foot + 22}" role="img" aria-label="{name}">'
    return Markup(opened + "".join(parts) + "</svg>")  # words are escaped above


def said(e: Mapping[str, Any]) -> str:
    """``0.86252 ± 0.00046``; what there is in its place, where there is no interval."""
    if half_width(e) is not None:
        beside = interval(e)
        return f"{digits(e)}{' ' if beside.startswith('±') else ', '}{beside}"
    return f"{digits(e)} (given)" if not e["free"] else f"{number(e['value'])} (no interval)"


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
    value, ends = e["value"], e["interval95"] or (e["value"], e["value"])
    reach = 2.5 * abs(value - origin) or max(abs(v - origin) for v in ends) or 1.0  # a wider one ends with an arrow
    if "integer" in e:
        reach = max(reach, 0.1)
    shown = [origin, value, *(min(max(v, origin - reach), origin + reach) for v in ends)]
    low, high = float(min(shown)), float(max(shown))
    air = 0.08 * (high - low) or 1.0
    start, end = 6.0, width - 6.0

    def at(v: float) -> float:
        return start + (v - low + air) / (high - low + 2 * air) * (end - start)

    parts = f'<path class="axis" d="M{start} 11H{end}"/><path class="zero" d="M{at(origin):.1f} 4v14"/>'
    parts += _drawn(e, at, (start, end), 11)
    opened = f'<svg class="whisker" width="{width}" height="22" viewBox="0 0 {width} 22" aria-hidden="true">'
    return Markup(opened + parts + "</svg>")  # numbers alone


def _drawn(e: Mapping[str, Any], at: Callable[[float], float], ends: tuple[float, float], y: float) -> str:
    """Dot and whisker; an arrow where the interval leaves the axis."""
    if e["value"] is None:
        return ""
    parts = ""
    if e["interval95"]:
        low, high = (min(max(at(v), ends[0]), ends[1]) for v in e["interval95"])
        parts = f'<path class="interval" d="M{low:.1f} {y}H{high:.1f}"/>'
        for place, value, sign in ((low, e["interval95"][0], 1), (high, e["interval95"][1], -1)):
            inside = ends[0] <= at(value) <= ends[1]
            d = f"M{place:.1f} {y - 5}v10" if inside else f"M{place + 5 * sign:.1f} {y - 5}l{-5 * sign} 5 {5 * sign} 5"
            parts += f'<path class="interval end" d="{d}"/>'
    place = min(max(at(e["value"]), ends[0]), ends[1])
    kind = "dot" if e["interval95"] else "dot hollow"
    return parts + f'<circle class="{kind}" cx="{place:.1f}" cy="{y}" r="4"/>'
