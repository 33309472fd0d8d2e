"""The posterior of a run with its folder: ``fracid posterior``, to be called from Python too.

Every batch of simulations goes into the folder's journal as it ends, and the same call continues from there.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fracid.bayes.inference import DRAWS, posterior
from fracid.bayes.result import METHODS, Posterior
from fracid.errors import InputError, refuse_unknown, typed
from fracid.optimise.base import Outcome
from fracid.runs.saved import load_run
from fracid.tasks.display import unless_given
from fracid.tasks.job import one_blas_thread
from fracid.tasks.progress import Observer
from fracid.workflows.fit import SAYS
from fracid.workflows.records import command_of
from fracid.workflows.study import Finished, folder_of, journal_of, study_of

DRAWN = "draws.npz"


@dataclass(frozen=True, repr=False)
class FinishedPosterior(Finished):
    """A posterior with its folder."""

    FILE, FOUND = "posterior.json", "posterior"

    posterior: Posterior
    draws: Path
    """Path of draws.npz: ``points``, ``log_weights`` and ``names``."""


def run_posterior(
    run: str | Path,
    *,
    method: str = "laplace",
    draws: int = DRAWS,
    executor: str | None = None,
    trust: bool = False,
    out: str | Path | None = None,
    seed: int = 1,
    jobs: int = 1,
    observer: Observer | None = None,
    command: Sequence[str] | None = None,
) -> FinishedPosterior:
    """Draw the posterior of a run and write it down: what ``fracid posterior`` does.

    Parameters
    ----------
    run : str or Path
        The folder of a fit.
    method, draws
        As of :func:`fracid.posterior`.
    executor : str, optional
        ``threads`` if left out; ``processes``, or a scheduler's address.
    out : str or Path, optional
        The folder; ``posterior`` in that of the run if left out.
    seed : int
        Random seed.
    jobs : int
        Threads or processes; the result is the same for any number.
    trust, observer, command
        As of :func:`fracid.run`.

    Raises
    ------
    InputError
        For a run or an option that is not possible, a fit that was interrupted or has no intervals, and a folder that
        holds a fit or cannot be written.
    NotTrusted
        If the project names code of its own, and `trust` is not given.
    Unfinished
        Where something ended it early, Ctrl-C too; what was done is kept.

    Examples
    --------
    >>> run_posterior("nowhere/rig")
    Traceback (most recent call last):
    fracid.errors.InputError: There is no nowhere/rig. ...
    """
    run, watching = Path(run), unless_given(observer)
    refuse_unknown("method", METHODS, method)
    with one_blas_thread():
        saved = load_run(run, trust=trust)
        if saved.outcome in (Outcome.INTERRUPTED, Outcome.STOPPED):
            raise InputError(SAYS("no-minimum", run=run, typed=typed("fit", saved.project.path)))
        folder = folder_of(out, run, "posterior")
        options = {"method": method, "draws": draws, "executor": executor, "seed": seed, "trust": trust}
        words = command_of("posterior", run, {"out": out, **options}) if command is None else command
        study = study_of("posterior", saved.project, fit=saved.problem.named(saved.x))
        with journal_of(folder, study, _fault, watching, counted="simulations", command=words) as kept:
            place = executor or "threads"
            drawn = posterior(saved, method=method, draws=draws, seed=seed, jobs=jobs, executor=place, **kept)
    content = io.BytesIO()
    np.savez_compressed(content, points=drawn.points, log_weights=drawn.log_weights, names=np.array(drawn.names))
    pictures = ("posterior", drawn.plot), ("posterior-predictive", drawn.plot_predictive)
    return FinishedPosterior.written(folder, drawn.to_json() | {"source": str(run)}, pictures, watching,
                                     contents={DRAWN: content.getvalue()}, posterior=drawn,
                                     draws=folder / DRAWN)  # fmt: skip


def _fault(_key: str, values: Any) -> str:
    """What is wrong with a batch, as a line of the journal has it."""
    numbers = isinstance(values, list) and all(v is None or isinstance(v, float | int) for v in values)
    return "" if numbers else "expected a list of numbers"
