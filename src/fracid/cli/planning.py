"""``fracid design RUN|PROJECT|RIG``: which experiments next, and what intervals to expect of them."""

from __future__ import annotations

from functools import partial
from math import isfinite
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fracid.cli.app import (
    CORES,
    Jobs,
    Json,
    Out,
    RealFriction,
    Seed,
    Trust,
    answer,
    assigned,
    command,
    named,
    numbers,
    option,
    print_study,
    say_next,
    several,
    typed,
)
from fracid.cli.app import table as new_table
from fracid.cli.completion import from_run, one_of
from fracid.errors import InputError
from fracid.tasks.display import shown
from fracid.units import half_of, half_width, to_second_digit

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.workflows.planning import FinishedDesign


SWING = (5.0, 150.0)
"""Angles from which a pendulum is released if none are given [°]."""


@command(
    "fracid design runs/rig --for lambda,mu --experiments 3 --seconds 20  [dim]# narrow these; writes runs/rig/design"
    "[/dim]",
    "fracid design runs/rig --against integer  [dim]# tell the orders from friction[/dim]",
    "fracid design runs/rig --release 5,150 --voltage multisine,0.2,8,6 --limit theta=2.5 --out next",
    "fracid design runs/servo --voltage pulses,0.3,1,1.2 --set mass=0.2,0.5,1 --seconds 6  [dim]# which mass to hang on"
    "[/dim]",
    "fracid design srv02-rotpen --friction --order mu=0.95 --for mu  [dim]# before any recording[/dim]",
    "fracid design runs/rig --for mu --json | jq '.expected.mu.interval95'",
)
def design(
    source: Annotated[
        str, typer.Argument(metavar="RUN|PROJECT|RIG", help="A run folder, a project file to fit, or a rig's name.")
    ],
    of: Annotated[
        str | None,
        option(
            "NAME,NAME",
            "Parameters whose intervals to narrow \\[default: all].",
            "--for",
            complete=from_run("orders", "parameters"),
        ),
    ] = None,
    experiments: Annotated[int, option("N", "Number of experiments.", min=1, max=1000)] = 3,
    release: Annotated[
        str | None, option("DEG,DEG", "Release angles; two are a range, 0 is none \\[default: 5,150 for a pendulum].")
    ] = None,
    seconds: Annotated[
        str | None, option("S,S", "Durations to choose from, in s \\[default: 20; driven, that of the recording].")
    ] = None,
    rate: Annotated[
        str | None, option("HZ,HZ", "Sample rates to choose from \\[default: 500; driven, that of the recording].")
    ] = None,
    arm: Annotated[str, option("NAME,NAME", "The arm: free, clamped, or both.")] = "free",
    voltage: Annotated[
        list[str] | None,
        several(
            "KIND,A,B,PEAK",
            "multisine or chirp from A to B Hz, pulses of A to B s \\[default: nothing; of what is "
            "driven and not released, a multisine as strong as its recording's input].",
        ),
    ] = None,
    voltage_step: Annotated[
        float, option("V", "Step of the amplifier: voltages are its multiples; 0 for any.", min=0)
    ] = 0.0,
    set_: Annotated[
        list[str] | None,
        several("NAME=A,B", "Values of a constant to choose from: mass=0.2,0.5,1, which is hung on.", "--set"),
    ] = None,
    limit: Annotated[
        list[str] | None, several("NAME=VALUE", "Largest magnitude, theta=2.5 rad, theta_speed=20 rad/s.")
    ] = None,
    sensors: Annotated[str | None, option("NAME,NAME", "Recorded outputs \\[default: all].")] = None,
    counts: Annotated[
        float | None, option("N", "Encoder counts per turn \\[default: those of the recordings].", min=0)
    ] = None,
    criterion: Annotated[
        str | None, named("D, A, Ds (with --for) or T (with --against).", one_of("D", "A", "Ds", "T"))
    ] = None,
    against: Annotated[
        str | None, named("integer: discriminate the orders from integer-order models.", one_of("integer"))
    ] = None,
    order: Annotated[list[str] | None, several("NAME=VALUE", "For a rig: an order, mu=0.95.")] = None,
    friction: RealFriction = False,
    robust: Annotated[
        int, option("N", "Average over N parameter draws from the intervals; 0 for the fitted values.", min=0, max=1000)
    ] = 0,
    trust: Trust = False,
    out: Out = None,
    seed: Seed = 1,
    jobs: Jobs = CORES,
    json_: Json = False,
) -> None:
    """Choose the next experiments, and predict their intervals.

    Computes the information of each candidate experiment with the noise of the run, adds it to that of the recordings
    so far, and finds the best set by exchange.  Excludes candidates that exceed a limit.  Writes project files to
    complete with the new recordings, voltages, expected curves with a band, plan.json and figures.  Exit code 0 when
    done.
    """
    orders, limits = assigned("--order", order, "mu=0.95"), assigned("--limit", limit, "theta=2.5")
    constants = {n: v for text in set_ or () for n, v in (_setting(text),)}
    angles = (0.0,) if release is None else numbers("--release", release)
    durations, rates = numbers("--seconds", seconds or "20"), numbers("--rate", rate or "500")
    said = {"seconds": seconds, "rate": rate, "voltage": voltage or release}
    from fracid.experiments.space import DesignSpace
    from fracid.workflows.planning import run_design

    space = DesignSpace(
        release=angles, arm=_names(arm), seconds=durations, rate=rates, counts=counts, sensors=_names(sensors),
        voltage=tuple(_voltage(text) for text in voltage or ()) or None, voltage_step=voltage_step, limits=limits,
        constants=constants,
    )  # fmt: skip
    with shown(events=json_) as observer:
        finished = run_design(
            source, space, experiments=experiments, criterion=criterion, of=_names(of), against=against,
            orders=orders or None, swing=SWING if release is None else (),
            unsaid=[name for name, value in said.items() if not value], friction=friction, robust=robust,
            trust=trust, out=out, seed=seed, jobs=jobs, observer=observer,
        )  # fmt: skip
    project = next((p for p in finished.files if p.suffix == ".toml"), finished.folder)
    after = typed("fit", project, trust=trust), "when the recordings are there"
    answer(json_, finished.result, partial(_show, finished, after))


