"""The pendulum's constants by linear regression, of a project or of a recording: ``fracid regress``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fracid.cards import Card, CardDisplay, brief
from fracid.errors import InputError, refuse_unknown
from fracid.findings import Words
from fracid.models import Model, rotary_pendulum
from fracid.problem import Free, Problem
from fracid.problem.project import Project, load_project
from fracid.recording import Recording, load_recording
from fracid.regression import LUMPED, TERMS, Regression, regress, start_of
from fracid.regression.equations import regress_equations
from fracid.regression.rows import swing_of, terms_of
from fracid.safety.paths import kind_of, refuse_mistaken
from fracid.tasks.job import one_blas_thread
from fracid.validation.unknown_past import whole_recordings
from fracid.workflows.records import json_document, write_files

SAYS = Words("workflows/regression.toml")

REGRESSION = "regression.json"


@dataclass(frozen=True)
class _Asked:
    """What to regress on what."""

    recordings: tuple[Recording, ...]
    model: Model
    orders: Mapping[str, float | Free]
    terms: tuple[str, ...]
    known: Mapping[str, float]
    problem: Problem | None = None
    """The project's: its start is given too."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class FinishedRegression(CardDisplay):
    """Regressions by the names of their recordings."""

    asked: _Asked
    regressions: Mapping[str, Regression]

    def _card(self) -> Card:
        rows = tuple((n, brief(r)) for n, r in self.regressions.items())
        if len(rows) == 1:
            rows = next(iter(self.regressions.values()))._card().rows
        return Card(f"Regression of {', '.join(self.regressions)}", rows)

    def starts(self, regression: Regression) -> dict[str, tuple[float, float]]:
        """Unknown of the project → its start there, and the one that a regression gives, where that is another."""
        problem = self.asked.problem
        if problem is None:
            return {}
        pairs = zip(problem.start.tolist(), start_of(problem, regression).tolist(), strict=True)
        return {n: (old, new) for n, (old, new) in zip(problem.names, pairs, strict=True) if new != old}

    @property
    def result(self) -> dict[str, Any]:
        """The content of regression.json: one regression as it is, several by name."""
        head = {"notes": [*self.asked.notes], "data_sha256": {r.name: r.sha256 for r in self.asked.recordings}}
        records = {
            name: f.to_json() | {"start": {n: new for n, (_, new) in self.starts(f).items()}}
            for name, f in self.regressions.items()
        }
        if len(records) > 1:
            return head | {"recordings": records}
        (record,) = records.values()
        return record | head


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
        if source.suffix == ".toml":
            asked = _of_project(load_project(source, trust=trust), start, stop)
        else:
            asked = _of_recording(source, start, stop, **recording)
        if asked.model.linear_terms is None and asked.problem is not None:
            names = ", ".join(r.name for r in asked.recordings)
            estimate = FinishedRegression(asked, {names: regress_equations(asked.problem)})
        else:
            said = _as_said(asked, known, orders, terms)
            groups = [[r] for r in said.recordings] if each else [list(said.recordings)]
            estimate = FinishedRegression(said, {
                ", ".join(r.name for r in group): regress(
                    group, said.model, orders=said.orders, known=said.known, terms=said.terms, cutoff=cutoff,
                    estimator=estimator,  # type: ignore[arg-type]
                )
                for group in groups
            })  # fmt: skip
    if out is not None:
        write_files(out, {REGRESSION: json_document(estimate.result)})
    return estimate


# ------------------------------------------------------------------ what is asked


