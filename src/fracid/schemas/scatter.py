"""What of result.json says how far values scatter: over the recordings, and with where the record begins."""

from __future__ import annotations

from pydantic import Field

from fracid.safety.schema import Block, Interval, Number


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
