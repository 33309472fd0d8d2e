r"""The minimum itself: from where a search ended, by derivatives that hold over the width of an interval.

A search ends where its steps gain next to nothing: in a valley that may be some standard errors from where the cost is
least, and its tangent is not to be trusted there (:mod:`fracid.estimation.tangent`).  :func:`settled` goes on with
Gauss and Newton's steps, each to the least of the parabola within the bounds (:mod:`fracid.estimation.bounded`), where
the cost confirms it.  Each run on the way corrects the derivatives by what it shows of them, so that a step costs one
run (:mod:`fracid.estimation.linearised`); they are asked anew where the way was long.  An unknown that a bound stops
ends *on* that bound, all others at the minimum beside it; one that then does nothing, where it began.  What is then
known of it is one record, :class:`Minimum`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.covariance import Known
from fracid.estimation.linearised import Linearised, linearised
from fracid.estimation.side_by_side import Walk, side_by_side
from fracid.estimation.tangent import Tangent, tangent
from fracid.optimise import Evaluation
from fracid.problem import Problem

ROUNDS = 6
"""Of fresh derivatives, at most."""

RUNS = 12
"""With the same derivatives, at most."""

SHORTEST = 1 / 8
"""Of a step, that is asked where longer ones lead up."""

GAIN = 3e-3
"""Twice the log likelihood by which the last step may still rise."""

WORN = 1.0
"""The same of a way after which derivatives are asked anew."""


@dataclass(frozen=True)
class Minimum:
    """A minimum, and how well the data determine it."""

    problem: Problem
    best: Evaluation
    substeps: int
    """Steps of a sample; of coarser recordings of one of their source."""
    uncertainty: Known
    near: Tangent | None = None
    """The tangent there, where its derivatives are known."""

    @property
    def x(self) -> FloatArray:
        """The point, shape (n_unknowns,)."""
        return self.best.point


def settled(problem: Problem, x: FloatArray, *, jobs: int = 1) -> Tangent | Failure:
    """Go from x, where a search ended, to the minimum beside it.

    Parameters
    ----------
    problem : Problem
        With a cost of known loss.
    x : array, shape (n_unknowns,)
    jobs : int
        Threads.

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
    for _ in range(ROUNDS):
        here = tangent(problem, x, jobs=jobs)
        if isinstance(here, Failure):
            return here
        (lower,) = side_by_side(problem, [onward(linearised(here), GAIN * here.unit)])
        x = lower.x
        if here.value - lower.value <= WORN * here.unit:
            break
    return _with_idle_unmoved(_onto_bounds(lower.tangent))


def onward(here: Linearised, enough: float, *, held: Sequence[int] = ()) -> Walk[Linearised]:
    """Go to the least, a run a step.

    Parameters
    ----------
    here : Linearised
    enough : float
        By how much V may still be above the least.
    held : sequence of int
        Unknowns that stay.
    """
    part = 1.0
    for _ in range(RUNS):
        delta = here.step(held)
        if part < SHORTEST or -here.foreseen(delta) <= enough:
            break
        there = yield from here.at(here.x + part * delta)
        if there is not None and there.value < here.value:
            here, part = there, 1.0
        else:
            here, part = here if there is None else here.taught(there), 0.5 * part
    return here


def beside(near: Tangent, x: FloatArray) -> Linearised | None:
    """The minimum next to x, by the derivatives of a point close by or of nearly the same problem; None where x fails.

    Parameters
    ----------
    near : Tangent
    x : array, shape (n_unknowns,)
    """

    def walk() -> Walk[Linearised | None]:
        here = yield from linearised(near).at(x)
        return None if here is None else (yield from onward(here, GAIN * near.unit))

    return side_by_side(near.problem, [walk()])[0]


def _onto_bounds(here: Tangent) -> Tangent:
    """The same point with what lies at a bound on it."""
    space, x, touching = here.problem.space, here.x.copy(), here.touching
    nearer = np.where(x - space.lower < space.upper - x, space.lower, space.upper)
    x[touching] = nearer[touching]
    return here if np.array_equal(x, here.x) else side_by_side(here.problem, [here.there(x)])[0] or here


def _with_idle_unmoved(here: Tangent) -> Tangent:
    """The same with what does nothing at that point where it began, such as the rest of a spring whose stiffness is 0.

    Its derivative was taken on the way there, and may have led it to a bound.
    """
    space = here.problem.space
    effect = np.linalg.norm(here.R, axis=0) * np.where(np.isfinite(width := space.upper - space.lower), width, 0.0)
    for i in np.flatnonzero((effect < math.sqrt(2 * here.unit)) & (here.x != space.start)):
        x = np.where(np.arange(len(here.x)) == i, space.start, here.x)
        (there,) = side_by_side(here.problem, [here.there(x)])
        if there is not None and there.value == here.value:
            here = replace(there, derivatives=[np.where(np.arange(len(x)) == i, 0.0, j) for j in there.derivatives])
    return here
