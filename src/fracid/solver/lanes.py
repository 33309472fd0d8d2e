"""A number for each of several runs in one vector register: the loop of ``pi2`` steps them all at once.

Runs beside each other, of a Jacobian or of a population, have the same right-hand side, inputs and grid; they differ in
orders, parameters and initial states.  To Numba a :class:`Lanes` is a number like a float, so that the same Python
right-hand side and the same loop (:mod:`fracid.solver.schemes`) compile for it; the history is that of so many states
(:mod:`fracid.solver.history`).  Two things go lane by lane: what enters the history and what is stored.  Newton's
method goes on where it is needed, and keeps all other lanes as they are.

**Where runs part.**  A condition holds in all lanes or in none; where it does not, the loop raises :class:`Parted`, and
the runs go one by one (:func:`fracid.solver.solve.integrate_all`), as they do where one ends early, or where a
right-hand side uses what is not written here.

**The same numbers.**  Sums, products and quotients are those of one run, in their order.  sin, cos, exp and tanh
are computed here, to a rounding or two of what the system's library gives.
"""

# ruff: noqa: ARG001, ARG002, ARG005 (an intrinsic names its arguments for its callers, and gets types and values apart)
# mypy: disallow-untyped-decorators=False, allow-untyped-defs, allow-untyped-calls
# mypy: disable-error-code="no-any-return, misc"

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import llvmlite.binding as llvm  # type: ignore[import-untyped]
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.errors import NumbaError
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, overload, register_model
from numba.np.arrayobj import make_array, populate_array

from fracid.arrays import FloatArray
from fracid.solver import schemes
from fracid.solver.compilation import INDICES, LOOP, call_at, kept, when_called
from fracid.solver.history import (
    BLOCK,
    Kernels,
    forget_mode,
    fused,
    in_all,
    inline,
    look_ahead,
)
from fracid.solver.loop_arguments import Run, run_type
from fracid.solver.right_hand_side import teach_helpers
from fracid.solver.same_function import once_for_equals
from fracid.solver.schemes import COMPLETED, ROWS, room_for
from fracid.solver.starting import Start, begun

COUNT = 8 if llvm.get_host_cpu_features().get("avx512f") else 4
"""Runs that step together: as many float64 as a vector register holds."""


class Parted(Exception):
    """A condition holds in some lanes and not in others."""


class Lanes(types.Type):
    """A float64 for each run."""

    def can_convert_from(self, context, other):
        """A number is the same in all lanes."""
        return Conversion.promote if isinstance(other, types.Float | types.Integer | types.Boolean) else None

    def unify(self, context, other):
        """What is a number in one branch and lanes in another is lanes."""
        return self if isinstance(other, types.Float | types.Integer) else None


class Mask(types.Type):
    """A truth value for each run."""

    def can_convert_from(self, context, other):
        """A truth value is the same in all lanes."""
        return Conversion.promote if isinstance(other, types.Boolean) else None

    def unify(self, context, other):
        """As of lanes."""
        return self if isinstance(other, types.Boolean) else None


LANES, MASK = Lanes(f"lanes{COUNT}"), Mask(f"mask{COUNT}")
VECTOR, TRUTHS = ir.VectorType(ir.DoubleType(), COUNT), ir.VectorType(ir.IntType(1), COUNT)
BITS, WHOLE = ir.VectorType(ir.IntType(64), COUNT), ir.IntType(COUNT)


register_model(Lanes)(lambda manager, kind: models.PrimitiveModel(manager, kind, VECTOR))
register_model(Mask)(lambda manager, kind: models.PrimitiveModel(manager, kind, TRUTHS))


def of_lanes(dimensions: int) -> types.Array:
    """An array of lanes, contiguous."""
    return types.Array(LANES, dimensions, "C", aligned=False)


RHS_OF_LANES = types.void(types.float64, of_lanes(1), types.float64[::1], of_lanes(1), of_lanes(1))
"""rhs(t, x, u, p, out) of runs that share their inputs."""


# --- arithmetic ------------------------------------------------------------------------------------


def _number(value):
    return ir.Constant(VECTOR, [float(value)] * COUNT)


def _bits(value):
    return ir.Constant(BITS, [value] * COUNT)


@lower_cast(types.Float, Lanes)
@lower_cast(types.Integer, Lanes)
@lower_cast(types.Boolean, Lanes)
def _spread(context, builder, kind, lanes, value):
    return in_all(builder, context.cast(builder, value, kind, types.float64), VECTOR)


