"""The simplex of Nelder and Mead [1]_ by SciPy: a local search for a cost that has no residuals.

One run at a time, so no threads help; use it from a good start, with few unknowns.  A failed run is merely
a bad corner.  A corner beyond a bound is reflected there: clipped, the simplex would lie flat in the bound.

References
----------
.. [1] J. Nelder, R. Mead, Comput. J. 7 (1965) 308; steps for many unknowns: F. Gao, L. Han, Comput. Optim. Appl.
   51 (2012) 259.
"""

from __future__ import annotations

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import at_least
from fracid.optimise.base import Ask, Entry, Optimiser, Outcome, Space, as_generator


def nelder_mead(space: Space, _rng: object, *, tolerance: float = 1e-6, budget: int = 1000) -> Optimiser:
    """Move a simplex from the start of the space, whose first edges are a tenth of the bounds; what is held stays.

    Parameters
    ----------
    tolerance : float
        Of the edges, relative to the first ones, and of the corners' costs, relative to the start's.
    budget : int
        Evaluations at most.

    Raises
    ------
    InputError
        If `budget` is below 1.

    Examples
    --------
    >>> from fracid.optimise import Evaluation, minimise
    >>> space = Space(("a", "b"), np.array([0.0, 0.0]), np.array([9.0, 9.0]), np.array([1.0, 1.0]))
    >>> found = minimise(lambda x: Evaluation(x, float(np.abs(x - [3.0, 4.0]).sum())), nelder_mead(space, None))
    >>> found.best.point.round(3)
    array([3., 4.])
    """
    at_least("budget", budget, 1)
    from scipy.optimize import minimize

    edges = np.diag(_edges(space))[space.moving]

    def run(evaluate: Ask) -> Outcome:
        def cost(z: FloatArray) -> float:  # z counts edges from the start
            return evaluate(_reflected(space.start + z @ edges, space))[0].cost

        first, many = cost(np.zeros(len(edges))), len(edges)
        if first == np.inf or not many:
            return Outcome.CONVERGED if first < np.inf else Outcome.ALL_FAILED
        # for one unknown the adaptive shrinking factor 1 − 1/n is 0: the simplex would fall into a point
        options = {"xatol": tolerance, "fatol": tolerance * abs(first), "maxfev": budget - 1, "adaptive": many > 1,
                   "initial_simplex": np.eye(many + 1, many, -1)}  # fmt: skip
        result = minimize(cost, np.zeros(many), method="Nelder-Mead", options=options)
        return Outcome.CONVERGED if result.success else Outcome.BUDGET_SPENT

    return as_generator(run)


def _reflected(x: FloatArray, space: Space) -> FloatArray:
    x = np.where(x < space.lower, 2 * space.lower - x, x)
    x = np.where(x > space.upper, 2 * space.upper - x, x)
    return space.clipped(x)


def _edges(space: Space) -> FloatArray:
    """A tenth of the bounds, or of the start where there are none, towards the inside."""
    width = space.upper - space.lower
    edge = np.where(np.isfinite(width), 0.1 * width, np.maximum(0.1 * np.abs(space.start), 1e-2))
    return np.where(space.start + edge > space.upper, -edge, edge)


OPTIMISER = Entry("nelder-mead", nelder_mead, polish=True)
