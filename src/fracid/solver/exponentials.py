r"""The compressed memory: weights as sums of decaying exponentials, by quadrature of their integrals.

For an order q, with :math:`a = 1 - q` for ``pi`` and :math:`a = 1 + q` for ``gl``,

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

``pi3`` takes the exponentials of ``pi``, valid one lag earlier, less a twelfth of their second difference.

``bdf``, the coefficients of :math:`(3/2 - 2ζ + ζ^2/2)^{-q} = \big((1-ζ)(3-ζ)/2\big)^{-q}`, have their integral along
the cut from ζ = 1 on, with :math:`ζ = e^s`,

.. math::

    w_k = \frac{\sin \pi q}{\pi} \int_0^{\ln 3} \Big(\frac{(e^s-1)(3-e^s)}{2}\Big)^{-q} e^{-sk}\,ds
          + O(k^{q-1}\,3^{-k}),

that of ``pi`` with another smooth factor beside :math:`s^{-q}`.  What the second root adds is gone after a few lags
more, which are kept exactly: 24 for a tolerance of 10⁻¹⁰.

References
----------
.. [Lubich] C. Lubich, A. Schädler, *Fast convolution for nonreflecting boundary conditions*,
   SIAM J. Sci. Comput. 24 (2002): history by exponentials.
.. [McLean] W. McLean, *Exponential sum approximations for* :math:`t^{-\beta}`, 2018: the substitution
   :math:`s = e^u` and its Poisson error.
.. [Golub] G. H. Golub, J. H. Welsch, *Calculation of Gauss quadrature rules*, Math. Comp. 23 (1969) 221.
.. [Koekoek] R. Koekoek, P. A. Lesky, R. F. Swarttouw, *Hypergeometric Orthogonal Polynomials and Their
   q-Analogues*, 2010, section 14.12: the little q-Jacobi polynomials.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy.linalg.lapack import dstev
from scipy.special import gammainc

from fracid.arrays import FloatArray
from fracid.solver.weights import Kernel, exact_kernel, exact_weights

EXACT_LAGS = 8
"""Lags that the compressed memory keeps exactly; 16 need two exponentials fewer, and take 3 % longer to step."""

WHOLE = 64
"""Runs of no more steps are kept whole."""

SPACING, UPPER, LOWER = 0.78, 0.1, 0.1
"""Shares of the tolerance; what is left covers Stirling's formula and the mean's second order."""

LOW_NODES = 5
"""Gauss nodes for the low end of the grid, beside the constant."""


# --- exponentials ----------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def compressed_kernel(family: str, q: float, steps: int, tolerance: float, lags: int) -> Kernel:
    """The weights of a family: `lags` exactly, the rest as exponentials within `tolerance`."""
    if q == 1.0 or steps <= WHOLE:
        return exact_kernel(family, q, steps)
    if family == "pi3":
        return _third_kernel(q, lags, steps, tolerance)
    if family == "bdf":  # the exponentials of the root at ζ = 1, after lags enough for that at 3
        lags = max(lags, 8 * math.ceil(math.log(10 / tolerance) / math.log(3) / 8))
    sine = -sine_ratio(q) if family == "gl" else sine_ratio(1 - q)
    decay, amplitude, start_ratio, ramp = _exponentials(family, q, sine, lags, steps, tolerance)
    return Kernel(*exact_weights(family, q, lags), decay, amplitude, start_ratio, ramp,
                  start_shift=0.5 if family == "bdf" else 1 / 6)  # fmt: skip


def _third_kernel(q: float, L: int, steps: int, tolerance: float) -> Kernel:
    """The exponentials of ``pi``, valid one lag earlier, less a twelfth of their second difference."""
    decay, amplitude, start_ratio, ramp = _exponentials("pi", q, sine_ratio(1 - q), L - 1, steps + 1, tolerance)
    rise = -np.expm1(-np.log1p(decay))  # 1 − 1/z
    share = 1 - (decay - rise) / 12
    amplitude *= (1 + decay) * share
    amplitude[0] += ramp
    w, start = exact_weights("pi3", q, L)
    return Kernel(w, start, decay, amplitude, (start_ratio + rise / 12) / share, ramp, 1 / 12)


def sine_ratio(a: float) -> float:
    """sin(πa)/π, to full relative precision next to whole numbers too."""
    whole = round(a)
    return (1 - 2 * (whole % 2)) * math.sin(math.pi * (a - whole)) / math.pi


def _quadrature(
    a: float, sine: float, first: float, steps: int, tolerance: float, double: bool
) -> tuple[FloatArray, FloatArray, float]:
    r"""Nodes, weights and ω' with (sin πa/π) ∫₀^∞ s^(a−1) F(s) ds = Σ ω F(s) + ω' F'(0).

    For :math:`F(s) = g(s) e^{-st}` with g smooth and t from `first` to `steps`; the first node is 0.
    `sine` is sin(πa)/π, from the caller, who knows a next to whole numbers better than 1 ± q does.
    """
    gamma, inner = math.exp(math.lgamma(a)), LOW_NODES
    spacing = _spacing(a, SPACING * tolerance)
    remainder = 0.3 * (1 + abs(a)) * math.expm1(spacing) ** 2  # of nodes of which a mean takes the place
    s_end = _upper_end(a, UPPER * tolerance * gamma / (spacing * remainder)) / first
    s_J = _low_width(a, spacing, LOWER * tolerance * gamma, double) / steps
    s_J = min(s_J, s_end * math.exp(-4 * spacing))  # in a short run, or next to order 1
    count = math.ceil(math.log(s_end / s_J) / spacing - 1e-9) - 1
    s = s_J * np.exp(spacing * (np.arange(1.0 + inner + count) - inner))
    omega, low = sine * spacing * s**a, slice(1, 1 + inner)
    nodes, weights, constant, slope_weight = _low_end(a, sine, spacing, double)
    s[0], s[low] = 0.0, s_J * nodes
    omega[0], omega[low] = s_J**a * constant, s_J**a * weights
    s[-1], mass = _mean_of_rest(a, s[-1], spacing, first, s_end)
    omega[-1] = sine * spacing * mass
    return s, omega, s_J ** (a + 1) * slope_weight


def _mean_of_rest(a: float, last: float, spacing: float, first: float, sigma: float) -> tuple[float, float]:
    """One node for `last` and all beyond: Gauss's rule in x = 1/(s + σ) for masses s^a e^(−s·first)."""
    mass = mean = 0.0
    for s in (last * math.exp(spacing * k) for k in range(5)):
        share = s**a * math.exp((last - s) * first) / (s + sigma)
        mass, mean = mass + share, mean + share / (s + sigma)
    node = mass / mean - sigma
    return node, mass**2 / mean * math.exp((node - last) * first)


