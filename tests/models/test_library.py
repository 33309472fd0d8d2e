"""The library: each model is what its page says, by an independent derivation, and all of it is had by name."""

import json
import math
import pickle
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fracid
from fracid.models import MODELS
from fracid.models.joints import presliding
from fracid.models.library import MODEL as LIBRARY
from fracid.models.library import inputs_of, table_of
from program import run


def smooth(v, slip):
    return math.tanh(v / slip)


def pendulum(x, u, p):
    """Newton's law about an axis."""
    loss = p["b_angle"] * x[1] + p["coulomb_angle"] * smooth(x[1], p["slip_speed"]) + p["drag_angle"] * x[1] * abs(x[1])
    return x[1], (u["torque"] - p["gravity"] * math.sin(x[0] - p["angle_rest"]) - loss) / p["J"]


def cart_pole(x, u, p):
    """Lagrange's equations, M(q) q'' = f, solved as a system."""
    _, speed, angle, rate = x
    s, c, first = math.sin(angle - p["angle_rest"]), math.cos(angle - p["angle_rest"]), p["ml"]
    mass = np.array([[p["M"], first * c], [first * c, p["J"]]])
    cart = u["force"] + first * s * rate**2 - p["b_position"] * speed
    pole = -first * p["g"] * s - (p["b_angle"] + p["drag_angle"] * abs(rate)) * rate
    dry = (p["coulomb_position"] * smooth(speed, p["slip_speed"]), p["coulomb_angle"] * smooth(rate, p["slip_rate"]))
    along, about = np.linalg.solve(mass, np.array([cart, pole]) - dry)
    return speed, along, rate, about


def joint(x, u, p):
    """With presliding as :func:`fracid.models.joints.presliding` has it, the springpot's state y, and a link that is
    ahead of the joint by an angle of its own."""
    angle, rate, z, y, bend, bend_rate = x
    duty = np.clip(p["gain"] * (u["goal"] - angle), -p["duty_limit"], p["duty_limit"])
    k, most = p["torque_constant"], p["current_limit"]
    current = np.clip((p["supply"] * duty - k * rate) / p["resistance"], -most, most) * (u["torque_enable"] > 0.5)
    drive = u["torque"] + p["torque_per_volt"] * u["voltage"] + k * current
    pull = (p["gravity"] + p["mass"] * 9.80665 * p["length"]) * math.sin(angle + bend - p["angle_rest"] - p["level"])
    load = abs((p["load_angle"] + p["load_directional_angle"]) * drive + p["load_angle"] * pull)
    out, f, s = np.zeros(1), p["coulomb_angle"] + load, p["stiction_angle"]
    dry = presliding(np.array([z]), out, 0, rate, f, s, p["stribeck_speed_angle"], p["presliding_angle"])
    dry += p["presliding_damping_angle"] * out[0]
    turn = angle - p["angle_rest"]
    shaft = p["elastic_angle"] * bend + p["elastic_damping_angle"] * bend_rate
    link = max(p["mass"] * p["length"] ** 2, p["J"] / 4)
    torque = (
        drive + shaft - p["spring_angle"] * turn - (p["b_angle"] + p["back_emf"] + p["drag_angle"] * abs(rate)) * rate
    )
    turns = (torque - dry - p["springpot_angle"] * y) / p["J"]
    return rate, turns, out[0], rate, bend_rate, (-shaft - pull) / link - turns


def two_mass(x, u, p):
    motor, motor_rate, load, load_rate, y = x
    shaft = p["k"] * (motor - load + p["load_rest"]) + p["d"] * (motor_rate - load_rate) + p["springpot_shaft"] * y
    dry = [p[f"coulomb_{n}"] * smooth(v, p["slip_speed"]) for n, v in (("motor", motor_rate), ("load", load_rate))]
    return (motor_rate, (u["torque"] - shaft - p["b_motor"] * motor_rate - dry[0]) / p["J_motor"],
            load_rate, (shaft - p["b_load"] * load_rate - dry[1]) / p["J_load"], motor_rate - load_rate)  # fmt: skip


