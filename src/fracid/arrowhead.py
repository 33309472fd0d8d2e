r"""Least squares with many blocks: unknowns that one recording alone has, and those that all share.

The rows of recording k depend on its own unknowns :math:`y_k` and on the shared ones z, on nothing else, so J is

.. math::  J = \begin{pmatrix} Y_1 & & & Z_1 \\ & Y_2 & & Z_2 \\ & & \ddots & \vdots \end{pmatrix},

and R of [J r] = QR has the same form, an arrowhead: one small QR a recording, and one of what they leave of the shared
columns.  A step costs as much as there are recordings, not as their cube [GP]_.  For the same reason the first unknown
of every recording can be moved at once: one simulation a recording gives as many columns as there are recordings
[CPR]_.

References
----------
.. [CPR] A. Curtis, M. Powell, J. Reid, J. Inst. Maths Applics 13 (1974) 117: columns that no row has in common.
.. [GP] G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413; G. Golub, R. Plemmons, Lin. Alg. Appl. 34 (1980) 3:
   block angular least squares.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray, IntArray
from fracid.errors import SMALLEST
from fracid.qr import triangle

UNSEEN = 1e-10
"""Of a column's norm, the damping of a step: what J does not see stays."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Which unknowns and which rows belong to which recording.

    Examples
    --------
    >>> blocks = Blocks(np.array([-1, 0, 0, 1, 1]), np.array([0, 10, 30]))
    >>> blocks.shared.tolist(), blocks.own.tolist(), [g.tolist() for g in blocks.groups]
    ([0], [[1, 2], [3, 4]], [[0], [1, 3], [2, 4]])
    """

    recording: IntArray
    """Of each unknown, −1 where all share it, shape (n_unknowns,)."""
    rows: IntArray
    """The first row of each recording, and the end of the last, shape (n_recordings + 1,)."""
    levels: int = 0
    """So many rows follow, one for each output: by what its rows are multiplied."""

    @cached_property
    def shared(self) -> IntArray:
        """The unknowns that all share."""
        return np.flatnonzero(self.recording < 0)

    @cached_property
    def own(self) -> IntArray:
        """Those of each recording, shape (n_recordings, most); −1 where it has fewer."""
        order = np.argsort(self.recording, kind="stable")[len(self.shared) :]
        counts = np.bincount(self.recording[order], minlength=len(self.rows) - 1)
        own = np.full((len(counts), int(counts.max(initial=0))), -1)
        own[np.arange(own.shape[1]) < counts[:, None]] = order
        return own

    @cached_property
    def groups(self) -> tuple[IntArray, ...]:
        """Unknowns that no row has in common: each shared one, and the first, second, … of every recording."""
        return (*self.shared[:, None], *(column[column >= 0] for column in self.own.T))

    def of(self, which: NDArray[np.integer[Any]] | NDArray[np.bool_]) -> Blocks:
        """Those of some of the unknowns."""
        return Blocks(self.recording[which], self.rows, self.levels)

    def columns(self, k: int) -> IntArray:
        """The unknowns that the rows of recording k depend on: its own, then the shared ones."""
        return np.concatenate([self.own[k][self.own[k] >= 0], self.shared])

    def cells(self, unknown: int) -> Iterator[tuple[int, int]]:
        """The recordings whose rows depend on an unknown, and its column there."""
        own = int(self.recording[unknown])
        for k in range(len(self.rows) - 1) if own < 0 else (own,):
            yield k, int(np.flatnonzero(self.columns(k) == unknown)[0])

    def level(self, rows: FloatArray, like: FloatArray) -> FloatArray:
        """Rows with the levels of others: those move with all recordings, and sum to nothing in J'r."""
        if not self.levels:
            return rows
        ratio, end = like[-self.levels :] / rows[-self.levels :], int(self.rows[-1])
        return np.concatenate([(rows[:end].reshape(-1, self.levels) * ratio).ravel(), like[end:]])


