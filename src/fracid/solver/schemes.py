r"""The stepping schemes for D^q x = f(t, x, u, p), compiled.

Each state i has its own order q_i, step weight g_i = h^{q_i} and kernel (:mod:`fracid.solver.memory`); f is a
function pointer, so the loops compile once for all right-hand sides and are cached on disk.  With
:math:`v^l = x^l - x^0` (for orders above 1: :math:`x^l - x^0 - t_l \dot x^0`) the schemes are

=================  =========================================================================================
``gl-paper``       (21)–(24) to the letter, the sum over raw x, right only for x⁰ = 0:
                   :math:`x_i^l = g_i f_i(x^{l-1}) - \sum_{k=1}^{l} w_k x_i^{l-k}`
``gl``             explicit, on v:  :math:`v_i^l = g_i f_i(x^{l-1}) - \sum w_k v_i^{l-k}`
``gl-sequential``  the same, from the last state to the first, each using those already new (a velocity
                   before the angle that it drives): at order 1 the symplectic Euler scheme, which
                   manufactures no anti-damping
``pi2``            product trapezoidal rule on f, with the corrections C of :mod:`fracid.solver.starting`:
                   :math:`x_i^l = x_i^0 + g_i\big(b_0 f_i^l + \sum_{k=1}^{l-1} b_k f_i^{l-k} + a_l f_i^0 + C_i^l\big)`;
                   predictor from extrapolated f, then corrector sweeps.
                   A step at which the sweeps contract slowly is solved by Newton's method: dry friction,
                   tanh(v/v_s), is steep, and fixed sweeps would diverge beyond h·|∂f/∂x| = 2
``pi3``            the same with weights of order 3 (:mod:`fracid.solver.starting`) and a parabola for predictor; for
                   smooth f only: a kink costs it all it has over ``pi2``, and stiff systems make it diverge
``pi2-implicit``   the equation of ``pi2``, every step by Newton's method, whose matrix is kept while it serves:
                   for stiff systems
``bdf2``           the same with the weights :math:`w_k` of :math:`(3/2 - 2ζ + ζ^2/2)^{-q}`, Lubich's quadrature of
                   BDF2, :math:`\tfrac12 w_{l-1}` for that of the start: what dies in the equation dies in the scheme,
                   at any step and every order up to 2
=================  =========================================================================================

**Inputs that jump.**  At a grid point where an input jumps, f has two values, f⁻ before and f⁺ after it, Δ = f⁺ − f⁻.
The panels to the left end with f⁻, those to the right begin with f⁺, whose half hat weighs

.. math::  A_j = \frac{1}{Γ(q)} \int_0^1 (j - s)^{q-1} (1 - s)\,ds

at the lag j.  ``pi2`` takes x there with f⁻, enters f⁻ + Δ/3 into the history and Δ/6 with the next sample, which has
the area 1/2 and the centre 1/3 of that hat, and adds what is wrong at the first lag, :math:`A_1 - b_1/3`.  At order 1
that is what two runs joined at the jump are, of convergence order 2; below it a solution begins like t^q anew at each
jump, and the convergence order is 1 + q.  ``gl`` needs f⁺ alone; the other methods take the mean of both inputs
(:mod:`fracid.solver.inputs`).

The first three are of convergence order 1, ``pi3`` of 3, the others of 2, where f(t, x) is smooth.

**States that relax.**  The z of a presliding joint (:func:`fracid.models.joints.presliding`), of order 1, forgets
within less than a step while the joint slides: :math:`\dot z = c - a z` with a·h up to any size, where the trapezoidal
rule would ring.  For a state that the run calls `relaxing` the right-hand side writes a behind f, and the ``pi``
methods take, with :math:`A = h\,\bar a`, :math:`\bar a = (a_0 + a_1)/2` and :math:`R = 1/(1 + A + A^2/2)`,

.. math::  z_1 = R\,\big(z_0 + \tfrac h2 c_0 + \tfrac h2 (1 + A)\,ρ\,c_1\big), \qquad
           ρ = \frac{\bar a}{a_1 (1 - R) + \bar a R},

of second order for small A (R is that of Lobatto IIIC), and c₁/a₁, sliding friction, for large.

**What is known before.**  `past` holds the states that are given: its last row is the state at the `start` of
the run, the rows before it the samples of the history, one a step, the first of which is the x⁰ of the formulas.
The loops walk over them as over any other step, but take x as it stands.  The corrected start adds its own rows.

**How a run ends.**  Where a state leaves ±`limit` or f is no longer finite, with the index of the last good
sample; where it leaves the `bounds` that the caller gave, with the first sample outside.  Every `every`-th sample
is stored.
"""

