"""Where a search started and where it ended: the record of each start of a multi-start search."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from fracid.arrays import FloatArray
from fracid.optimise.base import Outcome
from fracid.safety.schema import Block, Infinite, Number, Record, Unknown, fault_of, lacking

SAME_COST = 1.01
"""Costs up to this factor above the lowest are the same step of the waterfall."""


Origin = Annotated[str, Field(pattern=r"^(given|regression|Sobol [0-9]{1,9}|the simpler structure|windows)$")]

Begun = tuple[str, FloatArray]
"""Where a start comes from, and where it begins."""


@dataclass(frozen=True)
class Start(Record):
    """One start of the search, and what became of it."""

    origin: Origin
    """``given``, ``regression`` or ``Sobol 3``."""
    point: Annotated[Mapping[str, Unknown], Field(alias="start")]
    """Where it started, by unknown."""
    first_cost: Annotated[Infinite, Field(alias="cost_on_first_swing")]
    """There, on the first swing; infinite where the run fails."""
    end: Mapping[str, Unknown]
    """Where it ended or was left, by unknown."""
    cost: Number
    """There, on the whole record; None where it was left before."""
    ended: str
    """How, in words."""
    joined: Origin | None
    """The origin of the start whose minimum it fell into."""
    evaluations: int


class EndBlock(Block):
    """A start at its end, as the journal of a search has it."""

    start: Start
    outcome: Annotated[Outcome, Field(strict=False)]


def fault_of_end(content: Any, names: Iterable[str]) -> str:
    """Where a start's end is not one of a search for these unknowns, in words.

    Examples
    --------
    >>> from fracid.safety.schema import as_json
    >>> start = Start("given", {"mu": 1.0}, 0.2, {"mu": 0.9}, 0.1, "converged", None, 9)
    >>> fault_of_end(as_json(EndBlock, {"start": start, "outcome": Outcome.CONVERGED}), ["mu", "C1"])
    'end has no C1'
    """
    return fault_of(content, EndBlock) or lacking({"end": content["start"]["end"]}, names)


def won(starts: Sequence[Start]) -> Start | None:
    """The start that ended lowest."""
    return min((s for s in starts if s.cost is not None), key=attrgetter("cost"), default=None)


def final_cost(start: Start, starts: Sequence[Start]) -> float | None:
    """A start's final cost, or that of the one whose minimum it fell into; None where it was left for its cost."""
    by_origin = {s.origin: s for s in starts}
    while start.cost is None and start.joined is not None:
        start = by_origin[start.joined]
    return start.cost if start.cost is not None and np.isfinite(start.cost) else None
