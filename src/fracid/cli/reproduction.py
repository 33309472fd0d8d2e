"""``fracid reproduce RUN``: the run again, and its result held against the first: the same, to the last bit?"""

from __future__ import annotations

import io
import time
from contextlib import redirect_stdout
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fracid.cli.app import How, command, print_table, type_again
from fracid.safety.text import cut

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.runs.reproduction import Difference, Reproduction

SHOWN = 12
"""Differences in the table."""


@command
def reproduce(run: Path, how: How) -> None:
    """Do a run again, and compare the results value by value.

    Repeats it with its own project, recordings, seed and options.  The same versions on the same machine give the same
    result to the last bit, other versions or machines to 1e-9.  Lists the differences, the original value first.
    Writes nothing into the run's folder.  Exit code 0 if the results agree, 1 if not.
    """
    from fracid.workflows.reproduction import reproduce_run

    start_time = time.perf_counter()
    reproduction = how.done(reproduce_run, run, typed=_typed_again)
    how.answer(reproduction.to_json(), partial(_show, reproduction, run, time.perf_counter() - start_time))
    if not reproduction.reproduced:
        raise typer.Exit(1)


def _typed_again(words: list[str], where: Path) -> None:
    """Do what the words say, in the folder where they were typed, and print nothing."""
    with redirect_stdout(io.StringIO()):
        type_again(words, where, words)


# ------------------------------------------------------------------ as text


def _show(reproduction: Reproduction, run: Path, seconds: float, console: Console) -> None:
    from rich.markup import escape

    console.print(f"{escape(str(run))} was done again in {seconds:.1f} s.", soft_wrap=True)
    if reproduction.differences:
        rows = map(_row, reproduction.differences[:SHOWN])
        print_table(console, ("differs", "before", "now", "by"), rows, fold=("differs", "before", "now"))
        if len(reproduction.differences) > SHOWN:
            console.print(f"  and {len(reproduction.differences) - SHOWN} more, which --json lists")
    mark = "" if reproduction.reproduced else "[yellow]![/yellow] "
    console.print(f"{mark}[bold]{escape(reproduction.verdict)}[/bold]", soft_wrap=True)


def _row(d: Difference) -> tuple[str, str, str, str]:
    before, after = (value if isinstance(value, str) else repr(value) for value in (d.before, d.after))
    return d.where, cut(before, 60), cut(after, 60), f"{d.size:.1g}" if d.size < float("inf") else ""
