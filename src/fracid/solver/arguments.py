"""The arguments of a simulation: their checks, and the records that a checked run is made of.

Each ``check_…`` looks at one or two of what :func:`fracid.solve_fde` is given and returns the arrays that the loops
take, or raises :class:`~fracid.errors.InputError` with the value, what was expected and what to type.  What is checked
goes on as three records, grouped by who sets them:

==========================  ==========================================================================================
:class:`Equation`           τ₀^(q−1)·D^q x = f(t, x, u, p), with its inputs and parameters: the model's
:class:`InitialCondition`   x(start), ẋ(start) and the samples before: the recording's
:class:`Options`            method, memory and where a run ends: the user's, the same for all runs of a fit
==========================  ==========================================================================================
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fracid.arrays import FloatArray, real_array
from fracid.errors import InputError, brief, unknown_name
from fracid.solver.inputs import BETWEEN, Driven, between_samples
from fracid.solver.memory import Memory
from fracid.solver.methods import METHODS
from fracid.solver.trajectory import SAYS, refuse_masked, vector

MOST_STEPS = 1e15
"""Whole numbers beyond it are no exact floats, and a year of computing."""


class StepWarning(UserWarning):
    """The step was shortened so that the end is a whole number of them."""


class AtRestWarning(UserWarning):
    """A state of order above 1 was given one initial value, so its first derivative is taken as 0."""


@dataclass(frozen=True)
class Relaxations:
    r"""A finite memory in the place of an order: :math:`x = x_0 + \int k f + \sum_j a_j z_j (e^{-t/τ_j} - 1)`.

    With :math:`k(t) = a_0 + \sum_j a_j e^{-t/τ_j}`.
    """

    state: int
    shares: tuple[float, ...]
    """a_0 … a_n."""
    times: tuple[float, ...]
    """τ_1 … τ_n [s]."""
    held: tuple[float, ...]
    """z_1 … z_n, what each holds at the start."""


@dataclass(frozen=True)
class Equation:
    """A system τ₀^(q−1)·D^q x = f(t, x, u, p) with all that it depends on."""

    rhs: Any
    """f, compiled: rhs(t, x, u, p, out)."""
    orders: FloatArray
    """q, the order of each state, shape (n_states,)."""
    inputs: FloatArray
    """u on the grid from the first known sample on, shape (n_samples, n_inputs), or one row for all."""
    parameters: FloatArray
    """p, shape (n_parameters,)."""
    time_scale: float = 1.0
    """τ₀ [s], which keeps the units of f where an order is not 1."""
    relaxing: tuple[int, ...] = ()
    """States of order 1 with f = c − a x; ``rhs`` writes a behind f, at ``out[n_states + i]``, where there is room."""
    after: FloatArray | None = None
    """u just after each grid point where it jumps, `inputs` being just before it, of their shape; None for no jumps."""
    fading: tuple[Relaxations, ...] = ()
    """Of states of order 1 whose memory is finite; ``pi2`` alone runs them."""


@dataclass(frozen=True)
class InitialCondition:
    """What is known before a run begins."""

    values: FloatArray
    """x(start), shape (n_states,)."""
    slope: FloatArray | None = None
    """ẋ at the first known sample, for orders above 1, shape (n_states,); None for zero."""
    time: float = 0.0
    """The start [s]."""
    history: FloatArray | None = None
    """States at start − n_past h, …, start − h, shape (n_past, n_states); None for none."""

    @property
    def known(self) -> FloatArray:
        """All states that are known, one row a step, the last at the start: shape (n_past + 1, n_states)."""
        return self.values[None] if self.history is None else np.vstack([self.history, self.values])


@dataclass(frozen=True)
class Options:
    """How a run is solved, what is stored, and where it ends.

    Raises
    ------
    InputError
        For an unknown method.
    """

    method: str
    """Key of :data:`~fracid.solver.methods.METHODS`."""
    memory: Memory
    """How the history is summed."""
    corrections: int = 1
    """Corrector sweeps of ``pi2`` and ``pi3``."""
    corrected: bool = True
    """Whether ``pi2`` and ``pi3`` correct for a solution that begins like t^q."""
    every: int = 1
    """Every so many samples one is stored."""
    limit: float = 1e100
    """A state beyond ±limit ends the run as diverged."""
    bounds: FloatArray | None = None
    """Lowest and highest value of each state, shape (n_states, 2); the run ends with the first sample outside."""

    def __post_init__(self) -> None:
        """Refuse a method that is none; numbers are checked by `solve_fde`, since a fit makes these at each run."""
        if self.method not in METHODS:
            raise InputError(f"There is no method {self.method!r}; type one of {', '.join(METHODS)}.")


# --- arguments -------------------------------------------------------------------------------------


def warn_caller(sentence: str, kind: type[Warning]) -> None:
    """Warn where the caller of fracid's functions stands, however many of these are between."""
    level, frame = 1, sys._getframe()
    while frame.f_back and str(frame.f_globals.get("__name__")).startswith("fracid."):
        level, frame = level + 1, frame.f_back
    warnings.warn(sentence, kind, stacklevel=level)


