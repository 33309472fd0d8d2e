"""A fit with its folder: load, identify, write result, figures and report; or go on with what is in the folder.

::

    project ── load ── open the folder ── identify ── result.json ── figures, report.html ── finished
                            │                │
                       run.json         evaluations.jsonl, .memo: from which an interrupted run is resumed

``fracid fit`` and ``fracid demo`` are this call and what they print.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import disk_usage
from typing import Any

from fracid.cards import Card, CardDisplay
from fracid.errors import InputError, Unfinished, at_least
from fracid.estimation.records import RecordingFit
from fracid.estimation.starts import fault_of_end
from fracid.findings import Finding, Words
from fracid.fit import Fit
from fracid.optimise import MOST_STARTS, EvaluationLog, Outcome, optimiser_from_name
from fracid.problem.project import Project, load_project
from fracid.runs.evaluations import EVALUATIONS
from fracid.runs.folder import (
    MEMO,
    STARTS,
    Run,
    cut_short,
    discard,
    inputs_of,
    open_run,
    refuse_anothers,
    write_result,
)
from fracid.safety.paths import default_folder
from fracid.schemas.run_record import FitOptions
from fracid.tasks.display import unless_given
from fracid.tasks.job import free_memory, one_blas_thread
from fracid.tasks.journal import Journal
from fracid.tasks.progress import Observer
from fracid.tasks.simulation_cache import Memo
from fracid.tasks.tasks import executor_from_name
from fracid.workflows.drawer import Drawer, drawer
from fracid.workflows.figures import Drawing
from fracid.workflows.records import command_of

SAYS = Words("workflows/fit.toml")

FOLDER = 50_000_000
"""Bytes of a finished run folder, figures and all: a few MB, and some for each recording."""

LARGEST_SEED = 2**63
"""What JSON can hold everywhere."""


@dataclass(frozen=True, repr=False)
class FinishedRun(CardDisplay):
    """A fit with its folder."""

    project: Project
    fit: Fit
    folder: Path
    figures: tuple[Path, ...]
    """What was drawn, and the report."""
    result: Mapping[str, Any]
    """The content of result.json."""
    interrupted: bool
    """Whether Ctrl-C ended it: the best so far is written, and the same call goes on."""
    seconds: float
    """All of it [s]."""
    undrawn: str = ""
    """Why there are no figures and no report, in a sentence; empty where they are there."""
    resumed: bool = False
    """Whether it resumed an earlier, interrupted run in the folder."""

    def _card(self) -> Card:
        return self.fit._card().of_folder(self.folder)


def run(
    project: str | Path | Project,
    *,
    out: str | Path | None = None,
    preset: str | None = None,
    optimiser: str | None = None,
    seed: int | None = None,
    jobs: int = 1,
    starts: int | None = None,
    cut: bool = False,
    executor: str | None = None,
    resume: bool = False,
    trust: bool = False,
    figures: bool = True,
    observer: Observer | None = None,
    command: Sequence[str] | None = None,
    draws: Drawer | None = None,
) -> FinishedRun:
    """Identify what a project leaves free, and write the run folder: what ``fracid fit`` does.

    A folder that holds this very fit, interrupted, is resumed.  Ctrl-C keeps the best so far.

    Parameters
    ----------
    project : str, Path or Project
        The project file; or what :func:`fracid.load_project` made of it, unchanged: the folder keeps the file's text.
    out : str or Path, optional
        The run folder; ``runs/rig`` of ``rig.toml`` if left out.
    preset : str, optional
        ``paper``: the settings of the paper.  Of a loaded project it is said to :func:`fracid.load_project`.
    optimiser, seed
        In place of the project's; see :func:`fracid.identify`.
    jobs : int
        Threads; the result is the same for any number.  From 2 on a process beside this one draws.
    starts : int, optional
        Starts of ``multistart``.
    cut : bool
        Check how far the orders move with where the record begins: more searches.
    executor : str, optional
        Where many starts run, each for itself: ``processes`` or a scheduler's address.
    resume : bool
        Resume what is in the folder, or raise why that cannot be.
    trust : bool
        Run Python code that the project refers to.  Review it first.
    figures : bool
        Draw the figures and write the report, as the command does; ``fracid draw`` and ``fracid report`` do it later.
    observer : Observer, optional
        Hears notices, each stage, how far the search is, and the result before its figures; in a notebook they are
        shown if it is left out.
    command : sequence of str, optional
        What environment.json says was typed; if left out, the command that does the same.
    draws : Drawer, optional
        Who draws, where somebody was started for that before (:mod:`fracid.workflows.drawer`).

    Returns
    -------
    FinishedRun
        Also where no run of the model reached the end of the recording: then ``fit.cost`` is infinite.

    Raises
    ------
    InputError
        For a project or an option that cannot be, and for a folder that cannot be written, holds files of somebody
        else, or is at work in another process.
    NotTrusted
        If the project names code of its own, and `trust` is not given.
    DataError
        If a recording fails its checks.

    Examples
    --------
    >>> import tempfile, numpy as np
    >>> folder, time = Path(tempfile.mkdtemp()), np.arange(0, 1, 0.02)
    >>> np.savez(folder / "swing.npz", time=time, alpha=0.3 * np.exp(-0.1 * time) * np.cos(6 * time))
    >>> file = '''
    ... [model.orders]
    ... lambda = 1.0
    ... mu = { start = 1.0, lower = 0.9, upper = 1.1 }
    ... [fit]
    ... initial_state = "held"
    ... [[recording]]
    ... file = "swing.npz"
    ... alpha = { column = "alpha", unit = "rad" }
    ... initial = { alpha = 0.3 }
    ... '''
    >>> _ = (folder / "rig.toml").write_text(file)
    >>> finished = run(folder / "rig.toml", out=folder / "run", optimiser="least-squares", figures=False)
    >>> finished.result["optimiser"], sorted(path.name for path in finished.folder.glob("*.json"))
    ('least-squares', ['environment.json', 'result.json', 'run.json'])
    """
    start_time, watching = time.perf_counter(), unless_given(observer)
    watching.stage("recordings")
    if isinstance(project, Project):
        preset = preset or project.preset
    project = loaded(project, preset, trust)
    folder = default_folder(project.path.stem) if out is None else Path(out)
    name = _optimiser(optimiser, project.optimiser, starts)
    request = FitOptions(str(project.path.resolve()), preset, optimiser, seed, starts=starts, cut=cut,
                         executor=executor)  # fmt: skip
    _refuse_impossible(project, name, request)
    refuse_anothers(folder, project.path)
    inputs = inputs_of(project)
    if not resume and cut_short(folder, request, inputs):
        watching.notice(f"{folder} holds this fit, interrupted: it is resumed. To begin anew, remove the folder.")
        resume = True
    words = _command(project, out, request) if command is None else command
    with one_blas_thread():
        laps = {"load": time.perf_counter() - start_time}
        findings = _checked(project, jobs, watching)
        laps["look"] = time.perf_counter() - start_time - laps["load"]
    searching = True
    try:
        with (
            one_blas_thread(),
            open_run(folder, request, inputs=inputs, resume=resume, command=words) as opened,
            drawer(jobs if figures else 1) if draws is None else nullcontext(draws) as beside,
        ):
            draw = Drawing(project, folder, jobs, watching, drawer=beside) if figures else None
            heard = watching if draw is None else _drawn_too(watching, draw)
            fit = _identified(project, opened, jobs, heard, findings=findings, optimiser=name, seed=seed, starts=starts,
                              cut=cut, executor=executor or "threads")  # fmt: skip
            searching = False
            laps |= {stage: seconds + laps.get(stage, 0.0) for stage, seconds in fit.timing.items()}
            result = write_result(folder, fit, project, laps)  # what the figures may not find room for
            interrupted, seconds = fit.outcome is Outcome.INTERRUPTED, time.perf_counter() - start_time
            found = FinishedRun(project, fit, folder, (), result=result, interrupted=interrupted, seconds=seconds,
                                resumed=resume)  # fmt: skip
            watching.result(found)
            finished = _with_figures(found, draw, opened, laps, began=start_time, observer=watching)
    except KeyboardInterrupt:
        if searching and not resume:  # before the search has simulated anything no folder is left behind
            discard(folder)
        raise
    watching.stage("")
    return replace(finished, seconds=laps.get("total", time.perf_counter() - start_time))


def _with_figures(
    found: FinishedRun, draw: Drawing | None, opened: Run, laps: dict[str, float], began: float, observer: Observer
) -> FinishedRun:  # fmt: skip
    """Draw a fit whose result is written, and write how long that took; or say why there are no figures."""
    try:
        before = time.perf_counter()
        found = replace(found, figures=() if draw is None else draw(found.fit))
        laps["figures"] = time.perf_counter() - before
        laps["total"] = time.perf_counter() - began
        found = replace(found, result=write_result(found.folder, found.fit, found.project, laps))
        if not found.interrupted:
            opened.finish()
    except KeyboardInterrupt:
        observer.interrupted()
        return replace(found, interrupted=True, undrawn="Interrupted while the figures were drawn.")
    except (InputError, Unfinished, OSError, MemoryError) as error:
        return replace(found, undrawn=str(error) or "There is not enough memory for the figures.")
    return found


def loaded(project: str | Path | Project, preset: str | None, trust: bool) -> Project:
    """Load a project file; what is loaded already is taken as it is.

    Raises
    ------
    InputError
        As :func:`fracid.load_project`, and if a loaded project was loaded with another preset.
    """
    if not isinstance(project, Project):
        return load_project(project, preset=preset, trust=trust)
    if preset not in (None, project.preset):
        raise InputError(SAYS("other-preset", project=project, preset=preset, path=str(project.path)))
    return project


def _refuse_impossible(project: Project, optimiser: str, request: FitOptions) -> None:
    """Before an earlier run is cleared from the folder."""
    optimiser_from_name(optimiser)
    executor_from_name(request.executor or "threads")
    at_least("--multi-start", request.starts or 1, 1, MOST_STARTS)
    if request.executor and (request.starts or project.starts) < 2:
        raise InputError("--executor and --scheduler are for many starts; say how many: --multi-start N.")
    if request.seed is not None and request.seed >= LARGEST_SEED:
        raise InputError(f"--seed {request.seed} is not possible; expected less than 2^63.")


def _optimiser(optimiser: str | None, default: str, starts: int | None) -> str:
    """The optimiser: as asked, else as written; many starts belong to one alone."""
    if starts is None:
        return optimiser or default
    if optimiser not in (None, "multistart"):
        raise InputError(f"--multi-start is for the optimiser multistart, not {optimiser}: leave out one of the two.")
    return "multistart"


def _command(project: Project, out: str | Path | None, request: FitOptions) -> list[str]:
    options = {name: value for name, value in vars(request).items() if name not in ("project", "starts")}
    more = {"multi_start": request.starts, "trust": bool(project.own_code)}
    return command_of("fit", project.path, {"out": out, **options, **more})


def _drawn_too(observer: Observer, drawing: Drawing) -> Observer:
    """An observer whose recordings are drawn as they come."""

    def recordings(found: Mapping[str, RecordingFit]) -> None:
        drawing.begin(found)
        if observer.recordings is not None:
            observer.recordings(found)

    return replace(observer, recordings=recordings)


def _checked(project: Project, jobs: int, observer: Observer) -> tuple[Finding, ...]:
    """Faults of the data, said now, for a search may take its time to find nothing; before an earlier run is lost."""
    from fracid.validation.before_search import before  # here: numba takes a second to import

    observer.stage("checks of the data")
    reports = {r.name: r.report for r in project.recordings}
    findings = before(project.problem, reports, validation=project.validation, fixed_step=project.fixed_step, jobs=jobs)
    observer.notices(findings)
    return findings


def _identified(
    project: Project, run: Run, jobs: int, observer: Observer, findings: tuple[Finding, ...], *, optimiser: str,
    **options: Any,
) -> Fit:  # fmt: skip
    """Identify; what was simulated before a resumption is read from the folder."""
    from fracid.identification import identify  # not above: the process that draws starts while this is imported

    observer.notices(_short_of_room(project, run.folder))
    with (
        EvaluationLog(run.folder / EVALUATIONS, again=run.resumed) as log,
        Memo(run.folder / MEMO) as memo,
        _starts_kept(run, options["executor"], project.problem.names) as journal,
    ):
        observer.notices(_notes(run, log, memo) if run.resumed else ())
        return identify(project, optimiser=optimiser, jobs=jobs, log=log, journal=journal, memo=memo, seen=findings,
                        observer=observer, **options)  # fmt: skip


def _short_of_room(project: Project, folder: Path) -> Iterator[str]:
    """What the disk or the memory may not have, said before the search."""
    from fracid.estimation.long_records import memory_needed

    left, needed = disk_usage(folder).free, memory_needed(project.problem)
    if left < FOLDER:
        yield SAYS("disk", folder=folder, left=left / 1e6, needed=FOLDER / 1e6)
    if (available := free_memory()) is not None and needed > available:
        yield SAYS("memory", needed=needed / 1e9, available=available / 1e9)


def _starts_kept(run: Run, executor: str, names: Sequence[str]) -> AbstractContextManager[Journal | None]:
    """Of starts that run elsewhere, a journal in a folder of its own."""
    if executor == "threads":
        return nullcontext()
    (run.folder / STARTS).parent.mkdir(exist_ok=True)
    study = {"inputs": dict(run.state.inputs), "options": vars(run.state.options)}
    return Journal(run.folder / STARTS, study, lambda _, said: fault_of_end(said, names))


def _notes(run: Run, log: EvaluationLog, memo: Memo) -> Iterator[str]:
    """What a resumption found in the folder."""
    if log.torn:
        yield f"The last line of {run.folder / EVALUATIONS} was cut off in writing; it is written again."
    if memo.emptied:
        yield SAYS("emptied", run=run)
