"""Intervals: how often they hold the truth, and what they say of what cannot be known."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.signal import lfilter
from scipy.stats import t as student

import fracid
from fracid.arrowhead import Blocks
from fracid.errors import Failure, FailureReason
from fracid.estimation import interval_walk
from fracid.estimation.block_covariance import Bread, widening
from fracid.estimation.bounded import lowest, reach
from fracid.estimation.covariance import METHODS, at_bound, uncertainty
from fracid.estimation.derivatives import jacobian
from fracid.estimation.minimum import settled
from fracid.models import Model, Parameter
from fracid.models.written.equations import Equation, Equations
from fracid.optimise import least_squares, minimise
from fracid.problem import Experiment, Free, Prior, Problem
from fracid.problem.costs import COSTS, Cost
from fracid.signals.correlation import bartlett_long_run, sokal_bandwidth

pytestmark = pytest.mark.usefixtures("without_rivals")

RIG = fracid.rotary_pendulum("srv02-rotpen")
TRUE = np.array([0.9, 0.95])
ORDERS = {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)}


def clean(step=2e-3, end=4.0):
    run = fracid.simulate(RIG, orders=[0.9, 0.9, 0.95, 0.95], initial={"alpha": 0.3}, step=step, end=end)
    return run.states[:, [0, 2]]


def problem(measured, step=2e-3, **options):
    swing = Experiment("swing", step, measured, np.zeros((1, 1)), initial={"theta": 0.0, "alpha": 0.3})
    return Problem(RIG, (swing,), **{"orders": ORDERS, "initial_state": "held"} | options)


def noise(n, rho, seed):
    """AR(1) of a standard deviation of 3 mrad: lag-one correlation rho."""
    white = np.random.default_rng(seed).standard_normal((n + 500, 2))
    return 3e-3 * np.sqrt(1 - rho**2) * lfilter([1], [1, -rho], white, axis=0)[500:]


def held(cost, rho, seeds=40):
    """In how many of the twins the interval of each order holds the truth: ours, and by σ²(J'J)⁻¹."""
    exact, ours, plain = clean(), np.zeros(2, int), np.zeros(2, int)
    for seed in range(seeds):
        p = problem(exact + noise(len(exact), rho, seed), cost_function=COSTS[cost])
        x = minimise(p.evaluate, least_squares(p.space, None)).best.point
        e, J = np.concatenate(p.errors(x)).ravel(), jacobian(p, x, np.arange(2))[0].reshape(-1, 2)
        naive = np.sqrt(np.var(e) * np.diag(np.linalg.inv(J.T @ J)))
        ours += np.abs(x - TRUE) < 1.96 * uncertainty(p, x).standard_error
        plain += np.abs(x - TRUE) < 1.96 * naive
    return ours, plain


# Of 40 intervals that hold the truth with a probability of 95 %, 35 or fewer do so in 5 % of cases.


@pytest.mark.broad
@pytest.mark.parametrize("cost", ["rmse", "huber"])
def test_white_noise_leaves_the_truth_in_36_of_40_intervals(cost):
    ours, _ = held(cost, rho=0.0)
    assert np.all(ours >= 36)


def drawn(kind, rng, n=4000):
    """Errors with a known density at their median, 0."""
    if kind == "uniform":
        return rng.uniform(-0.5, 0.5, n)
    normal = rng.standard_normal(n) / math.sqrt(2 * math.pi)
    if kind == "outliers":
        normal[::25] += 12 * rng.choice([-1, 1], normal[::25].size)
    return normal if kind != "rounded" else np.round(normal / 0.5 + 0.2) * 0.5


@pytest.mark.parametrize(("kind", "density"), [("normal", 1.0), ("uniform", 1.0), ("outliers", 0.96), ("rounded", 1.0)])
def test_the_interval_of_a_median_is_wide_by_the_density_of_its_own_recording_there(kind, density):
    def still(t, x, u, p, out):
        out[0] = 0.0

    model = Model("level", still, ("x",), ("q",), {"x": 0}, (), (), "", "")
    scales, rng = np.array([1.0, 7.0]), np.random.default_rng(1)
    errors = [scale * drawn(kind, rng)[:, None] for scale in scales]
    own = {"initial": {"x": Free(0.0, -9.0, 9.0)}, "units": {"x": "m"}}
    levels = tuple(Experiment(f"{k}", 1e-2, e, np.zeros((1, 0)), **own) for k, e in enumerate(errors))
    p = Problem(model, levels, {"q": 1.0}, outputs=("x",), cost_function=COSTS["iae"])
    found = uncertainty(p, np.array([np.median(e) for e in errors])).standard_error
    np.testing.assert_allclose(found, scales / (2 * density * math.sqrt(4000)), rtol=0.12)


@pytest.mark.parametrize("digits", [1e-10, 1e-9, 4e-9])
def test_a_product_is_seen_to_be_one_whatever_a_run_rounds(digits):
    def fading(t, x, u, p, out):
        out[0] = -p[0] * p[1] * x[0] + p[2] * (12345678.9 * p[0] % 1.0) * x[0] ** 2

    rows = {"a": 2.0, "b": 0.3, "digits": digits}
    rates = tuple(Parameter(n, "1/s", v, n) for n, v in rows.items())
    model = Model("fading", fading, ("x",), ("q",), {"x": 0}, (), rates, "", "")
    t = np.arange(0, 5, 0.02)
    noisy = np.exp(-0.6 * t) + 1e-3 * np.random.default_rng(1).standard_normal(len(t))
    e = Experiment("e", 0.02, noisy[:, None], np.zeros((1, 0)), initial={"x": 1.0}, units={"x": "m"})
    free = {"a": Free(2.0, 0.1, 9.0), "b": Free(0.3, 0.01, 9.0)}
    p = Problem(model, (e,), {"q": 1.0}, free, outputs=("x",), initial_state="held")
    assert uncertainty(p, p.start).confounded == (("a", "b"),)


@pytest.mark.broad
def test_correlated_noise_leaves_the_truth_in_36_of_40_intervals_where_plain_least_squares_fails():
    ours, plain = held("rmse", rho=0.9)
    assert np.all(ours >= 36)
    assert np.all(plain < 25)


@pytest.mark.broad
def test_intervals_are_sensible_under_itae_too():
    ours, _ = held("itae", rho=0.0)
    assert np.all(ours >= 35)


@pytest.mark.broad
@pytest.mark.parametrize("seed", [4, 6, 9])
def test_an_order_by_itae_of_a_rounded_swing_has_the_truth_on_either_side_of_its_value(seed, tmp_path):
    rng, counts, t = np.random.default_rng([seed, 2711]), math.radians(360 / 4096), np.arange(0, 10.001, 0.02)
    g, b, angle = 60 * rng.uniform(0.8, 1.2), rng.uniform(0.15, 0.4), math.radians(rng.uniform(8, 14))
    swing = solve_ivp(lambda t, x: [x[1], -g * np.sin(x[0]) - b * x[1]], (0, 10), [angle, 0.0], t_eval=t, rtol=1e-10)
    rounded = np.round((swing.y[0] + rng.uniform(-0.5, 0.5) * counts) / counts) * counts
    np.savetxt(tmp_path / "swing.csv", np.column_stack([t, rounded]), header="t,a", delimiter=",", comments="")
    text = """[model]
    name = "swing"
    [model.equations]
    a = {equals = "rate", unit = "rad"}
    rate = {equals = "-g*sin(a) - b*rate", unit = "rad/s", order = "mu"}
    [model.orders]
    mu = {start = 1.0, lower = 0.7, upper = 1.3}
    [model.parameters]
    g = {start = 50.0, lower = 10.0, upper = 200.0, unit = "1/s^2"}
    b = {start = 0.3, lower = 0.0, upper = 5.0, unit = "1/s"}
    [[recording]]
    file = "swing.csv"
    a = {column = "a", unit = "rad"}
    initial = {a = {start = 0.2, lower = -1.0, upper = 1.0}}
    [fit]
    cost = "itae"
    """
    (tmp_path / "swing.toml").write_text(text)
    mu = fracid.identify(fracid.load_project(tmp_path / "swing.toml")).orders["mu"]
    low, high = mu.interval95
    assert low < min(1.0, mu.value)
    assert max(1.0, mu.value) < high


@pytest.mark.broad
def test_an_interval_is_as_wide_as_the_scatter_of_its_estimate():
    exact = clean()
    found, widths = [], []
    for seed in range(60):
        p = problem(exact + noise(len(exact), 0.0, 100 + seed))
        x = minimise(p.evaluate, least_squares(p.space, None)).best.point
        found.append(x)
        widths.append(uncertainty(p, x).standard_error)
    assert np.mean(widths, axis=0) == pytest.approx(np.std(found, axis=0), rel=0.3)


def test_two_recordings_give_a_narrower_interval_by_the_root_of_two():
    exact = clean()
    e = problem(exact + noise(len(exact), 0.0, 1)).experiments[0]
    f = replace(e, name="again", measured=exact + noise(len(exact), 0.0, 2))
    one, two = problem(e.measured), replace(problem(e.measured), experiments=(e, f))
    ratio = uncertainty(one, TRUE).standard_error / uncertainty(two, TRUE).standard_error
    assert ratio == pytest.approx(np.sqrt(2), rel=0.15)


def test_jobs_do_not_change_a_bit():
    p = problem(clean() + noise(2001, 0.5, 3))
    one, three = uncertainty(p, TRUE, jobs=1), uncertainty(p, TRUE, jobs=3)
    assert np.array_equal(one.standard_error, three.standard_error)


# --- what cannot be known ----------------------------------------------------------------------------

LUMPED = ("C1", "C3", "C4", "C6", "J_theta", "b_theta", "b_alpha")


def free(*names):
    return {n: Free(v := RIG.parameter(n).value, v / 10, 10 * v) for n in names}


def test_a_free_response_knows_only_ratios_and_names_all_that_are_confounded():
    p = problem(clean() + noise(2001, 0.0, 1), orders={"lambda": 0.9, "mu": 0.95}, parameters=free(*LUMPED))
    found = uncertainty(p, p.start)
    assert found.confounded == (LUMPED,)
    assert np.all(np.isnan(found.standard_error))
    assert found.interval(p.start, 0) is None


def test_one_known_constant_makes_the_others_known():
    p = problem(clean() + noise(2001, 0.0, 1), orders={"lambda": 0.9, "mu": 0.95},
                parameters={n: v for n, v in free(*LUMPED).items() if n != "C4"})  # fmt: skip
    found = uncertainty(p, p.start)
    assert found.confounded == ()
    assert np.all(found.standard_error > 0)


def test_two_unseen_directions_are_named_apart():
    # without dry friction the slip speed does nothing; the ratios remain another direction
    p = problem(clean() + noise(2001, 0.0, 1), orders={"lambda": 0.9, "mu": 0.95},
                parameters={"slip_speed": Free(0.02, 0.01, 0.1), **free(*LUMPED)})  # fmt: skip
    assert sorted(uncertainty(p, p.start).confounded) == [LUMPED, ("slip_speed",)]


def test_two_dampings_of_which_one_is_at_zero_are_confounded():
    model = Equations({"x": Equation("-(d1 + d2)*x")}).model("decay", [Parameter(n, "", 0.1, "") for n in ("d1", "d2")])
    measured = np.exp(-0.3 * np.arange(200.0) / 20)[:, None]
    decay = Experiment("decay", 0.05, measured, np.zeros((1, 0)), initial={"x": 1.0})
    ranges = {"d1": Free(0.1, 0.0, 0.25), "d2": Free(0.3, 0.0, 5.0)}
    p = Problem(model, (decay,), {}, ranges, initial_state="held")
    assert uncertainty(p, np.array([0.0, 0.3])).confounded == (("d1", "d2"),)


def test_what_lies_at_its_bound_has_an_interval_that_begins_there():
    p = problem(clean() + noise(2001, 0.0, 1), orders={"lambda": Free(0.9, 0.5, 0.9), "mu": ORDERS["mu"]})
    found = uncertainty(p, p.start)
    assert found.at_bound.tolist() == [True, False]
    low, high = found.interval(p.start, 0)
    assert low < high == 0.9
    both = problem(clean(), orders={"lambda": Free(0.9, 0.5, 0.9), "mu": Free(0.95, 0.95, 1.2)})
    assert np.all(uncertainty(both, both.start).at_bound)


def test_a_value_that_the_data_tell_from_its_bound_is_not_at_it_however_wide_its_range():
    near = {"lambda": Free(0.9, 0.5, 0.9 + 1e-5), "mu": ORDERS["mu"]}  # 1e-5 is a tenth of its standard error
    p = problem(clean() + noise(2001, 0.0, 1), orders=near)
    assert at_bound(p, p.start).tolist() == [False, False]
    dry = Free(1e-12, 0.0, 1.0)  # far nearer to 0 than the data can tell
    q = problem(clean() + noise(2001, 0.0, 1), parameters={"coulomb_alpha": dry})
    assert at_bound(q, q.start).tolist() == [name == "coulomb_alpha" for name in q.names]


def test_intervals_hold_with_what_lies_at_a_bound_free():
    """Those of a problem whose bound is far away, cut at the bound's side of the valley."""
    viscous = RIG.parameter("b_alpha").value
    data = clean() + noise(2001, 0.0, 1)
    free = problem(data, parameters={"b_alpha": Free(viscous, -1.0, 10.0)})
    best = settled(free, free.start).x
    value = float(best[free.names.index("b_alpha")])
    above, below = (problem(data, parameters={"b_alpha": bound}) for bound in (
        Free(value, value, 10.0), Free(value, -1.0, value)))  # fmt: skip
    whole, *halves = (uncertainty(p, best) for p in (free, above, below))
    i = free.names.index("mu")
    assert [h.at_bound[free.names.index("b_alpha")] for h in (whole, *halves)] == [False, True, True]
    low, high = whole.interval(best, i)
    ends = np.array([h.interval(best, i) for h in halves])
    assert (ends[:, 0].min(), ends[:, 1].max()) == pytest.approx((low, high), abs=0.02 * (high - low))


@pytest.mark.broad
def test_null_directions_are_looked_for_with_every_column_in():
    """Two constants of which the data know the product, one of them at its bound."""
    data = clean() + noise(2001, 0.0, 1)
    p = problem(data, orders={"lambda": 0.9, "mu": 0.95}, parameters=free(*LUMPED))
    at = RIG.parameter("b_alpha").value
    q = replace(p, parameters={**p.parameters, "b_alpha": Free(at, at, 10.0)})
    assert uncertainty(q, q.start).confounded == uncertainty(p, p.start).confounded
    assert len(uncertainty(q, q.start).confounded[0]) == len(LUMPED)


def test_there_is_a_sentence_where_there_is_no_interval():
    own = Cost("own", function=lambda time, residual: float(np.max(np.abs(residual))))
    failure = uncertainty(problem(clean(), cost_function=own), TRUE)
    assert (failure.reason, str(failure)) == (
        FailureReason.OWN_COST,
        "own is a user's own cost, of unknown loss",
    )
    fixed = problem(clean(), orders={"lambda": 0.9, "mu": 0.95})
    assert uncertainty(fixed, np.empty(0)) == Failure(FailureReason.NOTHING_FREE, "nothing is free")
    broken = problem(clean(), parameters={"C3": 0.1})
    failure = uncertainty(broken, TRUE)
    assert failure.reason is FailureReason.RUN
    assert "det M = 0" in str(failure)


def test_an_interval_is_1_96_standard_errors_to_each_side():
    p = problem(clean() + noise(2001, 0.0, 1))
    x = settled(p, TRUE).x
    found = uncertainty(p, x)
    for i, se in enumerate(found.standard_error):
        assert found.interval(x, i) == pytest.approx((x[i] - 1.96 * se, x[i] + 1.96 * se), abs=0.01 * se)


# --- its parts ---------------------------------------------------------------------------------------


def test_the_jacobian_is_the_derivative_of_the_errors_also_beside_a_bound():
    p = problem(clean(), orders={"lambda": Free(0.9, 0.5, 0.9), "mu": ORDERS["mu"]})
    x = p.start - [1e-12, 0.0]  # as close to the bound as a search may end
    h = 1e-6
    wanted = (p.errors(x + h * np.eye(2)[1])[0] - p.errors(x - h * np.eye(2)[1])[0]) / (2 * h)
    found = jacobian(p, x, np.arange(2))[0]
    assert found.shape == (2001, 2, 2)
    assert found[..., 1] == pytest.approx(wanted, rel=1e-5, abs=1e-6 * np.max(np.abs(wanted)))


@given(
    scores=st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=2, max_size=30),
    bandwidth=st.integers(0, 12),
)
@settings(max_examples=30, deadline=None)
def test_the_long_run_covariance_is_bartletts_sum(scores, bandwidth):
    s = np.array(scores)
    wanted = s.T @ s
    for k in range(1, min(bandwidth, len(s) - 1) + 1):
        lagged = s[:-k].T @ s[k:]
        wanted = wanted + (1 - k / (bandwidth + 1)) * (lagged + lagged.T)
    found = bartlett_long_run(s, bandwidth)
    assert found == pytest.approx(wanted, abs=1e-12)
    assert np.all(np.linalg.eigvalsh(found) > -1e-12)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, 0.97])
