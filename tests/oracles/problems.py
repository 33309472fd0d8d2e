"""Fractional initial value problems with known solutions: all Caputo, from t = 0.

Closed forms, Mittag-Leffler functions or values agreed on by independent codes; T1 … M2 are the names
that the documentation uses too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, gamma, radians

import numpy as np

from oracles.mittag_leffler import mittag_leffler


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


# --- solutions that are sums of powers ---------------------------------------------------------------

Powers = tuple[tuple[float, float], ...]
"""((c, r), …) for Σ c t^r."""


def caputo(powers: Powers, order: float) -> Powers:
    """D^q t^r = Γ(r+1)/Γ(r+1−q) t^(r−q); whole powers below ⌈q⌉ have none."""
    return tuple(
        (c * gamma(r + 1) / gamma(r + 1 - order), r - order)
        for c, r in powers
        if not (r == int(r) and r < ceil(order)) and c != 0
    )


def value(powers: Powers, t: float) -> float:
    return float(sum(c * t**r for c, r in powers))


def flat(powers: Powers) -> tuple[float, ...]:
    return tuple(v for pair in powers for v in pair)


# --- orders above 1, and a right-hand side that is not Lipschitz --------------------------------------


def _t6(t, x, u, p, out):
    out[0] = p[0] * t**4 + t**11 - x[0] ** 2


T6 = FractionalProblem(
    "T6", _t6, (1.5,), ((0.0, 0.0),), {t: (t**5.5,) for t in (0.5, 1.0)}, (gamma(6.5) / 24,), step=1 / 64
)


def _t14(t, x, u, p, out):
    product = max((x[1] - 0.5) * (x[2] - 0.3), 0.0)  # a step too low would leave the real numbers
    out[0] = (product ** (1 / 6) + np.sqrt(t)) / np.sqrt(np.pi)
    out[1] = p[0] * (x[0] - 1)
    out[2] = p[1] * (x[1] - 0.5)


T14 = FractionalProblem(
    "T14", _t14, (0.5, 0.2, 0.6), (1.0, 0.500000001, 0.300000001),
    {t: (1 + t, 0.5 + t**1.2, 0.3 + t**1.8) for t in (1.0, 5.0)}, (gamma(2.2), gamma(2.8) / gamma(2.2)),
    smooth=False, step=1 / 64,
)  # fmt: skip


# --- linear systems of one order: x(t) = V E_q(Λ t^q) V⁻¹ x(0) ------------------------------------------


def exact_linear(A, order: float, x0, t: float) -> tuple[float, ...]:
    """The matrix Mittag-Leffler function of a diagonalisable A, by its eigenvalues."""
    eigenvalues, V = np.linalg.eig(np.asarray(A, dtype=complex))
    start = np.linalg.solve(V, np.asarray(x0, dtype=complex))
    return tuple((V @ (mittag_leffler(order, eigenvalues * t**order) * start)).real.tolist())


def _linear(t, x, u, p, out):
    n = len(x)
    for i in range(n):
        out[i] = 0.0
        for j in range(n):
            out[i] += p[n * i + j] * x[j]


def linear(name: str, A, order: float, x0, times, step: float) -> FractionalProblem:
    """D^q x = A x, all states known."""
    return FractionalProblem(
        name, _linear, (order,) * len(x0), tuple(x0), {t: exact_linear(A, order, x0, t) for t in times},
        tuple(np.ravel(A).tolist()), smooth=False, step=step,
    )  # fmt: skip


SWIRL = ((-0.5, 2.0, 0.3), (-2.0, -0.5, 0.0), (0.4, 0.1, -1.0))
"""Two swinging states and a decaying one."""

LINEAR = (linear("linear(q=0.6)", SWIRL, 0.6, (1.0, 0.5, -1.0), (1.0, 5.0), 5e-3),
          linear("linear(q=0.95)", SWIRL, 0.95, (1.0, 0.5, -1.0), (1.0, 5.0), 5e-3),
          linear("linear(q=1.3)", ((-2.0, 0.5), (0.3, -1.0)), 1.3, (1.0, 0.5), (1.0, 5.0), 5e-3))  # fmt: skip


# --- stiff ones -------------------------------------------------------------------------------------------

CURVE: Powers = ((1.0, 0.0), (1.0, 2.0), (-1 / 3, 3.0))
"""1 + t² − t³/3, smooth and slow."""


def _t15(t, x, u, p, out):
    forcing = 0.0
    for k in range(2, len(p), 2):
        forcing += p[k] * t ** p[k + 1]
    curve = 1 + t**2 - t**3 / 3
    out[0] = -p[0] * (x[0] - curve) + forcing


def t15(order: float, stiffness: float, off: float = 0.0) -> FractionalProblem:
    """T15: D^q y = −L (y − g) + D^q g, g = 1 + t² − t³/3; y = g + (y(0) − 1) E_q(−L t^q)."""
    solution = {
        t: (value(CURVE, t) + off * mittag_leffler(order, -stiffness * t**order),) for t in (0.5, 1.0, 2.0)
    }  # fmt: skip
    name = f"T15(q={order}, L={stiffness:g}{', off the curve' if off else ''})"
    constants = (stiffness, 0.0, *flat(caputo(CURVE, order)))
    return FractionalProblem(name, _t15, (order,), (1.0 + off,), solution, constants, smooth=not off, step=1 / 64)


ROBINSON = ((-1e4, 1e3, 20.0), (5.0, -1e2, 10.0), (0.0, 0.5, -1.0))
"""Time constants from 10⁻⁴ to 1, far from normal."""

ROBINSON_CURVES: tuple[Powers, ...] = (CURVE, ((0.5, 0.0), (-0.4, 2.0)), ((-1.0, 0.0), (0.2, 3.0)))


def _robinson(t, x, u, p, out):
    g0, g1, g2 = 1 + t**2 - t**3 / 3, 0.5 - 0.4 * t**2, -1 + 0.2 * t**3
    d0, d1, d2 = x[0] - g0, x[1] - g1, x[2] - g2
    for i in range(3):
        out[i] = p[3 * i] * d0 + p[3 * i + 1] * d1 + p[3 * i + 2] * d2
    out[0] += p[9] * t ** p[10] + p[11] * t ** p[12]
    out[1] += p[13] * t ** p[14]
    out[2] += p[15] * t ** p[16]


def robinson(orders: tuple[float, float, float]) -> FractionalProblem:
    """Prothero and Robinson's with three states, each its order: D^q_i x_i = Σ A_ij (x_j − g_j) + D^q_i g_i."""
    forcing = tuple(v for g, q in zip(ROBINSON_CURVES, orders, strict=True) for v in flat(caputo(g, q)))
    solution = {t: tuple(value(g, t) for g in ROBINSON_CURVES) for t in (0.5, 1.0, 2.0)}
    start = tuple(value(g, 0.0) for g in ROBINSON_CURVES)
    constants = (*np.ravel(ROBINSON).tolist(), *forcing)
    return FractionalProblem(f"Prothero-Robinson{orders}", _robinson, orders, start, solution, constants, step=1 / 64)


