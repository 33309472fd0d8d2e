"""A loop in the solver is the solver's motion, regulators are python-control's, margins are where loops fall."""

import ctypes
import shutil
import subprocess
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.feedback import study
from fracid.feedback.code import c_controller
from fracid.feedback.pid import pid
from fracid.feedback.regulators import Plant, margins, regulator, sampled
from fracid.feedback.swing import law_of
from fracid.models.written.equations import Equation, Equations
from fracid.solver.closed_loop import answers
from fracid.solver.inputs import Driven

HOW = {"posture": "", "at": {}, "input_": None, "rate": None, "delay": None, "off": {}, "within": {}, "seconds": 3.0}


def twin(model=None, outputs=1, orders=None, inputs=None, **more):
    model = model or fracid.model("pendulum", coulomb_angle=1e-3)
    inputs = np.zeros((1, len(model.inputs))) if inputs is None else inputs
    e = fracid.Experiment("twin", 0.01, np.zeros((500, outputs)), inputs, **more)
    return fracid.Problem(model, (e,), orders or {"mu": 0.95}, initial_state="held")


def fit_of(problem):
    return SimpleNamespace(problem=problem, x=problem.start)


def loop_of(problem, **how):
    return study.conditions_of(problem, problem.start, **{**HOW, "limit": 0.3, **how})


def regulated(loop, **plant):
    c = loop.conditions
    return regulator(replace(loop.plant(loop.x), **plant), c.period, np.full(len(c.outputs), 0.5), c.most,
                     np.full(len(c.outputs), 1e-3), 1.0, 0.1)  # fmt: skip


@pytest.fixture(scope="module")
def upright():
    return loop_of(twin(), delay=0.013)


def test_the_motion_of_a_loop_is_that_of_the_solver_under_the_inputs_that_it_gave(upright):
    model = upright.problem.model
    time, y, u = upright.run(upright.x, regulated(upright), 1)
    inputs = np.r_[u[:1], u[:-1]][:, None]
    again = fracid.simulate(model, orders={"mu": 0.95}, initial={"angle": np.pi + 0.1}, step=0.01, end=time[-1],
                            inputs=Driven(inputs, u[:, None]), method="pi2-implicit", corrected=False)  # fmt: skip
    assert np.abs(u).max() > 0.1
    np.testing.assert_allclose(y[:, 0] + np.pi, again.states[:, 0], atol=1e-8)


def test_an_input_acts_after_its_delay(upright):
    _, _, u = upright.run(upright.x, regulated(upright), 1)
    assert u[0] == pytest.approx(0.0, abs=1e-9)  # 13 ms are one step of 10 ms
    assert abs(u[1]) > 0.1


def test_a_regulator_has_the_gains_of_python_control(upright):
    control = pytest.importorskip("control")
    plant = upright.plant(upright.x)
    A, B, C = sampled(plant, 0.01)
    found = regulator(plant, 0.01, np.array([0.5]), 0.3, np.array([1e-3]), 1.0, 0.1)
    K, *_ = control.dlqr(A, B, C.T @ C / 0.25, np.array([[1 / 0.09]]))
    M, *_ = control.dlqe(A, B, C, np.array([[0.03**2]]), np.array([[1e-6]]))
    np.testing.assert_allclose(found.B, M, rtol=1e-6)  # python-control's is the predictor's
    np.testing.assert_allclose(found.C + np.array(found.D) @ C, -K, rtol=1e-6)


def test_a_loop_falls_just_beyond_its_gain_margin():
    loop = loop_of(twin(fracid.model("pendulum")), off={"angle": 1e-4}, seconds=15.0)
    made = regulated(loop)
    gain, _, _ = margins(loop.plant(loop.x), made)
    grown = gain_of(made, 10 ** (0.9 * gain / 20)), gain_of(made, 10 ** (1.1 * gain / 20))
    holds = [loop.trial(loop.x, c, 1)["holds"] for c in grown]
    shrunk = [loop.trial(loop.x, gain_of(made, 10 ** (s * gain / 20)), 1)["holds"] for s in (-0.9, -1.1)]
    assert holds[0]
    assert shrunk[0]
    assert not holds[1] or not shrunk[1]


