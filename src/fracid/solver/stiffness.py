r"""Whether a step is short enough for what moves fastest, and why a run did not reach its end.

Near a state x the equations are linear, :math:`D^q δ = J δ` with :math:`J = ∂f/∂x`.  In one step h a mode of J changes
by about the eigenvalues μ of

.. math::  g J, \qquad g_i = h^{q_i} τ_0^{1 - q_i}

(τ₀ is a model's ``time_scale``, else 1).  Two numbers come of it:

\|J\|h       the largest \|μ\|.  An explicit scheme follows a fast decay up to about 1 (``pi3`` up to 2), beyond it
            overshoots each time, and what should have died grows.  ``pi2`` solves such steps by Newton's method.
steps       2π over the largest \|Im μ\|: steps for each period of the fastest oscillation.  With fewer than
            :data:`STEPS_A_PERIOD`, a scheme of order 2 has its frequency wrong by more than :math:`(2π/20)^2/12`, 1 %,
            and constants are fitted to that error.

**How a run ended.**  Where a state runs away, \|J\|h *before* it did tells whose fault it is: beyond its scheme's
limit the step's.  Otherwise the solution itself grows: in finite time, where the last decades of growth take less time
than the first, a *blow-up*; else exponentially.

References
----------
.. [HW] E. Hairer, G. Wanner, Solving ODEs II, 2nd ed. 1996, IV.2: stability of explicit schemes.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.findings import Finding
from fracid.solver.methods import METHODS
from fracid.solver.trajectory import Outcome, Trajectory

__all__ = ["STEPS_A_PERIOD", "fault_of", "linearised", "modes", "step_gain", "steps_a_period"]

STEPS_A_PERIOD = 20.0
"""Fewer are too few."""

LOOKED_AT = 3
"""Samples of a run at which J is asked for."""

USUAL = 3.0
"""A state beyond this many times its usual size is on its way out."""


def linearised(rhs: Callable[..., None], t: float, x: FloatArray, u: FloatArray, p: FloatArray) -> NDArray[np.float64]:
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
            J[c] -= at
            J[c] /= d
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
    scaled = gain[:, None] * J
    if not math.isfinite(float(np.sum(scaled))):
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
        ``blow-up``, ``runs-away``, ``stiff``, ``coarse-steps`` or ``not-finite``.

    Examples
    --------
    >>> from fracid import solve_fde
    >>> def decay(t, x, u, p, out):
    ...     out[0] = -p[0] * x[0]
    >>> run = solve_fde(decay, 0.9, [1.0], step=0.01, end=20.0, parameters=[1e4], method="gl")
    >>> run.fault.code, round(run.fault.number)
    ('stiff', 158)
    """
    with np.errstate(all="ignore"):
        return None if run.outcome is Outcome.LEFT else _fault(run, rhs, gain, inputs, parameters)


def _fault(
    run: Trajectory, rhs: Callable[..., None], gain: FloatArray, inputs: FloatArray, parameters: FloatArray
) -> Finding | None:
    end, several = float(run.time[-1]), len(run.time) > 1
    away = several and not run.completed and _sizes(run)[-1] > 10 * USUAL
    if run.outcome is Outcome.NOT_FINITE and not away:
        return Finding("not-finite", "", end, math.inf, "s",
                       f"The right-hand side is not finite after t = {end:.4g} s: a division by zero, such as "
                       "det M = 0, or an overflow.")  # fmt: skip
    if not several:
        return None
    last = len(run.time) - 1 if run.completed else max(1, _growing_from(run) - 1)
    linear = [_at(run, last * k // (LOOKED_AT - 1), rhs, inputs, parameters) for k in range(LOOKED_AT)]
    if run.completed and max(_bound(gain[:, None] * J) for J in linear) < 2 * math.pi / STEPS_A_PERIOD:
        return None
    spectra = [modes(J, gain) for J in linear]
    largest = max((float(np.max(np.abs(m))) for m in spectra if m.size), default=0.0)
    if largest > _follows(run):
        return _too_stiff(run, largest)
    if away or run.outcome is Outcome.DIVERGED:
        return _runs_away(run, largest)
    steps = sorted(map(steps_a_period, spectra))[LOOKED_AT // 2]
    if steps < STEPS_A_PERIOD:
        shorter = run.step * steps / (2 * STEPS_A_PERIOD)
        return Finding("coarse-steps", "", steps, STEPS_A_PERIOD, "steps a period",
                       f"The fastest oscillation has {steps:.2g} steps a period, and {STEPS_A_PERIOD:.0f} are too few "
                       f"already: its frequency is wrong by {100 * (2 * math.pi / steps) ** 2 / 12:.2g} % or so. "
                       f"Take a step of {shorter:.2g} s.")  # fmt: skip
    return None


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
    small = np.flatnonzero(_sizes(run) <= USUAL)
    return min(int(small[-1]) + 1, len(run.time) - 1) if small.size else 1


def _at(run: Trajectory, k: int, rhs: Callable[..., None], inputs: FloatArray, parameters: FloatArray) -> FloatArray:
    row = round((run.time[k] - run.origin) / run.step)
    u = inputs[min(row, len(inputs) - 1)]
    return linearised(rhs, float(run.time[k]), run.states[k], u, parameters)


def _follows(run: Trajectory) -> float:
    return METHODS[run.method].follows if run.method in METHODS else math.inf


def _too_stiff(run: Trajectory, largest: float) -> Finding:
    follows = _follows(run)
    q = float(np.max(run.orders))
    shorter = run.step * (0.5 * follows / largest) ** (1 / q)
    note = f", and it ran away at t = {run.time[-1]:.4g} s" if run.outcome is Outcome.DIVERGED else ""
    return Finding(
        "stiff", "", largest, follows, "|J|h",
        f"The step is too long for {run.method}: |J|h is {largest:.3g}, and an explicit scheme follows up to about "
        f'{follows:g}{note}. Type method = "pi2", or a step of {shorter:.2g} s.',
    )  # fmt: skip


def _runs_away(run: Trajectory, largest: float) -> Finding:
    """The solution itself: in finite time where the later growth is the faster."""
    sizes, t = _sizes(run), run.time
    first = _growing_from(run)
    later = min(len(t) - 1, first + int(np.argmax(np.append(sizes[first:] > 10 * USUAL, True))))
    step = f"The step is short enough, |J|h was {largest:.2g} before"
    if t[-1] - t[later] < t[later] - t[first - 1]:
        return Finding("blow-up", "", float(t[-1]), math.inf, "s",
                       f"The solution itself leaves every bound in finite time, at t = {t[-1]:.4g} s. {step}: a "
                       "shorter one ends there too. Look at the orders and the constants; no rig does so.")  # fmt: skip
    doubling = float(t[later] - t[first - 1]) / math.log2(10.0)
    return Finding("runs-away", "", doubling, math.inf, "s to double",
                   f"The solution itself grows without end, twofold in {doubling:.2g} s, and passed the limit at t = "
                   f"{t[-1]:.4g} s. {step}. Is a friction negative, or gravity's sign wrong?")  # fmt: skip
