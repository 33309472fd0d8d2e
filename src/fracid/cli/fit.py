"""``fracid fit PROJECT``: identify, show the table, write the run folder with its figures and its report."""

from __future__ import annotations

import re
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from fracid.cli.app import (
    SAYS,
    How,
    command,
    new_console,
    print_claim,
    print_figures,
    print_table,
    print_values,
    say,
    say_next,
    typed,
    warn,
)
from fracid.errors import DataError, Unfinished
from fracid.safety.text import printable
from fracid.tasks.display import duration, shown
from fracid.units import letter, with_time_unit, with_unit
from fracid.workflows.drawer import drawer, importing

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.fit import Fit
    from fracid.tasks.progress import Observer
    from fracid.validation.discretisation import Discretisation
    from fracid.workflows.fit import FinishedRun

SHOWN = 3
"""So many notes are printed, what costs most first."""


@command
def fit(project: Path, how: How) -> None:
    """Estimate the free values of a project; write the run folder.

    The folder holds result, log, figures and page.  Ctrl-C keeps the best so far; the same command, or fracid resume,
    continues it.  Exit code 0 if the search ended, 1 if it was interrupted, 3 if no run of the model reached the end
    of the recording.
    """
    with beginning(), watched("recordings", how.json_) as observer, drawer(how.jobs) as draws:
        with importing():
            from fracid.workflows.fit import run  # here: it takes a second, as what draws does meanwhile

        finished = run(project, **how.taken(run, observer=observer, draws=draws))
    tell_fit(finished, how)


@contextmanager
def beginning() -> Iterator[None]:
    """Ctrl-C in a search keeps its best, and in what follows the result; what comes out of a fit was before both."""
    try:
        yield
    except KeyboardInterrupt:
        sys.stderr.write("Interrupted before the search: nothing was written.\n")
        raise typer.Exit(Unfinished.exit_code) from None


@contextmanager
def watched(stage: str, json_: bool) -> Iterator[Observer]:
    """The stages of a fit, then its tables; what this terminal has shown before the search it need not repeat."""
    told: list[str] = []
    with shown(stage, events=json_, result=None if json_ else partial(show_fit, told=told)) as observer:

        def notice(sentence: str) -> None:
            observer.notice(sentence)
            told.append(sentence)

        yield replace(observer, notice=notice) if sys.stdout.isatty() and sys.stderr.isatty() else observer


# ------------------------------------------------------------------ from results to text


def tell_fit(run: FinishedRun, how: How) -> None:
    """Print what came after the result, or all of it as JSON, and end with the command's exit code."""
    how.answer(run.result, partial(_show_rest, run))
    if run.undrawn:
        say_undrawn(run)
    if not isfinite(run.fit.cost):
        raise typer.Exit(DataError.exit_code)
    if run.interrupted:
        again = typed("resume", run.folder, trust=bool(run.project.own_code))
        sys.stderr.write(f"Interrupted. To resume it: {again}\n")
        raise typer.Exit(1)


def say_undrawn(run: FinishedRun) -> None:
    """Report what is there and what is not, and exit with 1: the work was interrupted."""
    again = typed("resume", run.folder, trust=bool(run.project.own_code))
    sys.stderr.write(SAYS("undrawn", why=printable(run.undrawn), result=run.folder / "result.json", typed=again) + "\n")
    raise typer.Exit(Unfinished.exit_code)


def _show_rest(run: FinishedRun, console: Console) -> None:
    show_figures(run, console)
    if not isfinite(run.fit.cost) or run.interrupted or run.undrawn:
        return
    trust = bool(run.project.own_code)
    page = typed("report", run.folder, "--open", trust=trust), "look at the page"
    noise = typed("resid", run.folder, trust=trust), "are the residuals white noise, or does the model lack something?"
    ladder = typed("compare", run.project.path, trust=trust), "do the orders help, or another structure?"
    say_next(console, page, noise, *[ladder] * bool(run.project.problem.model.friction))


def show_figures(run: FinishedRun, console: Console) -> None:
    """Print where the figures are, in one line, and the page."""
    from rich.markup import escape

    print_figures(console, run.figures)
    for path in run.figures:
        if path.suffix == ".html":
            console.print(f"report   {escape(str(path))}", soft_wrap=True)


