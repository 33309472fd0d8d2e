r"""The exact weights of the history sums, and the kernel that holds them.

In units of the step, for an order q, with v the sample that is k steps old:

=======  ======================  =====================================================================
family   sums v =                weights
=======  ======================  =====================================================================
``gl``   x − x(0)                Grünwald–Letnikov (18), (19): :math:`w_0 = 1`,
                                 :math:`w_k = (1 - (1 + q)/k)\,w_{k-1}`
``pi``   f(t, x)                 product trapezoidal (:func:`trapezoidal_weights`), :math:`b_k`, and
                                 :math:`a_n` for the sample at the start
``pi3``  f(t, x)                 those of ``pi`` for :math:`f - δ^2 f/12` (:func:`third_weights`)
``bdf``  f(t, x)                 Lubich's quadrature of BDF2 (:func:`bdf_weights`): the coefficients of
                                 :math:`(3/2 - 2ζ + ζ^2/2)^{-q}`, and half of :math:`w_{n-1}` for the
                                 sample at the start
=======  ======================  =====================================================================

A :class:`Kernel` holds the first L + 1 of them exactly and the rest as :math:`\sum_m c_m z_m^{k-L-1}`; with all of
them exact it is the full memory (:func:`exact_kernel`), with none after L the short one, and
:mod:`fracid.solver.exponentials` makes the compressed one.  Differences that cancel for large k (second differences of
:math:`k^{q+1}`) are taken from their series, so that every weight has full relative precision.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial.polynomial import polyval
from scipy.special import zeta

from fracid.arrays import FloatArray, IntArray
from fracid.solver.operators import gl_weights


@dataclass(frozen=True, eq=False)
class Kernel:
    """The weights of one history sum, in units of the step, for one order; each is equal to itself alone."""

    weights: FloatArray
    """Exact weights w_0 … w_L, shape (L + 1,)."""
    start: FloatArray
    """What weighs the sample at the start instead of w_n while n ≤ L, shape (L + 1,)."""
    decay: FloatArray
    """z_m − 1, what each exponential loses from one lag to the next, shape (n_modes,).

    The difference is kept, not z_m: rounding z_m next to 1 would cost z_m^k a relative k·10⁻¹⁶."""
    amplitude: FloatArray
    """w_k = Σ_m amplitude_m · z_m^(k - L - 1) for k > L, shape (n_modes,)."""
    start_ratio: FloatArray
    """The start's amplitude over that of any other sample, per exponential, shape (n_modes,)."""
    ramp: float = 0.0
    """Slope of a linear part of the weights, ramp · (k − L − 1), beside the constant mode (the first)."""
    start_shift: float = 1 / 6
    """The start weighs a linear part by half of it less this: the centre of its half panel."""

    @property
    def lags(self) -> int:
        """L, the number of lags kept exactly."""
        return len(self.weights) - 1

    @property
    def modes(self) -> int:
        """Number of exponentials that a step works on, a constant and a ramp included."""
        return len(self.decay) + (self.ramp != 0.0)

    def at(self, lags: IntArray | list[int]) -> FloatArray:
        """Give the weights that the kernel really uses at some lags, to hold against the exact ones.

        Examples
        --------
        >>> from fracid.solver.memory import compressed, full
        >>> kernel = compressed(1e-10).kernel("gl", 0.8, steps=20_000)
        >>> exact = full().kernel("gl", 0.8, steps=20_000).weights
        >>> lags = [1, 16, 17, 500, 20_000]
        >>> bool(np.all(abs(kernel.at(lags) / exact[lags] - 1) < 1e-10))
        True
        """
        k = np.asarray(lags)
        beyond = np.maximum(k - self.lags - 1, 0)
        modes = np.exp(np.outer(beyond, np.log1p(self.decay))) @ self.amplitude + self.ramp * beyond
        return np.asarray(np.where(k <= self.lags, self.weights[np.minimum(k, self.lags)], modes))


# --- exact weights ---------------------------------------------------------------------------------


AT_ORDER_1 = {
    "pi": (np.array([0.5, 1.0]), np.array([0.0, 0.5])),  # the trapezoidal rule
    "pi3": (np.array([9, 28, 23, 24]) / 24, np.array([0, 15, 11, 12]) / 24),  # Adams and Moulton's of fourth order
}
"""Weights, and those of the start, of families that are running sums at order 1, after these lags."""


def exact_kernel(family: str, order: float, steps: int) -> Kernel:
    """All weights of a family, exactly."""
    if order != 1.0:
        return Kernel(*exact_weights(family, order, steps), *np.empty((3, 0)))
    if family == "gl":  # a backward difference
        return Kernel(np.array([1.0, -1.0]), np.array([1.0, -1.0]), *np.empty((3, 0)))
    w, start = AT_ORDER_1.get(family) or bdf_weights(order, 40)  # 1 − 3^(−k−1), a running sum from k = 40 on
    return Kernel(w, start, np.zeros(1), np.ones(1), start_ratio=np.full(1, 0.5))