from __future__ import annotations

import math
from functools import cache
from types import FunctionType
from typing import Any

import numba as nb
import numpy as np
from numba import types
from numba.core.dispatcher import Dispatcher
from numba.extending import register_jitable

from fracid.solver.compilation import MATRIX, PART, VECTOR, evaluate, when_called
from fracid.solver.history import (
    BLOCK,
    HISTORY,
    bare,
    enter,
    flush_denormals,
    inline,
    look_ahead,
    nothing_yet,
    restore,
    room,
)  # fmt: skip
from fracid.solver.loop_arguments import RUN, Run
from fracid.solver.starting import START

COMPLETED, DIVERGED, NOT_FINITE, UNSETTLED, LEFT = 0, 1, 2, 4, 5
"""How a run ended: its place in :class:`fracid.Outcome`, which has the sentences."""

SLOW, SETTLED, SMALL, NEWTON, SOLVED = 0.25, 1e-9, 1e-3, 12, 1e-12
"""When ``pi2`` takes Newton's method: the next sweep would move a state by more than a quarter of the last one
and by more than 10⁻⁹ of (10⁻³ + its size).  At most 12 iterations, until it moves none by more than 10⁻¹² of that."""

KEPT, WORN, UNSOLVED = 1.0, 0.0, -1.0
"""Of Newton's matrix: it serves on, it is to be made anew; and that a step was not solved."""

OPEN = 1e-3
"""Of (10⁻³ + its size) a state may move by so much more where Newton's method ends: a kink keeps it from settling, and
the check at half the step tells what that does."""

PATIENCE = 4
"""Times 12 iterations that ``bdf2`` takes at most."""

SLACK = 0.05
"""And where a relaxing state would move by more than this part of its size."""

EARLY = 64
"""Steps of four sweeps more: the predictor is no good where f begins like t^q."""

_ENDED = types.UniTuple(types.int64, 2)  # the last good step, and how the run ended


ROWS, NEWEST, SHARE = 10, 5, 9
"""For x and the like; what f weighs in its own step, and a jump of f, beside a third, in the next one."""


def room_for(run: Run, *lanes: int) -> tuple[Any, Any]:
    """What a loop changes: its history, and its work, of so many runs together (:mod:`fracid.solver.lanes`).

    The work is rows for x and the like, rows for f and the like, the inputs of a step, Newton's matrix, and z0, c0, a0
    of the relaxing states with room for Newton.
    The loops allocate nothing: counting references would be more to compile.
    """
    states, relaxing, q = len(run.orders), len(run.relaxing), run.orders
    f = np.zeros((2, 2 * states if relaxing else states, *lanes))
    rows = np.zeros((ROWS, states, *lanes))
    rows[NEWEST] = run.gain * run.kernels.own[run.kernels.of, 0].reshape(q.shape)
    rows[NEWEST, run.relaxing] = 0.0
    row, begins = run.kernels.table[run.kernels.of], run.kernels.lags + 16
    rows[SHARE] = run.gain * (row[:, begins + 8] - row[:, 8] / 3).reshape(q.shape)
    rows[SHARE, run.relaxing] = 0.0
    start = np.zeros((relaxing, 4, *lanes))
    work = tuple(rows), tuple(f), run.u[0].copy(), np.zeros((2 * states + 1, 2 * states, *lanes)), start
    return nothing_yet(run.kernels, len(run.past) - 1 + run.steps), work


WORK = types.Tuple((types.UniTuple(VECTOR, ROWS), types.UniTuple(VECTOR, 2), VECTOR, MATRIX, MATRIX))

