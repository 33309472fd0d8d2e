"""noise.json, and what the lines of a study's journal have."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

from pydantic import Field

from fracid.safety.schema import Block, Coherent, Interval, Number, fault_of, lacking
from fracid.schemas.result import FindingBlock


class StatisticsBlock(Block):
    """One unknown in one cell."""

    unit: str
    truth: float
    estimates: int
    bias: Number
    spread: Number
    claimed: Number
    intervals: int
    held: int
    bias_error: Number = None
    coverage: Number = None
    coverage95: Interval | None = None


class CellBlock(Block):
    """One level of noise with one resolution."""

    level: float
    resolution: float
    counts: Number = Field(None, alias="counts_per_turn")
    repetitions: int
    failed: int = 0
    failures: dict[str, int]
    stopped_short: int
    evaluations: float
    fractional: int | None
    unit: str = "rad"
    unknowns: dict[str, StatisticsBlock]


class StudyBlock(Coherent):
    """What noise does to the estimates."""

    model: str = ""
    truth: dict[str, float]
    method: str = ""
    cost_name: str = Field(alias="cost")
    outputs: list[str] = Field([])
    optimiser: str
    seeds: int
    seed: int | None = None
    cells: list[CellBlock]
    sentences: list[str] = Field([])
    findings: list[FindingBlock] = Field([])
    repetitions: dict[str, dict[str, Any]] = Field({})

    def incoherence(self) -> str:
        """Cells of other unknowns, and counts that cannot be."""
        if not self.cells:
            return "it has no cell"
        if any(set(cell.unknowns) != set(self.truth) for cell in self.cells):
            return "the unknowns of its cells are others"
        counts = (u for cell in self.cells for u in cell.unknowns.values())
        possible = all(0 <= u.held <= u.intervals <= u.estimates for u in counts)
        return "" if possible else "its counts are not possible"


class RepetitionBlock(Block):
    """A repetition that found a minimum, as the journal has it."""

    evaluations: int
    cost_of_truth: Number
    failure: Literal[""]
    cost: float
    values: dict[str, float]
    standard_errors: dict[str, Number]
    intervals: dict[str, Interval | None]
    fractional: bool | None


class FailedBlock(Block):
    """A repetition that found none."""

    evaluations: int
    cost_of_truth: Number
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
