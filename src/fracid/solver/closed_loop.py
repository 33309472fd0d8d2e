r"""A model under a sampled controller, compiled: ``pi2-implicit`` with the loop closed inside it.

Every `per` steps the controller reads the outputs, with noise and rounded as the encoder does, less their values at the
posture, e, and has a state v:

.. math::  u = \mathrm{sat}(u_e + C v + D e), \qquad v \leftarrow A v + B e + E\,(u - u_e).

E takes what the motor did, not what it was asked for: no windup.  The input is held until the next sample, and acts
`delay` steps late.

One that swings up has a region about upright where this holds, :math:`|φ| \le` catch and :math:`|φ + w/g| \le`
reach, until :math:`|φ|` is beyond release.  Elsewhere, with the energy :math:`\mathcal E = \frac12 (w/ω_0)^2 +
\cos φ - 1` (0 at upright) and rates w of φ and v of the arm's or cart's z, which are smoothed differences of the
samples, it accelerates the pivot by a, and n is what of u that takes:

.. math::  a &= P\,\mathrm{sat}(k(\mathcal E_0 - \mathcal E))\,\mathrm{sign}((l_0 + l_1\cos φ)\,w) - p z - d v, \\
           u &= \mathrm{sat}(u_e + (n_0 + n_1\cos^2φ)\,a + n_2\sin φ\,w^2 + n_3\sin φ\cos φ + n_4 v + n_5\cos φ\,w
                + n_6\sin φ\cos φ\,w v + n_7\sin φ\cos^2φ\,v^2).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types

from fracid.arrays import FloatArray, IntArray
from fracid.solver.compilation import INDICES, MATRIX, VECTOR, helper, when_called
from fracid.solver.history import HISTORY
from fracid.solver.loop_arguments import Run, run_type
from fracid.solver.schemes import WORK, _jump, adapted, room_for, step_pi2
from fracid.solver.starting import START, begun


class Pump(NamedTuple):
    """What drives a pendulum up, with the letters of the module's docstring."""

    place: int
    """Which output φ is."""
    arm: int
    """Which z is; φ's where nothing carries the pendulum."""
    turn: float
    """Of φ, 2π; 0 where it is no angle that turns."""
    omega: float
    most: float
    """P"""
    energy: float
    sharp: float
    """k"""
    lift: float
    lift_cosine: float
    stiffness: float
    """p"""
    damping: float
    """d"""
    grows: float
    catch: float
    """∞ for a controller that only holds."""
    reach: float
    release: float
    keep: float
    """Of a rate, from sample to sample."""
    period: float
    """[s]"""


class Law(NamedTuple):
    """A controller."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    E: FloatArray
    """Shapes (n, n), (n, n_outputs), (1, n), (1, n_outputs), (n, 1)."""
    drive: FloatArray
    """u at the posture, its least and its greatest value."""
    pump: Pump
    needs: FloatArray
    """n, shape (8,)."""
    begins: FloatArray
    """v from e and w, shape (n, 2 n_outputs)."""


class Loop(NamedTuple):
    """A controller and what stands between it and the model."""

    law: Law
    rows: IntArray
    """The states that are measured, shape (n_outputs,)."""
    reference: FloatArray
    """The outputs at the posture, shape (n_outputs,)."""
    quantum: FloatArray
    """A step of the encoder of each output; 0 for none."""
    noise: FloatArray
    """Added to each sample, shape (n_samples, n_outputs)."""
    channel: int
    """Which input it is."""
    per: int
    """Steps a sample."""
    delay: int
    """Steps until an input acts."""
    applied: FloatArray
    """The input just after each step, shape (n_steps + 1,); at first that before the controller's first."""
    state: FloatArray
    """v, and room for the next one, shape (2, n)."""
    seen: FloatArray
    """The sample before, its rates, what the controller does, and the newest sample, shape (4, n_outputs)."""
    inputs: FloatArray
    """All inputs just after a step, shape (1, n_inputs)."""


_pump = types.NamedTuple((*[types.int64] * 2, *[types.float64] * 15), Pump)
LAW = types.NamedTuple((*[MATRIX] * 5, VECTOR, _pump, VECTOR, MATRIX), Law)
LOOP = types.NamedTuple((LAW, INDICES, VECTOR, VECTOR, MATRIX, *[types.int64] * 3, VECTOR, *[MATRIX] * 3), Loop)

HOLDS = 2.0
"""Last of what a controller remembers, while it holds; 1 while it pumps, 0 before its first sample."""


