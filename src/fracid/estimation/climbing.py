"""Where a search of rich friction begins: on short windows, and one element after the other.

Of sixteen random starts with presliding and Stribeck's friction in both joints of a real SRV02 one came to the minimum,
four stopped near it on one angle and eleven far off.  What those elements look like at their minimum, viscous and dry
friction have found already, but for a shape: how far a joint gives, at which speed stiction goes.  So a search climbs:

1. What is :attr:`~fracid.models.friction.Friction.climbed` is off, and all else is fitted to windows of a few swings
   (:mod:`fracid.estimation.windows`), where the phase cannot run away.
2. Rung by rung an element comes in where it does nothing: its strength at "off", and its shape at each of its
   :attr:`~fracid.models.friction.Friction.entries` in turn.  The best on the windows goes on.
3. With what the windows share held, each recording's own unknowns are found on a horizon that grows; then all goes on
   together on the whole record.  The two take turns as long as the first gains: where a joint gives, many starts of a
   motion lead to nearly one swing, a curved valley in which all together creep.
4. All goes on from the best of the simpler structure there, too: no structure ends above one that is nested in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.estimation.horizons import Watch, from_start, lowest_from, refined
from fracid.estimation.windows import in_windows, shared_values
from fracid.models.friction import RUNGS
from fracid.optimise import Result
from fracid.problem import Problem
from fracid.problem.unknowns import Free

ROUGH: Mapping[str, Any] = {"tolerance": 1e-2, "budget": 12}
"""Least squares on the windows from each entry of an element."""

FINE: Mapping[str, Any] = {"tolerance": 1e-3, "budget": 30}
"""From the best of them."""

GAINS = 1e-3
"""Part of the cost that a recording's own unknowns must gain, found once more, for all to go on from there."""


def late_rungs(problem: Problem) -> dict[str, tuple[str, ...]]:
    """Rung → the free parameters that come in after all others, from the ground up.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0},
    ...                   {"b_alpha": Free(1e-4, 0.0, 1.0), "presliding_theta": Free(1e-3, 0.0, 0.1)})
    >>> late_rungs(problem)
    {'presliding': ('presliding_theta',)}
    """
    free = {n for n, v in problem.parameters.items() if isinstance(v, Free)}
    kinds = {n: k for n, k in problem.model.friction.items() if k.climbed and n in free}
    order = dict.fromkeys((*RUNGS, *(k.rung for k in kinds.values())))
    rungs = {rung: tuple(n for n, k in kinds.items() if k.rung == rung) for rung in order}
    return {rung: names for rung, names in rungs.items() if names}


def climbed(problem: Problem, watch: Watch) -> list[tuple[str, Result]]:
    """What the whole record comes to from the simpler structure, and from the top of the climb; nothing without rungs.

    Parameters
    ----------
    problem : Problem
    watch : Watch
        Told of every evaluation.

    Returns
    -------
    list of (str, Result)
        From where, and the result on the whole record.
    """
    elements = [n for rung in late_rungs(problem).values() for n in rung]
    if not elements or problem.cost_function.loss is None:
        return []
    simple = without(problem, elements)
    values = simple.named(from_start(simple, watch).point) | _off(problem, elements)
    simpler = refined(problem, embedded(problem, values), watch)
    return [("the simpler structure", simpler), ("windows", by_windows(problem, watch))]


def by_windows(problem: Problem, watch: Watch, **options: Any) -> Result:
    """The climb on windows, rung by rung, and from its top least squares on the whole record."""
    late, values = late_rungs(problem), dict(problem.parameter_starts)
    for k, names in enumerate(((), *late.values())):
        later = [n for rung in list(late)[k:] for n in late[rung]]
        pieces = in_windows(without(problem, later))
        starts = [embedded(pieces, {**values, **entry}) for entry in entries(pieces, names)]
        ends = [lowest_from(pieces, x, watch, **ROUGH) for x in starts]
        best = lowest_from(pieces, min(ends, key=lambda e: e.cost).point, watch, **FINE)
        values |= shared_values(pieces, best.point)
    return in_turn(problem, found_again(problem, embedded(problem, values), problem, watch), watch, **options)


def in_turn(problem: Problem, x: FloatArray, watch: Watch, **options: Any) -> Result:
    """Least squares from x, and again from where each recording's own unknowns, found anew there, cost less."""
    result = refined(problem, x, watch, **options)
    while not result.interrupted:
        x = found_again(problem, result.best.point, problem, watch)
        if not problem.cost(x) < (1 - GAINS) * result.best.cost:
            break
        result = refined(problem, x, watch, **options)
    return result


def found_again(problem: Problem, x: FloatArray, whole: Problem, watch: Watch) -> FloatArray:
    """The point of `whole` with what its recordings have for themselves found from their start, all else as in x."""
    alone = problem.with_shared(x, whole.experiments)
    return embedded(whole, problem.named(x) | alone.named(from_start(alone, watch).point))


def entries(problem: Problem, names: Sequence[str]) -> list[dict[str, float]]:
    """Where elements come in: strengths off, shapes at each of their entries in turn.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0})
    >>> entries(problem, ["stiction_theta", "stribeck_speed_theta"])
    [{'stiction_theta': 0.0, 'stribeck_speed_theta': 0.05}, {'stiction_theta': 0.0, 'stribeck_speed_theta': 0.5}]
    """
    kinds, own = problem.model.friction, {p.name: p.value for p in problem.model.parameters} | problem.parameter_starts

    def entry(name: str, turn: int) -> float:
        kind = kinds[name]
        return kind.entries[turn % len(kind.entries)] * own.get(kind.part_of, 1.0) if kind.entries else kind.off

    turns = max([1, *(len(kinds[n].entries) for n in names)])
    return [{n: entry(n, turn) for n in names} for turn in range(turns)]


def without(problem: Problem, names: Sequence[str]) -> Problem:
    """The problem with elements off.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0},
    ...                   {"presliding_theta": Free(1e-3, 0.0, 0.1)}, initial_state="held")
    >>> without(problem, ["presliding_theta"]).names
    ()
    """
    own = tuple(n for n in problem.per_recording if n not in names)
    return replace(problem, parameters={**problem.parameters, **_off(problem, names)}, per_recording=own)


def embedded(problem: Problem, values: Mapping[str, float]) -> FloatArray:
    """The point with these values, of unknowns or of what they are of, within the bounds; else the start.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": Free(0.9, 0.5, 1.2), "mu": 1.0})
    >>> embedded(problem, {"lambda": 1.0})[:2].tolist()
    [1.0, 0.0]
    """
    x = [values.get(u.name, values.get(u.target, u.range.start)) for u in problem.unknowns]
    return problem.space.clipped(np.array(x, float))


def starting_at(problem: Problem, values: Mapping[str, float]) -> Problem:
    """The same, the search for its parameters to begin at those of these values."""
    free = {n: v for n, v in problem.parameters.items() if isinstance(v, Free) and n in values}
    begun = {n: replace(v, start=values[n]) for n, v in free.items()}
    return replace(problem, parameters={**problem.parameters, **begun})


def _off(problem: Problem, names: Sequence[str]) -> dict[str, float]:
    return {n: problem.model.friction[n].off for n in names}
