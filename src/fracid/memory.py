r"""The history sum of a fractional system: kept whole, cut short, or compressed.

Every scheme of :mod:`fracid.simulate` needs, at each step n and for each state, one sum over
the whole past,

.. math::  H_n = \sum_{k=1}^{n} w_k\, v_{n-k},

with the weights of one of three kernels, all in units of the step:

=======  ==========================================================================================
``gl``   the Grünwald–Letnikov weights (18)–(19) of the derivative, :math:`v = x - x(0)`
``pi``   the product-trapezoidal weights of the integral, :math:`v = f(t, x)`:
         :math:`b_k = \big((k+1)^{q+1} - 2k^{q+1} + (k-1)^{q+1}\big)/\Gamma(q+2)`, and
         :math:`a_n = \big((n-1)^{q+1} - (n-1-q)\,n^q\big)/\Gamma(q+2)` for the sample at the start
``pi3``  the same for :math:`f - δ^2 f/12` and an end correction (:mod:`fracid.starting`):
         :math:`w_k = b_k - (b_{k+1} - 2 b_k + b_{k-1})/12` from k = 3 on; built from ``pi``, within 4/3 of its
         bound
=======  ==========================================================================================

A :class:`Kernel` keeps the first L weights exactly and the rest as a sum of decaying exponentials,
:math:`w_k \approx \sum_m c_m z_m^k` for :math:`k > L`.  The three memories are three fillings of it:

=================  ===================  ==============  =======================================
memory             exact weights        exponentials    error
=================  ===================  ==============  =======================================
``full``           all                  none            rounding
``short(L)``       L                    none or one     see :func:`short`; it can be large
``compressed``     8                    10–65           each weight within ``tolerance``, relative
=================  ===================  ==============  =======================================

so one compiled loop serves all, and a step costs O(L + modes) instead of O(n).

**How the compression works.**  With :math:`a = 1 - q` for ``pi`` and :math:`a = 1 + q` for ``gl``,

.. math::

    \frac{t^{q-1}}{\Gamma(q)} = \frac{\sin \pi q}{\pi} \int_0^\infty s^{a-1} e^{-st}\,ds, \qquad
    w_k = -\frac{\sin \pi q}{\pi} \int_0^\infty s^{a-1}
          \Big(\frac{1-e^{-s}}{s}\Big)^{q} e^{-s(k-q)}\,ds .

Put :math:`s = e^u` and sum over a grid of spacing Δ.  Three errors share the tolerance, 78 : 10 : 10:

1. *Spacing.* By Poisson's formula the relative error at every lag is
   :math:`2\,|\Gamma(a + 2\pi i/\Delta)/\Gamma(a)|`, about :math:`e^{-\pi^2/\Delta}`: 0.4 gives 10⁻¹⁰.
2. *Upper end.* The exact lags see to nodes with large :math:`e^{s L}`.  The last node that is kept stands for
   all beyond it: its place is their mean in 1/(s + σ), which leaves an error of second order.
3. *Lower end.* The grid below :math:`s_J = \theta/n` is infinite, and for q → 1 its weights do not decay
   (a fixed range of nodes is silently wrong there).  But :math:`e^{-st}` is nearly a polynomial in s
   for s t ≤ θ, and all moments of that part of the grid are geometric series,
   :math:`M_k = \Delta s_J^{a+k} / (1 - e^{-\Delta(a+k)})`.  So a Gauss–Radau rule does for all of it: the
   constant s = 0 and five inner nodes, exact for polynomials of degree 10.  Its remainder, which sets θ, is known
   too: the inner nodes are the roots of a little q-Jacobi polynomial, whose norm has a closed form.  For ``pi``
   and 1 < q < 2 the integral diverges at zero; the same series gives :math:`M_0` its finite part, which is what
   the kernel :math:`t^{q-1}` needs (Hadamard), and a double node at zero (a constant and a ramp in k) keeps the
   rule well conditioned up to q = 2, where the ramp is all that remains.

:meth:`Memory.certificate` computes the three from a kernel as built, and holds it against the exact weights;
``docs/memory.md`` has the derivation and the tables.

References
----------
.. [Lubich] C. Lubich, A. Schädler, *Fast convolution for nonreflecting boundary conditions*,
   SIAM J. Sci. Comput. 24 (2002): history by exponentials.
.. [McLean] W. McLean, *Exponential sum approximations for* :math:`t^{-\beta}`, 2018: the substitution
   :math:`s = e^u` and its Poisson error.
.. [Koekoek] R. Koekoek, P. A. Lesky, R. F. Swarttouw, *Hypergeometric Orthogonal Polynomials and Their
   q-Analogues*, 2010, section 14.12: the little q-Jacobi polynomials.
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

import numpy as np
from numba import types
from numpy.typing import NDArray

from fracid.compiling import helper, kept, when_called
from fracid.errors import InputError
from fracid.fractional import gl_weights

__all__ = ["Certificate", "Kernel", "Memory", "compressed", "full", "memory_from_name", "short"]

FloatArray = NDArray[np.float64]

EXACT_LAGS = 8
"""Lags that the compressed memory keeps exactly; 16 need two exponentials fewer, and take 3 % longer to step."""

WHOLE = 64
"""Runs of no more steps are kept whole."""

SPACING, UPPER, LOWER = 0.78, 0.1, 0.1
"""Shares of the tolerance; what is left covers Stirling's formula and the mean's second order."""

CHECKED = 1000
"""Up to this lag a certificate compares every weight."""

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
        family : ``"gl"``, ``"pi"`` or ``"pi3"``
        order : float
            Strictly between 0 and 2.
        steps : int
            Number of steps of the run: the largest lag that will be asked for.
        """
        return self.build(family, order, steps)

    def certificate(self, family: str, order: float, steps: int) -> Certificate:
        """Say how far the weights of a run's kernel can be from the exact ones, and how far they are.

        The bounds are computed from the nodes and weights of the kernel as built; the measurement holds it against
        the exact weights, by an expansion that owes nothing to the quadrature.  ``docs/memory.md`` derives both.

        Parameters
        ----------
        family : ``"gl"`` or ``"pi"``
        order : float
            Strictly between 0 and 2.
        steps : int
            Number of steps of the run, at least 1.

        Raises
        ------
        InputError
            If one of these is something else; it says what to type.

        Examples
        --------
        >>> certificate = compressed(1e-10).certificate("pi", 0.9, steps=10_000_000)
        >>> certificate.lags, certificate.modes
        (8, 40)
        >>> certificate.measured < certificate.bound < 1e-10
        True
        >>> short(100).certificate("pi", 0.9, steps=10_000_000).bound  # what is dropped, nothing bounds
        inf
        """
        _check_run(family, order, steps)
        kernel = self.kernel(family, float(order), int(steps))
        lags, error = _errors_found(kernel, family, float(order), int(steps))
        worst = int(np.argmax(error))
        return Certificate(
            self.name, family, float(order), int(steps), kernel.lags, kernel.modes,
            *_proved(family, float(order), int(steps), kernel),
            float(error[worst]), int(lags[worst]), float(error[lags <= CHECKED].max()),
        )  # fmt: skip


