"""Simulate systems of fractional order: D^q x = f(t, x, u, p), Caputo, each state its own order.

=================  =================  ==========================================================
method             convergence order  what for
=================  =================  ==========================================================
``pi2``            2                  everything, steep friction too; at order 1 a second-order ODE solver
``gl``             1                  the paper's scheme as it should be, on x − x(0)
``gl-sequential``  1                  the same without the anti-damping of explicit Euler
``gl-paper``       1 if x(0) = 0      (21)–(24) as printed, to reproduce the paper; else wrong
=================  =================  ==========================================================

:func:`solve_fde` takes any right-hand side, a plain Python function in Numba's language,

    def rhs(t, x, u, p, out):      # time, states, inputs, parameters; all float64
        out[0] = x[1]              # D^q_0 x_0 = ...
        out[1] = -p[0] * x[0]

and :func:`simulate` a named :class:`~fracid.models.Model`.  A run that diverges or meets a singular
right-hand side is not an error: its :attr:`Trajectory.outcome` says so and the trajectory ends there.

To add a method: write its loop in :mod:`fracid.stepping` and its row in :data:`METHODS`.
"""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba as nb
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fracid.errors import InputError
from fracid.memory import Memory, memory_from_name
from fracid.stepping import RHS_SIGNATURE, Kernels, stack, step_gl, step_gl_sequential, step_pi2

if TYPE_CHECKING:
    from fracid.models import Model

__all__ = [
    "METHODS",
    "Method",
    "Outcome",
    "PaperSchemeWarning",
    "Trajectory",
    "compile_rhs",
    "simulate",
    "solve_fde",
]

FloatArray = NDArray[np.float64]
RightHandSide = Callable[[float, FloatArray, FloatArray, FloatArray, FloatArray], None]


class PaperSchemeWarning(UserWarning):
    """``gl-paper`` is asked for where it does not converge."""


class Outcome(Enum):
    """How a run ended; the value is the sentence."""

    COMPLETED = "completed"
    DIVERGED = "diverged: a state left the range of the limit"
    NOT_FINITE = "the right-hand side is not finite (a division by zero, such as det M = 0, or an overflow)"


_OUTCOMES = (Outcome.COMPLETED, Outcome.DIVERGED, Outcome.NOT_FINITE)  # by the loops' codes


@dataclass(frozen=True)
class Trajectory:
    """A simulated run, as far as it went."""

    time: FloatArray
    """The grid [s], shape (n,)."""
    states: FloatArray
    """Shape (n, n_states)."""
    outcome: Outcome
    """How it ended."""
    step: float
    """h [s]."""
    method: str
    """A key of :data:`METHODS`."""
    memory: str
    """``full``, ``short(L)`` or ``compressed(tolerance)``."""

    @property
    def completed(self) -> bool:
        """Whether the run reached its end."""
        return self.outcome is Outcome.COMPLETED


@dataclass(frozen=True)
class Method:
    """A stepping scheme."""

    family: str
    """Which kernel it sums with: ``gl`` or ``pi`` (:mod:`fracid.memory`)."""
    convergence_order: int
    """The error falls as h to this, where f(t, x(t)) is smooth."""
    run: Callable[..., tuple[int, int]]
    """(the loops' common arguments, corrections, out) → (last good index, how it ended)."""


METHODS = {
    "pi2": Method("pi", 2, lambda *run: step_pi2(*run)),
    "gl": Method("gl", 1, lambda *run: step_gl(*run[:-2], False, run[-1])),
    "gl-sequential": Method("gl", 1, lambda *run: step_gl_sequential(*run[:-2], run[-1])),
    "gl-paper": Method("gl", 1, lambda *run: step_gl(*run[:-2], True, run[-1])),
}


