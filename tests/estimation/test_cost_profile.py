"""Profiles: where the cost is a parabola they are the sandwich's, and where it is not they say what the data know."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import fracid
from fracid.errors import InputError
from fracid.estimation import cost_profile
from fracid.estimation.cost_profile import profile
from fracid.estimation.covariance import uncertainty
from fracid.estimation.profile_walk import End, refit
from fracid.models import Model, Parameter
from fracid.problem import Experiment, Free, Problem
from fracid.problem.costs import COSTS, Cost

RIG = fracid.rotary_pendulum("srv02-rotpen")
ORDERS = {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)}


def noise(n, rho, seed, sd=3e-3, outputs=2):
    """AR(1), lag-one correlation rho."""
    white = np.random.default_rng(seed).standard_normal((n + 500, outputs))
    return sd * np.sqrt(1 - rho**2) * lfilter([1], [1, -rho], white, axis=0)[500:]


def pendulum(rig=RIG, alpha=0.3, rho=0.0, seed=1, end=2.0, sd=3e-3, **options):
    """A twin of orders 0.9 and 0.95, released at alpha."""
    run = fracid.simulate(rig, orders=[0.9, 0.9, 0.95, 0.95], initial={"alpha": alpha}, step=5e-3, end=end)
    measured = run.states[:, [0, 2]] + noise(len(run.time), rho, seed, sd)
    swing = Experiment("swing", 5e-3, measured, np.zeros((1, 1)), initial={"theta": 0.0, "alpha": alpha})
    return Problem(rig, (swing,), **{"orders": ORDERS, "initial_state": "held"} | options)


def ramp_rhs(t, x, u, p, out):
    out[0] = p[0] + p[1] * t


def rising_rhs(t, x, u, p, out):
    out[0] = 1.0 - np.exp(-p[0])


def cliff_rhs(t, x, u, p, out):
    out[0] = p[0] if p[0] <= 2.0 else 1e9


LINE = Model(
    name="line", zero="", source="a test", states=("y",), orders=("q",), outputs={"y": 0}, inputs=(), rhs=ramp_rhs,
    parameters=(Parameter("a", "rad/s", 1.0, "slope at 0"), Parameter("b", "rad/s^2", 0.0, "change of the slope")),
)  # fmt: skip
"""y' = a + b t from 0: linear in its parameters, so that V is a parabola exactly."""

SATURATED = replace(LINE, name="saturated", rhs=rising_rhs, parameters=(Parameter("a", "", 1.0, "rate"),))
"""y' = 1 - exp(-a): beyond some a nothing changes."""

CLIFF = replace(SATURATED, name="cliff", rhs=cliff_rhs)
"""y' = a up to 2, and beyond it no run reaches its end."""


def line(model=LINE, value=None, rho=0.0, seed=1, sd=0.1, n=401, free=None, cost="rmse"):
    t = np.arange(n) * 0.01
    exact = t + 0.25 * t**2 if value is None else value * t
    swing = Experiment("line", 0.01, exact[:, None] + noise(n, rho, seed, sd, 1), np.zeros((1, 0)), initial={"y": 0.0})
    free = free or {"a": Free(1.0, -9.0, 9.0), "b": Free(0.0, -9.0, 9.0)}
    return Problem(model, (swing,), {"q": 1.0}, free, outputs=("y",), initial_state="held", cost_function=COSTS[cost])


# --- where the cost is a parabola --------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize("cost", ["rmse", "ise", "itse", "huber"])
@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_the_profile_of_a_linear_problem_is_the_sandwichs_parabola(cost, rho):
    p = line(rho=rho, cost=cost, sd=3e-3)
    found = profile(p, parameters=["a", "b"])
    known = uncertainty(p, found.x)
    for i, name in enumerate("ab"):
        q = found.profiles[name]
        assert q.verdict == q.sentence == "two-sided"
        assert q.two_sided == pytest.approx(known.interval(found.x, i), rel=1e-6)
        assert q.wald95 == pytest.approx(known.interval(found.x, i), rel=1e-6)
        assert q.rise == pytest.approx(((q.values - q.best) / known.standard_error[i]) ** 2, abs=1e-3)