def _stiff_matrix():
    """Eigenvalues −1, −100 and −10⁴ on skew directions."""
    V = np.array([[1.0, 0.5, 0.2], [-0.3, 1.0, 0.4], [0.6, -0.2, 1.0]])
    return V @ np.diag([-1.0, -1e2, -1e4]) @ np.linalg.inv(V)


STIFF = (t15(0.5, 1e4), t15(0.8, 1e2), t15(0.8, 1e4), t15(1.0, 1e4), t15(0.8, 1e4, off=1.0), robinson((0.7, 0.8, 0.9)),
         linear("stiff linear(q=0.8)", _stiff_matrix(), 0.8, (1.0, 1.0, 1.0), (0.5, 1.0, 2.0), 1 / 64))  # fmt: skip
"""Explicit schemes diverge on them unless h^q · 10⁴ is small; the error of an implicit one must not grow with L."""


# --- multi-term equations ------------------------------------------------------------------------------


@dataclass(frozen=True)
class MultiTermProblem:
    """D^{a_m} y = g(t, d, u, p), d = (D^{a_0} y, …, D^{a_{m-1}} y), with every derivative of the solution known."""

    name: str
    g: Callable
    orders: tuple[float, ...]
    initial: tuple[float, ...]
    exact: Callable[[float, float], float]
    """(a, t) → D^a y(t), for t > 0."""
    times: tuple[float, ...]
    parameters: tuple[float, ...] = ()
    coefficients: dict[float, float] | None = None
    """Of a linear one: Σ c_k D^{a_k} y = f."""
    forcing: tuple[float, ...] = ()
    """f as c, r, c, r, … of Σ c t^r."""


def sum_of_powers(t, u, p):
    """f(t, u, p), p = c, r, c, r, …"""
    total = 0.0
    for k in range(0, len(p), 2):
        total += p[k] * t ** p[k + 1]
    return total


def _linear_g(t, d, u, p):
    """(f − Σ c_k d_k)/c_m, p = c_0, …, c_m, then f as c, r, …"""
    m = len(d)
    total = 0.0
    for k in range(m + 1, len(p), 2):
        total += p[k] * t ** p[k + 1]
    for k in range(m):
        total -= p[k] * d[k]
    return total / p[m]