# rhs is the address of f (:func:`fracid.solver.compilation.evaluate`).  A literal 1 would have Numba compile what takes
# it once more, so that np.int64(1) stands where it changes or is handed over.


@inline
def _finite(f):
    """Tell whether all derivatives are finite."""
    for i in range(len(f)):  # noqa: SIM110 (Numba compiles no generators)
        if not abs(f[i]) < math.inf:
            return False
    return True


@inline
def _read(u, n, now):
    """Copy the inputs of step n, where there is more than one row: a view would cost more."""
    if len(u) > 1:
        for c in range(len(now)):
            now[c] = u[n, c]


@inline
def _store(row, x, out):
    """Keep a sample; returns the row of the next."""
    for i in range(len(x)):
        out[row, i] = x[i]
    return row + 1


@inline
def _ended(n, row, state, run, x, f, out):
    """Keep the sample of a step, if it is good and one of every so many; `state` is that of Newton's matrix.

    Gives the row of the next one, how the run ends with this step, and the last good one.
    """
    m = len(run.past) - 1
    for i in range(len(x)):
        if not abs(x[i]) <= run.limit or not abs(f[i]) < math.inf:
            return row, DIVERGED if _finite(f) else NOT_FINITE, n - 1
    if anywhere(state == UNSOLVED):
        return row, UNSETTLED, n - 1
    if n == m + row * run.every:
        row = _store(row, x, out)
    for i in range(len(x) if n >= m else 0):
        if not run.bounds[i, 0] <= x[i] <= run.bounds[i, 1]:
            return row, LEFT, n
    return row, COMPLETED, n


@inline
def _advance(i, n, head, raw, run, x, f, history):
    """Take the n-th step of state i from f and what went before, or from what is known."""
    window, _, ahead = history
    m, j = len(run.past) - 1, (n - 1) % BLOCK
    drift = 0.0 if raw else run.past[0, i] + run.slope[i] * (n * run.h)
    v = run.gain[i] * f[i] - ahead[i, j] if n > m else run.past[n, i] - drift
    enter(i, j, v, head, window, ahead, run.kernels)
    x[i] = drift + v


@when_called(_ENDED(types.int64, RUN, HISTORY, WORK, types.boolean, types.boolean, MATRIX), allocates=False)
def step_gl(rhs, run, history, work, raw, last_first, out):
    """``gl``, ``gl-paper`` (`raw`) and ``gl-sequential`` (`last_first`): fill `out`, a row for each sample stored."""
    past, slope, h, kernels = run.past, run.slope, run.h, run.kernels
    m, states, end = len(past) - 1, len(slope), len(past) - 1 + run.steps
    (window, sums, ahead), head = history, np.int64(1)
    rows, (f, _), now, _, _ = work
    x0, x = past[0], rows[0]
    mode = flush_denormals()
    for i in range(states):
        x[i] = x0[i]
        if raw:
            window[i, 0] = x0[i]
    how, last, row = COMPLETED, np.int64(0), np.int64(1)  # the first row of out holds x(start)
    for n in range(1, end + 1):
        j = (n - 1) % BLOCK
        if j == 0:
            head = room(head, window, kernels.lags)
            look_ahead(n, head, window, sums, ahead, kernels)
        _read(run.u, n - 1, now)
        if last_first:
            for i in range(states - 1, -1, -1):
                if n > m:
                    evaluate(rhs, run.start + (n - 1 - m) * h, x, now, run.p, f)
                _advance(i, n, head, raw, run, x, f, history)
        else:  # apart: with one loop for both a step takes 15 % longer
            if n > m:
                evaluate(rhs, run.start + (n - 1 - m) * h, x, now, run.p, f)
            for i in range(states):
                _advance(i, n, head, raw, run, x, f, history)
        row, how, last = _ended(n, row, KEPT, run, x, f, out)
        if how != COMPLETED:
            break
        head += 1
    restore(mode)
    return last - m, how


# --- the product trapezoidal rule ------------------------------------------------------------------