def test_the_bandwidth_is_five_correlation_times(rho):
    scores = noise(20_000, rho, 1)
    assert sokal_bandwidth(scores) == pytest.approx(5 * (1 + rho) / (1 - rho), rel=0.25)


def test_the_bandwidth_sees_a_slow_error_under_a_fast_one():
    both = noise(20_000, 0.98, 1) + noise(20_000, 0.0, 2)
    assert sokal_bandwidth(both) > 150


# --- both covariances ----------------------------------------------------------------------------------


def test_the_white_one_takes_samples_for_independent_and_each_output_for_as_noisy_as_it_is():
    p = problem(clean() + noise(2001, 0.5, 3) * [1.0, 7.0])
    found, J = uncertainty(p, TRUE), jacobian(p, TRUE, np.arange(2))[0]
    bread = np.linalg.inv(np.einsum("toi,toj->ij", J, J))
    S = np.einsum("o,toi,toj->ij", np.mean(p.errors(TRUE)[0] ** 2, axis=0), J, J)
    assert found.white == pytest.approx(np.sqrt(np.diag(bread @ S @ bread)), rel=1e-9)
    assert found.standard_error == pytest.approx(np.sqrt(np.diag(found.covariance)))


@pytest.mark.parametrize(("rho", "share"), [(0.0, 1.0), (0.5, 1 / 3), (0.9, 1 / 19)])
def test_of_ar1_samples_one_in_1_plus_rho_over_1_minus_rho_counts(rho, share):
    # for a slope that changes as slowly as the noise is long; the pendulum's swings are nearly so
    p = problem(clean() + noise(2001, rho, 3))
    counted = uncertainty(p, TRUE).effective_samples / 2001
    assert np.all(counted > 0.5 * share)
    assert np.all(counted < 2.5 * share)


