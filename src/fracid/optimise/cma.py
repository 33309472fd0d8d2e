"""CMA-ES, evolution with an adapted covariance [1]_, by its authors' package ``cma``: for rough costs in long valleys.

Each generation is drawn from a normal distribution whose covariance learns the valley's shape; the better half
moves it.  It needs fewer evaluations than differential evolution where unknowns pull on each other, as the
constants of a pendulum do, and the order of the costs is all that it looks at.  It starts at the given start, a
quarter of the bounds wide, in the unit cube; a point beyond a bound is mirrored there.  A generation is one batch.
A failed run is merely the worst of its generation.

References
----------
.. [1] N. Hansen, *The CMA Evolution Strategy: A Tutorial*, arXiv:1604.00772.
"""

from __future__ import annotations

import math

import numpy as np

from fracid.errors import InputError, at_least
from fracid.optimise.base import Entry, Optimiser, Outcome, Space

WORST = 1e300
"""In the place of an infinite cost: the package refuses those."""


def cma(
    space: Space, rng: np.random.Generator, *, population: int | None = None, generations: int | None = None,
    width: float = 0.25, tolerance: float = 1e-6,
) -> Optimiser:  # fmt: skip
    """Evolve a normal distribution from the start of the space.

    Parameters
    ----------
    population : int, optional
        Points per generation; 4 + 3 ln n rounded down is the authors' default.
    generations : int, optional
        At most; 100 + 50 (n + 3)² / √population is the authors' default.
    width : float
        First standard deviation, in parts of the bounds.
    tolerance : float
        Standard deviation, in parts of the bounds, at which it has converged.

    Raises
    ------
    InputError
        If a bound is infinite, a count is not one, or a width is not positive.

    Examples
    --------
    >>> from fracid.optimise import Evaluation, minimise
    >>> space = Space(("a", "b"), np.array([0.0, 0.0]), np.array([9.0, 9.0]), np.array([1.0, 1.0]))
    >>> found = minimise(lambda x: Evaluation(x, float(np.abs(x - [3.0, 4.0]).sum())),
    ...                  cma(space, np.random.default_rng(1)))
    >>> found.best.point.round(3)
    array([3., 4.])
    """
    from cma import CMAEvolutionStrategy

    n = len(space.names)
    population = at_least("population", 4 + int(3 * math.log(n)) if population is None else population, 3)
    default = 100 + 50 * (n + 3) ** 2 // math.isqrt(population)
    generations = at_least("generations", default if generations is None else generations, 1)
    for name, value in {"width": width, "tolerance": tolerance}.items():
        if not 0.0 < value <= 1.0:
            raise InputError(f"{name} = {value!r}; expected a part of the bounds, above 0 and up to 1.")
    corners = space.from_unit(np.array([[0.0], [1.0]]) * np.ones(n))
    quiet = {"tolfun": 0.0, "tolfunhist": 0.0, "verbose": -10, "verb_log": 0}  # and it writes no file
    drawn = {"randn": lambda *shape: rng.standard_normal(shape), "seed": np.nan}
    strategy = CMAEvolutionStrategy(
        (space.start - corners[0]) / (corners[1] - corners[0]), width,
        {"popsize": population, "tolx": tolerance, **drawn, **quiet},
    )  # fmt: skip
    outcome = Outcome.ALL_FAILED
    for _ in range(generations):
        normal = strategy.ask()
        mirrored = 1.0 - np.abs(1.0 - np.mod(np.array(normal), 2.0))  # into the unit cube, as between two mirrors
        evaluations = yield space.from_unit(mirrored)
        costs = [e.cost if math.isfinite(e.cost) else WORST for e in evaluations]
        outcome = Outcome.GENERATIONS_DONE if min(costs) < WORST else outcome
        strategy.tell(normal, costs)
        if strategy.stop():
            return Outcome.CONVERGED if outcome is Outcome.GENERATIONS_DONE else outcome
    return outcome


OPTIMISER = Entry("cma", cma, polish=True)
