"""The figures and the report of a fit, with a process beside this one to draw the recordings.

Matplotlib holds the interpreter's lock, so threads would draw one after the other.  The process is started when the fit
begins, imports what drawing needs while the search runs, and draws the recordings while this one simulates the plane of
the orders and writes the report: 4 s where 7 s would pass.  Where it dies, this process draws.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from math import isfinite
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fracid.foreign import file_stems

if TYPE_CHECKING:
    from fracid.diagnostics import CostPlane
    from fracid.identify import Fit, RecordingFit
    from fracid.project import Project

__all__ = ["drawing"]


@contextmanager
def drawing(project: Project, folder: Path, jobs: int) -> Iterator[Callable[[Fit], tuple[Path, ...]]]:
    """Get ready to draw while something else is done; gives the function that draws a fit into its folder."""
    beside = ProcessPoolExecutor(1, get_context("spawn"), _prepare) if jobs > 1 else None
    if beside is not None:
        beside.submit(_nothing)  # starts it
    try:
        yield lambda found: _draw(found, project, folder, jobs, beside)
    finally:
        if beside is not None:
            beside.shutdown(wait=False, cancel_futures=True)


def _prepare() -> None:
    """Import what drawing needs."""
    import matplotlib.backends.backend_agg
    import matplotlib.backends.backend_svg
    import matplotlib.figure  # noqa: F401

    import fracid.plots  # noqa: F401
    from fracid.executor import follow_parent

    follow_parent()


def _nothing() -> None:
    pass


def _draw(
    found: Fit, project: Project, folder: Path, jobs: int, beside: ProcessPoolExecutor | None
) -> tuple[Path, ...]:
    """Figures 2 and 3 of each recording, the cost over the orders where two are free, and the report."""
    from fracid.diagnostics import cost_plane
    from fracid.report import write_report
    from fracid.runs import FIGURES

    resolutions = {r.name: {s.name: s.resolution for s in r.report.signals} for r in project.recordings}
    recordings = found.recordings, found.problem.model.zero, resolutions, folder / FIGURES
    drawn = _submitted(beside, *recordings)
    rest = _draw_search(found, folder / FIGURES)
    if isfinite(found.cost):
        two = len(found.problem.order_indices) >= 2
        plane = cost_plane(found.problem, found.x, jobs=jobs) if two else None
        rest += () if plane is None else _draw_plane(found, plane, folder)
        rest += (write_report(folder, found, project, plane=plane, jobs=jobs),)
    try:
        return (_draw_recordings(*recordings) if drawn is None else drawn.result()) + rest
    except BrokenExecutor:
        return _draw_recordings(*recordings) + rest


def _submitted(beside: ProcessPoolExecutor | None, *recordings: Any) -> Future[tuple[Path, ...]] | None:
    """The recordings on their way to the other process; None where there is none, or where it is dead already."""
    try:
        return None if beside is None else beside.submit(_draw_recordings, *recordings)
    except BrokenExecutor:
        return None


def _draw_recordings(
    recordings: Mapping[str, RecordingFit], zero: str, resolutions: Mapping[str, Mapping[str, Any]], where: Path
) -> tuple[Path, ...]:
    from fracid.plots import fitted_over_time, residual_plots, save

    paths: list[Path] = []
    stems = file_stems(recordings)
    for recording in recordings.values():
        if not isfinite(recording.cost):
            continue
        stem, resolution = stems[recording.name], resolutions.get(recording.name, {})
        paths += save(fitted_over_time(recording, zero=zero, resolution=resolution), where, f"figure2-{stem}")
        for output in recording.measured if recording.use == "fit" else ():
            paths += save(residual_plots(recording, output, resolution=resolution), where, f"figure3-{stem}-{output}")
    return tuple(paths)


def _draw_search(found: Fit, where: Path) -> tuple[Path, ...]:
    """Where many starts ended, and how far the orders move with the cut."""
    from fracid.plots import cut_shifts, save, waterfall

    paths: list[Path] = []
    if len(found.starts) > 1:
        paths += save(waterfall(found.starts, cost_name=found.problem.cost_function.name), where, "waterfall")
    if found.cut is not None and found.cut.treatments:
        paths += save(cut_shifts(found.cut), where, "cut")
    return tuple(paths)


def _draw_plane(found: Fit, plane: CostPlane, folder: Path) -> tuple[Path, ...]:
    from fracid.plots import cost_plane, save
    from fracid.runs import FIGURES

    best = (found.orders[plane.names[0]].value, found.orders[plane.names[1]].value)
    figure = cost_plane(plane.first, plane.second, plane.cost, best=best, evaluations=_tried(folder, plane.names),
                        cost_name=found.problem.cost_function.name, names=plane.names)  # fmt: skip
    return save(figure, folder / FIGURES, "cost-over-orders")


def _tried(folder: Path, names: tuple[str, str]) -> Any:
    """The orders of all evaluations in the log, shape (n, 2)."""
    import numpy as np

    from fracid.runs import EVALUATIONS

    lines = (json.loads(line) for line in (folder / EVALUATIONS).read_text(encoding="utf-8").splitlines())
    points = [line["point"] for line in lines]
    return np.array([[p[n] for n in names] for p in points if all(n in p for n in names)]).reshape(-1, 2)
