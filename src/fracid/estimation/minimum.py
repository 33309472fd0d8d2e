r"""The minimum itself: from where a search ended, by derivatives that hold over the width of an interval.

A search ends where its steps gain next to nothing: in a valley that may be some standard errors from where the cost is
least, and its tangent is not to be trusted there (:mod:`fracid.estimation.tangent`).  :func:`settled` goes on with
Gauss and Newton's steps, each to the least of the parabola within the bounds (:mod:`fracid.estimation.bounded`), where
the cost confirms it.  An unknown that a bound stops ends *on* that bound, all others at the minimum beside it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.tangent import Tangent, tangent
from fracid.problem import Problem

__all__ = ["settled"]

FRACTIONS = (1.0, 0.5, 0.25, 0.125)
"""Of a step, of which the cost is asked."""

ROUNDS = 12
"""Steps, at most."""

GAIN = 3e-3
"""Twice the log likelihood by which the last step may still rise."""

KEPT = 0.5
"""A step that gains less than this part of what the parabola promised has worn derivatives."""


def settled(
    problem: Problem, x: FloatArray, *, jobs: int = 1, held: Sequence[int] = (), near: Tangent | None = None
) -> Tangent | Failure:
    """Go from x, where a search ended, to the minimum beside it.

    Parameters
    ----------
    problem : Problem
        With a cost of known loss.
    x : array, shape (n_unknowns,)
    jobs : int
        Threads.
    held : sequence of int
        Unknowns that stay.
    near : Tangent, optional
        At a point close by: its derivatives serve as long as steps gain what they promise.

    Returns
    -------
    Tangent or Failure
        At the minimum; why a run fails.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=4e-3, end=3.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.951, 0.5, 1.2)}, initial_state="held")
    >>> settled(problem, problem.start).x.round(5)
    array([0.95])
    """
    here = tangent(problem, x, jobs=jobs) if near is None else near.there(x) or tangent(problem, x, jobs=jobs)
    fresh, renewals = near is None, ROUNDS if near is None else 1
    for _ in range(ROUNDS):
        if isinstance(here, Failure):
            return here
        delta = here.step(held)
        promised = -here.foreseen(delta)
        there = promised <= GAIN * here.unit
        if there and (fresh or near is not None):
            break
        lower = None if there else _lower(here, delta)
        if lower is None and (fresh or not renewals):
            break
        fresh = renewals > 0 and (lower is None or here.value - lower.value < KEPT * promised)
        here, renewals = lower or here, renewals - fresh
        if fresh:  # the derivatives are worn
            here = tangent(problem, here.x, jobs=jobs)
    return here if isinstance(here, Failure) else _onto_bounds(here, held)


def _lower(here: Tangent, delta: FloatArray) -> Tangent | None:
    """Where the cost is lower along a step, its end first."""
    points = (here.there(here.x + f * delta) for f in FRACTIONS)
    return next((p for p in points if p is not None and p.value < here.value), None)


def _onto_bounds(here: Tangent, held: Sequence[int]) -> Tangent:
    """The same point with what lies at a bound on it."""
    space, x, touching = here.problem.space, here.x.copy(), here.touching.copy()
    touching[list(held)] = False
    nearer = np.where(x - space.lower < space.upper - x, space.lower, space.upper)
    x[touching] = nearer[touching]
    return here if np.array_equal(x, here.x) else here.there(x) or here
