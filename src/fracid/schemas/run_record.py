"""environment.json, and what the lines of a run's logs have."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from fracid.safety.schema import Block


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
