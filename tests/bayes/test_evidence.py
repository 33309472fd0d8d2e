"""The part of a Student's t, with a slope and a normal prior, that lies within bounds."""

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.special import gammaln
from scipy.stats import multivariate_t

from fracid.bayes.evidence import log_box_integral


@pytest.mark.few(1)
@pytest.mark.parametrize(("count", "degrees"), [(5, 3.0), (12, 1.2), (12, 1e4)])
def test_the_part_of_a_correlated_students_t_within_bounds_is_that_of_scipy(count, degrees):
    rng, none = np.random.default_rng(0), np.zeros(count)
    mixing = rng.standard_normal((count, count + 2))
    scale = mixing @ mixing.T
    width = np.sqrt(np.diag(scale))
    lower = -rng.uniform(0, 1, count) * width
    lower[0] = 0.0  # at its bound
    upper = lower + 10 * width
    integral = log_box_integral(np.linalg.inv(scale), degrees, none, none, none, lower, upper)
    whole = gammaln(degrees / 2) - gammaln((degrees + count) / 2) + 0.5 * count * np.log(degrees * np.pi)
    part = multivariate_t.cdf(upper, none, scale, degrees, lower_limit=lower, random_state=1, maxpts=20_000)
    assert integral - whole - 0.5 * np.linalg.slogdet(scale)[1] == pytest.approx(np.log(part), abs=0.02)


def test_a_slope_at_a_bound_and_a_normal_prior_beside_count_as_in_a_sum_over_a_grid():
    precision, degrees, slope = np.array([[1.0, 0.7], [0.7, 1.0]]), 1.5, np.array([2.0, 0.0])
    x, y = np.linspace(0, 20, 1501), np.linspace(-20, 20, 3001)
    square = x[:, None] ** 2 + 1.4 * x[:, None] * y + y**2
    density = (1 + square / degrees + 2 * slope[0] * x[:, None] / (degrees + 2)) ** (-(degrees + 2) / 2)
    exact = np.log(simpson(simpson(density * np.exp(-0.1 * y**2 - 0.3 * y), x=y), x=x))
    prior = np.array([0.0, 0.2]), np.array([0.0, 0.3])
    found = log_box_integral(precision, degrees, slope, *prior, np.array([0.0, -20.0]), np.full(2, 20.0))
    assert found == pytest.approx(exact, abs=1e-3)
