"""The three memories give the same history sum, within what each promises."""

from dataclasses import replace
from itertools import product

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from fracid.errors import InputError
from fracid.solver.arguments import Equation, InitialCondition, Options, Relaxations
from fracid.solver.memory import Memory, compressed, full, memory_from_name, short
from fracid.solver.right_hand_side import compile_rhs
from fracid.solver.solve import integrate, solve_fde
from fracid.solver.weights import trapezoidal_weights
from scripts import module_of

ORDERS = (0.001, 0.01, 0.1, 0.3, 0.5, 0.7, 0.8623, 0.9, 0.99, 0.999, 0.999999, 1.0,
          1.000001, 1.001, 1.01, 1.1, 1.3, 1.5, 1.7, 1.9, 1.99, 1.999)  # fmt: skip
FAMILIES = ("gl", "pi")
MANY = 1_000_000
"""Steps."""
proof_of = module_of("benchmarks/certificate.py")
certificate = proof_of.certificate


def lags_up_to(steps):
    return np.unique(np.concatenate([np.arange(1, 60), np.geomspace(60, steps, 200).astype(int)]))


@pytest.mark.few(4)
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("order", ORDERS)
def test_every_compressed_weight_is_within_the_tolerance(family, order):
    every = full().kernel(family, order, MANY)
    for steps, tolerance in product((100, 20_000, MANY), (1e-8, 1e-10)):
        lags = lags_up_to(steps)
        exact = every.at(lags)
        error = np.abs(compressed(tolerance).kernel(family, order, steps).at(lags) - exact)
        assert np.all(error <= tolerance * np.abs(exact)), (steps, tolerance)


def exact_weight(family, q, k):
    """w_k with 60 digits."""
    with mpmath.workdps(60):
        q = mpmath.mpf(q)
        if family == "gl":
            return float((-1) ** k * mpmath.binomial(q, k))
        return float(((k + 1) ** (q + 1) - 2 * mpmath.mpf(k) ** (q + 1) + (k - 1) ** (q + 1)) / mpmath.gamma(q + 2))


def exact_start(q, k):
    """a_k of the trapezoidal family with 60 digits."""
    with mpmath.workdps(60):
        q = mpmath.mpf(q)
        return float(((k - 1) ** (q + 1) - (k - 1 - q) * mpmath.mpf(k) ** q) / mpmath.gamma(q + 2))


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("order", [q for q in ORDERS if q != 1.0])
def test_weights_are_those_of_an_independent_60_digit_computation(family, order):
    near, far = [1, 2, 3, 7, 8, 9, 17, 40], [9, 17, 100, 3_000, 50_000, 1_000_000]
    want = np.array([exact_weight(family, order, k) for k in near])
    np.testing.assert_allclose(full().kernel(family, order, 40).at(near), want, rtol=4e-15)
    want = np.array([exact_weight(family, order, k) for k in far])
    np.testing.assert_allclose(proof_of.far_weights(family, order, np.array(far)), want, rtol=1e-14)
    np.testing.assert_allclose(compressed(1e-10).kernel(family, order, 1_000_000).at(far), want, rtol=1e-10)


@pytest.mark.parametrize("order", [q for q in ORDERS if q != 1.0])
def test_weights_of_the_start_are_within_the_tolerance_too(order):
    kernel = compressed(1e-10).kernel("pi", order, 1_000_000)
    assert np.allclose(kernel.start[1:], [exact_start(order, k) for k in range(1, 9)], rtol=4e-15, atol=0)
    later = np.array([0, 5, 1_000, 900_000])
    start = np.exp(np.outer(later, np.log1p(kernel.decay))) @ (kernel.amplitude * kernel.start_ratio)
    start += kernel.ramp * (later / 2 - 1 / 6)  # its panel is half a hat, whose centre is a third of a step later
    np.testing.assert_allclose(start, [exact_start(order, int(k) + 9) for k in later], rtol=1e-10)


@pytest.mark.few(14)
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("order", [q for q in ORDERS if q != 1.0])
def test_the_tolerance_holds_to_ten_million_steps(family, order):
    steps = 10_000_000
    proof = certificate(compressed(1e-10), family, order, steps)
    assert proof.spacing + proof.upper + proof.lower <= 1e-10
    assert proof.rounding < (2e-12 if family == "gl" or order < 1.2 else 1e-9)
    lags = [9, 10, 17, 1_000, 1_001, 100_000, 3_000_000, steps]
    want = np.array([exact_weight(family, order, k) for k in lags])
    error = np.abs(compressed(1e-10).kernel(family, order, steps).at(lags) / want - 1)
    assert np.all(error <= proof.bound)
    assert proof.bound <= 1e-10 + proof.rounding
    assert error.max() <= proof.measured * (1 + 1e-3) + 1e-14


