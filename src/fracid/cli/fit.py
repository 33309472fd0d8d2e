"""``fracid fit PROJECT``: identify, show the table, write the run folder with its figures and its report."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from math import floor, isfinite, log10
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fracid.cli.app import CORES, Jobs, Json, Out, Trust, app, echo_json, new_console, one_place, say_next, typed
from fracid.cli.app import table as new_table
from fracid.cli.completion import key_of
from fracid.errors import DataError, InputError
from fracid.files import json_number
from fracid.safety.text import printable
from fracid.units import with_unit
from fracid.workflows.figures import drawing

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.estimation.records import Estimate
    from fracid.fit import Fit
    from fracid.optimise import Evaluation, EvaluationLog
    from fracid.problem.project import Project
    from fracid.runs.folder import Run
    from fracid.selection.integer_rival import Alternative
    from fracid.tasks.journal import Journal
    from fracid.tasks.simulation_cache import Memo

__all__ = ["Ran", "fit", "run_fit", "say_undrawn", "show_fit", "tell_fit"]

LARGEST_SEED = 2**63
"""What JSON can hold everywhere."""

FIT_EXAMPLE = (
    "[bold]Examples[/bold]",
    "fracid fit rig.toml  [dim](writes runs/rig)[/dim]",
    "fracid fit rig.toml --out runs/second --seed 7 --jobs 2",
    "fracid fit rig.toml --multi-start 16  [dim](sixteen starts, and the figure of where they ended)[/dim]",
    "fracid fit rig.toml --cut  [dim](what if the record began elsewhere, or its past were known?)[/dim]",
    "fracid fit rig.toml --preset paper  [dim](gl-paper, ITAE on alpha, orders alone, genetic algorithm)[/dim]",
    "fracid fit rig.toml --json | jq .orders",
)


@app.command(epilog="\n\n".join(FIT_EXAMPLE))
def fit(
    project: Annotated[Path, typer.Argument(metavar="PROJECT", help="The project file, .toml.")],
    preset: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="paper: the paper to the letter.", autocompletion=key_of("presets")),
    ] = None,
    optimiser: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="In place of the file's: {optimisers}.",
            autocompletion=key_of("optimisers"),
        ),
    ] = None,
    multi_start: Annotated[
        int | None,
        typer.Option("--multi-start", metavar="N", help="Starts: yours, the regression's, Sobol points.", min=1),
    ] = None,
    executor: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Where many starts run, each for itself: processes.",
            autocompletion=key_of("executors"),
        ),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler in place of it, tcp://HOST:8786.")
    ] = None,
    cut: Annotated[
        bool, typer.Option("--cut", help="Check how far the orders move with where the record begins: more searches.")
    ] = False,
    trust: Trust = False,
    out: Out = None,
    seed: Annotated[int | None, typer.Option("--seed", metavar="N", help="In place of the file's.", min=0)] = None,
    jobs: Jobs = CORES,
    json_: Json = False,
) -> None:
    """Identify what a project leaves free, and write the run folder: result, log and figures.

    Ctrl-C keeps the best so far; the same command, or fracid resume, goes on.  Exit code 0 if the search ended, 1 if it
    was interrupted, 3 if no run of the model reached the end of the recording.
    """
    folder = out or Path("runs") / project.stem
    ran = run_fit(project, folder, preset=preset, optimiser=optimiser, seed=seed, jobs=jobs, quiet=json_,
                  starts=multi_start, cut=cut, executor=one_place(executor, scheduler), trust=trust)  # fmt: skip
    tell_fit(ran, json_=json_)


@dataclass(frozen=True)
class Ran:
    """A fit with its folder."""

    project: Project
    fit: Fit
    folder: Path
    figures: tuple[Path, ...]
    result: dict[str, Any]
    """The content of result.json."""
    interrupted: bool
    seconds: float
    undrawn: str = ""
    """Why there are no figures and no report, in a sentence; empty where they are there."""


def run_fit(
    path: Path, folder: Path, *, preset: str | None, optimiser: str | None, seed: int | None, jobs: int, quiet: bool,
    starts: int | None = None, cut: bool = False, executor: str | None = None, resume: bool = False,
    trust: bool = False,
) -> Ran:  # fmt: skip
    """Load, identify and write everything; or go on with what is in the folder."""
    began = time.perf_counter()
    from fracid.optimise import Outcome, optimiser_from_name
    from fracid.problem.project import load_project
    from fracid.runs.folder import cut_short, inputs_of, open_run, refuse_anothers, write_result
    from fracid.tasks.tasks import executor_from_name

    project = load_project(path, preset=preset, trust=trust)
    name = _optimiser(optimiser, project.optimiser, starts)
    optimiser_from_name(name)  # refused before an earlier run is cleared from the folder
    asked = {"project": str(path.resolve()), "preset": preset, "optimiser": optimiser, "seed": seed, "starts": starts,
             "cut": cut, "executor": executor}  # fmt: skip
    executor_from_name(executor or "threads")
    if executor and (starts or project.starts) < 2:
        raise InputError("--executor and --scheduler are for many starts; say how many: --multi-start N.")
    if seed is not None and seed >= LARGEST_SEED:
        raise InputError(f"--seed {seed} is not possible; expected less than 2^63.")
    refuse_anothers(folder, path)
    inputs = inputs_of(project)
    if not resume and cut_short(folder, "fit", asked, inputs):
        sys.stderr.write(f"{folder} holds this fit, cut short: it is gone on with. To begin anew remove the folder.\n")
        resume = True
    with (
        open_run(folder, "fit", asked, inputs=inputs, resume=resume) as run,
        drawing(project, folder, jobs) as draw,
    ):
        laps = {"load": time.perf_counter() - began}
        found = _identified(project, run, jobs, quiet, optimiser=name, seed=seed, starts=starts, cut=cut,
                            executor=executor or "threads")  # fmt: skip
        laps |= found.timing
        result = write_result(folder, found, project, laps)  # what the figures may not find room for
        interrupted = Outcome.INTERRUPTED.value in found.outcome
        figures: tuple[Path, ...] = ()
        undrawn = ""
        try:
            written = time.perf_counter()
            figures = draw(found)
            laps["figures"] = time.perf_counter() - written
            laps["total"] = time.perf_counter() - began
            result = write_result(folder, found, project, laps)
            if not interrupted:
                run.finish()
        except KeyboardInterrupt:
            interrupted, undrawn = True, "Interrupted while the figures were drawn."
        except (InputError, OSError, MemoryError) as error:
            undrawn = str(error) or "There is not enough memory for the figures."
    return Ran(project, found, folder, figures, result, interrupted, laps.get("total", time.perf_counter() - began),
               undrawn)  # fmt: skip


def _identified(project: Project, run: Run, jobs: int, quiet: bool, *, optimiser: str, **options: Any) -> Fit:
    """Identify; what was simulated before a resumption is read from the folder."""
    from fracid.identification import identify
    from fracid.optimise import EvaluationLog
    from fracid.runs.folder import EVALUATIONS, MEMO
    from fracid.tasks.simulation_cache import Memo
    from fracid.validation.before_search import before

    reports = {r.name: r.report for r in project.recordings}
    seen = before(project.problem, reports, validation=project.validation, jobs=jobs)
    for finding in seen:  # now, for a search may take its time to find nothing
        sys.stderr.write(f"{finding}\n")
    with (
        EvaluationLog(run.folder / EVALUATIONS, again=run.resumed) as log,
        _progress(optimiser, quiet) as callback,
        Memo(run.folder / MEMO) if Memo.possible else nullcontext() as memo,
        _starts_kept(run, options["executor"], len(project.problem.unknowns)) as journal,
    ):
        for note in _notes(run, log, memo) if run.resumed else ():
            sys.stderr.write(printable(f"{note}\n"))
        remembering = replace(project, problem=replace(project.problem, memo=memo))
        found = identify(remembering, optimiser=optimiser, jobs=jobs, log=log, callback=callback,
                         journal=journal, seen=seen, **options)  # fmt: skip
    return replace(found, problem=project.problem)


def _starts_kept(run: Run, executor: str, unknowns: int) -> AbstractContextManager[Journal | None]:
    """Of starts that run elsewhere, a journal in a folder of its own."""
    from fracid.optimise import Outcome
    from fracid.runs.folder import STARTS
    from fracid.schemas.run import fault_of_end
    from fracid.tasks.journal import Journal

    if executor == "threads":
        return nullcontext()
    (run.folder / STARTS).parent.mkdir(exist_ok=True)
    outcomes = [o.value for o in Outcome]
    study = {"inputs": dict(run.state.inputs), "options": dict(run.state.options)}
    return Journal(run.folder / STARTS, study, lambda _, said: fault_of_end(said, unknowns, outcomes))


def _notes(run: Run, log: EvaluationLog, memo: Memo | None) -> Iterator[str]:
    """What a resumption found in the folder."""
    from fracid.runs.folder import EVALUATIONS

    if log.torn:
        yield f"The last line of {run.folder / EVALUATIONS} was cut off in writing; it is written again."
    if memo is None or memo.emptied:
        yield (
            f"What {run.folder} had simulated cannot be used: the program has changed, or the machine was restarted, "
            "since. It begins again."
        )


def _optimiser(asked: str | None, written: str, starts: int | None) -> str:
    """The optimiser: as asked, else as written; many starts belong to one alone."""
    if starts is None:
        return asked or written
    if asked not in (None, "multistart"):
        raise InputError(f"--multi-start is for the optimiser multistart, not {asked}: leave out one of the two.")
    return "multistart"


@contextmanager
def _progress(optimiser: str, events: bool) -> Iterator[Any]:
    """Evaluations, time and the best cost so far."""
    from fracid.cli.progress import progress_shown
    from fracid.optimise import optimiser_from_name
    from fracid.tasks.job import Progress

    began = time.perf_counter()
    total = optimiser_from_name(optimiser).evaluations  # most stop when they have converged
    with progress_shown("evaluations", events=events) as tell:

        def callback(best: Evaluation, evaluations: int) -> None:
            if tell is not None:
                cost = json_number(best.cost)
                tell(Progress(evaluations, total, 0, time.perf_counter() - began, cost))

        yield callback


# ------------------------------------------------------------------ from results to text


def tell_fit(ran: Ran, *, json_: bool) -> None:
    """Print the result, and end with the command's exit code."""
    if json_:
        echo_json(ran.result)
    else:
        console = new_console()
        show_fit(ran, console)
        if isfinite(ran.fit.cost) and not ran.interrupted and not ran.undrawn:
            _say_next(ran, console)
    if ran.undrawn:
        say_undrawn(ran)
    if not isfinite(ran.fit.cost):
        raise typer.Exit(DataError.exit_code)
    if ran.interrupted:
        sys.stderr.write(f"Interrupted; fracid resume {ran.folder}{' --trust' * bool(ran.project.own_code)} goes on.\n")
        raise typer.Exit(1)


