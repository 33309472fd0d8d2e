"""``fracid open FILE``: a recording in one offline page, with a preview of its fit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fracid.cli.app import command, flag, new_console, open_page, option, say_next, typed
from fracid.safety.text import printable
from fracid.tasks.display import shown


@command(
    "fracid open release.csv  [dim]# writes runs/open/release.html and opens it[/dim]",
    "fracid open log.mat --variable data --no-open",
    "fracid open  [dim]# an empty page: drop a recording into it[/dim]",
)
def open(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="A recording of any format that fracid check reads.")
    ] = None,
    variable: Annotated[str | None, typer.Option(help="Which array of a .mat, .npz or HDF5 file.")] = None,
    open_: Annotated[
        bool | None,
        flag("--open/--no-open", "Open the page in the browser \\[default: on a terminal with a display]."),
    ] = None,
    out: Annotated[Path | None, option("FILE", "Output file \\[default: runs/open/NAME.html].", "--out")] = None,
) -> None:
    """Open a recording in one page that previews a fit in the browser.

    Columns, units, release and model are guessed and can be corrected; least squares take seconds, the rig moves, and
    the page hands on the project and the command for intervals and claim.  It is a preview: no interval, no claim.
    Nothing is uploaded.
    """
    with shown("page"):
        from fracid.report.open import write_open_page

        path = write_open_page(file, out, variable)
    typer.echo(printable(f"page     {path}"))
    if not open_page(path, open_):
        typer.echo(f"Open {path.resolve().as_uri()} in a browser.")
    if file is not None:
        say_next(new_console(), (typed("init", file), "the project, with what the file itself says"))
