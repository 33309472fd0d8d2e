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
depends on t itself,
measured by :func:`_powers_of_time` (f = t^0.6 + …, or a smooth x under a fractional derivative, which makes
:math:`D^q x` begin like :math:`t^{1-q}`); of these the :data:`MOST` smallest below 1 that are :data:`APART`,
and 1, whose error is zero, where none is near it: a straight line must not be mistaken for powers.  Nothing is
corrected where the start is stiffer than the step can see, that is where h^q ∂f/∂x has a spectral radius above 1.

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
# ruff: noqa: ARG001 (an intrinsic names its arguments for its callers)

from __future__ import annotations

import math
from typing import NamedTuple

import numba as nb
import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.solver.compilation import RHS, helper, when_called
from fracid.solver.loop_arguments import RUN
from fracid.solver.weights import bdf_series, bdf_weights, third_weights, trapezoidal_weights, zeta

PI2, PI3, BDF2 = 0, 1, 2
"""The rules that are corrected."""

Expansion = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]

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

_alone = nb.njit(nogil=True, error_model="numpy")  # for those that Python calls too


class Start(NamedTuple):
    """The first steps, and what corrects the later ones."""

    known: FloatArray
    """States that are known, from the first sample of the past on, (n_known, n_states)."""
    x0: FloatArray
    """x⁰ of the formulas, (n_states,)."""
    together: int
    """s, how many steps were solved together; 0 where nothing is to be corrected."""
    knots: NDArray[np.int64]
    """Steps between which the corrections are parabolas, an odd number of them."""
    parabolas: FloatArray
    """:math:`\\sum_m c_m E_{σ_m}` between the knots (:func:`_parabolas`), (n_pieces, n_states, 3)."""


START = types.NamedTuple(
    (types.float64[:, ::1], types.float64[::1], types.int64, types.int64[::1], types.float64[:, :, ::1]), Start
)


@_alone
def exponents(orders: FloatArray, powers_of_time: FloatArray, third: bool = False) -> FloatArray:
    """Give the exponents σ with which f begins, in ascending order: below 1, and 1 where none is near it.

    For ``pi3`` (`third`): below 2, and with whole powers of t in the sums.
    """
    end, count = (2.0 if third else 1.0), 1
    sums = np.zeros(ROOM)  # in ascending order, the first `count` of them, beginning with the empty one
    n, powers = len(orders), len(powers_of_time)
    for k in range(ROOM):  # each sum and each generator give another: sums grow as they are walked
        for g in range(n + powers + 1):
            step = 1.0 if g == n + powers else orders[g] if g < n else powers_of_time[g - n]
            power = n <= g < n + powers and 0.05 < step < 0.98  # they are measured to 0.01
            whole = g == n + powers and third and count > 1
            total = sums[k] + step
            if step >= 1e-9 and k < count < ROOM and total < end - 1e-9 and (g < n or power or whole):
                place = count
                while sums[place - 1] > total - 1e-9:
                    place -= 1
                if place == count or sums[place] > total + 1e-9:
                    for m in range(count, place, -1):
                        sums[m] = sums[m - 1]
                    sums[place] = total
                    count += 1
    selection, size = np.zeros(MOST + 2), 0
    for k in range(1, count):
        least = 0.0 if size == 0 else APART_THIRD if third else APART
        if size < MOST and sums[k] - selection[size] > least:
            size += 1
            selection[size] = sums[k]
    if not third and size > 0 and selection[size] < 0.75:
        size += 1
        selection[size] = 1.0
    return selection[1 : size + 1].copy()


@_alone
def knots_up_to(steps: int) -> NDArray[np.int64]:
    """Give the n at which the corrections are known: all up to 64, then 3 % apart, an odd number, beyond `steps`."""
    knots, last = np.zeros(1000, np.int64), 64  # as many as there are up to 10^13
    for n in range(last + 1):
        knots[n] = n
    while knots[last] < steps or last % 2 == 1:
        knots[last + 1] = knots[last] + knots[last] // 32
        last += 1
    return knots[: last + 1].copy()


