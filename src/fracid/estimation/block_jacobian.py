"""Derivatives of many recordings by unknowns of which most belong to one recording: its columns alone are kept.

A matrix of all samples and all unknowns would have as many zeros as there are recordings, squared
(:mod:`fracid.arrowhead`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.arrowhead import Arrowhead, Blocks


@dataclass(frozen=True, eq=False)
class BlockJacobian:
    """∂e/∂x without its zeros."""

    blocks: Blocks
    """Of the unknowns by which it derives."""
    parts: list[FloatArray]
    """Of each recording by :meth:`Blocks.columns`, shape (n_samples, n_outputs, n_columns)."""
    errors: list[FloatArray]
    """e itself, of each recording, shape (n_samples, n_outputs)."""

    def of(self, which: NDArray[np.bool_]) -> BlockJacobian:
        """The columns of some of its unknowns."""
        kept = [part[..., which[self.blocks.columns(k)]] for k, part in enumerate(self.parts)]
        return BlockJacobian(self.blocks.of(which), kept, self.errors)

    def solved(self, change: FloatArray) -> FloatArray:
        """What moves all samples by most of a change, next to nothing of what they do not see, shape (n_unknowns,)."""
        rows = zip(self.parts, np.split(change, self.blocks.rows[1:-1]), strict=True)
        return Arrowhead.of(self.blocks, (np.column_stack([j.reshape(len(r), -1), -r]) for j, r in rows)).solution()
