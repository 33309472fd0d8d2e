"""What a fit leaves over of each recording and output: noise, or something that the model lacks."""

from __future__ import annotations

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.problem import Experiment, Problem
from fracid.signals.left_over import LeftOver, left_over

__all__ = ["leftovers"]


def leftovers(problem: Problem, x: FloatArray) -> dict[str, LeftOver]:
    """Recording and output, in words → what is left over of it; empty where a run fails."""
    fitted = [problem.fitted(x, e) for e in problem.experiments]
    return {
        f"{e.name}, {output}": left_over(
            _scored(e, e.measured[:, k] - y[:, k], k), e.measured[:, k], known=e.deviation is not None
        )
        for e, y in zip(problem.experiments, fitted, strict=True) if not isinstance(y, Failure)
        for k, output in enumerate(problem.outputs)
    }  # fmt: skip


def _scored(e: Experiment, residual: FloatArray, output: int) -> FloatArray:
    """What counts of a residual, NaN where nothing does; in standard deviations where these are known."""
    residual = residual if e.deviation is None else residual / e.deviation[:, output]
    return residual if e.scored is None else np.where(e.scored, residual, np.nan)
