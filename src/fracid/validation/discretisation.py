"""The discretisation check: does the step make the orders?

The equations are solved again at half the step, and there with ``pi2``, of second order; all free parameters are then
re-estimated from x.  One that shifts by more than its CI half-width is in part an artefact of the scheme: explicit
Euler's anti-damping, for one, shifts the orders.  A cost that changes by more than 5 % at half the step of a scheme
of second order means that the step is too coarse (steep dry friction).

Where the step is the fit's to choose, :func:`finer_step` halves it, and refines the minimum there, until no parameter
shifts by more than a fifth of its half-width, which costs a 95 % interval less than one of its hundredths: as long as
one of two half steps makes what the check complains of smaller, and no further than :data:`FINEST` steps a sample.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.covariance import LEAST_SHIFT, Known, half_width, uncertainty
from fracid.estimation.horizons import Watch, growing, lowest_from, uninterrupted
from fracid.estimation.linearised import Linearised
from fracid.estimation.long_records import corrected, is_coarse, on_all_samples, own_substeps
from fracid.estimation.minimum import Minimum, beside, settled
from fracid.estimation.nearly_equal import nearly_equal_minimum
from fracid.estimation.tangent import Tangent
from fracid.findings import Finding, Words
from fracid.optimise import Evaluation
from fracid.problem import Problem
from fracid.problem.checks import MOST_STEPS
from fracid.safety.schema import Infinite, Record, Unknown
from fracid.selection.step import COARSE, HELPS, QUIET
from fracid.solver.methods import METHODS
from fracid.units import letter, signed

SAYS = Words("validation/discretisation.toml")


class Refined(NamedTuple):
    """A minimum with its discretisation check."""

    at: Minimum
    check: Discretisation


@dataclass(frozen=True)
class Discretisation(Record):
    """What the step and the scheme do to the result."""

    cost: Infinite
    """With the method and step of the fit."""
    cost_half_step: Infinite
    """The same unknowns at half the step."""
    cost_second_order: Infinite
    """The same unknowns with pi2 at half the step."""
    orders: Mapping[str, Unknown]
    """The orders refined with pi2 at half the step, all other unknowns with them; empty for a user's own cost."""
    shift: Mapping[str, Unknown]
    """How far that moved them."""
    largest: Unknown = 0.0
    """The largest shift of an unknown, in CI half-widths."""
    warning: str = ""
    """A sentence, where an order moved by more than its interval's half width, or the finer run fails."""
    refinement: str = ""
    """What was said at a coarser step, where the fit chose this one: a sentence."""
    moves: Mapping[str, Unknown] = field(default_factory=dict)
    """How far it moved each unknown that all recordings share, or of one recording all."""

    def on_all_samples(self, problem: Problem, here: float, there: float) -> Discretisation:
        """Its costs on all samples, where the fit costs `there`, of those on coarser ones, where it costs `here`."""
        found = np.array([self.cost, self.cost_half_step, self.cost_second_order])
        cost, half, second = on_all_samples(problem, found, here, there).tolist()
        return replace(self, cost=cost, cost_half_step=half, cost_second_order=second)

    def judged(self, problem: Problem, x: FloatArray, known: Known, substeps: int) -> Discretisation:
        """With the warning that its moves are worth beside these intervals of x.

        It names no interval: what is shown in the end allows for the moves, or is none where the model does not fit.
        """
        if not self.moves:
            return self
        halves = {u.name: half_width(known, x, i) for i, u in enumerate(problem.unknowns)}
        width = {n: halves[problem.ties.get(n, n)] or LEAST_SHIFT for n in self.shift}  # the least that counts
        moved = [n for n, shift in self.shift.items() if abs(shift) > max(LEAST_SHIFT, width[n])]
        coarse = _costs_differ(problem.method, self)
        says = [SAYS("too-coarse", costs=(self.cost, self.cost_half_step), substeps=2 * substeps)] if coarse else []
        says += [SAYS("moves", name=letter(n), shift=signed(self.shift[n], width[n]), method=problem.method)
                 for n in moved]  # fmt: skip
        beyond = [SAYS("by", name=u.name, shift=signed(move, half))
                  for u in problem.unknowns for half, move in [(halves[u.name], self.moves.get(u.name, 0.0))]
                  if u.kind != "order" and half and abs(move) > half]  # fmt: skip
        says += [SAYS("move-too", beyond=", ".join(beyond))] if says and beyond else []
        if moved and not coarse:
            remedy = f"substeps = {2 * substeps}" if problem.method == "pi2" else 'method = "pi2"'
            says.append(SAYS("type", remedy=remedy))
        return replace(self, warning=" ".join(says))

    def widened(self, problem: Problem, x: FloatArray, known: Known) -> Known:
        """Intervals that allow for what the step moves, where that is more than :data:`QUIET` of their half-width."""
        if isinstance(known, Failure):
            return known
        moves = np.array([self.moves.get(u.name, 0.0) for u in problem.unknowns])
        halves = np.array([half_width(known, x, i) for i in range(len(x))])
        moves[np.abs(moves) <= QUIET * halves] = 0.0
        return known.wider(problem.space, x, TO_THE_LIMIT * moves) if moves.any() else known


