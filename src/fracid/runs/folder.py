"""The run folder: everything that one identification, or one study, leaves behind.

::

    runs/NAME/
    ├── run.json             what is done here, with all its options, and whether it is finished
    ├── result.json          Fit.to_json() with hashes of the data, versions and timing
    ├── project.toml         the project file as it was used
    ├── environment.json     versions, machine, command line and where it was typed
    ├── evaluations.jsonl    every evaluation of the cost, as it ended (written by the optimiser's log)
    ├── .memo                while it is unfinished: what was simulated (:mod:`fracid.tasks.simulation_cache`)
    ├── journal.jsonl        of a study: every repetition, as it ended (:mod:`fracid.tasks.journal`)
    ├── figures/             SVG and PNG; of fracid draw in figures/journal, PDF
    └── report.html          all of it on one page

The same inputs and seed give the same ``result.json`` but for its ``timing`` block, for any number of
threads.  A file is written whole or not at all.

**Gone on with.**  A fit does its work between :func:`open_run` and :meth:`Run.finish`; until that it can be resumed,
and the folder is one process's alone.  A study has its journal, which is never removed: the same command goes on from
it, and ``fracid resume`` types that command again, from ``environment.json``.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Any

from fracid.errors import InputError, writing
from fracid.findings import Words
from fracid.fit import Fit
from fracid.problem.project import Project
from fracid.runs.environment import code, machine, versions
from fracid.runs.evaluations import EVALUATIONS
from fracid.safety.door import bytes_of, text_if_any, write_files, write_whole
from fracid.safety.json_files import json_document
from fracid.safety.schema import Record, as_json, read_as, read_if_whole, record_of
from fracid.schemas.run_record import EnvironmentBlock, FitOptions
from fracid.tasks.folder_lock import FolderLock

SAYS = Words("runs/folder.toml")

RUN = "run.json"

JOURNAL = "journal.jsonl"

MEMO = ".memo"

FIGURES = "figures"

FIGURE = re.compile(
    r"(figure1-rig|(figure[23]|residuals|amplitude|linear)-.+|cost-over-orders|waterfall|cut|profiles|ladder|noise|posterior(-predictive)?)"
    r"\.(svg|png|pdf)"
)
"""Names of the figures that runs and studies draw."""

STARTS = f"starts/{JOURNAL}"

NEAR = 3
"""Folders above a run's in which a project is looked for that was moved together with it: runs/rig lies two below."""

POSTERIOR = ("posterior/posterior.json", "posterior/draws.npz", f"posterior/{JOURNAL}")

LATER = ("residuals.json", "profiles.json", "report.html", STARTS, *POSTERIOR)
"""What else lies in a run folder and is no longer true of a new run."""


@dataclass(frozen=True)
class RunState(Record):
    """The content of run.json."""

    options: FitOptions
    """What to call :func:`fracid.run` with again."""
    inputs: Mapping[str, str]
    """All that it reads from outside, with hashes; see :func:`inputs_of`."""
    finished: bool = False
    code: str = ""
    """Hash of fracid's source; of a run that another source went on with both, which no source has."""


@dataclass(frozen=True)
class Run:
    """A run folder at work."""

    folder: Path
    state: RunState
    resumed: bool
    """Whether there is something done to go on from."""

    def finish(self) -> None:
        """Say that all is done and written.

        Raises
        ------
        InputError
            If that cannot be written.
        """
        write_files(self.folder, {RUN: json_document(replace(self.state, finished=True).to_json())})
        for path in (self.folder / MEMO, *_halves(self.folder)):
            path.unlink(missing_ok=True)


@contextmanager
def open_run(
    folder: Path, options: FitOptions, *, inputs: Mapping[str, str] | None = None, resume: bool = False,
    command: Sequence[str] = (),
) -> Iterator[Run]:  # fmt: skip
    """Take a run folder for this process alone, begin or go on there, and let go of it.

    Without `resume` an earlier run's files are removed.

    Parameters
    ----------
    folder : Path
    options : FitOptions
        What to call it with again; not threads, which change no result.
    inputs : mapping, optional
        All that it reads from outside; see :func:`inputs_of`.
    resume : bool
        Go on with the run there, which must be the same.
    command : sequence of str
        What environment.json says was typed; of a resumed run it stays.

    Raises
    ------
    InputError
        If the folder cannot be written, holds other files, is at work in another process, or if what the run reads has
        changed since.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp()) / "rig"
    >>> with open_run(folder, FitOptions("rig.toml", seed=3)) as run:
    ...     run.finish()
    >>> run_state(folder).finished
    True
    """
    now = RunState(options, dict(inputs or {}), code=code())
    _refuse_strangers(folder)
    with FolderLock(folder):
        if resume:
            before = run_state(folder)
            _refuse_another(folder, before, now)
            both = " and ".join(dict.fromkeys((before.code, now.code)))
            now = replace(now, options=before.options, code=both)  # where the project was, too: its journals go by that
        else:
            (folder / RUN).unlink(missing_ok=True)  # killed from here on, there is nothing to go on with
            _clear(folder, command)
            write_files(folder, {RUN: json_document(now.to_json())})
        yield Run(folder, now, resume)


