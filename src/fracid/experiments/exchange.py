"""The best set of k candidates, repetition allowed: one after the other, then by exchange (Fedorov)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fracid.arrays import FloatArray
from fracid.experiments.criteria import Objective

BETTER = 1e-9
"""An exchange lowers the criterion by more than this."""

MOST_ROUNDS = 100
"""Of exchanges of every experiment."""


@dataclass(frozen=True)
class Criterion:
    """What is minimised of sums over experiments."""

    objective: Objective
    """Of sums, shape (n_sets, ...)."""
    parts: tuple[FloatArray, ...]
    """What each candidate adds, shape (n_candidates, ...)."""
    base: tuple[FloatArray, ...]
    """What is there without any, shape (...)."""


def of_each(criteria: Sequence[Criterion], chosen: Sequence[int]) -> FloatArray:
    """The mean of the criteria with each candidate added to those that are chosen, shape (n_candidates,)."""
    at = [*chosen]
    sums = (tuple(p + (b + p[at].sum(axis=0)) for p, b in zip(c.parts, c.base, strict=True)) for c in criteria)
    return np.asarray(np.mean([c.objective(own) for c, own in zip(criteria, sums, strict=True)], axis=0))


def exchange(criteria: Sequence[Criterion], count: int) -> tuple[int, ...]:
    """Choose `count` of the candidates, by the mean of some criteria.

    Examples
    --------
    Two ends of a line are worth more than its middle:

    >>> x = np.linspace(-1.0, 1.0, 5)
    >>> rows = np.stack([np.ones(5), x], axis=-1)
    >>> volume = lambda sums: -np.linalg.slogdet(sums[0])[1]
    >>> exchange([Criterion(volume, (rows[:, :, None] * rows[:, None, :],), (1e-9 * np.eye(2),))], 2)
    (0, 4)
    """
    chosen: list[int] = []
    while len(chosen) < count:
        chosen.append(int(np.argmin(of_each(criteria, chosen))))
    for _ in range(MOST_ROUNDS):
        changed = False
        for place in range(count):
            values = of_each(criteria, chosen[:place] + chosen[place + 1 :])
            best = int(np.argmin(values))
            if values[best] < values[chosen[place]] - BETTER:
                chosen[place], changed = best, True
        if not changed:
            break
    return tuple(sorted(chosen))
