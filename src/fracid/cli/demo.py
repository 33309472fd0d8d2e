"""``fracid demo``: the paper's experiment on two simulated recordings that fracid ships."""

from __future__ import annotations

import sys
import tomllib
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fracid.cli.app import How, command, new_console, open_page, say_next, typed
from fracid.cli.fit import beginning, say_undrawn, show_figures, show_fit
from fracid.safety.door import own_text
from fracid.safety.paths import default_folder
from fracid.safety.text import json_text
from fracid.tasks.display import shown
from fracid.workflows.drawer import drawer, importing

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.workflows.fit import FinishedRun

TRUE_ORDERS = {"lambda": 0.8623, "mu": 0.9146}
"""The orders that both twins were simulated with: the paper's result."""

STORY = tomllib.loads(own_text("cli/demo.toml"))["fit"]


@command
def demo(how: How) -> None:
    """Run the paper's experiment on two SIMULATED recordings.

    λ = 0.8623, μ = 0.9146, and how well a fit recovers them.  Release from 10°, hanging, 20 s at 1000 Hz, 4096
    counts a turn with noise; nothing here was measured. Ctrl-C ends it (exit code 1).
    """
    from fracid.report import write_index

    folder = how.out or default_folder("demo")
    console = new_console(file=sys.stderr if how.json_ else sys.stdout)
    results = {}
    show = partial(_show, console=console)
    console.print("The recordings of this demo are [bold]simulated[/bold] (λ = 0.8623, μ = 0.9146).")
    for part in STORY:
        project = Path(str(files("fracid") / "twins" / f"{part['twin']}-twin.toml"))
        console.print(f"\n[bold]{part['headline']}[/bold]", soft_wrap=True)
        with beginning(), shown("recording", events=how.json_, result=show) as observer, drawer(how.jobs) as draws:
            with importing():
                from fracid.workflows.fit import run  # here: it takes a second to import

            ran = run(project, out=folder / part["folder"], preset=part.get("preset"), seed=how.seed, jobs=how.jobs,
                      observer=observer, command=sys.argv[1:], draws=draws)  # fmt: skip
        results[part["folder"]] = ran.result
        show_figures(ran, console)
        if ran.undrawn:
            say_undrawn(ran)
        if ran.interrupted:
            raise typer.Exit(1)
    page = write_index(folder)
    console.print(f"\nreports  {page.resolve().as_uri()}", soft_wrap=True)
    if how.json_:
        typer.echo(json_text(results))
    else:
        open_page(page, how.open_)
        say_next(console, (typed("check", "FILE"), "a recording of your own"))


def _show(run: FinishedRun, console: Console) -> None:
    """The fit, and how far each order is from the one that the twin was made with."""
    show_fit(run, console)
    for name, true in TRUE_ORDERS.items():
        e = run.fit.orders[name]
        off = f"{name}: true value {true}, estimate {e.value:.4f}, error {e.value - true:+.2g}"
        if e.interval95 is not None:
            inside = e.interval95[0] <= true <= e.interval95[1]
            off += ", inside the 95 % interval" if inside else ", OUTSIDE the 95 % interval"
        console.print(f"  {off}.", soft_wrap=True)
