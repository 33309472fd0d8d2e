"""What the data can tell of each unknown, in words; the cost over the plane of the orders."""

import re
from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.errors import Failure, FailureReason, InputError
from fracid.estimation.cost_plane import CostPlane, cost_plane
from fracid.estimation.cost_profile import profile
from fracid.estimation.covariance import uncertainty
from fracid.estimation.minimum import settled
from fracid.estimation.parameter_verdicts import _halved, _halved_angles, _View, identifiability, widest
from fracid.estimation.profile_walk import refit
from fracid.estimation.records import Estimate
from fracid.models import Model, Parameter
from fracid.models.joints import presliding
from fracid.models.written.equations import Equation, Equations
from fracid.problem import Experiment, Free, Problem
from fracid.report.sentences import interval
from fracid.units import with_interval
from twins import release

RIG = fracid.rotary_pendulum("srv02-rotpen")
FREE = {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}


def problem(orders=FREE, **options):
    run = fracid.simulate(RIG, orders=[0.9, 0.9, 0.95, 0.95], initial={"alpha": 0.4}, step=5e-3, end=1.0)
    swing = Experiment("swing", 5e-3, run.states[:, [0, 2]], np.zeros((1, 1)), initial={"theta": 0.0, "alpha": 0.4})
    return Problem(RIG, (swing,), orders, initial_state="held", **options)


@pytest.mark.parametrize(
    ("model", "rest", "far"), [("capacitor", "current_rest", 3.0), ("oscillator", "displacement_rest", 0.2)]
)
def test_a_zero_that_may_be_0_is_measured_by_how_far_moves_what_it_is_of(model, rest, far):
    moves = np.linspace(0, 1, 9)[:, None]
    e = Experiment("log", 0.1, 0.2 * moves, 3.0 * moves)
    model = fracid.model(model)
    p = Problem(model, (e,), dict.fromkeys(model.order_names, 1.0), {rest: Free(0.0, -1.0, 1.0)})
    assert widest(p, p.unknowns[0], 0.0) == pytest.approx(0.05 * far)


def test_the_plane_has_the_cost_at_each_of_its_points_and_the_centre_is_one_of_them():
    p = problem()
    plane = cost_plane(p, np.array([0.9, 0.95]), points=7)
    assert plane.names == ("lambda", "mu")
    i, j = np.unravel_index(np.argmin(plane.cost), plane.cost.shape)
    assert (plane.first[i], plane.second[j], plane.cost[i, j]) == (0.9, 0.95, 0.0)
    assert plane.cost[1, 5] == p.cost(np.array([plane.first[1], plane.second[5]]))
    assert (plane.first[0], plane.first[-1]) == (pytest.approx(0.75), pytest.approx(1.05))


@pytest.mark.few(1)
@pytest.mark.parametrize("centre", [(0.5, 1.2), (1.2, 0.5), (1.19, 0.51)])
def test_the_plane_stays_within_the_bounds_and_grows_steadily(centre):
    plane = cost_plane(problem(), np.array(centre), points=9)
    for axis, middle in zip((plane.first, plane.second), centre, strict=True):
        assert len(axis) == 9
        assert middle in axis
        assert np.all(np.diff(axis) > 0)
        assert 0.5 <= axis[0] < axis[-1] <= 1.2


def test_each_order_has_its_own_reach_and_the_points_gather_at_the_minimum():
    orders = {"lambda": Estimate(0.9, standard_error=0.02), "mu": Estimate(0.95, standard_error=0.004)}
    plane = cost_plane(
        problem(), np.array([0.9, 0.95]), points=9, orders=orders
    )  # of a cost that rises from 0: 3 errors
    assert np.ptp(plane.first) == pytest.approx(6 * 0.02)
    assert np.ptp(plane.second) == pytest.approx(6 * 0.004)
    widths = np.diff(plane.first)
    assert widths[3] == widths.min() < 0.5 * widths[0]


