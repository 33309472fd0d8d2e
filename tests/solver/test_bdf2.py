"""The fractional BDF2: its weights, its order at the start, and that what is fast dies, at every order and step."""

import math
from itertools import product

import mpmath
import numpy as np
import pytest

from fracid.solver.memory import compressed, full
from fracid.solver.solve import solve_fde
from fracid.solver.starting import bdf_errors_of_powers
from fracid.solver.weights import bdf_weights
from oracles.mittag_leffler import mittag_leffler

ORDERS = (0.001, 0.05, 0.3, 0.6, 0.9, 0.999, 1.0, 1.001, 1.05, 1.3, 1.6, 1.95, 1.999)


def decay(t, x, u, p, out):
    out[0] = -p[0] * x[0]


def cubic(t, x, u, p, out):
    out[0] = -p[0] * x[0] ** 3


def oscillator(t, x, u, p, out):
    out[0], out[1] = x[1], -9 * x[0]


def exact_weights(q, steps):
    """Coefficients of (3/2 − 2ζ + ζ²/2)^(−q) with 60 digits, by the product of their factors' binomial series."""
    with mpmath.workdps(60):
        near = [mpmath.binomial(mpmath.mpf(q) + k - 1, k) for k in range(steps + 1)]
        far = [near[k] / mpmath.mpf(3) ** k for k in range(steps + 1)]
        scale = (mpmath.mpf(2) / 3) ** mpmath.mpf(q)
        return [float(scale * mpmath.fdot(near[: k + 1], far[k::-1])) for k in range(steps + 1)]


@pytest.mark.few(5)
@pytest.mark.parametrize("q", ORDERS)
def test_weights_are_those_of_an_independent_60_digit_computation(q):
    w, start = bdf_weights(q, 150)
    exact = np.array(exact_weights(q, 150))
    np.testing.assert_allclose(w, exact, rtol=2e-14)
    np.testing.assert_allclose(start[1:], exact[:-1] / 2, rtol=2e-14)


@pytest.mark.few(2)
@pytest.mark.parametrize("q", [q for q in ORDERS if q != 1.0])
def test_every_compressed_weight_is_within_the_tolerance(q):
    exact = bdf_weights(q, 1_000_000)[0]
    for steps, tolerance in product((100, 20_000, 1_000_000), (1e-3, 1e-8, 1e-10)):
        kernel, lags = compressed(tolerance).kernel("bdf", q, steps), np.unique(np.geomspace(1, steps, 400).astype(int))
        assert np.all(np.abs(kernel.at(lags) / exact[lags] - 1) <= tolerance), (steps, tolerance)
        later = np.unique(np.geomspace(kernel.lags + 1, steps, 100).astype(int))
        away = later - kernel.lags - 1
        start = np.exp(np.outer(away, np.log1p(kernel.decay))) @ (kernel.amplitude * kernel.start_ratio)
        start += kernel.ramp * (away / 2 - kernel.start_shift)
        assert np.all(np.abs(start / exact[later - 1] * 2 - 1) <= 3 * tolerance), (steps, tolerance)  # one lag earlier


@pytest.mark.parametrize("q", [0.2, 0.9, 1.0, 1.5])
@pytest.mark.parametrize("sigma", [0.0, 0.4, 0.9, 1.0])
def test_the_error_of_a_power_is_expanded_as_it_is_summed(q, sigma):
    n = np.array([1, 40, 64, 65, 100, 1000])
    w, start = bdf_weights(q, 1000)
    powers = np.arange(1001.0) ** sigma
    for steps, error in zip(n, bdf_errors_of_powers(q, np.array([sigma]), np.append(0, n))[0, 1:], strict=True):
        rule = math.fsum(w[steps - np.arange(1, steps + 1)] * powers[1 : steps + 1]) + (sigma == 0) * start[steps]
        exact = math.gamma(sigma + 1) / math.gamma(sigma + q + 1) * float(steps) ** (sigma + q)
        assert error == pytest.approx(exact - rule, abs=1e-13 * exact + 1e-13)


@pytest.mark.few(2)
@pytest.mark.parametrize("q", [0.3, 0.5, 0.8, 0.95, 1.0, 1.05, 1.3, 1.5, 1.8, 1.95])
def test_it_converges_at_order_two_to_the_mittag_leffler_function_at_every_time(q):
    off = []
    for step in (0.02, 0.01, 0.005):
        run = solve_fde(decay, q, [1.0], step=step, end=5.0, parameters=[1.0], method="bdf2")
        off.append(np.abs(run.states[:, 0] - mittag_leffler(q, -(run.time**q)))[run.time >= 0.5].max())
    assert np.log2(off[1] / off[2]) > 1.75
    assert off[2] < 1e-4


