"""Of the distributions behind a 95 % interval."""

from __future__ import annotations

import math

NORMAL_95 = 1.959963984540054
"""Half the width of a 95 % interval, in standard errors."""

CHI2_95 = {1: NORMAL_95**2, 2: -2 * math.log(0.05)}
"""95 % of χ², by its degrees of freedom: a rise of the cost that a profile calls too much."""


def normal_interval(value: float, error: float | None) -> tuple[float, float] | None:
    """The 95 % interval of a normal estimate with a standard error; None without one.

    Examples
    --------
    >>> [round(end, 2) for end in normal_interval(1.0, 0.5)], normal_interval(1.0, None)
    ([0.02, 1.98], None)
    """
    return None if error is None else (value - NORMAL_95 * error, value + NORMAL_95 * error)
