"""Simulate systems of fractional order: D^q x = f(t, x, u, p), Caputo, each state its own order.

:func:`solve_fde` takes any right-hand side, a plain Python function in Numba's language,

    def rhs(t, x, u, p, out):      # time, states, inputs, parameters; all float64
        out[0] = x[1]              # D^q_0 x_0 = ...
        out[1] = -p[0] * x[0]

and :func:`simulate` a named :class:`~fracid.models.Model`; :mod:`fracid.solver.batch` has many runs at once and their
derivatives, :mod:`fracid.solver.reduction` equations of several terms.  A run that diverges or meets a singular
right-hand side is not an error: its :attr:`Trajectory.outcome` says so, its :attr:`Trajectory.fault` why, and the
trajectory ends there.

By which method, :data:`fracid.solver.methods.METHODS` says, with the order of each and what it is for.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.solver.arguments import (
    check_bounds,
    check_history,
    check_initial_and_orders,
    check_inputs,
    check_times,
    count_steps,
    find_method,
    named_states,
)
from fracid.solver.history import Kernels, forget_mode, stack
from fracid.solver.memory import Memory, memory_from_name
from fracid.solver.methods import Method
from fracid.solver.right_hand_side import RightHandSide, compile_rhs, name_of, probe
from fracid.solver.stiffness import fault_of
from fracid.solver.trajectory import Outcome, Trajectory, vector

if TYPE_CHECKING:
    from fracid.models import Model

__all__ = ["PaperSchemeWarning", "simulate", "solve_fde"]


class PaperSchemeWarning(UserWarning):
    """A method that sums raw x, ``gl-paper``, is asked for where it does not converge."""


_OUTCOMES = (Outcome.COMPLETED, Outcome.DIVERGED, Outcome.NOT_FINITE, Outcome.LEFT)  # by the loops' codes


def solve_fde(
    rhs: RightHandSide,
    orders: ArrayLike,
    initial: ArrayLike,
    *,
    step: float,
    end: float,
    start: float = 0.0,
    inputs: ArrayLike | None = None,
    parameters: ArrayLike = (),
    method: str = "pi2",
    memory: str | Memory = "compressed",
    tolerance: float = 1e-10,
    corrections: int = 1,
    corrected: bool = True,
    history: ArrayLike | None = None,
    every: int = 1,
    times: ArrayLike | None = None,
    bounds: ArrayLike | None = None,
    limit: float = 1e100,
) -> Trajectory:
    """Solve D^q x = f(t, x, u, p), in the sense of Caputo (14).

    Parameters
    ----------
    rhs : function (t, x, u, p, out) -> None
        Plain Python in Numba's language; writes D^q_i x_i into ``out[i]``.  Division by zero gives inf.
    orders : float or array_like, shape (n_states,)
        Strictly between 0 and 2; a scalar holds for all states.
    initial : array_like, shape (n_states,) or (n_states, 2)
        x(start), and in the second column the first derivatives where an order exceeds 1.
    step, end : float
        h and the last time [s].  Where `end` is not a whole number of steps away, the step is shortened so
        that it is, with a :class:`StepWarning`; :attr:`Trajectory.step` is the one used.
    start : float
        The first time [s].
    inputs : array_like, shape (n + 1,) or (n + 1, n_inputs), optional
        u on the grid start, start + h, …, end; with a `history`, from its first sample on.
    parameters : array_like, shape (n_parameters,)
        Given to `rhs` as ``p``.
    method : key of :data:`fracid.solver.methods.METHODS`
    memory : ``"compressed"``, ``"full"``, ``"short(L)"`` or a :class:`~fracid.solver.memory.Memory`
    tolerance : float
        Of the compressed memory: relative error of each weight.
    corrections : int
        Corrector sweeps of ``pi2``; each costs one evaluation of `rhs` a step.
    corrected : bool
        Whether ``pi2`` corrects for a solution that begins like t^q (:mod:`fracid.solver.starting`).
    history : array_like, shape (n_past, n_states), optional
        The states at start − n_past h, …, start − h: the memory begins with the first of them, before which
        the system stood still (`initial`'s derivatives belong there too).  The end of one run continues so in another.
    every : int
        Store every so many samples only.
    times : array_like, shape (n_times,), optional
        Give the states at these times (:meth:`Trajectory.at`) in place of the grid.
    bounds : array_like, shape (n_states, 2), optional
        Lowest and highest value of each state (±inf for none); the run ends with the first sample outside.
    limit : float
        A state beyond ±limit ends the run as diverged.

    Returns
    -------
    Trajectory
        Up to the end, or up to the last good sample; see its ``outcome``.

    Raises
    ------
    InputError
        For orders outside (0, 2), shapes that do not fit, a step that is not positive, an end that is not
        after the start, values that are not finite, or a right-hand side that is not of the form above, or
        fails, or reads or writes where there is nothing.

    Examples
    --------
    D^0.8 y = −y, y(0) = 1, is the Mittag-Leffler function E_0.8(−t^0.8); at t = 1 it is 0.386948578…

    >>> def decay(t, x, u, p, out):
    ...     out[0] = -p[0] * x[0]
    >>> run = solve_fde(decay, 0.8, [1.0], step=1e-3, end=1.0, parameters=[1.0])
    >>> run.outcome.value, round(float(run.states[-1, 0]), 7)
    ('completed', 0.3869486)

    Its second half, with the first half for a history:

    >>> half = run.states[:501]
    >>> on = solve_fde(decay, 0.8, half[-1], history=half[:-1], step=1e-3, start=0.5, end=1.0, parameters=[1.0])
    >>> bool(abs(on.states - run.states[500:]).max() < 1e-14)
    True
    """
    return _solve(
        rhs, orders, initial, step=step, end=end, start=start, inputs=inputs, parameters=parameters, method=method,
        memory=memory, tolerance=tolerance, corrections=corrections, corrected=corrected, history=history, every=every,
        times=times, bounds=bounds, limit=limit,
    )  # fmt: skip


def simulate(
    model: Model,
    *,
    orders: Mapping[str, float] | ArrayLike,
    initial: Mapping[str, float] | ArrayLike,
    step: float,
    end: float,
    parameters: Mapping[str, float] | None = None,
    inputs: ArrayLike | None = None,
    bounds: Mapping[str, tuple[float, float]] | ArrayLike | None = None,
    **options: Any,
) -> Trajectory:
    """Simulate a named model; see :func:`solve_fde` for what is not said here.

    Parameters
    ----------
    model : Model
        For example ``fracid.rotary_pendulum()``.
    orders : mapping or array_like
        By name, ``{"lambda": 0.86, "mu": 0.91}``, or one per state.
    initial : mapping or array_like
        States at the start by name (those left out are 0), ``{"alpha": 0.17}``, or as in :func:`solve_fde`.
    parameters : mapping, optional
        By name, in place of the model's own values.
    bounds : mapping or array_like, optional
        By name, ``{"alpha": (-1.5, 1.5)}``, or as in :func:`solve_fde`.
    **options
        The other arguments of :func:`solve_fde`: start, method, memory, history, every, times, …

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
    if not hasattr(model, "parameter_vector"):
        raise InputError(f"model = {model!r}: expected a model, for example fracid.rotary_pendulum('srv02-rotpen').")
    values = model.parameter_vector(parameters)
    if inputs is None:
        inputs = np.zeros((1, len(model.inputs)))
    return _solve(
        model.rhs,
        model.state_orders(orders) if isinstance(orders, Mapping) else orders,
        named_states(model, initial, 0.0) if isinstance(initial, Mapping) else initial,
        step=step, end=end, inputs=inputs, parameters=values, time_scale=time_scale(model, values),
        bounds=named_states(model, bounds, (-np.inf, np.inf)) if isinstance(bounds, Mapping) else bounds,
        size=(len(model.states), len(model.inputs)), **options,
    )  # fmt: skip


def time_scale(model: Model, values: FloatArray) -> float:
    """τ₀ of a model [s]: the equations are τ₀^(q−1)·D^q x = f; 1 where it has no such parameter."""
    names = model.parameter_names
    return float(values[names.index("time_scale")]) if "time_scale" in names else 1.0


def _solve(
    rhs: RightHandSide,
    orders: ArrayLike,
    initial: ArrayLike,
    *,
    step: float,
    end: float,
    start: float = 0.0,
    inputs: ArrayLike | None = None,
    parameters: ArrayLike = (),
    method: str = "pi2",
    memory: str | Memory = "compressed",
    tolerance: float = 1e-10,
    corrections: int = 1,
    corrected: bool = True,
    history: ArrayLike | None = None,
    every: int = 1,
    times: ArrayLike | None = None,
    bounds: ArrayLike | None = None,
    limit: float = 1e100,
    time_scale: float = 1.0,
    size: tuple[int, int] | None = None,
) -> Trajectory:
    """Check everything, then run."""
    states, n_inputs = size or (None, None)
    x0, slope, q = check_initial_and_orders(initial, orders, states)
    past = check_history(history, x0)
    exact = history is not None or (inputs is not None and len(np.atleast_1d(inputs)) > 1)
    h, steps = count_steps(step, start, end, exact)
    u = check_inputs(inputs, len(past) + steps, n_inputs)
    p = vector("parameters", parameters)
    box, wanted = check_bounds(bounds, x0), check_times(times, start, end)
    for name, value in (("tolerance", tolerance), ("limit", limit)):
        if np.ndim(value) or np.asarray(value).dtype.kind not in "fiu" or not value > 0:
            raise InputError(f"{name} = {value!r}: expected a number above 0.")
    chosen, kept = find_method(method, corrections), memory_from_name(memory, tolerance)
    if not (isinstance(every, int | np.integer) and every >= 1):
        raise InputError(f"every = {every!r}: give a whole number of at least 1.")
    probe(rhs, x0, u[0], p)
    if chosen.raw and np.any(x0 != 0):
        warnings.warn(f"{method} sums raw x (21)-(24), which is right only for x(0) = 0; here it is not, and the "
                      "result does not converge. Type method='pi2' for the Caputo solution.",
                      PaperSchemeWarning, stacklevel=3)  # fmt: skip
    trajectory = integrate(
        compile_rhs(rhs), q, x0, slope, u, p, h, steps, chosen, kept, corrections=corrections, corrected=corrected,
        limit=limit, name=method, start=start, history=past, every=every, bounds=box, time_scale=time_scale,
    )  # fmt: skip
    trajectory = replace(trajectory, fault=fault_of(trajectory, compile_rhs(rhs), h**q * time_scale ** (1 - q), u, p))
    if wanted is None:
        return trajectory
    within = wanted[wanted <= trajectory.time[-1] + 1e-9 * h]
    return replace(trajectory, time=within, states=trajectory.at(within))


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
    corrected: bool = True,
    limit: float = 1e100,
    time_scale: float = 1.0,
    name: str = "",
    start: float = 0.0,
    history: FloatArray | None = None,
    every: int = 1,
    bounds: FloatArray | None = None,
) -> Trajectory:
    """Run a compiled right-hand side with everything checked already: the core of :func:`solve_fde`."""
    past = initial[None] if history is None else np.vstack([history, initial])
    states = _room(steps, every, len(initial))
    states[0] = initial
    gain = step**orders * time_scale ** (1 - orders)
    kernels = _kernels(memory, method.family, orders, steps + len(past) - 1)
    box = np.tile((-np.inf, np.inf), (len(initial), 1)) if bounds is None else bounds
    try:
        last, how = method.run(rhs, orders, past, slope, gain, inputs, parameters, start, step, steps, every, limit,
                               box, kernels, corrections, corrected, states)  # fmt: skip
    except Exception as error:
        forget_mode()
        raise InputError(f"The right-hand side {name_of(rhs)} fails on the way: {type(error).__name__}: {error}. "
                         f"Here x and out have {len(initial)} entries, u has {inputs.shape[1]}, "
                         f"p has {len(parameters)}.") from None  # fmt: skip
    kept = max(0, last) // every + 1
    return Trajectory(
        start + np.arange(kept, dtype=np.float64) * (step * every), states[:kept], _OUTCOMES[how], step, name,
        memory.name, orders, start - step * (len(past) - 1),
    )  # fmt: skip


def _room(steps: int, every: int, states: int) -> FloatArray:
    """For what is stored."""
    try:
        return np.empty((steps // every + 1, states))
    except (MemoryError, ValueError):
        raise InputError(f"{steps:.3g} steps of {states} states are more than there is memory for. Give a longer step, "
                         "or store every so many only: every=1000.") from None  # fmt: skip


def _kernels(memory: Memory, family: str, orders: FloatArray, steps: int) -> Kernels:
    """One kernel per state; states of the same order share its construction."""
    of = {q: memory.kernel(family, q, steps) for q in set(orders.tolist())}
    return stack([of[q] for q in orders.tolist()])
