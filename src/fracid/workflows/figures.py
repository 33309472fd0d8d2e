"""The figures of a run, and its report; in a fit another process draws them (:mod:`fracid.workflows.drawer`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fracid.estimation.fit_figures import rig_as_found
from fracid.figures import draw
from fracid.safety.text import file_stems
from fracid.tasks.progress import Observer
from fracid.workflows.drawer import Asked, Drawer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fracid.estimation.cost_plane import CostPlane
    from fracid.estimation.records import RecordingFit
    from fracid.fit import Fit
    from fracid.models import Model
    from fracid.problem.project import Project
    from fracid.selection.comparison_records import Comparison
    from fracid.validation.monte_carlo import NoiseStudy
    from fracid.validation.residual_analyses import Analyses

FEW = 3
"""To draw so few that wait here, too, would take longer than they take beside: to import what draws is one second."""

Pictures = Iterable[tuple[str, Callable[..., "Figure"]]]
"""File names without their endings, and what draws what is to stand there; it takes a style."""


@dataclass(frozen=True)
class Drawing:
    """The figures of a fit that is under way, and its report."""

    project: Project
    folder: Path
    jobs: int
    observer: Observer
    drawer: Drawer
    _begun: dict[str, _Drawn] = field(default_factory=dict)
    """By recording."""

    @property
    def figures(self) -> Path:
        """The folder that they are written into."""
        from fracid.runs.folder import FIGURES  # not above: the other process has no need of all that this imports

        return self.folder / FIGURES

    def begin(self, recordings: Mapping[str, RecordingFit]) -> None:
        """Have recordings drawn beside a simulation that may be the last: the rest of a fit is examined meanwhile.

        A very long one is handed over when that is done: both together would take much memory.
        """
        from fracid.validation.residual_analyses import ANALYSED

        self._of_recordings({n: r for n, r in recordings.items() if r.time.size <= ANALYSED})

    def __call__(self, fit: Fit) -> tuple[Path, ...]:
        """Draw the rig, Figures 2 and 3 of each recording, and the cost over two free orders; write the report."""
        from fracid.report import plane_of, write_report

        folder, model = self.folder, self.project.problem.model
        # One's own model is of a module that the other process does not have.
        drawable = self.drawer.pool is None or (model.rhs.__module__ or "").startswith("fracid.")
        self.observer.stage("figures")
        recordings = self._of_recordings(fit.recordings)
        of_the_rig = of_rig(rig_as_found(model, fit.parameters)) if drawable else ()
        pieces = [*self._asked(of_the_rig), *chain.from_iterable(r.figures for r in recordings)]
        of_starts = saved(of_search(fit), self.figures)
        if len(fit.problem.order_indices) >= 2:
            self.observer.stage("cost over the orders")
        plane = plane_of(fit, self.jobs)
        pieces += self._asked(of_plane(fit, plane, folder))
        self.observer.stage("page")
        residuals = {name: tested for r in recordings for name, tested in r.residuals().items()}
        page = write_report(folder, fit, self.project, plane=plane, jobs=self.jobs, residuals=residuals)
        self.observer.stage("figures of the recordings")
        patient = sum(piece.waits for piece in pieces) <= FEW
        written = [piece(patient=patient) for piece in reversed(pieces)]  # the last are those that nobody has begun
        return (*chain.from_iterable(reversed(written)), *of_starts, page)

    def _asked(self, pictures: Pictures) -> list[Asked[tuple[Path, ...]]]:
        return [self.drawer.asked(saved, [picture], self.figures) for picture in pictures]

    def _of_recordings(self, recordings: Mapping[str, RecordingFit]) -> list[_Drawn]:
        """Ask for what each recording needs; what is asked of the same simulation already is not asked again."""
        from fracid.validation.residual_analyses import analysed, first_part

        begun, stems, resolutions = self._begun, file_stems(recordings), self.project.resolutions
        new = {n: r for n, r in recordings.items() if n not in begun or not _looks_alike(begun[n].recording, r)}
        for name in new.keys() & begun.keys():
            begun[name].drop()
        # What is tested first: the page waits for it.
        tested = {n: self.drawer.asked(analysed, {n: first_part(r)}, resolutions) for n, r in new.items()}
        for n, r in new.items():
            begun[n] = _Drawn(r, tested[n], self._asked(_of_recording(stems[n], r, resolutions.get(n, {}))))
        return [begun[name] for name in recordings]


@dataclass(frozen=True)
class _Drawn:
    """What another process does for one recording, or this one when it is waited for."""

    recording: RecordingFit
    residuals: Asked[Analyses]
    figures: list[Asked[tuple[Path, ...]]]

    def drop(self) -> None:
        """Have none of it begun, and what is begun ended: two would write one file."""
        self.residuals.drop()
        for piece in self.figures:
            piece.drop()


def _looks_alike(one: RecordingFit, other: RecordingFit) -> bool:
    """Whether two simulations of a recording are the same, whatever is known of their parameters."""
    alike = (np.array_equal(y, other.fitted[name], equal_nan=True) for name, y in one.fitted.items())
    return one.cost == other.cost and all(alike)


def saved(
    pictures: Pictures, folder: Path, formats: tuple[str, ...] = ("svg", "png"), style: str = "screen"
) -> tuple[Path, ...]:
    """Draw figures and write them into a folder one by one."""
    written: list[Path] = []
    for stem, picture in pictures:
        from fracid.plots import save  # where there is something to draw: it takes a quarter of a second

        written += save(picture(style=style), folder, stem, formats)
    return tuple(written)


# ------------------------------------------------------------------ the figures by their files' names


def of_rig(model: Model) -> Pictures:
    """The paper's Figure 1, of a model with a scene whose constants make its lengths."""
    if model.scene is not None and np.isfinite(model.scene.at({}, [p.value for p in model.parameters])).all():
        yield "figure1-rig", model.plot


