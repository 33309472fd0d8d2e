"""compare.json, and what the lines of a comparison's journal have."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from math import inf, nan
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from fracid.safety.json_files import from_json, short_text
from fracid.safety.schema import AS_NULL, Block, Coherent, Infinite, Interval, Number, Unknown, fault_of, lacking
from fracid.schemas.result import AlternativeBlock, ClaimWord, OpenedBoundBlock

Missed = Annotated[
    float, BeforeValidator(partial(from_json, otherwise=-inf), json_schema_input_type=float | None), AS_NULL
]
"""A fit in per cent: null of a constant output that is missed."""


class ScoreBlock(Block):
    """How near a structure comes to one recording."""

    rmse: dict[str, Infinite]
    fit_percent: dict[str, Missed]
    itae: dict[str, Infinite]
    failed: str


class LeftOverBlock(Block):
    """The residual of one output of a recording."""

    rms: Infinite
    floor: float
    part: float
    known: bool = False
    fit: float = 100.0


class OrderOfRow(Block):
    """An order of a structure."""

    value: float
    interval95: Interval | None


class RowBlock(Block):
    """One structure, fitted and scored."""

    name: str
    friction: str
    fractional: bool
    paper: bool
    cost: Infinite
    parameters: int
    bic: Infinite = Field(alias="bic_above_best")
    error: Number = Field(None, alias="held_out_error")
    orders: dict[str, OrderOfRow]
    values: dict[str, float]
    at_bound: Annotated[tuple[str, ...], Field(strict=False)]
    outcome: str
    in_sample: dict[str, ScoreBlock]
    held_out: dict[str, ScoreBlock]
    left_over: dict[str, LeftOverBlock] = Field({})
    log_odds: Unknown = nan


class WindowBlock(Block):
    """A stretch of a recording, and the orders found in it."""

    recording: str
    start: float = Field(alias="from")
    end: float = Field(alias="to")
    whole: bool
    amplitude: dict[str, float]
    orders: dict[str, float]
    standard_errors: dict[str, Infinite]
    units: dict[str, str] = Field({})


class DriftBlock(Block):
    """How an order goes with amplitude."""

    order: str
    over: str
    amplitudes: list[float]
    values: list[float]
    standard_errors: list[Number]
    probability: float
    explained: float
    change: float
    unit: str = "rad"
    drifts: bool
    sentence: str


class AmplitudeBlock(Block):
    """Whether the orders of a structure drift with amplitude."""

    disguised: bool = Field(alias="friction_in_disguise")
    sentences: list[str]
    windows: list[WindowBlock]
    drifts: list[DriftBlock]
    notes: list[str]


class ComparisonBlock(Coherent):
    """The ladder of structures."""

    claim: ClaimWord | None = None
    claim_reasons: Annotated[tuple[str, ...], Field(strict=False)] = ()
    alternative: AlternativeBlock | None = None
    verdict: str
    notes: list[str]
    outputs: list[str]
    units: dict[str, str] = Field({})
    held_out: list[str] = Field([])
    leave_one_out: bool
    cost_name: str = Field(alias="cost")
    effective_samples: Unknown
    best: dict[str, str]
    rows: list[RowBlock] = Field(alias="structures")
    amplitude: dict[str, AmplitudeBlock]
    seed: int
    starts: int
    data_sha256: dict[str, str] = Field({})

    def incoherence(self) -> str:
        """Structures that are scored on other recordings or outputs; a best one that is not there."""
        if not self.rows:
            return "it has no structure"
        first, names = self.rows[0], {row.name for row in self.rows}
        for row in self.rows:
            for scores, others in ((row.in_sample, first.in_sample), (row.held_out, first.held_out)):
                if set(scores) != set(others):
                    return f"the recordings of {short_text(row.name)} are others"
                kinds = (kind for s in scores.values() for kind in (s.rmse, s.fit_percent, s.itae))
                if any(set(kind) != set(self.outputs) for kind in kinds):
                    return f"the outputs of {short_text(row.name)} are others"
        if {row.fractional for row in self.rows} != {False, True} or not set(self.best.values()) <= names:
            return "its best structures are not among them"
        return ""


class EvidenceBlock(Block):
    """The evidence of a structure, as the journal of a comparison has it."""

    log_evidence: Number
    cost: Number
    reason: str


class StartBlock(Block):
    """The fit of the project as it stands, as the journal of a comparison has it: where every structure may start."""

    values: dict[str, float]
    opened: list[OpenedBoundBlock] = Field([])


class FittedBlock(Block):
    """The fit of a structure, as the journal of a comparison has it."""

    values: dict[str, float]
    cost: Number
    squares: Number
    samples: float
    parameters: int
    at_bound: list[str]
    orders: dict[str, Interval | None]
    in_sample: dict[str, ScoreBlock]
    held_out: dict[str, ScoreBlock]
    left_over: dict[str, LeftOverBlock] = Field({})
    outcome: str


def fault_of_fitted(content: Any, outputs: Iterable[str]) -> str:
    """Where the fit of a structure is not one with these outputs, in words."""
    if fault := fault_of(content, FittedBlock):
        return fault
    scores = {
        f"{use}.{name}.{kind}": score[kind]
        for use in ("in_sample", "held_out")
        for name, score in content[use].items()
        for kind in ("rmse", "fit_percent", "itae")
    }
    return lacking(scores, outputs)