@_alone
def errors_of_powers(q: float, sigma: FloatArray, knots: NDArray[np.int64], third: bool = False) -> FloatArray:
    """E_σ(n) for an order q, the exponents σ and n at the knots, shape (n_exponents, n_knots)."""
    E, summed = np.zeros((len(sigma), len(knots))), 2 * SUMMED if third else SUMMED
    powers = np.zeros(summed + 1)
    w = third_weights(q, summed)[0] if third else trapezoidal_weights(q, summed)[0]
    ends = _ends(q, knots) if third else np.zeros((len(knots), 2))
    for m in range(len(sigma)):
        s = sigma[m]
        if s == 1.0:
            continue
        for k in range(summed + 1):
            powers[k] = float(k) ** s
        exact = math.gamma(s + 1) / math.gamma(s + q + 1)
        start, rule, last = _third_expansion(q, s) if third else _expansion(q, s)
        for j in range(1, len(knots)):
            n = knots[j]
            if third and n <= 2:
                M = _parabola_weights(q, n)
                E[m, j] = exact * float(n) ** (s + q) - M[1] - M[2] * powers[2]
            elif n <= summed:
                E[m, j] = exact * float(n) ** (s + q) + ends[j, 0] * (powers[2] - 2) + ends[j, 1]
                for k in range(1, n + 1):
                    E[m, j] -= w[n - k] * powers[k]
            else:
                log, r = math.log(n), 1.0 / n
                E[m, j] = math.exp((q - 1) * log) * (start[0] + r * (start[1] + r * (start[2] + r * start[3])))
                E[m, j] += math.exp((s + q - 2) * log) * (rule[0] + r * r * (rule[1] + r * r * rule[2]))
                E[m, j] += math.exp((s - 2) * log) * (last[0] + r * (last[1] + r * (last[2] + r * last[3])))
                E[m, j] += ends[j, 0] * (powers[2] - 2) + ends[j, 1]
    return E


BDF_TERMS = 10
"""Of the expansion of ``bdf2``'s errors, which is taken from n = 65 on."""


@_alone
def bdf_errors_of_powers(q: float, sigma: FloatArray, knots: NDArray[np.int64]) -> FloatArray:
    """E_σ(n) of ``bdf2``, shape (n_exponents, n_knots); at σ = 0 the start has its weights, half of the last."""
    E, (w, start), d = np.zeros((len(sigma), len(knots))), bdf_weights(q, min(64, knots[-1])), bdf_series(q)
    smooth, singular = np.zeros(BDF_TERMS), np.zeros(BDF_TERMS)
    for m in range(len(sigma)):
        s, factorial = sigma[m], 1.0
        exact = math.gamma(s + 1) / math.gamma(s + q + 1)
        for i in range(BDF_TERMS):
            singular[i] = 0.0
        for i in range(BDF_TERMS):
            smooth[i] = math.gamma(s + 1) * d[i] * _inverse_gamma(s + q + 1 - i)
            c = (zeta(-s - i) + (0.5 if s == 0.0 else 0.0)) / factorial
            for j in range(BDF_TERMS - i):
                singular[i + j] += c * d[j] * _inverse_gamma(q - i - j)
            factorial *= -(i + 1)
        for k in range(1, len(knots)):
            n = knots[k]
            if n <= 64:
                E[m, k] = exact * float(n) ** (s + q) - (start[n] if s == 0.0 else 0.0)
                for lag in range(n):
                    E[m, k] -= w[lag] * float(n - lag) ** s
            else:
                one = other = 0.0
                for i in range(BDF_TERMS - 1, -1, -1):
                    one, other = one / n + (smooth[i] if i > 0 else 0.0), other / n + singular[i]
                E[m, k] = -one * float(n) ** (s + q) - other * float(n) ** (q - 1)
    return E


