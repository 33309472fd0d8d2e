"""``fracid compare PROJECT``: every structure on the same recordings, judged on others: do orders help?"""

from __future__ import annotations

import csv
import io
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from math import degrees, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fracid.cli.app import CORES, Jobs, Json, Out, Trust, app, new_console, one_place, say_next, typed
from fracid.cli.app import table as new_table
from fracid.cli.completion import key_of
from fracid.errors import DataError, InputError
from fracid.safety.text import csv_cell, file_stems, printable

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.problem.project import Project
    from fracid.selection.comparison import Comparison, Row, Score

__all__ = ["compare"]

RESULT, TABLE = "compare.json", "compare.csv"

MOST = 3
"""Held-out recordings with a table each; of more the mean is shown."""

COMPARE_EXAMPLE = (
    "[bold]Examples[/bold]",
    'fracid compare rig.toml  [dim](fits use = "fit", judges on use = "validate"; writes runs/rig-compare)[/dim]',
    "fracid compare rig.toml --leave-one-out --jobs 8  [dim](each recording held out once)[/dim]",
    "fracid compare rig.toml --amplitude  [dim](do the orders drift as the swing dies?)[/dim]",
    "fracid compare rig.toml --keep cable_stiffness  [dim](stays as the file has it)[/dim]",
    "fracid compare rig.toml --json | jq .verdict",
)


@app.command(epilog="\n\n".join(COMPARE_EXAMPLE))
def compare(
    project: Annotated[Path, typer.Argument(metavar="PROJECT", help="The project file, .toml.")],
    leave_one_out: Annotated[
        bool, typer.Option("--leave-one-out", help="Hold each recording out once, fit all others.")
    ] = False,
    amplitude: Annotated[
        bool, typer.Option("--amplitude", help="Test whether orders drift with amplitude: friction in disguise.")
    ] = False,
    multi_start: Annotated[
        int | None, typer.Option("--multi-start", metavar="N", help="Starts of each fit.", min=1)
    ] = None,
    keep: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="A friction that stays as the file has it; may be given again."),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="paper: the paper's cost and outputs.", autocompletion=key_of("presets")),
    ] = None,
    executor: Annotated[
        str, typer.Option(metavar="NAME", help="threads or processes.", autocompletion=key_of("executors"))
    ] = "threads",
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler in place of it, tcp://HOST:8786.")
    ] = None,
    trust: Trust = False,
    out: Out = None,
    seed: Annotated[int | None, typer.Option("--seed", metavar="N", help="In place of the file's.", min=0)] = None,
    jobs: Jobs = CORES,
    json_: Json = False,
) -> None:
    """Compare viscous, Coulomb, drag and cable friction, each with orders 1 and with orders free.

    All are fitted alike to the recordings with use = "fit" and judged on those with use = "validate", where only the
    initial state, and what a recording has for itself, are found again.  Writes compare.json, compare.csv and figures.
    Cut short, the same command goes on where it was.  Exit code 0 if it is done, 3 if no run of any structure reaches
    the end of the recordings.
    """
    from fracid.problem.project import load_project

    loaded = load_project(project, preset=preset, trust=trust)
    folder = out or Path("runs") / f"{project.stem}-compare"
    options = {
        "leave_one_out": leave_one_out, "amplitude": amplitude, "keep": sorted(keep or []),
        "seed": loaded.seed if seed is None else seed, "starts": multi_start or loaded.starts,
    }  # fmt: skip
    place = one_place(None if executor == "threads" else executor, scheduler) or "threads"
    found = _compared(loaded, folder, options, place, jobs, json_)
    figures = _write(found, loaded, folder)
    if json_:
        typer.echo((folder / RESULT).read_text(encoding="utf-8").rstrip("\n"))
    else:
        console = new_console()
        _show(found, folder, figures, console)
        why = "with the structure that won in its file: residuals, intervals, a page"
        say_next(console, (typed("fit", project, *["--trust"] * trust), why))
    if not any(isfinite(row.cost) for row in found.rows):
        raise typer.Exit(DataError.exit_code)