def _check_run(family: str, order: float, steps: int) -> None:
    if family not in ("gl", "pi"):
        raise InputError(f"There is no family of weights {family!r}; type 'gl' (the derivative's, Grünwald–Letnikov) "
                         "or 'pi' (the integral's, product trapezoidal).")  # fmt: skip
    if not 0 < order < 2:
        raise InputError(f"The order is {order!r}; it must lie strictly between 0 and 2, for example 0.9.")
    if not (isinstance(steps, int | np.integer) and steps >= 1):
        raise InputError(f"steps={steps!r}: the number of steps must be whole and at least 1, for example 20_000.")


def full() -> Memory:
    """Keep every sample: exact, and O(n²) in time.

    Examples
    --------
    >>> full().kernel("gl", 0.5, steps=3).weights
    array([ 1.    , -0.5   , -0.125 , -0.0625])
    """
    return Memory("full", _exact)


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


def compressed(tolerance: float = 1e-10, *, lags: int = EXACT_LAGS) -> Memory:
    """Keep the last few lags and a few dozen decaying exponentials: O(n), and as good as full.

    Every weight is within `tolerance` of the exact one, relative to it, for every order strictly
    between 0 and 2 and up to 10⁷ steps; so H_n is within tolerance · Σ|w_k v_{n−k}|.
    :meth:`Memory.certificate` shows it, and what rounding adds: for ``pi`` well above order 1, where a long
    kernel's constant dwarfs its first weights, up to 10⁻⁹ of those at order 1.9 and 10⁷ steps.

    Parameters
    ----------
    tolerance : float, between 1e-13 and 1e-2
    lags : int, between 8 and 64
        Lags kept exactly.  More of them need fewer exponentials; 8 make the fastest runs.

    Raises
    ------
    InputError
        If `tolerance` is not between 1e-13 (rounding) and 1e-2, or `lags` not between 8 and 64.

    Examples
    --------
    >>> kernel = compressed(1e-10).kernel("pi", 0.9, steps=20_000)
    >>> kernel.lags, kernel.modes
    (8, 27)
    >>> compressed(1e-10, lags=16).kernel("pi", 0.9, steps=20_000).modes
    25
    """
    if not 1e-13 <= tolerance <= 1e-2:
        raise InputError(f"compressed({tolerance!r}): the tolerance must lie between 1e-13 and 1e-2; "
                         "type for example tolerance=1e-10.")  # fmt: skip
    if not (isinstance(lags, int | np.integer) and EXACT_LAGS <= lags <= WHOLE):
        raise InputError(f"compressed(lags={lags!r}): the exact lags must be a whole number from {EXACT_LAGS} to "
                         f"{WHOLE}; type for example lags=16.")  # fmt: skip
    name = f"compressed({tolerance:g})" if lags == EXACT_LAGS else f"compressed({tolerance:g}, lags={lags})"
    return Memory(name, lambda *run: _compressed(*run, float(tolerance), int(lags)))


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
    if family == "pi3":
        return _exact_third(order, steps)
    if order == 1.0 and family == "pi":  # a running sum: the trapezoidal rule, no memory
        return Kernel(np.array([0.5, 1.0]), np.array([0.0, 0.5]), np.zeros(1), np.ones(1), np.full(1, 0.5))
    if order == 1.0:  # a backward difference
        return Kernel(np.array([1.0, -1.0]), np.array([1.0, -1.0]), *np.empty((3, 0)))
    if family == "gl":
        w = gl_weights(order, steps + 1)
        return Kernel(w, w, *np.empty((3, 0)))
    return Kernel(*_trapezoidal_weights(order, steps), *np.empty((3, 0)))


