r"""Laplace's approximation, corrected by importance sampling.

A posterior is nearly normal where the data are many.  How nearly is seen by simulation: points are drawn from a
multivariate Student's t with the mode, the covariance and the bounds of Laplace's approximation, tails heavier than
those of any posterior that it can stand for, and each is weighted by posterior over proposal.  The largest weights are
smoothed (:mod:`fracid.bayes.pareto`), and their :math:`\hat k` says whether the correction can be trusted.  The mean
weight is the evidence.

A parameter at a bound, such as a friction that is zero, has half of its approximation beyond it.  What is drawn there
is drawn again, which costs no simulation and keeps the correlations with the other parameters.

Where the first draws leave many of the weights to a few, the proposal takes their weighted mean and covariance and
draws again, :data:`ROUNDS` times at most: adaptive importance sampling [PP]_.  The last proposal's draws alone count,
and are judged.

References
----------
.. [PP] T. Paananen, J. Piironen, P.-C. Bürkner, A. Vehtari, Statistics and Computing 31 (2021) 16.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.bayes.pareto import khat_limit, smoothed
from fracid.bayes.target import SAYS, BoxPrior, GaussianApproximation, Likelihood
from fracid.errors import InputError, at_least
from fracid.tasks.job import Progress, Task
from fracid.tasks.tasks import HERE, Execution

BATCH = 25
"""Draws of one task."""

PILOT = 400
"""Draws of the first round; each following has so many more, if so many of it promise a better proposal."""

ROUNDS = 3
"""Proposals at most."""

GOOD = 0.2
"""No better proposal is looked for where so large a part of the draws counts."""

WORTHWHILE = 1.1
"""A proposal of which a part so many times as large counts is better."""

ENOUGH = 10
"""Draws for each parameter that tell a mean and a covariance."""

MISSED = 3.0
"""Nested draws whose log evidence is less than that about the minimum by more than this have missed it; of draws that
have not, one set in twenty at most does so by chance, by Markov's inequality."""

LEAST_DRAWS = 100
"""Fewer draws say nothing of a posterior's tail."""


@dataclass(frozen=True)
class WeightedDraws:
    """Of a posterior."""

    points: FloatArray
    """Draws, without those whose runs fail, shape (n_draws, n_unknowns)."""
    log_weights: FloatArray
    """Logarithms of their weights, whose sum is 1, shape (n_draws,)."""
    log_evidence: float
    """log ∫ L(x)/L(x̂) π(x) dx, never above 0: what the model loses by being free [nats].  NaN where the prior is no
    density."""
    evidence_error: float
    """Its standard error [nats]."""
    simulations: int
    """Points at which the likelihood was asked for, with those that only improved the proposal."""
    khat: float = math.nan
    """The shape of the tail of the importance weights; NaN for nested sampling."""
    draws: int = 0
    """Of an importance sample: those within the bounds, whose runs fail too."""
    log_mass: float = -math.inf
    """Of nested sampling: the part of the evidence about the minimum of the cost [nats]; see :func:`log_mass_about`."""

    @property
    def limit(self) -> float:
        """k̂ must be below it; NaN for nested sampling."""
        return khat_limit(self.draws) if self.draws else math.nan

    @property
    def trusted(self) -> bool:
        """Whether k̂ is below its limit, or the evidence of nested sampling includes that about the minimum."""
        return self.khat < self.limit if self.draws else self.log_mass < self.log_evidence + MISSED

    @property
    def effective_draws(self) -> float:
        """As many independent draws tell the mean as well: 1/Σw²."""
        return float(1 / np.sum(np.exp(2 * self.log_weights)))


def importance_sample(
    likelihood: Likelihood, prior: BoxPrior, shape: GaussianApproximation, *, draws: int, seed: int,
    execution: Execution = HERE,
) -> WeightedDraws:  # fmt: skip
    """Draw from Laplace's approximation, and weight.

    Parameters
    ----------
    likelihood : Likelihood
    prior : BoxPrior
    shape : GaussianApproximation
        Where the first proposal lies.
    draws : int
    seed : int
        Each round has its own stream, so that `execution` changes nothing.
    execution : Execution, optional
        Where the simulations run; its journal keeps them.

    Raises
    ------
    InputError
        If no draw has a posterior density: the approximation lies outside of the bounds, or every run fails.

    Examples
    --------
    >>> class Normal:
    ...     def log_likelihoods(self, points):
    ...         return [-0.5 * float(x @ x) for x in points]
    >>> box = BoxPrior(np.full(2, -10.0), np.full(2, 10.0), {})
    >>> sample = importance_sample(Normal(), box, GaussianApproximation(np.zeros(2), np.eye(2)), draws=1000, seed=1)
    >>> sample.trusted, bool(abs(sample.log_evidence - np.log(2 * np.pi / 400)) < 0.05)
    (True, True)
    """
    at_least("draws", draws, LEAST_DRAWS)
    rounds, share = list[_Round](), 0.0
    for number, rng in enumerate(np.random.default_rng(seed).spawn(ROUNDS), 1):
        pilot = _Round(likelihood, prior, shape, f"laplace, {draws} draws, seed {seed}, round {number}", rng=rng)
        pilot.extend(min(number * PILOT, draws), draws, execution, than=share)
        rounds.append(pilot)
        better, share = pilot.share >= WORTHWHILE * share, max(share, pilot.share)
        if not better or share > GOOD:
            break
        shape = pilot.moved()
    best = max(rounds, key=lambda r: r.share)
    best.extend(draws - len(best.values), draws, execution)
    return best.sample(sum(len(r.values) for r in rounds))


