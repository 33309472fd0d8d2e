"""The minimum at half the step is found with the derivatives at the step, and is that of a search."""

from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.estimation.covariance import uncertainty
from fracid.estimation.horizons import Watch, refined
from fracid.estimation.nearly_equal import nearly_equal_minimum
from fracid.problem import Experiment, Free, Prior, Problem
from fracid.problem.costs import COSTS

FREE = {"b_alpha": Free(5e-4, 0.0, 1e-2), "coulomb_theta": Free(1e-3, 0.0, 1e-1)}
ORDERS = {"lambda": Free(0.95, 0.6, 1.2), "mu": Free(0.95, 0.6, 1.2)}


def problem(method="pi2", cost="rmse", orders=ORDERS):
    run = fracid.simulate(
        fracid.rotary_pendulum("srv02-rotpen"), orders={"lambda": 0.97, "mu": 0.96}, initial={"alpha": 0.8},
        parameters={"b_alpha": 4e-4, "coulomb_theta": 2e-3}, step=2e-3, end=4.0,
    )  # fmt: skip
    noise = 2e-3 * np.random.default_rng(3).standard_normal((401, 2))
    swings = (Experiment(name, 0.01, run.states[::5, [0, 2]] + sign * noise, np.zeros((1, 1)), initial={"alpha": 0.8})
              for name, sign in (("one", 1.0), ("other", -1.0)))  # fmt: skip
    return Problem(fracid.rotary_pendulum("srv02-rotpen"), tuple(swings), orders, FREE, initial_state="held",
                   method=method, cost_function=COSTS[cost])  # fmt: skip


@pytest.mark.few(1)
@pytest.mark.parametrize("method", ["pi2", "pi2-implicit", "bdf2"])
@pytest.mark.parametrize("cost", ["rmse", "huber"])
def test_a_chord_ends_where_a_search_does(method, cost):
    at = problem(method, cost)
    x = refined(at, at.start, Watch(), tolerance=1e-10).best.point
    half = replace(at, method="pi2", substeps=2)
    near, best = nearly_equal_minimum(at, x, half, 1), refined(half, x, Watch(), tolerance=1e-10).best
    widths = 1.96 * uncertainty(half, best.point).standard_error
    moved = np.abs(best.point - x) / widths
    np.testing.assert_allclose(near / widths, best.point / widths, atol=0.02 + 0.05 * moved.max())
    assert half.cost(near) == pytest.approx(best.cost, rel=1e-4)


def test_a_search_is_left_to_do_what_a_chord_cannot():
    at = problem()
    assert nearly_equal_minimum(at, at.start, replace(at, cost_function=COSTS["iae"]), 1) is None
    at_its_bound = problem(orders={**ORDERS, "mu": Free(1.2, 0.6, 1.2)})
    assert nearly_equal_minimum(at_its_bound, at_its_bound.start, at_its_bound, 1) is None
    pulled = problem(orders={**ORDERS, "mu": Free(0.95, 0.6, 1.2, prior=Prior(0.9, 0.01))})
    assert nearly_equal_minimum(pulled, pulled.start, pulled, 1) is None