def _exact_third(q: float, steps: int) -> Kernel:
    if q == 1.0:  # Adams and Moulton's fourth-order weights, summed; the running sum after three lags
        w, start = np.array([9, 28, 23, 24]) / 24, np.array([0, 15, 11, 12]) / 24
        return Kernel(w, start, np.zeros(1), np.ones(1), np.full(1, 0.5))
    return Kernel(*_third_weights(q, steps), *np.empty((3, 0)))


# What follows is compiled, since orders change, and kernels with them, at each evaluation of a fit.
_real, _whole, _row = types.float64, types.int64, types.float64[::1]
_compile: dict[str, Any] = {"nogil": True, "error_model": "numpy"}


@kept(types.UniTuple(_row, 2)(_real, _whole), **_compile)
def _trapezoidal_weights(q: float, steps: int) -> tuple[FloatArray, FloatArray]:
    r"""b_k and a_k for k = 0 … steps, free of the cancellation of their second differences.

    With the binomial series, :math:`b_k Γ(q+2) = 2 \sum_j \binom{q+1}{2j} k^{q+1-2j}` and
    :math:`a_k Γ(q+2) = \sum_{j≥2} (-1)^j \binom{q+1}{j} k^{q+1-j}`; from k = 8 on, 20 terms are exact.
    """
    b, a, binomial = np.zeros(steps + 1), np.zeros(steps + 1), np.ones(20)
    b[0] = 1.0
    for k in range(1, min(8, steps + 1)):
        up, down = math.expm1(q * math.log1p(1 / k)), math.expm1(q * math.log1p(-1 / k))  # for orders next to 0
        b[k], a[k] = k**q * ((k + 1) * up + (k - 1) * down), k**q * ((k - 1) * down + q)
    for j in range(19):
        binomial[j + 1] = binomial[j] * (q - (j - 1)) / (j + 1)
    for k in range(8, steps + 1):
        even = odd = 0.0
        for j in range(18, 1, -2):
            even, odd = even / k / k + binomial[j], odd / k / k + binomial[j + 1]
        b[k], a[k] = 2 * k ** (q - 1) * even, k ** (q - 1) * (even - odd / k)
    return b / math.gamma(q + 2), a / math.gamma(q + 2)


