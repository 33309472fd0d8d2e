r"""The history sum of a fractional system: kept whole, cut short, or compressed.

Every scheme of :mod:`fracid.simulate` needs, at each step n and for each state, one sum over
the whole past,

.. math::  H_n = \sum_{k=1}^{n} w_k\, v_{n-k},

with the weights of one of two kernels, both in units of the step:

``gl``   the Grünwald–Letnikov weights (18)–(19) of the derivative, :math:`v = x - x(0)`
``pi``   the product-trapezoidal weights of the integral, :math:`v = f(t, x)`:
         :math:`b_k = \big((k+1)^{q+1} - 2k^{q+1} + (k-1)^{q+1}\big)/\Gamma(q+2)`, and
         :math:`a_n = \big((n-1)^{q+1} - (n-1-q)\,n^q\big)/\Gamma(q+2)` for the sample at the start

A :class:`Kernel` keeps the first L weights exactly and the rest as a sum of decaying exponentials,
:math:`w_k \approx \sum_m c_m z_m^k` for :math:`k > L`.  The three memories are three fillings of it:

=================  ===================  ==============  =======================================
memory             exact weights        exponentials    error
=================  ===================  ==============  =======================================
``full``           all                  none            rounding
``short(L)``       L                    none or one     see :func:`short`; it can be large
``compressed``     16                   12–60           each weight within ``tolerance``, relative
=================  ===================  ==============  =======================================

so one compiled loop serves all, and a step costs O(L + modes) instead of O(n).

**How the compression works.**  With :math:`a = 1 - q` for ``pi`` and :math:`a = 1 + q` for ``gl``,

.. math::

    \frac{t^{q-1}}{\Gamma(q)} = \frac{\sin \pi q}{\pi} \int_0^\infty s^{a-1} e^{-st}\,ds, \qquad
    w_k = -\frac{\sin \pi q}{\pi} \int_0^\infty s^{a-1}
          \Big(\frac{1-e^{-s}}{s}\Big)^{q} e^{-s(k-q)}\,ds .

Put :math:`s = e^u` and sum over a grid of spacing Δ.  Three errors, each given a third of the tolerance:

1. *Spacing.* By Poisson's formula the relative error at every lag is
   :math:`2\,|\Gamma(a + 2\pi i/\Delta)/\Gamma(a)|`, about :math:`e^{-\pi^2/\Delta}`: 0.4 gives 10⁻¹⁰.
2. *Upper end.* Nodes with :math:`e^{-s(L-1)}` below the tolerance are left out: the exact lags see to those.
3. *Lower end.* The grid below :math:`s_J = \theta/n` is infinite, and for q → 1 its weights do not decay
   (a fixed range of nodes is silently wrong there).  But :math:`e^{-st}` is nearly a polynomial in s
   for s t ≤ θ, and all moments of that part of the grid are geometric series,
   :math:`M_k = \Delta s_J^{a+k} / (1 - e^{-\Delta(a+k)})`.  So a Gauss–Radau rule does for all of it: the
   constant s = 0 and five inner nodes, exact for polynomials of degree 10.  For ``pi`` and 1 < q < 2 the
   integral diverges at zero; the same series gives :math:`M_0` its finite part, which is what the kernel
   :math:`t^{q-1}` needs (Hadamard), and a double node at zero (a constant and a ramp in k) keeps the
   rule well conditioned up to q = 2, where the ramp is all that remains.

References
----------
.. [Lubich] C. Lubich, A. Schädler, *Fast convolution for nonreflecting boundary conditions*,
   SIAM J. Sci. Comput. 24 (2002): history by exponentials.
.. [McLean] W. McLean, *Exponential sum approximations for* :math:`t^{-\beta}`, 2018: the substitution
   :math:`s = e^u` and its Poisson error.
.. [Diethelm] K. Diethelm, N. Ford, A. Freed, *Detailed error analysis for a fractional Adams
   method*, Numer. Algorithms 36 (2004): the product-trapezoidal weights.
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numba as nb
import numpy as np
from numba import types
from numpy.typing import NDArray

from fracid.errors import InputError
from fracid.fractional import gl_weights

__all__ = ["Kernel", "Memory", "compressed", "full", "memory_from_name", "short"]

FloatArray = NDArray[np.float64]

EXACT_LAGS = 16
"""Lags that the compressed memory keeps exactly; fewer need more exponentials, and the reverse."""

LOW_NODES = 5
"""Gauss nodes for the low end of the grid, beside the constant."""


@dataclass(frozen=True)
class Kernel:
    """The weights of one history sum, in units of the step, for one order."""

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

    @property
    def lags(self) -> int:
        """L, the number of lags kept exactly."""
        return len(self.weights) - 1

    def at(self, lags: NDArray[np.int64] | list[int]) -> FloatArray:
        """Give the weights that the kernel really uses at some lags, to hold against the exact ones.

        Examples
        --------
        >>> kernel = compressed(1e-10).kernel("gl", 0.8, steps=20_000)
        >>> exact = full().kernel("gl", 0.8, steps=20_000).weights
        >>> lags = [1, 16, 17, 500, 20_000]
        >>> bool(np.all(abs(kernel.at(lags) / exact[lags] - 1) < 1e-10))
        True
        """
        k = np.asarray(lags)
        beyond = np.maximum(k - self.lags - 1, 0)
        modes = np.exp(np.outer(beyond, np.log1p(self.decay))) @ self.amplitude + self.ramp * beyond
        weights: FloatArray = np.where(k <= self.lags, self.weights[np.minimum(k, self.lags)], modes)
        return weights


@dataclass(frozen=True)
class Memory:
    """How the past is kept; made by :func:`full`, :func:`short` or :func:`compressed`."""

    name: str
    """``full``, ``short(L)`` or ``compressed(tolerance)``."""
    build: Callable[[str, float, int], Kernel]
    """(family, order, steps) → the kernel of a run of so many steps."""

    def kernel(self, family: str, order: float, steps: int) -> Kernel:
        """Build the kernel of one state.

        Parameters
        ----------
        family : ``"gl"`` or ``"pi"``
        order : float
            Strictly between 0 and 2.
        steps : int
            Number of steps of the run: the largest lag that will be asked for.
        """
        return self.build(family, order, steps)


def full() -> Memory:
    """Keep every sample: exact, and O(n²) in time.

    Examples
    --------
    >>> full().kernel("gl", 0.5, steps=3).weights
    array([ 1.    , -0.5   , -0.125 , -0.0625])
    """
    return Memory("full", lambda family, order, steps: _exact(family, order, steps))


def short(length: int) -> Memory:
    """Keep the last `length` lags only (Podlubny's short-memory principle).

    For ``gl`` older samples are dropped; with |x − x(0)| ≤ M the derivative is then wrong by at most
    :math:`M (Lh)^{-q}/|\\Gamma(1-q)|`.  For ``pi`` dropping the past of an *integral* would forget where
    the state came from, so all older samples weigh as much as lag L does.  At order 1 both are exact.

    Raises
    ------
    InputError
        If `length` is not a whole number of at least 1.

    Examples
    --------
    >>> short(2).kernel("gl", 0.5, steps=100).weights
    array([ 1.   , -0.5  , -0.125])
    """
    if not (isinstance(length, int | np.integer) and length >= 1):
        raise InputError(f"short({length!r}): the length must be a whole number of lags, 1 or more; "
                         "type for example memory='short(2000)'.")  # fmt: skip

    def build(family: str, order: float, steps: int) -> Kernel:
        exact = _exact(family, order, min(int(length), steps))
        if family == "gl" or steps <= length:
            return exact
        return Kernel(exact.weights, exact.start, np.zeros(1), exact.weights[-1:], np.full(1, 0.5))

    return Memory(f"short({length})", build)


def compressed(tolerance: float = 1e-10) -> Memory:
    """Keep the last 16 lags and a few dozen decaying exponentials: O(n), and as good as full.

    Every weight is within `tolerance` of the exact one, relative to it, for every order strictly
    between 0 and 2 and up to 10⁷ steps; so H_n is within tolerance · Σ|w_k v_{n−k}|.

    Raises
    ------
    InputError
        If `tolerance` is not between 1e-13 (rounding) and 1e-2.

    Examples
    --------
    >>> kernel = compressed(1e-10).kernel("pi", 0.9, steps=20_000)
    >>> kernel.lags, len(kernel.decay) < 40
    (16, True)
    """
    if not 1e-13 <= tolerance <= 1e-2:
        raise InputError(f"compressed({tolerance!r}): the tolerance must lie between 1e-13 and 1e-2; "
                         "type for example tolerance=1e-10.")  # fmt: skip
    return Memory(f"compressed({tolerance:g})", lambda *run: _compressed(*run, float(tolerance)))


def memory_from_name(name: str | Memory, tolerance: float = 1e-10) -> Memory:
    """Turn ``"full"``, ``"short(2000)"`` or ``"compressed"`` into a :class:`Memory`.

    Raises
    ------
    InputError
        If the name is none of these.

    Examples
    --------
    >>> memory_from_name("short(500)").name
    'short(500)'
    """
    if isinstance(name, Memory):
        return name
    if name == "full":
        return full()
    if name == "compressed":
        return compressed(tolerance)
    length = str(name).removeprefix("short(").removesuffix(")")
    if str(name) == f"short({length})" and length.isdecimal():
        return short(int(length))
    raise InputError(f"There is no memory {name!r}; type 'full', 'short(L)' with L lags, or 'compressed'.")


# --- exact weights ---------------------------------------------------------------------------------


def _exact(family: str, order: float, steps: int) -> Kernel:
    if order == 1.0 and family == "pi":  # a running sum: the trapezoidal rule, no memory
        return Kernel(np.array([0.5, 1.0]), np.array([0.0, 0.5]), np.zeros(1), np.ones(1), np.full(1, 0.5))
    if order == 1.0:  # a backward difference
        return Kernel(np.array([1.0, -1.0]), np.array([1.0, -1.0]), *np.empty((3, 0)))
    if family == "gl":
        w = gl_weights(order, steps + 1)
        return Kernel(w, w, *np.empty((3, 0)))
    return Kernel(*_trapezoidal_weights(order, steps), *np.empty((3, 0)))


# What follows is compiled, since orders change, and kernels with them, at each evaluation of a fit.
_real, _whole, _row = types.float64, types.int64, types.float64[::1]
_compile = {"cache": True, "nogil": True, "error_model": "numpy"}
_helper = nb.njit(nogil=True, error_model="numpy")


@nb.njit(types.UniTuple(_row, 2)(_real, _whole), **_compile)
def _trapezoidal_weights(q: float, steps: int) -> tuple[FloatArray, FloatArray]:
    r"""b_k and a_k for k = 0 … steps, free of the cancellation of their second differences.

    With the binomial series, :math:`b_k Γ(q+2) = 2 \sum_j \binom{q+1}{2j} k^{q+1-2j}` and
    :math:`a_k Γ(q+2) = \sum_{j≥2} (-1)^j \binom{q+1}{j} k^{q+1-j}`; from k = 8 on, 20 terms are exact.
    """
    b, a, binomial = np.zeros(steps + 1), np.zeros(steps + 1), np.ones(20)
    b[0] = 1.0
    for k in range(1, min(8, steps + 1)):
        b[k] = (k + 1.0) ** (q + 1) - 2 * float(k) ** (q + 1) + (k - 1.0) ** (q + 1)
        a[k] = (k - 1.0) ** (q + 1) - (k - 1.0 - q) * float(k) ** q
    for j in range(19):
        binomial[j + 1] = binomial[j] * (q + 1 - j) / (j + 1)
    for k in range(8, steps + 1):
        even = odd = 0.0
        for j in range(18, 1, -2):
            even, odd = even / k / k + binomial[j], odd / k / k + binomial[j + 1]
        b[k], a[k] = 2 * k ** (q - 1) * even, k ** (q - 1) * (even - odd / k)
    return b / math.gamma(q + 2), a / math.gamma(q + 2)


# --- exponentials ----------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def _compressed(family: str, q: float, steps: int, tolerance: float) -> Kernel:
    if q == 1.0 or steps <= 4 * EXACT_LAGS:
        return _exact(family, q, steps)
    if family == "gl":
        return Kernel(*_derivative_kernel(q, -_sine(q), steps, tolerance))
    return Kernel(*_integral_kernel(q, _sine(1 - q), steps, tolerance))


def _sine(a: float) -> float:
    """sin(πa)/π, to full relative precision next to whole numbers too."""
    whole = round(a)
    return (1 - 2 * (whole % 2)) * math.sin(math.pi * (a - whole)) / math.pi


@_helper
def _half_hat(s: float) -> float:
    """(e^s − 1 − s)/s², by its series where the difference would cancel."""
    if s >= 0.5:
        return (math.expm1(s) - s) / s**2
    series = 1.0
    for j in range(14, 2, -1):
        series = 1 + series * s / j
    return series / 2


@_helper
def _quadrature(
    a: float, sine: float, lags: int, steps: int, tolerance: float, double: bool
) -> tuple[FloatArray, FloatArray, float]:
    r"""Nodes, weights and ω' with (sin πa/π) ∫₀^∞ s^(a−1) F(s) ds = Σ ω F(s) + ω' F'(0).

    For :math:`F(s) = g(s) e^{-sk}` with g smooth and k from `lags` to `steps`; the first node is 0.
    `sine` is sin(πa)/π, from the caller, who knows a next to whole numbers better than 1 ± q does.
    """
    third = tolerance / 3
    theta = (third / 3.6e-14) ** (1 / (2 * LOW_NODES + 1))  # θ^11/11! · ‖π_5‖² = a third
    spacing, s_J = _spacing(a, third), theta / steps
    count = max(1, math.ceil(math.log(_upper_end(a, third) / (lags - 1) / s_J) / spacing))
    s, omega = np.zeros(LOW_NODES + 1 + count), np.zeros(LOW_NODES + 1 + count)
    slope_weight = _low_end(a, sine, spacing, double, s, omega)
    for m in range(len(s)):
        if m <= LOW_NODES:
            s[m], omega[m] = s_J * s[m], s_J**a * omega[m]
        else:
            s[m] = s_J * math.exp(spacing * (m - LOW_NODES))
            omega[m] = sine * spacing * s[m] ** a
    return s, omega, s_J ** (a + 1) * slope_weight


@_helper
def _spacing(a: float, tolerance: float) -> float:
    """Δ with 2·|Γ(a + 2πi/Δ)| = tolerance·|Γ(a)|, by Stirling: |Γ(a+iy)| ~ √(2π) y^(a−½) e^(−πy/2)."""
    scale = math.log(2 * math.sqrt(2 * math.pi) / tolerance) - math.lgamma(a)
    y = 10.0
    for _ in range(6):
        y = max(3.0, (scale + (a - 0.5) * math.log(y)) * 2 / math.pi)
    return 2 * math.pi / y


@_helper
def _upper_end(a: float, tolerance: float) -> float:
    """y with Γ(a, y) ≈ y^(a−1) e^(−y) = tolerance·|Γ(a)|."""
    scale = -math.log(tolerance) - math.lgamma(a)
    y = 20.0
    for _ in range(6):
        y = max(3.0, scale + (a - 1) * math.log(y))
    return y


@_helper
def _low_end(a: float, sine: float, spacing: float, double: bool, s: FloatArray, omega: FloatArray) -> float:
    """Gauss–Radau rule in [0, 1], times sin(πa)/π, for the grid at and below s_J = 1; see :func:`_quadrature`.

    It fills the first entries of s and ω.  p conditions are met by the node at 0; the other nodes are Gauss's
    for masses A^j at Q^j, j = 0, 1, …: roots of the little q-Jacobi polynomial, whose coefficients are known.
    """
    n, p = LOW_NODES, 2 if double else 1
    Q, A = math.exp(-spacing), math.exp(-spacing * (a + p))
    M, c = np.empty(2 + n), np.ones(n + 1)
    for k in range(n + 2):
        M[k] = -sine * spacing / math.expm1(-spacing * (a + k))
    for k in range(n):
        c[k + 1] = c[k] * Q * (1 - Q ** (k - n)) * (1 - A * Q ** (n + k)) / ((1 - A * Q**k) * (1 - Q ** (k + 1)))
    omega[0], slope_weight = M[0], M[1] if double else 0.0
    for i in range(1, n + 1):
        s[i] = _next_root(c, s[1:i])
        quotient = mass = value = 0.0  # Π/(s − s_i): its coefficients, its integral, its value at s_i
        for k in range(n - 1, -1, -1):
            quotient = c[k + 1] + quotient * s[i]
            mass, value = mass + quotient * M[p + k], value + quotient * s[i] ** k
        omega[i] = mass / value / s[i] ** p
        omega[0] -= omega[i]
        if double:
            slope_weight -= omega[i] * s[i]
    return slope_weight


@_helper
def _next_root(c: FloatArray, known: FloatArray) -> float:
    """The largest root of Σ c_k x^k that is not yet known, all being in (0, 1): Newton's method, from above."""
    x = 1.1
    for _ in range(60):
        value = derivative = 0.0
        for k in range(len(c) - 1, -1, -1):
            derivative, value = derivative * x + value, value * x + c[k]
        for root in known:
            derivative -= value / (x - root)
        change = value / derivative
        x -= change
        if abs(change) <= 4e-16 * x:
            break
    return x


_rows = (_row,) * 5


@nb.njit(types.Tuple(_rows)(_real, _real, _whole, _real), **_compile)
def _derivative_kernel(q: float, sine: float, steps: int, tolerance: float) -> tuple[FloatArray, ...]:
    """The fields of a ``gl`` kernel."""
    L, w = EXACT_LAGS, np.ones(EXACT_LAGS + 1)
    for k in range(1, L + 1):
        w[k] = w[k - 1] * (k - 1 - q) / k  # (19)
    s, omega, _ = _quadrature(1 + q, sine, L, steps, tolerance, False)
    for m in range(len(s)):
        slope = -math.expm1(-s[m]) / s[m] if s[m] > 0 else 1.0
        omega[m] *= slope**q * math.exp(-s[m] * (L + 1 - q))
    return w, w, np.expm1(-s), omega, np.ones(len(s))


@nb.njit(types.Tuple((*_rows, _real))(_real, _real, _whole, _real), **_compile)
def _integral_kernel(q: float, sine: float, steps: int, tolerance: float) -> tuple[Any, ...]:
    """The fields of a ``pi`` kernel."""
    b, a = _trapezoidal_weights(q, EXACT_LAGS)
    s, omega, ramp = _quadrature(1 - q, sine, EXACT_LAGS, steps, tolerance, q > 1)
    start = np.empty(len(s))
    for m in range(len(s)):
        hat = (math.sinh(s[m] / 2) / (s[m] / 2)) ** 2 if s[m] > 0 else 1.0
        start[m] = _half_hat(s[m]) / hat
        omega[m] *= hat * math.exp(-s[m] * (EXACT_LAGS + 1))
    omega[0] -= ramp * (EXACT_LAGS + 1)
    return b, a, np.expm1(-s), omega, start, -ramp
