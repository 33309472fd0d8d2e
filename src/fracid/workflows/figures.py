"""The figures of a run, and its report; in a fit another process draws them (:mod:`fracid.workflows.drawer`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fracid.errors import InputError
from fracid.estimation.fit_figures import rig_as_found
from fracid.figures import draw
from fracid.safety.text import file_stems
from fracid.tasks.progress import Observer
from fracid.workflows.drawer import Asked, Drawer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fracid.arrays import FloatArray
    from fracid.bayes.result import Posterior
    from fracid.estimation.cost_plane import CostPlane
    from fracid.estimation.records import RecordingFit
    from fracid.fit import Fit
    from fracid.models import Model
    from fracid.problem.project import Project
    from fracid.selection.comparison_records import Comparison
    from fracid.validation.monte_carlo import NoiseStudy
    from fracid.validation.residual_analyses import Analyses, Residuals

FEW = 3
"""To draw so few that wait here, too, would take longer than they take beside: to import what draws is one second."""

Figures = Iterator[tuple[str, "Figure"]]
"""File names without their endings, and what is to stand there."""


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
    def model(self) -> Model | None:
        """The rig, where it is drawn: one's own is of a module that the other process does not have, and is none."""
        model = self.project.problem.model
        return model if self.drawer.pool is None or (model.rhs.__module__ or "").startswith("fracid.") else None

    def begin(self, recordings: Mapping[str, RecordingFit]) -> None:
        """Have recordings drawn beside a simulation that may be the last: the rest of a fit is examined meanwhile."""
        if self.drawer.pool is not None:
            self._of_recordings(recordings)

    def __call__(self, fit: Fit) -> tuple[Path, ...]:
        """Draw the rig, Figures 2 and 3 of each recording, and the cost over two free orders; write the report."""
        from fracid.report import plane_of, write_report

        folder = self.folder
        self.observer.stage("figures")
        recordings = self._of_recordings(fit.recordings)
        pieces = [piece for r in recordings for piece in r.figures]
        if (model := self.model) is not None:
            pieces.insert(0, self.drawer.asked(_drawn, of_rig, folder, rig_as_found(model, fit.parameters)))
        of_starts = saved(of_search(fit), folder)
        if len(fit.problem.order_indices) >= 2:
            self.observer.stage("cost over the orders")
        plane = plane_of(fit, self.jobs)
        if plane is not None:
            best = fit.x[list(fit.problem.order_indices[:2])]
            pieces.append(
                self.drawer.asked(_drawn, of_plane, folder, plane, best, folder, fit.problem.cost_function.name)
            )
        self.observer.stage("page")
        residuals = {name: tested for r in recordings for name, tested in r.residuals().items()}
        page = write_report(folder, fit, self.project, plane=plane, jobs=self.jobs, residuals=residuals)
        self.observer.stage("figures of the recordings")
        patient = sum(piece.waits for piece in pieces) <= FEW
        written = [piece(patient=patient) for piece in reversed(pieces)]  # the last are those that nobody has begun
        return (*chain.from_iterable(reversed(written)), *of_starts, page)

    def _of_recordings(self, recordings: Mapping[str, RecordingFit]) -> list[_Drawn]:
        """Ask for what each recording needs; what is asked of the same simulation already is not asked again."""
        from fracid.validation.residual_analyses import analysed

        begun, stems, resolutions = self._begun, file_stems(recordings), self.project.resolutions
        new = {n: r for n, r in recordings.items() if n not in begun or not _looks_alike(begun[n].recording, r)}
        for name in new.keys() & begun.keys():
            begun[name].drop()
        # What is tested first: the page waits for it.
        tested = {n: self.drawer.asked(analysed, {n: r}, resolutions) for n, r in new.items()}
        for name, r in new.items():
            figures = [self.drawer.asked(_drawn, _of_recording, self.folder, stem, r, output, resolutions.get(name, {}))
                       for stem, output in _pictures(r, stems[name])]  # fmt: skip
            begun[name] = _Drawn(r, tested[name], figures)
        return [begun[name] for name in recordings]


