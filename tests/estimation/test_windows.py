"""A rig that stands upright, or tumbles, is fitted in windows: which samples, which unknowns, which answer."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fracid
from fracid.errors import InputError
from fracid.estimation.covariance import half_width, uncertainty
from fracid.estimation.drift import drift_of
from fracid.estimation.horizons import Watch, refined
from fracid.estimation.windows import (
    PARTS,
    beginning,
    chosen_window,
    closes_a_loop,
    in_parts,
    lengthened,
    piece,
    prediction,
    prediction_of,
    windowed,
)
from fracid.problem import Experiment, Free, Problem
from fracid.problem.costs import COSTS
from fracid.quantiles import NORMAL_95
from fracid.validation.discretisation import Discretisation
from fracid.workflows.profiles import run_profiles

pytestmark = pytest.mark.usefixtures("without_rivals")

STEP, SPAN = 0.01, 20.0
TRUTH = {"gravity": 0.147, "J": 3e-3, "b_angle": 2e-3, "coulomb_angle": 2e-3}
COUNT = 2 * math.pi / 4096


def balanced(seed, end=SPAN, drift=0.0):
    """Angle and held torque of a rod that a controller with noise of its own keeps upright, shape (n_samples,)."""
    rng, t = np.random.default_rng(seed), np.arange(0, end + STEP / 2, STEP)
    angle, rate, seen, torque = 0.02, 0.0, np.zeros(len(t)), np.zeros(len(t))
    for k in range(len(t)):
        seen[k] = COUNT * round((angle + 1e-3 * rng.standard_normal()) / COUNT)
        aim = 0.1 * np.sign(np.sin(2 * np.pi * t[k] / 3.7))
        torque[k] = -0.4 * (angle - aim) - 0.03 * rate + 0.01 * rng.standard_normal()
        dry = TRUTH["coulomb_angle"] * (1 + drift * (t[k] - end / 2) / 60)
        for _ in range(10):  # Heun's method
            h, slopes = STEP / 10, []
            for a, v in ((angle, rate), (0.0, 0.0)):
                a, v = (a, v) if not slopes else (angle + h * slopes[0][0], rate + h * slopes[0][1])
                friction = TRUTH["b_angle"] * v + dry * np.tanh(v / 0.02)
                slopes.append((v, (torque[k] + TRUTH["gravity"] * np.sin(a) - friction) / TRUTH["J"]))
            angle, rate = (x + h * (s + e) / 2 for x, s, e in zip((angle, rate), *slopes, strict=True))
    return seen, torque


def upright(measured, torque, **changes):
    e = fracid.Experiment("stand", STEP, measured[:, None], torque[:, None], between={"torque": "hold"})
    values = {n: Free(1.3 * TRUTH[n], TRUTH[n] / 20, TRUTH[n] * 20) for n in ("J", "b_angle", "coulomb_angle")}
    return fracid.Problem(
        fracid.model("pendulum", zero="upright"), (e,), {"mu": 1.0}, values, initial_state="estimate", **changes
    )


@pytest.fixture(scope="module")
def stand():
    return upright(*balanced(1))


def test_a_rod_that_stands_is_predicted_for_a_time_and_one_that_hangs_to_the_end(stand):
    Λ = (TRUTH["gravity"] / TRUTH["J"]) ** 0.5  # of what grows, without friction
    found = prediction(stand, stand.start)
    assert math.log(10) / Λ < found.window < 4 * math.log(10) / Λ
    assert found.window < found.seconds < SPAN
    hangs = replace(stand, model=fracid.model("pendulum", zero="hanging"))
    assert math.isinf(prediction(hangs, hangs.start).seconds)
    assert chosen_window(hangs) is None
    assert chosen_window(stand) == PARTS * found.window


def test_an_arm_that_sticks_while_its_pendulum_swings_asks_for_no_windows():
    rig = fracid.rotary_pendulum("srv02-rotpen", coulomb_theta=0.06, slip_speed=2e-3)
    run = fracid.simulate(rig, orders={"lambda": 1, "mu": 1}, initial={"alpha": 0.7}, step=4e-3, end=8.0)
    seen = run.states[:, [0, 2]] + 1e-3 * np.random.default_rng(1).standard_normal((len(run.time), 2))
    stuck = fracid.Experiment("stuck", 4e-3, seen, np.zeros((1, 1)))
    problem = fracid.Problem(rig, (stuck,), {"lambda": 1.0, "mu": 1.0})
    assert prediction(problem, problem.start).window == math.inf


@pytest.mark.parametrize(("step", "samples"), [(1e-4, 200), (5e-8, 60), (0.1, 4)])
def test_a_record_that_is_shorter_than_the_slopes_of_a_pendulum_is_predicted_without_a_warning(step, samples):
    wobble = 0.03 * np.sin(np.arange(samples) / 9)[:, None] * [1, 1]
    short = fracid.Experiment("short", step, wobble, np.zeros((1, 1)))
    problem = fracid.Problem(fracid.rotary_pendulum("srv02-rotpen"), (short,), {"lambda": 1.0, "mu": 1.0})
    assert prediction(problem, problem.start).window == math.inf


@pytest.mark.broad
def test_jitter_of_an_angle_hardly_makes_windows_shorter():
    """A quick angle beside a wide one is no pace at which the wide one starts."""
    t, noise = np.arange(0, 20, STEP), np.random.default_rng(5).standard_normal(2000)

    def window(alpha):
        seen = np.column_stack([0.25 * np.sin(0.9 * t), alpha])
        e = fracid.Experiment("held", STEP, seen, np.sin(t)[:, None])
        rig = fracid.rotary_pendulum("qube-servo2", zero="upright")
        problem = fracid.Problem(rig, (e,), {"lambda": 1.0, "mu": 1.0})
        return prediction(problem, problem.start).window

    jitter = 0.002 * np.sin(5 * t) + 0.003 * np.sin(80 * t) + 3e-3 * noise
    assert window(jitter) > 0.7 * window(0.02 * np.sin(5 * t))


def test_the_steps_of_a_window_are_fine_unless_they_are_fixed(stand):
    assert beginning(stand, 0.6).substeps == 8
    assert beginning(stand, 0.6, fixed_step=True).substeps == 1
    assert beginning(replace(stand, substeps=16), 0.6).substeps == 16
    assert beginning(stand, 12.0).substeps == 1
    assert beginning(stand, 0.05).substeps == 16  # a window has 36 samples, however few seconds it is asked for


def test_windows_hold_every_sample_once_and_share_all_but_their_starts(stand):
    e, pieces = stand.experiments[0], windowed(stand, 1.0)
    np.testing.assert_array_equal(np.concatenate([w.measured for w in pieces.experiments]), e.measured)
    assert [*pieces.recordings] == ["stand"]
    assert sum(u.experiment is None for u in pieces.unknowns) == 3
    assert {u.target for u in pieces.unknowns if u.experiment} == {"angle", "rate"}
    outputs = pieces.followed(pieces.start, "stand")
    alone = np.concatenate([pieces.fitted(pieces.start, w) for w in pieces.experiments])
    np.testing.assert_array_equal(outputs, alone)


def test_what_a_recording_has_for_itself_is_one_value_for_all_its_windows(stand):
    values = {**stand.parameters, "angle_rest": Free(0.0, -0.1, 0.1)}
    pieces = windowed(replace(stand, parameters=values, per_recording=("angle_rest",)), 1.0)
    assert [u.name for u in pieces.unknowns if u.target == "angle_rest"] == ["angle_rest [stand]"]
    k = pieces.names.index("angle_rest [stand]")
    moved = pieces.start + 0.05 * np.eye(len(pieces.start))[k]
    for w in pieces.experiments:
        assert np.abs(pieces.fitted(moved, w) - pieces.fitted(pieces.start, w)).max() > 1e-4, w.name


def test_each_recording_is_predicted_with_what_it_has_for_itself(stand):
    """Of two rods one has next to no weight: only the other falls, whichever recording it is of."""
    e = stand.experiments[0]
    both = replace(stand, parameters={**TRUTH, "gravity": Free(0.147, 0.0, 1.0)}, per_recording=("gravity",))
    pieces = windowed(replace(both, experiments=(e, replace(e, name="other"))), 1.0)
    found = {}
    for heavy in ("stand", "other", "none"):
        x = pieces.point({f"gravity [{name}]": 0.147 if name == heavy else 0.0 for name in ("stand", "other")})
        found[heavy] = prediction_of(pieces, x, 1.0)
    assert math.isfinite(found["stand"].seconds)
    assert found["stand"] == found["other"]
    assert math.isinf(found["none"].seconds)


def test_recordings_that_are_held_before_their_release_begin_in_motion_in_windows(stand):
    released = replace(stand.experiments[0], release_time=Free(0.0, -0.05, 0.05))
    held = replace(stand, experiments=(released,), initial_state="rest", parameters=TRUTH)
    pieces = windowed(held, 1.0)
    alone = pieces.with_shared(pieces.start, (released,))
    assert not any(u.kind == "time" for u in (*pieces.unknowns, *alone.unknowns))
    assert math.isfinite(prediction_of(pieces, pieces.start, 1.0).seconds)
    assert pieces.of(released).experiments[0].release_time == 0.0


def test_windows_with_a_past_have_states_that_relax_or_follow_others():
    rig = fracid.rotary_pendulum("srv02-rotpen", presliding_alpha=0.01, arm_stiffness=100.0)
    run = fracid.simulate(rig, orders={"lambda": 0.95, "mu": 1}, initial={"theta": 0.1, "arm": 0.1, "alpha": 0.5},
                          step=4e-3, end=4.0)  # fmt: skip
    swing = fracid.Experiment("swing", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    problem = fracid.Problem(rig, (swing,), {"lambda": 0.95, "mu": 1.0}, initial_state="estimate")
    pieces = windowed(problem, 1.0)
    assert {"z_alpha", "arm"} < pieces.told
    assert all(np.isfinite(pieces.errors(pieces.start)[k]).all() for k in range(len(pieces.experiments)))


@pytest.mark.parametrize(("limit", "most", "count"), [("MOST", 4, 4), ("LONG", 650, 6)])
def test_windows_that_are_too_many_lie_apart_and_what_lies_between_counts_in_none(
    stand, monkeypatch, limit, most, count
):
    monkeypatch.setattr(f"fracid.estimation.windows.{limit}", most)
    pieces = windowed(stand, 1.0)
    assert len(pieces.experiments) == count
    whole, _ = pieces.recordings["stand"]
    inside = np.zeros(len(whole.measured), bool)
    for w in pieces.experiments:
        first = round((w.start - whole.start) / STEP)
        inside[first : first + len(w.measured)] = True
    np.testing.assert_array_equal(np.isnan(pieces.followed(pieces.start, "stand")[:, 0]), ~inside)
    np.testing.assert_array_equal(whole.scored, inside[:, None])
    assert math.isfinite(prediction_of(pieces, pieces.start, 1.0).seconds)  # of all samples, what no window has too
    assert len(windowed(stand, 4.5).experiments) == len(windowed(stand, 1.9).experiments) == 4


def test_orders_that_are_no_integers_give_each_window_the_samples_before_it(stand):
    pieces = windowed(replace(stand, orders={"mu": Free(1.0, 0.6, 1.2)}), 1.0)
    assert [w.past is None for w in pieces.experiments][:2] == [True, False]
    np.testing.assert_array_equal(
        pieces.experiments[1].past, stand.experiments[0].measured[: len(pieces.experiments[1].past)]
    )
    assert all(w.past is None for w in windowed(stand, 1.0).experiments)
    assert beginning(replace(stand, orders={"mu": Free(0.9, 0.6, 1.2)}), 1.0).orders == {"mu": 0.9}


def test_the_search_on_windows_begins_where_that_on_their_parts_ends(stand):
    parts, whole = beginning(stand, 1.5), windowed(stand, 1.5)
    x = np.arange(1.0, 1 + len(parts.unknowns))
    x[:3] = [0.5 * (u.range.start + u.range.upper) for u in parts.unknowns[:3]]
    at = lengthened(parts, x, whole)
    assert at[:3].tolist() == x[:3].tolist()
    bound = np.append(parts.unknowns[0].range.lower, x[1:])
    assert lengthened(parts, bound, whole)[0] == parts.unknowns[0].range.start  # a sharp friction has no derivative
    own = {u.name: v for u, v in zip(parts.unknowns, x, strict=True)}
    for k, w in enumerate(whole.experiments):
        first = at[whole.names.index(f"angle(0) [{w.name}]")]
        assert first == own[f"angle(0) [stand, window {PARTS * k + 1}]"]


def test_windows_of_two_recordings_begin_each_where_its_own_parts_end(stand):
    """Both start at 0: a window of the one is no window of the other."""
    two = replace(stand, experiments=(*stand.experiments, replace(stand.experiments[0], name="again")))
    parts, whole = beginning(two, 1.5), windowed(two, 1.5)
    at = lengthened(parts, np.arange(1.0, 1 + len(parts.unknowns)), whole)
    starts = [v for u, v in zip(whole.unknowns, at, strict=True) if u.kind == "initial"]
    assert len({*starts}) == len(starts)


def test_a_piece_of_uneven_samples_has_its_own_times_inputs_and_deviations():
    times = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, 99)) * 0.01
    times, grid = times - times[0], np.arange(1200) * 1e-3
    sd, measured, inputs = times[:, None] + 1, np.cos(times)[:, None], grid[:, None] ** 2
    e = Experiment("uneven", 1e-3, measured, inputs, times=times, deviation=sd)
    part = piece(e, "part", 40, 80)
    assert part.time == pytest.approx(times[40:80] - times[40])
    assert part.start == pytest.approx(times[40])
    assert np.array_equal(part.measured, e.measured[40:80])
    assert np.array_equal(part.deviation, e.deviation[40:80])
    at = times[40] + 1e-3 * np.arange(len(part.inputs))
    assert part.inputs[:, 0] == pytest.approx(at**2, abs=1e-6)
    assert at[-2] < times[79] <= at[-1] + 1e-9


@pytest.mark.parametrize("seconds", [0, -1.0, 1e-9, math.inf, math.nan, "long", True])
def test_a_length_of_windows_that_is_none_is_refused(stand, seconds):
    with pytest.raises(InputError, match=r'expected ("auto", "none", or the seconds of a window|a number or a text)'):
        chosen_window(replace(stand, windows=seconds))


def test_windows_are_refused_where_nothing_says_how_one_begins(stand):
    two = fracid.model("two-mass")
    e = fracid.Experiment("two", STEP, np.zeros((200, 1)), np.zeros((1, len(two.inputs))))
    problem = fracid.Problem(two, (e,), {"lambda": 1.0, "mu": 1.0}, outputs=("motor",))
    assert chosen_window(problem) is None
    with pytest.raises(InputError, match='Type windows = "none"'):
        chosen_window(replace(problem, windows=1.0))


DOUBLE = """
[model]
name = "double-pendulum"
[model.definitions]
c = "cos(a - b)"
s = "sin(a - b)"
r1 = "-h*s*v*v - 0.9*sin(a) - 2e-3*w - 6e-4*(w - v)"
r2 = "h*s*w*w - 0.22*sin(b) - 6e-4*(v - w)"
[model.equations]
a = { equals = "w", unit = "rad" }
w = "(6e-3*r1 - h*c*r2)/(1.2e-4 - h*h*c*c)"
b = { equals = "v", unit = "rad" }
v = "(0.02*r2 - h*c*r1)/(1.2e-4 - h*h*c*c)"
[model.parameters]
h = { start = 5e-3, lower = 0.0, upper = 1e-2 }
[[recording]]
file = "double.csv"
time = 0
a = { column = 1, unit = "rad" }
b = { column = 2, unit = "rad" }
"""


def double_pendulum(t, x):
    a, w, b, v = x
    c, s, h = math.cos(a - b), math.sin(a - b), 5e-3
    r1 = -h * s * v * v - 0.9 * math.sin(a) - 2e-3 * w - 6e-4 * (w - v)
    r2 = h * s * w * w - 0.22 * math.sin(b) - 6e-4 * (v - w)
    both = 1.2e-4 - (h * c) ** 2
    return [w, (6e-3 * r1 - h * c * r2) / both, v, (0.02 * r2 - h * c * r1) / both]


@pytest.mark.parametrize(("release", "tumbles"), [(2.4, True), (0.4, False)])
def test_what_tumbles_before_it_dies_asks_for_windows_and_what_only_dies_does_not(tmp_path, release, tumbles):
    """Its start is lost in the first five seconds of twenty, though most places of the record are tame."""
    t = np.arange(0, 20, 0.01)
    run = solve_ivp(double_pendulum, (0, 20), [release, 0, release + 0.3, 0], t_eval=t, rtol=1e-9, atol=1e-10)
    seen = COUNT * np.round(run.y[[0, 2]].T / COUNT)
    np.savetxt(tmp_path / "double.csv", np.column_stack([t, seen]), delimiter=",", header="t,a,b", comments="")
    (tmp_path / "double.toml").write_text(DOUBLE)
    problem = fracid.load_project(tmp_path / "double.toml").problem
    assert (chosen_window(problem) is not None) == tumbles


def test_a_false_minimum_in_which_starts_are_lost_within_some_samples_asks_for_no_windows(stand):
    """A hundredth of a thousandth of the rod falls as a stiff contact parts: no window of it is worth its starts."""
    light = replace(stand, parameters={**TRUTH, "J": 1e-6})
    assert math.isfinite(prediction(light, light.start).seconds)
    assert chosen_window(light) is None


def test_windows_are_asked_for_at_the_minimum_where_a_start_that_is_far_off_shows_no_need_of_them():
    """Of no gravity nothing falls, and the whole record leads to no constant of a rod that stands."""
    stands = upright(*balanced(1, end=8.0))
    light = replace(stands, parameters={**stands.parameters, "gravity": Free(0.0, 0.0, 1.0), "J": TRUTH["J"]})
    assert chosen_window(light) is None
    fit = fracid.identify(light, jobs=2)
    assert fit.window is not None
    low, high = fit.parameters["gravity"].interval95
    assert low < TRUTH["gravity"] < high
    assert high - low < 0.2 * TRUTH["gravity"]


def test_a_torque_that_a_controller_makes_closes_a_loop_and_one_that_is_played_does_not():
    torque = np.repeat(np.random.default_rng(1).standard_normal((200, 1)), 10, axis=0)
    run = fracid.simulate(fracid.model("pendulum", **TRUTH), initial={}, step=STEP, end=19.99, inputs=0.1 * torque,
                          between="hold")  # fmt: skip
    angle = run.states[:, :1] + 1e-3 * np.random.default_rng(2).standard_normal((2000, 1))
    assert not closes_a_loop(fracid.Experiment("played", STEP, angle, torque))
    made = 1e-2 * np.random.default_rng(3).standard_normal((2000, 1)) - 20 * angle
    assert closes_a_loop(fracid.Experiment("held", STEP, angle, made))


@pytest.mark.broad
@pytest.mark.parametrize("drift", [0.0, 1.5])
def test_friction_that_changes_while_a_rod_stands_is_said_with_its_rate(drift):
    problem = windowed(upright(*balanced(1, 3 * SPAN, drift)), 0.5)
    x = [TRUTH.get(u.target, v) for u, v in zip(problem.unknowns, problem.start.tolist(), strict=True)]
    found = drift_of(problem, refined(problem, np.array(x), Watch()).best.point)
    if not drift:
        assert found is None
    else:
        assert found.name == "coulomb_angle"
        assert found.rate == pytest.approx(drift, abs=1.5 * found.half)
        assert found.half < drift / 3


@pytest.mark.broad
def test_a_rod_that_stands_is_identified_and_the_answer_improves_with_the_record():
    held, widths = [], []
    for seed, end in ((1, SPAN / 2), (3, 2 * SPAN)):
        fit = fracid.identify(upright(*balanced(seed, end)), fixed_step=False)
        assert fit.window is not None
        assert any("No simulation follows stand for longer than" in w for w in fit.warnings)
        assert len(fit.recordings["stand"].time) == round(end / STEP) + 1
        for n in ("J", "b_angle", "coulomb_angle"):
            low, high = fit.parameters[n].interval95
            held.append(low <= TRUTH[n] <= high)
        widths.append((high - low) / TRUTH[n])
        assert math.isfinite(prediction_of(fit.problem, fit.x, fit.window).seconds)
    assert sum(held) >= len(held) - 1
    assert 0.8 * widths[0] > widths[1] < 0.1


@pytest.mark.broad
def test_an_interval_allows_for_what_the_step_moves_unless_that_is_little(stand):
    problem = windowed(stand, 0.6)
    x = problem.start
    known = uncertainty(problem, x)
    halves = {n: half_width(known, x, i) for i, n in enumerate(problem.names)}
    check = Discretisation(1.0, 1.0, 1.0, {}, {}, moves={"J": 0.5 * halves["J"], "b_angle": 0.1 * halves["b_angle"]})
    wider = check.widened(problem, x, known)
    grown = {n: half_width(wider, x, i) / halves[n] for i, n in enumerate(problem.names) if n in TRUTH}
    assert grown["J"] == pytest.approx(math.hypot(1.0, 4 / 3 * 0.5 * NORMAL_95), rel=0.05)
    assert grown["b_angle"] == grown["coulomb_angle"] == 1.0


@pytest.mark.parametrize("cost", ["iae", "ise", "itae", "itse"])
def test_the_cost_of_a_residual_is_that_of_its_parts(cost):
    """The weights of a part go on where those of the one before it end."""
    swing = Experiment("swing", 1e-2, np.zeros((601, 2)), np.zeros((1, 1)))
    problem = Problem(
        fracid.rotary_pendulum("srv02-rotpen"), (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)},
        {"b_alpha": Free(3e-4, 0.0, 1.0)}, cost_function=COSTS[cost],
    )  # fmt: skip
    parts = in_parts(in_parts(problem, 2, ["b_alpha"]), 2, ["b_alpha"]).experiments
    (whole,), each = (
        [COSTS[cost].value(e.weighed_at, np.ones_like(e.measured)) for e in of] for of in ((swing,), parts)
    )
    assert len(each) == 4
    assert sum(each) == pytest.approx(whole, rel=0.01)  # but for the steps between them


def test_profiles_of_one_recording_in_windows_need_no_spread_over_recordings(tmp_path):
    """There are more windows than recordings: it ended in the error of a spread that nobody had asked for."""
    seen, torque = balanced(1, end=2.0)
    columns = np.column_stack([STEP * np.arange(len(seen)), seen, torque])
    np.savetxt(tmp_path / "stand.csv", columns, delimiter=",", header="t,angle,torque", comments="")
    (tmp_path / "stand.toml").write_text(f"""
[model]
name = "pendulum"
zero = "upright"
[model.orders]
mu = 1.0
[model.parameters]
gravity = {TRUTH["gravity"]}
coulomb_angle = {TRUTH["coulomb_angle"]}
b_angle = {TRUTH["b_angle"]}
J = {{ start = 4e-3, lower = 1e-3, upper = 1e-2 }}
[[recording]]
file = "stand.csv"
time = "t"
angle = {{ column = "angle", unit = "rad" }}
torque = {{ column = "torque", unit = "N m", between = "hold" }}
[fit]
windows = 0.5
substeps = 4
""")
    fracid.run(tmp_path / "stand.toml", out=tmp_path / "run")
    found = run_profiles(tmp_path / "run", points=5)
    assert found.profiles.profiles["J"].interval95 is not None
