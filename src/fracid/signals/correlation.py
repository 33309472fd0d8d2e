"""The correlation of a sampled signal: autocorrelation, correlation time, long-run variance, spectrum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fracid.arrays import BoolArray, FloatArray, stretches

WIDE = 5
"""A sum of autocorrelations ends at the first lag that is so many times the correlation time up to it (Sokal)."""


def longest_stretch(mask: BoolArray) -> slice:
    """The longest stretch without a gap.

    Examples
    --------
    >>> longest_stretch(np.array([True, False, True, True, False]))
    slice(2, 4, None)
    """
    return slice(*max(stretches(mask).tolist(), key=lambda ends: ends[1] - ends[0], default=(0, 0)))


# --- whiteness -------------------------------------------------------------------------------------


def autocorrelation(x: FloatArray) -> FloatArray:
    """ρ at lags 0 … n/4, about the mean, shape (n//4 + 1,).

    Examples
    --------
    >>> ρ = autocorrelation(np.sin(2 * np.pi * np.arange(4000) / 100))
    >>> round(float(ρ[50]), 1), round(float(ρ[100]), 1)
    (-1.0, 1.0)
    """
    products = products_by_lag(x - np.mean(x))[: x.size // 4 + 1]
    return np.asarray(products / products[0])


def correlation_time(ρ: FloatArray) -> float:
    """The longer of T₁ and T₂, in samples, at least 1; see the module's first screen.

    Parameters
    ----------
    ρ : array, shape (n_lags + 1,)
        From :func:`autocorrelation`.

    Examples
    --------
    >>> fading = 0.9 ** np.arange(1000)  # T₁ = (1 + 0.9)/(1 − 0.9) = 19 samples
    >>> swinging = np.cos(np.arange(1000))  # T₁ is nothing, T₂ as long as you look: 1 + 999/1
    >>> round(correlation_time(fading), 1), round(correlation_time(swinging))
    (19.0, 1000)
    """
    return max(1.0, _within_window(ρ)[0], _within_window(ρ**2)[0])


def _within_window(covariance: FloatArray) -> tuple[float, int]:
    """The correlation time 1 + 2·Σ ρ_j up to the first lag that is :data:`WIDE` times it, and that lag [samples]."""
    times = 2 * np.cumsum(covariance) / max(covariance[0], 1e-300) - 1
    wide_enough = np.flatnonzero(np.arange(times.size) >= WIDE * times)
    lag = int(wide_enough[0]) if wide_enough.size else times.size - 1
    return float(times[lag]), lag


def box_pierce(x: FloatArray) -> tuple[int, float, float]:
    r"""Lags, Q and p-value of the test for autocorrelation that takes noise of any changing size for white [LNS]_.

    Each lag has its own variance, :math:`Q = \sum_k (\sum_t x_t x_{t-k})^2 / \sum_t x_t^2 x_{t-k}^2`: where a few large
    samples make the sums, their correlations scatter more than :math:`1/\sqrt n`.

    .. [LNS] I. Lobato, J. Nankervis, N. Savin, Int. Economic Review 42 (2001) 187; F. Diebold, Proc. American
       Statistical Association, Business and Economic Statistics Section (1986) 323.

    Examples
    --------
    >>> noise = np.random.default_rng(1).normal(size=1000)
    >>> decaying = noise * np.exp(-np.arange(1000) / 100)
    >>> [round(box_pierce(x)[2], 2) for x in (noise, decaying, np.cumsum(noise))]
    [0.77, 0.28, 0.0]
    """
    from scipy.special import chdtrc

    x, lags = x - np.mean(x), min(10, x.size // 5)
    squares, least = x**2, float(np.finfo(float).tiny)
    Q = sum((x[k:] @ x[:-k]) ** 2 / max(float(squares[k:] @ squares[:-k]), least) for k in range(1, lags + 1))
    return lags, float(Q), float(chdtrc(lags, Q))


# --- spectrum --------------------------------------------------------------------------------------


def power_spectrum(x: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies [Hz] and the density of the power about the mean [unit²/Hz], each of shape (n//2 + 1,).

    Without a window, which would hide the first swings after a release: the densities add up to the variance.

    Examples
    --------
    >>> f, S = power_spectrum(np.random.default_rng(1).normal(size=10_000), 1e-3)
    >>> round(float(np.sum(S) * f[1]), 1)  # the variance
    1.0
    """
    n = len(x)
    S = np.abs(np.fft.rfft(x - np.mean(x))) ** 2 * step / n
    S[1 : (n + 1) // 2] *= 2  # those of −f
    return np.asarray(np.fft.rfftfreq(n, step)), S


def neighbour_correlation(scores: Sequence[FloatArray], limit: float) -> float:
    """The correlation of neighbours, of all pieces and columns together, between −limit and limit.

    Examples
    --------
    >>> t = np.arange(1000.0)[:, None]
    >>> round(neighbour_correlation([np.cos(t), np.sin(t)], 0.97), 3)  # cos 1
    0.54
    """
    after, before = (sum(float(np.vdot(s[:-1], s[lag : len(s) - 1 + lag])) for s in scores) for lag in (1, 0))
    return float(np.clip(after / max(before, 1e-300), -limit, limit))


def whitened(scores: FloatArray, rho: float) -> FloatArray:
    """s_t − ρ s_{t−1}.

    Examples
    --------
    >>> whitened(np.array([[1.0], [0.5], [0.25]]), 0.5).ravel().tolist()
    [1.0, 0.0, 0.0]
    """
    white = scores.copy()
    white[1:] -= rho * scores[:-1]
    return white


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
    return sokal_lag(sum((products_by_lag(s)[: n // 4 + 1] for s in scores.T), np.zeros(n // 4 + 1)))


def sokal_lag(covariance: FloatArray) -> float:
    """The same of covariances at lags 0, 1, …

    Examples
    --------
    >>> sokal_lag(0.5 ** np.arange(100))  # a correlation time of 3
    15.0
    """
    return float(_within_window(covariance)[1])


def products_by_lag(s: FloatArray) -> FloatArray:
    """Σ s_t s_{t+k} over t for each lag k, shape (n_samples,)."""
    from scipy.fft import irfft, next_fast_len, rfft

    n = next_fast_len(2 * len(s), real=True)  # padded: no lag wraps around; a prime length takes six times the memory
    return np.asarray(irfft(np.abs(rfft(s, n)) ** 2, n)[: len(s)])


def bartlett_long_run(scores: FloatArray, bandwidth: float) -> FloatArray:
    """S with the Bartlett window: the mean square of all sums over B + 1 neighbouring scores.

    Examples
    --------
    >>> s = np.array([[1.0], [2.0], [3.0]])
    >>> float(bartlett_long_run(s, 0.0)[0, 0]), float(bartlett_long_run(s, 1.0)[0, 0])  # 14, 14 + ½·2·8
    (14.0, 22.0)
    """
    m = int(bandwidth) + 1
    blocks = neighbour_sums(scores, m)
    return np.asarray(blocks.T @ blocks / m)


def neighbour_sums(scores: FloatArray, m: int) -> FloatArray:
    """All sums over m neighbours, those that stick out at the ends too, shape (n_samples + m − 1, n_columns)."""
    total = np.zeros((len(scores) + 2 * m - 1, scores.shape[1]))
    total[m : m + len(scores)] = scores
    np.cumsum(total, axis=0, out=total)
    return np.asarray(total[m:] - total[:-m])


def effective_samples(errors: list[FloatArray], scored: list[BoolArray] | None = None) -> float:
    """As how many independent samples correlated residuals count, 2 at least.

    Parameters
    ----------
    errors : list of array, shape (n_samples, n_outputs)
        The residuals of each recording; each output counts by its own scatter.
    scored : list of array of bool, optional
        Which of them count, those of an output then one after the other; all if left out.

    Returns
    -------
    float
        n/τ with n samples of all outputs, and τ the correlation time of all together [samples].

    Examples
    --------
    >>> noise = np.random.default_rng(0).standard_normal((10_000, 1))
    >>> 8_000 < effective_samples([noise]) <= 10_000
    True
    >>> effective_samples([np.repeat(noise, 10, axis=0)]) < 15_000  # each sample ten times: nothing new
    True
    """
    together = np.concatenate(errors)
    counts = np.ones(together.shape, bool) if scored is None else np.concatenate(scored)
    together = np.take_along_axis(together * counts, np.argsort(~counts, axis=0, kind="stable"), axis=0)
    spread = np.std(together, axis=0)
    time = max(1.0, sokal_bandwidth(together / np.where(spread > 0, spread, 1.0)) / 5)  # five correlation times
    return max(2.0, int(np.count_nonzero(counts)) / time)
