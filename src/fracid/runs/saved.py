"""A run folder read back: the problem, the values that were found, and each recording beside its simulation.

::

    runs/NAME/result.json   ──  the values of all unknowns           ┐
    runs/NAME/project.toml  ──  model, recordings, what was free     ┴→  SavedRun: problem, x, recordings

A run folder has no samples.  :func:`load_run` reads the project and its recordings again, refuses recordings whose hash
is not that of the run's, and simulates with the values of ``result.json``, validation recordings with their own.  A
float goes through JSON unchanged, so the same versions give the same trajectories to the last bit; where the rmse
does differ from the saved one a note says so.

The folder may come from a stranger or from a dying disc.  Each file must be of its :mod:`schema
<fracid.fit>`, and ``result.json`` of one run with ``project.toml``: the same recordings, outputs and orders,
values within their bounds.
"""

from __future__ import annotations

import math
from collections import UserDict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from fracid.cards import Card
from fracid.errors import FracidError, InputError, NotTrusted, typed
from fracid.estimation.records import RecordingFit, fit_of
from fracid.estimation.windows import windowed
from fracid.fit import Fit
from fracid.problem import Problem
from fracid.problem.project import LARGEST_FILE, Project, project_from_text
from fracid.runs.folder import RUN, SAYS, RunState
from fracid.safety.door import text_if_any
from fracid.safety.json_files import object_of
from fracid.safety.paths import path_of, refuse_mistaken
from fracid.safety.schema import UNREAD, Beside, as_json, fault_of, read_if_whole, record_of
from fracid.safety.text import ascii_short
from fracid.schemas.run_record import EnvironmentBlock
from fracid.selection.opened_bounds import reopened
from fracid.tasks.folder_lock import refuse_links
from fracid.units import with_unit

DIFFERENT = 1e-6
"""Relative difference of an rmse from the saved one that is told."""

MOST_WORDS = 1000
"""Of a command, that are looked at for a project file."""


@dataclass(frozen=True, repr=False, kw_only=True)
class SavedRun(Fit):
    """What :func:`load_run` gives: a :class:`fracid.Fit` that was read; its covariance is not read.

    Its recordings are simulated when they are first asked for, with the values of validation recordings too.
    """

    preset: str | None = None
    data_sha256: Mapping[str, str]
    versions: Mapping[str, str]
    timing: Mapping[str, float] = field(default_factory=dict)
    folder: Beside[Path] = UNREAD
    result: Beside[Mapping[str, Any]] = UNREAD
    """The content of ``result.json``."""
    project: Beside[Project] = UNREAD
    values: Beside[Mapping[str, float]] = UNREAD
    """Name of each unknown → its value, those of validation recordings too."""

    @property
    def problems(self) -> tuple[Problem, ...]:
        """That of the fit, and one for each validation recording, with values of its own."""
        return (self.problem, *(self.problem.with_shared(self.x, (e,)) for e in self.project.validation))

    def to_json(self) -> dict[str, Any]:
        """The content of ``result.json``."""
        return dict(self.result)

    @property
    def resolutions(self) -> dict[str, dict[str, float | None]]:
        """Recording → signal → the step of its encoder [rad]; None where none is seen."""
        return self.project.resolutions

    @property
    def notes(self) -> tuple[str, ...]:
        """What differs from the run as it was: simulates all recordings."""
        return tuple(self._differences())

    def _card(self) -> Card:
        result, project = self.result, self.project
        units = {e.name: e.units for e in (*project.problem.experiments, *project.validation)}
        scores = {n: (r["use"], r["rmse"], units.get(n, {})) for n, r in result["recordings"].items()}
        return self._card_of(f"Run {self.folder.name or self.folder}, fit of {result['model']['name']}", scores)

    def _differences(self) -> Iterator[str]:
        if text_if_any(self.project.path, LARGEST_FILE) not in (None, self.project.text):
            yield f"{self.project.path} has changed since the run; what counts here is the run's own copy of it."
        for name, r in self.recordings.items():
            scores = self.result["recordings"].get(name, {}).get("rmse", {})
            for output, now in r.rmse.items():
                if (before := scores.get(output)) is not None and not abs(now - before) <= DIFFERENT * before:
                    again, found = (with_unit(v, r.unit(output), ".6g") for v in (now, before))
                    yield SAYS("other-errors", name=name, output=output, again=again, found=found)


