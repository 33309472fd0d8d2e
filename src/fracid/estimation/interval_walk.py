r"""Where an interval ends off the tangent: the cost itself at both ends, all other unknowns refitted.

The covariance is that of the tangent.  In a valley that bends, beside a bound or a kink, the cost is no parabola as far
as an interval reaches.  :func:`walked` looks: with one unknown at the end of its interval and the others at their least
there, V should have risen by its limit L (:attr:`fracid.estimation.covariance.Uncertainty.rise`), so the height

.. math::  h(v) = \sqrt{(V_i(v) - V(\hat x))/L}

should be 1.  Where it is off by more than a seventh, the end is moved to where it is: by the secant of h, a line
where the cost is a parabola, or to the bound.  The derivatives of the minimum serve all refits, each run corrects them
on the way (:mod:`fracid.estimation.linearised`), so that a point costs some three runs; where they do not lead to the
ground of a valley, they are asked anew.  If a point lies lower than the minimum, that was none, and the search goes on
from there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

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
    lower = [point for point in found if isinstance(point, Evaluation)]
    if lower:
        return min(lower, key=lambda e: e.cost)
    ends = known.ends.copy()
    moved = known.walked.copy() if len(known.walked) else np.zeros(len(here.x), dtype=bool)
    for (i, side), end in zip(sides, found, strict=True):
        if isinstance(end, float) and end != ends[i, side]:
            ends[i, side], moved[i] = end, True
    return replace(known, ends=ends, walked=moved)


def _end(here: Linearised, known: Uncertainty, i: int, side: int) -> float | Evaluation:
    """Where the interval of unknown i ends on one side; a lower point, if one is on the way."""
    space, value, end = here.near.problem.space, float(here.x[i]), float(known.ends[i, side])
    limit = float(known.rise[i, side])
    room = float(abs((space.upper if side else space.lower)[i] - value))
    sign, distance = (1 if side else -1), abs(end - value)
    inside, outside = (0.0, 0.0), (math.inf, math.inf)  # (distance, height) on both sides of height 1
    last = here
    if distance == 0:
        return end
    for point in range(POINTS):
        there = _refitted(last, i, value + sign * distance, EXACT * limit)
        if there is None:  # the runs fail there
            outside, distance = (distance, math.inf), 0.5 * (inside[0] + distance)
            continue
        last, rise = there, there.value - here.value
        if rise < -LOWER * limit:
            return there.evaluation
        height = math.sqrt(max(rise + there.foreseen(there.step([i])), 0.0) / limit)
        if abs(height - 1) <= (OFF if point == 0 else CLOSE) or (distance == room and height <= 1):
            return end if point == 0 else value + sign * distance
        if height < 1:
            inside = (distance, height)
        else:
            outside = (distance, height)
        distance = min(room, _next(inside, outside))
        if len(last.axes) > RUNS:
            break
    return value + sign * distance


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
