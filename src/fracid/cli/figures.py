"""``fracid draw RUN|PROJECT|RIG``: the figures again, in the formats and the style of a journal."""

from __future__ import annotations

import typer

from fracid.cli.app import How, command
from fracid.safety.text import printable
from fracid.tasks.display import shown


@command
def draw(source: str, how: How) -> None:
    """Draw the figures again, sized for journal columns, as PDF.

    Fonts are embedded.  A run: the rig, measured and fitted outputs, the residuals and their tests, the cost over the
    orders, the minima of the starts, the start of the record, the linear models, and the profiles that fracid profile
    wrote into the folder.  A comparison: the nested friction models.  A noise study: bias and spread.  A project or a
    rig: the rig to scale, with the zeros and positive senses of both angles.
    """
    with shown("figures"):
        from fracid.workflows.redrawing import redraw  # here: it takes a second to import

        paths = redraw(source, **how.taken(redraw, formats=how.formats or ("pdf",)))
    for path in paths:
        typer.echo(printable(f"figure   {path}"))
