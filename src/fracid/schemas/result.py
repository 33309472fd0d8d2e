"""result.json: ``docs/run-folder.md`` says what each key means."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from fracid.safety.schema import Block, Infinite, Interval, Number, Unknown

Origin = Annotated[str, Field(pattern=r"^(given|regression|Sobol [0-9]{1,9}|the simpler structure|windows)$")]


class EstimateBlock(Block):
    """A value with what is known of it."""

    value: Unknown
    unit: str = ""
    standard_error: Number = None
    interval95: Interval | None
    interval_method: str | None = None
    white95: Interval | None = None
    free: bool
    at_bound: bool = False
    bound: Number = None
    identifiable: str
    reason: str = ""


class OrderBlock(EstimateBlock):
    """An order, and what it is in the integer-order model."""

    integer: Number = None


class RecordingBlock(Block):
    """A recording beside its simulation, without the samples."""

    use: Literal["fit", "validate"]
    samples: int
    begin: float = Field(alias="from")
    end: float = Field(alias="to")
    cost: Number
    rmse: dict[str, Number]
    fit_percent: dict[str, Number]
    initial: dict[str, EstimateBlock] = Field(alias="initial_state")
    parameters: dict[str, EstimateBlock]
    sha256: str = Field("", alias="data_sha256")


class ModelBlock(Block):
    """The model that was fitted."""

    name: str
    zero: str
    source: str


class CostBlock(Block):
    """What was made least."""

    name: str
    value: Number
    outputs: list[str]


class DiscretisationBlock(Block):
    """What the step and the scheme do to the result."""

    cost: Number
    cost_half_step: Number
    cost_second_order: Number
    orders: dict[str, Number]
    shift: dict[str, Number]
    largest: Number = 0.0
    warning: str
    refinement: str = ""


ClaimWord = Literal["fractional", "integer", "undecided"]


class TrialBlock(Block):
    """One thing of integer order that was held against the orders; null where it was not tried."""

    name: str
    cost: Infinite
    gain: Infinite = Field(alias="bic_gain_of_the_fractional_model")
    as_well: bool


class FiniteMemoryBlock(Block):
    """Relaxations in the place of the orders, all else equal."""

    relaxations: int
    cost: Infinite
    gain: Infinite = Field(alias="bic_gain_of_the_fractional_model")
    settles: bool


class AlternativeBlock(Block):
    """The integer-order model that comes nearest."""

    structure: str
    orders: Annotated[tuple[str, ...], Field(strict=False)] = ()
    cost: Number
    parameters: dict[str, Number]
    gain: Number = Field(alias="bic_gain_of_the_fractional_model")
    effective_samples: Number
    warning: str
    trials: Annotated[tuple[TrialBlock, ...], Field(strict=False)] = ()
    settles: bool = True
    memories: Annotated[tuple[FiniteMemoryBlock, ...], Field(strict=False)] = ()


class StartBlock(Block):
    """A start of the search, and what became of it."""

    origin: Origin
    point: dict[str, Unknown] = Field(alias="start")
    first_cost: Infinite = Field(alias="cost_on_first_swing")
    end: dict[str, Unknown]
    cost: Number
    ended: str
    joined: Origin | None
    evaluations: int


class SpreadOfOne(Block):
    """One unknown, by each recording alone."""

    values: list[Number]
    standard_errors: list[Number]
    standard_deviation: Number
    birge: Number


class SpreadBlock(Block):
    """What each recording says alone."""

    recordings: list[str]
    unknowns: dict[str, SpreadOfOne]
    sentences: list[str]


class AsFitted(Block):
    """What the treatments are held against."""

    orders: dict[str, float]
    cost: float
    levels: dict[str, float] = Field(alias="rmse")


class TreatmentBlock(Block):
    """The orders, with something else taken for the motion before the start."""

    orders: dict[str, float]
    shift: dict[str, float]
    cost: float
    levels: dict[str, float] = Field(alias="rmse")
    stopped: bool = Field(alias="still_moving")


class CutBlock(Block):
    """How far the orders move with where the record begins."""

    as_fitted: AsFitted
    half_width: dict[str, Number]
    treatments: dict[str, TreatmentBlock]
    left_out: dict[str, str]
    rivals: list[str]
    range: dict[str, Interval]
    warnings: list[str]


class FindingBlock(Block):
    """A fault that was seen, with its number."""

    code: str
    where: str
    number: Number
    limit: Number
    unit: str
    sentence: str


class OpenedBoundBlock(Block):
    """A bound that stopped the search, and was opened."""

    name: str
    unit: str = ""
    upper: bool
    was: float
    bound: float
    value: float
    cost: float
    lowered: float


class FitBlock(Block):
    """A fit without its samples."""

    model: ModelBlock
    method: str
    memory: str
    step: float
    substeps: int | None = Field(None, ge=1)
    orders: dict[str, OrderBlock]
    parameters: dict[str, EstimateBlock]
    recordings: dict[str, RecordingBlock]
    cost: CostBlock
    discretisation: DiscretisationBlock | None = None
    evaluations: int
    optimiser: str
    outcome: str
    claim: ClaimWord | None = None
    claim_reasons: Annotated[tuple[str, ...], Field(strict=False)] = ()
    opened_bounds: list[OpenedBoundBlock] = Field([])
    alternative: AlternativeBlock | None = None
    starts: list[StartBlock] = Field([])
    start_that_won: str | None = None
    spread: SpreadBlock | None = None
    cut: CutBlock | None = None
    interval_methods: dict[str, str] = Field({})
    warnings: list[str]
    findings: list[FindingBlock] = Field([])
    seed: int | None


class ResultBlock(FitBlock):
    """Everything that a run of ``fracid fit`` found; angles in radians, times in seconds, all else in SI."""

    preset: str | None = None
    data_sha256: dict[str, str]
    versions: dict[str, str]
    timing: dict[str, float] = Field({})
