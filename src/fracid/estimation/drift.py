"""Does friction change while a recording lasts?  Its windows say so, and cost no fit.

Each window says by how much the shared unknowns should be others in it, its own start found again.  Of each friction a
line in time is put through that, the others as one for all windows: one step of Gauss and Newton, with the variance of
windows that differ from each other.  Frictions that drift together are not told apart: the surest is said.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.block_covariance import normal_equations, scores_in, window_sums
from fracid.estimation.derivatives import by_blocks, slopes_of
from fracid.problem import Problem
from fracid.quantiles import NORMAL_95
from fracid.signals.correlation import bartlett_long_run

SURE = 2.0
"""A drift is said where it is so many times its 95 % half-width: of ten frictions none by chance."""


class Drift(NamedTuple):
    """Of one friction, in parts of its value a minute."""

    name: str
    rate: float
    half: float
    """Of its 95 % interval."""


def drift_of(problem: Problem, x: FloatArray) -> Drift | None:
    """The friction that changes most surely while the recordings of a problem in windows last, if one does."""
    free = np.flatnonzero((x > problem.space.lower) & (x < problem.space.upper) & ~problem.absent(x))
    if problem.blocks is None or not problem.in_windows:
        return None
    J = by_blocks(problem, x, free)
    if isinstance(J, Failure):
        return None
    blocks, near = J.blocks, normal_equations(problem, J, free)
    seen = [r @ near.bread.follow[blocks.columns(k)] for k, r in enumerate(near.rows)]
    sums = window_sums(blocks, scores_in(near.norm, J, slopes_of(problem, J.errors)), near.bread)
    minutes = np.array([e.start + e.time[-1] / 2 for e in problem.experiments]) / 60
    for _, part in problem.recordings.values():
        minutes[part] -= np.mean(minutes[part])
    H = np.array([p.T @ p for p in seen])
    A, B, C = (np.tensordot(minutes**power, H, 1) for power in (0, 1, 2))
    along = np.linalg.pinv(A, hermitian=True) @ B
    curvature = np.diag(C - B @ along)
    found = []
    for i, at in enumerate(free[blocks.shared].tolist()):
        if problem.unknowns[at].target in problem.model.friction and x[at] > 0 and curvature[i] > 0:
            rate = -float(np.sum(minutes * sums[:, i] - sums @ along[:, i])) / curvature[i]
            left = sums + rate * (minutes[:, None] * H[:, :, i] - H @ along[:, i])  # without the drift
            scatter = (minutes * left[:, i] - left @ along[:, i])[:, None]
            spread = math.sqrt(bartlett_long_run(scatter, len(scatter) ** (1 / 3))[0, 0]) / curvature[i]
            scale = float(near.norm[blocks.shared[i]] * x[at])
            found.append(Drift(problem.names[at], float(rate) / scale, NORMAL_95 * float(spread) / scale))
    surest = max(found, key=lambda d: abs(d.rate) / d.half, default=None)
    return surest if surest is not None and abs(surest.rate) > SURE * surest.half else None