def log_mass_about(
    likelihood: Likelihood, prior: BoxPrior, shape: GaussianApproximation, *, seed: int, execution: Execution
) -> float:
    """The mean weight of :data:`PILOT` draws from Laplace's approximation, without bias: the evidence, or less of it.

    Parameters
    ----------
    likelihood, prior, shape, seed, execution
        As of :func:`importance_sample`.

    Returns
    -------
    float
        Its logarithm [nats], −inf where every run fails.
    """
    from scipy.special import logsumexp

    pilot = _Round(likelihood, prior, shape, f"about the minimum, seed {seed}", rng=np.random.default_rng(seed))
    pilot.extend(PILOT, PILOT, replace(execution, progress=None))
    return float(logsumexp(pilot.log_ratios)) - math.log(pilot.drawn)


class _Round:
    """The draws of one proposal."""

    def __init__(
        self, likelihood: Likelihood, prior: BoxPrior, shape: GaussianApproximation, name: str, rng: np.random.Generator
    ) -> None:
        self.likelihood, self.prior, self.shape, self.name, self.rng = likelihood, prior, shape, name, rng
        self.points, self.values, self.drawn = np.empty((0, len(shape.mean))), np.empty(0), 0

    def extend(self, count: int, total: int, execution: Execution, *, than: float = 0.0) -> None:
        """Draw so many more, and simulate them, or the first alone where no greater part than `than` counts."""
        points, drawn = self.shape.draw(self.prior, self.rng, count)
        self.drawn += drawn
        first = PILOT if than > 0 else len(points)
        self._simulate(points[:first], total, execution)
        if first < len(points) and self.share > than:
            self._simulate(points[first:], total, execution)

    def _simulate(self, points: FloatArray, total: int, execution: Execution) -> None:
        before, tell = len(self.values), execution.progress
        told = None if tell is None else lambda p: tell(  # by draws and not by batches
            Progress(min(before + BATCH * p.done, total), total, before + BATCH * p.earlier, p.seconds))  # fmt: skip
        how = replace(execution, progress=told)
        values = simulated(self.likelihood, points, f"{self.name}, after {before}", BATCH, execution=how)
        self.points, self.values = np.concatenate([self.points, points]), np.append(self.values, values)

    @property
    def log_ratios(self) -> FloatArray:
        """Posterior over proposal, −inf where a run fails, shape (n_draws,)."""
        return np.asarray(self.values + self.prior.log_density(self.points) - self.shape.log_density(self.points))

    @property
    def share(self) -> float:
        """The part of the draws that counts, 0 where every run fails."""
        ratios = self.log_ratios
        if not np.any(np.isfinite(ratios)):
            return 0.0
        weights = np.exp(ratios - np.max(ratios))
        return float(np.sum(weights) ** 2 / np.sum(weights**2) / len(weights))

    def moved(self) -> GaussianApproximation:
        """The weighted mean and covariance; the weights are flattened until enough draws take part."""
        ratios, shape = self.log_ratios, self.shape
        some, enough = np.isfinite(ratios), ENOUGH * len(shape.mean)
        if np.count_nonzero(some) < enough:
            return replace(shape, covariance=shape.covariance / 4)  # nearly all runs fail: closer to the minimum
        points, ratios = self.points[some], ratios[some] - np.max(ratios[some])
        power = 1.0
        while True:
            weights = np.exp(power * ratios)
            weights /= np.sum(weights)
            if 1 / np.sum(weights**2) >= min(enough, 0.5 * len(points)):
                return replace(shape, mean=weights @ points, covariance=weighted_covariance(points, weights))
            power *= 0.7

    def sample(self, simulations: int) -> WeightedDraws:
        """All draws that count, with their smoothed weights."""
        from scipy.special import logsumexp

        ratios = self.log_ratios
        some = np.isfinite(ratios)
        if np.count_nonzero(some) < LEAST_DRAWS // 10:
            raise InputError(SAYS("few-draws", drawn=self.drawn, count=np.count_nonzero(some)))
        weights, khat = smoothed(ratios[some])
        weights += np.max(ratios)
        total = float(logsumexp(weights))
        log_weights = weights - total
        error = math.sqrt(max(float(np.sum(np.exp(2 * log_weights))) - 1 / self.drawn, 0.0))
        return WeightedDraws(self.points[some], log_weights, total - math.log(self.drawn), error,
                             simulations=simulations, khat=khat, draws=len(ratios))  # fmt: skip


def weighted_covariance(points: FloatArray, weights: FloatArray) -> FloatArray:
    """Of points of shape (n_points, n) about their weighted mean, shape (n, n)."""
    return np.atleast_2d(np.cov(points, rowvar=False, bias=True, aweights=weights))


def simulated(likelihood: Likelihood, points: FloatArray, name: str, size: int, execution: Execution) -> FloatArray:
    """The log likelihoods of points, −inf where there is none, so many in a task, shape (n_points,)."""
    tasks = [Task(f"{name}, {i}", (likelihood, points[i : i + size])) for i in range(0, len(points), size)]
    batches = execution.run(log_likelihoods, tasks).values()
    return np.array([-math.inf if v is None else v for batch in batches for v in batch])


def log_likelihoods(likelihood: Likelihood, points: FloatArray) -> list[float | None]:
    """Of some points, None where there is none.

    Parameters
    ----------
    likelihood : Likelihood
    points : array, shape (n_points, n)
    """
    return [v if math.isfinite(v) else None for v in likelihood.log_likelihoods(points)]
