r"""What repeating the experiment would give: resampled residuals, and each recording alone.

**Moving blocks** [K]_.  A record that might as well have been measured is the fitted one plus residuals drawn again:
blocks of l neighbouring residuals, all outputs together, laid end to end, less their mean at each place in a block, so
that their correlation in time outlives the shuffling.  l is five correlation times (Sokal's window, as in
:mod:`fracid.estimation.covariance`), so that a block's sum knows its scatter to some 10 %.  Each such record is fitted
again:

=============  ==============================================================================================
``one-step``   one Newton step with the Jacobian of the minimum, :math:`\hat x + A^{-1} \sum_t w_t ρ'(e^*_t) J_t`:
               thousands of draws in a second; it sees the noise, and nothing of the model's curvature
``refit``      a few steps of least squares from :math:`\hat x`, each with runs of the model: it also sees
               curvature, bounds, and a start that is taken from the first samples
=============  ==============================================================================================

The interval lies between the 2.5 % and 97.5 % quantiles of the draws.  It assumes that the residuals scatter alike all
along the record; the sandwich does not, and where the two differ by much, they do not.

**Recordings alone.**  Where there are several, each is fitted by itself.  What all share should come out the same
within each one's interval; how much it does not, as the factor :math:`\sqrt{χ^2/(k-1)}` of Birge [B]_, is model error
that no interval from residuals knows of.

References
----------
.. [K] H. Künsch, Ann. Statist. 17 (1989) 1217.
.. [B] R. Birge, Phys. Rev. 40 (1932) 207.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar, get_args

import numpy as np

from fracid.arrays import FloatArray
from fracid.cards import CardDisplay
from fracid.errors import Failure, InputError, at_least, unknown_name
from fracid.estimation.covariance import METHODS, residual_bandwidth, sandwich, uncertainty
from fracid.estimation.derivatives import jacobian, rows_and_scores
from fracid.estimation.profile_walk import refit
from fracid.problem import Problem
from fracid.safety.schema import as_json
from fracid.schemas.profiles import BootstrapBlock
from fracid.solver.trajectory import vector
from fracid.tasks.job import Progress, Task
from fracid.tasks.journal import Journal
from fracid.tasks.tasks import Execution

T = TypeVar("T")

Variant = Literal["one-step", "refit"]

QUICK: dict[str, Any] = {"tolerance": 1e-4, "budget": 6}
"""Of a refit where the loss is square, and a step from the minimum lands next to the new one."""

PATIENT: dict[str, Any] = {"tolerance": 1e-6, "budget": 60}
"""Of a refit for |e|, whose rows bend at every sample: stopped early it would scatter too little."""

FEW_BLOCKS = 20
"""Below so many blocks in all the scatter itself is badly known."""


@dataclass(frozen=True, repr=False)
class Bootstrap(CardDisplay):
    """Draws of the unknowns."""

    names: tuple[str, ...]
    variant: Variant
    x: FloatArray
    """The minimum, shape (n_unknowns,)."""
    draws: FloatArray
    """Shape (n_draws, n_unknowns); those whose runs failed are left out."""
    block: int
    """Length of a block [samples]."""
    failed: int
    """Draws left out."""
    warning: str = ""
    """Where there are too few blocks."""

    @property
    def standard_error(self) -> FloatArray:
        """Standard deviation of the draws, shape (n_unknowns,)."""
        return np.asarray(np.std(self.draws, axis=0, ddof=1))

    @property
    def bias(self) -> FloatArray:
        """Mean of the draws less the minimum, shape (n_unknowns,)."""
        return np.asarray(np.mean(self.draws, axis=0) - self.x)

    def interval(self, i: int) -> tuple[float, float]:
        """The 95 % interval of unknown i."""
        low, high = np.quantile(self.draws[:, i], [0.025, 0.975])
        return float(low), float(high)

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values, without the draws."""
        se, bias = self.standard_error.tolist(), self.bias.tolist()
        return as_json(BootstrapBlock, vars(self) | {
            "method": f"{METHODS['bootstrap']}, {self.variant}", "draws": len(self.draws),
            "unknowns": {n: {"standard_error": se[i], "bias": bias[i], "interval95": self.interval(i)}
                         for i, n in enumerate(self.names)},
        })  # fmt: skip