def test_other_unknowns_stay_where_they_are_and_jobs_change_nothing():
    p = problem(parameters={"C1": Free(4e-3, 1e-3, 1e-2)})
    x = np.array([0.9, 0.95, 5e-3])
    one, three = (cost_plane(p, x, points=3, jobs=jobs) for jobs in (1, 3))
    assert np.array_equal(one.cost, three.cost)
    assert one.cost[1, 1] == p.cost(x)


def test_a_cliff_beside_a_narrow_valley_makes_no_minimum_that_is_not_there():
    def cost(first, second):
        across = second - 0.03 * first
        return np.sqrt(1 + (first / 0.05) ** 2 + (across / 0.001) ** 2 * np.where(across > 0.025, 21, 1))

    gathered = np.sign(np.linspace(-1, 1, 15)) * np.abs(np.linspace(-1, 1, 15)) ** 1.6
    first, second = 0.1 * gathered, 0.05 * gathered
    fine = CostPlane(("lambda", "mu"), first, second, cost(first[:, None], second)).refined()
    truth = cost(fine.first[:, None], fine.second)
    assert np.abs(fine.cost / truth - 1)[truth < 5].max() < 0.1


def test_where_a_run_fails_the_plane_is_infinite():
    plane = cost_plane(problem(parameters={"C3": 0.1}), np.array([0.9, 0.95]), points=3)
    assert np.all(np.isinf(plane.cost))


def test_a_plane_needs_two_free_orders():
    with pytest.raises(InputError, match="needs two free orders"):
        cost_plane(problem({"lambda": 0.9, "mu": FREE["mu"]}), np.array([0.95]))


# --- what the data can tell ----------------------------------------------------------------------------

LUMPED = ("C1", "C3", "C4", "C6", "J_theta", "b_theta", "b_alpha")
ORDERS = {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)}
FIXED = {"lambda": 0.9, "mu": 0.95}


def twin(rig=RIG, alpha=0.5, outputs=("theta", "alpha"), sd=1e-3, **options):
    """A release of orders 0.9 and 0.95 with white noise."""
    swing = release("swing", rig, alpha=alpha, step=5e-3, end=4.0, outputs=outputs, noise=sd)
    return Problem(rig, (swing,), **{"orders": FIXED, "outputs": outputs, "initial_state": "held"} | options)


def free(*names):
    return {n: Free(v := RIG.parameter(n).value, v / 10, 10 * v) for n in names}


def verdicts(p, **options):
    """At the minimum, or x."""
    x = options.pop("x", None)
    return identifiability(p, settled(p, refit(p, p.start).point).x if x is None else x, **options)


def test_a_full_release_with_one_constant_known_identifies_all_others_and_both_orders():
    found = verdicts(twin(alpha=1.2, orders=ORDERS, parameters=free(*(n for n in LUMPED if n != "C4"))))
    assert {v.sentence for v in found.values()} == {"identifiable"}
    assert len(found) == 8


def test_a_free_response_knows_ratios_and_names_them():
    found = verdicts(twin(parameters=free(*LUMPED)))
    assert {v.kind for v in found.values()} == {"only in a ratio"}
    assert "with C1: only C4/C1 is identifiable, and so with C3" in found["C4"].reason
    assert all(name in found["C4"].reason for name in LUMPED)


def test_constants_that_work_through_their_product_are_named_as_a_product():
    def product(t, x, u, p, out):
        out[0] = p[0] * p[1] * (1.0 - x[0])

    parameters = (Parameter("gain", "", 1.0, "one"), Parameter("rate", "1/s", 1.0, "the other"))
    rig = Model(name="lag", zero="", source="a test", states=("y",), orders=("q",), outputs={"y": 0}, inputs=(),
                rhs=product, parameters=parameters)  # fmt: skip
    y = 1 - np.exp(-np.arange(400) * 0.01) + 1e-3 * np.random.default_rng(1).standard_normal(400)
    step = Experiment("step", 0.01, y[:, None], np.zeros((1, 0)), initial={"y": 0.0})
    both = {"gain": Free(1.0, 0.1, 10.0), "rate": Free(1.0, 0.1, 10.0)}
    found = verdicts(Problem(rig, (step,), {"q": 1.0}, both, outputs=("y",), initial_state="held"))
    assert found["gain"].sentence == "only in a ratio: with rate: only gain·rate is identifiable; fix one of them"