@settings(max_examples=30, deadline=None)
@given(
    family=st.sampled_from(FAMILIES),
    q=st.one_of(st.floats(0.001, 0.9999), st.floats(1.0001, 1.999)),
    log_steps=st.floats(1.9, 7),
    log_tolerance=st.floats(-12, -2),
    lags=st.integers(8, 64),
)
def test_what_is_found_is_within_what_is_proved(family, q, log_steps, log_tolerance, lags):
    tolerance = 10.0**log_tolerance
    proof = certificate(compressed(tolerance, lags=lags), family, q, int(10**log_steps))
    proved = proof.spacing + proof.upper + proof.lower
    assert proved <= tolerance
    assert proof.measured <= proved + proof.rounding
    assert proof.bound <= tolerance + proof.rounding


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("order", [0.3, 0.9, 1.5])
def test_the_spacing_costs_what_poissons_formula_says(family, order):
    proof = certificate(compressed(1e-8), family, order, 100_000)
    assert 0.95 * proof.spacing <= proof.measured <= 1.05 * proof.spacing


@pytest.mark.parametrize(
    ("mode", "factor", "seen_in"), [(1, 1 + 1e-4, "rounding"), (15, 1 + 1e-4, "near"), (-1, 4.0, "upper")]
)
def test_a_kernel_that_was_tampered_with_fails_its_certificate(mode, factor, seen_in):
    memory, run = compressed(1e-10), ("gl", 0.8, 2_000)
    kernel, genuine = memory.kernel(*run), certificate(memory, *run)
    amplitude = kernel.amplitude.copy()
    amplitude[mode] *= factor
    forged = certificate(Memory("forged", lambda *_: replace(kernel, amplitude=amplitude)), *run)
    assert forged.measured > 3 * genuine.measured
    assert forged.bound > 1e-10 > genuine.bound
    assert getattr(forged, seen_in) > 3 * getattr(genuine, seen_in)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("order", [0.001, 0.5, 0.9, 0.999, 1.001, 1.5, 1.999])
@pytest.mark.parametrize(("tolerance", "modes"), [(1e-8, 30), (1e-10, 37)])
def test_a_run_of_20_000_steps_needs_few_exponentials_after_16_lags(family, order, tolerance, modes):
    asked = min(modes, 28) if order < 1.1 and tolerance == 1e-8 else modes
    assert certificate(compressed(tolerance, lags=16), family, order, 20_000).modes <= asked


def test_certificates_of_memories_that_compress_nothing():
    whole, cut = certificate(full(), "gl", 0.9, 200_000), certificate(short(100), "gl", 0.9, 200_000)
    assert whole.measured <= whole.bound < 1e-10
    assert cut.bound == np.inf
    assert cut.measured == 1.0
    assert certificate(compressed(), "pi", 1.0, 1_000).bound == 0.0
    assert certificate(compressed(), "pi", 0.9, 5).bound < 1e-14


@pytest.mark.broad
@pytest.mark.parametrize(("order", "tolerance"), [(0.5, 1e-10), (0.9, 1e-10), (1.1, 1e-10), (1.9, 1e-9)])
def test_three_million_steps_of_a_constant_force_add_no_rounding_beyond_the_tolerance(order, tolerance):
    run = solve_fde(constant_force, order, [0.0] if order < 1 else [[0.0, 0.0]], step=1e-3, end=3e3)
    want = run.time[1:] ** order / float(mpmath.gamma(order + 1))
    np.testing.assert_allclose(run.states[1:, 0], want, rtol=tolerance)


def constant_force(t, x, u, p, out):
    out[0] = 1.0


@given(st.floats(0.001, 0.999), st.integers(3, 7), st.floats(-12, -6))
@settings(max_examples=5, deadline=None)
def test_below_order_1_the_memory_is_a_positive_sum_of_lags(q, log_steps, log_tolerance):
    for family, sign in (("pi", 1), ("gl", -1)):
        kernel = compressed(10.0**log_tolerance).kernel(family, q, 10**log_steps)
        assert np.all(sign * kernel.amplitude > 0)
        assert np.all((kernel.decay <= 0) & (kernel.decay > -1))


def test_a_certificate_says_it_in_a_sentence():
    said = str(certificate(compressed(1e-10), "pi", 0.9, 20_000))
    assert said.startswith(
        "pi, order 0.9, 20,000 steps, compressed(1e-10): 8 exact lags and 27 exponentials; no weight"
    )
    assert said.endswith(tuple("0123456789"))


def test_an_order_of_exactly_one_keeps_no_memory():
    derivative, integral = (compressed().kernel(family, 1.0, 10_000) for family in FAMILIES)
    assert (derivative.lags, len(derivative.decay)) == (1, 0)
    assert (integral.lags, len(integral.decay)) == (1, 1)
    assert np.all(integral.at([1, 2, 9_999]) == 1.0)