@inline
def _correct_block(n, knots, k, parabolas, ahead):
    """Add the corrections of the steps n … n + 7 to the history ahead; k is the parabola of n − 1, then of n + 7."""
    for j in range(BLOCK):
        k += n + j > knots[2 * k + 2]
        if j == 0 and n + BLOCK - 1 <= knots[2 * k + 2]:
            _add_parabola(n, np.int64(BLOCK), np.int64(0), knots, k, parabolas, ahead)
            break
        _add_parabola(n + j, np.int64(1), j, knots, k, parabolas, ahead)
    return k


@inline
def _add_parabola(n, count, first, knots, k, parabolas, ahead):
    """Newton's form over the knots 2k, 2k + 1, 2k + 2, for n and some after it."""
    edge, middle = float(n - knots[2 * k]), float(n - knots[2 * k + 1])
    for i in range(len(ahead)):
        c0, c1, c2 = parabolas[k, i, 0], parabolas[k, i, 1], parabolas[k, i, 2]
        value, slope = c0 + edge * (c1 + middle * c2), c1 + (edge + middle) * c2
        for j in range(count):
            ahead[i, first + j] += value + j * (slope + j * c2)


@inline
def _look_back(n, head, k, started, history, kernels):
    """Compute what the steps n … n + 7 know of the past; gives where the window goes on, and the parabola of n + 7."""
    window, sums, ahead = history
    head = room(head, window, kernels.lags)
    look_ahead(n, head, window, sums, ahead, kernels)
    if len(started.knots) > 3:
        k = _correct_block(n, started.knots, k, started.parabolas, ahead)
    return head, k


@bare
def _go_on_from(measured, rhs, t, x, u, p, f, newest, x0):
    """Shift x⁰ so that the run goes on from the last known state, which the model may not explain.

    Where it does, the shift is zero to rounding: what the sweeps of that step left open is left open again.
    """
    for i in range(len(x)):
        x0[i] -= x[i] - newest[i] * f[i]
        x[i] = measured[i]
    evaluate(rhs, t, x, u, p, f)
    for i in range(len(x)):
        x0[i] += x[i] - newest[i] * f[i]


@inline
def _slow(x, last, f, history, newest, scale):
    """Tell whether the next sweep would move x by too much, after the last one moved it there from `last`."""
    last_move = next_move = 0.0
    for i in range(len(x)):
        last_move = max(last_move, scale[i] * abs(x[i] - last[i]))
        next_move = max(next_move, scale[i] * abs(history[i] + newest[i] * f[i] - x[i]))
    return next_move > max(SLOW * last_move, SETTLED)


anywhere = bool
"""Whether a condition holds for the run, or for one of several that step together (:mod:`fracid.solver.lanes`)."""


@register_jitable  # Python calls it, too, where _relax steps in the state-space model
def _where(condition, one, other):
    return one if condition else other


@register_jitable
def _but(one, other):
    return one and not other


@inline
def _first(i, v, window):
    """The first sample of state i."""
    window[i, 0] = v


# The arguments of Newton's method are not grouped: a NamedTuple of arrays has its references counted at each call of a
# function that is not inlined, which costs ``pi2-implicit`` 14 % of a step.
@inline
def _relax(relaxing, x, f, start, h, history):
    """Put z1 of the relaxing states into `history`, with c1 and a1 as f and x have them; see the module's docstring."""
    for k in range(len(relaxing)):
        i = relaxing[k]
        z0, c0, a0, a1 = start[k, 0], start[k, 1], start[k, 2], f[len(x) + i]
        c1, mean = f[i] + a1 * x[i], 0.5 * (a0 + a1)
        A = mean * h
        R = 1 / (1 + A + 0.5 * A * A)
        settles = _where(mean > 0, a1 * (1 - R) + mean * R, 1.0)
        c1 = _where(mean > 0, c1 * (mean / settles), c1)  # ρ c1
        history[i] = R * (z0 + 0.5 * h * (c0 + (1 + A) * c1))


@inline
def _unsettled(relaxing, x, history, start):
    """Tell whether a relaxing state would still move by much of its own size, which its torque goes with."""
    moves = False
    for k in range(len(relaxing)):
        i = relaxing[k]
        moves = moves | (abs(history[i] - x[i]) > SLACK * max(max(abs(history[i]), abs(x[i])), abs(start[k, 0])))
    return moves