def test_correlated_noise_widens_a_profile_by_the_root_of_n_over_n_eff():
    p = line(rho=0.9, sd=3e-3)
    found = profile(p, parameters=["a"])
    known = uncertainty(p, found.x)
    low, high = found.profiles["a"].two_sided
    n_eff = known.effective_samples[0]
    assert n_eff < 401 / 5
    assert (high - low) / 2 == pytest.approx(1.96 * known.white[0] * known.widening[0] * np.sqrt(401 / n_eff), rel=1e-4)


def test_all_others_follow_along_the_profile_as_least_squares_has_them():
    p = line()
    q = profile(p, parameters=["a"]).profiles["a"]
    t = p.experiments[0].time
    for a, b in q.points:
        assert b == pytest.approx(np.sum((p.experiments[0].measured[:, 0] - a * t) * t**2) / np.sum(t**4 / 2), rel=1e-5)


def test_the_joint_profile_of_a_linear_problem_is_the_sandwichs_ellipse():
    p = line(rho=0.8, sd=3e-3)
    found = profile(p, parameters=["a"], joint=("a", "b"), points=12)
    joint, C = found.joint, uncertainty(p, found.x).covariance
    delta = np.stack(np.meshgrid(joint.first, joint.second, indexing="ij"), axis=-1) - np.array(joint.best)
    wanted = np.einsum("...i,ij,...j", delta, np.linalg.inv(C), delta)
    assert joint.rise == pytest.approx(wanted, rel=1e-4, abs=1e-4)
    assert joint.correlation == pytest.approx(C[0, 1] / np.sqrt(C[0, 0] * C[1, 1]))
    inside, rim = joint.rise < 5.99, np.ones_like(joint.rise, bool)
    rim[1:-1, 1:-1] = False
    assert inside.sum() > 5
    assert not np.any(inside & rim)


# --- coverage and costs ------------------------------------------------------------------------------


@pytest.mark.broad
@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_the_truth_is_in_32_of_36_intervals(rho):
    # with a probability of 95 % each, 31 or fewer are so in 3 % of cases
    inside = 0
    for seed in range(36):
        low, high = profile(line(rho=rho, seed=seed), parameters=["a"], points=5).profiles["a"].two_sided
        inside += low < 1.0 < high
    assert inside >= 32


@pytest.mark.few(1)
@pytest.mark.parametrize("cost", ["rmse", "huber", "iae", "itae"])
def test_a_pendulums_profile_agrees_with_the_sandwich_under_every_cost(cost):
    # the threshold of |e| rests on a density at 0, a profile on all of its rise: they agree to some 10 %
    q = profile(pendulum(cost_function=COSTS[cost]), parameters=["mu"], points=8).profiles["mu"]
    tolerance = 0.02 if cost in ("rmse", "huber") else 0.25
    assert np.ptp(q.two_sided) == pytest.approx(np.ptp(q.wald95), rel=tolerance)
    assert q.interval95[0] < q.best < q.interval95[1]


@pytest.mark.broad
def test_a_users_own_cost_has_a_profile_and_no_threshold():
    own = Cost("worst", function=lambda time, residual: float(np.max(np.abs(residual))))
    found = profile(pendulum(cost_function=own, end=1.0), parameters=["mu"], points=4)
    q = found.profiles["mu"]
    assert q.verdict == "no threshold"
    assert q.interval95 == (None, None)
    assert q.cost[-1] > 1.5 * found.cost
    assert "is a user's own, of unknown loss: there is no threshold" in found.notes[0]
    assert found.to_json()["threshold"] is None


# --- what is no parabola -----------------------------------------------------------------------------


def test_a_value_that_the_data_bound_from_below_only_is_one_sided():
    p = line(SATURATED, value=1.0, free={"a": Free(4.0, 0.1, 50.0)}, sd=0.5)
    q = profile(p).profiles["a"]
    assert q.verdict == "one-sided"
    assert q.ends == (End.CROSSED, End.BOUND)
    assert q.sentence == "one-sided: above it ends at its bound before the cost reaches the 95 % limit"
    assert q.interval95[0] > 1.0
    assert q.interval95[1] is None
    assert q.two_sided is None


