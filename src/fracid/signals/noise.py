r"""The noise of a sampled signal, read off its third differences.

A motion that is slow beside the sampling is nearly a parabola over four samples and leaves no third difference; white
noise of variance σ² leaves one of variance 20 σ²: :math:`(y_{t+3} - 3 y_{t+2} + 3 y_{t+1} - y_t)` has the
coefficients 1, 3, 3, 1.  From some 40 samples a period on the motion counts for less than an encoder of 4096 counts.
"""

from __future__ import annotations

import math

import numpy as np

from fracid.arrays import FloatArray
from fracid.signals.resolution import resolution

__all__ = ["noise_level", "white_noise"]


def white_noise(signal: FloatArray) -> float:
    """Root mean square of the third differences over √20; NaN of less than four samples.

    Examples
    --------
    >>> t = np.arange(10_000) / 1000
    >>> round(white_noise(np.cos(7 * t) + 1e-3 * np.random.default_rng(1).standard_normal(t.size)), 5)
    0.001
    """
    return float(np.sqrt(np.mean(np.diff(signal, 3) ** 2) / 20)) if signal.size > 3 else math.nan


def noise_level(signal: FloatArray, step: float | None = None) -> float:
    """The noise, but no less than the encoder's rounding q/√12 and 10⁻⁹.

    Parameters
    ----------
    signal : array, shape (n_samples,)
    step : float, optional
        The encoder's q; as :func:`~fracid.signals.resolution.resolution` has it, if left out.

    Examples
    --------
    >>> round(noise_level(np.round(np.cos(np.arange(5000) / 800), 2)) * math.sqrt(12), 3)
    0.01
    """
    q = (resolution(signal) or 0.0) if step is None else step
    white = white_noise(signal)
    return max(0.0 if math.isnan(white) else white, q / math.sqrt(12.0), 1e-9)
