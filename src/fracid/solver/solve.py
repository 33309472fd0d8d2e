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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from fracid.arrays import FloatArray
from fracid.errors import InputError, at_least, refuse_unknown
from fracid.solver.arguments import (
    Equation,
    InitialCondition,
    Options,
    Relaxations,
    check_above_0,
    check_bounds,
    check_driven,
    check_history,
    check_initial_and_orders,
    check_relaxing,
    check_times,
    count_steps,
    warn_caller,
)
from fracid.solver.compilation import address_of
from fracid.solver.history import Kernels, forget_mode, stack
from fracid.solver.inputs import Driven
from fracid.solver.loop_arguments import Run
from fracid.solver.memory import Memory, memory_from_name
from fracid.solver.methods import METHODS, Method
from fracid.solver.right_hand_side import RightHandSide, compile_rhs, name_of, probe
from fracid.solver.stiffness import fault_of, grows_by_itself, step_gain
from fracid.solver.trajectory import SAYS, Outcome, Trajectory, vector
from fracid.solver.weights import Kernel, relaxing_kernel

if TYPE_CHECKING:
    from fracid.models import Model


class PaperSchemeWarning(UserWarning):
    """A method that sums raw x, ``gl-paper``, is asked for where it does not converge."""


LARGEST = float(np.finfo(np.float64).max)
"""No limit is larger, so that a state within it is a number."""


