"""``fracid resume RUN``: go on with whatever was killed, interrupted, or ran out of disk.

Two kinds of run can be gone on with.

*   What has a ``run.json`` names itself, with all its options; :data:`KINDS` says how each is gone on with.  A fit
    begins again, but reads what it simulated before (:mod:`fracid.tasks.simulation_cache`), so it takes the same way
    and ends the same.
*   What has a journal but no run.json is a study: its command, from ``environment.json``, is typed again where
    it was typed, and does what the journal has not.

A run folder may come from a stranger, and may say anything.  So neither the permission to run code of a project's own,
``--trust``, nor the address of a scheduler, whose answers are unpickled, is taken from there: the caller types them.

To make a new command resumable name it in :data:`STUDIES` and give it a journal in the folder that
:func:`fracid.runs.folder.open_folder` made: that is all.
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fracid.cli.app import CORES, Jobs, Json, Trust, app, echo_json
from fracid.cli.completion import key_of
from fracid.errors import InputError, NotTrusted
from fracid.safety.environment import ignore_settings
from fracid.safety.text import printable

if TYPE_CHECKING:
    from fracid.runs.folder import RunState

__all__ = ["KINDS", "resume", "safe_words", "said_command"]

STUDIES = ("compare", "noise")
"""The commands that are typed again."""

ASKED = ("preset", "optimiser", "seed", "starts", "cut", "executor")
"""The options of a fit that its run.json has."""

ADDRESS = "://"
"""In every address of a scheduler."""

RESUME_EXAMPLE = (
    "[bold]Examples[/bold]",
    "fracid resume runs/rig",
    "fracid resume runs/rig-noise --jobs 8  [dim](threads and executor change no result)[/dim]",
    "fracid resume runs/rig-noise --scheduler tcp://head:8786",
)


@app.command(epilog="\n\n".join(RESUME_EXAMPLE))
def resume(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a run that was cut short.")],
    executor: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Of a study: threads or processes, in place of what it had.",
            autocompletion=key_of("executors"),
        ),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of a study: a Dask scheduler, tcp://HOST:8786.")
    ] = None,
    trust: Trust = False,
    jobs: Jobs = CORES,
    json_: Json = False,
) -> None:
    """Go on with a run that was cut short: nothing that was done is repeated, and the result is the same.

    Cut short by Ctrl-C, a kill, a crash or a full disk; a fit or a study, noise or compare.  Exit codes are those of
    the command itself; 0 too if the run is finished already.
    """
    from fracid.runs.folder import JOURNAL, RUN, run_state
    from fracid.safety.paths import refuse_mistaken
    from fracid.tasks.folder_lock import refuse_links

    if not run.is_dir():
        refuse_mistaken(run, "run")
    refuse_links(run)
    if (run / RUN).exists() or not (run / JOURNAL).exists():
        state = run_state(run)
        if state.kind not in KINDS:
            raise InputError(f"{run} was written by another version of fracid: it knows no kind {state.kind!r}.")
        options = _with_scheduler(run, state, executor, scheduler)
        KINDS[state.kind](run, options, state.finished, jobs, json_, trust)
    else:
        _typed_again(run, jobs, executor, scheduler, json_, trust)


def _with_scheduler(run: Path, state: RunState, executor: str | None, scheduler: str | None) -> Mapping[str, Any]:
    """The run's options; an address among them is used only if it is typed again."""
    there = str(state.options.get("executor") or "")
    if ADDRESS in there and executor is None:
        return {**state.options, "executor": _typed_by_hand(run, there, scheduler)}
    if executor or scheduler:
        raise InputError(f"{run} is a {state.kind}, which runs on threads: leave --executor and --scheduler out.")
    return state.options


def _typed_by_hand(run: Path, there: str, scheduler: str | None) -> str:
    if scheduler is None:
        raise InputError(
            f"{run} was on the scheduler {there}, and what a scheduler sends is run here: type its address yourself, "
            f"if it is yours: fracid resume {run} --scheduler {there}."
        )
    return scheduler