@pytest.mark.few(1)
@pytest.mark.parametrize("profiled", [False, True])
def test_the_order_of_a_clamped_arm_cannot_be_known_and_the_reason_is_that_it_stands_still(profiled):
    p = twin(fracid.rotary_pendulum("stepper-freeswing"), orders=ORDERS)
    profiles = profile(p, points=5).profiles if profiled else None
    found = verdicts(p, profiles=profiles)
    assert found["lambda"].kind == "practically not"
    assert "θ hardly moves" in found["lambda"].reason
    assert "an order shows in motion alone: fix it" in found["lambda"].reason
    assert found["mu"].sentence == "identifiable"
    assert ("its profile is flat from 0.5 to 1.2" in found["lambda"].reason) is profiled


def test_a_score_on_alpha_alone_warns_about_lambda():
    found = verdicts(twin(outputs=("alpha",), orders=ORDERS))
    assert found["lambda"].sentence == "identifiable: through alpha alone; score theta too"
    assert found["mu"].sentence == "identifiable"
    unsure = verdicts(twin(outputs=("alpha",), orders=ORDERS, sd=0.3))
    assert unsure["lambda"].kind == "practically not"
    said = r"its interval is 0\.50 … [\d.]+, wider than ± 0\.1, and ends at its bound"
    assert re.fullmatch(f"{said}; θ is not scored: score it too, or fix λ", unsure["lambda"].reason)


def test_a_small_angle_record_names_the_inertia_term_that_it_cannot_see():
    small, large = (verdicts(twin(alpha=a, parameters=free("C6", "J_theta", "b_alpha"))) for a in (0.05, 0.8))
    assert small["C6"].kind == "practically not"
    assert "its effect scales with amplitude^3.0 (α: " in small["C6"].reason
    assert "record a larger motion" in small["C6"].reason
    assert {n for n, v in small.items() if v.kind == "identifiable"} == {"J_theta", "b_alpha"}
    assert {v.kind for v in large.values()} == {"identifiable"}


def test_a_power_that_no_term_of_a_model_has_gives_no_advice(monkeypatch):
    p = twin(alpha=0.05, parameters=free("C6", "J_theta", "b_alpha"))
    monkeypatch.setattr(_View, "powers", np.full(len(p.names), 23.2))
    small = verdicts(p)
    assert small["C6"].kind == "practically not"
    assert "amplitude" not in small["C6"].reason


@pytest.mark.broad
def test_upright_angles_are_not_halved():
    rig = fracid.rotary_pendulum("srv02-rotpen", zero="upright")
    p = twin(rig, alpha=np.pi - 0.05, parameters={"C6": Free(4e-3, 1e-5, 1e-1)}, sd=0.05)
    found = verdicts(p)["C6"]
    assert "power" not in found.sentence


