"""The array types of fracid: 64-bit floats, and indices.  Shapes and units stand in the docstrings."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["FloatArray", "IntArray"]

FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]
"""For indices."""