def bootstrap(
    problem: Problem,
    x: FloatArray,
    *,
    variant: Variant = "one-step",
    draws: int = 400,
    block: int | None = None,
    seed: int = 1,
    jobs: int = 1,
    executor: str = "threads",
    journal: Journal | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Bootstrap:
    """Draw the unknowns as often as if the experiment had been repeated.

    Parameters
    ----------
    problem : Problem
        With a cost of known loss.
    x : array, shape (n_unknowns,)
        Its minimum.
    variant : {"one-step", "refit"}
        See the module's table.
    draws : int
    block : int, optional
        Length of a block [samples]; five correlation times if left out.
    seed : int
        Each draw has its own stream, so that `jobs` changes nothing.
    jobs : int
        Threads, or processes of ``refit``.
    executor, journal, progress
        Of ``refit``, as for :func:`fracid.tasks.tasks.run_tasks`.

    Raises
    ------
    InputError
        For a user's own cost, nothing free, a run that fails at x, or an impossible option.
    Unfinished
        By ``refit``, as :func:`fracid.tasks.tasks.run_tasks`.

    Examples
    --------
    >>> from fracid.problem import Experiment
    >>> import fracid
    >>> from fracid.problem import Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=5e-3, end=2.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((401, 2))
    >>> swing = Experiment("twin", 5e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> problem = Problem(rig, (swing,), {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)},
    ...                   initial_state="held")
    >>> found = bootstrap(problem, refit(problem, problem.start).point, draws=50)
    >>> low, high = found.interval(1)
    >>> low < 0.95 < high
    True
    """
    if variant not in get_args(Variant):
        raise unknown_name("variant", variant, get_args(Variant))
    if problem.cost_function.loss is None:
        raise InputError(f"The cost {problem.cost_function.name} is a user's own, of unknown loss: no bootstrap of it.")
    if not problem.names:
        raise InputError("Nothing is free, so there is nothing to draw.")
    at_least("draws", draws, 2)
    errors = problem.errors(x)
    if isinstance(errors, Failure):
        raise InputError(f"There is nothing to draw from: the run at the minimum fails: {errors}.")
    length = round(residual_bandwidth(errors)) + 1 if block is None else at_least("block", block, 1)
    length = min(length, min(map(len, errors)))
    streams = np.random.default_rng(seed).spawn(draws)
    x = vector("x", x)
    estimates: Iterable[Any]
    if variant == "refit":
        tasks = [Task(f"draw {i}", (problem, x, errors, length, rng)) for i, rng in enumerate(streams, 1)]
        estimates = Execution(executor, jobs, journal, progress).run(_redrawn, tasks).values()
    else:
        estimates = _stepped(problem, x, errors, length, streams, at_least("jobs", jobs, 1))
    good = [point for point in estimates if point is not None]
    if len(good) < 2:
        raise InputError(f"All but {len(good)} of the {draws} refits failed: the minimum lies beside runs that fail.")
    blocks = sum(len(e) // length for e in errors)
    warning = (f"The residuals are autocorrelated over {length} samples, which leaves {blocks} blocks: the bootstrap's "
               "intervals are too narrow.") if blocks < FEW_BLOCKS else ""  # fmt: skip
    return Bootstrap(problem.names, variant, x, np.array(good), length, draws - len(good), warning)


def resampled(errors: FloatArray, length: int, rng: np.random.Generator, *, median: bool = False) -> FloatArray:
    """Blocks of residuals at random, laid end to end, of mean 0 over all draws at every sample.

    For |e| the minimum rests on the `median`: then that of the record is 0.

    Parameters
    ----------
    errors : array, shape (n_samples, n_outputs)
    length : int
        Of a block, at most n_samples.

    Examples
    --------
    >>> resampled(np.arange(4.0)[:, None], 4, np.random.default_rng(0)).ravel()  # one block: nothing left
    array([0., 0., 0., 0.])
    """
    n = len(errors)
    starts = rng.integers(0, n - length + 1, -(-n // length))
    sample = errors[(starts[:, None] + np.arange(length)).ravel()[:n]]
    if median:
        return np.asarray(sample - np.median(errors, axis=0))
    total = np.vstack([np.zeros_like(errors[:1]), np.cumsum(errors, axis=0)])
    mean = (total[n - length + 1 :] - total[:length]) / (n - length + 1)  # over all starts, at each place of a block
    return np.asarray(sample - np.tile(mean, (len(starts), 1))[:n])


def _rests_on_median(problem: Problem) -> bool:
    """Whether the minimum of the loss rests on the residuals' median."""
    loss = problem.cost_function.loss
    return loss is not None and loss.centre == "median"


def _stepped(
    problem: Problem, x: FloatArray, errors: list[FloatArray], length: int, streams: list[Any], jobs: int
) -> list[FloatArray]:
    """One Newton step for each draw; unknowns at their bounds stay."""
    precision = _known(uncertainty(problem, x, jobs=jobs))
    free = np.flatnonzero(~precision.at_bound)
    if not len(free):
        return [x.copy() for _ in streams]
    J = _known(jacobian(problem, x, free, jobs=jobs))
    shape = _known(sandwich(problem, x, free, jobs=jobs))
    median = _rests_on_median(problem)

    def step(rng: np.random.Generator) -> FloatArray:
        samples = [resampled(e, length, rng, median=median) for e in errors]
        _, scores = rows_and_scores(problem, samples, J)
        point = x.copy()
        point[free] -= shape.inverse @ sum((s.sum(axis=0) for s in scores), np.zeros(len(free)))
        return point

    return [step(rng) for rng in streams]


def _known(found: T | Failure) -> T:
    if isinstance(found, Failure):
        raise InputError(f"There is no Newton step: {found}.")
    return found


def _redrawn(
    problem: Problem, x: FloatArray, errors: list[FloatArray], length: int, rng: np.random.Generator
) -> list[float] | None:
    """A few steps of least squares for one draw; None where every run fails."""
    median = _rests_on_median(problem)
    pairs = zip(problem.experiments, errors, strict=True)
    moved = ((e, e.in_units(resampled(error, length, rng, median=median) - error)) for e, error in pairs)
    records = tuple(replace(e, measured=e.measured + by) for e, by in moved)
    best = refit(replace(problem, experiments=records), x, **(PATIENT if median else QUICK))
    return best.point.tolist() if math.isfinite(best.cost) else None
