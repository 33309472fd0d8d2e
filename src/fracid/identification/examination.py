"""The examination of a minimum, whatever search found it: what the data say of it, and what contradicts it.

The steps are methods of :class:`Examination`, taken in the order of ``steps.toml``.  Each replaces ``at``, the minimum
with its intervals, or adds to what is found about it; any may add findings and warnings:

==================  ===================================================================  =============================
step                what it does                                                         sets
==================  ===================================================================  =============================
open_bounds         goes on beyond bounds that stop the search                           at, within
correct             gives a long record, searched with coarse steps, its own residuals   at
settle              goes on to the minimum itself, measures intervals                    at
with_quiet_step     checks the step, halves it until the check is quiet                  at, check
walk                follows the cost off the tangent to where intervals end              at
allow_for_inputs    allows for what inputs do between their samples                      at
look_elsewhere      looks for another minimum that is as good                            at
identify            says which unknowns are identifiable                                 verdicts
look                looks for faults of the fit
predict             simulates what was held out                                          validated
fit_each            fits each recording alone                                            spread
polish              goes on from an optimiser that keeps its own best
make_claim          compares the orders with models of integer order                     claim, alternative, residuals
from_nested         searches from a nested model of integer order
cut_record          moves the start of the record, where that is asked for               cut
==================  ===================================================================  =============================

A step that finds a lower minimum returns it, and the first step is taken again there.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure, FailureReason
from fracid.estimation.agreement import Spread, spread
from fracid.estimation.climbing import embedded
from fracid.estimation.covariance import Known, Uncertainty, half_width, uncertainty
from fracid.estimation.curvature import curvature, newton_step
from fracid.estimation.estimates import estimates_at, fits_at, validation_fit
from fracid.estimation.horizons import Watch, growing, lowest_from, uninterrupted
from fracid.estimation.input_noise import noisy_inputs, with_input_noise
from fracid.estimation.interval_walk import walked
from fracid.estimation.long_records import (
    TO_COMPARE,
    as_fitted,
    corrected,
    is_coarse,
    like,
    on_all_samples,
    on_every_sample,
    own_substeps,
    part_of,
    some_of,
)
from fracid.estimation.minimum import Minimum, settled
from fracid.estimation.other_minimum import as_good_elsewhere, with_another
from fracid.estimation.parameter_verdicts import Verdict, identifiability
from fracid.estimation.records import RecordingFit, fit_of
from fracid.estimation.starts import Start
from fracid.estimation.tangent import Tangent, tangent
from fracid.findings import Finding, Note, Words
from fracid.optimise import Entry, Evaluation, Outcome
from fracid.problem import Experiment, Problem
from fracid.safety.door import own_text
from fracid.selection.bic import SAME
from fracid.selection.claim import FLOOR, Claim, claim_of, no_run, orders_found
from fracid.selection.fractional_element import fractional_element
from fracid.selection.integer_alternatives import integer_alternatives
from fracid.selection.integer_rival import Alternative, beside_fit, claimable_values, integer_values
from fracid.selection.opened_bounds import LOWER, open_bounds
from fracid.selection.residual_noise import leftovers
from fracid.signals.left_over import LeftOver
from fracid.solver.methods import METHODS
from fracid.tasks.progress import Observer
from fracid.validation.after_search import after, between_samples, failed, noisy_start, with_start
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
from fracid.validation.misfits import missed
from fracid.validation.unknown_past import CutCheck, cut_check

SAYS = Words("identification/identification.toml")

RESTARTS = 3
"""From a model that costs less."""

NESTED: Mapping[str, Any] = {"tolerance": 1e-3, "budget": 5}
"""Least squares of the nested model from the fit."""

ELSEWHERE = 0.25
"""Of the work of a stage after the search: to look for another minimum."""

WIDER = 1.5
"""From which factor on the noise of inputs is told."""

NO_CLAIM = Claim("undecided", ("The fit was not examined to its end.",))


@dataclass(frozen=True)
class Setting:
    """What an examination is given beside the minimum: what was asked, and how it was searched."""

    problem: Problem
    """On every sample of its recordings, or of their windows."""
    window: float | None
    """Seconds of a window, where the recordings are fitted in windows."""
    optimiser: Entry
    seed: int
    starts: int
    """Of a search."""
    attempts: tuple[Start, ...]
    """What the search came to from each of them."""
    allowed: float
    """The work of a stage after the search, at most."""
    alternatives: Mapping[str, Problem]
    """Models of integer order that the user names."""
    fixed_step: bool
    """Whether the step stays as it is."""
    findings: tuple[Finding, ...]
    """Before the search."""
    validation: tuple[Experiment, ...]
    whole: Mapping[str, Experiment] | None
    """Recordings with what came before their start; None where that is not asked."""
    jobs: int
    observer: Observer

    @property
    def multi_starts(self) -> int:
        """Starts of a search by multistart, which more of them may bring to another minimum; 0 of any other."""
        return self.starts if self.optimiser.function is None else 0


@dataclass
class Examination:
    """What is found about a minimum so far; Ctrl-C may end it at any point."""

    setting: Setting
    at: Minimum
    outcome: Outcome
    check: Discretisation | None
    findings: list[Finding] = field(default_factory=list)
    """Beside those before the search."""
    warnings: list[str] = field(default_factory=list)
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)
    validated: dict[str, RecordingFit] = field(default_factory=dict)
    spread: Spread | None = None
    residuals: Mapping[str, LeftOver] = field(default_factory=dict)
    """What the model leaves of each output: of one that does not fit, intervals mean nothing."""
    alternative: Alternative | None = None
    claim: Claim = NO_CLAIM
    cut: CutCheck | Failure | None = None
    within: tuple[Problem, float] | None = None
    """The problem with its own bounds and its cost there, where some were opened."""
    restarts: int = 0
    """How often a model that is nested in the fit, or its alternative, led to a lower cost."""

    @property
    def sampled(self) -> Problem:
        """The problem on every sample."""
        return on_every_sample(self.at.problem, replace(self.setting.problem, substeps=self.at.substeps))

    @property
    def cost(self) -> float:
        """Of the minimum on every sample."""
        return self.sampled.cost(self.at.x) if is_coarse(self.at.problem) else self.at.best.cost

    def examine(self, begin: Callable[[str, str], None]) -> None:
        """Take the steps, each told, from the first again where one of them sees a lower minimum."""
        if not np.isfinite(self.at.best.cost):
            self.at = replace(self.at, uncertainty=Failure(FailureReason.RUN, "every run failed"))
            self.claim = no_run()
            self.warnings.append(f"No run reached its end: {self.at.best.reason}.")
            self.findings += failed(self.at.problem, self.at.x)
            return
        steps, done = STEPS if self.setting.whole is None else (*STEPS, WHERE_IT_BEGINS), 0
        try:
            while done < len(steps):
                stage, key, step = steps[done]
                begin(stage, key)
                lower, done = step(self), done + 1
                if lower is not None and self.restarts < RESTARTS:  # what was said of the former one is forgotten
                    self.at = replace(self.at, best=lower)
                    self.findings, self.warnings, self.verdicts, self.validated = [], [], {}, {}
                    self.spread, self.residuals, self.alternative, self.claim = None, {}, None, NO_CLAIM
                    self.restarts, done = self.restarts + 1, 0
        except KeyboardInterrupt:
            self.outcome = Outcome.INTERRUPTED

    # --- the minimum, its step and its intervals -------------------------------------------------------

    def open_bounds(self) -> None:
        """Go on beyond the bounds that stop the search, where that is worth it."""
        if self.setting.optimiser.keeps_its_own:
            return
        wider, lower = open_bounds(self.at.problem, self.at.best, jobs=self.setting.jobs)
        if wider is not self.at.problem:
            self.within = self.within or (self.at.problem, self.at.best.cost)
            self.at = replace(self.at, problem=wider, best=lower)

    def correct(self) -> None:
        """Give long records, searched with coarse steps, the residuals of their own."""
        at, jobs = self.at, self.setting.jobs
        if not is_coarse(at.problem):
            return
        exact = corrected(at.problem, at.x, own_substeps(at.problem, at.substeps), jobs)
        if isinstance(exact, Failure) or exact[1].cost > LOST * at.best.cost:  # coarse steps led elsewhere
            sampled = self.sampled
            exact = sampled, uninterrupted(growing(sampled, at.x, Watch(jobs))).best
        self.at = replace(at, problem=exact[0], best=exact[1])

    def settle(self) -> None:
        """Go on to the minimum itself, and measure its intervals."""
        setting, problem = self.setting, self.at.problem
        best, near = self.at.best, None
        if problem.cost_function.loss is not None and problem.blocks is None and problem.names and not setting.window:
            own = setting.optimiser.keeps_its_own
            found = (tangent if own else settled)(problem, best.point, jobs=setting.jobs)
            if isinstance(found, Tangent):
                best, near = best if own else found.evaluation, found
        self.at = replace(self.at, best=best, near=near)
        known = uncertainty(problem, best.point, jobs=setting.jobs, near=near)
        known = with_start(problem, best.point, known, jobs=setting.jobs)
        if setting.window is not None and self.check is not None:  # that of the parts of the windows
            known = self.check.widened(problem, best.point, known)
        self.at = replace(self.at, uncertainty=known)

    def with_quiet_step(self) -> None:
        """Check the step, and halve it until the check is quiet where it is the fit's to choose."""
        setting, at = self.setting, self.at
        if setting.window is not None:  # it was checked on parts of the windows
            return
        refinement = self.check.refinement if self.check else ""
        check = discretisation_check(at.problem, at.x, at.uncertainty, setting.jobs, substeps=at.substeps, near=at.near)
        self.check = replace(check, refinement=refinement)
        if setting.fixed_step or setting.optimiser.keeps_its_own:  # nor is what it found polished
            return
        if (finer := finer_step(Refined(at, self.check), setting.jobs)) is not None:
            self._refine(finer)

    def _refine(self, finer: Refined) -> None:
        """Go on at a finer step, with derivatives of its own: those of the coarser one led there."""
        self.at, self.check = finer
        self.settle()

    def walk(self) -> Evaluation | None:
        """Look off the tangent where intervals end; a point that is lower than the minimum, if one is seen."""
        self.show()
        while self._halve():  # bumps that the step makes are no valley
            pass
        found = self._walked(self.setting.allowed / self.at.problem.simulator.work)
        if isinstance(found, Evaluation):
            return found
        if self.check is not None and self.setting.window is None:
            self.check = self.check.judged(self.at.problem, self.at.x, found, self.at.substeps)
            if not (METHODS[self.at.problem.method].raw or self.setting.optimiser.keeps_its_own):
                found = self.check.widened(self.at.problem, self.at.x, found)  # what no finer step took away
        self.at = replace(self.at, uncertainty=found)
        if not isinstance(found, Failure) and found.unwalked:
            self.warnings.append(SAYS("walk-cut", ends=found.unwalked))
        return None

    def show(self) -> None:
        """The recordings beside their simulations, to who would draw them while the rest is examined."""
        if (draw := self.setting.observer.recordings) is not None:
            problem, x = self.sampled, self.at.x
            fitted = fits_at(problem, x, estimates_at(problem, x, self.at.uncertainty, self.verdicts), use="fit")
            draw(fitted | self.validated)

    def _walked(self, most: float) -> Known | Evaluation:
        known = self.at.uncertainty
        if self.at.near is None or isinstance(known, Failure) or self.setting.optimiser.keeps_its_own:
            return known
        return walked(self.at.near, known, most=most, jobs=self.setting.jobs)

    def _halve(self) -> bool:
        """Halve the step where the fit may choose it and a first look at the intervals sees its errors bend one.

        Gives whether it was halved.
        """
        setting, at = self.setting, self.at
        fixed = setting.fixed_step or setting.window is not None or is_coarse(at.problem)
        if fixed or self.check is None or at.near is None or not is_rough(at.near, at.uncertainty):
            return False
        found = self._walked(1)
        if isinstance(found, Uncertainty) and not (found.unwalked or found.walked.any()):
            return False
        finer = halved(Refined(at, self.check), setting.jobs)
        if finer is None or finer.at.near is None or isinstance(finer.at.uncertainty, Failure):
            return False
        refinement = SAYS("halved", substeps=finer.at.problem.substeps, began=setting.problem.substeps)
        self._refine(Refined(finer.at, replace(finer.check, refinement=refinement)))
        return True

    def allow_for_inputs(self) -> None:
        """Allow for what inputs do between their samples."""
        at = self.at
        exact, findings, notes = between_samples(at.problem, at.x, at.uncertainty, jobs=self.setting.jobs)
        known = with_input_noise(at.problem, at.x, exact, near=at.near, jobs=self.setting.jobs)
        if isinstance(exact, Uncertainty) and isinstance(known, Uncertainty):
            pairs = zip(known.standard_error, exact.standard_error, strict=True)
            if wider := [wide / narrow for wide, narrow in pairs if wide > WIDER * narrow]:
                notes += (SAYS("noisy-input", names=" and ".join(noisy_inputs(at.problem)), wider=max(wider)),)
        self.at = replace(self.at, uncertainty=known)
        self.findings += findings
        self.warnings += notes

    def look_elsewhere(self) -> Evaluation | None:
        """Look for another minimum that is as good, or lower."""
        setting, problem, known = self.setting, self.at.problem, self.at.uncertainty
        own = setting.optimiser.keeps_its_own or problem.cost_function.loss is None
        if own or isinstance(known, Failure) or setting.window is not None:
            return None
        ends = [embedded(problem, s.end) for s in setting.attempts]
        watch = Watch(setting.jobs, most=ELSEWHERE * setting.allowed)
        there = as_good_elsewhere(problem, self.at.best, known, ends, watch=watch)
        if there is None:
            return None
        if there.cost < (1 - LOWER) * self.at.best.cost:
            return there
        self.at = replace(self.at, uncertainty=with_another(problem, self.at.x, known, there.point))
        return None

    # --- what is found about it ------------------------------------------------------------------------

    def identify(self) -> None:
        """Say of each unknown whether it is identifiable."""
        self.verdicts = identifiability(self.at.problem, self.at.x, self.at.uncertainty, jobs=self.setting.jobs)

    def look(self) -> Evaluation | None:
        """Look for faults; where the search stopped short, for a lower minimum too."""
        at = self.at
        findings = after(at.problem, at.x, at.uncertainty, jobs=self.setting.jobs, near=at.near)
        said = {"stopped-short"} if self.setting.optimiser.keeps_its_own else set[str]()  # the polishing says more
        said |= {"late"} if any(f.code == "between" for f in self.findings) else set()  # an input that is held is late
        self.findings += [f for f in findings if f.code not in said]
        self.warnings += [f.note for f in noisy_start(at.problem, at.x, at.uncertainty)]  # the intervals include it
        return self._onward() if self.restarts < RESTARTS else None

    def _onward(self) -> Evaluation | None:
        """Where a Newton step leads, and least squares from there, of a search that stopped short; None if not lower.

        Gauss and Newton's steps end where the residual bends more than they see: next to a friction that is dry.
        """
        problem, x, known = self.at.problem, self.at.x, self.at.uncertainty
        if isinstance(known, Failure) or all(f.code != "stopped-short" for f in self.findings):
            return None
        parabola = curvature(problem, x, np.flatnonzero(~known.at_bound), jobs=self.setting.jobs)
        if isinstance(parabola, Failure):
            return None
        there = problem.evaluate(x + newton_step(problem, x, parabola)[0])
        lower = min(there, self._refined(problem, there.point), key=lambda e: e.cost)
        return lower if lower.cost < self.at.best.cost else None

    def _refined(self, problem: Problem, x: FloatArray, **options: Any) -> Evaluation:
        return lowest_from(problem, x, Watch(self.setting.jobs), **options)

    def predict(self) -> None:
        """Simulate what was held out; what is wrong with the step is known by now."""
        setting, at = self.setting, self.at
        for e in setting.validation:
            self.validated[e.name], reason = validation_fit(self.sampled, at.x, e, setting.window, jobs=setting.jobs)
            self.warnings += [f"No run of the validation recording reached its end: {reason}."] if reason else []
        if setting.validation:
            self.show()
        if self.check is not None:
            self.warnings.append(Note(self.check.warning, COARSE_STEP))
            self.findings += coarse_step(at.problem, self.check)

    def fit_each(self) -> None:
        """Fit each recording alone."""
        problem = self.at.problem
        if len(problem.recordings) > 1 and problem.cost_function.loss is not None:
            self.spread = spread(problem, self.at.x, jobs=self.setting.jobs)
            self.warnings += [Note(sentence, "spread") for sentence in self.spread.sentences]

    def polish(self) -> None:
        """Say what least squares finds from the best point of an optimiser that keeps its own.

        Where it lowers the cost by a part in a thousand, or moves an order by half its interval.
        """
        problem, best, orders = self.at.problem, self.at.best, self.at.problem.order_indices
        if not self.setting.optimiser.keeps_its_own or problem.cost_function.loss is None:
            return
        x, polished = best.point, self._refined(problem, best.point)
        halves = {i: half_width(self.at.uncertainty, x, i) for i in orders}
        shifts = [abs(polished.point[i] - x[i]) > max(1e-3, 0.5 * half) for i, half in halves.items()]
        if polished.cost <= 0.999 * best.cost or any(shifts):
            changes = ", ".join(f"{problem.unknowns[i].target} {x[i]:.4f} -> {polished.point[i]:.4f}" for i in orders)
            changes = f" ({changes})" if changes else ""
            self.warnings.append(SAYS("stopped", best=best, polished=polished, changes=changes))

    # --- models of integer order -----------------------------------------------------------------------

    def make_claim(self) -> None:
        """Look for what of integer order explains the recordings as well: slow ones where nothing else contradicts."""
        setting, at, problem = self.setting, self.at, self.at.problem
        part = some_of(part_of(problem))
        where, beside = self._cheaper(part)
        orders, self.residuals = orders_found(problem, at.x, at.uncertainty), leftovers(problem, at.x)
        noise = all(e.noise for e in self.residuals.values())
        contradictions = [f.note for f in (*setting.findings, *self.findings, *self.missed())]
        undecided = claim_of(orders, None, self.residuals, contradictions).claim == "undecided"
        slow = any(order.least_distance > FLOOR for order in orders) and noise
        halves = {} if isinstance(at.uncertainty, Failure) else {order.name: order.half for order in orders}
        nearest = integer_alternatives(
            where, beside, halves, slow=slow and not contradictions and undecided,
            own={n: _beside(other, where) for n, other in setting.alternatives.items()},
            starts=setting.starts, seed=setting.seed, watch=Watch(setting.jobs, most=setting.allowed),
        )  # fmt: skip
        goal = nearest.cost if nearest else None
        element = None if noise else fractional_element(where, beside, goal=goal, jobs=setting.jobs)
        cost, values = self.cost, claimable_values(problem, at.x)
        nearest = nearest and beside_fit(nearest, values, problem, beside.cost, cost)
        if element is not None:
            before, after = on_all_samples(problem, np.array([element.before, element.cost]), beside.cost, cost)
            element = replace(element, before=float(before), cost=float(after))
        starts, self.alternative = setting.multi_starts, nearest
        self.claim = claim_of(orders, nearest, self.residuals, contradictions, element=element, starts=starts)
        if nearest is not None and self.claim.claim == "integer":
            self.warnings.append(nearest.warning)
        if nearest is not None and part is not problem:
            few, many = len(part.recordings), len(problem.recordings)
            reason = SAYS("compared" if few == many else "compared-on", few=few, many=many, end=part.seconds)
            self.claim = replace(self.claim, reasons=(*self.claim.reasons, reason))

    def _cheaper(self, part: Problem) -> tuple[Problem, Evaluation]:
        """What alternatives are held against: part of the record at its minimum, at the longest step that does."""
        setting, problem, best = self.setting, self.at.problem, self.at.best
        if part is not problem:
            return part, self._refined(part, embedded(part, problem.named(best.point)))
        own = setting.alternatives or setting.window is not None
        dense = problem if own else as_fitted(problem, best.point, TO_COMPARE)
        if dense is not problem:
            return dense, dense.evaluate(best.point)  # the residuals of its own steps
        steps = setting.problem.substeps
        while steps < problem.substeps and setting.window is None and not is_coarse(problem):
            coarse = replace(problem, substeps=steps)
            there = self._refined(coarse, best.point)
            if abs(there.cost - best.cost) <= SAME * best.cost:
                return coarse, there
            steps *= 2
        return problem, best

    def missed(self) -> Iterator[Finding]:
        """Validation recordings that the model does not predict."""
        problem, x = self.at.problem, self.at.x
        names = problem.recordings if self.validated else ()
        fits = [fit_of(problem, x, n, "fit", initial={}, parameters={}) for n in names]
        if fits and all(np.isfinite(r.cost) for r in fits):
            yield from missed(self.validated, {n: max(r.rmse[n] for r in fits) for n in problem.outputs})

    def from_nested(self) -> Evaluation | None:
        """A lower minimum by way of the integer-order model that is nested in the fit, or of its alternative; or None.

        Converged is only what nothing nested in it beats.
        """
        problem, best, nearest = self.at.problem, self.at.best, self.alternative
        if problem.cost_function.loss is None or not problem.order_indices or self.setting.optimiser.keeps_its_own:
            return None
        goal = (1 - LOWER) * best.cost
        values: Mapping[str, float] = {}
        if nearest is not None:
            values = nearest.values if nearest.cost < self.cost else {}
        elif not all(e.explained for e in self.residuals.values()):  # noise alone cannot be fitted better
            integer = replace(problem, orders=integer_values(problem))
            end = self._refined(integer, embedded(integer, problem.named(best.point)), **NESTED)
            if end.cost < goal:
                fixed = {n: v for n, v in integer.orders.items() if isinstance(v, float | int)}
                values = integer.named(end.point) | fixed
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
        setting, at = self.setting, self.at
        self.cut = cut_check(self.sampled, at.x, at.uncertainty, whole=setting.whole, jobs=setting.jobs)
        if isinstance(self.cut, Failure):
            self.warnings.append(f"The cut was not checked: {self.cut}.")
        else:
            self.warnings += [Note(sentence, "cut") for sentence in self.cut.warnings]


*STEPS, WHERE_IT_BEGINS = (
    (row["told"], row["counted"], getattr(Examination, name))
    for name, row in tomllib.loads(own_text("identification/steps.toml")).items()
)
"""What is told as a step begins, where its seconds count, and what it does: it gives a lower minimum where it sees one.
The last is taken where it is asked for."""


def _beside(other: Problem, problem: Problem) -> Problem:
    """Another model of the same recordings, or some of them, with as many steps and on as many samples."""
    same = tuple(e for e in other.experiments if e.recording.name in problem.recordings)
    other = replace(other, experiments=same)
    if is_coarse(problem):
        other = like(other, own_substeps(problem)).until(problem.seconds)
    return replace(other, substeps=problem.substeps)
