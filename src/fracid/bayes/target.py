r"""The density that a posterior is drawn from: a likelihood as informative as the sandwich says, times the prior.

**The likelihood.**  Were residuals independent, the log likelihood would be the fall of the cost V over the noise, and
20,000 correlated samples would promise intervals many times too narrow.  So it is tempered by the sandwich
(:mod:`fracid.estimation.covariance`), :math:`C_S = A^{-1} S A^{-1}` with A the cost's curvature.  How another point
simulates the recording, :math:`Δ_t = f_t(x) - f_t(\hat x)`, is split into a change of parameters T that makes the same
difference to first order, and a remainder:

.. math::  T(x) = A^{-1} \sum_t \overline{ρ''}\, w_t J_t Δ_t, \qquad
           -\log L(x) = \frac{ν + d}{2} \log\Big(1 + φ \frac{T' C_S^{-1} T}{ν}\Big)
           + \frac{n_{eff}}{2 V(\hat x)} \Big(V(x) - V(\hat x) - \tfrac{φ}2\, T' A T\Big).

φ is the part of :math:`\tfrac12 T'AT` by which the cost does rise, 1 at most and 0 at least.  Without it L has no upper
bound where the cost grows more slowly than squares do, as that of ``weights = "noise"``: the logarithm does too.

Next to the minimum :math:`T = δ = x - \hat x`: the curvature is the sandwich's in every direction.  Far from it T is
what the model does there.  The remainder, which no change of parameters next to the minimum explains, counts by the
effective samples of the residual's correlation time (:func:`fracid.signals.correlation.effective_samples`).  For many
samples of white normal residuals :math:`C_S^{-1} = n A/2 V(\hat x)`, and L is the likelihood.  Without the remainder
this is the quasi-posterior of Chernozhukov and Hong [CH]_; with it, points that move the scores alike are
distinguished.  Müller [M]_ shows why the sandwich is the right curvature where a model is wrong.

ν stands for the few effective samples: the sandwich widens each standard error for them, by other factors for each of
d parameters, which would bend the correlations of a joint covariance.  So :math:`C_S` is taken before it is widened,
and ν is such that Student's t widens by the geometric mean of those factors.

Three known adjustments of a likelihood to the same end are not used [RCD]_:

- *one factor for all directions* has the right curvature in none;
- the *vertical* one [CB]_, a factor :math:`δ'C_S^{-1}δ/δ'Aδ` for each direction, serves the profiles of one parameter
  or two (:mod:`fracid.estimation.cost_profile`).  With 18, whose effective samples differ by 10⁴, the direction with
  the fewest makes up all of V, and its nonlinearity multiplies the misfit of all others;
- the *curvature* adjustment :math:`\log L(\hat x + Mδ)`, with a residual correlated over k samples, simulates a
  region :math:`\sqrt k` times too small, in which a bent valley looks straight and the bounds are not the model's.

The encoder's rounding is part of :math:`C_S`.

**The prior.**  Uniform between the bounds of the project, or the project's ``prior``, a normal density cut off at the
bounds.  Free parameters are independent beforehand.

References
----------
.. [CB] R. Chandler, S. Bate, Biometrika 94 (2007) 167, section 3.
.. [CH] V. Chernozhukov, H. Hong, J. Econometrics 115 (2003) 293.
.. [M] U. Müller, Econometrica 81 (2013) 1805.
.. [RCD] M. Ribatet, D. Cooley, A. Davison, Statistica Sinica 22 (2012) 813.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from fracid.arrays import BoolArray, FloatArray
from fracid.errors import Failure, InputError
from fracid.estimation.covariance import sandwich
from fracid.estimation.derivatives import differences, row_weights, scores_of, slopes_of
from fracid.estimation.long_records import as_fitted
from fracid.estimation.profile_walk import refit
from fracid.findings import Words
from fracid.problem import Problem
from fracid.problem.checks import require_free
from fracid.problem.unknowns import Free, Prior
from fracid.quantiles import NORMAL_95
from fracid.signals.correlation import effective_samples

SAYS = Words("bayes/target.toml")

FEWEST_DEGREES, MOST_DEGREES = 1.0, 1e4
"""Of Student's t: one has no mean, the other is the normal distribution."""

HEAVY = 7.0
"""Degrees of freedom of a proposal at most: in 15 dimensions 70 % of the draws of a normal posterior count."""

