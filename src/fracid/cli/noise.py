"""``fracid noise RUN|PROJECT``: identify the fitted model's own recordings again: what are its intervals worth?"""

from __future__ import annotations

import csv
import io
import json
import sys
from dataclasses import dataclass
from hashlib import sha256
from math import degrees, isfinite, pi, radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fracid.cli.app import CORES, Json, Out, Seed, Trust, app, echo_json, new_console, one_place, say_next, typed
from fracid.cli.app import table as new_table
from fracid.cli.completion import key_of
from fracid.errors import DataError, InputError
from fracid.safety.paths import refuse_mistaken
from fracid.safety.text import csv_cell, printable

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.arrays import FloatArray
    from fracid.problem import Problem
    from fracid.problem.project import Project
    from fracid.validation.monte_carlo import NoiseStudy, Plan, Statistics

__all__ = ["noise"]

RESULT, TABLE = "noise.json", "noise.csv"

HEADINGS = ("noise", "counts", "", "truth", "bias", "spread", "claimed", "coverage")

NOISE_EXAMPLE = (
    "[bold]Examples[/bold]",
    "fracid noise runs/rig  [dim](the model as fitted is the truth; writes runs/rig/noise)[/dim]",
    "fracid noise rig.toml --levels 0,0.02,0.2 --counts 4096,20000 --seeds 50  [dim](fits first)[/dim]",
    "fracid noise runs/rig --cost itae --out runs/rig-itae  [dim](what ITAE makes of the same recordings)[/dim]",
    "fracid noise runs/rig --optimiser genetic --jobs 2",
    "fracid noise runs/rig --json | jq '.cells[].unknowns.mu.coverage'",
)


@app.command(epilog="\n\n".join(NOISE_EXAMPLE))
def noise(
    source: Annotated[Path, typer.Argument(metavar="RUN|PROJECT", help="A run folder, or a project file to fit.")],
    levels: Annotated[
        str, typer.Option(metavar="DEG,DEG", help="Standard deviations of the noise, in degrees.")
    ] = "0.05,0.1,0.2",
    counts: Annotated[
        str, typer.Option(metavar="N,N", help="Counts a turn of the encoders; 0 for no rounding.")
    ] = "4096,20000",
    seeds: Annotated[int, typer.Option(metavar="N", help="Repetitions at each level with each encoder.", min=1)] = 50,
    cost: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="In place of the project's: {costs}.", autocompletion=key_of("costs")),
    ] = None,
    optimiser: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="In place of the run's: {optimisers}.",
            autocompletion=key_of("optimisers"),
        ),
    ] = None,
    executor: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="processes, or threads: of a model of your own the only way.",
            autocompletion=key_of("executors"),
        ),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler in place of it, tcp://HOST:8786.")
    ] = None,
    trust: Trust = False,
    out: Out = None,
    seed: Seed = 1,
    jobs: Annotated[int, typer.Option("--jobs", metavar="N", help="Processes at most.", min=1)] = CORES,
    json_: Json = False,
) -> None:
    """Simulate the fitted model with noise, identify it again, many times: bias, spread, and what intervals are worth.

    The values of the run are the truth.  Each repetition simulates every recording with them, four times finer than
    the fit, adds noise, rounds as the encoder does, and identifies from the project's own start.  Shows for each
    unknown how far it is off, how much it scatters, and in how many of the 95 % intervals the truth lies; writes
    noise.json, noise.csv and a figure.  Cut short, the same command goes on where it was.  Exit code 0 if it is done, 3
    if no run of the model reaches the end of the recording.
    """
    grid = [radians(v) for v in _numbers("--levels", levels)], [_step(v) for v in _numbers("--counts", counts)]
    if source.suffix != ".toml":
        refuse_mistaken(source, "run")
    fitted = _of_run(source, trust) if source.is_dir() else _of_project(source, jobs, trust)
    _refuse_other_units(fitted)
    folder = out or (source / "noise" if source.is_dir() else Path("runs") / f"{source.stem}-noise")
    study = _studied(fitted, folder, grid, seeds, seed, cost, optimiser, one_place(executor, scheduler), jobs, json_)
    record = study.to_json() | {"source": str(source)}
    figure = _write(study, record, folder)
    if json_:
        echo_json(record)
    else:
        console = new_console()
        _show(study, folder, figure, console)
        command = "profile" if source.is_dir() else "fit"
        say_next(console, (typed(command, source, *["--trust"] * trust), "what the measured data say of it"))