def oscillator(x, u, p):
    """Minus the slope of k x²/2 + k2 x³/3 + k3 x⁴/4."""
    away = x[0] - p["displacement_rest"]
    slope = np.polynomial.Polynomial([0, 0, p["k"] / 2, p["k2"] / 3, p["k3"] / 4]).deriv()(away)
    loss = p["b_displacement"] * x[1] + p["coulomb_displacement"] * smooth(x[1], p["slip_speed"])
    return x[1], (u["force"] - slope - loss - p["springpot_displacement"] * x[2]) / p["m"], x[1]


def tanks(x, u, p):
    """What comes in, less what goes out."""
    down, over = p["k_upper"] * max(x[0], 0.0) ** 0.5, p["weir"] * max(x[0] - p["rim"], 0.0)
    out = p["k_lower"] * max(x[1], 0.0) ** 0.5 + p["weir"] * max(x[1] - p["rim"], 0.0)
    pumped = p["k_pump"] * max(u["pump"] - p["pump_offset"], 0.0)
    return pumped - down - over, p["ratio"] * (down + p["share"] * over) - out


def capacitor(x, u, p):
    """Kirchhoff's law at the node between the capacitor and its branches."""
    branches = [(x[0] - x[i]) / p[f"R_{i}"] for i in (1, 2)]
    net = u["current"] - p["current_rest"] - p["leak"] * x[0] - sum(branches)
    return net / np.polyval([p["C2"], p["C1"], p["C0"]], x[0]), branches[0] / p["C_1"], branches[1] / p["C_2"]


def relaxation(x, u, p):
    away = u["stretch"] - p["slack"]
    return u["rate"], (away - x[1]) / p["tau_1"], (away - x[2]) / p["tau_2"]


DERIVED = {f.__name__.replace("_", "-"): f for f in (pendulum, cart_pole, joint, two_mass, oscillator, tanks, capacitor,
                                                     relaxation)}  # fmt: skip


def everything_on(name):
    """The model with every element, at values that are not zero."""
    model = fracid.model(name)
    values = {p.name: p.value or 0.1 * (1 + k) / len(model.parameters) for k, p in enumerate(model.parameters)}
    return model.with_parameters(**values), values


def test_every_model_has_an_independent_derivation_here():
    assert {*DERIVED} == {*LIBRARY} == {*MODELS} - {"rotary-pendulum"}


@pytest.mark.parametrize("name", LIBRARY)
def test_the_equations_are_those_of_an_independent_derivation(name):
    model, p = everything_on(name)
    rng, n = np.random.default_rng(1), len(model.states)
    for scale in (1e-3, 0.1, 1.0, 3.0):
        x, u = scale * rng.standard_normal(n), scale * rng.standard_normal(len(model.inputs))
        out = np.full(n * (1 + bool(model.relaxing)), np.nan)
        model.rhs(0.0, x, u, model.parameter_vector(), out)
        expected = DERIVED[name](x, dict(zip(model.inputs, u.tolist(), strict=True)), p)
        np.testing.assert_allclose(out[:n], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["joint", "relaxation"])
def test_a_state_forgets_with_the_slope_of_its_own_equation(name):
    model, _ = everything_on(name)
    rng, n = np.random.default_rng(2), len(model.states)
    x, u, p = rng.standard_normal(n), rng.standard_normal(len(model.inputs)), model.parameter_vector()

    def rates(x):
        out = np.zeros(2 * n)
        model.rhs(0.0, x, u, p, out)
        return out

    assert model.relaxing
    for i in model.relaxing_states:
        step = np.eye(n)[i]  # the equation is linear in its own state
        assert rates(x)[n + i] == pytest.approx(rates(x - step / 2)[i] - rates(x + step / 2)[i], rel=1e-9)


@pytest.mark.broad
def test_a_joint_with_a_stiff_spring_moves_as_one_that_is_rigid():
    model = fracid.model("joint", mass=0.5, b_angle=0.01, load_angle=0.1, gravity=0.0)
    stiff = model.with_parameters(elastic_angle=1e4, elastic_damping_angle=0.02)
    one, other = (
        fracid.simulate(m, orders={"mu": 1.0}, initial={"angle": 0.5}, step=5e-3, end=1.0, method="bdf2")
        for m in (model, stiff)
    )
    np.testing.assert_allclose(other.states[:, 0], one.states[:, 0], atol=1e-3 * np.ptp(one.states[:, 0]))