MOST = 1000
"""Draws for each that lies within the bounds, at most."""

FLAT = 1e-12
"""Relative curvature below which a direction counts as flat."""


class Likelihood(Protocol):
    """What the data say of points."""

    def log_likelihoods(self, points: FloatArray) -> list[float]:
        """Of each relative to its greatest; −inf where the model fails."""


@dataclass(frozen=True)
class BoxPrior:
    """Independent priors of the free parameters: uniform, or normal, between bounds."""

    lower: FloatArray
    """Shape (n,)."""
    upper: FloatArray
    """Shape (n,)."""
    normal: Mapping[int, Prior]
    """Free parameter → its normal density, of those that have one."""

    @property
    def unbounded(self) -> tuple[int, ...]:
        """Parameters with neither two bounds nor a normal prior: with one of them it is no density."""
        wide = np.flatnonzero(~np.isfinite(self.upper - self.lower)).tolist()
        return tuple(i for i in wide if i not in self.normal)

    def inside(self, x: FloatArray) -> Any:
        """Whether points lie within the bounds, shape (…,) of x of shape (…, n)."""
        return np.all((x >= self.lower) & (x <= self.upper), axis=-1)

    def log_density(self, x: FloatArray) -> FloatArray:
        """Of points within the bounds, shape (…,); up to a constant where some are :attr:`unbounded`."""
        uniform = np.isfinite(self.upper - self.lower)
        uniform[[*self.normal]] = False
        value = np.full(np.shape(x)[:-1], -np.sum(np.log(self.upper - self.lower)[uniform]))
        return np.asarray(value + sum(self._cut(i).logpdf(x[..., i]) for i in self.normal))

    def from_unit(self, u: FloatArray) -> FloatArray:
        """Points of the unit cube as points of the prior, shape (…, n)."""
        x = self.lower + u * (self.upper - self.lower)
        for i in self.normal:
            x[..., i] = self._cut(i).ppf(u[..., i])
        return np.asarray(np.clip(x, self.lower, self.upper))

    def _cut(self, i: int) -> Any:
        """A normal prior, cut off at the bounds."""
        from scipy.stats import truncnorm

        prior = self.normal[i]
        ends = ((b[i] - prior.mean) / prior.sd for b in (self.lower, self.upper))
        return truncnorm(*ends, loc=prior.mean, scale=prior.sd)


@dataclass(frozen=True)
class RecordedLikelihood:
    """The tempered likelihood of recordings; it can go to another process."""

    problem: Problem
    """Without its priors."""
    centre: FloatArray
    """x̂, the minimum of the cost, shape (n,)."""
    cost: float
    """There."""
    scale: float
    """V(x̂), in the unit of the curvature."""
    samples: float
    """n_eff of the remainder."""
    curvature: FloatArray
    """A, shape (n, n)."""
    precision: FloatArray
    """The inverse of C_S, shape (n, n)."""
    degrees: float
    """ν of Student's t."""
    errors: tuple[FloatArray, ...]
    """At x̂, of each recording, shape (n_samples, n_outputs)."""
    projection: tuple[FloatArray, ...]
    """What turns a change of the outputs into T, of each recording, shape (n_samples, n_outputs, n)."""
    gradient: FloatArray
    """∂V/∂x at x̂, no more than rounding but for parameters at a bound, shape (n,)."""

    def log_likelihoods(self, points: FloatArray) -> list[float]:
        """See the top of this module."""
        return [self._of(x, errors) for x, errors in zip(points, self.problem.all_errors(points), strict=True)]

    def _of(self, x: FloatArray, errors: list[FloatArray] | Failure) -> float:
        problem = self.problem
        if isinstance(errors, Failure) or not math.isfinite(cost := problem.criterion.cost(x, errors)):
            return -math.inf
        parts = zip(self.projection, self.errors, errors, strict=True)
        move = sum((np.einsum("toi,to->i", p, here - there) for p, here, there in parts), np.zeros(len(x)))
        rise = (cost / self.cost) ** (2 if problem.cost_function.root else 1) - 1
        to_second_order = 0.5 * float(move @ self.curvature @ move) / self.scale
        φ = min(max(rise, 0.0), to_second_order) / max(to_second_order, 1e-300)
        tangent = 0.5 * (self.degrees + len(x)) * math.log1p(φ * float(move @ self.precision @ move) / self.degrees)
        return -tangent - 0.5 * self.samples * (rise - φ * to_second_order)


