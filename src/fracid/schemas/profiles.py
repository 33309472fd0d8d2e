"""profiles.json: how far each unknown can go while the others follow."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from fracid.safety.json_files import short_text
from fracid.safety.schema import Block, Coherent, Infinite, Interval, Number, Numbers, Pair, Unknown, also_called
from fracid.schemas.scatter import SpreadBlock


class ProfileBlock(Block):
    """The profile of one unknown."""

    best: float = Field(alias="value")
    unit: str
    interval95: Annotated[tuple[Number, ...], Pair]
    method: str = ""
    wald95: Interval | None
    wald_method: str = ""
    verdict: str
    sentence: str
    ends: Annotated[tuple[str, ...], Pair]
    values: Numbers
    rise: list[Infinite]
    cost: list[Infinite]


class JointBlock(Block):
    """The profile of two unknowns together."""

    names: Annotated[tuple[str, ...], Pair]
    units: Annotated[tuple[str, ...], Pair]
    best: Interval
    first: Numbers
    second: Numbers
    threshold: float
    rise: list[list[Infinite]]
    correlation: Unknown


class CostAtBest(Block):
    """The cost that the profiles rise from."""

    name: str
    value: float


class ProfilesBlock(Coherent):
    """Profiles of several unknowns from one minimum."""

    cost: CostAtBest
    minimum: dict[str, float]
    threshold: Number
    profiles: dict[str, ProfileBlock]
    joint: JointBlock | None = None
    notes: list[str]

    def incoherence(self) -> str:
        """Lists that do not belong together."""
        for name, p in self.profiles.items():
            if not 0 < len(p.values) == len(p.rise) == len(p.cost):
                return f"the profile of {short_text(name)} has lists of different lengths"
        joint = self.joint
        if joint and [len(joint.second)] * len(joint.first) != [len(row) for row in joint.rise]:
            return "its joint profile has lists of different lengths"
        return ""


# --- what fracid profile writes beside them ----------------------------------------------------------


ByMethod = dict[str, dict[str, Annotated[tuple[Number, ...], Pair] | Number]]


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


class LikelihoodBlock(ProfilesBlock):
    """All that profiles.json has: of a report only the profiles are asked."""

    intervals: IntervalsBlock
    identifiability: dict[str, VerdictBlock]
    bootstrap: BootstrapBlock | str
    spread: SpreadBlock | None
    seed: int
