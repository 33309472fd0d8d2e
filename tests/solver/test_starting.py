"""The start's corrections: what the rule makes of powers of t, and which powers a system begins with."""

import mpmath
import numpy as np
import pytest

from fracid.solver.memory import full
from fracid.solver.solve import solve_fde
from fracid.solver.starting import errors_of_powers, exponents, knots_up_to
from oracles.mittag_leffler import mittag_leffler

NONE = np.array([])


def error_by_definition(q, sigma, n):
    """J^q t^σ at n less what the product trapezoidal rule with unit steps makes of it, to 30 digits."""
    with mpmath.workdps(30):
        q, sigma = mpmath.mpf(q), mpmath.mpf(sigma)

        def b(k):
            hat = (k + 1) ** (q + 1) - 2 * mpmath.mpf(k) ** (q + 1) + mpmath.mpf(k - 1) ** (q + 1) if k else 1
            return hat / mpmath.gamma(q + 2)

        exact = mpmath.gamma(sigma + 1) / mpmath.gamma(sigma + q + 1) * mpmath.mpf(n) ** (sigma + q)
        return float(exact - mpmath.fsum(b(n - k) * mpmath.mpf(k) ** sigma for k in range(1, n + 1)))


@pytest.mark.few(5)
@pytest.mark.parametrize("q", [0.05, 0.3, 0.8623, 0.99, 1.0, 1.01, 1.5, 1.95])
@pytest.mark.parametrize("sigma", [0.05, 0.3, 0.5, 0.8623, 0.97])
def test_the_errors_of_powers_are_those_of_the_definition(q, sigma):
    knots, some = knots_up_to(400), [0, 1, 2, 7, 31, 32, 33, 50, 80, -1]
    found, knots = errors_of_powers(q, np.array([sigma]), knots)[0, 0, some], knots[some]
    want = np.array([0.0] + [error_by_definition(q, sigma, int(n)) for n in knots[1:]])
    np.testing.assert_allclose(found, want, rtol=2e-7, atol=1e-13)


@pytest.mark.few(5)
@pytest.mark.parametrize("q", [0.05, 0.3, 0.8623, 0.99, 1.0, 1.3, 1.9])
@pytest.mark.parametrize("sigma", [0.1, 0.5, 0.8623, 1.5, 1.8])
def test_the_errors_of_powers_are_those_of_the_sum_for_the_third_order_too(q, sigma):
    knots = knots_up_to(400)
    end = int(knots[-1])
    n = np.arange(end + 1)
    kernel, trapezoidal = (full().kernel(family, q, end) for family in ("pi3", "pi"))
    if q == 1.0:  # kept as a sum with three weights of its own
        weights = kernel.at(n)
        b, a = np.r_[0.5, np.ones(end)], np.r_[0.0, np.full(end, 0.5)]
    else:
        weights, b, a = kernel.weights, trapezoidal.weights, trapezoidal.start
    summed = np.convolve(weights, n**sigma)[: end + 1] - (a * (2**sigma - 2) - b) / 12
    exact = np.array([float(mpmath.gamma(sigma + 1) / mpmath.gamma(sigma + q + 1) * mpmath.mpf(int(k)) ** (sigma + q))
                      for k in n])  # fmt: skip
    found = errors_of_powers(q, np.array([sigma]), knots, True)[0, 0]
    np.testing.assert_allclose(found[3:], (exact - summed)[knots[3:]], rtol=3e-4, atol=5e-9 * (1 + 400 ** (q - 1)))


@pytest.mark.parametrize("q", [0.3, 0.8, 1.0, 1.4])
def test_the_third_order_start_integrates_parabolas_exactly(q):
    def parabola(t, x, u, p, out):
        out[0] = 1 + 2 * t - 3 * t * t

    run = solve_fde(parabola, q, [0.0] if q <= 1 else [(0.0, 0.0)], step=0.05, end=3.0, method="pi3", corrected=False)
    exact = sum(
        c * float(mpmath.gamma(k + 1) / mpmath.gamma(k + 1 + q)) * run.time ** (k + q) for k, c in enumerate((1, 2, -3))
    )
    np.testing.assert_allclose(run.states[1:3, 0], exact[1:3], rtol=1e-12)
    np.testing.assert_allclose(run.states[:, 0], exact, atol=2e-6)


def test_a_straight_line_has_no_error():
    assert np.all(errors_of_powers(0.7, np.array([1.0]), knots_up_to(1000)) == 0)


@pytest.mark.parametrize("steps", [1, 64, 65, 1000, 123_456])
def test_knots_ascend_are_odd_in_number_and_reach_the_end(steps):
    knots = knots_up_to(steps)
    assert np.all(np.diff(knots) > 0)
    assert len(knots) % 2 == 1
    assert knots[0] == 0
    assert knots[-1] >= steps
    assert len(knots) < 65 + 40 * np.log(max(2, steps))


