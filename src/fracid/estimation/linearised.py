r"""What each run teaches about derivatives: Broyden's method, in few coordinates.

Near a point whose derivatives are known the rows F of a recording, of which :math:`\tfrac12|F|^2` has the slope of the
cost, are a line, :math:`F(x + δ) ≈ F + Jδ`.  A run at :math:`x + δ` shows what J misses, and the least change of J that
mends it is Broyden's [B]_,

.. math::  J ← J + (F(x + δ) - F(x) - Jδ)\, b', \qquad b = D^2δ/|Dδ|^2

with D the norms of the columns.  All that is in the span of the columns of the first J and of the rows seen since, some
thirty directions: in coordinates of those J is a small matrix, a step of it costs nothing beside a run, and so the way
to a minimum close by is as many runs as it has steps.

References
----------
.. [B] C. G. Broyden, Math. Comp. 19 (1965) 577: the least change of J that gives a known difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.estimation.bounded import lowest
from fracid.estimation.side_by_side import Walk
from fracid.estimation.tangent import AtPoint, Tangent
from fracid.optimise import Evaluation


@dataclass(frozen=True, eq=False)
class Linearised(AtPoint):
    """A point near a tangent, and what the runs on the way there add to its derivatives."""

    near: Tangent
    tangent: Tangent
    """The point with the derivatives of the tangent near it."""
    axes: tuple[FloatArray, ...]
    """Orthonormal: those of the tangent's columns, shape (n_rows, n_unknowns), and of each run, shape (n_rows,)."""
    J: FloatArray
    """Shape (n_axes, n_unknowns)."""
    F: FloatArray
    """Shape (n_axes,)."""

    @property
    def evaluation(self) -> Evaluation:  # type: ignore[override]
        """The point, its cost and its rows."""
        return self.tangent.evaluation

    def step(self, held: Sequence[int] = (), moved: FloatArray | float = 0.0) -> FloatArray:
        """To the least of the parabola within the bounds, with what is `held` moved so far, shape (n_unknowns,)."""
        space, delta = self.near.problem.space, np.zeros(len(self.x)) + moved
        free = np.setdiff1d(np.arange(len(self.x)), [*held, *np.flatnonzero(self.near.problem.absent(self.x))])
        low, high = (space.lower - self.x)[free], (space.upper - self.x)[free]
        delta[free] = lowest(self.J[:, free], self.F + self.J @ delta, low, high)
        return delta

    def foreseen(self, delta: FloatArray) -> float:
        """By how much V rises from x to x + δ, were it the parabola."""
        ahead = self.J @ delta
        return float(0.5 * ahead @ ahead + ahead @ self.F)

    def at(self, x: FloatArray) -> Walk[Linearised | None]:
        """Another point, with derivatives that agree with the way there; None where its run fails."""
        there = yield from self.near.there(x)
        if there is None:
            return None
        F, axis = _coordinates(self.axes, self.near.pulls(there.errors, there.x))
        J, before, delta = np.vstack([self.J, np.zeros(len(x))]), np.append(self.F, 0.0), there.x - self.x
        if np.any(delta):
            scaled = self.near.norms * delta
            J = J + np.outer(F - before - J @ delta, self.near.norms * scaled / float(scaled @ scaled))
        return Linearised(self.near, there, (*self.axes, axis), J=J, F=F)

    def taught(self, by: Linearised) -> Linearised:
        """The same point with the derivatives of another one, that was found from it."""
        return replace(self, axes=by.axes, J=by.J, F=np.append(self.F, 0.0))


def linearised(near: Tangent) -> Linearised:
    """The rows at a tangent in coordinates of its own columns."""
    rows = near.rows
    Q, R = np.linalg.qr(rows[:, :-1])
    F, axis = _coordinates((Q,), rows[:, -1])
    return Linearised(near, near, (Q, axis), J=np.vstack([R, np.zeros(R.shape[1])]), F=F)


def _coordinates(axes: tuple[FloatArray, ...], F: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Those of F, and the axis that they add."""
    rest, parts = F, []
    for axis in axes:
        part = axis.T @ rest
        rest = rest - axis @ part if axis.ndim == 2 else rest - part * axis
        parts.append(np.atleast_1d(part))
    size = float(np.linalg.norm(rest))
    return np.concatenate([*parts, [size]]), rest / size if size > 0 else rest
