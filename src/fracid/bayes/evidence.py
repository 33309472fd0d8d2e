r"""The evidence of a structure by Laplace's approximation, which costs no simulation beyond its derivatives.

The likelihood of :mod:`fracid.bayes.target` without its remainder is a multivariate Student's t about the minimum.  Its
mean over the prior is an integral over what lies within the bounds, found by drawing from the same density: a friction
at its bound, a direction that the data do not see, and a normal prior count as they are.  What it leaves out is how far
the model is from linear; ``fracid posterior`` asks for that, and says whether this approximation was good.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fracid.arrays import FloatArray
from fracid.bayes.laplace import importance_sample
from fracid.bayes.target import RecordedLikelihood, approximation, calibrated, joint_prior, require_likelihood
from fracid.errors import InputError
from fracid.estimation.covariance import at_bound
from fracid.problem import Problem
from fracid.problem.costs import Cost

__all__ = ["Evidence", "laplace_evidence", "log_fit", "require_evidence"]

DRAWS = 4000
"""Of the integral: its standard error is below 0.03 nats."""


@dataclass(frozen=True)
class Evidence:
    """How probable a model makes what was recorded, averaged over its prior."""

    log_evidence: float
    """Relative to the greatest likelihood, never above 0 [nats]."""
    cost: float
    """The data's alone, at the minimum."""


@dataclass(frozen=True)
class _Tangent:
    """The likelihood without its remainder: what its curvature alone says."""

    likelihood: RecordedLikelihood

    def log_likelihood(self, x: FloatArray) -> float:
        return self.likelihood.tangent(x - self.likelihood.centre)


def laplace_evidence(problem: Problem, x: FloatArray, *, seed: int = 1, jobs: int = 1) -> Evidence:
    """Average the likelihood over the prior, by Laplace's approximation about the minimum next to x.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum.
    seed : int
        Of the integral's draws.
    jobs : int
        Threads.

    Raises
    ------
    InputError
        As :func:`require_evidence` does, and where the model's run fails.

    Examples
    --------
    Of one order known to ± 1e-4, where the prior has ± 0.25, some log(1e-4 √2π / 0.5) = −7.6 nats are left:

    >>> import fracid
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=5e-3, end=2.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((401, 2))
    >>> swing = Experiment("twin", 5e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> order = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.95, 0.7, 1.2)}, initial_state="held")
    >>> -9 < laplace_evidence(order, order.start).log_evidence < -6
    True
    """
    require_evidence(problem)
    if not problem.names:
        return Evidence(0.0, problem.cost(x))
    likelihood, _ = calibrated(problem, x, jobs=jobs)
    prior = joint_prior(problem)
    shape = approximation(likelihood, prior, at_bound(problem, likelihood.centre, jobs=jobs))
    sample = importance_sample(_Tangent(likelihood), prior, shape, draws=DRAWS, seed=seed)
    return Evidence(sample.log_evidence, likelihood.cost)


def require_evidence(problem: Problem) -> None:
    """Refuse what has none.

    Raises
    ------
    InputError
        For a user's own cost, and a free parameter with neither two bounds nor a prior.
    """
    if problem.names:
        require_likelihood(problem)
    prior = joint_prior(problem)
    unbounded = [n for i, n in enumerate(problem.names)
                 if i not in prior.normal and not math.isfinite(prior.upper[i] - prior.lower[i])]  # fmt: skip
    if unbounded:
        raise InputError(
            f"There is no evidence where a free parameter has no bounds, such as {unbounded[0]}: give it a lower and "
            "an upper one, or a prior = { mean = ..., sd = ... }."
        )


def log_fit(cost: float, samples: float, kind: Cost) -> float:
    """The greatest log likelihood, up to what all models of the same recordings have in common.

    Parameters
    ----------
    cost : float
        The least.
    samples : float
        As how many independent ones the residuals count, the same for all models that are compared.
    kind : Cost
        A root, or not; tells the likelihood of the errors.

    Examples
    --------
    >>> from fracid.problem.costs import COSTS
    >>> round(log_fit(1.0, 1000.0, COSTS["rmse"]) - log_fit(1.01, 1000.0, COSTS["rmse"]), 2)
    9.95
    """
    power = (2 if kind.root else 1) * (1 if kind.loss is None else kind.loss.likelihood_factor)
    return -0.5 * power * samples * math.log(max(cost, 1e-300))