def say_undrawn(ran: Ran) -> None:
    """Say what is there and what is not, and end with 1 after Ctrl-C, else with 2."""
    sys.stderr.write(
        f"{printable(ran.undrawn)} The result is whole, in {ran.folder / 'result.json'}; its figures or the report are "
        f"missing. To draw them: {typed('resume', ran.folder, *['--trust'] * bool(ran.project.own_code))}\n"
    )
    raise typer.Exit(1 if ran.interrupted else InputError.exit_code)


def _say_next(ran: Ran, console: Console) -> None:
    from fracid.selection.ladder import has_friction

    trust = ["--trust"] * bool(ran.project.own_code)
    ladder = [(typed("compare", ran.project.path, *trust), "do the orders help, or is it friction?")]
    say_next(
        console,
        (typed("report", ran.folder, "--open", *trust), "look at the page"),
        (typed("resid", ran.folder, *trust), "what is left over: noise, or something that the model lacks?"),
        *ladder * has_friction(ran.project.problem.model),
    )


def show_fit(ran: Ran, console: Console) -> None:
    """Print the tables, the warnings and where everything is."""
    from rich.markup import escape

    p, found = ran.fit.problem, ran.fit
    console.print(
        f"[bold]{escape(p.model.name)}[/bold], {p.model.zero or 'no zero'}; {p.method}, memory {p.memory.name}, "
        f"step {1e3 * p.experiments[0].step / p.substeps:g} ms; {found.optimiser}, {found.evaluations} evaluations, "
        f"{ran.seconds:.1f} s: {escape(found.outcome)}",
        soft_wrap=True,
    )
    _print_estimates(console, found)
    _print_recordings(console, found)
    if len(found.starts) > 1:
        console.print(f"  starts: {escape(_starts(found))}", soft_wrap=True)
    for note in (*ran.project.notes, *found.warnings):
        console.print(f"[yellow]![/yellow] {escape(note)}", soft_wrap=True)
    if found.discretisation is not None:
        console.print(f"  discretisation: {escape(_discretisation(found))}", soft_wrap=True)
    if found.cut is not None and not found.cut.warnings:
        console.print(f"  cut: {escape(found.cut.verdict)}", soft_wrap=True)
    elif found.cut is None and _begins_in_motion(found):
        console.print("  cut: a record begins in motion; --cut shows how far the orders move with that", soft_wrap=True)
    if found.alternative is not None and not found.alternative.warning:
        console.print(f"  integer order: {escape(_rival(found.alternative))}", soft_wrap=True)
    elif found.alternative is None and (without := _without_integers(found)):
        console.print(
            f"  integer order: no rival was tried: the model gives {escape(without)} no integer value", soft_wrap=True
        )
    console.print(f"result   {escape(str(ran.folder / 'result.json'))}", soft_wrap=True)
    for path in ran.figures:
        if path.suffix in (".png", ".html"):
            what = "report" if path.suffix == ".html" else "figure"
            console.print(f"{what}   {escape(str(path))}", soft_wrap=True)


