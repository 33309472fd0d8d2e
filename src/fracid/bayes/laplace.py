r"""Laplace's approximation, corrected by importance sampling.

A posterior is nearly normal where the data are many.  How nearly is seen by simulation: points are drawn from a
multivariate Student's t with the mode, the covariance and the bounds of Laplace's approximation, tails heavier than
those of any posterior that it can stand for, and each is weighted by posterior over proposal.  The largest weights are
smoothed (:mod:`fracid.bayes.pareto`), and their :math:`\hat k` says whether the correction can be trusted.  The mean
weight is the evidence.

A parameter at a bound, such as a friction that is zero, has half of its approximation beyond it.  That half is folded
back, so that no draw is lost and the density stays exact.

Where the first draws leave many of the weights to a few, the proposal takes their weighted mean and covariance and
draws again, :data:`ROUNDS` times at most: adaptive importance sampling [PP]_.  The last proposal's draws alone count,
and are judged.

References
----------
.. [PP] T. Paananen, J. Piironen, P.-C. Bürkner, A. Vehtari, Statistics and Computing 31 (2021) 16.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.bayes.pareto import khat_limit, smoothed
from fracid.bayes.target import BoxPrior, GaussianApproximation, Likelihood
from fracid.errors import InputError, at_least
from fracid.tasks.job import Progress, Task
from fracid.tasks.tasks import Execution

__all__ = ["ImportanceSample", "StudentProposal", "importance_sample", "log_likelihoods"]

DEGREES = 7.0
"""Degrees of freedom of the proposal at most: in 15 dimensions 70 % of the draws of a normal posterior count."""

BATCH = 25
"""Draws of one task."""

PILOT = 400
"""Draws of a round that only improves the proposal."""

ROUNDS = 4
"""Proposals at most."""

GOOD = 0.2
"""No better proposal is looked for where so large a part of the draws counts."""

WORTHWHILE = 1.1
"""A proposal of which a part so many times as large counts is better."""

ENOUGH = 5
"""Draws for each parameter that tell a mean and a covariance."""

LEAST_DRAWS = 100
"""Fewer draws say nothing of a posterior's tail."""