@lower_cast(types.Boolean, Mask)
def _spread_truth(context, builder, kind, mask, value):
    return in_all(builder, builder.trunc(value, ir.IntType(1)) if value.type.width > 1 else value, TRUTHS)


def _of_lanes(function: Any, emit: Any, gives: types.Type = LANES, takes: Any = Lanes, n: int = 2) -> None:
    """Have a function of n numbers take lanes, or lanes and numbers."""

    @infer_global(function)
    class Template(AbstractTemplate):
        def generic(self, args, kws):
            kind, alike = (LANES, types.Number) if takes is Lanes else (MASK, types.Boolean)
            known = all(a == kind or isinstance(a, alike) for a in args)
            return signature(gives, *[kind] * n) if len(args) == n and kind in args and known else None

    lower_builtin(function, *[takes] * n)(lambda context, builder, signature, args: emit(builder, *args))


for _name, _emit in {"add": "fadd", "sub": "fsub", "mul": "fmul", "truediv": "fdiv"}.items():
    for _operator in (getattr(operator, _name), getattr(operator, "i" + _name)):
        _of_lanes(_operator, lambda b, x, y, emit=_emit: getattr(b, emit)(x, y))
for _name, _sign in {"gt": ">", "lt": "<", "ge": ">=", "le": "<=", "eq": "=="}.items():
    _of_lanes(getattr(operator, _name), lambda b, x, y, sign=_sign: b.fcmp_ordered(sign, x, y), MASK)
_of_lanes(operator.ne, lambda b, x, y: b.fcmp_unordered("!=", x, y), MASK)
_of_lanes(operator.or_, lambda b, x, y: b.or_(x, y), MASK, Mask)
_of_lanes(operator.and_, lambda b, x, y: b.and_(x, y), MASK, Mask)
_of_lanes(operator.neg, lambda b, x: b.fneg(x), n=1)


def _larger(b, x, y):
    return b.select(b.fcmp_ordered(">", y, x), y, x)


def _smaller(b, x, y):
    return b.select(b.fcmp_ordered("<", y, x), y, x)


def _size(b, x):
    return b.bitcast(b.and_(b.bitcast(x, BITS), _bits(2**63 - 1)), VECTOR)


def _signed(b, size, sign):
    """The size of one with the sign of another."""
    bit = b.and_(b.bitcast(sign, BITS), _bits(-(2**63)))
    return b.bitcast(b.or_(b.bitcast(_size(b, size), BITS), bit), VECTOR)


def _polynomial(b, x, *coefficients):
    value = _number(coefficients[0])
    for c in coefficients[1:]:
        value = fused(b, value, x, _number(c))
    return value


ROUND = 1.5 * 2.0**52
"""Added to a number it leaves the nearest whole one in the last bits."""

TURNS = 1e5
"""An angle beyond this [rad] is left to the system's library."""


def _sine_and_cosine(b, x):
    """Cody and Waite's reduction to ±π/4, and the polynomials of Cephes."""
    shifted = fused(b, x, _number(2 / math.pi), _number(ROUND))
    quarter, whole = b.bitcast(shifted, BITS), b.fsub(shifted, _number(ROUND))
    r = fused(b, whole, _number(-1.5707963267948966), x)
    r = fused(b, whole, _number(-6.123233995736766e-17), r)
    square = b.fmul(r, r)
    s = _polynomial(b, square, 1.58962301576546568060e-10, -2.50507477628578072866e-8, 2.75573136213857245213e-6,
                    -1.98412698295895385996e-4, 8.33333333332211858878e-3, -1.66666666666666307295e-1)  # fmt: skip
    s = fused(b, b.fmul(s, square), r, r)
    c = _polynomial(b, square, -1.13585365213876817300e-11, 2.08757008419747316778e-9, -2.75573141792967388112e-7,
                    2.48015872888517045348e-5, -1.38888888888730564116e-3, 4.16666666666665929218e-2)  # fmt: skip
    c = fused(b, c, b.fmul(square, square), fused(b, square, _number(-0.5), _number(1.0)))
    odd = b.icmp_unsigned("!=", b.and_(quarter, _bits(1)), _bits(0))

    def turned(value, count):
        sign = b.shl(b.and_(b.add(quarter, _bits(count)), _bits(2)), _bits(62))
        return b.bitcast(b.xor(b.bitcast(value, BITS), sign), VECTOR)

    return turned(b.select(odd, c, s), 0), turned(b.select(odd, s, c), 1)