def check_relaxing(relaxing: Sequence[int], orders: FloatArray) -> tuple[int, ...]:
    """States of order 1, by their index."""
    for i in relaxing:
        if not isinstance(i, int | np.integer) or not 0 <= i < len(orders) or orders[i] != 1.0:
            raise InputError(SAYS("relaxing", relaxing=tuple(relaxing), i=i, last=len(orders) - 1))
    return tuple(int(i) for i in relaxing)


def check_initial_and_orders(
    initial: ArrayLike, orders: ArrayLike, states: int | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """x(0), its slope and one order a state."""
    values, q = vector("initial", initial), vector("orders", orders)
    if values.ndim > 2 or (values.ndim == 2 and values.shape[1] != 2):
        raise InputError(SAYS("initial-shape", values=values))
    x0, slope = (values, np.zeros(len(values))) if values.ndim == 1 else np.ascontiguousarray(values.T)
    if states is not None and len(x0) != states:
        raise InputError(f"initial has {len(x0)} states; the model has {states}.")
    if q.ndim != 1 or len(q) not in (1, len(x0)):
        raise InputError(SAYS("orders-shape", q=q, states=len(x0), s="s" * (len(x0) > 1)))
    q = np.array(np.broadcast_to(q, len(x0)))
    for i in np.flatnonzero((q <= 0) | (q >= 2)):
        raise InputError(f"orders[{i}] = {q[i]:g}: an order must lie strictly between 0 and 2.")
    for i in np.flatnonzero((slope != 0) & (q <= 1)):
        raise InputError(SAYS("slope-below-1", i=i, slope=slope[i], order=q[i]))
    above = np.flatnonzero(q > 1)
    if states is None and values.ndim == 1 and above.size:
        i = above[0]
        pairs = ", ".join(f"[{x:g}, 0]" for x in x0[:3]) + ", …" * (len(x0) > 3)
        warn_caller(SAYS("at-rest", i=i, order=q[i], pairs=pairs), AtRestWarning)
    return x0, slope, q


def count_steps(step: float, start: float, end: float, exact: bool) -> tuple[float, int]:
    """The step and how many of them; `exact` where samples are given, which fix it."""
    step, start, end = (_number(name, value, "a number of seconds")
                        for name, value in (("step", step), ("start", start), ("end", end)))  # fmt: skip
    if not (math.isfinite(step) and step > 0):
        raise InputError(f"step = {step!r}: the step must be a positive number of seconds.")
    if not math.isfinite(start):
        raise InputError(f"start = {start!r}: the start must be a finite number of seconds.")
    if not (math.isfinite(end) and end > start):
        raise InputError(f"end = {end!r}: the end must be a number of seconds after the start, {start:g}.")
    duration = end - start
    if not duration / step < MOST_STEPS:
        raise InputError(SAYS("too-many-steps", step=step, start=start, end=end, steps=duration / step))
    steps = max(1, round(duration / step))
    if abs(steps * step - duration) <= 1e-6 * step * max(1.0, 1e-6 * steps):
        return step, steps
    if exact:
        below = max(1, math.floor(duration / step))
        raise InputError(SAYS("not-whole-steps", end=end, step=step, before=start + below * step,
                              after=start + (below + 1) * step))  # fmt: skip
    steps = math.ceil(duration / step)
    shortened = duration / steps
    warn_caller(SAYS("shortened", end=end, step=step, shortened=shortened), StepWarning)
    return shortened, steps


def _number(name: str, value: Any, expected: str) -> float:
    """A plain number, of an array without dimensions too."""
    number = real_array(value, fault := f"{name} = {brief(value)}: expected {expected}.")
    if number.ndim or isinstance(value, bool | np.bool_):
        raise InputError(fault)
    return float(number)


def check_history(history: ArrayLike | None, x0: FloatArray) -> FloatArray:
    """Known samples before the start, none of them where there is no history."""
    if history is None:
        return np.empty((0, len(x0)))
    past = vector("history", history)
    past = past.reshape(-1, 1) if past.ndim == 1 and len(x0) == 1 else past
    if past.ndim != 2 or past.shape[1] != len(x0):
        raise InputError(SAYS("history-shape", past=past, states=len(x0)))
    return past


def check_bounds(bounds: ArrayLike | None, x0: FloatArray) -> FloatArray | None:
    """Lowest and highest value of each state, shape (n_states, 2); None for no bounds."""
    if bounds is None:
        return None
    refuse_masked("bounds", bounds)
    box = real_array(bounds, "bounds = {}: expected pairs of numbers (±inf for none).")
    if box.shape != (len(x0), 2) or np.any(np.isnan(box)):
        raise InputError(SAYS("bounds-shape", box=box, states=len(x0)))
    for i in np.flatnonzero(~((box[:, 0] <= x0) & (x0 <= box[:, 1]))):
        raise InputError(SAYS("bounds-range", i=i, lowest=box[i, 0], highest=box[i, 1], start=x0[i]))
    return box


def check_times(times: ArrayLike | None, start: float, end: float) -> FloatArray | None:
    """Times to be read, ascending, between start and end [s]; None for the grid."""
    if times is None:
        return None
    instants = vector("times", times)
    if instants.ndim != 1 or not instants.size or np.any(np.diff(instants) < 0):
        raise InputError("times must be a list of times in ascending order.")
    slack = 1e-9 * max(abs(start), abs(end))
    for t in instants[(instants < start - slack) | (instants > end + slack)]:
        raise InputError(f"times: {t:g} is not between start = {start:g} and end = {end:g}.")
    return instants.clip(start, end)


def check_inputs(inputs: ArrayLike | None, steps: int, count: int | None = None) -> FloatArray:
    """The inputs on the grid, shape (n_samples, n_inputs), or one row for all."""
    if inputs is None:
        return np.zeros((1, 0))
    u = vector("inputs", inputs)
    u = u.reshape(len(u), -1)
    if count is None and len(u) == 1 and u.shape[1] == steps + 1 > 1:
        raise InputError(SAYS("one-row-of-inputs", u=u, points=steps + 1))
    if len(u) not in (1, steps + 1) or (count is not None and u.shape[1] != count):
        columns = "n_inputs" if count is None else count
        raise InputError(SAYS("inputs-shape", u=u, points=steps + 1, columns=columns))
    return u


def check_driven(
    inputs: ArrayLike | Driven | None, between: str, steps: int, count: int | None = None
) -> tuple[FloatArray, FloatArray | None]:
    """The inputs just before and just after each grid point; None for those after it where they do not jump."""
    if isinstance(inputs, Driven):
        before, after = (check_inputs(side, steps, count) for side in inputs)
        return before, Driven(before, after).jumps
    u = check_inputs(inputs, steps, count)
    if between not in BETWEEN:
        raise unknown_name("value of between", between, BETWEEN)
    if between == "line" or len(u) == 1:
        return u, None
    driven = [between_samples(column, between, 0.0, 1.0, count=len(u)) for column in u.T]
    return np.column_stack([d.before for d in driven]), np.column_stack([d.after for d in driven])


def check_above_0(name: str, value: float) -> None:
    """A number, and above 0."""
    if not _number(name, value, expected := "a number above 0") > 0:
        raise InputError(f"{name} = {value!r}: expected {expected}.")