def gain_of(controller, k):
    """The controller with its output k times as large, its filter as it was."""
    C, D, E = (np.array(m) for m in (controller.C, controller.D, controller.E))
    return replace(controller, C=(k * C).tolist(), D=(k * D).tolist(), E=(E / k).tolist())


def test_the_reduced_model_has_few_states_and_the_response_of_the_fractional_one(upright):
    linear = upright.plant(upright.x).linear
    assert len(linear.A) <= 12
    omega = np.geomspace(3.0, 100.0, 20)
    np.testing.assert_allclose(linear.response(omega), linear.exact_response(omega), rtol=0.1)


def test_a_delay_of_samples_and_a_part_is_that_of_a_finer_grid(upright):
    plant = Plant(upright.plant(upright.x).linear, 0, 0.025)
    A, B, C = sampled(plant, 0.01)
    fine = sampled(replace(plant, delay=0.0), 0.005)
    u, x, z, coarse, grid = np.sin(np.arange(40)), np.zeros(len(A)), np.zeros(len(fine[0])), [], []
    late = np.r_[np.zeros(5), np.repeat(u, 2)]
    for k in range(40):
        coarse.append((C @ x)[0])
        x = A @ x + B[:, 0] * u[k]
    for k in range(80):
        grid.append((fine[2] @ z)[0])
        z = fine[0] @ z + fine[1][:, 0] * late[k]
    np.testing.assert_allclose(coarse, grid[::2], atol=1e-9 * np.abs(grid).max())


@pytest.mark.broad
def test_of_a_rig_that_rests_by_itself_the_controller_that_brings_it_back_is_chosen():
    motion = {"x": Equation("v"), "v": Equation("pull - 40*x - 0.1*v", "q")}
    model = Equations(motion, {"x": Equation("x")}, {"pull": ""}).model("spring", [])
    problem = twin(model, orders={"q": 1.0}, inputs=6 * np.sin(np.arange(500))[:, None])
    found = fracid.control(fit_of(problem), limit=6.0, at={"x": 0.02}, off={"x": 0.05}, draws=1, seconds=3.0)
    least = max(found.tried, key=lambda d: d.distance)
    assert found.design.error < 0.7 * least.error
    assert found.design.distance > 0.5
    assert "holds rest at x = 0.02 in 1 of 1 draws" in found.sentence
    assert f"about {found.conditions.place}" in c_controller(found)


@pytest.mark.broad
def test_presliding_joints_are_held_too():
    joint = fracid.model("joint", gravity=0.1, coulomb_angle=0.02, presliding_angle=0.01)
    torque = np.sin(np.arange(500))[:, None] * (np.arange(len(joint.inputs)) == 0)
    loop = loop_of(twin(joint, orders={"mu": 1.0}, inputs=torque), limit=None, at={"angle": 0.5})
    assert loop.conditions.input == "torque"
    assert loop.conditions.at_rest == pytest.approx(0.1 * np.sin(0.5))
    time, y, _ = loop.run(loop.x, regulated(loop), 1)
    assert time[-1] == pytest.approx(3.0)
    assert np.abs(y[-100:, 0]).max() < 0.05


@pytest.fixture(scope="module")
def found():
    rig = fracid.rotary_pendulum("srv02-rotpen", zero="hanging", coulomb_theta=1e-3)
    volts = 3 * np.sin(0.02 * np.arange(400))[:, None]
    run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 0.95}, initial={"alpha": 0.3}, step=5e-3, end=1.995,
                          inputs=volts)  # fmt: skip
    y = run.states[:, [0, 2]] + 2e-3 * np.random.default_rng(1).standard_normal((400, 2))
    e = fracid.Experiment("twin", 5e-3, y, volts, initial={"alpha": 0.3})
    free = {"C6": fracid.Free(2.2e-3, 1e-4, 1e-2), "b_theta": fracid.Free(1e-3, 0.0, 1.0)}
    problem = fracid.Problem(rig, (e,), {"lambda": 1.0, "mu": 0.95}, free, initial_state="held")
    truth = np.array([rig.parameter(n).value for n in problem.names])
    return fracid.control(SimpleNamespace(problem=problem, x=truth), draws=5, seconds=3.0, within={"theta": 2.0})


