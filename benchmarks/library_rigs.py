"""Recordings of the library's models with known truth, made without fracid: what their unedited drafts are tested on.

The equations are written anew, of order 1, and solved by fourth-order Runge-Kutta with 40 steps to a sample; a
springpot's force is an exact sum of powers, since what drives it is a polygon, and the voltage of a constant-phase
element comes from the product trapezoidal rule, exact where it has no leak and its capacity is constant.  All constants
are drawn: a factor of 1.6 about those of the library either way.

>>> rig = recorded("oscillator", rate=50, rng=np.random.default_rng(1))
>>> sorted(rig.truth)[:3], list(rig.columns)
(['b_displacement', 'coulomb_displacement', 'k'], ['time', 'force', 'displacement [m]'])
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

SUBSTEPS = 40
"""Runge-Kutta steps to a sample; twice as many move no sample by a hundredth of its noise."""

Columns = dict[str, np.ndarray]
Rates = Callable[[Any, Any], tuple[float, ...]]


@dataclass(frozen=True)
class Recorded:
    """One recording of a model."""

    model: str
    truth: dict[str, float]
    columns: Columns
    gauge: tuple[str, tuple[str, ...]] = ("", ())
    """A constant that the draft assumes, and those that scale with it."""


def recorded(name: str, rate: int, rng: np.random.Generator) -> Recorded:
    """Make one."""
    return KINDS[name](rate, rng)


# --- what is common ----------------------------------------------------------------------------------------------


def near(rng: np.random.Generator, **values: float) -> dict[str, float]:
    """Each within a factor of 1.6."""
    return {n: v * math.exp(rng.uniform(-0.47, 0.47)) for n, v in values.items()}


def driven(rng: np.random.Generator, time: np.ndarray, low: float, high: float) -> np.ndarray:
    """Eight sines between two frequencies [Hz], 0 at first, of size 1."""
    sines = np.geomspace(low, high, 8) * np.exp(rng.uniform(-0.1, 0.1, 8))
    waves = np.sin(2 * np.pi * np.outer(time, sines) + rng.uniform(0, 2 * np.pi, 8)).sum(axis=1) / 4
    return np.asarray(waves * np.minimum(1.0, time / (0.05 * time[-1])))


def solved(rates: Rates, first: list[float], u: np.ndarray, step: float, hold: bool = False) -> np.ndarray:
    """States at the samples, shape (n_samples, n); the input is a line between samples, or keeps its value."""
    x, out, h = np.array(first), [np.array(first)], step / SUBSTEPS
    f = lambda x, v: np.array(rates(x.tolist(), v))  # noqa: E731
    for u_0, u_1 in zip(u[:-1].tolist(), u[1:].tolist(), strict=True):
        slope = 0.0 if hold else (u_1 - u_0) / SUBSTEPS
        for k in range(SUBSTEPS):
            v = u_0 + k * slope
            a = f(x, v)
            b = f(x + h / 2 * a, v + slope / 2)
            c = f(x + h / 2 * b, v + slope / 2)
            x = x + h / 6 * (a + 2 * b + 2 * c + f(x + h * c, v + slope))
        out.append(x)
    return np.array(out)


def grid(rate: int, seconds: float) -> np.ndarray:
    return np.arange(round(seconds * rate)) / rate


def noisy(rng: np.random.Generator, y: np.ndarray, share: float) -> np.ndarray:
    """With white noise of a share of its deviation."""
    return np.asarray(y + share * y.std() * rng.standard_normal(y.size))


# --- the models --------------------------------------------------------------------------------------------------


def pendulum(rate: int, rng: np.random.Generator) -> Recorded:
    """It is let go from 15° to 90°."""
    p = near(rng, gravity=0.147, J=3e-3, b_angle=2e-4, coulomb_angle=6e-4) | {"slip_speed": 0.02}
    G, J, b, dry, slip = p.values()
    t = grid(rate, rng.uniform(10, 20))
    f = lambda x, _: (x[1], (-G * math.sin(x[0]) - b * x[1] - dry * math.tanh(x[1] / slip)) / J)  # noqa: E731
    x = solved(f, [math.radians(rng.uniform(15, 90)), 0.0], np.zeros(t.size), 1 / rate)
    angle = x[:, 0] + math.radians(0.05) * rng.standard_normal(t.size)
    return Recorded("pendulum", p, {"time": t, "angle [rad]": angle}, ("gravity", ("J", "b_angle", "coulomb_angle")))


def cart_pole(rate: int, rng: np.random.Generator) -> Recorded:
    """A force moves the cart."""
    p = near(rng, M=0.8, ml=0.03, J=6e-3, b_position=2.0, coulomb_position=0.3, b_angle=5e-4)
    M, ml, J, b, dry, b_pole = p.values()
    t = grid(rate, 12.0)
    force = 4.0 * driven(rng, t, 0.2, 3.0)

    def f(x: list[float], u: float) -> tuple[float, ...]:
        s, c = math.sin(x[2]), math.cos(x[2])
        along = u - b * x[1] - dry * math.tanh(x[1] / 0.01) + ml * s * x[3] ** 2
        torque = -ml * 9.81 * s - b_pole * x[3]
        det = M * J - (ml * c) ** 2
        return x[1], (J * along - ml * c * torque) / det, x[3], (M * torque - ml * c * along) / det

    x = solved(f, [0.0, 0.0, 0.0, 0.0], force, 1 / rate)
    columns = {
        "time": t,
        "force": force,
        "position [m]": noisy(rng, x[:, 0], 0.002),
        "angle [rad]": noisy(rng, x[:, 2], 0.003),
    }
    return Recorded("cart-pole", p, columns)


def joint(rate: int, rng: np.random.Generator) -> Recorded:
    """A robot's axis in gravity."""
    p = near(rng, J=5e-3, gravity=0.1, b_angle=0.02, coulomb_angle=0.03)
    J, G, b, dry = p.values()
    t = grid(rate, 10.0)
    torque = 0.25 * driven(rng, t, 0.2, 4.0)
    f = lambda x, u: (x[1], (u - G * math.sin(x[0]) - b * x[1] - dry * math.tanh(x[1] / 0.02)) / J)  # noqa: E731
    x = solved(f, [0.0, 0.0], torque, 1 / rate)
    return Recorded("joint", p, {"time": t, "torque": torque, "angle [rad]": noisy(rng, x[:, 0], 0.002)})


