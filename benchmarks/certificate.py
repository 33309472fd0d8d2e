r"""The certificate of a compressed memory: a bound on its error, proven and measured.

    python benchmarks/certificate.py pi 0.9 10_000_000     # of one run's kernel: family, order, steps

How far can a weight of the kernel be from the exact one, relative to it?  Two answers that owe nothing to each other:

* **proven** (:func:`proven_errors`), from the nodes and weights of the kernel as built: the spacing of the grid, by
  Poisson's formula; the upper end, where a mean replaces all further nodes; the lower end, by the remainder of the
  Gauss rule; and rounding.  It holds for every lag;
* **measured** (:func:`measured_errors`): every lag up to 1000 and 2000 more up to the last, against the exact weights
  by Watson's lemma, an expansion in 1/k that is exact to rounding from k = 9 on.

:attr:`Certificate.bound` takes the measurement where every lag was compared, and the proof beyond.
``docs/memory.md`` derives the bounds.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.solver.exponentials import EXACT_LAGS, LOW_NODES, little_jacobi, sine_ratio
from fracid.solver.memory import Memory, compressed
from fracid.solver.weights import Kernel

CHECKED = 1000
"""Up to this lag a certificate compares every weight."""


@dataclass(frozen=True)
class Certificate:
    """What a memory promises of its weights, and what it was found to do; all errors are relative."""

    memory: str
    """Name of the memory."""
    family: str
    """``gl`` or ``pi``."""
    order: float
    """Order of the derivative."""
    steps: int
    """Number of steps: the largest lag that is covered."""
    lags: int
    """Lags kept exactly."""
    modes: int
    """Exponentials, a constant and a ramp included."""
    spacing: float
    """Bound on what the spacing of the grid costs a weight, at any lag."""
    upper: float
    """Bound on what the upper end costs; largest at the first lag that is not exact."""
    lower: float
    """Bound on what the lower end costs; largest at the last lag.  ∞ where weights are just dropped."""
    rounding: float
    """What double precision costs: four units in the last place of the terms of a sum."""
    measured: float
    """Largest error found: at every lag from 9 to 1000, and at 2000 more up to the last."""
    worst_lag: int
    """Where it was found."""
    near: float
    """Largest error found up to lag 1000, where every lag was compared."""

    @property
    def bound(self) -> float:
        """The error that no weight exceeds: compared one by one up to lag 1000, proved beyond."""
        return max(self.near, self.spacing + self.upper + self.lower + self.rounding)

    def __str__(self) -> str:
        """Say it in a sentence."""
        return (f"{self.family}, order {self.order:g}, {self.steps:,} steps, {self.memory}: {self.lags} exact lags and "
                f"{self.modes} exponentials; no weight is off by more than {self.bound:.2g} of itself (spacing "
                f"{self.spacing:.1g}, upper end {self.upper:.1g}, lower end {self.lower:.1g}, rounding "
                f"{self.rounding:.1g}); found: {self.measured:.2g}, at lag {self.worst_lag:,}")  # fmt: skip


def certificate(memory: Memory, family: str, order: float, steps: int) -> Certificate:
    """Say how far the weights of a run's kernel can be from the exact ones, and how far they are."""
    kernel = memory.kernel(family, order, steps)
    lags, error = measured_errors(kernel, family, order, steps)
    worst = int(np.argmax(error))
    return Certificate(
        memory.name, family, order, steps, kernel.lags, kernel.modes, *proven_errors(family, order, steps, kernel),
        float(error[worst]), int(lags[worst]), float(error[lags <= CHECKED].max()),
    )  # fmt: skip


# --- what is proved, and what is found -------------------------------------------------------------


def _in_common(family: str, q: float) -> tuple[float, float, float]:
    r"""a, p, shift: in both families :math:`w_k` is a factor times :math:`∫ s^{a-1} h(s)^p e^{-s(k - shift)} ds`.

    With :math:`h = \sinh(s/2)/(s/2)`: the hat function has its square, and (1 − e^(−s))/s is h e^(−s/2).
    """
    return (1 + q, q, q / 2) if family == "gl" else (1 - q, 2.0, 0.0)


def far_weights(family: str, q: float, lags: NDArray[np.int64]) -> FloatArray:
    r"""Exact w_k from k = 9 on, to rounding, by Watson's lemma: :math:`t^{-a} Σ_j c_j (a)_{2j} t^{-2j}` over a Γ.

    With t = k − shift and :math:`h^p = Σ c_j s^{2j}`; twelve terms do from t = 8 on.
    """
    a, p, shift = _in_common(family, q)
    t, total, rising, c = lags - shift, np.ones(len(lags)), 1.0, [1.0]
    h = [1 / (4.0**j * math.factorial(2 * j + 1)) for j in range(13)]
    for j in range(1, 13):
        c.append(sum((i * p - j + i) * h[i] * c[j - i] for i in range(1, j + 1)) / j)  # of a power of a series
        rising *= (a + 2 * j - 2) * (a + 2 * j - 1)
        total += c[j] * rising * t ** (-2.0 * j)
    scale = -sine_ratio(q) * math.gamma(1 + q) if family == "gl" else 1 / math.gamma(q)
    exact: FloatArray = scale * t**-a * total
    return exact