def solve_fde(
    rhs: RightHandSide,
    orders: ArrayLike,
    initial: ArrayLike,
    *,
    step: float,
    end: float,
    inputs: ArrayLike | None = None,
    parameters: ArrayLike = (),
    method: str = "pi2",
    memory: str | Memory = "compressed",
    tolerance: float = 1e-10,
    corrections: int = 1,
    limit: float = 1e100,
) -> Trajectory:
    """Solve D^q x = f(t, x, u, p) from t = 0, in the sense of Caputo (14).

    Parameters
    ----------
    rhs : function (t, x, u, p, out) -> None
        Plain Python in Numba's language; writes D^q_i x_i into ``out[i]``.  Division by zero gives inf.
    orders : float or array_like, shape (n_states,)
        Strictly between 0 and 2; a scalar holds for all states.
    initial : array_like, shape (n_states,) or (n_states, 2)
        x(0), and in the second column the first derivatives where an order exceeds 1.
    step, end : float
        h and the last time [s]; `end` must be a whole number of steps.
    inputs : array_like, shape (n + 1,) or (n + 1, n_inputs), optional
        u on the grid 0, h, …, end.
    parameters : array_like, shape (n_parameters,)
        Given to `rhs` as ``p``.
    method : key of :data:`METHODS`
    memory : ``"compressed"``, ``"full"``, ``"short(L)"`` or a :class:`~fracid.memory.Memory`
    tolerance : float
        Of the compressed memory: relative error of each weight.
    corrections : int
        Corrector sweeps of ``pi2``; each costs one evaluation of `rhs` a step.
    limit : float
        A state beyond ±limit ends the run as diverged.

    Returns
    -------
    Trajectory
        Up to the end, or up to the last good sample; see its ``outcome``.

    Raises
    ------
    InputError
        For orders outside (0, 2), shapes that do not fit, a step or end that is not positive, values
        that are not finite, or a right-hand side that is not of the form above.

    Examples
    --------
    D^0.8 y = −y, y(0) = 1, is the Mittag-Leffler function E_0.8(−t^0.8); at t = 1 it is 0.386948578…

    >>> def decay(t, x, u, p, out):
    ...     out[0] = -p[0] * x[0]
    >>> run = solve_fde(decay, 0.8, [1.0], step=1e-3, end=1.0, parameters=[1.0])
    >>> run.outcome.value, round(float(run.states[-1, 0]), 5)
    ('completed', 0.38695)
    """
    x0, slope, q = _initial_and_orders(initial, orders)
    steps = _steps(step, end)
    p = _vector("parameters", parameters)
    u = _inputs(inputs, steps)
    chosen, kept = _method(method, corrections), memory_from_name(memory, tolerance)
    _probe(rhs, x0, u[0], p)
    if method == "gl-paper" and np.any(x0 != 0):
        warnings.warn("gl-paper sums raw x (21)-(24), which is right only for x(0) = 0; here it is not, and the "
                      "result does not converge. Type method='pi2' for the Caputo solution.",
                      PaperSchemeWarning, stacklevel=2)  # fmt: skip
    return integrate(compile_rhs(rhs), q, x0, slope, u, p, float(step), steps, chosen, kept, corrections=corrections,
                     limit=limit, name=method)  # fmt: skip


def simulate(
    model: Model,
    *,
    orders: Mapping[str, float] | ArrayLike,
    initial: Mapping[str, float] | ArrayLike,
    step: float,
    end: float,
    parameters: Mapping[str, float] | None = None,
    inputs: ArrayLike | None = None,
    method: str = "pi2",
    memory: str | Memory = "compressed",
    tolerance: float = 1e-10,
    corrections: int = 1,
    limit: float = 1e100,
) -> Trajectory:
    """Simulate a named model; see :func:`solve_fde` for what is not said here.

    Parameters
    ----------
    model : Model
        For example ``fracid.rotary_pendulum()``.
    orders : mapping or array_like
        By name, ``{"lambda": 0.86, "mu": 0.91}``, or one per state.
    initial : mapping or array_like
        States at t = 0 by name (those left out are 0), ``{"alpha": 0.17}``, or as in :func:`solve_fde`.
    parameters : mapping, optional
        By name, in place of the model's own values.

    Raises
    ------
    InputError
        As :func:`solve_fde`, and for unknown names.

    Examples
    --------
    >>> import fracid
    >>> rig = fracid.rotary_pendulum("srv02-rotpen", zero="hanging")
    >>> run = simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 0.17}, step=1e-3, end=2.0)
    >>> run.states.shape
    (2001, 4)
    """
    q = model.state_orders(orders) if isinstance(orders, Mapping) else orders
    x0 = _named_states(model, initial) if isinstance(initial, Mapping) else initial
    values = model.parameter_vector(parameters)
    start, slope, q = _initial_and_orders(x0, q, len(model.states))
    steps = _steps(step, end)
    u = np.zeros((1, len(model.inputs))) if inputs is None else _inputs(inputs, steps, len(model.inputs))
    chosen, kept = _method(method, corrections), memory_from_name(memory, tolerance)
    return integrate(
        compile_rhs(model.rhs), q, start, slope, u, values, float(step), steps, chosen, kept,
        corrections=corrections, limit=limit, time_scale=time_scale(model, values), name=method,
    )  # fmt: skip