def two_mass(rate: int, rng: np.random.Generator) -> Recorded:
    """A motor turns a load through a shaft; dry friction at the motor."""
    p = near(rng, J_motor=4e-4, J_load=2e-3, k=1.3, d=5e-3, b_motor=5e-3, b_load=1e-3, coulomb_motor=5e-3)
    J_1, J_2, k, d, b_1, b_2, dry = p.values()
    t = grid(rate, 8.0)
    torque = 0.15 * driven(rng, t, 0.3, 12.0)

    def f(x: list[float], u: float) -> tuple[float, ...]:
        shaft = k * (x[0] - x[2]) + d * (x[1] - x[3])
        return (x[1], (u - b_1 * x[1] - dry * math.tanh(x[1] / 0.05) - shaft) / J_1, x[3], (shaft - b_2 * x[3]) / J_2)

    x = solved(f, [0.0] * 4, torque, 1 / rate)
    noise = math.radians(0.05) * rng.standard_normal((2, t.size))
    columns = {"time": t, "torque": torque, "motor [rad]": x[:, 0] + noise[0], "load [rad]": x[:, 2] + noise[1]}
    return Recorded("two-mass", p | {"coulomb_load": 0.0}, columns)


def oscillator(rate: int, rng: np.random.Generator) -> Recorded:
    """A force sweeps over the resonance."""
    p = near(rng, m=1.0, k=40.0, k3=9000.0, b_displacement=0.5, coulomb_displacement=0.04)
    m, k, k3, b, dry = p.values()
    t = grid(rate, 20.0)
    force = 3.0 * driven(rng, t, 0.3, 3.0)
    f = lambda x, u: (x[1], (u - b * x[1] - dry * math.tanh(x[1] / 0.01) - k * x[0] - k3 * x[0] ** 3) / m)  # noqa: E731
    x = solved(f, [0.0, 0.0], force, 1 / rate)
    return Recorded("oscillator", p, {"time": t, "force": force, "displacement [m]": noisy(rng, x[:, 0], 0.003)})


def tanks(_rate: int, rng: np.random.Generator) -> Recorded:
    """A pump that a converter drives fills both."""
    p = near(rng, k_pump=0.033, k_upper=0.035, k_lower=0.06)
    pump, upper, lower = p.values()
    t = 4.0 * np.arange(500)
    volts = np.round(2.4 + 1.2 * driven(rng, t, 1 / 600, 1 / 60), 3)

    def f(x: list[float], u: float) -> tuple[float, ...]:
        down = upper * math.sqrt(max(x[0], 0.0))
        return pump * max(u, 0.0) - down, down - lower * math.sqrt(max(x[1], 0.0))

    x = solved(f, [3.0, 2.0], volts, 4.0, hold=True)
    columns = {
        "time": t,
        "pump [V]": volts,
        "upper [V]": noisy(rng, x[:, 0], 0.01),
        "lower [V]": noisy(rng, x[:, 1], 0.01),
    }
    return Recorded("tanks", p, columns)