def _print_estimates(console: Console, found: Fit) -> None:
    from rich.markup import escape

    table = new_table("", "value", "95 % interval", "unit", "")
    shown = {**found.orders, **{n: e for n, e in found.parameters.items() if e.free}}
    for recording in found.recordings.values():
        own = f" [{recording.name}]" if len(found.recordings) > 1 else ""
        shown |= {f"{n}{own}": e for n, e in recording.parameters.items()}
    for name, e in shown.items():
        verdict = "" if e.identifiable == "identifiable" else e.identifiable
        table.add_row(*map(escape, (name, _digits(e.value, e), _interval(e), e.unit, verdict)))
    console.print(table)


def _print_recordings(console: Console, found: Fit) -> None:
    from rich.markup import escape

    outputs, cost = found.problem.outputs, found.problem.cost_function.name
    table = new_table(
        "recording", "use", *(f"{kind} {n}" for n in outputs for kind in ("RMSE", "fit")), f"cost ({cost})"
    )
    for r in found.recordings.values():
        scores = [
            text for n in outputs for text in (with_unit(r.rmse[n], r.unit(n), ".4g"), f"{r.fit_percent[n]:.2f} %")
        ]
        table.add_row(*map(escape, (r.name, r.use, *scores, f"{r.cost:.6g}")))
    console.print(table)