def test_each_method_has_its_interval_and_its_sentence():
    found = uncertainty(problem(clean() + noise(2001, 0.9, 3)), TRUE)
    wide, narrow = found.interval(TRUE, 0), found.interval(TRUE, 0, "white")
    assert wide[1] - wide[0] > 2 * (narrow[1] - narrow[0])
    assert set(METHODS) == {"sandwich", "white", "walk", "profile", "bootstrap"}


def test_unseen_directions_are_relative_changes():
    p = problem(clean() + noise(2001, 0.0, 1), orders={"lambda": 0.9, "mu": 0.95}, parameters=free(*LUMPED))
    (direction,) = uncertainty(p, p.start).unseen
    assert direction == pytest.approx(direction[0] * np.ones(7), abs=1e-2)  # all scale together
    assert np.max(np.abs(direction)) == 1.0


def test_outputs_that_count_by_their_noise_give_the_weighted_covariance():
    rough = noise(2001, 0.0, 3) * [1.0, 10.0]
    p = replace(problem(clean() + rough), weights="noise")
    J = jacobian(p, TRUE, np.arange(2))[0]
    sigma = np.sqrt(np.mean(p.errors(TRUE)[0] ** 2, axis=0))
    whole = (J / sigma[:, None]).reshape(-1, 2)
    assert uncertainty(p, TRUE).white == pytest.approx(np.sqrt(np.diag(np.linalg.inv(whole.T @ whole))), rel=1e-6)


