r"""The order of ``pi2`` and ``pi3`` where a solution begins like t^q: Lubich's starting corrections.

The solution of D^q x = f(t, x) begins as :math:`x_0 + f_0 t^q/Γ(q+1)`, so that f itself begins like
:math:`f_0 + c\,t^{σ}` with σ = q, or with any other sum of orders of the system.  Straight pieces between
the grid points miss the area under :math:`t^σ` for σ < 1, most of it in the first panels, and an error of
order 1 + σ stays for ever.  It can be taken out exactly, since the error that a rule of weights w makes of
:math:`t^σ` is known (in units of the step, k and n being whole numbers):

.. math::  E_σ(n) = \frac{Γ(σ+1)}{Γ(σ+q+1)} n^{σ+q} - \sum_{k=1}^{n} w_{n-k}\, k^σ .

So, with the exponents :math:`σ_1 … σ_s` of the system,

1. the first s steps are solved together, each with its corrections, by Newton's method;
2. from :math:`f_1 … f_s` follow the :math:`c_m` with :math:`f_k = f_0 + \sum_m c_m k^{σ_m}`;
3. every later step n adds :math:`h^q \sum_m c_m E_{σ_m}(n)` to what it knows, at no cost to speak of.

:math:`E_σ(n)` is summed up to n = 32.  Beyond, both ends of the sum are expanded by Euler's and Maclaurin's formula
with Riemann's ζ (Navot's form of it, for ends like :math:`k^σ`), for ``pi2``

.. math::

    E_σ(n) ≈ -ζ(-σ)\frac{n^{q-1}}{Γ(q)} + ζ(-σ-1)\frac{n^{q-2}}{Γ(q-1)} - …
    - \frac{Γ(σ+1)}{12\,Γ(σ+q-1)} n^{σ+q-2} - …
    - \frac{ζ(-q-1)}{Γ(q+2)} σ(σ-1) n^{σ-2} + …,

the start's singularity, the rule's own second order, and its last panel.  These are evaluated at *knots*, 3 %
apart from n = 64 on, with parabolas between.

**pi3** takes the last two of these out of the rule itself, for every f: it applies the weights b of ``pi2`` to
:math:`f_k - δ^2 f_k/12`, and at the last step takes off :math:`κ\,δ^2 f_n`, :math:`κ = ζ(-q-1)/Γ(q+2)`, with the
backward second difference.  That is again a sum over f with weights of its own (:func:`fracid.solver.memory`, family
``pi3``); what it leaves is :math:`O(h^3)`, and :math:`O(h^4)` at order 1, where it is Adams's and Moulton's rule.  At
the start δ²f_0 is taken as f_2 − 2f_1 + f_0, so that parabolas are integrated exactly, and the exponents go up to 2.

**Which exponents.**  Sums of the orders of all states that move from the start on, and the power with which f
depends on t itself, as it is measured (f = t^0.6 + …, or a smooth x under a fractional derivative, which makes
:math:`D^q x` begin like :math:`t^{1-q}`); of these the :data:`MOST` smallest below 1 that are :data:`APART`,
and 1, whose error is zero, where none is near it: a straight line must not be mistaken for powers.  Nothing is
corrected where the start is stiffer than the step can see, that is where h^q ∂f/∂x has a spectral radius above 1.

**Where inputs jump** within these steps, f is not smooth.  How it begins is that of the inputs without their jumps, and
steps after the first jump are no longer solved together: the loop takes them, as it does all later jumps.

**bdf2** has the same corrections with its own errors, whose expansion needs no last panel, since its weights and
powers are coefficients of :math:`\sum_j d_j s^{j-q}` and :math:`Γ(σ+1)\,s^{-σ-1} + \sum_i ζ(-σ-i)(-s)^i/i!`, at
e^(−s): :math:`E_σ(n)` is the sum of :math:`n^{σ+q-j}` and :math:`n^{q-1-i-j}` that their product leaves.  It does not
integrate constants exactly either: the start weighs :math:`w_{n-1}/2`, which makes order 2, and the exponent 0, with
:math:`f_0` for its coefficient, does the rest.  Without corrections, thus in stiff starts, the loop puts :math:`f_1` in
the place of :math:`f_0`: at order 1 that is the backward Euler step that BDF2 is usually begun with, and the fast part
is gone after it.

References
----------
.. [Lubich] C. Lubich, *Discretized fractional calculus*, SIAM J. Math. Anal. 17 (1986): starting weights.
.. [DFFW] K. Diethelm, J. M. Ford, N. J. Ford, M. Weilbeer, *Pitfalls in fast numerical solvers for
   fractional differential equations*, J. Comput. Appl. Math. 186 (2006): how ill-conditioned they get.
.. [Navot] I. Navot, *An extension of the Euler–Maclaurin summation formula to functions with a branch
   singularity*, J. Math. Phys. 40 (1961).
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

import math
from bisect import insort
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import chain, repeat
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray
from scipy.special import binom, gamma, rgamma, zeta

from fracid.arrays import FloatArray, IntArray
from fracid.solver.compilation import INDICES, MATRIX, VECTOR, evaluate, when_called
from fracid.solver.loop_arguments import Run
from fracid.solver.weights import (
    bdf_series,
    bdf_weights,
    exact_weights,
    relaxing_kernel,
    third_weights,
    trapezoidal_weights,
)

PI, PI3, BDF = "pi", "pi3", "bdf"
"""The families of weights that are corrected: those of ``pi2``, ``pi3`` and ``bdf2``."""

APART, MOST = 0.09, 5
"""How far apart exponents must be, and how many are corrected at most: more would magnify what they do not fit."""

APART_THIRD = 0.04
"""The same for ``pi3``, which is exact for parabolas and so has less to fit."""

ROOM = 64
"""Sums of orders that are looked at, at most; the smallest are found first."""

ITERATIONS, LARGE = 50, 120
"""Of Newton's method for the start, with a matrix up to so many unknowns; beyond, of fixed-point sweeps."""

