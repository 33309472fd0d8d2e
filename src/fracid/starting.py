r"""The second order of ``pi2`` where a solution begins like t^q: Lubich's starting corrections.

The solution of D^q x = f(t, x) begins as :math:`x_0 + f_0 t^q/Γ(q+1)`, so that f itself begins like
:math:`f_0 + c\,t^{σ}` with σ = q, or with any other sum of orders of the system.  Straight pieces between
the grid points miss the area under :math:`t^σ` for σ < 1, most of it in the first panels, and an error of
order 1 + σ stays for ever.  It can be taken out exactly, since the error that the product trapezoidal rule makes of
:math:`t^σ` is known (in units of the step, k and n being whole numbers):

.. math::  E_σ(n) = \frac{Γ(σ+1)}{Γ(σ+q+1)} n^{σ+q} - \sum_{k=1}^{n} b_{n-k}\, k^σ .

So, with the exponents :math:`σ_1 … σ_s < 1` of the system,

1. the first s steps are solved together, each with its corrections, by Newton's method;
2. from :math:`f_1 … f_s` follow the :math:`c_m` with :math:`f_k = f_0 + \sum_m c_m k^{σ_m}`;
3. every later step n adds :math:`h^q \sum_m c_m E_{σ_m}(n)` to what it knows, at no cost to speak of.

:math:`E_σ(n)` is summed up to n = 32.  Beyond, both ends of the sum are expanded by Euler's and Maclaurin's formula
with Riemann's ζ (Navot's form of it, for ends like :math:`k^σ`),

.. math::

    E_σ(n) ≈ -ζ(-σ)\frac{n^{q-1}}{Γ(q)} + ζ(-σ-1)\frac{n^{q-2}}{Γ(q-1)} - …
    - \frac{Γ(σ+1)}{12\,Γ(σ+q-1)} n^{σ+q-2} - …
    - \frac{ζ(-q-1)}{Γ(q+2)} σ(σ-1) n^{σ-2} + …,

the start's singularity, the rule's own second order, and its last panel.  These are evaluated at *knots*, 3 %
apart from n = 64 on, with parabolas between.

**Which exponents.**  Sums of the orders of all states, and the power with which f depends on t itself,
measured by :func:`_powers_of_time` (f = t^0.6 + …, or a smooth x under a fractional derivative, which makes
:math:`D^q x` begin like :math:`t^{1-q}`); of these the :data:`MOST` smallest below 1 that are :data:`APART`,
and 1, whose error is zero, where none is near it: a straight line must not be mistaken for powers.  Nothing is
corrected where the start is stiffer than the step can see, that is where h^q ∂f/∂x has a spectral radius above 1.

References
----------
.. [Lubich] C. Lubich, *Discretized fractional calculus*, SIAM J. Math. Anal. 17 (1986): starting weights.
.. [DFFW] K. Diethelm, J. M. Ford, N. J. Ford, M. Weilbeer, *Pitfalls in fast numerical solvers for
   fractional differential equations*, J. Comput. Appl. Math. 186 (2006): how ill-conditioned they get.
.. [Navot] I. Navot, *An extension of the Euler–Maclaurin summation formula to functions with a branch
   singularity*, J. Math. Phys. 40 (1961).
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from fracid.memory import _trapezoidal_weights as trapezoidal_weights

__all__ = ["errors_of_powers", "exponents", "gauss_jordan", "knots_up_to", "start_together"]

FloatArray = NDArray[np.float64]

APART, MOST = 0.09, 5
"""How far apart exponents must be, and how many are corrected at most: more would magnify what they do not fit."""

ITERATIONS, LARGE = 50, 120
"""Of Newton's method for the start, with a matrix up to so many unknowns; beyond, of fixed-point sweeps."""

SUMMED = 32
"""Up to here E_σ(n) is summed, beyond it is expanded."""

_helper = nb.njit(nogil=True, error_model="numpy")


