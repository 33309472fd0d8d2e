r"""An extended Kalman filter for D^q x = f(x, u, p): one step, compiled.

An order is held as a sum of exponentials on fixed rates :math:`p_j = p_1 e^{jΔ}`, the trapezoidal rule in
:math:`\ln p` of

.. math::  \frac{t^{q-1}}{Γ(q)} = \frac{\sin πq}{π} \int_0^\infty p^{-q} e^{-pt}\,dp, \qquad
           x_i = \sum_j c_j(q_i)\,y_j, \qquad \dot y_j = -p_j y_j + f_i,

whose error falls like :math:`e^{-π^2/Δ}`.  All rates below :math:`p_1` are one that does not decay, all above the last
one that does at once, with the sums of their weights.  An order is in the weights c alone, so that it can be estimated
like a constant, with the second order of :math:`c(q)\,y` in mean and variance.  A state of order 1 that is known has
one mode.

Each step is linearly implicit (:math:`f` at its end from its Jacobian, and once more by Newton's method), so that dry
friction does not ask for a shorter one.  The transition :math:`F = \mathrm{diag}(z) + α\,U_0 + β\,U_1` is never
formed: with J of the few states, :math:`F P F^\top` costs some ten operations for each entry of P.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import types

from fracid.arrays import FloatArray, IntArray
from fracid.solver.compilation import INDICES, MATRIX, RHS, VECTOR, helper, when_called
from fracid.solver.schemes import gauss_jordan

NEAR = 1e-6
"""Steps of differences, of 10⁻² + the size."""

LOWEST, HIGHEST = 0.05, 1.95
"""Within which an order is estimated."""

FAR = 0.03
"""Step of second differences in an order."""


class Filter(NamedTuple):
    """All that a step reads and writes; N = modes + slow states."""

    z: FloatArray
    """What a mode keeps over a step, shape (n_modes,)."""
    a: FloatArray
    """What f at its beginning adds."""
    b: FloatArray
    """What f at its end adds."""
    begin: IntArray
    """Of each state its first mode, and the number of modes behind the last, shape (n_states + 1,)."""
    rates: FloatArray
    """p_1, Δ, the number of rates."""
    orders: FloatArray
    """Of each state, shape (n_states,)."""
    p: FloatArray
    """Constants, shape (n_parameters,)."""
    slow: FloatArray
    """Of each slow state whether it is an order, else which constant; its bounds; the variance of its walk in a step,
    shape (n_slow, 5)."""
    of: IntArray
    """Of each state which slow state its order is, -1 for none, shape (n_states,)."""
    drive: FloatArray
    """Spectral density of the unknown part of f of each state, shape (n_states,)."""
    xi: FloatArray
    """The estimate: modes, then slow states, shape (N,)."""
    P: FloatArray
    """Its covariance, shape (N, N)."""
    u: FloatArray
    """Inputs at the last step."""
    h: FloatArray
    """The step [s], shape (1,)."""


_fields = (*[VECTOR] * 3, INDICES, *[VECTOR] * 3, MATRIX, INDICES, *[VECTOR] * 2, MATRIX, *[VECTOR] * 2)
FILTER = types.NamedTuple(_fields, Filter)


@helper
def weights(q, rates, count, c, dc, first):
    """The weights of a state's modes for an order, and their slopes in it."""
    if count == 1:
        c[first], dc[first] = 1.0, 0.0
        return
    p1, spacing, n = rates[0], rates[1], int(rates[2])
    for side in range(2):
        order = q + side * NEAR
        sine = math.sin(math.pi * order) / math.pi
        low, into = 1.0 - order, dc if side else c
        slow = 1.0 if abs(low) < 1e-12 else sine * spacing / -math.expm1(-low * spacing)
        into[first] = 1.0
        into[first + 1] = slow * (p1 * math.exp(-spacing)) ** low
        for j in range(n):
            into[first + 2 + j] = sine * spacing * (p1 * math.exp(j * spacing)) ** low
        into[first + 2 + n] = sine * spacing * (p1 * math.exp(n * spacing)) ** -order / -math.expm1(-order * spacing)
    for j in range(first, first + count):
        dc[j] = (dc[j] - c[j]) / NEAR


