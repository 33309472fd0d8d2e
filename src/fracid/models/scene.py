"""A drawing is a scene: bodies in a plane, each from one point to another, which are functions of the outputs.

``[model.scene]`` of a project or of the library has a row for each body, the first behind all others::

    [model.scene]
    cart = { shape = "box", from = ["position - 0.1", 0], to = ["position + 0.1", 0], width = 0.1 }
    rod  = { shape = "rod", from = ["position", 0], to = ["position + sin(angle)", "-cos(angle)"] }

A point has x to the right and y up, in any unit; outputs and parameters may stand in it.  The shapes are

===========  =======================================
``box``      a bar with square ends, `width` thick
``rod``      one with round ends
``disc``     its centre, and a mark on its rim
``spring``   turns of a spring, `width` wide
``vessel``   open above, from the middle of its bottom to that of its rim, `width` wide
===========  =======================================

The page moves it (``scene.js``), and :func:`fracid.plots.rig_drawing` and the page's still draw its :func:`outline`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.models.written.formulas import Formula, FormulaError, formula
from fracid.models.written.tree import Assign, Entry, Expression, Number, Program, parts

SHAPES = ("box", "rod", "disc", "spring", "vessel")

THIN = 0.05
"""Width of a body that says none."""


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
    """(t, outputs, (), parameters, out): x and y of where each body begins and ends, four numbers a body."""

    @property
    def moved_by(self) -> tuple[str, ...]:
        """The outputs that move something."""
        entries = (e for e in parts(self.program) if isinstance(e, Entry) and e.array == "x")
        used = {int(e.index.value) for e in entries if isinstance(e.index, Number)}
        return tuple(n for i, n in enumerate(self.outputs) if i in used)

    def at(self, values: Mapping[str, float], parameters: Sequence[float]) -> FloatArray:
        """Where the bodies begin and end, shape (n_bodies, 2, 2): body, end, x and y; outputs that are missing are 0.

        Examples
        --------
        >>> import fracid
        >>> cart = fracid.model("cart-pole")
        >>> cart.scene.at({"position": 1.0}, [p.value for p in cart.parameters])[-1].round(2).tolist()
        [[1.0, 0.0], [1.0, -0.3]]
        """
        out = np.zeros(4 * len(self.bodies))
        Formula(self.program)(0.0, [values.get(n, 0.0) for n in self.outputs], [], parameters, out)
        return out.reshape(-1, 2, 2)


def scene_of(
    rows: Mapping[str, Mapping[str, Any]], outputs: Iterable[str], parameters: Iterable[str],
    numbers: Mapping[str, float],
) -> Scene | None:  # fmt: skip
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
    for name, row in rows.items():
        where = f"[model.scene] {name}"
        if row.get("shape") not in SHAPES:
            raise InputError(f"{where}: shape = {row.get('shape')!r}; expected one of {', '.join(SHAPES)}.")
        texts = [text for end in ("from", "to") for text in _point(where, end, row.get(end))]
        try:
            ends = [formula(text, names) for text in texts]
        except FormulaError as error:
            raise error.at(where) from None
        width = row.get("width", THIN)
        if isinstance(width, bool) or not isinstance(width, int | float) or not 0 < width < np.inf:
            raise InputError(f"{where}: width = {width!r}; expected a number above 0.")
        moves = any(isinstance(e, Entry) and e.array == "x" for e in parts(tuple(ends)))
        body += [Assign(Entry("out", Number(len(body) + k)), value) for k, value in enumerate(ends)]
        bodies.append(Body(name, row["shape"], float(width), moves))
    places = tuple(f"end_{k}" for k in range(len(body)))
    return Scene(outputs, tuple(bodies), Program(places, (), (), tuple(body))) if bodies else None


def _point(where: str, end: str, point: Any) -> tuple[str, str]:
    if not isinstance(point, list) or len(point) != 2 or any(isinstance(v, bool | list | dict) for v in point):
        raise InputError(f'{where}: {end} = {point!r}; expected a point, as in {end} = ["position", 0].')
    return str(point[0]), str(point[1])


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
    corners = [start + across, end + across, end - across, start - across]
    if body.shape == "vessel":
        return np.array([corners[1], corners[0], corners[3], corners[2]])
    return np.array([*corners, corners[0]])