class _Recordings(UserDict[str, RecordingFit]):
    """Each recording beside its simulation, made when the first is asked for; NaN where the run fails."""

    def __init__(self, make: Callable[[], dict[str, RecordingFit]]) -> None:
        self._make = make

    @cached_property
    def data(self) -> dict[str, RecordingFit]:  # type: ignore[override]
        return self._make()


def _simulated(run: SavedRun) -> dict[str, RecordingFit]:
    """Of a run that has its recordings as its file has them."""
    validating = run.problems[1:]
    if run.window is not None:
        validating = tuple(windowed(p, run.window) for p in validating)
    return {
        name: fit_of(own, own.point(run.values), name, use, initial=there.initial, parameters=there.parameters)
        for own, use in [(run.problem, "fit"), *((p, "validate") for p in validating)] for name in own.recordings
        for there in [run.recordings[name]]
    }  # fmt: skip


def load_run(folder: str | Path, *, trust: bool = False) -> SavedRun:
    """Read the folder of a run of ``fracid fit``.

    Parameters
    ----------
    folder : str or Path
        With ``result.json`` and ``project.toml``; the recordings are looked for where the run found them.
    trust : bool
        Run Python code that its project refers to, a model or a cost in a file.  Review it first.

    Returns
    -------
    SavedRun

    Raises
    ------
    InputError
        If it is no run folder, its recordings are not where they were, or one has changed.
    NotTrusted
        If its project names code of its own, and `trust` is not given.

    Examples
    --------
    >>> import tempfile
    >>> load_run(tempfile.mkdtemp())
    Traceback (most recent call last):
    fracid.errors.InputError: ... is no run folder: it has no result.json that can be read. Give one that fracid fit
    wrote.
    """
    folder = path_of(folder, "'runs/swing'")
    refuse_mistaken(folder, "run")
    refuse_links(folder)
    result = _read(folder / "result.json")
    project = _project(folder, result, trust)
    for r in project.recordings:
        if result["data_sha256"].get(r.name) != r.sha256:
            raise InputError(f"The recording {r.name!r} is not the one that {folder} was fitted to; fit it again.")
    try:
        run = _read_back(folder, result, project)
        for fault in _strange(run):
            raise InputError(f"{fault}.")
    except InputError as error:
        raise InputError(f"{folder / 'result.json'} is not of the project beside it: {error} Fit it again.") from None
    return run


def _read_back(folder: Path, result: Mapping[str, Any], project: Project) -> SavedRun:
    """The fit that result.json describes: of the project, with the bounds that it opened and the step that it took."""
    run, values = record_of(SavedRun, result), _values(result)
    problem = reopened(project.problem, run.opened_bounds)
    if run.window is not None:
        problem = windowed(problem, run.window)
    if not project.fixed_step and run.substeps is not None:
        problem = replace(problem, substeps=run.substeps)
    run = replace(run, folder=folder, result=result, project=project, values=values, problem=problem,
                  x=problem.point(values), uncertainty=None)  # fmt: skip
    return replace(run, recordings=_Recordings(partial(_simulated, run)))


def _strange(run: SavedRun) -> Iterator[str]:
    """What result.json says that no fit of this project says, in words."""
    result, project, model = run.result, run.project, run.problem.model
    if set(result["recordings"]) != {r.name for r in project.recordings}:
        yield "its recordings are others"
    if missing := set(model.order_names) - set(result["orders"]):
        yield f"it has no order {min(missing)!r}"
    lost = [u.name for u in run.problem.unknowns if u.experiment is None and u.name not in run.values]
    if lost and result["cost"]["value"] is not None:  # of a search that did not fail
        yield f"it has no value of {lost[0]}"
    if run.substeps not in (None, run.problem.substeps):
        yield f"its substeps are {run.substeps}, and the project fixes {run.problem.substeps}"
    outputs = set(run.problem.outputs)
    for name, r in result["recordings"].items():
        if set(r["rmse"]) != outputs or set(r["fit_percent"]) != outputs:
            yield f"the outputs of {ascii_short(name)} are others"
    for u in (u for problem in run.problems for u in problem.unknowns):
        low, high = u.range.lower, u.range.upper
        slack = DIFFERENT * (high - low if math.isfinite(high - low) else abs(run.values.get(u.name, 0.0)))
        if not low - slack <= run.values.get(u.name, u.range.start) <= high + slack:
            yield f"{u.name} = {run.values[u.name]:.6g} is outside of its bounds, {low:.6g} to {high:.6g}"
    yield from _strange_blocks(run)


