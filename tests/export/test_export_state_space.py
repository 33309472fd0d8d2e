"""Integer-order state space against the fractional model: operators, models about both postures, python-control."""

import json
import re
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import sympy
from scipy.io import loadmat

import fracid
from fracid.errors import InputError
from fracid.export.recursion import Case
from fracid.export.state_space import (
    DECIBEL,
    DEGREES,
    follows,
    integer_model,
    linear_sentences,
    moving,
    positive_sum,
    sentences,
)
from fracid.models import Parameter
from fracid.models.written.equations import Equation, Equations
from fracid.models.written.mathematics import _Read as Simpler
from fracid.models.written.tree import Call, Entry, Name, Number, Operation
from fracid.plots import linear_response
from test_export import LUGRE, fitted, problem_of  # noqa: F401 (a fixture)

VISCOUS = {"b_theta": 1e-3, "b_alpha": 2e-4}

CASES = {
    "viscous": problem_of(steps=4000, **VISCOUS),
    "an order above 1": problem_of((1.1, 0.95), steps=4000, **VISCOUS),
    "low orders": problem_of((0.6, 0.7), steps=2000, **VISCOUS),
    "one integer order": problem_of((0.9, 1.0), steps=2000, **VISCOUS),
    "integer orders": problem_of((1.0, 1.0), steps=2000, **VISCOUS),
    "another unit of time": problem_of(steps=2000, time_scale=0.1, **VISCOUS),
    "dry friction, cable and offsets": problem_of(steps=2000),
    "counted from upright": problem_of(zero="upright", steps=1000, **VISCOUS),
    "springpots": problem_of(
        (1.0, 1.0), steps=1000, springpot_theta=5e-3, springpot_alpha=1e-4, springpot_order_alpha=0.2
    ),
    "an elastic arm": problem_of((1.0, 1.0), steps=1000, arm_stiffness=50.0, arm_damping=0.01, **VISCOUS),
    "presliding": problem_of((1.0, 1.0), steps=1000, **VISCOUS, **LUGRE),
}


# --- operators -------------------------------------------------------------------------------------


@pytest.mark.few(2)
@pytest.mark.parametrize("band", [(0.3, 3000.0), (6.0, 600.0), (0.01, 1e5)])
@pytest.mark.parametrize("order", [0.1, 0.5, 0.86, 0.95, 0.999, 1.05, 1.5, 1.9])
def test_an_operator_is_right_where_the_data_can_tell(order, band):
    operator, omega = positive_sum(order, band), np.geomspace(*band, 77)
    ratio = operator.response(omega) * (1j * omega) ** order
    assert np.abs(20 * np.log10(np.abs(ratio))).max() <= 1.05 * DECIBEL
    assert np.abs(np.degrees(np.angle(ratio))).max() <= 1.05 * DEGREES
    assert np.all(np.diff(operator.poles) > 0)
    assert operator.poles[0] == 0


@pytest.mark.few(2)
@pytest.mark.parametrize("order", [0.1, 0.5, 0.95, 1.05, 1.6])
def test_an_operator_is_passive_at_every_frequency_not_in_the_band_alone(order):
    operator, omega = positive_sum(order, (6.0, 600.0)), np.geomspace(1e-6, 1e9, 500)
    response = operator.response(omega) * (1j * omega if order > 1 else 1.0)
    assert response.real.min() >= -1e-12 * np.abs(response).max()
    assert order > 1 or operator.residues.min() > 0
    assert len(operator.poles) <= 13  # of Oustaloup's filter 15 to 21, and right a decade less