@helper
def _ends(q: float, knots: NDArray[np.int64]) -> FloatArray:
    """a_n/12 and −b_n/12 at the knots: what δ²f_0 weighs in ``pi3``, as f_2 − 2f_1 + f_0 and as f_1 − f_0."""
    ends, few = np.zeros((len(knots), 2)), trapezoidal_weights(q, min(8, knots[-1]))
    for j in range(len(knots)):
        n = knots[j]
        if n <= 8:
            ends[j, 0], ends[j, 1] = few[1][n] / 12, -few[0][n] / 12
        else:
            b = a = 0.0
            binomial, power = q * (q + 1) / 2, float(n) ** (q - 1)
            for k in range(2, 18):
                a += (-1) ** k * binomial * power
                b += 2 * binomial * power if k % 2 == 0 else 0.0
                binomial *= (q + 1 - k) / (k + 1)
                power /= n
            ends[j, 0], ends[j, 1] = a / math.gamma(q + 2) / 12, -b / math.gamma(q + 2) / 12
    return ends


@helper
def _parabola_weights(q: float, n: int) -> tuple[float, float, float]:
    """What f_0, f_1, f_2 weigh in J^q of the parabola through them, from 0 to n."""
    t = float(n)
    m0, m1, m2 = t**q / math.gamma(q + 1), t ** (q + 1) / math.gamma(q + 2), 2 * t ** (q + 2) / math.gamma(q + 3)
    return m0 - 1.5 * m1 + 0.5 * m2, 2 * m1 - m2, 0.5 * m2 - 0.5 * m1


@helper
def _expansion(q: float, s: float) -> Expansion:
    """Coefficients of E_σ(n) for large n in powers of 1/n: the start's, the rule's own (1/n²), the last panel's."""
    z0, z1, z2, z3 = zeta(-s), zeta(-s - 1), zeta(-s - 2), zeta(-s - 3)
    start = (-z0 * _inverse_gamma(q), z1 * _inverse_gamma(q - 1), -(z2 / 2 + z0 / 12) * _inverse_gamma(q - 2),
             (z3 / 6 + z1 / 12) * _inverse_gamma(q - 3))  # fmt: skip
    g = math.gamma(s + 1)
    rule = (-g * _inverse_gamma(s + q - 1) / 12, -g * _inverse_gamma(s + q - 3) / 360,
            -g * _inverse_gamma(s + q - 5) / 20160)  # fmt: skip
    z1, z2, z3, z4 = zeta(-q - 1), zeta(-q - 2), zeta(-q - 3), zeta(-q - 4)
    c = s * (s - 1) / math.gamma(q + 2)
    last = (-z1 * c, z2 * c * (s - 2), -(z3 / 2 + z1 / 12) * c * (s - 2) * (s - 3),
            (z4 / 6 + z2 / 12) * c * (s - 2) * (s - 3) * (s - 4))  # fmt: skip
    return start, rule, last


@helper
def _third_expansion(q: float, s: float) -> Expansion:
    """The same for ``pi3``, but for δ²f_0."""
    start = (-zeta(-s) * _inverse_gamma(q), zeta(-s - 1) * _inverse_gamma(q - 1),
             -zeta(-s - 2) / 2 * _inverse_gamma(q - 2), zeta(-s - 3) / 6 * _inverse_gamma(q - 3))  # fmt: skip
    g = math.gamma(s + 1)
    rule = 0.0, g * _inverse_gamma(s + q - 3) / 90, g * _inverse_gamma(s + q - 5) / 1008
    z1, z2, z3, b0 = zeta(-q - 1), zeta(-q - 2), zeta(-q - 3), 1.0
    c = -s * (s - 1) * (s - 2) / math.gamma(q + 2)
    last = 0.0, c * (-z2 + b0 / 12 + z1), c * (z3 / 2 - b0 / 24 - 7 * z1 / 12) * (s - 3), 0.0
    return start, rule, last


@helper
def _inverse_gamma(x: float) -> float:
    """1/Γ(x), which is 0 at 0, −1, −2, …"""
    factor = 1.0
    while x < 0.5:
        factor, x = factor * x, x + 1
    inverse: float = factor / math.gamma(x)
    return inverse


# --- the start -------------------------------------------------------------------------------------


_CALL = START(RHS, RUN, types.int64)


@intrinsic
def started(_, address, rhs, run, rule):
    """start_together(rhs, run, rule), which is compiled apart from the loops, from its address."""

    def emit(context, builder, signature, args):
        convention = context.call_conv
        kind = convention.get_function_type(_CALL.return_type, _CALL.args)
        there = builder.inttoptr(args[0], kind.as_pointer())
        status, start = convention.call_function(builder, there, _CALL.return_type, _CALL.args, args[1:])
        with cgutils.if_unlikely(builder, status.is_error):
            convention.return_status_propagate(builder, status)
        return start

    return START(types.int64, *_CALL.args), emit


