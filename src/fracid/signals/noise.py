r"""The noise of a sampled signal, read off its third differences.

A motion that is slow beside the sampling is nearly a parabola over four samples and leaves no third difference; white
noise of variance σ² leaves one of variance 20 σ²: :math:`(y_{t+3} - 3 y_{t+2} + 3 y_{t+1} - y_t)` has the
coefficients 1, 3, 3, 1.  From some 40 samples a period on the motion counts for less than an encoder of 4096 counts.
"""

from __future__ import annotations

import math

import numpy as np

from fracid.arrays import FloatArray


def white_noise(signal: FloatArray) -> float:
    """Root mean square of the third differences over √20; NaN of less than four samples.

    Examples
    --------
    >>> t = np.arange(10_000) / 1000
    >>> round(white_noise(np.cos(7 * t) + 1e-3 * np.random.default_rng(1).standard_normal(t.size)), 5)
    0.001
    """
    return float(np.sqrt(np.mean(np.diff(signal, 3) ** 2) / 20)) if signal.size > 3 else math.nan


def noise_floor(signal: FloatArray) -> float:
    """The noise of most samples: of the median third difference, which neither a burst nor a glitch raises; 0 of few.

    Examples
    --------
    >>> noisy = 0.1 * np.random.default_rng(1).standard_normal(1000)
    >>> noisy[500:520] += 1000.0
    >>> round(noise_floor(noisy), 2)
    0.1
    """
    return float(np.median(np.abs(np.diff(signal, 3)))) / (0.6745 * math.sqrt(20)) if signal.size > 3 else 0.0
