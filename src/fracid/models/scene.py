"""A drawing is a scene: bodies in a plane or in space, each from one point to another: functions of the outputs.

``[model.scene]`` of a project or of the library has a row for each body, the first behind all others::

    [model.scene]
    cart = { shape = "box", from = ["position - 0.1", 0], to = ["position + 0.1", 0], width = 0.1 }
    rod  = { shape = "rod", from = ["position", 0], to = ["position + sin(angle)", "-cos(angle)"] }

A point has x to the right and y up, or x, y and z with z up, in any unit; outputs and parameters may stand in it.  A
body in space is as flat as one in a plane, and faces the reader.  The shapes are

===========  =======================================
``box``      a bar with square ends, `width` thick
``rod``      one with round ends
``disc``     its centre, and a mark on its rim
``spring``   turns of a spring, `width` wide
``vessel``   open above, from the middle of its bottom to that of its rim, `width` wide
===========  =======================================

The page moves it (``scene.js``); :func:`fracid.plots.rig_drawing` and the page's still draw :meth:`Scene.drawn`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from math import cos, hypot, sin
from typing import Any

import numpy as np

from fracid.arrays import ByName, FloatArray
from fracid.errors import InputError
from fracid.models.written.formulas import Formula, formula
from fracid.models.written.tree import Assign, Entry, Expression, Number, Program, parts

SHAPES = ("box", "rod", "disc", "spring", "vessel")

THIN = 0.05
"""Width of a body that says none."""


OPEN = ("spring", "vessel")
"""Those without an inside."""

VIEW = -1.1, 0.42
"""Azimuth and elevation from which a scene in space is seen [rad]; the page's camera begins there too."""


@dataclass(frozen=True)
class Body:
    """One thing that is drawn."""

    name: str
    shape: str
    width: float
    moves: bool
    """Whether an output moves it."""


@dataclass(frozen=True)
class Scene:
    """The bodies of a model."""

    outputs: tuple[str, ...]
    """All of the model's."""
    bodies: tuple[Body, ...]
    program: Program
    """(t, outputs, (), parameters, out): where each body begins and ends, twice `dimension` numbers a body."""
    dimension: int = 2

    @property
    def moved_by(self) -> tuple[str, ...]:
        """The outputs that move something."""
        entries = (e for e in parts(self.program) if isinstance(e, Entry) and e.array == "x")
        used = {int(e.index.value) for e in entries if isinstance(e.index, Number)}
        return tuple(n for i, n in enumerate(self.outputs) if i in used)

    @cached_property
    def _places(self) -> Formula:
        """The program, to be called; written anew each time it would take longer than what it says."""
        return Formula(self.program)

    def at(self, values: ByName, parameters: Sequence[float]) -> FloatArray:
        """Where the bodies begin and end, shape (n_bodies, 2, dimension); an output that is missing is 0.

        NaN where the constants give no finite place.

        Examples
        --------
        >>> import fracid
        >>> cart = fracid.model("cart-pole")
        >>> cart.scene.at({"position": 1.0}, [p.value for p in cart.parameters])[-1].round(2).tolist()
        [[1.0, 0.0], [1.0, -0.3]]
        """
        out = np.full(2 * self.dimension * len(self.bodies), np.nan)
        with suppress(ArithmeticError, ValueError):  # a length that a constant of 0 makes infinite
            self._places(0.0, [values.get(n, 0.0) for n in self.outputs], [], parameters, out)
        return out.reshape(-1, 2, self.dimension)

    def rows(self, write: Callable[[Expression], str]) -> dict[str, dict[str, Any]]:
        """``[model.scene]``, as :func:`scene_of` reads it."""
        texts = [write(s.value) for s in self.program.body if isinstance(s, Assign)]
        points = [texts[k : k + self.dimension] for k in range(0, len(texts), self.dimension)]
        return {b.name: {"shape": b.shape, "from": start, "to": end, "width": b.width}
                for b, start, end in zip(self.bodies, points[::2], points[1::2], strict=True)}  # fmt: skip

    def drawn(self, values: ByName, parameters: Sequence[float]) -> list[tuple[Body, FloatArray]]:
        """The bodies with their outlines on paper, the farthest first."""
        places, depth = on_paper(self.at(values, parameters))
        behind = np.argsort(-depth.mean(axis=1), kind="stable")
        return [(self.bodies[k], outline(self.bodies[k], places[k])) for k in behind]


