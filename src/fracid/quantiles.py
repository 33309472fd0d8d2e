"""Of the distributions behind a 95 % interval."""

from __future__ import annotations

import math

NORMAL_95 = 1.959963984540054
"""Half the width of a 95 % interval, in standard errors."""

CHI2_95 = {1: NORMAL_95**2, 2: -2 * math.log(0.05)}
"""95 % of χ², by its degrees of freedom: a rise of the cost that a profile calls too much."""
