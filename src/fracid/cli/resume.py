"""``fracid resume RUN``: resume what was killed, interrupted, or ran out of disk.

A fit is resumed from its ``run.json``; a study's command, from ``environment.json``, is typed again where it was
typed, and does what its journal has not: :mod:`fracid.workflows.resumption` says what is taken from a folder, and what
only from the caller.
"""

from __future__ import annotations

from pathlib import Path

import typer

from fracid.cli.app import SAYS, How, command, type_again
from fracid.cli.fit import tell_fit, watched
from fracid.errors import InputError
from fracid.safety.text import printable


@command
def resume(run: Path, how: How) -> None:
    """Resume an interrupted run, without repeating finished work.

    The result is the same as that of an uninterrupted run.  Resumes fit, noise, compare and posterior after
    Ctrl-C, a kill, a crash or a full disk.  Exit codes are those of the command itself, and 0 if the run is finished
    already.
    """
    from fracid.workflows.resumption import finished_result, resume_run, state_of

    for option in (f"--{name}" for name in ("out", "seed") if getattr(how, name) is not None):
        raise InputError(SAYS("resumed-as-begun", run=run, option=option))
    if (state := state_of(run)) is None:
        _typed_again(run, how)
    elif not state.finished:
        with watched("", how.json_) as observer:
            finished = resume_run(run, **how.taken(resume_run, observer=observer))
        tell_fit(finished, how)
    else:
        said = printable(f"{run} is finished; its result is {run / 'result.json'}.")
        how.answer(finished_result(run), lambda _: typer.echo(said))


def _typed_again(folder: Path, how: How) -> None:
    """Type a study's command again, where it was typed."""
    from fracid.workflows.records import words_of
    from fracid.workflows.resumption import command_of_study, safe_words

    words, where = command_of_study(folder)
    again = safe_words(folder, words, how.executor or how.scheduler, how.trust)
    options = {"out": folder.resolve(), "jobs": how.jobs, "json": how.json_, "executor": how.executor,
               "scheduler": how.scheduler, "trust": how.trust}  # fmt: skip
    if code := type_again([*again, *words_of(options)], where, words):  # a second resumption types the same
        raise typer.Exit(code)