@inline
def _keep_relaxing(relaxing, x, f, start):
    """Keep z0, c0 and a0 for the next step."""
    for k in range(len(relaxing)):
        i = relaxing[k]
        a = f[len(x) + i]
        start[k, 0], start[k, 1], start[k, 2] = x[i], f[i] + a * x[i], a


@inline
def _correct(x, f, history, newest, W, trial, relaxing, start, h):
    """Put W (known + g b_0 f − x), by which x is to move, into the right of its row; tell if it is finite."""
    states, finite = len(x), True
    _relax(relaxing, x, f, start, h, history)
    for i in range(states):
        trial[i] = history[i] + newest[i] * f[i] - x[i]
    for i in range(states):
        change = 0.0
        for c in range(states):
            change += W[states + 1 + i, c] * trial[c]
        W[states, states + i] = change
        finite = finite & (abs(change) < math.inf)
    return finite


@inline
def _moves(W, x, side):
    """Return the size of the correction that was taken, or of the next, by x before and after the one taken."""
    states, size = len(x), 0.0
    for i in range(states):
        size = max(size, abs(W[states, side + i]) / (SMALL + abs(x[i]) + abs(W[states, i])))
    return size


@bare
def _newton(open_, rhs, t, x, u, p, f, history, newest, W, state, trial, relaxing, start, h):
    """Solve x = known + g b_0 f(t, x) by Newton's method from x, f = f(t, x), where it is open; leaves both solved.

    The rows of W are room for elimination; the correction that x takes and the one that the same matrix asks for next
    (Deuflhard's natural monotonicity); and that matrix, (1 − g b_0 ∂f/∂x)⁻¹, of an earlier step where it was KEPT.
    Where the next correction is below a tenth of the one taken, it serves on; where it is below it, it is made anew;
    else x has gone too far, to where the curve turns or to another root: it goes back, and on with a new matrix, or
    half as far.  Returns KEPT, WORN, of a matrix to make anew, or UNSOLVED, where after NEWTON iterations x would
    still move by much: a little may be left open beside a kink.
    """
    states, share, fresh = len(x), 1.0, open_ & (state != KEPT)
    if anywhere(fresh):
        _renew(fresh, rhs, t, x, u, p, f, history, newest, W, trial, relaxing, start, h)
    failed = _but(open_, _correct(x, f, history, newest, W, trial, relaxing, start, h))
    open_ = _but(open_, failed)
    for _ in range(NEWTON):
        for i in range(states):
            W[states, i] = _where(share == 1.0, W[states, states + i], W[states, i])
            x[i] += _where(open_, share * W[states, i], 0.0)
        evaluate(rhs, t, x, u, p, f)
        taken = _moves(W, x, np.int64(0))
        solved = _but(open_, taken > SOLVED)
        state, open_ = _where(solved, KEPT, state), _but(open_, solved)
        if not anywhere(open_):
            break
        finite = _correct(x, f, history, newest, W, trial, relaxing, start, h)
        following = _moves(W, x, states)
        back = _but(open_, _but(finite, following >= taken))
        if anywhere(back):
            for i in range(states):
                x[i] -= _where(back, share * W[states, i], 0.0)
            evaluate(rhs, t, x, u, p, f)
        half = back & fresh
        renew = _but(open_ & (back | (following >= 0.1 * taken)), half)
        fresh, share = half | renew, _where(half, 0.5 * share, 1.0)
        if anywhere(renew):
            _renew(renew, rhs, t, x, u, p, f, history, newest, W, trial, relaxing, start, h)
            lost = _but(renew, _correct(x, f, history, newest, W, trial, relaxing, start, h))
            failed, open_ = failed | lost, _but(open_, lost)
    last = _where(share == 1.0, _moves(W, x, states), _moves(W, x, np.int64(0)))
    state = _where(open_, _where(last < OPEN, WORN, UNSOLVED), state)
    return _where(failed, UNSOLVED, state)