JOINTS = {
    "a joint that slides tells little of what it gives": (
        1.0, 1e-2, {"coulomb_alpha": 3e-4, "presliding_alpha": 1e-4},
        {"coulomb_alpha": "identifiable", "presliding_alpha": "α slides, and only 0.013 % of its motion is"},
    ),
    "nor of its damping": (
        1.0, 1e-2, {"presliding_alpha": 1e-3, "presliding_damping_alpha": 1e-5},
        {"presliding_damping_alpha": "α slides, and only 0.12 % of its motion is presliding"},
    ),
    "a joint that sticks knows friction over what it gives alone": (
        0.1, 5e-2, {"coulomb_theta": 1.0, "presliding_theta": 0.4},
        {"presliding_theta": "θ hardly breaks away, 100 % of its motion is presliding, which depends only on friction"},
    ),
    "a joint that does both tells both": (
        1.0, 1e-4, {"coulomb_alpha": 3e-4, "presliding_alpha": 1e-2},
        {"coulomb_alpha": "identifiable", "presliding_alpha": "identifiable"},
    ),
    "a springpot of order near 0 is a spring": (
        1.0, 1e-1, {"springpot_theta": 3e-3, "springpot_order_theta": 0.02},
        {"springpot_order_theta": "is indistinguishable from a spring: its order"},
    ),
    "and of order near 1 a dashpot": (
        1.0, 2e-3, {"springpot_theta": 3e-3, "springpot_order_theta": 0.98, "b_theta": 2.4e-3},
        {"springpot_order_theta": "is indistinguishable from a dashpot: its order"},
    ),
    "of another order it is itself": (
        1.0, 1e-3, {"springpot_theta": 3e-3, "springpot_order_theta": 0.5},
        {"springpot_theta": "identifiable", "springpot_order_theta": "identifiable"},
    ),
}  # fmt: skip


@pytest.mark.few(1)
@pytest.mark.parametrize("case", JOINTS)
def test_what_a_motion_does_not_excite_in_a_joint_is_said(case):
    alpha, sd, values, words = JOINTS[case]
    rig = fracid.rotary_pendulum("srv02-rotpen", coulomb_alpha=3e-4).with_parameters(**values)
    swing = release("swing", rig, orders={"lambda": 1.0, "mu": 1.0}, alpha=alpha, step=4e-3, end=4.0, noise=sd)
    within = {n: (0.01, 0.99) if "order" in n else (v / 10, 10 * v) for n, v in values.items()}
    unknown = {n: Free(v, *within[n]) for n, v in values.items()}
    p = Problem(rig, (swing,), {"lambda": 1.0, "mu": 1.0}, unknown, initial_state="held")
    found = verdicts(p, x=p.start)
    for name, sentence in words.items():
        assert sentence in found[name].sentence
        assert found[name].kind == ("identifiable" if sentence == "identifiable" else "practically not")


@pytest.mark.broad
def test_a_presliding_joint_of_ones_own_needs_to_say_nothing_of_itself():
    def rhs(t, x, u, p, out):
        friction = presliding(x, out, 2, x[1], p[0], 0.0, 1.0, p[1])
        out[0], out[1] = x[1], -friction - x[0]

    parameters = (Parameter("f", "N", 0.01, "friction"), Parameter("delta", "m", 1e-4, "what it gives", lower=1e-9))
    own = Model(name="block", zero="", source="a test", states=("q", "v", "z"), orders=("mu", "mu", 1.0),
                outputs={"q": 0}, inputs=(), rhs=rhs, parameters=parameters, relaxing={"z": "delta"})  # fmt: skip
    run = fracid.simulate(own, orders={"mu": 1.0}, initial={"q": 0.1}, step=0.02, end=4.0)
    q = run.states[:, :1] + 0.1 * np.random.default_rng(1).standard_normal((201, 1))
    block = Experiment("block", 0.02, q, np.zeros((1, 0)), initial={"q": 0.1})
    p = Problem(own, (block,), {"mu": 1.0}, {"delta": Free(1e-4, 1e-6, 1e-2)}, outputs=("q",), initial_state="held")
    assert identifiability(p, p.start)["delta"].kind in ("practically not", "not at all")


