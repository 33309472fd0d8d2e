"""The walk along a profile: one parameter moves outwards, all others are re-estimated at each point.

With V the cost (the sum of squares) and V* its minimum, the rise of V at a point, scaled by the sandwich so that it
is χ² with one degree of freedom where residuals are correlated too, reaches 3.84 at the ends of the 95 % interval.
:func:`walk` goes from the minimum to one side in steps of √rise of equal size, each a :func:`refit` from the last
point extrapolated, until the rise passes 3.84, the bound is reached, runs fail, or the steps are spent (:class:`End`);
:func:`crossing` interpolates, linear in √rise.  :class:`Surface` is V about the minimum with its scale.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure, InputError
from fracid.estimation.covariance import Sandwich, at_bound, sandwich
from fracid.estimation.horizons import Watch, descent, minimised, uninterrupted
from fracid.optimise import Evaluation
from fracid.problem import Problem
from fracid.quantiles import CHI2_95, NORMAL_95

TOLERANCE = 1e-7
"""Of the refit that finds the minimum, relative to V."""

FINE = 0.01
"""A refit on the way ends where a step gains less than this in W: the last one gained far less yet."""

BUDGET = 30
"""Trial steps of each refit at most."""

LOWER = 0.05
"""A rise that matters: a point lower than the minimum by more means that it was none."""


class End(StrEnum):
    """Why a walk to one side ended; the value is the sentence."""

    CROSSED = "the cost reaches the 95 % limit"
    BOUND = "it ends at its bound before the cost reaches the 95 % limit"
    FAILED = "the runs fail before the cost reaches the 95 % limit"
    SPENT = "the cost stays below the 95 % limit in the range searched"


# --- the refit of what is not held -------------------------------------------------------------------


def refit(problem: Problem, x: FloatArray, fixed: Sequence[int] = (), *, tolerance: float = TOLERANCE) -> Evaluation:
    """Minimise over all unknowns but those held at their values in x, from x, on this thread.

    Parameters
    ----------
    fixed : sequence of int
        Their indices.
    tolerance : float
        Of :func:`fracid.optimise.least_squares`; a user's own cost takes Nelder and Mead's method.

    Returns
    -------
    Evaluation
        With all the unknowns as its point; an infinite cost where every run failed.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=5e-3, end=2.0)
    >>> swing = Experiment("twin", 5e-3, run.states[:, [0, 2]], np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> problem = Problem(rig, (swing,), {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)},
    ...                   initial_state="held")
    >>> refit(problem, np.array([1.0, 0.95]), fixed=[1]).point.round(3)
    array([0.9 , 0.95])
    """
    x = problem.space.clipped(x)
    search = descent(problem, x, fixed, tolerance=tolerance, budget=BUDGET)
    return problem.evaluate(x) if len(fixed) == len(x) else uninterrupted(minimised(problem, search, Watch())).best


class Surface:
    """V about a minimum, and by how much its rise is scaled."""

    def __init__(self, problem: Problem, top: Evaluation, jobs: int) -> None:
        """About the minimum `top`."""
        self.problem, self.top = problem, top
        self.calibrated = problem.cost_function.loss is not None
        self.space = problem.space
        self.at_bound = np.flatnonzero(at_bound(problem, top.point, jobs=jobs))
        self._shape: dict[tuple[int, ...], Sandwich] = {}
        self.jobs = jobs
        self._lock = threading.Lock()

    def sandwich(self, *which: int) -> Sandwich:
        """Over all unknowns off their bounds, and `which`."""
        inside = np.setdiff1d(np.arange(len(self.top.point)), self.at_bound)
        free = np.union1d(inside, which).astype(np.intp)
        with self._lock:
            if tuple(free) not in self._shape:
                shape = sandwich(self.problem, self.top.point, free, jobs=self.jobs)
                if isinstance(shape, Failure):
                    raise InputError(f"There is no threshold for the profile: {shape}.")
                self._shape[tuple(free)] = shape
            return self._shape[tuple(free)]

    def kappa(self, i: int) -> float:
        """κ of one unknown; the mean over all where the data do not see it."""
        if not self.calibrated:
            return 2 * max(self.top.cost, 1e-300) / CHI2_95[1]  # W = 3.84 where the cost has doubled
        shape = self.sandwich(i)
        at = int(np.searchsorted(shape.free, i))
        own = [at] if shape.inverse[at, at] > 0 and not _blind(shape, at) else range(len(shape.free))
        scale = np.trace(np.linalg.pinv(shape.inverse[np.ix_(own, own)]) @ shape.covariance[np.ix_(own, own)])
        return float(max(scale / len(own), 1e-300))

    def rise(self, e: Evaluation, i: int) -> float:
        """How far V has risen over its minimum, in units of the likelihood's."""
        return 2 * (e.value - self.top.value) / self.kappa(i)

    def tolerance(self, *fixed: int) -> float:
        """Of a refit on the way, relative to V, so that it ends within FINE."""
        kappa = min(self.kappa(i) for i in fixed)
        return float(np.clip(0.5 * FINE * kappa / max(self.top.value, 1e-300), 1e-9, 1e-3))

    def standard_error(self, i: int) -> float:
        """By the sandwich; NaN where the data do not see it, infinite precision and a user's own cost."""
        if not self.calibrated:
            return math.nan
        shape = self.sandwich(i)
        at = int(np.searchsorted(shape.free, i))
        se = math.sqrt(max(0.0, shape.covariance[at, at]))
        return se if se > 0 and not _blind(shape, at) else math.nan

    def slope(self, fixed: Sequence[int]) -> FloatArray:
        """How the others follow those held, were the cost a parabola, shape (n_unknowns, n_held)."""
        slope = np.zeros((len(self.top.point), len(fixed)))
        slope[list(fixed), range(len(fixed))] = 1.0
        if self.calibrated:
            shape = self.sandwich(*fixed)
            at = np.searchsorted(shape.free, fixed)
            slope[shape.free] = shape.inverse[:, at] @ np.linalg.pinv(shape.inverse[np.ix_(at, at)])
            slope[list(fixed)] = np.eye(len(fixed))
        return slope


