r"""The stepping schemes for D^q x = f(t, x, u, p), compiled.

Each state i has its own order q_i, step weight g_i = h^{q_i} and kernel (:mod:`fracid.memory`); f is a
function pointer, so the loops compile once for all right-hand sides and are cached on disk.  With
:math:`v^l = x^l - x^0` (for orders above 1: :math:`x^l - x^0 - t_l \dot x^0`) the schemes are

``gl-paper``       (21)–(24) to the letter, the sum over raw x, right only for x⁰ = 0:
                   :math:`x_i^l = g_i f_i(x^{l-1}) - \sum_{k=1}^{l} w_k x_i^{l-k}`
``gl``             explicit, on v:  :math:`v_i^l = g_i f_i(x^{l-1}) - \sum w_k v_i^{l-k}`
``gl-sequential``  the same, from the last state to the first, each using those already new (a velocity
                   before the angle that it drives): at order 1 the symplectic Euler scheme, which
                   manufactures no anti-damping
``pi2``            product trapezoidal rule on f, predictor from extrapolated f, then corrector sweeps:
                   :math:`x_i^l = x_i^0 + g_i\big(b_0 f_i^l + \sum_{k=1}^{l-1} b_k f_i^{l-k} + a_l f_i^0\big)`

The first three are of convergence order 1, ``pi2`` of order 2 where f(t, x(t)) is smooth.

The history of all four is one routine over a kernel's arrays: L exact lags against a sliding window of
past samples, plus the exponentials' running sums.  A run stops where a state leaves ±`limit` or f is no
longer finite, and returns the index of the last good sample.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
from numba import types
from numpy.typing import NDArray

from fracid.memory import Kernel

__all__ = ["RHS_SIGNATURE", "Kernels", "stack", "step_gl", "step_gl_sequential", "step_pi2"]

FloatArray = NDArray[np.float64]

COMPLETED, DIVERGED, NOT_FINITE = 0, 1, 2
"""How a run ended; :class:`fracid.simulate.Outcome` has the sentences."""


class Kernels(NamedTuple):
    """The kernels of all states, stacked for the compiled loops; row i belongs to state i."""

    weights: FloatArray
    """Exact weights w_L … w_1, reversed to meet the window from its oldest sample, (n_states, L_max)."""
    start: FloatArray
    """What weighs the first sample at lag k ≤ L, (n_states, L_max + 1)."""
    exponentials: FloatArray
    """z − 1, amplitude and the first sample's share of each exponential, (n_states, 3, M_max)."""
    own: FloatArray
    """b_0, the weight of the newest sample, and the slope of the linear part, (n_states, 2)."""
    sizes: NDArray[np.int64]
    """L and the number of exponentials, (n_states, 2)."""


