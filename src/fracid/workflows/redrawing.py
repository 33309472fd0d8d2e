"""Figures drawn again, of whatever a folder holds, or of a rig: ``fracid draw``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from fracid.errors import InputError, refuse_unknown
from fracid.estimation.cost_profile import Profiles
from fracid.estimation.fit_figures import rig_as_found
from fracid.export.state_space import integer_model
from fracid.figures import style_named
from fracid.models import RIGS, rotary_pendulum
from fracid.problem.project import load_project
from fracid.report import plane_of
from fracid.runs.folder import FIGURES
from fracid.runs.saved import SavedRun, load_run
from fracid.safety.schema import Record, read_as
from fracid.selection.comparison_records import Comparison
from fracid.tasks.folder_lock import refuse_links
from fracid.tasks.job import one_blas_thread
from fracid.validation.monte_carlo import NoiseStudy
from fracid.workflows.figures import (
    Pictures,
    of_comparison,
    of_plane,
    of_recordings,
    of_rig,
    of_search,
    of_study,
    of_tests,
    saved,
)
from fracid.workflows.fit import SAYS

FORMATS = ("pdf", "svg", "png")


def redraw(
    source: str, *, style: str = "journal", formats: Sequence[str] = ("pdf",), zero: str | None = None,
    trust: bool = False, out: Path | None = None, jobs: int = 1,
) -> tuple[Path, ...]:  # fmt: skip
    """Draw the figures of a run, a comparison or a study of noise again, or a rig; gives what was written.

    Parameters
    ----------
    source : str
        The folder; or a project file or the name of a rig, which is drawn itself.
    style : str
        ``journal`` or ``screen``.
    formats : sequence of str
        ``pdf``, ``svg``, ``png``.
    zero : str, optional
        Of a rig: ``hanging`` or ``upright``; hanging if left out.
    trust : bool
        Run Python code that the project refers to.  Review it first.
    out : Path, optional
        The folder; ``figures/journal`` in that of the run if left out.
    jobs : int
        Threads.

    Raises
    ------
    InputError
        For what is none of these, and for a style or a format that there is not.
    NotTrusted
        If the project names code of its own, and `trust` is not given.

    Examples
    --------
    >>> redraw("srv03")
    Traceback (most recent call last):
    fracid.errors.InputError: 'srv03' is neither a run, nor a project, nor a rig. ...
    """
    style_named(style)
    refuse_unknown("--format", FORMATS, *formats)
    folder = Path(source)
    if zero is not None and (folder.is_dir() or source.endswith(".toml")):
        raise InputError(f"--zero is for a rig; {source} says its own: leave it out.")
    home = folder / FIGURES if folder.is_dir() else Path(FIGURES)
    where = out or (home if style == "screen" else home / style)
    with one_blas_thread():
        named = _of_named_rig(source, zero or "hanging", trust)
        pictures = _of_folder(folder, trust, jobs) if folder.is_dir() else named
        return saved(pictures, where, tuple(dict.fromkeys(formats)), style)


def _of_named_rig(name: str, zero: str, trust: bool) -> Pictures:
    """A rig by its name, or with the constants of a project."""
    if name in RIGS:
        yield name, rotary_pendulum(name, zero=zero).plot
    elif name.endswith(".toml"):
        yield Path(name).stem, load_project(Path(name), trust=trust).problem.model.plot
    else:
        raise InputError(SAYS("nothing-to-draw", name=name, rigs=", ".join(RIGS)))


def _of_folder(folder: Path, trust: bool, jobs: int) -> Pictures:
    """All that can be drawn of what lies there."""
    refuse_links(folder)
    if (folder / "compare.json").exists():
        return of_comparison(_read(folder / "compare.json", Comparison, "fracid compare PROJECT"))
    if not (folder / "result.json").exists() and (folder / "noise.json").exists():
        return of_study(_read(folder / "noise.json", NoiseStudy, "fracid noise RUN"))
    run = load_run(folder, trust=trust)
    return chain(
        of_rig(rig_as_found(run.problem.model, run.parameters)), of_recordings(run.recordings, run.resolutions),
        of_tests(run.recordings, run.resolutions), of_plane(run, plane_of(run, jobs), run.folder),
        of_search(run), _of_profiles(run), _of_linear(run),
    )  # fmt: skip


def _of_profiles(run: SavedRun) -> Pictures:
    if (path := run.folder / "profiles.json").exists():
        profiles = _read(path, Profiles, "fracid profile RUN")
        if not set(run.problem.names) <= set(profiles.minimum):
            raise InputError(f"{path} is of other unknowns than the run. Write it again: fracid profile RUN.")
        yield "profiles", replace(profiles, problem=run.problem).plot


def _read(path: Path, kind: type[Record], wrote: str) -> Any:
    """What a command wrote of a kind."""
    return kind.of_json(read_as(path, kind, wrote, "{path} cannot be read: {error}."))


def _of_linear(run: SavedRun) -> Pictures:
    """The linear models about both postures, where something drives them."""
    try:
        system = integer_model(run)
    except InputError:  # it says why where it is asked for: fracid export RUN --to state-space
        return
    for posture, linear in system.linear.items():
        if linear.inputs and linear.outputs and linear.G.any():
            yield f"linear-{posture}", partial(system.plot, posture)
