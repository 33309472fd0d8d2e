"""Find the free orders, constants and initial states of a problem: strategies, and their result, a Fit.

By default it searches by ``multistart``: least squares from the start, on a horizon that grows to the whole record
(against local minima that are a whole swing off); with ``starts`` > 1 from the regression's start and from Sobol points
too (:mod:`fracid.estimation.search`).  :data:`fracid.optimise.OPTIMISERS` has the others; from the best point of most
that take no derivatives least squares goes on.

Where a search ends at a bound beyond which a parameter means as much as before, it goes on there if that is worth it
(:mod:`fracid.selection.opened_bounds`).

Before the search it looks for faults of the data and of the project that would make it find nothing that means
anything (:mod:`fracid.validation.before_search`).  Whatever found the minimum, :func:`identify` then

1. measures the uncertainty of every unknown (:mod:`fracid.estimation.covariance`) and says in words what the data can
   tell of it (:func:`fracid.identifiability`),
2. finds each validation recording's own unknowns again (initial state, `per_recording`), all else fixed,
3. makes the *discretisation check*: the score at half the step and with the second-order method, and how
   far the orders move when they are refined there: a scheme that manufactures fractional orders shows; where a project
   does not say its ``substeps`` the step is halved, before all this, until the check is quiet,
4. fits each of several recordings alone: do they agree within their intervals (:func:`fracid.spread`)?
5. goes on by least squares from the best of an optimiser that keeps its own, as the genetic algorithm does, and says so
   where that finds better (the result of the others without derivatives is polished already),
6. fits what of integer order may explain the recordings as well, where orders were found off 1
   (:mod:`fracid.selection.integer_alternatives`), and says what is claimed (:mod:`fracid.selection.claim`),
7. where it is asked to, finds how far the orders move with where the record begins
   (:mod:`fracid.validation.unknown_past`).

Ctrl-C keeps the best so far: in the search it skips the seven, in one of them what is left of them.
"""

from __future__ import annotations

import math
import re
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.cards import listed
from fracid.errors import Failure, FailureReason, InputError, at_least, brief
from fracid.estimation.agreement import Spread, spread
from fracid.estimation.climbing import embedded
from fracid.estimation.covariance import OF_FITS, Uncertainty, half_width, uncertainty
from fracid.estimation.curvature import curvature, newton_step
from fracid.estimation.drift import drift_of
from fracid.estimation.horizons import Watch, from_start, growing, lowest_from, refined, uninterrupted
from fracid.estimation.interval_walk import walked
from fracid.estimation.long_records import (
    TO_COMPARE,
    as_fitted,
    coarse_problem,
    corrected,
    is_coarse,
    like,
    on_all_samples,
    on_every_sample,
    own_substeps,
    part_of,
    some_of,
)
from fracid.estimation.minimum import settled
from fracid.estimation.other_minimum import as_good_elsewhere, with_another
from fracid.estimation.parameter_verdicts import Verdict, identifiability
from fracid.estimation.records import Estimate, Estimates, OrderEstimate, RecordingFit, fit_of
from fracid.estimation.search import search
from fracid.estimation.starts import Start, won
from fracid.estimation.tangent import Tangent, tangent
from fracid.estimation.windows import beginning, chosen_window, closes_a_loop, lengthened, prediction_of, windowed
from fracid.findings import Finding, Note, Words
from fracid.fit import PARTIAL, CostBlock, Fit, ModelBlock
from fracid.optimise import Entry, Evaluation, EvaluationLog, Outcome, optimiser_from_name
from fracid.problem import Experiment, Free, Problem, Unknown
from fracid.problem.checks import refuse_twins
from fracid.problem.project import Project
from fracid.safety.door import own_text
from fracid.selection.claim import FLOOR, Claim, claim_of, no_run, orders_found
from fracid.selection.fractional_element import fractional_element
from fracid.selection.integer_alternatives import LEAST, SAME, TIMES, integer_alternatives
from fracid.selection.integer_rival import Alternative, beside_fit, claimable_values, integer_values
from fracid.selection.opened_bounds import LOWER, open_bounds, opened_bounds, reopened
from fracid.selection.residual_noise import leftovers
from fracid.signals.left_over import LeftOver
from fracid.solver.methods import METHODS
from fracid.tasks.display import unless_given
from fracid.tasks.job import Progress, one_blas_thread
from fracid.tasks.journal import Journal
from fracid.tasks.progress import Observer
from fracid.tasks.tasks import executor_from_name
from fracid.units import letter, with_half_width
from fracid.validation.after_search import after, between_samples, failed, hidden_starts, with_start
from fracid.validation.before_search import before
from fracid.validation.discretisation import (
    COARSE_STEP,
    LOST,
    Discretisation,
    Refined,
    coarse_step,
    discretisation_check,
    finer_step,
    halved,
    is_rough,
)
from fracid.validation.misfits import cost_of, misfits, missed
from fracid.validation.unknown_past import CutCheck, cut_check, whole_records