@helper
def _states(F, c, xi, x):
    for i in range(len(x)):
        x[i] = 0.0
        for j in range(F.begin[i], F.begin[i + 1]):
            x[i] += c[j] * xi[j]


@helper
def bent(F, i, c, dc, above, below):
    """What the second order of c(q) · y adds to a state whose own order is not known: to its mean and its variance.

    With δ the error of the order and ε that of the modes it is δ c' · ε + δ² c'' · y / 2, of normal δ and ε.
    """
    s, first, behind = len(F.z) + F.of[i], F.begin[i], F.begin[i + 1]
    curved, along, spread = 0.0, 0.0, 0.0
    for j in range(first, behind):
        curved += (above[j] - 2 * c[j] + below[j]) / FAR**2 * F.xi[j] * F.P[s, s]
        along += dc[j] * F.P[j, s]
        inner = 0.0
        for k in range(first, behind):
            inner += F.P[j, k] * dc[k]
        spread += dc[j] * inner
    return along + curved / 2, along**2 + 2 * along * curved + curved**2 / 2 + F.P[s, s] * spread


@helper
def _bent(F, i, c, dc):
    if F.of[i] < 0:
        return 0.0, 0.0
    first, count = F.begin[i], F.begin[i + 1] - F.begin[i]
    above, below, unused = np.zeros(len(c)), np.zeros(len(c)), np.zeros(len(c))
    weights(F.orders[i] + FAR, F.rates, count, above, unused, first)
    weights(F.orders[i] - FAR, F.rates, count, below, unused, first)
    return bent(F, i, c, dc, above, below)


@helper
def _column(rhs, t, x, u, p, f, moved, k, d, J, c):
    """Put into column c of J how f changes with entry k of x or p, which is `moved` by d."""
    trial, kept = np.zeros(len(f)), moved[k]
    moved[k] = kept + d
    rhs(t, x, u, p, trial)
    moved[k] = kept
    for r in range(len(f)):
        J[r, c] = (trial[r] - f[r]) / d


@helper
def _jacobian(rhs, F, t, x, u, f, J, G):
    """∂f/∂x, and ∂f/∂θ for the slow states that are constants."""
    for i in range(len(x)):
        _column(rhs, t, x, u, F.p, f, x, i, NEAR * (1e-2 + abs(x[i])), J, i)
    for s in range(len(F.slow)):
        G[:, s] = 0.0
        if F.slow[s, 0] == 0.0:
            k = int(F.slow[s, 1])
            size = abs(F.p[k]) if F.p[k] != 0.0 else 1.0
            _column(rhs, t, x, u, F.p, f, F.p, k, NEAR * size, G, s)