def measured_errors(kernel: Kernel, family: str, q: float, steps: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Lags, and the relative error of the kernel's weight at each."""
    if q == 1.0 or steps <= EXACT_LAGS:  # known weights
        return np.array([steps]), np.zeros(1)
    spread = np.geomspace(CHECKED, max(CHECKED, steps), 2000).astype(np.int64)
    lags = np.unique(np.minimum(np.concatenate([np.arange(EXACT_LAGS + 1, CHECKED + 1), spread]), steps))
    return lags, np.abs(kernel.at(lags) / far_weights(family, q, lags) - 1)


def proven_errors(family: str, q: float, steps: int, kernel: Kernel) -> tuple[float, float, float, float]:
    """Bounds on the relative errors by spacing, upper end, lower end, rounding, from the kernel's nodes and weights."""
    if q == 1.0:
        return 0.0, 0.0, 0.0, 0.0
    if kernel.lags >= steps:  # three roundings a lag of the recursion (19), or a closed form
        return 0.0, 0.0, 0.0, float(np.finfo(np.float64).eps) * (1.5 * steps if family == "gl" else 40)
    if kernel.modes < LOW_NODES:  # the rest is dropped, or frozen
        return 0.0, 0.0, math.inf, 0.0
    s = -np.log1p(kernel.decay)
    grid = s[LOW_NODES + 1 : -1]  # without the last, which is a mean
    spacing = math.log(grid[-1] / grid[0]) / (len(grid) - 1)
    upper = _upper_error(family, q, steps, kernel, grid[-1] * np.exp(spacing * np.arange(1, 9)), spacing)
    lower, off = _lower_error(family, q, steps, kernel, spacing)
    return _spacing_error(family, q, spacing), upper, lower, off + _rounding(kernel, steps)


def _spacing_error(family: str, q: float, spacing: float) -> float:
    """2 Σ_m |Γ(a + 2πi m/Δ)/Γ(a)|: Poisson's formula.

    A weight of ``pi`` is a mean of t^(−a), so it has no larger error.  One of ``gl`` has a factor more, whose
    distance from 1 is at most p |y|²/(3 t²) with y = 2πm/Δ + 3i.
    """
    from scipy.special import loggamma

    a, p, _ = _in_common(family, q)
    y = 2 * np.pi * np.arange(1, 4) / spacing
    factor = 1 + (p * (y**2 + 9) / (3 * CHECKED**2) if family == "gl" else 0)
    return float(2 * (factor * np.exp(loggamma(a + 1j * y).real - loggamma(a + 0j).real)).sum())


def _upper_error(family: str, q: float, steps: int, kernel: Kernel, beyond: FloatArray, spacing: float) -> float:
    """What the mean of the last nodes is off, at worst: computed at each lag, until nothing is left of them."""
    a, p, shift = _in_common(family, q)
    lags = np.arange(kernel.lags + 1, min(CHECKED, steps) + 1)
    log_h = beyond / 2 + np.log(-np.expm1(-beyond) / beyond)
    share = np.exp(a * np.log(beyond) + p * log_h - np.outer(lags - shift, beyond)).sum(axis=1)
    mean = np.exp((lags - lags[0]) * np.log1p(kernel.decay[-1])) * kernel.amplitude[-1]
    return float(np.abs((_factor(family, q) * spacing * share - mean) / far_weights(family, q, lags)).max())


def _lower_error(family: str, q: float, steps: int, kernel: Kernel, spacing: float) -> tuple[float, float]:
    """Gauss's remainder at the last lag; and what the rule as computed is off for the powers it is meant for."""
    a, p, shift = _in_common(family, q)
    r, t, next_lag = 2 * LOW_NODES + 1 + (kernel.ramp != 0.0), steps - shift, kernel.lags + 1
    s = -np.log1p(kernel.decay[: LOW_NODES + 2])
    s, s_J = s[:-1], s[-1] / math.exp(spacing)
    h = np.sinh(s / 2) / np.where(s > 0, s / 2, 1.0) + (s == 0)
    amplitude = kernel.amplitude[: len(s)] - kernel.ramp * next_lag * (s == 0)
    omega = amplitude * np.exp(s * (next_lag - shift)) / h**p / _factor(family, q)
    off = 0.0
    for k in range(r):
        moment = -spacing * s_J**a * (s_J * t) ** k / math.expm1(-spacing * (a + k))
        slope = kernel.ramp * t / _factor(family, q) if k == 1 else 0.0
        off += abs(float(omega @ (s * t) ** k) - slope - moment) / math.factorial(k)
    norm = little_jacobi(r - 2 * LOW_NODES + a, spacing)
    remainder = spacing * s_J**a * (s_J * t) ** r / math.factorial(r) * norm
    x = r / (2 * t)  # F is h^p e^(−st): Leibniz's formula, and Cauchy's for h^p in a circle of radius 2
    leibniz = 1 + (math.sinh(1 + s_J) / (1 + s_J)) ** p * x / (1 - x)
    weight = math.exp(math.lgamma(a)) * t**-a
    return float(leibniz * remainder / weight), float(leibniz * off / weight)


def _factor(family: str, q: float) -> float:
    """The factor of the integral, sin(πa)/π."""
    return -sine_ratio(q) if family == "gl" else sine_ratio(1 - q)


def _rounding(kernel: Kernel, steps: int) -> float:
    """What double precision costs the sum of the exponentials: four units in the last place of its terms.

    Above order 1 the constant of a long ``pi`` kernel is much larger than the first weights, by (steps/L)^(q−1).
    """
    lags = np.geomspace(kernel.lags + 1, steps, 40).astype(np.int64)
    beyond = lags - kernel.lags - 1
    terms = np.exp(np.outer(beyond, np.log1p(kernel.decay))) @ np.abs(kernel.amplitude) + abs(kernel.ramp) * beyond
    return float(4 * np.finfo(np.float64).eps * (terms / np.abs(kernel.at(lags))).max())


if __name__ == "__main__":
    print(certificate(compressed(1e-10), sys.argv[1], float(sys.argv[2]), int(sys.argv[3])))
