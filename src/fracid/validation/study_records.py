"""The records of a noise study, and its files: noise.json, and the lines of its journal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import computed_field

from fracid.safety.schema import Block, Interval, Number, Record, also_called, computed, fault_of, lacking
from fracid.units import with_unit


@dataclass(frozen=True)
class Statistics(Record):
    """One unknown in one cell."""

    unit: str
    truth: float
    estimates: int
    """Repetitions that found a value."""
    bias: Number
    """Mean estimate less the truth [unit]; None without estimates."""
    spread: Number
    """Standard deviation of the estimates [unit]; None below two."""
    claimed: Number
    """Root mean square of the standard errors [unit]; None where there was none."""
    intervals: int
    """Repetitions that gave a 95 % interval."""
    held: int
    """Those whose interval contains the true value."""

    @computed
    def coverage(self) -> float | None:
        """The share of intervals that contain the true value."""
        return self.held / self.intervals if self.intervals else None

    @computed
    def coverage95(self) -> tuple[float, float] | None:
        """The exact binomial 95 % interval of the coverage."""
        return binomial95(self.held, self.intervals) if self.intervals else None

    @computed
    def bias_error(self) -> float | None:
        """Standard error of the bias [unit]."""
        return None if self.spread is None else self.spread / math.sqrt(self.estimates)


TIMES = "× RMS"
"""The unit of levels and resolutions that are multiples of each output's own residual."""


@dataclass(frozen=True)
class Cell(Record):
    """One level of noise with one resolution."""

    level: float
    """Standard deviation of the noise [rad]."""
    resolution: float
    """A step of the encoder [rad]; 0 for none."""
    repetitions: int
    failures: Mapping[str, int]
    """Why no minimum was found → how often."""
    stopped_short: int
    """Repetitions whose search ended above the cost of the truth."""
    evaluations: float
    """Of the cost, mean of a repetition."""
    fractional: int | None
    """Repetitions whose orders would be called fractional; None where that was not asked."""
    unknowns: Mapping[str, Statistics]
    unit: str = "rad"
    """Of level and resolution: that of the scored outputs, or :data:`TIMES`."""

    @computed_field(alias="counts_per_turn")  # type: ignore[prop-decorator]
    @property
    def counts(self) -> float | None:
        """The encoder's counts a turn; None for no encoder, and where no angle is measured."""
        return 2 * math.pi / self.resolution if self.resolution and self.unit == "rad" else None

    @computed
    def failed(self) -> int:
        """Repetitions without a minimum."""
        return sum(self.failures.values())

    free_parameters = also_called("unknowns", Mapping[str, Statistics])

    @property
    def label(self) -> str:
        """In words: ``0.1° of noise, 4096 counts``."""
        return label_of(self.level, self.resolution, self.unit)


def binomial95(hits: int, trials: int) -> tuple[float, float]:
    """The exact 95 % interval of a share [CP]_.

    Examples
    --------
    >>> low, high = binomial95(47, 50)
    >>> round(low, 3), round(high, 3)
    (0.835, 0.987)
    """
    from scipy.special import betaincinv

    low = betaincinv(hits, trials - hits + 1, 0.025) if hits else 0.0
    high = betaincinv(hits + 1, trials - hits, 0.975) if hits < trials else 1.0
    return float(low), float(high)


def label_of(level: float, resolution: float, unit: str = "rad") -> str:
    """A level of noise and a step of rounding, in words."""
    steps = f"{2 * math.pi / resolution:.6g} counts" if resolution and unit == "rad" else with_unit(resolution, unit)
    return f"{with_unit(level, unit, '.6g')} of noise, {steps if resolution else 'no rounding'}"


# --- the files ---------------------------------------------------------------------------------------------


class _Repetition(Block):
    """What the journal has of each repetition."""

    evaluations: int
    cost_of_truth: Number


class RepetitionBlock(_Repetition):
    """A repetition that found a minimum."""

    failure: Literal[""]
    cost: float
    values: dict[str, float]
    standard_errors: dict[str, Number]
    intervals: dict[str, Interval | None]
    fractional: bool | None


class FailedBlock(_Repetition):
    """A repetition that found none."""

    failure: str
    cost: None


def fault_of_repetition(content: Any, names: Iterable[str]) -> str:
    """Where a repetition is not one of a study with these unknowns, in words.

    Examples
    --------
    >>> found = {"evaluations": 3, "cost_of_truth": 0.1, "failure": "", "cost": 0.1, "values": {},
    ...          "standard_errors": {}, "intervals": {}, "fractional": None}
    >>> fault_of_repetition(found, ["mu"])
    'values has no mu'
    """
    if isinstance(content, dict) and content.get("failure"):
        return fault_of(content, FailedBlock)
    of_each = ("values", "standard_errors", "intervals")
    return fault_of(content, RepetitionBlock) or lacking({key: content[key] for key in of_each}, names)
