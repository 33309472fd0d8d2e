r"""Samples that draw a line: few enough to be light, enough to look the same.

A line of a million samples is drawn by the least and the greatest of each of some hundred bins: on a screen it is the
same line.  Numbers are embedded as little-endian float32 in base64, some 5·10⁻⁸ of their size apart, a thousandth of
any encoder's step.
"""

from __future__ import annotations

import base64
from math import inf

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray


def base64_floats(values: FloatArray) -> str:
    """Numbers as base64 of little-endian float32.

    Examples
    --------
    >>> base64_floats(np.array([0.0, 1.0]))
    'AAAAAAAAgD8='
    """
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()


def floats_of(text: str) -> FloatArray:
    """The numbers again.

    Examples
    --------
    >>> floats_of("AAAAAAAAgD8=")
    array([0., 1.])
    """
    return np.frombuffer(base64.b64decode(text), dtype="<f4").astype(float)


def extremes(signals: list[FloatArray], points: int) -> NDArray[np.intp]:
    """Indices of at most that many samples (and two) that draw the same lines.

    Parameters
    ----------
    signals : list of arrays, each of shape (n,)
        On one time base; what is not finite is passed over.
    points : int

    Returns
    -------
    array of int, shape (m,)
        Rising; all of them where there are few.

    Examples
    --------
    >>> t = np.arange(100.0)
    >>> extremes([np.sin(t / 100), np.where(t == 37, 9.0, 0.0)], 12).tolist()
    [0, 33, 34, 37, 67, 68, 99]
    """
    n = signals[0].size
    if n <= points:
        return np.arange(n)
    size = -(-n * 2 * len(signals) // points)
    parts = [np.array([0, n - 1])]
    for y in signals:
        padded = np.append(y, np.full(-n % size, np.nan)).reshape(-1, size)
        mask = np.isfinite(padded)
        at = size * np.arange(len(padded))
        parts += [at + np.where(mask, padded, inf).argmin(axis=1), at + np.where(mask, padded, -inf).argmax(axis=1)]
    indices = np.unique(np.concatenate(parts))
    return indices[indices < n]