def test_a_rig_is_held_upright_over_draws_of_its_covariance(found):
    assert found.conditions.posture == "upright"
    assert found.conditions.states["alpha"] == pytest.approx(np.pi)
    assert len(found.trials) == found.design.draws == 5
    assert found.share == 1.0
    assert found.phase_margin95[0] > 20
    assert set(found.worst) == set(found.loop.problem.names)
    assert len(found.tried) == 6
    assert "holds upright in 5 of 5 draws" in repr(found)


def test_a_draw_rests_where_its_own_model_does_and_the_controller_knows_the_place_of_the_fit():
    rig = fracid.rotary_pendulum("srv02-rotpen", zero="hanging", alpha_rest=0.3)
    problem = twin(rig, 2, {"lambda": 1.0, "mu": 0.95})
    problem = replace(problem, parameters={"alpha_rest": fracid.Free(0.3, -1.0, 1.0)})
    points = np.array([[0.3], [0.32]])
    made = fracid.control(fit_of(problem), limit=8.0, points=points, seconds=3.0)
    assert made.share == 1.0
    assert made.conditions.reference["alpha"] == pytest.approx(np.pi + 0.3)
    _, y, _ = made.loop.run(points[1], made.design.controller, 1)
    assert y[0, 1] == pytest.approx(0.1 + 0.02)
    assert y[-1, 1] == pytest.approx(0.02, abs=0.005)


@pytest.mark.parametrize(("cable", "place"), [(0.0, 0.0), (1e-9, 0.0), (1e-3, -1.0)])
def test_an_arm_is_held_at_its_rest_angle_only_where_a_cable_pulls_it_there(cable, place):
    rig = fracid.rotary_pendulum("qube-servo2", zero="hanging", cable_stiffness=cable, theta_rest=-1.0)
    loop = loop_of(twin(rig, 2, {"lambda": 1.0, "mu": 1.0}))
    assert loop.conditions.reference == pytest.approx({"theta": place, "alpha": np.pi})
    assert loop.conditions.at_rest == pytest.approx(0.0, abs=1e-6)


TANKS = fracid.model("tanks", k_pump=0.05, k_upper=0.045, k_lower=0.05)


def pumped(mean):
    return twin(TANKS, 2, {"q": 1.0}, mean + 0.6 * np.sin(np.arange(500))[:, None])


def test_the_outputs_that_a_posture_does_not_name_are_where_it_takes_them():
    c = loop_of(pumped(3.0), at={"lower": 4.0}).conditions
    assert c.reference == pytest.approx({"lower": 4.0, "upper": 4.0 * (0.05 / 0.045) ** 2})
    assert c.at_rest == pytest.approx(0.05 * 4.0**0.5 / 0.05, rel=1e-6)


@pytest.mark.parametrize("limit", [None, 5.0])
def test_an_input_that_has_one_sign_at_rest_and_in_the_recordings_has_no_other(limit):
    c = loop_of(pumped(3.0), at={"lower": 4.0}, limit=limit).conditions
    assert (c.least, c.most) == (0.0, limit or pytest.approx(3.6, abs=0.01))
    assert loop_of(pumped(0.0), at={"lower": 4.0}, limit=5.0).conditions.least == -5.0
    assert loop_of(twin(inputs=np.ones((500, 1)))).conditions.least == -0.3  # upright takes torques of both signs


