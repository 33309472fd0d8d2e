"""``fracid control RUN``: a controller about a posture, and over which part of what is known it holds."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from fracid.cli.app import LONG, How, assigned, command, print_entry, print_study, print_table, say, typed, warn

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.workflows.feedback import FinishedControl


@command(*LONG)
def control(
    run: Path,
    kind: str = "lqr",
    posture: str = "",
    at: list[str] | None = None,
    input_: str | None = None,
    limit: float | None = None,
    rate: float | None = None,
    delay: float | None = None,
    off: list[str] | None = None,
    within: list[str] | None = None,
    seconds: float = 10.0,
    draws: int = 200,
    posterior: bool = False,
    *,
    how: How,
) -> None:
    """Design a controller, and test it over what is uncertain.

    Regulators of several weights are simulated on the fractional model with friction, delay, encoder, noise, sampling
    and limits as identified, over draws of the free parameters.  Shows the design that holds on most draws, their
    share, and gain and phase margins with their 95 % bands.  Writes control.json and a figure.  Exit code 0 when done.
    """
    from fracid.workflows.feedback import run_control

    finished = how.done(
        run_control, run, draws=draws, posterior=posterior, kind=kind, posture=posture,
        at=assigned("--at", at, "angle=0.5"), input_=input_, limit=limit, rate=rate, delay=delay,
        off=assigned("--off", off, "alpha=0.2"), within=assigned("--within", within, "alpha=0.6"), seconds=seconds,
    )  # fmt: skip
    how.answer(finished.result, partial(_show, finished, typed("export", run, "--to", "c", trust=how.trust)))


# ------------------------------------------------------------------ from results to text


def _show(finished: FinishedControl, after: str, console: Console) -> None:
    from rich.markup import escape

    from fracid.feedback.study import margin_text

    found, c = finished.control, finished.control.conditions
    names = dict.fromkeys(n for d in found.tried for n in d.controller.weights)
    rows = []
    for d in found.tried:
        gain = "∞" if d.gain_margin is None else f"{d.gain_margin:.3g} dB"
        weights = (f"{d.controller.weights[n]:.3g}" if n in d.controller.weights else "" for n in names)
        rows.append([d.controller.kind, *weights, f"{d.held} of {d.draws}", gain, f"{d.phase_margin:.3g} °"])
    print_table(console, ["controller", *names, "holds", "gain margin", "phase margin"], rows)
    mark = "" if found.design.held == found.design.draws else "[yellow]![/yellow] "
    say(console, escape(found.sentence), mark)
    print_entry(console, "gain", margin_text(found.design.gain_margin, found.gain_margin95, "dB"))
    print_entry(console, "phase", margin_text(found.design.phase_margin, found.phase_margin95, "°"))
    print_entry(console, "loop", f"{1 / c.period:.4g} Hz, {c.input} up to {c.most:.3g} {c.unit}, delay "
                                 f"{1e3 * c.delay:.3g} ms")  # fmt: skip
    if (trial := found.trials[found.worst_draw]) and not trial.holds:
        values = ", ".join(f"{n} = {v:.4g}" for n, v in found.worst.items())
        print_entry(console, "worst", f"lost after {trial.until:.3g} s: {values}")
    warn(console, *found.notes)
    print_study(console, finished, (after, "the model as C"), code=finished.folder / "controller.c")