@dataclass(frozen=True, eq=False)
class Arrowhead:
    """R of [J r] = QR; a recording that has fewer unknowns than another has columns of zeros for them.

    Examples
    --------
    >>> blocks = Blocks(np.array([-1, 0, 1]), np.array([0, 9, 18]))
    >>> J = np.zeros((18, 3))
    >>> J[:, 0], J[:9, 1], J[9:, 2] = np.arange(18) ** 2, np.arange(9), np.arange(9)
    >>> r = np.sin(np.arange(18.0))
    >>> parts = [np.column_stack([J[rows][:, [own, 0]], r[rows]]) for rows, own in ((slice(9), 1), (slice(9, 18), 2))]
    >>> R = Arrowhead.of(blocks, parts)
    >>> bool(np.allclose(R.step(np.zeros(3)), -np.linalg.lstsq(J, r)[0])), bool(np.allclose(R.gradient, J.T @ r))
    (True, True)
    """

    blocks: Blocks
    own: FloatArray
    """Columns of each recording's own unknowns, shape (n_recordings, most, most)."""
    shared: FloatArray
    """In the same rows those of the shared ones, shape (n_recordings, most, n_shared)."""
    rhs: FloatArray
    """In the same rows r, shape (n_recordings, most)."""
    rest: FloatArray
    """R of what the recordings leave of the shared columns and r, shape (n_shared + 1, n_shared + 1)."""

    @classmethod
    def of(cls, blocks: Blocks, parts: Iterable[FloatArray]) -> Arrowhead:
        """From [Y Z r] of each recording, shape (n_rows, n_own + n_shared + 1)."""
        K, p, s = len(blocks.own), blocks.own.shape[1], len(blocks.shared)
        R, left = np.zeros((K, p, p + s + 1)), []
        for k, part in enumerate(parts):
            p_k = part.shape[1] - s - 1
            T = triangle([part])
            R[k, :p_k, :p_k], R[k, :p_k, p:] = T[:p_k, :p_k], T[:p_k, p_k:]
            left.append(T[p_k:, p_k:])
        rest = triangle([np.concatenate([np.zeros((1, s + 1)), *left])])
        return cls(blocks, R[..., :p], R[..., p : p + s], R[..., -1], rest=rest)

    @cached_property
    def gradient(self) -> FloatArray:
        """J'r, shape (n_unknowns,)."""
        own = np.einsum("kri,kr->ki", self.own, self.rhs)
        shared = np.einsum("kri,kr->i", self.shared, self.rhs) + self.rest[:, :-1].T @ self.rest[:, -1]
        return self._joined(own, np.asarray(shared))

    @cached_property
    def norms(self) -> FloatArray:
        """Of the columns of J, shape (n_unknowns,)."""
        own = np.sum(self.own**2, axis=1)
        shared = np.sum(self.shared**2, axis=(0, 1)) + np.sum(self.rest[:, :-1] ** 2, axis=0)
        return np.sqrt(self._joined(own, np.asarray(shared)))

    def square(self, step: FloatArray) -> float:
        """Give ‖J step‖²."""
        own, shared = self._apart(step)
        above = np.einsum("kri,ki->kr", self.own, own) + self.shared @ shared
        return float(np.sum(above**2) + np.sum((self.rest[:, :-1] @ shared) ** 2))

    def step(self, damping: FloatArray) -> FloatArray:
        """Minimise ‖J step + r‖² + ‖damping·step‖²; an infinite damping holds an unknown, shape (n_unknowns,)."""
        held = np.isinf(damping)
        held_own, held_shared = self._apart(held.astype(np.float64))
        d_own, d_shared = self._apart(np.where(held, 1.0, damping))
        K, p, s = self.shared.shape
        d_own[self.blocks.own < 0] = 1.0
        own, shared = self.own * (1 - held_own)[:, None], self.shared * (1 - held_shared)
        above = np.concatenate([own, shared, self.rhs[..., None]], 2)
        below = np.zeros((K, p, p + s + 1))
        below[:, np.arange(p), np.arange(p)] = d_own
        R = np.asarray(np.linalg.qr(np.concatenate([above, below], axis=1), mode="r"))
        rest = self.rest.copy()
        rest[:, :-1] *= 1 - held_shared
        last = np.column_stack([np.diag(d_shared), np.zeros(s)])
        T = triangle([np.concatenate([R[:, p:, p:].reshape(-1, s + 1), rest, last])])
        shared = -_solved(T[:-1, :-1], T[:-1, -1])
        own = -_solved(R[:, :p, :p], R[:, :p, -1] + R[:, :p, p:-1] @ shared)
        return self._joined(own, shared)

    def solution(self) -> FloatArray:
        """The step to the least ‖J step + r‖², that moves next to nothing of what J does not see."""
        return self.step(np.maximum(UNSEEN * self.norms, SMALLEST))

    def _apart(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Each recording's own entries of x, 0 where it has fewer, and the shared ones."""
        return np.where(self.blocks.own < 0, 0.0, x[self.blocks.own]), x[self.blocks.shared]

    def _joined(self, own: FloatArray, shared: FloatArray) -> FloatArray:
        x = np.empty(len(self.blocks.recording))
        x[self.blocks.shared] = shared
        x[self.blocks.own[self.blocks.own >= 0]] = own[self.blocks.own >= 0]
        return x


def _solved(R: FloatArray, y: FloatArray) -> FloatArray:
    """R⁻¹y, or the shortest of those that come nearest where R has none."""
    if R.shape[-1] == 0:
        return y[..., :0]
    diagonal = np.abs(np.diagonal(R, axis1=-2, axis2=-1))
    if np.all(diagonal > 1e-14 * diagonal.max(axis=-1, keepdims=True)):
        return np.asarray(np.linalg.solve(R, y[..., None])[..., 0])
    return np.asarray((np.linalg.pinv(R) @ y[..., None])[..., 0])