@dataclass(frozen=True)
class GaussianApproximation:
    """Where a posterior lies, and how wide it is, to first order."""

    mean: FloatArray
    """Shape (n,)."""
    covariance: FloatArray
    """Shape (n, n)."""
    degrees: float = math.inf
    """Degrees of freedom of Student's t that the tails follow; no more than :data:`HEAVY` where it is drawn from."""

    @cached_property
    def root(self) -> FloatArray:
        """L of the scale matrix L L', shape (n, n)."""
        size = np.sqrt(np.diag(self.covariance))
        values, vectors = np.linalg.eigh(self.covariance / np.outer(size, size))
        return np.asarray(size[:, None] * vectors * np.sqrt(np.maximum(values, 1e-10 * values[-1])))

    def draw(self, prior: BoxPrior, rng: np.random.Generator, count: int) -> tuple[FloatArray, int]:
        """Points within the bounds, shape (count, n), and how many were drawn for them."""
        n, nu = len(self.root), min(self.degrees, HEAVY)
        kept, drawn = [np.empty((0, n))], 0
        while (lacking := count - sum(map(len, kept))) > 0 and drawn < MOST * count:
            normal = rng.standard_normal((count, n))
            x = self.mean + (normal @ self.root.T) / np.sqrt(rng.chisquare(nu, (count, 1)) / nu)
            inside = np.flatnonzero(prior.inside(x))[:lacking]
            kept.append(x[inside])
            drawn += int(inside[-1]) + 1 if len(inside) == lacking else count
        return np.concatenate(kept), drawn

    def log_density(self, x: FloatArray) -> FloatArray:
        """Of what is drawn, shape (n_points,): of all draws, those beyond the bounds counted too."""
        n, nu = len(self.root), min(self.degrees, HEAVY)
        z = np.linalg.solve(self.root, (x - self.mean).T)
        constant = math.lgamma((nu + n) / 2) - math.lgamma(nu / 2) - n / 2 * math.log(nu * math.pi)
        volume = float(np.linalg.slogdet(self.root)[1])
        return np.asarray(constant - volume - (nu + n) / 2 * np.log1p(np.sum(z**2, axis=0) / nu))


def joint_prior(problem: Problem) -> BoxPrior:
    """The prior that a project says: its bounds, and its ``prior``.

    Examples
    --------
    >>> import fracid
    >>> still = fracid.Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> mu = Free(0.9, 0.5, 1.0, prior=Prior(0.9, 0.01))
    >>> problem = fracid.Problem(fracid.rotary_pendulum(), (still,), {"lambda": Free(0.9, 0.5, 1.0), "mu": mu},
    ...                          initial_state="held")
    >>> prior = joint_prior(problem)
    >>> prior.unbounded, np.exp(prior.log_density(np.array([0.6, 0.9]))).round(2).item()  # 2 × 39.9
    ((), 79.79)
    """
    return BoxPrior(problem.space.lower, problem.space.upper, dict(problem.priors))


def likelihood_problem(problem: Problem) -> Problem:
    """The same problem without its priors, whose cost is the data's alone."""
    if not problem.priors:
        return problem

    def bare(values: Mapping[str, Any]) -> Any:
        return {n: replace(v, prior=None) if isinstance(v, Free) else v for n, v in values.items()}

    parts = (replace(e, initial=bare(e.initial), **bare({"release_time": e.release_time})) for e in problem.experiments)
    return replace(problem, experiments=tuple(parts), orders=bare(problem.orders), parameters=bare(problem.parameters))


