"""Recordings of simulated rigs with known truth, made without fracid: what its claims are tested against.

Two things must not share their errors: the simulated recording (twin) and the program that identifies it.  So nothing
here imports fracid.  The equations of the rotary pendulum are written anew from the paper's (8)-(12), with the pendulum
hanging at α = 0,

    M(α)·[θ̈, α̈]ᵀ = [F_θ, F_α]ᵀ,   M11 = J_θ + C6 sin²α,   M12 = C3 cos α,   M22 = C1,

and solved by schemes that fracid does not use:

=================  ==========================================================================================
truth              scheme
=================  ==========================================================================================
integer order      fourth-order Runge-Kutta with fixed steps (:func:`ordinary`); joints with set-valued friction
                   stick and slip at events that are located to rounding, so that a stuck joint has rate 0
fractional orders, product integration of f as a polygon, over the whole past, by a recursive fast convolution
springpots         (:func:`fractional`)
=================  ==========================================================================================

Each :class:`Kind` is one thing that a rig has and its model may lack, with severities from mild to gross.
:func:`recording` makes one recording of a rig, :func:`write` puts it into the file that ``fracid init`` takes:

>>> release = recording("play", 0.25, seed=3, seconds=4.0)
>>> release.truth.fractional, release.time.size, sorted(release.truth.rig)[:2]
(False, 2501, ['C1', 'C3'])

Angles in rad, time in s; constants in SI units.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from scipy import fft

TANH, SET_VALUED, BRISTLE = 0.0, 1.0, 2.0
"""How dry friction acts at rest: smooth in the speed; sticking; by bristles that give (Dahl, LuGre)."""

STATES = ("theta", "theta_rate", "alpha", "alpha_rate", "hub", "hub_rate", "bristle_theta", "bristle_alpha",
          "alpha_lowpass", "springpot_theta", "springpot_alpha")  # fmt: skip
"""Of the simulation.  The hub is the motor's side of the gear; it moves with the arm where ``hub_inertia`` is 0."""


class Rig(NamedTuple):
    """All constants of the equations, zero where the rig lacks the element; numbers of the SRV02 with ROTPEN."""

    C1: float = 4.290672e-3
    """Pendulum inertia about its pivot [kg m²]."""
    C3: float = 4.279392e-3
    """Coupling of arm and pendulum [kg m²]."""
    C4: float = 0.19435572
    """Gravity torque [N m]."""
    C6: float = 4.290672e-3
    """What the pendulum adds to the arm at 90° [kg m²]."""
    J_theta: float = 1.0007e-2
    """Arm inertia with all that turns with it [kg m²]."""
    b_theta: float = 0.05
    """Viscous friction [N m s/rad]."""
    b_alpha: float = 3e-4
    friction: float = TANH
    """Kind of dry friction."""
    coulomb_theta: float = 0.01
    """Sliding friction [N m]."""
    coulomb_alpha: float = 2.5e-4
    slip_speed: float = 0.02
    """Of the smooth kind: f·tanh(v/slip_speed) [rad/s]."""
    stiction_theta: float = 0.0
    """What rest takes above sliding [N m]: g(v) = f + s·exp(−(v/v_st)²)."""
    stiction_alpha: float = 0.0
    stribeck_theta: float = 0.05
    """v_st [rad/s]."""
    stribeck_alpha: float = 0.5
    presliding_theta: float = 0.0
    """δ, what the joint gives before it breaks away [rad]: σ₀ = (f + s)/δ."""
    presliding_alpha: float = 0.0
    bristle_damping_theta: float = 0.0
    """σ₁ [N m s/rad]."""
    bristle_damping_alpha: float = 0.0
    fading: float = 0.0
    """Relative change of all friction per second [1/s]."""
    eccentricity: float = 0.0
    """Relative change of all dry friction over a turn, as a cosine of the angle."""
    drag_theta: float = 0.0
    """Quadratic drag [N m s²/rad²]."""
    drag_alpha: float = 0.0
    cable: float = 0.02
    """Spring of the cable on the arm [N m/rad]."""
    cable_cubic: float = 0.0
    """Its hardening [N m/rad³]."""
    lean_x: float = 0.0
    """How far the axis leans to where the arm points at θ = 0 [rad]: gravity has that part in the arm's plane."""
    lean_y: float = 0.0
    """And to where it points at 90°."""
    arm_moment: float = 0.027432
    """Mass times distance from the axis, of arm and pendulum [kg m]."""
    hub_inertia: float = 0.0
    """Of the motor's side of gear or elastic arm, part of J_theta [kg m²]."""
    shaft_stiffness: float = 0.0
    """Between hub and arm [N m/rad]."""
    shaft_damping: float = 0.0
    """[N m s/rad]"""
    play: float = 0.0
    """Half the gap between hub and arm [rad]."""
    torque_per_volt: float = -0.1282
    """Motor [N m/V]."""
    back_emf: float = 0.0
    """Braking by the motor while its amplifier is on [N m s/rad]."""
    lowpass: float = 0.0
    """Time constant of a filter of α [s]."""
    springpot_theta: float = 0.0
    """c of the torque c·D^ν of the angle [N m s^ν/rad]."""
    springpot_alpha: float = 0.0


# --- the equations ---------------------------------------------------------------------------------------


@njit(cache=True)
def _limit(f: float, s: float, stribeck: float, level: float, v: float) -> float:
    """Return g(v), the dry friction at a speed [N m]."""
    return level * (f if s == 0.0 else f + s * math.exp(-((v / stribeck) ** 2)))