def solve_fde(
    rhs: RightHandSide,
    orders: ArrayLike,
    initial: ArrayLike,
    *,
    step: float,
    end: float,
    start: float = 0.0,
    inputs: ArrayLike | Driven | None = None,
    between: str = "line",
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
    relaxing: Sequence[int] = (),
    model: Model | None = None,
) -> Trajectory:
    """Solve D^q x = f(t, x, u, p), in the sense of Caputo (14).

    Parameters
    ----------
    rhs : function (t, x, u, p, out) -> None
        Plain Python in Numba's language; writes D^q_i x_i into ``out[i]``.  Division by zero gives inf.
    orders : float or array_like, shape (n_states,)
        Strictly between 0 and 2; a scalar holds for all states.
    initial : array_like, shape (n_states,) or (n_states, 2)
        x(start), and in the second column the first derivatives where an order exceeds 1.  Without it these are taken
        as 0, and an :class:`AtRestWarning` says so.
    step, end : float
        h and the last time [s].  Where `end` is not a whole number of steps away, the step is shortened so
        that it is, with a :class:`StepWarning`; :attr:`Trajectory.step` is the one used.
    start : float
        The first time [s].
    inputs : array_like, shape (n + 1,) or (n + 1, n_inputs), optional
        u on the grid start, start + h, …, end; with a `history`, from its first sample on.  A
        :class:`~fracid.solver.inputs.Driven` has it before and after each of these.
    between : ``"line"``, ``"hold"`` or ``"band-limited"``
        What the inputs do between the grid points: :mod:`fracid.solver.inputs`.
    parameters : array_like, shape (n_parameters,)
        Given to `rhs` as ``p``.
    method : key of :data:`fracid.solver.methods.METHODS`
        ``pi2``, of second order; ``pi3``, of third for a smooth f; ``bdf2`` and ``pi2-implicit`` for stiff systems;
        ``gl``, ``gl-sequential`` and ``gl-paper``, of first order.
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
    relaxing : sequence of int
        States of order 1 whose f is c − a x, however large a is, as of a presliding joint: there `out` is twice as
        long, and `rhs` writes a of state i into ``out[n_states + i]`` (:mod:`fracid.solver.schemes`).
    model : Model, optional
        The one that `rhs` is of, whose states and inputs are counted and whose time scale holds; :func:`simulate`
        gives it.

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
    states, n_inputs = (len(model.states), len(model.inputs)) if model else (None, None)
    x0, slope, q = check_initial_and_orders(initial, orders, states)
    past = check_history(history, x0)
    samples = inputs.before if isinstance(inputs, Driven) else inputs
    exact = history is not None or (samples is not None and len(vector("inputs", samples)) > 1)
    h, steps = count_steps(step, start, end, exact)
    u, after = check_driven(inputs, between, len(past) + steps, n_inputs)
    p, instants = vector("parameters", parameters), check_times(times, start, end)
    check_above_0("tolerance", tolerance)
    check_above_0("limit", limit)
    options = Options(method, memory_from_name(memory, tolerance), at_least("corrections", corrections, 1), corrected,
                      every=at_least("every", every, 1), limit=limit, bounds=check_bounds(bounds, x0))  # fmt: skip
    relaxing = check_relaxing(relaxing, q)
    probe(rhs, x0, u[0], p, relaxing=bool(relaxing))
    if METHODS[method].raw and np.any(x0 != 0):
        warn_caller(SAYS("raw-sums", options=options), PaperSchemeWarning)
    equation = Equation(compile_rhs(rhs), q, u, p, time_scale=time_scale(model, p) if model else 1.0, relaxing=relaxing,
                        after=after)  # fmt: skip
    run = integrate(equation, InitialCondition(x0, slope, start, past), h, steps, options=options)
    run = replace(run, fault=fault_of(run, equation.rhs, step_gain(h, q, equation.time_scale), u, parameters=p))
    if run.completed and grows_by_itself(run):
        run = replace(run, outcome=Outcome.UNSTABLE)
    if instants is None:
        return run
    within = instants[instants <= run.time[-1] + 1e-9 * h]
    return replace(run, time=within, states=run.at(within))


def simulate(
    model: Model,
    *,
    orders: Mapping[str, float] | ArrayLike | None = None,
    initial: Mapping[str, float] | ArrayLike,
    step: float,
    end: float,
    parameters: Mapping[str, float] | None = None,
    inputs: ArrayLike | Driven | None = None,
    bounds: Mapping[str, tuple[float, float]] | ArrayLike | None = None,
    **options: Any,
) -> Trajectory:
    """Simulate a named model; see :func:`solve_fde` for what is not said here.

    Parameters
    ----------
    model : Model
        For example ``fracid.rotary_pendulum()``.
    orders : mapping or array_like, optional
        By name, ``{"lambda": 0.86, "mu": 0.91}``, or one per state.  An order that is left out is the model's integer.
    initial : mapping or array_like
        States at the start by name, or by an output's (those left out are 0), ``{"alpha": 0.17}``, or as in
        :func:`solve_fde`.
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
    >>> other = simulate(rig, orders={"mu": 1.0}, initial={"alpha": 0.17}, step=1e-3, end=2.0)
    >>> bool((other.states == run.states).all())
    True
    """
    if not hasattr(model, "parameter_vector"):
        raise InputError(f"model = {model!r}: expected a model, for example fracid.rotary_pendulum('srv02-rotpen').")
    model = model.with_parameters(**(parameters or {}))
    values = model.parameter_vector()
    if orders is None or isinstance(orders, Mapping):
        orders = _with_integer_orders(model, orders or {})
    if inputs is None:
        inputs = np.zeros((1, len(model.inputs)))
    if isinstance(bounds, Mapping):
        refuse_unknown(f"{model.name} state", model.states, *bounds)
        bounds = [bounds.get(n, (-np.inf, np.inf)) for n in model.states]
    return solve_fde(
        model.rhs,
        model.state_orders(orders, values) if isinstance(orders, Mapping) else orders,
        model.state_vector(initial) if isinstance(initial, Mapping) else initial,
        step=step, end=end, inputs=inputs, parameters=values, bounds=bounds,
        relaxing=model.relaxing_states, model=model, **options,
    )  # fmt: skip


def _with_integer_orders(model: Model, given: Mapping[str, float]) -> dict[str, float]:
    """Those given, and every other order at its integer value."""
    named = {model.order_called(name) for name in given}
    others = {n: model.solved_at(n, None) for n in model.order_names if n not in named}
    if without := [n for n, q in others.items() if q is None]:
        raise InputError(SAYS("no-orders", without=' and '.join(without),
                              typed=', '.join(f'{n!r}: 0.5' for n in without)))  # fmt: skip
    return {n: q for n, q in others.items() if q is not None} | dict(given)


def time_scale(model: Model, values: FloatArray) -> float:
    """τ₀ of a model [s]: the equations are τ₀^(q−1)·D^q x = f; 1 where it has no such parameter."""
    names = model.parameter_names
    return float(values[names.index("time_scale")]) if "time_scale" in names else 1.0


def integrate(
    equation: Equation, initial: InitialCondition, step: float, steps: int, options: Options,
    loop: Callable[[Any, Run, FloatArray], tuple[int, int]] | None = None,
) -> Trajectory:  # fmt: skip
    """Run a compiled right-hand side with everything checked already: the core of :func:`solve_fde`.

    By the loop of its method, or another that takes the same.
    """
    method = METHODS[options.method]
    posed = equation, initial
    run = _run(posed, step, steps, options)
    out = _room(steps, options.every, len(initial.values))
    out[0] = initial.values
    try:
        last, how = (loop or method.run)(address_of(equation.rhs), run, out)
    except Exception as error:
        forget_mode()
        raise InputError(SAYS("fails", name=name_of(equation.rhs), error=error, of=equation)) from None
    count = max(0, last) // options.every + 1
    return _trajectory(out[:count], how, posed, step, options)


Posed = tuple[Equation, InitialCondition]


def integrate_all(
    posed: Sequence[Posed], step: float, steps: int, options: Options, wanted: Sequence[int]
) -> dict[int, Trajectory]:
    """Run a right-hand side with several orders, parameters and initial states, of those `wanted`, by number.

    Together where that can be: by ``pi2``, with the same inputs for all, and no history (:mod:`fracid.solver.lanes`).
    """
    found = dict[int, Trajectory]()
    for first in range(0, len(posed), RUNS):
        few = posed[first : first + RUNS]
        numbers = range(first, first + len(few))
        if len(few) >= FEW and {*numbers} & {*wanted} and go_together(posed[0][0].rhs, options.method):
            found |= zip(numbers, _together(few, step, steps, options=options) or (), strict=False)
    return {k: found.get(k) or integrate(*posed[k], step, steps, options=options) for k in wanted}


FEW, RUNS = 3, 8
"""Fewer runs than so many go one by one; as many are asked for at once."""

MOST = 1 << 28
"""Bytes of what runs that go together give, at most."""


def go_together(rhs: RightHandSide, method: str) -> bool:
    """Tell whether runs of a right-hand side can go together."""
    from fracid.solver import lanes

    return method == "pi2" and lanes.for_lanes(getattr(rhs, "py_func", rhs)) is not None


def _together(posed: Sequence[Posed], step: float, steps: int, options: Options) -> list[Trajectory] | None:
    (one, first), *_ = posed
    alike = all(e.rhs is one.rhs and e.inputs is one.inputs and e.after is one.after for e, _ in posed)
    known = any(len(i.known) > 1 or i.time != first.time for _, i in posed)
    if not alike or known or RUNS * 8 * steps // options.every * len(first.values) > MOST:
        return None
    from fracid.solver import lanes

    addresses, states = (address_of(lanes.for_lanes(one.rhs.py_func)), address_of(one.rhs)), list[FloatArray]()
    for k in range(0, len(posed), lanes.COUNT):
        few = [*posed[k : k + lanes.COUNT]]
        few += few[-1:] * (lanes.COUNT - len(few))  # the last again in lanes left over
        orders = np.stack([e.orders for e, _ in few], axis=-1).ravel()
        own = {lanes.COUNT * i + lane: kernel for lane, (e, _) in enumerate(few) for i, kernel in _own(e, step).items()}
        kernels = _kernels(options.memory, METHODS["pi2"].family, orders, steps, own=own)
        runs = [_run(each, step, steps, options, kernels) for each in few]
        found = lanes.run_together(addresses, runs)
        if found is None:
            return None
        states += list(found)
    return [_trajectory(x, 0, each, step, options) for x, each in zip(states, posed, strict=False)]


def _run(posed: Posed, step: float, steps: int, options: Options, kernels: Kernels | None = None) -> Run:
    """A run as the loops take it, with its own kernels where none are given."""
    (equation, initial), method = posed, METHODS[options.method]
    past, states = initial.known, len(initial.values)
    inputs, after = _at_jumps(equation, method)
    if kernels is None:
        length = steps + len(past) - 1
        kernels = _kernels(options.memory, method.family, equation.orders, length, own=_own(equation, step))
    return Run(
        orders=equation.orders, gain=step_gain(step, equation.orders, equation.time_scale),
        u=inputs, p=equation.parameters, past=past,
        slope=np.zeros(states) if initial.slope is None else initial.slope,
        start=float(initial.time), h=float(step), steps=int(steps), every=int(options.every),
        limit=min(float(options.limit), LARGEST),
        bounds=np.tile((-np.inf, np.inf), (states, 1)) if options.bounds is None else options.bounds,
        kernels=kernels, corrections=int(options.corrections), corrected=bool(options.corrected),
        relaxing=np.array(equation.relaxing, dtype=np.int64),
        fading=np.array([_row(f, step) for f in equation.fading]) if equation.fading else np.zeros((0, 2)),
        after=after,
    )  # fmt: skip


def _trajectory(states: FloatArray, how: int, posed: Posed, step: float, options: Options) -> Trajectory:
    """What a loop has stored, from the start on."""
    equation, initial = posed
    time = initial.time + np.arange(len(states), dtype=np.float64) * (step * options.every)
    return Trajectory(
        time, states, list(Outcome)[how], step, method=options.method, memory=options.memory.name,
        orders=equation.orders, origin=initial.time - step * (len(initial.known) - 1),
    )  # fmt: skip


def _at_jumps(equation: Equation, method: Method) -> tuple[FloatArray, FloatArray]:
    """The inputs as a method takes them: just before each grid point, and just after it where they jump."""
    before, after, none = equation.inputs, equation.after, np.empty((0, equation.inputs.shape[1]))
    if after is None:
        return before, none
    if method.at_a_jump == "both":
        return before, after
    return after if method.at_a_jump == "after" else (before + after) / 2, none


def _room(steps: int, every: int, states: int) -> FloatArray:
    """For what is stored."""
    try:
        return np.empty((steps // every + 1, states))
    except (MemoryError, ValueError):
        raise InputError(SAYS("memory", steps=steps, states=states)) from None


def _own(equation: Equation, step: float) -> dict[int, Kernel]:
    """The kernels of states with a finite memory."""
    return {f.state: relaxing_kernel(f.shares, tuple(step / τ for τ in f.times)) for f in equation.fading}


def _row(f: Relaxations, step: float) -> list[float]:
    of_each = zip(f.shares[1:], (step / τ for τ in f.times), f.held, strict=True)
    return [f.state, f.shares[0], *chain.from_iterable(of_each)]


def _kernels(memory: Memory, family: str, orders: FloatArray, steps: int, own: Mapping[int, Kernel]) -> Kernels:
    """One kernel per state, its own if it has one; states of the same order share its construction."""
    of = {q: memory.kernel(family, q, steps) for q in set(orders.tolist())}
    return stack(*(own.get(i, of[q]) for i, q in enumerate(orders.tolist())))
