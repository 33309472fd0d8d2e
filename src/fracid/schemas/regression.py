"""regression.json: the constants that a linear regression finds, in SI."""

from __future__ import annotations

from typing import Annotated

from fracid.safety.schema import Block, Interval, Number, Pair


class SearchedOrder(Block):
    """An order, and its interval where it was searched."""

    value: float
    interval95: Annotated[tuple[Number, ...], Pair] | None


class ConstantBlock(Block):
    """One constant as the regression sees it."""

    value: float
    unit: str
    standard_error: float | None
    interval95: Interval | None
    bias: float | None
    verdict: str


class RegressionBlock(Block):
    """A regression without its rows."""

    orders: dict[str, SearchedOrder]
    parameters: dict[str, ConstantBlock]
    combinations: dict[str, float]
    estimator: str
    fit_percent: dict[str, float]
    noise_ratio: Number
    condition_number: Number
    samples: int
    cutoff: float
    cutoff_reason: str
    window: float
    noise: dict[str, float]
    amplitude: float
    belief: str
    warnings: list[str]


class StartedBlock(RegressionBlock):
    """A regression with the start that it gives to the unknowns of a project."""

    start: dict[str, float]


class RegressionResultBlock(StartedBlock):
    """The file of one regression."""

    notes: list[str]
    data_sha256: dict[str, str]


class RegressionsBlock(Block):
    """The file of several: one for each recording."""

    notes: list[str]
    data_sha256: dict[str, str]
    recordings: dict[str, StartedBlock]
