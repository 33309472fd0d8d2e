"""control.json: a controller, what it was held to, and the draws of the unknowns on which it holds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from fracid.arrays import FloatArray
from fracid.safety.json_files import json_number
from fracid.safety.schema import Beside, Ends, Listed, Number, Record, Unknown, _listed, computed
from fracid.units import with_unit

SECONDS = 10.0
"""Of a trial."""

Matrix = Annotated[list[list[float]], BeforeValidator(_listed)]


@dataclass(frozen=True)
class Swing(Record):
    """How a pendulum is swung up, while it is beyond the catch; the law is :mod:`fracid.solver.closed_loop`'s."""

    output: str
    """The pendulum's angle φ, 0 at upright."""
    omega: float
    """ω₀ of the pendulum whose pivot is held [rad/s]."""
    grows: float
    """g, the unstable pole at upright [1/s]."""
    lift: Listed[float]
    """l₀ and l₁: the sign of l₀ + l₁ cos φ is that of the pendulum's acceleration by the input."""
    pump: float
    """P, an acceleration of the arm or cart; the input itself where there is none."""
    energy: float
    """ℰ₀, that it is pumped to; that of hanging is −2, of upright 0."""
    sharp: float
    """k"""
    catch: float
    """[rad]"""
    reach: float
    """[rad]"""
    release: float
    """[rad]"""
    keep: float
    """Part of a smoothed rate that is kept from sample to sample."""
    stiffness: float
    """p [1/s²]"""
    damping: float
    """d [1/s]"""
    needs: Listed[float]
    """n, shape (8,)."""
    begins: Matrix
    """v from e and w, where the regulator begins: beyond release."""
    arm: str = ""
    """What carries the pendulum, z; "" for nothing."""


@dataclass(frozen=True)
class Controller(Record):
    """u = C v + D e, then v ← A v + B e + E u: e the outputs less their reference, u the input less its own, limited.

    Examples
    --------
    >>> follow = Controller("pid", {"P": 2.0}, 0.01, [[0.0]], [[0.0]], [[0.0]], [[-2.0]], [[0.0]])
    >>> follow.response(np.array([1.0])).round(3).tolist()
    [[(-2+0j)]]
    """

    kind: str
    """``LQR``, ``PID`` …"""
    weights: Mapping[str, float]
    """What it was designed with."""
    period: float
    """From sample to sample [s]."""
    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    E: Matrix
    swing: Swing | None = None
    """Of one that swings up before it holds."""

    def response(self, omega: FloatArray) -> Any:
        """From e to u at iω while the input is not limited, shape (n_omega, n_outputs)."""
        A, B, C, D, E = (np.array(m) for m in (self.A, self.B, self.C, self.D, self.E))
        z, identity = np.exp(1j * omega * self.period), np.eye(len(A))
        inner = z[:, None, None] * identity - A - E @ C
        return (C @ np.linalg.solve(inner, np.broadcast_to(B + E @ D, (len(z), *B.shape))) + D)[:, 0]


@dataclass(frozen=True)
class Trial(Record):
    """One draw under one controller."""

    holds: bool
    until: float
    """When it left, or the end [s]."""
    peak: dict[str, float]
    """Output → largest deviation."""
    error: float
    """Root mean square of the output that began off, less its reference."""
    effort: float
    """Root mean square of the input less its value at the posture."""
    limited: float
    """Part of the time at which the input was at a limit."""
    gain_margin: Number
    """[dB]; None where any gain is borne."""
    phase_margin: float
    """[°]; 180 where it never comes to the size of 1."""
    distance: float
    """Of the open loop from −1, at least."""
    up: float = 0.0
    """When a pendulum that is swung up was last beyond the posture's deviation [s]; 0 of one that begins within it."""


@dataclass(frozen=True)
class Design(Record):
    """A controller and how often it held."""

    controller: Controller
    draws: int
    held: int
    gain_margin: Number
    """At the fitted values [dB]."""
    phase_margin: float
    """[°]"""
    distance: float
    """Of the open loop from −1, at least: one over the maximum sensitivity."""
    error: Unknown = math.nan
    """Root mean square of the output that began off, less its reference: the median of the draws."""
    effort: Unknown = math.nan
    """That of the input less its value at the posture."""


