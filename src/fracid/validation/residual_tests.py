"""The statistical tests of a residual analysis.

By the functions of ``scipy.special``: ``scipy.stats`` takes half a second to import, in each of a fit's two processes.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc, log_ndtr, ndtr, ndtri

from fracid.arrays import FloatArray
from fracid.signals.correlation import power_spectrum
from fracid.validation.residual_records import ENOUGH, NAN


def is_testable(thin: FloatArray) -> bool:
    """Whether a thinned residual can be tested."""
    return thin.size >= ENOUGH and bool(np.ptp(thin) > 0)


def swing_band(speed: FloatArray, step: float) -> tuple[float, float, float] | None:
    """Where the fitted speed has its peak [Hz], between the ends of the band that has half its density and more.

    The speed knows nothing of a plateau; a peak below three periods a record is no swing.
    """
    if np.ptp(speed) <= 1e-12:
        return None
    f, S = power_spectrum(speed, step)
    at = int(np.argmax(S))
    strong = f[S[at] <= 2 * S]
    return (float(strong[0]), float(f[at]), float(strong[-1])) if at >= 3 else None


def harmonic_number(f: float, band: tuple[float, float, float] | None, bin_width: float) -> int | None:
    """Which multiple of the swing a frequency is; a damped swing is a band, and so are its multiples."""
    if band is None:
        return None
    low, swing, high = band
    m, margin = round(f / swing), max(1.5 * bin_width, 0.1 * swing)
    return m if 1 <= m <= 5 and m * low - margin <= f <= m * high + margin else None


def mann_whitney(e: FloatArray) -> float:
    """The p-value of |e| being larger in the last third than in the first, or smaller."""
    size, third = np.abs(e - np.median(e)), e.size // 3
    _, which, ties = np.unique(np.r_[size[:third], size[-third:]], return_inverse=True, return_counts=True)
    ranks, n = (np.cumsum(ties) - (ties - 1) / 2)[which], 2 * third
    variance = third**2 / 12 * (n + 1 - np.sum(ties**3 - ties) / (n * (n - 1)))
    excess = abs(np.sum(ranks[:third]) - third * (n + 1) / 2) - 0.5  # corrected for steps of one half
    return min(1.0, float(2 * ndtr(-excess / max(math.sqrt(variance), 1e-300))))


def fisher(ratio: float, freedom: float) -> float:
    """The p-value of a ratio of spreads, each of as many independent samples: Fisher's F."""
    return float(2 * fdtrc(freedom, freedom, max(ratio, 1 / ratio) ** 2)) if math.isfinite(ratio) else NAN


def spread_ratio(e: FloatArray, by: NDArray[Any]) -> float:
    """Spread where `by` is in its upper third, divided by that in its lower; NaN where `by` does not vary."""
    if np.ptp(by) <= 1e-12:
        return NAN
    low, high = np.quantile(by, (1 / 3, 2 / 3))
    small, large = e[by <= low] - e.mean(), e[by >= high] - e.mean()
    return float(np.sqrt(np.mean(large**2) / max(np.mean(small**2), 1e-300)))


def breusch_pagan(e: FloatArray, by: FloatArray) -> float:
    """The p-value of e² rising or falling with `by`; Koenker's form, which needs no normal errors."""
    if not is_testable(e) or np.ptp(by) <= 1e-12:
        return NAN
    return float(chdtrc(1, e.size * np.corrcoef((e - e.mean()) ** 2, by)[0, 1] ** 2))


def normal_quantiles(n: int) -> FloatArray:
    """The medians of n ordered values of a standard normal distribution (J. Filliben, 1975), shape (n,)."""
    medians = (np.arange(1, n + 1) - 0.3175) / (n + 0.365)
    medians[-1] = 0.5 ** (1 / n)
    medians[0] = 1 - medians[-1]
    return np.asarray(ndtri(medians))


def normal_probability(e: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Normal quantiles, the ordered residual over them, and their correlation, PPCC.

    Examples
    --------
    >>> quantiles, ordered, ppcc = normal_probability(np.array([2.0, 0.0, 1.0]))
    >>> quantiles.round(2).tolist(), ordered.tolist(), round(ppcc, 6)
    ([-0.82, 0.0, 0.82], [0.0, 1.0, 2.0], 1.0)
    """
    quantiles, ordered = normal_quantiles(e.size), np.sort(e)
    return quantiles, ordered, float(np.corrcoef(quantiles, ordered)[0, 1])


def anderson_darling(e: FloatArray) -> tuple[float, float]:
    """A² of normal errors of unknown mean and variance, and its p-value by Stephens' approximation [DA]_.

    .. [DA] R. D'Agostino, M. Stephens (eds), Goodness-of-Fit Techniques, Dekker 1986, table 4.9.
    """
    n, z = e.size, np.sort((e - e.mean()) / np.std(e, ddof=1))
    i = np.arange(1, n + 1)
    A2 = float(-n - np.sum((2 * i - 1) / n * (log_ndtr(z) + log_ndtr(-z[::-1]))))
    a = A2 * (1 + 0.75 / n + 2.25 / n**2)
    b, c, d = next(row for limit, *row in STEPHENS if a < limit)
    p = math.exp(b + c * a + d * a**2)
    return A2, p if a >= 0.34 else 1.0 - p


STEPHENS = ((0.2, -13.436, 101.14, -223.73), (0.34, -8.318, 42.796, -59.938), (0.6, 0.9177, -4.279, -1.38),
            (13.0, 1.2937, -5.709, 0.0186), (math.inf, -math.inf, 0.0, 0.0))  # fmt: skip
"""Up to which A², corrected for n: ln p = b + c A² + d A⁴, of 1 − p in the first two rows."""
