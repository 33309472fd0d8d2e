"""Agreement between recordings: each is fitted alone; do the estimates agree within their intervals?

For each shared parameter, with estimate v and standard error s of each of k recordings and weights w = 1/s², Birge's
ratio is √(Σ w (v − v̄)²/(k − 1)) about the weighted mean v̄: about 1 where the intervals account for the scatter, and the
factor by which they are too narrow where it is larger.  A model that is wrong in the same way everywhere passes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.cards import CardDisplay
from fracid.errors import Failure, InputError, at_least
from fracid.estimation.covariance import Known, uncertainty
from fracid.estimation.nearly_equal import chord_of_one, derivatives_of_each
from fracid.estimation.profile_walk import refit
from fracid.estimation.tangent import Tangent
from fracid.findings import Words
from fracid.problem import Problem
from fracid.safety.schema import Array, Listed, Record, Unknown, computed
from fracid.tasks.job import in_threads

SAYS = Words("estimation/agreement.toml")

# --- each recording alone ------------------------------------------------------------------------------


@dataclass(frozen=True)
class SpreadOfOne(Record):
    """One unknown, by each recording alone."""

    values: Array
    """Shape (n_recordings,); NaN where a recording's run fails."""
    standard_errors: Array
    """By the sandwich of each recording, shape (n_recordings,); NaN where it cannot tell."""

    @property
    def _told(self) -> tuple[FloatArray, FloatArray]:
        """Values and errors of the recordings that can tell."""
        tell = np.isfinite(self.values) & (self.standard_errors > 0)
        return self.values[tell], self.standard_errors[tell]

    @computed
    def standard_deviation(self) -> Unknown:
        """Over the recordings that can tell; NaN below two."""
        values, _ = self._told
        return float(np.std(values, ddof=1)) if len(values) > 1 else math.nan

    @computed
    def birge(self) -> Unknown:
        """√(χ²/(k − 1)) about the weighted mean: about 1 where the intervals are honest."""
        v, errors = self._told
        w = errors**-2.0
        return math.sqrt(np.sum(w * (v - np.sum(w * v) / np.sum(w)) ** 2) / (len(v) - 1)) if len(v) > 1 else math.nan


@dataclass(frozen=True, repr=False)
class Spread(CardDisplay, Record):
    """What each recording says alone of the unknowns that all share."""

    recordings: Listed[str]
    unknowns: Mapping[str, SpreadOfOne]

    @computed
    def sentences(self) -> tuple[str, ...]:
        """What the recordings do not agree on, in words."""
        apart = ((n, u.birge, u.values) for n, u in self.unknowns.items() if u.birge > 2)
        return tuple(SAYS("differs", name=n, ratio=r, low=np.nanmin(v), high=np.nanmax(v)) for n, r, v in apart)


def spread(problem: Problem, x: FloatArray, *, jobs: int = 1) -> Spread:
    """Fit each recording alone, from x.

    Parameters
    ----------
    problem : Problem
        With two recordings or more, and a cost of known loss.
    x : array, shape (n_unknowns,)
        The minimum of all together.
    jobs : int
        Threads.

    Raises
    ------
    InputError
        If there is but one recording, or the cost is a user's own.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> def swing(seed):
    ...     run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=5e-3, end=2.0)
    ...     noise = 1e-3 * np.random.default_rng(seed).standard_normal((401, 2))
    ...     return Experiment(f"{seed}", 5e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> problem = Problem(rig, (swing(1), swing(2), swing(3)), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)},
    ...                   initial_state="held")
    >>> spread(problem, problem.start).unknowns["mu"].birge < 2
    True
    """
    if len(problem.recordings) < 2:
        raise InputError("There is one recording to fit; a spread needs two or more.")
    if problem.cost_function.loss is None:
        raise InputError(f"The cost {problem.cost_function.name} is a user's own, of unknown loss: no spread of it.")
    shared = [i for i, u in enumerate(problem.unknowns) if u.experiment is None]
    at = problem.named(np.asarray(x))

    J = derivatives_of_each(problem, np.asarray(x), jobs)

    def alone(name: str) -> tuple[FloatArray, FloatArray]:
        one = replace(problem, experiments=problem.experiments[problem.recordings[name][1]])
        best, precision = _alone(one, one.point(at), J.get(name))
        if precision is None or isinstance(precision, Failure):
            return np.full(len(shared), np.nan), np.full(len(shared), np.nan)
        where = [one.names.index(problem.names[i]) for i in shared]
        return best[where], precision.standard_error[where]

    estimates = in_threads(at_least("jobs", jobs, 1), alone, problem.recordings)
    values, errors = (np.array(rows) for rows in zip(*estimates, strict=True))
    return Spread(tuple(problem.recordings), {
        problem.names[i]: SpreadOfOne(*of_one) for i, *of_one in zip(shared, values.T, errors.T, strict=True)
    })  # fmt: skip


def _alone(one: Problem, x: FloatArray, J: FloatArray | None) -> tuple[FloatArray, Known | None]:
    """The minimum of one recording, and what is known there: by the derivatives at x, where those lead to it."""
    near = None if J is None else chord_of_one(one, x, J)
    if J is not None and near is not None:
        errors = one.errors(near)
        tangent = None if isinstance(errors, Failure) else Tangent(one, one.criterion(near, errors), errors, [J])
        return near, uncertainty(one, near, near=tangent)
    best = refit(one, x)
    return best.point, uncertainty(one, best.point) if math.isfinite(best.cost) else None
