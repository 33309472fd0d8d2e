"""profiles.json: all that is known of how far each unknown can go; of a report only the profiles are asked."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from fracid.estimation.agreement import Spread
from fracid.estimation.cost_profile import Profiles
from fracid.safety.schema import Block, Interval, Number, OpenInterval, also_called

ByMethod = dict[str, dict[str, OpenInterval | Number]]


class IntervalsBlock(Block):
    """Unknown → method → its interval, and its effective samples."""

    methods: dict[str, str]
    unknowns: ByMethod
    free_parameters = also_called("unknowns", ByMethod)


class VerdictBlock(Block):
    """Whether a free parameter is identifiable."""

    kind: str = Field(alias="verdict")
    sentence: str


class DrawsOfOne(Block):
    """One unknown, over all draws."""

    standard_error: float
    bias: float
    interval95: Interval


class BootstrapBlock(Block):
    """Draws of the unknowns, without the draws."""

    method: str
    draws: int
    failed: int = 0
    block: int
    warning: str
    unknowns: dict[str, DrawsOfOne]
    free_parameters = also_called("unknowns", dict[str, DrawsOfOne])


@dataclass(frozen=True, repr=False, kw_only=True)
class Likelihood(Profiles):
    """All that profiles.json has."""

    intervals: IntervalsBlock
    identifiability: dict[str, VerdictBlock]
    bootstrap: BootstrapBlock | str
    spread: Spread | None
    seed: int
