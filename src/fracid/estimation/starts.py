"""Where a search started and where it ended: the record of each start of a multi-start search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fracid.arrays import FloatArray

SAME_COST = 1.01
"""Costs up to this factor above the lowest are the same step of the waterfall."""


@dataclass(frozen=True)
class Start:
    """One start of the search, and what became of it."""

    origin: str
    """``given``, ``regression`` or ``Sobol 3``."""
    point: FloatArray
    """Where it started, shape (n_unknowns,)."""
    first_cost: float
    """There, on the first swing; infinite where the run fails."""
    end: FloatArray
    """Where it ended or was left, shape (n_unknowns,)."""
    cost: float | None
    """There, on the whole record; None where it was left before."""
    ended: str
    """How, in words."""
    evaluations: int
    joined: str | None = None
    """The origin of the start whose minimum it fell into."""


def won(starts: Sequence[Start]) -> Start | None:
    """The start that ended lowest."""
    candidates = [s for s in starts if s.cost is not None]
    return min(candidates, key=lambda s: s.cost if s.cost is not None else np.inf, default=None)


def final_cost(start: Start, starts: Sequence[Start]) -> float | None:
    """A start's final cost, or that of the one whose minimum it fell into; None where it was left for its cost."""
    by_origin = {s.origin: s for s in starts}
    while start.cost is None and start.joined is not None:
        start = by_origin[start.joined]
    return start.cost if start.cost is not None and np.isfinite(start.cost) else None