SAYS = Words("identification.toml")


def identify(
    problem: Problem | Project,
    *,
    optimiser: str | None = None,
    validation: tuple[Experiment, ...] = (),
    seed: int | None = None,
    jobs: int = 1,
    starts: int | None = None,
    log: EvaluationLog | None = None,
    callback: Callable[[Evaluation, int], None] | None = None,
    cut: bool = False,
    executor: str = "threads",
    journal: Journal | None = None,
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
    seen : tuple of Finding, optional
        What :func:`fracid.validation.before_search.before` found; asked for if left out.
    options : mapping
        Passed on to the optimiser.
    alternatives : mapping, optional
        Models of integer order on the same recordings with which the orders are compared, by name; a project has its
        own, ``[[alternative]]``.
    fixed_step : bool, optional
        Whether the step stays as it is; else it is halved until the discretisation check is quiet.  A problem's
        stays if nothing is said, a project's where it says ``substeps``.
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
        window = None if entry.keeps_its_own else chosen_window(problem)
        work = beginning(problem, window, fixed_step) if window else problem
        work = work if window or entry.keeps_its_own else coarse_problem(problem)
        problem = windowed(problem, window) if window else problem
        checked: Discretisation | None = None
        with _counted(work, entry, watching, callback) as tell:
            watch = Watch(jobs, log, tell)
            result, attempts = search(work, entry, rng, starts=starts, watch=watch, options=options,
                                      executor=executor, journal=journal)  # fmt: skip
            if window and not result.interrupted:
                work, at, checked = _lengthened(work, result.best.point, problem, fixed_step, jobs=jobs)
                result, attempts = refined(work, at, watch), ()
                checked = checked.on_all_samples(work, checked.cost, result.best.cost)
        asked = _Asked(problem, window, entry, seed, starts=starts, alternatives=alternatives or {},
                       fixed_step=fixed_step, seen=tuple(seen), validation=validation, whole=whole if cut else None,
                       jobs=jobs, observer=watching)  # fmt: skip
        allowed = max(TIMES * watch.work, LEAST)
        found = _Findings(asked, work, result.best, result.outcome, starts=attempts, allowed=allowed, check=checked,
                          seen=[*seen], substeps=problem.substeps)  # fmt: skip
        if not result.interrupted:
            found.examine(begin)
        found.problem.last_derivatives.clear()  # some hundred megabytes
        if found.outcome is Outcome.INTERRUPTED:
            watching.interrupted()
        begin("", "")
        timing = dict.fromkeys((key for key, _ in stages[:-1]), 0.0)
        for (key, begun), (_, end) in pairwise(stages):
            timing[key] += end - begun
        return _fit(found, watch.count, timing)


@contextmanager
def _counted(
    problem: Problem, entry: Entry, observer: Observer, callback: Callable[[Evaluation, int], None] | None
) -> Iterator[Callable[[Evaluation, int], None]]:
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
NOT_FITTED = Failure(FailureReason.NO_FIT, "the model does not fit")


RESTARTS = 3
"""From a model that costs less."""

NESTED: Mapping[str, Any] = {"tolerance": 1e-3, "budget": 5}
"""Least squares of the nested model from the fit."""

ELSEWHERE = 0.25
"""Of the work of a stage after the search: to look for another minimum."""

NO_CLAIM = Claim("undecided", ("The fit was not examined to its end.",))


@dataclass(frozen=True)
class _Asked:
    """What the steps after the search are given beside the minimum."""

    problem: Problem
    """On every sample of its recordings, or of their windows."""
    window: float | None
    """Seconds of a window, where the recordings are fitted in windows."""
    optimiser: Entry
    seed: int
    starts: int
    """Of a search."""
    alternatives: Mapping[str, Problem]
    """Models of integer order that the user names."""
    fixed_step: bool
    """Whether the step stays as it is."""
    seen: tuple[Finding, ...]
    """Before the search."""
    validation: tuple[Experiment, ...]
    whole: Mapping[str, Experiment] | None
    """Recordings with what came before their start; None where that is not asked."""
    jobs: int
    observer: Observer


@dataclass
class _Findings:
    """What is known of a minimum so far; Ctrl-C may end the examination at any point."""

    asked: _Asked
    problem: Problem
    best: Evaluation
    outcome: Outcome
    starts: tuple[Start, ...]
    allowed: float
    """The work of a stage after the search, at most."""
    check: Discretisation | None
    seen: list[Finding]
    substeps: int
    """Steps of a sample; of coarser recordings of one of their source."""
    known: Uncertainty | Failure = INTERRUPTED
    near: Tangent | None = None
    """Errors and derivatives at the minimum."""
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)
    validated: dict[str, RecordingFit] = field(default_factory=dict)
    spread: Spread | None = None
    left: Mapping[str, LeftOver] = field(default_factory=dict)
    """What the model leaves of each output: of one that does not fit, intervals mean nothing."""
    alternative: Alternative | None = None
    claim: Claim = NO_CLAIM
    cut: CutCheck | Failure | None = None
    warnings: list[str] = field(default_factory=list)
    restarts: int = 0
    """How often a model that is nested in the fit, or its alternative, led to a lower cost."""
    within: tuple[Problem, float] | None = None
    """The problem with its own bounds and its cost there, where some were opened."""

    @property
    def x(self) -> FloatArray:
        """The minimum, shape (n_unknowns,)."""
        return self.best.point

    @property
    def sampled(self) -> Problem:
        """The problem on every sample."""
        return on_every_sample(self.problem, replace(self.asked.problem, substeps=self.substeps))

    @property
    def cost(self) -> float:
        """Of the minimum on every sample."""
        return self.sampled.cost(self.x) if is_coarse(self.problem) else self.best.cost

    def _at_its_step(self, check: Discretisation) -> Refined:
        return Refined(self.problem, self.substeps, self.best, self.known, check, near=self.near)

    def examine(self, begin: Callable[[str, str], None]) -> None:
        """Take the steps after the search, each told, from the first again where one of them sees a lower minimum."""
        if not np.isfinite(self.best.cost):
            self.known, self.claim = Failure(FailureReason.RUN, "every run failed"), no_run()
            self.warnings.append(f"No run reached its end: {self.best.reason}.")
            self.seen += failed(self.problem, self.x)
            return
        steps, done = STEPS if self.asked.whole is None else (*STEPS, WHERE_IT_BEGINS), 0
        try:
            while done < len(steps):
                stage, key, step = steps[done]
                begin(stage, key)
                lower, done = step(self), done + 1
                if lower is not None and self.restarts < RESTARTS:  # what was said of the former one is forgotten
                    self.best, self.seen, self.warnings, self.validated = lower, [*self.asked.seen], [], {}
                    self.restarts, done = self.restarts + 1, 0
        except KeyboardInterrupt:
            self.outcome = Outcome.INTERRUPTED

    def correct(self) -> None:
        """Give long records, searched with coarse steps, the residuals of their own."""
        if not is_coarse(self.problem):
            return
        exact = corrected(self.problem, self.x, own_substeps(self.problem, self.substeps), self.asked.jobs)
        if isinstance(exact, Failure) or exact[1].cost > LOST * self.best.cost:  # coarse steps led elsewhere
            sampled = self.sampled
            exact = sampled, uninterrupted(growing(sampled, self.x, Watch(self.asked.jobs))).best
        self.problem, self.best = exact

    def open_bounds(self) -> None:
        """Go on beyond the bounds that stop the search, where that is worth it."""
        if self.asked.optimiser.keeps_its_own:
            return
        wider, lower = open_bounds(self.problem, self.best, jobs=self.asked.jobs)
        if wider is not self.problem:
            self.within = self.within or (self.problem, self.best.cost)
            self.problem, self.best = wider, lower

    def show(self) -> None:
        """The recordings beside their simulations, to who would draw them while the rest is examined."""
        if (draw := self.asked.observer.recordings) is not None:
            problem = self.sampled
            estimates = _estimates(problem, self.x, self.known, self.verdicts)
            fitted = {n: _recording(problem, self.x, estimates, n, use="fit") for n in problem.recordings}
            draw(fitted | self.validated)

    def settle(self) -> None:
        """Go on to the minimum itself, and find what is known there."""
        problem, asked, self.near = self.problem, self.asked, None
        if problem.cost_function.loss is not None and problem.blocks is None and problem.names and not asked.window:
            own = asked.optimiser.keeps_its_own
            found = (tangent if own else settled)(problem, self.x, jobs=asked.jobs)
            if isinstance(found, Tangent):
                self.near, self.best = found, self.best if own else found.evaluation
        known = uncertainty(problem, self.x, jobs=asked.jobs, near=self.near)
        self.known = with_start(problem, self.x, known, jobs=asked.jobs)
        if asked.window is not None and self.check is not None:  # that of the parts of the windows
            self.known = self.check.widened(problem, self.x, self.known)

    def walk(self) -> Evaluation | None:
        """Look off the tangent where intervals end; a point that is lower than the minimum, if one is seen."""
        self.show()
        while self._halve():  # bumps that the step makes are no valley
            pass
        found = self._walked(self.allowed / self.problem.simulator.work)
        if isinstance(found, Evaluation):
            return found
        self.known = found
        if not isinstance(found, Failure) and found.unwalked:
            self.warnings.append(SAYS("walk-cut", ends=found.unwalked))
        return None

    def _walked(self, most: float) -> Uncertainty | Failure | Evaluation:
        if self.near is None or isinstance(self.known, Failure) or self.asked.optimiser.keeps_its_own:
            return self.known
        return walked(self.near, self.known, most=most, jobs=self.asked.jobs)

    def _halve(self) -> bool:
        """Halve the step where the fit may choose it and a first look at the intervals sees its errors bend one.

        Gives whether it was halved.
        """
        fixed = self.asked.fixed_step or self.asked.window is not None or is_coarse(self.problem)
        if fixed or self.check is None or self.near is None or not is_rough(self.near, self.known):
            return False
        found = self._walked(1)
        if isinstance(found, Uncertainty) and not (found.unwalked or found.walked.any()):
            return False
        finer = halved(self._at_its_step(self.check), self.asked.jobs)
        if finer is None or finer.near is None or isinstance(finer.uncertainty, Failure):
            return False
        said = SAYS("halved", finer=finer, began=self.asked.problem.substeps)
        self._take(replace(finer, check=replace(finer.check, refinement=said)))
        return True

    def _take(self, finer: Refined) -> None:
        """Go on at a finer step, with derivatives of its own: those of the coarser one led there."""
        self.problem, self.substeps, self.check, self.best = finer.problem, finer.substeps, finer.check, finer.best
        self.settle()

    def with_quiet_step(self) -> None:
        """Check the step, and halve it until the check is quiet where it is the fit's to choose."""
        asked, problem, x = self.asked, self.problem, self.x
        if asked.window is not None:  # it was checked on parts of the windows
            return
        taken = self.check.refinement if self.check else ""
        check = discretisation_check(problem, x, self.known, asked.jobs, substeps=self.substeps, near=self.near)
        self.check = replace(check, refinement=taken)
        fixed = asked.fixed_step or asked.optimiser.keeps_its_own  # nor is what it found polished
        finer = None if fixed else finer_step(self._at_its_step(self.check), asked.jobs)
        if finer is not None:
            self._take(finer)
        if not fixed:  # what no finer step helped
            self.known = self.check.widened(self.problem, self.x, self.known)

    def allow_for_inputs(self) -> None:
        """Allow for what inputs do between their samples."""
        self.known, found, notes = between_samples(self.problem, self.x, self.known, jobs=self.asked.jobs)
        self.seen += found
        self.warnings += notes

    def look_elsewhere(self) -> Evaluation | None:
        """Look for another minimum that is as good, or lower."""
        problem, known = self.problem, self.known
        own = self.asked.optimiser.keeps_its_own or problem.cost_function.loss is None
        if own or isinstance(known, Failure) or self.asked.window is not None:
            return None
        ends = [embedded(problem, s.end) for s in self.starts]
        watch = Watch(self.asked.jobs, most=ELSEWHERE * self.allowed)
        there = as_good_elsewhere(problem, self.best, known, ends, watch=watch)
        if there is None:
            return None
        if there.cost < (1 - LOWER) * self.best.cost:
            return there
        self.known = with_another(problem, self.x, known, there.point)
        return None

    def identify(self) -> None:
        """Say of each unknown whether it is identifiable."""
        self.verdicts = identifiability(self.problem, self.x, self.known, jobs=self.asked.jobs)

    def look(self) -> Evaluation | None:
        """Look for faults; where the search stopped short, for a lower minimum too."""
        found = after(self.problem, self.x, self.known, jobs=self.asked.jobs, near=self.near)
        said = {"stopped-short"} if self.asked.optimiser.keeps_its_own else set[str]()  # the polishing says more
        said |= {"late"} if any(f.code == "between" for f in self.seen) else set()  # an input that is held is late
        self.seen += [f for f in found if f.code not in said]
        return self._onward() if self.restarts < RESTARTS else None

    def _onward(self) -> Evaluation | None:
        """Where a Newton step leads, and least squares from there, of a search that stopped short; None if not lower.

        Gauss and Newton's steps end where the residual bends more than they see: next to a friction that is dry.
        """
        if isinstance(self.known, Failure) or all(f.code != "stopped-short" for f in self.seen):
            return None
        parabola = curvature(self.problem, self.x, np.flatnonzero(~self.known.at_bound), jobs=self.asked.jobs)
        if isinstance(parabola, Failure):
            return None
        there = self.problem.evaluate(self.x + newton_step(self.problem, self.x, parabola)[0])
        lower = min(there, self._refined(self.problem, there.point), key=lambda e: e.cost)
        return lower if lower.cost < self.best.cost else None

    def _refined(self, problem: Problem, x: FloatArray, **options: Any) -> Evaluation:
        return lowest_from(problem, x, Watch(self.asked.jobs), **options)

    def predict(self) -> None:
        """Simulate what was held out; what is wrong with the step is known by now."""
        for e in self.asked.validation:
            self.validated[e.name], reason = _validate(self.sampled, self.x, e, self.asked.window, jobs=self.asked.jobs)
            self.warnings += [f"No run of the validation recording reached its end: {reason}."] if reason else []
        if self.asked.validation:
            self.show()
        if self.check is not None:
            self.warnings.append(Note(self.check.warning, COARSE_STEP))
            self.seen += coarse_step(self.problem, self.check)

    def fit_each(self) -> None:
        """Fit each recording alone."""
        if len(self.problem.recordings) > 1 and self.problem.cost_function.loss is not None:
            self.spread = spread(self.problem, self.x, jobs=self.asked.jobs)
            self.warnings += [Note(sentence, "spread") for sentence in self.spread.sentences]

    def polish(self) -> None:
        """Say what least squares finds from the best point of an optimiser that keeps its own.

        Where it lowers the cost by a part in a thousand, or moves an order by half its interval.
        """
        problem, before, at = self.problem, self.x, self.problem.order_indices
        if not self.asked.optimiser.keeps_its_own or problem.cost_function.loss is None:
            return
        polished = self._refined(problem, before)
        shifts = [abs(polished.point[i] - before[i]) > max(1e-3, 0.5 * half_width(self.known, before, i)) for i in at]
        if polished.cost <= 0.999 * self.best.cost or any(shifts):
            changes = ", ".join(f"{problem.unknowns[i].target} {before[i]:.4f} -> {polished.point[i]:.4f}" for i in at)
            changes = f" ({changes})" if changes else ""
            self.warnings.append(SAYS("stopped", best=self.best, polished=polished, changes=changes))

    def make_claim(self) -> None:
        """Look for what of integer order explains the recordings as well: slow ones where nothing else contradicts."""
        problem, best, asked = self.problem, self.best, self.asked
        part = some_of(part_of(problem))
        where, beside = self._cheaper(part)
        orders, left = orders_found(problem, best.point, self.known), leftovers(problem, best.point)
        self.left, noise = left, all(e.noise for e in left.values())
        contradictions = [f.note for f in (*self.seen, *self.missed())]
        undecided = claim_of(orders, None, left, contradictions).claim == "undecided"
        slow = any(order.least_damping > FLOOR for order in orders) and noise
        nearest = integer_alternatives(
            where, beside, {} if isinstance(self.known, Failure) else {order.name: order.half for order in orders},
            slow=slow and not contradictions and undecided,
            own={n: _beside(other, where) for n, other in asked.alternatives.items()},
            starts=asked.starts, seed=asked.seed, watch=Watch(asked.jobs, most=self.allowed),
        )  # fmt: skip
        goal = nearest.cost if nearest else None
        element = None if noise else fractional_element(where, beside, goal=goal, jobs=asked.jobs)
        cost, values = self.cost, claimable_values(problem, best.point)
        nearest = nearest and beside_fit(nearest, values, problem, beside.cost, cost)
        if element is not None:
            before, after = on_all_samples(problem, np.array([element.before, element.cost]), beside.cost, cost)
            element = replace(element, before=float(before), cost=float(after))
        restarts, self.alternative = not asked.optimiser.keeps_its_own, nearest
        self.claim = claim_of(orders, nearest, left, contradictions, element=element, restarts=restarts)
        if nearest is not None and self.claim.claim == "integer":
            self.warnings.append(nearest.warning)
        if nearest is not None and part is not problem:
            few, many = len(part.recordings), len(problem.recordings)
            end = max(float(e.time[-1]) for e in part.experiments)
            reason = SAYS("compared", end=end) if few == many else SAYS("compared-on", few=few, many=many, end=end)
            self.claim = replace(self.claim, reasons=(*self.claim.reasons, reason))

    def _cheaper(self, part: Problem) -> tuple[Problem, Evaluation]:
        """What the rivals are held against: part of the record at its minimum, at the search's step if that does."""
        problem, best, began = self.problem, self.best, self.asked.problem.substeps
        if part is not problem:
            return part, self._refined(part, embedded(part, problem.named(best.point)))
        own = self.asked.alternatives or self.asked.window is not None
        dense = problem if own else as_fitted(problem, best.point, TO_COMPARE)
        if dense is not problem:
            return dense, dense.evaluate(best.point)  # the residuals of its own steps
        if is_coarse(problem) or self.asked.window is not None or began == problem.substeps:
            return problem, best
        coarse = replace(problem, substeps=began)
        there = self._refined(coarse, best.point)
        return (coarse, there) if abs(there.cost - best.cost) <= SAME * best.cost else (problem, best)

    def missed(self) -> Iterator[Finding]:
        """Validation recordings that the model does not predict."""
        errors = self.problem.errors(self.x)
        if not isinstance(errors, Failure):
            raw = [e.in_units(r) for e, r in zip(self.problem.experiments, errors, strict=True)]
            outputs = enumerate(self.problem.outputs)
            rms = {n: max(float(np.sqrt(np.mean(e[:, k] ** 2))) for e in raw) for k, n in outputs}
            yield from missed(self.validated, rms)

    def from_nested(self) -> Evaluation | None:
        """A lower minimum by way of the integer-order model that is nested in the fit, or of its alternative; or None.

        Converged is only what nothing nested in it beats.
        """
        problem, best, nearest = self.problem, self.best, self.alternative
        if problem.cost_function.loss is None or not problem.order_indices or self.asked.optimiser.keeps_its_own:
            return None
        goal = (1 - LOWER) * best.cost
        if nearest is not None:
            values = nearest.values if nearest.cost < self.cost else {}
        elif all(e.explained for e in self.left.values()):  # noise alone cannot be fitted better
            return None
        else:
            integer = replace(problem, orders=integer_values(problem))
            end = self._refined(integer, embedded(integer, problem.named(best.point)), **NESTED)
            values = integer.named(end.point) | {
                n: v for n, v in integer.orders.items() if isinstance(v, float | int)
            } if end.cost < goal else {}  # fmt: skip
        if not values:
            return None
        as_found = {u.name: v for u, v in zip(problem.unknowns, best.point, strict=True) if u.target not in values}
        lower = self._refined(problem, embedded(problem, {**as_found, **values}))
        if not lower.cost < goal:
            return None
        self.outcome = Outcome.BUDGET_SPENT if self.restarts >= RESTARTS else self.outcome
        return lower

    def cut_record(self) -> None:
        """Find how far the orders move with where the record begins."""
        self.cut = cut_check(self.sampled, self.x, self.known, whole=self.asked.whole, jobs=self.asked.jobs)
        if isinstance(self.cut, Failure):
            self.warnings.append(f"The cut was not checked: {self.cut}.")
        else:
            self.warnings += [Note(sentence, "cut") for sentence in self.cut.warnings]