def _named_states(model: Model, values: Mapping[str, float]) -> FloatArray:
    """The initial state from some states' names; the others are 0."""
    for name in values:
        if name not in model.states:
            raise InputError(f"There is no state {name!r}; {model.name} has {', '.join(map(repr, model.states))}.")
    return np.array([values.get(name, 0.0) for name in model.states], dtype=np.float64)


def time_scale(model: Model, values: FloatArray) -> float:
    """τ₀ of a model [s]: the equations are τ₀^(q−1)·D^q x = f; 1 where it has no such parameter."""
    names = model.parameter_names
    return float(values[names.index("time_scale")]) if "time_scale" in names else 1.0


def integrate(
    rhs: Any,
    orders: FloatArray,
    initial: FloatArray,
    slope: FloatArray,
    inputs: FloatArray,
    parameters: FloatArray,
    step: float,
    steps: int,
    method: Method,
    memory: Memory,
    *,
    corrections: int = 1,
    limit: float = 1e100,
    time_scale: float = 1.0,
    name: str = "",
) -> Trajectory:
    """Run a compiled right-hand side with everything checked already: the core of :func:`solve_fde`."""
    states = np.empty((steps + 1, len(initial)))
    states[0] = initial
    gain = step**orders * time_scale ** (1 - orders)
    kernels = _kernels(memory, method.family, orders, steps)
    last, how = method.run(rhs, initial, slope, gain, inputs, parameters, step, limit, kernels, corrections, states)
    return Trajectory(
        np.arange(last + 1, dtype=np.float64) * step, states[: last + 1], _OUTCOMES[how], step, name, memory.name
    )


def _kernels(memory: Memory, family: str, orders: FloatArray, steps: int) -> Kernels:
    """One kernel per state; states of the same order share its construction."""
    of = {q: memory.kernel(family, q, steps) for q in set(orders.tolist())}
    return stack([of[q] for q in orders.tolist()])


# --- the right-hand side ---------------------------------------------------------------------------


@lru_cache(maxsize=128)
def compile_rhs(rhs: Any) -> Any:
    """Compile a right-hand side once for all runs.

    fracid's own are cached on disk; a user's is compiled anew in each process, since Numba's cache does
    not notice a change in what the function calls.

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
    own = function.__module__.startswith("fracid.") and Path(function.__code__.co_filename).exists()
    try:
        return nb.njit(RHS_SIGNATURE, error_model="numpy", nogil=True, cache=own)(function)
    except nb.core.errors.NumbaError as error:
        raise InputError(
            f"The right-hand side {_name(function)} cannot be compiled by Numba: {_reason(error)} "
            "Use numbers, loops, indexing and NumPy or math functions only, and write into out[i]; "
            "rhs(t, x, u, p, out) gets float64 arrays."
        ) from None


def _check_arity(function: Any) -> None:
    if not callable(function):
        raise InputError(f"The right-hand side must be a function (t, x, u, p, out); got {function!r}.")
    try:
        signature = inspect.signature(function)
        signature.bind(0.0, None, None, None, None)
    except (TypeError, ValueError):
        raise InputError(f"The right-hand side {_name(function)} takes {signature}; "
                         "it must take (t, x, u, p, out).") from None  # fmt: skip


def _probe(rhs: Any, x0: FloatArray, u: FloatArray, p: FloatArray) -> None:
    """Run the function once in Python, where a wrong index is an error and not a crash."""
    function = getattr(rhs, "py_func", rhs)
    _check_arity(function)
    out = np.full(len(x0), np.nan)
    sizes = f"x and out have {len(x0)} entries, u has {len(u)}, p has {len(p)}"
    try:
        with np.errstate(all="ignore"):
            returned = function(0.0, x0.copy(), u.copy(), p.copy(), out)
    except ArithmeticError:
        return  # compiled, it gives inf, and the run's outcome says so
    except (IndexError, ValueError) as error:
        if isinstance(error, ValueError) and "math domain" in str(error):
            return
        raise InputError(
            f"The right-hand side {_name(function)} does not fit its arguments: {error}. Here {sizes}."
        ) from None
    except Exception as error:
        raise InputError(f"The right-hand side {_name(function)} fails at the start: "
                         f"{type(error).__name__}: {error}. Here {sizes}.") from None  # fmt: skip
    if returned is not None:
        raise InputError(f"The right-hand side {_name(function)} returns a value; "
                         "it must write the derivatives into out and return nothing: out[0] = ...")  # fmt: skip
    untouched = np.flatnonzero(np.isnan(out))
    if len(untouched) and np.all(np.isfinite(x0)) and not _computes_nan(function, x0, u, p, untouched):
        raise InputError(f"The right-hand side {_name(function)} leaves out[{untouched[0]}] unwritten; "
                         f"it must fill all {len(x0)} entries of out.")  # fmt: skip


def _computes_nan(function: Any, x0: FloatArray, u: FloatArray, p: FloatArray, where: NDArray[np.intp]) -> bool:
    """Tell an entry that was left alone from one into which NaN was written."""
    out = np.zeros(len(x0))
    with np.errstate(all="ignore"):
        function(0.0, x0.copy(), u.copy(), p.copy(), out)
    return bool(np.any(np.isnan(out[where])))


def _name(function: Any) -> str:
    return getattr(function, "__name__", repr(function))


def _reason(error: Exception) -> str:
    """The lines of Numba's report that a user can act on."""
    lines = [line.strip() for line in str(error).splitlines()]
    telling = [line for line in lines if line and not line.startswith(("Failed in", "During:", "- Resolution"))]
    where = next((line for line in lines if line.startswith("File ")), "")
    return " ".join([*telling[:2], where]).strip().rstrip(":.") + "."


