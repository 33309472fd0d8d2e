"""The step of a comparison: as fine as its two best structures need.

A fit chooses its step (:mod:`fracid.validation.discretisation`).  Structures must be compared at one step, or a BIC
would be of the solver; so the step is halved until the best with orders free and the best with orders 1 are quiet at
it, and all are fitted again from their minima there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.estimation.covariance import LEAST_SHIFT
from fracid.estimation.horizons import Watch, refined, uninterrupted
from fracid.problem import Problem
from fracid.problem.checks import MOST_STEPS

FINEST = 16
"""Steps a sample at most: there are many structures."""

COARSE = 0.05
"""A cost that half the step changes by more than this part says that the step is too coarse."""

HELPS = 0.7
"""A half step that leaves more than this part of what moved before does not help."""

NEAR: Mapping[str, Any] = {"tolerance": 1e-5, "budget": 20}
"""Least squares at half the step, to see how far its minimum is."""

HIGHER = 0.02
"""A minimum that costs more than this part more at a finer step is not the one that was there."""


def quiet_substeps(problem: Problem, x: FloatArray, half_widths: Mapping[str, float], *, jobs: int = 1) -> int:
    """The fewest steps a sample at which half the step moves neither cost nor orders, or as many as help.

    Parameters
    ----------
    problem : Problem
    x : numpy.ndarray, shape (n_unknowns,)
        Its minimum.
    half_widths : mapping
        Half the 95 % interval of each free order.
    jobs : int
        Threads.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 0.5}, step=1e-2, end=4.0)
    >>> swing = Experiment("twin", 1e-2, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)}, initial_state="held",
    ...                   method="gl")
    >>> x = refined(problem, problem.start, Watch()).best.point
    >>> quiet_substeps(problem, x, {"mu": 1.0}), quiet_substeps(problem, x, {"mu": 1e-3}) > 1
    (1, True)
    """
    steps = max(problem.simulator.steps(e) for e in problem.experiments) / problem.substeps
    width = {i: max(LEAST_SHIFT, half_widths.get(n, np.inf)) for n, i in problem.free_orders.items()}
    here, before = problem.evaluate(x), (np.inf, np.inf)
    while 2 * problem.substeps <= FINEST and 2 * problem.substeps * steps <= MOST_STEPS:
        half = replace(problem, substeps=2 * problem.substeps)
        if not width and abs(half.cost(here.point) - here.cost) <= COARSE * here.cost:  # its minimum changes by less
            break
        there = uninterrupted(refined(half, here.point, Watch(jobs), **NEAR)).best
        moved = max((abs(there.point[i] - here.point[i]) / width[i] for i in width), default=0.0)
        changed = abs(there.cost - here.cost)
        quiet = moved <= 1.0 and (problem.method != "pi2" or changed <= COARSE * here.cost)
        helps = moved <= HELPS * before[0] or changed <= HELPS * before[1]
        if there.reason or quiet or not helps:
            break
        problem, here, before = half, there, (moved, changed)
    return problem.substeps