Step = Callable[[_Findings], Evaluation | None]
"""A step after the search; it gives a lower minimum where it sees one."""

*STEPS, WHERE_IT_BEGINS = (
    (row["told"], row["counted"], getattr(_Findings, name))
    for name, row in tomllib.loads(own_text("identification-steps.toml")).items()
)
"""What is told as a step begins, where its seconds count, and what it does, in this order; the last where it is asked
for."""


def _beside(other: Problem, problem: Problem) -> Problem:
    """Another model of the same recordings, or some of them, with as many steps and on as many samples."""
    same = tuple(e for e in other.experiments if e.recording.name in problem.recordings)
    other = replace(other, experiments=same)
    if is_coarse(problem):
        other = like(other, own_substeps(problem)).until(max(float(e.time[-1]) for e in problem.experiments))
    return replace(other, substeps=problem.substeps)


IMITATION = "may stand in for friction that the model lacks"
"""The verdict on orders whose integer-order rival, with more friction free, is as good."""

CHANCE = "not distinguishable from {:g} with these recordings"
"""The verdict on orders at whose integer value the same model is as good."""


def _fit(found: _Findings, evaluations: int, timing: Mapping[str, float]) -> Fit:
    asked, best, fits = found.asked, found.best, all(e.fits for e in found.left.values())
    opened = () if found.within is None else opened_bounds(*found.within, found.problem, best)
    precision = found.known if fits else NOT_FITTED
    searched = found.problem
    if found.within is not None:
        searched = replace(searched, parameters=reopened(found.within[0], opened).parameters)
    problem = on_every_sample(searched, found.sampled)
    model = problem.model
    estimates = _estimates(problem, best.point, found.known, found.verdicts)
    if not fits:  # the value, and the bound that it may lie at
        estimates = {n: e if not e.free or e.at_bound else Estimate(e.value, e.unit, True, identifiable="unknown")
                     for n, e in estimates.items()}  # fmt: skip
    cost, alternative, check = found.cost, found.alternative, found.check
    if math.isfinite(best.cost):
        check = check and check.on_all_samples(found.problem, best.cost, cost)
    if found.alternative is not None and found.alternative.warning and found.claim.claim == "integer":
        for n in found.alternative.orders:
            verdict = IMITATION if found.alternative.parameters else CHANCE.format(model.integer_order(n))
            estimates[n] = replace(estimates[n], identifiable=verdict, reason="")
    fitted = {n: _recording(problem, best.point, estimates, n, use="fit") for n in problem.recordings}
    cut = found.outcome is Outcome.INTERRUPTED
    coloured = [where for where, e in found.left.items() if e.coloured]
    hidden = partial(hidden_starts, problem, best.point)
    ended = () if cut else (*misfits(fitted, len(found.starts), coloured, hidden), *found.missed())
    later = (*found.seen[len(asked.seen) :], *ended)
    findings = [f for group in (asked.seen, later) for f in sorted(group, key=cost_of, reverse=True)]  # causes lead
    messages = (PARTIAL * cut, *(f.note for f in findings if f.code != COARSE_STEP), *(b.sentence for b in opened),
                *_warnings(problem, precision, found.verdicts), *found.warnings,
                *_followed(problem, best.point, asked.window))  # fmt: skip
    starts, warnings = found.starts, tuple(filter(None, messages))
    return Fit(
        problem=problem, x=best.point, evaluations=evaluations, seed=asked.seed, optimiser=asked.optimiser.name,
        outcome=found.outcome, method=problem.method, memory=problem.memory.name,
        step=problem.experiments[0].step / problem.substeps, substeps=problem.substeps,
        model=ModelBlock(name=model.name, zero=model.zero, source=model.source),
        minimised=CostBlock(name=problem.cost_function.name, value=cost, outputs=list(problem.outputs)),
        orders=Estimates({
            n: OrderEstimate(**vars(estimates[n]), integer=model.integer_order(n)) for n in problem.orders
        }),
        parameters=Estimates({n: estimates[n] for n in model.parameter_names if n in estimates}),
        recordings=fitted | found.validated, opened_bounds=opened,
        starts=starts, start_that_won=None if (lowest := won(starts)) is None else lowest.origin,
        alternative=alternative, spread=found.spread, window=asked.window,
        cut=found.cut if isinstance(found.cut, CutCheck) else None,
        discretisation=check, uncertainty=precision if isinstance(precision, Uncertainty) else None,
        interval_methods=OF_FITS if isinstance(precision, Uncertainty) else {},
        timing=timing,
        warnings=warnings, warning_codes=tuple(getattr(w, "code", "") for w in warnings), findings=tuple(findings),
        claim=found.claim.claim, claim_reasons=found.claim.reasons, claim_codes=found.claim.codes,
    )  # fmt: skip


