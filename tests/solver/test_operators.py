import math
import subprocess
import sys
import time
from itertools import product

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import rgamma

from fracid.errors import InputError
from fracid.solver.operators import derivative, gl_weights
from oracles.mittag_leffler import mittag_leffler

KINDS = ["caputo", "gl", "rl"]
SPLINE_KINDS = ["caputo", "rl"]
ORDERS = [-1.5, -1.0, -0.5, -0.001, 0.0, 0.001, 0.3, 0.5, 0.9146, 0.999, 1.0, 1.001, 1.2, 1.5, 1.9, 2.0, 2.5]
EPS = np.finfo(float).eps


def power_rule(kind, order, power, t):
    """D^q t^r = Γ(r+1)/Γ(r+1-q) t^(r-q) at t > 0; Caputo kills polynomials of degree below q."""
    if kind == "caputo" and power == int(power) and power < order:
        return np.zeros_like(t)
    return math.gamma(power + 1) * rgamma(power + 1 - order) * t ** (power - order)


def exponential_rule(kind, order, t):
    """D^q e^-t."""
    m = max(math.ceil(order), 0)
    if kind == "caputo" or order == m:
        return (-1.0) ** m * t ** (m - order) * mittag_leffler(1.0, -t, m + 1 - order)
    return t**-order * mittag_leffler(1.0, -t, 1 - order)


# The weights (18)-(19).


@pytest.mark.parametrize("order", [-3, -2, -1, 0, 1, 2, 3, 7, 20])
def test_weights_of_an_integer_order_are_the_exact_binomials(order):
    expected = [float((-1) ** k * mpmath.binomial(order, k)) for k in range(40)]
    np.testing.assert_array_equal(gl_weights(order, 40), expected)
    assert not np.signbit(gl_weights(order, 40)[gl_weights(order, 40) == 0]).any()


@pytest.mark.parametrize("order", [-2, -1, 0, 1, 2])
def test_weights_of_an_integer_order_stay_exact_for_a_million_lags(order):
    k = np.arange(10**6)
    expected = {-2: k + 1.0, -1: np.ones_like(k)}.get(order)
    if expected is None:
        expected = np.zeros(10**6)
        expected[: order + 1] = [(-1) ** j * math.comb(order, j) for j in range(order + 1)]
    np.testing.assert_array_equal(gl_weights(order, 10**6), expected)


@pytest.mark.parametrize(
    "order", [-2.3, -1.7, -0.5, -0.001, 1e-9, 0.001, 0.5, 0.8623, 0.999, 1 - 1e-9, 1.5, 1.999, 2.3]
)
def test_weights_are_those_of_mpmath_up_to_lag_a_million(order):
    weights = gl_weights(order, 10**6 + 1)
    for k in [0, 1, 2, 3, 4, 5, 9, 30, 1000, 31_623, 10**6]:
        with mpmath.workdps(40):
            exact = (-1) ** k * mpmath.binomial(mpmath.mpf(order), k)
        assert abs(float(weights[k] / exact) - 1) < 1e-12, k


def test_weights_follow_the_printed_recursion():
    order, weights = 0.8623, gl_weights(0.8623, 200)
    for k in range(199):
        assert weights[k + 1] == pytest.approx((1 - (order + 1) / (k + 1)) * weights[k], rel=1e-14)


@given(a=st.floats(-1.9, 1.9), b=st.floats(-1.9, 1.9))
def test_weights_of_two_orders_convolve_to_those_of_their_sum(a, b):
    product = np.convolve(gl_weights(a, 60), gl_weights(b, 60))[:60]
    np.testing.assert_allclose(product, gl_weights(a + b, 60), atol=1e-12 * np.abs(product).max())


@pytest.mark.parametrize(
    ("order", "count", "message"),
    [
        (math.nan, 3, "order is nan, expected a finite number"),
        (math.inf, 3, "order is inf, expected a finite number"),
        ("0.9", 3, "order is '0.9', expected a finite number"),
        (10**400, 3, "order is 1000.*, expected a finite number"),
        (0.9, 0, "count = 0; expected a whole number, 1 or more"),
        (0.9, 2.5, "count = 2.5; expected"),
        (-1e6, 100_000, "order -1000000.0 makes 100000 weights overflow"),
    ],
)
def test_weights_say_what_is_wrong_with_their_arguments(order, count, message):
    with pytest.raises(InputError, match=message):
        gl_weights(order, count)


