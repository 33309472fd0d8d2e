"""Find the free orders, constants and initial states of a problem: strategies, and their result, a Fit.

By default it searches by ``multistart``: least squares from the start, on a horizon that grows to the whole record
(against local minima that are a whole swing off); with ``starts`` > 1 from the regression's start and from Sobol points
too (:mod:`fracid.estimation.search`).  :data:`fracid.optimise.OPTIMISERS` has the others; from the best point of most
that take no derivatives least squares goes on.

Before the search it looks for faults of the data and of the project that would make it find nothing that means
anything (:mod:`fracid.validation.before_search`).  Whatever found the minimum,
:mod:`fracid.identification.examination` goes through it step by step: its step and intervals, what the data can tell
of it, held-out recordings, models of integer order, the claim.  :mod:`fracid.identification.result` makes a Fit of
what was found.

Ctrl-C keeps the best so far: in the search it skips the examination, in a step of that what is left of it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure, FailureReason, InputError, at_least, brief
from fracid.estimation.covariance import uncertainty
from fracid.estimation.horizons import Watch, refined
from fracid.estimation.long_records import coarse_problem
from fracid.estimation.minimum import Minimum
from fracid.estimation.search import search
from fracid.estimation.windows import beginning, chosen_window, lengthened, windowed
from fracid.findings import Finding
from fracid.fit import Fit
from fracid.identification.examination import SAYS, Examination, Setting
from fracid.identification.result import as_fit
from fracid.optimise import Entry, Evaluation, EvaluationLog, Outcome, Told, optimiser_from_name
from fracid.problem import Experiment, Problem
from fracid.problem.checks import refuse_twins
from fracid.problem.project import Project
from fracid.selection.integer_alternatives import LEAST, TIMES
from fracid.tasks.display import unless_given
from fracid.tasks.job import Progress, one_blas_thread
from fracid.tasks.journal import Journal
from fracid.tasks.progress import Observer
from fracid.tasks.simulation_cache import Memo
from fracid.tasks.tasks import executor_from_name
from fracid.validation.before_search import before
from fracid.validation.discretisation import Discretisation, Refined, discretisation_check, finer_step
from fracid.validation.unknown_past import whole_records


def identify(
    problem: Problem | Project,
    *,
    optimiser: str | None = None,
    validation: tuple[Experiment, ...] = (),
    seed: int | None = None,
    jobs: int = 1,
    starts: int | None = None,
    log: EvaluationLog | None = None,
    callback: Told | None = None,
    cut: bool = False,
    executor: str = "threads",
    journal: Journal | None = None,
    memo: Memo | None = None,
    seen: tuple[Finding, ...] | None = None,
    options: Mapping[str, Any] | None = None,
    alternatives: Mapping[str, Problem] | None = None,
    fixed_step: bool | None = None,
    observer: Observer | None = None,
) -> Fit:
    """Identify the unknowns of a problem.

    Parameters
    ----------
    problem : Problem or Project
        A project brings its own validation recordings, optimiser and seed.
    optimiser : str, optional
        See the module's table; the default is ``multistart``.
    validation : tuple of Experiment
        Held-out recordings: their own unknowns are found again, the rest is fixed.
    seed : int, optional
        Of every random choice; 1 by default.
    jobs : int
        Threads; the result is the same for any number.
    starts : int, optional
        Starts of ``multistart``, 1 by default or as the project says: the given one, the
        regression's where it applies, Sobol points.
    log : EvaluationLog, optional
        Gets each evaluation as it ends.
    callback : function (best evaluation so far, number of evaluations) -> None
        Called after each batch of the search; the cost is infinite as long as a part of the record is fitted.
    cut : bool
        Also find how far the orders move with where the record begins: about as many more searches as there are
        treatments of its past (:func:`fracid.cut_check`).
    executor, journal
        Where many starts run, and what keeps each as it ends; see :func:`fracid.tasks.tasks.run_tasks`.
    memo : Memo, optional
        Keeps what the search and what follows it simulate.  A fit in a folder has one, and a run that goes alone is off
        one beside others by a last bit (:mod:`fracid.solver.lanes`): of a point that recurs, its first run is taken.
    seen : tuple of Finding, optional
        What :func:`fracid.validation.before_search.before` found; asked for if left out.
    options : mapping
        Passed on to the optimiser.
    alternatives : mapping, optional
        Models of integer order on the same recordings with which the orders are compared, by name; a project has its
        own, ``[[alternative]]``.
    fixed_step : bool, optional
        Whether the step stays as it is; else it is halved until the discretisation check is quiet.  A problem's
        stays if nothing is said, a project's where it says ``substeps``.  Intervals allow for what a step moves.
    observer : Observer, optional
        Hears each stage as it begins, and how far the search is; in a notebook it is shown if left out.

    Returns
    -------
    Fit
        Also where the search was interrupted (Ctrl-C): the best so far.

    Raises
    ------
    InputError
        For an unknown optimiser, or bounds that it cannot do with.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=2e-3, end=4.0)
    >>> swing = Experiment("twin", 2e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> fit = identify(Problem(rig, (swing,), {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}))
    >>> round(fit.orders["lambda"].value, 4), round(fit.orders["mu"].value, 4)
    (0.9, 0.95)
    """
    project: Project | None = None
    if not isinstance(problem, Problem):
        if not hasattr(problem, "problem"):
            raise InputError(SAYS("no-problem", problem=brief(problem)))
        if validation:
            raise InputError('validation is for a Problem; a project has its own, by use = "validate".')
        project = problem
        problem, validation, alternatives = project.problem, project.validation, alternatives or project.alternatives
        optimiser = optimiser or project.optimiser
        seed, starts = (project.seed if seed is None else seed), (project.starts if starts is None else starts)
    seed = at_least("seed", 1 if seed is None else seed, 0, 2**63 - 1)
    refuse_twins(e.name for e in (*problem.experiments, *validation))
    executor_from_name(executor)
    entry = optimiser_from_name(optimiser or "multistart")
    fixed_step = (project is None or project.fixed_step) if fixed_step is None else fixed_step
    whole = whole_records(project) if cut and project is not None else {}
    reports = None if project is None else {r.name: r.report for r in project.recordings}
    rng, options, starts = np.random.default_rng(seed), dict(options or {}), 1 if starts is None else starts
    watching = unless_given(observer)
    stages = list[tuple[str, float]]()

    def begin(stage: str, key: str) -> None:
        watching.stage(stage)
        stages.append((key, time.perf_counter()))

    with one_blas_thread():  # sums split over threads round differently
        begin("checks of the data", "look")
        if seen is None:
            seen = before(problem, reports, validation=validation, fixed_step=fixed_step, jobs=jobs)
        begin("search", "search")
        given, problem = problem, problem if memo is None else replace(problem, memo=memo)
        window = None if entry.keeps_its_own else chosen_window(problem)
        checked: Discretisation | None = None
        with _counted(problem, entry, watching, callback) as tell:
            watch = Watch(jobs, log, tell)
            run = partial(search, optimiser=entry, rng=rng, starts=starts, watch=watch, options=options,
                          executor=executor)  # fmt: skip
            if not window:
                work = problem if entry.keeps_its_own else coarse_problem(problem)
                result, attempts = run(work, journal=journal)
                unasked = entry.keeps_its_own or result.interrupted
                window = None if unasked else chosen_window(problem, result.best.point)
                journal = None  # it has the starts of this search
            if window:  # known at the start, or at the minimum alone: a model that is far off may fall, its rig stand
                work, problem = beginning(problem, window, fixed_step), windowed(problem, window)
                result, attempts = run(work, journal=journal)
            if window and not result.interrupted:
                work, at, checked = _lengthened(work, result.best.point, problem, fixed_step, jobs=jobs)
                result, attempts = refined(work, at, watch), ()
                checked = checked.on_all_samples(work, checked.cost, result.best.cost)
        minimum = Minimum(work, result.best, problem.substeps, INTERRUPTED)
        allowed = max(TIMES * watch.work, LEAST)
        setting = Setting(problem, window, entry, seed, starts=starts, attempts=attempts, allowed=allowed, jobs=jobs,
                          alternatives=alternatives or {}, fixed_step=fixed_step, findings=tuple(seen),
                          validation=validation, whole=whole if cut else None, observer=watching)  # fmt: skip
        found = Examination(setting, minimum, result.outcome, checked)
        if not result.interrupted:
            found.examine(begin)
        found.at.problem.last_derivatives.clear()  # some hundred megabytes
        if found.outcome is Outcome.INTERRUPTED:
            watching.interrupted()
        begin("", "")
        timing = dict.fromkeys((key for key, _ in stages[:-1]), 0.0)
        for (key, begun), (_, end) in pairwise(stages):
            timing[key] += end - begun
        fit = as_fit(found, watch.count, timing)
        return fit if memo is None else replace(fit, problem=replace(fit.problem, memo=given.memo))


@contextmanager
def _counted(problem: Problem, entry: Entry, observer: Observer, callback: Told | None) -> Iterator[Told]:
    """Evaluations, time and the best cost so far, for an observer; and for the caller's own callback."""
    start_time = time.perf_counter()
    units = {e.units.get(n, "rad") if e.deviation is None else "" for e in problem.experiments for n in problem.outputs}
    unit = units.pop() if problem.cost_function.name == "rmse" and len(units) == 1 else ""
    with observer.progress("evaluations") as tell:

        def count(best: Evaluation, evaluations: int) -> None:
            if callback is not None:
                callback(best, evaluations)
            if tell is not None:
                seconds, finite = time.perf_counter() - start_time, math.isfinite(best.cost)
                tell(Progress(evaluations, entry.evaluations, 0, seconds, best=best.cost if finite else None, unit=unit,
                              note="" if finite else best.reason))  # fmt: skip

        yield count


INTERRUPTED = Failure(FailureReason.INTERRUPTED, "the search was interrupted")


def _lengthened(
    parts: Problem, x: FloatArray, whole: Problem, fixed_step: bool, jobs: int
) -> tuple[Problem, FloatArray, Discretisation]:
    """A problem in windows, and where to begin, from the minimum of that in parts of them.

    Its step is checked and chosen there: at a window's end what half a step changes has grown, and led elsewhere.
    """
    at = Minimum(parts, parts.evaluate(x), parts.substeps, uncertainty(parts, x, jobs=jobs))
    begun = Refined(at, discretisation_check(parts, x, at.uncertainty, jobs))
    at, check = begun if fixed_step else finer_step(begun, jobs) or begun
    whole = replace(whole, substeps=at.problem.substeps)
    return whole, lengthened(at.problem, at.x, whole), check