def _spacing(a: float, tolerance: float) -> float:
    """Δ with 2·|Γ(a + 2πi/Δ)| = tolerance·|Γ(a)|, by Stirling: |Γ(a+iy)| ~ √(2π) y^(a−½) e^(−πy/2)."""
    scale = math.log(2 * math.sqrt(2 * math.pi) / tolerance) - math.lgamma(a)
    y = 10.0
    for _ in range(6):
        y = max(3.0, (scale + (a - 0.5) * math.log(y)) * 2 / math.pi)
    return 2 * math.pi / y


def _upper_end(a: float, weight: float) -> float:
    """y with y^a e^(−y) = weight."""
    y = 20.0
    for _ in range(6):
        y = max(3.0, a * math.log(y) - math.log(weight))
    return y


def _low_width(a: float, spacing: float, error: float, double: bool) -> float:
    r"""θ at which the rule of :func:`_low_end` is off by `error` (relative to t^(−a), for t = n) on e^(−st).

    Gauss's remainder for F = e^(−st) is Δ θ^(a+r)/r! · ∫ x^p π² dμ ≤ error, with r = 2 · inner nodes + p.
    """
    p = 2 if double else 1
    r = 2 * LOW_NODES + p
    power = error * math.exp(math.lgamma(r + 1.0)) / (spacing * little_jacobi(a + p, spacing))
    return math.exp(math.log(power) / (a + r))


