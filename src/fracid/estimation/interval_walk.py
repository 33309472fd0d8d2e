r"""Where an interval ends off the tangent: the cost itself at both ends, all other unknowns refitted.

The covariance is that of the tangent.  In a valley that bends, beside a bound or a kink, the cost is no parabola as far
as an interval reaches.  :func:`walked` looks: with one unknown at the end of its interval and the others at their least
there, V should have risen by its limit L (:attr:`fracid.estimation.covariance.Uncertainty.rise`), so the height

.. math::  h(v) = \sqrt{(V_i(v) - V(\hat x))/L}

should be 1.  Where it is off by more than a seventh, the end is moved to where it is: by the secant of h, a line
where the cost is a parabola, or to the bound.  The derivatives of the minimum serve all refits, each run corrects them
on the way (:mod:`fracid.estimation.linearised`), so that a point costs some three runs; where they do not lead to the
ground of a valley, one half as far is asked first, then, once, derivatives of its own.  An end whose ground is not
found stays where the tangent has it, and no interval ends before what the walks of the others went through below its
limit; nor does any end before the tangent's where the cost is of |e|, a chain of kinks whose ground no derivative
leads to.  If a point lies lower than the minimum, that was none, and the search goes on from there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from operator import itemgetter

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.covariance import Uncertainty
from fracid.estimation.derivatives import jacobian
from fracid.estimation.linearised import Linearised, linearised
from fracid.estimation.minimum import onward
from fracid.estimation.side_by_side import Walk, side_by_side
from fracid.estimation.tangent import Tangent
from fracid.optimise import Evaluation

BENT = 2.0
"""By which factor the end of an interval that all recordings share is off where the others are walked, too."""

OFF = 0.15
"""A height that is off by less leaves the interval of the tangent."""

CLOSE = 0.1
"""A height that is off by less ends the walk."""

SHORT = 0.6
"""Of the way to the tangent's end: where a step that is shorter does not lead to the ground, derivatives are asked."""

POINTS, RUNS = 8, 20
"""Of one walk, at most: points, and runs after which no other point is begun."""

EXACT = 0.3
"""Part of its limit by which V of a refit may still be above the least."""

NEAR = 0.7
"""A point of another walk tells how far an interval goes where the limit is reached at so much of the way to it."""

LOWER = 0.05
"""Part of its limit by which V is lower at a lower point."""


