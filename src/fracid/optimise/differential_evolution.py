"""Differential evolution by SciPy: for rough costs with few unknowns.

A child of point i is :math:`x_{best} + F (x_a - x_b)`, mixed gene by gene with :math:`x_i` (F drawn from
[0.5, 1) for each generation); it replaces :math:`x_i` where it is better [1]_.  A generation is one batch.

References
----------
.. [1] R. Storn, K. Price, J. Global Optim. 11 (1997) 341.
"""

from __future__ import annotations

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import at_least
from fracid.optimise.base import Ask, Entry, Optimiser, Outcome, Space, as_generator

ROUNDING = 1e-12
"""Of a range: so far within its bounds a start is, for SciPy's own rounding would put it outside by a last digit."""


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

    Raises
    ------
    InputError
        If a bound is infinite, or a count is not one.

    Examples
    --------
    >>> from fracid.optimise import Evaluation, minimise
    >>> space = Space(("a",), np.array([0.0]), np.array([9.0]), np.array([1.0]))
    >>> search = differential_evolution(space, np.random.default_rng(1))
    >>> found = minimise(lambda x: Evaluation(x, float(abs(x[0] - 3))), search)
    >>> round(float(found.best.point[0]), 3)
    3.0
    """
    from scipy.optimize import differential_evolution as scipy_differential_evolution

    at_least("population", population, 5)
    at_least("generations", generations, 1)
    corners = space.from_unit(np.array([[0.0], [1.0]]) * np.ones(len(space.names)))
    inside = space.from_unit(np.array([[ROUNDING], [1 - ROUNDING]]) * np.ones(len(space.names)))

    def run(evaluate: Ask) -> Outcome:
        def costs(points: FloatArray) -> FloatArray:  # SciPy's vectorised form: shape (n, k)
            return np.array([e.cost for e in evaluate(np.clip(points.T.reshape(-1, len(space.names)), *corners))])

        result = scipy_differential_evolution(
            costs, list(zip(*corners, strict=True)), x0=np.clip(space.start, *inside), rng=rng, popsize=population,
            maxiter=generations, tol=tolerance, vectorized=True, updating="deferred", polish=False,
        )  # fmt: skip
        return Outcome.CONVERGED if result.success else Outcome.GENERATIONS_DONE

    return as_generator(run)


OPTIMISER = Entry("differential-evolution", differential_evolution, polish=True)
