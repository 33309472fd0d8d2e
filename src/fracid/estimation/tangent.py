r"""Derivatives that hold over the width of an interval.

A difference of :math:`10^{-5}` of an unknown sees how one sample crosses a steep friction, not how the recording
changes over the interval that is to be printed.  With the column-scaled derivatives J = U S V' a relative error ε of a
column moves what the data hardly see, directions :math:`v_k` of small :math:`s_k`, by :math:`ε/s_k` of its size.  So
along those, and along unknowns whose conditional standard error is far longer than the difference was, J is asked again
where it matters: over half a standard error to each side,

.. math::  J ← J + (d - J v_k)\, v_k', \qquad
           d = \frac{e(x + t v_k) - e(x - t v_k)}{2t}, \quad t = \frac{σ}{2\,|J v_k|},

Broyden's correction [B]_ by a central difference, until J agrees with what it is asked.

References
----------
.. [B] C. G. Broyden, Math. Comp. 19 (1965) 577: the least change of J that gives a known difference.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.errors import SMALLEST, Failure
from fracid.estimation.block_jacobian import BlockJacobian
from fracid.estimation.derivatives import (
    DIFFERENCE,
    difference_steps,
    differences,
    pulls,
    row_weights,
    rows_and_pulls,
    shared_by_all,
)
from fracid.estimation.side_by_side import Walk, side_by_side
from fracid.optimise import Evaluation
from fracid.problem import Problem
from fracid.qr import triangle

UNSEEN = 1e-6
"""Singular values of the column-scaled Jacobian below this part of the largest count as zero."""

TOUCHING = 0.02
"""An unknown lies at a bound where the way there, all others held, is less than this many standard errors."""

BOUND = 1e-3
"""And less than this part of its range."""

WEAK = 1 / 30
"""Directions that the data see by less than this part of the best are asked again."""

MOST = 8
"""Of those, the weakest."""

AGREES = 0.05
"""A direction whose difference is off by less than this part needs no correction."""

LASTS = 0.5
"""And only a difference that changes by less than this part of that, over half its length, is a slope."""

ASKED = 3
"""Times, until derivatives agree."""

FAINT = 1e-3
"""Directions seen by less than this part of the best may be none at all, but for the rounding of first differences."""

STEADY = 100.0
"""Times as long as the first differences those are asked: with as much less rounding, and before a valley bends."""

SPAN = 0.5
"""Half of a difference, in standard errors of independent residuals."""

LONGER = 10.0
"""Times as long as the step of the first differences: such a half standard error is asked again."""

FARTHEST = 0.1
"""Of the size of an unknown: where a difference would reach further, the cost is asked (walked), not its tangent."""

SHORTEST = 0.2
"""Of that, what the bounds must leave."""


class AtPoint:
    """What is known at a point."""

    evaluation: Evaluation
    """The point, its cost and its rows."""

    @property
    def x(self) -> FloatArray:
        """The point, shape (n_unknowns,)."""
        return self.evaluation.point

    @property
    def value(self) -> float:
        """V, the sum that is minimised."""
        return self.evaluation.value


@dataclass(frozen=True, eq=False)
class Tangent(AtPoint):
    """A point with the errors of its recordings and their derivatives."""

    problem: Problem
    evaluation: Evaluation
    """The point, its cost and its rows."""
    errors: list[FloatArray]
    """Of each recording, shape (n_samples, n_outputs)."""
    derivatives: list[FloatArray]
    """Of those by all unknowns, shape (n_samples, n_outputs, n_unknowns)."""

    @cached_property
    def unit(self) -> float:
        """By how much V rises where twice the log likelihood of independent residuals falls by 1."""
        loss = self.problem.cost_function.loss
        samples = sum(e.size for e in self.errors) * (1 if loss is None else loss.likelihood_factor)
        return max(self.value, SMALLEST) / samples

    @cached_property
    def _triangle(self) -> FloatArray:
        R = triangle(self._parts())
        seen = np.any([np.any(j, axis=(0, 1)) for j in self.derivatives], axis=0)
        R[:, :-1][:, ~seen] = 0.0  # QR leaves 1e-17 of a column of zeros
        return R

    @property
    def R(self) -> FloatArray:
        """Of the rows √(wρ″)J, shape (n_unknowns + 1, n_unknowns): A = R'R."""
        return self._triangle[:, :-1]

    @property
    def y(self) -> FloatArray:
        """What they leave: V is about ½|Rδ + y|² and a constant, shape (n_unknowns + 1,)."""
        return self._triangle[:, -1]

    @property
    def rows(self) -> FloatArray:
        """Those of R and y before they are made a triangle, shape (n_rows, n_unknowns + 1)."""
        return np.vstack(self._parts())

    def pulls(self, errors: list[FloatArray], x: FloatArray) -> FloatArray:
        """The last column of those with the errors of another point, shape (n_rows,)."""
        priors, data = self._priors(), pulls(self.problem, errors, row_weights(self.problem, self.errors))
        return np.concatenate([*data, priors[:, :-1] @ (x - self.x) + priors[:, -1]])

    def _parts(self) -> list[FloatArray]:
        return [*rows_and_pulls(self.problem, self.errors, self.derivatives), self._priors()]

    def _priors(self) -> FloatArray:
        """A prior is a datum at the level D/n of the recordings' own: D/n z²."""
        criterion, n = self.problem.criterion, len(self.x)
        rows = np.zeros((max(len(criterion.priors), 1), n + 1))
        if criterion.priors and self.evaluation.residuals is not None:
            data = self.evaluation.residuals[: -len(criterion.priors)]
            level = math.sqrt(2 * float(data @ data) / criterion.prior_samples)
            for row, (i, prior) in zip(rows, criterion.priors.items(), strict=True):
                row[i], row[n] = level / prior.sd, level * (self.x[i] - prior.mean) / prior.sd
        return rows

    @cached_property
    def norms(self) -> FloatArray:
        """√A_ii, 1 where nothing depends on an unknown, shape (n_unknowns,)."""
        norms = np.linalg.norm(self.R, axis=0)
        return np.where(norms > 0, norms, 1.0)

    @cached_property
    def touching(self) -> NDArray[np.bool_]:
        """Which unknowns lie at a bound, shape (n_unknowns,)."""
        space = self.problem.space
        away, width = np.minimum(self.x - space.lower, space.upper - self.x), space.upper - space.lower
        of_range = np.where(np.isfinite(width), BOUND * width, 0.0)
        return np.asarray(away <= np.minimum(TOUCHING * math.sqrt(2 * self.unit) / self.norms, of_range))

    def by(self, free: NDArray[np.intp]) -> BlockJacobian:
        """Its errors and their derivatives by some of the unknowns."""
        blocks = shared_by_all(self.problem, len(free))
        return BlockJacobian(blocks, [j[..., free] for j in self.derivatives], self.errors)

    def there(self, x: FloatArray) -> Walk[Tangent | None]:
        """The same derivatives at another point within the bounds; None where its run fails."""
        x = self.problem.space.clipped(x)
        errors = yield x
        if isinstance(errors, Failure):
            return None
        return Tangent(self.problem, self.problem.criterion(x, errors), errors, self.derivatives)

    def asked_again(self, jobs: int) -> Tangent:
        """With derivatives that agree with differences over half a standard error, where those are longer by far."""
        seen, shortest = np.any(self.R != 0, axis=0), difference_steps(self.problem, self.x)
        reach = np.where(seen, SPAN * math.sqrt(2 * self.unit) / self.norms, 0.0)
        farthest = FARTHEST / DIFFERENCE * shortest
        here = self._corrected([s for s in np.diag(reach)[reach > LONGER * shortest] if np.all(s < farthest)], jobs)
        here = here or self
        for _ in range(ASKED):
            _, singular, V = np.linalg.svd(here.R / here.norms)
            weak = np.flatnonzero((singular < WEAK * singular[0]) & (singular > UNSEEN * singular[0]))[-MOST:]
            steps = [reach / singular[k] * V[k] for k in weak]
            steps = [s * min(1.0, STEADY / max(np.abs(s) / shortest)) if singular[k] < FAINT * singular[0] else s
                     for k, s in zip(weak, steps, strict=True)]  # fmt: skip
            better = here._corrected([s for s in steps if np.all(np.abs(s) < farthest)], jobs)
            if better is None:
                break
            here = better
        return here

    def _corrected(self, steps: Sequence[FloatArray], jobs: int) -> Tangent | None:
        """With derivatives that agree with these steps, which are orthogonal; None where they do."""
        corrections = [*filter(None, side_by_side(self.problem, [*map(self._correction, steps)], jobs=jobs))]
        if not corrections:
            return None
        return replace(self, derivatives=[
            sum((np.multiply.outer(missed, by) for missed, by in parts), j)
            for j, *parts in zip(self.derivatives, *corrections, strict=True)
        ])  # fmt: skip

    def _correction(self, across: FloatArray) -> Walk[list[tuple[FloatArray, FloatArray]] | None]:
        """What J misses of the step `across`, of each recording, and by which unknowns; None where it misses little."""
        along = yield from self._along(across)
        if along is None:
            return None
        missed = [d - j @ across for d, j in zip(along, self.derivatives, strict=True)]
        if self._size(missed) <= AGREES * self._size(along):
            return None
        halves = yield from self._along(0.5 * across)
        if halves is None:
            return None
        changes = [d - 2 * half for d, half in zip(along, halves, strict=True)]
        if self._size(changes) > LASTS * self._size(missed):
            return None  # a jump in between is no slope
        scaled = self.norms * across
        by = self.norms * scaled / float(scaled @ scaled)
        return [(m, by) for m in missed]

    def _size(self, parts: list[FloatArray]) -> float:
        """Of errors, weighted as they are scored."""
        weights = self.problem.criterion.sample_weights(self.errors)
        return math.sqrt(sum(float(np.sum(w * part**2)) for w, part in zip(weights, parts, strict=True)))

    def _along(self, across: FloatArray) -> Walk[list[FloatArray] | None]:
        """The derivative of the errors along a step, by differences of its length within the bounds.

        Central, or beside a bound of the second order too: along a valley the first is next to nothing.
        None where the bounds leave too little, or a run fails.
        """
        up, down = self._room(across), self._room(-across)
        if max(up, down) <= SHORTEST:
            return None
        if min(up, down) > SHORTEST:
            f = min(up, down)
            weights = {f: 0.5 / f, -f: -0.5 / f}
        else:
            f = up if up > down else -down
            weights = {f: -1 / f, 0.5 * f: 4 / f, 0.0: -3 / f}
        total = [0.0 * e for e in self.errors]
        for at, weight in weights.items():
            point = self if at == 0 else (yield from self.there(self.x + at * across))
            if point is None:
                return None
            total = [t + weight * e for t, e in zip(total, point.errors, strict=True)]
        return total

    def _room(self, across: FloatArray) -> float:
        """Which part of a step the bounds leave."""
        space, moves = self.problem.space, across != 0
        ends = np.where(across > 0, space.upper, space.lower)
        return float(min(1.0, np.min(((ends - self.x)[moves] / across[moves]), initial=1.0)))


def tangent(problem: Problem, x: FloatArray, *, jobs: int = 1) -> Tangent | Failure:
    """Errors and derivatives at x that hold over the width of an interval, or why a run fails.

    Parameters
    ----------
    problem : Problem
        With a cost of known loss.
    x : array, shape (n_unknowns,)
    jobs : int
        Threads.
    """
    J = differences(problem, x, np.arange(len(x)), jobs=jobs)
    if isinstance(J, Failure):
        return J
    return Tangent(problem, problem.criterion(x, J.errors), J.errors, J.parts).asked_again(jobs)