@dataclass(frozen=True)
class Conditions(Record):
    """The loop as it was found, and what it is held to."""

    posture: str
    states: dict[str, float]
    """At the posture."""
    input: str
    unit: str
    at_rest: float
    """The input at the posture."""
    least: float
    most: float
    delay: float
    """[s]"""
    period: float
    """[s]"""
    steps: int
    """Of the solver, in a period."""
    outputs: Listed[str]
    reference: dict[str, float]
    """Of the outputs at the posture."""
    units: dict[str, str]
    quanta: dict[str, float]
    """Steps of the encoders; 0 for none."""
    noise: dict[str, float]
    """Standard deviations."""
    off: dict[str, float]
    """Where a trial begins, less the posture."""
    within: dict[str, Number]
    """Deviations beyond which it has fallen; None for none."""
    seconds: float = SECONDS
    at: dict[str, float] = field(default_factory=dict)
    """Outputs at the posture, as far as they were given."""

    @property
    def place(self) -> str:
        """The posture in words, with what was given of it."""
        at = " and ".join(f"{n} = {with_unit(v, self.units.get(n, '1'), '.4g')}" for n, v in self.at.items())
        return f"{self.posture} at {at}" if at else self.posture

    @property
    def authority(self) -> float:
        """The input that there is to either side of that at rest."""
        return min(self.most - self.at_rest, self.at_rest - self.least)

    def weighed(self, error: float, effort: float) -> float:
        r"""The mean of :math:`(y/\bar y)^2 + (u/\bar u)^2`, of the output that began off by y̅ with the authority u̅."""
        return (error / next(iter(self.off.values()))) ** 2 + (effort / self.authority) ** 2


@dataclass(frozen=True, repr=False)
class ControlRecord(Record):
    """A controller with the draws on which it holds."""

    model: str
    conditions: Conditions
    design: Design
    """The chosen one, over all draws."""
    tried: Listed[Design]
    """All of them, over the first draws."""
    trials: Listed[Trial]
    """Of the chosen design, one for each draw."""
    worst: dict[str, float]
    """Unknown → its value in the draw that fell first, or else is nearest to instability."""
    worst_draw: int
    """Which that is."""
    seed: int
    share95: Ends
    """The binomial interval of the share."""
    notes: Listed[str] = ()
    loop: Beside[Any] = None
    """What simulates it, in the session that designed it."""

    @computed
    def share(self) -> float:
        """Of the draws on which it holds."""
        return self.design.held / self.design.draws

    @computed
    def gain_margin95(self) -> tuple[float | None, float | None]:
        """In which 95 % of the draws have theirs [dB]; None for any."""
        low, high = _band([math.inf if t.gain_margin is None else t.gain_margin for t in self.trials])
        return json_number(low), json_number(high)

    @computed
    def phase_margin95(self) -> tuple[float, float]:
        """In which 95 % of the draws have theirs [°]."""
        return _band([t.phase_margin for t in self.trials])

    @computed
    def up95(self) -> tuple[float, float] | None:
        """In which 95 % of the draws that are swung up and held are there [s]."""
        swung = [t.up for t in self.trials if t.holds and self.design.controller.swing is not None]
        return _band(swung) if swung else None

    @computed
    def sentence(self) -> str:
        """What was found."""
        low, high = (100 * v for v in self.share95)
        swung = "" if self.up95 is None else ", swung up after {:.3g} to {:.3g} s in 95 % of them".format(*self.up95)
        holds = f"{self.design.controller.kind} holds {self.conditions.place} in {self.design.held}"
        return f"{holds} of {self.design.draws} draws (95 % interval {low:.3g} to {high:.3g} %){swung}."


def margin_text(value: float | None, band: tuple[float | None, float | None], unit: str) -> str:
    """A margin and its band.

    Examples
    --------
    >>> margin_text(12.345, (10.0, None), "dB")
    '12.3 dB, in 95 % of the draws 10 to ∞ dB'
    """
    best, low, high = ("∞" if v is None else f"{v:.3g}" for v in (value, *band))
    return f"{best} {unit}, in 95 % of the draws {low} to {high} {unit}"


def _band(values: list[float]) -> tuple[float, float]:
    low, high = np.quantile(values, (0.025, 0.975), method="nearest").tolist()
    return low, high
