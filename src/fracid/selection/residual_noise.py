"""What a fit leaves over of each recording and output: noise, or something that the model lacks."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np

from fracid.arrays import FloatArray
from fracid.estimation.block_jacobian import BlockJacobian
from fracid.estimation.derivatives import by_all
from fracid.estimation.input_noise import noisy_inputs, shaken
from fracid.estimation.records import RecordingFit, fit_of
from fracid.problem import Problem
from fracid.signals.coloured import is_coloured_noise
from fracid.signals.correlation import longest_stretch
from fracid.signals.left_over import LeftOver
from fracid.units import letter

FINER = 2
"""Times the steps of a fit: behind a jump of an input a step is off by more than the rest of its record, which is no
lack of the model."""


def leftovers(problem: Problem, x: FloatArray) -> dict[str, LeftOver]:
    """Recording and output, in words → what is left over of it; empty where a run fails."""
    recordings = [e for e, _ in problem.recordings.values()]

    @cache
    def derivatives() -> list[FloatArray]:
        windows = len(recordings) < len(problem.experiments)
        J = None if problem.blocks is not None or windows else by_all(problem, x)
        return J.parts if isinstance(J, BlockJacobian) else [np.zeros((*e.measured.shape, 0)) for e in recordings]

    def of(problem: Problem, errors: Sequence[FloatArray] = ()) -> dict[str, LeftOver]:
        fits = [fit_of(problem, x, e.name, "fit", initial={}, parameters={}) for e in recordings]
        for k, (r, e) in enumerate(zip(fits, errors, strict=False)):
            fits[k] = replace(r, measured={n: r.fitted[n] + d for n, d in zip(problem.outputs, e.T, strict=True)})
        return {
            f"{r.name}, {letter(n)}":
                _left_over(r, n, e.inputs, partial(lambda i, k: derivatives()[i][:, k], i, k))
            for i, (e, r) in enumerate(zip(recordings, fits, strict=True)) if math.isfinite(r.cost)
            for k, n in enumerate(problem.outputs)
        }  # fmt: skip

    left = of(problem)
    if not all(found.noise for found in left.values()):
        finer = of(replace(problem, substeps=FINER * problem.substeps))
        left = finer if finer and all(found.noise for found in finer.values()) else left
    by_noise = None if all(found.explained for found in left.values()) else shaken(problem, x)
    if by_noise is None or len(by_noise[1]) != len(recordings):  # none, or of windows
        return left
    by_inputs, names = of(problem, by_noise[1]), " and ".join(map(letter, noisy_inputs(problem)))
    return {where: replace(e, coloured=True, inputs=names) if by_inputs[where].noise and not e.explained else e
            for where, e in left.items()}  # fmt: skip


def _left_over(r: RecordingFit, output: str, inputs: FloatArray, unknowns: Callable[[], FloatArray]) -> LeftOver:
    """Of one output: what counts of it, in standard deviations where these are known."""
    percent, left, residual = r.fit_percent[output], r.left_over(output), r.standardised(output)
    if not left.explained and r.of(output) is r:
        at, simulated = longest_stretch(np.isfinite(residual)), np.column_stack([*r.fitted.values()])
        motion = np.hstack([simulated, inputs]) if len(inputs) == len(simulated) else simulated
        left = replace(left, coloured=is_coloured_noise(residual[at], motion[at], lambda: unknowns()[at]))
    return replace(left, fit=percent) if math.isfinite(percent) else left
