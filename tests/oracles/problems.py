"""Fractional initial value problems with known solutions: all Caputo, from t = 0.

Closed forms, Mittag-Leffler functions or values agreed on by independent codes; T1 … M2 are the names
that the documentation uses too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import gamma, radians

import numpy as np


@dataclass(frozen=True)
class FractionalProblem:
    name: str
    rhs: Callable
    orders: tuple[float, ...]
    initial: tuple
    solution: dict[float, tuple[float, ...]]
    """Time [s] → the states that are known there, from the first on (NaN where one is not known)."""
    parameters: tuple[float, ...] = ()
    smooth: bool = True
    """Whether f(t, x(t)) is smooth enough for pi2 to show order 2 at the times given."""
    step: float = 1e-2
    """A step at which every method is in its asymptotic regime."""


def _t1(t, x, u, p, out):
    out[0] = -x[0]


T1 = FractionalProblem(
    "T1", _t1, (0.8,), (1.0,),
    {0.1: (0.84614678862631,), 1.0: (0.38694857861898,), 5.0: (0.087827430293285,), 10.0: (0.042979301317702,),
     20.0: (0.022381088674435,)},
    smooth=False,
)  # fmt: skip


def t2(a: float) -> FractionalProblem:
    """T2 of order a: y = t⁸ − 3t^(4+a/2) + 9/4 t^a on [0, 1]."""

    def rhs(t, x, u, p, out):
        a, g1, g2, g3 = p[0], p[1], p[2], p[3]
        polynomial = g1 * t ** (8 - a) - g2 * t ** (4 - a / 2) + g3
        out[0] = polynomial + (1.5 * t ** (a / 2) - t**4) ** 3 - max(x[0], 0.0) ** 1.5

    constants = (a, 40320 / gamma(9 - a), 3 * gamma(5 + a / 2) / gamma(5 - a / 2), 9 / 4 * gamma(a + 1))
    initial = (0.0,) if a <= 1 else ((0.0, 0.0),)
    y = {t: (t**8 - 3 * t ** (4 + a / 2) + 9 / 4 * t**a,) for t in (0.5, 1.0)}
    return FractionalProblem(f"T2(a={a})", rhs, (a,), initial, y, constants, smooth=False, step=1 / 64)


def t4(orders: tuple[float, ...]) -> FractionalProblem:
    """T4, y = t² for each of the orders, as one system."""

    def rhs(t, x, u, p, out):
        for i in range(len(out)):
            out[i] = t**2 - x[i] + p[2 * i + 1] * t ** (2 - p[2 * i])

    constants = tuple(v for q in orders for v in (q, 2 / gamma(3 - q)))
    initial = tuple(0.0 for _ in orders) if max(orders) <= 1 else tuple((0.0, 0.0) for _ in orders)
    return FractionalProblem(
        f"T4{orders}", rhs, orders, initial, {t: (t * t,) * len(orders) for t in (0.5, 1.0, 2.0)}, constants,
        step=1 / 64,
    )  # fmt: skip


def _t8(t, x, u, p, out):
    out[0] = 1 - x[0]


T8 = FractionalProblem(
    "T8", _t8, (1.8,), ((0.0, 0.0),),
    {1.0: (0.52577552929554,), 5.0: (0.90947621519843,), 20.0: (0.97793201545338,)},
)  # fmt: skip


def _t11(t, x, u, p, out):
    out[0] = -(1 + t**2) * x[0] ** 2 + t**0.6 / p[0] + (1 + t**2) * (1 + t) ** 2


T11 = FractionalProblem(
    "T11",
    _t11,
    (0.4,),
    (1.0,),
    {t: (1 + t,) for t in (0.5, 1.0)},
    (0.6 * gamma(0.6),),
    smooth=False,
    step=1 / 256,
)


def _t19(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -4 * x[0] - 0.1 * x[1]


T19 = FractionalProblem(
    "T19", _t19, (0.9, 0.9), (0.1, 0.0),
    {0.5: (0.041940168070165, -0.16404250791474), 1.0: (-0.037819972222254, -0.12991039483861),
     5.0: (-0.005572294030053, 0.020843094270105), 20.0: (-4.2278614564901e-6, -0.00067049045849035)},
    smooth=False,
)  # fmt: skip


def _t20(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -9.81 * np.sin(x[0]) - 0.2 * x[1]


T20 = FractionalProblem(
    "T20", _t20, (0.95, 0.95), (0.17, 0.0),
    {0.5: (-0.0089014732, -0.4696879324), 2.0: (0.0791286309, -0.0848312367),
     5.0: (-0.0187173753, 0.0566137257), 20.0: (-0.0000746726, -0.0004850744)},
    smooth=False, step=5e-3,
)  # fmt: skip


def _t27(t, x, u, p, out):
    a, b, c, d = p[0], p[1], p[2], p[3]
    out[0] = a * x[0] - b * x[0] * x[1]
    out[1] = d * x[0] * x[1] - c * x[1]


T27 = FractionalProblem(
    "T27", _t27, (0.98, 0.99), (34.0, 6.0),
    {5.0: (20.0354520515, 38.0800450917), 25.0: (23.7815462206, 32.3959567081)},
    (0.55, 0.028, 0.80, 0.024), smooth=False,
)  # fmt: skip


def _pendulum(t, x, u, p, out):
    """The RIP about hanging, written out independently of the package."""
    C1, C3, C4, C6, J, b_theta, b_alpha = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
    s, c = np.sin(x[2]), np.cos(x[2])
    M11, M12 = J + C6 * s * s, C3 * c
    r1 = -(b_theta + C6 * 2 * s * c * x[3]) * x[1] + C3 * s * x[3] ** 2
    r2 = C6 * s * c * x[1] ** 2 - b_alpha * x[3] - C4 * s
    det = M11 * C1 - M12**2
    out[0], out[1], out[2], out[3] = x[1], (C1 * r1 - M12 * r2) / det, x[3], (M11 * r2 - M12 * r1) / det


T33_CONSTANTS = {"C1": 2.2e-3, "C3": 1.6e-3, "C4": 0.127 * 9.81 * 0.15, "C6": 2.2e-3 - 2e-5, "J_theta": 4e-3 + 2e-5,
                 "b_theta": 1.5e-3, "b_alpha": 5e-4}  # fmt: skip

T33 = FractionalProblem(
    "T33", _pendulum, (0.8623, 0.8623, 0.9146, 0.9146), (0.0, 0.0, radians(10), 0.0),
    {0.5: (0.0295960364, 0.1391439455, 0.0544580951, -0.2948027320),
     1.0: (0.0376862579, 0.0646245110, 0.0122281877, -0.1706219213),
     5.0: (0.0116692623, -0.0036265521, -0.0000142704, -0.0035493244)},
    tuple(T33_CONSTANTS.values()), smooth=False, step=2e-3,
)  # fmt: skip


def m1(zeta: float) -> FractionalProblem:
    """M1: D^μ D^μ a + 2ζω D^μ a + ω² a = 0."""

    def rhs(t, x, u, p, out):
        out[0] = x[1]
        out[1] = -2 * p[0] * p[1] * x[1] - p[1] ** 2 * x[0]

    known = {0.0: (-0.3501724498601634, -0.03701016503163679, 0.009163960056799185),
             0.0417: (-0.2807209779040752, -0.00139412583135243, 0.0007808680566407067)}  # fmt: skip
    solution = dict(zip((0.25, 1.0, 3.0), ((v,) for v in known[zeta]), strict=True))
    return FractionalProblem(
        f"M1(ζ={zeta})", rhs, (0.9146, 0.9146), (1.0, 0.0), solution, (zeta, 6.73), smooth=False, step=5e-3
    )


def _m2(t, x, u, p, out):
    C1, C3, C4, C5, b = p[0], p[1], p[2], p[3], p[4]
    r1, r2 = -b * x[1], -b * x[3] - C4 * x[2]
    det = C5 * C1 - C3**2  # M12 = −C3: the angle α − π here, not π − α
    out[0], out[1], out[2], out[3] = x[1], (C1 * r1 + C3 * r2) / det, x[3], (C5 * r2 + C3 * r1) / det


M2 = FractionalProblem(
    "M2", _m2, (0.9146,) * 4, (0.0, 0.0, radians(10), 0.0),
    {t: (radians(theta), np.nan, radians(alpha))
     for t, theta, alpha in ((0.25, -6.29774, -5.31332), (0.5, -2.99532, 1.69933), (2.0, -2.73794, -0.07197))},
    (0.00427484, 0.00426644, 0.19385737, 0.01000255, 0.0024), smooth=False, step=1e-3,
)  # fmt: skip

PROBLEMS = (T1, t2(0.25), t2(0.9), t2(1.5), t4((0.5,)), t4((0.8, 0.7, 0.9)), t4((1.5, 1.2)), T8, T11, T19, T20, T27,
            T33, m1(0.0), m1(0.0417), M2)  # fmt: skip
