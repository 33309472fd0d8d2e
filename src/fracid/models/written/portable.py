"""Functions of Python that other languages lack or have otherwise: comparisons with NaN, signs of zero, remainders."""

from __future__ import annotations

import math

__all__ = ["choice", "floored", "greater", "lesser", "modulo", "signed", "signum"]


def lesser(a: float, b: float) -> float:
    """The lesser of two.

    Examples
    --------
    >>> lesser(2.0, 1.0)
    1.0
    """
    return b if b < a else a


def greater(a: float, b: float) -> float:
    """The greater of two.

    Examples
    --------
    >>> greater(2.0, 1.0)
    2.0
    """
    return b if b > a else a


def signum(v: float) -> float:
    """-1, 0 or 1.

    Examples
    --------
    >>> signum(-0.3)
    -1.0
    """
    return 1.0 if v > 0.0 else -1.0 if v < 0.0 else v


def signed(size: float, of: float) -> float:
    """A size with the sign of another number, where zero has one.

    Examples
    --------
    >>> signed(2.0, -1.0)
    -2.0
    """
    return -abs(size) if of < 0.0 or (of == 0.0 and 1.0 / of < 0.0) else abs(size)


def modulo(a: float, b: float) -> float:
    """The remainder with the sign of b, as Python's %.

    Examples
    --------
    >>> modulo(-1.0, 3.0)
    2.0
    """
    r = math.fmod(a, b)
    if r == 0.0:
        return math.copysign(0.0, b)
    return r + b if (r < 0.0) != (b < 0.0) else r


def floored(a: float, b: float) -> float:
    """The whole quotient, as Python's //.

    Examples
    --------
    >>> floored(-1.0, 3.0)
    -1.0
    """
    r = math.fmod(a, b)
    q = (a - r) / b
    if r != 0.0 and (r < 0.0) != (b < 0.0):
        q -= 1.0
    if q == 0.0:
        return math.copysign(0.0, a / b)
    whole = math.floor(q)
    return whole + 1.0 if q - whole > 0.5 else float(whole)


def choice(test: bool, yes: float, no: float) -> float:
    """One of two.

    Examples
    --------
    >>> choice(True, 1.0, 2.0)
    1.0
    """
    if test:
        return yes
    return no
