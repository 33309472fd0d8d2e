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

                   A step at which the sweeps contract slowly is solved by Newton's method: dry friction,
                   tanh(v/v_s), is steep, and fixed sweeps would diverge beyond h·|∂f/∂x| = 2

The first three are of convergence order 1, ``pi2`` of order 2 where f(t, x(t)) is smooth.

**The history** :math:`H_n = \sum_{k=1}^n w_k v_{n-k}` of all four is one routine, eight steps at a time, eight
numbers to a vector register.  Before step n = 1, 9, 17, … :func:`_history` computes what the samples known by
then add to H of the steps n … n + 7 (``ahead``): the last L of them through their weights, all older ones
through the sums :math:`Y_m = \sum_s z_m^{n-L-1-s} v_s`.  Each new sample adds its share to the rest of its
block (:func:`_enter`).  So every table entry that is loaded serves eight steps, and nothing is summed
across a register.  Where a state leaves ±`limit` or f is no longer finite a run stops, and returns the index
of the last good sample.
"""

# ruff: noqa: ARG001, ARG005 (an intrinsic names its arguments for its callers, and gets types and values apart)

from __future__ import annotations

from typing import Any, NamedTuple

import numba as nb
import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core.datamodel import models
from numba.extending import intrinsic, register_jitable, register_model
from numba.np.arrayobj import make_array
from numpy.typing import NDArray

from fracid.memory import Kernel

__all__ = ["RHS_SIGNATURE", "Kernels", "stack", "step_gl", "step_gl_sequential", "step_pi2"]

FloatArray = NDArray[np.float64]

COMPLETED, DIVERGED, NOT_FINITE = 0, 1, 2
"""How a run ended; :class:`fracid.simulate.Outcome` has the sentences."""

BLOCK = 8
"""Steps whose history is computed at once: as many float64 as the widest vector registers hold."""


class Kernels(NamedTuple):
    """The kernels of a run for the compiled loops, a row for each that differs.

    One table holds all, since every array more is a pointer more that the loops have to keep: the columns

    ======== ======= =============================================================================
    from     columns hold
    ======== ======= =============================================================================
    0        L + 16  w_k in column 7 + k for 1 ≤ k < L + 8, and zeros before
    start    L + 16  the same for the first sample
    forget   M       z⁸ − 1 of each exponential: what its sum loses in eight steps
    enter    M       what the first sample adds to each sum
    collect  8 M     z⁷ of all, then z⁶, … z⁰: what eight samples, the oldest first, add to each sum
    foresee  8 M     c, c z, … c z⁷ of each: what its sum adds to H of eight steps
    ======== ======= =============================================================================
    """

    table: FloatArray
    """The six above, (rows, 2 (L + 16) + 18 M)."""
    lags: int
    """L of the columns, the most that a row has."""
    modes: int
    """M of the columns."""
    of: NDArray[np.int64]
    """The row of each state, (n_states,)."""
    sizes: NDArray[np.int64]
    """L and M of each row, multiples of 8, (rows, 2)."""
    own: FloatArray
    """w_0, the weight of the newest sample, and 8 where the weights have a linear part, (rows, 2)."""


def stack(kernels: list[Kernel]) -> Kernels:
    """Make the table for one kernel per state; states that share a kernel share its row."""
    rows = list({id(k): k for k in kernels}.values())
    row_of = {id(k): r for r, k in enumerate(rows)}
    sizes = np.array([(_eights(k.lags), _eights(len(k.decay) + (k.ramp != 0.0))) for k in rows])
    L, M = map(int, sizes.max(axis=0))
    of = np.array([row_of[id(k)] for k in kernels])
    own = np.array([(k.weights[0], BLOCK * (k.ramp != 0.0)) for k in rows])
    stacked = Kernels(_zeros(len(rows), 2 * (L + 16) + 18 * M), L, M, of, sizes, own)
    for r, k in enumerate(rows):
        _fill(r, k.weights, k.start, k.decay, k.amplitude, k.start_ratio, k.ramp, stacked)
    return stacked


@register_jitable
def _columns(L: int, M: int) -> tuple[int, int, int, int, int]:
    """Where the parts of the table begin: start, forget, enter, collect, foresee."""
    forget = 2 * (L + 16)
    return L + 16, forget, forget + M, forget + 2 * M, forget + 10 * M


@register_jitable
def _zeros(rows: int, columns: int) -> FloatArray:
    """Zeros that begin at a multiple of 64 bytes: loads across two cache lines cost twice."""
    room = np.zeros(rows * columns + BLOCK)
    first = -room.ctypes.data % 64 // 8
    return room[first : first + rows * columns].reshape(rows, columns)


def _eights(count: int) -> int:
    """The next multiple of 8, but not 0."""
    return max(1, -(-count // BLOCK)) * BLOCK


_vector, _matrix, _indices = types.float64[::1], types.float64[:, ::1], types.int64[::1]
_kernels = types.NamedTuple((_matrix, types.int64, types.int64, _indices, types.int64[:, ::1], _matrix), Kernels)


@nb.njit(types.void(types.int64, *[_vector] * 5, types.float64, _kernels), cache=True, nogil=True)
def _fill(r, exact, first, decay, amplitude, first_ratio, ramp, stacked):
    """Fill one row.  Lags beyond the exact ones up to L + 7 take their weights from the exponentials.

    A linear part of the weights is one sum more, :math:`Y_0 = \\sum_s (n-L-1-s) v_s`; the constant's is Y_1 then.
    """
    row, M = stacked.table[r], stacked.modes
    start, forget, enter, collect, foresee = _columns(stacked.lags, M)
    known, m0 = 8 + len(exact) - 1, 1 if ramp != 0.0 else 0
    more = 8 + stacked.sizes[r, 0] - known  # lags to make of the exponentials, for L to be a multiple of 8
    row[8:known], row[start + 8 : start + known] = exact[1:], first[1:]
    for m in range(len(decay)):
        s = np.log1p(decay[m])
        row[forget + m0 + m], row[enter + m0 + m] = np.expm1(BLOCK * s), first_ratio[m]
        for j in range(more + BLOCK - 1):
            weight = amplitude[m] * np.exp(j * s)
            row[known + j] += weight
            row[start + known + j] += weight * first_ratio[m]
        for j in range(BLOCK):
            row[collect + j * M + m0 + m] = np.exp((BLOCK - 1 - j) * s)
            row[foresee + BLOCK * (m0 + m) + j] = amplitude[m] * np.exp((more + j) * s)
    if ramp != 0.0:
        row[enter] = -1 / 6  # the first sample's panel is half a hat, whose centre is a third of a step later
        for j in range(more + BLOCK - 1):
            row[known + j] += ramp * j
            row[start + known + j] += ramp * (j / 2 - 1 / 6)
        for j in range(BLOCK):
            row[collect + j * M] = BLOCK - 1 - j
            row[foresee + j] = ramp
            row[foresee + BLOCK + j] += ramp * (more + j)


# --- eight numbers in a register -------------------------------------------------------------------


class _Eight(types.Type):  # type: ignore[misc]
    """Eight float64 in one vector register."""


_eight, _lanes = _Eight("eight"), ir.VectorType(ir.DoubleType(), BLOCK)


@register_model(_Eight)
class _EightModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _lanes)


def _pointer(context, builder, signature, args):
    """Where array[i, k] stands; the intrinsics neither count references nor look for negative indices."""
    array = make_array(signature.args[0])(context, builder, args[0])
    row = builder.mul(args[1], builder.extract_value(array.shape, 1))
    return builder.gep(array.data, [builder.add(row, args[2])])


def _spread(builder, number):
    """A number in all eight places."""
    undefined = ir.Constant(_lanes, ir.Undefined)
    first = builder.insert_element(undefined, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(ir.IntType(32), BLOCK), [0] * BLOCK))


@intrinsic
def _load(_, array, i, k):
    """array[i, k : k + 8]."""

    def emit(context, builder, signature, args):
        at = _pointer(context, builder, signature, args)
        return builder.load(builder.bitcast(at, _lanes.as_pointer()), align=8)

    return _eight(array, types.intp, types.intp), emit


@intrinsic
def _store(_, array, i, k, eight):
    """array[i, k : k + 8] = eight."""

    def emit(context, builder, signature, args):
        at = _pointer(context, builder, signature, args)
        builder.store(args[3], builder.bitcast(at, _lanes.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, _eight), emit


@intrinsic
def _at(_, array, i, k):
    """array[i, k] in all eight places."""

    def emit(context, builder, signature, args):
        return _spread(builder, builder.load(_pointer(context, builder, signature, args)))

    return _eight(array, types.intp, types.intp), emit


@intrinsic
def _all(_, number):
    """A number in all eight places."""
    return _eight(types.float64), lambda context, builder, signature, args: _spread(builder, args[0])


@intrinsic
def _add(_, total, x, y):
    """total + x · y, rounded once where the machine can."""

    def emit(context, builder, signature, args):
        product = builder.fmul(args[1], args[2], flags=("contract",))
        return builder.fadd(args[0], product, flags=("contract",))

    return _eight(_eight, _eight, _eight), emit


# --- the history -----------------------------------------------------------------------------------

_inline = nb.njit(nogil=True, error_model="numpy", forceinline=True)


@_inline
def _history(n, head, window, sums, ahead, kernels):
    """Compute H of the steps n … n + 7 from the samples before n; window[i, head − k] is v_i^{n−k}."""
    table, M = kernels.table, kernels.modes
    start, forget, enter, collect, foresee = _columns(kernels.lags, M)
    for i in range(len(kernels.of)):
        r = kernels.of[i]
        L, modes = kernels.sizes[r, 0], kernels.sizes[r, 1]
        total = _sum(window, i, head - 1, -1, table, r, 8, 1, min(n - 1, L))
        if n <= L:
            total = _add(total, _at(window, i, head - n), _load(table, r, start + 7 + n))
        else:
            if n == L + 1:
                for m in range(modes):
                    sums[i, m] = table[r, enter + m] * window[i, head - n]
            else:
                slope = kernels.own[r, 1] * sums[i, 1]  # of the linear part: older samples' age grows by eight
                _collect(i, r, modes, head - L - BLOCK, window, sums, table, forget, collect, M)
                sums[i, 0] += slope
            total = _add(total, _all(1.0), _sum(sums, i, 0, 1, table, r, foresee, BLOCK, modes))
        _store(ahead, i, 0, total)


@_inline
def _sum(values, i, at, by, table, r, column, stride, count):
    """Σ_{k < count} values[i, at + k·by] · table[r, column + k·stride : … + 8], in four chains side by side."""
    a = b = c = d = _all(0.0)
    for k in range(0, count, 4):
        a = _add(a, _at(values, i, at + k * by), _load(table, r, column + k * stride))
        b = _add(b, _at(values, i, at + (k + 1) * by), _load(table, r, column + (k + 1) * stride))
        c = _add(c, _at(values, i, at + (k + 2) * by), _load(table, r, column + (k + 2) * stride))
        d = _add(d, _at(values, i, at + (k + 3) * by), _load(table, r, column + (k + 3) * stride))
    one = _all(1.0)
    return _add(_add(a, one, b), one, _add(c, one, d))


@_inline
def _collect(i, r, modes, oldest, window, sums, table, forget, collect, M):
    """Take the eight samples that leave the exact lags into the sums: Y ← Y + (z⁸ − 1) Y + Σ z^(7−j) v_j."""
    v0, v1, v2, v3 = _quartet(window, i, oldest)
    v4, v5, v6, v7 = _quartet(window, i, oldest + 4)
    one = _all(1.0)
    for m in range(0, modes, BLOCK):
        y, at = _load(sums, i, m), collect + m
        a = _add(_all(0.0), y, _load(table, r, forget + m))
        a = _add(_add(a, v0, _load(table, r, at)), v1, _load(table, r, at + M))
        a = _add(_add(a, v2, _load(table, r, at + 2 * M)), v3, _load(table, r, at + 3 * M))
        b = _add(_add(y, v4, _load(table, r, at + 4 * M)), v5, _load(table, r, at + 5 * M))
        b = _add(_add(b, v6, _load(table, r, at + 6 * M)), v7, _load(table, r, at + 7 * M))
        _store(sums, i, m, _add(a, one, b))


@_inline
def _quartet(array, i, k):
    return _at(array, i, k), _at(array, i, k + 1), _at(array, i, k + 2), _at(array, i, k + 3)


@_inline
def _enter(i, j, v, head, window, ahead, kernels):
    """Enter the new sample of state i, the j-th of its block, and add its share to the rest of the block."""
    window[i, head] = v
    _store(ahead, i, 0, _add(_load(ahead, i, 0), _all(v), _load(kernels.table, kernels.of[i], 7 - j)))


@_inline
def _nothing_yet(kernels, steps):
    """Give an empty window, which slides every 256 steps or more (never where all is kept), sums and H ahead."""
    states, longest = len(kernels.of), kernels.lags
    width = min(steps, longest + max(256, longest // 4)) + 3 * BLOCK
    return _zeros(states, width), _zeros(states, kernels.modes), _zeros(states, BLOCK)


@_inline
def _room(head, window, lags):
    """Give the place of the next eight samples; in a full window the newest part moves to the front first."""
    if head + BLOCK <= window.shape[1]:
        return head
    keep = lags + BLOCK
    for i in range(len(window)):
        for k in range(keep):
            window[i, k] = window[i, head - keep + k]
    return keep


# --- the schemes -----------------------------------------------------------------------------------

SLOW, SETTLED, SMALL, NEWTON = 0.25, 1e-7, 1e-3, 12
"""When ``pi2`` takes Newton's method: the next sweep would move a state by more than a quarter of the last one
and by more than 10⁻⁷ of (10⁻³ + its size).  At most 12 iterations."""

LARGEST = float(np.finfo(np.float64).max)
"""No limit is larger, so that a state within it is a number."""

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


@_inline
def _finite(f):
    """Tell whether all derivatives are finite."""
    for v in f:  # noqa: SIM110 (Numba compiles no generators)
        if not np.isfinite(v):
            return False
    return True


@_inline
def _read(u, n, now):
    """Copy the inputs of step n, where there is more than one row: a view would cost more."""
    if len(u) > 1:
        for c in range(len(now)):
            now[c] = u[n, c]


@nb.njit(_ENDED(*_RUN, types.boolean, _matrix), cache=True, nogil=True, error_model="numpy")
def step_gl(rhs, x0, slope, gain, u, p, h, limit, kernels, raw, out):
    """``gl-paper`` (raw) and ``gl``: fill `out`, (steps + 1, n_states), from its second row on."""
    steps, states, limit = len(out) - 1, len(x0), min(limit, LARGEST)
    (window, sums, ahead), head = _nothing_yet(kernels, steps), 1
    x, f, now = x0.copy(), np.zeros(states), u[0].copy()
    if raw:
        window[:, 0] = x0
    for n in range(1, steps + 1):
        j = (n - 1) % BLOCK
        if j == 0:
            head = _room(head, window, kernels.lags)
            _history(n, head, window, sums, ahead, kernels)
        _read(u, n - 1, now)
        rhs((n - 1) * h, x, now, p, f)
        for i in range(states):
            v = gain[i] * f[i] - ahead[i, j]
            _enter(i, j, v, head, window, ahead, kernels)
            x[i] = v if raw else x0[i] + slope[i] * (n * h) + v
            if not abs(x[i]) <= limit:
                return n - 1, DIVERGED if _finite(f) else NOT_FINITE
            out[n, i] = x[i]
        head += 1
    return steps, COMPLETED


@nb.njit(_ENDED(*_RUN, _matrix), cache=True, nogil=True, error_model="numpy")
def step_gl_sequential(rhs, x0, slope, gain, u, p, h, limit, kernels, out):
    """``gl-sequential``: the last state first, each derivative with the states already new."""
    steps, states, limit = len(out) - 1, len(x0), min(limit, LARGEST)
    (window, sums, ahead), head = _nothing_yet(kernels, steps), 1
    x, f, now = x0.copy(), np.zeros(states), u[0].copy()
    for n in range(1, steps + 1):
        j = (n - 1) % BLOCK
        if j == 0:
            head = _room(head, window, kernels.lags)
            _history(n, head, window, sums, ahead, kernels)
        _read(u, n - 1, now)
        for i in range(states - 1, -1, -1):
            rhs((n - 1) * h, x, now, p, f)
            v = gain[i] * f[i] - ahead[i, j]
            _enter(i, j, v, head, window, ahead, kernels)
            x[i] = x0[i] + slope[i] * (n * h) + v
            if not abs(x[i]) <= limit:
                return n - 1, DIVERGED if np.isfinite(f[i]) else NOT_FINITE
            out[n, i] = x[i]
        head += 1
    return steps, COMPLETED


@_inline
def _slow(x, last, f, known, newest, weight):
    """Tell whether the next sweep would move x by too much, after the last one moved it there from `last`."""
    moved = next_move = 0.0
    for i in range(len(x)):
        moved = max(moved, weight[i] * abs(x[i] - last[i]))
        next_move = max(next_move, weight[i] * abs(known[i] + newest[i] * f[i] - x[i]))
    return next_move > max(SLOW * moved, SETTLED)


@nb.njit(nogil=True, error_model="numpy")
def _newton(rhs, t, x, u, p, f, known, newest, A, trial):
    """Solve x = known + g b_0 f(t, x) by Newton's method from x, f = f(t, x); leaves both solved.

    A holds 1 − g b_0 ∂f/∂x, by forward differences, and the residual in its last column.  After NEWTON
    iterations it takes what it has (a kink may keep it from settling); the check at half the step tells.
    """
    for _ in range(NEWTON):
        for j in range(len(x)):
            d, kept = 1e-7 * (0.01 + abs(x[j])), x[j]
            x[j] = kept + d
            rhs(t, x, u, p, trial)
            x[j] = kept
            for i in range(len(x)):
                A[i, j] = (i == j) - newest[i] * (trial[i] - f[i]) / d
        for i in range(len(x)):
            A[i, -1] = known[i] + newest[i] * f[i] - x[i]
        _eliminate(A)
        size = 0.0
        for i in range(len(x)):
            x[i] += A[i, -1]
            size = max(size, abs(A[i, -1]) / (SMALL + abs(x[i])))
        rhs(t, x, u, p, f)
        if not size > 1e-10:
            return


@nb.njit(nogil=True, error_model="numpy")
def _eliminate(A):
    """Gauss–Jordan with row pivoting: the last column becomes the solution."""
    n = len(A)
    for k in range(n):
        pivot = k + np.argmax(np.abs(A[k:, k]))
        for j in range(k, n + 1):
            A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
        for i in range(n):
            if i != k:
                factor = A[i, k] / A[k, k]
                for j in range(k, n + 1):
                    A[i, j] -= factor * A[k, j]
    for k in range(n):
        A[k, n] /= A[k, k]


@nb.njit(_ENDED(*_RUN, types.int64, _matrix), cache=True, nogil=True, error_model="numpy")
def step_pi2(rhs, x0, slope, gain, u, p, h, limit, kernels, corrections, out):
    """``pi2``: predict f by extrapolation, then `corrections` sweeps, Newton where they are slow."""
    steps, states, limit = len(out) - 1, len(x0), min(limit, LARGEST)
    (window, sums, ahead), head = _nothing_yet(kernels, steps), 1
    x, f, now = x0.copy(), np.zeros(states), u[0].copy()
    before, known, newest = np.zeros(states), np.zeros(states), np.zeros(states)
    A, trial = np.zeros((states, states + 1)), np.zeros(states)
    last, weight = np.zeros(states), np.zeros(states)
    rhs(0.0, x, now, p, f)
    if not _finite(f):
        return 0, NOT_FINITE
    for i in range(states):
        newest[i] = gain[i] * kernels.own[kernels.of[i], 0]
        window[i, 0] = before[i] = f[i]
    for n in range(1, steps + 1):
        j = (n - 1) % BLOCK
        if j == 0:
            head = _room(head, window, kernels.lags)
            _history(n, head, window, sums, ahead, kernels)
            for i in range(states):
                weight[i] = 1 / (SMALL + abs(x[i]))
        for i in range(states):
            known[i] = x0[i] + slope[i] * (n * h) + gain[i] * ahead[i, j]
            x[i] = known[i] + newest[i] * (2 * f[i] - before[i])
            before[i] = f[i]
        _read(u, n, now)
        sweeps = corrections if n > 1 else corrections + 4  # nothing to extrapolate from at the start
        for _ in range(sweeps):
            rhs(n * h, x, now, p, f)
            for i in range(states):
                last[i], x[i] = x[i], known[i] + newest[i] * f[i]
                if not abs(x[i]) <= limit:
                    return n - 1, DIVERGED if _finite(f) else NOT_FINITE
        rhs(n * h, x, now, p, f)
        if _slow(x, last, f, known, newest, weight):
            _newton(rhs, n * h, x, now, p, f, known, newest, A, trial)
        for i in range(states):
            if not np.isfinite(f[i]):
                return n - 1, NOT_FINITE
            if not abs(x[i]) <= limit:  # Newton's method has moved it
                return n - 1, DIVERGED
            _enter(i, j, f[i], head, window, ahead, kernels)
            out[n, i] = x[i]
        head += 1
    return steps, COMPLETED
