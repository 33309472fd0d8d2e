r"""A model under a sampled controller, compiled: ``pi2-implicit`` with the loop closed inside it.

Every `per` steps the controller reads the outputs, with noise and rounded as the encoder does, less their values at the
posture, e, and has a state v:

.. math::  u = \mathrm{sat}(u_e + C v + D e), \qquad v \leftarrow A v + B e + E\,(u - u_e).

E takes what the motor did, not what it was asked for: no windup.  The input is held until the next sample, and acts
`delay` steps late.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types

from fracid.arrays import FloatArray, IntArray
from fracid.solver.compilation import evaluate, helper, when_called
from fracid.solver.history import BLOCK, HISTORY, enter, flush_denormals, look_ahead, restore, room
from fracid.solver.loop_arguments import RUN
from fracid.solver.schemes import (
    COMPLETED,
    DIVERGED,
    LEFT,
    UNSETTLED,
    UNSOLVED,
    WORK,
    WORN,
    _finite,
    _jump,
    _keep_relaxing,
    _newton,
    _outside,
    _relax,
)


class Loop(NamedTuple):
    """A controller and what stands between it and the model."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    E: FloatArray
    """Shapes (n, n), (n, n_outputs), (1, n), (1, n_outputs), (n, 1)."""
    rows: IntArray
    """The states that are measured, shape (n_outputs,)."""
    reference: FloatArray
    """The outputs at the posture, shape (n_outputs,)."""
    quantum: FloatArray
    """A step of the encoder of each output; 0 for none."""
    noise: FloatArray
    """Added to each sample, shape (n_samples, n_outputs)."""
    drive: FloatArray
    """u at the posture, its least and its greatest value."""
    channel: int
    """Which input it is."""
    per: int
    """Steps a sample."""
    delay: int
    """Steps until an input acts."""


_vector, _matrix = types.float64[::1], types.float64[:, ::1]
LOOP = types.NamedTuple(
    (*[_matrix] * 5, types.int64[::1], _vector, _vector, _matrix, _vector, *[types.int64] * 3), Loop
)


@helper
def _act(loop, n, x, v, applied):
    """Take the sample of step n: write the inputs from n + delay on until those of the next sample."""
    states, outputs, u = len(v), len(loop.rows), 0.0
    e = np.zeros(outputs)
    for i in range(outputs):
        y = x[loop.rows[i]] + loop.noise[n // loop.per, i]
        if loop.quantum[i] > 0.0:
            y = loop.quantum[i] * np.round(y / loop.quantum[i])
        e[i] = y - loop.reference[i]
        u += loop.D[0, i] * e[i]
    for j in range(states):
        u += loop.C[0, j] * v[j]
    u = min(max(loop.drive[0] + u, loop.drive[1]), loop.drive[2])
    new = np.zeros(states)
    for j in range(states):
        new[j] = loop.E[j, 0] * (u - loop.drive[0])
        for i in range(outputs):
            new[j] += loop.B[j, i] * e[i]
        for i in range(states):
            new[j] += loop.A[j, i] * v[i]
    v[:] = new
    for m in range(n + loop.delay, min(n + loop.delay + loop.per, len(applied))):
        applied[m] = u


@when_called(types.UniTuple(types.int64, 2)(types.int64, RUN, HISTORY, WORK, LOOP, _vector, _matrix))
def step_closed(rhs, run, history, work, loop, applied, out):
    """Fill `out` with the states and `applied` with the input just after each step; gives the last good step and how.

    `applied` begins as the input before the controller's first.
    """
    _, gain, u, p, past, _, start, h, steps, _, limit, bounds, kernels, _, _, relaxing, _ = run
    (window, sums, ahead), head, states = history, 1, len(gain)
    (x, before, known, _, _, newest, _, jump, entered, share), (f, trial), now, W, relax_start = work
    x0, after, v, state = past[0], u[0].copy(), np.zeros(len(loop.A)), WORN
    mode, last, how = flush_denormals(), steps, COMPLETED
    for i in range(states):
        x[i] = x0[i]
    _act(loop, 0, x, v, applied)
    now[loop.channel] = applied[0]
    evaluate(rhs, start, x, now, p, f)
    for i in range(states):
        window[i, 0] = before[i] = f[i]
    _keep_relaxing(relaxing, x, f, relax_start)
    for n in range(1, steps + 1):
        t, j = start + n * h, (n - 1) % BLOCK
        if j == 0:
            head = room(head, window, kernels.lags)
            look_ahead(n, head, window, sums, ahead, kernels)
        for i in range(states):
            known[i] = x0[i] + gain[i] * ahead[i, j] + newest[i] * share[i] * jump[i]
            x[i] = known[i] + newest[i] * (2 * f[i] - before[i])
            before[i] = f[i]
        for r in range(len(relaxing)):
            x[relaxing[r]] = relax_start[r, 0]
        evaluate(rhs, t, x, now, p, f)
        if len(relaxing):
            _relax(relaxing, x, f, relax_start, h, known)
            for r in relaxing:
                x[r] = known[r]
            evaluate(rhs, t, x, now, p, f)
        state = _newton(rhs, t, x, now, p, f, known, newest, W, state, trial, relaxing, relax_start, h)
        if n % loop.per == 0:
            _act(loop, n, x, v, applied)
        after[loop.channel] = applied[n]
        _jump(rhs, t, x, now, after, p, f, before, jump, entered, trial)
        now[loop.channel] = applied[n]
        _keep_relaxing(relaxing, x, f, relax_start)
        good = _finite(f)
        for i in range(states):
            good = good and abs(x[i]) <= limit
            out[n, i] = x[i]
            enter(i, j, entered[i], head, window, ahead, kernels)
        if not good or state == UNSOLVED:
            last, how = n - 1, UNSETTLED if good else DIVERGED
            break
        if _outside(x, bounds):
            last, how = n, LEFT
            break
        head += 1
    restore(mode)
    return last, how