def two_decays(outputs, recordings):
    """Two parts that have nothing in common; the second is measured in every 20th row."""
    equations = Equations({"x": Equation("-a*x"), "y": Equation("-b*y")})
    model = equations.model("two", [Parameter(n, "", 0.5, "", lower=0.0, upper=5.0) for n in "ab"])
    t, rng = np.arange(0, 6, 0.01), np.random.default_rng(4)
    measured = np.exp(-0.5 * t)[:, None] + 0.05 * rng.standard_normal((recordings, len(t), 2))
    blank = tuple((k + 0.005, k + 0.195) for k in t[::20])
    own = [Experiment(f"run {k}", 0.01, y[:, : len(outputs)], np.zeros((1, 1)), units={"x": "1", "y": "1"},
                      blanks=((), blank)[: len(outputs)]) for k, y in enumerate(measured)]  # fmt: skip
    free = {n: Free(0.5, 0.0, 5.0) for n in "ab"[: len(outputs)]}
    return Problem(model, tuple(own), {}, free, outputs=outputs, initial_state="rest")


@pytest.mark.parametrize("recordings", [1, 3])
def test_an_output_that_is_measured_now_and_then_leaves_the_intervals_of_what_another_tells(recordings, monkeypatch):
    monkeypatch.setattr("fracid.problem.problem.MANY", 2)  # three recordings are blocks of their own
    alone, both = (two_decays(outputs, recordings) for outputs in (("x",), ("x", "y")))
    assert np.count_nonzero(both.scored[0], axis=0).tolist() == [600, 30]
    assert (both.blocks is None) == (recordings == 1)
    widths = [dict(zip(p.names, np.ptp(uncertainty(p, p.start).ends, axis=1), strict=True)) for p in (alone, both)]
    assert {n: widths[1][n] for n in alone.names} == pytest.approx(widths[0], rel=1e-6)


