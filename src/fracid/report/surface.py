"""A surface over two values as SVG, for paper and where no script runs: what ``planes.js`` draws, but for the inset.

Its colours grow with the logarithm of how far the cost rises above its least, so that both the valley's floor and its
walls are seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import log
from typing import Any

import numpy as np
from markupsafe import Markup

from fracid.arrays import FloatArray
from fracid.estimation.cost_plane import Scale
from fracid.report.charts import Axis, steps
from fracid.report.drawing import drawn

WIDTH, HEIGHT, LEFT, TOP, RIGHT, BOTTOM = 540, 400, 70, 10, 108, 44
"""Of the drawing, and the room around the surface [px]."""

BANDS = 32
"""Of colour."""

CIVIDIS = ("00224e", "123570", "3b496c", "575d6d", "707173", "8a8678", "a59c74", "c3b369", "e1cc55", "fee838")
"""As in ``planes.js``."""


@dataclass(frozen=True)
class Surface:
    """What is drawn."""

    names: Sequence[str]
    first: FloatArray
    """Shape (n,), rising."""
    second: FloatArray
    """Shape (m,), rising."""
    height: FloatArray
    """Shape (n, m); not finite where no run ended."""
    scale: Scale
    best: Sequence[float]
    intervals: Sequence[Any] = (None, None)
    """Two ends each, where there are any."""
    integers: Sequence[float | None] = (None, None)
    """Of the two orders, where they have any."""
    tried: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """Where the search has been, shape (k, 2)."""
    keys: Sequence[str] = ()
    """What the orders are called in files."""
    least: float = 0.0
    """The cost that the height is a share of; 0 for none."""

    @property
    def search(self) -> list[tuple[float, float]]:
        """From where to where the search went in each order, where it went beyond the surface."""
        ends = list(zip(self.tried.min(axis=0, initial=np.inf), self.tried.max(axis=0, initial=-np.inf), strict=True))
        beyond = any(a < v[0] or b > v[-1] for (a, b), v in zip(ends, (self.first, self.second), strict=True))
        return ends if beyond else []


def surface_still(surface: Surface) -> Markup:
    """A surface over two values: colours, lines of equal height, the search, the best with its intervals.

    Examples
    --------
    >>> from fracid.estimation.cost_plane import risen
    >>> axis = np.linspace(0.8, 1.0, 9)
    >>> bowl = (axis[:, None] - 0.9) ** 2 + (axis - 0.9) ** 2
    >>> text = surface_still(Surface(("order λ", "order μ"), axis, axis, bowl, risen(1 + bowl)[1], (0.9, 0.9),
    ...                              ([0.88, 0.92], None), tried=np.array([[0.85, 0.9], [0.9, 0.9]])))
    >>> text.count('class="interval"'), 'class="tried"' in text, "order λ" in text
    (1, True, True)
    """
    x = Axis(surface.first[0], surface.first[-1], LEFT, WIDTH - RIGHT)
    y = Axis(surface.second[0], surface.second[-1], HEIGHT - BOTTOM, TOP)
    thick = (y.start - y.end) / BANDS
    shades = [(_colour((k + 0.5) / BANDS), y.start - (k + 1) * thick) for k in range(BANDS)]
    bar = Axis(surface.scale.low, surface.scale.high, y.start, y.end, log=True)
    return drawn("surface.svg.j2", surface=surface, x=x, y=y, width=WIDTH, height=HEIGHT, shades=shades, bar=bar,
                 thick=thick + 0.4, colours=Markup("".join(_colours(surface, x, y))))  # fmt: skip


def _colour(share: float) -> str:
    at = np.linspace(0, 1, len(CIVIDIS))
    channels = (np.interp(share, at, [int(c[k : k + 2], 16) for c in CIVIDIS]) for k in (0, 2, 4))
    return "#" + "".join(f"{round(v):02x}" for v in channels)


def _colours(surface: Surface, x: Axis, y: Axis) -> Iterator[str]:
    """A band over the one below it, which it overlaps, or seams would show; grey where no run ended; lines on top."""
    from contourpy import FillType, LineType, contour_generator

    low, high = surface.scale.low, surface.scale.high
    share = np.log(np.maximum(np.where(np.isfinite(surface.height), surface.height, high), low) / low) / log(high / low)
    masked = np.ma.array(share.T, mask=~np.isfinite(surface.height.T))
    contours: Any = contour_generator(x.at(surface.first), y.at(surface.second), masked, name="serial",
                                      fill_type=FillType.OuterOffset, line_type=LineType.Separate)  # fmt: skip
    yield f'<rect class="failed" x="{x.start}" y="{y.end}" width="{x.end - x.start}" height="{y.start - y.end}"/>'
    for k in range(BANDS):
        shapes, offsets = contours.filled(k / BANDS if k else -1.0, np.inf)
        rings = [shape[a:b] for shape, at in zip(shapes, offsets, strict=True) for a, b in pairwise(at)]
        if rings:
            d = "".join(steps(ring, "z") for ring in rings)
            yield f'<path fill="{_colour((k + 0.5) / BANDS)}" fill-rule="evenodd" transform="scale(.1)" d="{d}"/>'
    for at, _ in surface.scale.levels:
        if lines := contours.lines(log(at / low) / log(high / low)):
            yield f'<path class="level" transform="scale(.1)" d="{"".join(map(steps, lines))}"/>'