def test_where_a_presliding_joint_began_is_forgotten_and_spoils_no_others_interval():
    rig = fracid.rotary_pendulum("srv02-rotpen", coulomb_alpha=3e-4, presliding_alpha=1e-3)
    swing = release("swing", rig, orders={"lambda": 1.0, "mu": 1.0}, alpha=0.4, step=4e-3, end=2.0, noise=1e-3)
    p = Problem(
        rig, (replace(swing, initial={"D^mu alpha": 0.0}),), {"lambda": 1.0, "mu": 1.0}, initial_state="estimate"
    )
    x = np.array([{"alpha(0) [swing]": 0.4}.get(name, 0.0) for name in p.names])
    precision = uncertainty(p, x)
    half = dict(zip(p.names, 1.96 * precision.standard_error, strict=True))
    assert half["alpha(0) [swing]"] < 1e-3
    verdict = identifiability(p, x, precision)["z_alpha(0) [swing]"]
    assert verdict.sentence == "forgotten: once the joint has moved by presliding_alpha"


def test_what_does_nothing_is_not_known_at_all():
    rig = RIG.with_parameters(coulomb_theta=0.0)
    p = twin(rig, parameters={"slip_speed": Free(0.02, 0.01, 0.1)})
    found = verdicts(p, x=p.start)
    assert found["slip_speed"].sentence == "not identifiable: nothing that was measured depends on it"


def test_a_spring_that_is_not_there_leaves_its_rest_where_it_began_and_says_that_it_does_nothing():
    cable = {"cable_stiffness": Free(1e-3, 0.0, 0.1), "theta_rest": Free(0.1, -1.0, 1.0)}
    viscous = 1.02 * RIG.parameter("b_theta").value  # more than there is: no room for a spring
    p = twin(parameters=cable | {"b_theta": viscous})
    assert p.names == ("cable_stiffness", "theta_rest")
    assert settled(p, np.array([1e-3, -1.0])).x.tolist() == [0.0, 0.1]
    says = "it does nothing where cable_stiffness is 0, and the interval of cable_stiffness includes 0"
    found = verdicts(p, x=np.array([0.0, -1.0]))["theta_rest"]
    assert found.sentence == f"not identifiable: {says}"
    found = verdicts(p, x=np.array([1e-9, -1.0]))["theta_rest"]
    assert found.sentence == f"practically non-identifiable: its interval is wider than its bounds, −1 … 1; {says}"
    known = uncertainty(p, x := np.array([1e-9, -1.0]))
    short = replace(known, ends=np.vstack([known.ends[0], [-1.0, 0.5]]))  # as where the walk finds the other end
    assert identifiability(p, x, short)["theta_rest"].sentence == f"practically non-identifiable: {says}"


def test_a_bound_is_told_and_with_a_profile_what_the_data_say_beyond():
    viscous = 1.05 * RIG.parameter("b_theta").value  # more than there is: no room for dry friction
    p = twin(parameters={"coulomb_theta": Free(1e-4, 0.0, 0.1), "b_theta": viscous})
    says = verdicts(p)["coulomb_theta"].sentence
    assert says.startswith("at its bound: 0; it is zero within the resolution of the data: remove it")
    found = verdicts(p, profiles=profile(p, parameters=["coulomb_theta"]).profiles)["coulomb_theta"]
    assert found.sentence.startswith("at its bound: 0; its interval is all below ")
    assert found.says.startswith("lies at its bound: 0; its interval is all below ")


def test_two_constants_that_hang_together_closely_are_named_as_a_ratio():
    # gravity over inertia is the frequency; each alone is seen only in what a heavy arm gives way
    p = twin(RIG.with_parameters(J_theta=1.0, b_alpha=0.0), sd=0.03, parameters=free("C1", "C4"))
    wide = verdicts(p, x=p.start)
    assert {v.kind for v in wide.values()} == {"only in a ratio"}
    assert "with C1, nearly: C4/C1 is known to" in wide["C4"].reason
    C1 = p.parameters["C1"].start  # where on the ridge a bound ends it says nothing of the bound
    cut = replace(p, parameters={**p.parameters, "C1": Free(C1, C1, 10 * C1)})
    assert uncertainty(cut, cut.start).at_bound.any()
    found = verdicts(cut, x=cut.start)["C1"]
    assert found.sentence.startswith("only in a ratio: with C4, nearly: C1/C4 is known to")
    assert found.sentence.endswith("fix one of them")


