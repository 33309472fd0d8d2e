"""The references themselves: derivatives of the Mittag-Leffler function and of the recursions."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from scipy.special import digamma, gamma

from fracid.solver.memory import full
from fracid.solver.solve import solve_fde
from oracles.derivatives import TINY, complex_step, gl, mittag_leffler_slopes, pi2, trapezoidal_weights
from oracles.mittag_leffler import mittag_leffler
from oracles.problems import T1, T8, T20

RECURSIONS = {
    "gl": gl,
    "gl-sequential": lambda *run: gl(*run, sequential=True),
    "pi2": pi2,
}
STEP, STEPS = 0.02, 100
END = STEP * STEPS


# --- the Mittag-Leffler function -------------------------------------------------------------------


@pytest.mark.parametrize(("t", "slope"), [(1, -0.119122125443), (5, -0.44344231345), (20, -0.182281517889)])
def test_the_derivative_of_t1_by_its_order_is_the_known_one(t, slope):
    y, by_order, _ = mittag_leffler_slopes(0.8, 1, t)
    assert float(y) == pytest.approx(T1.solution[t][0], abs=1e-13)
    assert float(by_order) == pytest.approx(slope, abs=1e-12)


@pytest.mark.parametrize(("order", "rate", "t"), [(0.5, 2, 1.5), (0.8, 1, 5), (0.95, 4, 3), (1, 0.5, 2), (1.6, 3, 4)])
def test_slopes_are_the_limits_of_differences(order, rate, t):
    def y(q, r):
        return mittag_leffler_slopes(q, r, t)[0]

    value, by_order, by_rate = mittag_leffler_slopes(order, rate, t)
    d = mpmath.mpf(10) ** -6
    assert float(value) == pytest.approx(mittag_leffler(order, -rate * float(t) ** order), abs=1e-12)
    q, r = mpmath.mpf(order), mpmath.mpf(rate)
    assert float(by_order) == pytest.approx(float((y(q + d, r) - y(q - d, r)) / (2 * d)), abs=1e-9)
    assert float(by_rate) == pytest.approx(float((y(q, r + d) - y(q, r - d)) / (2 * d)), abs=1e-9)


def test_slopes_of_order_one_are_those_of_the_exponential():
    y, _, by_rate = mittag_leffler_slopes(1, 0.7, 3)
    assert (float(y), float(by_rate)) == pytest.approx((np.exp(-2.1), -3 * np.exp(-2.1)), rel=1e-14)


# --- the recursions ----------------------------------------------------------------------------------


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("method", "problem"),
    [("gl", T1), ("gl", T8), ("gl", T20), ("gl-sequential", T8), ("gl-sequential", T20), ("pi2", T8),
     ("pi2", replace(T20, orders=(1.0, 1.0)))],
    ids=lambda v: getattr(v, "name", v),
)  # fmt: skip
def test_the_recursions_are_those_of_the_solver(method, problem):
    # pi2 where f begins like a straight line: elsewhere a solver may correct its start
    ours = solve_fde(problem.rhs, problem.orders, problem.initial, step=STEP, end=END, parameters=problem.parameters,
                     method=method, memory="full", corrections=25)  # fmt: skip
    theirs = RECURSIONS[method](problem.rhs, problem.orders, problem.initial, problem.parameters, STEP, STEPS)
    np.testing.assert_allclose(theirs.real, ours.states, rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(theirs.imag, 0)


@pytest.mark.parametrize("order", [0.3, 0.95, 1.4])
def test_the_trapezoidal_weights_are_those_of_the_memory(order):
    kernel = full().kernel("pi", order, 400)
    b, a = trapezoidal_weights(order, 400)
    np.testing.assert_allclose(b, kernel.weights, rtol=1e-12)
    np.testing.assert_allclose(a[1:], kernel.start[1:], rtol=1e-12)


def test_each_step_of_pi2_is_solved_to_rounding():
    x = pi2(T20.rhs, T20.orders, T20.initial, (), STEP, STEPS).real
    f = np.column_stack([x[:, 1], -9.81 * np.sin(x[:, 0]) - 0.2 * x[:, 1]])
    b, a = (w.real for w in trapezoidal_weights(0.95, STEPS))
    sums = [b[:n] @ f[n:0:-1] + a[n] * f[0] for n in range(1, STEPS + 1)]
    np.testing.assert_allclose(x[1:], x[0] + STEP**0.95 * np.array(sums), atol=1e-14)


def t20(method):
    """(order of x₁, order of x₂, stiffness, damping, x₁(0), x₂(0)) → the run."""
    return lambda v: RECURSIONS[method](_pendulum, v[:2], v[4:], v[2:4], STEP, STEPS)


def _pendulum(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -p[0] * np.sin(x[0]) - p[1] * x[1]


@pytest.mark.few(3)
@pytest.mark.parametrize("method", RECURSIONS)
@pytest.mark.parametrize("k", range(6), ids=["order 1", "order 2", "stiffness", "damping", "angle", "rate"])
def test_a_complex_step_is_the_limit_of_differences_of_the_recursion(method, k):
    run, values = t20(method), np.array([0.95, 0.9, 9.81, 0.2, 0.17, 0.1])
    d = 1e-5 * np.eye(6)[k]
    difference = (run(values + d) - run(values - d)).real / 2e-5
    slope = complex_step(run, values, k)
    assert np.abs(slope[1:]).max() > 1e-3
    np.testing.assert_allclose(slope, difference, atol=1e-8 * max(1.0, np.abs(slope).max()))


def test_complex_weights_carry_the_derivative_by_the_order():
    # Γ(q+2) b_1 = 2^(q+1) − 2 and Γ(q+2) a_1 = q
    q, g, psi = 0.7, gamma(2.7), digamma(2.7)
    b, a = (w[1].imag / TINY for w in trapezoidal_weights(q + 1j * TINY, 5))
    assert b == pytest.approx((2 ** (q + 1) * np.log(2) - (2 ** (q + 1) - 2) * psi) / g, rel=1e-14)
    assert a == pytest.approx((1 - q * psi) / g, rel=1e-14)


@pytest.mark.parametrize(("method", "convergence_order"), [("gl", 1.0), ("gl-sequential", 1.0), ("pi2", 1.8)])
def test_the_recursion_s_derivative_by_the_order_converges_to_the_function_s(method, convergence_order):
    def slope(steps):
        def last(order):
            return RECURSIONS[method](T1.rhs, order, [1.0], (), 1 / steps, steps)[-1, 0]

        return complex_step(last, [0.8], 0)

    exact = float(mittag_leffler_slopes(0.8, 1, 1)[1])
    coarse, fine = (abs(slope(steps) - exact) for steps in (64, 128))
    assert np.log2(coarse / fine) == pytest.approx(convergence_order, abs=0.25)