def _lengthened(
    parts: Problem, x: FloatArray, whole: Problem, fixed_step: bool, jobs: int
) -> tuple[Problem, FloatArray, Discretisation]:
    """A problem in windows, and where to begin, from the minimum of that in parts of them.

    Its step is checked and chosen there: at a window's end what half a step changes has grown, and led elsewhere.
    """
    check = discretisation_check(parts, x, uncertainty(parts, x, jobs=jobs), jobs)
    begun = Refined(parts, parts.substeps, parts.evaluate(x), Failure(FailureReason.NO_FIT, ""), check)
    if not fixed_step and (finer := finer_step(begun, jobs)) is not None:
        parts, x, check = finer.problem, finer.best.point, finer.check
    whole = replace(whole, substeps=parts.substeps)
    return whole, lengthened(parts, x, whole), check


def _followed(problem: Problem, x: FloatArray, window: float | None) -> Iterator[str]:
    """For how long the model predicts recordings that were fitted in windows."""
    if window is not None:
        seconds, count = prediction_of(problem, x, window).seconds, len(problem.experiments)
        how_long = f"for longer than {seconds:.2g} s" if math.isfinite(seconds) else "to its end without a new start"
        apart = any(e.mask != problem.experiments[at][0].mask for e, at in problem.recordings.values())
        yield SAYS("windows", recordings=listed(problem.recordings), how_long=how_long, count=count, window=window,
                   apart=SAYS("apart") if apart else "")  # fmt: skip
        if loops := [n for n, (e, _) in problem.recordings.items() if closes_a_loop(e)]:
            yield SAYS("closed-loop", recordings=listed(loops))
        if (drift := drift_of(problem, x)) is not None:
            yield SAYS("drift", name=drift.name, rate=with_half_width(100 * drift.rate, 100 * drift.half))