def test_one_weight_is_one():
    np.testing.assert_array_equal(gl_weights(0.7, 1), [1.0])


# Exactness.


@pytest.mark.few(40)
@pytest.mark.parametrize("kind", SPLINE_KINDS)
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("samples", [5, 6, 7, 100, 1001])
def test_caputo_and_rl_are_exact_on_powers_up_to_the_cube(kind, order, samples):
    step = 0.01
    t = step * np.arange(samples)
    for power in range(4):
        expected = power_rule(kind, order, power, t[1:])
        rounding = 300 * EPS * np.max(t**power) * step**-order
        error = np.abs(derivative(t**power, order, step, kind=kind)[1:] - expected).max()
        assert error <= max(1e-12 * np.abs(expected).max(), rounding), power


@pytest.mark.parametrize("kind", SPLINE_KINDS)
@pytest.mark.parametrize("order", [order for order in ORDERS if order <= 1.9])
def test_caputo_and_rl_of_a_parabola_are_within_a_billionth_of_their_largest_value(kind, order):
    t = np.linspace(0, 3, 1001)
    signal = 2.5 - 1.5 * t + 4 * t**2
    expected = sum(c * power_rule(kind, order, r, t[1:]) for r, c in enumerate([2.5, -1.5, 4.0]))
    error = np.abs(derivative(signal, order, 0.003, kind=kind)[1:] - expected).max()
    assert error < 1e-9 * np.abs(expected).max()


@pytest.mark.few(40)
@pytest.mark.parametrize("kind", SPLINE_KINDS)
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("samples", [1, 2, 3, 4])
def test_a_short_record_is_its_interpolating_polynomial(kind, order, samples):
    t = 0.5 * np.arange(samples)
    for power in range(samples):
        expected = power_rule(kind, order, power, t[1:])
        np.testing.assert_allclose(derivative(t**power, order, 0.5, kind=kind)[1:], expected, atol=1e-11)


@pytest.mark.parametrize("order", [0.001, 0.5, 0.9146, 1.0, 1.3, 2.0, 2.5])
def test_a_constant_signal_has_zero_caputo_derivative(order):
    np.testing.assert_array_equal(derivative(np.full(1000, 0.1), order, 1e-3), np.zeros(1000))


@pytest.mark.parametrize("kind", KINDS)
def test_order_zero_returns_the_signal(kind):
    signal = np.random.default_rng(1).normal(size=(50, 2))
    np.testing.assert_array_equal(derivative(signal, 0, 0.1, kind=kind), signal)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("order", [-1.2, -1, 0, 0.5, 1, 1.4, 2])
def test_the_result_is_the_callers_to_change(kind, order):
    signal = np.ones(10)
    derivative(signal, order, 0.1, kind=kind)[:] = 7.0
    np.testing.assert_array_equal(signal, np.ones(10))


def test_gl_of_order_one_and_two_are_the_plain_backward_differences():
    signal = np.array([3.0, 5.0, 9.0, 2.0])
    np.testing.assert_array_equal(derivative(signal, 1, 0.5, kind="gl"), [6.0, 4.0, 8.0, -14.0])
    np.testing.assert_array_equal(derivative(signal, 2, 1.0, kind="gl"), [3.0, -1.0, 2.0, -11.0])
    np.testing.assert_allclose(derivative(signal, -1, 0.5, kind="gl"), [1.5, 4.0, 8.5, 9.5], rtol=1e-15)


@pytest.mark.parametrize("order", [-1.5, -0.4, 0.4, 0.9146, 1.7])
def test_gl_by_fft_is_the_sum_of_17_written_out(order):
    signal = np.random.default_rng(2).normal(size=300)
    weights, step = gl_weights(order, 300), 0.02
    expected = [step**-order * sum(weights[k] * signal[n - k] for k in range(n + 1)) for n in range(300)]
    np.testing.assert_allclose(derivative(signal, order, step, kind="gl"), expected, atol=1e-13 * np.ptp(expected))


def test_order_minus_one_of_three_samples_is_simpsons_rule():
    assert derivative([1.0, 4.0, 2.0], -1, 0.5)[-1] == pytest.approx(0.5 / 3 * (1 + 16 + 2))


# What happens at the start.


