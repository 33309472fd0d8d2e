"""A right-hand side: from plain Python in Numba's language to the compiled function that the loops call.

    def rhs(t, x, u, p, out):      # time, states, inputs, parameters; all float64
        out[0] = x[1]

A wrong index in compiled code would read or write the memory of others, so it is looked for: constant indices
are held against the sizes before a run, computed ones are checked at every access.  What cannot be checked is refused
by its name (:func:`_unfit`), and so is what would make two runs differ: random numbers, and what is kept from call to
call.  States, inputs and parameters are not its own: it is compiled for arrays that cannot be written.
"""

from __future__ import annotations

import dis
import inspect
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba as nb
import numpy as np
from numba import types
from numba.core.dispatcher import Dispatcher

from fracid.arrays import FloatArray
from fracid.errors import InputError, brief
from fracid.findings import Words
from fracid.models import joints
from fracid.models.base import RightHandSide as RightHandSide
from fracid.solver.compilation import LOOP, RHS_SIGNATURE, kept
from fracid.solver.same_function import once_for_equals

SAYS = Words("solver/right_hand_side.toml")

ARGUMENTS = 5
"""Of a right-hand side."""

READING = types.void(types.float64, *[types.Array(types.float64, 1, "C", readonly=True)] * 3, types.float64[::1])
"""Its signature, by which it cannot write but into out."""

CHANGED = "x, u or p, which are not its own; it may write into out alone. Copy what is to be changed: y = x.copy()."

UNCHECKED = ("flat", "as_strided", "carray", "farray")
"""Ways into an array past Numba's checks of indices."""

UNWRITTEN = -6.02214076e303
"""What `out` holds before the first look: so large that what is added to it leaves it as it is."""


def compile_rhs(rhs: Any) -> Any:
    """Compile a right-hand side once for all runs, and for all functions that mean the same.

    fracid's own are cached on disk and not checked; a user's is compiled anew in each process, since Numba's cache does
    not notice a change in what the function calls.  Where all its indices are constants they are held against the
    sizes once, before a run; where one is computed, every access is checked (which costs up to the time of f again).

    Raises
    ------
    InputError
        If it is not a function of (t, x, u, p, out), or not in Numba's language.

    Examples
    --------
    >>> compile_rhs(lambda t, x: None)
    Traceback (most recent call last):
    fracid.errors.InputError: The right-hand side <lambda> takes (t, x); it must take (t, x, u, p, out).
    """
    return _compiled(_in_python(rhs))


@once_for_equals
def _compiled(function: Any) -> Any:
    teach_helpers(function)
    if (function.__module__ or "").startswith("fracid."):  # what exec made may have none
        # ours allocate nothing, and counting who has x and out doubles their time; a test asks for their indices
        return kept(RHS_SIGNATURE, **LOOP)(function)
    options = {"error_model": "numpy", "nogil": True, "boundscheck": _largest_indices(function) is None}
    try:
        return _reading(function, options)
    except Exception as error:  # Numba's own, and what it stumbles over
        fault: str = SAYS("not-compiled", error=_reason(error))
    with suppress(Exception):
        kept(RHS_SIGNATURE, keep=False, **options)(function)
        fault = f"changes {CHANGED}"
    raise InputError(f"The right-hand side {name_of(function)} {fault}")


def _reading(function: Any, options: dict[str, Any]) -> Any:
    """Compiled so that it cannot write but into out, in a function of the loops' signature."""
    bare = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "forceinline": True}
    inner = kept(READING, keep=False, **bare, **options)(function)

    def rhs(t: float, x: FloatArray, u: FloatArray, p: FloatArray, out: FloatArray) -> None:
        out[: len(x)] = np.nan  # what a branch leaves unwritten would be the value of another state
        inner(t, x, u, p, out)

    rhs.__name__ = name_of(function)
    return kept(RHS_SIGNATURE, keep=False, **options)(rhs)


def teach_helpers(function: Any) -> None:
    """Make the functions that a function calls, and those that they call, known to Numba; plain Python they stay.

    Those are the elements of :mod:`fracid.models.joints`, and a user's own helpers, whose every access is checked.

    Examples
    --------
    >>> def cubed(x):
    ...     return x**3
    >>> def rhs(t, x, u, p, out):
    ...     out[0] = -cubed(x[0])
    >>> teach_helpers(rhs)
    >>> out = np.zeros(1)
    >>> compile_rhs(rhs)(0.0, np.array([2.0]), np.zeros(0), np.zeros(0), out)
    >>> float(out[0])
    -8.0
    """
    for helper in _helpers(function):
        _teach(helper)