@njit(cache=True)
def _dry(p: Rig, g: float, at_rest: float, delta: float, damping: float, v: float, z: float) -> tuple[float, float]:
    """Return torque and rate of the bristle of a joint that is no set-valued one."""
    if p.friction == BRISTLE and delta > 0.0:
        sigma = at_rest / delta
        rate = v - abs(v) * z * sigma / g
        return sigma * z + damping * rate, rate
    if p.friction == SET_VALUED or g == 0.0:
        return 0.0, 0.0
    return g * math.tanh(v / p.slip_speed), 0.0


@njit(cache=True)
def rates(t: float, x: np.ndarray, u: float, on: float, p: Rig, slip: np.ndarray, out: np.ndarray,
          holding: np.ndarray) -> None:  # fmt: skip
    """Write the derivative of each state; ``slip``: −1, 0 (stuck) or 1 for a joint with set-valued friction.

    ``holding`` receives the torque that holds each stuck joint [N m].
    """
    theta, w_theta, alpha, w_alpha = x[0], x[1], x[2], x[3]
    geared = p.hub_inertia > 0.0
    hub, w_hub = (x[4], x[5]) if geared else (theta, w_theta)
    sin, cos = math.sin(alpha), math.cos(alpha)
    sin2 = 2.0 * sin * cos
    faded = 1.0 + p.fading * t
    level_theta = faded * (1.0 + p.eccentricity * math.cos(hub - 0.5))
    level_alpha = faded * (1.0 + p.eccentricity * math.cos(alpha - 0.7))
    g_theta = _limit(p.coulomb_theta, p.stiction_theta, p.stribeck_theta, level_theta, w_hub)
    g_alpha = _limit(p.coulomb_alpha, p.stiction_alpha, p.stribeck_alpha, level_alpha, w_alpha)
    dry_theta, out[6] = _dry(p, g_theta, level_theta * (p.coulomb_theta + p.stiction_theta), p.presliding_theta,
                             p.bristle_damping_theta, w_hub, x[6])  # fmt: skip
    dry_alpha, out[7] = _dry(p, g_alpha, level_alpha * (p.coulomb_alpha + p.stiction_alpha), p.presliding_alpha,
                             p.bristle_damping_alpha, w_alpha, x[7])  # fmt: skip

    F_hub = p.torque_per_volt * u - on * p.back_emf * w_hub - faded * p.b_theta * w_hub - dry_theta
    F_theta = -p.cable * theta - p.cable_cubic * theta**3
    F_theta -= p.drag_theta * abs(w_theta) * w_theta + p.springpot_theta * x[9]
    F_theta += (p.C3 * sin * w_alpha - p.C6 * sin2 * w_theta) * w_alpha  # (9)
    F_alpha = 0.5 * p.C6 * sin2 * w_theta * w_theta - p.C4 * sin - faded * p.b_alpha * w_alpha - dry_alpha  # (10)
    F_alpha -= p.drag_alpha * abs(w_alpha) * w_alpha + p.springpot_alpha * x[10]
    e_r = p.lean_x * math.cos(theta) + p.lean_y * math.sin(theta)
    e_t = p.lean_y * math.cos(theta) - p.lean_x * math.sin(theta)
    F_theta += 9.81 * p.arm_moment * e_t - p.C4 * sin * e_r
    F_alpha += p.C4 * cos * e_t
    J = p.J_theta
    if geared:
        twist = hub - theta
        excess = twist - min(max(twist, -p.play), p.play)
        torque = p.shaft_stiffness * excess + p.shaft_damping * (w_hub - w_theta)
        if p.play > 0.0 and torque * excess <= 0.0:  # teeth push, they do not pull
            torque = 0.0
        out[4], out[5] = w_hub, (F_hub - torque) / p.hub_inertia
        F_theta += torque
        J -= p.hub_inertia
    else:
        out[4] = out[5] = 0.0
        F_theta += F_hub

    M11, M12, M22 = J + p.C6 * sin * sin, p.C3 * cos, p.C1  # (8)
    if p.friction == SET_VALUED:
        F_theta -= slip[0] * g_theta
        F_alpha -= slip[1] * g_alpha
    stuck_theta, stuck_alpha = p.friction == SET_VALUED and slip[0] == 0, p.friction == SET_VALUED and slip[1] == 0
    if stuck_theta and stuck_alpha:
        a_theta = a_alpha = 0.0
    elif stuck_theta:
        a_theta, a_alpha = 0.0, F_alpha / M22
    elif stuck_alpha:
        a_theta, a_alpha = F_theta / M11, 0.0
    else:
        det = M11 * M22 - M12 * M12
        a_theta = (M22 * F_theta - M12 * F_alpha) / det
        a_alpha = (M11 * F_alpha - M12 * F_theta) / det
    holding[0], holding[1] = F_theta - M12 * a_alpha, F_alpha - M12 * a_theta
    out[0], out[1], out[2], out[3] = w_theta, a_theta, w_alpha, a_alpha
    out[8] = (alpha - x[8]) / p.lowpass if p.lowpass > 0.0 else 0.0
    out[9], out[10] = w_theta, w_alpha  # D^{1−ν} y = v


