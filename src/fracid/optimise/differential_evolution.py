"""Differential evolution (Storn and Price 1997) by SciPy: for rough costs with few unknowns."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracid.optimise.base import Optimiser, Outcome, Space, as_generator

__all__ = ["differential_evolution"]

FloatArray = NDArray[np.float64]


def differential_evolution(
    space: Space, rng: np.random.Generator, *, population: int = 10, generations: int = 40, tolerance: float = 1e-6
) -> Optimiser:
    """Evolve ``population × n`` points, whole generations at a time, so that they run on all threads.

    Parameters
    ----------
    population : int
        Points per unknown.
    generations : int
        After the initial one, at most.
    tolerance : float
        Relative spread of the population's costs at which it has converged.
    """
    from scipy.optimize import differential_evolution as scipy_differential_evolution

    corners = space.from_unit(np.array([[0.0], [1.0]]) * np.ones(len(space.names)))

    def run(evaluate: Any) -> Outcome:
        def costs(points: FloatArray) -> FloatArray:  # SciPy's vectorised form: shape (n, k)
            batch = evaluate(np.clip(points.T.reshape(-1, len(space.names)), *corners))
            return np.array([e.cost if np.isfinite(e.cost) else 1e300 for e in batch])

        found = scipy_differential_evolution(
            costs, list(zip(*corners, strict=True)), x0=space.start, rng=rng, popsize=population, maxiter=generations,
            tol=tolerance, vectorized=True, updating="deferred", polish=False,
        )  # fmt: skip
        return Outcome.CONVERGED if found.success else Outcome.GENERATIONS_DONE

    return as_generator(run)
