"""Exact derivatives to hold sensitivities against: of the Mittag-Leffler function, and of the recursions themselves.

Two kinds, independent of the package and of each other:

``mittag_leffler_slopes``   what a sensitivity converges to: E_q(−λ t^q) and its derivatives, in many digits
``gl``, ``pi2``             what a sensitivity of the discrete scheme is, at any step: the recursions in plain
                            NumPy, for complex orders, parameters and initial values.  Im(run(v + iε))/ε with
                            ε = 10⁻³⁰ is the derivative to rounding, since nothing is subtracted
                            (:func:`complex_step`).  The start is not corrected for its singularity.
"""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
from scipy.special import gamma

TINY = 1e-30


def complex_step(run: Callable, values, k: int):
    """∂ run / ∂ values[k], for a run that is analytic in values."""
    moved = np.array(values, dtype=complex)
    moved[k] += 1j * TINY
    return np.imag(run(moved)) / TINY


# --- the Mittag-Leffler function -------------------------------------------------------------------


def mittag_leffler_slopes(order, rate, t) -> tuple[mpmath.mpf, mpmath.mpf, mpmath.mpf]:
    """y = E_q(−λ t^q), ∂y/∂q and ∂y/∂λ, by the power series differentiated term by term.

    Its terms grow to about exp(|z|^(1/q)) before they fall, and that many digits are kept besides 20.
    """
    size = float(rate) ** (1 / float(order)) * float(t)
    with mpmath.workdps(30 + int(size)):
        q, rate, t = mpmath.mpf(order), mpmath.mpf(rate), mpmath.mpf(t)
        z, y, by_order, by_rate, k = -rate * t**q, mpmath.mpf(0), mpmath.mpf(0), mpmath.mpf(0), 0
        while True:
            term = z**k / mpmath.gamma(q * k + 1)
            y += term
            by_order += k * (mpmath.log(t) - mpmath.digamma(q * k + 1)) * term
            by_rate += k * term / rate
            k += 1
            if q * k > 2 * size + 5 and abs(term) < mpmath.mpf(10) ** -25:
                return +y, +by_order, +by_rate


# --- the recursions ----------------------------------------------------------------------------------


def _start(orders, initial, steps):
    """Orders, x(0) and its slopes as complex arrays, and room for the run."""
    x0 = np.array(initial, dtype=complex)
    x0, slope = (x0, np.zeros_like(x0)) if x0.ndim == 1 else x0.T
    q = np.broadcast_to(np.asarray(orders, dtype=complex), x0.shape)
    x = np.zeros((steps + 1, len(x0)), dtype=complex)
    x[0] = x0
    return q, x0, slope, x


def _f(rhs, t, x, parameters):
    out = np.zeros(len(x), dtype=complex)
    rhs(t, x, np.zeros(0), np.asarray(parameters), out)
    return out


def gl(rhs, orders, initial, parameters, step: float, steps: int, *, sequential: bool = False):
    """v^l = h^q f(x^{l−1}) − Σ_{k=1}^{l} w_k v^{l−k}, v = x − x(0) − t x'(0); shape (steps + 1, n_states).

    Sequential: the last state first, each f with the states already new.
    """
    q, x0, slope, x = _start(orders, initial, steps)
    w = np.ones((steps + 1, len(x0)), dtype=complex)
    for k in range(1, steps + 1):
        w[k] = w[k - 1] * (1 - (q + 1) / k)
    v = np.zeros_like(x)
    for n in range(1, steps + 1):
        now = x[n - 1].copy()
        for i in reversed(range(len(x0))) if sequential else [slice(None)]:
            f = _f(rhs, (n - 1) * step, now, parameters)
            v[n, i] = step ** q[i] * f[i] - np.sum(w[1 : n + 1, i] * v[n - 1 :: -1, i][:n], axis=0)
            now[i] = x0[i] + slope[i] * n * step + v[n, i]
        x[n] = now
    return x


def trapezoidal_weights(q, steps: int):
    """b_0 … b_steps and a_0 … a_steps of one order, where powers cancel by expm1 and log1p: to about k·10⁻¹⁶."""
    k = np.arange(2, steps + 1)
    up, down = np.expm1((q + 1) * np.log1p(1 / k)), np.expm1((q + 1) * np.log1p(-1 / k))
    b = np.concatenate([[1, 2 ** (q + 1) - 2], k ** (q + 1) * (up + down)])
    a = np.concatenate([[0, q], k**q * (k * down + 1 + q)])
    return b[: steps + 1] / gamma(q + 2), a[: steps + 1] / gamma(q + 2)


def pi2(rhs, orders, initial, parameters, step: float, steps: int):
    """x^l = x(0) + t x'(0) + h^q (Σ_{k=0}^{l−1} b_k f^{l−k} + a_l f^0), solved at each step to rounding."""
    q, x0, slope, x = _start(orders, initial, steps)
    b, a = (np.array(w).T for w in zip(*(trapezoidal_weights(order, steps) for order in q), strict=True))
    f = np.zeros_like(x)
    f[0] = _f(rhs, 0.0, x0, parameters)
    for n in range(1, steps + 1):
        t, own = n * step, step**q * b[0]
        known = x0 + slope * t + step**q * (np.sum(b[1:n] * f[n - 1 : 0 : -1], axis=0) + a[n] * f[0])
        x[n] = _newton(lambda y, t=t: _f(rhs, t, y, parameters), known, own, x[n - 1])
        f[n] = _f(rhs, t, x[n], parameters)
    return x


def _newton(f, known, own, x):
    """Solve x = known + own f(x).  The Jacobian is of differences: each round still gains six digits, Im too."""
    unit = 1e-7 * np.eye(len(x))
    for _ in range(8):
        here = f(x)
        J = np.array([(f(x.real + d) - f(x.real - d)).real / 2e-7 for d in unit]).T
        x = x + np.linalg.solve(np.eye(len(x)) - own.real[:, None] * J, known + own * here - x)
    return x
