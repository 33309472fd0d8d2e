"""A controller of a run with its folder: ``fracid control``, to be called from Python too.

Every trial goes into the folder's journal as it ends, and the same call continues from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fracid.errors import InputError, typed
from fracid.export.identified import columns_of
from fracid.feedback.code import c_controller
from fracid.feedback.study import DRAWS, Control, planned
from fracid.recording.readers.numpy_files import read_npz
from fracid.report.scene import scene_moving
from fracid.runs.folder import FIGURES
from fracid.runs.saved import load_run
from fracid.safety.door import write_files
from fracid.safety.schema import fault_of
from fracid.schemas.feedback import Trial
from fracid.tasks.display import unless_given
from fracid.tasks.job import one_blas_thread
from fracid.tasks.progress import Observer
from fracid.workflows.posterior_draws import DRAWN
from fracid.workflows.records import command_of
from fracid.workflows.study import Finished, folder_of, journal_of, study_of

CODE = "controller.c"


@dataclass(frozen=True, repr=False)
class FinishedControl(Finished):
    """A controller with its folder."""

    FILE, FOUND = "control.json", "control"

    control: Control


def run_control(
    run: str | Path,
    *,
    draws: int = DRAWS,
    posterior: bool = False,
    trust: bool = False,
    out: str | Path | None = None,
    seed: int = 1,
    jobs: int = 1,
    observer: Observer | None = None,
    command: Sequence[str] | None = None,
    **loop: Any,
) -> FinishedControl:
    """Design a controller of a run and write it down: what ``fracid control`` does.

    Parameters
    ----------
    run : str or Path
        The folder of a fit.
    draws, seed, jobs
        As of :func:`fracid.control`.
    posterior : bool
        Take the draws of ``fracid posterior``, in the folder ``posterior`` of the run.
    out : str or Path, optional
        The folder; ``control`` in that of the run if left out.
    trust, observer, command
        As of :func:`fracid.run`.
    **loop
        What else :func:`fracid.control` takes: posture, at, ``input_``, limit, rate, delay, off, within, seconds.

    Raises
    ------
    InputError
        As of :func:`fracid.control`, and for a folder that holds a fit or cannot be written.
    NotTrusted
        If the project names code of its own, and `trust` is not given.
    Unfinished
        Where something ended it early, Ctrl-C too; what was done is kept.

    Examples
    --------
    >>> run_control("nowhere/rig")
    Traceback (most recent call last):
    fracid.errors.InputError: There is no nowhere/rig. ...
    """
    run, watching = Path(run), unless_given(observer)
    with one_blas_thread():
        fit = load_run(run, trust=trust)
        folder, points = folder_of(out, run, "control"), None
        if posterior:
            if not (run / "posterior" / DRAWN).exists():
                raise InputError(f"There are no draws of {run} yet; type {typed('posterior', run)}.")
            drawn = read_npz(run / "posterior" / DRAWN)
            weights = np.exp(np.asarray(drawn["log_weights"], float))
            chosen = np.random.default_rng(seed).choice(len(weights), draws, p=weights / weights.sum())
            points = np.asarray(drawn["points"], float)[chosen]
        plan = planned(fit, draws=draws, points=points, seed=seed, jobs=jobs, **loop)
        options = {"draws": draws, "posterior": posterior, "trust": trust, "seed": seed, **loop}
        words = command_of("control", run, {"out": out, **options}) if command is None else command
        study = study_of("control", fit.project, fit=fit.problem.named(fit.x))
        with journal_of(
            folder, study, lambda _, trial: fault_of(trial, Trial), watching, counted="trials", command=words
        ) as kept:
            found = plan.run(jobs=jobs, **kept)
        scene = fit.problem.model.scene
        moving = {} if scene is None else {"motion.svg": scene_moving(scene, *found.worst_motion())}
        motion = write_files(folder / FIGURES, moving)
        code = {CODE: c_controller(found, columns_of(fit))}
        finished = FinishedControl.written(folder, found.to_json() | {"source": str(run)}, [("control", found.plot)],
                                           watching, contents=code, control=found)  # fmt: skip
        return replace(finished, figures=(*finished.figures, *motion))