SUMMED = 32
"""Up to here E_σ(n) is summed, beyond it is expanded."""


class Start(NamedTuple):
    """The first steps, and what corrects the later ones."""

    known: FloatArray
    """States that are known, from the first sample of the past on, (n_known, n_states)."""
    x0: FloatArray
    """x⁰ of the formulas, (n_states,)."""
    together: int
    """s, how many steps were solved together; 0 where nothing is to be corrected."""
    knots: IntArray
    """Steps between which the corrections are parabolas, an odd number of them."""
    parabolas: FloatArray
    """:math:`\\sum_m c_m E_{σ_m}` between the knots (:func:`_parabolas`), (n_pieces, n_states, 3)."""


START = types.NamedTuple((MATRIX, VECTOR, types.int64, INDICES, types.float64[:, :, ::1]), Start)


# --- the tables of a start ---------------------------------------------------------------------------


class Corrections(NamedTuple):
    """What corrects the rule for some exponents, in units of the step, a row for each order."""

    fit: FloatArray
    """F with c = F (f_0, f_1 − f_0, …, f_s − f_0), (n_corrections, s + 1)."""
    together: FloatArray
    """M with x_n = x_0 + h^q Σ_{k ≤ s} M_{nk} f_k for n ≤ s, (n_orders, s + 1, s + 1)."""
    knots: IntArray
    """The n at which the corrections are known, an odd number of them."""
    errors: FloatArray
    """E with C(n) = Σ_e c_e E_e(n), (n_orders, n_corrections, n_knots)."""


@lru_cache(maxsize=64)
def corrections(family: str, orders: tuple[float, ...], sigma: tuple[float, ...], steps: int) -> Corrections:
    """Make the tables.

    ``pi3`` corrects :math:`δ^2 f_0` beside the powers, as f_2 − 2f_1 + f_0 and f_1 − f_0, and solves two steps
    together at least; ``bdf2`` corrects constants, :math:`f_0`, and solves one.

    Examples
    --------
    >>> corrections("pi", (0.8,), (0.8,), 100).together[0].round(4)
    array([[0.    , 0.    ],
           [0.4222, 0.6515]])
    """
    s, exponent = _steps_together(family, sigma), np.array(sigma)
    k, knots = np.arange(1.0, s + 1), knots_up_to(steps)
    fit = k ** exponent[:, None] / (1 + 4.0 ** exponent[:, None])  # the nearest, where there are fewer than steps
    if len(sigma) == s:
        fit = np.linalg.inv(k[:, None] ** exponent)
    fit = np.column_stack([np.zeros(len(fit)), fit])
    fit = np.vstack([fit, BEND_AND_RISE @ np.eye(3, s + 1)]) if family == PI3 else fit
    fit = np.vstack([np.eye(1, s + 1), fit]) if family == BDF else fit
    distinct = np.array([*dict.fromkeys(orders)])
    of = dict(zip(distinct.tolist(), _errors(family, distinct, exponent, knots), strict=True))
    M = {q: _starting_weights(family, q, E[:, : s + 1], fit) for q, E in of.items()}
    return Corrections(fit, np.array([M[q] for q in orders]), knots, np.array([of[q] for q in orders]))