def decay(equation, start, ranges, measured):
    """A problem of one equation that decays from 1, at `start`."""
    model = Equations({"x": Equation(equation)}).model("decay", [Parameter(n, "", v, "") for n, v in start.items()])
    run = Experiment("decay", 0.05, measured[:, None], np.zeros((1, 0)), initial={"x": 1.0})
    return Problem(model, (run,), {}, {n: Free(v, *ranges[n]) for n, v in start.items()}, initial_state="held")


def test_an_interval_that_ends_where_another_parameter_meets_its_bound_is_said_to():
    noise = 1e-2 * np.random.default_rng(1).standard_normal(200)
    measured = np.exp(-0.35 * np.arange(200) / 20) + noise  # V/K alone is known, K from 10 on
    start = {"V": 3.8, "K": 10.0}
    p = decay("-V*x/(K + x)", start, {"V": (0.01, 1e5), "K": (0.1, 10.0)}, measured)
    assert "practically non-identifiable: its interval ends where K meets its bound, 10:" in verdicts(p)["V"].sentence
    wide = decay("-V*x/(K + x)", start, {"V": (0.01, 1e5), "K": (0.1, 1e5)}, measured)
    assert "meets its bound" not in verdicts(wide)["V"].sentence


def test_no_interval_ends_where_a_parameter_that_does_nothing_meets_its_bound():
    cable = {"cable_stiffness": Free(1e-3, 0.0, 0.1), "theta_rest": Free(0.1, -1.0, 1.0)}
    p = twin(parameters={"drag_theta": Free(1e-4, 0.0, 0.1)} | cable | free("b_theta"))
    x = p.point({"cable_stiffness": 0.0, "theta_rest": -1.0, "drag_theta": 0.0})
    known, i, k = uncertainty(p, x), p.names.index("b_theta"), p.names.index("theta_rest")
    ends = known.ends.copy()
    ends[i] = x[i] + 0.3 * (known.ends[i] - x[i])
    stopped = replace(known, ends=ends, stops={(i, 0): {k: -1.0}, (i, 1): {k: -1.0}})
    found = identifiability(p, x, stopped)
    assert found["b_theta"].sentence == "identifiable"
    says = "it does nothing where cable_stiffness is 0"  # and not drag_theta, though that may be 0 too
    assert says in found["theta_rest"].sentence


def mount(order, r, lower):
    """A mass on a spring and on an element of some order, let go."""
    element = {"x": Equation("v"), "v": Equation("-z - 40*x"), "z": Equation("v", order=order)}
    model = Equations(element, {"x": Equation("x")}).model("mount", [])
    run = fracid.simulate(model, orders=model.state_orders({"r": r}), initial={"x": 1.0}, step=0.02, end=4.0)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((201, 1))
    swing = Experiment("mount", 0.02, run.states[:, :1] + noise, np.zeros((1, 0)), initial={"x": 1.0})
    return Problem(model, (swing,), {"r": Free(r, lower, 1.0)}, {}, initial_state="held")


@pytest.mark.parametrize(
    ("order", "r", "lower", "advice"),
    [
        ("r", 1e-3, 1e-3, "no order lies beyond 0: put an element of order 0 in its place, or extend the model"),
        ("1 - r", 1.0, 0.5, "no order lies beyond 1: put an element of order 1 in its place, or extend the model"),
        ("r", 0.3, 0.3, "widen the bound or extend the model"),
    ],
)
def test_a_bound_is_widened_only_where_an_order_may_lie_beyond_it(order, r, lower, advice):
    p = mount(order, r, lower)
    assert verdicts(p, x=p.start)["r"].reason == f"{r:.4g}; {advice}"