COARSE_STEP = "step"
"""The code of a finding of the discretisation check, whose sentence stands there."""

TO_THE_LIMIT = 4 / 3
"""What all finer steps move, of what half the step does, by a scheme of second order."""

FINEST = 32
"""Steps a sample that a fit chooses at most."""

LOST = 1.5
"""Times the cost at a step: a minimum at half of it that costs more is another one, for beside a separatrix the same
values fall to another side.  The check looks for its own from the first swing on."""

SOUGHT = 1_000_000
"""Steps of all runs at most, of which that is done: it takes what a search does, at a finer step."""

BUMPS = 0.5
"""Part of the rise that ends an interval, by which the step may raise the cost."""


def discretisation_check(
    problem: Problem, x: FloatArray, known: Known, jobs: int, *, substeps: int = 1, near: Tangent | None = None
) -> Discretisation:
    """Score at half the step and with the second-order method, and refine the orders there.

    Of coarser recordings `substeps` are the steps of a sample of their source that corrected them; of others they are
    the problem's.  The derivatives of `near`, the tangent at x, serve at half the step.
    """
    if is_coarse(problem):
        return _corrected_check(problem, x, known, jobs, substeps=substeps)
    half = replace(problem, substeps=2 * problem.substeps)
    second = replace(half, method="pi2")
    after = second.evaluate(x)
    costs = (problem.cost(x), half.cost(x), after.cost)
    if after.reason or problem.cost_function.loss is None:  # least squares cannot refine it
        return Discretisation(*costs, {}, {}, warning=SAYS("fails", reason=after.reason) if after.reason else "")
    if problem.in_windows:  # at a window's end what a start is off by has grown
        best = lowest_from(second, x, Watch(jobs), budget=10)
        return _judged(problem, x, known, (costs[0], best.cost, best.cost), best.point, substeps=problem.substeps)
    finer = _minimum_beside(problem, x, second, jobs, near=near)
    if near is not None:  # what the step moves, without what a valley leaves x short of its own minimum
        finer = x + finer - _minimum_beside(problem, x, problem, jobs, near=near)
    if second.simulator.work <= SOUGHT and second.cost(finer) > LOST * costs[0]:
        best = uninterrupted(growing(second, x, Watch(jobs))).best
        costs, finer = (costs[0], best.cost, best.cost), best.point
    return _judged(problem, x, known, costs, finer, substeps=problem.substeps)


def _minimum_beside(problem: Problem, x: FloatArray, other: Problem, jobs: int, near: Tangent | None) -> FloatArray:
    """The minimum of a problem that is nearly another one, from x, that one's."""
    if near is not None:
        there = beside(replace(near, problem=other), x)
        if there is not None:
            return there.x + there.step()
    begun, ended = (nearly_equal_minimum(problem, x, which, jobs) for which in (problem, other))
    if begun is None or ended is None:
        return lowest_from(other, x, Watch(jobs), tolerance=1e-6, budget=20).point
    return problem.space.clipped(x + (ended - begun))


def _corrected_check(problem: Problem, x: FloatArray, known: Known, jobs: int, substeps: int) -> Discretisation:
    """The same of a problem whose coarse steps the fit's own have corrected: those are halved."""
    finer = corrected(replace(problem, method="pi2"), x, own_substeps(problem, 2 * substeps), jobs, rounds=1)
    here = problem.cost(x)
    if isinstance(finer, Failure):
        return Discretisation(here, np.inf, np.inf, {}, shift={}, warning=SAYS("fails", reason=finer))
    there = finer[0].cost(x)
    return _judged(problem, x, known, (here, there, there), finer=finer[1].point, substeps=substeps)


def _judged(
    problem: Problem, x: FloatArray, known: Known, costs: tuple[float, float, float], finer: FloatArray, substeps: int
) -> Discretisation:
    """How far the orders move from x to the minimum at half the step, and what that means."""
    at = problem.free_orders
    at |= {name: at[to] for name, to in problem.ties.items() if to in at}
    shift = {n: float(finer[i] - x[i]) for n, i in at.items()}
    halves = [half_width(known, x, i) for i in range(len(x))]
    largest = max((abs(float(b - a)) / half for a, b, half in zip(x, finer, halves, strict=True) if half), default=0.0)
    moves = {u.name: float(finer[i] - x[i]) for i, u in enumerate(problem.unknowns)
             if u.experiment is None or len(problem.recordings) == 1}  # fmt: skip
    check = Discretisation(*costs, {n: float(finer[i]) for n, i in at.items()}, shift, largest, moves=moves)
    return check.judged(problem, x, known, substeps)


