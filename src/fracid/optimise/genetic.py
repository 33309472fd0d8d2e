"""The paper's genetic algorithm: population 20, crossover 0.5, mutation 0.01, 25 generations.

The paper gives these four numbers and no more.  Here

* a gene is one unknown, a real number;
* a *pair* of parents, each chosen by a tournament of two, is crossed with a probability of 0.5, all genes
  of it; else the parents are copied.  Simulated binary crossover [1]_ of index 0, the widest: gene by gene
  the distance of two children is that of their parents times a number that is uniform in (0, 1) half of
  the time, and else beyond 1, as far as the bounds;
* each *gene* mutates with a probability of 0.01 (polynomial mutation);
* a generation replaces the last, but for the best of both, the one elite;
* 25 generations follow the initial one: 26 × 20 = 520 evaluations, twins included.

The paper does not say how a gene is coded.  With two genes one child in fifty mutates at all, so crossover
has to do the search, and its kind decides: in a trial not kept here the customary index 15 and genes of 16 bits
searched less well than the wide index 0.  Distance to the minimum in the plane of two orders in [0.5, 1.2]²,
median and worst tenth of 50 seeds, on valleys like that of (26) (``benchmarks/evidence.py`` prints it again):

========================== =============== ===============
520 evaluations            valley 1 : 7    narrow 1 : 20
========================== =============== ===============
this                       0.005   0.043   0.035   0.134
random points              0.019   0.056   0.036   0.090
========================== =============== ===============

So it is no better than random points on a narrow valley: one seed is no answer.  Where the cost is smooth,
least squares needs some 30 evaluations.

References
----------
.. [1] K. Deb, R. Agrawal, Complex Systems 9 (1995) 115.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.errors import InputError, at_least
from fracid.optimise.base import Entry, Optimiser, Outcome, Space


def genetic(
    space: Space, rng: np.random.Generator, *, population: int = 20, crossover: float = 0.5, mutation: float = 0.01,
    generations: int = 25,
) -> Optimiser:  # fmt: skip
    """Breed `generations` of `population` points; the defaults are the paper's.

    Parameters
    ----------
    population, generations : int
        Points per generation; generations after the initial one.
    crossover : float
        Probability that a pair is crossed.
    mutation : float
        Probability that a gene mutates.

    Raises
    ------
    InputError
        If a bound is infinite, a count is not one, or a rate is not within 0 … 1.

    Examples
    --------
    >>> from fracid.optimise import Evaluation, minimise
    >>> space = Space(("a",), np.array([0.0]), np.array([9.0]), np.array([1.0]))
    >>> found = minimise(lambda x: Evaluation(x, float(abs(x[0] - 3))), genetic(space, np.random.default_rng(1)))
    >>> found.evaluations, found.best.cost < 0.1
    (520, True)
    """
    at_least("population", population, 2)
    at_least("generations", generations, 0)
    for name, rate in {"crossover": crossover, "mutation": mutation}.items():
        if not 0.0 <= rate <= 1.0:
            raise InputError(f"{name} = {rate!r}; expected a probability, 0 … 1.")
    draw, best_first = np.random.default_rng(int(rng.integers(2**31))), partial(np.argsort, kind="stable")
    herd = draw.random((population, len(space.names)))
    costs = np.array([e.cost for e in (yield space.from_unit(herd))])
    for _ in range(generations):
        pairs = herd[_winners(costs, 2 * math.ceil(population / 2), draw)]
        young = _mutated(_crossed(pairs[::2], pairs[1::2], crossover, draw), mutation, draw)[:population]
        born = np.array([e.cost for e in (yield space.from_unit(young))])
        elite = best_first(costs)[:1]
        herd, costs = np.concatenate([herd[elite], young]), np.concatenate([costs[elite], born])
        stay = best_first(costs)[:population]
        herd, costs = herd[stay], costs[stay]
    return Outcome.GENERATIONS_DONE


def _winners(costs: FloatArray, count: int, draw: np.random.Generator) -> NDArray[np.int_]:
    """The better of two, so many times; each takes part as often as any other."""
    rounds = [draw.permutation(costs.size) for _ in range(math.ceil(2 * count / costs.size))]
    couples = np.concatenate(rounds)[: 2 * count].reshape(-1, 2)
    return np.array([a if costs[a] < costs[b] else b if costs[b] < costs[a] else draw.choice([a, b])
                     for a, b in couples])  # fmt: skip


def _crossed(a: FloatArray, b: FloatArray, probability: float, draw: np.random.Generator) -> FloatArray:
    """Two children of each pair: the first of all pairs, then the second of all; shape (2 n_pairs, n_unknowns).

    About the middle of its parents a child lies β/2 times their distance away.  That density of β which is symmetric
    in β and 1/β is cut off at a bound [1]_, to which β may reach on that side.
    """
    first, second = a.copy(), b.copy()
    pairs = draw.random(len(a)) < probability
    if pairs.any():
        draw.random((len(a), 1 + a.shape[1]))  # pymoo draws them, and needs none: searches stay as they were with it
        apart = np.abs(a - b) > 1e-14
        low, high = np.minimum(a, b)[apart], np.maximum(a, b)[apart]
        u, swapped = draw.random(low.size), draw.random(low.size) < 0.5
        below = 0.5 * ((low + high) - _spread(u, 1.0 + 2.0 * low / (high - low)) * (high - low))
        above = 0.5 * ((low + high) + _spread(u, 1.0 + 2.0 * (1.0 - high) / (high - low)) * (high - low))
        for child, gene in ((first, np.where(swapped, above, below)), (second, np.where(swapped, below, above))):
            own = child.copy()
            own[apart] = np.clip(gene, 0.0, 1.0)
            child[pairs] = own[pairs]
    return np.concatenate([first, second])


def _spread(u: FloatArray, most: FloatArray) -> FloatArray:
    """β of index 0, of a u that is uniform in (0, 1), where β reaches to `most`."""
    α = 2.0 - 1.0 / most
    return np.where(u <= 1.0 / α, u * α, 1.0 / np.maximum(2.0 - u * α, 1e-300))


def _mutated(herd: FloatArray, probability: float, draw: np.random.Generator) -> FloatArray:
    """Polynomial mutation of index 20: a step within the bounds, mostly a small one."""
    genes, herd = draw.random(herd.shape) < probability, herd.copy()
    x = herd[genes]
    u = draw.random(x.size)
    draw.random(len(herd))  # pymoo's again
    down = (2.0 * u + (1.0 - 2.0 * u) * (1.0 - x) ** 21.0) ** (1 / 21) - 1.0
    up = 1.0 - (2.0 * (1.0 - u) + 2.0 * (u - 0.5) * x**21.0) ** (1 / 21)
    herd[genes] = np.clip(x + np.where(u <= 0.5, down, up), 0.0, 1.0)
    return herd


OPTIMISER = Entry("genetic", genetic, evaluations=26 * 20)
