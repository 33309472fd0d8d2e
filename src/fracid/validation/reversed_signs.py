"""Is the sign of an angle wrong?  Two swings of each recording, fitted as given and with one sign reversed.

A wrong sign leaves most of the motion over, whatever the constants are; the right one leaves little, even after a
search of a few steps.  What is asked of so short a fit is which of the two it is, no value.  Undriven, one of two
angles reversed is the same as the other reversed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.horizons import uninterrupted
from fracid.findings import Finding, Words
from fracid.optimise import least_squares, minimise
from fracid.problem import Experiment, Problem
from fracid.problem.costs import COSTS
from fracid.problem.unknowns import scaled
from fracid.signals.swing import swing_period, swing_start

SAYS = Words("validation/before_search.toml")

SWINGS = 2
"""That are fitted to compare signs."""

SAMPLES = 60
"""Of each of them that are fitted."""

SIGNS = 8
"""Recordings whose signs are asked for."""

BAD = 0.35
"""Part of the motion that two fitted swings leave over, beyond which other signs are tried."""

ROUNDS = 3
"""Of a few steps each, until that is reached: a drafted start may lack ten times its friction."""

BETTER = 0.5
"""A sign that leaves less than this part of what the given one does is named."""


def wrong_sign(problem: Problem, jobs: int) -> Iterator[Finding]:
    """Turn each angle round, in each recording by itself, for each has signs of its own.

    One finding for all recordings with the same angle reversed, with the numbers of the clearest.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 0.6}, step=4e-3, end=3.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]] * [1.0, -1.0], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)})
    >>> [(f.code, f.where) for f in wrong_sign(problem, 1)]
    [('wrong-sign', 'twin: theta')]
    """
    alone = {e.name: _reversal(replace(problem, experiments=(e,)), jobs) for e in _most_moved(problem)}
    reversals = {name: found for name, found in alone.items() if found is not None}
    for angles in dict.fromkeys(own for own, _, _ in reversals.values()):
        alike = {name: (given, turned) for name, (own, given, turned) in reversals.items() if own == angles}
        given, turned = max(alike.values(), key=lambda left: left[0] / left[1])
        where, either = f"{', '.join(alike)}: {angles[0]}", " or ".join(angles)
        yield SAYS.finding("wrong-sign", where, 100 * given, 100 * BAD, turned=100 * turned, angles=either)


def _most_moved(problem: Problem) -> list[Experiment]:
    """Not more than so many recordings, in their order: those in which the angle that moves less moves most."""
    travels = [-np.min(np.ptp(e.measured, axis=0)) for e in problem.experiments]
    return [problem.experiments[i] for i in np.sort(np.argsort(travels, kind="stable")[:SIGNS])]


def _reversal(problem: Problem, jobs: int) -> tuple[tuple[str, ...], float, float] | None:
    """Angles of which either, reversed, explains the one recording, and what is left over without that and with it.

    None where it fits as it is, or reversed no better.
    """
    early = _two_swings(problem)
    angles = [] if early is None else _signed(early)
    if early is None or not angles or (given := _left_over(early, jobs)) < BAD:
        return None
    turned = {o: _left_over(_turned(early, o), jobs) for o in angles}
    best = min(turned.values())
    if not best < min(BAD, BETTER * given):
        return None
    same = len(angles) == 2 and not np.any(early.experiments[0].inputs)  # undriven, one turned is the other turned
    either = tuple(o for o in angles if same or turned[o] < 1.5 * best)
    return either, given, best


def _two_swings(problem: Problem) -> Problem | None:
    """Of the recording, every so many samples, by its rmse; None if nothing swings."""
    e = problem.experiments[0]
    moving = [y for y in e.measured.T if np.ptp(y) > 0]
    period, begins = min(((swing_period(y), swing_start(y)) for y in moving), default=(math.inf, 0))
    if not math.isfinite(period) or e.past is not None:
        return None
    every = max(1, round(period / SAMPLES)) if e.times is None else 1
    early = e.until(float(e.time[min(len(e.measured), begins + round((SWINGS + 0.25) * period)) - 1]))
    short = replace(early, step=every * e.step, measured=early.measured[::every], inputs=early.inputs[::every],
                    deviation=None)  # fmt: skip
    return replace(problem, experiments=(short,), cost_function=COSTS["rmse"], weights="equal", memo=None,
                   substeps=max(1, round(SAMPLES * every / period)), method="pi2")  # fmt: skip


def _signed(problem: Problem) -> list[str]:
    """The angles whose sign matters: reversed all together, the equations are the same."""
    e = problem.experiments[0]
    travel = np.ptp(e.measured, axis=0)
    moves = [o for o, far in zip(problem.outputs, travel, strict=True) if far > 1e-2 * travel.max()]
    return moves if len(moves) > 1 or np.any(e.inputs) else []


def _turned(problem: Problem, output: str) -> Problem:
    """The same with the sign of one output, and of what is known of its start, reversed."""
    e, i = problem.experiments[0], problem.model.output_states.get(output)
    own = set() if i is None else {problem.model.states[j] for j in (i, problem.model.rates.get(i, i))}
    sign = np.where(np.array(problem.outputs) == output, -1.0, 1.0)
    initial = {n: scaled(v, -1.0) if n in own else v for n, v in e.initial.items()}
    return replace(problem, experiments=(replace(e, measured=e.measured * sign, initial=initial),))


def _left_over(problem: Problem, jobs: int) -> float:
    """The part of the motion that a short search leaves over; the start's where that is little already."""
    x, part = problem.start, _part(problem, problem.start)
    for _ in range(ROUNDS if problem.names else 0):
        if part < BAD:
            break
        search = least_squares(replace(problem.space, start=x), None, tolerance=1e-3, budget=6)
        x = uninterrupted(minimise(problem.evaluate, search, jobs=jobs)).best.point
        part = _part(problem, x)
    return part


def _part(problem: Problem, x: FloatArray) -> float:
    """The part of the motion that x leaves over, rms over the outputs that move; infinite if its run fails."""
    e = problem.experiments[0]
    fitted = problem.fitted(x, e)
    if isinstance(fitted, Failure):
        return math.inf
    spread = np.std(e.measured, axis=0)
    moves = spread > 1e-2 * spread.max()
    parts = np.sqrt(np.mean((e.measured - fitted) ** 2, axis=0))[moves] / spread[moves]
    return float(np.sqrt(np.mean(parts**2)))