@pytest.mark.parametrize(
    ("signal", "order", "expected"),
    [
        ("constant", 0.5, math.inf),
        ("constant", 1.5, -math.inf),  # 1/Γ(1-q) < 0
        ("constant", 1.0, 0.0),
        ("constant", -0.5, 0.0),
        ("line", 0.5, 0.0),
        ("line", 1.5, math.inf),
        ("parabola", 1.5, 0.0),
        ("parabola", 2.5, math.inf),
        ("falling constant", 0.5, -math.inf),
        ("constant and line", 1.5, -math.inf),  # the constant's t^-1.5 outdoes the line's t^-0.5
    ],
)
def test_rl_starts_infinite_just_where_its_definition_is(signal, order, expected):
    t = 0.01 * np.arange(400)
    signals = {
        "constant": 1 + 0 * t,
        "falling constant": -1 + t,
        "line": t,
        "parabola": 3 * t**2,
        "constant and line": 1 + t,
    }
    assert derivative(signals[signal], order, 0.01, kind="rl")[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("order", [-0.5, 0.3, 1.5, 2.5])
def test_caputo_of_a_fractional_order_starts_at_zero(order):
    assert derivative(np.cos(0.1 * np.arange(50)), order, 0.1)[0] == 0


def test_an_offset_does_not_change_caputo_and_adds_its_own_term_to_rl():
    t = 0.01 * np.arange(2001)
    swing = 0.17 * np.exp(-t / 3) * np.cos(6 * t)
    raised = swing + math.pi
    np.testing.assert_allclose(derivative(raised, 0.9146, 0.01), derivative(swing, 0.9146, 0.01), atol=1e-11)
    rl = derivative(raised, 0.9146, 0.01, kind="rl")[1:] - derivative(swing, 0.9146, 0.01, kind="rl")[1:]
    np.testing.assert_allclose(rl, math.pi * power_rule("rl", 0.9146, 0, t[1:]), atol=1e-10)


# Convergence.


def error_at_half(kind, order, power, samples):
    t = np.linspace(0, 1, samples + 1)
    i = samples // 2
    signal, exact = t**power, power_rule(kind, order, power, t[1:])
    return abs(derivative(signal, order, 1 / samples, kind=kind)[i] - exact[i - 1])


def rate_at_start(kind, order, power):
    """Of convergence; 0 or less where there is no Caputo derivative, for the signal's own is infinite there."""
    m = max(math.ceil(order), 0)
    return power + 1 if kind == "rl" or m <= 1 else power + 1 - m


CASES = [case for case in product(SPLINE_KINDS, [-1.5, -0.5, 0.2, 0.5, 0.9146, 1.2, 1.5, 1.9, 2.4],
                                  [0.3, 0.5, 1.5, 2.5, 3.5, 5.5]) if rate_at_start(*case) > 0]  # fmt: skip


@pytest.mark.few(36)
@pytest.mark.parametrize(("kind", "order", "power"), CASES)
def test_fractional_powers_converge_as_fast_as_stated(kind, order, power):
    stated = min(4, 4 - order, rate_at_start(kind, order, power))
    coarse, fine = error_at_half(kind, order, power, 200), error_at_half(kind, order, power, 800)
    assert fine < 1e-12 or math.log(coarse / fine, 4) > stated - 0.15


@pytest.mark.parametrize("order", [-1.5, -0.5, 0.2, 0.5, 0.9146, 1.2, 1.5, 1.9, 2.4, 3.4])
@pytest.mark.parametrize("kind", SPLINE_KINDS)
def test_a_smooth_signal_that_does_not_start_at_zero_converges_as_fast_as_stated(kind, order):
    def error(samples):
        t = np.linspace(0, 2, samples + 1)
        exact = exponential_rule(kind, order, t[1:])
        return np.abs(derivative(np.exp(-t), order, 2 / samples, kind=kind)[1:] - exact)[samples // 2]

    stated = min(4, 4 - order) if order < 3 else 6 - order
    coarse, fine = (error(100), error(400)) if order < 3 else (error(50), error(200))
    assert fine < 1e-12 or math.log(coarse / fine, 4) > stated - 0.15
    assert fine < 1e-3


@pytest.mark.parametrize("order", [-1.5, -0.5, 0.3, 0.9146, 1.0, 1.4, 2.0])
def test_gl_agrees_with_rl_to_first_order(order):
    def difference(samples):
        t = np.linspace(0, 1, samples + 1)
        gl, rl = (derivative(np.cos(3 * t), order, 1 / samples, kind=kind)[-1] for kind in ("gl", "rl"))
        return abs(gl - rl)

    assert 0.9 < math.log2(difference(1000) / difference(2000)) < 1.1
    assert difference(2000) < 0.02


@pytest.mark.few(3)
@pytest.mark.parametrize("order", [-1.5, -0.3, 0.25, 0.5, 0.9146, 1.3, 1.75])
def test_the_sine_has_its_known_derivatives(order):
    t = np.linspace(0, 10, 4001)
    rl = t[1:] ** (1 - order) * mittag_leffler(2.0, -(t[1:] ** 2), 2 - order)
    correction = power_rule("rl", order, 1, t[1:]) if order > 1 else 0.0
    np.testing.assert_allclose(derivative(np.sin(t), order, t[1], kind="rl")[1:], rl, atol=2e-5)
    np.testing.assert_allclose(derivative(np.sin(t), order, t[1])[1:], rl - correction, atol=2e-5)


@pytest.mark.parametrize("order", [0.5, 0.8, 0.9146])
def test_the_mittag_leffler_function_is_its_own_derivative(order):
    t = np.linspace(0, 4, 8001)
    y = mittag_leffler(order, -(t**order))
    late = t > 1
    np.testing.assert_allclose(derivative(y, order, t[1])[late], -y[late], atol=1e-4)


@pytest.mark.parametrize("order", [0.2, 0.5, 0.9146, 1.0, 1.4])
@pytest.mark.parametrize("kind", SPLINE_KINDS)
def test_differentiating_undoes_integrating(kind, order):
    t = np.linspace(0, 2, 2001)
    signal = np.sin(3 * t) ** 2 * np.exp(-t)
    back = derivative(derivative(signal, -order, t[1], kind=kind), order, t[1], kind=kind)
    np.testing.assert_allclose(back[5:], signal[5:], atol=1e-5)


@pytest.mark.parametrize("order", [0.3, 0.9146, 1.6])
def test_differentiating_undoes_integrating_exactly_for_gl(order):
    signal = np.random.default_rng(3).normal(size=400)
    back = derivative(derivative(signal, -order, 0.01, kind="gl"), order, 0.01, kind="gl")
    np.testing.assert_allclose(back, signal, atol=1e-10)


# Properties.


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("integer", [-1, 0, 1, 2])
def test_the_order_just_below_an_integer_gives_nearly_what_the_integer_gives(kind, integer):
    t = 0.01 * np.arange(1000)
    signal = 0.5 + np.cos(3 * t)
    at, below = (derivative(signal, order, 0.01, kind=kind) for order in (integer, integer - 1e-6))
    # near t = 0 a fractional derivative bends over a time that shrinks with the distance to the integer
    np.testing.assert_allclose(below[20:], at[20:], atol=2e-4)


@pytest.mark.parametrize("integer", [-1, 0, 1, 2])
def test_the_order_just_above_an_integer_differs_for_caputo_by_the_start_alone(integer):
    t = 0.01 * np.arange(1000)
    signal = 0.5 + np.cos(3 * t)
    at, above = (derivative(signal, order, 0.01) for order in (integer, integer + 1e-6))
    start = at[0] if integer >= 0 else 0.0
    np.testing.assert_allclose(above[20:], (at - start)[20:], atol=2e-4)


@settings(deadline=None, max_examples=30)
@given(
    order=st.floats(-2, 2.5),
    a=st.floats(-5, 5),
    b=st.floats(-5, 5),
    samples=st.integers(1, 60),
    kind=st.sampled_from(KINDS),
    seed=st.integers(0, 2**32 - 1),
)
def test_the_derivative_is_linear(order, a, b, samples, kind, seed):
    x, y = np.random.default_rng(seed).normal(size=(2, samples))
    together, of_x, of_y = (derivative(v, order, 0.5, kind=kind)[1:] for v in (a * x + b * y, x, y))
    np.testing.assert_allclose(together, a * of_x + b * of_y, atol=1e-9)


@settings(deadline=None, max_examples=20)
@given(order=st.floats(-2, 2.5), step=st.floats(1e-4, 1e3), kind=st.sampled_from(KINDS))
def test_the_step_is_only_a_unit_of_time(order, step, kind):
    signal = np.random.default_rng(4).normal(size=40)
    expected = derivative(signal, order, 1.0, kind=kind) * step**-order
    np.testing.assert_allclose(derivative(signal, order, step, kind=kind), expected, rtol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("order", [-0.7, 0.9, 1.0, 1.8])
def test_channels_are_treated_one_by_one(kind, order):
    signals = np.random.default_rng(5).normal(size=(80, 3)) * [1, 1e3, 1e-3]
    together = derivative(signals, order, 0.1, kind=kind)
    assert together.shape == (80, 3)
    for channel in range(3):
        alone = derivative(signals[:, channel], order, 0.1, kind=kind)
        np.testing.assert_allclose(together[1:, channel], alone[1:], atol=1e-12 * np.abs(alone[1:]).max())


@pytest.mark.parametrize("kind", KINDS)
def test_only_gl_leaves_the_past_alone_but_the_splines_foresight_fades(kind):
    signal = np.zeros(100)
    signal[60] = 1.0
    before = np.abs(derivative(signal, 0.9, 1.0, kind=kind)[:60])
    assert np.all(before[:30] < 1e-14)
    assert np.all(before < (1e-14 if kind == "gl" else 3 * 0.27 ** np.arange(60, 0, -1) + 1e-14))


def test_integers_lists_and_single_precision_are_taken():
    for signal in ([1, 2, 4], (1.0, 2.0, 4.0), np.array([1, 2, 4], dtype=np.float32)):
        np.testing.assert_allclose(derivative(signal, 1, 1.0), [0.5, 1.5, 2.5])
        assert derivative(signal, 1, 1.0).dtype == np.float64


@pytest.mark.broad
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("order", [-0.5, 0.9146, 1.5])
def test_a_million_samples_take_seconds_not_hours(kind, order):
    t = 1e-3 * np.arange(10**6)
    start = time.perf_counter()
    result = derivative(np.sin(t), order, 1e-3, kind=kind)
    assert time.perf_counter() - start < 10
    # long after the start any of them is the phase shift by qπ/2; what is left of the start fades as t^(-1-q)
    late = slice(-5000, None)
    offset = {-0.5: t[late] ** -0.5 / math.gamma(0.5)}.get(order, 0.0)
    if kind != "caputo" or order < 1:
        np.testing.assert_allclose(result[late], np.sin(t[late] + order * math.pi / 2) + offset, atol=3e-3)
    else:
        fading = power_rule("rl", order, 1, t[late])
        np.testing.assert_allclose(result[late], np.sin(t[late] + order * math.pi / 2) - fading, atol=3e-3)


# Bad input.


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"signal": []}, r"signal has shape \(0,\), expected \(n,\) or \(n, channels\) with at least one sample"),
        ({"signal": 1.0}, r"signal has shape \(\), expected"),
        ({"signal": np.zeros((2, 2, 2))}, r"signal has shape \(2, 2, 2\), expected"),
        ({"signal": np.zeros((5, 0))}, r"signal has shape \(5, 0\), expected"),
        ({"signal": [1.0, math.nan, 2.0]}, r"signal\[1\] is nan \(1 such\), expected finite numbers.*Cut or fill"),
        ({"signal": [[1.0, 2.0], [3.0, math.inf]]}, r"signal\[1, 1\] is inf"),
        ({"signal": [1e250, 0.0]}, r"signal\[0\] is 1e\+250"),
        ({"signal": ["a", "b"]}, r"signal is \['a', 'b'\], expected real numbers"),
        ({"signal": [1.0, None]}, "signal is .1.0, None., expected real numbers"),
        ({"signal": [1.0, 2j]}, "expected real numbers"),
        ({"signal": [[1.0], [1.0, 2.0]]}, "expected real numbers"),
        ({"signal": None}, "signal is None, expected real numbers"),
        ({"order": math.nan}, "order is nan, expected a finite number"),
        ({"order": -math.inf}, "order is -inf, expected a finite number"),
        ({"order": "one"}, "order is 'one', expected a finite number"),
        ({"order": 0.5j}, "order is 0.5j, expected a finite number"),
        ({"order": 10.5}, "order is 10.5, expected a number between -10 and 10"),
        ({"step": 0.0}, r"step is 0, expected the time between samples \[s\]"),
        ({"step": -1e-3}, "step is -0.001, expected the time between samples"),
        ({"step": math.nan}, "step is nan, expected a finite number"),
        ({"kind": "weyl"}, 'kind is \'weyl\', expected "caputo", "gl" or "rl"'),
        ({"kind": ["gl"]}, "kind is .'gl'., expected"),
        ({"step": 1e-200, "order": 2.0}, "order 2 at a step of 1e-200 s overflows"),
    ],
)
def test_the_derivative_says_what_is_wrong_with_its_arguments(change, message):
    arguments = {"signal": [0.0, 1.0, 3.0, 4.0], "order": 0.9, "step": 0.1, "kind": "caputo"} | change
    with pytest.raises(InputError, match=message):
        derivative(arguments.pop("signal"), arguments.pop("order"), arguments.pop("step"), **arguments)


