"""environment.json, the options in run.json, and what the lines of a run's logs have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import Field

from fracid.safety.schema import Block, Record


@dataclass(frozen=True)
class FitOptions(Record):
    """The options of a fit, in its run.json."""

    project: str
    preset: str | None = None
    optimiser: str | None = None
    seed: int | None = None
    starts: int | None = None
    cut: bool = False
    executor: str | None = None


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
