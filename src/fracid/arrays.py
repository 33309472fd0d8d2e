"""The array type of fracid: 64-bit floats.  Shapes and units stand in the docstrings."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["FloatArray"]

FloatArray = NDArray[np.float64]
