r"""PID loops and their fractional kin, tuned on the simulation of the fitted model itself.

.. math::  u = -\Big(K_p + K_i s^{-λ} + K_d \frac{s^μ}{1 + T s}\Big) e

of one output, with orders 1 a PID.  Fractional operators are the sums of :mod:`fracid.export.state_space`, sampled with
e held.  At a limit the states are those of an e that would not have met it (Hanus' conditioning).

A PID minimises the mean of :math:`(y/\bar y)^2 + (u/\bar u)^2` over a simulation; a FOPID of each of
:data:`ORDERS` the same, with no more than the PID's effort (rms of u) and an open loop no nearer to −1 (the same
maximum sensitivity), which is what makes the two comparable.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution, minimize

from fracid.arrays import FloatArray
from fracid.export.state_space import positive_sum
from fracid.feedback.regulators import REDUCED, SLOWEST, held
from fracid.schemas.feedback import Controller

FILTER = 2.0
"""Time constant of the derivative's filter, in samples."""

RANGES = ((-1.0, 1.5), (-2.5, 1.5), (-2.5, 1.0))
"""Decades of the gains, about the whole input for the allowed deviation, over a second, and over a tenth of one."""

ORDERS = tuple(itertools.product((0.6, 0.8, 1.0), (0.7, 0.8, 0.9, 1.0)))
"""Of integral and derivative, that a FOPID is tried with."""

GENERATIONS, PEOPLE, TRIES = 12, 10, 80
"""Of the search for gains by differential evolution, and of that from there on by simplices."""


def pid(
    gains: tuple[float, float, float], orders: tuple[float, float], period: float, place: int, outputs: int,
    kind: str = "PID",
) -> Controller:  # fmt: skip
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
    return Controller(kind, weights, period, A.tolist(), B.tolist(), C.tolist(), D.tolist(), E.tolist())


def both(
    judge: Callable[[Controller, float, float], float], spent: Callable[[Controller], tuple[float, float]],
    scale: float, period: float, place: int, outputs: int, seed: int,
) -> list[Controller]:  # fmt: skip
    """A PID, and a FOPID of no more than its effort and no nearer to −1.

    Parameters
    ----------
    judge : function (controller, most effort, least distance from −1) -> float
        Less is better.
    spent : function (controller) -> (effort, distance)
    scale : float
        A gain of the right sign and size.
    period, place, outputs
        As of :func:`pid`.
    seed : int
    """

    def make(z: FloatArray, orders: tuple[float, float] = (1.0, 1.0), kind: str = "PID") -> Controller:
        first, second, third = (scale * 10**z * np.array([1.0, 1.0, 0.1])).tolist()
        return pid((first, second, third), orders, period, place, outputs, kind)

    def refined(z: FloatArray, bounds: tuple[float, float], *fractional: Any) -> Any:
        return minimize(lambda z: judge(make(z, *fractional), *bounds), z, method="Nelder-Mead",
                        options={"maxfev": TRIES})  # fmt: skip

    rough = differential_evolution(lambda z: judge(make(z), np.inf, 0.0), RANGES, maxiter=GENERATIONS, popsize=PEOPLE,
                                   rng=seed, polish=False)  # fmt: skip
    plain = refined(rough.x, (np.inf, 0.0)).x
    bounds = spent(make(plain))
    found = {orders: refined(plain, bounds, orders, "FOPID") for orders in ORDERS}
    best = min(ORDERS, key=lambda orders: found[orders].fun)
    return [make(plain), make(found[best].x, best, "FOPID")]