@pytest.mark.parametrize("family", FAMILIES)
def test_weights_are_continuous_in_the_order_at_one(family):
    lags = [1, 2, 16, 17, 1_000]
    below, at, above = (compressed().kernel(family, q, 5_000).at(lags) for q in (1 - 1e-9, 1.0, 1 + 1e-9))
    np.testing.assert_allclose(below, at, atol=1e-7)
    np.testing.assert_allclose(above, at, atol=1e-7)


def test_an_order_next_to_one_is_run_as_one():
    def decay(t, x, u, p, out):
        out[0] = -x[0]

    below, one = (solve_fde(decay, q, [1.0], step=0.01, end=1.0).states for q in (np.nextafter(1, 0), 1.0))
    np.testing.assert_allclose(below, one, rtol=1e-12)


def test_weights_of_the_start_and_of_the_rest_integrate_a_constant_exactly():
    q, n = 0.7, 5_000
    kernel = full().kernel("pi", q, n)
    total = kernel.weights[:n].sum() + kernel.start[n]
    assert total == pytest.approx(n**q / float(mpmath.gamma(q + 1)), rel=1e-12)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("order", [1 - 1e-6, 1 + 1e-9, 1 + 1e-6, 1 + 1e-4])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-8])
def test_a_loose_tolerance_next_to_order_one_still_holds(family, order, tolerance):
    lags = lags_up_to(20_000)
    exact = full().kernel(family, order, 20_000).at(lags)
    error = np.abs(compressed(tolerance).kernel(family, order, 20_000).at(lags) - exact)
    assert np.all(error <= tolerance * np.abs(exact))


def test_short_memory_of_a_derivative_forgets_and_of_an_integral_freezes():
    derivative, integral = (short(50).kernel(family, 0.6, 1_000) for family in FAMILIES)
    assert np.all(derivative.at([51, 1_000]) == 0.0)
    assert np.all(integral.at([51, 1_000]) == integral.weights[50])


@settings(max_examples=20, deadline=None)
@given(q=st.floats(0.001, 1.999), steps=st.integers(70, 300_000), log_tolerance=st.floats(-10, -3))
def test_the_tolerance_holds_for_any_order_length_and_tolerance(q, steps, log_tolerance):
    tolerance = 10.0**log_tolerance
    for family in FAMILIES:
        lags = lags_up_to(steps)
        exact = full().kernel(family, q, steps).at(lags)
        error = np.abs(compressed(tolerance).kernel(family, q, steps).at(lags) - exact)
        assert np.all(error <= tolerance * np.abs(exact))


@pytest.mark.parametrize("memory", [full(), short(25), compressed(), compressed(2.5e-7), compressed(1e-8, lags=16)])
def test_a_memory_is_typed_as_it_is_printed(memory):
    typed = memory_from_name(memory.name)
    assert (typed.name, typed.tolerance) == (memory.name, memory.tolerance)
    assert memory_from_name(typed) is typed