def _compared(
    project: Project, folder: Path, options: dict[str, Any], executor: str, jobs: int, json_: bool
) -> Comparison:
    """Run it, going on with what the journal in the folder has."""
    from fracid.cli.progress import progress_shown
    from fracid.runs.folder import JOURNAL
    from fracid.selection.comparison import compare as library_compare
    from fracid.selection.ladder import ladder
    from fracid.tasks.journal import Journal
    from fracid.tasks.tasks import executor_from_name

    executor_from_name(executor)  # what is mistyped is refused before an earlier comparison gives way
    ladder(project.problem, keep=options["keep"], others=project.validation)
    study = _study(project, options)
    _begin(folder, study)
    with (
        Journal(folder / JOURNAL, study, _fault(project, options)) as journal,
        progress_shown("fits", events=json_) as tell,
    ):
        for note in journal.notes:
            sys.stderr.write(printable(f"{note}\n"))
        return library_compare(project, executor=executor, jobs=jobs, journal=journal, progress=tell, **options)


def _study(project: Project, options: Mapping[str, Any]) -> dict[str, Any]:
    """All that a fit depends on."""
    from fracid.runs.folder import inputs_of

    same = {name: value for name, value in options.items() if name != "amplitude"}  # it adds to what there is
    return {"kind": "compare", "preset": project.preset, **same, **inputs_of(project)}


def _fault(project: Project, options: Mapping[str, Any]) -> Callable[[str, Any], str]:
    """What is wrong with a result that the journal has."""
    from fracid.safety.schema import fault_of
    from fracid.schemas.comparison import AmplitudeBlock, fault_of_fitted

    problem = project.problem
    fitted, held = ({e.name for e in those} for those in (problem.experiments, project.validation))

    def fault(key: str, said: Any) -> str:
        if key.startswith("amplitude |"):
            return fault_of(said, AmplitudeBlock)
        there = fault_of_fitted(said, problem.outputs)
        if there or options["leave_one_out"]:
            return there
        return "" if set(said["in_sample"]) == fitted and set(said["held_out"]) == held else "of other recordings"

    return fault


def _begin(folder: Path, study: Mapping[str, Any]) -> None:
    """Make the folder, or go on in it; a comparison that is finished gives way to another one."""
    from fracid.runs.folder import JOURNAL, open_folder
    from fracid.tasks.folder_lock import FolderLock

    journal = folder / JOURNAL
    if (folder / "result.json").exists():
        raise InputError(f"{folder} holds a fit; give the comparison a folder of its own: --out DIR.")
    if (folder / RESULT).exists() and journal.exists() and _header(journal) != study:
        with FolderLock(folder):
            (folder / RESULT).unlink()
            journal.unlink()
    if not journal.exists():  # else environment.json keeps the command that is gone on with
        open_folder(folder)


def _header(journal: Path) -> Any:
    from fracid.safety.schema import lines_of
    from fracid.schemas.run import StudyLine

    return next((line["study"] for line in lines_of(journal, StudyLine)), None)


# ------------------------------------------------------------------ from results to files


def _write(found: Comparison, project: Project, folder: Path) -> list[Path]:
    from fracid.files import write_text
    from fracid.plots import save
    from fracid.runs.folder import FIGURES

    record = found.to_json() | {"data_sha256": {r.name: r.sha256 for r in project.recordings}}
    try:
        write_text(folder / "project.toml", project.text)
        write_text(folder / TABLE, _csv(found.table()))
        write_text(folder / RESULT, json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be written: {error.strerror}. Give another: --out DIR.") from None
    paths = save(found.plot(), folder / FIGURES, "ladder")
    for name, stem in file_stems(found.amplitude).items():
        if found.amplitude[name].drifts:
            paths += save(found.amplitude[name].plot(), folder / FIGURES, f"amplitude-{stem}")
    return [path for path in paths if path.suffix == ".png"]


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]))
    writer.writeheader()
    writer.writerows({n: csv_cell(v) if isinstance(v, str) else v for n, v in row.items()} for row in rows)
    return text.getvalue()


