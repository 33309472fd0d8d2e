"""``fracid report RUN``: the run as one HTML page that opens offline."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fracid.cli.app import CORES, Jobs, Trust, command, flag, new_console, open_page, option, say_next, typed
from fracid.safety.text import printable
from fracid.tasks.display import shown


@command(
    "fracid report runs/rig  [dim]# writes runs/rig/report.html[/dim]",
    "fracid report runs/rig --open  [dim]# and opens it in the browser[/dim]",
    "fracid report runs/rig-compare  [dim]# of compare, design, posterior, profile or noise: its page again[/dim]",
    "fracid report runs  [dim]# of a folder of runs: runs/index.html, all of them side by side[/dim]",
    "fracid report runs/rig --out rig.html  [dim]# one file: send it to whom you like[/dim]",
    "fracid profile runs/rig && fracid report runs/rig  [dim]# with the profiles[/dim]",
)
def report(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a fit or a study, or a folder of runs.")],
    out: Annotated[Path | None, option("FILE", "Output file \\[default: report.html in the folder].", "--out")] = None,
    open_: Annotated[bool, flag("--open", "Open the page in the browser.")] = False,
    trust: Trust = False,
    jobs: Jobs = CORES,
) -> None:
    """Write a fit, or a study, as one HTML page that opens offline.

    Verdict, data, equations, values, curves, residuals, and the rig in motion.  The page is one file and loads nothing
    from the network.  Profiles and the ladder of structures are on it where fracid profile and fracid compare wrote
    them into the folder.
    """
    with shown("page"):
        from fracid.report import INDEX, write_report  # here: it takes a second to import

        path = write_report(run, jobs=jobs, out=out, trust=trust)
    typer.echo(printable(f"report   {path}"))
    if open_ and not open_page(path, True):
        typer.echo(f"No browser took it here. Open {path.resolve().as_uri()}.", err=True)
    elif not open_:
        export = () if path.name == INDEX else ((typed("export", run), "for MATLAB, C and control design"),)
        say_next(new_console(), (typed("report", run, "--open"), "in the browser"), *export)