def energy(rig: Rig, x: np.ndarray) -> np.ndarray:
    """Return kinetic and potential energy [J] of states, shape (..., 11)."""
    theta, w, alpha, w_alpha, hub, w_hub = np.moveaxis(np.asarray(x)[..., :6], -1, 0)
    J = rig.J_theta - rig.hub_inertia + rig.C6 * np.sin(alpha) ** 2
    kinetic = 0.5 * (J * w**2 + rig.hub_inertia * w_hub**2 + rig.C1 * w_alpha**2) + rig.C3 * np.cos(alpha) * w * w_alpha
    height = rig.C4 * (1 - np.cos(alpha))
    height -= 9.81 * rig.arm_moment * (rig.lean_x * np.cos(theta) + rig.lean_y * np.sin(theta))
    height -= rig.C4 * np.sin(alpha) * (rig.lean_y * np.cos(theta) - rig.lean_x * np.sin(theta))
    excess = hub - theta - np.clip(hub - theta, -rig.play, rig.play)
    springs = rig.cable * theta**2 + 0.5 * rig.cable_cubic * theta**4 + rig.shaft_stiffness * excess**2
    return kinetic + height + 0.5 * springs


# --- integer order: Runge-Kutta, with events where joints stick ----------------------------------------------


class Drive(NamedTuple):
    """The input of a run."""

    volts: np.ndarray = np.zeros(1)
    """At each multiple of the period; the last one stays [V]."""
    amplifier: np.ndarray = np.zeros(1)
    """1 where it is on, 0 where it is off; the last one stays."""
    period: float = 1.0
    """[s]; a whole number of steps."""
    held: bool = True
    """Whether the voltage stays between samples; else it goes in lines."""


class Joints(NamedTuple):
    """What a run with set-valued friction keeps beside the states, and its scratch."""

    slip: np.ndarray
    """Of arm and pendulum: −1, 0 (stuck) or 1."""
    holding: np.ndarray
    """What holds a stuck joint at the end of the step [N m]."""
    slopes: np.ndarray
    """The four of a step, shape (4, 11)."""


@njit(cache=True)
def _input(drive: Drive, t: float, k: int) -> tuple[float, float]:
    """Return voltage and amplifier at a time in the k-th interval between samples."""
    volts, here = drive.volts, min(k, drive.volts.size - 1)
    on = drive.amplifier[min(k, drive.amplifier.size - 1)]
    if drive.held or here + 1 >= volts.size:
        return volts[here], on
    return volts[k] + (volts[k + 1] - volts[k]) * (t / drive.period - k), on


@njit(cache=True)
def _step(t: float, h: float, x: np.ndarray, drive: Drive, k: int, p: Rig, joints: Joints, y: np.ndarray) -> None:
    """One step of the classical Runge-Kutta scheme from x to y; y may be x."""
    slip, holding, s = joints
    begin, on = _input(drive, t, k)
    middle, end = _input(drive, t + h / 2, k)[0], _input(drive, t + h, k)[0]
    rates(t, x, begin, on, p, slip, s[0], holding)
    rates(t + h / 2, x + h / 2 * s[0], middle, on, p, slip, s[1], holding)
    rates(t + h / 2, x + h / 2 * s[1], middle, on, p, slip, s[2], holding)
    rates(t + h, x + h * s[2], end, on, p, slip, s[3], holding)
    y[:] = x + h / 6 * (s[0] + 2 * s[1] + 2 * s[2] + s[3])
    if p.friction == SET_VALUED:
        rates(t + h, y, end, on, p, slip, s[0], holding)


@njit(cache=True)
def _breakaway(t: float, x: np.ndarray, p: Rig) -> tuple[float, float]:
    """Return the torque that breaks each joint away [N m]."""
    faded = 1.0 + p.fading * t
    theta = (p.coulomb_theta + p.stiction_theta) * (1.0 + p.eccentricity * math.cos(x[0] - 0.5))
    alpha = (p.coulomb_alpha + p.stiction_alpha) * (1.0 + p.eccentricity * math.cos(x[2] - 0.7))
    return faded * theta, faded * alpha


@njit(cache=True)
def _settle(t: float, x: np.ndarray, drive: Drive, k: int, p: Rig, joints: Joints) -> None:
    """Find whether each joint sticks or slips, and which way: the one choice that contradicts no law.

    A joint that moves slips; one at rest sticks where no more than the breakaway torque holds it, or else starts
    the way that it accelerates.
    """
    slip, holding, slopes = joints
    u, on = _input(drive, t, k)
    limits = _breakaway(t, x, p)
    for a in (0, 1, -1):
        if x[1] != 0.0 and a != np.sign(x[1]):
            continue
        for b in (0, 1, -1):
            if x[3] != 0.0 and b != np.sign(x[3]):
                continue
            slip[0], slip[1] = a, b
            rates(t, x, u, on, p, slip, slopes[0], holding)
            good_a = x[1] != 0.0 or (abs(holding[0]) <= limits[0] if a == 0 else slopes[0][1] * a > 0.0)
            good_b = x[3] != 0.0 or (abs(holding[1]) <= limits[1] if b == 0 else slopes[0][3] * b > 0.0)
            if good_a and good_b:
                return
    raise ValueError("no choice of sticking and slipping agrees with the laws of friction")


@njit(cache=True)
def _past_an_event(t: float, y: np.ndarray, p: Rig, joints: Joints) -> bool:
    """Whether a joint has turned round, or is held by more than breaks it away."""
    limits = _breakaway(t, y, p)
    for j in range(2):
        slip = joints.slip[j]
        if abs(joints.holding[j]) > limits[j] if slip == 0 else slip * y[1 + 2 * j] < 0.0:
            return True
    return False