BEND_AND_RISE = np.array([[0.0, -2.0, 1.0], [0.0, 1.0, 0.0]])
"""f_2 − 2f_1 + f_0 and f_1 − f_0, of f_1 − f_0 and f_2 − f_0."""


def _steps_together(family: str, sigma: tuple[float, ...]) -> int:
    """s, the number of steps that are solved together."""
    return max(len(sigma), {PI3: 2, BDF: 1}.get(family, 0))


def _errors(family: str, orders: FloatArray, sigma: FloatArray, knots: IntArray) -> FloatArray:
    """What a rule makes wrong at the knots: of each power, and of what else it corrects."""
    if family == BDF:
        return np.array([bdf_errors_of_powers(q, np.append(0.0, sigma), knots) for q in orders])
    E = errors_of_powers(orders, sigma, knots, family == PI3)
    return np.concatenate([E, [-_ends(q, knots) for q in orders]], axis=1) if family == PI3 else E


def _starting_weights(family: str, q: float, E: FloatArray, fit: FloatArray) -> FloatArray:
    """M of one order, exact for the powers, shape (s + 1, s + 1)."""
    s = fit.shape[1] - 1
    M = np.zeros((s + 1, s + 1))
    w, start = exact_weights(family, q, s)
    for n in range(1, s + 1):
        rows = slice(None)
        if family == PI3 and n <= 2:  # a parabola through the first three needs no correction of its own
            M[n, :3], rows = _parabola_weights(q, n), slice(None, -2)
        else:
            M[n, 0], M[n, 1 : n + 1] = start[n], w[:n][::-1]
        share = E[rows, n] @ fit[rows]
        M[n] += share
        M[n, 0] -= np.sum(share[1:])
    return M


@lru_cache(maxsize=256)
def exponents(orders: tuple[float, ...], powers_of_time: tuple[float, ...], third: bool = False) -> tuple[float, ...]:
    """Give the exponents σ with which f begins, in ascending order: below 1, and 1 where none is near it.

    For ``pi3`` (`third`): below 2, and with whole powers of t in the sums.

    Examples
    --------
    >>> exponents((0.4,), (0.0,)), exponents((0.5,), (0.0,)), exponents((0.9,), (0.0,), third=True)
    ((0.4, 0.8), (0.5, 1.0), (0.9, 1.0, 1.8, 1.9))
    """
    end, sums = (2.0 if third else 1.0) - 1e-9, [0.0]  # in ascending order, beginning with the empty sum
    powers = [power for power in powers_of_time if 0.05 < power < 0.98]  # they are measured to 0.01
    steps = [step for step in (*orders, *powers) if 1e-9 <= step < end]
    steps += [1.0] if third and steps else []
    for smaller in sums:  # each sum and each step give another: sums grow as they are walked
        for total in (smaller + step for step in steps):
            if total < end and len(sums) < ROOM and all(abs(total - other) > 1e-9 for other in sums):
                insort(sums, total)
    selection, apart = [0.0], APART_THIRD if third else APART
    for total in sums[1:]:
        if len(selection) <= MOST and (len(selection) == 1 or total - selection[-1] > apart):
            selection.append(total)
    if not third and 0 < selection[-1] < 0.75:
        selection.append(1.0)
    return tuple(selection[1:])


