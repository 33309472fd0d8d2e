r"""Long records: searched as coarsely as the model allows, corrected by what every sample says.

An hour at 1 kHz takes a model a second, and a fit asks for thousands of runs.  So a fit of long records works on
coarser ones (:mod:`fracid.problem.coarse`): means of so many samples that :data:`PER_PERIOD` are left of a period, the
model stepped once for each.  What such steps get wrong moves the minimum.  At a point x the *defect*

.. math::  d(x) = y_h(x) - y_H(x)

of the outputs at the record's own step h and at the coarse step H is one run at h; the coarse problem with
:math:`y - d(x)` in place of what was measured has the residuals of the fine one at x, and nearly its minimum: after a
few rounds, each a hundredth as far as the last, x stays where it is, and has the fine problem's residuals with the
coarse one's derivatives [S]_.  All that is asked of a minimum after the search, its intervals, verdicts and
alternatives, is asked of that problem.

References
----------
.. [S] H. J. Stetter, Numer. Math. 29 (1978) 425: the defect correction principle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import SMALLEST, Failure, FailureReason
from fracid.estimation.bounded import lowest
from fracid.estimation.derivatives import difference_steps, jacobian
from fracid.estimation.horizons import Watch, lowest_from
from fracid.estimation.tangent import Tangent
from fracid.optimise import Evaluation
from fracid.problem import Experiment, Problem
from fracid.problem.coarse import as_samples, coarser, means, possible
from fracid.solver.methods import METHODS
from fracid.tasks.simulation_cache import Recent

LONG = 200_000
"""Samples, of all recordings that are fitted: from here on a search works on coarser ones."""

PER_PERIOD = 48
"""Coarse samples in a period."""

FEWEST = 50_000
"""Coarse samples of all recordings."""

STEPS = 1
"""Of the model for each coarse sample, where that is enough."""

DIFFERENT = 0.02
"""Of the motion: outputs that differ by more between steps and half steps ask for half steps."""

ROUNDS = 6
"""Of the correction."""

SMALL = 1e-3
"""A round that moves every unknown by less than this part of the first is the last."""

SHRINKS = 0.5
"""A round that moves the unknowns by more than this part of the one before has the wrong derivatives."""

ROUGHLY = (32, 0, 1000)
"""Coarse samples in a period, samples from which on, coarse samples of all: where they only tell about where it is."""

PART = 16_000
"""Coarse samples of a recording on which other models are compared with the fit."""

ENOUGH = 8_000
"""Samples of many recordings on which they are."""

TO_COMPARE = (10_000, 5_000)
"""Samples from which on they are compared on coarser recordings, and samples of those."""

TELLING = 30
"""Swings that such a part has at least."""

COPIES = 5
"""Of the derivatives, in what is made of them."""

DENSE = 512 << 20
"""Bytes of derivatives at most, which the correction takes as one matrix: of many recordings with unknowns of their own
they are sparse, and their search is that of :mod:`fracid.optimise.blockwise`, on every sample."""

MEMORY = 256 << 20
"""Bytes of simulated outputs that are kept where no folder keeps them."""


def coarse_problem(problem: Problem, sizes: tuple[int, int] | None = None) -> Problem:
    """The problem on coarser recordings; the same where they are short, fast or of a kind that cannot be coarser.

    Parameters
    ----------
    problem : Problem
    sizes : (int, int), optional
        Samples from which on it is, and that are left; :data:`LONG` and :data:`FEWEST` if left out.

    Examples
    --------
    >>> import fracid
    >>> t = 1e-3 * np.arange(300_000)
    >>> swing = Experiment("long", 1e-3, np.sin(6 * t)[:, None] * [0.1, 1.0], np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (swing,), {"lambda": 1.0, "mu": 1.0}, initial_state="held")
    >>> coarse = coarse_problem(problem)
    >>> len(coarse.experiments[0].measured), coarse.experiments[0].step, coarse.substeps
    (75000, 0.004, 1)
    """
    every = _every(problem, PER_PERIOD, *(sizes or (LONG, FEWEST)))
    if every == 1:
        return problem
    coarse = like(problem, every)
    coarse = replace(coarse, memo=problem.memo or Recent(MEMORY), substeps=STEPS)
    while coarse.substeps < every and _differ(coarse):
        coarse = replace(coarse, substeps=2 * coarse.substeps)
    return coarse


def like(problem: Problem, every: int) -> Problem:
    """The problem with each recording made coarser."""
    coarse = (coarser(e, every, problem.model.inputs) for e in problem.experiments)
    return replace(problem, experiments=tuple(coarse))


def is_coarse(problem: Problem) -> bool:
    """Whether its recordings are coarser ones."""
    return any(e.means > 1 for e in problem.experiments)


def on_every_sample(problem: Problem, sampled: Problem) -> Problem:
    """A problem, found on coarser recordings, on those of another one, from which they were made.

    Examples
    --------
    >>> import fracid
    >>> still = Experiment("still", 1e-3, np.zeros((300_000, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0}, initial_state="held")
    >>> [len(p.experiments[0].measured) for c in [coarse_problem(problem)] for p in (c, on_every_sample(c, problem))]
    [75000, 300000]
    """
    if not is_coarse(problem):
        return problem
    fine = tuple(
        replace(whole, initial=e.initial, sensors=e.sensors, actuators=e.actuators, between=e.between)
        for e, whole in zip(problem.experiments, sampled.experiments, strict=True)
    )
    return replace(problem, experiments=fine, substeps=sampled.substeps, memo=sampled.memo)


def own_substeps(problem: Problem, substeps: int = 1) -> int:
    """Steps for each coarse sample at so many for each sample of its source."""
    return substeps * max(e.means for e in problem.experiments)


def corrected(
    problem: Problem, x: FloatArray, substeps: int, jobs: int, *, rounds: int = ROUNDS
) -> tuple[Problem, Evaluation] | Failure:
    """The coarse problem with the residuals of finer steps, and its minimum; or why a run with these fails.

    Parameters
    ----------
    problem : Problem
        On coarser recordings.
    x : array, shape (n_unknowns,)
        Its minimum.
    substeps : int
        The finer steps, of a coarse sample.
    jobs : int
        Threads.
    rounds : int
        At most.
    """
    fine, moves = replace(problem, substeps=substeps), list[float]()
    J = jacobian(problem, x, np.arange(len(x)), jobs=jobs)
    for _ in range(rounds):
        exact = _with_defect(problem, fine, x)
        if isinstance(exact, Failure):
            return exact
        problem, before, errors = exact, x, exact.errors(x)
        too_far = len(moves) > 1 and moves[-1] > SHRINKS * moves[-2]  # for one Jacobian
        if isinstance(J, Failure) or isinstance(errors, Failure) or too_far:
            x = lowest_from(problem, x, Watch(jobs)).point
        else:
            here = Tangent(problem, problem.criterion(x, errors), errors, J)
            x = x + lowest(here.R, here.y, problem.space.lower - x, problem.space.upper - x)
        moves.append(float(np.max(np.abs(x - before) / difference_steps(problem, x), initial=0.0)))
        if moves[-1] <= SMALL * moves[0]:
            break
    return problem, problem.evaluate(x)


def _with_defect(problem: Problem, fine: Problem, x: FloatArray) -> Problem | Failure:
    experiments = []
    for e in problem.experiments:
        exact, coarse = (p.fitted(x, e) for p in (fine, problem))
        if isinstance(exact, Failure) or isinstance(coarse, Failure):
            return exact if isinstance(exact, Failure) else Failure(FailureReason.RUN, str(coarse))
        experiments.append(replace(e, measured=means(e.sampled.measured, e.means) - (exact - coarse)))
    return replace(problem, experiments=tuple(experiments))


def part_of(problem: Problem) -> Problem:
    """The first swings of coarser recordings, enough to tell models apart; all of those that hardly swing."""
    rows = max(len(e.measured) for e in problem.experiments)
    swings = min(e.swings for e in problem.experiments)
    if not is_coarse(problem) or rows <= 1.5 * PART or swings * PART / rows < TELLING:
        return problem
    return problem.until(PART * problem.experiments[0].step)


def some_of(problem: Problem) -> Problem:
    """Of many recordings as many, evenly picked, as tell models apart.

    Examples
    --------
    >>> import fracid
    >>> swings = tuple(Experiment(f"swing {k}", 1e-3, np.zeros((4000, 2)), np.zeros((1, 1))) for k in range(9))
    >>> problem = Problem(fracid.rotary_pendulum(), swings, {"lambda": 1.0, "mu": 1.0}, initial_state="held")
    >>> [e.name for e in some_of(problem).experiments]
    ['swing 0', 'swing 4', 'swing 8']
    """
    wholes, rows = [*problem.recordings.values()], sum(len(e.measured) for e in problem.experiments)
    every = min(round(rows / ENOUGH), math.ceil(len(wholes) / 2))
    if every <= 1:
        return problem
    picked = [e for _, at in wholes[::every] for e in problem.experiments[at]]
    return replace(problem, experiments=tuple(picked))


def to_compare(problem: Problem, others: Sequence[Experiment]) -> tuple[Problem, tuple[Experiment, ...]]:
    """A problem, and recordings beside it, as models are compared on them: of long ones the first swings, coarser.

    Examples
    --------
    >>> import fracid
    >>> t = 1e-3 * np.arange(300_000)
    >>> swing = Experiment("long", 1e-3, np.sin(6 * t)[:, None] * [0.1, 1.0], np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (swing,), {"lambda": 1.0, "mu": 1.0}, initial_state="held")
    >>> part, (beside,) = to_compare(problem, [replace(swing, name="beside")])
    >>> [(len(e.measured), e.step) for e in (part.experiments[0], beside)]
    [(16001, 0.004), (16001, 0.004)]
    """
    coarse = coarse_problem(problem)
    if not is_coarse(coarse):
        return problem, tuple(others)
    part, first = part_of(coarse), coarse.experiments[0]
    beside = [coarser(e, first.means, problem.model.inputs) if possible(e) else e for e in others]
    return part, tuple(beside if part is coarse else [e.until(PART * first.step) for e in beside])


def as_fitted(problem: Problem, x: FloatArray, sizes: tuple[int, int] | None = None) -> Problem:
    """A problem as a fit leaves it at x: on coarser recordings where these are long, with the residuals of its steps.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
    sizes : (int, int), optional
        As of :func:`coarse_problem`.

    Examples
    --------
    >>> import fracid
    >>> still = Experiment("still", 1e-3, np.full((300_000, 2), 0.1), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0}, initial_state="rest")
    >>> [len(p.experiments[0].measured) for p in (problem, as_fitted(problem, problem.start))]
    [300000, 75000]
    """
    coarse = coarse_problem(problem, sizes)
    if not is_coarse(coarse):
        return problem
    fine = replace(coarse, substeps=own_substeps(coarse, problem.substeps))
    exact = _with_defect(coarse, fine, x)
    return coarse if isinstance(exact, Failure) else exact


def on_all_samples(problem: Problem, costs: FloatArray, here: float, there: float) -> FloatArray:
    """Costs of means, or of a part, with what that leaves out: what is `here` is `there` on all samples.

    Examples
    --------
    >>> import fracid
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0})
    >>> on_all_samples(problem, np.array([3.0, 6.0]), 3.0, 5.0).round(3).tolist()  # rmse: its squares add up
    [5.0, 7.211]
    """
    if problem.cost_function.root and there >= here:
        return np.hypot(costs, math.sqrt(there**2 - here**2))
    return costs * (max(there, SMALLEST) / max(here, SMALLEST))


def memory_needed(problem: Problem) -> int:
    """Bytes that a fit takes, as measured on long and on many recordings.

    Examples
    --------
    >>> import fracid
    >>> still = Experiment("still", 1e-3, np.zeros((10_000, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0})
    >>> memory_needed(problem) / 10**6
    6.72
    """
    samples = sum(len(e.measured) for e in problem.experiments)
    unknowns = len(problem.names) if problem.blocks is None else len(problem.blocks.groups)
    run = 8 * (4 * len(problem.model.states) + 4 * len(problem.outputs) + 20)
    every = _every(problem, PER_PERIOD, LONG, FEWEST)
    return samples * run + 8 * COPIES * unknowns * len(problem.outputs) * samples // every


def thinned(problem: Problem, x: FloatArray) -> Problem:
    """The problem on coarser recordings, a step of ``pi2`` for each sample, with its own residuals at x.

    It tells cheaply about where another model of the same recordings has its minimum; the same problem where it cannot.

    Examples
    --------
    >>> import fracid
    >>> t = 1e-3 * np.arange(10_000)
    >>> swing = Experiment("swing", 1e-3, np.sin(6 * t)[:, None] * [0.1, 1.0], np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (swing,), {"lambda": 1.0, "mu": 1.0}, initial_state="rest")
    >>> [e.step for e in thinned(problem, problem.start).experiments]
    [0.008]
    """
    samples = replace(problem, experiments=tuple(map(as_samples, problem.experiments)))  # of means too
    every = 1 if problem.in_windows else _every(samples, *ROUGHLY)
    if every == 1:
        return problem
    coarse = replace(like(samples, every), method="pi2", substeps=STEPS, memo=Recent(MEMORY))
    exact = _with_defect(coarse, replace(coarse, method=problem.method, substeps=every * problem.substeps), x)
    return problem if isinstance(exact, Failure) else exact


def _every(problem: Problem, per_period: int, long: int, fewest: int) -> int:
    """Of how many samples the means are, a power of two; 1 where nothing is to be gained, or it cannot be."""
    samples = sum(len(e.measured) for e in problem.experiments)
    raw = METHODS[problem.method].raw
    if samples < long or raw or problem.cost_function.loss is None or not all(map(possible, problem.experiments)):
        return 1
    periods = [(len(e.measured) - 1) / e.swings if e.swings else math.inf for e in problem.experiments]
    most = min(min(periods) / per_period, samples / fewest)
    every = 1 << max(0, math.floor(math.log2(most)))
    return every if 8 * len(problem.names) * len(problem.outputs) * samples // every <= DENSE else 1


def _differ(problem: Problem) -> bool:
    """Whether half the step changes what is simulated from the start."""
    half = replace(problem, substeps=2 * problem.substeps)
    for e in problem.experiments:
        part, twice = problem.fitted(problem.start, e), half.fitted(problem.start, e)
        if isinstance(part, Failure) or isinstance(twice, Failure):
            return True
        if np.any(np.sqrt(np.mean((part - twice) ** 2, axis=0)) > DIFFERENT * np.std(e.measured, axis=0)):
            return True
    return False