@when_called(_CALL, wrapped=False)
def start_together(rhs, run, rule):
    """Solve the first steps together, and give what corrects the later ones; zeros where nothing is to be corrected.

    ``pi3`` has two steps to solve together and :math:`δ^2 f_0` to correct even without exponents, ``bdf2`` one step
    and constants, the first row of its errors.
    """
    past, orders, third, bdf = run.past, run.orders, rule == PI3, rule == BDF2
    m, states, steps = len(past) - 1, len(orders), len(past) - 1 + run.steps
    plain = Start(past, past[0].copy(), 0, np.array([0, 1, 2**62]), np.zeros((1, states, 3)))
    if not (run.corrected or third):
        return plain
    sigma, A = np.zeros(0), _jacobian(rhs, run)
    if run.corrected:
        powers = _powers_of_time(rhs, run)
        sigma = exponents(_orders_that_move(rhs, run, A, powers), powers, third)
    s = max(len(sigma), 2 if third else 1 if bdf else 0)
    if s == 0 or (steps < s and len(run.u) > 1):  # no inputs are known beyond the end
        return plain
    knots = knots_up_to(steps + 8)
    fit = _fit_of_powers(sigma, s)
    rows = len(sigma) + bdf
    E, M, ends = np.zeros((states, rows, len(knots))), np.zeros((states, s + 1, s + 1)), np.zeros((states, 0, 2))
    if third:
        ends = np.zeros((states, len(knots), 2))
    with_constant = np.zeros(len(sigma) + 1)
    for e in range(len(sigma)):
        with_constant[e + 1] = sigma[e]
    for i in range(states):
        first = 0
        while orders[first] != orders[i]:
            first += 1
        if first < i:
            _copy(E[first], E[i])
        elif bdf:
            _copy(bdf_errors_of_powers(orders[i], with_constant, knots), E[i])
        else:
            _copy(errors_of_powers(orders[i], sigma, knots, third), E[i])
        _copy(M[first] if first < i else _starting_weights(orders[i], E[i], fit, rule), M[i])
        if third:
            _copy(ends[first] if first < i else _ends(orders[i], knots), ends[i])
    x, f = np.zeros((max(m, s) + 1, states)), np.zeros((s + 1, states))
    for n in range(len(x)):
        for i in range(states):
            x[n, i] = past[min(n, m), i]
    base = past[0].copy()
    if not _solve_together(rhs, run, x, f, A, M, base):
        return plain
    C = np.zeros((states, len(knots)))
    for i in range(states):
        for e in range(len(sigma)):
            c = 0.0
            for k in range(1, s + 1):
                c += fit[e, k - 1] * (f[k, i] - f[0, i])
            for n in range(len(knots)):
                C[i, n] += c * E[i, bdf + e, n]
        if bdf:
            for n in range(len(knots)):
                C[i, n] += f[0, i] * E[i, 0, n]
        if third:
            bend, rise = f[2, i] - 2 * f[1, i] + f[0, i], f[1, i] - f[0, i]
            for n in range(len(knots)):
                C[i, n] -= bend * ends[i, n, 0] + rise * ends[i, n, 1]
    return Start(x, base, s, knots, _parabolas(knots, C))


@helper
def _copy(source, target):
    """Fill a matrix; an assignment of slices would take Numba two seconds more to compile."""
    for r in range(len(target)):
        for c in range(target.shape[1]):
            target[r, c] = source[r, c]