# --- what the minimum says -------------------------------------------------------------------------


def _recording(problem: Problem, x: FloatArray, estimates: Mapping[str, Estimate], name: str, use: str) -> RecordingFit:
    """One recording beside its simulation, which is NaN where the run fails."""
    e = problem.experiments[problem.recordings[name][1]][0]
    begun = zip(problem.model.states, problem.unpack(x, e)[2].tolist(), strict=True)
    initial = {n: estimates.get(f"{n}(0) [{e.name}]", Estimate(value)) for n, value in begun}
    own = {n: estimates[f"{n} [{name}]"] for n in problem.own_parameters}
    if isinstance(e.release_time, Free):
        own["release_time"] = estimates[f"release_time [{e.name}]"]
    elif e.release_time:  # else it is the first sample
        own["release_time"] = Estimate(e.release_time, "s")
    return fit_of(problem, x, name, use, initial=initial, parameters=own)


def _validate(
    problem: Problem, x: FloatArray, e: Experiment, window: float | None, jobs: int
) -> tuple[RecordingFit, str]:
    """Find a recording's own unknowns, all that is shared fixed at x; in words why, where every run failed."""
    sampled = problem.with_shared(x, (e,))
    sampled = windowed(sampled, window) if window else sampled
    alone = sampled if window else coarse_problem(sampled)
    best = from_start(alone, Watch(jobs))
    if alone.names and is_coarse(alone):
        exact = corrected(alone, best.point, own_substeps(alone, problem.substeps), jobs)
        alone, best = (alone, best) if isinstance(exact, Failure) else exact
    precision = uncertainty(alone, best.point, jobs=jobs)
    estimates = _estimates(alone, best.point, precision, identifiability(alone, best.point, precision, jobs=jobs))
    return _recording(on_every_sample(alone, sampled), best.point, estimates, e.name, use="validate"), best.reason


