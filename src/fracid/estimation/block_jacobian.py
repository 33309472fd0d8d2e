"""Derivatives of many recordings by unknowns of which most belong to one recording: its columns alone are kept.

A matrix of all samples and all unknowns would have as many zeros as there are recordings, squared
(:mod:`fracid.arrowhead`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray, zeros_together
from fracid.arrowhead import Arrowhead, Blocks
from fracid.errors import Failure, FailureReason
from fracid.tasks.job import in_threads


@dataclass(frozen=True, eq=False)
class BlockJacobian:
    """∂e/∂x without its zeros."""

    blocks: Blocks
    """Of the unknowns by which it derives."""
    parts: list[FloatArray]
    """Of each recording by :meth:`Blocks.columns`, shape (n_samples, n_outputs, n_columns)."""

    def of(self, which: NDArray[np.bool_]) -> BlockJacobian:
        """The columns of some of its unknowns."""
        kept = [part[..., which[self.blocks.columns(k)]] for k, part in enumerate(self.parts)]
        return BlockJacobian(self.blocks.of(which), kept)

    @property
    def norms(self) -> FloatArray:
        """Of the columns, shape (n_unknowns,)."""
        squares = np.zeros(len(self.blocks.recording))
        for k, part in enumerate(self.parts):
            squares[self.blocks.columns(k)] += np.sum(part**2, axis=(0, 1))
        return np.asarray(np.sqrt(squares))

    def solved(self, change: FloatArray) -> FloatArray:
        """What moves all samples by most of a change, next to nothing of what they do not see, shape (n_unknowns,)."""
        blocks, rows = self.blocks, np.split(change, self.blocks.rows[1:-1])
        parts = (np.column_stack([j.reshape(len(r), -1), -r]) for j, r in zip(self.parts, rows, strict=True))
        return Arrowhead.of(blocks, parts).step(np.maximum(1e-10 * self.norms, 1e-300))


def block_jacobian(
    errors: Callable[[FloatArray], list[FloatArray] | Failure],
    here: list[FloatArray],
    x: FloatArray,
    steps: FloatArray,
    blocks: Blocks,
    free: NDArray[np.intp],
    *,
    jobs: int = 1,
) -> BlockJacobian | Failure:
    """Central differences, one unknown of each recording at once; one-sided where a run fails.

    Parameters
    ----------
    errors : function (point) -> errors of each recording, shape (n_samples, n_outputs), or why there are none
    here : list of array
        Those at x.
    steps : array, shape (n_unknowns,)
        Of the differences.
    blocks : Blocks
        Of all unknowns.
    free : array of int
        By which to derive, in ascending order.
    jobs : int
        Threads.

    Examples
    --------
    >>> t = np.arange(3.0)[:, None]
    >>> def lines(x):
    ...     return [x[1] + x[0] * t, x[2] + x[0] * t]
    >>> blocks, x = Blocks(np.array([-1, 0, 1]), np.array([0, 3, 6])), np.zeros(3)
    >>> found = block_jacobian(lines, lines(x), x, np.full(3, 0.5), blocks, np.arange(3))
    >>> found.parts[1][:, 0].tolist()
    [[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]]
    """
    some = blocks.of(free)
    parts = zeros_together([(*e.shape, len(some.columns(k))) for k, e in enumerate(here)])

    def differentiate(group: NDArray[np.int64]) -> Failure | None:
        h = np.zeros(len(x))
        h[free[group]] = steps[free[group]]
        plus, minus = errors(x + h), errors(x - h)
        fails = [side for side in (plus, minus) if isinstance(side, Failure)]
        if fails and len(group) > 1:  # of one recording, as a rule
            halves: Sequence[NDArray[np.int64]] = np.array_split(group, 2)
            return next((why for half in halves if (why := differentiate(half)) is not None), None)
        if len(fails) == 2:
            return Failure(FailureReason.RUN, f"the runs on both sides of the minimum fail: {fails[0]}")
        high, low = (here if isinstance(side, Failure) else side for side in (plus, minus))
        for i in group:
            own = int(some.recording[i])
            for k in range(len(parts)) if own < 0 else (own,):
                column = parts[k].shape[-1] - len(some.shared) + some.place[i] if own < 0 else some.place[i]
                parts[k][..., column] = (high[k] - low[k]) / ((2 - len(fails)) * h[free[i]])
        return None

    reasons = [why for why in in_threads(jobs, differentiate, some.groups) if why]
    return reasons[0] if reasons else BlockJacobian(some, parts)