def test_a_loop_in_numbers_a_hundred_thousand_times_as_large_runs_as_far():
    vessel = Equations({"pressure": Equation("(supply - pressure)/T", "q", "Pa")}, {}, {"supply": "Pa"})
    model = vessel.model("vessel", [fracid.Parameter("T", "s", 1.2, "")])
    runs = []
    for size in (1.0, 1e5):
        filled = size * np.linspace(0, 1, 500)[:, None]
        e = fracid.Experiment("filling", 0.01, filled, filled, units={"pressure": "Pa"})
        problem = fracid.Problem(model, (e,), {"q": 0.9}, initial_state="held")
        loop = loop_of(problem, limit=2.0 * size, at={"pressure": 0.5 * size}, within={"pressure": 5.0 * size})
        runs.append(len(loop.run(problem.start, regulated(loop), 0)[0]))
    assert runs == [301, 301]


def pulled(t, x, u, p, out):
    out[0] = x[1]
    out[1] = 25.0 * u[0] ** 2 - 1e9 * x[0] - 1e4 * x[1]


def test_a_posture_is_found_where_the_input_acts_by_its_square_and_states_are_small():
    plate = fracid.Model("plate", pulled, ("x", "v"), ("mu", 1.0), {"x": 0}, ("volt",), (), "", "")
    c = loop_of(twin(plate, orders={"mu": 1.0}, inputs=np.ones((500, 1))), at={"x": 1e-7}).conditions
    assert abs(c.at_rest) == pytest.approx(2.0)


def test_a_loop_is_drawn_with_its_margins_and_the_worst_draw(found):
    figure = found.plot()
    titles = [axes.get_title() for axes in figure.axes]
    assert "margins of 5 draws" in " ".join(titles)
    entries = [(line.get_color(), line.get_marker(), line.get_linestyle()) for line in figure.legends[0].get_lines()]
    assert len(set(entries)) == len(entries) > 3


@pytest.fixture(scope="module")
def swung():
    cart = fracid.model("cart-pole", coulomb_position=0.3)
    points, problem = np.empty((2, 0)), twin(cart, 2, {"lambda": 1.0, "mu": 0.97})
    return fracid.control(fit_of(problem), kind="swing", limit=10.0, delay=3e-3, seconds=6.0, points=points)


def test_a_pendulum_that_hangs_is_swung_up_caught_and_held(swung):
    assert swung.share == 1.0
    assert swung.conditions.off == {"angle": pytest.approx(np.pi)}
    assert 0.5 < swung.up95[0] <= swung.up95[1] < 4.0
    assert "swing-up and LQR holds upright in 2 of 2 draws" in swung.sentence
    assert "swung up after" in swung.sentence
    assert "it is up after" in swung.notes[-1]
    _, y, u = swung.loop.run(swung.loop.x, swung.design.controller, 1)
    assert abs(y[0, 1]) == pytest.approx(np.pi)
    assert np.abs(y[-100:, 1]).max() < 0.1
    assert np.abs(u).max() <= 10.0


def test_what_the_acceleration_of_a_cart_takes_is_lagranges_equations(swung):
    swing, p = swung.design.controller.swing, {q.name: q.value for q in swung.loop.problem.model.parameters}
    S, J = p["ml"], p["J"]
    known = [p["M"], -(S**2) / J, S, -(S**2) * p["g"] / J, p["b_position"], S * p["b_angle"] / J, 0.0, 0.0]
    np.testing.assert_allclose(swing.needs, known, atol=1e-9)
    assert swing.lift == pytest.approx((0.0, S / J))
    held = (-p["b_angle"] + np.sqrt(p["b_angle"] ** 2 + 4 * J * S * p["g"])) / (2 * J)
    assert swing.omega == pytest.approx(held ** (1 / 0.97), rel=0.01)