def run_state(folder: Path) -> RunState:
    """Read what is done in a run folder.

    Raises
    ------
    InputError
        If it has no run.json, or a damaged one.

    Examples
    --------
    >>> import tempfile
    >>> run_state(Path(tempfile.mkdtemp()))
    Traceback (most recent call last):
    fracid.errors.InputError: ... has no run.json that can be read: ...
    """
    missing = SAYS("no-state", folder="{path.parent}")
    return record_of(RunState, read_as(folder / RUN, RunState, "the command itself", missing))


def cut_short(folder: Path, options: FitOptions, inputs: Mapping[str, str]) -> bool:
    """Whether a folder holds this very run, begun and not finished: with these options, of the same inputs.

    Parameters
    ----------
    folder, options, inputs
        As for :func:`open_run`.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp()) / "rig"
    >>> with open_run(folder, FitOptions("rig.toml", seed=3)):
    ...     pass
    >>> cut_short(folder, FitOptions("rig.toml", seed=3), {}), cut_short(folder, FitOptions("rig.toml", seed=4), {})
    (True, False)
    """
    with suppress(InputError):
        before = run_state(folder)
        return _same(before.options, options) and before.inputs == inputs and not before.finished
    return False


def moved_project(folder: Path, state: RunState) -> Path:
    """Where the project of a run lies: where it lay, or, moved together with the run, near the folder, by its hash.

    Parameters
    ----------
    folder : Path
    state : RunState

    Examples
    --------
    >>> moved_project(Path("runs/rig"), RunState(FitOptions("/nowhere/rig.toml"), {})).as_posix()
    '/nowhere/rig.toml'
    """
    named = Path(state.options.project)
    digest = state.inputs.get(f"the project file {named.name}")
    near = (place / named.name for place in (folder, *folder.resolve().parents[:NEAR]))
    return named if named.is_file() else next((p for p in near if _has_digest(p, digest)), named)


def _has_digest(path: Path, digest: str | None) -> bool:
    """As :func:`inputs_of` has it, of the text."""
    text = text_if_any(path, encoding="utf-8-sig")
    return text is not None and sha256(text.encode()).hexdigest() == digest


def _same(before: FitOptions, now: FitOptions) -> bool:
    """Whether two ask for the same, wherever the project lies: what it says is among the inputs."""
    return replace(before, project="") == replace(now, project="")


def refuse_used(folder: Path) -> None:
    """Refuse a folder that holds anything: what is written there would stand in place of it.

    Raises
    ------
    InputError

    Examples
    --------
    >>> refuse_used(Path("/nowhere/new"))
    """
    if folder.exists() and (not folder.is_dir() or any(not path.name.startswith(".") for path in folder.iterdir())):
        raise InputError(f"{folder} holds files already; give an empty or a new folder: --out DIR.")


def refuse_anothers(folder: Path, project: Path) -> None:
    """Refuse a folder with the fit of another project, which is still there: its result would be lost.

    Raises
    ------
    InputError

    Examples
    --------
    >>> refuse_anothers(Path("/nowhere/new"), Path("rig.toml"))
    """
    if not (state := read_if_whole(folder / RUN, RunState)):
        return
    fitted = Path(state["options"]["project"])
    if fitted.is_file() and not (project.is_file() and fitted.samefile(project)):
        raise InputError(SAYS("other-project", folder=folder, fitted=fitted))


CODE, VERSION = "the code ", "the version of "
"""How the keys begin of inputs that are no data: where they are others a result may be, too."""


def inputs_of(project: Project) -> dict[str, str]:
    """Hash all that a run of a project depends on: the file, its recordings, its code; and name the versions.

    Parameters
    ----------
    project : Project

    Returns
    -------
    dict
        What, in words → hash or version.
    """
    inputs = {f"the project file {project.path.name}": sha256(project.text.encode()).hexdigest()}
    inputs |= {f"the recording {r.name!r}": r.sha256 for r in project.recordings}
    for file in project.own_code:
        inputs[f"{CODE}{os.path.relpath(file, project.path.parent)}"] = sha256(bytes_of(file)).hexdigest()
    return inputs | {f"{VERSION}{package}": number for package, number in versions().items()}


