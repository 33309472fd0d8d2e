"""The discretisation check: does the step make the orders?

The equations are solved again at half the step, and there with ``pi2``, of second order; the orders are then
re-estimated from x.  An order that shifts by more than its CI half-width is in part an artefact of the scheme:
explicit Euler's anti-damping, for one, shifts the orders.  A cost of ``pi2`` that changes by more than 5 % at half the
step means that the step is too coarse (steep dry friction).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.covariance import LEAST_SHIFT, Uncertainty, half_width
from fracid.estimation.horizons import Watch, refined, uninterrupted
from fracid.findings import Finding
from fracid.problem import Problem

__all__ = ["COARSE_STEP", "Discretisation", "coarse_step", "discretisation_check"]


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


COARSE_STEP = "step"
"""The code of a finding of the discretisation check, whose sentence stands there."""

COARSE = 0.05
"""A cost that changes by more than this part at half the step says that the step is too coarse."""


def discretisation_check(
    problem: Problem, x: FloatArray, uncertainty: Uncertainty | Failure, jobs: int
) -> Discretisation:
    """Score at half the step and with the second-order method, and refine the orders there."""
    half = replace(problem, substeps=2 * problem.substeps)
    second = replace(half, method="pi2")
    after = second.evaluate(x)
    costs = (problem.cost(x), half.cost(x), after.cost)
    if after.reason:
        return Discretisation(*costs, {}, {}, f"With pi2 at half the step the best run fails: {after.reason}.")
    if problem.cost_function.loss is None:  # least squares cannot refine it
        return Discretisation(*costs, {}, {})
    finer = uninterrupted(refined(second, x, jobs, Watch(), tolerance=1e-6, budget=20)).best.point
    at = {problem.unknowns[i].target: i for i in problem.order_indices}
    at |= {name: at[to] for name, to in problem.ties.items() if to in at}
    shift = {n: float(finer[i] - x[i]) for n, i in at.items()}
    width = {n: max(LEAST_SHIFT, half_width(uncertainty, x, i)) for n, i in at.items()}
    warning = " ".join(
        f"{n} moves by {shift[n]:+.4f} when the equations are solved with pi2 at half the step: more than its "
        f"interval of ±{width[n]:.4f}, so it is in part an artefact of the step of {problem.method}."
        for n in at if abs(shift[n]) > width[n]
    )  # fmt: skip
    if problem.method == "pi2" and abs(costs[1] - costs[0]) > COARSE * costs[0]:
        warning = (
            f"The step is too coarse: at half of it the same values cost {costs[1]:.6g} instead of {costs[0]:.6g}. "
            f"Steep dry friction does this; type substeps = {2 * problem.substeps} in [fit]. {warning}"
        ).strip()
    return Discretisation(*costs, {n: float(finer[i]) for n, i in at.items()}, shift, warning)


def coarse_step(problem: Problem, check: Discretisation) -> Iterator[Finding]:
    """The discretisation check as a finding."""
    if not check.warning:
        return
    change = 100 * abs(check.cost_half_step / check.cost - 1) if check.cost > 0 else np.inf
    yield Finding(COARSE_STEP, "", change, 100 * COARSE, f"% of the cost at half the step of {problem.method}",
                  check.warning)  # fmt: skip
