"""``fracid open FILE``: a recording in one offline page, with a preview of its fit."""

from __future__ import annotations

from pathlib import Path

import typer

from fracid.cli.app import How, command, new_console, open_page, say_next, typed
from fracid.safety.text import printable
from fracid.tasks.display import shown
from fracid.workflows.records import words_of


@command
def open(file: Path | None = None, *, how: How) -> None:
    """Open a recording in one page that previews a fit in the browser.

    Columns, units, release and model are guessed and can be corrected; least squares take seconds, the rig moves, and
    the page hands on the project and the command for intervals and claim.  It is a preview: no interval, no claim.
    Nothing is uploaded.
    """
    with shown("page"):
        from fracid.report.open import write_open_page

        path = write_open_page(file, how.out, how.variable)
    typer.echo(printable(f"page     {path}"))
    if not open_page(path, how.open_):
        typer.echo(f"Open {path.resolve().as_uri()} in a browser.")
    if file is not None:
        from fracid.cli.check import models_for
        from fracid.recording import inspect_recording

        options = {"variable": how.variable}
        models = models_for(inspect_recording(file, **options), {})
        say_next(new_console(), *((typed("init", file, *words_of(options), *which), why) for which, why in models))
