"""The cost over the two orders: a point, or a gorge?"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from fracid.arrays import FloatArray
from fracid.estimation.cost_plane import CostPlane, risen
from fracid.figures import Style
from fracid.plots.appearance import (
    CLOUD,
    INK,
    MARKS,
    MEDIUM,
    SMALL,
    cost_label,
    extent,
    finish,
    label,
    new,
    note,
    style_of,
    symbol,
)

ROOM = 0.06
"""A line that is narrower than this part of the plane has no room for its number."""

TICKS = 4
"""At the horizontal axis of one column: orders next to 1 have long numbers."""


def cost_plane(
    plane: CostPlane, *, best: tuple[float, float] | None = None, evaluations: ArrayLike | None = None,
    cost_name: str = "cost", style: str | Style = "screen",
) -> Figure:  # fmt: skip
    """Draw the cost over the plane of two orders: filled by the logarithm of its rise above the least, with lines.

    Where the search went beyond the plane, the legend says from where to where.

    Parameters
    ----------
    plane : CostPlane
        Its cost is infinite or NaN where the simulation diverges: hatched, and said to be.
    best : (lambda, mu), optional
        What was found.
    evaluations : array_like, shape (k, 2), optional
        Where the search has been.
    cost_name : str
        For the colour bar.
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> from fracid.estimation.cost_plane import CostPlane
    >>> orders = np.linspace(0.8, 1.0, 9)
    >>> valley = 1e-3 + (orders[:, None] - 0.86) ** 2 + 9 * (orders - 0.91) ** 2
    >>> figure = cost_plane(CostPlane(("lambda", "mu"), orders, orders, valley), best=(0.86, 0.91), cost_name="itae")
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['order $\\\\mu$ [–]', 'ITAE relative to its least [–]']
    """
    first, second, names = plane.first, plane.second, plane.names
    figure, place = new(7, 5.8, style), ""
    brief = style_of(figure).brief
    axes = figure.subplots()
    if not np.isfinite(plane.cost).all():
        grey = {"fc": "0.88", "ec": "0.6", "hatch": "///", "lw": 0, "zorder": 0}
        axes.fill(first[[0, -1, -1, 0]], second[[0, 0, -1, -1]], label="diverges", **grey)
    if np.isfinite(plane.cost).any():
        _filled(figure, axes, plane, cost_name)
    else:
        note(axes, "every simulation diverges", 0.93)
    _search(axes, evaluations, plane, brief)
    _integers(axes, first, second)
    if best is not None:
        digits = [max(4, 2 - math.floor(math.log10(x[-1] - x[0]))) for x in (first, second)]
        place = "best: " + ", ".join(f"{symbol(n)} = {v:.{d}f}" for n, v, d in zip(names, best, digits, strict=True))
        axes.plot(*best, ls="", label="best" if brief else place, **MARKS["best"])
    axes.set_xlim(extent(np.append(first, best[:1] if best else [])))
    axes.set_ylim(extent(np.append(second, best[1:] if best else [])))
    axes.ticklabel_format(useOffset=False)
    label(axes, "", f"order {symbol(names[0])} [–]", f"order {symbol(names[1])} [–]")
    if brief:
        axes.locator_params(axis="x", nbins=TICKS)
    return finish(figure, f"{cost_label(cost_name)[0]} over the orders", grid=False, caption=place)


def _filled(figure: Figure, axes: Axes, plane: CostPlane, cost_name: str) -> None:
    """Colours by log10 of the cost's rise above its least; of the cost itself where that has no meaning."""
    import matplotlib as mpl

    (height, scale, least), name = risen(plane.cost), cost_label(cost_name)
    shades = mpl.colormaps["Blues_r"](np.linspace(0.3, 1, 26))  # light under black lines
    depth = np.ma.log10(np.maximum(np.ma.masked_invalid(height).T, scale.low))
    levels, places = np.log10(np.geomspace(scale.low, scale.high, 25)), {np.log10(h): t for h, t in scale.levels}
    colours = axes.contourf(plane.first, plane.second, depth, levels=levels, colors=shades, extend="both")
    # Arrows, where the colours end before the costs.
    beyond = (0.03 * (levels[0] > depth.min()), 0.03 * (levels[-1] < depth.max()))
    bar = figure.colorbar(colours, ax=axes, pad=0.02, extendfrac=beyond)
    bar.set_ticks(list(places), labels=list(places.values()))
    bar.ax.tick_params(labelsize=SMALL)
    plain = f"{name[0]}{scale.title.removeprefix('cost')} {name[1]}"  # above the lowest, of a cost that is negative
    bar.set_label(f"{name[0]} relative to its least [–]" if least else plain, fontsize=MEDIUM)
    _lines(axes, (plane.first, plane.second, depth), places, "lines of equal rise" if least else "lines of equal cost")


def _integers(axes: Axes, first: FloatArray, second: FloatArray) -> None:
    """Draw where an order is an integer."""
    for values, line in ((first, axes.axvline), (second, axes.axhline)):
        for order in range(math.floor(values[0]) + 1, math.ceil(values[-1])):
            line(order, color=INK, lw=1.0, ls="--", label="integer orders")


def _lines(axes: Axes, plane: tuple[FloatArray, FloatArray, Any], texts: Mapping[float, str], legend: str) -> None:
    """Draw lines of equal depth with their texts: at most seven of those that lie on the plane."""
    if inside := [v for v in sorted(texts) if plane[2].min() < v < plane[2].max()]:
        some = {v: texts[v] for v in inside[:: -(-len(inside) // 7)]}
        lines = axes.contour(*plane, levels=list(some), colors=INK, linewidths=0.7, linestyles="solid")
        across = np.array([np.ptp(plane[0]), np.ptp(plane[1])])
        roomy = [level for level, path in zip(lines.levels, lines.get_paths(), strict=True)
                 if np.size(path.vertices) and (np.ptp(path.vertices, axis=0) > ROOM * across).all()]  # fmt: skip
        axes.clabel(lines, roomy, fmt=some, fontsize=7, zorder=3.5)
        axes.plot([], [], color=INK, lw=0.7, label=legend)


def _search(axes: Axes, evaluations: ArrayLike | None, plane: CostPlane, brief: bool) -> None:
    """Draw where on the plane the search has been."""
    points = np.asarray([] if evaluations is None else evaluations, float).reshape(-1, 2)
    low, high = np.transpose([axis[[0, -1]] for axis in (plane.first, plane.second)])
    inside = ((points >= low) & (points <= high)).all(axis=1)
    if not points.size:
        return
    count = f"{len(points)}"
    if not inside.all():
        spans = (f"{symbol(n)} {p.min():.2f}–{p.max():.2f}" for n, p in zip(plane.names, points.T, strict=True))
        count = f"{np.count_nonzero(inside)} of {len(points)} in this window; all: {', '.join(spans)}"
    axes.plot(*points[inside].T, ls="", rasterized=bool(len(points) > CLOUD),
              label="evaluations" if brief else f"evaluations ({count})", **MARKS["tried"])  # fmt: skip