@dataclass(frozen=True)
class StudentProposal:
    """A multivariate Student's t, folded about bounds that parameters lie at."""

    centre: FloatArray
    """Shape (n,)."""
    root: FloatArray
    """L of the scale matrix L L', shape (n, n)."""
    degrees: float
    """Of freedom."""
    mirrors: tuple[tuple[int, float, int], ...]
    """Parameter, its bound, and +1 if it lies above, −1 if below."""

    @classmethod
    def about(cls, shape: GaussianApproximation, prior: BoxPrior) -> StudentProposal:
        """The one with the mode and the scale of an approximation."""
        size = np.sqrt(np.diag(shape.covariance))
        values, vectors = np.linalg.eigh(shape.covariance / np.outer(size, size))
        root = size[:, None] * vectors * np.sqrt(np.maximum(values, 1e-10 * values[-1]))
        middle = 0.5 * (prior.lower + prior.upper)
        sides = [(i, *((prior.lower[i], 1) if shape.mean[i] <= middle[i] else (prior.upper[i], -1)))
                 for i in shape.folded]  # fmt: skip
        return cls(
            shape.mean, root, min(shape.degrees, DEGREES), tuple((i, float(bound), side) for i, bound, side in sides)
        )

    def draw(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Points, shape (count, n)."""
        normal = rng.standard_normal((count, len(self.centre)))
        x = self.centre + (normal @ self.root.T) / np.sqrt(rng.chisquare(self.degrees, (count, 1)) / self.degrees)
        for i, bound, side in self.mirrors:
            x[:, i] = bound + side * np.abs(x[:, i] - bound)
        return np.asarray(x)

    def log_density(self, x: FloatArray) -> FloatArray:
        """Of points on the inner side of all mirrors, shape (n_points,)."""
        from scipy.special import logsumexp

        images = []
        for flips in itertools.product((False, True), repeat=len(self.mirrors)):
            image = x.copy()
            for (i, bound, _), flipped in zip(self.mirrors, flips, strict=True):
                if flipped:
                    image[:, i] = 2 * bound - image[:, i]
            images.append(self._unfolded(image))
        return np.asarray(logsumexp(images, axis=0))

    def _unfolded(self, x: FloatArray) -> FloatArray:
        n, nu = len(self.centre), self.degrees
        z = np.linalg.solve(self.root, (x - self.centre).T)
        constant = math.lgamma((nu + n) / 2) - math.lgamma(nu / 2) - n / 2 * math.log(nu * math.pi)
        volume = float(np.linalg.slogdet(self.root)[1])
        return np.asarray(constant - volume - (nu + n) / 2 * np.log1p(np.sum(z**2, axis=0) / nu))


@dataclass(frozen=True)
class ImportanceSample:
    """Weighted draws of a posterior."""

    points: FloatArray
    """Shape (n_draws, n); without those of no weight."""
    log_weights: FloatArray
    """Of a sum of 1, shape (n_draws,)."""
    log_likelihood: FloatArray
    """Shape (n_draws,)."""
    log_evidence: float
    """Of the likelihood relative to its value at the minimum."""
    evidence_error: float
    """Its standard error [nats]."""
    khat: float
    draws: int
    """Of the proposal, those of no weight too."""
    simulations: int
    """With those that only improved the proposal."""

    @property
    def trusted(self) -> bool:
        """Whether k̂ is below its limit."""
        return self.khat < khat_limit(self.draws)

    @property
    def effective_draws(self) -> float:
        """1/Σw²."""
        return float(1 / np.sum(np.exp(2 * self.log_weights)))


def importance_sample(
    likelihood: Likelihood, prior: BoxPrior, shape: GaussianApproximation, *, draws: int, seed: int,
    execution: Execution | None = None,
) -> ImportanceSample:  # fmt: skip
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
    ...     def log_likelihood(self, x):
    ...         return -0.5 * float(x @ x)
    >>> box = BoxPrior(np.full(2, -10.0), np.full(2, 10.0), {})
    >>> sample = importance_sample(Normal(), box, GaussianApproximation(np.zeros(2), np.eye(2)), draws=1000, seed=1)
    >>> sample.trusted, bool(abs(sample.log_evidence - np.log(2 * np.pi / 400)) < 0.05)
    (True, True)
    """
    execution = execution or Execution()
    at_least("draws", draws, LEAST_DRAWS)
    best, simulations = None, 0
    for number, rng in enumerate(np.random.default_rng(seed).spawn(ROUNDS), 1):
        pilot = _Round(likelihood, prior, StudentProposal.about(shape, prior), f"round {number}", rng)
        pilot.extend(min(PILOT, draws), draws, execution)
        simulations += len(pilot.values)
        better = best is None or pilot.share > WORTHWHILE * best.share
        best = pilot if best is None or pilot.share > best.share else best
        if not better or best.share > GOOD:
            break
        shape = pilot.moved(shape)
    assert best is not None
    best.extend(draws - len(best.values), draws, execution)
    return best.sample(simulations + draws - min(PILOT, draws))


class _Round:
    """The draws of one proposal."""

    def __init__(
        self, likelihood: Likelihood, prior: BoxPrior, proposal: StudentProposal, name: str, rng: np.random.Generator
    ) -> None:
        self.likelihood, self.prior, self.proposal, self.name, self.rng = likelihood, prior, proposal, name, rng
        self.points = np.empty((0, len(proposal.centre)))
        self.values = np.empty(0)

    def extend(self, count: int, total: int, execution: Execution) -> None:
        """Draw so many more, and simulate those within the bounds."""
        before = len(self.values)
        points = self.proposal.draw(self.rng, count)
        values, inside = np.full(count, -np.inf), np.flatnonzero(self.prior.inside(points))
        batches = [inside[i : i + BATCH] for i in range(0, len(inside), BATCH)]
        tasks = [Task(f"{self.name}, draw {before + b[0]}", (self.likelihood, points[b])) for b in batches]
        tell = execution.progress
        told = None if tell is None else lambda p: tell(_in_draws(p, before, total))
        results = replace(execution, progress=told).run(log_likelihoods, tasks)
        for batch, values_of_batch in zip(batches, results.values(), strict=True):
            values[batch] = [-np.inf if v is None else v for v in values_of_batch]
        self.points = np.concatenate([self.points, points])
        self.values = np.concatenate([self.values, values])

    @property
    def log_ratios(self) -> FloatArray:
        """Posterior over proposal, −inf where there is no posterior, shape (n_draws,)."""
        ratios = np.full(len(self.values), -np.inf)
        some = np.isfinite(self.values)
        points = self.points[some]
        ratios[some] = self.values[some] + self.prior.log_density(points) - self.proposal.log_density(points)
        return ratios

    @property
    def share(self) -> float:
        """The part of the draws that counts, 0 where none has a posterior density."""
        ratios = self.log_ratios
        if not np.any(np.isfinite(ratios)):
            return 0.0
        weights = np.exp(ratios - np.max(ratios))
        return float(np.sum(weights) ** 2 / np.sum(weights**2) / len(weights))

    def moved(self, shape: GaussianApproximation) -> GaussianApproximation:
        """The weighted mean and covariance; the weights are flattened until enough draws take part."""
        ratios = self.log_ratios
        some = np.isfinite(ratios)
        if np.count_nonzero(some) < ENOUGH * len(shape.mean):
            return replace(shape, covariance=shape.covariance / 4)  # nearly all runs fail: closer to the minimum
        points, ratios = self.points[some], ratios[some] - np.max(ratios[some])
        power = 1.0
        while True:
            weights = np.exp(power * ratios)
            weights /= np.sum(weights)
            if 1 / np.sum(weights**2) >= min(ENOUGH * len(shape.mean), 0.5 * len(points)):
                break
            power *= 0.7
        mean = weights @ points
        for i in shape.folded:  # folded draws scatter about the bound
            mean[i] = shape.mean[i]
        deviation = points - mean
        return replace(shape, mean=mean, covariance=deviation.T @ (weights[:, None] * deviation))

    def sample(self, simulations: int) -> ImportanceSample:
        """All draws that count, with their smoothed weights."""
        from scipy.special import logsumexp

        ratios = self.log_ratios
        some = np.isfinite(ratios)
        if np.count_nonzero(some) < LEAST_DRAWS // 10:
            raise InputError(
                f"Of {len(ratios)} draws about the minimum {np.count_nonzero(some)} lie within the bounds and reach "
                "the end of the recording: the posterior cannot be drawn from there. Type --method nested."
            )
        weights, khat = smoothed(ratios[some])
        weights += np.max(ratios)
        total = float(logsumexp(weights))
        log_weights = weights - total
        spread = math.sqrt(max(float(np.sum(np.exp(2 * log_weights))) - 1 / len(ratios), 0.0))
        return ImportanceSample(self.points[some], log_weights, self.values[some], total - math.log(len(ratios)),
                                spread, khat, len(ratios), simulations)  # fmt: skip


def log_likelihoods(likelihood: Likelihood, points: FloatArray) -> list[float | None]:
    """Of some points, None where there is none.

    Parameters
    ----------
    likelihood : Likelihood
    points : array, shape (n_points, n)
    """
    values = [likelihood.log_likelihood(x) for x in points]
    return [v if math.isfinite(v) else None for v in values]


def _in_draws(p: Progress, before: int, total: int) -> Progress:
    """Progress by draws and not by batches."""
    return Progress(min(before + BATCH * p.done, total), total, before + BATCH * p.earlier, p.seconds)
