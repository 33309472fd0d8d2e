r"""Controllers of an identified model about a posture, designed on its reduced realisation.

The reduced realisation is that of :mod:`fracid.export.state_space` with sums that are right within :data:`REDUCED` over
the band of the loop, sampled with the input held and late (:func:`sampled`).  The regulator minimises

.. math::  \sum_k \sum_i (y_i/\bar y_i)^2 + ρ\,(u/\bar u)^2,

with :math:`\bar y` the deviations that are allowed, :math:`\bar u` the input that there is, and takes the states from a
Kalman filter that thinks of the noise of the sensors and of an input that is off by :math:`σ\bar u`: the larger that,
the nearer its margins to those of the regulator that sees all states (Doyle and Stein, 1979).

Margins are those of the fractional model itself, the loop opened at the input: its response at iω, with hold and delay,
times that of the controller at :math:`e^{iωT}`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are
from scipy.optimize import least_squares

from fracid.arrays import ByName, FloatArray
from fracid.errors import InputError, refuse_unknown
from fracid.export.state_space import LinearModel, moving, posture
from fracid.findings import Words
from fracid.models import Model
from fracid.schemas.feedback import Controller

SAYS = Words("feedback/study.toml")

UPRIGHT, HANGING = "upright", "hanging"

REDUCED = (0.3, 2.0)
"""Errors that a sum may have over the band of a loop, in dB and degrees: it has some five terms."""

STAYS = 1e-6
"""Part of such a state that is gone at each sample, for what a regulator weighs."""

SLOWEST = 3e-4
"""Lowest frequency of that band, over half the sampling rate."""

BALANCED = 1e-6
"""What is left of f at a posture, of what the whole input does."""

IMAGES = (-1, 0, 1)
"""Multiples of the sampling rate from where a frequency is seen."""

REAL = 0.1
"""Angle from −1 [rad] at which the ends of a response are taken for real."""

PLACES = 600
"""Frequencies at which margins are looked for."""


class Posture(NamedTuple):
    """Where a model rests."""

    name: str
    states: FloatArray
    """x_e, shape (n_states,)."""
    inputs: FloatArray
    """u_e, shape (n_inputs,)."""


def posture_of(model: Model, parameters: FloatArray, name: str, at: ByName, channel: int, most: float = 1.0) -> Posture:
    """Where a model rests with outputs at given values, and the others where that takes them.

    A pendulum's other outputs are at rest, and all of them at 0 where none is given.  `most` is the whole input.

    Raises
    ------
    InputError
        If there is no such posture, or output, or nothing balances the model there.

    Examples
    --------
    >>> import fracid
    >>> model = fracid.model("joint", gravity=0.2)
    >>> there = posture_of(model, model.parameter_vector(), "", {"angle": 0.5}, 0)
    >>> [round(float(v), 4) for v in (there.states[0], there.inputs[0])]
    [0.5, 0.0959]
    """
    p, names = moving(model, parameters), (UPRIGHT, HANGING) if model.pendulum else ("rest",)
    name = name or names[0]
    refuse_unknown("posture", names, name)
    refuse_unknown("output at a posture", model.output_states, *at)
    x = posture(model, parameters, name) if model.pendulum else np.zeros(len(model.states))
    for n, value in at.items():
        x[model.output_states[n]] = value
    named = {n: i for n, i in model.output_states.items() if model.pendulum or not at or n in at}
    held, u = np.isin(np.arange(len(x)), [*named.values(), *model.relaxing_states]), np.zeros(len(model.inputs))

    def left(unknown: FloatArray) -> FloatArray:
        x[~held], u[channel] = unknown[:-1], unknown[-1]
        return np.nan_to_num(model.derivatives(x, u, p)[: len(x)], nan=1e9)  # where there is no value

    starts = [np.append(x[~held], begun) for begun in (0.0, most, -most)]  # at 0 the slope of what squares it is 0
    size = np.abs(left(starts[1]) - left(starts[0])).max() or 1.0
    for start in starts:
        found = least_squares(left, start, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
        if np.abs(left(found.x)).max() <= BALANCED * size:
            return Posture(name, x.copy(), u.copy())
    where = ", ".join(f"{n} = {x[i]:.4g}" for n, i in named.items())
    raise InputError(f"{model.name} does not rest at {where}, whatever its input: there is no posture to control.")


@dataclass(frozen=True)
class Plant:
    """A model linearised about a posture, from one input to some outputs."""

    linear: LinearModel
    channel: int
    delay: float
    """From the input that is asked for to the output that shows it [s]."""
    begins: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    """The reduced states from outputs and their rates, as in a motion in the middle of the band, (n, 2 n_outputs)."""

    def response(self, omega: FloatArray, period: float) -> Any:
        """Of the fractional model, held, late and sampled, shape (n_omega, n_outputs)."""
        images = (omega[:, None] + 2 * math.pi / period * np.array(IMAGES)).ravel()
        half = 0.5 * images * period
        held = np.sinc(half / np.pi) * np.exp(-1j * (half + images * self.delay))
        exact = self.linear.exact_response(images)[:, :, self.channel] * held[:, None]
        return exact.reshape(len(omega), len(IMAGES), -1).sum(axis=1)


def held(A: FloatArray, B: FloatArray, time: float) -> tuple[FloatArray, FloatArray]:
    """What is left of the states after a time, and what an input adds to them that is held so long."""
    from scipy.signal import cont2discrete  # slow to load

    left, added, *_ = cont2discrete((A, B, A, B), time)
    return left, added


def sampled(plant: Plant, period: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A, B and C of the realisation with its input held and late: the inputs under way are its last states.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> lag = SimpleNamespace(A=np.array([[-1.0]]), B=np.array([[1.0]]), C=np.array([[1.0]]))
    >>> A, B, C = sampled(Plant(lag, 0, 0.15), 0.1)
    >>> A.round(4).tolist(), B.ravel().tolist()
    ([[0.9048, 0.0464, 0.0488], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]], [0.0, 0.0, 1.0])
    """
    A, B = plant.linear.A, plant.linear.B[:, [plant.channel]]
    whole, n = math.floor(plant.delay / period + 1e-9), len(A)
    late = max(0.0, plant.delay - whole * period)
    rest, newer = held(A, B, period - late)  # of the input now
    older = rest @ held(A, B, late)[1]  # of that before
    more = whole + (late > 1e-9 * period)
    F, C = np.zeros((n + more, n + more + 1)), np.zeros((len(plant.linear.C), n + more))  # the input now comes last
    F[:n, :n], C[:, :n] = held(A, B, period)[0], plant.linear.C
    F[n:, n + 1 :] = np.eye(more)
    if more > whole:
        F[:n, [n]] = older
    F[:n, [n + more - whole]] = newer
    return F[:, :-1].copy(), F[:, -1:].copy(), C