# --- arguments -------------------------------------------------------------------------------------


def _vector(name: str, values: ArrayLike) -> FloatArray:
    try:
        vector = np.array(values, dtype=np.float64, ndmin=1)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {values!r}: expected numbers.") from None
    if not np.all(np.isfinite(vector)):
        raise InputError(f"{name} = {values!r}: every value must be a finite number.")
    return vector


def _initial_and_orders(
    initial: ArrayLike, orders: ArrayLike, states: int | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """x(0), its slope and one order a state."""
    given, q = _vector("initial", initial), _vector("orders", orders)
    if given.ndim > 2 or (given.ndim == 2 and given.shape[1] != 2):
        raise InputError(f"initial has the shape {given.shape}; expected (n_states,), or (n_states, 2) with the "
                         "first derivatives in the second column.")  # fmt: skip
    x0, slope = (given, np.zeros(len(given))) if given.ndim == 1 else np.ascontiguousarray(given.T)
    if states is not None and len(x0) != states:
        raise InputError(f"initial has {len(x0)} states; the model has {states}.")
    if q.ndim != 1 or len(q) not in (1, len(x0)):
        raise InputError(f"orders has the shape {q.shape}, but there are {len(x0)} states; "
                         f"give one order, or {len(x0)}.")  # fmt: skip
    q = np.ascontiguousarray(np.broadcast_to(q, len(x0)))
    for i in np.flatnonzero((q <= 0) | (q >= 2)):
        raise InputError(f"orders[{i}] = {q[i]:g}: an order must lie strictly between 0 and 2.")
    for i in np.flatnonzero((slope != 0) & (q <= 1)):
        raise InputError(f"initial[{i}, 1] = {slope[i]:g}, but a state of order {q[i]:g} has no initial derivative "
                         "(only orders above 1 have); give 0 there.")  # fmt: skip
    return x0, slope, q


def _steps(step: float, end: float) -> int:
    if not (math.isfinite(step) and step > 0):
        raise InputError(f"step = {step!r}: the step must be a positive number of seconds.")
    if not (math.isfinite(end) and end > 0):
        raise InputError(f"end = {end!r}: the end must be a positive number of seconds; runs start at 0.")
    steps = round(end / step)
    if steps < 1 or abs(steps * step - end) > 1e-6 * step * max(1.0, 1e-6 * steps):
        below = max(1, math.floor(end / step))
        raise InputError(f"end = {end:g} is not a whole number of steps of {step:g}; "
                         f"type end={below * step:.12g} or end={(below + 1) * step:.12g}.")  # fmt: skip
    return steps


def _inputs(inputs: ArrayLike | None, steps: int, count: int | None = None) -> FloatArray:
    if inputs is None:
        return np.zeros((1, 0))
    u = _vector("inputs", inputs)
    u = np.ascontiguousarray(u.reshape(len(u), -1))
    if len(u) != steps + 1 or (count is not None and u.shape[1] != count):
        wanted = "n_inputs" if count is None else count
        raise InputError(f"inputs has the shape {u.shape}; expected ({steps + 1}, {wanted}), a row for each of the "
                         f"{steps + 1} grid points 0, step, …, end.")  # fmt: skip
    return u


def _method(name: str, corrections: int) -> Method:
    if name not in METHODS:
        raise InputError(f"There is no method {name!r}; type one of {', '.join(METHODS)}.")
    if not (isinstance(corrections, int | np.integer) and corrections >= 1):
        raise InputError(f"corrections = {corrections!r}: give a whole number of at least 1.")
    return METHODS[name]