def _fit(folder: Path, options: Any, finished: bool, jobs: int, json_: bool, trust: bool) -> None:
    from fracid.cli.fit import run_fit, tell_fit
    from fracid.safety.schema import fault_of, read_as
    from fracid.schemas.result import ResultBlock
    from fracid.schemas.run import FitOptions

    if finished:
        path = folder / "result.json"
        try:
            result = read_as(path, ResultBlock, "fracid fit PROJECT")
        except OSError:
            raise InputError(f"The fit in {folder} was finished, but {path} cannot be read; fit it again.") from None
        if json_:
            echo_json(result)
        else:
            typer.echo(printable(f"{folder} is finished; its result is {path}."))
        return
    if fault := fault_of(options, FitOptions):
        raise InputError(f"{folder} was written by another version of fracid, or is damaged: in its run.json {fault}.")
    how = {name: options[name] for name in ASKED}
    ran = run_fit(Path(str(options["project"])), folder, jobs=jobs, quiet=json_, resume=True, trust=trust, **how)
    tell_fit(ran, json_=json_)


KINDS: dict[str, Callable[[Path, Any, bool, int, bool, bool], None]] = {"fit": _fit}
"""Kind → what goes on with it, given folder, options, whether it is finished, threads, and whether JSON is wanted and
code of the project's own is trusted."""


def _typed_again(
    folder: Path, jobs: int, executor: str | None, scheduler: str | None, json_: bool, trust: bool
) -> None:
    """Type a study's command again, where it was typed."""
    words, where = said_command(folder)
    again = safe_words(folder, words, executor or scheduler, trust)
    more = ["--out", str(folder.resolve()), "--jobs", str(jobs), *(["--json"] if json_ else [])]
    more += ["--executor", executor] if executor else []
    more += ["--scheduler", scheduler] if scheduler else []
    more += ["--trust"] if trust else []
    if where.is_dir():
        ignore_settings(where)
        os.chdir(where)
    sys.argv[1:] = words  # a second resumption types the same
    if code := app(args=[*again, *more], prog_name="fracid", standalone_mode=False):
        raise typer.Exit(code)


def said_command(folder: Path) -> tuple[list[str], Path]:
    """What was typed for a study, and where, by its environment.json."""
    from fracid.safety.schema import read_as
    from fracid.schemas.run import EnvironmentBlock

    try:
        said = read_as(folder / "environment.json", EnvironmentBlock, "the command itself")
        if "\0" in "".join([*said["command"], said["directory"]]):
            raise KeyError("command")
        return said["command"], Path(said["directory"])
    except (OSError, InputError, KeyError):
        raise InputError(f"{folder} does not say what its command was: type that again, with --out {folder}.") from None


def safe_words(folder: Path, words: list[str], elsewhere: str | None, trust: bool) -> list[str]:
    """The command without what only the caller may say: the folder may come from a stranger."""
    if words[:1] not in ([name] for name in STUDIES):
        raise InputError(f"{folder} holds no study that can be typed again; those are {' and '.join(STUDIES)}.")
    if any(".py:" in word for word in words) and not trust:
        raise NotTrusted(
            f"{folder} wants to run code: {shlex.join(['fracid', *words])}. Read the file; if you trust it say so: "
            "--trust."
        )
    if (address := next((word for word in words if ADDRESS in word), None)) and not elsewhere:
        _typed_by_hand(folder, address.removeprefix("--scheduler="), None)
    return [word for word in _without_address(words) if word != "--trust"]


def _without_address(words: list[str]) -> list[str]:
    """Without a scheduler's address and the option before it."""
    kept: list[str] = []
    for word in words:
        if ADDRESS not in word:
            kept.append(word)
        elif kept[-1] in ("--scheduler", "--executor"):
            kept.pop()
    return kept
