"""All that a report is made of: the run, its recordings beside their simulations, and what lies in its folder."""

from __future__ import annotations

import tomllib
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import FracidError, InputError
from fracid.recording import Recording, inspect_recording
from fracid.report.sentences import number
from fracid.runs.folder import EVALUATIONS
from fracid.safety.schema import Block, lines_of, read_as
from fracid.schemas.comparison import ComparisonBlock
from fracid.schemas.profiles import ProfilesBlock
from fracid.schemas.result import ResultBlock
from fracid.schemas.run_record import EnvironmentBlock, EvaluationLine
from fracid.units import SHOWN_UNITS
from fracid.validation.residuals import residual_analysis

if TYPE_CHECKING:
    from fracid.estimation.cost_plane import CostPlane
    from fracid.estimation.records import RecordingFit
    from fracid.fit import Fit
    from fracid.problem.project import Project
    from fracid.runs.saved import SavedRun
    from fracid.validation.residual_records import ResidualAnalysis

__all__ = ["Analyses", "Material", "analysed", "tried"]

Analyses = Mapping[str, Mapping[str, "ResidualAnalysis"]]
"""Recording → output → what its residual says."""

ANALYSED = 600_000
"""Samples of a residual that are tested, ten minutes at 1 kHz: more tell no more, and take memory and minutes."""

BESIDE: dict[str, tuple[type[Block], str]] = {
    "profiles.json": (ProfilesBlock, "fracid profile RUN"),
    "compare.json": (ComparisonBlock, "fracid compare PROJECT --out RUN"),
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
    x: FloatArray
    """The unknowns where the search ended, shape (n_unknowns,)."""
    recordings: Mapping[str, RecordingFit]
    """Each recording beside its simulation, fitted ones first."""
    plane: CostPlane | None = None
    """The cost over two free orders."""
    notes: tuple[str, ...] = field(default=())
    """What differs from the run as it was."""
    made: Analyses | None = None
    """What each residual says, where somebody has asked before."""

    @classmethod
    def of_run(cls, run: SavedRun, plane: CostPlane | None = None) -> Material:
        """From a folder that was read back."""
        return cls(run.folder, run.result, run.project, run.x, run.recordings, plane, run.notes)

    @classmethod
    def of_fit(
        cls, folder: Path, fit: Fit, project: Project, plane: CostPlane | None = None, made: Analyses | None = None
    ) -> Material:
        """From a fit that has just been written to its folder."""
        try:
            result = read_as(folder / "result.json", ResultBlock, "fracid fit PROJECT")
        except OSError:
            raise InputError(f"{folder} has no result.json that can be read: write the fit's result first.") from None
        return cls(folder, result, project, fit.x, fit.recordings, plane, made=made)

    def used(self, use: str) -> dict[str, Any]:
        """The block of result.json of each recording with that use."""
        return {n: r for n, r in self.result["recordings"].items() if r["use"] == use}

    def unit(self, signal: str) -> tuple[str, float]:
        """In which unit a signal is shown, and the factor to it."""
        units = {n: u for r in self.project.recordings for n, u in r.units.items()}
        unit = units.get(signal, "rad")
        return SHOWN_UNITS.get(unit, ("" if unit == "1" else unit, 1.0))

    def shown(self, signal: str, value: float, form: str = ".2g") -> str:
        """A value of a signal in its shown unit."""
        unit, factor = self.unit(signal)
        return f"{number(factor * value, form)}{unit if unit == '°' else f' {unit}'.rstrip()}"

    @cached_property
    def analyses(self) -> Analyses:
        """What each residual says."""
        return analysed(self.recordings, self.project.resolutions) if self.made is None else self.made

    @cached_property
    def as_recorded(self) -> dict[str, Recording]:
        """Each recording from its file's first sample to its last; as it was used, where the file has gone."""
        tables = tomllib.loads(self.project.text)["recording"]
        return {r.name: _whole(r, s, self._signals) for r, s in zip(self.project.recordings, tables, strict=True)}

    @property
    def _signals(self) -> tuple[str, ...]:
        return (*self.project.problem.model.outputs, *self.project.problem.model.inputs)

    @cached_property
    def tried(self) -> FloatArray:
        """The plane's two orders at all evaluations of the log, shape (n, 2)."""
        if self.plane is None:
            return np.empty((0, 2))
        return tried(self.folder, self.plane.names)

    def beside(self, name: str) -> dict[str, Any] | None:
        """A JSON file of the run folder; None where there is none that can be read."""
        return self._beside[0].get(name)

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


def analysed(recordings: Mapping[str, RecordingFit], resolutions: Mapping[str, Mapping[str, Any]]) -> Analyses:
    """Recording → output → what its residual says; of a very long one, the first :data:`ANALYSED` samples."""
    return {
        name: {n: residual_analysis(first_part(r), n, resolutions[name]) for n in r.measured}
        for name, r in recordings.items()
    }


def first_part(r: RecordingFit, samples: int = ANALYSED) -> RecordingFit:
    """The first so many samples of a recording and its simulation, without a copy."""
    if r.time.size <= samples:
        return r
    measured, fitted = ({n: y[:samples] for n, y in lines.items()} for lines in (r.measured, r.fitted))
    return replace(r, time=r.time[:samples], measured=measured, fitted=fitted)


def _whole(recording: Recording, table: Mapping[str, Any], signals: tuple[str, ...]) -> Recording:
    if not {"from", "to"} & table.keys() and recording.report.resampled is None:
        return recording  # it was used whole
    try:
        return inspect_recording(
            recording.path, {n: table[n] for n in signals if n in table}, time=table.get("time"), name=recording.name,
            variable=table.get("variable"),
        )  # fmt: skip
    except (FracidError, OSError):
        return recording


def tried(folder: Path, names: tuple[str, str]) -> FloatArray:
    """Two unknowns at all evaluations in the log of a folder, shape (n, 2); a line that is torn is left out."""
    flat = array("d")
    for line in lines_of(folder / EVALUATIONS, EvaluationLine):
        if all(n in line["point"] for n in names):
            flat.extend(line["point"][n] for n in names)
    return np.array(flat).reshape(-1, 2)
