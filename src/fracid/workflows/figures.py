"""The figures of a run, and its report; in a fit with a process beside this one to draw the recordings.

Matplotlib holds the interpreter's lock, so threads would draw one after the other.  The process is started when the fit
begins, imports what drawing needs and draws the rig while the search runs, and draws the recordings while this one
simulates the plane of the orders and writes the report: 4 s where 7 s would pass.  Where it dies, this process draws.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fracid.errors import InputError
from fracid.safety.environment import ignore_settings
from fracid.safety.text import file_stems
from fracid.tasks.observer import Observer

if TYPE_CHECKING:
    from concurrent.futures import Future, ProcessPoolExecutor

    from matplotlib.figure import Figure

    from fracid.estimation.cost_plane import CostPlane
    from fracid.estimation.records import RecordingFit
    from fracid.fit import Fit
    from fracid.models import Model
    from fracid.problem.project import Project
    from fracid.runs.saved import SavedRun

__all__ = ["drawing", "ended_with_this", "of_plane", "of_recordings", "of_rig", "of_search", "saved"]

Figures = Iterator[tuple[str, "Figure"]]
"""File names without their endings, and what is to stand there."""


@contextmanager
def drawing(
    project: Project, folder: Path, jobs: int, observer: Observer
) -> Iterator[Callable[[Fit], tuple[Path, ...]]]:
    """Get ready to draw while something else is done; gives the function that draws a fit into its folder."""
    from fracid.tasks.local import deaf_to_ctrl_c, fresh_processes  # not above: every command's help would wait

    beside = fresh_processes(1, _prepare) if jobs > 1 else None
    # A model of one's own is of a module that the other process does not have; and it is no rig to draw.
    model: Model | None = project.problem.model
    if not (project.problem.model.rhs.__module__ or "").startswith("fracid."):
        model = None
    with deaf_to_ctrl_c():
        rig = _submitted(beside, _draw_rig, model, folder)  # starts it

    def draw(fit: Fit) -> tuple[Path, ...]:
        with ended_with_this(beside):
            return _draw(fit, project, folder, jobs, beside, rig, observer)

    try:
        with ended_with_this(beside):
            yield draw
    finally:
        if beside is not None:
            beside.shutdown(wait=False, cancel_futures=True)


@contextmanager
def ended_with_this(beside: ProcessPoolExecutor | None) -> Iterator[None]:
    """What ends the work here, Ctrl-C or a full disk, ends the process beside it: nobody waits for its figures."""
    try:
        yield
    except BaseException:
        for process in list((getattr(beside, "_processes", None) or {}).values()):
            process.terminate()
        raise


def _prepare() -> None:
    """Import what drawing needs, as long as there is somebody to draw for."""
    from fracid.tasks.local import follow_parent

    follow_parent()
    with suppress(AttributeError, OSError):  # the search first
        os.nice(5)
    ignore_settings(Path())
    import matplotlib.backends.backend_agg
    import matplotlib.backends.backend_svg
    import matplotlib.figure  # noqa: F401
    import statsmodels.stats.diagnostic  # type: ignore[import-untyped]
    import statsmodels.tsa.stattools  # type: ignore[import-untyped]  # noqa: F401

    import fracid.plots  # noqa: F401


def _draw(
    fit: Fit,
    project: Project,
    folder: Path,
    jobs: int,
    beside: ProcessPoolExecutor | None,
    rig: Future[tuple[Path, ...]] | None,
    observer: Observer,
) -> tuple[Path, ...]:
    """The rig, Figures 2 and 3 of each recording, the cost over the orders where two are free, and the report."""
    from fracid.estimation.cost_plane import cost_plane, reaches
    from fracid.report import write_report

    recordings = fit.recordings, project.resolutions, folder
    observer.stage("figures")
    future = _submitted(beside, _draw_recordings, *recordings)
    rest = saved(of_search(fit), folder)
    if isfinite(fit.cost):
        two = len(fit.problem.order_indices) >= 2
        if two:
            observer.stage("cost over the orders")
        reach = reaches(fit.problem, fit.x, fit.orders) if two else 0.0
        plane = cost_plane(fit.problem, fit.x, reach=reach, jobs=jobs) if two else None
        rest += saved(of_plane(fit, plane, folder), folder) if plane is not None else ()
        observer.stage("page")
        rest += (write_report(folder, fit, project, plane=plane, jobs=jobs),)
    observer.stage("figures of the recordings")
    first = _awaited(rig, _draw_rig, fit.problem.model, folder)
    return first + _awaited(future, _draw_recordings, *recordings) + rest


def _submitted(
    beside: ProcessPoolExecutor | None, work: Callable[..., tuple[Path, ...]], *what: Any
) -> Future[tuple[Path, ...]] | None:
    """What is to be drawn, on its way to the other process; None where there is none, or where it is dead already."""
    try:
        return None if beside is None else beside.submit(work, *what)
    except BrokenExecutor:
        return None


def _awaited(
    future: Future[tuple[Path, ...]] | None, work: Callable[..., tuple[Path, ...]], *what: Any
) -> tuple[Path, ...]:
    """What the other process drew, or this one draws."""
    try:
        return work(*what) if future is None else future.result()
    except BrokenExecutor:
        return work(*what)


def _draw_rig(model: Model | None, folder: Path) -> tuple[Path, ...]:
    return () if model is None else saved(of_rig(model), folder)


def _draw_recordings(
    recordings: Mapping[str, RecordingFit], resolutions: Mapping[str, Mapping[str, Any]], folder: Path
) -> tuple[Path, ...]:
    return saved(of_recordings(recordings, resolutions), folder)


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
    from fracid.plots import fitted_over_time, residual_plots

    stems = file_stems(recordings)
    for recording in recordings.values():
        if not isfinite(recording.cost):
            continue
        stem, resolution = stems[recording.name], resolutions.get(recording.name, {})
        yield f"figure2-{stem}", fitted_over_time(recording, resolution=resolution, style=style)
        for output in recording.measured if recording.use == "fit" else ():
            yield f"figure3-{stem}-{output}", residual_plots(recording, output, resolution=resolution, style=style)


def of_search(fit: Fit | SavedRun, style: str = "screen") -> Figures:
    """Where many starts ended, and how far the orders move with the cut."""
    if len(fit.starts) > 1:
        yield "waterfall", fit.plot_starts(style=style)
    if fit.cut is not None and fit.cut.treatments:
        yield "cut", fit.cut.plot(style=style)


def of_plane(fit: Fit | SavedRun, plane: CostPlane, folder: Path, style: str = "screen") -> Figures:
    """The cost over two orders, and where the search has been."""
    from fracid.report.material import tried

    first, second = fit.problem.order_indices[:2]
    best = (float(fit.x[first]), float(fit.x[second]))
    yield "cost-over-orders", plane.plot(best=best, evaluations=tried(folder, plane.names),
                                         cost_name=fit.problem.cost_function.name, style=style)  # fmt: skip
