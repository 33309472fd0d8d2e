"""Another minimum that explains the recordings as well.

An interval says how far a value may go from the minimum, and nothing of another minimum.  Some models have two, the
same to the last digit: of a drug that is absorbed and leaves, the two rates may be exchanged with another volume (the
pharmacologist's flip-flop).  :func:`as_good_elsewhere` goes down from where other starts of the search came to, and
from where two constants of one unit have exchanged their values, what is left at its least.  Values that have only
changed places, as two like branches of a circuit may, are the same model.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain, combinations

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.estimation.covariance import Uncertainty
from fracid.estimation.horizons import Watch, descent, minimised, uninterrupted
from fracid.optimise import Evaluation
from fracid.problem import Problem

APART = 2.0
"""Half intervals: beyond so many another value is another solution."""

NEAR = 4.0
"""Times the minimum's V: from points below that the search goes on."""

FIRST = {"tolerance": 1e-2, "budget": 8}
"""Least squares of all but the two that were exchanged."""


def as_good_elsewhere(
    problem: Problem, best: Evaluation, known: Uncertainty, also: Sequence[FloatArray] = (), *, watch: Watch
) -> Evaluation | None:
    """A minimum apart from the best whose cost lies within the limit of an interval, or that is lower.

    Parameters
    ----------
    problem : Problem
    best : Evaluation
        The minimum.
    known : Uncertainty
        There.
    also : sequence of array, shape (n_unknowns,)
        Where other starts of a search came to.
    watch : Watch
        Ends the search where its work is spent.

    Examples
    --------
    An order that is started elsewhere comes back:

    >>> import fracid
    >>> from fracid.estimation.covariance import uncertainty
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=4e-3, end=3.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((751, 2))
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> problem = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}, initial_state="held")
    >>> best, known = problem.evaluate(problem.start), uncertainty(problem, problem.start)
    >>> as_good_elsewhere(problem, best, known, [np.array([0.96])], watch=Watch()) is None
    True
    """
    half = np.nan_to_num(0.5 * np.ptp(known.ends, axis=1), nan=np.inf)
    exchanged = _exchanged(problem, best.point, half, known.at_bound, watch=watch)
    begun = (problem.evaluate(x) for x in also if np.any(_apart(best.point, x, half)))
    for x in (e.point for e in chain(begun, exchanged) if e.value < NEAR * best.value):
        if watch.spent:
            break
        there = uninterrupted(minimised(problem, descent(problem, x), watch)).best
        apart = _apart(best.point, there.point, half)
        limits = known.rise[apart]
        limit = np.min(limits, initial=np.inf, where=np.isfinite(limits)) if np.any(apart) else -np.inf
        as_good = there.value - best.value < limit
        if as_good and not _relabelled(problem, best.point, there.point, half, apart):
            return there
    return None


def with_another(problem: Problem, x: FloatArray, known: Uncertainty, other: FloatArray) -> Uncertainty:
    """Intervals that hold both minima, shape of `other` (n_unknowns,)."""
    half = np.nan_to_num(0.5 * np.ptp(known.ends, axis=1), nan=np.inf)
    apart = _apart(x, other, half)
    both = np.column_stack([np.minimum(known.ends[:, 0], other - half), np.maximum(known.ends[:, 1], other + half)])
    ends = np.clip(both, problem.space.lower[:, None], problem.space.upper[:, None])
    return replace(known, ends=np.where(apart[:, None], ends, known.ends), walked=known.walked | apart,
                   elsewhere=np.where(apart, other, np.nan))  # fmt: skip


def _apart(x: FloatArray, other: FloatArray, half: FloatArray) -> NDArray[np.bool_]:
    return np.asarray(np.abs(other - x) > APART * half)


def _exchanged(
    problem: Problem, x: FloatArray, half: FloatArray, at_bound: NDArray[np.bool_], watch: Watch
) -> Iterator[Evaluation]:
    """All others at their least beside each pair of one unit that differs and may be exchanged."""
    for i, j in combinations(np.flatnonzero(~at_bound & np.isfinite(half)).tolist(), 2):
        one, other = problem.unknowns[i], problem.unknowns[j]
        alike = (one.kind, one.unit, one.experiment) == (other.kind, other.unit, other.experiment)
        fits = one.range.lower < x[j] < one.range.upper and other.range.lower < x[i] < other.range.upper
        if alike and fits and one.kind in ("parameter", "order") and abs(x[i] - x[j]) > APART * (half[i] + half[j]):
            exchanged = x.copy()
            exchanged[[i, j]] = x[[j, i]]
            yield uninterrupted(minimised(problem, descent(problem, exchanged, [i, j], **FIRST), watch)).best


def _relabelled(problem: Problem, x: FloatArray, other: FloatArray, half: FloatArray, apart: NDArray[np.bool_]) -> bool:
    """Whether all that is apart has the former value of another of its unit."""
    units, at = np.array([u.unit for u in problem.unknowns]), np.flatnonzero(apart)
    same = (units[at, None] == units[at]) & (np.abs(other[at, None] - x[at]) <= APART * half[at])
    return bool(np.all(same.any(axis=1)))