def finer_step(begun: Refined, jobs: int) -> Refined | None:
    """The minimum at the coarsest step at which the check is quiet; None where it is quiet, or no half step helps.

    What steep friction does is uneven: one half step may not help, and the next one does.
    """
    best, found, held, idle = None, begun, begun.check, False
    method = begun.at.problem.method
    while found.check.warning or found.check.largest > QUIET:
        finer = halved(found, jobs)
        helps = finer is not None and _helps(method, held, finer.check)
        if finer is None or (idle and not helps):
            break
        found, idle = finer, not helps
        if helps:
            sentence = SAYS("halved", finer=finer.at, begun=begun.at, complaint=_complaint(method, begun.check))
            best = found = Refined(finer.at, replace(finer.check, refinement=sentence))
            held = best.check
    return best


def halved(coarse: Refined, jobs: int) -> Refined | None:
    """The minimum at half the step of another one; None where it is lost, its run fails, or it takes too many steps."""
    at = coarse.at
    problem, x, substeps = at.problem, at.x, 2 * at.substeps
    other = replace(problem, substeps=own_substeps(problem, substeps))
    if substeps > FINEST or 2 * max(other.simulator.steps(e) for e in other.experiments) > MOST_STEPS:
        return None
    if is_coarse(problem):
        exact = corrected(problem, x, other.substeps, jobs)
        if isinstance(exact, Failure):
            return None
        (other, minimum), near = exact, None
    else:
        minimum, near = _minimum_of(problem, x, other, jobs, near=at.near)
    most = LOST * max(at.best.cost, coarse.check.cost_second_order)
    if minimum.cost > most and 2 * other.simulator.work <= SOUGHT:  # the check went there from the first swing on
        moved = x + [coarse.check.moves.get(u.name, 0.0) for u in problem.unknowns]
        minimum, near = lowest_from(other, moved, Watch(jobs)), None
    problem.last_derivatives.clear()
    if minimum.reason or minimum.cost > most:
        return None
    known = uncertainty(other, minimum.point, jobs=jobs, near=near)
    check = discretisation_check(other, minimum.point, known, jobs, substeps=substeps, near=near)
    return Refined(Minimum(other, minimum, substeps, known, near), check)


def is_rough(near: Tangent, known: Known) -> bool:
    """Whether what the step does wrong may raise the cost by half of what ends an interval: then it has bumps there.

    Half the step changes the rows r by c, and V by 2r·c, up or down as the samples that cross a steep friction fall.
    """
    finer = replace(near.problem, substeps=2 * near.problem.substeps).evaluate(near.x).residuals
    if isinstance(known, Failure) or finer is None or near.evaluation.residuals is None:
        return False
    change, rises = finer - near.evaluation.residuals, known.rise[known.rise > 0]
    return 2 * math.sqrt(near.unit * float(change @ change)) > BUMPS * float(np.min(rises, initial=math.inf))


def _minimum_of(
    problem: Problem, x: FloatArray, other: Problem, jobs: int, near: Tangent | None
) -> tuple[Evaluation, Tangent | None]:
    """The minimum of `other`, nearly `problem`, from x, that one's; with the tangent there, where one is given."""
    if near is not None:
        far = near.evaluation.cost * (1 + COARSE) < other.cost(x)  # there its derivatives are others
        there = settled(other, x, jobs=jobs) if far else beside(replace(near, problem=other), x)
        there = there.tangent if isinstance(there, Linearised) else there
        if isinstance(there, Tangent):
            return there.evaluation, there
    point = nearly_equal_minimum(problem, x, other, jobs)
    return lowest_from(other, x, Watch(jobs)) if point is None else other.evaluate(point), None


def _costs_differ(method: str, check: Discretisation) -> bool:
    """Whether half the step changes the cost by too much."""
    return METHODS[method].convergence_order >= 2 and abs(check.cost_half_step - check.cost) > COARSE * check.cost


def _helps(method: str, coarse: Discretisation, finer: Discretisation) -> bool:
    """Whether a half step makes smaller what the check of the coarse one complains of, or the least cost."""
    if not math.isfinite(coarse.cost_second_order) or finer.cost < (1 - COARSE) * coarse.cost:
        return True
    of_cost = _costs_differ(method, coarse)
    before, after = (abs(c.cost_half_step - c.cost) if of_cost else c.largest for c in (coarse, finer))
    return after <= HELPS * before


def _complaint(method: str, check: Discretisation) -> str:
    """What the check had to say, in few words."""
    if _costs_differ(method, check):
        return SAYS("changes-cost", check=check)
    return SAYS("moves-a-value" if math.isfinite(check.cost_second_order) else "run-fails", check=check)


def coarse_step(problem: Problem, check: Discretisation) -> Iterator[Finding]:
    """The discretisation check as a finding."""
    if check.warning:
        change = 100 * abs(check.cost_half_step / check.cost - 1) if check.cost > 0 else np.inf
        yield SAYS.finding(COARSE_STEP, "", change, 100 * COARSE, method=problem.method, warning=check.warning)