def _estimates(
    problem: Problem, x: FloatArray, precision: Uncertainty | Failure, verdicts: Mapping[str, Verdict]
) -> dict[str, Estimate]:
    """Every order and parameter by name, and every unknown by its own; what is tied as that which it follows."""
    units = {p.name: p.unit for p in problem.model.parameters}
    starts = problem.order_starts | {p.name: p.value for p in problem.model.parameters} | problem.parameter_starts
    values = {**problem.orders, **problem.parameters}
    fixed = {n: Estimate(float(v), units.get(n, "")) for n, v in starts.items()
             if not isinstance(values.get(problem.ties.get(n, n)), Free)}  # fmt: skip
    free = {u.name: _estimate(u, x, i, precision, verdict=verdicts.get(u.name, Verdict(u.name, "unknown")))
            for i, u in enumerate(problem.unknowns)}  # fmt: skip
    return fixed | free | {name: free[to] for name, to in problem.aliases.items()}


def _estimate(u: Unknown, x: FloatArray, i: int, precision: Uncertainty | Failure, verdict: Verdict) -> Estimate:
    value = float(x[i])
    if isinstance(precision, Failure):
        return Estimate(value, u.unit, True, identifiable=verdict.kind)
    se, own = float(precision.standard_error[i]), bool(precision.at_bound[i])
    nearer = min(u.range.lower, u.range.upper, key=lambda end: abs(end - value)) if own else None
    interval, white = (precision.interval(x, i, method) for method in ("sandwich", "white"))
    return Estimate(value, u.unit, free=True, standard_error=se if np.isfinite(se) else None, interval95=interval,
                    at_bound=own, bound=nearer, identifiable=verdict.kind, reason=verdict.reason, white95=white,
                    interval_method=precision.method(i))  # fmt: skip


