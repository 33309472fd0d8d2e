"""The noise of a sampled signal."""

from __future__ import annotations

import math

import numpy as np

from fracid.arrays import FloatArray
from fracid.signals.resolution import resolution

__all__ = ["noise_level"]


def noise_level(y: FloatArray) -> float:
    """Of the samples: by third differences, and no less than the encoder's rounding [rad]."""
    q = resolution(y) or 0.0
    white = float(np.sqrt(np.mean(np.diff(y, 3) ** 2) / 20)) if y.size > 3 else 0.0
    return max(white, q / math.sqrt(12.0), 1e-9)