def test_a_compressed_memory_without_its_tolerance_has_the_one_beside_it():
    assert memory_from_name("compressed", 1e-6).name == "compressed(1e-06)"
    assert memory_from_name("compressed(1e-8)", 1e-6).name == "compressed(1e-08)"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: memory_from_name("endless"), "no memory 'endless'.*'full', 'short"),
        (lambda: memory_from_name("short(x)"), "no memory 'short"),
        (lambda: memory_from_name("compressed(1..2)"), r"'compressed\(1e-8\)' with its tolerance"),
        (lambda: memory_from_name("compressed(1)"), "between 1e-13 and 1e-2"),
        (lambda: memory_from_name("short(0)"), "whole number of lags"),
        (lambda: short(2.5), "whole number of lags"),
        (lambda: compressed(0.0), "between 1e-13 and 1e-2"),
        (lambda: compressed(float("nan")), "between 1e-13 and 1e-2"),
        (lambda: compressed(lags=4), "whole number from 8 to 64; type for example lags=16"),
        (lambda: compressed(lags=12.5), "lags=12.5.*whole number"),
    ],
)
def test_a_wrong_memory_is_told(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.few(2)
@pytest.mark.parametrize("order", ORDERS)
def test_the_third_order_weights_follow_from_the_trapezoidal_ones_within_the_tolerance(order):
    lags = lags_up_to(MANY)
    trapezoidal, exact = (full().kernel(family, order, MANY + 1) for family in ("pi", "pi3"))
    far = lags[(lags >= 3) & (lags < MANY)]
    b = trapezoidal.at
    np.testing.assert_allclose(exact.at(far), b(far) - (b(far + 1) - 2 * b(far) + b(far - 1)) / 12, rtol=1e-12)
    for steps in (100, 20_000, MANY):
        lags = lags_up_to(steps)
        kernel = compressed(1e-10).kernel("pi3", order, steps + 1)
        np.testing.assert_allclose(kernel.at(lags), exact.at(lags), rtol=1.4e-10)


@pytest.mark.parametrize("order", [0.01, 0.5, 0.9, 1.0, 1.1, 1.7, 1.99])
def test_the_third_order_weights_and_the_starts_integrate_a_constant_exactly(order):
    kernel, n = full().kernel("pi3", order, 300), np.arange(1, 301)
    start = kernel.start[1:] if order != 1.0 else np.r_[kernel.start[1:], np.full(297, 0.5)]
    total = np.cumsum(kernel.at(np.arange(300))) + start
    np.testing.assert_allclose(total, n**order / float(mpmath.gamma(order + 1)), rtol=1e-12)


def test_at_order_one_the_third_order_weights_are_those_of_adams_and_moulton():
    summed = compressed().kernel("pi3", 1.0, 5000).at([0, 1, 2, 3, 4, 4999])
    np.testing.assert_allclose(np.diff(summed[:5], prepend=0.0), np.array([9, 19, -5, 1, 0]) / 24, atol=1e-15)
    assert summed[-1] == 1.0


def leaking(t, x, u, p, out):
    out[0] = u[0] - 0.4 * x[0]


def driven_by_slow(t, x, u, p, out):
    out[0] = -x[0] + x[1]
    out[1] = np.cos(t) - 0.5 * x[0] - np.sin(x[1])


SHARES, TIMES, HELD = (0.5, 0.4, 0.3), (2.0, 0.05), (0.2, -0.1)


@pytest.mark.few(2)
@pytest.mark.parametrize("shares", [SHARES, (0.5, -0.4, 0.3), (0.0, 1.0, 0.0)])
@pytest.mark.parametrize("held", [HELD, (0.0, 0.0)])
def test_a_finite_memory_is_that_of_a_state_for_each_relaxation_where_the_input_jumps_too(shares, held):
    def slope(t, y, on):
        f = np.sin(t) + on - 0.4 * y[0]
        fades = y[1:] / TIMES
        return [sum(shares) * f - shares[1:] @ fades, *(f - fades)]

    errors = []
    for step in (0.04, 0.02):
        t = np.arange(round(8 / step) + 1) * step
        before, after = (np.sin(t) + on for on in (t > 4 + 1e-9, t > 4 - 1e-9))
        equation = Equation(compile_rhs(leaking), np.ones(1), before[:, None], np.zeros(0), after=after[:, None],
                            fading=(Relaxations(0, shares, TIMES, held),))  # fmt: skip
        run = integrate(equation, InitialCondition(np.array([0.3])), step, len(t) - 1, Options("pi2", compressed()))
        first = solve_ivp(slope, (0, 4), [0.3, *held], args=(0.0,), rtol=1e-10, atol=1e-12, dense_output=True)
        then = solve_ivp(slope, (4, 8.1), first.y[:, -1], args=(1.0,), rtol=1e-10, atol=1e-12, dense_output=True)
        exact = np.where(t <= 4, first.sol(np.minimum(t, 4))[0], then.sol(np.maximum(t, 4))[0])
        errors.append(np.max(np.abs(run.states[:, 0] - exact)))
    assert errors[1] < 1e-4
    assert errors[0] / errors[1] > 3.5


def test_a_finite_memory_beside_an_order_begins_as_its_states_do():
    def with_states(t, x, u, p, out):
        f = np.cos(t) - 0.5 * x[0] - np.sin(x[1])
        out[0] = -x[0] + x[1]
        out[1] = 1.2 * f - 0.4 * x[2] / 2.0 - 0.3 * x[3] / 0.05
        out[2] = f - x[2] / 2.0
        out[3] = f - x[3] / 0.05

    u, p, how = np.zeros((1, 1)), np.zeros(0), Options("pi2", compressed())
    as_states = Equation(compile_rhs(with_states), np.array([0.6, 1.0, 1.0, 1.0]), u, p)
    memory = Relaxations(1, SHARES, TIMES, HELD)
    remembers = Equation(compile_rhs(driven_by_slow), np.array([0.6, 1.0]), u, p, fading=(memory,))
    fine = integrate(as_states, InitialCondition(np.array([0.3, 0.1, *HELD])), 1 / 1280, 6400, how).states[::64, :2]
    run = integrate(remembers, InitialCondition(np.array([0.3, 0.1])), 1 / 80, 400, how).states[::4]
    assert np.max(np.abs(run - fine)) < 1e-4


def test_the_integral_of_order_zero_is_the_sample_itself():
    """A springpot at its bound is a spring."""
    b, a = trapezoidal_weights(0.0, 12)
    assert b.tolist() == [1.0] + 12 * [0.0]
    assert not a.any()
