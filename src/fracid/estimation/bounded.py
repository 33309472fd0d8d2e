r"""Least squares within bounds, and how far one unknown can go there: of a parabola, by its triangle.

With :math:`q(δ) = \tfrac12|Rδ + y|^2` the parabola of the cost and :math:`l ≤ δ ≤ u` what the bounds leave,
:func:`lowest` is its least point, and :func:`reach` the δ_i at which the least over all others has risen by a given
amount: the profile of the parabola.  Where no bound is on the way that is :math:`\sqrt{2\,rise\,(A^{-1})_{ii}}` from
the least point.  Where one is, it holds an unknown that would have gone on, so the profile is steeper beyond; and where
a bound stops the least point itself, the profile of the others begins beside it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.errors import SMALLEST

BLIND = 1e-7
"""Of a column's norm, the damping of a step: what R does not see stays."""


def lowest(R: FloatArray, y: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """The δ within the bounds at which ½|Rδ + y|² is least, shape (n,).

    Parameters
    ----------
    R : array, shape (m, n)
    y : array, shape (m,)
    low, high : array, shape (n,)
        low ≤ 0 ≤ high.

    Examples
    --------
    >>> R, y = np.array([[1.0, 1.0], [0.0, 0.1]]), np.array([-1.0, -0.2])
    >>> free, bound = np.full(2, np.inf), np.array([np.inf, 1.5])
    >>> lowest(R, y, -free, free).round(3), lowest(R, y, -free, bound).round(3)
    (array([-1.,  2.]), array([-0.5,  1.5]))
    """
    from scipy.optimize import lsq_linear

    if not R.shape[1]:
        return np.zeros(0)
    norms = np.linalg.norm(R, axis=0)
    norms[norms == 0] = 1.0
    damped = np.vstack([R / norms, BLIND * np.eye(len(norms))])
    aim = np.append(-y, np.zeros(len(norms)))
    low, high = low * norms, high * norms
    delta = np.linalg.lstsq(damped, aim, rcond=None)[0]
    if np.any((delta < low) | (delta > high)):
        delta = lsq_linear(damped, aim, (low, np.maximum(high, low + SMALLEST)), method="bvls").x
    return np.asarray(np.clip(delta, low, high) / norms)


def reach(
    R: FloatArray, y: FloatArray, low: FloatArray, high: FloatArray, i: int, side: int, rise: float
) -> tuple[float, NDArray[np.int_]]:
    """How far δ_i can go to one side until the least over the others has risen so much, and which are at a bound there.

    Those at their lower bound have −1, those at their upper one 1, the others 0.  Its own bound ends it, too.

    Parameters
    ----------
    R, y, low, high
        As of :func:`lowest`, whose point is δ = 0.
    i, side : int
        Which, and −1 or 1.
    rise : float
        Of ½|Rδ + y|², above 0.

    Examples
    --------
    >>> R, y = np.array([[1.0, 1.0], [0.0, 0.1]]), np.zeros(2)
    >>> free, bound = np.full(2, np.inf), np.array([np.inf, 1.5])
    >>> [reach(R, y, -free, above, 0, -1, 0.02) for above in (free, bound)]
    [(2.0099..., array([0, 0])), (1.6322..., array([0, 1]))]
    """
    from scipy.optimize import brentq

    others, base = np.arange(R.shape[1]) != i, 0.5 * float(y @ y)
    room, at = float(high[i] if side > 0 else -low[i]), np.zeros(len(low), dtype=int)

    def excess(distance: float) -> float:
        ahead = y + R[:, i] * (side * distance)
        delta = lowest(R[:, others], ahead, low[others], high[others])
        at[others] = (delta >= high[others]).astype(int) - (delta <= low[others])
        rest = ahead + R[:, others] @ delta
        rounded = 0.5 * float(rest @ rest) - base
        return (rounded if distance > 0 else 0.0) - rise  # beside columns that are nearly one, rounding may exceed it

    alone = np.linalg.lstsq(R[:, others], R[:, i], rcond=None)[0]
    steep = float(np.linalg.norm(R[:, i] - R[:, others] @ alone))  # 1/√(A⁻¹)_ii
    far = min(room, math.sqrt(2 * rise) / steep) if steep > 0 else room
    if not math.isfinite(far):
        return math.inf, at
    while far < room and excess(far) < -1e-6 * rise:  # the least point lies beyond a bound: it begins flatter
        far = min(room, 2 * far)
    if excess(far) > 1e-6 * rise:
        far = float(brentq(excess, 0.0, far, xtol=1e-4 * far))
        excess(far)
    at[i] = side * (far == room)
    return far, at