@lru_cache(maxsize=64)
def relaxing_kernel(shares: tuple[float, ...], rates: tuple[float, ...]) -> Kernel:
    r"""The product-trapezoidal weights of :math:`k(t) = a_0 + \sum_j a_j e^{-s_j t}`, in units of the step, exactly.

    Parameters
    ----------
    shares : tuple of float
        a_0 … a_n.
    rates : tuple of float
        s_1 … s_n, steps over time constants.

    Examples
    --------
    >>> relaxing_kernel((1.0,), ()).at([0, 1, 2, 9])
    array([0.5, 1. , 1. , 1. ])
    """
    s, a = np.array([0.0, *rates]), np.array(shares)
    with np.errstate(divide="ignore", invalid="ignore"):  # half and whole of the hat that f is between the samples
        half = np.where(s < 1e-3, 1 / 2 + s / 6 + s**2 / 24 + s**3 / 120, (np.expm1(s) - s) / s**2)
        hat = np.where(s > 0, (np.sinh(s / 2) / (s / 2)) ** 2, 1.0)
    z = np.exp(-s)
    w, start = [a @ (hat - half), a @ (hat * z)], [0.0, a @ (half * z)]
    return Kernel(np.array(w), np.array(start), np.expm1(-s), a * hat * z * z, start_ratio=half / hat)


def exact_weights(family: str, q: float, steps: int) -> tuple[FloatArray, FloatArray]:
    """w_k and those of the start, for k = 0 … steps."""
    if family == "gl":
        return (w := gl_weights(q, steps + 1)), w
    return {"pi": trapezoidal_weights, "pi3": third_weights, "bdf": bdf_weights}[family](q, steps)


def trapezoidal_weights(q: float, steps: int) -> tuple[FloatArray, FloatArray]:
    r"""b_k and a_k for k = 0 … steps, free of the cancellation of their second differences.

    With the binomial series, :math:`b_k Γ(q+2) = 2 \sum_j \binom{q+1}{2j} k^{q+1-2j}` and
    :math:`a_k Γ(q+2) = \sum_{j≥2} (-1)^j \binom{q+1}{j} k^{q+1-j}`; from k = 9 on, 20 terms are exact.
    """
    b, a = np.zeros((2, steps + 1))
    b[0] = 1.0
    for k in range(1, min(9, steps + 1)):  # so few take NumPy longer
        up, down = (math.expm1(q * math.log1p(1 / m)) for m in (k, -max(k, 2)))  # k = 1 has no down
        b[k], a[k] = k**q * ((k + 1) * up + (k - 1) * down), k**q * ((k - 1) * down + q)
    if steps > 8:
        n, binomial = np.arange(9.0, steps + 1), [1.0]
        for j in range(1, 20):
            binomial.append(binomial[-1] * (q - (j - 2)) / j)
        even, odd = (np.vander(n**-2, 9, increasing=True) @ np.reshape(binomial[2:], (9, 2))).T
        b[9:], a[9:] = 2 * n ** (q - 1) * even, n ** (q - 1) * (even - odd / n)
    return b / math.gamma(q + 2), a / math.gamma(q + 2)


def third_weights(q: float, steps: int) -> tuple[FloatArray, FloatArray]:
    r"""The weights of ``pi3``: those of f − δ²f/12 under ``pi``, less κ δ²f at the last step; and of the start.

    Up to k = 2 the second difference is the last step's, backward.  The start counts f_{-1} as f_0.
    """
    b, a = trapezoidal_weights(q, steps + 3)
    before = np.append(0.0, b)[: steps + 1]
    w = b[: steps + 1] - (b[1 : steps + 2] - 2 * b[: steps + 1] + before) / 12
    start = a[: steps + 1] + (b[: steps + 1] - before) / 12
    kappa, start[0] = float(zeta(-q - 1)) / math.gamma(q + 2), 0.0
    for k, (last, end) in enumerate(((1, 3), (-2, -3), (1, 1))[: steps + 1]):
        w[k] -= last * kappa + end * b[0] / 12
        if k > 0:  # constants are integrated exactly
            start[k] = k**q / math.gamma(q + 1) - np.sum(w[:k])
    return w, start


SERIES = 18
"""Terms of the expansion of BDF2's weights for large k: exact to rounding from k = 64 on."""


def bdf_series(q: float) -> FloatArray:
    r"""d_j of :math:`(3/2 - 2e^{-s} + e^{-2s}/2)^{-q} = \sum_j d_j s^{j-q}`, by Miller's recursion for powers."""
    j, d = np.arange(SERIES), np.ones(SERIES)
    p = (2 - 2.0**j) / np.cumprod([1.0, *-(j[1:] + 1)])  # of the base over s, whose first term is 1
    for n in range(1, SERIES):
        k = j[1 : n + 1]
        d[n] = ((k * (1 - q) - n) * p[k]) @ d[n - k] / n
    return d


def bdf_weights(q: float, steps: int) -> tuple[FloatArray, FloatArray]:
    r"""Coefficients of :math:`(3/2 - 2ζ + ζ^2/2)^{-q}`, k = 0 … steps, and half the one before, for the start.

    By Miller's recursion; from k = 64 on by :math:`\sum_j d_j k^{q-1-j}/Γ(q-j)`, since what is left out dies as
    :math:`3^{-k}`, the root at ζ = 3.
    """
    w = [0.0, (2 / 3) ** q]  # with one before the first
    for k in range(1, min(64, steps + 1)):
        w.append(-4 / 3 * ((1 - q) / k - 1) * w[-1] + (2 * (1 - q) / k - 1) * w[-2] / 3)
    later = np.arange(64.0, steps + 1)
    over_gamma = np.cumprod([1 / math.gamma(q), *(q - np.arange(1, SERIES))])  # 1 / Γ(q − j)
    series = polyval(1 / later, bdf_series(q) * over_gamma)
    all_of_them = np.concatenate([w[1:], series * later ** (q - 1)])
    return all_of_them, np.append(0.0, all_of_them[:-1] / 2)
