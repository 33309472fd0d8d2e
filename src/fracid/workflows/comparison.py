"""A comparison of structures with its folder: ``fracid compare``, to be called from Python too.

Every fit goes into the folder's journal as it ends, and the same call goes on from there.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any

from pydantic import Field

from fracid.bayes.evidence import require_evidence
from fracid.estimation.long_records import to_compare
from fracid.models.friction import RUNGS
from fracid.problem import Experiment, Problem
from fracid.problem.problem import alternative_of
from fracid.problem.project import Project
from fracid.problem.toml_text import plain_value, reached, toml_document
from fracid.runs.folder import JOURNAL, open_folder
from fracid.safety.schema import Block, Record, as_json, fault_of
from fracid.safety.user_code import is_own
from fracid.selection.amplitude import AmplitudeTest
from fracid.selection.comparison import GIVEN, compare
from fracid.selection.comparison_records import (
    Comparison,
    CurvesBlock,
    EvidenceBlock,
    GivenBlock,
    drawn,
    fault_of_fitted,
)
from fracid.selection.integer_rival import Alternative
from fracid.selection.ladder import ladder
from fracid.tasks.display import unless_given
from fracid.tasks.folder_lock import FolderLock
from fracid.tasks.job import one_blas_thread
from fracid.tasks.progress import Observer
from fracid.tasks.tasks import executor_from_name
from fracid.workflows.figures import of_comparison
from fracid.workflows.fit import loaded
from fracid.workflows.records import command_of, csv_text
from fracid.workflows.study import Finished, folder_of, header_of, journal_of, refuse_fit, study_of

TABLE, CURVES, BEST = "compare.csv", "curves.json", "best.toml"

MOST_RECORDINGS = 12
"""Whose curves are kept, held out ones first."""


class _Step(Block):
    substeps: int = Field(ge=1)


class _Rival(Block):
    alternative: Alternative | None = None


BESIDE: dict[str, type[Block | Record]] = {
    "amplitude |": AmplitudeTest, "evidence |": EvidenceBlock, GIVEN: GivenBlock, "alternatives |": _Rival,
    "step |": _Step,
}  # fmt: skip
"""How the keys of a journal begin that are no fits, and what they have."""


@dataclass(frozen=True, repr=False)
class FinishedComparison(Finished):
    """A comparison with its folder."""

    FILE, FOUND = "compare.json", "comparison"

    project: Project
    comparison: Comparison
    table: Path
    """Path of compare.csv."""

    @property
    def best(self) -> Path | None:
        """Path of best.toml: the project with the best structure and its values; None where no run of it ends."""
        path = self.folder / BEST
        return path if path.exists() else None


def run_comparison(
    project: str | Path | Project,
    *,
    out: str | Path | None = None,
    leave_one_out: bool = False,
    amplitude: bool = False,
    evidence: bool = False,
    starts: int | None = None,
    keep: Sequence[str] = (),
    rungs: Sequence[str] = (),
    preset: str | None = None,
    seed: int | None = None,
    jobs: int = 1,
    executor: str | None = None,
    trust: bool = False,
    observer: Observer | None = None,
    command: Sequence[str] | None = None,
) -> FinishedComparison:
    """Fit every structure to a project's recordings, and write the folder: what ``fracid compare`` does.

    Interrupted, the same call resumes.

    Parameters
    ----------
    project : str, Path or Project
    out : str or Path, optional
        The folder; ``runs/rig-compare`` of ``rig.toml`` if left out.
    leave_one_out, amplitude, evidence, keep
        As of :func:`fracid.compare`.
    rungs : sequence of str, optional
        Of the ladder (:data:`fracid.models.friction.RUNGS`), or ``all``; as :func:`fracid.compare` has it if left out.
    starts, seed
        In place of the project's.
    preset, jobs, trust, observer, command
        As of :func:`fracid.run`.
    executor : str, optional
        ``threads``, ``processes`` or a scheduler's address; threads if left out.

    Raises
    ------
    InputError
        For a project or an option that cannot be, and for a folder that holds a fit or cannot be written.
    NotTrusted
        If the project names code of its own, and `trust` is not given.
    Unfinished
        Where something ended it early, Ctrl-C too; what was done is kept.

    Examples
    --------
    >>> run_comparison("nowhere/rig.toml")
    Traceback (most recent call last):
    fracid.errors.InputError: There is no nowhere/rig.toml. ...
    """
    watching = unless_given(observer)
    watching.stage("recordings")
    project, executor = loaded(project, preset, trust), executor or "threads"
    folder = folder_of(out, project.path, "compare")
    options: dict[str, Any] = {
        "leave_one_out": leave_one_out, "amplitude": amplitude, "evidence": evidence, "keep": sorted(keep),
        "rungs": list(RUNGS if "all" in rungs else rungs) or None,
        "seed": project.seed if seed is None else seed, "starts": starts or project.starts,
    }  # fmt: skip
    executor_from_name(executor)  # what is mistyped is refused before an earlier comparison gives way
    base, others = to_compare(project.problem, project.validation)
    beside = {n: alternative_of(base, p.model, p.orders, p.parameters) for n, p in project.alternatives.items()}
    asked = ladder(base, keep=options["keep"], rungs=options["rungs"], others=others, alternatives=beside)
    for structure in asked.structures if evidence else ():
        require_evidence(structure.problem)
    same = {name: value for name, value in options.items() if name not in ("amplitude", "evidence")}  # both add
    study = study_of("compare", project, preset=project.preset, **same)
    _begin(folder, study, _command(project, out, options, executor) if command is None else command)
    watching.stage("fits")
    fault = partial(_fault, project, leave_one_out)
    with one_blas_thread(), journal_of(folder, study, fault, watching, counted="fits") as kept:
        comparison = compare(project, executor=executor, jobs=jobs, **kept, **options)
    record = comparison.to_json() | {"data_sha256": {r.name: r.sha256 for r in project.recordings}}
    return FinishedComparison.written(folder, record, of_comparison(comparison), watching, contents={
        "project.toml": project.text, TABLE: csv_text(comparison.lines()),
        CURVES: json.dumps(_curves(base, others, comparison), separators=(",", ":")),
        **_best(project, comparison, folder),
    }, project=project, comparison=comparison, table=folder / TABLE)  # fmt: skip


def _curves(base: Problem, others: Sequence[Experiment], comparison: Comparison) -> dict[str, Any]:
    """Each recording beside what the structures simulate of it, where the page can draw them all."""
    every = {e.name: e for e in (*base.experiments, *others)}
    shown = [*dict.fromkeys((*comparison.held_out, *every))][:MOST_RECORDINGS]
    some = {n: drawn(every[n].time.size, len(every)) for n in shown if n in every}
    return as_json(CurvesBlock, {
        "recordings": {n: {
            "time": (every[n].time - every[n].time[0])[at],
            "measured": dict(zip(base.outputs, every[n].measured[at].T, strict=True)),
        } for n, at in some.items()},
        "structures": {row.name: {n: row.curves[n] for n in shown if n in row.curves} for row in comparison.rows},
    })  # fmt: skip


def _best(project: Project, comparison: Comparison, folder: Path) -> dict[str, str]:
    """The project with the structure that the claim is for, its search to begin at what was found."""
    row = comparison.best(fractional=comparison.claim == "fractional")
    found = comparison.problems[row.name]
    if found.model.name != project.problem.model.name or not isfinite(row.cost):
        return {}
    tables = tomllib.loads(project.text)
    model = tables.setdefault("model", {})
    for kind, values in {"parameters": found.parameters, "orders": found.orders}.items():
        given = model.get(kind, {})
        new = {n: v for n, v in values.items()
               if n in given or n in row.values or v != project.problem.parameters.get(n)}  # fmt: skip
        model[kind] = given | {n: plain_value(v, row.values.get(n), given.get(n)) for n, v in new.items()}
    places = [(r, "file") for r in tables["recording"]]
    code = [(model, "name"), (tables.get("fit", {}), "cost"), *((a, "model") for a in tables.get("alternative", []))]
    places += [(table, key) for table, key in code if is_own(table.get(key, ""))]
    for table, key in places:
        table[key] = reached(table[key], project.path.parent, folder)
    tables["fit"] = tables.get("fit", {}) | {"substeps": found.substeps}  # at which it was found
    head = f"# {row.name}: the structure that fracid compare found best, with its values.\n"
    return {BEST: head + toml_document(tables)}


def _command(project: Project, out: str | Path | None, options: Mapping[str, Any], executor: str) -> list[str]:
    choices = {name: options[name] for name in ("leave_one_out", "amplitude", "evidence", "keep", "seed")}
    place = None if executor == "threads" else executor
    more = {"rung": options["rungs"], "multi_start": options["starts"], "preset": project.preset, "executor": place}
    return command_of("compare", project.path, {"out": out, **choices, **more, "trust": bool(project.own_code)})


def _fault(project: Project, leave_one_out: bool, key: str, result: Any) -> str:
    """What is wrong with a result that the journal has."""
    for start, kind in BESIDE.items():
        if key.startswith(start):
            return fault_of(result, kind)
    there = fault_of_fitted(result, project.problem.outputs)
    if there or leave_one_out:
        return there
    fitted, validation = ({e.name for e in those} for those in (project.problem.experiments, project.validation))
    same = set(result["row"]["in_sample"]) == fitted and set(result["row"]["held_out"]) == validation
    return "" if same else "of other recordings"


def _begin(folder: Path, study: Mapping[str, Any], command: Sequence[str]) -> None:
    """Make the folder, or go on in it; a comparison that is finished gives way to another one."""
    journal, result = folder / JOURNAL, folder / FinishedComparison.FILE
    refuse_fit(folder, "compare")
    if result.exists() and journal.exists() and header_of(journal) != study:
        with FolderLock(folder):
            result.unlink()
            journal.unlink()
    if not journal.exists():  # else environment.json keeps the command that is resumed
        open_folder(folder, command)
