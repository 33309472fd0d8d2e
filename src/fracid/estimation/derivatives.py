r"""What the errors of a minimum depend on: their derivatives by the unknowns, and the rows that these make.

:func:`jacobian` takes central differences of measured minus simulated, within the bounds; :func:`by_blocks` the same of
many recordings with unknowns of their own, without its zeros.  With weights w and a loss ρ, rows
:math:`R = \sqrt{wρ''}\,J` give the curvature :math:`A = R'R` of the cost and scores :math:`w\,ρ'J` its gradient.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray, IntArray, zeros_together
from fracid.arrowhead import Blocks
from fracid.errors import Failure, FailureReason
from fracid.estimation.block_jacobian import BlockJacobian
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
    J = differences(problem, x, free, jobs=jobs)
    return J if isinstance(J, Failure) else J.parts


def by_blocks(problem: Problem, x: FloatArray, free: NDArray[np.intp], *, jobs: int = 1) -> BlockJacobian | Failure:
    """The same without the zeros of what belongs to one of many recordings; what was asked last is known again.

    Parameters
    ----------
    free : array of int
        In ascending order.
    """
    by, last = problem.last_derivatives.get(x.tobytes(), (np.array([-1]), None))
    if isinstance(last, BlockJacobian) and np.all(np.isin(free, by)):
        return last if len(free) == len(by) else last.of(np.isin(by, free))
    J = differences(problem, x, free, problem.blocks and problem.blocks.of(free), jobs=jobs)
    problem.last_derivatives.clear()
    if not isinstance(J, Failure):
        problem.last_derivatives[x.tobytes()] = (free, J)
    return J


def by_all(problem: Problem, x: FloatArray, *, jobs: int = 1) -> BlockJacobian | Failure:
    """The same by all unknowns, in one block; of few recordings what was asked last is known again."""
    asked = differences if problem.blocks else by_blocks
    return asked(problem, x, np.arange(len(x)), jobs=jobs)


def shared_by_all(problem: Problem, unknowns: int) -> Blocks:
    """One block: no unknown is a recording's own."""
    rows = np.cumsum([0, *(e.measured.size for e in problem.experiments)])
    return Blocks(np.full(unknowns, -1), rows)


