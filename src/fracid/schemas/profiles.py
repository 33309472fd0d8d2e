"""profiles.json: how far each unknown can go while the others follow."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from fracid.safety.json_files import short_text
from fracid.safety.schema import Block, Coherent, Infinite, Interval, Number, Numbers, Pair, Unknown

__all__ = ["JointBlock", "ProfileBlock", "ProfilesBlock"]


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
