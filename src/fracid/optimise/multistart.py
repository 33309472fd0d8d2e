"""Least squares from many starts: the given one, and Sobol points over the bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fracid.optimise.base import Optimiser, Outcome, Space
from fracid.optimise.least_squares import least_squares

__all__ = ["multistart"]


def multistart(space: Space, rng: np.random.Generator, *, starts: int = 8, tolerance: float = 1e-8) -> Optimiser:
    """Run least squares from the start of the space and from `starts` − 1 scrambled Sobol points.

    Unbounded unknowns keep their start.
    """
    from scipy.stats.qmc import Sobol

    bounded = np.isfinite(space.upper - space.lower)
    cube = Sobol(len(space.names), rng=rng).random_base2(max(0, int(np.ceil(np.log2(max(1, starts - 1))))))
    low, high = np.where(bounded, space.lower, space.start), np.where(bounded, space.upper, space.start)
    outcome = Outcome.ALL_FAILED
    for start in [space.start, *(low + cube * (high - low))][: max(1, starts)]:
        ended = yield from least_squares(replace(space, start=np.clip(start, low, high)), None, tolerance=tolerance)
        outcome = ended if ended is Outcome.CONVERGED or outcome is Outcome.ALL_FAILED else outcome
    return outcome
