r"""What the errors of a minimum depend on: their derivatives by the unknowns, and the rows that these make.

:func:`jacobian` takes central differences of measured minus simulated, within the bounds; :func:`by_blocks` the same of
many recordings with unknowns of their own, without its zeros.  With weights w and a loss ρ, rows
:math:`R = \sqrt{wρ''}\,J` give the curvature :math:`A = R'R` of the cost and scores :math:`w\,ρ'J` its gradient.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray, joined
from fracid.errors import Failure, FailureReason
from fracid.estimation.block_jacobian import BlockJacobian, block_jacobian
from fracid.problem import Problem
from fracid.problem.costs import Loss
from fracid.tasks.job import in_threads

DIFFERENCE = 1e-5
"""Of the size of an unknown, by which it is differentiated."""


def jacobian(problem: Problem, x: FloatArray, free: NDArray[np.intp], *, jobs: int = 1) -> list[FloatArray] | Failure:
    """∂e/∂x of each recording by central differences, shape (n_samples, n_outputs, n_free); runs go on threads.

    Beside a bound, and beside runs that fail (a minimum next to det M = 0), the difference is one-sided.  Of what no
    small step brings in (:meth:`fracid.problem.Problem.absent`) it is 0.
    """
    absent, space = problem.absent(x), problem.space
    steps = difference_steps(problem, x)
    here = problem.errors(x)
    if isinstance(here, Failure):
        return here
    J = [np.zeros((*e.shape, len(free))) for e in here]

    def differentiate(columns: list[int]) -> Failure | None:
        changes = [steps * (np.arange(len(x)) == free[c]) for c in columns]
        ends = [[np.clip(x + side * change, space.lower, space.upper) for side in (1, -1)] for change in changes]
        found = iter(problem.simulator.all_errors([end for pair in ends for end in pair]))
        for column, pair in zip(columns, ends, strict=True):
            i, sides = free[column], [next(found), next(found)]
            good = [(here, x) if isinstance(s, Failure) else (s, end) for s, end in zip(sides, pair, strict=True)]
            (high, above), (low, below) = good
            if above[i] != below[i]:
                for j, p, m in zip(J, high, low, strict=True):
                    j[..., column] = (p - m) / (above[i] - below[i])
            elif any(isinstance(side, Failure) for side in sides):  # else its bounds leave it no room
                why = next(side for side in sides if isinstance(side, Failure))
                return Failure(FailureReason.RUN, f"the runs on both sides of the minimum fail: {why}")
        return None

    moving = [c for c in range(len(free)) if not absent[free[c]]]
    at_once = max(1, problem.simulator.abreast // 2)
    groups = [moving[k : k + at_once] for k in range(0, len(moving), at_once)]
    reasons = [why for why in in_threads(jobs, differentiate, groups) if why]
    return reasons[0] if reasons else J


def by_blocks(problem: Problem, x: FloatArray, free: NDArray[np.intp], *, jobs: int = 1) -> BlockJacobian | Failure:
    """The same of a problem of many recordings (:attr:`fracid.problem.Problem.blocks`), without its zeros."""
    assert problem.blocks is not None
    by, last = problem.last_derivatives.get(x.tobytes(), (np.array([-1]), None))
    if isinstance(last, BlockJacobian) and np.all(np.isin(free, by)):
        return last if len(free) == len(by) else last.of(np.isin(by, free))
    here = problem.errors(x)
    if isinstance(here, Failure):
        return here
    J = block_jacobian(problem.errors, here, x, difference_steps(problem, x), problem.blocks, free, jobs=jobs)
    problem.last_derivatives.clear()
    if not isinstance(J, Failure):
        problem.last_derivatives[x.tobytes()] = (free, J)
    return J


def difference_steps(problem: Problem, x: FloatArray) -> FloatArray:
    """Of the differences, shape (n_unknowns,)."""
    width = problem.space.upper - problem.space.lower
    return np.asarray(DIFFERENCE * np.maximum(np.abs(x), 1e-2 * np.minimum(width, 1.0)))


def rows_and_scores(
    problem: Problem, errors: list[FloatArray], J: list[FloatArray]
) -> tuple[FloatArray, list[FloatArray]]:
    """Rows R with A = R'R, shape (n_rows, n_free), and the scores of each recording, shape (n_samples, n_free)."""
    rows, scores = rows_and_scores_by_recording(problem, errors, J)
    return rows[0] if len(rows) == 1 else np.concatenate(rows), scores


def rows_and_scores_by_recording(
    problem: Problem, errors: list[FloatArray], J: list[FloatArray]
) -> tuple[list[FloatArray], list[FloatArray]]:
    """The same, the rows of each recording alone; its J may have columns of its own."""
    loss, weights = loss_of(problem), problem.criterion.sample_weights(errors)
    curvature = loss.curvature(joined(errors))
    rows = [(np.sqrt(curvature * w)[..., None] * j).reshape(-1, j.shape[-1]) for w, j in zip(weights, J, strict=True)]
    scores = [np.einsum("to,toi->ti", w * loss.psi(e), j) for w, e, j in zip(weights, errors, J, strict=True)]
    return rows, scores


def rows_and_pulls(problem: Problem, errors: list[FloatArray], J: list[FloatArray]) -> Iterator[FloatArray]:
    """[R y] of each recording alone, the sum of its scores R'y: Gauss and Newton's step is −R⁺y."""
    weights = problem.criterion.sample_weights(errors)
    curvature = loss_of(problem).curvature(joined(errors))
    for w, y, j in zip(weights, pulls(problem, errors), J, strict=True):
        rows = (np.sqrt(curvature * w)[..., None] * j).reshape(-1, j.shape[-1])
        yield np.column_stack([rows, y])


def pulls(problem: Problem, errors: list[FloatArray]) -> list[FloatArray]:
    """The y of each recording alone, shape (n_samples * n_outputs,)."""
    loss, weights = loss_of(problem), problem.criterion.sample_weights(errors)
    curvature = loss.curvature(joined(errors))
    return [(np.sqrt(w / curvature) * loss.psi(e)).ravel() for w, e in zip(weights, errors, strict=True)]


def loss_of(problem: Problem) -> Loss:
    """ρ, which only a user's own cost has not."""
    loss = problem.cost_function.loss
    assert loss is not None
    return loss
