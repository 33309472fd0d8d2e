"""A Monte Carlo study of noise with its folder: ``fracid noise``, to be called from Python too.

The truth is what a run found, or what a project's search finds now.  Every repetition goes into the folder's journal
as it ends, and the same call goes on from there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import degrees, inf, nextafter, pi, radians
from pathlib import Path
from typing import Any

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.estimation.search import searched
from fracid.problem import Problem
from fracid.problem.project import Project
from fracid.runs.saved import SavedRun
from fracid.tasks.display import unless_given
from fracid.tasks.job import one_blas_thread
from fracid.tasks.progress import Observer
from fracid.tasks.tasks import Execution
from fracid.validation.monte_carlo import NoiseStudy, Plan, planned
from fracid.validation.study_records import fault_of_repetition
from fracid.workflows.figures import of_study
from fracid.workflows.records import command_of, csv_text
from fracid.workflows.study import Finished, folder_of, journal_of, run_or_project, study_of

TABLE = "noise.csv"

LEVELS, COUNTS = (0.05, 0.1, 0.2), (4096.0, 20000.0)
"""Of noise [°], and of an encoder's turn, if none are given and all outputs are angles."""

MULTIPLES = (0.5, 1.0, 2.0)
"""Of each output's residual, if not."""


@dataclass(frozen=True, repr=False)
class FinishedNoiseStudy(Finished):
    """A study of noise with its folder."""

    FILE, FOUND = "noise.json", "study"

    study: NoiseStudy
    table: Path
    """Path of noise.csv."""


def run_noise_study(
    source: str | Path,
    *,
    levels: Sequence[float] | None = None,
    resolutions: Sequence[float] | None = None,
    relative: bool = False,
    seeds: int = 50,
    cost: str | None = None,
    optimiser: str | None = None,
    executor: str | None = None,
    trust: bool = False,
    out: str | Path | None = None,
    seed: int = 1,
    jobs: int = 1,
    angles: bool = False,
    observer: Observer | None = None,
    command: Sequence[str] | None = None,
) -> FinishedNoiseStudy:
    """Identify a model's own noisy simulations many times, and write the folder: what ``fracid noise`` does.

    Interrupted, the same call resumes.

    Parameters
    ----------
    source : str or Path
        A run folder, whose values are the truth; or a project file, which is fitted first.
    levels, resolutions : sequence of float, optional
        Standard deviations of the noise, and steps of the encoders, 0 for none; in the outputs' own unit, as of
        :func:`fracid.noise_study`.  Left out, 0.05°, 0.1°, 0.2° with 4096 and 20000 counts a turn where all outputs are
        angles, else 0.5, 1 and 2, relative.
    relative : bool
        Whether both are multiples of the RMS of each output's residual.
    seeds : int
        Repetitions at each level with each encoder.
    cost, optimiser : str, optional
        In place of the run's.
    executor : str, optional
        ``processes`` if left out; ``threads``, which a model of your own needs; or a scheduler's address.
    out : str or Path, optional
        The folder; ``noise`` in that of the run, ``runs/rig-noise`` of ``rig.toml`` if left out.
    seed : int
        Random seed.
    jobs : int
        Processes or threads.
    angles : bool
        Whether both are what the command has: degrees and counts a turn where all outputs are angles, else multiples.
    trust, observer, command
        As of :func:`fracid.run`.

    Raises
    ------
    InputError
        For a run, a project or an option that cannot be, and for a folder that holds a fit or cannot be written.
    DataError
        If no run of the model reaches the end of the recording.
    NotTrusted
        If the project names code of its own, and `trust` is not given.
    Unfinished
        Where something ended it early, Ctrl-C too; what was done is kept.

    Examples
    --------
    >>> run_noise_study("nowhere/rig.toml")
    Traceback (most recent call last):
    fracid.errors.InputError: There is no nowhere/rig.toml. ...
    """

    def fault(_key: str, said: Any) -> str:
        return fault_of_repetition(said, truth.problem.names)

    source = Path(source)
    options = {"seeds": seeds, "cost": cost, "optimiser": optimiser, "executor": executor, "seed": seed}
    watching = unless_given(observer)
    with one_blas_thread():
        truth, project, x = _truth_of(source, jobs, trust, watching)
        grid = _grid(truth.problem, levels, resolutions, relative, angles=angles)
        words = _command(source, out, grid, options | {"trust": trust}) if command is None else command
        folder = folder_of(out, source, "noise")
        plan = planned(
            truth.problem, x, **grid, seeds=seeds, seed=seed, cost=cost,
            optimiser=optimiser or truth.optimiser, starts=project.starts,
        )  # fmt: skip
        watching.stage("repetitions")
        with journal_of(folder, _header(plan, project), fault, watching, counted="repetitions", command=words) as kept:
            watching.notices(plan.findings)
            study = plan.run(Execution(executor or ("threads" if plan.own else "processes"), jobs, **kept))
    return FinishedNoiseStudy.written(folder, study.to_json() | {"source": str(source)}, of_study(study), watching,
                                      contents={TABLE: csv_text(study.lines())}, study=study,
                                      table=folder / TABLE)  # fmt: skip


