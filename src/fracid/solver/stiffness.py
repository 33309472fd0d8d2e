r"""Whether a step is short enough for what moves fastest, and why a run did not reach its end.

Near a state x the equations are linear, :math:`D^q δ = J δ` with :math:`J = ∂f/∂x`.  In one step h a mode of J changes
by about the eigenvalues μ of

.. math::  g J, \qquad g_i = h^{q_i} τ_0^{1 - q_i}

(τ₀ is a model's ``time_scale``, else 1).  Two numbers come of it:

\|J\|h       the largest \|μ\|.  An explicit scheme follows a fast decay up to about 1 (``pi3`` up to 2), beyond it
            overshoots each time, and what should have died grows.  ``pi2`` solves such steps by Newton's method, and
            follows all up to order 1, but not above (next section); ``bdf2`` follows all.
steps       2π over the largest \|Im μ\|: steps for each period of the fastest oscillation.  With fewer than
            :data:`STEPS_A_PERIOD`, a scheme of order 2 has its frequency wrong by more than :math:`(2π/20)^2/12`, 1 %,
            and constants are fitted to that error.
growth      the largest real μ.  Above 1 a deviation grows more than e-fold in a step; an implicit scheme damps it or
            changes its sign, and ends at rest where the solution leaves, or on the branch at the other side.

**Above order 1** the equation of ``pi2`` has a limit of its own, whoever solves it.  With x growing like
:math:`e^{sn}` over n steps, equation and scheme are both det(1 − diag(σ_i(s) g_i) J) = 0, where

.. math::  σ(s) = s^{-q} \quad\text{or}\quad σ(s) = \sum_k b_k e^{-sk} = 4 \sinh^2(s/2) \sum_m (s + 2πim)^{-q-2},

m over all whole numbers (the weights' series, by Poisson's formula).  A scheme that has more roots with Re s > 0 than
the equation makes something grow that should not (:func:`_growing` counts them by the argument principle; [Lubich] has
the theorem).  For :math:`D^q x = -a x` the first root comes over at s = iπ, where x changes its sign from sample to
sample: at

.. math::  h^q a = \frac{Γ(q+2)}{4\,(2^{q+2}-1)\,ζ(-q-1)},

240 at order 1.01, 50 at 1.05, 9.5 at 1.5, 12 towards 2.

**Near order 1** the equation of ``pi2`` is the trapezoidal rule, which multiplies a fast decay by
:math:`(1 - |μ|/2)/(1 + |μ|/2)` a step: beyond 2 it changes its sign at every step, and hardly gets smaller.

**Sweeps.**  ``pi2`` asks for Newton's method after its sweeps, which overshoot where \|J\|h is above 1: a curved f may
run away there and then, and no blow-up is concluded from it.

**Low orders.**  An explicit scheme sets x to :math:`x^0 + g f` of the last sample, less a history whose weights
vanish as q → 0: a fixed-point iteration, which is off by :math:`|μ|/(1+|μ|)` at first, and by :math:`2^{-q}|μ|` times
as much with each sample; and no step helps, for :math:`h^q` hardly depends on h.

**How a run ended.**  Where a state runs away, \|J\|h *before* it did tells whose fault it is: beyond its scheme's
limit the step's.  Otherwise the solution itself grows: in finite time, where the last decades of growth take less time
than the first, a *blow-up*; else exponentially.  An implicit step has no solution over a pole: the run is *unsettled*,
and so it is where the solution jumps within a step and Newton's method does not find it.

References
----------
.. [Lubich] C. Lubich, *A stability analysis of convolution quadratures for Abel-Volterra integral equations*,
   IMA J. Numer. Anal. 6 (1986).
.. [HW] E. Hairer, G. Wanner, Solving ODEs II, 2nd ed. 1996, IV.2: stability of explicit schemes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.findings import Finding, Words
from fracid.solver.methods import METHODS
from fracid.solver.trajectory import Outcome, Trajectory

SAYS = Words("solver/stiffness.toml")

STEPS_A_PERIOD = 20.0
"""Fewer are too few."""

LOOKED_AT = 3
"""Samples of a run at which J is asked for."""

JUMP = 0.2
"""A change of a state from sample to sample by more than this part of its range is a jump."""

USUAL = 3.0
"""A state beyond this many times its usual size is on its way out."""

OUT_OF_ALL_BOUNDS = 1e3
"""A run that ends beyond this many times its usual size is none that anybody asked for."""

GROWTH = 1.0
"""What a scheme makes grow is told where it grows by e or more over the run."""

FASTEST = 600.0
"""Logarithm of the fastest rate that is looked at: a number beyond it is none."""

RINGS, SHARE = 20, 0.01
"""A state that changes its direction at so many steps in a row, by that share of its range still: a scheme does so."""

LOW_ORDER, SETTLED = 0.1, 100.0
"""Below this order an explicit scheme tells after how many samples it comes within 1/100."""


def linearised(rhs: Callable[..., None], t: float, x: FloatArray, u: FloatArray, p: FloatArray) -> FloatArray:
    """J = ∂f/∂x by forward differences, shape (n_states, n_states); not finite where f is not.

    Examples
    --------
    >>> def pendulum(t, x, u, p, out):
    ...     out[0], out[1] = x[1], -9.0 * np.sin(x[0])
    >>> linearised(pendulum, 0.0, np.zeros(2), np.zeros(0), np.zeros(0)).round(3).tolist()
    [[0.0, 1.0], [-9.0, 0.0]]
    """
    at, J, state = np.empty(len(x)), np.empty((len(x), len(x))), x.copy()
    try:
        rhs(t, state, u, p, at)
        for c, value in enumerate(x.tolist()):
            d = 1e-7 * (0.01 + abs(value))
            state[c] = value + d
            rhs(t, state, u, p, J[c])
            state[c] = value
            J[c] = (J[c] - at) / d
    except (ArithmeticError, ValueError):  # a division by zero, or a root of what is negative, in plain Python
        J[:] = np.nan
    return J.T


def modes(J: FloatArray, gain: FloatArray) -> NDArray[np.complex128]:
    """μ, the eigenvalues of gJ; empty where J is not finite.

    Examples
    --------
    >>> modes(np.array([[0.0, 1.0], [-900.0, 0.0]]), np.full(2, 1e-2)).imag.round(3).tolist()
    [0.3, -0.3]
    """
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = gain[:, None] * J
    if not np.all(np.isfinite(scaled)):
        return np.empty(0, dtype=np.complex128)
    return np.asarray(np.linalg.eigvals(scaled), dtype=np.complex128)


def step_gain(step: float, orders: FloatArray, time_scale: float) -> FloatArray:
    """The g of one step [s] at given orders, shape (n_states,).

    Examples
    --------
    >>> step_gain(1e-2, np.array([1.0, 0.5]), 1.0).tolist()
    [0.01, 0.1]
    """
    return np.asarray(step**orders * time_scale ** (1 - orders))


def steps_a_period(eigenvalues: NDArray[np.complex128]) -> float:
    """Steps for each period of the fastest mode that swings rather than dies; infinite where none does.

    Examples
    --------
    >>> round(steps_a_period(np.array([0.3j, -0.3j])), 1)
    20.9
    """
    swinging = [abs(m.imag) for m in eigenvalues if abs(m.imag) > abs(m.real)]
    return float(2 * math.pi / max(swinging)) if swinging and max(swinging) > 0 else math.inf


class TooLong(NamedTuple):
    """A step beyond what its scheme follows."""

    size: float
    """|J|h, the largest |μ|."""
    limit: float
    """The |J|h that the scheme follows."""
    parts: float
    """Into how many the step must be divided; infinite where no number is enough."""


def too_long(method: str, orders: FloatArray, linear: list[FloatArray], gain: FloatArray, steps: int) -> TooLong | None:
    """Tell whether a scheme makes something grow, near one of some states, that does not grow in the equations.

    Parameters
    ----------
    method : key of :data:`fracid.solver.methods.METHODS`
    orders : array, shape (n_states,)
    linear : list of array, shape (n_states, n_states)
        J at those states.
    gain : array, shape (n_states,)
        g of the module's first screen.
    steps : int
        Length of the run.

    Examples
    --------
    >>> J, orders = [np.array([[-3e4]])], np.array([1.05])
    >>> found = too_long("pi2", orders, J, 1e-2**orders, 1000)
    >>> round(found.size), round(found.limit)
    (238, 50)
    >>> too_long("bdf2", orders, J, 1e-2**orders, 1000) is None
    True
    """
    sizes = [_largest([modes(J, gain)]) for J in linear]
    follows, largest = METHODS[method].follows, max(sizes, default=0.0)
    if largest > follows:
        with np.errstate(over="ignore"):  # an order of 10⁻⁹ asks for more parts than there are numbers
            parts = float(np.float64(2 * largest / follows) ** (1 / float(np.max(orders))))
        return TooLong(largest, follows, parts)
    if METHODS[method].family != "pi" or not np.max(orders) > 1:
        return None
    scaled = [gain[:, None] * J for J in linear]
    beyond = [k for k, size in enumerate(sizes) if size > 0 and _unstable(scaled[k], orders, steps)]
    if not beyond:
        return None
    worst = max(beyond, key=lambda k: sizes[k])
    parts = _parts(scaled[worst], orders, steps)
    at_limit = modes(linear[worst], gain * parts**-orders)
    return TooLong(sizes[worst], float(np.max(np.abs(at_limit))), 1.2 * parts)


def _parts(scaled: FloatArray, orders: FloatArray, steps: int) -> float:
    """Into how many parts the step must be divided for the scheme to follow, by bisection."""
    least, most = 0.0, 1.0  # logarithms

    def unstable(log_parts: float) -> bool:
        parts = math.exp(log_parts)
        return _unstable(parts ** -orders[:, None] * scaled, orders, round(steps * parts))

    while unstable(most) and most < 40:
        least, most = most, 2 * most
    for _ in range(12):
        middle = (least + most) / 2
        least, most = (middle, most) if unstable(middle) else (least, middle)
    return math.exp(most)


def _unstable(scaled: FloatArray, orders: FloatArray, steps: int) -> bool:
    """Tell whether ``pi2`` has more growing modes than the equations D^q δ = Jδ, `scaled` being gJ."""
    rate = min(GROWTH / max(1, steps), 0.5)
    of_equation = _growing(lambda s, q: s**-q, math.inf, rate / 2, scaled, orders=orders)
    return _growing(_of_scheme, math.pi, rate, scaled, orders=orders) > of_equation


def _growing(
    symbol: Callable[[NDArray[np.complex128], float], NDArray[np.complex128]], highest: float, rate: float,
    scaled: FloatArray, orders: FloatArray,
) -> int:  # fmt: skip
    """Roots s of det(1 − diag(σ_i(s)) gJ) with Re s > rate, by the turns of its argument along Re s = rate."""
    fastest = math.log(max(1.0, float(np.abs(scaled).sum()))) / float(np.min(orders))  # bounds the equation's roots
    end = highest if math.isfinite(highest) else 1e3 * math.exp(min(fastest, FASTEST))
    s = rate + 1j * np.append(0.0, np.geomspace(rate / 100, end, 400))
    of = {q: symbol(s, q) for q in set(orders.tolist())}
    rows = np.stack([of[q] for q in orders.tolist()], axis=1)
    argument = np.unwrap(np.angle(np.linalg.slogdet(np.eye(len(orders)) - rows[:, :, None] * scaled).sign))
    return round(float(argument[0] - argument[-1]) / math.pi)  # the lower half is its mirror image


def _of_scheme(s: NDArray[np.complex128], q: float) -> NDArray[np.complex128]:
    """Σ_k b_k e^(−sk)."""
    m = 2j * math.pi * np.arange(-30, 31)
    return np.asarray(4 * np.sinh(s / 2) ** 2 * ((s[:, None] + m) ** (-q - 2)).sum(axis=1))


def grows_by_itself(run: Trajectory) -> bool:
    """Tell whether a run that its step spoils has grown out of all proportion: what it ends with is no solution."""
    spoilt = run.fault is not None and run.fault.code == "stiff"
    return spoilt and len(run.time) > 2 and bool(_sizes(run)[-1] > OUT_OF_ALL_BOUNDS)


@np.errstate(all="ignore")
def fault_of(
    run: Trajectory, rhs: Callable[..., None], gain: FloatArray, inputs: FloatArray, parameters: FloatArray
) -> Finding | None:
    """Say why a run did not reach its end, or what is wrong with its step; None where nothing is.

    Parameters
    ----------
    run : Trajectory
        On its grid, every sample or every so many.
    rhs : function (t, x, u, p, out)
    gain : array, shape (n_states,)
        g of the module's first screen.
    inputs : array, shape (n_steps, n_inputs) or (1, n_inputs)
    parameters : array, shape (n_parameters,)

    Returns
    -------
    Finding or None
        ``blow-up``, ``runs-away``, ``stiff``, ``unsettled``, ``ringing``, ``coarse-steps``, ``low-order`` or
        ``not-finite``.

    Examples
    --------
    >>> from fracid import solve_fde
    >>> def decay(t, x, u, p, out):
    ...     out[0] = -p[0] * x[0]
    >>> run = solve_fde(decay, 0.9, [1.0], step=0.01, end=20.0, parameters=[1e4], method="gl")
    >>> run.fault.code, round(run.fault.number)
    ('stiff', 158)
    """
    end, several = float(run.time[-1]), len(run.time) > 1
    unsolved = run.outcome is Outcome.UNSETTLED
    away = several and not run.completed and _sizes(run)[-1] > 10 * USUAL
    if run.outcome is Outcome.NOT_FINITE and not away:
        return SAYS.finding("not-finite", "", end, math.inf)
    if run.outcome is Outcome.LEFT or (not several and run.completed):
        return None
    last = len(run.time) - 1
    if not run.completed:
        last = max(1, _growing_from(run) - 1) if last > 1 else 0  # the second may be on its way out
    samples = [last * k // (LOOKED_AT - 1) for k in range(LOOKED_AT)] + _jumps_after(run)
    linear = [_at(run, k, rhs, inputs, parameters=parameters) for k in samples]
    if run.completed and max(_bound(gain[:, None] * J) for J in linear) < 2 * math.pi / STEPS_A_PERIOD:
        return None
    length, method = round((end - run.origin) / run.step), METHODS[run.method]
    beyond = too_long(run.method, run.orders, linear, gain, steps=length if run.completed else max(100, length))
    if beyond is not None:
        return _too_stiff(run, beyond)
    spectra = [modes(J, gain) for J in linear]
    largest = _largest(spectra)
    if away or unsolved or run.outcome is Outcome.DIVERGED:
        if largest > method.sweeps:
            shorter = run.step * (0.5 * method.sweeps / largest) ** (1 / float(np.max(run.orders)))
            return SAYS.finding("overshoots", "", largest, method.sweeps, end=run.time[-1], run=run, shorter=shorter)
        found = _runs_away(run, largest) if several and (away or not unsolved) else None
        if not unsolved or (found is not None and found.code != "blow-up"):
            return found
        stiff = "" if run.method == "bdf2" else 'method = "bdf2", or '  # a jump may have a solution that is not found
        return SAYS.finding("unsettled", "", end, run.step, stiff=stiff, shorter=run.step / 10)
    if method.family == "gl" and np.min(run.orders) < LOW_ORDER:
        return _low_order(run, linear, gain)
    if method.family == "pi" and (ringing := _rings(run, largest)):
        return ringing
    if (growth := max(map(_growth, spectra))) > 1:
        parts = (10 * growth) ** (1 / float(np.max(run.orders)))
        return SAYS.finding("outgrown", "", growth, 1.0, run=run, shorter=run.step / parts)
    steps = sorted(map(steps_a_period, spectra[:LOOKED_AT]))[LOOKED_AT // 2]
    if steps < STEPS_A_PERIOD:
        shorter = run.step * steps / (2 * STEPS_A_PERIOD)
        return SAYS.finding("coarse-steps", "", steps, STEPS_A_PERIOD, percent=100 * (2 * math.pi / steps) ** 2 / 12,
                            shorter=shorter)  # fmt: skip
    return None


def _growth(eigenvalues: NDArray[np.complex128]) -> float:
    """The largest μ of what grows rather than swings; 0 where nothing does."""
    return max((float(m.real) for m in eigenvalues if m.real > abs(m.imag)), default=0.0)


def _jumps_after(run: Trajectory) -> list[int]:
    """The sample before the largest change, where that is a jump: at what it leaps over nobody looks else."""
    change, ranges = np.abs(np.diff(run.states, axis=0)), np.ptp(run.states, axis=0)
    part = np.max(change / np.where(ranges > 0, ranges, 1.0), axis=1, initial=0.0)
    return [int(np.argmax(part))] if run.completed and np.max(part, initial=0.0) > JUMP else []


def _largest(spectra: list[NDArray[np.complex128]]) -> float:
    """The largest |μ|; 0 where none is known."""
    return max((float(np.max(np.abs(m))) for m in spectra if m.size), default=0.0)


def _bound(scaled: FloatArray) -> float:
    """An upper bound of the largest |μ|, ‖(gJ)⁴‖^¼, for less than the eigenvalues cost; inf where it is not known."""
    square = scaled @ scaled
    bound = float(np.abs(square @ square).sum()) ** 0.25
    return bound if math.isfinite(bound) else math.inf


def _sizes(run: Trajectory) -> FloatArray:
    """The largest state of each sample, each in units of its own usual size, shape (n,)."""
    sizes = np.abs(run.states - run.states[0])
    usual = np.median(sizes[1:], axis=0)
    usual = np.where(usual > 0, usual, max(1e-300, float(np.max(usual))))
    return np.asarray((sizes / usual).max(axis=1))


def _growing_from(run: Trajectory) -> int:
    """The first sample after which the states stay beyond their usual size."""
    return min(int(np.max(np.flatnonzero(_sizes(run) <= USUAL), initial=0)) + 1, len(run.time) - 1)


def _at(run: Trajectory, k: int, rhs: Callable[..., None], inputs: FloatArray, parameters: FloatArray) -> FloatArray:
    row = round((run.time[k] - run.origin) / run.step)
    u = inputs[min(row, len(inputs) - 1)]
    return linearised(rhs, float(run.time[k]), run.states[k], u, p=parameters)


def _too_stiff(run: Trajectory, beyond: TooLong) -> Finding:
    note = f", and it ran away at t = {run.time[-1]:.4g} s" if run.outcome is Outcome.DIVERGED else ""
    implicit = METHODS[run.method].family == "pi"
    why = SAYS("amplifies" if implicit else "explicit", run=run, limit=beyond.limit, note=note)
    other = "bdf2" if implicit or np.max(run.orders) > 1 else "pi2"
    return SAYS.finding("stiff", "", beyond.size, beyond.limit, run=run, why=why, other=other,
                        shorter=run.step / beyond.parts)  # fmt: skip


def _rings(run: Trajectory, largest: float) -> Finding | None:
    """What the trapezoidal rule carries on with alternating sign, where every step is stored."""
    if largest <= 2 or len(run.time) < RINGS + 3 or not np.isclose(run.time[1] - run.time[0], run.step):
        return None
    change = np.diff(run.states, axis=0)
    swing = np.where(change[1:] * change[:-1] < 0, np.abs(np.diff(change, axis=0)) / 2, 0.0)
    lasting = np.minimum.reduce([swing[k : len(swing) - RINGS + k] for k in range(RINGS)]).max(axis=0)
    with np.errstate(invalid="ignore"):
        share = np.nan_to_num(lasting / np.ptp(run.states, axis=0))
    state = int(np.argmax(share))
    if share[state] < SHARE:
        return None
    return SAYS.finding("ringing", "", largest, 2.0, state=state, RINGS=RINGS, percent=100 * share[state], run=run,
                        shorter=run.step / largest)  # fmt: skip


def _low_order(run: Trajectory, linear: list[FloatArray], gain: FloatArray) -> Finding | None:
    """What an explicit scheme loses where it is a fixed-point iteration."""
    low = run.orders < LOW_ORDER
    spectra = [modes(J[np.ix_(low, low)], gain[low]) for J in linear]
    largest, q = _largest(spectra), float(np.min(run.orders))
    if not largest > 1 / SETTLED:
        return None
    samples = math.log(SETTLED * largest / (1 + largest)) / (q * math.log(2) - math.log(largest))
    return SAYS.finding("low-order", "", samples, 1.0, q=q, run=run)


def _runs_away(run: Trajectory, largest: float) -> Finding:
    """The solution itself: in finite time where the later growth is the faster."""
    sizes, t = _sizes(run), run.time
    first = _growing_from(run)
    later = min(len(t) - 1, first + int(np.argmax(np.append(sizes[first:] > 10 * USUAL, True))))
    step = f"The step is short enough, |J|h was {largest:.2g} before"
    if t[-1] - t[later] < t[later] - t[first - 1]:
        return SAYS.finding("blow-up", "", float(t[-1]), math.inf, step=step)
    doubling = float(t[later] - t[first - 1]) / math.log2(10.0)
    return SAYS.finding("runs-away", "", doubling, math.inf, end=t[-1], step=step)