@njit(cache=True)
def _with_events(t: float, h: float, x: np.ndarray, drive: Drive, k: int, p: Rig, joints: Joints) -> None:
    """One step with as many events in it as there are."""
    slip, holding, _ = joints
    y, end = np.empty_like(x), t + h
    for _ in range(50):
        if end - t <= 1e-15:
            return
        _step(t, end - t, x, drive, k, p, joints, y)
        if not _past_an_event(end, y, p, joints):
            x[:] = y
            return
        low, high = 0.0, end - t
        while high - low > 1e-13:
            middle = 0.5 * (low + high)
            _step(t, middle, x, drive, k, p, joints, y)
            low, high = (low, middle) if _past_an_event(t + middle, y, p, joints) else (middle, high)
        _step(t, high, x, drive, k, p, joints, y)
        t += high
        x[:] = y
        limits = _breakaway(t, x, p)
        for j in range(2):
            if slip[j] == 0 and abs(holding[j]) > limits[j]:
                x[1 + 2 * j] = np.sign(holding[j]) * 1e-14  # its sign says that it moves, and which way
            elif slip[j] != 0 and slip[j] * x[1 + 2 * j] < 0.0:
                x[1 + 2 * j] = 0.0
        _settle(t, x, drive, k, p, joints)
    raise ValueError("fifty events within one step")