def regulator(
    plant: Plant, period: float, allowed: FloatArray, most: float, noise: FloatArray, rho: float, sigma: float
) -> Controller:
    """A linear quadratic regulator behind a Kalman filter.

    Parameters
    ----------
    plant : Plant
    period : float
        [s]
    allowed : ndarray, shape (n_outputs,)
        Deviations that weigh as much as the whole input.
    most : float
        The whole input.
    noise : ndarray, shape (n_outputs,)
        Standard deviation of each sensor.
    rho, sigma : float
        What the input weighs, and how far it is off as the filter thinks, of the whole.

    Raises
    ------
    InputError
        If the input does not reach, or the outputs do not show, what would have to be held.
    """
    A, B, C = sampled(plant, period)
    Q, R, V = C.T @ np.diag(allowed**-2.0) @ C, np.array([[rho / most**2]]), np.diag(noise**2)
    try:
        P, S = _riccati(A, B, Q, R), _riccati(A.T, C.T, (sigma * most) ** 2 * B @ B.T, V)
    except (np.linalg.LinAlgError, ValueError) as error:
        outputs = " and ".join(plant.linear.outputs)
        raise InputError(SAYS("no-regulator", name=plant.linear.name, outputs=outputs, error=error)) from None
    K, M = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A), np.linalg.solve(C @ S @ C.T + V, C @ S).T
    seen = np.eye(len(A)) - M @ C
    return Controller("LQR", {"rho": rho, "sigma": sigma}, period, (A @ seen).tolist(), B=(A @ M).tolist(),
                      C=(-K @ seen).tolist(), D=(-K @ M).tolist(), E=B.tolist())  # fmt: skip


def _riccati(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray) -> FloatArray:
    """Solve Riccati's equation; what nothing moves and what stays, as a presliding joint's z at rest, is let decay."""
    try:
        return np.asarray(solve_discrete_are(A, B, Q, R))
    except np.linalg.LinAlgError:
        return np.asarray(solve_discrete_are((1 - STAYS) * A, B, Q, R))


def margins(plant: Plant, controller: Controller) -> tuple[float, float, float]:
    """Gain margin [dB], phase margin [°] and the least distance of the open loop from −1.

    The gain may grow or shrink, the phase turn either way: the nearest of them counts.

    Examples
    --------
    A loop 1/s that is sampled often has nearly 90°, and bears the gain that its sampling does:

    >>> from types import SimpleNamespace
    >>> integrator = SimpleNamespace(exact_response=lambda w: (1 / (1j * w))[:, None, None])
    >>> p = Controller("pid", {}, 0.01, [[0.0]], [[0.0]], [[0.0]], [[-1.0]], [[0.0]])
    >>> [round(m, 1) for m in margins(Plant(integrator, 0, 0.0), p)]
    [47.4, 89.7, 1.0]
    """
    top = math.pi / controller.period
    omega = np.geomspace(SLOWEST * top, top, PLACES)
    loop = -np.sum(plant.response(omega, controller.period) * controller.response(omega), axis=1)
    gains, phases = np.log(np.abs(loop)), np.angle(-loop)  # 0 at −1
    turned = np.abs(np.diff(phases)) < math.pi
    ends = gains[[0, -1]][np.abs(phases[[0, -1]]) < REAL]  # at rest and at half the sampling rate a loop is real
    at_minus_one = np.append(_at_zeros(phases, gains)[turned[_zeros(phases)]], ends)
    at_one = _at_zeros(gains, np.unwrap(phases))
    gain = 20 / math.log(10) * float(np.abs(at_minus_one).min(initial=math.inf))
    phase = np.degrees(np.abs(np.angle(np.exp(1j * at_one))).min(initial=math.pi))
    return gain, float(phase), float(np.abs(1 + loop).min())


def _zeros(y: FloatArray) -> Any:
    return np.flatnonzero(np.diff(np.signbit(y)))


def _at_zeros(y: FloatArray, other: FloatArray) -> FloatArray:
    """Another curve where y crosses 0, both straight between their points."""
    k = _zeros(y)
    return np.asarray(other[k] + y[k] / (y[k] - y[k + 1]) * (other[k + 1] - other[k]))
