"""``fracid init FILE``: a commented project file from a recording, which runs as it is."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from fracid.cli.app import SAYS, How, command, say_next, typed
from fracid.cli.check import column_from_text, columns_from_texts, text_of_column, time_from_text
from fracid.errors import InputError
from fracid.safety.text import printable
from fracid.tasks.display import shown

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.recording.guess import Columns


@command
def init(files: list[Path], how: How) -> None:
    """Write a commented project file for a recording, ready to run.

    The names of the columns decide the model; --model chooses another.  Several recordings have the same columns.  For
    a rotary pendulum, fracid asks what each column is and proposes an answer; with --column, --yes or without a
    terminal it takes its proposal.
    """
    target = how.out or Path(f"{files[0].stem}.toml")
    if target.exists() and not how.force:
        raise InputError(f"{target} is there already; give another name, --out FILE, or write over it: --force.")
    clock, rig = time_from_text(how.time, how.rate), how.rig
    columns: Columns | None = columns_from_texts(how.column)
    with shown("project"):
        from fracid.workflows.draft import chosen_model, write_draft  # here: it takes a second to import

        model = how.model or chosen_model(files, columns, time=clock, variable=how.variable, rig=rig)
    asks = not (how.yes or how.json_) and sys.stdin and sys.stdin.isatty()
    if asks and model == "rotary-pendulum" and columns is None:
        columns, rig = _asked(files[0], clock, how)
    with shown("project"):
        draft = write_draft(files[0], target, columns, model=model, zero=how.zero, more=files[1:], time=clock,
                            variable=how.variable, rig=rig)  # fmt: skip
    record = {"project": str(target), "model": model, "notes": list(draft.notes)}
    how.answer(record, partial(_show, draft.notes, target))


def _show(notes: Sequence[str], target: Path, console: Console) -> None:
    for note in notes:
        typer.echo(printable(f"  {note}"))
    typer.echo(printable(f"project  {target}"))
    say_next(console, (typed("fit", target), "once you have read every line of it"))


def _asked(file: Path, clock: dict[str, Any] | None, how: How) -> tuple[Columns, str]:
    """What a person answers."""
    from fracid.cli.check import print_check
    from fracid.models import RIGS
    from fracid.problem.draft import guess_file
    from fracid.recording import inspect_recording

    recording = inspect_recording(file, time=clock, variable=how.variable, guess_units=True)
    print_check(recording, None)
    guess, notes = guess_file(file, time=clock, variable=how.variable)
    for note in notes:
        typer.echo(printable(f"  {note}"))
    columns: Columns = {}
    for signal, what in SIGNALS.items():
        proposed = guess.get(signal)
        question = SAYS("which-column", signal=signal, what=what, none="" if signal == "alpha" else "; - for none")
        answer = typer.prompt(question, default=text_of_column(proposed) if proposed else "-")
        if answer.strip() not in ("-", ""):
            columns[signal] = column_from_text(f"{signal}={answer}")[1]
    rig = how.rig or typer.prompt(f"Which rig is it most like? {', '.join(RIGS)}", default="srv02-rotpen")
    return columns, rig


SIGNALS = {"alpha": "the pendulum's angle", "theta": "the arm's angle", "voltage": "the motor's voltage"}
