"""Resampled residuals scatter as repeated experiments do, and recordings that disagree are told."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import fracid
from fracid.errors import InputError
from fracid.estimation.agreement import spread
from fracid.estimation.block_bootstrap import Bootstrap, bootstrap, resampled
from fracid.estimation.covariance import residual_bandwidth, uncertainty
from fracid.estimation.profile_walk import refit
from fracid.problem import Free, Prior, Problem
from fracid.problem.costs import COSTS, Cost
from twins import release

RIG = fracid.rotary_pendulum("srv02-rotpen")
ORDERS = {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)}


def noise(n, rho, seed, sd=3e-3):
    """AR(1) of two outputs, lag-one correlation rho."""
    white = np.random.default_rng(seed).standard_normal((n + 500, 2))
    return sd * np.sqrt(1 - rho**2) * lfilter([1], [1, -rho], white, axis=0)[500:]


def swing(name="swing", rho=0.0, seed=1, mu=0.95, end=4.0):
    exact = release(name, orders={"lambda": 0.9, "mu": mu}, alpha=0.3, step=2e-3, end=end)
    return replace(exact, measured=exact.measured + noise(len(exact.measured), rho, seed))


def fitted(*swings, **options):
    p = Problem(RIG, swings, **{"orders": ORDERS, "initial_state": "held"} | options)
    return p, refit(p, p.start).point


# --- the blocks --------------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize("length", [1, 3, 7, 20])
def test_resampled_residuals_have_mean_zero_at_every_sample(length):
    errors = np.random.default_rng(1).standard_normal((20, 2)) + 5.0
    draws = np.array([resampled(errors, length, rng) for rng in np.random.default_rng(2).spawn(4000)])
    scatter = np.maximum(draws.std(axis=0), 1e-12) / np.sqrt(4000)
    assert np.all(np.abs(draws.mean(axis=0)) < 5 * scatter + 1e-12)


def test_blocks_are_neighbours_of_the_record():
    errors = np.arange(100.0)[:, None] ** 2
    drawn = resampled(errors, 10, np.random.default_rng(3), median=True)[:, 0] + np.median(errors)
    roots = np.sqrt(drawn).reshape(10, 10)
    assert np.allclose(np.diff(roots, axis=1), 1.0)
    assert len(np.unique(roots[:, 0])) > 1


@pytest.mark.broad
def test_blocks_keep_the_correlation_that_single_samples_lose():
    errors = noise(20_000, 0.9, 1)
    length = round(residual_bandwidth([errors])) + 1
    sums = {}
    for size in (1, length):
        drawn = np.array([resampled(errors, size, rng).sum(axis=0) for rng in np.random.default_rng(1).spawn(300)])
        sums[size] = drawn.var() / (20_000 * errors.var())
    assert sums[1] == pytest.approx(1.0, rel=0.3)
    assert sums[length] == pytest.approx((1 + 0.9) / (1 - 0.9), rel=0.3)


# --- the draws ---------------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize(("cost", "rho"), [("rmse", 0.0), ("rmse", 0.9), ("huber", 0.0), ("itae", 0.0)])
def test_one_step_draws_scatter_as_the_sandwich_says(cost, rho):
    p, x = fitted(swing(rho=rho), cost_function=COSTS[cost])
    known, drawn = uncertainty(p, x), bootstrap(p, x)
    assert drawn.standard_error == pytest.approx(known.standard_error, rel=0.35)
    assert np.all(np.abs(drawn.bias) < 0.3 * drawn.standard_error)
    for i in range(2):
        low, high = drawn.interval(i)
        assert high - low == pytest.approx(2 * 1.96 * drawn.standard_error[i], rel=0.15)
    if rho > 0:
        assert np.all(drawn.standard_error > 2 * known.white)


def test_draws_scatter_with_the_prior_as_the_sandwich_says():
    narrow = Free(0.95, 0.5, 1.2, prior=Prior(0.95, 1.0))
    p, x = fitted(swing(end=1.0), orders={"lambda": 0.9, "mu": narrow})
    sd = float(uncertainty(p, x).standard_error[0])  # of the recording alone
    p, x = fitted(swing(end=1.0), orders={"lambda": 0.9, "mu": replace(narrow, prior=Prior(0.95, sd))})
    both = bootstrap(p, x).standard_error[0]
    assert both == pytest.approx(sd / np.sqrt(2), rel=0.15)
    assert both == pytest.approx(uncertainty(p, x).standard_error[0], rel=0.15)


def test_what_lies_at_a_bound_is_left_alone():
    p, x = fitted(swing(end=1.0), orders={"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.94, 0.5, 0.9401)})
    assert np.ptp(bootstrap(p, x, draws=10).draws[:, 1]) == 0


def test_the_seed_decides_and_jobs_do_not():
    p, x = fitted(swing(end=1.0))
    one, three, other = (bootstrap(p, x, draws=6, seed=s, jobs=j) for s, j in ((1, 1), (1, 3), (2, 1)))
    assert np.array_equal(one.draws, three.draws)
    assert not np.array_equal(one.draws, other.draws)


def test_the_record_says_its_method_its_block_and_too_few_blocks():
    p, x = fitted(swing(rho=0.98, end=2.0))
    record = bootstrap(p, x, draws=20).to_json()
    assert record["method"] == "moving-block bootstrap of the residuals, one-step"
    assert record["block"] > 50
    assert "the bootstrap's intervals are too narrow" in record["warning"]
    assert list(record["unknowns"]) == ["lambda", "mu"]
    assert bootstrap(p, x, draws=20, block=10).warning == ""


@pytest.mark.parametrize(("options", "words"), [
    ({"draws": 1}, "draws = 1; expected a whole number, 2 or more"),
    ({"block": 0}, "block = 0; expected a whole number, 1 or more"),
    ({"jobs": 0}, "jobs = 0"),
])  # fmt: skip
def test_what_cannot_be_drawn_is_told(options, words):
    p, x = fitted(swing(end=0.5))
    with pytest.raises(InputError, match=words):
        bootstrap(p, x, **options)


def test_a_users_own_cost_nothing_free_and_a_run_that_fails_are_told():
    own = Cost("worst", function=lambda time, residual: float(np.max(np.abs(residual))))
    p, x = fitted(swing(end=0.5))
    with pytest.raises(InputError, match="worst is a user's own, of unknown loss"):
        bootstrap(replace(p, cost_function=own), x)
    with pytest.raises(InputError, match="Nothing is free"):
        bootstrap(replace(p, orders={"lambda": 0.9, "mu": 0.95}), np.empty(0))
    with pytest.raises(InputError, match="the run at the minimum fails"):
        bootstrap(replace(p, parameters={"C3": 0.1}), x)


def test_an_interval_holds_95_of_100_draws():
    found = Bootstrap(("a",), np.zeros(1), np.arange(1001.0)[:, None], 1)
    assert found.interval(0) == (25.0, 975.0)


# --- each recording alone ------------------------------------------------------------------------------


def test_recordings_of_one_truth_agree_within_their_standard_errors():
    p, x = fitted(*(swing(f"swing {k}", seed=k, end=2.0) for k in range(1, 6)))
    found = spread(p, x)
    assert found.sentences == ()
    assert list(found.unknowns) == ["lambda", "mu"]
    for u in found.unknowns.values():
        assert len(u.values) == len(u.standard_errors) == 5
        assert u.birge < 2
        assert u.standard_deviation == pytest.approx(u.standard_errors.mean(), rel=0.8)


def test_recordings_that_disagree_are_told_with_how_far():
    p, x = fitted(swing("slow", seed=1, end=2.0), swing("fast", seed=2, mu=0.96, end=2.0))
    found = spread(p, x)
    assert found.unknowns["mu"].birge > 5
    (said,) = [s for s in found.sentences if s.startswith("mu")]
    assert "from 0.95 to 0.96" in said
    record = found.to_json()
    assert record["unknowns"]["mu"]["values"] == pytest.approx([0.95, 0.96], abs=1e-3)
    assert record["recordings"] == ["slow", "fast"]


def test_what_each_recording_has_for_itself_is_left_out_and_jobs_change_nothing():
    swings = swing("one", end=1.0), swing("two", seed=2, end=1.0)
    cable = {"theta_rest": Free(0.0, -0.5, 0.5), "cable_stiffness": 0.01}
    p, x = fitted(*swings, initial_state="rest", parameters=cable, per_recording=("theta_rest",))
    one, two = (spread(p, x, jobs=jobs) for jobs in (1, 2))
    assert list(one.unknowns) == ["lambda", "mu"]
    assert all(np.array_equal(u.values, two.unknowns[n].values) for n, u in one.unknowns.items())


def test_a_spread_needs_two_recordings_and_a_known_loss():
    p, x = fitted(swing(end=0.5))
    with pytest.raises(InputError, match="one recording to fit; a spread needs two or more"):
        spread(p, x)
    own = Cost("worst", function=lambda time, residual: float(np.max(np.abs(residual))))
    two = replace(p, experiments=(swing("a", end=0.5), swing("b", end=0.5)), cost_function=own)
    with pytest.raises(InputError, match="no spread of it"):
        spread(two, x)