def test_a_prior_narrows_an_interval_as_one_more_measurement_does():
    orders = {"lambda": Free(0.9, 0.5, 1.2), "mu": 0.95}
    p = problem(clean() + noise(2001, 0.0, 3), orders=orders)
    alone = uncertainty(p, p.start).white[0]
    known = Free(0.9, 0.5, 1.2, prior=Prior(0.9, alone))
    both = uncertainty(replace(p, orders=orders | {"lambda": known}), p.start)
    assert both.white[0] == pytest.approx(alone / np.sqrt(2), rel=1e-2)
    assert both.standard_error[0] < 0.8 * uncertainty(p, p.start).standard_error[0]


# --- few samples ---------------------------------------------------------------------------------------


def widened(rows, inverse, bandwidth):
    """Where all recordings share all unknowns."""
    shared = Blocks(np.full(len(inverse), -1), np.cumsum([0, *map(len, rows)]))
    bread = Bread(inverse, np.eye(len(inverse)), np.empty((0, len(inverse))))
    return widening(shared, rows, bread, [(np.ones(1, bool), bandwidth)])


def means(n, rho, seeds=2000):
    """Of AR(1) records with mean 0: their mean, its standard error as it comes, and by what that is to be widened."""
    rng, rows = np.random.default_rng(1), [np.ones((n, 1, 1))]
    found = []
    for white in rng.standard_normal((seeds, n + 200, 1)):
        y = lfilter([1], [1, -rho], white, axis=0)[200:]
        scores = y - y.mean()
        B = sokal_bandwidth(scores)
        error = np.sqrt(bartlett_long_run(scores, B)[0, 0]) / n
        found.append((y.mean(), error, widened(rows, np.array([[1 / n]]), B)[0]))
    return np.array(found).T