@settings(deadline=None, max_examples=30)
@given(
    signal=st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=12),
    order=st.floats(),
    step=st.floats(),
    kind=st.sampled_from(KINDS),
)
def test_any_numbers_give_numbers_or_a_sentence(signal, order, step, kind):
    try:
        result = derivative(signal, order, step, kind=kind)
    except InputError:
        return
    assert np.isfinite(result[1:]).all()
    assert not np.isnan(result).any()


# The Mittag-Leffler function.


@pytest.mark.parametrize(
    ("t", "expected"),
    [
        (0.1, 0.84614678862631),
        (1, 0.38694857861898),
        (5, 0.087827430293285),
        (10, 0.042979301317702),
        (20, 0.022381088674435),
    ],
)
def test_mittag_leffler_gives_the_relaxation_of_order_0_8(t, expected):
    assert mittag_leffler(0.8, -(t**0.8)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("t", "expected"), [(1, 0.52577552929554), (5, 0.90947621519843), (20, 0.97793201545338)])
def test_mittag_leffler_gives_the_step_response_of_order_1_8(t, expected):
    assert t**1.8 * mittag_leffler(1.8, -(t**1.8), 2.8) == pytest.approx(expected, rel=1e-12)


def test_mittag_leffler_is_the_functions_it_generalises():
    x = np.linspace(-3, 3, 31)
    np.testing.assert_allclose(mittag_leffler(1.0, x), np.exp(x), rtol=1e-12)
    np.testing.assert_allclose(mittag_leffler(2.0, -(x**2)), np.cos(x), atol=1e-12)
    np.testing.assert_allclose(x * mittag_leffler(2.0, -(x**2), 2.0), np.sin(x), atol=1e-12)
    erfcx = [math.exp(v**2) * math.erfc(-v) for v in x]
    np.testing.assert_allclose(mittag_leffler(0.5, x), erfcx, rtol=1e-11)


