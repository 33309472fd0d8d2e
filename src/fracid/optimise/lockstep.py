r"""Many searches at once, and where to start them: the parts of ``multistart`` (:mod:`fracid.estimation.search`).

For a smooth cost with several minima.  Sobol points fill the box more evenly than random ones [1]_.  A box is
often as wide as somebody's ignorance, a friction of 0.002 in −1 … 1: so each unknown is drawn evenly in
:math:`\operatorname{asinh}(x/s)`, s the size of its start; that is x itself near zero and its decades further out.

All searches advance together (:func:`lockstep`): in each round every one hands in its batch, and the batches run
as one.  So all threads have work, and the result knows nothing of their number.  A search that has come down, and
whose fit is now the same as a better one's, residual for residual, has fallen into a minimum already found and is left.
Where it has not come down, residuals may agree because nothing moves yet.

References
----------
.. [1] I. Sobol', USSR Comput. Math. Math. Phys. 7 (1967) 86; scrambled: A. Owen, J. Complexity 14 (1998) 466.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fracid.arrays import FloatArray
from fracid.optimise.base import Entry, Evaluation, Optimiser, Outcome, Space

MOST_STARTS = 100_000
"""Weeks of work: more is a slip, and the points alone would not go into memory."""

DOWN = 0.98
"""Of its first cost: what has not come below is where it started."""

SAME = 0.02
"""Two fits whose residuals differ by less than this part of the better one's residual are the same minimum."""


def sobol_points(space: Space, count: int, rng: np.random.Generator) -> FloatArray:
    """Scrambled Sobol points over the bounds, each unknown evenly in asinh(x/size), shape (count, n).

    Examples
    --------
    >>> space = Space(("b",), np.array([-1.0]), np.array([1.0]), np.array([0.002]))
    >>> points = sobol_points(space, 64, np.random.default_rng(1))
    >>> points.shape, bool(0.2 < np.mean(np.abs(points) < 0.05) < 0.6)  # the size is 0.02 here
    ((64, 1), True)
    """
    from scipy.stats.qmc import Sobol

    if count == 0:
        return np.empty((0, len(space.names)))
    size = space.typical
    bounded = np.isfinite(space.upper - space.lower)
    low, high = (np.arcsinh(np.where(bounded, side, space.start) / size) for side in (space.lower, space.upper))
    cube = Sobol(len(space.names), rng=rng).random_base2((count - 1).bit_length())[:count]
    points = size * np.sinh(low + cube * (high - low))
    return np.asarray(np.where(bounded, space.clipped(points), space.start))


@dataclass(eq=False)
class Path:
    """What one of several searches has come to; :func:`lockstep` keeps it."""

    name: str = ""
    best: Evaluation | None = None
    """None before its first round."""
    outcome: Outcome | None = None
    """None while it runs, and where it was left."""
    first_cost: float = np.inf
    """Of its first point."""
    evaluations: int = 0
    joined: Path | None = None
    """The search in whose minimum it was left."""
    came_down: bool = False
    """Whether it has lowered its cost, here or on a shorter part before."""

    def add(self, batch: list[Evaluation]) -> None:
        """Count a batch and keep the best."""
        self.first_cost = batch[0].cost if self.best is None else self.first_cost
        self.evaluations += len(batch)
        self.best = min([*([self.best] if self.best else []), *batch], key=lambda e: e.cost)
        self.came_down |= self.best.cost < DOWN * self.first_cost

    @property
    def lowest(self) -> float:
        """The cost of the best."""
        return np.inf if self.best is None else self.best.cost


def lockstep(searches: Sequence[Optimiser], paths: Sequence[Path]) -> Optimiser:
    """Advance several searches together, one batch of each a round, and record in `paths` where they get.

    The first is never left, whatever the others have found.

    Parameters
    ----------
    searches : sequence of generators
        Of the same unknowns and the same cost.
    paths : sequence of Path
        One for each; filled while they run.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from fracid.optimise import least_squares, minimise
    >>> space = Space(("a",), np.array([-9.0]), np.array([9.0]), np.array([1.0]))
    >>> starts = [least_squares(replace(space, start=np.array([a])), None) for a in (1.0, 2.0)]
    >>> paths = [Path(), Path()]
    >>> result = minimise(lambda x: Evaluation(x, float((x[0] - 3) ** 2 + 1), np.array([x[0] - 3, 1.0])),
    ...                   lockstep(starts, paths))
    >>> [round(float(p.best.point[0]), 4) for p in paths], result.evaluations == sum(p.evaluations for p in paths)
    ([3.0, 3.0], True)
    """
    try:
        live = {i: np.atleast_2d(next(search)) for i, search in enumerate(searches)}
        while live:
            evaluations = yield np.concatenate(list(live.values()))
            for i, points in list(live.items()):
                batch, evaluations = evaluations[: len(points)], evaluations[len(points) :]
                paths[i].add(batch)
                try:
                    live[i] = np.atleast_2d(searches[i].send(batch))
                except StopIteration as end:
                    paths[i].outcome = end.value
                    del live[i]
            for i in [i for i in live if i > 0]:
                paths[i].joined = _same_minimum(paths, i)
                if paths[i].joined is not None:
                    searches[i].close()
                    del live[i]
    finally:
        for search in searches:
            search.close()
    return Outcome.CONVERGED


def _same_minimum(paths: Sequence[Path], i: int) -> Path | None:
    """The first better search, itself not left, whose residuals are those of search i."""
    mine = paths[i].best
    if mine is None or mine.residuals is None or not paths[i].came_down:
        return None
    for j, other in enumerate(paths):
        best = other.best if j != i and other.joined is None else None
        if best is None or best.residuals is None or (mine.cost, i) < (best.cost, j):
            continue
        if np.linalg.norm(mine.residuals - best.residuals) <= SAME * np.linalg.norm(best.residuals):
            return other
    return None


OPTIMISER = Entry("multistart", None, needs_rows=True)
