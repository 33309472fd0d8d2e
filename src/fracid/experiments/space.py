"""What can be done on a rig: the decisions of a design, and the limits that exclude a candidate."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.cards import CardDisplay
from fracid.errors import InputError, is_number, refuse_unknown
from fracid.experiments.excitation import SAYS, Chirp, Excitation, Multisine, Pulses
from fracid.problem.unknowns import InitialState
from fracid.solver.arguments import check_above_0

ARMS = ("free", "clamped")

SPEED = "_speed"
"""Behind an output's name in `limits`: the limit of its rate."""


@dataclass(frozen=True)
class Candidate:
    """One experiment that could be done.

    Examples
    --------
    >>> str(Candidate(90.0, 20.0, 500.0))
    'release from 90°, 20 s at 500 Hz'
    """

    release: float
    """Angle from rest at which it is let go [°]."""
    seconds: float
    """Duration [s]."""
    rate: float
    """Samples a second [Hz]."""
    arm: str = "free"
    """``free`` or ``clamped``."""
    voltage: Excitation | None = None
    """None for nothing applied."""
    constants: tuple[tuple[str, float], ...] = ()
    """Names and values of the constants that are set for it."""
    unit: str = ""
    """That of the input, for its line."""
    around: float = 0.0
    """Value of the input about which the voltage swings [unit]."""

    @property
    def samples(self) -> int:
        """How many."""
        return round(self.seconds * self.rate) + 1

    def __str__(self) -> str:
        """One line."""
        parts = [f"release from {self.release:.4g}°" if self.release else "from rest"]
        parts += ["arm clamped"] if self.arm == "clamped" else []
        parts += [f"{self.voltage} {self.unit}".rstrip()] if self.voltage is not None else []
        parts += [f"offset {self.around:.3g} {self.unit}".rstrip()] if self.voltage is not None and self.around else []
        parts += [f"{n} {v:.4g}" for n, v in self.constants]
        return ", ".join([*parts, f"{self.seconds:.4g} s at {self.rate:.4g} Hz"])

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {"release": self.release, "seconds": self.seconds, "rate": self.rate, "arm": self.arm,
                "voltage": None if self.voltage is None else
                {"kind": type(self.voltage).__name__.lower(), **vars(self.voltage)},
                "constants": dict(self.constants), "text": str(self)}  # fmt: skip