@lru_cache(maxsize=64)
def knots_up_to(steps: int) -> IntArray:
    """Give the n at which the corrections are known: all up to 64, then 3 % apart, an odd number, beyond `steps`."""
    knots = list(range(65))
    while knots[-1] < steps or len(knots) % 2 == 0:
        knots.append(knots[-1] + knots[-1] // 32)
    return np.array(knots)


def errors_of_powers(q: float | FloatArray, sigma: FloatArray, knots: IntArray, third: bool = False) -> FloatArray:
    """E_σ(n) for each order q and exponent σ, at the :func:`knots_up_to` an end, (n_orders, n_exponents, n_knots)."""
    summed = 2 * SUMMED if third else SUMMED
    weights = [(third_weights if third else trapezoidal_weights)(order, summed)[0] for order in np.atleast_1d(q)]
    q, s, k = np.atleast_1d(q)[:, None, None], sigma[:, None], np.arange(summed + 1)
    n, lag = knots.astype(float), k[:, None] - k
    near, far = n[: summed + 1], n[summed + 1 :]  # all are knots up to there
    exact, powers = gamma(s + 1) * rgamma(s + q + 1), k**s
    sums = np.array([powers @ np.where(lag >= 0, w[lag], 0.0).T for w in weights])
    start, rule, last = (_third_expansion if third else _expansion)(q, s)
    descending = far ** -np.arange(4.0)[:, None]  # powers of 1/n
    expanded = (far ** (q - 1) * (start @ descending) + far ** (s + q - 2) * (rule @ descending[:3] ** 2)
                + far ** (s - 2) * (last @ descending))  # fmt: skip
    E = np.concatenate([exact * near ** (s + q) - sums, expanded], axis=-1)
    if third:
        bend, rise = np.array([_ends(order, knots) for order in q[:, 0, 0]]).transpose(1, 0, 2)[:, :, None]
        E += bend * (2.0**s - 2) + rise
        for j in (1, 2):
            _, one, two = _parabola_weights(q, n[j])
            E[..., j] = (exact * n[j] ** (s + q) - one - two * 2.0**s)[..., 0]
    E[..., 0] = 0.0
    return np.where(s == 1.0, 0.0, E)


BDF_TERMS = 10
"""Of the expansion of ``bdf2``'s errors, which is taken from n = 65 on."""


def bdf_errors_of_powers(q: float, sigma: FloatArray, knots: IntArray) -> FloatArray:
    """E_σ(n) of ``bdf2``, shape (n_exponents, n_knots); at σ = 0 the start has its weights, half of the last."""
    E, (w, start) = np.zeros((len(sigma), len(knots))), bdf_weights(q, min(64, knots[-1]))
    i, d, near, n = np.arange(BDF_TERMS), bdf_series(q)[:BDF_TERMS], knots[1:] <= 64, knots[1:].astype(float)
    few, far = knots[1:][near], n[~near]
    for row, s in zip(E[:, 1:], sigma, strict=True):
        powers = np.append(0.0, np.arange(1.0, len(w)) ** s)
        exact = math.gamma(s + 1) / math.gamma(s + q + 1)  # J^q t^σ at t = 1
        row[near] = exact * n[near] ** (s + q) - np.convolve(w, powers)[few] - (s == 0) * start[few]
        smooth = math.gamma(s + 1) * d * rgamma(s + q + 1 - i) * (i > 0)
        c = (zeta(-s - i) + 0.5 * (s == 0)) * (-1.0) ** i / gamma(i + 1.0)
        singular = np.convolve(c, d)[:BDF_TERMS] * rgamma(q - i)
        row[~near] = -(far ** (s + q)) * polyval(1 / far, smooth) - far ** (q - 1) * polyval(1 / far, singular)
    return E


def _ends(q: float, knots: IntArray) -> FloatArray:
    """a_n/12 and −b_n/12 at the knots: what δ²f_0 weighs in ``pi3``, as f_2 − 2f_1 + f_0 and as f_1 − f_0."""
    b, a = trapezoidal_weights(q, 8)
    n, k = np.maximum(knots, 8).astype(float), np.arange(2, 18)
    terms = binom(q + 1, k)
    of_each = (-1) ** k, -2 * (k % 2 == 0)
    series = [n ** (q - 1) / math.gamma(q + 2) * polyval(1 / n, weight * terms) for weight in of_each]
    few = np.minimum(knots, 8)
    return np.where(knots < 8, [a[few], -b[few]], series) / 12


def _parabola_weights(q: Any, n: float) -> tuple[Any, Any, Any]:
    """What f_0, f_1, f_2 weigh in J^q of the parabola through them, from 0 to n."""
    m0, m1, m2 = n**q * rgamma(q + 1), n ** (q + 1) * rgamma(q + 2), 2 * n ** (q + 2) * rgamma(q + 3)
    return m0 - 1.5 * m1 + 0.5 * m2, 2 * m1 - m2, 0.5 * m2 - 0.5 * m1


ENDS = np.array([[-1.0, 0.0, -1 / 12, 0.0], [0.0, 1.0, 0.0, 1 / 12], [0.0, 0.0, -1 / 2, 0.0], [0.0, 0.0, 0.0, 1 / 6]])
"""What ζ(a), ζ(a − 1), … weigh in 1, 1/n, 1/n², 1/n³ at an end of the sum: its own share, and that of a δ²/12."""


def _expansion(q: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients of E_σ(n) for large n in powers of 1/n: the start's, the rule's own (1/n²), the last panel's."""
    k = np.arange(4)
    start = zeta(-s - k) @ ENDS * rgamma(q - k)
    rule = -gamma(s + 1) * rgamma(s + q - np.array([1, 3, 5])) / (12, 360, 20160)
    last = zeta(-q - 1 - k) @ ENDS * np.cumprod(s - 1 - k, axis=-1)
    return start, rule, last * s * rgamma(q + 2)


def _third_expansion(q: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same for ``pi3``, but for δ²f_0."""
    k, y = np.arange(4), zeta(-q - 1 - np.arange(3))
    start = zeta(-s - k) * rgamma(q - k) * (-1, 1, -1 / 2, 1 / 6)
    rule = gamma(s + 1) * rgamma(s + q - np.array([1, 3, 5])) * (0, 1 / 90, 1 / 1008)
    none = np.zeros(y.shape[:-1])
    last = np.stack([none, 1 / 12 + y[..., 0] - y[..., 1], y[..., 2] / 2 - 1 / 24 - 7 * y[..., 0] / 12, none], -1)
    falling = -s * (s - 1) * (s - 2) * np.concatenate([s, s, s - 3, s], axis=1) ** (k == 2)
    return start, rule, last * falling * rgamma(q + 2)


# --- the start of a run ------------------------------------------------------------------------------


@when_called(types.void(types.int64, VECTOR, MATRIX, MATRIX, VECTOR, MATRIX), allocates=False)
def _evaluate(rhs, t, x, u, p, f):
    """Fill each row of f from those of t, x and u."""
    for k in range(len(t)):
        evaluate(rhs, t[k], x[k], u[k], p, f[k])


@np.errstate(all="ignore")  # f may be infinite anywhere
def begun(rhs: int, runs: Sequence[Run], family: str) -> list[Start]:
    """Solve the first steps together, and give what corrects the later ones; zeros where nothing is to be corrected.

    `rhs` is the address of f.  The runs have their inputs and grid in common, and differ in orders, parameters and
    initial states: all is done for all of them at once, along the first axis.
    """
    one = runs[0]
    steps = len(one.past) - 1 + one.steps
    if not (one.corrected or family == PI3):
        return [*map(_uncorrected, runs)]
    A, powers, moves = _look_around(rhs, runs)
    sigmas = [exponents((*run.orders[m].tolist(),), (*of_time.tolist(),), family == PI3) if one.corrected else ()
              for run, of_time, m in zip(runs, powers, moves, strict=True)]  # fmt: skip
    if len({*map(len, sigmas)}) > 1:
        alike = [[k for k, sigma in enumerate(sigmas) if len(sigma) == count] for count in {*map(len, sigmas)}]
        found = [begun(rhs, [runs[k] for k in few], family) for few in alike]
        of = dict(zip(chain(*alike), chain(*found), strict=True))
        return [of[k] for k in range(len(runs))]
    s = _steps_together(family, sigmas[0])
    if s == 0 or (steps < s and len(one.u) > 1):  # no inputs are known beyond the end
        return [*map(_uncorrected, runs)]
    tables = [_with_fading(run, corrections(family, tuple(run.orders.tolist()), sigma, steps + 8))
              for run, sigma in zip(runs, sigmas, strict=True)]  # fmt: skip
    fit, M, _, errors = (np.stack(part) for part in zip(*tables, strict=True))
    u, last = _without_jumps(one, s)
    settled, x, f, base = _solved_together(rhs, runs, u, A, M)
    f[:, 1:] -= f[:, :1]
    knots, known = tables[0].knots, x[:, : max(len(one.past) - 1, last) + 1]
    C = np.einsum("rei,rien->rin", fit @ f, errors) + [_held(run, knots) for run in runs]
    solved = map(Start, known, base, repeat(last), repeat(knots), _parabolas(knots, C))
    return [start if good else _uncorrected(run) for start, good, run in zip(solved, settled, runs, strict=True)]


def _uncorrected(run: Run) -> Start:
    """A start with nothing to correct but what finite memories hold."""
    knots, parabolas = np.array([0, 1, 2**62]), np.zeros((1, len(run.orders), 3))
    if len(run.fading):
        knots = knots_up_to(len(run.past) + run.steps + 7)
        parabolas = _parabolas(knots, _held(run, knots))
    return Start(run.past, run.past[0].copy(), 0, knots, parabolas)


def _held(run: Run, n: FloatArray | IntArray) -> FloatArray:
    """What finite memories that hold something at the start add at the steps n, over the gain: (n_states, n_steps)."""
    C = np.zeros((len(run.orders), len(n)))
    for i, (a, s, z) in ((int(row[0]), row[2:].reshape(-1, 3).T) for row in run.fading):
        C[i] = (a * z) @ np.expm1(-np.outer(s, n)) / run.gain[i]
    return C


def _with_fading(run: Run, tables: Corrections) -> Corrections:
    """The same with the rule alone for states of a finite memory, whose kernel is no power."""
    if not len(run.fading):
        return tables
    M, errors = tables.together.copy(), tables.errors.copy()
    lags = np.subtract.outer(np.arange(M.shape[1]), np.arange(M.shape[1]))
    for state, a_0, *of_each in run.fading.tolist():
        i, kernel = int(state), relaxing_kernel((a_0, *of_each[::3]), tuple(of_each[1::3]))
        first = replace(kernel, weights=kernel.start, amplitude=kernel.amplitude * kernel.start_ratio)
        M[i], errors[i] = np.where(lags >= 0, kernel.at(np.maximum(lags, 0).ravel()).reshape(lags.shape), 0.0), 0.0
        M[i, :, 0] = first.at(lags[:, 0])
        M[i, 0] = 0.0
    return tables._replace(together=M, errors=errors)


def _parabolas(knots: IntArray, C: FloatArray) -> FloatArray:
    """Divided differences of C over knots 0, 1, 2, then 2, 3, 4, …: shape (…, n_pieces, n_states, 3)."""
    slope = np.diff(C) / np.diff(knots)
    first = slope[..., ::2]
    second = (slope[..., 1::2] - first) / (knots[2::2] - knots[:-2:2])
    return np.ascontiguousarray(np.stack([C[..., :-2:2], first, second], axis=-1).swapaxes(-3, -2))


def _look_around(rhs: int, runs: Sequence[Run]) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Look at f about the starts: h^q ∂f/∂x, with which powers of t it begins, and which states move.

    The powers are those of f(t, x_0 + t·slope), 0 where it does not depend on t.  A state moves by its own f or through
    others; those at rest say nothing of how a solution begins.
    """
    one, x0, slope = runs[0], np.array([run.past[0] for run in runs]), np.array([run.slope for run in runs])
    states, e, d = x0.shape[1], 1e-6 * one.h, 1e-6 * (0.01 + np.abs(x0))
    aside = d[:, None] * np.eye(states)
    x = x0[:, None] + np.concatenate([aside, -aside, slope[:, None] * [[0.0], [e], [2 * e], [0.0]]], axis=1)
    t = np.full(x.shape[1], _first_time(one))
    t[-3], t[-2] = t[-3] + e, t[-2] + 2 * e
    u = np.repeat(one.u[:1], len(t), axis=0)
    u[-1] = one.u[min(1, len(one.u) - 1)]
    f = np.zeros(x.shape)
    for run, x_run, f_run in zip(runs, x, f, strict=True):
        _evaluate(rhs, t, x_run, u, run.p, f_run)
    gain = np.array([run.gain for run in runs])
    A = gain[..., None] * (f[:, :states] - f[:, states : 2 * states]).swapaxes(1, 2) / (2 * d)[:, None]
    now, soon, twice_as_soon, then = f[:, 2 * states :].swapaxes(0, 1)
    once, twice = np.abs(soon - now), np.abs(twice_as_soon - now)
    with_time = (once > 1e-11 * np.abs(now)) & (twice > once)
    powers = np.zeros(x0.shape)
    powers[with_time] = np.log2(twice[with_time] / once[with_time])
    moves = (now != 0) | (then != 0) | (powers > 0)
    for _ in range(0 if moves.all() else states):
        moves |= ((A != 0) @ moves[..., None])[..., 0]
    return A, powers, moves


def _without_jumps(run: Run, s: int) -> tuple[FloatArray, int]:
    """The inputs of s steps as they would go on without their jumps, and the step at which they first do jump, or s.

    How a solution begins is told by what comes before them; what comes after them is no longer solved together.
    """
    u = run.u[: s + 1] if len(run.u) > 1 else np.repeat(run.u, s + 1, axis=0)
    if not len(run.after):
        return u, s
    jumps = run.after[: s + 1] - u
    return u - (np.cumsum(jumps, axis=0) - jumps), int(min([s, *np.flatnonzero(jumps.any(axis=1))]))


def _first_time(run: Run) -> float:
    """Time of the first known sample, the t = 0 of the formulas."""
    return run.start - (len(run.past) - 1) * run.h


def _solved_together(
    rhs: int, runs: Sequence[Run], u: FloatArray, A: FloatArray, M: FloatArray
) -> tuple[list[bool], FloatArray, FloatArray, FloatArray]:
    """Solve for x_{m+1} … x_s and f_0 … f_s by Newton's method, with the matrix of the start: x, f, and x(0).

    And whether it settles; not where a step leads further than the last: that would be another root.
    """
    one, (count, states, _, end) = runs[0], M.shape
    m, s = len(one.past) - 1, end - 1
    power = np.linalg.matrix_power(A, 16)  # whose norm's root is near the radius, whatever the states' scales
    calm = np.max(np.sum(np.abs(power), axis=-1), axis=-1) ** (1 / 16) <= 1.0
    past, gain, slope = (np.array([getattr(run, n) for run in runs]) for n in ("past", "gain", "slope"))
    x, base = past.take(np.minimum(np.arange(max(m, s) + 1), m), axis=1), past[:, 0].copy()
    f, n = np.zeros((count, s + 1, states)), np.arange(s + 1.0)
    t = _first_time(one) + n * one.h
    held = np.array([_held(run, n).T for run in runs])
    drift, weights = n[:, None] * one.h * slope[:, None] + gain[:, None] * held, gain[..., None, None] * M
    size = max(0, s - m) * states
    inverse = (_newton_matrices(np.where(calm[:, None, None], A, 0.0), M, m) if 0 < size <= LARGE
               else np.tile(np.eye(size), (count, 1, 1)))  # fmt: skip
    settled = [
        bool(calm[k]) and _iterate(rhs, t, x[k], u, run.p, f[k], drift[k], weights[k], inverse[k], np.zeros(size),
                                   base[k], m, run.limit)
        for k, run in enumerate(runs)
    ]  # fmt: skip
    return settled, x, f, base


@when_called(
    types.boolean(types.int64, VECTOR, MATRIX, MATRIX, VECTOR, MATRIX, MATRIX, types.float64[:, :, ::1], MATRIX,
                  VECTOR, VECTOR, types.int64, types.float64), allocates=False,
)  # fmt: skip
def _iterate(rhs, t, x, u, p, f, drift, weights, inverse, left, base, m, limit):
    """Newton's method for the steps beyond m, with one matrix; tell if it settles."""
    steps, states, move = len(f), len(base), math.inf
    for _ in range(ITERATIONS):
        for k in range(steps):
            evaluate(rhs, t[k], x[k], u[k], p, f[k])
        for n in range(m, steps):
            for i in range(states):
                total = drift[n, i]
                for k in range(steps):
                    total += weights[i, n, k] * f[k, i]
                if n == m:
                    base[i] = x[m, i] - total  # x(0), but for what the model does not explain of the history
                else:
                    left[(n - m - 1) * states + i] = base[i] + total - x[n, i]
        moved_before, move = move, 0.0
        for r in range(len(left)):
            n, i, change = m + 1 + r // states, r % states, 0.0
            for c in range(len(left)):
                change += inverse[r, c] * left[c]
            x[n, i] += change
            move = max(move, abs(change) / (1e-3 + abs(x[n, i])))
            if not abs(x[n, i]) <= limit:
                return False
        if move < 1e-14 or move > max(moved_before, 1e-11):
            return move < 1e-14
    return move < 1e-11


def _newton_matrices(A: FloatArray, M: FloatArray, m: int) -> FloatArray:
    """The inverses of 1 − (M_{nk} − M_{mk}) A for the steps beyond m."""
    count, size = len(A), (M.shape[2] - 1 - m) * A.shape[1]
    B = (M - M[:, :, m : m + 1])[:, :, m + 1 :, m + 1 :]
    W = np.eye(size) - np.einsum("rink,ric->rnikc", B, A).reshape(count, size, size)
    return np.ascontiguousarray(np.linalg.inv(W))