def _refuse_another(folder: Path, before: RunState, now: RunState) -> None:
    """Go on with the same alone."""
    if not _same(before.options, now.options):
        raise InputError(f"{folder} holds another run, with {vars(before.options)}.")
    for what in {**before.inputs, **now.inputs}:
        if before.inputs.get(what) != now.inputs.get(what):
            raise InputError(SAYS("changed", folder=folder, what=what))


def open_folder(folder: Path, command: Sequence[str] = ()) -> Path:
    """Make a run folder, and clear it of an earlier run's own files.

    Parameters
    ----------
    folder : Path
    command : sequence of str
        What environment.json says was typed, or what one would type for the same.

    Raises
    ------
    InputError
        If it cannot be written, holds files that no run of fracid wrote, or another process is at work there.

    Examples
    --------
    >>> import tempfile
    >>> open_folder(Path(tempfile.mkdtemp()) / "first").name
    'first'
    """
    _refuse_strangers(folder)
    with FolderLock(folder):
        _clear(folder, command)
    return folder


def _clear(folder: Path, command: Sequence[str]) -> None:
    """Of an earlier run's own files, and say in environment.json what is done now."""
    with writing(f"The folder {folder}"):
        old = (folder / name for name in (EVALUATIONS, MEMO, "result.json", *LATER))
        for path in (*old, *_figures(folder), *_halves(folder)):
            path.unlink(missing_ok=True)
        began = datetime.now(UTC).isoformat(timespec="seconds")
        typed = {"command": list(command), "directory": str(Path.cwd()), "started": began}
        environment = as_json(EnvironmentBlock, {"versions": versions(), **machine(), "code": code(), **typed})
        write_whole(folder / "environment.json", json.dumps(environment, indent=2) + "\n")


def discard(folder: Path) -> None:
    """Remove what an interrupted run wrote before it had anything to keep, and the folder where nothing else is in it.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp()) / "rig"
    >>> with open_run(folder, FitOptions("rig.toml")):
    ...     pass
    >>> discard(folder)
    >>> folder.exists()
    False
    """
    for path in (*(folder / name for name in (RUN, "environment.json", EVALUATIONS, MEMO)), *_figures(folder)):
        path.unlink(missing_ok=True)
    with suppress(OSError):  # what others put there stays
        for place in (folder / FIGURES, folder):
            if place.is_dir() and {path.name for path in place.iterdir()} <= {".lock"}:
                (place / ".lock").unlink(missing_ok=True)
                place.rmdir()


def _refuse_strangers(folder: Path) -> None:
    """Make the folder, but refuse one with files of somebody else."""
    with writing(f"The folder {folder}"):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            names = {path.name for path in folder.iterdir() if not path.name.startswith(".")}
        except (FileExistsError, NotADirectoryError):
            raise InputError(f"{folder} is no folder, or lies below a file; give another: --out DIR.") from None
    if names and not names & {"environment.json", RUN}:
        raise InputError(f"{folder} holds files that are not a run's; give an empty or a new folder: --out DIR.")


def _figures(folder: Path) -> list[Path]:
    """Figures of an earlier run: of recordings, perhaps, that this one does not have; what others put there stays."""
    return [path for path in (folder / FIGURES).rglob("*") if FIGURE.fullmatch(path.name)]


def _halves(folder: Path) -> list[Path]:
    """What :func:`write_whole` had begun when a process was killed."""
    return [path for where in (folder, folder / FIGURES) for path in where.glob(".?*.*-*")]


def result_of(fit: Fit, project: Project, timing: Mapping[str, float]) -> dict[str, Any]:
    """Give the content of ``result.json``.

    Examples
    --------
    >>> result_of.__name__
    'result_of'
    """
    return fit.to_json() | {
        "preset": project.preset,
        "data_sha256": {r.name: r.sha256 for r in project.recordings},
        "versions": versions(),
        "timing": {stage: round(seconds, 3) for stage, seconds in timing.items()},
    }


def write_result(folder: Path, fit: Fit, project: Project, timing: Mapping[str, float]) -> dict[str, Any]:
    """Write ``result.json`` and ``project.toml``; gives the former's content.

    Raises
    ------
    InputError
        If the disk will not take them.
    """
    result = result_of(fit, project, timing)
    write_files(folder, {"result.json": json_document(result), "project.toml": project.text},
                writing(f"The result in {folder}", "Allow it, then type fracid resume."))  # fmt: skip
    return result