def scene_of(
    rows: Mapping[str, Mapping[str, Any]], outputs: Iterable[str], parameters: Iterable[str], numbers: ByName
) -> Scene | None:
    """Read the bodies of ``[model.scene]``; None where there is none.

    Raises
    ------
    InputError
        With the body and what is wrong with it.
    """
    outputs = tuple(outputs)
    names: dict[str, Expression] = {n: Number(v) for n, v in numbers.items()}
    names |= {n: Entry("x", Number(i)) for i, n in enumerate(outputs)}
    names |= {n: Entry("p", Number(k), n) for k, n in enumerate(parameters)}
    bodies: list[Body] = []
    body: list[Assign] = []
    dimension = 0
    for name, row in rows.items():
        where = f"[model.scene] {name}"
        if row.get("shape") not in SHAPES:
            raise InputError(f"{where}: shape = {row.get('shape')!r}; expected one of {', '.join(SHAPES)}.")
        texts = [text for end in ("from", "to") for text in _point(where, end, row.get(end))]
        ends = [formula(text, names, where) for text in texts]
        width = row.get("width", THIN)
        if isinstance(width, bool) or not isinstance(width, int | float) or not 0 < width < np.inf:
            raise InputError(f"{where}: width = {width!r}; expected a number above 0.")
        if len(texts) != 2 * (dimension := dimension or len(texts) // 2):
            raise InputError(f"{where}: {len(texts)} coordinates of its ends; those before have {2 * dimension}.")
        moves = any(isinstance(e, Entry) and e.array == "x" for e in parts(tuple(ends)))
        body += [Assign(Entry("out", Number(len(body) + k)), value) for k, value in enumerate(ends)]
        bodies.append(Body(name, row["shape"], float(width), moves))
    places = tuple(f"end_{k}" for k in range(len(body)))
    return Scene(outputs, tuple(bodies), Program(places, (), (), tuple(body)), dimension) if bodies else None


def _point(where: str, end: str, point: Any) -> list[str]:
    if not isinstance(point, list) or len(point) not in (2, 3) or any(isinstance(v, bool | list | dict) for v in point):
        raise InputError(f'{where}: {end} = {point!r}; expected a point, as in {end} = ["position", 0].')
    return [str(v) for v in point]


def on_paper(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points, shape (..., 2) or (..., 3), as they are seen, shape (..., 2), and how far away each is.

    Examples
    --------
    >>> on_paper(np.array([0.0, 0.0, 1.0]))[0].round(3).tolist()
    [0.0, 0.913]
    """
    if points.shape[-1] == 2:
        return points, np.zeros(points.shape[:-1])
    azimuth, elevation = VIEW
    x, y, z = np.moveaxis(points, -1, 0)
    right, back = cos(azimuth) * x - sin(azimuth) * y, sin(azimuth) * x + cos(azimuth) * y
    return np.stack([right, cos(elevation) * z + sin(elevation) * back], -1), cos(elevation) * back - sin(elevation) * z


def outline(body: Body, ends: FloatArray) -> FloatArray:
    """The line about a body, shape (n, 2), that is closed where the body has an inside.

    Examples
    --------
    >>> outline(Body("cart", "box", 2.0, True), np.array([[0.0, 0.0], [4.0, 0.0]])).tolist()
    [[0.0, 1.0], [4.0, 1.0], [4.0, -1.0], [0.0, -1.0], [0.0, 1.0]]
    """
    start, end = ends
    along, length = end - start, hypot(*(end - start))
    across = 0.5 * body.width * np.array([-along[1], along[0]]) / (length or 1.0)
    if body.shape == "disc":
        turn = np.linspace(0, 2 * np.pi, 61)[:, None]
        rim = start + np.cos(turn) * along + np.sin(turn) * np.array([-along[1], along[0]])
        return np.vstack([rim, start])
    if body.shape == "spring":
        share = np.linspace(0, 1, 26)[:, None]
        side = np.where((np.arange(26) < 3) | (np.arange(26) > 22), 0.0, (-1.0) ** np.arange(26))[:, None]
        return np.asarray(start + share * along + side * across)
    if body.shape == "rod":
        turn = np.linspace(0.5, 1.5, 13)[:, None] * np.pi
        ahead = 0.5 * body.width * along / (length or 1.0)
        caps = [at + np.cos(turn) * s * ahead + np.sin(turn) * s * across for at, s in ((start, 1), (end, -1))]
        return np.vstack([*caps, caps[0][:1]])
    corners = [start + across, end + across, end - across, start - across]
    if body.shape == "vessel":
        return np.array([corners[1], corners[0], corners[3], corners[2]])
    return np.array([*corners, corners[0]])