UNTOLD = ("identifiable", "forgotten", "unknown")
"""Verdicts that are no warning."""


def _warnings(problem: Problem, precision: Uncertainty | Failure, verdicts: Mapping[str, Verdict]) -> Iterator[str]:
    if METHODS[problem.method].raw:
        yield SAYS("raw-sums", problem=problem)
    for order, output in problem.model.seen_in.items():
        if order in problem.names and output not in problem.outputs:
            scored = " and ".join(letter(n) for n in problem.outputs)
            yield SAYS("unscored", scored=scored, order=letter(order), output=letter(output))
    if isinstance(precision, Failure):
        yield f"There are no intervals: {precision}."
        return
    together = [names for names in precision.confounded if len(names) > 1]
    for names in together:
        yield f"The data cannot separate {' and '.join(letter(n) for n in names)}: fix one of them."
    alike: dict[tuple[str, bool], list[str]] = {}
    for v in verdicts.values():
        if v.kind not in UNTOLD and not any(v.name in names for names in together):
            alike.setdefault((v.says, bool(v.reason)), []).append(letter(v.name))
    for (says, explained), unknowns in alike.items():
        if len(unknowns) == 1:
            yield Note(f"{unknowns[0]} {says}.", "verdict" * explained)
        else:
            yield f"{', '.join(unknowns[:-1])} and {unknowns[-1]} {_of_several(says)}."


def _of_several(said: str) -> str:
    """``lie at their bound: 0; they are zero …`` for ``lies at its bound: 0; it is zero …``.

    Examples
    --------
    >>> _of_several("lies at its bound: 0; it is zero within the resolution of the data: remove it")
    'lie at their bound: 0; they are zero within the resolution of the data: remove them'
    """
    plural = {r"^is": "are", r"^lies": "lie", r"\bit is\b": "they are", r"\bits\b": "their",
              r"\b(fix|remove|beyond|score) it\b": r"\1 them"}  # fmt: skip
    for one, several in plural.items():
        said = re.sub(one, several, said)
    return said
