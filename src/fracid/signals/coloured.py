r"""Is a correlated residual noise, or something that the model lacks?

A camera, a filter or a bus correlates noise over a time of its own, wherever the motion goes.  What a model lacks goes
with the motion.  So a residual e is called *coloured noise* where

1. an autoregression of a low order p makes it white, :math:`\varepsilon_t = e_t - \sum_k \varphi_k e_{t-k}`, and its
   correlation time fits many times into the record;
2. nothing of the motion explains what is left, beside what the unknowns can do, whose least squares were not those of
   coloured noise: :math:`\varepsilon` on the outputs, their rates, squares and cubes and
   the inputs, each as it is and through relaxations of a few times, all filtered as e was, by the F test (Cochrane and
   Orcutt, J. American Statistical Association 44 (1949) 32);
3. it is as large where the motion is large: :math:`|\varepsilon|` on the sizes of the same, by the same test.

A few spikes, as a solver leaves them where an input jumps, are neither: they count as :data:`SPIKE` deviations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.linalg import solve_banded, solve_toeplitz  # scipy.signal takes a second to import
from scipy.special import fdtrc

from fracid.arrays import FloatArray
from fracid.signals.correlation import autocorrelation, correlation_time, products_by_lag

ORDERS = 4
"""Of the autoregression, at most."""

SHORT, LONG = 64, 100_000
"""Samples: of fewer nothing is known, and no more than so many are looked at."""

MANY = 5.0
"""Correlation times in the record, at least."""

WHITE = 0.6
"""Part of the samples that counts once it is white, or by chance next to it."""

SPIKE = 4.0

MEDIAN = 0.6745
"""Of the size of a normal number of deviation 1."""

CHANCE = 0.005
"""How often noise is taken for something that the model lacks, by each test."""

SAME_DIRECTION = 1e-6
"""Directions of the regressors below this part of the largest are none."""


def is_coloured_noise(e: FloatArray, motion: FloatArray, unknowns: Callable[[], FloatArray]) -> bool:
    """Whether a residual is correlated as noise is.

    Parameters
    ----------
    e : array, shape (n_samples,)
        Without a gap.
    motion : array, shape (n_samples, n_signals)
        What was simulated, and the inputs.
    unknowns : function () -> array, shape (n_samples, n_unknowns)
        What the unknowns can do in first order; asked where it is needed.

    Examples
    --------
    >>> def no_unknowns():
    ...     return np.zeros((1000, 1))
    >>> t = np.arange(1000) / 100
    >>> y = np.exp(-t / 5) * np.cos(6 * t)
    >>> from scipy.signal import lfilter
    >>> noise = lfilter([1.0], [1.0, -0.9], np.random.default_rng(0).standard_normal(t.size))
    >>> [is_coloured_noise(e, y[:, None], no_unknowns) for e in (noise, noise + 20 * y**3)]
    [True, False]
    """
    e, motion = e[:LONG] - np.mean(e[:LONG]), motion[:LONG]
    n = len(e)
    if n < SHORT or n < MANY * correlation_time(autocorrelation(e)):
        return False
    whitening, white = whitening_filter(e)
    if not white:
        return False
    p, ε = len(whitening) - 1, whitened(e, whitening)
    nothing = np.zeros(n)  # where no signal moves, and nothing is unknown
    columns, own = np.column_stack([nothing, *_regressors(motion)]), np.column_stack([nothing, unknowns()[:n]])
    filtered, theirs = whitened(columns, whitening), whitened(own, whitening)
    Q = directions(theirs)
    ε = ε - Q @ (Q.T @ ε)
    most = SPIKE * np.median(np.abs(ε)) / MEDIAN
    ε, filtered = np.clip(ε, -most, most), filtered - Q @ (Q.T @ filtered)
    return _unrelated(ε, filtered, Q.shape[1]) and _unrelated(np.abs(ε), np.abs(columns[p:]), 0)


def whitening_filter(e: FloatArray) -> tuple[FloatArray, bool]:
    """The autoregression of the lowest order that makes a residual white, as a filter (1, −φ₁, …); whether it does.

    Parameters
    ----------
    e : array, shape (n_samples,)
        Without a gap.

    Examples
    --------
    >>> from scipy.signal import lfilter
    >>> noise = lfilter([1.0], [1.0, -0.9], np.random.default_rng(0).standard_normal(10_000))
    >>> found, white = whitening_filter(noise)
    >>> found.round(1).tolist(), white
    ([1.0, -0.9], True)
    """
    most = len(e) // 4 + 1
    covariance = products_by_lag(e - np.mean(e))[:most]
    for p in range(1, ORDERS + 1):
        found = np.concatenate([[1.0], -solve_toeplitz(covariance[:p], covariance[1 : p + 1])])
        ε = whitened(e, found)
        left = products_by_lag(ε - np.mean(ε))[:most]
        ρ = left / left[0]
        if correlation_time(ρ) <= 1 / WHITE and 1.0 + 2.0 * ρ[1] >= WHITE:  # nor overdone: white noise differenced
            return found, True
    return found, False


def whitened(signals: FloatArray, whitening: FloatArray) -> FloatArray:
    """Signals through the filter, from the first sample on that has all that it needs before it."""
    p, n = len(whitening) - 1, len(signals)
    return np.asarray(sum(part * signals[p - k : n - k] for k, part in enumerate(whitening)))


def _regressors(motion: FloatArray) -> Iterator[FloatArray]:
    """The signals, their rates, squares and cubes, and the signals through relaxations that fade over the record."""
    n = len(motion)
    for signal in motion.T:
        size = np.std(signal)
        if size == 0.0:
            continue
        y = (signal - signal[0]) / size
        v = np.gradient(y)
        v = v / max(np.std(v), np.finfo(float).tiny)
        yield from (y, y**2, y**3, v, v * np.abs(v))
        for τ in np.geomspace(2.0, n / 4, 4):
            yield solve_banded((1, 0), [np.ones(n), np.full(n, 1 / τ - 1.0)], y / τ)


def directions(columns: FloatArray, same: float = SAME_DIRECTION) -> FloatArray:
    """An orthonormal basis of what columns span, without what is the `same` up to that part."""
    Q, singular, _ = np.linalg.svd(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300), full_matrices=False)
    return np.asarray(Q[:, singular > same * np.max(singular, initial=0.0)])


def _unrelated(y: FloatArray, columns: FloatArray, spent: int) -> bool:
    """Whether columns explain no more of y than chance does; some of its freedom may be spent."""
    y, Q = y - np.mean(y), directions(columns - np.mean(columns, axis=0))
    k, free = Q.shape[1], len(y) - Q.shape[1] - 1 - spent
    if k == 0 or free < 1:
        return True
    explained = float(np.sum((Q.T @ y) ** 2))
    F = explained / k / (max(float(y @ y) - explained, 1e-300) / free)
    return bool(fdtrc(k, free, F) > CHANCE)