def test_what_is_off_has_no_state_and_what_is_on_has():
    joint = fracid.model("joint")
    assert joint.states == ("angle", "rate")
    assert joint.with_parameters(presliding_angle=0.01, coulomb_angle=0.1).states == ("angle", "rate", "z")
    both = fracid.model("joint", springpot_angle=0.1, presliding_angle=0.01)
    assert (both.states, both.relaxing) == (("angle", "rate", "z", "y"), {"z": "presliding_angle"})
    assert both.with_parameters(springpot_angle=0.0, presliding_angle=0.0).states == joint.states
    assert fracid.model("capacitor").follows == {}
    assert fracid.model("capacitor", C_2=1.0).follows == {"v_2": "v"}
    again = pickle.loads(pickle.dumps(joint))
    assert again.with_parameters(presliding_angle=0.01).program == both.with_parameters(springpot_angle=0.0).program


@pytest.mark.parametrize("name", LIBRARY)
def test_what_a_draft_may_leave_out_is_a_rung_of_the_ladder(name):
    m, rows = fracid.model(name), table_of(name)["model"]["parameters"]
    left = [n for n, row in rows.items() if row["start"] == 0.0 and not row.get("known") and "free" not in row]
    assert {*left} <= {*m.friction, *m.rests}


def test_friction_is_known_by_its_name_and_its_joint_too():
    friction = fracid.model("cart-pole").friction
    assert {n: (k.rung, k.joint) for n, k in friction.items()} == {
        "b_position": ("viscous", "position"), "coulomb_position": ("Coulomb", "position"),
        "b_angle": ("viscous", "angle"), "coulomb_angle": ("Coulomb", "angle"), "drag_angle": ("drag", "angle"),
    }  # fmt: skip


@pytest.mark.parametrize("name", ["pendulum", "cart-pole"])
def test_upright_is_hanging_from_the_other_side(name):
    hanging, upright = (fracid.model(name, zero=zero) for zero in ("hanging", "upright"))
    n, u = len(hanging.states), np.array([0.3])
    x = np.linspace(0.1, 0.4, n)
    turned = x.copy()
    turned[hanging.states.index("angle")] += math.pi
    rates = np.zeros((2, n))
    for model, at, out in zip((hanging, upright), (turned, x), rates, strict=True):
        model.rhs(0.0, at, u, model.parameter_vector(), out)
    np.testing.assert_allclose(rates[0], rates[1], rtol=1e-12, atol=1e-12)
    assert (hanging.zero, upright.zero, hanging.pendulum) == ("hanging", "upright", "angle")


@pytest.mark.parametrize("name", LIBRARY)
def test_its_file_says_all_that_a_page_and_a_draft_need(name):
    model, table = fracid.model(name), table_of(name)
    assert model.about
    assert model.source
    assert {*table["columns"]} == {*model.outputs, *model.inputs} - {*model.input_rates}
    for p in model.parameters:
        assert all((p.description, p.unit, p.symbol)), p.name
    assert all(model.output_units[n] for n in model.outputs)
    inputs = inputs_of(name, np.linspace(0.0, 1.0, 5))
    assert {*inputs} <= {*model.inputs}


@dataclass(frozen=True)
class Exact:
    """A motion that is known in closed form."""

    name: str
    parameters: dict
    orders: dict
    inputs: dict
    output: str
    truth: object
    initial: dict = field(default_factory=dict)


EXACT = (
    Exact("capacitor", {"C0": 2.0, "R": 0.5, "leak": 0.0}, {"q": 0.8}, {"current": lambda t: 1.0 + 0 * t}, "voltage",
          lambda t: 0.5 + t**0.8 / (2.0 * math.gamma(1.8))),
    Exact("relaxation", {"k": 3.0, "c": 2.0}, {"nu": 0.4}, {"stretch": lambda t: 0.1 * t}, "force",
          lambda t: 0.3 * t + 0.2 * t**0.6 / math.gamma(1.6)),
)  # fmt: skip
"""A constant current into a constant-phase element; a ramp of a spring and a springpot."""