def test_at_order_one_it_is_bdf2():
    h, x = 0.05, np.empty((81, 2))
    A, identity = np.array([[0.0, 1.0], [-9.0, 0.0]]), np.eye(2)
    x[0] = 1.0, 0.0
    x[1] = np.linalg.solve(1.5 * identity - h * A, 1.5 * x[0] + h / 2 * A @ x[0])  # of order 2, f_0 being given
    for n in range(2, 81):
        x[n] = np.linalg.solve(1.5 * identity - h * A, 2 * x[n - 1] - 0.5 * x[n - 2])
    run = solve_fde(oscillator, 1.0, x[0], step=h, end=4.0, method="bdf2")
    np.testing.assert_allclose(run.states, x, atol=1e-13)


def test_a_stiff_start_at_order_one_is_a_step_of_backward_euler():
    run = solve_fde(decay, 1.0, [1.0], step=0.1, end=1.0, parameters=[1e4], method="bdf2")
    assert run.states[1, 0] == pytest.approx(1 / (1 + 1e3), rel=1e-12)


@pytest.mark.few(30)
@pytest.mark.parametrize("stiffness", [1.0, 1e2, 1e4, 1e6, 1e8])
@pytest.mark.parametrize("step", [0.1, 0.01])
@pytest.mark.parametrize("q", [0.3, 0.6, 0.9, 1.0, 1.05, 1.3, 1.6, 1.95])
def test_a_relaxation_stays_bounded_and_decays_as_the_exact_solution_does(q, step, stiffness):
    run = solve_fde(decay, q, [1.0], step=step, end=20.0, parameters=[stiffness], method="bdf2")
    assert run.completed
    assert run.fault is None or run.fault.code == "coarse-steps"
    assert np.abs(run.states).max() <= 1.0
    last = run.time >= 18.0
    exact = mittag_leffler(q, -stiffness * run.time[last] ** q)
    assert np.abs(run.states[last, 0]).max() <= 1.05 * np.abs(exact).max() + 1e-15
    if q < 1 or 1 < q < 1.9:  # its tail is a power of t, to which nothing that swings is left to add
        np.testing.assert_allclose(run.states[last, 0], exact, rtol=0.01 if stiffness > 1 else 0.1, atol=1e-5)


@pytest.mark.parametrize("q", [0.5, 1.05, 1.5, 1.9])
@pytest.mark.parametrize("stiffness", [1e4, 1e8])
def test_on_a_slow_curve_the_error_does_not_grow_with_the_stiffness(q, stiffness):
    def pulled(t, x, u, p, out):
        out[0] = -p[0] * (x[0] - 1 - t * t) + 2 / p[1] * t ** (2 - p[2])

    for step in (0.1, 0.01):
        run = solve_fde(pulled, q, [1.0], step=step, end=2.0, parameters=[stiffness, math.gamma(3 - q), q],
                        method="bdf2")  # fmt: skip
        assert np.abs(run.states[:, 0] - 1 - run.time**2).max() < 1 / stiffness


@pytest.mark.parametrize("q", [0.7, 1.0, 1.4])
def test_a_steep_curve_is_solved_from_far_off(q):
    run = solve_fde(cubic, q, [10.0], step=0.1, end=5.0, parameters=[1e6], method="bdf2")
    assert run.completed
    assert np.abs(run.states[1:]).max() < 1.0


@pytest.mark.parametrize(("q", "stiffness"), [(0.3, 1e6), (1.0, 1e6), (1.05, 3e4), (1.95, 1.0), (1.95, 1e6)])
def test_compressed_memory_gives_the_run_of_full_memory(q, stiffness):
    whole, short = (
        solve_fde(decay, q, [1.0], step=1e-2, end=20.0, parameters=[stiffness], method="bdf2", memory=m).states
        for m in (full(), compressed(1e-10))
    )
    np.testing.assert_allclose(short, whole, atol=2e-9)


def test_a_stiff_run_goes_on_from_its_own_past():
    whole = solve_fde(decay, 1.05, [1.0], step=1e-2, end=2.0, parameters=[3e4], method="bdf2")
    for cut in (1, 7, 100):
        past = whole.states[:cut]
        on = solve_fde(decay, 1.05, whole.states[cut], history=past, start=whole.time[cut], end=2.0, step=1e-2,
                       parameters=[3e4], method="bdf2")  # fmt: skip
        np.testing.assert_allclose(on.states, whole.states[cut:], atol=1e-12)
