r"""The history sum of all the schemes, compiled: eight steps at a time, eight numbers to a vector register.

:math:`H_n = \sum_{k=1}^n w_k v_{n-k}` of every state, over the weights of its :class:`~fracid.solver.weights.Kernel`:
the last L samples through their own weights, all older ones through the sums
:math:`Y_m = \sum_s z_m^{n-L-1-s} v_s` of the exponentials.

Before step n = 1, 9, 17, … :func:`look_ahead` computes what the samples known by then add to H of the steps
n … n + 7 (``ahead``), and each new sample adds its share to the rest of its block (:func:`enter`).  So every
table entry that is loaded serves eight steps, and nothing is summed across a register.  Numba's loops do not
come out so by themselves; the five intrinsics below write the vector instructions.
"""

# ruff: noqa: ARG001, ARG005 (an intrinsic names its arguments for its callers, and gets types and values apart)

from __future__ import annotations

import platform
from functools import lru_cache
from typing import NamedTuple

import numba as nb
import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core.datamodel import models
from numba.extending import intrinsic, register_jitable, register_model
from numba.np.arrayobj import make_array

from fracid.arrays import FloatArray, IntArray
from fracid.solver.compilation import INDICES, MATRIX, PART, when_called
from fracid.solver.weights import Kernel

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
    of: IntArray
    """The row of each state, (n_states,)."""
    sizes: IntArray
    """L and M of each row, multiples of 8, (rows, 2)."""
    own: FloatArray
    """w_0, the weight of the newest sample, and 8 where the weights have a linear part, (rows, 2)."""


@lru_cache(maxsize=16)
def stack(*kernels: Kernel) -> Kernels:
    """Make the table for one kernel per state; states that share a kernel share its row."""
    rows = list(dict.fromkeys(kernels))
    sizes = np.array([(_eights(k.lags), _eights(len(k.decay) + (k.ramp != 0.0))) for k in rows])
    L, M = map(int, sizes.max(axis=0))
    of = np.array([rows.index(k) for k in kernels])
    own = np.array([(k.weights[0], BLOCK * (k.ramp != 0.0)) for k in rows])
    stacked = Kernels(_zeros(len(rows), 2 * (L + 16) + 18 * M), L, M, of, sizes, own)
    for r, k in enumerate(rows):
        _fill(stacked.table[r], k, sizes[r, 0], stacked)
    return stacked


@register_jitable
def _columns(L: int, M: int) -> tuple[int, int, int, int, int]:
    """Where the parts of the table begin: start, forget, enter, collect, foresee."""
    forget = 2 * (L + 16)
    return L + 16, forget, forget + M, forget + 2 * M, forget + 10 * M


def _zeros(rows: int, columns: int) -> FloatArray:
    """Zeros that begin at a multiple of 64 bytes: loads across two cache lines cost twice."""
    room = np.zeros(rows * columns + BLOCK)
    first = -room.ctypes.data % 64 // 8
    return room[first : first + rows * columns].reshape(rows, columns)