@njit(cache=True)
def _ordinary(p: Rig, x: np.ndarray, h: float, kept: int, rows: int, drive: Drive) -> np.ndarray:
    """All states every ``kept`` steps of h."""
    out = np.empty((rows, x.size))
    out[0] = x
    joints = Joints(np.zeros(2), np.zeros(2), np.zeros((4, x.size)))
    per_sample = max(1, round(drive.period / h))
    for i in range((rows - 1) * kept):
        t, k = i * h, i // per_sample
        if p.friction == SET_VALUED:
            if i == 0 or (i % per_sample == 0 and k < drive.volts.size):  # a held input may have jumped
                _settle(t, x, drive, k, p, joints)
            _with_events(t, h, x, drive, k, p, joints)
        else:
            _step(t, h, x, drive, k, p, joints, x)
        if (i + 1) % kept == 0:
            out[(i + 1) // kept] = x
    return out


def ordinary(
    rig: Rig, initial: np.ndarray, *, step: float, end: float, kept: int = 1, drive: Drive | None = None
) -> np.ndarray:
    """Solve a rig of integer orders; all states every ``kept`` steps, shape (n, 11)."""
    if rig.friction == SET_VALUED and rig.hub_inertia > 0.0:
        raise ValueError("set-valued friction is for a rig whose hub and arm move together")
    rows = math.ceil(end / (kept * step) - 1e-9) + 1
    return _ordinary(rig, np.array(initial, dtype=float), step, kept, rows, drive or Drive())


# --- fractional orders: product integration over the whole past ------------------------------------------------


def _weights(order: float, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights of f_{n−k} (k > 0) and of f_0 in the trapezoidal rule, times Γ(order + 2)/h^order.

    (k+1)^{q+1} − 2k^{q+1} + (k−1)^{q+1} loses all digits at large k; from 60 on its series in 1/k takes over.
    """
    k, q = np.arange(n, dtype=float), order
    with np.errstate(divide="ignore", invalid="ignore"):
        a = (k + 1) ** (q + 1) - 2 * k ** (q + 1) + np.abs(k - 1) ** (q + 1)
        c2, c4 = (q - 1) * (q - 2) / 12, (q - 1) * (q - 2) * (q - 3) * (q - 4) / 360
        series = q * (q + 1) * k ** (q - 1) * (1 + c2 / k**2 + c4 / k**4)
        first = k**q * ((k - 1) * np.expm1(q * np.log1p(-1 / k)) + q)  # (k−1)^{q+1} − (k−1−q) k^q
    a[60:] = series[60:]
    a[0] = first[0] = 0.0
    if n > 1:
        first[1] = q
    return a, first


@njit(cache=True)
def _leaf(low: int, high: int, h: float, p: Rig, volts: np.ndarray, active: np.ndarray, scale: np.ndarray,
          a: np.ndarray, first: np.ndarray, past: np.ndarray, f: np.ndarray, x: np.ndarray) -> None:  # fmt: skip
    """Steps low to high − 1; ``past`` has the sums over all f before low."""
    slip, holding, out, now = np.zeros(2), np.zeros(2), np.zeros(x.shape[1]), np.empty(x.shape[1])
    for n in range(max(low, 1), high):
        now[:] = x[n - 1]
        for i, s in enumerate(active):
            total = past[i, n] + first[i, n] * f[i, 0]
            for j in range(max(low, 1), n):
                total += a[i, n - j] * f[i, j]
            past[i, n] = x[0, s] + scale[i] * total
            now[s] = past[i, n] + scale[i] * (2 * f[i, n - 1] - f[i, n - 2] if n > 1 else f[i, 0])
        u = volts[min(n, volts.size - 1)]
        for _ in range(50):  # to the fixed point of the implicit rule
            rates(n * h, now, u, 0.0, p, slip, out, holding)
            change = 0.0
            for i, s in enumerate(active):
                value = past[i, n] + scale[i] * out[s]
                change = max(change, abs(value - now[s]) / (1.0 + abs(value)))
                now[s] = value
            if change < 1e-14:
                break
        rates(n * h, now, u, 0.0, p, slip, out, holding)
        x[n] = now
        for i, s in enumerate(active):
            f[i, n] = out[s]


def fractional(rig: Rig, initial: np.ndarray, *, orders: tuple[float, float] = (1.0, 1.0),
               springpot_orders: tuple[float, float] = (0.5, 0.5), step: float, end: float,
               volts: np.ndarray | None = None) -> np.ndarray:  # fmt: skip
    """Solve D^λ θ = x₂, D^λ x₂ = …, D^μ α = x₄, D^μ x₄ = … and the springpots' D^{1−ν} y = v, all after Caputo.

    The polygon through f is integrated exactly (Diethelm's corrector, solved to its fixed point).  The sums over the
    past are done by halves: the second half of an interval needs the first half once, by FFT.  ``volts`` is the
    input at each step.  Returns all states at each step, shape (n, 11).
    """
    if rig.friction != TANH or rig.hub_inertia > 0.0 or rig.lowpass > 0.0:
        raise ValueError("fractional orders are for a rigid rig with smooth friction")
    active = np.array([0, 1, 2, 3, *([9] if rig.springpot_theta else []), *([10] if rig.springpot_alpha else [])])
    q = np.array([orders[0]] * 2 + [orders[1]] * 2 + [0.0] * 5 + [1 - nu for nu in springpot_orders])[active]
    n = round(end / step) + 1
    a, first = (np.array(w) for w in zip(*(_weights(order, n) for order in q), strict=True))
    scale = step**q / np.array([math.gamma(order + 2) for order in q])
    x, f, past = np.zeros((n, len(STATES))), np.zeros((len(active), n)), np.zeros((len(active), n))
    x[0] = initial
    volts = np.zeros(1) if volts is None else np.ascontiguousarray(volts, dtype=float)
    out = np.zeros(len(STATES))
    rates(0.0, x[0], volts[0], 0.0, rig, np.zeros(2), out, np.zeros(2))
    f[:, 0] = out[active]
    spectrum = lru_cache(maxsize=None)(lambda size: fft.rfft(a[:, :size], fft.next_fast_len(size, real=True)))

    def advance(low: int, high: int) -> None:
        if high - low <= 256:
            _leaf(low, high, step, rig, volts, active, scale, a, first, past, f, x)
            return
        middle, size = (low + high) // 2, high - low
        advance(low, middle)
        begin = max(low, 1)  # f_0 has weights of its own
        length = fft.next_fast_len(size, real=True)
        sums = fft.irfft(spectrum(size) * fft.rfft(f[:, begin:middle], length), length)
        past[:, middle:high] += sums[:, middle - begin : high - begin]
        advance(middle, high)

    advance(0, n)
    return x


# --- what is in a recording ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sensor:
    """How angles become numbers in a file."""

    counts: float = 4096.0
    """Encoder steps a turn, both angles."""
    noise: float = 0.1
    """Of both angles, white, before rounding [encoder steps]."""
    dither: bool = False
    """Whether noise of one step, uniform, goes before the rounding, so that the rounding is white."""
    theta_late: float = 0.0
    """[s]"""
    alpha_late: float = 0.0
    """[s]"""
    alpha_gain: float = 1.0
    """Wrong counts a turn of α's encoder, as a factor."""
    alpha_bias: float = 0.0
    """[rad]"""
    jitter: float = 0.0
    """Standard deviation of the time at which a sample is taken, which the time column does not show [s]."""
    theta_of_hub: bool = False
    """Whether θ's encoder sits on the motor's side."""


@dataclass(frozen=True)
class Twin:
    """A rig, its sensors and orders: all that is known of a truth before it is recorded."""

    rig: Rig
    sensor: Sensor = field(default_factory=Sensor)
    orders: tuple[float, float] = (1.0, 1.0)
    springpot_orders: tuple[float, float] = (0.5, 0.5)
    drive: str = ""
    """`pulses` or `multisine`; empty: a release."""
    held: bool = True
    """Whether the converter holds the input between samples; else it is a line from sample to sample."""
    sample: float = 0.0
    """Time between samples that the truth asks for [s]; 0: the caller's."""
    off_after: float = 1.0
    """Part of a driven recording after which the amplifier is off."""
    seed: int = 0
    """Of the rig."""

    @property
    def chance(self) -> np.random.Generator:
        """For constants of a kind that differ from rig to rig; each call begins anew."""
        return np.random.default_rng([self.seed, 3])

    @property
    def fractional(self) -> bool:
        """Whether an order is off 1 or a joint has a springpot."""
        return self.orders != (1.0, 1.0) or bool(self.rig.springpot_theta or self.rig.springpot_alpha)

    @property
    def step(self) -> float:
        """Of the integration [s], at most: halved, it moves no sample by 1e-3 encoder steps (3e-3 at order 0.7)."""
        if self.fractional:
            return 1e-4
        if self.rig.play > 0.0:  # teeth meet within a step: the order is lost there
            return 5e-6
        return 1e-5 if self.rig.friction == BRISTLE or self.rig.hub_inertia > 0.0 else 1e-4


@dataclass(frozen=True)
class Truth:
    """What a recording was made from."""

    kind: str
    severity: float
    seed: int
    take: int
    fractional: bool
    """Whether the right claim is "fractional"."""
    orders: dict[str, float]
    """Lambda, mu, and ν of each springpot that is there."""
    rig: dict[str, float]
    """All constants of :class:`Rig`."""
    sensor: dict[str, Any]
    release: float
    """Angle of release [rad], 0 where driven."""
    begin: float
    """Time of release [s]; of a driven recording the first voltage."""


@dataclass(frozen=True)
class Recording:
    """A simulated recording, as a rig would write it."""

    time: np.ndarray
    """[s], shape (n,)."""
    theta: np.ndarray
    """[rad], shape (n,)."""
    alpha: np.ndarray
    """[rad], shape (n,), 0 hanging."""
    voltage: np.ndarray | None
    """[V], shape (n,); None of a release."""
    truth: Truth


@dataclass(frozen=True)
class Kind:
    """One thing that a rig has, from mild to gross."""

    name: str
    unit: str
    """Of the severity."""
    severities: tuple[float, ...]
    make: Callable[[Twin, float], Twin]
    """Twin, severity → the twin with it."""
    title: str

    @property
    def fractional(self) -> bool:
        """Whether the right claim is "fractional"."""
        return self.make(Twin(Rig()), self.severities[0]).fractional


KINDS: dict[str, Kind] = {}
"""Name → kind."""


def kind(name: str, title: str, unit: str, *severities: float) -> Callable[[Callable[..., Twin]], None]:
    """Enter a kind into the table."""

    def enter(make: Callable[[Twin, float], Twin]) -> None:
        KINDS[name] = Kind(name, unit, severities, make, title)

    return enter


def _with(twin: Twin, sensor: dict[str, Any] | None = None, more: dict[str, Any] | None = None, **rig: float) -> Twin:
    """Return the twin with other constants, other sensors and more."""
    rigged = twin.rig._replace(**{name: float(value) for name, value in rig.items()})
    return replace(twin, rig=rigged, sensor=replace(twin.sensor, **(sensor or {})), **(more or {}))


@kind("none", "nothing but the model: viscous and smooth dry friction, cable", "-", 1)
def _(twin: Twin, _s: float) -> Twin:
    return twin


@kind("sticking", "set-valued Coulomb friction, joints stick", "times", 0.5, 1, 3)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, friction=SET_VALUED, coulomb_theta=s * twin.rig.coulomb_theta,
                 coulomb_alpha=s * twin.rig.coulomb_alpha)  # fmt: skip


@kind("stribeck", "set-valued friction that falls with speed: stiction above sliding", "times f", 0.3, 1, 3)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, friction=SET_VALUED, stiction_theta=s * twin.rig.coulomb_theta,
                 stiction_alpha=s * twin.rig.coulomb_alpha, stribeck_theta=twin.chance.uniform(0.02, 0.2),
                 stribeck_alpha=twin.chance.uniform(0.1, 1.0))  # fmt: skip


@kind("dahl", "presliding without stiction (Dahl), both joints", "° of δ at the arm", 0.1, 0.5, 2)
def _(twin: Twin, s: float) -> Twin:
    δ = math.radians(s)
    return _with(
        twin, friction=BRISTLE, presliding_theta=δ, presliding_alpha=δ * twin.chance.uniform(0.5, 3), cable=0.002
    )


@kind("lugre", "presliding with stiction (LuGre), both joints as on a real SRV02", "° of δ at the arm", 0.1, 0.5, 1)
def _(twin: Twin, s: float) -> Twin:
    δ, near = math.radians(s), np.exp(0.2 * twin.chance.standard_normal(6))
    return _with(twin, friction=BRISTLE, coulomb_theta=0.0317 * near[0], stiction_theta=0.074 * near[1],
                 stribeck_theta=0.032 * near[2], presliding_theta=δ, coulomb_alpha=2e-5,
                 stiction_alpha=1.45e-4 * near[3], stribeck_alpha=0.68 * near[4], presliding_alpha=9 * δ,
                 bristle_damping_alpha=9.5e-4 * near[5], b_theta=0.110, b_alpha=4.75e-4, cable=0.002)  # fmt: skip


DRIVE_INERTIA = 2.08e-3
"""Motor and gears of the SRV02, seen from the arm [kg m²]."""


@kind("play", "play of the gear, θ read at the arm", "°, half the gap", 0.1, 0.25, 0.5)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, hub_inertia=DRIVE_INERTIA, shaft_stiffness=1000.0, shaft_damping=0.3, play=math.radians(s))


