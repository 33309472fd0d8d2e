r"""PID loops and their fractional kin.

.. math::  u = -\Big(K_p + K_i s^{-λ} + K_d \frac{s^μ}{1 + T s}\Big) e

of one output, with orders 1 a PID.  Fractional operators are the sums of :mod:`fracid.export.state_space`, sampled with
e held.  At a limit the states are those of an e that would not have met it (Hanus' conditioning).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fracid.export.state_space import positive_sum
from fracid.feedback.regulators import REDUCED, SLOWEST, held
from fracid.schemas.feedback import Controller

FILTER = 2.0
"""Time constant of the derivative's filter, in samples."""


def pid(
    gains: Sequence[float], orders: Sequence[float], period: float, place: int, outputs: int, kind: str = "PID"
) -> Controller:
    """A controller of one of some outputs.

    Examples
    --------
    >>> found = pid((2.0, 0.5, 0.1), (1.0, 1.0), 0.01, 0, 1)
    >>> found.response(np.array([1e-3]))[0, 0].round(1).tolist()  # as -0.5/s at low frequencies
    (-2+500j)
    """
    proportional, integral, derivative = gains
    band, T = (SLOWEST * np.pi / period, np.pi / period), FILTER * period
    slope = -np.expm1(-period / T) / period  # 1/T, but such that a held e has the slope that it is a sample of
    whole = positive_sum(orders[0], band, REDUCED)
    part = positive_sum(1 - orders[1], band, REDUCED) if orders[1] < 1 else None
    n, m = len(whole.poles), 0 if part is None else len(part.poles)
    F, G = np.zeros((1 + n + m, 1 + n + m)), np.zeros((1 + n + m, 1))
    F[0, 0], G[0] = -1 / T, 1 / T  # the filter; the derivative is what drives it
    F[1 : 1 + n, 1 : 1 + n], G[1 : 1 + n] = np.diag(-whole.poles), 1.0
    H, straight = np.zeros(1 + n + m), proportional
    H[1 : 1 + n] = integral * whole.residues
    if part is None:
        H[0], straight = -derivative * slope, proportional + derivative * slope
    else:
        F[1 + n :, 0], G[1 + n :] = -1 / T, 1 / T
        F[1 + n :, 1 + n :], H[1 + n :] = np.diag(-part.poles), derivative * part.residues
    kept, added = held(F, G, period)
    B, C, D, E = np.zeros((len(F), outputs)), -H[None], np.zeros((1, outputs)), -added / straight
    A, D[0, place] = kept - E @ C, -straight
    weights = {"Kp": proportional, "Ki": integral, "Kd": derivative}
    weights |= {"lambda": orders[0], "mu": orders[1]} if kind == "FOPID" else {}
    return Controller(kind, weights, period, A.tolist(), B=B.tolist(), C=C.tolist(), D=D.tolist(), E=E.tolist())