def _by_library(name: str, emit: Callable[..., Any]) -> Callable[..., Any]:
    """Leave the lanes that are too large to the system's library."""

    def whole(b, x):
        near = b.fcmp_ordered("<=", _size(b, x), _number(TURNS))
        place = cgutils.alloca_once_value(b, emit(b, x))
        kind = ir.FunctionType(ir.DoubleType(), [ir.DoubleType()])
        function = cgutils.get_or_insert_function(b.module, kind, f"llvm.{name}.f64")
        with cgutils.if_unlikely(b, b.icmp_unsigned("!=", b.bitcast(near, WHOLE), ir.Constant(WHOLE, -1))):
            value = b.load(place)
            for k in range(COUNT):
                at = ir.Constant(ir.IntType(32), k)
                far = b.call(function, [b.extract_element(x, at)])
                number = b.select(b.extract_element(near, at), b.extract_element(value, at), far)
                value = b.insert_element(value, number, at)
            b.store(value, place)
        return b.load(place)

    return whole


def _exponential(b, x):
    """2^k · e^r with |r| ≤ ln 2 / 2; from 0 below −708 and infinite above 709.7."""
    inside = _smaller(b, _larger(b, x, _number(-708.0)), _number(709.7))
    shifted = fused(b, inside, _number(1 / math.log(2)), _number(ROUND))
    whole = b.fsub(shifted, _number(ROUND))
    r = fused(b, whole, _number(-6.93147180369123816490e-01), inside)
    r = fused(b, whole, _number(-1.90821492927058770002e-10), r)
    series, square = [1 / math.factorial(k) for k in range(13, -1, -1)], b.fmul(r, r)
    p = fused(b, r, _polynomial(b, square, *series[::2]), _polynomial(b, square, *series[1::2]))  # odd beside even
    half = b.ashr(b.shl(b.bitcast(shifted, BITS), _bits(13)), _bits(14))  # k may be 1024: two factors
    rest = b.sub(b.ashr(b.shl(b.bitcast(shifted, BITS), _bits(13)), _bits(13)), half)
    for power in (half, rest):
        p = b.fmul(p, b.bitcast(b.shl(b.add(power, _bits(1023)), _bits(52)), VECTOR))
    p = b.select(b.fcmp_ordered(">", x, _number(709.7)), _number(math.inf), p)
    p = b.select(b.fcmp_ordered("<", x, _number(-708.0)), _number(0.0), p)
    return b.select(b.fcmp_unordered("uno", x, x), x, p)


def _hyperbolic_tangent(b, x):
    """1 − 2/(e^{2|x|} + 1), and below 5/8 the rational function of Cephes."""
    size = _size(b, x)
    e = _exponential(b, b.fmul(_smaller(b, size, _number(20.0)), _number(2.0)))
    s = b.fmul(x, x)
    above = _polynomial(b, s, -9.64399179425052238628e-1, -9.92877231001918586564e1, -1.61468768441708447952e3)
    below = _polynomial(b, s, 1.0, 1.12811678491631932402e2, 2.23548839060100448583e3, 4.84406305325125486048e3)
    is_small = b.fcmp_ordered("<", size, _number(0.625))  # one division for both, which is what takes time
    ratio = b.fdiv(b.select(is_small, above, _number(2.0)), b.select(is_small, below, b.fadd(e, _number(1.0))))
    small, large = fused(b, b.fmul(ratio, s), size, size), b.fsub(_number(1.0), ratio)
    value = _signed(b, b.select(is_small, small, large), x)
    return b.select(b.fcmp_unordered("uno", x, x), x, value)


def _of_llvm(name, b, *x):
    kind = ir.FunctionType(VECTOR, [VECTOR] * len(x))
    return b.call(cgutils.get_or_insert_function(b.module, kind, f"llvm.{name}.v{COUNT}f64"), x)


_of_lanes(operator.pow, partial(_of_llvm, "pow"))
_of_lanes(math.sqrt, partial(_of_llvm, "sqrt"), n=1)
_of_lanes(max, _larger)
_of_lanes(min, _smaller)
_of_lanes(math.copysign, _signed)
for _function, _emit_one in {
    abs: _size, math.fabs: _size, math.exp: _exponential, math.tanh: _hyperbolic_tangent,
    math.sin: _by_library("sin", lambda b, x: _sine_and_cosine(b, x)[0]),
    math.cos: _by_library("cos", lambda b, x: _sine_and_cosine(b, x)[1]),
}.items():  # fmt: skip
    _of_lanes(_function, _emit_one, n=1)


@overload(float)
def _as_it_is(x):
    return (lambda x: x) if isinstance(x, Lanes) else None


# --- conditions ------------------------------------------------------------------------------------