def differences(
    problem: Problem, x: FloatArray, free: NDArray[np.intp], blocks: Blocks | None = None, *, jobs: int = 1
) -> BlockJacobian | Failure:
    """Both, with the errors at x, by `blocks` of the unknowns `free`: one of each recording is moved at once."""
    blocks = shared_by_all(problem, len(free)) if blocks is None else blocks
    space, steps, simulated = problem.space, difference_steps(problem, x), problem.simulator.all_errors

    def both_sides(group: IntArray) -> list[FloatArray]:
        change = np.zeros(len(x))
        change[free[group]] = steps[free[group]]
        return [space.clipped(x + side * change) for side in (1, -1)]

    there = ~problem.absent(x)[free]
    moving = [group[there[group]] for group in blocks.groups if np.any(there[group])]
    at_once = max(1, problem.abreast // 2)
    rest = len(moving) % at_once
    here, *beside = simulated([x, *chain.from_iterable(map(both_sides, moving[:rest]))])
    if isinstance(here, Failure):
        return here
    parts = [np.moveaxis(part, 0, -1)  # column by column, as they come
             for part in zeros_together([(len(blocks.columns(k)), *e.shape) for k, e in enumerate(here)])]  # fmt: skip

    def differentiate(groups: Sequence[IntArray], known: Sequence[list[FloatArray] | Failure] = ()) -> Failure | None:
        ends = [end for group in groups for end in both_sides(group)]
        found = iter(zip(known or simulated(ends), ends, strict=True))
        for group in groups:
            sides = [next(found), next(found)]
            fails = [errors for errors, _ in sides if isinstance(errors, Failure)]
            if fails and len(group) > 1:  # of one recording, as a rule
                if why := differentiate(np.array_split(group, 2)):
                    return why
                continue
            (high, above), (low, below) = ((here, x) if isinstance(e, Failure) else (e, end) for e, end in sides)
            for c, i in zip(group.tolist(), free[group].tolist(), strict=True):
                if above[i] != below[i]:
                    for k, column in blocks.cells(c):
                        parts[k][..., column] = (high[k] - low[k]) / (above[i] - below[i])
                elif fails:  # else its bounds leave it no room
                    return Failure(FailureReason.RUN, f"the runs on both sides of the minimum fail: {fails[0]}")
        return None

    chunks = [moving[k : k + at_once] for k in range(rest, len(moving), at_once)]
    reasons = [differentiate(moving[:rest], beside), *in_threads(jobs, differentiate, chunks)]
    return next(filter(None, reasons), None) or BlockJacobian(blocks, parts, here)


def difference_steps(problem: Problem, x: FloatArray) -> FloatArray:
    """Of the differences, shape (n_unknowns,)."""
    return DIFFERENCE * problem.space.sizes(x)


def scores_of(slopes: Sequence[FloatArray], J: Sequence[FloatArray]) -> Iterator[FloatArray]:
    """Of each recording from its slopes, shape (n_samples, n_columns)."""
    return (np.einsum("to,toi->ti", slope, j) for slope, j in zip(slopes, J, strict=True))


def slopes_of(problem: Problem, errors: list[FloatArray]) -> list[FloatArray]:
    """wρ′ of each sample, shape (n_samples, n_outputs) of each recording."""
    loss, weights = loss_of(problem), problem.criterion.sample_weights(errors)
    return [w * loss.psi(e) for w, e in zip(weights, errors, strict=True)]


def rows_and_pulls(problem: Problem, errors: list[FloatArray], J: list[FloatArray]) -> Iterator[FloatArray]:
    """[R y] of each recording alone, the sum of its scores R'y: Gauss and Newton's step is −R⁺y."""
    at = row_weights(problem, errors)
    return map(np.column_stack, zip(rows_of(problem, errors, J), pulls(problem, errors, at), strict=True))


def rows_of(problem: Problem, errors: list[FloatArray], J: list[FloatArray]) -> Iterator[FloatArray]:
    """R of each recording, A = ΣR'R, shape (n_rows, n_columns)."""
    return ((root[..., None] * j).reshape(-1, j.shape[-1])
            for root, j in zip(row_weights(problem, errors), J, strict=True))  # fmt: skip


def row_weights(problem: Problem, errors: list[FloatArray]) -> list[FloatArray]:
    """√(wρ″) of each sample, by which its derivatives become rows, shape (n_samples, n_outputs) of each recording.

    ρ″ is the mean over each output of a recording: how its residual is distributed says nothing of another's.
    """
    curvature, found = loss_of(problem).curvature, list[FloatArray]()
    for whole, at in problem.recordings.values():
        pairs = zip(problem.experiments[at], errors[at], strict=True)
        parts = [[r[own] for r, own in zip(e.T, of.scored.T, strict=True)] for of, e in pairs]
        own = map(np.concatenate, zip(*parts, strict=True))
        signals = zip(own, whole.in_deviations(whole.measured).T, strict=True)
        found += [np.array([curvature(e, y) if e.size else 0.0 for e, y in signals])] * len(parts)
    return [np.sqrt(c * w) for c, w in zip(found, problem.criterion.sample_weights(errors), strict=True)]


def pulls(problem: Problem, errors: list[FloatArray], at: list[FloatArray]) -> list[FloatArray]:
    """The y of each recording alone, beside rows with the weights `at`, shape (n_samples * n_outputs,)."""
    slopes = slopes_of(problem, errors)
    return [(slope / np.where(root > 0, root, 1.0)).ravel() for slope, root in zip(slopes, at, strict=True)]


def prior_curvature(problem: Problem, errors: list[FloatArray], free: NDArray[np.intp]) -> tuple[FloatArray, float]:
    """What the priors add to A, on its diagonal, and the level D/n that turns a curvature into a variance.

    A prior is a datum: it adds twice that level times its curvature to S, as white samples of the curvature do.
    """
    priors = [problem.unknowns[i].prior for i in free]
    loss, weights = loss_of(problem), problem.criterion.sample_weights(errors)
    total = sum(float(np.sum(w * loss.rho(e))) for w, e in zip(weights, errors, strict=True))
    level = total / problem.criterion.prior_samples
    return np.array([2 * level / p.sd**2 if p else 0.0 for p in priors]), level


def loss_of(problem: Problem) -> Loss:
    """ρ, which only a user's own cost has not."""
    loss = problem.cost_function.loss
    assert loss is not None
    return loss