def test_an_order_whose_narrow_interval_its_bound_cuts_is_identifiable_up_to_that_bound():
    p = mount("r", 0.02, 0.01995)
    known = uncertainty(p, p.start)
    assert not known.at_bound[0]
    assert known.ends[0, 0] == 0.01995
    says = "its interval ends at its bound, 0.01995, not where the data end it; widen that bound"
    assert identifiability(p, p.start, known)["r"].sentence == f"identifiable: {says}"


@pytest.mark.parametrize(("lower", "upper", "bounds"), [
    (0.0, 5.0, ""), (0.0, 0.5015, "0.5015"), (0.499, 5.0, "0.499"), (0.499, 0.5015, "0.499 and 0.5015"),
])  # fmt: skip
def test_what_a_bound_cuts_of_an_interval_is_told_and_printed_from_end_to_end(lower, upper, bounds):
    measured = np.exp(-0.5 * np.arange(200) / 20) + 1e-2 * np.random.default_rng(3).standard_normal(200)
    fit = fracid.identify(decay("-k*x", {"k": 0.5}, {"k": (lower, upper)}, measured), optimiser="least-squares")
    k, notes = fit.parameters["k"], dict(zip(fit.warning_codes, fit.warnings, strict=True))
    assert (k.identifiable, k.at_bound, k.cut) == ("identifiable", False, bool(bounds))
    assert [k.interval95[0] == lower, k.interval95[1] == upper] == [str(b) in bounds for b in (lower, upper)]
    assert (f"k is identifiable: its interval ends at its bound, {bounds}, not" in notes.get("bounded", "")) == k.cut
    assert ("…" in repr(k), "±" in repr(k)) == (k.cut, not k.cut)
    assert ("…" in interval(k.to_json())) == k.cut


def test_an_interval_as_wide_as_a_scale_that_nothing_shows_is_said_to_be():
    measured = np.exp(-2.0 * np.arange(200) / 20) + 1e-2 * np.random.default_rng(1).standard_normal(200)
    start, ranges = {"R": 1e3, "C": 5e-4, "G": 4e-7}, {"R": (10.0, 1e6), "C": (1e-6, 1e-2), "G": (0.0, 1e-2)}
    p = decay("-x/(R*C) - G*abs(x)*x/C", start, ranges, measured)
    found = verdicts(p, x=p.start)
    assert found["G"].kind == "only in a ratio"
    assert "is for these values of R and C alone, which the data cannot separate" in found["G"].reason
    known = decay("-x/(R*5e-4) - G*abs(x)*x/5e-4", {n: start[n] for n in "RG"}, ranges, measured)
    assert "only in a ratio" not in {v.kind for v in verdicts(known, x=known.start).values()}


def test_a_voltage_at_rest_is_not_halved_with_the_states_and_ends_no_fit():
    cell = Equations({"v": Equation("i/C - v/R")}, {"u": Equation("E + v")}, inputs={"i": "A"})
    model = cell.model("cell", [Parameter(n, "", v, "") for n, v in {"C": 100.0, "R": 1e4, "E": 3.7}.items()])
    current = np.ones((99, 1))
    measured = 3.7 + np.arange(99.0)[:, None] * 1e-2 / 100
    p = Problem(model, (Experiment("cell", 1e-2, measured, current),), {}, {"R": Free(1e4, 1.0, 1e6)})
    assert [*_halved_angles(p, p.start)] == []
    assert identifiability(p, p.start)["R"].kind != "identifiable"