@helper
def _pumped(pump, n, angle, w, z, v):
    s, c = np.sin(angle), np.cos(angle)
    missing = pump.energy - 0.5 * (w / pump.omega) ** 2 - c + 1.0
    a = pump.most * min(max(pump.sharp * missing, -1.0), 1.0)
    if (pump.lift + pump.lift_cosine * c) * w < 0.0:
        a = -a
    a -= pump.stiffness * z + pump.damping * v
    u = (n[0] + n[1] * c * c) * a + n[2] * s * w * w + n[3] * s * c + n[4] * v + n[5] * c * w
    return u + (n[6] * w + n[7] * c * v) * s * c * v


@helper
def _answer(law, e, state, seen):
    """The input for a sample e; the state goes on, and so does `seen`: as of :class:`Loop`."""
    pump, (v, new), states, outputs, u = law.pump, (state[0], state[1]), state.shape[1], len(e), 0.0
    for i in range(outputs):
        turn = pump.turn if i == pump.place else 0.0
        moved = e[i] - seen[0, i] if seen[2, 0] > 0.0 else 0.0
        if turn > 0.0:
            e[i] -= turn * np.round(e[i] / turn)
            moved -= turn * np.round(moved / turn)
        seen[0, i] = e[i]
        seen[1, i] += (1.0 - pump.keep) * (moved / pump.period - seen[1, i])
    angle, rate = e[pump.place], seen[1, pump.place]
    caught = abs(angle) <= pump.catch and abs(angle + rate / pump.grows) <= pump.reach
    if caught or (seen[2, 0] == HOLDS and abs(angle) <= pump.release):
        seen[2, 0] = HOLDS
        for i in range(outputs):
            u += law.D[0, i] * e[i]
        for j in range(states):
            u += law.C[0, j] * v[j]
    else:
        seen[2, 0] = 1.0
        u = _pumped(pump, law.needs, angle, rate, e[pump.arm], seen[1, pump.arm])
    u = min(max(law.drive[0] + u, law.drive[1]), law.drive[2])
    for j in range(states):
        new[j] = law.E[j, 0] * (u - law.drive[0])
        for i in range(outputs):
            new[j] += law.B[j, i] * e[i]
        for i in range(states):
            new[j] += law.A[j, i] * v[i]
    if abs(angle) > pump.release:  # the filter knows the motion about upright alone: there it will begin
        for j in range(states):
            new[j] = 0.0
            for i in range(2 * outputs):
                new[j] += law.begins[j, i] * seen[i // outputs, i % outputs]
    for j in range(states):
        v[j] = new[j]
    return u


@when_called(VECTOR(LAW, MATRIX))
def answers(law, errors):
    """The inputs for a row of samples, shape (n, n_outputs), from its first on."""
    u, state, seen = np.zeros(len(errors)), np.zeros((2, len(law.A))), np.zeros((4, errors.shape[1]))
    for k in range(len(u)):
        u[k] = _answer(law, errors[k].copy(), state, seen)
    return u


@helper
def _act(loop, n, x):
    """Take the sample of step n: write the inputs from n + delay on until those of the next sample."""
    e = loop.seen[3]
    for i in range(len(e)):
        y = x[loop.rows[i]] + loop.noise[n // loop.per, i]
        if loop.quantum[i] > 0.0:
            y = loop.quantum[i] * np.round(y / loop.quantum[i])
        e[i] = y - loop.reference[i]
    u = _answer(loop.law, e, loop.state, loop.seen)
    for m in range(n + loop.delay, min(n + loop.delay + loop.per, len(loop.applied))):
        loop.applied[m] = u


@helper
def _sampled(rhs, n, t, x, u, loop, p, f, before, jump, entered, trial):
    """In the place of inputs that are known beforehand: the controller's, which jump where it samples."""
    if n % loop.per == 0:
        _act(loop, n, x)
    loop.inputs[0, loop.channel] = loop.applied[n]
    _jump(rhs, 0, t, x, u, loop.inputs, p, f, before, jump, entered, trial)
    u[loop.channel] = loop.applied[n]


_pi2 = adapted(step_pi2, _jump=_sampled)


RUN = run_type(0, after=LOOP)


@when_called(types.UniTuple(types.int64, 2)(types.int64, RUN, START, HISTORY, WORK, MATRIX), allocates=False)
def _step(rhs, run, started, history, work, out):
    loop, now = run.after, work[2]
    _act(loop, 0, run.past[0])
    now[loop.channel] = loop.applied[0]
    return _pi2(rhs, run, started, history, work, False, out)


def step_closed(rhs: int, run: Run, loop: Loop, out: FloatArray) -> tuple[int, int]:
    """Fill `out` with the states, and `loop` with the inputs; gives the last good step and how the run ended."""
    run = run._replace(corrections=0, corrected=False, after=loop)
    ended: tuple[int, int] = _step(rhs, run, *begun(rhs, [run], "pi"), *room_for(run), out)
    return ended
