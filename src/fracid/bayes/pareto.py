r"""Pareto-smoothed importance sampling: the largest weights replaced, and a number that says whether to trust them.

The largest M of S importance ratios follow a generalised Pareto distribution of shape k.  Its fit [ZS]_ replaces them
by its quantiles, which removes most of their noise, and :math:`\hat k` is the diagnostic [V]_: the mean of a function
needs :math:`k < 1`, its standard error :math:`k < 1/2`; below :math:`\min(1 - 1/\log_{10} S, 0.7)` the smoothed
weights can be trusted, above it they cannot.

References
----------
.. [V] A. Vehtari, D. Simpson, A. Gelman, Y. Yao, J. Gabry, J. Machine Learning Research 25 (2024) 72.
.. [ZS] J. Zhang, M. Stephens, Technometrics 51 (2009) 316.
"""

from __future__ import annotations

import math

import numpy as np

from fracid.arrays import FloatArray

LEAST_TAIL = 5
"""A tail of fewer ratios is not smoothed: nothing can be said of its shape."""


def khat_limit(draws: int) -> float:
    """The greatest k̂ of so many draws that can be trusted [V]_.

    Examples
    --------
    >>> khat_limit(100), khat_limit(10_000)
    (0.5, 0.7)
    """
    return min(1 - 1 / math.log10(max(draws, 11)), 0.7)


def smoothed(log_ratios: FloatArray) -> tuple[FloatArray, float]:
    """Smooth the largest importance ratios.

    Parameters
    ----------
    log_ratios : array, shape (n_draws,)
        Of target to proposal; −inf where the target has none.

    Returns
    -------
    log_weights : array, shape (n_draws,)
        Relative to the largest ratio, none above 0.
    khat : float
        Infinite where there are too few ratios to tell.

    Examples
    --------
    A normal target from a proposal that is broader, and from one that is too narrow:

    >>> x = np.random.default_rng(1).standard_normal(2000)
    >>> [round(smoothed(x**2 / 2 - (s * x) ** 2 / 2)[1], 1) for s in (1.5, 0.5)]
    [-1.7, 0.7]
    """
    weights = log_ratios - np.max(log_ratios)
    finite = int(np.count_nonzero(np.isfinite(weights)))
    tail = int(min(0.2 * finite, 3 * math.sqrt(finite)))
    if tail < LEAST_TAIL:
        return weights, math.inf
    order = np.argsort(weights, kind="stable")[-tail - 1 :]
    cutoff, order = max(float(weights[order[0]]), math.log(np.finfo(float).tiny)), order[1:]
    excess = np.exp(weights[order]) - math.exp(cutoff)
    if excess[0] <= 0 or excess[-1] - excess[0] <= 1e-10:  # all alike: nothing to smooth
        return weights, -math.inf
    k, sigma = _generalised_pareto(excess)
    if math.isfinite(k):
        quantile = (np.arange(tail) + 0.5) / tail
        weights = weights.copy()
        excess = -sigma * np.log1p(-quantile) if k == 0 else sigma * np.expm1(-k * np.log1p(-quantile)) / k
        weights[order] = np.log(excess + math.exp(cutoff))
    return np.minimum(weights, 0.0), k


def _generalised_pareto(x: FloatArray) -> tuple[float, float]:
    """Shape and scale of sorted x > 0, by the posterior mean of [ZS]_, the shape shrunk towards 1/2 as [V]_ do."""
    n = len(x)
    m = 30 + int(math.sqrt(n))
    b = 1 - np.sqrt(m / (np.arange(1, m + 1) - 0.5))
    b = b / (3 * x[int(n / 4 + 0.5) - 1]) + 1 / x[-1]
    shape = np.mean(np.log1p(-b[:, None] * x), axis=1)
    likelihood = n * (np.log(-b / shape) - shape - 1)
    weights = 1 / np.sum(np.exp(likelihood - likelihood[:, None]), axis=1)
    keep = weights >= 10 * np.finfo(float).eps
    theta = float(np.sum(b[keep] * weights[keep]) / np.sum(weights[keep]))
    k = float(np.mean(np.log1p(-theta * x)))
    return (n * k + 5.0) / (n + 10), -k / theta
