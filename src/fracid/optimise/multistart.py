"""Least squares from many starts: the given one, and Sobol points over the bounds.

For a smooth cost with several minima.  The loop keeps the best of all; a start whose run fails costs one
evaluation.  Sobol points fill the box more evenly than random ones [1]_.

References
----------
.. [1] I. Sobol', USSR Comput. Math. Math. Phys. 7 (1967) 86; scrambled: A. Owen, J. Complexity 14 (1998) 466.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fracid.optimise.base import Optimiser, Outcome, Space, at_least
from fracid.optimise.least_squares import least_squares

__all__ = ["multistart"]


def multistart(space: Space, rng: np.random.Generator, *, starts: int = 8, tolerance: float = 1e-8) -> Optimiser:
    """Run least squares from the start of the space and from `starts` − 1 scrambled Sobol points.

    Unbounded unknowns keep their start.

    Raises
    ------
    InputError
        When it runs, if `starts` is below 1, or the cost has no residuals.

    Examples
    --------
    >>> from fracid.optimise import Evaluation, minimise
    >>> space = Space(("a",), np.array([-3.0]), np.array([3.0]), np.array([-1.0]))
    >>> def evaluate(x):  # two minima, the higher one nearer
    ...     r = np.array([x[0] ** 2 - 1, 0.5 * (x[0] - 1)])
    ...     return Evaluation(x, float(r @ r), r)
    >>> minimise(evaluate, multistart(space, np.random.default_rng(1))).best.point.round(4)
    array([1.])
    """
    from scipy.stats.qmc import Sobol

    bounded = np.isfinite(space.upper - space.lower)
    cube = Sobol(len(space.names), rng=rng).random_base2((at_least("starts", starts, 1) - 1).bit_length())
    low, high = np.where(bounded, space.lower, space.start), np.where(bounded, space.upper, space.start)
    outcome = Outcome.ALL_FAILED
    for start in [space.start, *(low + cube * (high - low))][:starts]:
        ended = yield from least_squares(replace(space, start=np.clip(start, low, high)), None, tolerance=tolerance)
        outcome = ended if ended is Outcome.CONVERGED or outcome is Outcome.ALL_FAILED else outcome
    return outcome