def _strange_blocks(run: SavedRun) -> Iterator[str]:
    """Blocks that name what others have."""
    targets = {s.origin: s.joined for s in run.starts}
    for origin in targets:
        way = [origin]
        while (after := targets.get(way[-1])) is not None and len(way) <= len(targets):
            way.append(after)
        if way[-1] not in targets or len(way) > len(targets):
            yield f"the start {origin} joined one that is not there"
    check, spread, cut = run.discretisation, run.spread, run.cut
    if check and not set(check.shift) == set(check.orders) <= set(run.orders):
        yield "the orders of its discretisation are others"
    if spread and any({len(u.values), len(u.standard_errors)} != {len(spread.recordings)}
                      for u in spread.unknowns.values()):  # fmt: skip
        yield "its spread is of other recordings"
    if cut and any(not set(t.shift) == set(t.orders) == set(cut.as_fitted.orders) for t in cut.treatments.values()):
        yield "the orders of its cut are others"


def _read(path: Path) -> dict[str, Any]:
    if (content := object_of(text_if_any(path))) is not None:
        if fault := fault_of(content, SavedRun):
            raise InputError(f"{path} is damaged: {fault}. Write it again: fracid fit PROJECT.")
        return content | as_json(SavedRun, content)  # with what follows from the rest, whatever stood there
    if state := read_if_whole(path.parent / RUN, RunState):
        ended = f"was finished, but its {path.name} cannot be read; fit it again"
        missing = ended if state["finished"] else f"is not finished; type {typed('resume', path.parent)}"
        raise InputError(f"The fit in {path.parent} {missing}.")
    raise InputError(SAYS("no-run", path=path))


def _project(folder: Path, result: Mapping[str, Any], trust: bool) -> Project:
    """The project as the run used it, its relative paths leading from where its file was, whatever it says by now."""
    if (text := text_if_any(folder / "project.toml", LARGEST_FILE)) is None:
        raise InputError(f"{folder} is no run folder: it has no project.toml that can be read.")
    there = [path for path in _places(folder) if path.parent.is_dir()]
    there.sort(key=lambda path: text_if_any(path, LARGEST_FILE) != text)  # the file itself first, then where it was
    reason = ""
    for path in (*there, folder / "project.toml"):
        try:
            return project_from_text(text, path, preset=result["preset"])
        except NotTrusted:
            if not trust:
                raise
            # there and nowhere else: it is the file that was named to be read
            return project_from_text(text, path, preset=result["preset"], trust=True)
        except FracidError as error:
            reason = reason or str(error)
    raise InputError(SAYS("not-as-read", folder=folder, reason=reason))


def _places(folder: Path) -> Iterator[Path]:
    """Where the project file may lie: as the run names it, from here or above the run; or in fracid itself."""
    command = read_if_whole(folder / "environment.json", EnvironmentBlock).get("command", [])
    arguments = [*command, *read_if_whole(folder / RUN, RunState).get("options", {}).values()]
    words = [w for w in arguments[:MOST_WORDS] if isinstance(w, str) and w.endswith(".toml") and "\0" not in w]
    for word in dict.fromkeys(words):
        yield from (place / word for place in (Path(), *folder.resolve().parents))
    yield from (Path(__file__).parents[1] / "twins").glob("*.toml")  # the demo's


def _values(result: Mapping[str, Any]) -> dict[str, float]:
    """Name of each unknown → its value in result.json."""
    shared = {n: e["value"] for block in ("orders", "parameters") for n, e in result[block].items()}
    for name, r in result["recordings"].items():
        shared |= {f"{n}(0) [{name}]": e["value"] for n, e in r["initial_state"].items()}
        shared |= {f"{n} [{name}]": e["value"] for n, e in r["parameters"].items()}
        shared |= {f"{n}(0) [{w}]": v for w, states in r["windows"].items() for n, v in states.items()}
    return {n: float(v) for n, v in shared.items() if v is not None}