def stack(kernels: list[Kernel]) -> Kernels:
    """Stack one kernel per state."""
    lags = [k.lags for k in kernels]
    modes = [-(-len(k.decay) // LANES) * LANES for k in kernels]
    weights, start = np.zeros((len(kernels), max(lags))), np.zeros((len(kernels), max(lags) + 1))
    exponentials = np.zeros((len(kernels), 3, max(1, *modes)))
    for i, k in enumerate(kernels):
        weights[i, : lags[i]] = k.weights[:0:-1]
        start[i, : lags[i] + 1] = k.start
        exponentials[i, :, : len(k.decay)] = k.decay, k.amplitude, k.start_ratio
        exponentials[i, 0, len(k.decay) :] = -1.0  # padding that forgets at once
    own = np.array([(k.weights[0], k.ramp) for k in kernels])
    return Kernels(weights, start, exponentials, own, np.array([*zip(lags, modes, strict=True)]))


LANES = 8
"""Exponentials are padded to a multiple of this, so that vector instructions leave no remainder."""

_vector, _matrix = types.float64[::1], types.float64[:, ::1]
_kernels = types.NamedTuple((_matrix, _matrix, types.float64[:, :, ::1], _matrix, types.int64[:, ::1]), Kernels)

RHS_SIGNATURE = types.void(types.float64, _vector, _vector, _vector, _vector)
"""rhs(t, x, u, p, out): the one signature of every right-hand side."""

_RUN = (
    types.FunctionType(RHS_SIGNATURE),
    _vector,  # x0, initial states
    _vector,  # slope, their first derivatives (0 where an order is at most 1)
    _vector,  # gain, h^q of each state
    _matrix,  # u, inputs on the grid: a row a step, or one row for all
    _vector,  # p, parameters
    types.float64,  # h
    types.float64,  # limit
    _kernels,
)
_ENDED = types.UniTuple(types.int64, 2)  # the last good step, and how the run ended

_fast = {"contract", "reassoc", "nsz"}  # lets sums be vectorised; NaN and inf keep their meaning


@nb.njit(fastmath=_fast, error_model="numpy", nogil=True)
def _history(n, head, window, sums, weights, start, exponentials, own, sizes, H):
    """H_i = Σ_{k=1}^{n} w_k v_i^{n−k} for each state i; window[i, head − k] is v_i^{n−k}."""
    for i in range(len(H)):
        L, modes = sizes[i, 0], sizes[i, 1]
        total = 0.0
        if n <= L:
            for k in range(1, n):
                total += weights[i, L - k] * window[i, head - k]
            H[i] = total + start[i, n] * window[i, head - n]
            continue
        w, recent = weights[i, :L], window[i, head - L : head]
        for k in range(L):
            total += w[k] * recent[k]
        leaving = window[i, head - L - 1]  # leaves the exact lags in this step, for the exponentials
        z, c, Y = exponentials[i, 0, :modes], exponentials[i, 1, :modes], sums[i, :modes]
        if own[i, 1] != 0.0:
            sums[i, modes] += Y[0]  # the linear part: every older sample's lag grows by one
            total += own[i, 1] * sums[i, modes]
        tail = 0.0
        for m in range(modes):
            y = Y[m] + (z[m] * Y[m] + leaving)
            Y[m] = y
            tail += c[m] * y
        H[i] = total + tail
        if n == L + 1:
            H[i] += _enter_start(leaving, exponentials[i], own[i, 1], sums[i], modes)


@nb.njit(nogil=True)
def _enter_start(first, exponentials, slope, sums, modes):
    """Correct the sums for the first sample, whose panel is only half a hat."""
    change = 0.0
    for m in range(modes):
        excess = (exponentials[2, m] - 1.0) * first if exponentials[1, m] != 0.0 else 0.0
        sums[m] += excess
        change += exponentials[1, m] * excess
    if slope != 0.0:
        sums[modes] = -first / 6  # the half-hat's own slope at s = 0
        change += slope * sums[modes]
    return change


@nb.njit(nogil=True)
def _nothing_yet(sizes, steps):
    """Give an empty window, which slides every 4096 steps (never where all is kept), and empty sums."""
    longest, states = sizes[:, 0].max(), len(sizes)
    width = min(steps, longest + max(4096, longest // 4)) + 2
    return np.zeros((states, width)), np.zeros((states, sizes[:, 1].max() + 1))


@nb.njit(nogil=True)
def _room(head, window, sizes):
    """Give the place of the next sample; where the window is full, its newest part moves to the front."""
    if head < window.shape[1]:
        return head
    keep = sizes[:, 0].max() + 1
    for i in range(len(window)):
        for k in range(keep):
            window[i, k] = window[i, head - keep + k]
    return keep


@nb.njit(nogil=True)
def _finite(f):
    """Tell whether all derivatives are finite."""
    for v in f:  # noqa: SIM110 (Numba compiles no generators)
        if not np.isfinite(v):
            return False
    return True


@nb.njit(nogil=True)
def _within(x, limit):
    """Tell whether all states are within ±limit."""
    for v in x:  # noqa: SIM110
        if not abs(v) <= limit:
            return False
    return True


@nb.njit(_ENDED(*_RUN, types.boolean, _matrix), cache=True, nogil=True, error_model="numpy")
def step_gl(rhs, x0, slope, gain, u, p, h, limit, kernels, raw, out):
    """``gl-paper`` (raw) and ``gl``: fill `out`, (steps + 1, n_states), from its second row on."""
    steps, states = len(out) - 1, len(x0)
    weights, start, exponentials, own, sizes = kernels
    (window, sums), head = _nothing_yet(sizes, steps), 1
    x, f, H = x0.copy(), np.zeros(states), np.zeros(states)
    if raw:
        window[:, 0] = x0
    for n in range(1, steps + 1):
        rhs((n - 1) * h, x, u[min(n - 1, len(u) - 1)], p, f)
        if not _finite(f):
            return n - 1, NOT_FINITE
        head = _room(head, window, sizes)
        _history(n, head, window, sums, weights, start, exponentials, own, sizes, H)
        for i in range(states):
            v = gain[i] * f[i] - H[i]
            window[i, head] = v
            x[i] = v if raw else x0[i] + slope[i] * (n * h) + v
        head += 1
        if not _within(x, limit):
            return n - 1, DIVERGED
        out[n] = x
    return steps, COMPLETED


@nb.njit(_ENDED(*_RUN, _matrix), cache=True, nogil=True, error_model="numpy")
def step_gl_sequential(rhs, x0, slope, gain, u, p, h, limit, kernels, out):
    """``gl-sequential``: the last state first, each derivative with the states already new."""
    steps, states = len(out) - 1, len(x0)
    weights, start, exponentials, own, sizes = kernels
    (window, sums), head = _nothing_yet(sizes, steps), 1
    x, f, H = x0.copy(), np.zeros(states), np.zeros(states)
    for n in range(1, steps + 1):
        head = _room(head, window, sizes)
        _history(n, head, window, sums, weights, start, exponentials, own, sizes, H)
        for i in range(states - 1, -1, -1):
            rhs((n - 1) * h, x, u[min(n - 1, len(u) - 1)], p, f)
            if not np.isfinite(f[i]):
                return n - 1, NOT_FINITE
            v = gain[i] * f[i] - H[i]
            window[i, head] = v
            x[i] = x0[i] + slope[i] * (n * h) + v
        head += 1
        if not _within(x, limit):
            return n - 1, DIVERGED
        out[n] = x
    return steps, COMPLETED


@nb.njit(_ENDED(*_RUN, types.int64, _matrix), cache=True, nogil=True, error_model="numpy")
def step_pi2(rhs, x0, slope, gain, u, p, h, limit, kernels, corrections, out):
    """``pi2``: predict f by extrapolation, then `corrections` sweeps; the last f goes into the history."""
    steps, states = len(out) - 1, len(x0)
    weights, start, exponentials, own, sizes = kernels
    (window, sums), head = _nothing_yet(sizes, steps), 1
    x, f, H = x0.copy(), np.zeros(states), np.zeros(states)
    before, known = np.zeros(states), np.zeros(states)
    rhs(0.0, x, u[0], p, f)
    if not _finite(f):
        return 0, NOT_FINITE
    for i in range(states):
        window[i, 0] = before[i] = f[i]
    for n in range(1, steps + 1):
        head = _room(head, window, sizes)
        _history(n, head, window, sums, weights, start, exponentials, own, sizes, H)
        for i in range(states):
            known[i] = x0[i] + slope[i] * (n * h) + gain[i] * H[i]
            extrapolated = 2 * f[i] - before[i]
            before[i] = f[i]
            x[i] = known[i] + gain[i] * own[i, 0] * extrapolated
        now = u[min(n, len(u) - 1)]
        sweeps = corrections if n > 1 else corrections + 4  # nothing to extrapolate from at the start
        for _ in range(sweeps):
            rhs(n * h, x, now, p, f)
            for i in range(states):
                x[i] = known[i] + gain[i] * own[i, 0] * f[i]
        if not _within(x, limit):
            return n - 1, DIVERGED if _finite(f) else NOT_FINITE
        rhs(n * h, x, now, p, f)
        if not _finite(f):
            return n - 1, NOT_FINITE
        for i in range(states):
            window[i, head] = f[i]
        head += 1
        out[n] = x
    return steps, COMPLETED