def _linear_problem(name, coefficients, forcing, initial, exact, times) -> MultiTermProblem:
    by_order = dict(sorted(coefficients.items()))
    return MultiTermProblem(
        name, _linear_g, tuple(by_order), initial, exact, times, (*by_order.values(), *flat(forcing)), by_order,
        flat(forcing),
    )  # fmt: skip


def manufactured(name: str, coefficients: dict[float, float], y: Powers, times=(0.5, 1.0, 2.0)) -> MultiTermProblem:
    """Σ c_k D^{a_k} y = f, with f made for the solution y, a sum of powers."""
    forcing = tuple((c * b, r) for a, c in coefficients.items() for b, r in caputo(y, a))
    initial = tuple(value(caputo(y, k), 0.0) for k in range(ceil(max(coefficients))))
    return _linear_problem(name, coefficients, forcing, initial, lambda a, t: value(caputo(y, a), t), times)


def free(name: str, coefficients: dict[float, float], unit: float, initial: tuple[float, ...], times):
    """Σ c_k D^{a_k} y = 0 with all orders multiples of a unit q ≤ 1 that divides 1: D^q x = A x, A a companion matrix.

    State k is D^{kq} y, so all steps from one to the next compose, and the exact solution follows.
    """
    size = round(max(coefficients) / unit)
    A, x0 = np.diag(np.ones(size - 1), 1), np.zeros(size)
    for a, c in coefficients.items():
        if round(a / unit) < size:
            A[-1, round(a / unit)] = -c / coefficients[max(coefficients)]
    x0[:: round(1 / unit)] = initial

    def exact(a: float, t: float) -> float:
        return exact_linear(A, unit, x0, t)[round(a / unit)]

    return _linear_problem(name, coefficients, (), initial, exact, times)


def _hardening(t, d, u, p):
    """Stiffer the further out, with damping that depends on y: D^2.3 y = f − 0.5 y D^1.4 y − y³."""
    y, slope = 1 + t**2 / 2, p[0] * t**0.6
    return 0.5 * y * slope + y**3 - 0.5 * d[0] * d[1] - d[0] ** 3


_HARDENING: Powers = ((1.0, 0.0), (0.5, 2.0))

T18 = manufactured("T18: Bagley and Torvik", {2: 1.0, 1.5: 1.0, 0: 1.0}, ((1.0, 0.0), (1.0, 1.0)))

MULTI_TERM = (
    T18,
    manufactured("plate, y = 1 + t + t^2", {2: 1.0, 1.5: 0.5, 0: 2.0}, ((1.0, 0.0), (1.0, 1.0), (1.0, 2.0))),
    free("free plate, damping 1", {2: 1.0, 1.5: 1.0, 0: 1.0}, 0.5, (1.0, 0.5), (1.0, 4.0)),
    free("free plate, damping 0.05", {2: 1.0, 1.5: 0.05, 0: 4.0}, 0.5, (1.0, 0.0), (1.0, 4.0)),
    free("free plate, damping 100", {2: 1.0, 1.5: 100.0, 0: 1.0}, 0.5, (1.0, 0.0), (1.0, 4.0)),
    manufactured("Basset, y = 1 + t^2", {1: 1.0, 0.5: 1.0, 0: 1.0}, ((1.0, 0.0), (1.0, 2.0))),
    free("free Basset", {1: 1.0, 0.5: 1.0, 0: 1.0}, 0.5, (1.0,), (1.0, 4.0)),
    manufactured("relaxation and oscillation", {1.8: 1.0, 0.6: 0.4, 0: 2.0}, ((1.0, 0.0), (-1.0, 1.0), (0.5, 3.0))),
    manufactured("order 2.5 without y", {2.5: 2.0, 1.2: 1.0}, ((1.0, 0.0), (0.5, 1.0), (-1.0, 2.0), (0.3, 3.5))),
    manufactured("order 4", {4: 1.0, 3.3: 0.5, 0.4: 1.0, 0: 1.0}, ((1.0, 0.0), (1.0, 3.0), (0.1, 5.0))),
    free("thirds", {4 / 3: 1.0, 2 / 3: 1.0, 0: 1.0}, 1 / 3, (1.0, 0.5), (1.0, 4.0)),
    MultiTermProblem("hardening spring", _hardening, (0, 1.4, 2.3), (1.0, 0.0, 1.0),
                     lambda a, t: value(caputo(_HARDENING, a), t), (0.5, 1.0, 2.0), flat(caputo(_HARDENING, 1.4))),
)  # fmt: skip
"""Linear ones, forced and free, and one that is not."""