def springpot_force(slopes: np.ndarray, nu: float, step: float) -> np.ndarray:
    """D^ν of a polygon that begins at 0: slope changes times (t − t_i)^(1−ν)/Γ(2−ν), at its corners.

    >>> bool(np.allclose(springpot_force(np.ones(3), 0.0, 0.5), [0.0, 0.5, 1.0, 1.5]))
    True
    """
    powers = (step * np.arange(slopes.size + 1)) ** (1 - nu) / math.gamma(2 - nu)
    return np.convolve(np.diff(slopes, prepend=0.0), powers)[: slopes.size + 1]


def relaxation(_rate: int, rng: np.random.Generator) -> Recorded:
    """A strip is stretched in ramps."""
    p = near(rng, k=100.0, c=50.0) | {"nu": rng.uniform(0.15, 0.6)}
    t = 0.05 * np.arange(1200)
    corners = [0.0, 1.0, 20.0, 22.0, 40.0, 41.0, 60.0]
    stretch = np.interp(t, corners, np.array([0.0, 2.0, 2.0, 3.0, 3.0, 1.5, 1.5]) * 0.01)
    force = p["k"] * stretch + p["c"] * springpot_force(np.diff(stretch) / 0.05, p["nu"], 0.05)
    return Recorded("relaxation", p, {"time": t, "stretch [m]": stretch, "force [N]": noisy(rng, force, 0.005)})


def charged(current: np.ndarray, p: dict[str, float], step: float) -> np.ndarray:
    """v of (C0 + C1 v) D^q v = i − leak v, both sides 0 at first: their polygon is integrated exactly.

    >>> cell, ramp = {"C0": 2.0, "C1": 0.0, "leak": 0.0, "q": 1.0}, np.arange(4.0)
    >>> charged(ramp, cell, 1.0).tolist()
    [0.0, 0.25, 1.0, 2.25]
    >>> round(float(charged(np.full(2000, 0.5), cell | {"C1": 2.0}, 1e-3)[-1]), 3)  # 2 v + v² = i t
    0.414
    """
    q = p["q"]
    powers = step**q * np.arange(current.size + 1) ** (1 + q) / math.gamma(2 + q)
    weights = np.diff(powers, 2, prepend=0.0)
    v, f = np.zeros((2, current.size))
    for n in range(1, current.size):
        past = weights[1:n] @ f[n - 1 : 0 : -1]
        v[n] = v[n - 1]
        for _ in range(4):
            f[n] = (current[n] - p["leak"] * v[n]) / (p["C0"] + p["C1"] * v[n])
            v[n] = past + weights[0] * f[n]
    return v


def capacitor(_rate: int, rng: np.random.Generator) -> Recorded:
    """A cell is charged and discharged by steps of current: a constant-phase element behind a resistance.

    Of every other one the capacity grows with the voltage, and it leaks.
    """
    p = near(rng, C0=15.0, R=0.05) | {"q": rng.uniform(0.8, 0.98)}
    occurs = int(rng.integers(2))
    p |= {n: occurs * v for n, v in near(rng, C1=2.0, leak=4e-3).items()}
    t = 0.1 * np.arange(2400)
    knots = np.cumsum([0.0, 5.0, 0.1, 30.0, 0.1, 60.0, 0.1, 20.0, 0.1, 35.0, 0.1, 20.0, 0.1, 70.0])
    current = np.interp(np.arange(4 * t.size) / 40, knots, [0, 0, 1, 1, 0, 0, -1, -1, 0, 0, 0.5, 0.5, 0, 0])
    voltage = (charged(current, p, 0.025) + p["R"] * current)[::4]
    return Recorded("capacitor", p, {"time": t, "current [A]": current[::4], "voltage [V]": noisy(rng, voltage, 0.003)})


KINDS: dict[str, Callable[[int, np.random.Generator], Recorded]] = {
    "pendulum": pendulum, "cart-pole": cart_pole, "joint": joint, "two-mass": two_mass, "oscillator": oscillator,
    "tanks": tanks, "relaxation": relaxation, "capacitor": capacitor,
}  # fmt: skip