@intrinsic
def _count(context, mask):
    """In how many lanes it holds: as bits."""
    return types.int64(MASK), lambda c, b, s, a: b.zext(b.bitcast(a[0], WHOLE), ir.IntType(64))


@overload(bool)
def _agreed(mask):
    if isinstance(mask, Mask):
        every = 2**COUNT - 1

        def condition(mask):
            bits = _count(mask)
            if bits != 0 and bits != every:
                raise Parted
            return bits != 0

        return condition
    return None


@overload(operator.not_)
def _none_of(mask):
    return (lambda mask: not bool(mask)) if isinstance(mask, Mask) else None


@inline
def _anywhere(mask):
    return _count(mask) != 0


@intrinsic
def _where(context, mask, x, y):
    return LANES(MASK, LANES, LANES), lambda c, b, s, a: b.select(*a)


@intrinsic
def _but(context, one, other):
    return MASK(MASK, MASK), lambda c, b, s, a: b.and_(a[0], b.not_(a[1]))


# --- lane by lane ----------------------------------------------------------------------------------


@intrinsic
def _lane(context, lanes, k):
    """The number of one run."""
    return types.float64(LANES, types.intp), lambda c, b, s, a: b.extract_element(*a)


@intrinsic
def _with_lane(context, lanes, k, number):
    """The lanes with another number for one run."""
    return LANES(LANES, types.intp, types.float64), lambda c, b, s, a: b.insert_element(a[0], a[2], a[1])


@intrinsic
def _together(context, array):
    """See an array of numbers, whose last axis are the runs, as one of lanes; its references are not counted."""

    def emit(context, builder, signature, args):
        numbers, lanes = make_array(signature.args[0])(context, builder, args[0]), make_array(signature.return_type)
        view, shape = lanes(context, builder), cgutils.unpack_tuple(builder, numbers.shape)[:-1]
        strides = cgutils.unpack_tuple(builder, numbers.strides)[:-1]
        populate_array(
            view, builder.bitcast(numbers.data, VECTOR.as_pointer()), shape, strides,
            context.get_constant(types.intp, 8 * COUNT), numbers.meminfo, numbers.parent,
        )  # fmt: skip
        return view._getvalue()

    return of_lanes(array.ndim - 1)(array), emit


class Beside(NamedTuple):
    """The kernels of runs beside each other."""

    each: Kernels
    """Of all runs' states: that of state i in run k is number COUNT · i + k."""
    near: Any
    """w_0 … w_7 of each state, in lanes, (n_states, 8)."""
    lags: int
    """L."""


@intrinsic
def _evaluate(context, address, t, x, u, p, out):
    """Call the right-hand side of lanes."""
    return types.void(address, *RHS_OF_LANES.args), lambda c, b, s, a: call_at(c, b, RHS_OF_LANES, a[0], a[1:])


@inline
def _look_ahead(n, head, window, sums, ahead, kernels):
    numbers, inner = sums
    look_ahead(n, head, window, inner, numbers, kernels.each)
    for i in range(len(ahead)):
        for j in range(BLOCK):
            H = ahead[i, j]
            for k in range(COUNT):
                H = _with_lane(H, k, numbers[COUNT * i + k, j])
            ahead[i, j] = H


@inline
def _enter(i, j, v, head, window, ahead, kernels):
    for k in range(COUNT):
        window[COUNT * i + k, head] = _lane(v, k)
    for later in range(j + 1, BLOCK):
        ahead[i, later] = _added(ahead[i, later], v, kernels.near[i, later - j])


@intrinsic
def _added(context, total, x, y):
    """total + x · y, as the history adds up."""
    return LANES(LANES, LANES, LANES), lambda c, b, s, a: fused(b, a[1], a[2], a[0])


@inline
def _first(i, v, window):
    for k in range(COUNT):
        window[COUNT * i + k, 0] = _lane(v, k)


@inline
def _store(row, x, out):
    for k in range(COUNT):
        for i in range(len(x)):
            out[k, row, i] = _lane(x[i], k)
    return row + 1


# --- the loop --------------------------------------------------------------------------------------


_pi2 = schemes.adapted(
    schemes.step_pi2, evaluate=_evaluate, look_ahead=_look_ahead, enter=_enter, _first=_first, _store=_store,
    _where=_where, _but=_but, anywhere=_anywhere,
)  # fmt: skip

_vector, _matrix, _cube = (types.Array(types.float64, n, "C") for n in (1, 2, 3))

STARTED = types.NamedTuple((_cube, _matrix, types.int64, INDICES, types.Array(types.float64, 4, "C")), Start)
ROOM = types.Tuple((_matrix, _matrix, _matrix, _cube, _cube, types.UniTuple(_matrix, ROWS),
                    types.UniTuple(_matrix, 2), _vector, _cube, _cube))  # fmt: skip


