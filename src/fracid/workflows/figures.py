"""The figures of a run, and its report; in a fit another process draws them (:mod:`fracid.workflows.drawer`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import chain
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fracid.errors import InputError
from fracid.safety.text import file_stems
from fracid.tasks.observer import Observer
from fracid.workflows.drawer import Drawer, ended_with_this

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fracid.arrays import FloatArray
    from fracid.estimation.cost_plane import CostPlane
    from fracid.estimation.records import RecordingFit
    from fracid.fit import Fit
    from fracid.models import Model
    from fracid.problem.project import Project
    from fracid.runs.saved import SavedRun

__all__ = ["drawing", "of_plane", "of_recordings", "of_rig", "of_search", "saved"]

Figures = Iterator[tuple[str, "Figure"]]
"""File names without their endings, and what is to stand there."""


@contextmanager
def drawing(
    project: Project, folder: Path, jobs: int, observer: Observer, drawer: Drawer
) -> Iterator[Callable[[Fit], tuple[Path, ...]]]:
    """Have the rig drawn while something else is done; gives the function that draws a fit into its folder."""
    model: Model | None = project.problem.model
    # A model of one's own is of a module that the other process does not have; and it is no rig to draw.
    if drawer.pool is not None and not (project.problem.model.rhs.__module__ or "").startswith("fracid."):
        model = None
    rig = drawer.asked(_draw_rig, model, folder)

    def draw(fit: Fit) -> tuple[Path, ...]:
        with ended_with_this(drawer.pool):
            return _draw(fit, project, folder, jobs, drawer, rig, observer)

    with ended_with_this(drawer.pool):
        yield draw


def _draw(
    fit: Fit,
    project: Project,
    folder: Path,
    jobs: int,
    drawer: Drawer,
    rig: Callable[[], tuple[Path, ...]],
    observer: Observer,
) -> tuple[Path, ...]:
    """The rig, Figures 2 and 3 of each recording, the cost over the orders where two are free, and the report."""
    from fracid.estimation.cost_plane import cost_plane, reaches
    from fracid.report import write_report
    from fracid.validation.residual_analyses import analysed

    observer.stage("figures")
    analyses = drawer.asked(analysed, fit.recordings, project.resolutions) if isfinite(fit.cost) else None
    drawn = [rig]
    for stem, recording, output in _pictures(fit.recordings):
        resolution = project.resolutions.get(recording.name, {})
        drawn.append(drawer.asked(_draw_recording, stem, recording, output, resolution, folder))
    rest = saved(of_search(fit), folder)
    drawn.append(lambda: rest)
    plane = None
    if analyses is not None:
        two = len(fit.problem.order_indices) >= 2
        if two:
            observer.stage("cost over the orders")
        reach = reaches(fit.problem, fit.x, fit.orders) if two else 0.0
        plane = cost_plane(fit.problem, fit.x, reach=reach, jobs=jobs) if two else None
        if plane is not None:
            drawn.append(drawer.asked(_draw_plane, plane, fit.x[list(fit.problem.order_indices[:2])], folder,
                                      fit.problem.cost_function.name))  # fmt: skip
    observer.stage("page")
    page = write_report(folder, fit, project, plane=plane, jobs=jobs, analyses=None if analyses is None else analyses())
    drawn.append(lambda: (page,))
    observer.stage("figures of the recordings")
    written = [paths() for paths in reversed(drawn)]  # the last are those that the process beside has not begun
    return tuple(chain.from_iterable(reversed(written)))


def _draw_rig(model: Model | None, folder: Path) -> tuple[Path, ...]:
    return () if model is None else saved(of_rig(model), folder)


def _draw_recording(
    stem: str, recording: RecordingFit, output: str | None, resolution: Mapping[str, Any], folder: Path
) -> tuple[Path, ...]:
    return saved([(stem, _recording_figure(recording, output, resolution, "screen"))], folder)


def _draw_plane(plane: CostPlane, best: FloatArray, folder: Path, cost_name: str) -> tuple[Path, ...]:
    return saved([("cost-over-orders", _plane_figure(plane, best, folder, cost_name, "screen"))], folder)


def saved(figures: Iterable[tuple[str, Figure]], folder: Path, formats: tuple[str, ...] = ("svg", "png"),
          where: Path | None = None) -> tuple[Path, ...]:  # fmt: skip
    """Write figures, each as it is drawn, into the folder of a run or where it is said."""
    from fracid.plots import save
    from fracid.runs.folder import FIGURES

    return tuple(path for stem, figure in figures for path in save(figure, where or folder / FIGURES, stem, formats))


# ------------------------------------------------------------------ the figures by their files' names


def of_rig(model: Model, style: str = "screen") -> Figures:
    """The paper's Figure 1, of a rotary pendulum whose constants make its lengths."""
    try:
        yield "figure1-rig", model.plot(style=style)
    except InputError:
        return


def of_recordings(
    recordings: Mapping[str, RecordingFit], resolutions: Mapping[str, Mapping[str, Any]], style: str = "screen"
) -> Figures:
    """Figure 2 of each recording, and Figure 3 of each output of those that were fitted."""
    for stem, recording, output in _pictures(recordings):
        yield stem, _recording_figure(recording, output, resolutions.get(recording.name, {}), style)


def _pictures(recordings: Mapping[str, RecordingFit]) -> Iterator[tuple[str, RecordingFit, str | None]]:
    """File name, recording, and the output whose residual is drawn; None for the motion itself."""
    stems = file_stems(recordings)
    for recording in recordings.values():
        if not isfinite(recording.cost):
            continue
        yield f"figure2-{stems[recording.name]}", recording, None
        for output in recording.measured if recording.use == "fit" else ():
            yield f"figure3-{stems[recording.name]}-{output}", recording, output


def _recording_figure(recording: RecordingFit, output: str | None, resolution: Mapping[str, Any], style: str) -> Figure:
    from fracid.plots import fitted_over_time, residual_plots

    if output is None:
        return fitted_over_time(recording, resolution=resolution, style=style)
    return residual_plots(recording, output, resolution=resolution, style=style)


def of_search(fit: Fit | SavedRun, style: str = "screen") -> Figures:
    """Where many starts ended, and how far the orders move with the cut."""
    if len(fit.starts) > 1:
        yield "waterfall", fit.plot_starts(style=style)
    if fit.cut is not None and fit.cut.treatments:
        yield "cut", fit.cut.plot(style=style)


def of_plane(fit: Fit | SavedRun, plane: CostPlane, folder: Path, style: str = "screen") -> Figures:
    """The cost over two orders, and where the search has been."""
    best = fit.x[list(fit.problem.order_indices[:2])]
    yield "cost-over-orders", _plane_figure(plane, best, folder, fit.problem.cost_function.name, style)


def _plane_figure(plane: CostPlane, best: FloatArray, folder: Path, cost_name: str, style: str) -> Figure:
    from fracid.runs.evaluations import tried

    evaluations, (first, second) = tried(folder, plane.names), best.tolist()
    return plane.plot(best=(first, second), evaluations=evaluations, cost_name=cost_name, style=style)