@pytest.mark.broad
def test_a_swing_that_friction_ends_names_the_limit_that_would_do():
    rig = fracid.rotary_pendulum("qube-servo2", b_theta=1e-3, coulomb_theta=2e-4)
    problem = twin(rig, 2, {"lambda": 1.0, "mu": 0.97})
    with pytest.raises(InputError, match=r"swings \d+° from hanging, and no higher: .* it takes (6|8|12|20|32) V"):
        fracid.control(fit_of(problem), kind="swing", limit=4.0, rate=200.0, points=np.empty((1, 0)))


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("problem", "how", "words"),
    [
        (twin(), {"limit": 0.01, "seconds": 2.0}, "higher from swing to swing when 2 s are over"),
        (twin(fracid.model("joint", gravity=0.1), orders={"mu": 1.0}), {"limit": 1.0}, "no posture to swing up to"),
        (twin(fracid.model("cart-pole"), 2, {"lambda": 1.0, "mu": 1.0}), {"within": {"position": 0.01}}, "its room"),
        (twin(), {"posture": "hanging"}, "a swing-up ends upright"),
    ],
)
def test_what_cannot_be_swung_up_is_refused_in_a_sentence(problem, how, words):
    with pytest.raises(InputError, match=words):
        fracid.control(fit_of(problem), kind="swing", points=np.empty((1, 0)), **{"limit": 5.0, **how})


UNDRIVEN = replace(fracid.model("pendulum"), inputs=(), input_units={})


@pytest.mark.parametrize(
    ("problem", "how", "words"),
    [
        (twin(fracid.rotary_pendulum(torque_per_volt=0.0), 2, {"lambda": 1.0, "mu": 1.0}), {}, "torque_per_volt is 0"),
        (twin(UNDRIVEN, inputs=np.zeros((1, 1))), {}, "pendulum has no input: there is nothing to control it with"),
        (twin(), {"limit": None}, "Nothing drove the recordings"),
        (twin(), {"posture": "sideways"}, "unknown posture"),
        (twin(fracid.model("cart-pole"), 2, {"lambda": 1.0, "mu": 1.0}), {"at": {"angle": 1.0}}, "does not rest"),
        (twin(), {"off": {"theta": 0.1}}, "theta"),
        (twin(), {"rate": 0}, "rate = 0: expected a number above 0"),
        (twin(), {"limit": -5.0}, "limit = -5.0: expected a number above 0"),
        (twin(), {"delay": -1.0}, "delay = -1.0: expected a number of seconds, 0 or more"),
        (twin(), {"off": {"angle": 0.0}}, "begins at the posture shows nothing: give --off angle a value other than 0"),
    ],
)  # fmt: skip
def test_what_cannot_be_controlled_is_refused_in_a_sentence(problem, how, words):
    with pytest.raises(InputError, match=words):
        loop_of(problem, **how)


def test_a_delay_that_the_loop_cannot_bear_is_named():
    with pytest.raises(InputError, match="A delay of 200 ms may be more than the loop bears"):
        fracid.control(fit_of(twin()), limit=0.15, delay=0.2, rate=25.0, draws=1, seconds=1.0)


def test_a_posture_that_takes_more_than_there_is_is_refused():
    with pytest.raises(InputError, match=r"takes .* of torque, and there are"):
        fracid.control(fit_of(twin(fracid.model("joint", gravity=1.0), orders={"mu": 1.0})), limit=0.1,
                       at={"angle": 1.0}, draws=2)  # fmt: skip


def test_a_gain_that_the_recordings_cannot_tell_is_refused():
    free = {n: fracid.Free(v, v / 9, v * 9) for n, v in (("gravity", 0.147), ("J", 3e-3))}
    run = fracid.simulate(fracid.model("pendulum"), orders={"mu": 1.0}, initial={"angle": 1.0}, step=0.01, end=4.99)
    e = fracid.Experiment("twin", 0.01, run.states[:, :1], np.zeros((1, 1)), initial={"angle": 1.0})
    model = fracid.model("pendulum", b_angle=0.0)
    problem = fracid.Problem(model, (e,), {"mu": 1.0}, free, initial_state="held")
    with pytest.raises(InputError, match="do not separate gravity and J"):
        fracid.control(fit_of(problem), limit=0.3, draws=2)


FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-ffp-contract=off"]


@pytest.mark.few(1)
@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@pytest.mark.parametrize(
    ("which", "right", "wrong"),
    [("found", "u += D[i] * e[i]", "u -= D[i] * e[i]"), ("swung", "* w < 0.0) a = -a", "* w > 0.0) a = -a")],
)
def test_the_controller_in_c_passes_its_own_test_and_is_the_loops_one(which, right, wrong, tmp_path, request):
    found = request.getfixturevalue(which)
    text = c_controller(found)
    (tmp_path / "controller.c").write_text(text)
    own = ["cc", *FLAGS, "-DFRACID_CONTROLLER_TEST", "controller.c", "-o", "test", "-lm"]
    subprocess.run(own, cwd=tmp_path, check=True)
    off = subprocess.run([tmp_path / "test"], check=True, capture_output=True, text=True).stdout
    assert float(off) < 1e-9
    subprocess.run(["cc", *FLAGS, "-shared", "-fPIC", "controller.c", "-o", "c.so", "-lm"], cwd=tmp_path, check=True)
    c = replace(found.conditions, noise=dict.fromkeys(found.conditions.outputs, 0.0), delay=0.0)
    _, y, u = replace(found.loop, conditions=c).run(found.loop.x, found.design.controller, 1)
    library, memory = ctypes.CDLL(str(tmp_path / "c.so")), ctypes.create_string_buffer(4096)
    library.fracid_controller_step.restype = ctypes.c_double
    library.fracid_controller_init(memory)
    samples = y + [c.reference[n] for n in c.outputs]
    given = [library.fracid_controller_step(memory, (ctypes.c_double * 2)(*sample)) for sample in samples]
    np.testing.assert_allclose(given, u, atol=1e-9 * c.most)
    np.testing.assert_allclose(
        answers(law_of(found.design.controller, c), np.ascontiguousarray(y)), u, atol=1e-9 * c.most
    )
    assert right in text
    (tmp_path / "controller.c").write_text(text.replace(right, wrong))
    subprocess.run(own, cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "test"], check=False, capture_output=True).returncode == 1


def test_the_controller_in_c_says_its_units_and_how_a_column_is_read(found):
    columns = ['theta = { column = 2, unit = "deg", sign = -1, zero = 0.3 }', "alpha = 1 */ evil"]
    head = c_controller(found, columns).partition("#include")[0]
    assert "y is theta [rad], alpha [rad], u is voltage [V]" in head
    assert columns[0] in head
    assert "alpha = 1 * / evil" in head
    assert "sign * scale" not in c_controller(found)


def test_a_pid_and_a_fopid_have_the_responses_of_their_formulas():
    omega = np.geomspace(0.5, 10.0, 10)
    s = 1j * omega
    for orders in ((1.0, 1.0), (0.8, 0.7)):
        made = pid((2.0, 1.5, 0.3), orders, 1e-3, 1, 2)
        whole = 2.0 + 1.5 * s ** -orders[0] + 0.3 * s ** orders[1] / (1 + 2e-3 * s)
        np.testing.assert_allclose(made.response(omega)[:, 1], -whole, rtol=0.03)
        assert not made.response(omega)[:, 0].any()


@pytest.mark.broad
def test_a_fopid_has_no_more_than_the_effort_of_its_pid_nor_less_of_its_robustness_and_says_what_it_brings():
    loops = fracid.control(fit_of(twin()), kind="pid", limit=0.3, draws=2, seconds=2.0)
    plain, other = loops.tried
    assert [plain.controller.kind, other.controller.kind] == ["PID", "FOPID"]
    assert plain.held == other.held == 2
    first, second = (loops.loop.trial(loops.loop.x, d.controller, 1) for d in (plain, other))
    assert second["effort"] <= 1.01 * first["effort"]
    assert other.distance >= 0.99 * plain.distance
    assert second["error"] <= 1.01 * first["error"]
    assert "times the PID's" in loops.notes[-1]
