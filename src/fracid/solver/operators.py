r"""Derivatives and integrals of any real order: the weights, sampled signals, and the function that solves.

**Grünwald–Letnikov (16)–(19).**  With the binomial weights :math:`w_k = (-1)^k \binom{q}{k}`,

.. math::  {}^{GL}D^q f(t_n) \approx h^{-q} \sum_{k=0}^{n} w_k\, f(t_{n-k}), \qquad
           w_0 = 1,\quad w_k = \Big(1 - \frac{q+1}{k}\Big) w_{k-1}.

**Riemann–Liouville and Caputo (14).**  With :math:`m = \lceil q \rceil` (0 for an integral) and I the
integral from the record's start,

.. math::

    {}^{C}D^q f = I^{m-q} f^{(m)}, \qquad
    {}^{RL}D^q f = {}^{C}D^q f + \sum_{j<m} \frac{f^{(j)}(0)}{\Gamma(j+1-q)}\, t^{j-q}, \qquad
    I^s g(t) = \frac{1}{\Gamma(s)} \int_0^t (t-u)^{s-1} g(u)\, du .

What is computed is *exactly* these of the cubic spline p through the samples (not-a-knot: no conditions
made up at the ends).  On the cell from sample i to the next, :math:`p^{(m)} = \sum_l a_{il}\, x^l` with x in
steps from the cell's start, so the integral is a few convolutions with the moments of the kernel over a cell,

.. math::

    I^s p^{(m)}(t_n) = h^{s-m} \sum_l \sum_{i<n} a_{il}\, K_l(n-i), \qquad
    K_l(k) = \frac{1}{\Gamma(s)} \int_0^1 (k-x)^{s-1} x^l\, dx .

=========  ====================  =========================================================================
``kind``   exact to rounding on  error at a fixed t > 0, as the step h goes to 0
=========  ====================  =========================================================================
caputo,    polynomials of        :math:`h^{4-q}` (an integral: :math:`h^4`) where the signal is smooth.  For a
rl         degree 3              signal that starts as :math:`t^r`: also :math:`h^{r+1}`, and for caputo above
                                 order 1 :math:`h^{r+1-m}`, since it has to tell the start's derivatives
gl         nothing but order 0   :math:`h`
=========  ====================  =========================================================================

(From order 3 on the spline is of degree 5, 7, …, the next odd number above q, and 6, 8, … take the place of 4.)

*What to use when.*  ``caputo`` is the derivative of the paper and of fracid's models: 0 for a constant.
``rl`` differs by what the start value contributes, and is infinite at the first sample unless that is 0.
``gl`` is ``rl`` to first order, causal (a value uses no later sample) and what the paper's scheme sees; take
it to compare with that.  The spline is not quite causal: the k-th sample before one feels it :math:`0.27^k`.
No kind filters: white noise of size σ comes out as about :math:`\sigma h^{-q}`.
An integer order gives the plain derivative or repeated integral, whatever the kind; just above an
integer m, Caputo's differs from it by :math:`f^{(m)}(0)`, which is the definition's doing.

Everything costs O(n log n): a million samples take well below a second.

References
----------
.. [Podlubny] I. Podlubny, *Fractional Differential Equations*, 1999: the three definitions, Sections 2.2–2.4.
.. [Li] C. Li, F. Zeng, *Numerical Methods for Fractional Calculus*, 2015: such rules of low degree.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from functools import lru_cache
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from fracid.arrays import FloatArray, real_array
from fracid.errors import InputError, at_least
from fracid.solver.trajectory import SAYS, refuse_masked

ORDER_LIMIT = 10.0
"""Largest order of :func:`derivative`, either way: the tenth difference of any recording is noise."""

SIGNAL_LIMIT = 1e200
"""Largest sample of :func:`derivative`; beyond it sums overflow."""


def gl_weights(order: float, count: int) -> FloatArray:
    r"""Give the Grünwald–Letnikov weights :math:`w_k = (-1)^k \binom{q}{k}`, (18), by the recursion (19).

    Parameters
    ----------
    order : float
        q, any real number; negative for an integral.
    count : int
        How many weights, from w_0 on; at least 1.

    Returns
    -------
    ndarray, shape (count,)
        Relative error below 1e-12 up to k = 10⁶; exact integers where the order is an integer, and so
        zeros after w_q for the order q = 0, 1, 2, …

    Raises
    ------
    InputError
        If the order is not a finite number, the count is below 1, or the weights overflow.

    Examples
    --------
    >>> gl_weights(0.5, 4)
    array([ 1.    , -0.5   , -0.125 , -0.0625])
    >>> gl_weights(2, 5)
    array([ 1., -2.,  1.,  0.,  0.])
    """
    order = _number("order", order)
    at_least("count", count, 1)
    k = np.arange(1.0, count)
    # The first form is exact where a factor is nearly zero; over 10⁶ factors it would drift by 10⁻¹¹, since
    # k - 1 - q rounds alike for many k.  The second, as printed in (19), does not.
    factors = np.where(k < 2 * abs(order) + 2, (k - 1 - order) / k, 1 - (order + 1) / k)
    with np.errstate(over="ignore", invalid="ignore"):
        weights = np.concatenate(([1.0], np.cumprod(factors)))
    if not np.isfinite(weights).all():
        raise InputError(f"order {order!r} makes {len(weights)} weights overflow. Take an order nearer to 0.")
    return np.rint(weights) + 0.0 if float(order).is_integer() else weights


def derivative(
    signal: ArrayLike, order: float, step: float, *, kind: Literal["caputo", "gl", "rl"] = "caputo"
) -> FloatArray:
    r"""Differentiate or integrate a sampled signal to any real order.

    Parameters
    ----------
    signal : array_like, shape (n_samples,) or (n_samples, n_channels)
        Equally spaced samples; the first is at t = 0, where the memory starts.  It need not be 0.
    order : float
        q in [-10, 10]; a negative order is the integral of order -q.
    step : float
        h [s].
    kind : {"caputo", "gl", "rl"}
        Which definition; the module's first screen says what differs.

    Returns
    -------
    ndarray, same shape as the signal
        In the signal's unit times s^-q.  Rounding costs no more than the samples' own does, some 10 to 100
        units in the last place of the largest sample times h^-q (much, for high orders).  At the first
        sample, where every fractional integral is 0: ``caputo`` gives 0 for a fractional order and ``rl``
        gives ±inf where its definition does: unless the signal (above order 1 also its slope, …) is 0 there.
        A record of three samples or fewer is taken as the polynomial through them.

    Raises
    ------
    InputError
        If the signal is empty, not of this shape or not of finite real numbers, the step not positive, the
        order out of range, or the kind unknown.

    Notes
    -----
    Equations (14) for ``caputo``, (16)–(17) for ``gl``; formulas and references at the module's top.

    Examples
    --------
    >>> t = np.linspace(0, 1, 5)
    >>> bool(np.allclose(derivative(t**2, 0.5, 0.25), 2 / math.gamma(2.5) * t**1.5))
    True
    >>> derivative(np.full(4, 10.0), 0.8623, 1e-3)
    array([0., 0., 0., 0.])
    >>> derivative([1.0, 1.0, 1.0], 0.5, 1.0, kind="rl")
    array([       inf, 0.56418958, 0.39894228])
    """
    values = _signal(signal)
    order, step = _number("order", order), _number("step", step)
    if abs(order) > ORDER_LIMIT:
        raise InputError(f"order is {order:g}, expected a number between -10 and 10, for example order=0.9.")
    if step <= 0:
        raise InputError(f"step is {step:g}, expected the time between samples [s], for example step=0.001.")
    if kind not in tuple(_KINDS):
        raise InputError(f'kind is {kind!r}, expected "caputo", "gl" or "rl".')
    channels = values.reshape(len(values), -1).T
    with np.errstate(over="ignore", invalid="ignore"):
        result = _KINDS[kind](channels, order) * np.power(step, -order)
    if not np.isfinite(result[:, 1:]).all():
        raise InputError(f"order {order:g} at a step of {step:g} s overflows. Give time or the signal in another unit.")
    return np.ascontiguousarray(result.T).reshape(values.shape)


# Checks, at the edge and once.


def _number(name: str, value: Any) -> float:
    # An int may be too large for float(), so the comparison comes first; NaN fails it too.
    limit: Any = sys.float_info.max
    if not isinstance(value, Real) or not -limit <= value <= limit:
        raise InputError(f"{name} is {value!r}, expected a finite number.")
    return float(value)


def _signal(signal: ArrayLike) -> FloatArray:
    refuse_masked("signal", signal)
    values = real_array(signal, "signal is {}, expected real numbers, shape (n,) or (n, channels).")
    if values.ndim not in (1, 2) or values.size == 0:
        raise InputError(f"signal has shape {values.shape}, expected (n,) or (n, channels) with at least one sample.")
    bad = np.argwhere(~(np.abs(values) < SIGNAL_LIMIT))
    if len(bad):
        place = tuple(bad[0].tolist())
        raise InputError(SAYS("signal", place=", ".join(map(str, place)), value=values[place], count=len(bad),
                              limit=SIGNAL_LIMIT))  # fmt: skip
    return values


# Grünwald–Letnikov.


def _grunwald_letnikov(values: FloatArray, order: float) -> FloatArray:
    """(17) in units of the step, shape (n_channels, n_samples)."""
    n = values.shape[1]
    weights = gl_weights(order, n)
    lags = np.flatnonzero(weights)
    if len(lags) > ORDER_LIMIT + 1:
        return _causal_sum(weights[None], values[None])
    result = np.zeros_like(values)  # a plain difference: the FFT would add rounding
    for k in lags:
        result[:, k:] += weights[k] * values[:, : n - k]
    return result


def _causal_sum(kernels: FloatArray, signals: FloatArray) -> FloatArray:
    """Σ_l Σ_i kernels[l, n - i] signals[l, channel, i] for every n, by FFT, shape (n_channels, n_samples)."""
    from scipy.fft import irfft, next_fast_len, rfft

    n = signals.shape[-1]
    size = next_fast_len(2 * n - 1, real=True)
    spectrum = sum(rfft(k, size) * rfft(s, size) for k, s in zip(kernels, signals, strict=True))
    return np.asarray(irfft(spectrum, size)[..., :n])


# Riemann–Liouville and Caputo, of the spline through the samples; in units of the step.


_KINDS: dict[str, Callable[[FloatArray, float], FloatArray]] = {
    "caputo": lambda values, order: _of_spline(values, order, 0 if order > 0 else 1),
    "gl": _grunwald_letnikov,
    "rl": lambda values, order: _of_spline(values, order, max(math.ceil(order), 1)),
}


def _of_spline(values: FloatArray, order: float, start_terms: int) -> FloatArray:
    """I^(m-q) p^(m), and what the derivatives at the start contribute, shape (n_channels, n_samples)."""
    if order == 0:
        return values
    # Splining f - f(0) keeps a large offset (α = π) from costing digits, and makes constants exact.
    rises = values - values[:, :1]
    degree = max(3, 2 * math.floor((order + 1) / 2) + 1)  # odd and above the order
    spline = _spline(rises, degree)
    m = max(math.ceil(order), 0)
    result = _integral(spline, m, m - order, values.shape[1])
    start = np.array([values[:, 0], *(_start_derivative(spline, rises, j) for j in range(1, start_terms))])
    return result + _powers(start[:start_terms], order, values.shape[1])


def _spline(values: FloatArray, degree: int) -> Any:
    """Not-a-knot spline, x in steps; a record of up to ``degree`` samples goes on as its polynomial."""
    from scipy.interpolate import make_interp_spline

    n = values.shape[1]
    for _ in range(n, degree + 1):  # the n-th difference of a polynomial of degree n - 1 vanishes
        following = -values[:, -n:] @ gl_weights(n, n + 1)[:0:-1]
        values = np.column_stack([values, following])
    return make_interp_spline(np.arange(values.shape[1]), values, k=degree, axis=1)


def _integral(spline: Any, m: int, s: float, n: int) -> FloatArray:
    """I^s of the m-th derivative of a spline at the first n knots, s ≥ 0."""
    if s == 0:
        return np.asarray(spline(np.arange(n), nu=m))
    powers = range(spline.k - m + 1)
    cells = np.array([spline(np.arange(n - 1), nu=m + r) / math.factorial(r) for r in powers])
    result = np.zeros((cells.shape[1], n))
    if n > 1:
        result[:, 1:] = _causal_sum(_cell_moments(s, len(powers), n - 1), cells)
    return result


@lru_cache(maxsize=16)  # windows of a record have the same length
def _cell_moments(s: float, powers: int, count: int) -> FloatArray:
    r"""K_l(k) = 1/Γ(s) ∫₀¹ (k-x)^(s-1) x^l dx for l < powers and k = 1 … count, shape (powers, count).

    The integral is a Beta function for k = 1.  For k > 1 its closed form is a difference of large numbers;
    Gauss–Legendre sums only positive ones and converges at about (4k - 2)^(-2 nodes), the singularity being
    off the cell.
    """
    from scipy.special import rgamma

    moments = np.empty((powers, count))
    moments[:, 0] = [math.factorial(r) / math.gamma(r + 1 + s) for r in range(powers)]
    for lags, nodes in ((slice(1, 16), 12), (slice(16, count), 6)):
        x, w = np.polynomial.legendre.leggauss(nodes)
        x, w = (x + 1) / 2, w / 2 * rgamma(s)
        k = np.arange(1.0, count + 1)[lags]
        pairs = zip(x, w, strict=True)
        moments[:, lags] = sum(np.multiply.outer(xi ** np.arange(powers), wi * (k - xi) ** (s - 1)) for xi, wi in pairs)
    return moments


def _start_derivative(spline: Any, rises: FloatArray, j: int) -> FloatArray:
    """p^(j)(0) per channel, exactly 0 where it is so within rounding: else ``rl`` would be infinite at 0."""
    slope = np.asarray(spline(0.0, nu=j))
    rounding = 256 * np.finfo(float).eps * np.abs(rises[:, :16]).max(axis=1)
    return np.where(np.abs(slope) > rounding, slope, 0.0)


def _powers(start: FloatArray, order: float, n: int) -> FloatArray:
    """Σ_j start_j t^(j-q) / Γ(j+1-q), t = 0 … n-1, shape (n_channels, n); at 0 the strongest term rules."""
    from scipy.special import rgamma

    result = np.zeros((start.shape[1], n))
    t = np.arange(1.0, n)
    for j in reversed(range(len(start))):
        coefficient = start[j] * rgamma(j + 1 - order)
        result[:, 1:] += np.multiply.outer(coefficient, t ** (j - order))
        if j < order:
            result[:, 0] = np.where(coefficient == 0, result[:, 0], np.copysign(np.inf, coefficient))
    return result