@pytest.mark.broad
@pytest.mark.parametrize("case", EXACT, ids=lambda c: c.name)
def test_a_fractional_element_does_what_is_known_in_closed_form(case):
    time = np.linspace(0.0, 2.0, 201)
    twin = fracid.Twin.of_model(
        fracid.model(case.name, **case.parameters), orders=case.orders, initial=case.initial, step=0.01, end=2.0,
        inputs={n: (time, u(time)) for n, u in case.inputs.items()},
    )  # fmt: skip
    found = twin.record(twin.simulate()).signals[case.output]
    np.testing.assert_allclose(found[20:], case.truth(time)[20:], rtol=2e-4)


@pytest.mark.broad
@pytest.mark.parametrize("name", LIBRARY)
def test_its_twin_is_what_scipy_solves_at_order_1(name):
    twin = fracid.Twin.of_library(name)
    twin = twin.changed(orders=dict.fromkeys(twin.orders, 1.0), substeps=8)
    if twin.model.springpot_orders:  # at ν = 0 the springpot is a spring
        twin = twin.changed(orders=dict.fromkeys(twin.orders, 1e-9))
    run = twin.simulate()
    model, p = twin.model, twin.model.parameter_vector(twin.parameters)
    there = twin._inputs

    def held(t, times, values):
        return values[np.searchsorted(times, t, side="right") - 1]

    def rhs(t, x):
        steps = {*model.input_rates, *(n for n, between in twin.between.items() if between == "hold")}
        u = [held(t, *there[n]) if n in steps & {*there} else np.interp(t, *there[n]) if n in there else 0.0
             for n in model.inputs]  # fmt: skip
        out = np.zeros(len(x))
        model.rhs(t, x, np.array(u), p, out)
        return out

    stop = twin.end / 4  # where chaos has not yet made two of one motion
    at = twin.time[twin.time <= stop]
    start, fine = model.state_vector(twin.initial), {"rtol": 1e-9, "atol": 1e-11, "max_step": twin.step}
    exact = solve_ivp(rhs, (0, stop), start, t_eval=at, **fine)
    scale = np.ptp(exact.y, axis=1)[:, None] + 1e-12
    assert np.abs((run.states[: len(at)].T - exact.y) / scale).max() < 2e-3


def test_a_command_lists_them(capsys):
    code, text, _ = run(capsys, "models", "--json")
    assert code == 0
    listed = json.loads(text)
    assert {*listed} == {*MODELS}
    assert listed["cart-pole"]["inputs"] == {"force": "N"}
    assert listed["capacitor"]["outputs"] == {"voltage": "V"}
    assert "cart-pole" in run(capsys, "models")[1]
    assert "viscous friction of the cart" in run(capsys, "models", "cart-pole")[1]


PROJECT = """
[model]
name = "cart-pole"
zero = "upright"
[model.parameters]
M = { start = 0.5, lower = 0.1, upper = 2.0 }
[[recording]]
file = "cart.csv"
position = { column = "position", unit = "mm" }
angle = { column = "angle", unit = "deg" }
force = { column = "force", unit = "N" }
"""


def test_a_project_names_one(tmp_path):
    t = np.linspace(0, 1, 50)
    np.savetxt(tmp_path / "cart.csv", np.c_[t, t, t, t], delimiter=",", header="time,position,angle,force", comments="")
    (tmp_path / "cart.toml").write_text(PROJECT, encoding="utf-8")
    problem = fracid.load_project(tmp_path / "cart.toml").problem
    assert (problem.model.zero, problem.outputs) == ("upright", ("position", "angle"))
    assert {"lambda", "mu", "M"} <= {*problem.names}
    (tmp_path / "cart.toml").write_text(PROJECT.replace("cart-pole", "cart-pool"), encoding="utf-8")
    with pytest.raises(fracid.InputError, match="did you mean cart-pole"):
        fracid.load_project(tmp_path / "cart.toml")


