"""``fracid draw RUN|PROJECT|RIG``: the figures again, in the formats and the style of a journal."""

from __future__ import annotations

from typing import Annotated

import typer

from fracid.cli.app import CORES, Jobs, Out, Trust, command, named
from fracid.cli.completion import key_of, one_of
from fracid.safety.text import printable
from fracid.tasks.display import shown

WRITTEN = ("pdf", "svg", "png")


@command(
    "fracid draw runs/rig  [dim]# PDF for a journal's columns, into runs/rig/figures/journal[/dim]",
    "fracid draw runs/rig --format pdf --format svg --out paper/figures",
    "fracid draw runs/rig --style screen --format pdf",
    "fracid draw runs/rig-compare  [dim]# the ladder of structures[/dim]",
    "fracid draw qube-servo2 --zero upright  [dim]# the rig itself, to scale[/dim]",
)
def draw(
    source: Annotated[
        str,
        typer.Argument(
            metavar="RUN|PROJECT|RIG",
            help="The folder of a fit, a comparison or a noise study; a project file; or the name of a rig.",
            autocompletion=key_of("rigs"),
        ),
    ],
    style: Annotated[str, named("journal or screen.", one_of("journal", "screen"))] = "journal",
    formats: Annotated[
        list[str] | None, named("pdf, svg or png; may be repeated \\[default: pdf].", one_of(*WRITTEN), "--format")
    ] = None,
    zero: Annotated[
        str | None, named("For a rig: alpha = 0 hanging or upright \\[default: hanging].", one_of("hanging", "upright"))
    ] = None,
    trust: Trust = False,
    out: Out = None,
    jobs: Jobs = CORES,
) -> None:
    """Draw the figures again, sized for journal columns, as PDF.

    Fonts are embedded.  A run: the rig, measured and fitted outputs, the residuals and their tests, the cost over the
    orders, the minima of the starts, the start of the record, the linear models, and the profiles that fracid profile
    wrote into the folder.  A comparison: the nested friction models.  A noise study: bias and spread.  A project or a
    rig: the rig to scale, with the zeros and positive senses of both angles.
    """
    with shown("figures"):
        from fracid.workflows.redrawing import redraw  # here: it takes a second to import

        paths = redraw(source, style=style, formats=formats or ("pdf",), zero=zero, trust=trust, out=out, jobs=jobs)
    for path in paths:
        typer.echo(printable(f"figure   {path}"))
