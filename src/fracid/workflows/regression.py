"""The pendulum's constants by linear regression, of a project or of a recording: ``fracid regress``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fracid.cards import Card, CardDisplay, brief
from fracid.errors import InputError, refuse_unknown
from fracid.findings import Words
from fracid.models import rotary_pendulum
from fracid.problem import Problem
from fracid.problem.project import Project, load_project
from fracid.recording import Recording, load_recording
from fracid.regression import LUMPED, Regression, start_of
from fracid.regression.equations import regress_equations
from fracid.regression.linear import SEARCHED, Asked
from fracid.regression.rows import swing_of
from fracid.safety.door import write_files
from fracid.safety.json_files import json_document
from fracid.safety.paths import kind_of, refuse_mistaken
from fracid.tasks.job import one_blas_thread
from fracid.validation.unknown_past import whole_recordings

SAYS = Words("workflows/regression.toml")

REGRESSION = "regression.json"


@dataclass(frozen=True, repr=False)
class FinishedRegression(CardDisplay):
    """Regressions by the names of their recordings."""

    recordings: tuple[Recording, ...]
    problem: Problem | None
    """The project's: its start is given too."""
    notes: tuple[str, ...]
    regressions: Mapping[str, Regression]

    def _card(self) -> Card:
        rows = tuple((n, brief(r)) for n, r in self.regressions.items())
        if len(rows) == 1:
            rows = next(iter(self.regressions.values()))._card().rows
        return Card(f"Regression of {', '.join(self.regressions)}", rows)

    def starts(self, regression: Regression) -> dict[str, tuple[float, float]]:
        """Unknown of the project → its start there, and the one that a regression gives, where that is another."""
        if (problem := self.problem) is None:
            return {}
        pairs = zip(problem.start.tolist(), start_of(problem, regression).tolist(), strict=True)
        return {n: (old, new) for n, (old, new) in zip(problem.names, pairs, strict=True) if new != old}

    @property
    def result(self) -> dict[str, Any]:
        """The content of regression.json: one regression as it is, several by name."""
        head = {"notes": [*self.notes], "data_sha256": {r.name: r.sha256 for r in self.recordings}}
        records = {
            name: f.to_json() | {"start": {n: new for n, (_, new) in self.starts(f).items()}}
            for name, f in self.regressions.items()
        }
        record, *others = records.values()
        return head | {"recordings": records} if others else record | head


def run_regression(
    source: Path,
    *,
    known: Mapping[str, float],
    orders: Mapping[str, float],
    terms: Sequence[str],
    estimator: str,
    cutoff: float | None,
    each: bool,
    start: float | str | None,
    stop: float | None,
    trust: bool,
    out: Path | None,
    **recording: Any,
) -> FinishedRegression:
    """Regress the constants on a project's recordings, or on one, and write regression.json where `out` says.

    Parameters
    ----------
    source : Path
        A project file, or a recording.
    known, orders : mapping
        Constants [SI] and orders that are known.
    terms : sequence of str
        The constants to look for; what is free in the project, or all of a rig, if empty.
    estimator, cutoff
        As of :func:`fracid.regress`.
    each : bool
        Each recording by itself.
    start, stop
        First and last time [s].
    trust : bool
        Let the project run code of its own.
    out : Path or None
        The folder.
    recording
        Of a recording: ``columns``, ``time``, ``variable``, ``rig``, ``zero``.

    Raises
    ------
    InputError
        For what cannot be regressed, and for a folder that cannot be written.
    NotTrusted
        If the project names code of its own, and `trust` is not given.
    """
    if kind_of(source) not in ("project", None):
        refuse_mistaken(source, "recording")
    with one_blas_thread():
        project = load_project(source, trust=trust) if source.suffix == ".toml" else None
        problem = None if project is None else project.problem
        if project is not None and project.problem.model.linear_terms is None:
            recordings, notes = _fitted(project, project.recordings), tuple[str, ...]()
            regressions = {", ".join(r.name for r in recordings): regress_equations(project.problem)}
        else:
            if project is None:
                recordings, asked = _of_recording(source, start, stop, **recording)
            else:
                recordings, asked = _recordings(project, start, stop), Asked.by(project.problem)
            refuse_unknown("order", asked.orders, *orders)
            sought = tuple(terms) or asked.terms or LUMPED
            asked = replace(asked, orders={**asked.orders, **orders}, terms=sought, known=known)
            fitted = {} if problem is None else {e.name: e for e in problem.experiments}
            swings = [swing_of(r, asked.model, fitted.get(r.name)) for r in recordings]
            asked = asked.settled(swings, "rig" if project is None else "project")
            notes, groups = asked.notes, [[s] for s in swings] if each else [swings]
            regressions = {", ".join(s.name for s in group): asked.of(group, estimator, cutoff) for group in groups}
    estimate = FinishedRegression(recordings, problem, notes, regressions)
    if out is not None:
        write_files(out, {REGRESSION: json_document(estimate.result)})
    return estimate


# ------------------------------------------------------------------ what is asked


def _fitted(project: Project, recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """Those that the project fits."""
    fitted = {e.name for e in project.problem.experiments}
    return tuple(r for r in recordings if r.name in fitted)


def _recordings(project: Project, start: float | str | None, stop: float | None) -> tuple[Recording, ...]:
    """The recordings to be fitted, from another start if one is asked for."""
    recordings = project.recordings if start is None else whole_recordings(project)
    names = (*project.problem.outputs, *project.problem.model.inputs)  # an arm that is not scored may stand still
    trimmed = (r.trim(start, stop) for r in _fitted(project, recordings))
    return tuple(replace(r, signals={n: x for n, x in r.signals.items() if n in names}) for r in trimmed)


def _of_recording(
    path: Path, start: float | str | None, stop: float | None, *, columns: Mapping[str, Any] | None,
    time: Mapping[str, Any] | None, variable: str | None, rig: str | None, zero: str | None,
) -> tuple[tuple[Recording, ...], Asked]:  # fmt: skip
    """The nine lumped constants of a rig, from one recording."""
    if columns is None or "alpha" not in columns:
        raise InputError(SAYS("which-column", path=path))
    recording = load_recording(path, columns, time=time, start=start, stop=stop, variable=variable, resample="needed")
    words: dict[str, Any] = {n: v for n, v in (("rig", rig), ("zero", zero)) if v is not None}
    model = rotary_pendulum(actuation="torque" if "torque" in columns else "voltage", **words)
    return (recording,), Asked(model, dict.fromkeys(model.order_names, SEARCHED), LUMPED)