@dataclass(frozen=True, repr=False)
class DesignSpace(CardDisplay):
    """The decisions of a design: each a value, or those among which :func:`fracid.design` chooses.

    Raises
    ------
    InputError
        For a value that no experiment can have.

    Examples
    --------
    >>> space = DesignSpace(release=(5, 150), arm=("free", "clamped"), seconds=20, rate=500, counts=4096,
    ...                     voltage=Multisine(0.2, 8.0, peak=6.0), limits={"theta": 2.5})
    >>> candidates = space.candidates
    >>> len(candidates), str(candidates[0])
    (220, 'release from 5°, 20 s at 500 Hz')
    """

    release: float | Sequence[float] = 0.0
    """Angle from rest [°]: one, a pair for a range, or three and more for the angles themselves."""
    arm: str | Sequence[str] = "free"
    """``free``, ``clamped`` (a rotary pendulum's arm, so that θ stands still), or both."""
    seconds: float | Sequence[float] = 20.0
    """Duration, or durations [s]."""
    rate: float | Sequence[float] = 500.0
    """Samples a second, or several rates [Hz]."""
    counts: float | None = None
    """Counts a turn of the encoders, 0 for no rounding; None as in the recordings, or 4096 without any."""
    voltage: Excitation | Sequence[Excitation] | None = None
    """What may be applied to the motor beside nothing; None where nothing can."""
    voltage_step: float = 0.0
    """Step of the amplifier, in the unit of the input: voltages are multiples of it [V]; 0 for any voltage."""
    around: float = 0.0
    """Value of the input about which its signal swings, such as a pump's [unit of the input]."""
    constants: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    """Constant that can be set, such as a mass that is hung on → its value, or values to choose from."""
    sensors: Sequence[str] = ()
    """Outputs that are recorded; empty for those of the run, or all of the model."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """Output → its largest magnitude [rad]; ``theta_speed``, its largest rate [rad/s].  What exceeds it is excluded."""
    noise: float | None = None
    """Standard deviation beside rounding [rad]; None as in the recordings, or a tenth of a count without any."""
    initial_state: InitialState = "rest"
    """``rest``: at rest, at an angle that each fit finds; ``held``: at exactly that angle; ``estimate``: in motion."""
    moment: float = 0.05
    """Each fit looks for the moment of release within this time of its first sample [s]; 0 where it is known."""
    levels: int = 20
    """How many angles a range is divided into, and how many frequencies a sine's band."""

    def __post_init__(self) -> None:
        """Refuse what no experiment can have."""
        for name, least in (("release", -360.0), ("seconds", 0.0), ("rate", 0.0)):
            values = _several(getattr(self, name))
            if not values or not all(is_number(v) and math.isfinite(v) and v >= least for v in values):
                raise InputError(SAYS("numbers", name=name, value=getattr(self, name), least=least))
        if min(_several(self.seconds)) * min(_several(self.rate)) < 10:
            raise InputError(SAYS("few-samples", seconds=min(_several(self.seconds)), rate=min(_several(self.rate))))
        refuse_unknown("arm", ARMS, *_several(self.arm))
        for u in _several(self.voltage):
            if not isinstance(u, Multisine | Chirp | Pulses | None):
                raise InputError(SAYS("voltage", u=u))
        for name, limit in self.limits.items():
            check_above_0(f"limits: {name}", limit)
        least = min((u.peak for u in _several(self.voltage) if u is not None), default=math.inf)
        possible = {
            "voltage-step": 0 <= self.voltage_step <= least and not math.isinf(self.voltage_step),
            "counts": self.counts is None or self.counts == 0 or self.counts >= 3,
            "noise": self.noise is None or 0 <= self.noise < math.inf,
            "initial-state": self.initial_state in ("rest", "held", "estimate"),
            "moment": 0 <= self.moment < math.inf,
            "levels": self.levels >= 1,
        }
        for code, is_possible in possible.items():
            if not is_possible:
                raise InputError(SAYS(code, space=self))

    @property
    def angles(self) -> tuple[float, ...]:
        """The angles of release [°]: within a range multiples of 5°, or of 1°, which a hand can set.

        Examples
        --------
        >>> DesignSpace(release=(5, 150), levels=6).angles, DesignSpace(release=(2.5, 9), levels=3).angles
        ((5.0, 35.0, 65.0, 90.0, 120.0, 150.0), (2.5, 6.0, 9.0))
        """
        values = _several(self.release)
        if len(values) == 2:
            angles = np.linspace(*values, self.levels)
            apart = abs(values[1] - values[0]) / max(1, self.levels - 1)
            if grid := next((g for g in (5.0, 1.0) if apart >= g), 0.0):
                angles[1:-1] = grid * np.round(angles[1:-1] / grid)
            return tuple(dict.fromkeys(angles.round(6).tolist()))
        return tuple(map(float, values))

    @property
    def voltages(self) -> tuple[Excitation | None, ...]:
        """What may be applied, nothing among it where a release moves the rig."""
        signals = [v for u in _several(self.voltage) if u is not None for v in u.variants(self.levels)]
        return tuple(signals) if signals and not any(self.angles) else (None, *signals)

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """Every combination; a clamped arm needs a release and no voltage."""
        settings = [tuple(zip(self.constants, map(float, s), strict=True))
                    for s in product(*map(_several, self.constants.values()))]  # fmt: skip
        arms, rates, durations = map(_several, (self.arm, self.rate, self.seconds))
        decisions = product(arms, self.voltages, self.angles, settings, rates, durations)
        return tuple(
            Candidate(release, float(seconds), float(rate), arm, voltage, constants, around=self.around)
            for arm, voltage, release, constants, rate, seconds in decisions
            if (release != 0.0 or voltage is not None) and (arm == "free" or (voltage is None and release != 0.0))
        )

    def applied(self, voltage: Excitation, time: FloatArray) -> FloatArray:
        """A voltage at some times, as the amplifier gives it: the nearest of its steps within the peak.

        Examples
        --------
        >>> chirp = Chirp(0.3, 4.0, peak=2.0)
        >>> DesignSpace(voltage=chirp, voltage_step=0.3).applied(chirp, np.arange(4) / 4).round(6).tolist()
        [0.0, 0.9, 1.8, 1.8]
        """
        u = voltage.signal(time)
        if not self.voltage_step:
            return u + self.around
        most = math.floor(voltage.peak / self.voltage_step + 1e-9)
        return (self.voltage_step * np.clip(np.round(u / self.voltage_step), -most, most)).round(12) + self.around

    def within_limits(self, outputs: Mapping[str, FloatArray], rate: float) -> bool:
        """Whether simulated outputs stay within the limits."""
        signals = {**outputs, **{f"{name}{SPEED}": np.diff(y) * rate for name, y in outputs.items()}}
        return all(np.max(np.abs(signals[name])) <= limit for name, limit in self.limits.items())


def by_motion(candidates: Sequence[Candidate]) -> list[list[int]]:
    """Which candidates differ in their duration alone: the beginnings of one simulation.

    Examples
    --------
    >>> by_motion(DesignSpace(release=(10, 20, 30), seconds=(5, 10)).candidates)
    [[0, 1], [2, 3], [4, 5]]
    """
    groups: dict[Candidate, list[int]] = {}
    for i, c in enumerate(candidates):
        groups.setdefault(replace(c, seconds=0.0), []).append(i)
    return [*groups.values()]


def _several(value: Any) -> tuple[Any, ...]:
    return tuple(value) if isinstance(value, Sequence) and not isinstance(value, str) else (value,)
