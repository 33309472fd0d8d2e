"""A right-hand side: from plain Python in Numba's language to the compiled function that the loops call.

    def rhs(t, x, u, p, out):      # time, states, inputs, parameters; all float64
        out[0] = x[1]

A wrong index in compiled code would read or write the memory of others, so it is looked for: constant indices
are held against the sizes before a run, computed ones are checked at every access.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache, lru_cache
from types import FunctionType
from typing import Any

import numba as nb
import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.models import joints
from fracid.solver.compilation import RHS_SIGNATURE, kept
from fracid.solver.same_function import once_for_equals

__all__ = ["RightHandSide", "compile_rhs", "name_of", "probe", "teach_helpers"]

RightHandSide = Callable[[float, FloatArray, FloatArray, FloatArray, FloatArray], None]


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
    function = getattr(rhs, "py_func", rhs)
    _check_arity(function)
    return _compiled(function)


@once_for_equals
def _compiled(function: Any) -> Any:
    own = (function.__module__ or "").startswith("fracid.")  # what exec made may have none
    checked = not own and _largest_indices(function) is None  # of ours a test asks, for it takes a tenth of a second
    teach_helpers(function)
    options = {"_nrt": False} if own else {}  # ours allocate nothing, and counting who has x and out doubles their time
    try:
        return kept(RHS_SIGNATURE, own, error_model="numpy", nogil=True, boundscheck=checked, **options)(function)
    except nb.core.errors.NumbaError as error:
        raise InputError(
            f"The right-hand side {name_of(function)} cannot be compiled by Numba: {_reason(error)} "
            "Use numbers, loops, indexing and NumPy or math functions only, and write into out[i]; "
            "rhs(t, x, u, p, out) gets float64 arrays."
        ) from None


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
    _teach_joints()
    if not isinstance(function, FunctionType):
        return
    reach = inspect.getclosurevars(function)
    for helper in (*reach.globals.values(), *reach.nonlocals.values()):
        if isinstance(helper, FunctionType) and helper is not function and helper not in joints.ELEMENTS:
            _teach(helper)


@cache
def _teach(helper: FunctionType) -> None:
    nb.extending.register_jitable(error_model="numpy", boundscheck=True)(helper)
    teach_helpers(helper)


@cache
def _teach_joints() -> None:
    for element in joints.ELEMENTS:
        nb.extending.register_jitable(error_model="numpy")(element)


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


@lru_cache(maxsize=128)
def _check_arity(function: Any) -> None:
    if not callable(function):
        raise InputError(f"The right-hand side must be a function (t, x, u, p, out); got {function!r}.")
    try:
        signature = inspect.signature(function)
        signature.bind(0.0, None, None, None, None)
    except (TypeError, ValueError):
        raise InputError(f"The right-hand side {name_of(function)} takes {signature}; "
                         "it must take (t, x, u, p, out).") from None  # fmt: skip


def probe(rhs: Any, x0: FloatArray, u: FloatArray, p: FloatArray, relaxing: bool = False) -> None:
    """Run the function once in Python, where a wrong index is an error and not a crash.

    One with `relaxing` states may write their rates behind the derivatives, where it sees that there is room.
    """
    function = getattr(rhs, "py_func", rhs)
    _check_arity(function)
    out = np.full(len(x0), np.nan)
    sizes = f"x and out have {len(x0)} entries, u has {len(u)}, p has {len(p)}"
    reach = _largest_indices(function) or (0,) * 5
    sizes_there = len(x0), len(u), len(p), len(x0) * (1 + relaxing)
    for argument, needed, there in zip(("x", "u", "p", "out"), reach[1:], sizes_there, strict=True):
        if needed > there:
            raise InputError(f"The right-hand side {name_of(function)} does not fit its arguments: it uses "
                             f"{argument}[{needed - 1}]. Here {sizes}.")  # fmt: skip
    arguments = {"x": x0.copy(), "u": u.copy(), "p": p.copy()}
    try:
        with np.errstate(all="ignore"):
            returned = function(0.0, *arguments.values(), out)
    except ArithmeticError:
        return  # compiled, it gives inf, and the run's outcome says so
    except (IndexError, ValueError) as error:
        if isinstance(error, ValueError) and "math domain" in str(error):
            return
        raise InputError(
            f"The right-hand side {name_of(function)} does not fit its arguments: {error}. Here {sizes}."
        ) from None
    except Exception as error:
        raise InputError(f"The right-hand side {name_of(function)} fails at the start: "
                         f"{type(error).__name__}: {error}. Here {sizes}.") from None  # fmt: skip
    if returned is not None:
        raise InputError(f"The right-hand side {name_of(function)} returns a value; "
                         "it must write the derivatives into out and return nothing: out[0] = ...")  # fmt: skip
    for argument, before in (("x", x0), ("u", u), ("p", p)):
        if not np.array_equal(arguments[argument], before):
            raise InputError(f"The right-hand side {name_of(function)} changes {argument}, which is not its own; "
                             f"it may write into out alone. Copy what is to be changed: "
                             f"y = {argument}[0].")  # fmt: skip
    untouched = np.flatnonzero(np.isnan(out))
    if len(untouched) and np.all(np.isfinite(x0)) and not _computes_nan(function, x0, u, p, untouched):
        raise InputError(f"The right-hand side {name_of(function)} leaves out[{untouched[0]}] unwritten; "
                         f"it must fill all {len(x0)} entries of out.")  # fmt: skip


def _computes_nan(function: Any, x0: FloatArray, u: FloatArray, p: FloatArray, where: NDArray[np.intp]) -> bool:
    """Tell an entry that was left alone from one into which NaN was written."""
    out = np.zeros(len(x0))
    with np.errstate(all="ignore"):
        function(0.0, x0.copy(), u.copy(), p.copy(), out)
    return bool(np.any(np.isnan(out[where])))


def name_of(function: Any) -> str:
    """Give the name that messages call a function by."""
    return getattr(function, "__name__", repr(function))


def _reason(error: Exception) -> str:
    """The lines of Numba's report that a user can act on."""
    lines = [line.strip() for line in str(error).splitlines()]
    telling = [line for line in lines if line and not line.startswith(("Failed in", "During:", "- Resolution"))]
    where = next((line for line in lines if line.startswith("File ")), "")
    return " ".join([*telling[:2], where]).strip().rstrip(":.") + "."