@pytest.mark.broad
@pytest.mark.parametrize(("n", "rho"), [(80, 0.5), (200, 0.8), (400, 0.9)])
def test_a_mean_of_few_samples_lies_in_its_widened_interval_and_not_in_the_plain_one(n, rho):
    mean, error, wider = means(n, rho)
    assert np.mean(np.abs(mean) < 1.96 * error) < 0.89
    assert 0.915 < np.mean(np.abs(mean) < 1.96 * wider * error) < 0.97


@pytest.mark.parametrize("n", [5, 10, 100])
def test_white_samples_widen_as_students_t_does(n):
    # s²/n knows n - 1 degrees of freedom, of which a fit of the mean took one: f = 1/n, ν = n
    wider = widened([np.ones((n, 1, 1))], np.array([[1 / n]]), 0.0)[0]
    assert wider == pytest.approx(student.ppf(0.975, n) / 1.96 / np.sqrt(1 - 1 / n), rel=1e-4)
    assert wider == pytest.approx(student.ppf(0.975, n - 1) / 1.96 / np.sqrt(1 - 1 / n), rel=0.1)


def test_what_two_recordings_tell_is_widened_less_than_what_one_tells():
    one, two = [np.ones((50, 2, 1))], [np.ones((50, 2, 1))] * 2
    assert 1 < widened(two, np.array([[1 / 200]]), 5.0)[0] < widened(one, np.array([[1 / 100]]), 5.0)[0]


def test_samples_that_do_not_count_widen_nothing():
    rows, inverse = np.concatenate([np.ones((40, 1, 1)), np.zeros((400, 1, 1))]), np.array([[1 / 40]])
    assert widened([rows], inverse, 3.0) == pytest.approx(widened([rows[:40]], inverse, 3.0))


