"""Minima that are near: by derivatives that are known already.

A search is dear for its derivatives: one run of all recordings for each unknown, or group of them, at each of its
steps.  The minimum of a problem that is nearly another one (at half the step, say, or one recording of all) is
found from the minimum of that with its J: steps to the x where the residuals r of this problem have J'r = 0, one run
each.  Where its own J differs by a part δ, its own minimum does by about as small a part of what r makes uncertain.
"""

from __future__ import annotations

import numpy as np

from fracid.arrays import FloatArray, IntArray
from fracid.arrowhead import Arrowhead, Blocks
from fracid.errors import Failure
from fracid.estimation.block_jacobian import BlockJacobian
from fracid.estimation.derivatives import by_blocks, rows_and_pulls
from fracid.problem import Problem

ROUNDS = 8
"""Steps, at most."""

SMALL = 1e-3
"""A step that moves every unknown by less than this part of the first is the last."""

STILL = 1e-9
"""Of its range, by which an unknown may be off."""

SHRINKS = 0.3
"""A step of more than this part of the one before has the wrong derivatives."""


def nearly_equal_minimum(problem: Problem, x: FloatArray, other: Problem, jobs: int) -> FloatArray | None:
    """The minimum of `other`, a problem of the same unknowns, from x, the minimum of `problem`, with its derivatives.

    None where a prior pulls, the cost has a corner, an order lies at its bound, a bound stops a step, or the
    derivatives do not lead there: then a search does.
    """
    if problem.priors or not (_smooth(problem) and _smooth(other)):
        return None
    inside = np.flatnonzero((x > problem.space.lower) & (x < problem.space.upper))
    if not len(inside) or not np.all(np.isin(problem.order_indices, inside)):
        return None
    J = by_blocks(problem, x, inside, jobs=jobs)
    return None if isinstance(J, Failure) else _chord(other, x, inside, J)


def derivatives_of_each(problem: Problem, x: FloatArray, jobs: int) -> dict[str, FloatArray]:
    """Of each recording alone by its unknowns, in their order, shape (n_samples, n_outputs, n_unknowns).

    Of none where those of all are not known recording by recording.
    """
    everything = np.arange(len(x))
    J = by_blocks(problem, x, everything, jobs=jobs) if problem.space.blocks is not None and _smooth(problem) else None
    if J is None or isinstance(J, Failure):
        return {}
    columns = (J.blocks.columns(k) for k in range(len(J.parts)))
    parts = (part[..., np.argsort(at)] for part, at in zip(J.parts, columns, strict=True))
    return {e.name: part for e, part in zip(problem.experiments, parts, strict=True)}


def chord_of_one(problem: Problem, x: FloatArray, J: FloatArray) -> FloatArray | None:
    """The minimum of one recording, with its derivatives near there; None where those do not lead to it."""
    blocks = Blocks(np.zeros(len(x), dtype=np.int64), np.array([0, J.shape[0] * J.shape[1]]))
    return _chord(problem, x, np.arange(len(x)), BlockJacobian(blocks, [J], []))


def _smooth(problem: Problem) -> bool:
    """Whether the cost has no corner where a residual is 0."""
    loss = problem.cost_function.loss
    return loss is not None and loss.centre == "mean"


def _chord(problem: Problem, x: FloatArray, free: IntArray, J: BlockJacobian) -> FloatArray | None:
    """Where J'r = 0, from x, the unknowns that are not `free` held; None where steps with J do not lead there."""
    width, moves = problem.space.upper - problem.space.lower, list[float]()
    size = np.where(np.isfinite(width), width, np.maximum(np.abs(x), 1.0))[free]
    for _ in range(ROUNDS):
        errors = problem.errors(x)
        if isinstance(errors, Failure):
            return None
        step = Arrowhead.of(J.blocks, rows_and_pulls(problem, errors, J.parts)).solution()
        x = x.copy()
        x[free] += step
        if np.any((x < problem.space.lower) | (x > problem.space.upper)):
            return None
        moves.append(float(np.max(np.abs(step) / size, initial=0.0)))
        if moves[-1] <= max(SMALL * moves[0], STILL):
            return x
        if len(moves) > 1 and moves[-1] > SHRINKS * moves[-2]:
            return None
    return None
