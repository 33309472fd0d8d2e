"""environment.json, and what the lines of a run's logs have."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pydantic import Field

from fracid.safety.json_files import shown
from fracid.safety.schema import Block, Infinite, fault_of


class FitOptions(Block):
    """The options of a fit in it."""

    project: str
    preset: str | None
    optimiser: str | None
    seed: int | None
    starts: int | None
    cut: bool
    executor: str | None


class EnvironmentBlock(Block):
    """environment.json: versions and machine, what was typed, where and when."""

    versions: dict[str, str] = Field({})
    platform: str = ""
    processor: str = ""
    code: str = ""
    command: list[str] = Field([])
    directory: str = ""
    started: str = ""


class EvaluationLine(Block):
    """A line of evaluations.jsonl."""

    point: dict[str, float]


class StudyLine(Block):
    """The first line of a journal."""

    study: dict[str, Any]


class EndBlock(Block):
    """A start of a search at its end, as its journal has it."""

    first_cost: Infinite
    end: list[float]
    cost: Infinite
    ended: str
    evaluations: int
    outcome: str


def fault_of_end(content: Any, unknowns: int, outcomes: Iterable[str]) -> str:
    """Where a start's end is not one of a search with so many unknowns, in words.

    Examples
    --------
    >>> end = {"first_cost": None, "end": [1.0], "cost": 0.1, "ended": "", "evaluations": 3, "outcome": "done"}
    >>> fault_of_end(end, 2, ["done"])
    'end has 1 entries; expected 2'
    """
    if fault := fault_of(content, EndBlock):
        return fault
    if len(content["end"]) != unknowns:
        return f"end has {len(content['end'])} entries; expected {unknowns}"
    expected = tuple(outcomes)
    outcome = content["outcome"]
    return "" if outcome in expected else f"outcome is {shown(outcome)}; expected {' or '.join(expected)}"