@helper
def zeta(s: float) -> float:
    """Riemann's ζ(s) for s < 0, by Euler's and Maclaurin's formula from the 12th term on."""
    N = 12.0
    total: float = N ** (1 - s) / (s - 1) + N**-s / 2
    for k in range(1, 12):
        total += float(k) ** -s
    term = s * N ** (-s - 1) / 2
    for j, bernoulli in enumerate((1 / 6, -1 / 30, 1 / 42, -1 / 30, 5 / 66)):
        total += bernoulli * term
        term *= (s + 2 * j + 1) * (s + 2 * j + 2) / (N * N * (2 * j + 3) * (2 * j + 4))
    return total


@kept(types.UniTuple(_row, 2)(_real, _whole), **_compile)
def _third_weights(q: float, steps: int) -> tuple[FloatArray, FloatArray]:
    r"""The weights of ``pi3``: those of f − δ²f/12 under ``pi``, less κ δ²f at the last step; and of the start.

    Up to k = 2 the second difference is the last step's, backward.  The start counts f_{-1} as f_0.
    """
    b, a = _trapezoidal_weights(q, steps + 3)
    w, start = np.zeros(steps + 1), np.zeros(steps + 1)
    kappa = zeta(-q - 1) / math.gamma(q + 2)
    for k in range(steps + 1):
        w[k] = b[k] - (b[k + 1] - 2 * b[k] + (b[k - 1] if k > 0 else 0.0)) / 12
        start[k] = a[k] + (b[k] - b[k - 1]) / 12 if k > 0 else 0.0
    for k in range(min(3, steps + 1)):
        last = (1.0, -2.0, 1.0)[k]
        w[k] -= last * kappa + (3.0, -3.0, 1.0)[k] * b[0] / 12
        start[k] = k**q / math.gamma(q + 1) - w[:k].sum() if k > 0 else 0.0  # constants are integrated exactly
    return w, start


# --- exponentials ----------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def _compressed(family: str, q: float, steps: int, tolerance: float, lags: int) -> Kernel:
    if q == 1.0 or steps <= WHOLE:
        return _exact(family, q, steps)
    if family == "gl":
        return Kernel(*_derivative_kernel(q, -_sine(q), lags, steps, tolerance))
    if family == "pi3":
        return _third_kernel(q, lags, steps, tolerance)
    return Kernel(*_integral_kernel(q, _sine(1 - q), lags, steps, tolerance))


def _third_kernel(q: float, L: int, steps: int, tolerance: float) -> Kernel:
    """The exponentials of ``pi``, valid one lag earlier, less a twelfth of their second difference."""
    pi = Kernel(*_integral_kernel(q, _sine(1 - q), L - 1, steps + 1, tolerance))
    rise = -np.expm1(-np.log1p(pi.decay))  # 1 − 1/z
    share = 1 - (pi.decay - rise) / 12
    amplitude = pi.amplitude * (1 + pi.decay) * share
    amplitude[0] += pi.ramp
    w, start = _third_weights(q, L)
    return Kernel(w, start, pi.decay, amplitude, (pi.start_ratio + rise / 12) / share, pi.ramp, 1 / 12)


def _sine(a: float) -> float:
    """sin(πa)/π, to full relative precision next to whole numbers too."""
    whole = round(a)
    return (1 - 2 * (whole % 2)) * math.sin(math.pi * (a - whole)) / math.pi


@helper
def _half_hat(s: float) -> float:
    """(e^s − 1 − s)/s², by its series where the difference would cancel."""
    if s >= 0.5:
        return (math.expm1(s) - s) / s**2
    series = 1.0
    for j in range(14, 2, -1):
        series = 1 + series * s / j
    return series / 2


