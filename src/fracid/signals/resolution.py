"""The resolution of a sampled signal: the step of its encoder."""

from __future__ import annotations

import numpy as np

from fracid.arrays import FloatArray

__all__ = ["resolution"]


def resolution(signal: FloatArray) -> float | None:
    """Return the spacing q of the lattice on which the values lie, None if they lie on none.

    Examples
    --------
    >>> resolution(np.array([0.0, 0.3, 0.5, 0.2, 0.1]))
    0.1
    >>> resolution(np.sqrt(np.arange(100.0))) is None
    True
    """
    values = np.unique(signal)
    spacings = np.diff(values)
    spacings = spacings[spacings > 1e-9 * max(abs(values[0]), abs(values[-1]))]  # one value, written in two ways
    if not spacings.size:
        return None
    q = float(np.mean(spacings[spacings < 1.5 * spacings.min()]))
    multiples = spacings[spacings < 20 * q] / q
    if not 1e-12 <= q <= 1e12 or np.mean(np.abs(multiples - np.round(multiples))) >= 0.1:
        return None
    return round(q, 12)