@kind("backlash", "play of the gear, θ read at the motor", "°, half the gap", 0.1, 0.25, 0.5)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, {"theta_of_hub": True}, hub_inertia=DRIVE_INERTIA, shaft_stiffness=1000.0, shaft_damping=0.3,
                 play=math.radians(s))  # fmt: skip


def _elastic(rig: Rig, frequency: float, damping: float) -> dict[str, float]:
    """Return the shaft whose mode, hub against arm and both free, has a frequency [Hz] and a damping ratio."""
    reduced = DRIVE_INERTIA * (rig.J_theta - DRIVE_INERTIA) / rig.J_theta
    omega = 2 * math.pi * frequency
    return {"hub_inertia": DRIVE_INERTIA, "shaft_stiffness": reduced * omega**2,
            "shaft_damping": 2 * damping * reduced * omega}  # fmt: skip


@kind("elastic", "elastic arm, θ read at the hub", "Hz", 40, 21, 12)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, {"theta_of_hub": True}, **_elastic(twin.rig, s, twin.chance.uniform(0.01, 0.05)))


@kind("elastic-tip", "elastic arm, θ read at the tip", "Hz", 40, 21, 12)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, **_elastic(twin.rig, s, twin.chance.uniform(0.01, 0.05)))


@kind("cubic-cable", "cable that hardens", "N m/rad³", 0.02, 0.1, 0.3)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, cable_cubic=s)


@kind("drag", "quadratic drag of both joints", "times 1e-5 N m s²/rad²", 1, 5, 20)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, drag_alpha=1e-5 * s, drag_theta=2e-4 * s)


@kind("eccentric", "dry friction that goes with the angle", "part", 0.2, 0.5, 0.9)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, eccentricity=s)


@kind("fading", "all friction falls or rises with time", "%/s", -0.5, -1.5, 1.5)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, fading=0.01 * s)


@kind("tilted", "axis that is not vertical", "°", 0.5, 2)
def _(twin: Twin, s: float) -> Twin:
    way = twin.chance.uniform(-math.pi, math.pi)
    return _with(twin, lean_x=math.radians(s) * math.cos(way), lean_y=math.radians(s) * math.sin(way))