def test_what_means_nothing_for_a_model_is_refused():
    with pytest.raises(fracid.InputError, match="the model has no pendulum"):
        fracid.model("tanks", zero="upright")
    with pytest.raises(fracid.InputError, match="unknown tanks parameter 'rig'"):
        fracid.models.model_from_name("tanks", rig="srv02-rotpen")
    with pytest.raises(fracid.InputError, match="acts only with presliding_angle"):
        fracid.model("joint", presliding_damping_angle=0.1)


def lifted(**more):
    """A servo that lifts, holds and drops a mass."""
    servo = {"mass": 0.5, "gain": 0.6, "torque_per_volt": 0.0, "J": 2e-3, "b_angle": 0.01, "coulomb_angle": 0.01,
             "load_angle": 0.1, "load_directional_angle": 0.2}  # fmt: skip
    model = fracid.model("joint", **servo | more)
    time = np.arange(0.0, 4.0, 0.005)
    goal = np.where(time < 3.0, 1.2 * np.sin(2.0 * time), 0.0)
    columns = {"goal": goal, "torque_enable": (time < 3.0).astype(float)}
    inputs = np.column_stack([columns.get(n, 0.0 * time) for n in model.inputs])
    return model, fracid.simulate(
        model, initial={}, step=0.005, end=3.995, inputs=inputs, method="bdf2", between="hold"
    )


def test_a_servo_that_lets_go_drops_its_mass_and_no_current_brakes_it():
    model, run = lifted(load_angle=0.0, load_directional_angle=0.0, coulomb_angle=0.0, b_angle=0.0)
    p, late = {q.name: q.value for q in model.parameters}, run.time > 3.05
    angle, rate = run.states[late, :2].T
    energy = 0.5 * (p["J"] + 0.5 * 0.1**2) * rate**2 - 0.5 * 9.80665 * 0.1 * np.cos(angle)
    assert np.ptp(energy) < 0.02 * np.ptp(0.5 * 9.80665 * 0.1 * np.cos(angle))


def test_friction_that_grows_with_the_load_stands_still_where_coulomb_friction_slides():
    _, light = lifted(load_angle=0.0, load_directional_angle=0.0)
    _, heavy = lifted(load_angle=0.6, load_directional_angle=0.3)
    swings = [np.ptp(run.states[run.time > 3.5, 0]) for run in (light, heavy)]
    assert swings[1] < 0.5 * swings[0]


def test_the_current_and_the_duty_of_a_servo_have_their_limits():
    kt = 0.3
    for limits, torque in (
        ({}, kt * 7.4 / 3.0),
        ({"duty_limit": 0.5}, kt * 3.7 / 3.0),
        ({"current_limit": 0.1}, kt * 0.1),
    ):
        model = fracid.model("joint", gain=100.0, b_angle=0.0, **limits)
        out = np.zeros(2)
        u = [{"goal": 1.0, "torque_enable": 1.0}.get(n, 0.0) for n in model.inputs]
        model.rhs(0.0, np.zeros(2), np.array(u), model.parameter_vector(), out)
        assert out[1] == pytest.approx(torque / model.parameter("J").value)


def recorded(name, seconds=1.0):
    """A problem whose recording is the beginning of the model's twin."""
    twin = fracid.Twin.of_library(name)
    twin = twin.changed(end=twin.step * round(max(seconds, 20 * twin.step) / twin.step))
    recording = twin.record(twin.simulate())
    e = fracid.Experiment.of(recording, twin.model, [*twin.model.outputs], {s: 0.0 for s in twin.model.states})
    return twin, fracid.Problem(
        twin.model, (e,), dict(twin.orders), twin.parameters, outputs=(*twin.model.outputs,), initial_state="held"
    )


@pytest.mark.few(1)
@pytest.mark.parametrize("name", LIBRARY)
def test_a_problem_of_it_is_a_twin_again_with_every_order(name):
    twin, problem = recorded(name)
    again = fracid.Twin.of_problem(problem, problem.start, problem.experiments[0])
    assert dict(again.orders) == pytest.approx(dict(twin.orders))
    assert again.changed(orders=twin.orders).orders == twin.orders
