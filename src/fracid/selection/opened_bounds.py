"""Bounds that stop a search, opened: the same model with a bound and without it.

A bound is where its author thinks that nothing is to be found, and mostly nothing is.  Where a search ends at one
beyond which the parameter means as much as before (:mod:`fracid.problem.limits`), least squares goes on from there with
the bound ten times as far away, three times at most.  The bound stays open only where that is worth it: where Schwarz's
criterion falls by more than 10, strong evidence, and the cost by more than 0.1 %, in one round or in all: the first
towards a value far away may gain little.  Then the fit says so, and ``opened_bounds`` in its result has where the bound
was and where it is.  ``hard = true`` in the table of a parameter holds its bounds.

Orders, releases, and what channels do are not opened, nor is a sign: a friction at 0 is not there.
"""

from __future__ import annotations

from dataclasses import dataclass

from fracid.errors import Failure, InputError
from fracid.estimation.climbing import embedded
from fracid.estimation.horizons import Watch, lowest_from
from fracid.findings import Words
from fracid.optimise import Evaluation
from fracid.problem import Free, Problem
from fracid.problem.limits import opened, with_bound, with_ranges
from fracid.safety.schema import Record
from fracid.selection.bic import STRONG, schwarz
from fracid.signals.correlation import effective_samples

SAYS = Words("selection/comparison.toml")

ROUNDS = 3
"""Times that bounds are opened tenfold."""

NEAR = 1e-3
"""A value nearer to a bound than this part of its range is stopped by it."""

LOWER = 1e-3
"""A cost that is lower by this part is lower."""


@dataclass(frozen=True)
class OpenedBound(Record):
    """One bound that was opened."""

    name: str
    """The parameter's."""
    unit: str
    upper: bool
    """Whether it was the upper one."""
    was: float
    """Where the project has it."""
    bound: float
    """Where it is now."""
    value: float
    """Where the search ends; of several recordings' the one furthest out."""
    cost: float
    """At the bounds as they were."""
    lowered: float
    """With all that were opened."""

    @property
    def sentence(self) -> str:
        """What it took, and what keeps the bound."""
        side, unit = "upper" if self.upper else "lower", f" {self.unit}" if self.unit else ""
        return SAYS("opened", b=self, side=side, unit=unit)


def open_bounds(problem: Problem, best: Evaluation, *, jobs: int = 1) -> tuple[Problem, Evaluation]:
    """Open the bounds that stop a search, where that is worth it.

    Returns
    -------
    Problem
        With the bounds that were opened; the same one where none was.
    Evaluation
        Its minimum.

    Examples
    --------
    A friction of 2·10⁻³ that is looked for up to 5·10⁻⁴:

    >>> import fracid, numpy as np
    >>> from fracid.problem import Experiment
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, parameters={"b_alpha": 2e-3},
    ...                       initial={"alpha": 0.5}, step=1e-2, end=6.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((601, 2))
    >>> swing = Experiment("twin", 1e-2, run.states[:, [0, 2]] + noise, np.zeros((1, 1)))
    >>> narrow = {"b_alpha": Free(3e-4, 0.0, 5e-4)}
    >>> problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": 1.0}, narrow, initial_state="held")
    >>> wider, end = open_bounds(problem, problem.evaluate(np.array([5e-4])))
    >>> wider.parameters["b_alpha"].upper, round(float(end.point[0]), 4)
    (0.005, 0.002)
    """
    kept = trial, further = problem, best
    for _ in range(ROUNDS if problem.cost_function.loss is not None else 0):
        wider, end = trial, further
        trial = with_ranges(wider, _stopping(wider, end))
        if trial is wider:
            break
        further = lowest_from(trial, embedded(trial, wider.named(end.point)), Watch(jobs))
        if not further.cost < end.cost:
            break
        if _is_worth_it(trial, further, kept[1]):
            kept = trial, further
    return kept


def _stopping(problem: Problem, end: Evaluation) -> dict[str, Free]:
    """The parameters that a bound stops which may be opened, with their wider ranges."""
    ranges: dict[str, Free] = {}
    for u, x in zip(problem.unknowns, end.point.tolist(), strict=True):
        if u.kind != "parameter" or u.target not in problem.parameters:
            continue
        near = NEAR * (u.range.upper - u.range.lower)
        for upper, away in ((True, u.range.upper - x), (False, x - u.range.lower)):
            if away <= near and (wider := opened(problem, u.target, upper=upper)) is not None:
                ranges[u.target] = wider
    return ranges


def _is_worth_it(problem: Problem, further: Evaluation, end: Evaluation) -> bool:
    """Whether the cost is lower by strong evidence."""
    errors = problem.errors(further.point)
    if isinstance(errors, Failure) or end.residuals is None or not further.cost < (1 - LOWER) * end.cost:
        return False
    n, k = effective_samples(errors, problem.scored), len(problem.names)
    before, after = (schwarz(e.value, k, n, problem.cost_function) for e in (end, further))
    return before - after > STRONG


def opened_bounds(problem: Problem, cost: float, wider: Problem, end: Evaluation) -> tuple[OpenedBound, ...]:
    """The bounds of a problem that a minimum lies beyond.

    Parameters
    ----------
    problem : Problem
        With the project's bounds.
    cost : float
        Of the minimum within them.
    wider : Problem
        With those that were opened.
    end : Evaluation
        Its minimum.
    """
    furthest: dict[tuple[str, bool], OpenedBound] = {}
    for u, x in zip(wider.unknowns, end.point.tolist(), strict=True):
        if u.kind != "parameter" or u.target not in problem.parameters or wider is problem:
            continue
        was, now = _range(problem, u.target), _range(wider, u.target)
        for upper, old, new in ((True, was.upper, now.upper), (False, was.lower, now.lower)):
            other = furthest.get((u.target, upper))
            if (x > old if upper else x < old) and (other is None or (x > other.value) == upper):
                furthest[u.target, upper] = OpenedBound(u.target, u.unit, upper, old, bound=new, value=x, cost=cost,
                                                        lowered=end.cost)  # fmt: skip
    return tuple(furthest.values())


def reopened(problem: Problem, bounds: tuple[OpenedBound, ...]) -> Problem:
    """A problem as a project has it with the bounds that a fit of it opened.

    Raises
    ------
    InputError
        If one is of no free parameter, or beyond what that means.

    Examples
    --------
    >>> import fracid, numpy as np
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> ranges = {"b_alpha": Free(0.1, 0.0, 1.0)}
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0}, ranges)
    >>> reopened(problem, (OpenedBound("b_alpha", "", True, 1.0, 10.0, 3.0, 2.0, 1.0),)).parameters["b_alpha"].upper
    10.0
    """
    for b in bounds:
        problem = with_ranges(problem, {b.name: with_bound(_range(problem, b.name), b.bound, upper=b.upper)})
    return problem


def _range(problem: Problem, name: str) -> Free:
    free = problem.parameters.get(name)
    if not isinstance(free, Free):
        raise InputError(f"A bound of {name!r} is said to be opened, and that is no free parameter.")
    return free
