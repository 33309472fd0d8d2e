"""``fracid init FILE``: a commented project file from a recording, which runs as it is."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from fracid.cli.app import Rate, Variable, command, flag, named, new_console, option, say_next, typed
from fracid.cli.check import column_from_text, columns_from_texts, time_from_text
from fracid.cli.completion import COLUMNS, ZEROS, key_of, one_of
from fracid.errors import InputError
from fracid.safety.text import printable
from fracid.tasks.display import shown


@command(
    "fracid init release.mat  [dim]# asks what the columns are; writes release.toml[/dim]",
    "fracid init release.mat --yes --rig qube-servo2 --out rig.toml  [dim]# takes what it guesses[/dim]",
    "fracid init swing.txt --rate 1000 --column alpha=0,unit=deg",
    "fracid init log.csv --model joint --column angle=q --column torque=tau",
    "fracid init kp100.json kp400.json --out servo.toml  [dim]# a servo's logs, with mass and gains[/dim]",
)
def init(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="The recording, or several of one rig.")],
    column: Annotated[
        list[str] | None,
        option("NAME=COLUMN[,FIELD=VALUE]", "As for fracid check; alpha, theta, voltage.", complete=one_of(*COLUMNS)),
    ] = None,
    time: Annotated[str | None, option("COLUMN[,unit=ms]", "The time column.")] = None,
    rate: Rate = None,
    variable: Variable = None,
    model: Annotated[str | None, named("The model, as fracid models lists it.", key_of("models"))] = None,
    zero: Annotated[str | None, named("Of a cart-pole or a pendulum: hanging or upright.", one_of(*ZEROS))] = None,
    rig: Annotated[str | None, named("Whose constants to begin with.", key_of("rigs"))] = None,
    out: Annotated[Path | None, option("FILE", "The project file.", "--out")] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing: take what is guessed.")] = False,
    force: Annotated[bool, flag("--force", "Overwrite existing files.")] = False,
) -> None:
    """Write a commented project file for a recording, ready to run.

    What the columns are called says of which model they are; --model names another.  Several recordings have the same
    columns.  For a rotary pendulum it asks what they are, with what it guesses as the answer; with --column, --yes or
    without a terminal it takes the guess.
    """
    target = out or Path(f"{files[0].stem}.toml")
    if target.exists() and not force:
        raise InputError(f"{target} is there already; give another name, --out FILE, or write over it: --force.")
    clock = time_from_text(time, rate)
    columns: dict[str, dict[str, Any]] | None = columns_from_texts(column)
    with shown("project"):
        from fracid.workflows.draft import chosen_model, write_draft  # here: it takes a second to import

        model = model or chosen_model(files[0], columns, time=clock, variable=variable, rig=rig)
    if model == "rotary-pendulum" and columns is None and not yes and sys.stdin.isatty():
        columns, rig = _asked(files[0], clock, variable, rig)
    with shown("project"):
        draft = write_draft(
            files[0], target, columns, model=model, zero=zero, more=files[1:], time=clock, variable=variable, rig=rig
        )
    for note in draft.notes:
        typer.echo(printable(f"  {note}"))
    typer.echo(printable(f"project  {target}"))
    say_next(new_console(), (typed("fit", target), "once you have read every line of it"))


def _asked(
    file: Path, clock: dict[str, Any] | None, variable: str | None, rig: str | None
) -> tuple[dict[str, dict[str, Any]], str]:
    """What a person answers."""
    from fracid.cli.check import print_check
    from fracid.models import RIGS
    from fracid.problem.draft import guess_file
    from fracid.recording import inspect_recording

    recording = inspect_recording(file, time=clock, variable=variable, guess_units=True)
    print_check(recording, None)
    guess, notes = guess_file(file, time=clock, variable=variable)
    for note in notes:
        typer.echo(printable(f"  {note}"))
    columns: dict[str, dict[str, Any]] = {}
    for signal, what in SIGNALS.items():
        proposed = guess.get(signal)
        answer = typer.prompt(
            f"Which column is {signal}, {what}? By name or place, fields after commas"
            + ("" if signal == "alpha" else "; - for none"),
            default=_as_text(proposed) if proposed else "-",
        )
        if answer.strip() not in ("-", ""):
            columns[signal] = column_from_text(f"{signal}={answer}")[1]
    rig = rig or typer.prompt(f"Which rig is it most like? {', '.join(RIGS)}", default="srv02-rotpen")
    return columns, rig


SIGNALS = {"alpha": "the pendulum's angle", "theta": "the arm's angle", "voltage": "the motor's voltage"}


def _as_text(fields: dict[str, Any]) -> str:
    """``2,unit=rad``: as :func:`column_from_text` reads it."""
    return ",".join([str(fields["column"]), *(f"{k}={v}" for k, v in fields.items() if k != "column")])