def of_recordings(recordings: Mapping[str, RecordingFit], resolutions: Mapping[str, Mapping[str, Any]]) -> Pictures:
    """Figure 2 of each recording, and Figure 3 of each output of those that were fitted."""
    stems = file_stems(recordings)
    return chain.from_iterable(_of_recording(stems[n], r, resolutions.get(n, {})) for n, r in recordings.items())


def _of_recording(stem: str, recording: RecordingFit, resolution: Mapping[str, Any]) -> Pictures:
    if isfinite(recording.cost):
        yield f"figure2-{stem}", partial(draw, "fitted_over_time", recording, resolution=resolution)
        for output in recording.measured if recording.use == "fit" else ():
            yield f"figure3-{stem}-{output}", partial(draw, "residual_plots", recording, output, resolution=resolution)


def of_tests(recordings: Mapping[str, RecordingFit], resolutions: Mapping[str, Mapping[str, Any]],
             analyses: Analyses | None = None) -> Pictures:  # fmt: skip
    """What ``fracid resid`` looks at: of what was analysed, or of each output of each recording."""
    stems = file_stems(recordings)
    for name, recording in recordings.items():
        found = dict.fromkeys(recording.measured) if analyses is None else analyses.get(name, {})
        for output, analysis in found.items():
            how = {"analysis": analysis, "resolution": resolutions[name]}
            yield f"residuals-{stems[name]}-{output}", partial(draw, "residual_diagnostics", recording, output, **how)


def of_comparison(comparison: Comparison) -> Pictures:
    """The ladder, and the orders over the amplitude where they drift."""
    yield "ladder", comparison.plot
    for name, stem in file_stems(comparison.amplitude).items():
        if comparison.amplitude[name].drifts:
            yield f"amplitude-{stem}", comparison.amplitude[name].plot


def of_study(study: NoiseStudy) -> Pictures:
    """Bias, spread and coverage, where anything was estimated."""
    if any(s.estimates for cell in study.cells for s in cell.unknowns.values()):
        yield "noise", study.plot


def of_search(fit: Fit) -> Pictures:
    """Where many starts ended, and how far the orders move with the cut."""
    if len(fit.starts) > 1:
        yield "waterfall", fit.plot_starts
    if fit.cut is not None and fit.cut.treatments:
        yield "cut", fit.cut.plot


def of_plane(fit: Fit, plane: CostPlane | None, folder: Path) -> Pictures:
    """The cost over two orders, and where the search has been."""
    if plane is not None:
        best = tuple(fit.x[list(fit.problem.order_indices[:2])].tolist())
        yield "cost-over-orders", partial(_searched, plane, folder, best=best, cost_name=fit.problem.cost_function.name)


def _searched(plane: CostPlane, folder: Path, **how: Any) -> Figure:
    from fracid.runs.evaluations import tried

    return plane.plot(evaluations=tried(folder, plane.names), **how)
