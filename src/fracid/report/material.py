"""All that a report is made of: the run, its recordings beside their simulations, and what lies in its folder."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fracid.errors import FracidError, InputError
from fracid.plots.look import SHOWN_UNITS
from fracid.recording import Recording, inspect_recording
from fracid.report.words import number
from fracid.residuals import residual_analysis
from fracid.runs import EVALUATIONS

if TYPE_CHECKING:
    from fracid.diagnostics import CostPlane
    from fracid.identify import Fit, RecordingFit
    from fracid.project import Project
    from fracid.residuals import ResidualAnalysis
    from fracid.saved import SavedRun

__all__ = ["Material"]

FloatArray = NDArray[np.float64]

ANALYSED = 600_000
"""Samples of a residual that are tested, ten minutes at 1 kHz: more tell no more, and take memory and minutes."""


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

    @classmethod
    def of_run(cls, run: SavedRun, plane: CostPlane | None = None) -> Material:
        """From a folder that was read back."""
        return cls(run.folder, run.result, run.project, run.x, run.recordings, plane, run.notes)

    @classmethod
    def of_fit(cls, folder: Path, fit: Fit, project: Project, plane: CostPlane | None = None) -> Material:
        """From a fit that has just been written to its folder."""
        result = _read(folder / "result.json")
        if result is None:
            raise InputError(f"{folder} has no result.json that can be read: write the fit's result first.")
        return cls(folder, result, project, fit.x, fit.recordings, plane)

    def used(self, use: str) -> dict[str, Any]:
        """The block of result.json of each recording with that use."""
        return {n: r for n, r in self.result["recordings"].items() if r["use"] == use}

    def unit(self, signal: str) -> tuple[str, float]:
        """In which unit a signal is shown, and the factor to it."""
        units = {n: u for r in self.project.recordings for n, u in r.units.items()}
        said = units.get(signal, "rad")
        return SHOWN_UNITS.get(said, ("" if said == "1" else said, 1.0))

    def shown(self, signal: str, value: float, form: str = ".2g") -> str:
        """A value of a signal in its shown unit."""
        unit, factor = self.unit(signal)
        return f"{number(factor * value, form)}{unit if unit == '°' else f' {unit}'.rstrip()}"

    @cached_property
    def analyses(self) -> dict[str, dict[str, ResidualAnalysis]]:
        """Recording → output → what its residual says; of a very long one, the first :data:`ANALYSED` samples."""
        return {
            name: {n: residual_analysis(first_part(r), n, self.project.resolutions[name]) for n in r.measured}
            for name, r in self.recordings.items()
        }

    @cached_property
    def as_recorded(self) -> dict[str, Recording]:
        """Each recording from its file's first sample to its last; as it was used, where the file has gone."""
        said = tomllib.loads(self.project.text)["recording"]
        return {r.name: _whole(r, s, self._signals) for r, s in zip(self.project.recordings, said, strict=True)}

    @property
    def _signals(self) -> tuple[str, ...]:
        return (*self.project.problem.model.outputs, *self.project.problem.model.inputs)

    @cached_property
    def tried(self) -> FloatArray:
        """The plane's two orders at all evaluations of the log, shape (n, 2)."""
        if self.plane is None:
            return np.empty((0, 2))
        points = [line.get("point", {}) for line in _lines(self.folder / EVALUATIONS)]
        names = self.plane.names
        return np.array([[p[n] for n in names] for p in points if all(n in p for n in names)]).reshape(-1, 2)

    def beside(self, name: str) -> dict[str, Any] | None:
        """A JSON file of the run folder; None where there is none that can be read."""
        return _read(self.folder / name)


def first_part(r: RecordingFit, samples: int = ANALYSED) -> RecordingFit:
    """The first so many samples of a recording and its simulation, without a copy."""
    if r.time.size <= samples:
        return r
    measured, fitted = ({n: y[:samples] for n, y in lines.items()} for lines in (r.measured, r.fitted))
    return replace(r, time=r.time[:samples], measured=measured, fitted=fitted)


def _whole(recording: Recording, said: Mapping[str, Any], signals: tuple[str, ...]) -> Recording:
    if not {"from", "to"} & said.keys() and recording.report.resampled is None:
        return recording  # it was used whole
    try:
        return inspect_recording(
            recording.path, {n: said[n] for n in signals if n in said}, time=said.get("time"), name=recording.name,
            variable=said.get("variable"),
        )  # fmt: skip
    except (FracidError, OSError):
        return recording


def _read(path: Path) -> dict[str, Any] | None:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def _lines(path: Path) -> list[dict[str, Any]]:
    """The lines of a log; a torn last one is left out."""
    found = []
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return []
    for line in text.splitlines():
        try:
            found.append(json.loads(line))
        except ValueError:
            continue
    return [line for line in found if isinstance(line, dict)]
