"""The best set of k candidates, repetition allowed: one after the other, then by exchange (Fedorov)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fracid.arrays import FloatArray
from fracid.experiments.criteria import Objective

BETTER = 1e-9
"""An exchange lowers the criterion by more than this."""

MOST_ROUNDS = 100
"""Of exchanges of every experiment."""


def averaged(objective: Objective, parts: tuple[FloatArray, ...], rest: tuple[FloatArray, ...]) -> FloatArray:
    """The criterion of what is there with each candidate added, averaged over the draws, shape (n_candidates,)."""
    return np.asarray(np.mean(objective(tuple(p + r[:, None] for p, r in zip(parts, rest, strict=True))), axis=0))


def exchange(
    objective: Objective, parts: tuple[FloatArray, ...], base: tuple[FloatArray, ...], count: int
) -> tuple[int, ...]:
    """Choose `count` of the candidates.

    Parameters
    ----------
    objective : function
        Of sums over experiments, shape (n_draws, n_sets, ...): what is minimised, shape (n_draws, n_sets).
    parts : tuple of array, shape (n_draws, n_candidates, ...)
        What each candidate adds.
    base : tuple of array, shape (n_draws, ...)
        What is there without any.
    count : int

    Examples
    --------
    Two ends of a line are worth more than its middle:

    >>> x = np.linspace(-1.0, 1.0, 5)
    >>> rows = np.stack([np.ones(5), x], axis=-1)
    >>> volume = lambda sums: -np.linalg.slogdet(sums[0])[1]
    >>> exchange(volume, ((rows[:, :, None] * rows[:, None, :])[None],), (1e-9 * np.eye(2)[None],), 2)
    (0, 4)
    """
    chosen: list[int] = []
    while len(chosen) < count:
        chosen.append(int(np.argmin(averaged(objective, parts, _without(parts, base, chosen, None)))))
    for _ in range(MOST_ROUNDS):
        changed = False
        for place in range(count):
            values = averaged(objective, parts, _without(parts, base, chosen, place))
            best = int(np.argmin(values))
            if values[best] < values[chosen[place]] - BETTER:
                chosen[place], changed = best, True
        if not changed:
            break
    return tuple(sorted(chosen))


def _without(
    parts: tuple[FloatArray, ...], base: tuple[FloatArray, ...], chosen: Sequence[int], place: int | None
) -> tuple[FloatArray, ...]:
    """The sums of those that are chosen but one."""
    others = [c for k, c in enumerate(chosen) if k != place]
    return tuple(b + p[:, others].sum(axis=1) for p, b in zip(parts, base, strict=True))