def little_jacobi(b: float, spacing: float) -> float:
    """∫ π² dμ of the monic orthogonal polynomial of degree LOW_NODES for masses A^j at Q^j, [Koekoek] (14.12.2)."""
    n, Q, A = LOW_NODES, math.exp(-spacing), math.exp(-spacing * b)
    ratios = (((1 - Q ** (k + 1)) / (1 - A * Q ** (n + k))) ** 2 for k in range(n))
    return math.prod(ratios, start=A**n * Q ** (n * (n - 1)) / (1 - A * Q ** (2 * n)))


def _low_end(a: float, sine: float, spacing: float, double: bool) -> tuple[FloatArray, FloatArray, float, float]:
    """Gauss–Radau rule in [0, 1], times sin(πa)/π, for the grid at and below s_J = 1; see :func:`_quadrature`.

    p conditions are met by the node at 0; the other nodes are Gauss's for masses A^j at Q^j, j = 0, 1, …: eigenvalues
    of the recurrence of the little q-Jacobi polynomials, [Koekoek] (14.12.4) with its b = 1 [Golub].  Gives nodes and
    weights, and those of F(0) and F'(0).
    """
    p = 2 if double else 1
    Q, A = math.exp(-spacing), math.exp(-spacing * (a + p))
    power = Q ** np.arange(2 * LOW_NODES + 1)
    Q_n, rest = power[:LOW_NODES], 1 - A / Q * power  # 1 − A Q^(k−1)
    up = Q_n * rest[1 : LOW_NODES + 1] ** 2 / (rest[1::2] * rest[2::2])
    down = A / Q * Q_n[1:] * (1 - Q_n[1:]) ** 2 / (rest[2:-1:2] * rest[3::2])  # none of the first, where A may be Q
    s, vectors, _ = dstev(up + np.append(0.0, down), np.sqrt(up[:-1] * down))
    moments = [-sine * spacing / math.expm1(-spacing * (a + k)) for k in range(3)]
    omega = moments[p] * vectors[0] ** 2 / s**p
    return s, omega, moments[0] - sum(omega.tolist()), moments[1] - float(omega @ s) if double else 0.0


def _exponentials(
    family: str, q: float, sine: float, L: int, steps: int, tolerance: float
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Decay, amplitude and start ratio of the exponentials of a kernel, and their ramp."""
    a, first = (1 + q, L + 1 - 0.7 * q) if family == "gl" else (1 - q, L + (0.7 if family == "pi" else 1.0))
    s, omega, ramp = _quadrature(a, sine, first, steps, tolerance, family != "gl" and q > 1)
    decay, start, n = np.expm1(-s), np.ones(len(s)), s[1:]  # s_0 = 0
    if family == "gl":
        omega[1:] *= (-decay[1:] / n) ** q * np.exp(-n * (L + 1 - q))
    elif family == "pi":
        hat = (np.sinh(n / 2) / (n / 2)) ** 2
        start[0], start[1:] = 0.5, np.exp(n) * gammainc(2, n) / n**2 / hat  # (e^s − 1 − s)/s² without cancellation
        omega[1:] *= hat * np.exp(-n * (L + 1))
    else:  # the start's weights are half of those one lag earlier
        start = np.exp(s) / 2
        omega[1:] *= (np.expm1(n) * (3 - np.exp(n)) / (2 * n)) ** -q * np.exp(-n * (L + 1))
    omega[0] -= ramp * (L + 1)
    return decay, omega, start, -ramp
