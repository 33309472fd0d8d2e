r"""How sure an estimate is: the covariance of the unknowns of a problem, and which of them cannot be told.

At the minimum of :math:`\tfrac12\sum r_t(x)^2` with Jacobian J and scores :math:`s_t = J_t r_t`,

.. math::  \mathrm{cov}\,\hat x = (J'J)^{-1}\, S\, (J'J)^{-1}, \qquad
           S = \Gamma_0 + \sum_{k=1}^{B}\Big(1 - \frac{k}{B+1}\Big)(\Gamma_k + \Gamma_k'), \quad
           \Gamma_k = \sum_t s_t s_{t+k}' .

This is the sandwich of Newey and West: it holds for residuals that are correlated in time, as 20,000
samples of a 1 kHz recording are, where :math:`\sigma^2 (J'J)^{-1}` would promise intervals many times too
narrow.  The bandwidth B follows Andrews' rule for the Bartlett window, from the residuals' own lag-one
correlation.  It does not know of model error: an interval says where the best value *of this model* lies.

An unknown at one of its bounds is held there; directions that J does not see (singular values of the
column-scaled J below 10⁻⁶ of the largest) are reported by the names that take part in them.

References
----------
.. [NW] W. Newey, K. West, Econometrica 55 (1987) 703: the sandwich.
.. [A] D. Andrews, Econometrica 59 (1991) 817, eq. (6.4): the bandwidth.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fracid.problem import Problem

__all__ = ["Uncertainty", "andrews_bandwidth", "bartlett_long_run", "jacobian", "uncertainty"]

FloatArray = NDArray[np.float64]

NORMAL_95 = 1.959963984540054
"""Half the width of a 95 % interval, in standard errors."""

UNSEEN = 1e-6
"""Singular values of the column-scaled Jacobian below this part of the largest count as zero."""


@dataclass(frozen=True)
class Uncertainty:
    """Standard errors of the unknowns, and what the data say nothing about."""

    standard_error: FloatArray
    """NaN where it cannot be known or the unknown lies at a bound, shape (n_unknowns,)."""
    at_bound: NDArray[np.bool_]
    """Shape (n_unknowns,)."""
    confounded: tuple[tuple[str, ...], ...]
    """Names that can only be known together, one tuple for each direction that the data do not see."""
    bandwidth: float
    """B of the sandwich [rows of the residual]."""
    condition: float
    """Of the column-scaled Jacobian."""

    def interval(self, x: FloatArray, i: int) -> tuple[float, float] | None:
        """The 95 % interval of unknown i, None where there is none."""
        se = float(self.standard_error[i])
        return (float(x[i]) - NORMAL_95 * se, float(x[i]) + NORMAL_95 * se) if math.isfinite(se) else None


def uncertainty(problem: Problem, x: FloatArray, *, jobs: int = 1) -> Uncertainty | str:
    """Find the covariance at the minimum x, or say why there is none.

    Examples
    --------
    >>> import fracid, numpy as np
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=2e-3, end=4.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((2001, 2))
    >>> swing = Experiment("twin", 2e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)})
    >>> found = uncertainty(problem, problem.start)
    >>> bool(np.all(found.standard_error[:2] < 0.01))
    True
    """
    names, space = problem.names, problem.space
    if not names:
        return "nothing is free"
    width = space.upper - space.lower
    margin = np.where(np.isfinite(width), 1e-6 * width, 0.0)
    at_bound = (x - space.lower <= margin) | (space.upper - x <= margin)
    free = np.flatnonzero(~at_bound)
    residual = problem.evaluate(x).residuals
    if residual is None:
        return "the cost has no residuals"
    J = jacobian(problem, x, free, jobs=jobs)
    if isinstance(J, str):
        return J
    error = np.full(len(x), np.nan)
    if not len(free):
        return Uncertainty(error, at_bound, (), 0.0, 1.0)
    norm = np.linalg.norm(J, axis=0)
    norm[norm == 0] = 1.0
    _, singular, V = np.linalg.svd(J / norm, full_matrices=False)
    seen = singular > UNSEEN * singular[0]
    scores = (J / norm) * residual[:, None]
    bandwidth = andrews_bandwidth(residual)
    inverse = (V[seen].T / singular[seen] ** 2) @ V[seen]  # pseudo-inverse of the scaled J'J
    covariance = inverse @ bartlett_long_run(scores, bandwidth) @ inverse
    known = ~np.any(np.abs(V[~seen]) > 0.1, axis=0)
    error[free[known]] = (np.sqrt(np.diag(covariance)) / norm)[known]
    confounded = tuple(tuple(names[free[i]] for i in np.flatnonzero(np.abs(v) > 0.1)) for v in V[~seen])
    return Uncertainty(error, at_bound, confounded, bandwidth, float(singular[0] / max(singular[-1], 1e-300)))


def jacobian(problem: Problem, x: FloatArray, free: NDArray[np.intp], *, jobs: int = 1) -> FloatArray | str:
    """∂r/∂x by central differences, shape (n_rows, n_free), or why there is none; runs go on threads."""
    steps = 1e-5 * np.maximum(np.abs(x), 1e-2 * np.minimum(problem.space.upper - problem.space.lower, 1.0))
    steps = np.minimum(steps, 0.5 * np.minimum(problem.space.upper - x, x - problem.space.lower) + (steps == 0))
    points = [x + sign * steps[i] * (np.arange(len(x)) == i) for i in free for sign in (1, -1)]
    with ThreadPoolExecutor(jobs) as pool:
        rows = list(pool.map(problem.evaluate, points))
    for evaluation in rows:
        if evaluation.residuals is None:
            return f"a run next to the minimum fails: {evaluation.reason}"
    columns = [
        (plus.residuals - minus.residuals) / (plus.point[i] - minus.point[i])
        for i, plus, minus in zip(free, rows[::2], rows[1::2], strict=True)
    ]
    return np.column_stack(columns) if columns else np.empty((0, 0))


def andrews_bandwidth(residual: FloatArray) -> float:
    """B = 1.1447·(α n)^(1/3), α = 4ρ²/((1−ρ)²(1+ρ)²), ρ the lag-one correlation; at most n/4.

    Examples
    --------
    >>> noise = np.random.default_rng(0).standard_normal(10_000)
    >>> andrews_bandwidth(noise) < 10 < andrews_bandwidth(np.cumsum(noise))
    True
    """
    n = len(residual)
    power = float(residual @ residual)
    rho = float(residual[1:] @ residual[:-1]) / power if power > 0 else 0.0
    rho = min(abs(rho), 1 - 1 / n)
    alpha = 4 * rho**2 / ((1 - rho) ** 2 * (1 + rho) ** 2)
    return min(n / 4, 1.1447 * (alpha * n) ** (1 / 3))


def bartlett_long_run(scores: FloatArray, bandwidth: float) -> FloatArray:
    """S with the Bartlett window: the mean square of all sums over B + 1 neighbouring scores.

    Examples
    --------
    >>> s = np.array([[1.0], [2.0], [3.0]])
    >>> float(bartlett_long_run(s, 0.0)[0, 0]), float(bartlett_long_run(s, 1.0)[0, 0])  # 14, 14 + ½·2·8
    (14.0, 22.0)
    """
    m = int(bandwidth) + 1
    padded = np.concatenate([np.zeros((m, scores.shape[1])), scores, np.zeros((m - 1, scores.shape[1]))])
    total = np.cumsum(padded, axis=0)
    blocks = total[m:] - total[:-m]
    return np.asarray(blocks.T @ blocks / m)
