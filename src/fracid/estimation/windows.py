"""A record in pieces: a few swings each, with an initial state of its own.

Over a whole record the phase after thirty swings decides the cost, and friction that is a little wrong early cannot be
told from friction that is very wrong late: of rich friction each wrong shape has a minimum of its own.  Over three
swings the phase cannot run away.  In pieces, each of which starts anew, the cost has few minima, and what all pieces
share is nearly that of the whole record (*multiple shooting* [1]_).  The pieces are where a search of rich friction
begins; where it ends is the whole record.

References
----------
.. [1] H. G. Bock, *Recent advances in parameter identification techniques for O.D.E.*, in Numerical Treatment of
   Inverse Problems in Differential and Integral Equations, Birkhäuser (1983).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from fracid.arrays import FloatArray
from fracid.problem import Experiment, Problem
from fracid.problem.unknowns import Free
from fracid.tasks.simulation_cache import Recent

SWINGS = 3
"""Of a window."""

WINDOWS = 12
"""Of all recordings together; of a long one they lie apart."""

LEAST = 0.25
"""Of a window's samples so many count: beside masks, bridged gaps and delays little may be left."""


def in_windows(problem: Problem) -> Problem:
    """The same problem on windows of its recordings, which share all but their initial states.

    Orders stay where the search starts: a window's past is not its own, and an order would stand in for it.

    Examples
    --------
    >>> import fracid
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 1, "mu": 1}, initial={"alpha": 0.3}, step=4e-3, end=20.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> pieces = in_windows(Problem(rig, (swing,), {"lambda": Free(1.0, 0.5, 1.2), "mu": 1.0}))
    >>> len(pieces.experiments), pieces.orders, len(pieces.experiments[0].time) * 4e-3 < 4.0
    (9, {'lambda': 1.0, 'mu': 1.0}, True)
    """
    count = max(1, WINDOWS // len(problem.experiments))
    windows = tuple(w for e in problem.experiments for w in _windows(e, count))
    orders = {n: v.start if isinstance(v, Free) else v for n, v in problem.orders.items()}
    return replace(problem, experiments=windows, orders=orders, initial_state="estimate", memo=Recent())


def in_parts(problem: Problem, parts: int, own: Sequence[str]) -> Problem:
    """The same problem on parts of its recordings, one after the other, each with its own values of some parameters.

    Examples
    --------
    >>> import fracid
    >>> swing = Experiment("twin", 4e-3, np.cos(np.arange(900) / 9)[:, None] * [1, 1], np.zeros((1, 1)))
    >>> orders = {"lambda": 1.0, "mu": 1.0}
    >>> problem = Problem(fracid.rotary_pendulum(), (swing,), orders, {"b_alpha": Free(1e-4, 0.0, 1.0)})
    >>> [u.name for u in in_parts(problem, 2, ["b_alpha"]).unknowns if u.target == "b_alpha"]
    ['b_alpha [twin, part 1]', 'b_alpha [twin, part 2]']
    """
    pieces = []
    for e in problem.experiments:
        ends = np.linspace(0, len(e.measured), parts + 1).astype(int).tolist()
        pieces += [_piece(e, f"{e.name}, part {k}", a, b) for k, (a, b) in enumerate(pairwise(ends), start=1)]
    names = tuple(dict.fromkeys((*problem.per_recording, *own)))
    return replace(
        problem,
        experiments=tuple(p for p in pieces if p.samples),
        per_recording=names,
        initial_state="estimate",
        memo=Recent(),
    )


def _windows(e: Experiment, most: int) -> list[Experiment]:
    """Windows of a recording, evenly spread; the recording itself where it is no longer than one, or none counts.

    Every delay lies in the first half of a window."""
    samples, late = len(e.measured), e.longest_delay
    length = round(SWINGS * samples / max(e.swings, SWINGS))
    length = min(samples, max(length, math.ceil(2 * late / e.step) + 2 if late > 0 else 0))
    count = min(most, samples // length)
    firsts = np.linspace(0, samples - length, count).astype(int) if count > 1 else [0]
    windows = [_piece(e, f"{e.name}, window {k + 1}", a, a + length) for k, a in enumerate(map(int, firsts))]
    return [w for w in windows if w.samples >= LEAST * length] or [_piece(e, e.name, 0, samples)]


def _piece(e: Experiment, name: str, first: int, end: int) -> Experiment:
    """Some samples of a recording, which begin in motion."""
    return replace(
        e, name=name, past=None, past_inputs=None, release_time=0.0, initial={},
        measured=e.measured[first:end], inputs=e.inputs if len(e.inputs) == 1 else e.inputs[first:end],
        start=e.start + first * e.step, source=e.source_of(first, end),
    )  # fmt: skip


def shared_values(problem: Problem, x: FloatArray) -> Mapping[str, float]:
    """What a point says of orders and parameters, by name: of those that each window has for itself, the median.

    Examples
    --------
    >>> import fracid
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum("srv02-rotpen"), (still,), {"lambda": Free(0.9, 0.5, 1.2), "mu": 1.0})
    >>> shared_values(problem, problem.start)
    {'lambda': 0.9}
    """
    values: dict[str, list[float]] = {}
    for unknown, value in zip(problem.unknowns, x.tolist(), strict=True):
        if unknown.kind in ("order", "parameter"):
            values.setdefault(unknown.target, []).append(value)
    return {name: float(np.median(several)) for name, several in values.items()}
