r"""Where an interval ends off the tangent: the cost itself at both ends, all other unknowns refitted.

The covariance is that of the tangent.  In a valley that bends, beside a bound or a kink, the cost is no parabola as far
as an interval reaches.  :func:`walked` looks: with one unknown at the end of its interval and the others at their least
there, V should have risen by its limit L (:attr:`fracid.estimation.covariance.Uncertainty.rise`), so the height

.. math::  h(v) = \sqrt{(V_i(v) - V(\hat x))/L}

should be 1.  Where it is off by more than a seventh, the end is moved to where it is: by the secant of h, a line
where the cost is a parabola, or to the bound.  The derivatives of the minimum serve all refits, each run corrects them
on the way (:mod:`fracid.estimation.linearised`), so that a point costs some three runs; where they do not lead to the
ground of a valley, they are asked anew, and no interval ends before what the walks of the others went through below its
limit.  If a point lies lower than the minimum, that was none, and the search goes on
from there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.covariance import Uncertainty
from fracid.estimation.linearised import Linearised, linearised
from fracid.estimation.minimum import onward
from fracid.estimation.tangent import Tangent, tangent
from fracid.optimise import Evaluation
from fracid.tasks.job import in_threads

BENT = 2.0
"""By which factor the end of an interval that all recordings share is off where the others are walked, too."""

OFF = 0.15
"""A height that is off by less leaves the interval of the tangent."""

CLOSE = 0.1
"""A height that is off by less ends the walk."""

ROUNDS = 3
"""Of derivatives, at most, on the way to a refit: those of the minimum, then fresh ones."""

POINTS, RUNS = 6, 20
"""Of one walk, at most: points, and runs after which no other point is begun."""

EXACT = 0.3
"""Part of its limit by which V of a refit may still be above the least."""

NEAR = 0.7
"""A point of another walk tells how far an interval goes where the limit is reached at so much of the way to it."""

LOWER = 0.05
"""Part of its limit by which V is lower at a lower point."""


def walked(here: Tangent, known: Uncertainty, *, jobs: int = 1) -> Uncertainty | Evaluation:
    """The intervals where the cost ends them, or a point that is lower than the minimum.

    What belongs to one recording is walked where the tangent is far off for what all share.

    Parameters
    ----------
    here : Tangent
        At the minimum.
    known : Uncertainty
        There.
    jobs : int
        Threads.

    Examples
    --------
    >>> import fracid
    >>> from fracid.estimation.covariance import uncertainty
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=4e-3, end=3.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((751, 2))
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}, initial_state="held")
    >>> from fracid.estimation.minimum import settled
    >>> here = settled(problem, problem.start)
    >>> found = walked(here, uncertainty(problem, here.x, near=here))
    >>> found.method(0), bool(found.ends[0, 0] < 0.95 < found.ends[0, 1])
    ('sandwich', True)
    """
    shared = [i for i, u in enumerate(here.problem.unknowns) if u.experiment is None]
    found = _walked(here, known, shared, jobs)
    if isinstance(found, Evaluation):
        return found
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.log((found.ends - here.x[:, None]) / (known.ends - here.x[:, None]))[shared]
    if not np.any(np.abs(moved[np.isfinite(moved)]) > math.log(BENT)):
        return found
    return _walked(here, found, [i for i in range(len(here.x)) if i not in shared], jobs)


def _walked(here: Tangent, known: Uncertainty, which: Sequence[int], jobs: int) -> Uncertainty | Evaluation:
    """The same of some unknowns; those without an interval stay so."""
    sides = [
        (i, side) for i in which for side in (0, 1) if known.rise[i, side] > 0 and math.isfinite(known.ends[i, side])
    ]
    start = linearised(here)
    found = in_threads(jobs, lambda where: _end(start, known, *where), sides)
    points = [point for _, way in found for point in way]
    lowest = min((point.evaluation for point in points), key=lambda e: e.cost, default=here.evaluation)
    if any(end is None for end, _ in found):
        return lowest
    ends = known.ends.copy()
    for (i, side), (end, _) in zip(sides, found, strict=True):
        ends[i, side] = end
    ends = _as_far_as_any(start, known, ends, points)
    moved = np.any(np.nan_to_num(ends) != np.nan_to_num(known.ends), axis=1)
    return replace(known, ends=ends, walked=moved | known.walked if len(known.walked) else moved)


def _as_far_as_any(here: Linearised, known: Uncertainty, ends: FloatArray, points: Sequence[Linearised]) -> FloatArray:
    """No interval ends before what a walk of another unknown went through below its limit.

    Beside a kink the derivatives may not lead to the ground of a valley, along which another walk goes; a point above
    the limit counts as far as a parabola to it has the limit.
    """
    for point in points:
        delta = np.where(here.near.problem.absent(point.x), 0.0, point.x - here.x)
        side, every = (delta > 0).astype(int), np.arange(len(delta))
        with np.errstate(divide="ignore", invalid="ignore"):
            below = np.minimum(1.0, np.sqrt(known.rise[every, side] / max(point.value - here.value, 0.0)))
        below[below < NEAR] = 0.0
        beyond = np.abs(delta) * below > (1 + OFF) * np.abs(ends[every, side] - here.x)
        ends[every[beyond], side[beyond]] = (here.x + delta * below)[beyond]
    return ends


def _end(here: Linearised, known: Uncertainty, i: int, side: int) -> tuple[float | None, list[Linearised]]:
    """Where the interval of unknown i ends on one side, and the points on the way; None if one of them is lower."""
    space, value, end = here.near.problem.space, float(here.x[i]), float(known.ends[i, side])
    limit = float(known.rise[i, side])
    room = float(abs((space.upper if side else space.lower)[i] - value))
    sign, distance = (1 if side else -1), abs(end - value)
    inside, outside = (0.0, 0.0), (math.inf, math.inf)  # (distance, height) on both sides of height 1
    last, way = here, list[Linearised]()
    if distance == 0:
        return end, way
    for point in range(POINTS):
        there = _refitted(last, i, value + sign * distance, EXACT * limit)
        if there is None:  # the runs fail there
            outside, distance = (distance, math.inf), 0.5 * (inside[0] + distance)
            continue
        last, rise = there, there.value - here.value
        way.append(there)
        if rise < -LOWER * limit:
            return None, way
        height = math.sqrt(max(rise + there.foreseen(there.step([i])), 0.0) / limit)
        if abs(height - 1) <= (OFF if point == 0 else CLOSE) or (distance == room and height <= 1):
            return (end if point == 0 else value + sign * distance), way
        if height < 1:
            inside = (distance, height)
        else:
            outside = (distance, height)
        distance = min(room, _next(inside, outside))
        if len(last.axes) > RUNS:
            break
    return value + sign * distance, way


def _next(inside: tuple[float, float], outside: tuple[float, float]) -> float:
    """Where the height is 1, were it a line between two points; at most three times as far as was seen."""
    if not math.isfinite(outside[1]):
        ahead = inside[0] / max(inside[1], 1 / 3)
        return min(ahead, 0.5 * (inside[0] + outside[0]))
    slope = (outside[1] - inside[1]) / (outside[0] - inside[0])
    return inside[0] + (1 - inside[1]) / slope


def _refitted(last: Linearised, i: int, value: float, enough: float) -> Linearised | None:
    """The minimum over all other unknowns with unknown i at a value; None where the runs fail."""
    moved = np.zeros(len(last.x))
    moved[i] = value - last.x[i]
    there = last.at(last.x + last.step([i], moved))
    for _ in range(ROUNDS):
        if there is None:
            return None
        there = onward(there, enough, held=[i])
        if -there.foreseen(there.step([i])) <= enough:
            break
        fresh = tangent(there.near.problem, there.x)  # a bent valley: these derivatives do not lead to its ground
        there = None if isinstance(fresh, Failure) else linearised(fresh)
    return there
