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
from fracid.estimation.covariance import LEAST_SHIFT, half_width, uncertainty
from fracid.estimation.horizons import Watch, lowest_from
from fracid.problem import Problem
from fracid.problem.checks import MOST_STEPS

FINEST = 16
"""Steps a sample at most: there are many structures."""

QUIET = 0.2
"""CI half-widths by which half the step may move an unknown."""

COARSE = 0.05
"""A cost that half the step changes by more than this part says that the step is too coarse."""

HELPS = 0.7
"""A half step that leaves more than this part of what moved before does not help."""

NEAR: Mapping[str, Any] = {"tolerance": 1e-6, "budget": 20}
"""Least squares at half the step, to see how far its minimum is; and at the first, for x may end short of its own."""

HIGHER = 0.02
"""A minimum that costs more than this part more at a finer step is not the one that was there."""


def quiet_substeps(problem: Problem, x: FloatArray, *, jobs: int = 1) -> int:
    """The fewest steps a sample at which half the step moves neither cost nor unknowns, or as many as help.

    Parameters
    ----------
    problem : Problem
        With a cost of known loss.
    x : numpy.ndarray, shape (n_unknowns,)
        Its minimum.
    jobs : int
        Threads.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 0.5}, step=1e-2, end=4.0)
    >>> def needed(noise):
    ...     y = run.states[:, [0, 2]] + noise * np.random.default_rng(1).standard_normal((401, 2))
    ...     swing = Experiment("twin", 1e-2, y, np.zeros((1, 1)))
    ...     problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)}, initial_state="held")
    ...     return quiet_substeps(problem, lowest_from(problem, problem.start, Watch()).point)
    >>> needed(0.1), needed(0.01)
    (1, 4)
    """
    steps = max(problem.simulator.steps(e) for e in problem.experiments) / problem.substeps
    known, least = uncertainty(problem, x, jobs=jobs), LEAST_SHIFT * problem.space.sizes(x)
    width = np.maximum([half_width(known, x, i) or np.inf for i in range(len(x))], least)
    here, before = lowest_from(problem, x, Watch(jobs), **NEAR), (np.inf, np.inf)
    while 2 * problem.substeps <= FINEST and 2 * problem.substeps * steps <= MOST_STEPS:
        half = replace(problem, substeps=2 * problem.substeps)
        there = lowest_from(half, here.point, Watch(jobs), **NEAR)
        moved = float(np.max(np.abs(there.point - here.point) / width))
        changed = abs(there.cost - here.cost)
        quiet = moved <= QUIET and (problem.method != "pi2" or changed <= COARSE * here.cost)
        helps = moved <= HELPS * before[0] or changed <= HELPS * before[1]
        if there.reason or quiet or not helps:
            break
        problem, here, before = half, there, (moved, changed)
    return problem.substeps
