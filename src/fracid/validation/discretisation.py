"""The discretisation check: does the step make the orders?

The equations are solved again at half the step, and there with ``pi2``, of second order; the orders are then
re-estimated from x.  An order that shifts by more than its CI half-width is in part an artefact of the scheme:
explicit Euler's anti-damping, for one, shifts the orders.  A cost of ``pi2`` that changes by more than 5 % at half the
step means that the step is too coarse (steep dry friction).

Where the step is the fit's to choose, :func:`finer_step` halves it, and refines the minimum there, until the check is
quiet: as long as each half step makes what it complains of smaller, and no further than :data:`FINEST` steps a sample.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.covariance import LEAST_SHIFT, Uncertainty, half_width, uncertainty
from fracid.estimation.horizons import Watch, refined, uninterrupted
from fracid.estimation.long_records import corrected, is_coarse, on_all_samples
from fracid.estimation.nearly_equal import nearly_equal_minimum, nearly_equal_shift
from fracid.findings import Finding
from fracid.optimise import Evaluation
from fracid.problem import Problem
from fracid.problem.checks import MOST_STEPS
from fracid.units import GREEK, to_second_digit
from fracid.units import half_width as shown_half_width

__all__ = ["COARSE_STEP", "Discretisation", "Refined", "coarse_step", "discretisation_check", "finer_step"]


@dataclass(frozen=True)
class Refined:
    """A minimum at a finer step, which the fit chose."""

    problem: Problem
    best: Evaluation
    uncertainty: Uncertainty | Failure
    check: Discretisation


@dataclass(frozen=True)
class Discretisation:
    """What the step and the scheme do to the result."""

    cost: float
    """With the method and step of the fit."""
    cost_half_step: float
    """The same unknowns at half the step."""
    cost_second_order: float
    """The same unknowns with pi2 at half the step."""
    orders: Mapping[str, float]
    """The orders refined with pi2 at half the step, all other unknowns with them; empty for a user's own cost."""
    shift: Mapping[str, float]
    """How far that moved them."""
    warning: str = ""
    """A sentence, where an order moved by more than its interval's half width, or the finer run fails."""
    refinement: str = ""
    """What was said at a coarser step, where the fit chose this one: a sentence."""

    def on_all_samples(self, problem: Problem, here: float, there: float) -> Discretisation:
        """Its costs on all samples, where the fit costs `there`, of those on coarser ones, where it costs `here`."""
        found = np.array([self.cost, self.cost_half_step, self.cost_second_order])
        cost, half, second = on_all_samples(problem, found, here, there).tolist()
        return replace(self, cost=cost, cost_half_step=half, cost_second_order=second)


COARSE_STEP = "step"
"""The code of a finding of the discretisation check, whose sentence stands there."""

COARSE = 0.05
"""A cost that changes by more than this part at half the step says that the step is too coarse."""

FINEST = 32
"""Steps a sample that a fit chooses at most."""

HELPS = 0.7
"""A half step that leaves more than this part of what the check complains of does not help."""


def discretisation_check(
    problem: Problem, x: FloatArray, known: Uncertainty | Failure, jobs: int, *, substeps: int = 1
) -> Discretisation:
    """Score at half the step and with the second-order method, and refine the orders there.

    On coarser recordings `substeps` are those of a fit, for each coarse sample; half of them correct the coarse steps.
    """
    if is_coarse(problem):
        return _corrected_check(problem, x, known, jobs, substeps)
    half = replace(problem, substeps=2 * problem.substeps)
    second = replace(half, method="pi2")
    after = second.evaluate(x)
    costs = (problem.cost(x), half.cost(x), after.cost)
    if after.reason:
        return Discretisation(*costs, {}, {}, f"With pi2 at half the step the best run fails: {after.reason}.")
    if problem.cost_function.loss is None:  # least squares cannot refine it
        return Discretisation(*costs, {}, {})
    shift = nearly_equal_shift(problem, x, second, jobs)
    if shift is None:
        shift = uninterrupted(refined(second, x, jobs, Watch(), tolerance=1e-6, budget=20)).best.point - x
    finer = np.clip(x + shift, problem.space.lower, problem.space.upper)
    return _judged(problem, x, known, costs, finer)


def _corrected_check(
    problem: Problem, x: FloatArray, known: Uncertainty | Failure, jobs: int, substeps: int
) -> Discretisation:
    """The same of a problem whose coarse steps the fit's own have corrected: those are halved."""
    finer = corrected(replace(problem, method="pi2"), x, 2 * substeps, jobs, rounds=1)
    here = problem.cost(x)
    if isinstance(finer, Failure):
        return Discretisation(here, np.inf, np.inf, {}, {}, f"With pi2 at half the step the best run fails: {finer}.")
    there = finer[0].cost(x)
    return _judged(problem, x, known, (here, there, there), finer[1].point)