def test_an_interval_has_an_end_beside_columns_that_are_nearly_one_too():
    rng = np.random.default_rng(870)
    n = rng.integers(2, 6)
    R = rng.standard_normal((n + 1, n)) * 10.0 ** rng.uniform(-3, 3, n)
    R[:, 1] = R[:, 0] * (1 + 1e-9 * rng.standard_normal()) + 10.0 ** rng.uniform(-14, -8) * rng.standard_normal(n + 1)
    y = 10.0 ** rng.uniform(0, 6) * rng.standard_normal(n + 1)
    low = np.where(rng.uniform(size=n) < 0.5, -(10.0 ** rng.uniform(-6, 1, n)), -np.inf)
    high = np.where(rng.uniform(size=n) < 0.5, 10.0 ** rng.uniform(-6, 1, n), np.inf)
    least = lowest(R, y, low, high)
    y, low, high = y + R @ least, low - least, high - least
    for i in range(n):  # rounding alone exceeds so small a rise
        for side in (-1, 1):
            far, _ = reach(R, y, low, high, i, side, 1e-6 * float(y @ y))
            assert 0 <= far <= (high[i] if side > 0 else -low[i])


@pytest.mark.broad
def test_the_end_of_an_order_in_a_bent_valley_is_where_a_refit_by_scipy_says(tmp_path, monkeypatch):
    """A release from 10° leaves inertias and friction in a valley that the derivatives of the minimum do not follow."""
    rig, rng = fracid.rotary_pendulum("qube-servo2"), np.random.default_rng(9)
    run = fracid.simulate(rig, orders={"mu": 0.95}, initial={"alpha": np.radians(10)}, step=1e-3, end=8.0)
    seen = np.degrees(run.states[::8, [0, 2]]) + 0.05 * rng.standard_normal((1001, 2))
    seen = np.round(seen / 360 * 2048) * 360 / 2048
    table = np.column_stack([run.time[::8], seen])
    monkeypatch.chdir(tmp_path)
    np.savetxt("r.csv", table, "%.6f", ",", header="time [s],theta [deg],alpha [deg]", comments="")
    Path("p.toml").write_text(fracid.draft_project("r.csv", rig="qube-servo2").text, encoding="utf-8")
    fit = fracid.identify(fracid.load_project("p.toml"))
    p, known = fit.problem, fit.uncertainty
    i, (low, high) = p.names.index("mu"), fit.orders["mu"].interval95
    others, size = np.arange(len(fit.x)) != i, np.maximum(np.abs(fit.x), 1e-3)

    def least(mu):
        """V with all others refitted."""
        bounds = [b[others] for b in (p.space.lower, p.space.upper)]
        refit = scipy.optimize.least_squares(lambda x: p.evaluate(np.insert(x, i, mu)).residuals, fit.x[others],
                                             bounds=bounds, x_scale=size[others])  # fmt: skip
        return 2 * refit.cost

    assert low < 0.95 < high
    height = math.sqrt((least(low) - least(fit.x[i])) / known.rise[i, 0])  # not the root of what is below 0
    assert height == pytest.approx(1, abs=0.25)  # a seventh, and what bumps of the cost leave above its least


def test_an_interval_reaches_as_far_as_points_below_its_limit_whether_or_not_their_ground_was_found(monkeypatch):
    """As where a stiffness grows and the rest of its spring leaves a bound: no derivative leads there in time."""
    line = Equations({"x": Equation("1")}, {"y": Equation("tanh(gain)*x", unit="1")}).model(
        "line", [Parameter("gain", "", 1.5, "")]
    )
    y = np.linspace(0, 1, 101) * np.tanh(1.5) + 0.3 * np.random.default_rng(1).standard_normal(101)
    e = Experiment("line", 0.01, y[:, None], np.zeros((1, 0)), initial={"x": 0.0})
    p = Problem(line, (e,), {}, {"gain": Free(1.5, -5.0, 9.0)}, initial_state="held")
    here = settled(p, p.start)
    known = uncertainty(p, here.x, near=here)
    expected = interval_walk.walked(here, known)
    monkeypatch.setattr(interval_walk, "EXACT", -1.0)  # so that no ground is low enough
    found = interval_walk.walked(here, known)
    assert found.ends[0, 1] == expected.ends[0, 1] > known.ends[0, 1] + 0.05
