"""How far a parameter may go: the limits of what it means, beyond the bounds that a project gives it.

A bound of a project is where its author thinks that nothing is to be found.  Beyond it a value may mean as much as
before: an inertia, a stiffness, a dry friction of twice the size.  Or nothing any more: a friction below 0 drives the
rig, an order belongs to the equations, a delay and a release decide which samples are scored.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from fracid.problem.problem import Problem
from fracid.problem.sensors import QUANTITIES
from fracid.problem.unknowns import Free

TENFOLD = 10.0
"""By which a bound is opened at a time."""

TURN = 6.3
"""An angle is nowhere further away [rad]."""


def limits(problem: Problem, name: str) -> tuple[float, float]:
    """Between which values a free order or parameter means something, and those that are tied to it.

    A parameter keeps its sign where a bound gives it one: what turns the other way is another rig.

    Examples
    --------
    >>> import fracid, numpy as np
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> ranges = {"b_alpha": Free(0.1, 0.0, 1.0), "torque_per_volt": Free(-0.1, -1.0, 0.0),
    ...           "presliding_alpha": Free(0.1, 0.0, 0.2)}
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0}, ranges)
    >>> [limits(problem, name) for name in ranges]
    [(0.0, inf), (-inf, 0.0), (0.0, 0.5)]
    """
    if name in problem.orders:
        return 0.0, 1.0 if name in problem.model.springpot_orders.values() else 2.0
    free = problem.parameters[name]
    assert isinstance(free, Free)
    if name.partition("_")[0] in QUANTITIES:
        return free.lower, free.upper
    followers = [n for n, root in problem.ties.items() if root == name]
    constants = [problem.model.parameter(n) for n in (name, *followers)]
    low, high = max(c.lower for c in constants), min(c.upper for c in constants)
    if free.lower >= 0.0 or name in problem.model.friction:
        low = max(low, min(0.0, free.lower))
    if free.upper <= 0.0:
        high = min(high, 0.0)
    if (kind := problem.model.friction.get(name)) is not None:
        high = min(high, kind.most * (problem.parameter_starts.get(kind.part_of, 1.0) if kind.part_of else 1.0))
    if constants[0].unit == "rad":
        low, high = max(low, -TURN), min(high, TURN)
    return min(low, free.lower), max(high, free.upper)


def opened(problem: Problem, name: str, *, upper: bool) -> Free | None:
    """The range of a free parameter with one bound ten times as far away, or at its limit; None where that is nowhere.

    Steps of a search are measured as before.

    Examples
    --------
    >>> import fracid, numpy as np
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> ranges = {"b_alpha": Free(0.1, 0.0, 1.0)}
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0}, ranges)
    >>> opened(problem, "b_alpha", upper=True).upper, opened(problem, "b_alpha", upper=False)
    (10.0, None)
    """
    free = problem.parameters[name]
    if not isinstance(free, Free) or free.hard:
        return None
    limit, bound = limits(problem, name)[upper], free.upper if upper else free.lower
    outwards = (bound > 0) == upper
    further = bound * TENFOLD if outwards else bound / TENFOLD
    further = min(further, limit) if upper else max(further, limit)
    if bound == 0.0 or not (further > bound if upper else further < bound):
        return None
    return with_bound(free, further, upper=upper)


def with_bound(free: Free, bound: float, *, upper: bool) -> Free:
    """A range with another bound, in which a search measures its steps as before.

    Examples
    --------
    >>> with_bound(Free(0.1, 0.0, 1.0), 50.0, upper=True)
    Free(start=0.1, lower=0.0, upper=50.0, prior=None, scale=0.1, hard=False)
    """
    width = free.upper - free.lower
    scale = free.scale or min(max(abs(free.start), 0.01 * width), width)
    return replace(free, scale=scale, upper=bound) if upper else replace(free, scale=scale, lower=bound)


def with_ranges(problem: Problem, ranges: Mapping[str, Free]) -> Problem:
    """The problem with other ranges of free parameters.

    Examples
    --------
    >>> import fracid, numpy as np
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> ranges = {"b_alpha": Free(0.1, 0.0, 1.0)}
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0}, ranges)
    >>> with_ranges(problem, {"b_alpha": Free(0.1, 0.0, 10.0)}).space.upper[0]
    np.float64(10.0)
    """
    return replace(problem, parameters={**problem.parameters, **ranges}) if ranges else problem