# ------------------------------------------------------------------ from results to text


def _show(found: Comparison, folder: Path, figures: Sequence[Path], console: Console) -> None:
    from rich.markup import escape

    fitted = [*found.rows[0].in_sample]
    console.print(f"[bold]fitted[/bold]: {escape(', '.join(fitted))}", soft_wrap=True)
    _print_structures(console, found)
    held_out = [*found.held_out]
    groups = {f"the mean of {len(held_out)}": held_out} if len(held_out) > MOST else {n: [n] for n in held_out}
    for title, names in groups.items():
        console.print(f"[bold]held out[/bold]: {escape(title)}", soft_wrap=True)
        _print_scores(console, found, names)
    for note in found.notes:
        console.print(f"  • {escape(note)}", soft_wrap=True)
    for name, test in found.amplitude.items():
        console.print(f"[bold]amplitude[/bold]: {escape(name)}", soft_wrap=True)
        for sentence in test.sentences:
            console.print(f"  {escape(sentence)}", soft_wrap=True)
    console.print(f"[bold]{escape(found.verdict)}[/bold]", soft_wrap=True)
    for what, path in (("result", folder / RESULT), ("table", folder / TABLE), *(("figure", p) for p in figures)):
        console.print(f"{what:8} {escape(str(path))}", soft_wrap=True)


def _print_structures(console: Console, found: Comparison) -> None:
    """In sample: the orders, how many parameters, what they are worth, and how near the fit comes."""
    orders = [*found.rows[0].orders]
    table = new_table("", "orders", *orders, "unknowns", "BIC", *found.outputs, "ITAE")
    for row in found.rows:
        values = [_order(*row.orders[n]) if row.fractional else "" for n in orders]
        table.add_row(*_structure(row), *values, str(row.parameters), f"{row.bic:+.4g}" if isfinite(row.bic) else "–",
                      *_scores(found, [*row.in_sample.values()]))  # fmt: skip
    console.print(table)
    console.print(
        f"  [dim]angles: RMSE and fit; ITAE in ° s²; BIC above the lowest, of {found.effective_samples:.0f} effective "
        "samples; ← the paper's structure[/dim]",
        soft_wrap=True,
    )


def _print_scores(console: Console, found: Comparison, names: Sequence[str]) -> None:
    table = new_table("", "orders", *found.outputs, "ITAE")
    for row in found.rows:
        table.add_row(*_structure(row), *_scores(found, [row.held_out[n] for n in names if n in row.held_out]))
    console.print(table)


def _structure(row: Row) -> tuple[str, str]:
    """What its rung adds, and its orders."""
    added = row.friction.split(" + ")
    return ("+ " if len(added) > 1 else "") + added[-1], ("free ←" if row.paper else "free") if row.fractional else "1"


def _order(value: float, ends: tuple[float, float] | None) -> str:
    return f"{value:.4f}" if ends is None else f"{value:.4f} ± {(ends[1] - ends[0]) / 2:.2g}"


def _scores(found: Comparison, scores: Sequence[Score]) -> list[str]:
    """RMSE and fit of each output, and the ITAE of all: the mean over recordings."""
    if not scores or any(s.failed for s in scores):
        return ["fails"]
    mean = {
        kind: {n: sum(getattr(s, kind)[n] for s in scores) / len(scores) for n in found.outputs}
        for kind in ("rmse", "fit_percent", "itae")
    }
    near = [f"{degrees(mean['rmse'][n]):.3g}° {_percent(mean['fit_percent'][n])}" for n in found.outputs]
    return [*near, f"{degrees(sum(mean['itae'].values())):.4g}"]


def _percent(fit: float) -> str:
    return f"{fit:.1f} %" if isfinite(fit) else ""