def test_at_order_1_the_operator_is_an_integrator():
    operator = positive_sum(1.0, (1.0, 100.0))
    assert operator.poles.tolist() == [0.0]
    assert operator.residues.tolist() == [1.0]
    assert operator.errors == pytest.approx((0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize(("order", "band", "words"), [
    (2.0, (1.0, 2.0), "strictly between 0 and 2"),
    (0.9, (0.0, 2.0), "two frequencies above 0"),
    (0.9, (3.0, 2.0), "the lower first"),
])  # fmt: skip
def test_an_operator_that_cannot_be_is_refused(order, band, words):
    with pytest.raises(InputError, match=words):
        positive_sum(order, band)


# --- the models ------------------------------------------------------------------------------------


@pytest.mark.broad
@pytest.mark.parametrize("name", CASES)
def test_the_integer_order_model_swings_as_the_fractional_one(name):
    problem = CASES[name]
    x, e = problem.start, problem.experiments[0]
    exact = problem.simulate(x, e).states
    assert np.ptp(exact[:, 2]) > 0.2
    for output, error in follows(integer_model(problem), Case.of(problem, x, e), exact).items():
        assert error < 1e-2 * np.ptp(exact[:, problem.model.outputs[output]])


@pytest.mark.few(3)
@pytest.mark.parametrize("posture", ["hanging", "upright"])
@pytest.mark.parametrize("name", CASES)
def test_a_linear_model_has_the_fractional_models_response_and_poles(name, posture):
    linear = integer_model(CASES[name]).linear[posture]
    omega = np.geomspace(*integer_model(CASES[name]).operators[0].band, 60)
    ratio = linear.response(omega) / linear.exact_response(omega)
    assert np.abs(ratio - 1).max() < 0.02
    unstable = [m for m in linear.modes if m.pole.real > 0 and m.pole.imag == 0]
    assert len(unstable) == (posture == "upright")
    swings = [m for m in linear.modes if m.pole.imag > 0]
    assert len(swings) >= (posture == "hanging")
    for mode in (*unstable, *swings):
        if mode.frequency > omega[0]:  # slower than the record: none of the filter's business
            # four operators' phases, and more far from the axis, for which the filter is not made
            allowed = 0.03 if mode.damping > 0.3 else 4 * np.radians(DEGREES) + 1e-3
            assert abs(mode.pole - mode.exact) < allowed * mode.frequency


def exactly(e, at):
    """An expression of the tree for SymPy: of constants their exact values."""
    match e:
        case Number(v):
            return sympy.Rational(v)
        case Name() | Entry():
            return at[e]
        case Call("max", (a, Number(0))):
            return exactly(a, at)  # of the determinant
        case Call(f, arguments):
            return getattr(sympy, f.capitalize() if f == "abs" else f)(*(exactly(a, at) for a in arguments))
        case Operation("neg", (a,)):
            return -exactly(a, at)
        case Operation(sign, (a, b)):
            a, b = exactly(a, at), exactly(b, at)
            return {"+": a + b, "-": a - b, "*": a * b}[sign] if sign != "/" else a / b
    raise AssertionError(e)


def test_a_linear_model_has_the_exact_derivatives_of_the_tree():
    model, p = CASES["viscous"].model, CASES["viscous"].model.parameter_vector()
    read = Simpler(model, {q.name: v for q, v in zip(model.parameters, p, strict=True) if v}, driven=True)
    here, x, u = read._run(read.program.body, {}), sympy.symbols("x:4", real=True), sympy.Symbol("u")
    at = {Entry("x", Number(i)): x[i] for i in range(4)} | {Entry("u", Number(0)): u}
    at |= {
        Entry("p", Number(k), q.name): sympy.Rational(v)
        for k, (q, v) in enumerate(zip(model.parameters, p, strict=True))
    }
    for name, e in read.definitions.items():
        at[Name(name)] = exactly(e, at)
    f = sympy.Matrix([exactly(here[f"out {i}"], at) for i in range(4)])
    for linear in integer_model(CASES["viscous"]).linear.values():
        where = dict(zip(x, map(sympy.Rational, linear.about.tolist()), strict=True)) | {u: 0}
        for found, by in ((linear.F, x), (linear.G, [u])):
            exact = np.array(f.jacobian(by).subs(where).evalf(20).tolist(), dtype=float)
            np.testing.assert_allclose(found, exact, atol=2e-10 * np.abs(exact).max())


@pytest.mark.parametrize("posture", ["hanging", "upright"])
def test_at_integer_orders_the_poles_are_those_of_the_rig(posture):
    linear = integer_model(CASES["integer orders"]).linear[posture]
    np.testing.assert_allclose(np.sort_complex(linear.poles), np.sort_complex(np.linalg.eigvals(linear.F)), atol=1e-9)


def test_at_integer_orders_a_pendulum_on_an_endlessly_heavy_arm_swings_as_a_simple_one():
    problem = problem_of((1.0, 1.0), J_theta=1e6, b_alpha=2e-4)
    p = dict(zip(problem.model.parameter_names, problem.model.parameter_vector(), strict=True))
    (swing,) = integer_model(problem).linear["hanging"].modes
    (fall,) = integer_model(problem).linear["upright"].modes
    omega, zeta = np.sqrt(p["C4"] / p["C1"]), p["b_alpha"] / (2 * np.sqrt(p["C4"] * p["C1"]))
    assert swing.frequency == pytest.approx(omega, rel=1e-6)
    assert swing.damping == pytest.approx(zeta, rel=1e-5)
    assert fall.pole.real == pytest.approx(omega * (np.sqrt(1 + zeta**2) - zeta), rel=1e-6)


def test_presliding_is_a_spring_with_a_dashpot_where_the_joint_sticks_and_dry_friction_nothing():
    """D² θ (0) of a rig without a pendulum: −σ₀ z − (b + σ₁) v, σ₀ = (f + s)/δ; without presliding −b v."""
    f, s, delta, sigma1, b, J = 1e-2, 5e-3, 5e-3, 0.02, 1e-3, 0.01
    own = {"J_theta": J, "C3": 0.0, "b_theta": b, "coulomb_theta": f, "stiction_theta": s, "play_theta": 0.0}
    for presliding in (0.0, delta):
        damping = sigma1 if presliding else 0.0
        system = integer_model(
            problem_of((1.0, 1.0), **own, presliding_theta=presliding, presliding_damping_theta=damping)
        )
        row, words = system.linear["hanging"].F[1], " ".join(linear_sentences(system))
        assert ("of a joint that sticks, right within 0.005 rad" in words) is bool(presliding)
        assert ("without dry friction" in words) is not bool(presliding)
        assert row[1] == pytest.approx(-(b + damping) / J)
        assert row[4:] == pytest.approx([-(f + s) / delta / J] if presliding else [])


def test_friction_that_grows_with_the_load_is_dry_friction_which_a_moving_joint_has_no_slope_of():
    """About 0.5 rad gravity loads the joint, J D² x = u − b D x − G sin x − κ |G sin x| tanh(D x / v)."""
    J, G, b, at = 5e-3, 0.25, 0.02, 0.5
    e = fracid.Experiment("e", 0.01, np.zeros((50, 1)), np.zeros((1, 4)))
    joint = fracid.model("joint", J=J, gravity=G, b_angle=b, load_angle=0.1, load_directional_angle=0.05)
    system = integer_model(fracid.Problem(joint, (e,), {"mu": 1.0}))
    p, held = moving(joint, system.parameters), np.array([G * np.sin(at), 0.0, 0.0, 0.0])
    linear = system.linearised("held", joint.state_vector({"angle": at}), p, held)
    np.testing.assert_allclose(linear.F[1, :2], [-G * np.cos(at) / J, -b / J], rtol=1e-6)
    assert "without dry friction, which" in " ".join(linear_sentences(system))


@pytest.mark.parametrize("element", [{"play_theta": 5e-3, "arm_stiffness": 50.0}, {"dead_zone": 0.3}])
def test_gear_and_motor_are_in_contact_in_linear_models_and_that_is_said(element):
    own = {n: 0.0 for n in element if n != "arm_stiffness"}
    with_it, without = (integer_model(problem_of((1.0, 1.0), **VISCOUS, **element | e)) for e in ({}, own))
    assert f"without {next(iter(own))}, which has no linear part there" in " ".join(linear_sentences(with_it))
    np.testing.assert_allclose(with_it.linear["hanging"].F, without.linear["hanging"].F, rtol=1e-9)
    np.testing.assert_allclose(with_it.linear["hanging"].G, without.linear["hanging"].G, rtol=1e-9)


def test_both_zeros_of_alpha_have_the_same_poles():
    options = {"steps": 1000, **VISCOUS}
    a, b = (integer_model(problem_of(zero=zero, **options)).linear for zero in ("hanging", "upright"))
    for posture in ("hanging", "upright"):
        np.testing.assert_allclose(a[posture].poles, b[posture].poles, rtol=1e-4, atol=1e-6)


def test_without_a_motor_the_input_is_the_torque():
    torque, volts = (integer_model(problem_of(torque_per_volt=k)).linear["hanging"] for k in (0.0, 0.1))
    assert (torque.inputs, volts.inputs) == (("torque",), ("voltage",))
    np.testing.assert_allclose(0.1 * torque.G, volts.G, rtol=1e-6)


def test_the_step_response_is_the_fractional_models():
    found = integer_model(CASES["viscous"])
    for posture, end in (("hanging", 2.0), ("upright", 0.3)):
        _, integer, exact = found.step_response(found.linear[posture], end)
        assert np.all(np.abs(integer - exact).max(axis=0) < 5e-3 * np.ptp(exact, axis=0))


def test_a_users_own_model_has_a_linear_one_about_its_rest():
    def rhs(t, x, u, p, out):
        out[0] = u[0] - p[0] * x[0] - x[0] ** 3 + 2.0

    own = fracid.Model(
        name="own", rhs=rhs, states=("level",), orders=("mu",), outputs={"level": 0}, inputs=("flow",),
        parameters=(Parameter("rate", "1/s", 1.0, "of decay"),), zero="", source="a test",
    )  # fmt: skip
    swing = fracid.Experiment("own", 0.01, np.zeros((1000, 1)), np.zeros((1, 1)))
    problem = fracid.Problem(own, (swing,), {"mu": 0.9}, outputs=("level",), initial_state="held")
    linear = integer_model(problem).linear["rest"]
    assert linear.about == pytest.approx([1.0])
    assert pytest.approx(np.array([[-4.0]])) == linear.F
    assert linear.exact_response([2.0])[0, 0, 0] == pytest.approx(1 / ((2j) ** 0.9 + 4))


def test_a_model_whose_input_has_one_sign_is_linearised_about_the_recordings_mean():
    """Dlower = k_upper sqrt(upper) - k_lower sqrt(lower) has slopes of 0.025/sqrt(level), infinite at 0."""
    tanks = fracid.model("tanks", k_pump=0.05, k_upper=0.05, k_lower=0.05)
    e = fracid.Experiment("steps", 4.0, np.full((200, 2), 5.0), 2.5 + np.sin(np.arange(200))[:, None])
    system = integer_model(fracid.Problem(tanks, (e,), {"q": 1.0}, initial_state="held"))
    linear, mean = system.linear["rest"], e.inputs.mean()
    assert linear.about == pytest.approx([mean**2] * 2)
    assert linear.F[1] == pytest.approx([0.025 / mean, -0.025 / mean])
    assert f"about rest with pump = {mean:.4g}, the mean of the recordings" in " ".join(linear_sentences(system))
    empty = replace(system, around=None)
    assert not empty.linear
    assert "no state of rest at which the equations have slopes" in " ".join(linear_sentences(empty))


def pulled(t, x, u, p, out):
    out[0] = 1e-6 / (1e-6 - x[0]) ** 2 * 1e-6 * u[0] - 3.0


def test_slopes_of_states_of_any_size_are_those_of_the_equations():
    plate = fracid.Model("plate", pulled, ("x",), (1.0,), {"x": 0}, ("force",), (), "", "")
    e = fracid.Experiment("twin", 0.01, np.full((100, 1), 4e-7), np.zeros((1, 1)))
    system = integer_model(fracid.Problem(plate, (e,), {}, initial_state="held"))
    for x in (0.0, 5e-7):
        linear = system.linearised("there", np.array([x]), np.empty(0), np.array([1.0]))
        assert pytest.approx(np.array([[2e-12 / (1e-6 - x) ** 3]]), rel=1e-6) == linear.F


def turned(t, x, u, p, out):
    out[0] = -2.0 * x[0] + 1e3 * x[1]
    out[1] = u[0] - 1e3 * x[1]


def test_slopes_next_to_zero_are_those_at_zero():
    own = fracid.Model("motor", turned, ("x", "y"), (1.0, 1.0), {"x": 0}, ("volt",), (), "", "")
    e = fracid.Experiment("twin", 0.01, np.zeros((100, 1)), np.zeros((1, 1)))
    system = integer_model(fracid.Problem(own, (e,), {}, initial_state="held"))
    for tiny in (0.0, 1e-17, 1e-310):
        F = system.linearised("rest", np.array([tiny, -tiny]), np.empty(0)).F
        np.testing.assert_allclose(F, [[-2.0, 1e3], [0.0, -1e3]], rtol=1e-9)


def filled(t, x, u, p, out):
    out[0] = u[0]


def test_an_input_that_the_fit_holds_is_held_in_the_integer_order_model():
    own = fracid.Model("tank", filled, ("level",), (1.0,), {"level": 0}, ("flow",), (), "", "")
    e = fracid.Experiment("steps", 0.1, np.zeros((50, 1)), np.sign(np.sin(np.arange(50)))[:, None],
                          between={"flow": "hold"})  # fmt: skip
    problem = fracid.Problem(own, (e,), {}, initial_state="held")
    exact = problem.simulate(problem.start, e).states
    assert follows(integer_model(problem), Case.of(problem, problem.start, e), exact)["level"] < 1e-6


# --- python-control --------------------------------------------------------------------------------


@pytest.fixture
def control():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pytest.importorskip("control")


@pytest.mark.parametrize("posture", ["hanging", "upright"])
def test_python_control_agrees(control, posture):
    found = integer_model(CASES["viscous"])
    linear = found.linear[posture]
    system = linear.control()
    assert system.input_labels == ["voltage"]
    assert system.output_labels == ["theta", "alpha"]
    omega = np.geomspace(1.0, 100.0, 7)
    np.testing.assert_allclose(system(1j * omega)[:, 0], linear.response(omega)[:, :, 0].T, rtol=1e-6)
    about = control.linearize(found.control(linear.about), 0, 0)
    rows = np.abs(linear.A).max(axis=1, keepdims=True)
    assert np.all(np.abs(about.A - linear.A) < 1e-3 * (1 + rows))
    np.testing.assert_allclose(about.B, linear.B, atol=1e-3)


def test_python_control_simulates_the_nonlinear_model(control):
    problem = problem_of((0.95, 0.9), steps=150, **VISCOUS)
    exact = problem.simulate(problem.start, problem.experiments[0])
    system = integer_model(problem).control(exact.states[0])
    response = control.input_output_response(system, exact.time, np.zeros(len(exact.time)), 0, solve_ivp_method="BDF")
    assert np.all(np.abs(response.outputs.T - exact.states[:, [0, 2]]).max(axis=0) < 5e-3)


def test_without_python_control_the_sentence_says_what_to_type(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "control", None)
    with pytest.raises(InputError, match=r"pip install 'fracid\[control\]'"):
        integer_model(CASES["viscous"]).linear["hanging"].control()


# --- files and figures -----------------------------------------------------------------------------


@pytest.mark.broad
def test_the_files_hold_the_matrices(fitted, tmp_path):  # noqa: F811
    folder, done = tmp_path, fracid.export_run(fracid.load_run(fitted), tmp_path, ["matlab", "state-space"])
    found = json.loads((folder / "state_space.json").read_text(encoding="utf-8"))
    matlab = loadmat(folder / "results.mat", simplify_cells=True)["integer"]
    linear = found["linear"]["hanging"]
    np.testing.assert_array_equal(matlab["linear"]["hanging"]["A"], linear["A"])
    np.testing.assert_array_equal(matlab["decay"], found["decay"])
    eigenvalues = np.linalg.eigvals(np.array(linear["A"]))
    for mode in linear["damping"]:
        assert np.abs(eigenvalues - complex(*mode["pole"])).min() < 1e-6 * mode["frequency"]
    assert {"linear-hanging.svg", "linear-upright.png"} <= {p.name for p in done.files}
    said = " ".join(done.notes)
    for words in ("lags 1/(s + p)", "About hanging it swings at", "About upright it falls with", "stiff"):
        assert words in said


@pytest.mark.few(1)
@pytest.mark.parametrize("posture", ["hanging", "upright"])
def test_the_figure_draws_both_models_of_every_output(posture):
    figure = linear_response(integer_model(CASES["one integer order"]), posture)
    assert len(figure.axes) == 6
    for axes in figure.axes:
        fractional, integer = (line.get_ydata() for line in axes.get_lines())
        assert np.abs(np.asarray(fractional) - integer).max() < 0.02 * np.ptp(fractional) + 0.2


def test_a_step_of_an_input_has_the_models_unit():
    swing = fracid.Experiment("twin", 2e-3, np.zeros((5000, 1)), np.zeros((1, 1)))
    problem = fracid.Problem(fracid.model("oscillator"), (swing,), {"mu": 0.9})
    figure = linear_response(integer_model(problem), "rest")
    assert figure.axes[-1].get_title() == "step of 1 N"
    assert figure.axes[0].get_ylabel() == "magnitude [dB re 1 m/N]"


def test_an_output_that_is_not_fitted_has_the_models_unit_too():
    rates = {"position": Equation("speed"), "speed": Equation("force - 9*position - speed", "mu")}
    model = Equations(rates, inputs={"force": "N"}).model("axis", [])
    e = fracid.Experiment("axis", 0.01, np.zeros((500, 1)), np.ones((1, 1)), units={"position": "m"})
    problem = fracid.Problem(model, (e,), {"mu": 0.9}, initial_state="held", outputs=("position",))
    run, system = SimpleNamespace(problem=problem, x=problem.start), integer_model(problem)
    assert re.search(r"is off the fractional one by position \S+ m, speed \S+ rms", " ".join(sentences(run, system)))
    assert linear_response(system, "rest").axes[-1].get_ylabel() == "speed [–]"


@pytest.mark.few(1)
@pytest.mark.parametrize("order", [1.0005, 1.02, 1.5])
def test_an_order_above_1_is_1_over_s_and_a_sum_of_lags(order):
    operator = positive_sum(order, (0.3, 3000.0))
    s = 1j * np.geomspace(0.3, 3000.0, 40)
    assert operator.poles[0] == 0.0
    assert np.abs(operator.response(s.imag) * s**order - 1).max() < 2e-3


@pytest.mark.broad
def test_an_order_next_to_0_is_no_sum_of_lags():
    with pytest.raises(InputError, match=r"1/s\^0.005 is no sum of 100 lags"):
        positive_sum(0.005, (0.3, 3000.0))


def parametric(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -p[0] * (1 + 0.5 * np.sin(0.8 * t)) * x[0]


def test_a_right_hand_side_that_depends_on_time_is_not_frozen_at_its_beginning():
    own = fracid.Model(
        "swing", parametric, ("x", "v"), (1.0, 1.0), {"x": 0}, (), (Parameter("k", "1", 4.0, ""),), "", ""
    )
    e = fracid.Experiment("twin", 0.01, np.zeros((100, 1)), np.zeros((1, 0)))
    with pytest.raises(InputError, match="A program has no time of its own"):
        integer_model(fracid.Problem(own, (e,), {}, initial_state="held"))
