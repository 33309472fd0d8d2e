"""``fracid control RUN``: a controller about a posture, and over which part of what is known it holds."""

from __future__ import annotations

import sys
from functools import partial
from typing import TYPE_CHECKING, Annotated

from fracid.cli.app import (
    CORES,
    Jobs,
    Json,
    Out,
    RunFolder,
    Seed,
    Trust,
    answer,
    assigned,
    command,
    flag,
    option,
    print_entry,
    print_study,
    say,
    say_next,
    several,
    typed,
)
from fracid.cli.app import table as new_table
from fracid.tasks.display import shown

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.workflows.feedback import FinishedControl


@command(
    "fracid control runs/rig --limit 10  [dim]# upright, with 10 V; writes runs/rig/control[/dim]",
    "fracid control runs/rig --rate 500 --delay 0.002 --off alpha=0.2 --within alpha=0.6",
    "fracid control runs/joint --at angle=0.5 --off angle=-0.5",
    "fracid control runs/rig --json | jq .share95",
)
def control(
    run: RunFolder,
    kind: Annotated[str, option("NAME", "lqr, or pid: a PID, and a fractional one of its effort.")] = "lqr",
    posture: Annotated[str, option("NAME", "Of a pendulum: upright or hanging \\[default: upright].")] = "",
    at: Annotated[list[str] | None, several("NAME=VALUE", "An output at the posture, 0 if left out.")] = None,
    input_: Annotated[
        str | None, option("NAME", "The input that is driven \\[default: the recorded one].", "--input")
    ] = None,
    limit: Annotated[float | None, option("VALUE", "The greatest input \\[default: that of the recordings].")] = None,
    rate: Annotated[float | None, option("HZ", "Samples a second \\[default: those of the recording].")] = None,
    delay: Annotated[float | None, option("S", "Delay of the loop \\[default: that of the fit].")] = None,
    off: Annotated[list[str] | None, several("NAME=VALUE", "Where an output begins, from the posture.")] = None,
    within: Annotated[list[str] | None, several("NAME=VALUE", "How far an output may be from the posture.")] = None,
    seconds: Annotated[float, option("S", "Duration of each simulation.", min=0.01)] = 10.0,
    draws: Annotated[int, option("N", "Draws of the free parameters.", min=1)] = 200,
    posterior: Annotated[bool, flag("--posterior", "Draws of fracid posterior instead of the intervals'.")] = False,
    trust: Trust = False,
    out: Out = None,
    seed: Seed = 1,
    jobs: Jobs = CORES,
    json_: Json = False,
) -> None:
    """Design a controller, and test it over what is uncertain.

    Regulators of several weights are simulated on the fractional model with friction, delay, encoder, noise, sampling
    and limits as identified, over draws of the free parameters.  Shows the design that holds on most draws, their
    share, and gain and phase margins with their 95 % bands.  Writes control.json and a figure.  Exit code 0 when done.
    """
    from fracid.workflows.feedback import run_control

    with shown(events=json_) as observer:
        finished = run_control(
            run, draws=draws, posterior=posterior, trust=trust, out=out, seed=seed, jobs=jobs, observer=observer,
            command=sys.argv[1:], kind=kind, posture=posture, at=assigned("--at", at, "angle=0.5"), input_=input_,
            limit=limit, rate=rate, delay=delay, off=assigned("--off", off, "alpha=0.2"),
            within=assigned("--within", within, "alpha=0.6"), seconds=seconds,
        )  # fmt: skip
    answer(json_, finished.result, partial(_show, finished, typed("export", run, "--to", "c", trust=trust)))


# ------------------------------------------------------------------ from results to text


def _show(finished: FinishedControl, after: str, console: Console) -> None:
    from rich.markup import escape

    from fracid.feedback.study import margin_text

    found, c = finished.control, finished.control.conditions
    names = dict.fromkeys(n for d in found.tried for n in d.controller.weights)
    table = new_table("controller", *names, "holds", "gain margin", "phase margin")
    for d in found.tried:
        gain = "∞" if d.gain_margin is None else f"{d.gain_margin:.3g} dB"
        weights = (f"{d.controller.weights[n]:.3g}" if n in d.controller.weights else "" for n in names)
        table.add_row(d.controller.kind, *weights, f"{d.held} of {d.draws}", gain, f"{d.phase_margin:.3g} °")
    console.print(table)
    mark = "" if found.design.held == found.design.draws else "[yellow]![/yellow] "
    say(console, escape(found.sentence), mark, 2)
    print_entry(console, "gain", margin_text(found.design.gain_margin, found.gain_margin95, "dB"))
    print_entry(console, "phase", margin_text(found.design.phase_margin, found.phase_margin95, "°"))
    print_entry(console, "loop", f"{1 / c.period:.4g} Hz, {c.input} up to {c.most:.3g} {c.unit}, delay "
                                 f"{1e3 * c.delay:.3g} ms")  # fmt: skip
    if (trial := found.trials[found.worst_draw]) and not trial.holds:
        values = ", ".join(f"{n} = {v:.4g}" for n, v in found.worst.items())
        print_entry(console, "worst", f"lost after {trial.until:.3g} s: {values}")
    for note in found.notes:
        say(console, escape(note), "[yellow]![/yellow] ", 2)
    files = {"result": finished.path, "code": finished.folder / "controller.c", "page": finished.page}
    print_study(console, files, finished.figures)
    say_next(console, (after, "the model as C"))
