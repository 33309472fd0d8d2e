"""``fracid draw RUN|PROJECT|RIG``: the figures again, in the formats and the style of a journal."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fracid.cli.app import CORES, Jobs, Out, Trust, app
from fracid.cli.completion import key_of, one_of
from fracid.errors import InputError
from fracid.safety.text import printable

if TYPE_CHECKING:
    from fracid.runs.saved import SavedRun
    from fracid.safety.schema import Block
    from fracid.workflows.figures import Figures

__all__ = ["draw"]

DRAW_EXAMPLE = (
    "[bold]Examples[/bold]",
    "fracid draw runs/rig  [dim](PDF for a journal's columns, into runs/rig/figures/journal)[/dim]",
    "fracid draw runs/rig --format pdf --format svg --out paper/figures",
    "fracid draw runs/rig --style screen --format pdf",
    "fracid draw runs/rig-compare  [dim](the ladder of structures)[/dim]",
    "fracid draw qube-servo2 --zero upright  [dim](the rig itself, to scale)[/dim]",
)

WRITTEN = ("pdf", "svg", "png")


@app.command(epilog="\n\n".join(DRAW_EXAMPLE))
def draw(
    source: Annotated[
        str,
        typer.Argument(
            metavar="RUN|PROJECT|RIG",
            help="The folder of a run, a comparison or a study of noise; a project file or the name of a rig.",
            autocompletion=key_of("rigs"),
        ),
    ],
    style: Annotated[
        str, typer.Option(metavar="NAME", help="journal or screen.", autocompletion=one_of("journal", "screen"))
    ] = "journal",
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            metavar="NAME",
            help="pdf, svg or png; may be given again. pdf if left out.",
            autocompletion=one_of(*WRITTEN),
        ),
    ] = None,
    zero: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Of a rig: hanging or upright. hanging if left out.",
            autocompletion=one_of("hanging", "upright"),
        ),
    ] = None,
    trust: Trust = False,
    out: Out = None,
    jobs: Jobs = CORES,
) -> None:
    """Draw the figures again: as wide as a journal's columns, as PDF with its fonts embedded.

    Of a run: the rig, measured and fitted, the residuals and what is tested of them, the cost over the orders, where
    the starts ended, the cut, the linear models, and the profiles where fracid profile wrote them into the folder.  Of
    a comparison: the ladder; of a study of noise: bias and spread.  Of a project or a rig: the rig itself, to scale,
    with the zeros and positive senses of both angles.
    """
    from fracid.figures import style_named
    from fracid.runs.folder import FIGURES
    from fracid.workflows.figures import saved

    style_named(style)
    folder, wanted = Path(source), _formats(formats)
    if zero is not None and (folder.is_dir() or source.endswith(".toml")):
        raise InputError(f"--zero is for a rig; {source} says its own: leave it out.")
    of_rig = _of_rig(source, zero or "hanging", style, trust)
    figures = _of_folder(folder, style, trust, jobs) if folder.is_dir() else of_rig
    home = folder / FIGURES if folder.is_dir() else Path(FIGURES)
    where = out or (home if style == "screen" else home / style)
    for path in saved(figures, folder, wanted, where):
        typer.echo(printable(f"figure   {path}"))


def _formats(asked: list[str] | None) -> tuple[str, ...]:
    for name in asked or ():
        if name not in WRITTEN:
            raise InputError(f"Figures cannot be written as {name!r}; give --format {', '.join(WRITTEN)}.")
    return tuple(dict.fromkeys(asked or ["pdf"]))


def _of_rig(name: str, zero: str, style: str, trust: bool) -> Figures:
    """A rig by its name, or with the constants of a project."""
    from fracid.models import RIGS, rotary_pendulum
    from fracid.problem.project import load_project

    if name in RIGS:
        yield name, rotary_pendulum(name, zero=zero).plot(style=style)
    elif name.endswith(".toml"):
        yield Path(name).stem, load_project(Path(name), trust=trust).problem.model.plot(style=style)
    else:
        raise InputError(
            f"{name!r} is neither a run, nor a project, nor a rig. Give a folder that fracid fit, compare "
            f"or noise wrote, a project file, or one of the rigs {', '.join(RIGS)}."
        )


def _of_folder(folder: Path, style: str, trust: bool, jobs: int) -> Figures:
    """All that can be drawn of what lies there."""
    from fracid.tasks.folder_lock import refuse_links

    refuse_links(folder)
    if (folder / "compare.json").exists():
        return _of_comparison(folder / "compare.json", style)
    if not (folder / "result.json").exists() and (folder / "noise.json").exists():
        return _of_study(folder / "noise.json", style)
    from fracid.runs.saved import load_run

    return _of_run(load_run(folder, trust=trust), style, jobs)


def _of_run(run: SavedRun, style: str, jobs: int) -> Figures:
    from fracid.estimation.cost_plane import cost_plane
    from fracid.workflows import figures as drawing

    plane: Figures = iter(())
    if len(run.problem.order_indices) >= 2:
        plane = drawing.of_plane(run, cost_plane(run.problem, run.x, jobs=jobs), run.folder, style)
    return chain(
        drawing.of_rig(run.problem.model, style), drawing.of_recordings(run.recordings, run.resolutions, style),
        _of_tests(run, style), plane, drawing.of_search(run, style), _of_profiles(run, style),
        _of_linear(run, style),
    )  # fmt: skip


def _of_tests(run: SavedRun, style: str) -> Figures:
    """What ``fracid resid`` looks at, of each output of each recording."""
    from fracid.plots import residual_diagnostics
    from fracid.safety.text import file_stems

    stems = file_stems(run.recordings)
    for name, recording in run.recordings.items():
        for output in recording.measured:
            yield (
                f"residuals-{stems[name]}-{output}",
                residual_diagnostics(recording, output, resolution=run.resolutions[name], style=style),
            )


def _of_profiles(run: SavedRun, style: str) -> Figures:
    from fracid.estimation.cost_profile import Profiles
    from fracid.schemas.profiles import ProfilesBlock

    path = run.folder / "profiles.json"
    if path.exists():
        said = _read(path, ProfilesBlock, "fracid profile RUN")
        if not set(run.problem.names) <= set(said["minimum"]):
            raise InputError(f"{path} is of other unknowns than the run. Write it again: fracid profile RUN.")
        yield "profiles", Profiles.of_json(said, run.problem).plot(style=style)


def _of_comparison(path: Path, style: str) -> Figures:
    from fracid.safety.text import file_stems
    from fracid.schemas.comparison import ComparisonBlock
    from fracid.selection.comparison import Comparison

    found = Comparison.of_json(_read(path, ComparisonBlock, "fracid compare PROJECT"))
    yield "ladder", found.plot(style=style)
    for name, stem in file_stems(found.amplitude).items():
        if found.amplitude[name].drifts:
            yield f"amplitude-{stem}", found.amplitude[name].plot(style=style)


def _of_study(path: Path, style: str) -> Figures:
    from fracid.schemas.study import StudyBlock
    from fracid.validation.monte_carlo import SavedStudy

    found = SavedStudy.of_json(_read(path, StudyBlock, "fracid noise RUN"))
    if any(s.estimates for cell in found.cells for s in cell.unknowns.values()):
        yield "noise", found.plot(style=style)


def _of_linear(run: SavedRun, style: str) -> Figures:
    """The linear models about both postures, where something drives them."""
    from fracid.export.state_space import integer_model

    try:
        found = integer_model(run)
    except InputError:  # it says why where it is asked for: fracid export RUN --to state-space
        return
    for posture, linear in found.linear.items():
        if linear.inputs and linear.G.any():
            yield f"linear-{posture}", found.plot(posture, style=style)


def _read(path: Path, block: type[Block], wrote: str) -> Any:
    """A JSON file of the folder, which must be there."""
    from fracid.safety.schema import read_as

    try:
        return read_as(path, block, wrote)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or 'it is no plain file'}.") from None
