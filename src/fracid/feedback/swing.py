r"""A pendulum that hangs is swung up by its energy, caught, and handed to a regulator.

The law is that of :mod:`fracid.solver.closed_loop`.  Its constants are those of the fitted model: g is its unstable
pole at upright, :math:`ω_0` the zero there from the input to the arm or cart, which is the pendulum whose pivot is
held, and n what the right-hand side says, by least squares (exact for a pendulum on a cart, or an arm without springs).
Pivots are accelerated in parts of what would hold the pendulum level, which makes their way about as long as it.

What grows at upright, φ + w/g, an input of :math:`\bar u` can turn back up to :math:`|b|\bar u/g^2`, with b the
acceleration per input; :data:`SURE` of it is trusted.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from fracid.arrays import FloatArray
from fracid.export.state_space import LinearModel
from fracid.models import Model
from fracid.safety.door import own_text
from fracid.schemas.feedback import Conditions, Controller, Swing
from fracid.solver.closed_loop import Law, Pump

CATCH, RELEASE, SURE, FAR = 0.4, 0.8, 0.6, 1.0
"""Angles at which the regulator takes over and gives up [rad], the part of its reach that is trusted, and how much."""

SHARP = 20.0
"""Parts of the whole pump for a missing energy of 1, which is half of that from hanging to upright."""

SMOOTHED = 0.1
"""Time constant of the rates, over 1/ω₀."""

CENTRED, DAMPED = 0.3, 0.5
"""Frequency over ω₀, and damping, with which arm or cart are held near their place."""

PUMPS, ENERGIES = (0.3, 0.6, 1.0), (0.0, 0.1)
"""Accelerations of the pivot, and energies beyond that of upright, that are tried."""

HANGS = math.pi
"""How far off upright a trial begins [rad]."""

SPREAD = 200
"""Points at which the right-hand side is asked what a pivot's acceleration takes."""


ONLY_HOLDS = Swing(**tomllib.loads(own_text("feedback/only-holds.toml")))
"""Of a controller whose catch is everywhere."""


def law_of(controller: Controller, c: Conditions) -> Law:
    """A controller as the numbers that are compiled."""
    s = controller.swing or ONLY_HOLDS
    place, arm = (c.outputs.index(n) if n else 0 for n in (s.output, s.arm or s.output))
    pump = Pump(place, arm, 2 * math.pi * bool(s.output), s.omega, most=s.pump, energy=s.energy, sharp=s.sharp,
                lift=s.lift[0], lift_cosine=s.lift[1], stiffness=s.stiffness, damping=s.damping, grows=s.grows,
                catch=s.catch, reach=s.reach, release=s.release, keep=s.keep, period=controller.period)  # fmt: skip
    A, B, C, D, E = (np.array(getattr(controller, name), dtype=np.float64) for name in "ABCDE")
    begins = np.array(s.begins) if s.begins else np.zeros((len(A), 2 * len(c.outputs)))
    return Law(A, B, C, D, E=E, drive=np.array([c.at_rest, c.least, c.most]), pump=pump, needs=np.array(s.needs),
               begins=begins)  # fmt: skip


