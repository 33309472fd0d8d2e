r"""The evidence of a structure by Laplace's approximation, which costs no simulation beyond its derivatives.

To second order about the minimum the likelihood of :mod:`fracid.bayes.target` is

.. math::  \log L(\hat x + δ) = -\frac{ν + d}{2} \log\Big(1 + \frac{δ' C_S^{-1} δ}{ν} + \frac{2 s'δ}{ν + d}\Big) ,
           \qquad s = \frac{n_{eff}}{2 V} \frac{∂V}{∂x} ,

with a slope s where a parameter lies at a bound and the cost falls beyond.  Its mean over the prior is an integral of
this over a box.  Student's t is a mixture of normal densities, their precision in proportion to a w of a gamma
distribution, with a slope and a normal prior too; the part of each that lies in the box is found one parameter after
the other, each drawn between its bounds given those before [G]_.

What it leaves out is how far the model is from linear: ``fracid posterior`` asks for that, and says whether this
approximation was good.

References
----------
.. [G] A. Genz, J. Computational and Graphical Statistics 1 (1992) 141.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fracid.arrays import FloatArray
from fracid.bayes.target import SAYS, calibrated, joint_prior, require_likelihood
from fracid.errors import InputError
from fracid.problem import Problem
from fracid.problem.costs import Cost

DRAWS = 2**12
"""Of the integral, points of Sobol's sequence."""

TOUCHING = 1e-3
"""A parameter no further from its bound than this part of its range lies there, if the cost falls beyond."""

FLAT = 1e-3
"""Variance of a uniform prior over that of what keeps a direction that the data do not see from being singular."""


@dataclass(frozen=True)
class Evidence:
    """How probable a model makes what was recorded, averaged over its prior."""

    log_evidence: float
    """Relative to the greatest likelihood, never above 0 [nats]."""
    cost: float
    """The data's alone, at the minimum."""


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
    prior, centre = joint_prior(problem), likelihood.centre
    lower, upper = prior.lower - centre, prior.upper - centre
    slope = 0.5 * likelihood.samples / likelihood.scale * likelihood.gradient
    near = TOUCHING * (upper - lower)
    slope = np.where(-lower <= near, np.maximum(slope, 0.0), np.where(upper <= near, np.minimum(slope, 0.0), 0.0))
    linear, diagonal = np.zeros(len(centre)), FLAT * 12 / (upper - lower) ** 2
    for i, normal in prior.normal.items():
        diagonal[i] = normal.sd**-2
        linear[i] = (centre[i] - normal.mean) / normal.sd**2
    integral = log_box_integral(
        likelihood.precision, likelihood.degrees, slope, diagonal, linear=linear, lower=lower, upper=upper, seed=seed
    )
    return Evidence(float(prior.log_density(centre)) + integral, likelihood.cost)


def log_box_integral(
    precision: FloatArray, degrees: float, slope: FloatArray, diagonal: FloatArray, linear: FloatArray,
    lower: FloatArray, upper: FloatArray, *, seed: int = 1,
) -> float:  # fmt: skip
    r"""log ∫ (1 + x'Px/ν + 2s'x/(ν + d))^(−(ν + d)/2) exp(−x'Dx/2 − c'x) dx over a box that holds 0.

    Parameters
    ----------
    precision : array, shape (d, d)
        P.
    degrees : float
        ν.
    slope : array, shape (d,)
        s, uphill from where it is at an end of the box.
    diagonal : array, shape (d,)
        Of D; P + D is not singular.
    linear : array, shape (d,)
        c.
    lower, upper : array, shape (d,)
        Ends of the box, infinite ones too.
    seed : int
        Of the points.

    Examples
    --------
    >>> none, one = np.zeros(1), np.ones(1)
    >>> half = log_box_integral(np.eye(1), 1e6, none, none, none, none, np.inf * one)  # of a normal density
    >>> bool(abs(half - np.log(np.sqrt(2 * np.pi) / 2)) < 1e-4)
    True
    """
    from scipy.special import gammaincinv, gammaln, logsumexp
    from scipy.stats import truncnorm
    from scipy.stats.qmc import Sobol

    count = len(slope)
    size = 1 / np.sqrt(np.diag(precision) + diagonal)
    P, D, a, b = precision * np.outer(size, size), diagonal * size**2, lower / size, upper / size
    s, c = degrees / (degrees + count) * slope * size, linear * size
    spread = np.sqrt(np.diag(np.linalg.inv(P + np.diag(D))))
    order = np.argsort(-_log_part(a / spread, b / spread))  # what is cut off most is drawn first, from the end
    P, D, s, c, a, b = P[np.ix_(order, order)], D[order], s[order], c[order], a[order], b[order]
    points = np.clip(Sobol(count + 1, rng=seed).random(DRAWS), 1e-12, 1 - 1e-12)
    w = gammaincinv(degrees / 2, points[:, -1])
    precise = 2 * w[:, None] / degrees
    Q, pull = precise[..., None] * P + np.diag(D), precise * s + c
    root, mean = np.linalg.cholesky(Q), -np.linalg.solve(Q, pull[..., None])[..., 0]
    log_part, x = np.zeros(len(w)), np.zeros((len(w), count))
    for i in reversed(range(count)):
        scale = root[:, i, i]
        given = -np.einsum("nj,nj->n", root[:, i + 1 :, i], x[:, i + 1 :]) / scale
        low, high = (a[i] - mean[:, i] - given) * scale, (b[i] - mean[:, i] - given) * scale
        log_part += _log_part(low, high)
        x[:, i] = given + truncnorm.ppf(points[:, i], low, high) / scale
    volume = count / 2 * math.log(2 * math.pi) - np.sum(np.log(np.einsum("nii->ni", root)), axis=1)
    volume -= 0.5 * np.sum(mean * pull, axis=1)
    mixture = gammaln(degrees / 2) - gammaln((degrees + count) / 2) + count / 2 * np.log(w)
    return float(logsumexp(mixture + volume + log_part) - math.log(len(w)) + np.sum(np.log(size)))


def _log_part(low: FloatArray, high: FloatArray) -> FloatArray:
    """Logarithm of the part of the normal distribution between two values."""
    from scipy.special import log_ndtr

    beyond = low > 0  # both tails alike, without cancellation
    low, high = np.where(beyond, -high, low), np.where(beyond, -low, high)
    return np.asarray(log_ndtr(high) + np.log1p(-np.exp(np.minimum(log_ndtr(low) - log_ndtr(high), -1e-16))))


def require_evidence(problem: Problem) -> None:
    """Refuse what has none.

    Raises
    ------
    InputError
        For a user's own cost, and a free parameter with neither two bounds nor a prior.
    """
    if problem.names:
        require_likelihood(problem)
    for i in joint_prior(problem).unbounded:
        raise InputError(SAYS("no-evidence", name=problem.names[i]))


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