def _numbers(option: str, text: str) -> list[float]:
    """The numbers of a list with commas."""
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if not values or not all(isfinite(v) and v >= 0 for v in values):
        example = "0.05,0.1,0.2" if option == "--levels" else "4096,20000"
        raise InputError(f"{option} {text!r} is not possible; expected numbers from 0 on: {option} {example}.")
    return values


def _step(counts: float) -> float:
    if 0 < counts < 3:
        raise InputError(
            f"--counts {counts:g} is not possible; expected counts a turn, e.g. 4096, or 0 for no rounding."
        )
    return 2 * pi / counts if counts else 0.0


# ------------------------------------------------------------------ the truth


@dataclass(frozen=True)
class _Fitted:
    """A model with the values that are the truth."""

    problem: Problem
    x: FloatArray
    optimiser: str
    starts: int
    digest: str
    """Of the project file, with its own code."""


def _of_run(folder: Path, trust: bool) -> _Fitted:
    from fracid.runs.saved import load_run

    run = load_run(folder, trust=trust)
    return _fitted(run.project, run.problem, run.x, str(run.result.get("optimiser", "multistart")))


def _of_project(path: Path, jobs: int, trust: bool) -> _Fitted:
    """Fit a project, without what comes after the search."""
    import numpy as np

    from fracid.estimation.search import search
    from fracid.problem.project import load_project

    project = load_project(path, trust=trust)
    rng = np.random.default_rng(project.seed)
    found, _ = search(project.problem, project.optimiser, rng, jobs=jobs, starts=project.starts)
    if found.interrupted:
        raise KeyboardInterrupt
    if not isfinite(found.best.cost):
        raise DataError(f"{path}: no run reached its end: {found.best.reason}. There is no model to simulate.")
    return _fitted(project, project.problem, found.best.point, project.optimiser)


def _fitted(project: Project, problem: Problem, x: FloatArray, optimiser: str) -> _Fitted:
    parts = [project.text.encode(), *(file.read_bytes() for file in project.own_code)]
    return _Fitted(problem, x, optimiser, project.starts, sha256(b"".join(parts)).hexdigest()[:16])


def _refuse_other_units(fitted: _Fitted) -> None:
    """Degrees and counts a turn mean nothing to a voltage."""
    for e in fitted.problem.experiments:
        for output in fitted.problem.outputs:
            if (unit := e.units.get(output, "rad")) != "rad":
                raise InputError(
                    f"{e.name}: {output} is in {unit}, and --levels and --counts are of angles. In Python "
                    "fracid.noise_study takes levels and resolutions in the output's own unit."
                )


# ------------------------------------------------------------------ the study


def _studied(
    fitted: _Fitted, folder: Path, grid: tuple[list[float], list[float]], seeds: int, seed: int, cost: str | None,
    optimiser: str | None, executor: str | None, jobs: int, json_: bool,
) -> NoiseStudy:  # fmt: skip
    """Run it, going on with what the journal in the folder has."""
    from fracid.cli.progress import progress_shown
    from fracid.runs.folder import JOURNAL, open_folder
    from fracid.schemas.study import fault_of_repetition
    from fracid.tasks.journal import Journal
    from fracid.validation.monte_carlo import planned

    plan = planned(
        fitted.problem, fitted.x, levels=grid[0], resolutions=grid[1], seeds=seeds, seed=seed, cost=cost,
        optimiser=optimiser or fitted.optimiser, starts=fitted.starts,
    )  # fmt: skip

    def fault(_key: str, said: Any) -> str:
        return fault_of_repetition(said, plan.problem.names)

    if (folder / "result.json").exists():
        raise InputError(f"{folder} holds a fit; give the study a folder of its own: --out DIR.")
    with (
        Journal(open_folder(folder) / JOURNAL, _header(plan, fitted), fault) as journal,
        progress_shown("repetitions", events=json_) as progress,
    ):
        for note in (*journal.notes, *plan.findings):
            sys.stderr.write(printable(f"{note}\n"))
        where = executor or ("threads" if plan.own else "processes")
        return plan.run(executor=where, jobs=jobs, journal=journal, progress=progress)


