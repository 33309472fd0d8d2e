"""What a fit leaves over of each recording and output: noise, or something that the model lacks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.derivatives import jacobian
from fracid.estimation.records import fit_percent
from fracid.problem import Experiment, Problem
from fracid.signals.coloured import is_coloured_noise
from fracid.signals.correlation import longest_stretch
from fracid.signals.left_over import LeftOver, left_over
from fracid.units import GREEK

FINER = 2
"""Times the steps of a fit: behind a jump of an input a step is off by more than the rest of its record, which is no
lack of the model."""


def leftovers(problem: Problem, x: FloatArray) -> dict[str, LeftOver]:
    """Recording and output, in words → what is left over of it; empty where a run fails."""
    recordings = [e for e, _ in problem.recordings.values()]

    @cache
    def derivatives() -> list[FloatArray]:
        windows = len(recordings) < len(problem.experiments)
        J = None if problem.blocks is not None or windows else jacobian(problem, x, np.arange(len(x)))
        none = [np.zeros((*e.measured.shape, 0)) for e in recordings]
        return J if isinstance(J, list) else none

    left = _leftovers(problem, x, derivatives)
    if all(found.noise for found in left.values()):
        return left
    finer = _leftovers(replace(problem, substeps=FINER * problem.substeps), x, derivatives)
    return finer if finer and all(found.noise for found in finer.values()) else left


def _leftovers(
    problem: Problem, x: FloatArray, derivatives: Callable[[], list[FloatArray]]
) -> dict[str, LeftOver]:  # fmt: skip
    def of(number: int, output: int, simulated: FloatArray) -> LeftOver:
        return _left_over(recordings[number], simulated, output, lambda: derivatives()[number][:, output])

    recordings = [e for e, _ in problem.recordings.values()]
    fitted = [problem.followed(x, e.name) for e in recordings]
    return {
        f"{e.name}, {GREEK.get(output, output)}": of(number, k, y)
        for number, (e, y) in enumerate(zip(recordings, fitted, strict=True)) if not isinstance(y, Failure)
        for k, output in enumerate(problem.outputs)
    }  # fmt: skip


def _left_over(
    e: Experiment, simulated: FloatArray, output: int, unknowns: Callable[[], FloatArray]
) -> LeftOver:  # fmt: skip
    """Of one output: what counts of it, in standard deviations where these are known."""
    measured, fitted = e.measured[:, output], simulated[:, output]
    counts = np.ones(len(measured), dtype=bool) if e.scored is None else e.scored
    residual = np.where(counts, measured - fitted, np.nan)
    residual = residual if e.deviation is None else residual / e.deviation[:, output]
    left = left_over(residual, measured, known=e.deviation is not None)
    if not left.explained:
        at = longest_stretch(np.isfinite(residual))
        motion = np.hstack([simulated, e.inputs]) if len(e.inputs) == len(measured) else simulated
        left = replace(left, coloured=is_coloured_noise(residual[at], motion[at], lambda: unknowns()[at]))
    moves = np.ptp(measured[counts]) > 0.0
    return replace(left, fit=fit_percent(measured[counts], fitted[counts])) if moves else left