def _helpers(function: Any) -> Iterator[Any]:
    """Functions of a user's own that a function calls by their names, compiled ones among them."""
    for how, _, value in _names(function):
        if how in ("LOAD_GLOBAL", "LOAD_DEREF") and isinstance(value, FunctionType | Dispatcher):
            is_own = str(value.__module__).partition(".")[0] not in ("numpy", "scipy", "numba")
            if is_own and value is not function and value not in joints.ELEMENTS:
                yield value


@cache
def _teach(helper: Any) -> None:
    if isinstance(helper, Dispatcher):
        if not helper.targetoptions.get("boundscheck"):
            helper.targetoptions["boundscheck"] = True
            helper.recompile()
        helper = helper.py_func
    else:
        nb.extending.register_jitable(error_model="numpy", boundscheck=True)(helper)
    teach_helpers(helper)


def _names(function: Any) -> Iterator[tuple[str, str, Any]]:
    """What a function and those within it load and store by name: how, which name, and its value where it is known."""
    if not isinstance(function, FunctionType):
        return
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    known = function.__globals__ | {name: _content(cell) for name, cell in cells}
    left = [function.__code__]
    while left:
        code = left.pop()
        left += [within for within in code.co_consts if isinstance(within, CodeType)]
        value: Any = None
        for step in dis.get_instructions(code):
            if step.opname in ("LOAD_GLOBAL", "LOAD_DEREF"):
                value = known.get(step.argval)
            elif step.opname in ("LOAD_ATTR", "LOAD_METHOD"):
                value = getattr(value, step.argval, None) if isinstance(value, ModuleType) else None
            elif step.opname != "STORE_GLOBAL" and not (step.opname == "STORE_DEREF" and step.argval in known):
                continue
            yield step.opname, str(step.argval), value


def names_time(rhs: Any) -> bool:
    """Whether a right-hand side so much as names its first argument.

    Examples
    --------
    >>> names_time(lambda t, x, u, p, out: None)
    False
    """
    code = getattr(rhs, "py_func", rhs).__code__
    return any(code.co_varnames[0] in step.argrepr.split(", ") for step in dis.get_instructions(code))


def _content(cell: Any) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # empty as yet
        return None


for _element in joints.ELEMENTS:
    nb.extending.register_jitable(error_model="numpy")(_element)


@once_for_equals
def _largest_indices(function: Any) -> tuple[int, ...] | None:
    """How many entries of (t, x, u, p, out) a right-hand side touches, None where only the run can tell."""
    from numba.core import ir, ir_utils
    from numba.core.compiler import run_frontend

    try:
        code = run_frontend(function)
    except Exception:
        return None  # the compiler will say what it does not like
    sizes = [0] * 5
    if any(isinstance(within, CodeType) for within in function.__code__.co_consts):
        return None
    for statement in (line for block in code.blocks.values() for line in block.body):
        if isinstance(statement, ir.SetItem | ir.StaticSetItem):
            array, index = statement.target, statement.index
        elif isinstance(value := getattr(statement, "value", None), ir.Expr) and value.op.endswith("getitem"):
            array, index = value.value, value.index
        else:
            continue
        argument = ir_utils.guard(ir_utils.get_definition, code, array)
        if _is_tuple_taken_apart(code, argument):  # a, b, c, d = p[0], p[1], p[2], p[3]
            continue
        constant = ir_utils.guard(ir_utils.find_const, code, index) if isinstance(index, ir.Var) else index
        if not (isinstance(argument, ir.Arg) and isinstance(constant, int)):
            return None
        sizes[argument.index] = max(sizes[argument.index], constant + 1 if constant >= 0 else -constant)
    return tuple(sizes)


def _is_tuple_taken_apart(code: Any, value: Any) -> bool:
    """Tell whether a value is a tuple written in place, whose entries go to names: no array, and as many by grammar."""
    from numba.core import ir, ir_utils

    if not (isinstance(value, ir.Expr) and value.op == "exhaust_iter"):
        return False
    whole = ir_utils.guard(ir_utils.get_definition, code, value.value)
    return isinstance(whole, ir.Expr) and whole.op == "build_tuple"