@kind("alpha-lowpass", "α behind a first-order filter", "ms", 1, 5, 20)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, lowpass=1e-3 * s)


@kind("theta-late", "θ read late", "ms", 0.5, 2, 5)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, {"theta_late": 1e-3 * s})


@kind("alpha-late", "α read late", "ms", 0.5, 2, 5)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, {"alpha_late": 1e-3 * s})


@kind("held-input", "input held between samples", "ms", 2, 5, 10)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, more={"drive": "multisine", "held": True, "sample": 1e-3 * s})


@kind("line-input", "input that goes in lines between samples", "ms", 2, 5, 10)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, more={"drive": "multisine", "held": False, "sample": 1e-3 * s})


@kind("back-emf", "pulses, then the amplifier off: the motor brakes while it is on", "times 0.069 N m s/rad", 0.3, 1)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, more={"drive": "pulses", "off_after": 0.5}, back_emf=0.069 * s)


@kind("pulses", "nothing but the model, driven by pulses", "-", 1)
def _(twin: Twin, _s: float) -> Twin:
    return _with(twin, more={"drive": "pulses"})


@kind("encoder", "coarse encoders without dither", "counts a turn", 4096, 2000, 1024)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, {"counts": s, "noise": 0.0})


@kind("dithered", "encoders with dither", "counts a turn", 4096, 1024)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, {"counts": s, "dither": True})


@kind("jitter", "samples taken off their time", "ms", 0.1, 0.5, 2)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, {"jitter": 1e-3 * s})


@kind("gain", "wrong counts a turn of α's encoder", "%", 0.1, 0.5, 2)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, {"alpha_gain": 1 + 0.01 * s})


@kind("bias", "zero of α that is off", "°", 0.05, 0.2, 1)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, {"alpha_bias": math.radians(s)})


@kind("several", "LuGre, α late and filtered, friction that fades: mild, together", "times", 0.5, 1)
def _(twin: Twin, s: float) -> Twin:
    twin = KINDS["lugre"].make(twin, 0.3 * s)
    return _with(twin, {"alpha_late": 5e-4 * s, "alpha_gain": 1 + 1e-3 * s}, lowpass=1e-3 * s, fading=-0.003 * s)


@kind("orders", "both orders below 1", "order", 0.97, 0.9, 0.8, 0.7)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, more={"orders": (s, s)})


@kind("order-mu", "the pendulum's order below 1", "order", 0.97, 0.9, 0.8)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, more={"orders": (1.0, s)})


@kind("order-lambda", "the arm's order below 1", "order", 0.97, 0.9, 0.8)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, more={"orders": (s, 1.0)})


@kind("springpot-alpha", "springpot at the pendulum, order 0.3 to 0.7", "times 1e-3 N m s^ν/rad", 0.5, 2, 5)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, more={"springpot_orders": (0.5, twin.chance.uniform(0.3, 0.7))}, springpot_alpha=1e-3 * s)


@kind("springpot-theta", "springpot at the arm, order 0.3 to 0.7", "times 1e-2 N m s^ν/rad", 0.5, 2, 5)
def _(twin: Twin, s: float) -> Twin:
    return _with(twin, more={"springpot_orders": (twin.chance.uniform(0.3, 0.7), 0.5)}, springpot_theta=1e-2 * s)


# --- a rig is recorded -----------------------------------------------------------------------------------------


def drawn_rig(rng: np.random.Generator) -> Rig:
    """Draw a rig near the SRV02; C4 stays, for a draft takes it as known."""
    near = dict(zip(("C1", "C3", "C6", "J_theta"), np.exp(0.05 * rng.standard_normal(4)), strict=True))
    srv02 = Rig()
    inertias = {name: getattr(srv02, name) * factor for name, factor in near.items()}

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(math.log(low), math.log(high))))

    return srv02._replace(**{name: float(value) for name, value in inertias.items()}, b_theta=between(0.01, 0.13),
                          b_alpha=between(1e-4, 6e-4), coulomb_theta=between(2e-3, 0.04),
                          coulomb_alpha=between(1e-4, 1e-3), cable=between(5e-3, 0.05))  # fmt: skip


def drawn_twin(name: str, severity: float, seed: int) -> Twin:
    """Return the twin of a kind; a seed is a rig, whose recordings share all constants."""
    if name not in KINDS:
        raise ValueError(f"kind {name!r}: expected one of {', '.join(KINDS)}")
    return KINDS[name].make(Twin(drawn_rig(np.random.default_rng([seed, 1])), seed=seed), severity)


def recording(name: str, severity: float, *, seed: int, take: int = 0, seconds: float = 20.0, rate: float = 500.0,
              release: float = 75.0, plateau: float = 1.0) -> Recording:  # fmt: skip
    """Return a recording of a rig that has something.

    ``seed`` is the rig, ``take`` its recording: another noise, another drive.  ``release`` [°] is the angle from which
    it falls after it was held for ``plateau`` [s]; a driven kind begins at rest instead.  ``rate`` [Hz].
    """
    twin = drawn_twin(name, severity, seed)
    rng = np.random.default_rng([seed, 2, take])
    period = twin.sample or 1 / rate
    time = np.arange(round((plateau + seconds) / period) + 1) * period
    volts = _drive(twin, time, plateau, rng) if twin.drive else None
    begin = 0.0 if twin.drive else plateau + period * rng.uniform()  # a hand lets go between two samples
    angle = 0.0 if twin.drive else math.radians(release)
    motion, step = _motion(twin, angle, time[-1] - begin, volts, period)
    theta, alpha = _read(twin, motion, step, time - begin, rng)
    orders = dict(zip(("lambda", "mu"), twin.orders, strict=True))
    springpots = dict(zip(("springpot_theta", "springpot_alpha"), twin.springpot_orders, strict=True))
    orders |= {name: order for name, order in springpots.items() if getattr(twin.rig, name)}
    truth = Truth(name, severity, seed, take, twin.fractional, orders, twin.rig._asdict(), asdict(twin.sensor), angle,
                  plateau if twin.drive else begin)  # fmt: skip
    return Recording(time, theta, alpha, volts, truth)