@helper
def _quadrature(
    a: float, sine: float, first: float, steps: int, tolerance: float, double: bool
) -> tuple[FloatArray, FloatArray, float]:
    r"""Nodes, weights and ω' with (sin πa/π) ∫₀^∞ s^(a−1) F(s) ds = Σ ω F(s) + ω' F'(0).

    For :math:`F(s) = g(s) e^{-st}` with g smooth and t from `first` to `steps`; the first node is 0.
    `sine` is sin(πa)/π, from the caller, who knows a next to whole numbers better than 1 ± q does.
    """
    gamma, inner = math.exp(math.lgamma(a)), LOW_NODES
    spacing = _spacing(a, SPACING * tolerance)
    left = 0.3 * (1 + abs(a)) * math.expm1(spacing) ** 2  # of nodes of which a mean takes the place
    s_end = _upper_end(a, UPPER * tolerance * gamma / (spacing * left)) / first
    s_J = _low_width(a, spacing, LOWER * tolerance * gamma, double) / steps
    s_J = min(s_J, s_end * math.exp(-4 * spacing))  # in a short run, or next to order 1
    count = math.ceil(math.log(s_end / s_J) / spacing - 1e-9) - 1
    s, omega = np.zeros(1 + inner + count), np.zeros(1 + inner + count)
    slope_weight = _low_end(a, sine, spacing, double, s, omega)
    for m in range(1 + inner):
        s[m], omega[m] = s_J * s[m], s_J**a * omega[m]
    for m in range(1 + inner, len(s)):
        s[m] = s_J * math.exp(spacing * (m - inner))
        omega[m] = sine * spacing * s[m] ** a
    s[-1], mass = _mean_of_rest(a, s[-1], spacing, first, s_end)
    omega[-1] = sine * spacing * mass
    return s, omega, s_J ** (a + 1) * slope_weight


@helper
def _mean_of_rest(a: float, last: float, spacing: float, first: float, sigma: float) -> tuple[float, float]:
    """One node for `last` and all beyond: Gauss's rule in x = 1/(s + σ) for masses s^a e^(−s·first)."""
    mass = mean = 0.0
    for j in range(5):
        s = last * math.exp(spacing * j)
        share = s**a * math.exp((last - s) * first) / (s + sigma)
        mass, mean = mass + share, mean + share / (s + sigma)
    node = mass / mean - sigma
    return node, mass**2 / mean * math.exp((node - last) * first)


@helper
def _spacing(a: float, tolerance: float) -> float:
    """Δ with 2·|Γ(a + 2πi/Δ)| = tolerance·|Γ(a)|, by Stirling: |Γ(a+iy)| ~ √(2π) y^(a−½) e^(−πy/2)."""
    scale = math.log(2 * math.sqrt(2 * math.pi) / tolerance) - math.lgamma(a)
    y = 10.0
    for _ in range(6):
        y = max(3.0, (scale + (a - 0.5) * math.log(y)) * 2 / math.pi)
    return 2 * math.pi / y


@helper
def _upper_end(a: float, weight: float) -> float:
    """y with y^a e^(−y) = weight."""
    y = 20.0
    for _ in range(6):
        y = max(3.0, a * math.log(y) - math.log(weight))
    return y


@helper
def _low_width(a: float, spacing: float, error: float, double: bool) -> float:
    r"""θ at which the rule of :func:`_low_end` is off by `error` (relative to t^(−a), for t = n) on e^(−st).

    Gauss's remainder for F = e^(−st) is Δ θ^(a+r)/r! · ∫ x^p π² dμ ≤ error, with r = 2 · inner nodes + p.
    """
    p = 2 if double else 1
    r = 2 * LOW_NODES + p
    power = error * math.exp(math.lgamma(r + 1.0)) / (spacing * _little_jacobi(a + p, spacing))
    return math.exp(math.log(power) / (a + r))


@helper
def _little_jacobi(b: float, spacing: float) -> float:
    """∫ π² dμ of the monic orthogonal polynomial of degree LOW_NODES for masses A^j at Q^j, [Koekoek] (14.12.2)."""
    n, Q, A = LOW_NODES, math.exp(-spacing), math.exp(-spacing * b)
    norm: float = A**n * Q ** (n * (n - 1)) / (1 - A * Q ** (2 * n))
    for k in range(n):
        norm *= ((1 - Q ** (k + 1)) / (1 - A * Q ** (n + k))) ** 2
    return norm


@helper
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


@helper
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