def walked(here: Tangent, known: Uncertainty, *, most: float = math.inf, jobs: int = 1) -> Uncertainty | Evaluation:
    """The intervals where the cost ends them, or a point that is lower than the minimum.

    What belongs to one recording is walked where the tangent is far off for what all share.

    Parameters
    ----------
    here : Tangent
        At the minimum.
    known : Uncertainty
        There.
    most : float
        Runs, after which no further point is begun, half of them for what belongs to one recording; derivatives that
        take more than what is left are not asked.  With 1 each end is looked at once.
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
    found = _walked(here, known, shared, 0.5 * most, jobs=jobs)
    if isinstance(found, Evaluation):
        return found
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.log((found.ends - here.x[:, None]) / (known.ends - here.x[:, None]))[shared]
    if not np.any(np.abs(moved[np.isfinite(moved)]) > math.log(BENT)):
        return found
    return _walked(here, found, [i for i in range(len(here.x)) if i not in shared], 0.5 * most, jobs=jobs)


def _walked(here: Tangent, known: Uncertainty, which: list[int], most: float, jobs: int) -> Uncertainty | Evaluation:
    """The same of some unknowns; those without an interval stay so."""
    start, together = linearised(here), _Together(most)
    ways = [
        _Way(start, known, i, side, together) for i in which for side in (0, 1)
        if known.rise[i, side] > 0 and math.isfinite(known.ends[i, side]) and known.ends[i, side] != here.x[i]
    ]  # fmt: skip
    side_by_side(here.problem, [way.followed(jobs) for way in ways], jobs=jobs)
    if together.lower:
        return here.problem.evaluate(min(together.points, key=itemgetter(0))[1])
    ends, kinked = known.ends.copy(), here.problem.cost_function.kinked
    for way in ways:
        if way.found is not None and (way.distance > way.first or (way.distance < way.first and not kinked)):
            ends[way.i, way.side] = way.found
    ends = _as_far_as_any(start, known, ends, together.points)
    moved = known.walked | np.any(np.nan_to_num(ends) != np.nan_to_num(known.ends), axis=1)
    nearer = np.abs(ends - here.x[:, None]) < np.abs(known.ends - here.x[:, None])  # the cost ends it, and no bound
    stops = {at: bounds for at, bounds in known.stops.items() if not nearer[at]}
    left = (together.runs <= 0) * sum(way.goes_on for way in ways)
    return replace(known, ends=ends, walked=moved, stops=stops, unwalked=known.unwalked + left)


Seen = tuple[float, FloatArray]
"""V at a point, and that, shape (n_unknowns,): no rows, for those of all points are each as large as a record."""


def _as_far_as_any(here: Linearised, known: Uncertainty, ends: FloatArray, points: Sequence[Seen]) -> FloatArray:
    """No interval ends before what a walk of another unknown went through below its limit.

    Beside a kink the derivatives may not lead to the ground of a valley, along which another walk goes; a point above
    the limit counts as far as a parabola to it has the limit.
    """
    for value, x in points:
        delta = np.where(here.near.problem.absent(x), 0.0, x - here.x)
        side, every = (delta > 0).astype(int), np.arange(len(delta))
        with np.errstate(divide="ignore", invalid="ignore"):
            below = np.minimum(1.0, np.sqrt(known.rise[every, side] / max(value - here.value, 0.0)))
        below[below < NEAR] = 0.0
        beyond = np.abs(delta) * below > (1 + OFF) * np.abs(ends[every, side] - here.x)
        ends[every[beyond], side[beyond]] = (here.x + delta * below)[beyond]
    return ends


@dataclass
class _Together:
    """What all walks share."""

    runs: float
    """That are left to them."""
    lower: bool = False
    """Whether a point is lower than the minimum: then all end."""
    points: list[Seen] = field(default_factory=list)


class _Way:
    """To where the interval of unknown i ends on one side."""

    def __init__(self, here: Linearised, known: Uncertainty, i: int, side: int, together: _Together) -> None:
        self.here, self.last, self.together = here, here, together
        self.i, self.side, self.sign, self.limit = i, side, (1 if side else -1), float(known.rise[i, side])
        space, value = here.near.problem.space, float(here.x[i])
        self.room = abs(float((space.upper if side else space.lower)[i]) - value)
        self.distance = self.first = abs(float(known.ends[i, side]) - value)
        self.inside, self.outside = (0.0, 0.0), (math.inf, math.inf)  # (distance, height) on both sides of height 1
        self.seen, self.fresh, self.lost, self.goes_on, self.runs = False, False, False, True, 0
        self.found: float | None = None
        """The end, where it is not the tangent's."""

    def followed(self, jobs: int) -> Walk[None]:
        """From point to point."""
        for _ in range(POINTS):
            if self.goes_on and not self.together.lower and self.together.runs > 0:
                yield from self.look(jobs)

    def look(self, jobs: int) -> Walk[None]:
        """At one point, and where the next one is."""
        there = yield from self._refitted(jobs)
        if there is None:  # the runs fail there, or its ground is not seen from so far
            self.outside, self.distance = (self.distance, math.inf), 0.5 * (self.inside[0] + self.distance)
            return
        rise = there.value - self.here.value
        if rise < -LOWER * self.limit:
            self.together.lower = True
            return
        height = math.sqrt(max(rise + there.foreseen(there.step([self.i])), 0.0) / self.limit)
        as_foreseen = not self.seen and max(abs(height - 1), abs(height * self.first / self.distance - 1)) <= OFF
        self.seen = self.seen or self.distance == self.first
        ends = as_foreseen or abs(height - 1) <= CLOSE or (self.distance == self.room and height <= 1)
        self.goes_on = not ends and self.runs <= RUNS
        self.last = there if self.goes_on else self.here
        if as_foreseen:
            return
        if not ends:
            if height < 1:
                self.inside = (self.distance, height)
            else:
                self.outside = (self.distance, height)
            self.distance = min(self.room, _next(self.inside, self.outside))
        if ends or (self.inside[0] > 0 and (math.isfinite(self.outside[1]) or not self.lost)):
            self.found = float(self.here.x[self.i]) + self.sign * self.distance

    def _refitted(self, jobs: int) -> Walk[Linearised | None]:
        """The minimum over all other unknowns at the distance; None where the runs fail or do not lead there."""
        enough, moved = EXACT * self.limit, np.zeros(len(self.here.x))
        moved[self.i] = self.here.x[self.i] + self.sign * self.distance - self.last.x[self.i]
        begun = yield from self.last.at(self.last.x + self.last.step([self.i], moved))
        self._took(1)
        if begun is None:
            return None
        there = yield from onward(begun, enough, held=[self.i])
        self._took(len(there.axes) - len(begun.axes))
        near, derivatives = self.distance - self.inside[0] <= SHORT * self.first, 2 * len(there.x)
        asked = near and not self.fresh and derivatives <= self.together.runs
        if asked and -there.foreseen(there.step([self.i])) > enough:
            J, self.fresh = jacobian(there.near.problem, there.x, np.arange(len(there.x)), jobs=jobs), True
            self._took(derivatives)
            if isinstance(J, Failure):
                return None
            there = yield from onward(linearised(replace(there.tangent, derivatives=J)), enough, held=[self.i])
            self._took(len(there.axes) - 2)
        below = there.value - self.here.value < self.limit  # and its ground, seen or not, is lower still
        arrived = below or -there.foreseen(there.step([self.i])) <= enough
        self.lost = self.lost or not arrived
        self.together.points.append((there.value, there.x))
        return there if arrived else None

    def _took(self, runs: int) -> None:
        self.runs, self.together.runs = self.runs + runs, self.together.runs - runs


def _next(inside: tuple[float, float], outside: tuple[float, float]) -> float:
    """Where the height is 1, were it a line between two points; at most three times as far as was seen."""
    if not math.isfinite(outside[1]):
        return min(inside[0] / max(inside[1], 1 / 3), 0.5 * (inside[0] + outside[0]))
    slope = (outside[1] - inside[1]) / (outside[0] - inside[0])
    return inside[0] + (1 - inside[1]) / slope