def _blind(shape: Sandwich, at: int) -> bool:
    """Whether an unknown takes part in a direction that J does not see."""
    return bool(np.any(np.abs(shape.directions[:, at]) > 1e-6 * np.linalg.norm(shape.directions, axis=1)))


# --- the walk ------------------------------------------------------------------------------------------


class Branch(NamedTuple):
    """One side of a profile, from the minimum outwards, the minimum left out."""

    path: tuple[Evaluation, ...]
    end: End


RETRIES = 5
"""Shorter steps in a row, at most."""

NEAR = 0.02
"""The walk ends this close to where runs fail, as a part of the way there."""


def walk(surface: Surface, i: int, side: int, points: int, counted: Callable[[], None] = lambda: None) -> Branch:
    """Go from the minimum to one side until the rise is past the threshold; calls `counted` after each point."""
    path, heights, wall = [surface.top], [0.0], math.inf  # how far from the minimum runs fail
    best, bound = surface.top.point[i], float((surface.space.upper if side > 0 else surface.space.lower)[i])
    slope, aim = surface.slope([i])[:, 0], 2 * NORMAL_95 / (points - 1)  # so that the last is past it
    step, retries, tolerance = _first_step(surface, i, aim), 0, surface.tolerance(i)
    for _ in range(4 * points):
        if heights[-1] >= NORMAL_95 or len(path) == 2 * points:
            break
        here = path[-1].point
        room, open_ = abs(bound - here[i]), wall - abs(here[i] - best)
        if room == 0 or open_ < NEAR * wall < math.inf:
            break
        step = min(step, room, 0.5 * open_)
        step = room if room - step < 1e-3 * step else step
        ahead = here + side * step * slope
        ahead[i] = bound if step == room else here[i] + side * step
        e = refit(surface.problem, ahead, [i], tolerance=tolerance)
        height = math.sqrt(max(0.0, surface.rise(e, i)))
        if not math.isfinite(height):
            wall = abs(ahead[i] - best)
            continue
        gain = height - heights[-1]
        if gain > 2.5 * aim and retries < RETRIES:
            step, retries = step / 3, retries + 1
            continue
        path.append(e)
        counted()
        heights.append(height)
        slope, retries = (e.point - here) / (e.point[i] - here[i]), 0
        step *= float(np.clip(aim / max(gain, 1e-9), 0.3, 3.0))
    end = End.BOUND if path[-1].point[i] == bound else End.FAILED if wall < math.inf else End.SPENT
    return Branch(tuple(path[1:]), End.CROSSED if heights[-1] >= NORMAL_95 else end)


def _first_step(surface: Surface, i: int, aim: float) -> float:
    """As far as the rise of a parabola aims; a fiftieth of the range where there is none to go by."""
    x, width = abs(float(surface.top.point[i])), float(surface.space.upper[i] - surface.space.lower[i])
    rough = 0.02 * (width if math.isfinite(width) else max(x, 1.0))
    step = aim * surface.standard_error(i)
    return min(step, 12 * rough) if math.isfinite(step) else rough


def crossing(values: FloatArray, rise: FloatArray) -> float | None:
    """Where the rise first passes 3.84, linear in √W between points; from the minimum outwards."""
    height = np.sqrt(np.maximum(rise, 0.0))
    past = np.flatnonzero(height >= NORMAL_95)
    if not len(past):
        return None
    k = int(past[0])
    share = (NORMAL_95 - height[k - 1]) / (height[k] - height[k - 1])
    return float(values[k - 1] + share * (values[k] - values[k - 1]))