def _of_project(project: Project, start: float | str | None, stop: float | None) -> _Asked:
    """What the project fits: its free constants and orders, its fixed ones, recordings; or equations, as they are."""
    problem, fitted = project.problem, {e.name for e in project.problem.experiments}
    if problem.model.linear_terms is None:
        return _Asked(tuple(r for r in project.recordings if r.name in fitted), problem.model, {}, (), {}, problem)
    free = {u.target for u in problem.unknowns if u.kind == "parameter"}
    ties = {n for n, root in problem.ties.items() if root in free or n in problem.orders}
    orders = {n: problem.orders[problem.ties.get(n, n)] for n in problem.orders}
    notes = [f"{', '.join(sorted(ties))}: tied in the project, estimated separately here: the regression ignores ties."]
    request = _Asked(
        _recordings(project, start, stop), problem.model.with_parameters(**problem.parameter_starts),
        {n: v if isinstance(v, Free) else problem.order_starts[n] for n, v in orders.items()},
        tuple(n for n in TERMS if n in free | ties), {}, problem, tuple(notes if ties else ()),
    )  # fmt: skip
    return _in_motion(request)


def _recordings(project: Project, start: float | str | None, stop: float | None) -> tuple[Recording, ...]:
    """The recordings to be fitted, from another start if one is asked for."""
    fitted = {e.name for e in project.problem.experiments}
    recordings = project.recordings if start is None else whole_recordings(project)
    names = (*project.problem.outputs, *project.problem.model.inputs)  # an arm that is not scored may stand still
    trimmed = (r.trim(start, stop) for r in recordings if r.name in fitted)
    return tuple(replace(r, signals={n: x for n, x in r.signals.items() if n in names}) for r in trimmed)


def _in_motion(request: _Asked) -> _Asked:
    """Leave orders as they are where a recording starts in motion: what its memory misses would pass for an order."""
    moving = [r.name for r in request.recordings if swing_of(r, request.model).in_motion]
    searched = [n for n, v in request.orders.items() if isinstance(v, Free)]
    if not moving or not searched:
        return request
    note = SAYS("in-motion", moving=", ".join(moving), searched=" and ".join(searched))
    orders = {n: v.start if isinstance(v, Free) else v for n, v in request.orders.items()}
    return replace(request, orders=orders, notes=(*request.notes, note))


def _of_recording(
    path: Path, start: float | str | None, stop: float | None, *, columns: Mapping[str, Any] | None,
    time: Mapping[str, Any] | None, variable: str | None, rig: str | None, zero: str | None,
) -> _Asked:  # fmt: skip
    """The nine lumped constants of a rig, from one recording."""
    if columns is None or "alpha" not in columns:
        raise InputError(SAYS("which-column", path=path))
    recording = load_recording(
        path, columns, time=time, start=start, stop=stop,
        variable=variable, resample="needed",
    )  # fmt: skip
    words: dict[str, Any] = {n: v for n, v in (("rig", rig), ("zero", zero)) if v is not None}
    model = rotary_pendulum(**words)
    return _in_motion(_Asked((recording,), model, dict.fromkeys(("lambda", "mu"), Free(1.0, 0.5, 1.2)), LUMPED, {}))


def _as_said(request: _Asked, known: Mapping[str, float], orders: Mapping[str, float], terms: Sequence[str]) -> _Asked:
    """With the constants and orders that the caller knows.

    Where all is looked for, one is taken as it is: a common factor of all constants changes no motion.
    """
    refuse_unknown("order", request.orders, *orders)
    terms = tuple(terms) or request.terms or LUMPED
    request = replace(request, orders={**request.orders, **orders}, terms=terms, known=known)
    volts = any("voltage" in r.signals for r in request.recordings) and request.model.drive not in terms
    torque = any("torque" in r.signals for r in request.recordings)
    constants = [
        n for n in LUMPED if n not in terms and n in request.model.parameter_names and request.model.parameter(n).value
    ]
    if known or volts or torque or constants:
        return request
    gauge = request.model.parameter(terms_of(request.model).gauge)
    owner = "project" if request.problem else "rig"
    note = SAYS("gauge", gauge=gauge, owner=owner)
    return replace(request, known={gauge.name: gauge.value}, notes=(*request.notes, note))