@pytest.mark.broad
def test_a_ratio_alone_leaves_each_of_its_parts_flat():
    names = ("C1", "C3", "C4", "C6", "J_theta", "b_theta", "b_alpha")
    free = {n: Free(v := RIG.parameter(n).value, v / 100, 100 * v) for n in names} | {
        "C4": Free(v := RIG.parameter("C4").value, v / 10, 10 * v)
    }
    p = pendulum(orders={"lambda": 0.9, "mu": 0.95}, parameters=free)
    found = profile(p, p.start, parameters=["C4"], points=6).profiles["C4"]
    assert found.verdict == "flat"
    assert found.wald95 is None
    assert found.values[[0, -1]] == pytest.approx([found.best / 10, found.best * 10], rel=0.2)
    one_known = replace(p, parameters={n: v for n, v in free.items() if n != "C1"})
    assert profile(one_known, parameters=["C4"], points=6).profiles["C4"].verdict == "two-sided"


@pytest.mark.broad
def test_the_order_of_a_clamped_arm_is_flat():
    clamped = fracid.rotary_pendulum("stepper-freeswing")
    found = profile(pendulum(clamped), points=6).profiles
    assert (found["lambda"].verdict, found["mu"].verdict) == ("flat", "two-sided")
    assert found["lambda"].interval95 == (None, None)


def test_friction_that_is_not_there_hits_its_bound_and_is_bounded_from_above():
    p = pendulum(orders={"lambda": 0.9, "mu": 0.95}, parameters={"coulomb_theta": Free(1e-4, 0.0, 0.1)})
    q = profile(p, parameters=["coulomb_theta"]).profiles["coulomb_theta"]
    assert q.verdict == "hits a bound"
    assert q.best == pytest.approx(0.0, abs=1e-5)
    assert q.interval95[0] is None
    assert 0 < q.interval95[1] < 1e-3


def test_runs_that_fail_end_a_profile_and_say_so():
    p = line(CLIFF, value=1.0, free={"a": Free(1.0, -9.0, 9.0)}, sd=60.0)
    q = profile(p).profiles["a"]
    assert q.verdict == "one-sided"
    assert q.ends == (End.CROSSED, End.FAILED)
    assert q.sentence == "one-sided: above the runs fail before the cost reaches the 95 % limit"
    assert 1.9 < q.values[-1] <= 2.0


# --- the start, the options --------------------------------------------------------------------------


def test_a_start_off_the_minimum_is_refined_first():
    p = line()
    assert profile(p, np.array([5.0, -3.0]), parameters=["a"]).x == pytest.approx(refit(p, p.start).point, abs=1e-6)


def test_a_minimum_is_left_alone_where_nothing_is_gained():
    clamped = pendulum(fracid.rotary_pendulum("stepper-freeswing"))
    mu = refit(clamped, clamped.start, fixed=[0]).point[1]
    assert profile(clamped, np.array([0.77, mu]), points=4).x[0] == 0.77


def test_a_lower_point_on_the_way_becomes_the_minimum_and_is_told(monkeypatch):
    module = cost_profile
    honest = module._minimum
    calls = []

    def stuck(problem, x, at, jobs):  # the first time the search stops short
        calls.append(x)
        short = problem.evaluate(np.array([1.2, 0.9]))
        return module.Surface(problem, short, jobs) if len(calls) == 1 else honest(problem, x, at, jobs)

    monkeypatch.setattr(module, "_minimum", stuck)
    p = line()
    found = profile(p, parameters=["a"])
    assert found.x == pytest.approx(refit(p, p.start).point, abs=1e-6)
    assert "lower cost than the minimum" in found.notes[0]
    assert found.profiles["a"].rise.min() > -0.01