@once_for_equals
def _unfit(function: Any) -> str:
    """Why a function can be no right-hand side, in words that follow its name; empty where it can."""
    code = function.__code__
    if code.co_flags & (inspect.CO_GENERATOR | inspect.CO_COROUTINE | inspect.CO_ASYNC_GENERATOR):
        return "waits or yields; it must be a plain def, without async and yield"
    wanting = code.co_flags & (inspect.CO_VARARGS | inspect.CO_VARKEYWORDS) or code.co_kwonlyargcount
    if wanting or code.co_argcount != ARGUMENTS:
        return f"takes {inspect.signature(function)}; it must take (t, x, u, p, out)"
    return next(filter(None, (_fault(*use) for f in _reached(function) for use in _names(f))), "")


def _reached(function: Any) -> Iterator[Any]:
    """Itself, its helpers, and theirs."""
    left, seen = [function], list[Any]()
    while left:
        now = left.pop()
        if now not in seen:
            seen.append(now)
            left += [getattr(helper, "py_func", helper) for helper in _helpers(now)]
            yield now


def _fault(how: str, name: str, value: Any) -> str:
    """What is wrong with one use of a name."""
    makers = (value, type(value), getattr(value, "__self__", None), type(getattr(value, "__self__", None)))
    origins = {value.__name__} if isinstance(value, ModuleType) else {str(getattr(m, "__module__", "")) for m in makers}
    if any(origin == "random" or origin.startswith("numpy.random") for origin in origins):
        return f"draws random numbers ({name}), so that no two runs were the same; leave them out"
    if how.startswith("STORE"):
        return f"changes {name}, which lies outside of it, so that its value would depend on earlier calls"
    if name in UNCHECKED:
        return f"uses {name}, whose accesses cannot be checked; index the array itself: out[i]"
    return ""


def _in_python(rhs: Any) -> Any:
    """The function itself, where it is one that can be compiled."""
    function = getattr(rhs, "py_func", rhs)
    if not isinstance(function, FunctionType):
        raise InputError(f"The right-hand side must be a function, def rhs(t, x, u, p, out); got {brief(function)}.")
    if reason := _unfit(function):
        raise InputError(f"The right-hand side {name_of(function)} {reason}.")
    return function


def probe(rhs: Any, x0: FloatArray, u: FloatArray, p: FloatArray, relaxing: bool = False) -> None:
    """Run the function once in Python, where a wrong index is an error and not a crash.

    One with `relaxing` states may write their rates behind the derivatives, where it sees that there is room.
    """
    function = _in_python(rhs)
    out = np.full(len(x0), UNWRITTEN)
    sizes = f"x and out have {len(x0)} entries, u has {len(u)}, p has {len(p)}"
    reach = _largest_indices(function) or (0,) * 5
    sizes_there = len(x0), len(u), len(p), len(x0) * (1 + relaxing)
    for argument, needed, there in zip(("x", "u", "p", "out"), reach[1:], sizes_there, strict=True):
        if needed > there:
            raise InputError(SAYS("other-arguments", rhs=name_of(function), of=argument, last=needed - 1, sizes=sizes))
    arguments = {"x": x0.copy(), "u": u.copy(), "p": p.copy()}
    for given in arguments.values():
        given.flags.writeable = False
    try:
        with np.errstate(all="ignore"):
            returned = function(0.0, *arguments.values(), out)
    except ArithmeticError:
        return  # compiled, it gives inf, and the run's outcome says so
    except (IndexError, ValueError) as error:
        if isinstance(error, ValueError) and "math domain" in str(error):
            return
        if "read-only" in str(error):
            raise InputError(f"The right-hand side {name_of(function)} changes {CHANGED}") from None
        raise InputError(SAYS("does-not-fit", function=name_of(function), error=error, sizes=sizes)) from None
    except Exception as error:
        raise InputError(SAYS("fails", function=name_of(function), error=error, sizes=sizes)) from None
    if returned is not None:
        raise InputError(SAYS("returns", function=name_of(function)))
    untouched = np.flatnonzero(out == UNWRITTEN)
    if len(untouched):
        raise InputError(SAYS("unwritten", function=name_of(function), where=untouched[0], states=len(x0)))


def name_of(function: Any) -> str:
    """Give the name that messages call a function by."""
    return getattr(function, "__name__", repr(function))


def _reason(error: Exception) -> str:
    """The lines of Numba's report that a user can act on."""
    lines = [line.strip() for line in str(error).splitlines()]
    telling = [line for line in lines if line and not line.startswith(("Failed in", "During:", "- Resolution"))]
    where = next((line for line in lines if line.startswith("File ")), "")
    return " ".join([*telling[:2], where]).strip().rstrip(":.") + "."