def _grid(
    problem: Problem, levels: Sequence[float] | None, resolutions: Sequence[float] | None, relative: bool, angles: bool
) -> dict[str, Any]:
    """Levels and resolutions as :func:`planned` takes them."""
    units = {o: e.units.get(o, "rad") for e in problem.experiments for o in problem.outputs}
    others = [f"{o} in {unit}" for o, unit in units.items() if unit != "rad"]
    if others and angles and any(resolutions or ()):
        raise InputError(f"--counts is of angles, and the recordings have {others[0]}: leave it out.")
    if others and (angles or levels is None):
        return {"levels": MULTIPLES if levels is None else levels, "resolutions": (0.0,), "relative": True}
    turns = COUNTS if resolutions is None else resolutions if angles else ()
    degrees = LEVELS if levels is None else levels if angles else ()
    return {"levels": [*map(radians, degrees)] or levels, "resolutions": [*map(_counts, turns)] or resolutions,
            "relative": relative}  # fmt: skip


def _command(source: Path, out: str | Path | None, grid: Mapping[str, Any], options: Mapping[str, Any]) -> list[str]:
    levels, resolutions = grid["levels"], grid["resolutions"]
    words = {
        "levels": ",".join(f"{v:g}" if grid["relative"] else _decimal(v, degrees, radians) for v in levels),
        "counts": None if grid["relative"] else ",".join(_decimal(step, _counts, _counts) for step in resolutions),
    }
    return command_of("noise", source, {"out": out, **words, **options})


def _counts(step: float) -> float:
    """Counts a turn from the step [rad], and the step from the counts; 0 is no rounding."""
    return 2 * pi / step if step else 0.0


def _decimal(value: float, there: Callable[[float], float], back: Callable[[float], float]) -> str:
    """The number in the unit of the command; one that is read back to the last bit, where there is one."""
    near = there(value)
    candidates = (float(f"{near:.15g}"), near, nextafter(near, 0), nextafter(near, inf))
    return repr(next((c for c in candidates if back(c) == value), near)).removesuffix(".0")


# ------------------------------------------------------------------ the truth


def _truth_of(
    source: Path, jobs: int, trust: bool, observer: Observer
) -> tuple[SavedRun | Project, Project, FloatArray]:
    """A run with its project and its values; a project with those that its search comes to."""
    found = run_or_project(source, trust, observer)
    if isinstance(found, SavedRun):
        return found, found.project, found.x
    observer.stage("search")
    return found, found, searched(found, "simulate", jobs)


# ------------------------------------------------------------------ the study


def _header(plan: Plan, project: Project) -> dict[str, Any]:
    """All that a repetition depends on beside its key, so that more levels or seeds go on from what there is."""
    settings = {name: plan.how[name] for name in ("optimiser", "starts", "sizes") if plan.how[name] is not None}
    method = f"{plan.problem.method}, {plan.problem.memory.name}, {plan.problem.substeps}"
    return study_of("noise", project, truth=plan.problem.named(plan.truth), method=method,
                    cost=plan.problem.cost_function.name, seed=plan.seed, **settings)  # fmt: skip
