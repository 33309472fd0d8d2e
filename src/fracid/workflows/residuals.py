"""Residual analyses of a run with their files: ``fracid resid``, to be called from Python too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fracid.cards import Card
from fracid.errors import refuse_unknown
from fracid.runs.saved import SavedRun, load_run
from fracid.safety.schema import as_json
from fracid.tasks.display import unless_given
from fracid.tasks.job import one_blas_thread
from fracid.tasks.progress import Observer
from fracid.validation.residual_analyses import Analyses, first_part
from fracid.validation.residual_records import ResidualAnalysis, ResidualsBlock
from fracid.validation.residuals import residual_analysis
from fracid.workflows.figures import of_tests
from fracid.workflows.study import Written


@dataclass(frozen=True, repr=False)
class FinishedResiduals(Written):
    """A run with the analyses of its residuals, and where they were written."""

    FILE = "residuals.json"

    run: SavedRun
    analyses: Analyses
    """Recording → output → what its residual says."""

    def _card(self) -> Card:
        rows = tuple((f"{a.recording}, {a.output}", a.whiteness.sentence) for a in self.all)
        return Card(f"Residuals of {self.run.folder}", rows).of_folder(self.folder)

    @property
    def all(self) -> tuple[ResidualAnalysis, ...]:
        """One after the other."""
        return tuple(a for outputs in self.analyses.values() for a in outputs.values())


def run_residuals(
    run: str | Path,
    *,
    recordings: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    trust: bool = False,
    out: str | Path | None = None,
    observer: Observer | None = None,
) -> FinishedResiduals:
    """Test the residuals of a fit, and write the result: what ``fracid resid`` does.

    Parameters
    ----------
    run : str or Path
        The run folder.
    recordings, outputs : sequence of str, optional
        Which; all if left out.
    trust : bool
        Run Python code that the project refers to.  Review it first.
    out : str or Path, optional
        The folder; that of the run if left out.
    observer : Observer, optional
        Hears each stage as it begins.

    Raises
    ------
    InputError
        If the folder holds no run that can be read, a name is none of the run's, or the folder cannot be written.
    NotTrusted
        If the project names code of its own, and `trust` is not given.

    Examples
    --------
    >>> run_residuals("nowhere/rig")
    Traceback (most recent call last):
    fracid.errors.InputError: ...
    """
    source, folder, watching = Path(run), Path(out or run), unless_given(observer)
    watching.stage("run")
    with one_blas_thread():
        loaded_run = load_run(source, trust=trust)
        refuse_unknown(f"recording of {source}", loaded_run.recordings, *(recordings or ()))
        refuse_unknown(f"output of {source}", loaded_run.problem.outputs, *(outputs or ()))
        watching.stage("tests of the residuals")
        tested = {n: first_part(r) for n, r in loaded_run.recordings.items() if not recordings or n in recordings}
        for name, r in tested.items():
            if r.time.size < (samples := loaded_run.recordings[name].time.size):
                watching.notice(f"{name} has {samples:,} samples: the first {r.time.size:,} are tested and drawn.")
        analyses = {
            name: {n: residual_analysis(r, n, loaded_run.resolutions[name])
                   for n in loaded_run.problem.outputs if not outputs or n in outputs}
            for name, r in tested.items()
        }  # fmt: skip
    record = as_json(ResidualsBlock, {"notes": loaded_run.notes, "recordings": analyses})
    figures = of_tests(tested, loaded_run.resolutions, analyses)
    if (recordings or outputs) and (file := folder / FinishedResiduals.FILE).exists():
        watching.notice(f"{file} is replaced: it has what was chosen alone. To keep one of all, type --out DIR.")
    return FinishedResiduals.written(folder, record, figures, watching, run=loaded_run, analyses=analyses)