@dataclass(frozen=True)
class _Drawn:
    """What another process does for one recording, or this one when it is waited for."""

    recording: RecordingFit
    residuals: Asked[Residuals]
    figures: list[Asked[tuple[Path, ...]]]

    def drop(self) -> None:
        """Have none of it begun, and what is begun ended: two would write one file."""
        self.residuals.drop()
        for piece in self.figures:
            piece.drop()


def _looks_alike(one: RecordingFit, other: RecordingFit) -> bool:
    """Whether two simulations of a recording are the same, whatever is known of their parameters."""
    return one.cost == other.cost and all(
        np.array_equal(y, other.fitted[name], equal_nan=True) for name, y in one.fitted.items()
    )


def _drawn(figures: Callable[..., Figures], folder: Path, *of: Any) -> tuple[Path, ...]:
    """What another process is asked for."""
    return saved(figures(*of), folder)


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
    stems = file_stems(recordings)
    for name, recording in recordings.items():
        for stem, output in _pictures(recording, stems[name]):
            yield from _of_recording(stem, recording, output, resolutions.get(name, {}), style)


def _pictures(recording: RecordingFit, stem: str) -> Iterator[tuple[str, str | None]]:
    """File name, and the output whose residual is drawn there; None for the motion itself."""
    if isfinite(recording.cost):
        yield f"figure2-{stem}", None
        for output in recording.measured if recording.use == "fit" else ():
            yield f"figure3-{stem}-{output}", output


def _of_recording(
    stem: str, recording: RecordingFit, output: str | None, resolution: Mapping[str, Any], style: str = "screen"
) -> Figures:
    from fracid.plots import fitted_over_time, residual_plots

    if output is None:
        yield stem, fitted_over_time(recording, resolution=resolution, style=style)
    else:
        yield stem, residual_plots(recording, output, resolution=resolution, style=style)


def of_tests(recordings: Mapping[str, RecordingFit], resolutions: Mapping[str, Mapping[str, Any]],
             analyses: Analyses | None = None, style: str = "screen") -> Figures:  # fmt: skip
    """What ``fracid resid`` looks at: of what was analysed, or of each output of each recording."""
    from fracid.plots import residual_diagnostics

    stems = file_stems(recordings)
    for name, recording in recordings.items():
        found = dict.fromkeys(recording.measured) if analyses is None else analyses.get(name, {})
        for output, analysis in found.items():
            figure = residual_diagnostics(recording, output, analysis=analysis, resolution=resolutions[name],
                                          style=style)  # fmt: skip
            yield f"residuals-{stems[name]}-{output}", figure


def of_comparison(comparison: Comparison, style: str = "screen") -> Figures:
    """The ladder, and the orders over the amplitude where they drift."""
    yield "ladder", comparison.plot(style=style)
    for name, stem in file_stems(comparison.amplitude).items():
        if comparison.amplitude[name].drifts:
            yield f"amplitude-{stem}", comparison.amplitude[name].plot(style=style)


def plotted(name: str, result: Any) -> Figures:
    """The one figure of a result that plots itself."""
    yield name, result.plot()


def of_posterior(drawn: Posterior) -> Figures:
    """Each parameter and each pair, and the simulations that come of them."""
    yield "posterior", drawn.plot()
    yield "posterior-predictive", drawn.plot_predictive()


def of_study(study: NoiseStudy, style: str = "screen") -> Figures:
    """Bias, spread and coverage, where anything was estimated."""
    if any(s.estimates for cell in study.cells for s in cell.unknowns.values()):
        yield "noise", draw("noise_levels", study, style=style)


def of_search(fit: Fit, style: str = "screen") -> Figures:
    """Where many starts ended, and how far the orders move with the cut."""
    if len(fit.starts) > 1:
        yield "waterfall", fit.plot_starts(style=style)
    if fit.cut is not None and fit.cut.treatments:
        yield "cut", fit.cut.plot(style=style)


def of_plane(plane: CostPlane | None, best: FloatArray, folder: Path, cost_name: str, style: str = "screen") -> Figures:
    """The cost over two orders, and where the search has been."""
    from fracid.runs.evaluations import tried

    if plane is not None:
        first, second = best.tolist()
        yield "cost-over-orders", plane.plot(best=(first, second), evaluations=tried(folder, plane.names),
                                             cost_name=cost_name, style=style)  # fmt: skip
