"""Bounded nonlinear least squares: SciPy's trust-region reflective method (Branch, Coleman, Li 1999).

The engine for everything smooth.  The Jacobian is taken by forward differences whose points are asked for
as one batch, so that they run on all threads.  A trial step whose run fails gets rows of a thousand times
the size of the last good ones: the trust region shrinks away from it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fracid.errors import InputError
from fracid.optimise.base import Evaluation, Optimiser, Outcome, Space, as_generator

__all__ = ["least_squares"]

FloatArray = NDArray[np.float64]

DIFFERENCE = 1e-6
"""Step of the differences, relative to the size of the unknown: √(relative rounding of a trajectory)."""


def least_squares(
    space: Space, rng: np.random.Generator | None, *, tolerance: float = 1e-8, budget: int = 100
) -> Optimiser:
    """Minimise Σ r² from the start of the space.

    Parameters
    ----------
    tolerance : float
        Of the relative gain, step and gradient.
    budget : int
        Trial steps at most (Jacobians not counted).
    """
    del rng  # nothing here is random
    from scipy.optimize import least_squares as scipy_least_squares

    size = _sizes(space)

    def run(evaluate):  # type: ignore[no-untyped-def]
        good: list[Evaluation] = []

        def residuals(x: FloatArray) -> FloatArray:
            e = evaluate(x)[0]
            if e.residuals is not None:
                good[:] = [e]
                return np.asarray(e.residuals)
            if not good:
                raise _StartFails(e)
            return np.full_like(good[0].residuals, 1e3 * max(np.abs(good[0].residuals).max(), 1e-6))

        def jacobian(x: FloatArray) -> FloatArray:
            h = DIFFERENCE * size
            h = np.where(x + h > space.upper, -h, h)
            batch = evaluate(x + np.diag(h))
            base = good[0].residuals if np.array_equal(good[0].point, x) else residuals(x)
            columns = [
                (e.residuals - base) / (e.point[i] - x[i]) if e.residuals is not None else np.zeros_like(base)
                for i, e in enumerate(batch)
            ]
            return np.column_stack(columns)

        try:
            found = scipy_least_squares(
                residuals, space.start, jacobian, bounds=(space.lower, space.upper), x_scale=size,
                ftol=tolerance, xtol=tolerance, gtol=None, max_nfev=budget,
            )  # fmt: skip
        except _StartFails as failed:
            if failed.evaluation.cost < np.inf:
                raise InputError(
                    "This cost has no residuals for least squares: type optimiser = 'genetic' or "
                    "'differential-evolution', or one of the built-in costs."
                ) from None
            return Outcome.ALL_FAILED
        return Outcome.BUDGET_SPENT if found.status == 0 else Outcome.CONVERGED

    return as_generator(run)


def _sizes(space: Space) -> FloatArray:
    """The size of each unknown: of its start, or of a hundredth of its range where it starts near zero."""
    width = space.upper - space.lower
    return np.maximum(np.abs(space.start), np.where(np.isfinite(width), 1e-2 * width, 1e-3))


class _StartFails(Exception):
    def __init__(self, evaluation: Evaluation) -> None:
        super().__init__(evaluation.reason)
        self.evaluation = evaluation