def swings(up: LinearModel, model: Model, parameters: FloatArray, c: Conditions) -> list[Swing]:
    """What is tried to swing a pendulum up.

    Parameters
    ----------
    up : LinearModel
        About upright.
    model : Model
    parameters : ndarray, shape (n_parameters,)
        Without dry friction.
    c : Conditions
    """
    channel, place = model.inputs.index(c.input), model.output_states[model.pendulum]
    arm = next((n for n in model.output_states if n != model.pendulum), "")
    rate = int(np.abs(up.F[place]).argmax())
    grows = max(m.pole.real for m in up.modes if m.pole.imag == 0)
    lift, omega, needs = float(up.G[rate, channel]), grows, np.eye(8)[0]
    if arm:
        row = model.output_states[arm]
        own = int(np.abs(up.F[row]).argmax())
        lift /= float(up.G[own, channel])
        omega, needs = _held_still(up, row, channel, grows), _needs(model, parameters, up, c, rows=(place, rate, own))
    reach = c.authority * float(abs(up.G[rate, channel] / up.F[rate, place]))
    centred = CENTRED * omega if arm else 0.0
    swing = Swing(
        output=model.pendulum, arm=arm, omega=omega, grows=grows, lift=(0.0, lift) if arm else (lift, 0.0),
        pump=0.0, energy=0.0, sharp=SHARP, catch=CATCH, reach=min(FAR, SURE * reach), release=RELEASE,
        keep=math.exp(-c.period * omega / SMOOTHED), stiffness=centred**2, damping=2 * DAMPED * centred,
        needs=tuple(needs.tolist()), begins=[],
    )  # fmt: skip
    return [replace(swing, pump=part * omega**2 / abs(lift), energy=energy) for part in PUMPS for energy in ENERGIES]


def with_swing(held: Controller, swing: Swing, begins: FloatArray) -> Controller:
    """A controller that holds upright, after it has swung up; its state begins as that of the outputs and rates.

    Examples
    --------
    >>> held = Controller("LQR", {"rho": 1.0}, 0.01, [[0.0]], [[0.0]], [[0.0]], [[-2.0]], [[0.0]])
    >>> needs = (1.0, *[0.0] * 7)
    >>> swing = Swing("angle", 7.0, 7.0, (300.0, 0.0), 0.098, 0.1, 20.0, 0.4, 0.2, 0.8, 0.5, 0.0, 0.0, needs, [])
    >>> made = with_swing(held, swing, np.zeros((1, 2)))
    >>> made.kind, round(made.weights["pump"], 3)
    ('swing-up and LQR', 0.6)
    """
    swing = replace(swing, begins=np.pad(begins, ((0, len(held.A) - len(begins)), (0, 0))).tolist())
    weights = {**held.weights, "pump": swing.pump * abs(sum(swing.lift)) / swing.omega**2, "energy": swing.energy}
    return replace(held, kind=f"swing-up and {held.kind}", weights=weights, swing=swing)


def _held_still(up: LinearModel, row: int, channel: int, grows: float) -> float:
    """With which rate a pendulum falls whose pivot is held [rad/s]: the zero of the response to the pivot."""

    def gain(s: float) -> Any:
        """det [W s^q - F, -G; C, 0], of which the response is a part."""
        inner = np.diag(up.weight * s**up.orders) - up.F
        return np.linalg.det(np.block([[inner, -up.G[:, [channel]]], [np.eye(len(inner))[[row]], np.zeros((1, 1))]]))

    return float(brentq(gain, 0.1 * grows, grows))


def _needs(model: Model, p: FloatArray, up: LinearModel, c: Conditions, rows: tuple[int, int, int]) -> FloatArray:
    """What an acceleration of the pivot takes of the input at any angle and rates."""
    place, rate, own = rows
    random = np.random.default_rng(1)
    angle = random.uniform(-math.pi, math.pi, SPREAD)
    w, v = random.standard_normal((2, SPREAD)) * math.sqrt(abs(up.F[rate, place]))
    inputs = random.uniform(c.least, c.most, SPREAD)
    a, u = np.empty(SPREAD), np.array([c.at_rest if n == c.input else 0.0 for n in model.inputs])
    for k in range(SPREAD):
        x = up.about.copy()
        x[place], x[rate], x[own] = x[place] + angle[k], w[k], v[k]
        u[model.inputs.index(c.input)] = inputs[k]
        a[k] = model.derivatives(x, u, p)[own]
    s, co = np.sin(angle), np.cos(angle)
    terms = np.column_stack([a, co**2 * a, s * w**2, s * co, v, co * w, s * co * w * v, s * co**2 * v**2])
    return np.asarray(np.linalg.lstsq(terms, inputs - c.at_rest, rcond=None)[0])