@pytest.mark.parametrize(
    ("orders", "powers", "want"),
    [
        ([1.0, 1.0], [0.0, 0.0], []),
        ([1.5], [0.0], []),
        ([0.8], [0.0], [0.8]),
        ([0.5], [0.0], [0.5, 1.0]),
        ([0.4], [0.0], [0.4, 0.8]),
        ([0.4], [0.6], [0.4, 0.6, 0.8]),
        ([1.5], [0.5], [0.5, 1.0]),
        ([0.8623, 0.8623, 0.9146, 0.9146], [0.0], [0.8623]),  # too near to tell apart
        ([0.3, 0.5], [0.0], [0.3, 0.5, 0.6, 0.8, 0.9]),
        ([0.1], [0.0], [0.1, 0.2, 0.3, 0.4, 0.5, 1.0]),  # no more than five, and the line
        ([0.9], [1.0], [0.9]),  # f = t is no power of its own
        ([0.06], [0.0], [0.06, 0.18, 0.3, 0.42, 0.54, 1.0]),  # the first may be as near to 0 as it likes
    ],
)
def test_a_system_begins_with_the_sums_of_its_orders_and_the_power_of_time(orders, powers, want):
    np.testing.assert_allclose(exponents(tuple(orders), tuple(powers)), want, atol=1e-12)


@pytest.mark.few(3)
@pytest.mark.parametrize("q", [0.1, 0.2, 0.4, 0.6, 0.8, 0.95])
def test_the_corrected_relaxation_is_far_better_at_every_time(q):
    def decay(t, x, u, p, out):
        out[0] = -x[0]

    plain, corrected = (solve_fde(decay, q, [1.0], step=1 / 64, end=4.0, corrected=c) for c in (False, True))
    late = plain.time >= 0.25
    exact = np.array([float(mittag_leffler(q, -(t**q))) for t in plain.time[late]])
    off = [np.abs(run.states[late, 0] - exact) for run in (plain, corrected)]
    gain = {0.1: 1e3, 0.2: 1e3, 0.4: 30, 0.6: 5, 0.8: 3, 0.95: 1.0}[q]
    assert off[1].max() < off[0].max() / gain


@pytest.mark.parametrize("sigma", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("q", [0.3, 0.9, 1.4])
def test_a_power_of_time_in_the_right_hand_side_is_found_and_integrated_exactly(q, sigma):
    def power(t, x, u, p, out):
        out[0] = t ** p[0]

    initial = [0.0] if q <= 1 else [(0.0, 0.0)]
    plain, corrected = (
        solve_fde(power, q, initial, step=0.01, end=2.0, parameters=[sigma], corrected=c) for c in (False, True)
    )
    exact = float(mpmath.gamma(sigma + 1) / mpmath.gamma(sigma + q + 1)) * plain.time ** (sigma + q)
    off = [np.abs(run.states[:, 0] - exact).max() for run in (plain, corrected)]
    assert off[1] < 1e-3 * off[0] + 1e-9


def test_a_start_stiffer_than_the_step_is_left_as_it_is():
    def stiff(t, x, u, p, out):
        out[0] = -1e5 * x[0]

    plain, corrected = (
        solve_fde(stiff, 0.6, [1.0], step=1e-2, end=1.0, method="pi2-implicit", corrected=c).states
        for c in (False, True)
    )
    np.testing.assert_array_equal(plain, corrected)


def test_what_is_of_integer_order_is_not_touched():
    def oscillator(t, x, u, p, out):
        out[0], out[1] = x[1], -9 * x[0]

    plain, corrected = (
        solve_fde(oscillator, 1.0, [1.0, 0.0], step=1e-2, end=1.0, corrected=c).states for c in (False, True)
    )
    np.testing.assert_array_equal(plain, corrected)


def test_corrections_vanish_as_the_order_goes_to_one():
    def oscillator(t, x, u, p, out):
        out[0], out[1] = x[1], -9 * x[0]

    near, at = (solve_fde(oscillator, q, [1.0, 0.0], step=1e-2, end=3.0).states for q in (1 - 1e-9, 1.0))
    np.testing.assert_allclose(near, at, atol=1e-7)


@pytest.mark.parametrize("method", ["pi2", "pi3"])
def test_the_order_of_a_state_that_stands_still_does_not_show_in_the_others(method):
    def clamped(t, x, u, p, out):
        out[0], out[1] = x[1], 0.0 * x[2]  # an arm held fast
        out[2], out[3] = x[3], -40 * np.sin(x[2]) - 0.3 * x[3] + x[0]

    one, other = (
        solve_fde(clamped, (q, q, 0.9, 0.9), [0.0, 0.0, 0.5, 0.0], step=1e-2, end=2.0, method=method).states
        for q in (0.5, 0.8)
    )
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("third", [False, True])
def test_an_order_of_next_to_nothing_adds_no_exponent_and_writes_nowhere_else(third):
    with_it, without = (exponents(tuple(q), (0.3,), third) for q in ([1e-20, 0.45, 5e-10], [0.45]))
    assert with_it == without