def _eights(count: int) -> int:
    """The next multiple of 8, but not 0."""
    return max(1, -(-count // BLOCK)) * BLOCK


KERNELS = types.NamedTuple((MATRIX, types.int64, types.int64, INDICES, types.int64[:, ::1], MATRIX), Kernels)


def _fill(row: FloatArray, k: Kernel, size: int, stacked: Kernels) -> None:
    """Fill one row.  Lags beyond the exact ones up to `size` + 7 take their weights from the exponentials.

    A linear part of the weights is one sum more, :math:`Y_0 = \\sum_s (n-L-1-s) v_s`; the constant's is Y_1 then.
    """
    M, exact, linear = stacked.modes, len(k.weights), int(k.ramp != 0.0)
    start, forget, enter, collect, foresee = _columns(stacked.lags, M)
    more = size + 1 - exact  # lags to make of the exponentials, for L to be a multiple of 8
    s, lag, last = np.log1p(k.decay), np.arange(more + BLOCK), np.arange(BLOCK)[::-1]
    weights = k.amplitude[:, None] * np.exp(np.outer(s, lag))
    modes, beyond = slice(linear, linear + len(s)), slice(7 + exact, 6 + exact + len(lag))
    of_block, of_mode = row[collect:foresee].reshape(BLOCK, M), row[foresee:].reshape(M, BLOCK)
    row[8 : 7 + exact], row[start + 8 : start + 7 + exact] = k.weights[1:], k.start[1:]
    row[beyond], row[start:][beyond] = np.sum(weights[:, :-1], axis=0), k.start_ratio @ weights[:, :-1]
    row[forget:enter][modes], row[enter:collect][modes] = np.expm1(BLOCK * s), k.start_ratio
    of_block[:, modes], of_mode[modes] = np.exp(np.outer(last, s)), weights[:, more:]
    if linear:
        row[enter] = -k.start_shift  # the first sample's panel is half a hat, whose centre is later
        row[beyond] += k.ramp * lag[:-1]
        row[start:][beyond] += k.ramp * (lag[:-1] / 2 - k.start_shift)
        of_block[:, 0], of_mode[0] = last, k.ramp
        of_mode[1] += k.ramp * lag[more:]


# --- eight numbers in a register -------------------------------------------------------------------


class _Eight(types.Type):  # type: ignore[misc]
    """Eight float64 in one vector register."""


_eight, _lanes = _Eight("eight"), ir.VectorType(ir.DoubleType(), BLOCK)


register_model(_Eight)(lambda manager, kind: models.PrimitiveModel(manager, kind, _lanes))


def _pointer(context, builder, signature, args):
    """Where array[i, k] stands; the intrinsics neither count references nor look for negative indices."""
    array = make_array(signature.args[0])(context, builder, args[0])
    row = builder.mul(args[1], builder.extract_value(array.shape, 1))
    return builder.gep(array.data, [builder.add(row, args[2])])


def in_all(builder, number, kind=_lanes):
    """A number in all places of a vector."""
    undefined, places = ir.Constant(kind, ir.Undefined), ir.VectorType(ir.IntType(32), kind.count)
    first = builder.insert_element(undefined, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(places, [0] * kind.count))


def fused(builder, x, y, z):
    """x · y + z, rounded once where the machine can."""
    return builder.fadd(builder.fmul(x, y, flags=("contract",)), z, flags=("contract",))


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
    return _eight(array, types.intp, types.intp), lambda c, b, s, a: in_all(b, b.load(_pointer(c, b, s, a)))


@intrinsic
def _all(_, number):
    """A number in all eight places."""
    return _eight(types.float64), lambda context, builder, signature, args: in_all(builder, args[0])


@intrinsic
def _add(_, total, x, y):
    """total + x · y, rounded once where the machine can."""
    return _eight(_eight, _eight, _eight), lambda c, builder, s, args: fused(builder, args[1], args[2], args[0])


# --- denormal numbers ------------------------------------------------------------------------------

_X86 = platform.machine().lower() in ("x86_64", "amd64")


def _control_register(builder, instruction, value=None):
    """Load or store the register that says how SSE rounds; elsewhere than on x86 there is none."""
    place = builder.alloca(ir.IntType(32))
    if value is not None:
        builder.store(value, place)
    pointer = builder.bitcast(place, ir.IntType(8).as_pointer())
    kind = ir.FunctionType(ir.VoidType(), [ir.IntType(8).as_pointer()])
    builder.call(builder.module.globals.get(instruction) or ir.Function(builder.module, kind, instruction), [pointer])
    return builder.load(place)


@intrinsic
def flush_denormals(_):
    """Take numbers below 10⁻³⁰⁸ for zero, since a sum that has died out would step a hundred times slower in them.

    Returns what :func:`restore` needs."""

    def emit(context, builder, signature, args):
        if not _X86:
            return ir.Constant(ir.IntType(32), 0)
        before = _control_register(builder, "llvm.x86.sse.stmxcsr")
        _control_register(builder, "llvm.x86.sse.ldmxcsr", builder.or_(before, ir.Constant(ir.IntType(32), 0x8040)))
        return before

    return types.int32(), emit


@intrinsic
def restore(_, before):
    """Treat denormal numbers as before."""

    def emit(context, builder, signature, args):
        if _X86:
            _control_register(builder, "llvm.x86.sse.ldmxcsr", args[0])
        return context.get_dummy_value()

    return types.void(types.int32), emit


@when_called(types.void(), allocates=False)
def forget_mode():
    """Set the processor's rounding as every program finds it, after a run that did not come to its :func:`restore`."""
    restore(types.int32(0x1F80))


# --- the history -----------------------------------------------------------------------------------

bare = nb.njit(_nrt=False, **PART)
"""For what loops call, and allocates nothing."""

inline = nb.njit(_nrt=False, forceinline=True, **PART)
"""The same, put in the place of the call."""


@inline
def look_ahead(n, head, window, sums, ahead, kernels):
    """Compute H of the steps n … n + 7 from the samples before n; window[i, head − k] is v_i^{n−k}."""
    table = kernels.table
    start, _, enter, _, foresee = _columns(kernels.lags, kernels.modes)
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
                _collect(i, r, head - L - BLOCK, window, sums, kernels)
                sums[i, 0] += slope
            total = _add(total, _all(1.0), _sum(sums, i, 0, 1, table, r, foresee, BLOCK, modes))
        _store(ahead, i, 0, total)


@inline
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


@inline
def _collect(i, r, oldest, window, sums, kernels):
    """Take the eight samples that leave the exact lags into the sums: Y ← Y + (z⁸ − 1) Y + Σ z^(7−j) v_j."""
    table, M = kernels.table, kernels.modes
    _, forget, _, collect, _ = _columns(kernels.lags, M)
    v0, v1, v2, v3 = _quartet(window, i, oldest)
    v4, v5, v6, v7 = _quartet(window, i, oldest + 4)
    one = _all(1.0)
    for m in range(0, kernels.sizes[r, 1], BLOCK):
        y, at = _load(sums, i, m), collect + m
        a = _add(_all(0.0), y, _load(table, r, forget + m))
        a = _add(_add(a, v0, _load(table, r, at)), v1, _load(table, r, at + M))
        a = _add(_add(a, v2, _load(table, r, at + 2 * M)), v3, _load(table, r, at + 3 * M))
        b = _add(_add(y, v4, _load(table, r, at + 4 * M)), v5, _load(table, r, at + 5 * M))
        b = _add(_add(b, v6, _load(table, r, at + 6 * M)), v7, _load(table, r, at + 7 * M))
        _store(sums, i, m, _add(a, one, b))


@inline
def _quartet(array, i, k):
    return _at(array, i, k), _at(array, i, k + 1), _at(array, i, k + 2), _at(array, i, k + 3)


@inline
def enter(i, j, v, head, window, ahead, kernels):
    """Enter the new sample of state i, the j-th of its block, and add its share to the rest of the block."""
    window[i, head] = v
    _store(ahead, i, 0, _add(_load(ahead, i, 0), _all(v), _load(kernels.table, kernels.of[i], 7 - j)))


def nothing_yet(kernels: Kernels, steps: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Give an empty window, which slides every 256 steps or more (never where all is kept), sums and H ahead."""
    states, longest = len(kernels.of), kernels.lags
    width = min(steps, longest + max(256, longest // 4)) + 3 * BLOCK
    return _zeros(states, width), _zeros(states, kernels.modes), _zeros(states, BLOCK)


HISTORY = types.UniTuple(MATRIX, 3)
"""A window, sums and H ahead."""


@inline
def room(head, window, lags):
    """Give the place of the next eight samples; in a full window the newest part moves to the front first."""
    if head + BLOCK <= window.shape[1]:
        return head
    keep = lags + BLOCK
    for i in range(len(window)):
        for k in range(keep):
            window[i, k] = window[i, head - keep + k]
    return keep
