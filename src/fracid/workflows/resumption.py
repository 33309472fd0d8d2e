"""What a folder of an interrupted run holds, and how it is resumed.

Two kinds of run can be resumed.

*   What has a ``run.json``, a fit, names itself, with all its options.  It begins again, but reads what it simulated
    before (:mod:`fracid.tasks.simulation_cache`), so it takes the same way and ends the same: :func:`resume_run`.
*   What has a journal but no run.json is a study.  The same call, or the same command, does what the journal has not;
    its words are in ``environment.json``: :func:`command_of_study`.

A run folder may come from a stranger, and may say anything.  So neither the permission to run code of a project's own,
nor the address of a scheduler, whose answers are unpickled, is taken from there: the caller says them.

To make a new study resumable name its command in :data:`fracid.safety.paths.STUDIES` and give it a journal in the
folder that :func:`fracid.runs.folder.open_folder` made: that is all.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fracid.errors import InputError, NotTrusted, typed
from fracid.findings import Words
from fracid.runs.folder import JOURNAL, RUN, RunState, moved_project, run_state
from fracid.runs.saved import SavedRun
from fracid.safety.paths import STUDIES, refuse_mistaken
from fracid.safety.schema import read_as, read_if_whole
from fracid.schemas.run_record import EnvironmentBlock
from fracid.tasks.folder_lock import refuse_links
from fracid.tasks.progress import Observer
from fracid.workflows.fit import FinishedRun, run

SAYS = Words("workflows/resumption.toml")

ADDRESS = "://"
"""In every address of a scheduler."""


def resume_run(
    folder: str | Path,
    *,
    executor: str | None = None,
    jobs: int = 1,
    trust: bool = False,
    observer: Observer | None = None,
) -> FinishedRun:
    """Resume an interrupted fit: no finished work is repeated, and the result is the same.

    Interrupted by Ctrl-C, a kill, a crash or a full disk.  A study goes on by the same call again.

    Parameters
    ----------
    folder : str or Path
        The run folder.
    executor : str, optional
        The address of the scheduler that the fit was on: what a scheduler sends is run here, and the folder may come
        from a stranger.
    jobs : int
        Threads; the result is the same for any number.
    trust : bool
        Run Python code that the project refers to.  Review it first.
    observer : Observer, optional
        Hears notices, and how far the search is.

    Raises
    ------
    InputError
        If the folder holds no fit, one that is finished, or one whose project or recordings have changed since.
    NotTrusted
        If the project names code of its own, and `trust` is not given.

    Examples
    --------
    >>> resume_run("nowhere/rig")
    Traceback (most recent call last):
    fracid.errors.InputError: There is no nowhere/rig. ...
    """
    folder = Path(folder)
    if (state := state_of(folder)) is None:
        raise InputError(f"{folder} holds a study, which goes on by the call that began it, or by fracid resume.")
    if state.finished:
        raise InputError(f"{folder} is finished; fracid.load_run reads its result.")
    place = _place_of(folder, state, executor)
    how = vars(state.options) | {"project": moved_project(folder, state), "executor": place}
    return run(**how, out=folder, jobs=jobs, resume=True, trust=trust, observer=observer)


def state_of(folder: Path) -> RunState | None:
    """Read what is done in a folder; None of a study, whose command is typed again.

    Raises
    ------
    InputError
        If it holds neither.

    Examples
    --------
    >>> state_of(Path("nowhere/rig"))
    Traceback (most recent call last):
    fracid.errors.InputError: There is no nowhere/rig. ...
    """
    if not folder.is_dir():
        refuse_mistaken(folder, "run")
    refuse_links(folder)
    if (folder / JOURNAL).exists() and not (folder / RUN).exists():
        return None
    return run_state(folder)


def _place_of(folder: Path, state: RunState, executor: str | None) -> str | None:
    """Where a fit goes on: where it was; on a scheduler only if the caller says its address again."""
    there = state.options.executor
    on_scheduler = ADDRESS in str(there)
    if on_scheduler and executor is None:
        raise InputError(SAYS("scheduler", folder=folder, there=there, typed=typed("resume", folder)))
    if executor and not (on_scheduler and ADDRESS in executor):
        raise InputError(f"{folder} is a fit, which runs on threads: leave --executor and --scheduler out.")
    return executor or there


def finished_result(folder: Path) -> Any:
    """Read the result of a fit that is finished.

    Raises
    ------
    InputError
        If it cannot be read.

    Examples
    --------
    >>> finished_result(Path("nowhere/rig"))
    Traceback (most recent call last):
    fracid.errors.InputError: The fit in nowhere/rig was finished, but ...
    """
    missing = "The fit in {path.parent} was finished, but {path} cannot be read; fit it again."
    return read_as(folder / "result.json", SavedRun, "fracid fit PROJECT", missing)


# ------------------------------------------------------------------ studies


def command_of_study(folder: Path) -> tuple[list[str], Path]:
    """What was typed for a study, and where, by its environment.json.

    Raises
    ------
    InputError
        If it does not say that.

    Examples
    --------
    >>> command_of_study(Path("nowhere/rig"))
    Traceback (most recent call last):
    fracid.errors.InputError: nowhere/rig has no record of its command: ...
    """
    environment = read_if_whole(folder / "environment.json", EnvironmentBlock)
    if not environment or "\0" in "".join([*environment["command"], environment["directory"]]):
        raise InputError(f"{folder} has no record of its command: type that again, with --out {folder}.")
    return environment["command"], Path(environment["directory"])


def safe_words(folder: Path, words: list[str], elsewhere: str | None, trust: bool) -> list[str]:
    """Give a study's command without what only the caller may say: the folder may come from a stranger.

    Raises
    ------
    InputError
        If it is no study's, or names a scheduler and `elsewhere` names none.
    NotTrusted
        If it runs code, and `trust` is not given.

    Examples
    --------
    >>> safe_words(Path("runs/a"), ["compare", "rig.toml", "--trust"], None, False)
    ['compare', 'rig.toml']
    """
    if typed(*words[:1]) not in STUDIES.values():
        raise InputError(f"{folder} holds no study that can be typed again; those are {', '.join(STUDIES.values())}.")
    if any(".py:" in word for word in words) and not trust:
        raise NotTrusted(SAYS("own-code", folder=folder, words=typed(*words)))
    if (address := next((word for word in words if ADDRESS in word), None)) and not elsewhere:
        there = address.removeprefix("--scheduler=")
        raise InputError(SAYS("scheduler", folder=folder, there=there, typed=typed("resume", folder)))
    places = ("--scheduler", "--executor")  # before an address, and without it nothing
    return [word for word, then in zip(words, [*words[1:], ""], strict=True)
            if ADDRESS not in word and word != "--trust" and not (word in places and ADDRESS in then)]  # fmt: skip