# ------------------------------------------------------------------ from text to a space


def _names(text: str | None) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip()) if text else ()


def _setting(text: str) -> tuple[str, tuple[float, ...]]:
    """``mass=0.2,0.5,1``."""
    name, _, values = text.partition("=")
    return name.strip(), numbers("--set", values, "mass=0.2,0.5,1")


def _voltage(text: str) -> Any:
    """``multisine,0.2,8,6``."""
    from fracid.experiments.excitation import Chirp, Multisine, Pulses

    kinds = {"multisine": Multisine, "chirp": Chirp, "pulses": Pulses}
    kind, _, rest = text.partition(",")
    values = numbers("--voltage", rest) if rest else ()
    if kind not in kinds or len(values) != 3:
        raise InputError(f"--voltage {text!r} is not possible; expected multisine,0.2,8,6 (from Hz, to Hz, peak), "
                         "chirp,0.3,4,6 or pulses,0.1,1,6 (shortest s, longest s, peak).")  # fmt: skip
    low, high, peak = values
    return kinds[kind](low, high, peak)


# ------------------------------------------------------------------ from results to text


def _show(finished: FinishedDesign, after: tuple[str, str], console: Console) -> None:
    from rich.markup import escape

    plan = finished.plan
    excluded = f", {plan.excluded} more are excluded" if plan.excluded else ""
    count = len(plan.experiments)
    console.print(f"[bold]{count} experiment{'s' * (count > 1)}[/bold] of {plan.candidates} candidates{excluded}; "
                  f"criterion {plan.criterion}", soft_wrap=True)  # fmt: skip
    for c, count in plan.repetitions.items():
        console.print(f"  {count} × {escape(str(c))}", soft_wrap=True)
    table = new_table("", "value", "95 % to expect", "narrower by", "unit")
    gains = plan.gain_over()
    for name, v in plan.expected.items():
        half = half_of(v.interval95)
        value = to_second_digit(v.value, half) if half else f"{v.value:.5g}"
        ends = f"± {half_width(half, v.value)}" if half else "not shown"
        gain = gains.get(name)
        narrower = "–" if gain is None or not isfinite(gain) else f"{gain:.2g}"
        mark = "*" if name in plan.of else ""
        table.add_row(*map(escape, (f"{name}{mark}", value, ends, narrower, v.unit)))
    console.print(table)
    star = "* The plan is chosen to narrow these. " if plan.of else ""
    console.print(f"[dim]{star}Narrower by: today's 95 % interval divided by the one to expect.[/dim]", soft_wrap=True)
    for name, distance in sorted((plan.distances or {}).items(), key=lambda item: item[1])[:1]:
        console.print(f"The nearest integer-order alternative, with {escape(name)}, stays {distance:.3g} standard "
                      "deviations away.", soft_wrap=True)  # fmt: skip
    if len(plan.alone or {}) > 1:
        alone = ", ".join(f"{order} {distance:.3g}" for order, distance in (plan.alone or {}).items())
        console.print(f"Where one order alone is fractional: {escape(alone)}.", soft_wrap=True)
    files = {"sheet": finished.folder / "sheet.txt", "page": finished.folder / "plan.html"}
    print_study(console, files, finished.files)
    say_next(console, after)
