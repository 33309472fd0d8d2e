"""Many runs at once, and the derivatives of one run with respect to all that it depends on.

:func:`solve_fde_batch` solves a list of runs of one right-hand side on threads: the compiled loops hold no lock.

:func:`sensitivities` gives ∂x(t)/∂(orders, parameters, initial state) by differences of neighbouring runs:
four runs for each, at ±d and ±2d, whose error is :math:`d^4`, on threads.  The alternative is to carry the
variational equation D^q s = f_x s + f_p along.  Since a compiled right-hand side can only be differenced, that costs
some 1.2 runs for each derivative (`benchmarks/solver.py`): no less than the one-sided differences that a search
makes do with; and an order needs a second memory besides, with the weights' derivative w′, and Newton's steps a
derivative of their own.  So differences it is, of every method and memory alike.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fracid.arrays import FloatArray
from fracid.cards import CardDisplay
from fracid.errors import InputError, at_least
from fracid.solver.right_hand_side import RightHandSide
from fracid.solver.solve import solve_fde
from fracid.solver.trajectory import SAYS, Trajectory, vector
from fracid.tasks.job import in_threads


def solve_fde_batch(
    rhs: RightHandSide, runs: Iterable[Mapping[str, Any]], *, jobs: int | None = None, **common: Any
) -> list[Trajectory]:
    """Solve many runs of one right-hand side, on threads.

    Parameters
    ----------
    rhs : function (t, x, u, p, out) -> None
        As in :func:`~fracid.solver.solve.solve_fde`.
    runs : iterable of mappings
        What each run has for itself: any arguments of :func:`~fracid.solver.solve.solve_fde` by name.
    jobs : int, optional
        Threads; by default one a core.  The results do not depend on it.
    **common
        What all runs share.

    Returns
    -------
    list of Trajectory
        In the order of `runs`.

    Raises
    ------
    InputError
        As :func:`~fracid.solver.solve.solve_fde`, and for arguments that it does not have; the message begins with
        the number of the run.

    Examples
    --------
    >>> def decay(t, x, u, p, out):
    ...     out[0] = -p[0] * x[0]
    >>> runs = solve_fde_batch(decay, [{"orders": q} for q in (0.5, 0.9)], initial=[1.0], parameters=[1.0],
    ...                        step=0.01, end=1.0)
    >>> [round(float(run.states[-1, 0]), 3) for run in runs]
    [0.428, 0.376]
    """

    def solve(numbered: tuple[int, Mapping[str, Any]]) -> Trajectory:
        number, run = numbered
        try:
            return solve_fde(rhs, **{**common, **run})
        except (InputError, TypeError) as error:
            raise InputError(f"Run {number}: {error}") from None

    threads, numbered = (os.cpu_count() or 1) if jobs is None else at_least("jobs", jobs, 1), [*enumerate(runs)]
    return [*map(solve, numbered[:1]), *in_threads(threads, solve, numbered[1:])]  # the first compiles for all


@dataclass(frozen=True, repr=False)
class Sensitivities(CardDisplay):
    """A run and its derivatives."""

    run: Trajectory
    """The run itself."""
    orders: FloatArray
    """∂x/∂(order of each state), shape (n, n_states, n_states); a scalar order's is the sum over the last axis."""
    parameters: FloatArray
    """∂x/∂p, shape (n, n_states, n_parameters)."""
    initial: FloatArray
    """∂x/∂x(start), shape (n, n_states, n_states)."""


def sensitivities(
    rhs: RightHandSide,
    orders: ArrayLike,
    initial: ArrayLike,
    *,
    parameters: ArrayLike = (),
    jobs: int | None = None,
    tolerance: float = 1e-13,
    **options: Any,
) -> Sensitivities:
    """Differentiate a run with respect to its orders, parameters and initial state.

    Parameters
    ----------
    rhs, orders, initial, parameters
        As in :func:`~fracid.solver.solve.solve_fde`; all other arguments of it may follow by name.
    jobs : int, optional
        Threads; by default one a core.
    tolerance : float
        Of the compressed memory: tight, since a difference magnifies what two runs do not share.

    Returns
    -------
    Sensitivities
        With an error of some 10⁻⁹ of the size of x, as long as x is smooth in what it is differentiated by.

    Raises
    ------
    InputError
        As :func:`~fracid.solver.solve.solve_fde`; where a neighbouring run does not reach the end; and for a history
        (its derivatives would have to be given too).

    Examples
    --------
    The derivative of E_0.8(−t^0.8) with respect to its order, at t = 1, is −0.119122…

    >>> def decay(t, x, u, p, out):
    ...     out[0] = -p[0] * x[0]
    >>> found = sensitivities(decay, 0.8, [1.0], parameters=[1.0], step=1e-3, end=1.0)
    >>> round(float(found.orders[-1, 0, 0]), 5)
    -0.11912
    """
    if options.get("history") is not None:
        raise InputError("history: a run that continues another has no derivatives here; differentiate the whole run.")
    x0, p = vector("initial", initial), vector("parameters", parameters)
    q = np.array(np.broadcast_to(vector("orders", orders), len(x0)))
    states = np.atleast_2d(x0.T)[0]
    moving = np.column_stack([x0, np.zeros(len(x0))]) if x0.ndim == 1 else x0  # a neighbour of order 1 is above it
    kinds = {"orders": (q, _order_steps(q)), "parameters": (p, _steps(p)), "initial": (moving, _steps(states))}
    points = [(kind, i, step) for kind, (_, steps) in kinds.items() for i, step in enumerate(steps)]
    runs, weights = list[dict[str, Any]]([{}]), [*STENCIL.values()]
    for kind, i, step in points:
        for side in STENCIL:
            values = kinds[kind][0].copy()
            values[(i, 0) if values.ndim == 2 else i] += side * step
            runs.append({"initial": moving, kind: values})
    common = {"orders": q, "initial": x0, "parameters": p, "tolerance": tolerance, **options}
    run, *neighbours = solve_fde_batch(rhs, runs, jobs=jobs, **common)
    slopes = np.zeros((*run.states.shape, len(points)))
    for k, near in enumerate(neighbours):
        kind, i, step = points[k // len(STENCIL)]
        if len(near.time) < len(run.time):
            raise InputError(SAYS("no-derivative", kind=kind, i=i, run=near, end=near.time[-1]))
        slopes[..., k // len(STENCIL)] += weights[k % len(STENCIL)] / step * near.states[: len(run.time)]
    return Sensitivities(run, *np.split(slopes, np.cumsum([len(q), len(p)]), axis=-1))


STENCIL = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}
"""Weights of the fourth-order central difference."""


def _steps(values: FloatArray) -> FloatArray:
    """d: ε^(1/5) of the value, where rounding and d⁴ are alike; of 1 for a zero."""
    return np.asarray(5e-4 * np.where(values == 0, 1.0, np.abs(values)))


def _order_steps(q: FloatArray) -> FloatArray:
    """The same, such that no order leaves (0, 2), nor crosses 1 where that would change what initial values mean."""
    room = np.minimum(q, 2 - q)
    room = np.where(q == 1, room, np.minimum(room, np.abs(q - 1)))
    return np.minimum(5e-4, room / 3)
