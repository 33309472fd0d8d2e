"""The three memories give the same history sum, within what each promises."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fracid.errors import InputError
from fracid.memory import compressed, full, memory_from_name, short

ORDERS = (0.001, 0.01, 0.1, 0.3, 0.5, 0.7, 0.8623, 0.9, 0.99, 0.999, 0.999999, 1.0,
          1.000001, 1.001, 1.01, 1.1, 1.3, 1.5, 1.7, 1.9, 1.99, 1.999)  # fmt: skip
FAMILIES = ("gl", "pi")


def lags_up_to(steps):
    return np.unique(np.concatenate([np.arange(1, 60), np.geomspace(60, steps, 200).astype(int)]))


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("steps", [100, 20_000, 1_000_000])
@pytest.mark.parametrize("tolerance", [1e-8, 1e-10])
def test_every_compressed_weight_is_within_the_tolerance(family, order, steps, tolerance):
    lags = lags_up_to(steps)
    exact = full().kernel(family, order, steps).at(lags)
    error = np.abs(compressed(tolerance).kernel(family, order, steps).at(lags) - exact)
    assert np.all(error <= tolerance * np.abs(exact))


def exact_weight(family, q, k):
    """w_k with 40 digits."""
    with mpmath.workdps(40):
        q = mpmath.mpf(q)
        if family == "gl":
            return float((-1) ** k * mpmath.binomial(q, k))
        return float(((k + 1) ** (q + 1) - 2 * mpmath.mpf(k) ** (q + 1) + (k - 1) ** (q + 1)) / mpmath.gamma(q + 2))


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("order", [q for q in ORDERS if q != 1.0])
def test_weights_are_those_of_an_independent_40_digit_computation(family, order):
    lags = [1, 2, 7, 8, 16, 17, 100, 3_000, 50_000, 1_000_000]
    want = np.array([exact_weight(family, order, k) for k in lags])
    np.testing.assert_allclose(
        full().kernel(family, order, 1_000_000).at(lags), want, rtol=1e-10
    )  # the recursion adds up rounding
    np.testing.assert_allclose(compressed(1e-10).kernel(family, order, 1_000_000).at(lags), want, rtol=1e-10)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("order", [0.001, 0.5, 0.9, 0.999, 1.001, 1.5, 1.9])
def test_the_compressed_bound_holds_to_ten_million_steps(family, order):
    lags = [17, 1_000, 100_000, 3_000_000, 10_000_000]
    want = np.array([exact_weight(family, order, k) for k in lags])
    kernel = compressed(1e-9).kernel(family, order, 10_000_000)
    np.testing.assert_allclose(kernel.at(lags), want, rtol=1e-9)
    assert len(kernel.decay) <= 60


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


@settings(max_examples=40, deadline=None)
@given(q=st.floats(0.001, 1.999), steps=st.integers(70, 300_000), log_tolerance=st.floats(-10, -3))
def test_the_tolerance_holds_for_any_order_length_and_tolerance(q, steps, log_tolerance):
    tolerance = 10.0**log_tolerance
    for family in FAMILIES:
        lags = lags_up_to(steps)
        exact = full().kernel(family, q, steps).at(lags)
        error = np.abs(compressed(tolerance).kernel(family, q, steps).at(lags) - exact)
        assert np.all(error <= tolerance * np.abs(exact))


@pytest.mark.parametrize("name", ["full", "short(25)", "compressed(1e-10)"])
def test_a_memory_keeps_its_name(name):
    asked = "compressed" if name.startswith("compressed") else name
    assert memory_from_name(asked).name == name
    assert memory_from_name(memory_from_name(asked)).name == name


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: memory_from_name("endless"), "no memory 'endless'.*'full', 'short"),
        (lambda: memory_from_name("short(x)"), "no memory 'short"),
        (lambda: memory_from_name("short(0)"), "whole number of lags"),
        (lambda: short(2.5), "whole number of lags"),
        (lambda: compressed(0.0), "between 1e-13 and 1e-2"),
        (lambda: compressed(float("nan")), "between 1e-13 and 1e-2"),
    ],
)
def test_a_wrong_memory_is_told(make, message):
    with pytest.raises(InputError, match=message):
        make()