def _judged(
    problem: Problem, x: FloatArray, known: Uncertainty | Failure, costs: tuple[float, float, float], finer: FloatArray
) -> Discretisation:
    """How far the orders move to the minimum at half the step, and what that means."""
    at = {problem.unknowns[i].target: i for i in problem.order_indices}
    at |= {name: at[to] for name, to in problem.ties.items() if to in at}
    shift = {n: float(finer[i] - x[i]) for n, i in at.items()}
    width = {n: half_width(known, x, i) or LEAST_SHIFT for n, i in at.items()}  # without one, the least that counts
    moved = [n for n in at if abs(shift[n]) > max(LEAST_SHIFT, width[n])]
    warning = " ".join(
        f"{GREEK.get(n, n)} moves by {_signed(shift[n], width[n])} when the equations are solved with pi2 at half the "
        f"step: more than its interval of ± {shown_half_width(width[n])}, so it is in part an artefact of the step of "
        f"{problem.method}."
        for n in moved
    )
    if moved:
        remedy = f"substeps = {_substeps(problem)}" if problem.method == "pi2" else 'method = "pi2"'
        warning += f" Type {remedy} in [fit]."
    check = Discretisation(*costs, {n: float(finer[i]) for n, i in at.items()}, shift, warning)
    if _costs_differ(problem.method, check):
        warning = (
            f"The step is too coarse: at half of it the same values cost {costs[1]:.6g} instead of {costs[0]:.6g}. "
            f"Steep dry friction does this; type substeps = {_substeps(problem)} in [fit]. {warning}"
        ).strip()
    return replace(check, warning=warning)


def _signed(shift: float, width: float) -> str:
    """With its sign, to the second digit of the interval that it is held against."""
    return ("−" if shift < 0 else "+") + to_second_digit(abs(shift), width)


def _substeps(problem: Problem) -> int:
    """Twice those of a sample."""
    return 2 if is_coarse(problem) else 2 * problem.substeps


def finer_step(problem: Problem, x: FloatArray, check: Discretisation, jobs: int) -> Refined | None:
    """The minimum at the coarsest step at which the check is quiet; None where it is quiet, or no half step helps."""
    before, coarse, best = check, problem, None
    steps = max(problem.simulator.steps(e) for e in problem.experiments) / problem.substeps
    while check.warning and 2 * problem.substeps <= FINEST and 4 * problem.substeps * steps <= MOST_STEPS:
        halved = replace(problem, substeps=2 * problem.substeps)
        near = nearly_equal_minimum(problem, x, halved, jobs)
        problem.last_derivatives.clear()
        problem = halved
        minimum = uninterrupted(refined(problem, x, jobs, Watch())).best if near is None else problem.evaluate(near)
        if minimum.reason:
            break
        known = uncertainty(problem, minimum.point, jobs=jobs)
        finer = discretisation_check(problem, minimum.point, known, jobs)
        if not _helps(problem.method, check, finer):
            break
        check, x = finer, minimum.point
        sentence = (
            f"The step was halved to {problem.substeps} a sample; at {coarse.substeps} a sample "
            f"{_complaint(coarse, before)}."
        )
        best = Refined(problem, minimum, known, replace(check, refinement=sentence))
    return best


def _costs_differ(method: str, check: Discretisation) -> bool:
    """Whether half the step changes the cost by too much."""
    return method == "pi2" and abs(check.cost_half_step - check.cost) > COARSE * check.cost


def _helps(method: str, coarse: Discretisation, finer: Discretisation) -> bool:
    """Whether a half step makes smaller what the check of the coarse one complains of."""
    if not coarse.orders and not _costs_differ(method, coarse):
        return True  # its run at half the step failed
    before, after = (
        abs(check.cost_half_step - check.cost) if _costs_differ(method, coarse) else max(map(abs, check.shift.values()))
        for check in (coarse, finer)
    )
    return after <= HELPS * before


def _complaint(problem: Problem, check: Discretisation) -> str:
    """What the check had to say, in few words."""
    if _costs_differ(problem.method, check):
        return f"half the step changes the cost from {check.cost:.3g} to {check.cost_half_step:.3g}"
    moved = ", ".join(f"{n} by {shift:+.2g}" for n, shift in check.shift.items())
    return f"half the step moves {moved}" if moved else "the run at half the step fails"


def coarse_step(problem: Problem, check: Discretisation) -> Iterator[Finding]:
    """The discretisation check as a finding."""
    if not check.warning:
        return
    change = 100 * abs(check.cost_half_step / check.cost - 1) if check.cost > 0 else np.inf
    yield Finding(COARSE_STEP, "", change, 100 * COARSE, f"% of the cost at half the step of {problem.method}",
                  check.warning)  # fmt: skip