@when_called(types.UniTuple(types.int64, 2)(types.int64, run_type(1), STARTED, ROOM, _cube), allocates=False)
def step_together(rhs, run, started, room, out):
    """``pi2`` of COUNT runs: fill `out`, (COUNT, rows, n_states)."""
    window, sums, numbers, near, ahead, rows, f, now, W, start = room
    kernels: Any = Beside(run.kernels, _together(near), run.kernels.lags)
    lanes = Run(
        _together(run.orders), _together(run.gain), run.u, _together(run.p), _together(run.past),
        _together(run.slope), run.start, run.h, run.steps, run.every, run.limit, run.bounds,
        kernels, run.corrections, run.corrected, run.relaxing, run.fading, run.after,
    )  # fmt: skip
    begin = Start(_together(started.known), _together(started.x0), started.together, started.knots,
                  _together(started.parabolas))  # fmt: skip
    work = (
        (_together(rows[0]), _together(rows[1]), _together(rows[2]), _together(rows[3]), _together(rows[4]),
         _together(rows[5]), _together(rows[6]), _together(rows[7]), _together(rows[8]), _together(rows[9])),
        (_together(f[0]), _together(f[1])), now, _together(W), _together(start),
    )  # fmt: skip
    return _pi2(rhs, lanes, begin, (window, (numbers, sums), _together(ahead)), work, False, out)


@once_for_equals
def for_lanes(function: Any) -> Any:
    """A right-hand side compiled for lanes; None where its runs go one by one.

    Those are one that uses what lanes have not, and a user's own, which would be compiled in each process.
    """
    if not (function.__module__ or "").startswith("fracid."):
        return None
    teach_helpers(function)
    try:
        return kept(RHS_OF_LANES, no_cpython_wrapper=True, **LOOP)(function)
    except NumbaError:
        return None


def _started(rhs: int, runs: Sequence[Run]) -> list[Start]:
    """How runs begin that step together: what solves fewer first steps than another takes more from its own loop.

    Nothing where those fail.
    """
    starts = begun(rhs, runs, "pi")
    most = max(starts, key=lambda start: start.together)
    for k, (run, start) in enumerate(zip(runs, starts, strict=True)):
        if start.together == most.together:
            continue
        kernels = run.kernels._replace(of=run.kernels.of[k::COUNT].copy())
        few = run._replace(steps=most.together, every=1, kernels=kernels)
        known = np.empty((few.steps + 1, len(run.orders)))
        known[0] = run.past[0]
        _, how = schemes.step_pi2(rhs, few, start, *room_for(few), False, known)
        if how != COMPLETED:
            return []
        nothing = np.zeros_like(most.parabolas)
        parabolas = start.parabolas if start.parabolas.shape == nothing.shape else nothing
        starts[k] = start._replace(known=known, together=few.steps, knots=most.knots, parabolas=parabolas)
    return starts


def run_together(rhs: tuple[int, int], runs: Sequence[Run]) -> FloatArray | None:
    """The states of COUNT runs of ``pi2`` that differ in orders, parameters and initial states.

    Parameters
    ----------
    rhs : two addresses
        Of the right-hand side for lanes, and for one run.
    runs : sequence of Run
        Their `kernels` are those of all: of state i in run k at COUNT · i + k.

    Returns
    -------
    array, shape (COUNT, n_rows, n_states), or None
        None where they part or end early: they are to be run one by one.
    """
    one, states = runs[0], len(runs[0].orders)
    starts = _started(rhs[1], runs)
    if not starts:
        return None

    def stacked(records: Sequence[Any], *names: str) -> dict[str, Any]:
        return {n: np.ascontiguousarray(np.stack([getattr(r, n) for r in records], axis=-1)) for n in names}

    run = one._replace(**stacked(runs, "orders", "gain", "p", "past", "slope"))
    started = starts[0]._replace(**stacked(starts, "known", "x0", "parabolas"))
    history, work = room_for(run, COUNT)
    near = one.kernels.table[one.kernels.of, 7:15].reshape(states, COUNT, BLOCK).swapaxes(1, 2)
    room = (*history, np.ascontiguousarray(near), np.zeros((states, BLOCK, COUNT)), *work)
    out = np.empty((COUNT, one.steps // one.every + 1, states))
    out[:, 0] = run.past[-1].T
    try:
        _, how = step_together(rhs[0], run, started, room, out)
    except Parted:
        forget_mode()
        return None
    return out if how == COMPLETED else None
