"""``fracid report RUN``: the run as one HTML page that opens offline."""

from __future__ import annotations

from pathlib import Path

import typer

from fracid.cli.app import How, command, new_console, open_page, say_next, typed
from fracid.safety.text import printable
from fracid.tasks.display import shown


@command
def report(run: Path, how: How) -> None:
    """Write a fit, or a study, as one HTML page that opens offline.

    Verdict, data, equations, values, curves, residuals, and the rig in motion.  The page is one file and loads nothing
    from the network.  Profiles and the ladder of structures are on it where fracid profile and fracid compare wrote
    them into the folder.
    """
    with shown("page", events=how.json_):
        from fracid.report import write_report  # here: it takes a second to import

        path = write_report(run, **how.taken(write_report))
    how.answer({"report": str(path)}, lambda _: typer.echo(printable(f"report   {path}")))
    if how.open_ and not open_page(path, True):
        typer.echo(f"No browser took it here. Open {path.resolve().as_uri()}.", err=True)
    elif not (how.open_ or how.json_):
        export = ((typed("export", run), "for MATLAB, C and control design"),) if (run / "result.json").exists() else ()
        say_next(new_console(), (typed("report", run, "--open"), "in the browser"), *export)