@bare
def _renew(where, rhs, t, x, u, p, f, history, newest, W, trial, relaxing, start, h):
    """Put (1 − g b_0 ∂f/∂x)⁻¹ into the last rows of W, ∂f/∂x by forward differences."""
    n = len(x)
    _relax(relaxing, x, f, start, h, history)
    for k in range(len(relaxing)):
        start[k, 3] = history[relaxing[k]]
    for c in range(n):
        d, value = 1e-7 * (0.01 + abs(x[c])), x[c]
        x[c] = value + d
        evaluate(rhs, t, x, u, p, trial)
        _relax(relaxing, x, trial, start, h, history)
        x[c] = value
        for i in range(n):
            W[i, c] = -newest[i] * (trial[i] - f[i]) / d
        for k in range(len(relaxing)):
            i = relaxing[k]
            W[i, c] = -(history[i] - start[k, 3]) / d
        W[c, c] += 1.0
    for c in range(n):
        for i in range(n):
            W[i, n + c] = 1.0 if i == c else 0.0
    gauss_jordan(W, n)
    for i in range(n):
        for c in range(n):
            W[n + 1 + i, c] = _where(where, W[i, n + c], W[n + 1 + i, c])


@bare
def gauss_jordan(W, n):
    """Turn the first n rows, [A | 1], into [1 | A⁻¹], with row pivots."""
    for k in range(n):
        for i in range(k + 1, n):
            larger = abs(W[i, k]) > abs(W[k, k])
            for c in range(2 * n if anywhere(larger) else 0):
                W[k, c], W[i, c] = _where(larger, W[i, c], W[k, c]), _where(larger, W[k, c], W[i, c])
        factor = 1 / W[k, k]
        for c in range(2 * n):
            W[k, c] *= factor
        for i in range(n):
            factor = W[i, k]
            for c in range(2 * n if i != k else 0):
                W[i, c] -= factor * W[k, c]


@bare
def _rare(newton, joins, measured, rhs, t, x, u, p, f, history, newest, W, state, trial, x0, relaxing, start, h):
    """What few steps need, apart from the loop, where it would cost registers: returns the state of Newton's W."""
    if anywhere(newton):
        state = _newton(newton, rhs, t, x, u, p, f, history, newest, W, state, trial, relaxing, start, h)
    if joins:
        _go_on_from(measured, rhs, t, x, u, p, f, newest, x0)
    return state


@bare
def _jump(rhs, n, t, x, u, after, p, f, before, jump, entered, trial):
    """Evaluate f just after a jump of the inputs, and say what enters the history; the predictor goes on from there."""
    jumps = False
    for c in range(len(u)):
        jumps = jumps or u[c] != after[n, c]
    for i in range(len(x)):
        entered[i] = f[i] + jump[i] / 6
        jump[i] = 0.0
    if not jumps:
        return
    evaluate(rhs, t, x, after[n], p, trial)
    for i in range(len(x)):
        jump[i] = trial[i] - f[i]
        entered[i] += jump[i] / 3
        before[i] = trial[i] - (f[i] - before[i])
    for i in range(len(f)):  # of states that relax the rates too
        f[i] = trial[i]


@inline
def _predict(n, j, run, started, rows, f, ahead, curve):
    """Fill in what is known of step n, and x: f goes on in a straight line, or in a parabola where `curve` is 1.

    Where Newton's method takes every step it begins at the last x: a steep f that goes on leads to another root.
    """
    x, before, earlier, _, known, newest, _, jump, _, share = rows
    free = n >= max(len(run.past) - 1, started.together + 1)
    for i in range(len(x)):
        known[i] = started.x0[i] + run.slope[i] * (n * run.h) + run.gain[i] * ahead[i, j]
        if len(run.after) > 0:
            known[i] += share[i] * jump[i]
        bend = curve * (f[i] - 2 * before[i] + earlier[i])
        if not free:
            x[i] = started.known[n, i]
        elif run.corrections > 0:
            x[i] = known[i] + newest[i] * (2 * f[i] - before[i] + bend)
        earlier[i], before[i] = before[i], f[i]
    return free


