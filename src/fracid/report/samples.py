r"""Samples that draw a line: few enough to be light, enough to look the same.

A line of a million samples is drawn by the least and the greatest of each of some hundred bins: on a screen it is the
same line.  Numbers are embedded as little-endian float32 in base64, some 5·10⁻⁸ of their size apart, a thousandth of
any encoder's step.
"""

from __future__ import annotations

import base64

import numpy as np

from fracid.arrays import FloatArray


def base64_floats(values: FloatArray, kind: str = "<f4") -> str:
    """Numbers as base64 of little-endian float32, or of another kind.

    Examples
    --------
    >>> base64_floats(np.array([0.0, 1.0]))
    'AAAAAAAAgD8='
    """
    return base64.b64encode(np.asarray(values, dtype=kind).tobytes()).decode()


def floats_of(text: str) -> FloatArray:
    """The numbers again.

    Examples
    --------
    >>> floats_of("AAAAAAAAgD8=")
    array([0., 1.])
    """
    return np.frombuffer(base64.b64decode(text), dtype="<f4").astype(float)
