r"""How sure an estimate is: the covariance of the unknowns of a problem, and which of them cannot be told.

At the minimum of :math:`\sum_t w_t\,ρ(e_t(x))` over samples t, with :math:`J_t = \partial e_t/\partial x` and
scores :math:`s_t = w_t\,ρ'(e_t)\,J_t`,

.. math::  \mathrm{cov}\,\hat x = A^{-1} S A^{-1}, \quad A = \overline{ρ''}\sum w_t J_t J_t', \quad
           S = \Gamma_0 + \sum_{k=1}^{B}\Big(1 - \frac{k}{B+1}\Big)(\Gamma_k + \Gamma_k'), \;
           \Gamma_k = \sum_t s_t s_{t+k}' .

This is the M-estimator's sandwich [H]_ with the long-run covariance of Newey and West [NW]_: it holds for
residuals that are correlated in time, as 20,000 samples of a 1 kHz recording are, where
:math:`\sigma^2 (J'J)^{-1}` would promise intervals many times too narrow.  The bandwidth B is five correlation
times of the scores, found from them by Sokal's window [S]_; the scores are whitened by their lag-one correlation
before, and S is coloured again after [AM]_.  How often a 95 % interval of λ and of μ holds the truth, on twins of
4 s at 500 Hz, 150 seeds (``benchmarks/evidence.py`` prints it again):

====================================== ============== ==========================
noise                                  this           :math:`\sigma^2 (J'J)^{-1}`
====================================== ============== ==========================
white                                  94 %, 95 %     94 %, 95 %
AR(1), ρ = 0.9                         90 %, 93 %     28 %, 38 %
AR(1), ρ = 0.98, and as much white     79 %, 93 %     19 %, 31 %
====================================== ============== ==========================

So where errors are slow beside the record, as in the last row, it still promises too much.
It does not know of model error: an interval says where the best value *of this model* lies.

An unknown at one of its bounds is held there; directions that J does not see (singular values of the
column-scaled J below 10⁻⁶ of the largest) are reported by the names that take part in them.

References
----------
.. [H] P. Huber, Proc. 5th Berkeley Symposium 1 (1967) 221.
.. [NW] W. Newey, K. West, Econometrica 55 (1987) 703: the sandwich.
.. [S] A. Sokal, in Functional Integration: Basics and Applications, NATO ASI B 361 (1997) 131: the bandwidth.
.. [AM] D. Andrews, J. Monahan, Econometrica 60 (1992) 953: whitening, and its limit of 0.97.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fracid.optimise import Space
from fracid.problem import Problem

__all__ = ["Uncertainty", "bartlett_long_run", "jacobian", "sokal_bandwidth", "uncertainty"]

FloatArray = NDArray[np.float64]

NORMAL_95 = 1.959963984540054
"""Half the width of a 95 % interval, in standard errors."""

UNSEEN = 1e-6
"""Singular values of the column-scaled Jacobian below this part of the largest count as zero."""

PART = 1e-2
"""Who has less than this of the largest share in an unseen direction takes no part in it."""

WHITENED = 0.97
"""Limit of the correlation that is taken out before S is estimated [AM]_."""

BOUND = 1e-3
"""An unknown within this part of its range of a bound lies at it."""


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
    """B of the sandwich [samples]."""
    condition: float
    """Of the column-scaled Jacobian."""

    def interval(self, x: FloatArray, i: int) -> tuple[float, float] | None:
        """The 95 % interval of unknown i, None where there is none."""
        se = float(self.standard_error[i])
        return (float(x[i]) - NORMAL_95 * se, float(x[i]) + NORMAL_95 * se) if math.isfinite(se) else None


def uncertainty(problem: Problem, x: FloatArray, *, jobs: int = 1) -> Uncertainty | str:
    """Find the covariance at the minimum x, or say why there is none.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum; elsewhere the result means nothing.
    jobs : int
        Threads.

    Returns
    -------
    Uncertainty or str
        The sentence says why there is none: nothing is free, a user's own cost, a run that fails.

    Examples
    --------
    >>> import fracid, numpy as np
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=2e-3, end=4.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((2001, 2))
    >>> swing = Experiment("twin", 2e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> problem = Problem(rig, (swing,), {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)},
    ...                   initial_state="held")
    >>> found = uncertainty(problem, problem.start)  # here the start is the minimum
    >>> bool(np.all((found.standard_error > 1e-6) & (found.standard_error < 1e-3))), found.confounded
    (True, ())
    """
    if not problem.names:
        return "nothing is free"
    if problem.cost_function.loss is None:
        return f"the cost {problem.cost_function.name} is a user's own, of unknown loss"
    at_bound = _at_bound(problem.space, x)
    free = np.flatnonzero(~at_bound)
    error = np.full(len(x), np.nan)
    if not len(free):
        return Uncertainty(error, at_bound, (), 0.0, 1.0)
    errors, J = problem.errors(x), jacobian(problem, x, free, jobs=jobs)
    if isinstance(errors, str) or isinstance(J, str):
        return errors if isinstance(errors, str) else str(J)
    rows, scores = _rows_and_scores(problem, errors, J)
    norm = np.linalg.norm(rows, axis=0)
    norm[norm == 0] = 1.0
    _, singular, V = np.linalg.svd(rows / norm, full_matrices=False)
    seen = singular > UNSEEN * singular[0]
    S, bandwidth = _long_run([s / norm for s in scores])
    inverse = (V[seen].T / singular[seen] ** 2) @ V[seen]  # pseudo-inverse of the scaled A
    covariance = inverse @ S @ inverse
    size = np.maximum(np.abs(x), 1e-2 * np.minimum(problem.space.upper - problem.space.lower, 1.0))[free]
    partners = _sparse(V[~seen] / (norm * size))
    known = ~np.any(partners, axis=0)
    error[free[known]] = (np.sqrt(np.diag(covariance)) / norm)[known]
    confounded = tuple(tuple(problem.names[free[i]] for i in np.flatnonzero(row)) for row in partners)
    return Uncertainty(error, at_bound, confounded, bandwidth, float(singular[0] / max(singular[-1], 1e-300)))


def _at_bound(space: Space, x: FloatArray) -> NDArray[np.bool_]:
    """Which unknowns lie within a thousandth of their range of a bound."""
    width = space.upper - space.lower
    margin = np.where(np.isfinite(width), BOUND * width, 0.0)
    return np.asarray((x - space.lower <= margin) | (space.upper - x <= margin))


def _rows_and_scores(
    problem: Problem, errors: list[FloatArray], J: list[FloatArray]
) -> tuple[FloatArray, list[FloatArray]]:
    """Rows R with A = R'R, shape (n_rows, n_free), and the scores of each recording, shape (n_samples, n_free)."""
    loss, weight = problem.cost_function.loss, problem.cost_function.weight
    assert loss is not None
    assert weight is not None
    weights = [share**2 * weight(e.time) for e, share in zip(problem.experiments, problem.shares(), strict=True)]
    curvature = loss.curvature(np.concatenate([e.ravel() for e in errors]))
    rows = [np.sqrt(curvature * w)[:, None, None] * j for w, j in zip(weights, J, strict=True)]
    scores = [np.einsum("t,to,toi->ti", w, loss.psi(e), j) for w, e, j in zip(weights, errors, J, strict=True)]
    return np.concatenate([r.reshape(-1, r.shape[-1]) for r in rows]), scores