def _digits(value: float, e: Estimate) -> str:
    """As many digits as the standard error makes worth reading, and two more; the bound where it lies at one."""
    if e.bound is not None:
        return f"{e.bound:.6g}"
    if e.standard_error is None or not e.standard_error > 0 or value == 0:
        return f"{value:.6g}"
    wanted = floor(log10(abs(value))) - floor(log10(e.standard_error)) + 2
    return f"{value:.{min(12, max(2, wanted))}g}"


def _interval(e: Estimate) -> str:
    if not e.free:
        return "fixed"
    if e.interval95 is None:
        return "none" if e.bound is None else "at its bound"
    return f"± {(e.interval95[1] - e.interval95[0]) / 2:.2g}"


def _begins_in_motion(found: Fit) -> bool:
    """Whether an order is free, and the speed at some start was found to be other than zero."""
    speeds = [
        e for r in found.recordings.values() if r.use == "fit" for n, e in r.initial.items() if n.startswith("D^")
    ]
    surely = any(e.interval95 is not None and not e.interval95[0] <= 0 <= e.interval95[1] for e in speeds)
    return surely and bool(found.problem.order_indices)


def _starts(found: Fit) -> str:
    """How many starts ended where, and which one won."""
    from fracid.estimation.starts import SAME_COST, final_cost, won

    best = won(found.starts)
    if best is None or best.cost is None:
        return f"none of {len(found.starts)} reached the end"
    costs = [final_cost(s, found.starts) for s in found.starts]
    lowest = sum(cost is not None and cost <= SAME_COST * best.cost for cost in costs)
    lost = sum(cost is None for cost in costs)
    left = f", {lost} were left for their cost" if lost else ""
    return f"{lowest} of {len(costs)} came to the lowest cost{left}; the lowest is that of the start {best.origin}"


def _without_integers(found: Fit) -> str:
    """The free orders of which the model says that no integer value makes sense."""
    return " and ".join(n for n, e in found.orders.items() if e.free and found.problem.model.integer_order(n) is None)


def _rival(rival: Alternative) -> str:
    return f"with {rival.structure} the cost is {rival.cost:.6g}, BIC {rival.gain:.3g} worse: the orders explain more"


def _discretisation(found: Fit) -> str:
    check = found.discretisation
    assert check is not None
    moved = ", ".join(f"{n} {shift:+.1e}" for n, shift in check.shift.items())
    cost = f"with pi2 at half the step the cost is {check.cost_second_order:.6g}"
    return f"{cost} and the orders move by {moved}" if moved else cost
