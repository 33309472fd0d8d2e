"""``fracid resid RUN``: what a fit leaves over, and what that says of the model."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fracid.cli.app import Json, Out, Trust, app, echo_json, new_console, say_next, typed
from fracid.cli.app import table as new_table
from fracid.cli.completion import from_run
from fracid.errors import DataError, InputError
from fracid.safety.text import file_stems
from fracid.units import with_unit

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.runs.saved import SavedRun
    from fracid.validation.residual_records import ResidualAnalysis

__all__ = ["resid"]

RESIDUALS = "residuals.json"

RESID_EXAMPLE = (
    "[bold]Examples[/bold]",
    "fracid resid runs/rig  [dim](every recording and output; into the folder of that run)[/dim]",
    'fracid resid runs/rig --recording "release 92°" --output alpha',
    "fracid resid runs/rig --json | jq '.recordings[][].whiteness.effective_samples'",
)


@app.command(epilog="\n\n".join(RESID_EXAMPLE))
def resid(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a run, as fracid fit leaves it.")],
    recording: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="May be given again. All of them if left out.", autocompletion=from_run("recordings")
        ),
    ] = None,
    output: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="theta or alpha; may be given again. All if left out.")
    ] = None,
    trust: Trust = False,
    out: Out = None,
    json_: Json = False,
) -> None:
    """Test what a fit leaves over: is it noise, or does the model lack something?

    Simulates each recording with the values of the run, validation recordings too, and says in words whether the
    residual is white, at which frequencies it is not, whether it is normal and scatters alike throughout, and how large
    it is beside the encoder's step.  Writes residuals.json and a page of figures for each.  Exit code 0 if it is done,
    3 if no run of the model reached the end of a recording.
    """
    found = _analysed(run, recording, output, trust)
    folder = out or run
    figures = _write(found, folder)
    if json_:
        echo_json(found.record)
    else:
        _show(found, folder, figures, new_console())
    if not any(isfinite(a.level.rms) for a in found.all):
        raise DataError(f"No run of the model reached the end of {' or '.join(found.analyses)}: there is no residual.")


@dataclass(frozen=True)
class _Analysed:
    """A run with the analyses of its residuals."""

    run: SavedRun
    analyses: Mapping[str, Mapping[str, ResidualAnalysis]]
    """Recording → output → what its residual says."""

    @property
    def all(self) -> tuple[ResidualAnalysis, ...]:
        """One after the other."""
        return tuple(a for outputs in self.analyses.values() for a in outputs.values())

    @property
    def record(self) -> dict[str, Any]:
        """The content of residuals.json."""
        recordings = {name: {n: a.to_json() for n, a in outputs.items()} for name, outputs in self.analyses.items()}
        return {"notes": list(self.run.notes), "recordings": recordings}


def _analysed(folder: Path, recordings: list[str] | None, outputs: list[str] | None, trust: bool) -> _Analysed:
    from fracid.errors import unknown_name
    from fracid.runs.saved import load_run
    from fracid.validation.residuals import residual_analysis

    run = load_run(folder, trust=trust)
    for what, asked, there in (("recording", recordings, run.recordings), ("output", outputs, run.problem.outputs)):
        for name in asked or ():
            if name not in there:
                raise unknown_name(f"{what} of {folder}", name, there)
    return _Analysed(run, {
        name: {n: residual_analysis(run.recordings[name], n, run.resolutions[name])
               for n in run.problem.outputs if not outputs or n in outputs}
        for name in run.recordings if not recordings or name in recordings
    })  # fmt: skip


def _write(found: _Analysed, folder: Path) -> list[Path]:
    """residuals.json, and a figure each; gives those to look at."""
    from fracid.files import write_text
    from fracid.plots import residual_diagnostics, save
    from fracid.runs.folder import FIGURES

    text = json.dumps(found.record, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / RESIDUALS, text)
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be written: {error.strerror}. Give another: --out DIR.") from None
    paths: list[Path] = []
    stems = file_stems(found.run.recordings)
    for a in found.all:
        figure = residual_diagnostics(found.run.recordings[a.recording], a.output, analysis=a,
                                      resolution=found.run.resolutions[a.recording])  # fmt: skip
        paths += save(figure, folder / FIGURES, f"residuals-{stems[a.recording]}-{a.output}")
    return [path for path in paths if path.suffix == ".png"]


# ------------------------------------------------------------------ as text


def _show(found: _Analysed, folder: Path, figures: list[Path], console: Console) -> None:
    from rich.markup import escape

    console.print(_figures(found))
    for note in found.run.notes:
        console.print(f"[yellow]![/yellow] {escape(note)}", soft_wrap=True)
    for a in found.all:
        console.print(f"\n[bold]{escape(a.recording)}, {escape(a.output)}[/bold]{_not_fitted(a)}", soft_wrap=True)
        console.print(_sentences(a))
    console.print(f"\nresult   {escape(str(folder / RESIDUALS))}", soft_wrap=True)
    for path in figures:
        console.print(f"figure   {escape(str(path))}", soft_wrap=True)
    from fracid.selection.ladder import has_friction

    project, trust = found.run.project, ["--trust"] * bool(found.run.project.own_code)
    if has_friction(project.problem.model):
        say_next(console, (typed("compare", project.path, *trust), "does another structure leave less?"))
    else:
        say_next(console, (typed("profile", found.run.folder, *trust), "which values do the data exclude?"))


def _figures(found: _Analysed) -> Any:
    """The sizes of all effects in one table."""
    from rich.markup import escape

    table = new_table("recording", "output", "rms", "steps", "correlated", "count", "PPCC", fold=("recording",))
    for a in found.all:
        steps, w = a.level.steps, a.whiteness
        table.add_row(
            escape(a.recording), escape(a.output), with_unit(a.level.rms, a.unit) if isfinite(a.level.rms) else "–",
            _number(steps, ".2f" if steps < 10 else ",.0f"), _number(w.correlation_time, ".2g", " s"),
            f"{_number(w.effective_samples, ',.0f')} of {a.samples:,}", _number(a.normality.ppcc, ".3f"),
        )  # fmt: skip
    return table


def _number(value: float, digits: str, unit: str = "") -> str:
    return f"{value:{digits}}{unit}" if isfinite(value) else "–"


def _not_fitted(a: ResidualAnalysis) -> str:
    parts = ["not fitted"] if a.use == "validate" else []
    parts += [f"{a.missing:,} samples left out: the simulation has no value there"] if a.missing else []
    return f" ({'; '.join(parts)})" if parts else ""


def _sentences(a: ResidualAnalysis) -> Any:
    from rich.markup import escape
    from rich.padding import Padding
    from rich.table import Table

    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True, style="dim")
    table.add_column(overflow="fold")
    for name, sentence in a.sentences.items():
        table.add_row(name, escape(sentence))
    return Padding(table, (0, 0, 0, 2))