def test_a_verdict_says_the_interval_that_is_printed():
    p = twin(parameters={"b_theta": Free(2e-3, 0.0, 1.0), "coulomb_theta": Free(1e-9, 0.0, 1.0)}, sd=3e-2)
    x = settled(p, refit(p, p.start).point).x
    known = uncertainty(p, x)
    for cut in ((0.2, 3.0), (-3.0, 3.0)):  # in half-widths: other bounds cut it above 0, or not
        ends = known.ends.copy()
        ends[0] = np.clip(x[0] * (1.0 + 0.3 * np.array(cut)), 0.0, None)
        wide = replace(known, ends=ends, standard_error=np.maximum(known.standard_error, abs(x)))
        said = identifiability(p, x, wide)["b_theta"].reason
        assert ("which includes 0" in said) == (ends[0, 0] == 0.0)
        assert not said or with_interval(float(x[0]), *ends[0].tolist()) in said


def test_without_intervals_nothing_is_said_but_why():
    p = twin(orders=ORDERS)
    found = identifiability(p, p.start, Failure(FailureReason.RUN, "a run fails"))
    assert {v.sentence for v in found.values()} == {"unknown: a run fails"}


@pytest.mark.few(1)
@pytest.mark.parametrize("widest", [0.01, 1.0, 100.0])
def test_what_is_known_lies_at_no_bound_however_wide_its_range(widest):
    p = twin(RIG.with_parameters(coulomb_theta=1e-4), parameters={"coulomb_theta": Free(1e-4, 0.0, widest)})
    assert verdicts(p)["coulomb_theta"].sentence == "identifiable"
    profiles = profile(p, parameters=["coulomb_theta"]).profiles
    assert profiles["coulomb_theta"].verdict == "two-sided"
    assert verdicts(p, profiles=profiles)["coulomb_theta"].sentence == "identifiable"


def test_the_speed_at_the_start_is_not_known_from_a_record_far_rougher_than_its_motion():
    run = fracid.simulate(RIG, orders=[0.9, 0.9, 0.95, 0.95], initial={"alpha": 0.4}, step=5e-3, end=0.2)
    rough = 2.0 * np.random.default_rng(1).standard_normal((41, 2))
    starts = {}
    for name, noise in (("smooth", 1e-4 * rough), ("rough", rough)):
        swing = Experiment(name, 5e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)))
        p = Problem(RIG, (swing,), {"lambda": 0.9, "mu": 0.95})
        x = np.array([0.0, 0.0, 0.4, 0.0])
        starts[name] = identifiability(p, x)[f"D^lambda theta(0) [{name}]"].kind
    assert starts == {"smooth": "identifiable", "rough": "practically not"}


def test_half_of_a_small_motion_remembers_half_of_its_past():
    run = fracid.simulate(RIG, orders=[0.8, 0.8, 0.7, 0.7], initial={"alpha": 0.02}, step=5e-3, end=1.0)
    y = run.states[:, [0, 2]]
    p = Problem(RIG, (Experiment("swing", 5e-3, y[60:], np.zeros((1, 1)), past=y[:60]),), {"lambda": 0.8, "mu": 0.7})
    ((smaller, x),) = _halved_angles(p, p.start)
    whole, half = (q.simulator.all_outputs([at], q.experiments[0])[0] for q, at in ((p, p.start), (smaller, x)))
    np.testing.assert_allclose(half, 0.5 * whole, atol=1e-3 * np.ptp(whole))


@pytest.mark.broad
def test_where_half_the_motion_has_another_start_no_power_is_told():
    t, free = 2e-2 * np.arange(100), {"presliding_theta": Free(1e-3, 1e-5, 2e-3)}
    for speed in np.geomspace(1e-4, 1.0, 60):  # the arm slides at once; at half the speed it does not
        e = Experiment("swing", 2e-2, np.column_stack([speed * t, 0.3 * np.cos(5 * t)]), np.zeros((1, 1)))
        p = Problem(RIG, (e,), FREE, {**free, "coulomb_theta": 1e-3})
        if replace(p, experiments=(_halved(e),)).names != p.names:
            assert not list(_halved_angles(p, p.start))
            return
    pytest.fail("no speed begins otherwise than half of it")