def show_fit(run: FinishedRun, console: Console | None = None, told: Collection[str] = ()) -> None:
    """Print the tables, the warnings that nobody was told, and where the result is; figures and page are to come."""
    from rich.markup import escape

    from fracid.fit import PARTIAL
    from fracid.selection.doubts import doubts, in_motion, unsaid

    console = console or new_console()
    p, fit = run.fit.problem, run.fit
    if run.interrupted:
        say(console, PARTIAL.replace("PARTIAL", "[bold yellow]PARTIAL[/]"))
    print_claim(console, fit.claim, fit.claim_reasons, doubts(run.result))
    zero, step = f", {p.model.zero}" if p.model.zero else "", with_time_unit(p.experiments[0].step / p.substeps)
    say(console, SAYS("fit", model=escape(p.model.name), zero=zero, p=p, step=step, fit=fit,
                      outcome=escape(fit.outcome), seconds=duration(run.seconds, fine=True)))  # fmt: skip
    print_values(console, [*_estimates(run.result)])
    _print_recordings(console, fit)
    if len(fit.starts) > 1:
        say(console, f"starts: {escape(_starts(fit))}", "  ")
    warnings = [w for w in unsaid(run.result) if w != PARTIAL]
    notes = _folded([n for n in (*warnings, *run.project.notes) if n not in told], p.outputs, fit.recordings)
    warn(console, *notes[:SHOWN])
    if len(notes) > SHOWN:
        warn(console, f"{len(notes) - SHOWN} more: on the page, and in result.json")
    if fit.discretisation is not None:
        say(console, f"discretisation: {escape(_discretisation(fit.discretisation))}", "  ")
    if fit.cut is not None and not fit.cut.warnings:
        say(console, f"cut: {escape(fit.cut.verdict)}", "  ")
    elif fit.cut is None and fit.problem.order_indices and in_motion(run.result):
        say(console, "cut: a record begins in motion; --cut shows how far the orders move with that", "  ")
    without = [n for n, e in fit.orders.items() if e.free and p.model.integer_order(n) is None]
    if fit.alternative is None and without:
        say(console, SAYS("no-integer-value", orders=escape(" and ".join(without))), "  ")
    console.print(f"result   {escape(str(run.folder / 'result.json'))}", soft_wrap=True)


def _folded(notes: Sequence[str], outputs: Collection[str], recordings: Collection[str]) -> list[str]:
    """Notes, of which those that say the same of another output, with other numbers, are one."""
    kept, of = ("|".join(map(re.escape, sorted(names, key=len)[::-1])) for names in (recordings, outputs))
    parts = re.compile(rf"(?<!\w)({kept})(?!\w)|\b({of})\b|\d[\d.,e+-]*")  # a number in a name is none
    groups: dict[str, dict[str, str]] = {}
    for note in notes:
        output = next((m[2] for m in parts.finditer(note) if m[2]), "")
        same = groups.setdefault(parts.sub(lambda m: m[1] or "#", note), {})
        if output in same:
            same = groups.setdefault(note, {})
        same[output] = note
    also = (f" The same holds for {' and '.join(names)}." if names else "" for _, *names in groups.values())
    return [next(iter(same.values())) + more for same, more in zip(groups.values(), also, strict=True)]


def _estimates(result: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """What was estimated, and the orders that were given; with what its interval does not say."""
    several = len(result["recordings"]) > 1
    own = [(f" [{name}]" * several, r["parameters"]) for name, r in result["recordings"].items()]
    free = {n: e for n, e in result["parameters"].items() if e["free"]}
    for of, estimates in (("", result["orders"] | free), *own):
        for n, e in estimates.items():
            yield {**e, "name": f"{n}{of}", "says": "", "reason": ""}


def _print_recordings(console: Console, fit: Fit) -> None:
    outputs, cost = fit.problem.outputs, fit.problem.cost_function.name
    headings = ["recording", "use", *(f"{kind} {n}" for n in outputs for kind in ("RMSE", "fit")), f"cost ({cost})"]
    rows = []
    for r in fit.recordings.values():
        errors = {n: with_unit(e, r.unit(n), ".4g") if isfinite(e) else "none" for n, e in r.rmse.items()}
        scores = [text for n in outputs for text in (errors[n], _percent(r.fit_percent[n]))]
        rows.append([r.name, r.use, *scores, f"{r.cost:.6g}" if isfinite(r.cost) else "none"])
    print_table(console, headings, rows, fold=headings)


def _percent(fit: float) -> str:
    """Two decimals say how near to 100 % it is, and nothing of a fit that is none."""
    if not isfinite(fit):
        return "none"
    return f"{fit:.2f} %" if fit > -100 else f"{fit:,.0f} %"


def _starts(fit: Fit) -> str:
    """How many starts ran to the end and reached the lowest cost, which one won, and what became of the others."""
    from fracid.estimation.starts import SAME_COST, won

    best = won(fit.starts)
    if best is None or best.cost is None:
        return f"none of {len(fit.starts)} reached the end"
    lowest = sum(s.cost is not None and s.cost <= SAME_COST * best.cost for s in fit.starts)
    joined = sum(s.cost is None and s.joined is not None for s in fit.starts)
    dropped = sum(s.cost is None and s.joined is None for s in fit.starts)
    notes = [f", {joined} joined another before the end" if joined else ""]
    notes += [f", {dropped} were left for their cost" if dropped else ""]
    reached = f"{lowest} of {len(fit.starts)} starts reached the lowest cost{''.join(notes)}"
    return f"{reached}; the lowest came from the start {best.origin!r}"


def _discretisation(check: Discretisation) -> str:
    shifts = ", ".join(f"{letter(n)} {shift:+.1e}" for n, shift in check.shift.items())
    cost = f"the cost is {check.cost_second_order:.6g}" if isfinite(check.cost_second_order) else "the run fails"
    said = f"with pi2 at half the step {cost}{f' and the orders move by {shifts}' * bool(shifts)}"
    return f"{check.refinement} {said[0].upper()}{said[1:]}" if check.refinement else said