def _sparse(unseen: FloatArray) -> NDArray[np.bool_]:
    """Who takes part in each unseen direction, of relative changes, shape (n_unseen, n_free).

    A basis of the unseen directions is arbitrary; row reduction gives the one that names the fewest together.
    """
    rows, lead = unseen / np.max(np.abs(unseen), axis=1, keepdims=True, initial=1e-300), 0
    for column in np.argsort(-np.max(np.abs(rows), axis=0, initial=0.0), kind="stable"):
        if lead == len(rows):
            break
        best = lead + int(np.argmax(np.abs(rows[lead:, column])))
        if abs(rows[best, column]) < PART:
            continue
        rows[[lead, best]] = rows[[best, lead]]
        rows[lead] /= rows[lead, column]
        others = np.arange(len(rows)) != lead
        rows[others] -= np.outer(rows[others, column], rows[lead])
        lead += 1
    return np.asarray(np.abs(rows) > PART * np.max(np.abs(rows), axis=1, keepdims=True, initial=0.0))


def jacobian(problem: Problem, x: FloatArray, free: NDArray[np.intp], *, jobs: int = 1) -> list[FloatArray] | str:
    """∂e/∂x of each recording by central differences, shape (n_samples, n_outputs, n_free); runs go on threads.

    Beside runs that fail (a minimum next to det M = 0) the difference is one-sided.
    """
    steps = 1e-5 * np.maximum(np.abs(x), 1e-2 * np.minimum(problem.space.upper - problem.space.lower, 1.0))
    room = np.minimum(problem.space.upper - x, x - problem.space.lower)
    steps = np.where(room > 0, np.minimum(steps, 0.5 * room), steps)
    points = [x + sign * steps[i] * (np.arange(len(x)) == i) for i in free for sign in (1, -1)]
    with ThreadPoolExecutor(jobs) as pool:
        here, *errors = list(pool.map(problem.errors, [x, *points]))
    if isinstance(here, str):
        return here
    columns = []
    for i, plus, minus in zip(free, errors[::2], errors[1::2], strict=True):
        if isinstance(plus, str) and isinstance(minus, str):
            return f"the runs on both sides of the minimum fail: {plus}"
        one_sided = isinstance(plus, str) or isinstance(minus, str)
        high, low = (here if isinstance(side, str) else side for side in (plus, minus))
        width = steps[i] if one_sided else 2 * steps[i]
        columns.append([(p - m) / width for p, m in zip(high, low, strict=True)])
    return [np.stack(recording, axis=-1) for recording in zip(*columns, strict=True)]