@helper
def _add_product(A, B, into):
    """Add A B to a matrix; many entries of A are 0."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            if A[i, j] != 0.0:
                for k in range(B.shape[1]):
                    into[i, k] += A[i, j] * B[j, k]


@helper
def _solve(W, B):
    """B becomes A⁻¹ B, with A⁻¹ in the right half of W."""
    right = B.copy()
    B[:] = 0.0
    _add_product(W[:, len(B) :], right, B)


@helper
def _times(F, c, J, G, W, ca, w0, dx0, dx1, inside, out):
    """F · inside, by columns of `inside` taken as rows: out = (F insideᵀ)ᵀ for a symmetric matrix and its successor."""
    states, modes, slow, N = len(F.orders), len(F.z), len(F.slow), len(inside)
    U0, X1, U1 = np.zeros((states, N)), np.zeros((states, N)), np.zeros((states, N))
    X0 = np.zeros((states, N))
    for i in range(states):
        for j in range(F.begin[i], F.begin[i + 1]):
            cj, cz, row = c[j], c[j] * F.z[j], inside[j]
            for k in range(N):
                X0[i, k] += cj * row[k]
                X1[i, k] += cz * row[k]
        s = F.of[i]
        if s >= 0:
            for k in range(N):
                X0[i, k] += dx0[i] * inside[modes + s, k]
                X1[i, k] += dx1[i] * inside[modes + s, k]
    _add_product(J, X0, U0)
    _add_product(G, inside[modes:], U0)
    _add_product(G, inside[modes:], U1)
    for r in range(states):
        for k in range(N):
            X1[r, k] += ca[r] * U0[r, k] + w0[r] * U1[r, k]
    _solve(W, X1)
    _add_product(J, X1, U1)
    for i in range(states):
        for j in range(F.begin[i], F.begin[i + 1]):
            z, a, b, row, into = F.z[j], F.a[j], F.b[j], inside[j], out[j]
            for k in range(N):
                into[k] = z * row[k] + a * U0[i, k] + b * U1[i, k]
    for s in range(slow):
        for k in range(N):
            out[modes + s, k] = inside[modes + s, k]


@helper
def _drive(F, i, J, W, whole, x1):
    """Add what a step of the unknown part of f of state i adds to P: all other states feel it within the same step."""
    modes = np.zeros(len(F.z))
    x1[:] = 0.0
    x1[i, 0] = whole
    _solve(W, x1)
    for r in range(len(x1)):
        at_end = 1.0 if r == i else 0.0
        for k in range(len(x1)):
            at_end += J[r, k] * x1[k, 0]
        for j in range(F.begin[r], F.begin[r + 1]):
            modes[j] = F.b[j] * at_end + F.a[j] * (r == i)
    for j in range(len(modes)):
        share = F.drive[i] / F.h[0] * modes[j]
        for k in range(len(modes)):
            F.P[j, k] += share * modes[k]


@helper
def _predict(rhs, F, t, u, c, dc):
    states, modes = len(F.orders), len(F.z)
    h, xi, P = F.h[0], F.xi, F.P
    x0, x1, f0, f1 = np.zeros(states), np.zeros((states, 1)), np.zeros(states), np.zeros(states)
    J, G = np.zeros((states, states)), np.zeros((states, len(F.slow)))
    free, ca, w0 = np.zeros(states), np.zeros(states), np.zeros(states)
    dx0, dx1, W = np.zeros(states), np.zeros(states), np.zeros((states, 2 * states))
    _states(F, c, xi, x0)
    rhs(t, x0, u, F.p, f1)
    _jacobian(rhs, F, t, x0, u, f1, J, G)
    rhs(t, x0, F.u, F.p, f0)
    for i in range(states):
        for j in range(F.begin[i], F.begin[i + 1]):
            free[i] += c[j] * (F.z[j] * xi[j] + F.a[j] * f0[i])
            ca[i] += c[j] * F.a[j]
            w0[i] += c[j] * F.b[j]
            dx0[i] += dc[j] * xi[j]
    x = x0.copy()
    for i in range(states):
        for r in range(states):
            W[i, r], W[i, states + r] = (i == r) - w0[i] * J[i, r], i == r
    gauss_jordan(W, states)
    for _ in range(2):  # linearly implicit from x0, then Newton's method once
        for i in range(states):
            x1[i, 0] = free[i] + w0[i] * f1[i] - x[i]
        _solve(W, x1)
        for i in range(states):
            x[i] += x1[i, 0]
        rhs(t + h, x, u, F.p, f1)
    for i in range(states):
        for j in range(F.begin[i], F.begin[i + 1]):
            xi[j] = F.z[j] * xi[j] + F.a[j] * f0[i] + F.b[j] * f1[i]
            dx1[i] += dc[j] * xi[j]
    half = np.zeros(P.shape)
    _times(F, c, J, G, W, ca, w0, dx0, dx1, P, half)
    _times(F, c, J, G, W, ca, w0, dx0, dx1, np.ascontiguousarray(half.T), P)
    for i in range(states):
        if F.drive[i] > 0.0:
            _drive(F, i, J, W, ca[i] + w0[i], x1)
    for s in range(len(F.slow)):
        P[modes + s, modes + s] += F.slow[s, 4]


@helper
def _correct(outputs, F, t, u, c, dc, measured, variance, innovation):
    """One sensor after the other; returns Σ (innovation² / its variance) and Σ ln of the variances, and how many."""
    states, modes, N, sensors = len(F.orders), len(F.z), len(F.xi), len(measured)
    x, y = np.zeros(states), np.zeros(sensors)
    H, G = np.zeros((sensors, states)), np.zeros((sensors, len(F.slow)))
    before, row, gain, doubt = F.xi.copy(), np.zeros(N), np.zeros(N), np.zeros(states)
    _states(F, c, F.xi, x)
    for i in range(states):
        more, doubt[i] = _bent(F, i, c, dc)
        x[i] += more
    outputs(t, x, u, F.p, y)
    _jacobian(outputs, F, t, x, u, y, H, G)
    nis, logs, count = 0.0, 0.0, 0
    for m in range(sensors):
        innovation[m] = np.nan
        if not np.isfinite(measured[m]):
            continue
        row[:] = 0.0
        for s in range(len(F.slow)):
            row[modes + s] = G[m, s]
        expected, spread = y[m], variance[m]
        for i in range(states):
            if H[m, i] != 0.0:
                spread += H[m, i] ** 2 * doubt[i]
                for j in range(F.begin[i], F.begin[i + 1]):
                    row[j] += H[m, i] * c[j]
                    if F.of[i] >= 0:
                        row[modes + F.of[i]] += H[m, i] * dc[j] * before[j]
        gain[:] = 0.0
        for k in range(N):
            if row[k] != 0.0:
                for j in range(N):
                    gain[j] += row[k] * F.P[k, j]
        for k in range(N):
            expected += row[k] * (F.xi[k] - before[k])
            spread += row[k] * gain[k]
        innovation[m] = measured[m] - expected
        for j in range(N):
            share = gain[j] / spread
            F.xi[j] += share * innovation[m]
            for k in range(N):
                F.P[j, k] -= share * gain[k]
        nis += innovation[m] ** 2 / spread
        logs += math.log(spread)
        count += 1
    return nis, logs, count


@helper
def _refresh(F, c, dc):
    """Constants, orders and weights from the slow states."""
    modes = len(F.z)
    for s in range(len(F.slow)):
        value = min(max(F.xi[modes + s], F.slow[s, 2]), F.slow[s, 3])
        F.xi[modes + s] = value
        if F.slow[s, 0] == 0.0:
            F.p[int(F.slow[s, 1])] = value
    for i in range(len(F.orders)):
        if F.of[i] >= 0:
            F.orders[i] = F.xi[modes + F.of[i]]
        first = F.begin[i]
        weights(F.orders[i], F.rates, F.begin[i + 1] - first, c, dc, first)


@when_called(types.void(RHS, RHS, FILTER, types.int64, MATRIX, MATRIX, VECTOR, types.boolean, MATRIX))
def run_filter(rhs, outputs, F, first, measured, inputs, variance, held, out):
    """Step through samples: rows of `measured` (NaN where there is none), and of `inputs`.

    Row k is measured at the end of step `first` + k, and its inputs are those then; `held` ones last until the next.
    `out` takes a row a sample: states, slow states, their standard deviations, innovations, NIS, logs, count.
    """
    states, modes, slow, sensors = len(F.orders), len(F.z), len(F.slow), len(variance)
    c, dc, row = np.zeros(modes), np.zeros(modes), np.zeros(len(F.xi))
    x, innovation = np.zeros(states), np.zeros(sensors)
    _refresh(F, c, dc)
    for n in range(len(measured)):
        t, u = (first + n - 1) * F.h[0], inputs[n] if len(inputs) > 1 else inputs[0]
        if first + n > 0:
            _predict(rhs, F, t, F.u if held else u, c, dc)
        F.u[:] = u
        nis, logs, count = _correct(outputs, F, t + F.h[0], u, c, dc, measured[n], variance, innovation)
        _refresh(F, c, dc)
        _states(F, c, F.xi, x)
        width = states + slow
        for i in range(states):
            more, total = _bent(F, i, c, dc)
            out[n, i] = x[i] + more
            row[:] = 0.0
            for j in range(F.begin[i], F.begin[i + 1]):
                row[j] = c[j]
                if F.of[i] >= 0:
                    row[modes + F.of[i]] += dc[j] * F.xi[j]
            for j in range(len(row)):
                if row[j] != 0.0:
                    inner = 0.0
                    for k in range(len(row)):
                        inner += F.P[j, k] * row[k]
                    total += row[j] * inner
            out[n, width + i] = math.sqrt(max(total, 0.0))
        for s in range(slow):
            out[n, states + s] = F.xi[modes + s]
            out[n, width + states + s] = math.sqrt(max(F.P[modes + s, modes + s], 0.0))
        for m in range(sensors):
            out[n, 2 * width + m] = innovation[m]
        out[n, -3], out[n, -2], out[n, -1] = nis, logs, count
