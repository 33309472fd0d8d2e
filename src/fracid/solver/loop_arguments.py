"""One run as the compiled loops take it: orders, inputs, what is known before, grid, limits, weights.

For :math:`D^{q_i} x_i = f_i(t, x, u, p)`, state i of order q_i and step weight g_i = h^{q_i}.  Nothing in a
:class:`Run` changes while a loop runs; what changes (the state, f, the history) is the loop's own.

f is an argument of its own, by its address (:func:`fracid.solver.compilation.evaluate`): as a function pointer of
Numba's it would take 50 µs to hand over, and more to compile.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import types

from fracid.arrays import FloatArray, IntArray
from fracid.solver.history import KERNELS, Kernels


class Run(NamedTuple):
    """One run, as the compiled loops take it; its letters are those of the formulas in :mod:`fracid.solver.schemes`."""

    orders: FloatArray
    """q, the order of each state, (n_states,)."""
    gain: FloatArray
    """g, h^q of each state, (n_states,)."""
    u: FloatArray
    """Inputs on the grid from the first known sample on, (n_past + steps + 1, n_inputs), or one row for all."""
    p: FloatArray
    """Parameters, (n_parameters,)."""

    past: FloatArray
    """Known states, one row a step, (n_past + 1, n_states); the last is that at `start`."""
    slope: FloatArray
    """First derivatives at the first known sample, 0 where an order is at most 1, (n_states,)."""
    start: float
    """Time of the last known state [s]."""

    h: float
    """Step [s]."""
    steps: int
    """Steps from `start` to the end."""
    every: int
    """Every so many samples one is stored."""
    limit: float
    """A state beyond ±limit ends the run as diverged."""
    bounds: FloatArray
    """Lowest and highest value of each state, (n_states, 2)."""

    kernels: Kernels
    """Weights of the history sums."""
    corrections: int
    """Corrector sweeps of ``pi2`` and ``pi3``; 0 for Newton's method at every step."""
    corrected: bool
    """Whether ``pi2`` and ``pi3`` correct for a solution that begins like t^q."""
    relaxing: IntArray
    """States of order 1 whose f is c − a x, with a in the second half of what the right-hand side writes."""
    fading: FloatArray
    """Of each state with a finite memory: which, then a_0, and a_j, h/τ_j, z_j of its relaxations, a row each."""
    after: Any
    """Inputs just after each grid point, where `u` are those just before it, of its shape; no rows for no jumps.  Of a
    closed loop what gives them (:class:`fracid.solver.closed_loop.Loop`)."""


def run_type(more: int, after: Any = types.float64[:, ::1]) -> types.NamedTuple:
    """Of a :class:`Run` whose orders, gains, parameters and states have so many axes more, with such an `after`."""
    vector, matrix = (types.Array(types.float64, n + more, "C") for n in (1, 2))
    inputs, limits = types.float64[:, ::1], (types.float64, types.float64[:, ::1])
    grid = types.float64, types.float64, types.int64, types.int64
    how = KERNELS, types.int64, types.boolean, types.int64[::1], types.float64[:, ::1], after
    return types.NamedTuple((vector, vector, inputs, vector, matrix, vector, *grid, *limits, *how), Run)


RUN = run_type(0)
