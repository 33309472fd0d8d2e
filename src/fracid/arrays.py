"""The array types of fracid: 64-bit floats, and indices.  Shapes and units stand in the docstrings."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]
"""For indices."""


def zeros_together(shapes: Sequence[tuple[int, ...]]) -> list[FloatArray]:
    """Arrays of zeros in one piece of memory, which the system takes back whole; of hundreds it would keep the holes.

    Examples
    --------
    >>> [part.tolist() for part in zeros_together([(1, 2), (1,)])]
    [[[0.0, 0.0]], [0.0]]
    """
    sizes = [math.prod(shape) for shape in shapes]
    parts = np.split(np.zeros(sum(sizes)), np.cumsum(sizes)[:-1])
    return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