def _long_run(scores: list[FloatArray]) -> tuple[FloatArray, float]:
    """S over all recordings, column by column whitened before and coloured after [AM]_, and the bandwidth."""
    before, after = (np.concatenate([s[part] for s in scores]) for part in (slice(-1), slice(1, None)))
    rho = np.sum(before * after, axis=0) / np.maximum(np.sum(before**2, axis=0), 1e-300)
    rho = np.clip(rho, -WHITENED, WHITENED)
    white = [s - rho * np.vstack([np.zeros_like(s[:1]), s[:-1]]) for s in scores]
    bandwidth = sokal_bandwidth(np.concatenate(scores))
    S = sum((bartlett_long_run(w, bandwidth) for w in white), np.zeros((len(rho), len(rho))))
    return S / np.outer(1 - rho, 1 - rho), bandwidth


def sokal_bandwidth(scores: FloatArray) -> float:
    """B: the first lag that is 5 times the correlation time of the scores up to it [S]_, at most n/4.

    The correlation time up to lag k is 1 + 2·Σ ρ_j over j ≤ k, ρ from all columns together.

    Examples
    --------
    >>> noise = np.random.default_rng(0).standard_normal((10_000, 1))
    >>> sokal_bandwidth(noise) < 10 < sokal_bandwidth(np.cumsum(noise, axis=0))
    True
    """
    n = len(scores)
    power = np.abs(np.fft.rfft(scores, 2 * n, axis=0)) ** 2  # padded: no lag wraps around
    covariance = np.fft.irfft(power.sum(axis=1))[: n // 4 + 1]
    times = 2 * np.cumsum(covariance) / max(covariance[0], 1e-300) - 1
    wide_enough = np.flatnonzero(np.arange(len(times)) >= 5 * times)
    return float(wide_enough[0] if len(wide_enough) else n // 4)


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
