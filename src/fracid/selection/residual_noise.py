"""What a fit leaves over of each recording and output: noise, or something that the model lacks."""

from __future__ import annotations

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.records import fit_percent
from fracid.problem import Experiment, Problem
from fracid.signals.left_over import LeftOver, left_over
from fracid.units import GREEK

__all__ = ["leftovers"]


def leftovers(problem: Problem, x: FloatArray) -> dict[str, LeftOver]:
    """Recording and output, in words → what is left over of it; empty where a run fails."""
    fitted = [problem.fitted(x, e) for e in problem.experiments]
    return {
        f"{e.name}, {GREEK.get(output, output)}": _left_over(e, e.measured[:, k], y[:, k], k)
        for e, y in zip(problem.experiments, fitted, strict=True) if not isinstance(y, Failure)
        for k, output in enumerate(problem.outputs)
    }  # fmt: skip


def _left_over(e: Experiment, measured: FloatArray, fitted: FloatArray, output: int) -> LeftOver:
    """Of one output: what counts of it, in standard deviations where these are known."""
    counts = np.ones(len(measured), dtype=bool) if e.scored is None else e.scored
    residual = np.where(counts, measured - fitted, np.nan)
    deviation = None if e.deviation is None else e.deviation[:, output]
    left = left_over(residual if deviation is None else residual / deviation, measured, known=deviation is not None)
    moves = np.ptp(measured[counts]) > 0.0
    return left._replace(fit=fit_percent(measured[counts], fitted[counts])) if moves else left