@inline
def _sweep(rhs, n, t, free, run, rows, f, now, start):
    """Sweep, x = known + g b_0 f(t, x), where x is `free`, and evaluate f there; tells whether a state runs away."""
    x, last_x, known, newest, relaxing = rows[0], rows[3], rows[4], rows[5], run.relaxing
    if free and len(relaxing):  # they follow the speed that is predicted, or f would not be that of any motion
        for r in range(len(relaxing)):
            x[relaxing[r]] = start[r, 0]
        evaluate(rhs, t, x, now, run.p, f)
        _relax(relaxing, x, f, start, run.h, known)
        for r in range(len(relaxing)):
            x[relaxing[r]] = known[relaxing[r]]
    more = 4 if n <= EARLY and run.corrections > 0 else 0
    for _ in range(run.corrections + more if free else 0):
        evaluate(rhs, t, x, now, run.p, f)
        _relax(relaxing, x, f, start, run.h, known)
        for i in range(len(x)):
            last_x[i], x[i] = x[i], known[i] + newest[i] * f[i]
            if not abs(x[i]) <= run.limit:
                return DIVERGED if _finite(f) else NOT_FINITE
    evaluate(rhs, t, x, now, run.p, f)
    _relax(relaxing, x, f, start, run.h, known)
    return COMPLETED


@when_called(_ENDED(types.int64, RUN, START, HISTORY, WORK, types.boolean, MATRIX), allocates=False)
def step_pi2(rhs, run, started, history, work, third, out):
    """``pi2``, ``pi3`` (`third`): extrapolate f, then sweep, Newton where that is slow; no sweeps: Newton at once."""
    h, p, after, relaxing, kernels = run.h, run.p, run.after, run.relaxing, run.kernels
    m, states, end = len(run.past) - 1, len(run.slope), len(run.past) - 1 + run.steps
    t0, jumps, curve = run.start - m * h, len(after) > 0, 1.0 if third else 0.0
    window, _, ahead = history
    rows, (f, trial), now, W, start = work
    x, before, _, last_x, known, newest, scale, jump, entered, _ = rows
    mode = flush_denormals()
    for i in range(states):
        x[i] = run.past[0, i]
    evaluate(rhs, t0, x, now, p, f)
    for i in range(states):
        before[i] = f[i]
        _first(i, f[i], window)
    _keep_relaxing(relaxing, x, f, start)
    how, last, head, row, k = COMPLETED, np.int64(0), np.int64(1), np.int64(1), np.int64(0)
    state = WORN * run.gain[0]  # of lanes where the run is of lanes, or Numba compiles Newton's method for both
    if not _finite(f):
        how, end = NOT_FINITE, 0
    for n in range(1, end + 1):
        t, j = t0 + n * h, (n - 1) % BLOCK
        if j == 0:
            head, k = _look_back(n, head, k, started, history, kernels)
            for i in range(states):
                scale[i] = 1 / (SMALL + abs(x[i]))
        _read(run.u, n, now)
        free, joins = _predict(n, j, run, started, rows, f, ahead, curve), n == m > started.together
        how = _sweep(rhs, n, t, free, run, rows, f, now, start)
        if how != COMPLETED:
            break
        newton = _slow(x, last_x, f, known, newest, scale) | _unsettled(relaxing, x, known, start)
        newton = (newton | (run.corrections == 0)) & free
        if anywhere(newton) or joins:
            state = _rare(newton, joins, run.past[m], rhs, t, x, now, p, f, known, newest, W, state, trial, started.x0,
                          relaxing, start, h)  # fmt: skip
        if jumps:
            _jump(rhs, n, t, x, now, after, p, f, before, jump, entered, trial)
        _keep_relaxing(relaxing, x, f, start)
        for i in range(states):
            enter(i, j, entered[i] if jumps else f[i], head, window, ahead, kernels)
        row, how, last = _ended(n, row, state, run, x, f, out)
        if how != COMPLETED:
            break
        head += 1
    restore(mode)
    return last - m, how


# --- the fractional BDF2 ---------------------------------------------------------------------------


