"""All that a report is made of: the run, its recordings beside their simulations, and what lies in its folder."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from fracid.errors import FracidError, InputError
from fracid.estimation.cost_plane import CostPlane
from fracid.estimation.cost_profile import Profiles
from fracid.fit import Fit
from fracid.models import Model
from fracid.problem import Problem
from fracid.problem.project import Project
from fracid.recording import Recording, inspect_recording
from fracid.report.sentences import in_unit
from fracid.runs.saved import SavedRun
from fracid.safety.schema import Block, Record, read_as
from fracid.schemas.run_record import EnvironmentBlock
from fracid.selection.comparison_records import Comparison
from fracid.units import shown_unit
from fracid.validation.residual_analyses import Analyses, analysed

BESIDE: dict[str, tuple[type[Block | Record], str]] = {
    "profiles.json": (Profiles, "fracid profile RUN"),
    "compare.json": (Comparison, "fracid compare PROJECT --out RUN"),
    "environment.json": (EnvironmentBlock, "fracid fit PROJECT"),
}
"""Files that the report looks at → what they must be, and what writes them."""


@dataclass(frozen=True)
class Material:
    """A run as the report sees it."""

    folder: Path
    result: Mapping[str, Any]
    """The content of result.json."""
    project: Project
    """With the step that the fit took."""
    fit: Fit
    """Of this session, or as it was read back."""
    plane: CostPlane | None = None
    """The cost over two free orders."""
    tested: Analyses | None = None
    """Each residual, where somebody has had it tested before."""

    @classmethod
    def of(
        cls, folder: Path, fit: Fit, project: Project, plane: CostPlane | None = None, tested: Analyses | None = None
    ) -> Material:
        """From a fit that is written to its folder."""
        missing = "{path.parent} has no result.json that can be read: write the fit's result first."
        result = read_as(folder / "result.json", SavedRun, "fracid fit PROJECT", missing)
        solved = replace(project, problem=replace(project.problem, substeps=fit.problem.substeps))
        return cls(folder, result, solved, fit, plane=plane, tested=tested)

    @property
    def problem(self) -> Problem:
        """What was solved."""
        return self.project.problem

    @property
    def model(self) -> Model:
        """Of the rig."""
        return self.problem.model

    def used(self, use: str) -> dict[str, Any]:
        """The block of result.json of each recording with that use."""
        return {n: r for n, r in self.result["recordings"].items() if r["use"] == use}

    def unit(self, signal: str) -> tuple[str, float]:
        """In which unit a signal is shown, and the factor to it."""
        units = {n: u for r in self.project.recordings for n, u in r.units.items()}
        return shown_unit(units.get(signal, "rad"))

    def shown(self, signal: str, value: float, form: str = ".2g") -> str:
        """A value of a signal in its shown unit."""
        return in_unit(value, self.unit(signal), form)

    @cached_property
    def residuals(self) -> Analyses:
        """Each residual, tested."""
        return analysed(self.fit.recordings, self.project.resolutions) if self.tested is None else self.tested

    @cached_property
    def as_recorded(self) -> dict[str, Recording]:
        """Each recording from its file's first sample to its last; as it was used, where the file has gone."""
        tables, signals = tomllib.loads(self.project.text)["recording"], (*self.model.outputs, *self.model.inputs)
        return {r.name: _whole(r, s, signals) for r, s in zip(self.project.recordings, tables, strict=True)}

    def beside(self, name: str) -> dict[str, Any]:
        """A JSON file of the run folder; empty where there is none that can be read."""
        return dict(self._beside[0].get(name, {}))

    @property
    def left_out(self) -> list[str]:
        """Which of these are damaged, and left out for that."""
        return self._beside[1]

    @cached_property
    def _beside(self) -> tuple[dict[str, Any], list[str]]:
        contents, damaged = {}, []
        for name, (block, wrote) in BESIDE.items():
            try:
                contents[name] = read_as(self.folder / name, block, wrote)
            except OSError:
                continue
            except InputError as error:
                damaged.append(f"{error} It is left out here.")
        return contents, damaged


def _whole(recording: Recording, table: Mapping[str, Any], signals: tuple[str, ...]) -> Recording:
    if {"from", "to"} & table.keys() or recording.report.resampled is not None:  # else it was used whole
        with suppress(FracidError, OSError):
            return inspect_recording(
                recording.path, {n: table[n] for n in signals if n in table}, time=table.get("time"),
                name=recording.name, variable=table.get("variable"),
            )  # fmt: skip
    return recording