def _drive(twin: Twin, time: np.ndarray, plateau: float, rng: np.random.Generator) -> np.ndarray:
    """Return pulses of 2 to 6 V of alternating sign, or a multisine of 0.2 to 5 Hz and 1.5 V rms; 0 on the plateau."""
    volts, end = np.zeros_like(time), time[-1]
    if twin.drive == "multisine":
        frequency = np.arange(0.2, 5.0, 0.2) * rng.uniform(0.9, 1.1)
        phase = rng.uniform(0, 2 * math.pi, frequency.size)
        volts = (
            np.sin(2 * math.pi * frequency * time[:, None] + phase).sum(axis=1) * 1.5 / math.sqrt(frequency.size / 2)
        )
    else:
        begin, sign = plateau, rng.choice([-1.0, 1.0])
        while begin < twin.off_after * end:
            pulse = (time >= begin) & (time < begin + rng.uniform(0.1, 0.4))
            volts[pulse] = sign * rng.uniform(2.0, 6.0)
            begin, sign = begin + rng.uniform(0.8, 2.0), -sign
    return np.where(time < plateau, 0.0, np.round(volts, 4))


def _motion(twin: Twin, angle: float, end: float, volts: np.ndarray | None, period: float) -> tuple[np.ndarray, float]:
    """Return all states from the release or the first sample on, and the time between them."""
    initial = np.zeros(len(STATES))
    initial[[2, 8]] = angle
    if twin.fractional:
        n = math.ceil(end / twin.step - 1e-9) + 1
        return fractional(twin.rig, initial, orders=twin.orders, springpot_orders=twin.springpot_orders,
                          step=twin.step, end=(n - 1) * twin.step), twin.step  # fmt: skip
    if volts is None:
        step, kept, drive = twin.step, max(1, round(2e-4 / twin.step)), None
    else:
        per_sample = math.ceil(period / twin.step - 1e-9)
        step, kept = period / per_sample, math.gcd(per_sample, max(1, round(2e-4 / twin.step)))
        on = (np.arange(volts.size) < twin.off_after * volts.size).astype(float)
        drive = Drive(volts, on, period, twin.held)
    x = ordinary(twin.rig, initial, step=step, end=end, kept=kept, drive=drive)
    return x, kept * step


def _read(
    twin: Twin, x: np.ndarray, step: float, time: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return θ and α as the encoders count them at each time; before 0 the rig is held."""
    sensor, rig = twin.sensor, twin.rig
    at = time + sensor.jitter * rng.standard_normal(time.size)
    hub = sensor.theta_of_hub and rig.hub_inertia > 0.0
    first, smooth = (4 if hub else 0), twin.orders == (1.0, 1.0)
    theta = _between(x[:, first], x[:, first + 1] if smooth else None, step, at - sensor.theta_late)
    if rig.lowpass > 0.0:
        alpha = _between(x[:, 8], (x[:, 2] - x[:, 8]) / rig.lowpass, step, at - sensor.alpha_late)
    else:
        alpha = _between(x[:, 2], x[:, 3] if smooth else None, step, at - sensor.alpha_late)
    return _counted(theta, sensor, rng), _counted(sensor.alpha_gain * alpha + sensor.alpha_bias, sensor, rng)


def _between(y: np.ndarray, rate: np.ndarray | None, step: float, time: np.ndarray) -> np.ndarray:
    """Return a signal at any time: Hermite's cubic; where its rate is not known, by central differences."""
    rate = np.gradient(y, step) if rate is None else rate
    at = np.clip(time / step, 0.0, y.size - 1.0)
    k = np.minimum(at.astype(int), y.size - 2)
    s = at - k
    a, b, da, db = y[k], y[k + 1], step * rate[k], step * rate[k + 1]
    return a + s * (da + s * (3 * (b - a) - 2 * da - db + s * (2 * (a - b) + da + db)))


def _counted(y: np.ndarray, sensor: Sensor, rng: np.random.Generator) -> np.ndarray:
    """Return the angle in whole encoder steps, counted down, times the step [rad]."""
    step = 2 * math.pi / sensor.counts
    steps = y / step + sensor.noise * rng.standard_normal(y.size)
    return step * np.floor(steps + (rng.uniform(-0.5, 0.5, y.size) if sensor.dither else 0.0) + 0.5 * sensor.dither)


def write(record: Recording, folder: Path) -> Path:
    """Write a recording as CSV: time [s], theta and alpha [rad], and voltage [V] where there is one."""
    truth = record.truth
    columns = {"time": record.time, "theta": record.theta, "alpha": record.alpha}
    columns |= {} if record.voltage is None else {"voltage": record.voltage}
    file = folder / f"{truth.kind}_{truth.severity:g}_{truth.seed}_{truth.take}.csv"
    folder.mkdir(parents=True, exist_ok=True)
    np.savetxt(file, np.column_stack([*columns.values()]), delimiter=",", header=",".join(columns), comments="",
               fmt="%.10g", encoding="utf-8")  # fmt: skip
    return file
