"""A surface over two values as SVG: the cost over the orders, for paper and where no script runs.

Its colours grow with the logarithm of how far the cost rises above its least, so that both the valley's floor and its
walls are seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from fracid.arrays import FloatArray
from fracid.report.charts import Axis
from fracid.report.sentences import number

__all__ = ["surface_still"]

SIZE, LEFT, TOP, BOTTOM, RIGHT = 420, 58, 10, 48, 92
"""Of the drawing, and the room around the surface [px]."""

SHADES = 12
"""Colours, and classes ``s0`` … of ``page.css``; the last is where a run failed."""

FLOOR = {"Cost": 0.01, "Rise": 0.5}
"""A rise that looks like none: of a cost as a share of the least, of a profile as it is."""

DEPTH = 1e-3
"""Nor more than this part of the greatest."""


def surface_still(plane: Mapping[str, Any], what: str = "Cost") -> Markup:
    """A surface over two values, with the best, its intervals and a scale.

    Parameters
    ----------
    plane : mapping
        ``names`` of two, ``first`` (n,), ``second`` (m,), ``cost`` (n, m), ``best`` of two, ``intervals`` of two.
    what : str
        ``Cost``, whose rise is shown as a share of the least, or ``Rise``, that of a profile.

    Examples
    --------
    >>> axis = np.linspace(0.8, 1.0, 5)
    >>> plane = {"names": ["order λ", "order μ"], "first": axis, "second": axis,
    ...          "cost": 1 + (axis[:, None] - axis) ** 2, "best": [0.9, 0.9], "intervals": [[0.88, 0.92], None]}
    >>> drawn = surface_still(plane)
    >>> drawn.count('class="interval"'), "order λ" in drawn
    (1, True)
    """
    first, second, cost = (np.asarray(plane[n], dtype=float) for n in ("first", "second", "cost"))
    x, y = Axis(first[0], first[-1], LEFT, SIZE - RIGHT), Axis(second[0], second[-1], SIZE - BOTTOM, TOP)
    rise = cost / np.nanmin(np.where(np.isfinite(cost), cost, np.nan)) - 1 if what == "Cost" else cost
    floor = min(FLOOR[what], DEPTH * (float(rise[np.isfinite(rise)].max(initial=0.0)) or 1.0))
    shades, top = _shades(rise, floor)
    columns, rows = (np.concatenate([a[:1], (a[1:] + a[:-1]) / 2, a[-1:]]) for a in (x.at(first), y.at(second)))
    parts = []
    for i in range(first.size):
        j = 0
        for shade, run in groupby(shades[i].tolist()):  # one rectangle for neighbours of a colour
            k = j + len(list(run))
            parts.append(_rectangle(shade, columns[i], rows[k], columns[i + 1] - columns[i], rows[j] - rows[k]))
            j = k
    parts += [f'<text x="{x.at(v):.1f}" y="{SIZE - BOTTOM + 16}" text-anchor="middle">{number(v, ".6g")}</text>'
              for v in x.ticks(70.0)]  # fmt: skip
    parts += [f'<text x="{LEFT - 6}" y="{y.at(v) + 4:.1f}" text-anchor="end">{number(v, ".6g")}</text>'
              for v in y.ticks(40.0)]  # fmt: skip
    names, middle = [escape(n) for n in plane["names"]], (SIZE - BOTTOM + TOP) / 2
    parts.append(f'<text x="{(LEFT + SIZE - RIGHT) / 2}" y="{SIZE - 8}" text-anchor="middle">{names[0]}</text>')
    turned = f'transform="rotate(-90 14 {middle})"'
    parts.append(f'<text x="14" y="{middle}" text-anchor="middle" {turned}>{names[1]}</text>')
    parts += _scale(top, floor, what == "Cost")
    a, b = float(x.at(plane["best"][0])), float(y.at(plane["best"][1]))
    for ends, axis, upright in zip(plane["intervals"], (x, y), (False, True), strict=True):
        if ends and None not in ends:
            low, high = (float(axis.at(min(max(v, axis.low), axis.high))) for v in ends)
            d = f"M{a:.1f} {low:.1f}V{high:.1f}" if upright else f"M{low:.1f} {b:.1f}H{high:.1f}"
            parts.append(f'<path class="interval" d="{d}"/>')
    parts.append(f'<circle class="best" cx="{a:.1f}" cy="{b:.1f}" r="5"/>')
    name = escape(f"{what} over {plane['names'][0]} and {plane['names'][1]}")
    opened = f'<svg class="still surface" viewBox="0 0 {SIZE} {SIZE}" role="img" aria-label="{name}">'
    return Markup(opened + "".join(parts) + "</svg>")  # the names are escaped


def _shades(rise: FloatArray, floor: float) -> tuple[Any, float]:
    """A number of a colour for each point, and the greatest rise."""
    there = np.isfinite(rise)
    top = float(rise[there].max(initial=0.0)) or 1.0
    share = np.log1p(np.maximum(np.where(there, rise, 0.0), 0.0) / floor) / np.log1p(top / floor)
    return np.where(there, np.minimum((share * SHADES).astype(int), SHADES - 1), SHADES), top


def _scale(top: float, floor: float, percent: bool) -> list[str]:
    """What the colours mean, at the right."""
    left, height = SIZE - RIGHT + 16, (SIZE - BOTTOM - TOP) / SHADES
    base = SIZE - BOTTOM
    parts = [_rectangle(k, left, base - (k + 1) * height, 14, height) for k in range(SHADES)]
    for k in range(0, SHADES + 1, 3):
        rise = floor * np.expm1(k / SHADES * np.log1p(top / floor))
        words = "least" if k == 0 else f"+{number(100 * rise, '.2g')} %" if percent else f"+{number(rise, '.2g')}"
        parts.append(f'<text x="{left + 19}" y="{base - k * height + 4:.1f}">{words}</text>')
    return parts


def _rectangle(shade: int, x: float, y: float, width: float, height: float) -> str:
    # a little larger, or seams show between neighbours
    return f'<rect class="s{shade}" x="{x:.1f}" y="{y:.1f}" width="{width + 0.4:.1f}" height="{height + 0.4:.1f}"/>'