@_helper
def exponents(orders: FloatArray, powers_of_time: FloatArray) -> FloatArray:
    """Give the exponents σ below 1 with which f begins, in ascending order, and 1 where none is near it."""
    found, generators = [0.0], [q for q in orders if q < 1.0]
    for power in powers_of_time:
        if 0.05 < power < 0.98:  # measured to 0.01
            generators.append(power)
    generators.sort()
    chosen, at = [0.0], 0
    while at < len(found):  # every sum of generators, by breadth: found grows as it is walked
        for g in generators:
            total = found[at] + g
            if total < 1.0 and len(found) < 200:
                new = True
                for other in found:
                    new = new and abs(total - other) > 1e-9
                if new:
                    found.append(total)
        at += 1
    found.sort()
    for total in found:
        if total - chosen[-1] > APART and len(chosen) <= MOST:
            chosen.append(total)
    if len(chosen) > 1 and chosen[-1] < 0.75:
        chosen.append(1.0)
    return np.array(chosen[1:])


@_helper
def knots_up_to(steps: int) -> NDArray[np.int64]:
    """Give the n at which the corrections are known: all up to 64, then 3 % apart, an odd number, beyond `steps`."""
    knots = [n for n in range(65)]
    while knots[-1] < steps or len(knots) % 2 == 0:
        knots.append(knots[-1] + max(1, knots[-1] // 32))
    return np.array(knots)


@_helper
def errors_of_powers(q: float, sigma: FloatArray, knots: NDArray[np.int64]) -> FloatArray:
    """E_σ(n) for an order q, the exponents σ and n at the knots, shape (n_exponents, n_knots)."""
    E = np.zeros((len(sigma), len(knots)))
    b, _ = trapezoidal_weights(q, SUMMED)
    for m in range(len(sigma)):
        s = sigma[m]
        if s == 1.0:
            continue
        powers = np.array([float(k) ** s for k in range(SUMMED + 1)])
        exact = math.gamma(s + 1) / math.gamma(s + q + 1)
        start, rule, last = _expansion(q, s)
        for j in range(1, len(knots)):
            n = knots[j]
            if n <= SUMMED:
                E[m, j] = exact * float(n) ** (s + q)
                for k in range(1, n + 1):
                    E[m, j] -= b[n - k] * powers[k]
            else:
                log, r = math.log(n), 1.0 / n
                E[m, j] = math.exp((q - 1) * log) * (start[0] + r * (start[1] + r * (start[2] + r * start[3])))
                E[m, j] += math.exp((s + q - 2) * log) * (rule[0] + r * r * (rule[1] + r * r * rule[2]))
                E[m, j] += math.exp((s - 2) * log) * (last[0] + r * (last[1] + r * (last[2] + r * last[3])))
    return E


@_helper
def _expansion(q: float, s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients of E_σ(n) for large n in powers of 1/n: the start's, the rule's own (1/n²), the last panel's."""
    z0, z1, z2, z3 = _zeta(-s), _zeta(-s - 1), _zeta(-s - 2), _zeta(-s - 3)
    start = np.array([-z0 * _inverse_gamma(q), z1 * _inverse_gamma(q - 1), -(z2 / 2 + z0 / 12) * _inverse_gamma(q - 2),
                      (z3 / 6 + z1 / 12) * _inverse_gamma(q - 3)])  # fmt: skip
    rule = -math.gamma(s + 1) * np.array([_inverse_gamma(s + q - 1) / 12, _inverse_gamma(s + q - 3) / 360,
                                          _inverse_gamma(s + q - 5) / 20160])  # fmt: skip
    z1, z2, z3, z4 = _zeta(-q - 1), _zeta(-q - 2), _zeta(-q - 3), _zeta(-q - 4)
    last = s * (s - 1) / math.gamma(q + 2) * np.array([
        -z1, z2 * (s - 2), -(z3 / 2 + z1 / 12) * (s - 2) * (s - 3),
        (z4 / 6 + z2 / 12) * (s - 2) * (s - 3) * (s - 4)])  # fmt: skip
    return start, rule, last


@_helper
def _inverse_gamma(x: float) -> float:
    """1/Γ(x), which is 0 at 0, −1, −2, …"""
    factor = 1.0
    while x < 0.5:
        factor, x = factor * x, x + 1
    inverse: float = factor / math.gamma(x)
    return inverse


@_helper
def _zeta(s: float) -> float:
    """Riemann's ζ(s) for s < 0, by Euler's and Maclaurin's formula from the 12th term on."""
    N = 12.0
    total: float = N ** (1 - s) / (s - 1) + N**-s / 2
    for k in range(1, 12):
        total += float(k) ** -s
    term = s * N ** (-s - 1) / 2
    for j, bernoulli in enumerate((1 / 6, -1 / 30, 1 / 42, -1 / 30, 5 / 66)):
        total += bernoulli * term
        term *= (s + 2 * j + 1) * (s + 2 * j + 2) / (N * N * (2 * j + 3) * (2 * j + 4))
    return total


# --- the start -------------------------------------------------------------------------------------


@_helper
def start_together(rhs, orders, past, slope, gain, u, p, t0, h, steps, limit, corrected):
    """Solve the first steps together, and give what corrects the later ones.

    Returns the states that are known then, (n, n_states), from the first sample of the past on, s, the knots, and
    :math:`\\sum_m c_m E_{σ_m}` of each state between them (:func:`_parabolas`); zeros where nothing is to be corrected.
    """
    m, states = len(past) - 1, len(slope)
    plain = past, 0, np.array([0, 1, 2**62]), np.zeros((1, states, 3))
    if not corrected:
        return plain
    sigma = exponents(orders, _powers_of_time(rhs, past[0], slope, u, p, t0, h))
    s = len(sigma)
    if s == 0 or steps < s:
        return plain
    knots = knots_up_to(steps + 8)
    fit = _fit_of_powers(sigma)
    E, M = np.zeros((states, s, len(knots))), np.zeros((states, s + 1, s + 1))
    for i in range(states):
        first = 0
        while orders[first] != orders[i]:
            first += 1
        E[i] = E[first] if first < i else errors_of_powers(orders[i], sigma, knots)
        M[i] = M[first] if first < i else _starting_weights(orders[i], E[i], fit)
    x, f = np.zeros((max(m, s) + 1, states)), np.zeros((s + 1, states))
    x[: m + 1], x[m + 1 :] = past, past[m]
    if not _solve_together(rhs, x, f, M, m, past[0], slope, gain, u, p, t0, h, limit):
        return plain
    C = np.zeros((states, len(knots)))
    for i in range(states):
        for e in range(s):
            c = 0.0
            for k in range(1, s + 1):
                c += fit[e, k - 1] * (f[k, i] - f[0, i])
            C[i] += c * E[i, e]
    return x, s, knots, _parabolas(knots, C)


@_helper
def _parabolas(knots, C):
    """Divided differences of C over knots 0, 1, 2, then 2, 3, 4, …: shape (n_pieces, n_states, 3)."""
    pieces = np.zeros((len(knots) // 2, len(C), 3))
    for i in range(len(C)):
        for r in range(len(knots) // 2):
            a, b, c = knots[2 * r], knots[2 * r + 1], knots[2 * r + 2]
            first, second = (C[i, 2 * r + 1] - C[i, 2 * r]) / (b - a), (C[i, 2 * r + 2] - C[i, 2 * r + 1]) / (c - b)
            pieces[r, i] = C[i, 2 * r], first, (second - first) / (c - a)
    return pieces


@_helper
def _powers_of_time(rhs, x0, slope, u, p, t0, h):
    """Measure the powers of t with which f(t, x_0 + t·slope) begins, one a state; 0 where it does not depend on t."""
    states, e = len(x0), 1e-6 * h
    powers, x, now = np.zeros(states), x0.copy(), u[0].copy()
    f = np.zeros((3, states))
    for k in range(3):
        for i in range(states):
            x[i] = x0[i] + slope[i] * (k * e)
        rhs(t0 + k * e, x, now, p, f[k])
    for i in range(states):
        once, twice = abs(f[1, i] - f[0, i]), abs(f[2, i] - f[0, i])
        if once > 1e-11 * abs(f[0, i]) and twice > once:
            powers[i] = math.log2(twice / once)
    return powers


@_helper
def _fit_of_powers(sigma):
    """Give the matrix that takes f_1 − f_0 … f_s − f_0 to c_1 … c_s with f_k − f_0 = Σ c_m k^σ_m."""
    s = len(sigma)
    W = np.zeros((s, 2 * s))
    for k in range(s):
        W[k, s + k] = 1.0
        for m in range(s):
            W[k, m] = (k + 1.0) ** sigma[m]
    gauss_jordan(W)
    return W[:, s:].copy()


@_helper
def _starting_weights(q, E, fit):
    """M with x_n = x_0 + h^q Σ_{k ≤ s} M_{nk} f_k for n ≤ s, exact for the powers; shape (s + 1, s + 1)."""
    s = len(fit)
    b, a = trapezoidal_weights(q, s)
    M = np.zeros((s + 1, s + 1))
    for n in range(1, s + 1):
        M[n, 0] = a[n]
        for k in range(1, s + 1):
            share = 0.0
            for e in range(s):
                share += E[e, n] * fit[e, k - 1]
            M[n, k] = share + (b[n - k] if k <= n else 0.0)
            M[n, 0] -= share
    return M


@_helper
def _solve_together(rhs, x, f, M, m, x0, slope, gain, u, p, t0, h, limit):
    """Solve for x_{m+1} … x_s and f_0 … f_s by Newton's method, with the matrix of the start; tell if it settles."""
    s, states = len(f) - 1, len(slope)
    now, A = u[0].copy(), _jacobian(rhs, x0, gain, u, p, t0)
    if not _spectral_radius(A) <= 1.0:
        return False
    size = s * states
    W, residual, base = np.zeros((size, 2 * size)), np.zeros(size), np.zeros(states)
    for n in range(1, s + 1):
        for i in range(states):
            row = (n - 1) * states + i
            W[row, row] = W[row, size + row] = 1.0
            for k in range(max(1, m + 1), s + 1 if n > m and size <= LARGE else 1):
                for c in range(states):
                    W[row, (k - 1) * states + c] -= M[i, n, k] * A[i, c]
    if size <= LARGE:
        gauss_jordan(W)
    for _ in range(ITERATIONS):
        for n in range(s + 1):
            if len(u) > 1:
                now[:] = u[n]
            rhs(t0 + n * h, x[n], now, p, f[n])
        moved = 0.0
        for n in range(m, s + 1):
            for i in range(states):
                total = slope[i] * (n * h)
                for k in range(s + 1):
                    total += gain[i] * M[i, n, k] * f[k, i]
                if n == m:
                    base[i] = x[m, i] - total  # x(0), but for what the model does not explain of the history
                else:
                    residual[(n - 1) * states + i] = base[i] + total - x[n, i]
        for n in range(m + 1, s + 1):
            for i in range(states):
                change = 0.0
                for c in range(size):
                    change += W[(n - 1) * states + i, size + c] * residual[c]
                x[n, i] += change
                moved = max(moved, abs(change) / (1e-3 + abs(x[n, i])))
                if not abs(x[n, i]) <= limit:
                    return False
        if moved < 1e-14:
            return True
    return moved < 1e-11


@_helper
def _jacobian(rhs, x0, gain, u, p, t0):
    """h^q ∂f/∂x at the start, by central differences."""
    states, x, now = len(x0), x0.copy(), u[0].copy()
    A, f = np.zeros((states, states)), np.zeros((2, states))
    for c in range(states):
        d = 1e-6 * (0.01 + abs(x0[c]))
        for side in range(2):
            x[c] = x0[c] + (d if side else -d)
            rhs(t0, x, now, p, f[side])
        x[c] = x0[c]
        for i in range(states):
            A[i, c] = gain[i] * (f[1, i] - f[0, i]) / (2 * d)
    return A


@_helper
def _spectral_radius(A):
    """Estimate it by the root of the norm of A^16, which no scaling of the states changes much."""
    radius, power = 0.0, A.copy()
    for _ in range(4):
        n, squared = len(A), np.zeros(A.shape)
        for i in range(n):
            for k in range(n):
                for c in range(n):
                    squared[i, c] += power[i, k] * power[k, c]
        power = squared
    for i in range(len(A)):
        radius = max(radius, np.abs(power[i]).sum())
    return radius ** (1 / 16)


@_helper
def gauss_jordan(W):
    """Turn [A | B] into [1 | A⁻¹B], with row pivots."""
    n, columns = W.shape
    for k in range(n):
        pivot = k + np.argmax(np.abs(W[k:, k]))
        for c in range(columns):
            W[k, c], W[pivot, c] = W[pivot, c], W[k, c]
        factor = 1 / W[k, k]
        for c in range(columns):
            W[k, c] *= factor
        for i in range(n):
            if i != k:
                factor = W[i, k]
                for c in range(columns):
                    W[i, c] -= factor * W[k, c]