@pytest.mark.few(2)
@pytest.mark.parametrize("order", [0.3, 0.7, 0.9146, 1.0, 1.3, 1.9, 2.0, 2.5, 3.0, 4.0])
@pytest.mark.parametrize("beta", [1.0, 0.5, 1.8, 3.0])
def test_mittag_leffler_is_its_power_series(order, beta):
    for z in (-2.0, -1.0, -0.3, 0.06, -1e-9, 0.6, 1.5, 1 + 1j):
        with mpmath.workdps(60):
            coefficients = [mpmath.rgamma(mpmath.mpf(order) * k + beta) for k in range(300)]
            exact = complex(mpmath.polyval(coefficients[::-1], mpmath.mpmathify(z)))
        assert mittag_leffler(order, z, beta) == pytest.approx(exact, rel=1e-10)


@pytest.mark.parametrize("order", [0.05, 0.5, 0.8, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("beta", [0.0, 0.5, 1.0, 2.0])
def test_mittag_leffler_keeps_its_digits_near_zero(order, beta):
    z = np.array([0.0, -0.0, 1e-300, -1e-17, 1e-12, -1e-6, 1e-3])
    expected = rgamma(beta) + z * rgamma(order + beta) + z**2 * rgamma(2 * order + beta)
    np.testing.assert_allclose(mittag_leffler(order, z, beta), expected, rtol=5e-6)
    series, library = (
        mittag_leffler(order, np.array([1, -1]) / 16 * (1 - 1e-15), beta),
        mittag_leffler(order, [1 / 16, -1 / 16], beta),
    )
    np.testing.assert_allclose(series, library, rtol=1e-11)


def test_importing_the_module_does_not_load_scipy():
    code = "import sys, fracid.solver.operators; sys.exit('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