@when_called(types.Tuple(_rows)(_real, _real, _whole, _whole, _real))
def _derivative_kernel(q: float, sine: float, L: int, steps: int, tolerance: float) -> tuple[FloatArray, ...]:
    """The fields of a ``gl`` kernel."""
    w = np.ones(L + 1)
    for k in range(1, L + 1):
        w[k] = w[k - 1] * (k - 1 - q) / k  # (19)
    s, omega, _ = _quadrature(1 + q, sine, L + 1 - 0.7 * q, steps, tolerance, False)
    for m in range(len(s)):
        slope = -math.expm1(-s[m]) / s[m] if s[m] > 0 else 1.0
        omega[m] *= slope**q * math.exp(-s[m] * (L + 1 - q))
    return w, w, np.expm1(-s), omega, np.ones(len(s))


@when_called(types.Tuple((*_rows, _real))(_real, _real, _whole, _whole, _real))
def _integral_kernel(q: float, sine: float, L: int, steps: int, tolerance: float) -> tuple[Any, ...]:
    """The fields of a ``pi`` kernel."""
    b, a = _trapezoidal_weights(q, L)
    s, omega, ramp = _quadrature(1 - q, sine, L + 0.7, steps, tolerance, q > 1)
    start = np.empty(len(s))
    for m in range(len(s)):
        hat = (math.sinh(s[m] / 2) / (s[m] / 2)) ** 2 if s[m] > 0 else 1.0
        start[m] = _half_hat(s[m]) / hat
        omega[m] *= hat * math.exp(-s[m] * (L + 1))
    omega[0] -= ramp * (L + 1)
    return b, a, np.expm1(-s), omega, start, -ramp


# --- what is proved, and what is found -------------------------------------------------------------


def _in_common(family: str, q: float) -> tuple[float, float, float]:
    r"""a, p, shift: in both families :math:`w_k` is a factor times :math:`∫ s^{a-1} h(s)^p e^{-s(k - shift)} ds`.

    With :math:`h = \sinh(s/2)/(s/2)`: the hat function has its square, and (1 − e^(−s))/s is h e^(−s/2).
    """
    return (1 + q, q, q / 2) if family == "gl" else (1 - q, 2.0, 0.0)


def _far_weights(family: str, q: float, lags: NDArray[np.int64]) -> FloatArray:
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
    scale = -_sine(q) * math.gamma(1 + q) if family == "gl" else 1 / math.gamma(q)
    exact: FloatArray = scale * t**-a * total
    return exact


def _errors_found(kernel: Kernel, family: str, q: float, steps: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Lags, and the relative error of the kernel's weight at each."""
    if q == 1.0 or steps <= EXACT_LAGS:  # known weights
        return np.array([steps]), np.zeros(1)
    spread = np.geomspace(CHECKED, max(CHECKED, steps), 2000).astype(np.int64)
    lags = np.unique(np.minimum(np.concatenate([np.arange(EXACT_LAGS + 1, CHECKED + 1), spread]), steps))
    return lags, np.abs(kernel.at(lags) / _far_weights(family, q, lags) - 1)


def _proved(family: str, q: float, steps: int, kernel: Kernel) -> tuple[float, float, float, float]:
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
    return float(np.abs((_factor(family, q) * spacing * share - mean) / _far_weights(family, q, lags)).max())


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
    norm = _little_jacobi.py_func(r - 2 * LOW_NODES + a, spacing)
    remainder = spacing * s_J**a * (s_J * t) ** r / math.factorial(r) * norm
    x = r / (2 * t)  # F is h^p e^(−st): Leibniz's formula, and Cauchy's for h^p in a circle of radius 2
    leibniz = 1 + (math.sinh(1 + s_J) / (1 + s_J)) ** p * x / (1 - x)
    weight = math.exp(math.lgamma(a)) * t**-a
    return float(leibniz * remainder / weight), float(leibniz * off / weight)


def _factor(family: str, q: float) -> float:
    """The factor of the integral, sin(πa)/π."""
    return -_sine(q) if family == "gl" else _sine(1 - q)


def _rounding(kernel: Kernel, steps: int) -> float:
    """What double precision costs the sum of the exponentials: four units in the last place of its terms.

    Above order 1 the constant of a long ``pi`` kernel is much larger than the first weights, by (steps/L)^(q−1).
    """
    lags = np.geomspace(kernel.lags + 1, steps, 40).astype(np.int64)
    beyond = lags - kernel.lags - 1
    terms = np.exp(np.outer(beyond, np.log1p(kernel.decay))) @ np.abs(kernel.amplitude) + abs(kernel.ramp) * beyond
    return float(4 * np.finfo(np.float64).eps * (terms / np.abs(kernel.at(lags))).max())