@helper
def _parabolas(knots, C):
    """Divided differences of C over knots 0, 1, 2, then 2, 3, 4, …: shape (n_pieces, n_states, 3)."""
    pieces = np.zeros((len(knots) // 2, len(C), 3))
    for i in range(len(C)):
        for r in range(len(knots) // 2):
            a, b, c = knots[2 * r], knots[2 * r + 1], knots[2 * r + 2]
            first, second = (C[i, 2 * r + 1] - C[i, 2 * r]) / (b - a), (C[i, 2 * r + 2] - C[i, 2 * r + 1]) / (c - b)
            pieces[r, i, 0], pieces[r, i, 1], pieces[r, i, 2] = C[i, 2 * r], first, (second - first) / (c - a)
    return pieces


@helper
def _first_time(run):
    """Time of the first known sample, the t = 0 of the formulas."""
    return run.start - (len(run.past) - 1) * run.h


@helper
def _powers_of_time(rhs, run):
    """Measure the powers of t with which f(t, x_0 + t·slope) begins, one a state; 0 where it does not depend on t."""
    x0, t0 = run.past[0], _first_time(run)
    states, e = len(x0), 1e-6 * run.h
    powers, x, now = np.zeros(states), x0.copy(), run.u[0].copy()
    f = np.zeros((3, states))
    for k in range(3):
        for i in range(states):
            x[i] = x0[i] + run.slope[i] * (k * e)
        rhs(t0 + k * e, x, now, run.p, f[k])
    for i in range(states):
        once, twice = abs(f[1, i] - f[0, i]), abs(f[2, i] - f[0, i])
        if once > 1e-11 * abs(f[0, i]) and twice > once:
            powers[i] = math.log2(twice / once)
    return powers


@helper
def _orders_that_move(rhs, run, A, powers):
    """Give the orders of the states that start to move, by their own f or through others; those at rest say nothing."""
    orders, x0, t0, u = run.orders, run.past[0], _first_time(run), run.u
    states, f, later = len(orders), np.zeros(len(orders)), np.zeros(len(orders))
    rhs(t0, x0.copy(), u[0].copy(), run.p, f)
    rhs(t0, x0.copy(), u[min(1, len(u) - 1)].copy(), run.p, later)
    moves = np.zeros(states, np.bool_)
    for i in range(states):
        moves[i] = f[i] != 0.0 or later[i] != 0.0 or powers[i] > 0.0
    for _ in range(states):
        for i in range(states):
            for c in range(states):
                moves[i] = moves[i] or (moves[c] and A[i, c] != 0.0)
    moving, count = np.zeros(states), 0
    for i in range(states):
        if moves[i]:
            moving[count] = orders[i]
            count += 1
    return moving[:count].copy()


@helper
def _fit_of_powers(sigma, s):
    """Give the matrix from f_1 − f_0 … f_s − f_0 to the c_m of f_k − f_0 = Σ c_m k^σ_m (the nearest c_1, if s = 2)."""
    if len(sigma) < s:
        fit = np.zeros((len(sigma), s))
        for m in range(len(sigma)):
            for k in range(s):
                fit[m, k] = (k + 1.0) ** sigma[m] / (1.0 + 4.0 ** sigma[m])
        return fit
    W = np.zeros((s, 2 * s))
    for k in range(s):
        W[k, s + k] = 1.0
        for m in range(s):
            W[k, m] = (k + 1.0) ** sigma[m]
    gauss_jordan(W)
    return W[:, s:].copy()


@helper
def _starting_weights(q, E, fit, rule):
    """M with x_n = x_0 + h^q Σ_{k ≤ s} M_{nk} f_k for n ≤ s, exact for the powers; shape (s + 1, s + 1)."""
    s, third, constants = fit.shape[1], rule == PI3, len(E) - len(fit)
    M = np.zeros((s + 1, s + 1))
    w, start = bdf_weights(q, s) if rule == BDF2 else third_weights(q, s) if third else trapezoidal_weights(q, s)
    ends = _ends(q, np.arange(s + 1)) if third else np.zeros((s + 1, 2))
    for n in range(1, s + 1):
        if third and n <= 2:
            M[n, 0], M[n, 1], M[n, 2] = _parabola_weights(q, n)
        else:
            M[n, 0] = start[n]
            for k in range(1, n + 1):
                M[n, k] = w[n - k]
            if third:
                M[n, 0] -= ends[n, 0] - ends[n, 1]
                M[n, 1] -= ends[n, 1] - 2 * ends[n, 0]
                M[n, 2] -= ends[n, 0]
        for e in range(constants):
            M[n, 0] += E[e, n]
        for k in range(1, s + 1):
            for e in range(len(fit)):
                M[n, k] += E[constants + e, n] * fit[e, k - 1]
                M[n, 0] -= E[constants + e, n] * fit[e, k - 1]
    return M


@helper
def _solve_together(rhs, run, x, f, A, M, base):
    """Solve for x_{m+1} … x_s and f_0 … f_s by Newton's method, with the matrix of the start; tell if it settles.

    It does not where a step leads further than the last: that would be another root.
    """
    slope, gain, u, h, t0, m = run.slope, run.gain, run.u, run.h, _first_time(run), len(run.past) - 1
    s, states = len(f) - 1, len(slope)
    now = u[0].copy()
    if not _spectral_radius(A) <= 1.0:
        return False
    size = s * states
    W, residual, move = np.zeros((size, 2 * size)), np.zeros(size), math.inf
    for n in range(1, s + 1):
        for i in range(states):
            row = (n - 1) * states + i
            W[row, row] = W[row, size + row] = 1.0
            for k in range(max(1, m + 1), s + 1 if n > m and size <= LARGE else 1):
                for c in range(states):
                    W[row, (k - 1) * states + c] -= (M[i, n, k] - M[i, m, k]) * A[i, c]
    if size <= LARGE:
        gauss_jordan(W)
    for _ in range(ITERATIONS):
        for n in range(s + 1):
            for c in range(len(now) if len(u) > 1 else 0):
                now[c] = u[n, c]
            rhs(t0 + n * h, x[n], now, run.p, f[n])
        moved_before, move = move, 0.0
        for n in range(m, s + 1):
            for i in range(states):
                total = slope[i] * (n * h)
                for k in range(s + 1):
                    total += gain[i] * M[i, n, k] * f[k, i]
                if n == m:
                    base[i] = x[m, i] - total  # x(0), but for what the model does not explain of the history
                else:
                    residual[(n - 1) * states + i] = base[i] + total - x[n, i]
        for n in range(m + 1, s + 1):
            for i in range(states):
                change = 0.0
                for c in range(size):
                    change += W[(n - 1) * states + i, size + c] * residual[c]
                x[n, i] += change
                move = max(move, abs(change) / (1e-3 + abs(x[n, i])))
                if not abs(x[n, i]) <= run.limit:
                    return False
        if move < 1e-14:
            return True
        if move > max(moved_before, 1e-11):
            return False
    return move < 1e-11


@helper
def _jacobian(rhs, run):
    """h^q ∂f/∂x at the start, by central differences."""
    x0, t0 = run.past[0], _first_time(run)
    states, x, now = len(x0), x0.copy(), run.u[0].copy()
    A, f = np.zeros((states, states)), np.zeros((2, states))
    for c in range(states):
        d = 1e-6 * (0.01 + abs(x0[c]))
        for side in range(2):
            x[c] = x0[c] + (d if side else -d)
            rhs(t0, x, now, run.p, f[side])
        x[c] = x0[c]
        for i in range(states):
            A[i, c] = run.gain[i] * (f[1, i] - f[0, i]) / (2 * d)
    return A


@helper
def _spectral_radius(A):
    """Estimate it by the root of the norm of A^16, which no scaling of the states changes much."""
    radius, power = 0.0, A.copy()
    for _ in range(4):
        n, squared = len(A), np.zeros(A.shape)
        for i in range(n):
            for k in range(n):
                for c in range(n):
                    squared[i, c] += power[i, k] * power[k, c]
        power = squared
    for i in range(len(A)):
        radius = max(radius, np.abs(power[i]).sum())
    return radius ** (1 / 16)


@helper
def gauss_jordan(W):
    """Turn [A | B] into [1 | A⁻¹B], with row pivots."""
    n, columns = W.shape
    for k in range(n):
        pivot = k + np.argmax(np.abs(W[k:, k]))
        for c in range(columns):
            W[k, c], W[pivot, c] = W[pivot, c], W[k, c]
        factor = 1 / W[k, k]
        for c in range(columns):
            W[k, c] *= factor
        for i in range(n):
            if i != k:
                factor = W[i, k]
                for c in range(columns):
                    W[i, c] -= factor * W[k, c]