def _header(plan: Plan, fitted: _Fitted) -> dict[str, Any]:
    """All that a repetition depends on beside its key, so that more levels or seeds go on from what there is."""
    from fracid.runs.environment import versions

    return {
        "kind": "noise",
        "project": fitted.digest,
        "truth": dict(zip(plan.problem.names, plan.truth.tolist(), strict=True)),
        "method": f"{plan.problem.method}, {plan.problem.memory.name}, {plan.problem.substeps}",
        "cost": plan.problem.cost_function.name,
        "seed": plan.seed,
        **{name: plan.how[name] for name in ("optimiser", "starts")},
        "versions": versions(),
    }


# ------------------------------------------------------------------ from results to files and text


def _write(study: NoiseStudy, record: dict[str, Any], folder: Path) -> Path:
    from fracid.files import write_text
    from fracid.plots import noise_levels, save
    from fracid.runs.folder import FIGURES

    try:
        write_text(folder / RESULT, json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
        write_text(folder / TABLE, _csv(study))
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be written: {error.strerror}. Give another: --out DIR.") from None
    drawn = any(s.estimates for cell in study.cells for s in cell.unknowns.values())
    paths = save(noise_levels(study), folder / FIGURES, "noise") if drawn else ()
    return next((path for path in paths if path.suffix == ".png"), folder / RESULT)


def _csv(study: NoiseStudy) -> str:
    rows, text = study.table(), io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]))
    writer.writeheader()
    writer.writerows({n: csv_cell(v) if isinstance(v, str) else v for n, v in row.items()} for row in rows)
    return text.getvalue()


def _show(study: NoiseStudy, folder: Path, figure: Path, console: Console) -> None:
    from rich.markup import escape

    console.print(
        f"{study.seeds} repetitions a cell; {study.optimiser}, {study.problem.cost_function.name}, "
        f"{study.problem.method}; angles in degrees. Coverage is the share of 95 % intervals that hold the truth.",
        soft_wrap=True,
    )
    table = new_table(*HEADINGS, fold=("",))
    for cell in study.cells:
        first = (f"{degrees(cell.level):.4g}°", f"{cell.counts:.6g}" if cell.counts else "none")
        for i, s in enumerate(cell.unknowns.values()):
            table.add_row(*map(escape, (*(("", "") if i else first), *_row(s))))
    console.print(table)
    for sentence in study.sentences():
        mark = "" if sentence.endswith("can be believed.") else "[yellow]![/yellow] "
        console.print(f"{mark}{escape(sentence)}", soft_wrap=True)
    console.print(f"result   {escape(str(folder / RESULT))}", soft_wrap=True)
    console.print(f"table    {escape(str(folder / TABLE))}", soft_wrap=True)
    console.print(f"figure   {escape(str(figure))}", soft_wrap=True)


def _row(s: Statistics) -> tuple[str, ...]:
    """An unknown's line: truth, bias, spread, claimed, coverage."""
    factor = degrees(1.0) if s.unit in ("rad", "rad/s") else 1.0

    def shown(value: float | None, form: str) -> str:
        return "–" if value is None else f"{factor * value:{form}}"

    held = "–"
    if s.coverage95 is not None and s.coverage is not None:
        low, high = s.coverage95
        held = f"{100 * s.coverage:.0f} % ({100 * low:.0f}–{100 * high:.0f})"
    return (s.name, shown(s.truth, ".5g"), shown(s.bias, "+.1e"), shown(s.spread, ".1e"), shown(s.claimed, ".1e"), held)