def calibrated(problem: Problem, x: FloatArray, *, jobs: int = 1) -> tuple[RecordedLikelihood, tuple[str, ...]]:
    """Temper the likelihood of a problem about the minimum next to x; of long records that of coarser ones, as a fit.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum, or a point next to it.
    jobs : int
        Threads.

    Returns
    -------
    likelihood : RecordedLikelihood
    notes : tuple of str
        Parameters that the data do not identify.

    Raises
    ------
    InputError
        Where no likelihood can be tempered: a user's own cost, nothing free, a run that fails, parameters that neither
        the data nor a bound fixes.
    """
    require_likelihood(problem)
    x = problem.space.clipped(x)
    bare = as_fitted(likelihood_problem(problem), x)
    best = refit(bare, x)
    if not math.isfinite(best.cost):
        raise InputError(f"There is no posterior: no run of the model reaches the end of the recording: {best.reason}.")
    estimator = sandwich(bare, best.point, np.arange(len(x)), jobs=jobs)
    if isinstance(estimator, Failure):
        raise InputError(f"There is no posterior: the intervals of this fit cannot be computed: {estimator}.")
    unseen = np.flatnonzero(np.any(estimator.directions != 0, axis=0))
    if improper := [i for i in joint_prior(problem).unbounded if i in unseen]:
        raise InputError(SAYS("unbounded", name=problem.names[improper[0]]))
    names = " and ".join(problem.names[i] for i in unseen)
    notes = (f"The data do not identify {names}: there the posterior is the prior.",) if names else ()
    x = best.point
    J = differences(bare, x, np.arange(len(x)), jobs=jobs)
    assert not isinstance(J, Failure)  # the sandwich has computed it
    covariance = estimator.covariance / np.outer(estimator.widening, estimator.widening)
    curvature, precision = inverse(estimator.inverse), inverse(covariance)
    degrees = _degrees(float(np.exp(np.mean(np.log(estimator.widening)))))
    roots = row_weights(bare, J.errors)
    projection = tuple((-(w**2)[..., None] * j) @ estimator.inverse for w, j in zip(roots, J.parts, strict=True))
    scale = len(bare.outputs) * best.cost**2 if bare.cost_function.root else best.cost
    gradient = np.sum([s.sum(axis=0) for s in scores_of(slopes_of(bare, J.errors), J.parts)], axis=0)
    return RecordedLikelihood(bare, x, best.cost, scale, samples=effective_samples(J.errors, bare.scored),
                              curvature=curvature, precision=precision, degrees=degrees, errors=tuple(J.errors),
                              projection=projection, gradient=gradient), notes  # fmt: skip


def _degrees(widening: float) -> float:
    """The degrees of freedom of Student's t whose 95 % interval is so many times as wide as the normal's.

    Examples
    --------
    >>> round(_degrees(4.302653 / NORMAL_95), 3)
    2.0
    """
    from scipy.special import stdtridf

    return float(np.clip(stdtridf(0.975, NORMAL_95 * widening), FEWEST_DEGREES, MOST_DEGREES))


def approximation(likelihood: RecordedLikelihood, prior: BoxPrior, at_bound: BoolArray) -> GaussianApproximation:
    """The Gaussian that has the likelihood's curvature, times the prior's; a uniform one counts by its variance.

    Parameters
    ----------
    likelihood : RecordedLikelihood
    prior : BoxPrior
    at_bound : array of bool, shape (n,)
        Which parameters lie at a bound.
    """
    width = prior.upper - prior.lower
    mean, precision = np.where(np.isfinite(width), 0.5 * (prior.lower + prior.upper), 0.0), 12 / width**2
    for i, normal in prior.normal.items():
        mean[i], precision[i] = normal.mean, normal.sd**-2
    total, pull = likelihood.precision + np.diag(precision), likelihood.precision @ likelihood.centre + precision * mean
    centre, held = likelihood.centre.copy(), at_bound.copy()
    while not np.all(held):  # the mode of the others, given what is held: a correlated one moves with it
        centre[~held] = inverse(total[np.ix_(~held, ~held)]) @ (pull - total[:, held] @ centre[held])[~held]
        if not np.any(beyond := ~held & ((centre < prior.lower) | (centre > prior.upper))):
            break
        centre, held = np.clip(centre, prior.lower, prior.upper), held | beyond
    return GaussianApproximation(centre, inverse(total), likelihood.degrees)


def inverse(matrix: FloatArray) -> FloatArray:
    """The pseudo-inverse of a symmetric matrix whose rows have different units.

    Examples
    --------
    >>> inverse(np.diag([1e-12, 1.0, 0.0])).diagonal().tolist()
    [1000000000000.0, 1.0, 0.0]
    """
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    unit = np.where(size > 0, size, 1.0)
    relative = np.linalg.pinv(matrix / np.outer(unit, unit), rcond=FLAT, hermitian=True)
    return np.asarray(relative / np.outer(unit, unit))


def require_likelihood(problem: Problem) -> None:
    """Refuse a problem without a likelihood.

    Raises
    ------
    InputError
        If nothing is free, or the cost is a user's own.
    """
    require_free(problem.names)
    if problem.cost_function.loss is None:
        raise InputError(SAYS("own-cost", problem=problem))