@bare
def _first_derivative(rhs, run, x, f, newest, W, trial, base, weight, now, relax_start):
    """Fill f with that of the first sample after a stiff start, known or solved for: at order 1, backward Euler."""
    past, h = run.past, run.h
    t, _ = run.start - (len(past) - 2) * h, _read(run.u, min(1, len(run.u) - 1), now)
    for i in range(len(x)):
        x[i], base[i], weight[i] = past[min(1, len(past) - 1), i], past[0, i] + run.slope[i] * h, 1.5 * newest[i]
    evaluate(rhs, t, x, now, run.p, f)
    if len(past) == 1:
        _settle(rhs, t, x, now, run.p, f, base, weight, W, WORN, trial, run.relaxing, relax_start)


@bare
def _settle(rhs, t, x, u, p, f, history, newest, W, state, trial, relaxing, start):
    """Take Newton's method further where a steep curve needs it: what is left open is multiplied by |J|h later."""
    for _ in range(PATIENCE):
        state = _newton(True, rhs, t, x, u, p, f, history, newest, W, state, trial, relaxing, start, 0.0)
        if state == KEPT:
            break
    return state


@when_called(_ENDED(types.int64, RUN, START, HISTORY, WORK, MATRIX), allocates=False)
def step_bdf2(rhs, run, started, history, work, out):
    """``bdf2``: every step by Newton's method, from x going on in a straight line; nothing relaxes, as it dies here."""
    h, p, past, kernels, x0 = run.h, run.p, run.past, run.kernels, started.x0
    m, states, end = len(past) - 1, len(run.slope), len(past) - 1 + run.steps
    t0, first_free = run.start - m * h, max(m, started.together + 1)
    window, _, ahead = history
    rows, (f, trial), now, W, start = work
    x, before, known, last_move, newest, base, weight, _, _, _ = rows
    mode = flush_denormals()
    for i in range(states):
        x[i] = before[i] = past[0, i]
        newest[i] = run.gain[i] * kernels.own[kernels.of[i], 0]
    evaluate(rhs, t0, x, now, p, f)
    how, last, state, head, row, k = COMPLETED, np.int64(0), WORN, np.int64(1), np.int64(1), np.int64(0)
    if not _finite(f):
        how, end = NOT_FINITE, 0
    elif started.together == 0:
        _first_derivative(rhs, run, x, f, newest, W, trial, base, weight, now, start)
    for i in range(states):
        window[i, 0], x[i] = f[i], past[0, i]
    for n in range(1, end + 1):
        t, j = t0 + n * h, (n - 1) % BLOCK
        if j == 0:
            head, k = _look_back(n, head, k, started, history, kernels)
        _read(run.u, n, now)
        for i in range(states):  # predict: x goes on in a straight line, but not that of a jump
            known[i] = x0[i] + run.slope[i] * (n * h) + run.gain[i] * ahead[i, j]
            move = x[i] - before[i]
            goes_on = abs(move) <= 2 * abs(last_move[i])
            before[i], last_move[i] = x[i], move
            x[i] = started.known[n, i] if n < first_free else x[i] + move if goes_on else x[i]
        evaluate(rhs, t, x, now, p, f)
        if n >= first_free:
            state = _settle(rhs, t, x, now, p, f, known, newest, W, state, trial, run.relaxing, start)
        if n == m > started.together:
            _go_on_from(past[m], rhs, t, x, now, p, f, newest, x0)
        for i in range(states):
            enter(i, j, f[i], head, window, ahead, kernels)
        row, how, last = _ended(n, row, state, run, x, f, out)
        if how != COMPLETED:
            break
        head += 1
    restore(mode)
    return last - m, how


# --- the same loops of something else --------------------------------------------------------------


@cache
def adapted(function: Any, **own: Any) -> Any:
    """A loop and its parts, compiled with functions of one's own in the place of those of the same names."""
    code = getattr(function, "py_func", None) or function.__wrapped__
    new: dict[str, Any] = {}
    for name in code.__code__.co_names:
        part = code.__globals__.get(name)
        if name in own:
            new[name] = own[name]
        elif isinstance(part, Dispatcher) and part.py_func.__module__ == __name__:
            new[name] = adapted(part, **own)
    if all(part is code.__globals__[name] for name, part in new.items()):
        return function
    loop = FunctionType(code.__code__, {**code.__globals__, **new}, code.__name__)
    return nb.njit(forceinline=True, **PART)(loop)  # it may allocate, if whoever calls it may
