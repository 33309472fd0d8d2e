"""Profiles of unknowns with their folder: ``fracid profile``, to be called from Python too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

from fracid.arrays import FloatArray
from fracid.errors import DataError, Failure, FailureReason, InputError, writing
from fracid.estimation.agreement import spread
from fracid.estimation.block_bootstrap import Bootstrap, bootstrap
from fracid.estimation.cost_profile import CostAtBest, Profiles, profile
from fracid.estimation.covariance import METHODS, Known, uncertainty
from fracid.estimation.likelihood_record import Likelihood
from fracid.estimation.long_records import as_fitted, is_coarse, on_all_samples
from fracid.estimation.parameter_verdicts import Verdict, identifiability
from fracid.identification import identify
from fracid.problem import Problem
from fracid.runs.folder import MEMO
from fracid.runs.saved import SavedRun
from fracid.safety.schema import as_json
from fracid.tasks.display import unless_given
from fracid.tasks.folder_lock import FolderLock
from fracid.tasks.job import one_blas_thread
from fracid.tasks.progress import Observer
from fracid.tasks.simulation_cache import Memo
from fracid.workflows.study import Finished, folder_of, run_or_project


@dataclass(frozen=True, repr=False)
class FinishedProfiles(Finished):
    """Profiles with what stands beside them, and their folder."""

    FILE, FOUND = "profiles.json", "profiles"

    profiles: Profiles
    bootstrap: Bootstrap | Failure
    """Or why there is none, in words."""
    verdicts: Mapping[str, Verdict]


def run_profiles(
    source: str | Path,
    *,
    parameters: Sequence[str] | None = None,
    joint: tuple[str, str] | None = None,
    points: int = 12,
    trust: bool = False,
    out: str | Path | None = None,
    seed: int = 1,
    jobs: int = 1,
    observer: Observer | None = None,
) -> FinishedProfiles:
    """Profile unknowns, look at them in every other way, and write it down: what ``fracid profile`` does.

    What was simulated stays in the folder until all is written, so that what was killed goes on by the same call.

    Parameters
    ----------
    source : str or Path
        A run folder; or a project file, which is fitted first.
    parameters, joint, points
        As of :func:`fracid.profile`.
    trust : bool
        Run Python code that the project refers to.  Review it first.
    out : str or Path, optional
        The folder; that of the run, ``runs/rig-profile`` of ``rig.toml`` if left out.
    seed : int
        Of the bootstrap.
    jobs : int
        Threads; the result is the same for any number.
    observer : Observer, optional
        Hears each stage as it begins.

    Raises
    ------
    InputError
        For a run, a project or an option that cannot be, and for a folder that cannot be written.
    DataError
        If no run of the model reaches the end of the recording.
    NotTrusted
        If the project names code of its own, and `trust` is not given.

    Examples
    --------
    >>> run_profiles("nowhere/rig.toml")
    Traceback (most recent call last):
    fracid.errors.InputError: There is no nowhere/rig.toml. ...
    """
    source = Path(source)
    folder = folder_of(source if out is None and source.is_dir() else out, source, "profile")
    watching = unless_given(observer)
    with one_blas_thread():
        fitted, x = _fitted(source, seed, jobs, trust, observer=watching)
    watching.stage("profiles")
    with writing(str(folder)):
        folder.mkdir(parents=True, exist_ok=True)
    with one_blas_thread(), FolderLock(folder), Memo(folder / MEMO) as memo:
        problem = as_fitted(replace(fitted, memo=memo), x)
        if is_coarse(problem):
            watching.notice(_note(problem))
        with watching.progress("points") as tell:
            found = profile(problem, x, parameters=parameters, joint=joint, points=points, jobs=jobs, progress=tell)
        x = found.x
        watching.stage("intervals")
        precision = uncertainty(problem, x, jobs=jobs)
        watching.stage("bootstrap")
        try:
            resampling = precision if isinstance(precision, Failure) else bootstrap(problem, x, seed=seed, jobs=jobs)
        except InputError as error:  # profiles need none
            resampling = Failure(FailureReason.REFUSED, str(error))
        watching.stage("identifiability")
        verdicts = identifiability(problem, x, precision, found.profiles, jobs=jobs)
        several = len(problem.recordings) > 1 and not isinstance(precision, Failure)
        likelihood = _on_every_sample(found, fitted)
        record = as_json(Likelihood, vars(likelihood) | {
            "intervals": _intervals(likelihood, precision, resampling),
            "identifiability": verdicts,
            "bootstrap": str(resampling) if isinstance(resampling, Failure) else resampling.to_json(),
            "spread": spread(problem, x, jobs=jobs) if several else None,
            "seed": seed,
        })  # fmt: skip
        finished = FinishedProfiles.written(folder, record, [("profiles", likelihood.plot)], watching,
                                            profiles=likelihood, bootstrap=resampling, verdicts=verdicts)  # fmt: skip
        memo.remove()
    return finished


def _note(problem: Problem) -> str:
    means = max(e.means for e in problem.experiments)
    return f"The recordings are long: they are profiled on means of {means} samples, as they were fitted."


def _on_every_sample(likelihood: Profiles, fitted: Problem) -> Profiles:
    """Profiles with the costs that their points have on all samples."""
    if not is_coarse(likelihood.problem):
        return replace(likelihood, problem=fitted)
    here, there = likelihood.cost, fitted.cost(likelihood.x)
    own = {n: replace(p, cost=on_all_samples(fitted, p.cost, here, there)) for n, p in likelihood.profiles.items()}
    notes = (*likelihood.notes, _note(likelihood.problem))
    at_best = CostAtBest(name=likelihood.at_best.name, value=there)
    return replace(likelihood, problem=fitted, at_best=at_best, profiles=own, notes=notes)


def _fitted(source: Path, seed: int, jobs: int, trust: bool, observer: Observer) -> tuple[Problem, FloatArray]:
    """A run's problem and its values; a project's, fitted now."""
    found = run_or_project(source, trust, observer)
    if isinstance(found, SavedRun):
        return found.problem, found.x
    fit = identify(found, seed=seed, jobs=jobs, observer=observer)
    if not isfinite(fit.cost):
        raise DataError(f"{source}: {' '.join(fit.warnings[-1:])} There is nothing to profile.")
    return fit.problem, fit.x


def _intervals(profiles: Profiles, uncertainties: Known, replicates: Bootstrap | Failure) -> dict[str, Any]:
    """Every unknown's intervals by every method that gave one."""
    rows: dict[str, dict[str, Any]] = {n: {} for n in profiles.problem.names}
    for i, name in enumerate(rows):
        if not isinstance(uncertainties, Failure):
            rows[name] |= {method: uncertainties.interval(profiles.x, i, method) for method in ("sandwich", "white")}
            rows[name]["effective_samples"] = uncertainties.effective_samples[i]
        if not isinstance(replicates, Failure) and rows[name]["sandwich"] is not None:
            rows[name]["bootstrap"] = replicates.interval(i)
        if name in profiles.profiles:
            rows[name]["profile"] = profiles.profiles[name].interval95
    return {"methods": {n: sentence for n, sentence in METHODS.items() if n != "walk"}, "unknowns": rows}
