r"""Bounded least squares of many recordings: Levenberg and Marquardt's method on an arrowhead.

For problems most of whose unknowns belong to one recording each: all recordings' first own unknowns are moved by
one evaluation, then their second ones, and a step is found recording by recording (:mod:`fracid.arrowhead`).  What it
finds is what :mod:`.least_squares` finds, whose steps cost the cube of the number of unknowns.

A step minimises :math:`‖Js + r‖^2 + α‖s/size‖^2`, with unknowns held that lie at a bound and would leave it; what
leaves by the step stops at its bound.  α follows the ratio of the gain to what was expected [N]_.  Where a difference
fails, the recordings are halved until it is known whose run fails; that unknown stays where it is for that step.

References
----------
.. [N] H. Nielsen, Damping parameter in Marquardt's method, IMM-REP-1999-05, Technical University of Denmark.
"""

from __future__ import annotations

from collections.abc import Generator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray, zeros_together
from fracid.arrowhead import Arrowhead, Blocks
from fracid.optimise.base import Evaluation, Optimiser, Outcome, Space

FIRST = 1e-6
"""The first α, of the greatest curvature in units of the sizes."""

FALL = 1e-2
"""By so much α falls at most from step to step."""

STUCK = 1e12
"""With α this many times that curvature, no step is worth a name."""


def blockwise(space: Space, *, tolerance: float, budget: int) -> Optimiser:
    """Minimise Σ r² from the start of the space.

    Parameters
    ----------
    space : Space
        With blocks.
    tolerance, budget
        As of :func:`fracid.optimise.least_squares`.

    Examples
    --------
    >>> from fracid.optimise import minimise
    >>> blocks = Blocks(np.array([-1, 0, 1]), np.array([0, 4, 8]))
    >>> t = np.arange(4.0)
    >>> def evaluate(x):  # two lines of one slope, each with its own start
    ...     r = np.concatenate([x[1] + x[0] * t - 3 * t, x[2] + x[0] * t - 3 * t - 1])
    ...     return Evaluation(x, float(r @ r), r)
    >>> space = Space(("slope", "a", "b"), np.full(3, -9.0), np.full(3, 9.0), np.zeros(3), blocks=blocks)
    >>> search = blockwise(space, tolerance=1e-8, budget=50)
    >>> bool(np.allclose(minimise(evaluate, search).best.point, [3, 0, 1], atol=1e-6))
    True
    """
    assert space.blocks is not None
    [best], size = (yield space.start[None]), space.typical
    if best.residuals is None:
        return Outcome.ALL_FAILED
    R: Arrowhead | None = None
    r, α, ν = best.residuals, 0.0, 2.0
    for _ in range(budget - 1):
        x = best.point
        if R is None:
            R = yield from _linearised(best, space.blocks, space.steps(x), space.moving)
            steepest = float(np.max(R.norms * size, initial=0.0)) ** 2
            α = α or FIRST * steepest
        step, expected = _step(R, α, space, x)
        if expected <= 0 or α > STUCK * steepest:
            return Outcome.CONVERGED
        [trial] = yield (x + step)[None]
        if trial.residuals is None:
            α, ν = max(16 * α, FIRST * steepest), 2.0
            continue
        before, after = 0.5 * float(r @ r), 0.5 * float(trial.residuals @ trial.residuals)
        ratio = (before - after) / expected
        small = np.linalg.norm(step / size) < tolerance * (tolerance + np.linalg.norm((x - space.start) / size + 1))
        if ratio > 0:
            best, r, R = trial, trial.residuals, None
            α, ν = α * max(FALL, 1 - (2 * ratio - 1) ** 3), 2.0
        else:
            α, ν = ν * α, 2 * ν
        if small or (ratio > 0.25 and before - after < tolerance * before):
            return Outcome.CONVERGED
    return Outcome.BUDGET_SPENT


def _step(R: Arrowhead, α: float, space: Space, x: FloatArray) -> tuple[FloatArray, float]:
    """A step within the bounds, and by how much ½ Σ r² should fall."""
    g, step = R.gradient, np.zeros(len(x))
    held: NDArray[np.bool_] = ((x <= space.lower) & (g > 0)) | ((x >= space.upper) & (g < 0)) | ~space.moving
    while not held.all():
        free = x + R.step(np.where(held, np.inf, np.sqrt(α) / space.typical))
        end = space.clipped(free)
        step = np.where(held, 0.0, end - x)
        expected = -float(g @ step) - 0.5 * R.square(step)
        if expected > 0 or np.array_equal(end, free):
            return step, expected
        held = held | (end != free)
    return step, 0.0


def _linearised(
    here: Evaluation, blocks: Blocks, h: FloatArray, moving: NDArray[np.bool_]
) -> Generator[FloatArray, list[Evaluation], Arrowhead]:
    """R of [J r] by differences, the columns of a group at once; 0 where one fails, and of what is held."""
    x, r = here.point, np.asarray(here.residuals)
    parts = zeros_together([(b - a, len(blocks.columns(k)) + 1) for k, (a, b) in enumerate(pairwise(blocks.rows))])
    for part, rows in zip(parts, np.split(r[: blocks.rows[-1]], blocks.rows[1:-1]), strict=True):
        part[:, -1] = rows
    groups = [group[moving[group]] for group in blocks.groups if np.any(moving[group])]
    while groups:
        points = np.tile(x, (len(groups), 1))
        for point, group in zip(points, groups, strict=True):
            point[group] += h[group]
        halves = []
        for group, e in zip(groups, (yield points), strict=True):
            if e.residuals is not None:
                change, h_taken = blocks.level(e.residuals, r) - r, e.point - x
                for i in group:
                    for k, column in blocks.cells(i):
                        a, b = blocks.rows[k : k + 2]
                        parts[k][:, column] = change[a:b] / h_taken[i]
            elif len(group) > 1:
                halves += np.array_split(group, 2)
        groups = halves
    return Arrowhead.of(blocks, parts)