@pytest.mark.broad
def test_jobs_do_not_change_a_bit():
    p = pendulum()
    one, three = (profile(p, points=5, joint=("lambda", "mu"), jobs=jobs).to_json() for jobs in (1, 3))
    assert one == three


@pytest.mark.broad
def test_more_points_are_more_and_agree():
    p = line()
    few, many = (profile(p, parameters=["a"], points=n).profiles["a"] for n in (6, 24))
    assert len(many.values) > 3 * len(few.values)
    assert many.two_sided == pytest.approx(few.two_sided, rel=1e-6)
    assert np.all(np.diff(many.values) > 0)


def test_the_orders_are_profiled_where_nothing_is_named_and_else_what_all_share():
    assert list(profile(pendulum(), points=4).profiles) == ["lambda", "mu"]
    assert list(profile(line(), points=4).profiles) == ["a", "b"]


def test_a_fit_is_profiled_at_its_own_minimum():
    p = line()
    fit = fracid.identify(p)
    found = profile(fit, parameters=["b"])
    assert found.x == pytest.approx(fit.x)
    record = found.to_json()["profiles"]["b"]
    assert record["method"] == "profile likelihood, its threshold scaled by the sandwich"
    assert record["interval95"] == pytest.approx(list(found.profiles["b"].two_sided))
    assert len(record["values"]) == len(record["rise"]) == len(record["cost"])


@pytest.mark.parametrize(("options", "words"), [
    ({"parameters": ["b_alpa"]}, "unknown name 'b_alpa'"),
    ({"parameters": ["b_alpha"]}, r"b_alpha is not free, so it has no profile; free it with b_alpha = \{ start"),
    ({"joint": ("mu", "mu")}, "expected two different names, such as mu and b_alpha"),
    ({"joint": ("mu", "zeta")}, "'zeta'"),
    ({"points": 3}, "points = 3; expected a whole number, 4 or more"),
    ({"jobs": 0}, "jobs = 0; expected a whole number, 1 or more"),
])  # fmt: skip
def test_what_cannot_be_profiled_is_told(options, words):
    with pytest.raises(InputError, match=words):
        profile(pendulum(end=0.5), **options)


def test_nothing_free_and_nothing_that_runs_is_told():
    with pytest.raises(InputError, match="Nothing is free"):
        profile(pendulum(orders={"lambda": 0.9, "mu": 0.95}))
    with pytest.raises(InputError, match=r"nothing to profile: no run from the start reached its end: .*det M = 0"):
        profile(pendulum(end=0.5, parameters={"C3": 0.1}))


# --- the figure ------------------------------------------------------------------------------------------


def test_the_figure_has_a_panel_for_each_profile_and_one_for_the_two_together():
    from fracid.plots import profiles

    figure = profiles(profile(line(), points=5, joint=("a", "b")))
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:2] == ["two-sided", "two-sided"]
    assert titles[2].startswith("together; correlation −0.9")
    assert figure.axes[0].get_xlabel() == "a [°/s]"
    shown = {line.get_label() for line in figure.axes[0].get_lines()}
    assert {"profile", "95 % threshold, 3.84", "parabola of the sandwich", "best"} <= shown


@pytest.mark.broad
def test_a_flat_profile_is_drawn_without_a_parabola_and_a_users_cost_without_a_threshold():
    from fracid.plots import profiles

    flat = pendulum(fracid.rotary_pendulum("stepper-freeswing"), orders={"lambda": ORDERS["lambda"], "mu": 0.95})
    own = Cost("worst", function=lambda time, residual: float(np.max(np.abs(residual))))
    shown = [
        {line.get_label() for line in profiles(profile(p, p.start, points=4)).axes[0].get_lines()}
        for p in (flat, replace(line(), cost_function=own))
    ]
    assert "95 % threshold, 3.84" in shown[0]
    assert "95 % threshold, 3.84" not in shown[1]
    assert "parabola of the sandwich" not in shown[1]


def test_no_profile_is_no_figure():
    from fracid.plots import profiles

    with pytest.raises(InputError, match="no profile to draw"):
        profiles(replace(profile(line(), points=4), profiles={}))
