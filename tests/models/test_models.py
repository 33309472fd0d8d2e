"""The rotary pendulum agrees with first principles, its rigs stand, and wrong names are told in our words."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp
from scipy.integrate import solve_ivp

import fracid
from fracid.errors import InputError
from fracid.models import (
    RIGS,
    Geometry,
    Model,
    Parameter,
    lumped_constants,
    mass_matrix,
    model_from_name,
    rotary_pendulum,
)
from fracid.models.base import Angle, Written
from fracid.models.pendulum import TABLE
from fracid.solver.right_hand_side import _largest_indices, compile_rhs
from helpers.energy import energy
from oracles import furuta

ZEROS = ("hanging", "upright")
FRICTIONLESS = dict(b_theta=0.0, b_alpha=0.0, coulomb_theta=0.0, coulomb_alpha=0.0)


def test_a_model_that_says_its_angles_and_forms_as_before_is_read():
    def rhs(t, x, u, p, out):
        out[0] = -x[0]

    model = Model("one", rhs, ("alpha",), (1.0,), {"alpha": 0}, (), (), "hanging", "a test",
                  angles={"alpha": Angle(of_zero=True)}, written=Written(rhs, None, {"c": ""}))  # fmt: skip
    assert (model.angles, model.pendulum) == (("alpha",), "alpha")


def f(model, x, u=(0.0,), **overrides):
    """The right-hand side as plain Python."""
    out = np.full(4, np.nan)
    model.rhs(0.0, np.asarray(x, float), np.asarray(u, float), model.parameter_vector(overrides), out)
    return out


def random_geometry(rng):
    """A rod-like arm, and a pendulum with a full tensor but for the elements its symmetry forbids."""
    span = dict(m1=(0.05, 1), l1c=(0.02, 0.2), J1=(1e-4, 1e-2), l1=(0.05, 0.4), m2=(0.01, 0.5), l2c=(0.05, 0.4),
                Ixx=(0, 1e-4), Iyy=(1e-4, 5e-3), Izz=(1e-4, 5e-3), Ixz=(-1e-5, 1e-5), g=(1, 12),
                ex=(-0.3, 0.3), ey=(-0.3, 0.3))  # fmt: skip
    return {name: rng.uniform(*span[name]) for name in furuta.GEOMETRY}


def lumped(geometry):
    """The same rig by (2)-(7)."""
    rig = Geometry(
        pendulum_mass=geometry["m2"], pendulum_com=geometry["l2c"], arm_length=geometry["l1"],
        arm_inertia=geometry["J1"] + geometry["m1"] * geometry["l1c"] ** 2, I2xx=geometry["Ixx"],
        I2yy=geometry["Iyy"], I2zz=geometry["Izz"], I2xz=geometry["Ixz"], gravity=geometry["g"],
    )  # fmt: skip
    return lumped_constants(rig)


def model_constants(constants):
    return {name: constants[name] for name in ("C1", "C3", "C4", "C6", "J_theta")}


# --- the equations ---------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize("zero", ZEROS)
def test_the_right_hand_side_equals_lagranges_equations_of_two_rigid_bodies(zero):
    rng = np.random.default_rng(1)
    for _ in range(50):
        geometry = random_geometry(rng)
        x = rng.normal(size=4) * (2, 5, 2, 5)
        p = dict(
            b_theta=rng.uniform(0, 0.1), b_alpha=rng.uniform(0, 0.1), coulomb_theta=rng.uniform(0, 0.1),
            coulomb_alpha=rng.uniform(0, 0.1), slip_speed=rng.uniform(0.1, 1), drag_theta=rng.uniform(0, 0.1),
            drag_alpha=rng.uniform(0, 0.1), cable_stiffness=rng.uniform(0, 1), theta_rest=rng.normal(),
            alpha_rest=rng.normal(), torque_per_volt=rng.normal(), tilt_x=geometry["ex"], tilt_y=geometry["ey"],
            arm_moment=(geometry["m2"] * geometry["l1"] + geometry["m1"] * geometry["l1c"]) * geometry["g"] / 9.81,
        )  # fmt: skip
        volts = rng.normal()
        torques = [
            p["torque_per_volt"] * volts - p["b_theta"] * x[1] - p["drag_theta"] * x[1] * abs(x[1])
            - p["coulomb_theta"] * math.tanh(x[1] / p["slip_speed"]) - p["cable_stiffness"] * (x[0] - p["theta_rest"]),
            -p["b_alpha"] * x[3] - p["drag_alpha"] * x[3] * abs(x[3])
            - p["coulomb_alpha"] * math.tanh(x[3] / p["slip_speed"]),
        ]  # fmt: skip
        model = rotary_pendulum(zero=zero, **model_constants(lumped(geometry)), **p)
        expected = furuta.accelerations(geometry, (x[0], x[2] - p["alpha_rest"]), (x[1], x[3]), torques, zero)
        out = f(model, x, [volts])
        np.testing.assert_array_equal(out[[0, 2]], x[[1, 3]])
        np.testing.assert_allclose(out[[1, 3]], expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


def test_the_printed_formulas_hold_with_the_bracket_over_the_determinant():
    rng = np.random.default_rng(2)
    for _ in range(50):
        k = lumped(random_geometry(rng))
        C1, C2, C3, C4, C5, C6, I2xx = (k[name] for name in ("C1", "C2", "C3", "C4", "C5", "C6", "I2xx"))
        b_theta, b_alpha, tau = rng.uniform(0, 0.1, 3)
        x = rng.normal(size=4) * 3
        theta_dot, alpha, alpha_dot = x[1:]
        sin, cos, sin2 = math.sin(alpha), math.cos(alpha), math.sin(2 * alpha)
        in_theta = (-b_theta - C6 * sin2 * alpha_dot) * theta_dot + C3 * sin * alpha_dot**2
        in_alpha = C6 / 2 * sin2 * theta_dot**2 - b_alpha * alpha_dot + C4 * sin
        M11 = C5 + I2xx * cos**2 + C2 * sin**2
        a, b = C1 * in_theta, C3 * cos * in_alpha  # (9), (10)
        c, d = M11 * in_alpha, C3 * cos * in_theta  # (11), (12)
        det = M11 * C1 - (C3 * cos) ** 2
        printed = [theta_dot, (C1 * tau + a - b) / det, alpha_dot, (-C3 * cos * tau + c - d) / det]  # (1)
        model = rotary_pendulum(
            zero="upright", actuation="torque", C1=C1, C2=C2, C3=C3, C4=C4, C5=C5, I2xx=I2xx,
            b_theta=b_theta, b_alpha=b_alpha,
        )  # fmt: skip
        np.testing.assert_allclose(f(model, x, [tau]), printed, rtol=1e-12, atol=1e-12 * np.abs(printed).max())


@pytest.mark.parametrize("rig", RIGS)
def test_hanging_is_upright_seen_from_the_other_side(rig):
    hanging, upright = (rotary_pendulum(rig, zero=zero, coulomb_alpha=1e-3) for zero in ZEROS)
    theta, theta_rate, a, a_rate = x = np.array([0.3, -1.2, 0.7, 2.1])
    mirrored = f(upright, [theta, theta_rate, math.pi - a, -a_rate], [0.1]) * (1, 1, -1, -1)
    np.testing.assert_allclose(f(hanging, x, [0.1]), mirrored, rtol=1e-12)


def test_the_tensor_element_i2xz_is_minus_the_integral_of_x_z():
    assert str(furuta.tensor_element_xz_of_a_point_mass()) == "-m*x*z"


def test_a_mass_further_out_along_the_arm_raises_the_coupling():
    thin = dict(pendulum_mass=0.1, pendulum_com=0.2, arm_length=0.3, arm_inertia=1e-3, I2yy=0.0, I2zz=0.0)
    # A bar bent outwards: tip mass 0.1 kg at x = 0.1 and z = 0.05 from the centre of mass, another opposite.
    bent = lumped_constants(Geometry(**thin, I2xz=-2 * 0.1 * 0.1 * 0.05))
    assert bent["C3"] == pytest.approx(0.1 * 0.3 * 0.2 + 1e-3)


@settings(deadline=None, max_examples=60)
@given(
    mass=st.floats(0.01, 5), com=st.floats(0.01, 1), arm=st.floats(0, 1), hub=st.floats(1e-5, 1),
    own=st.floats(1e-6, 0.1), slim=st.floats(0, 1), alpha=st.floats(-10, 10),
)  # fmt: skip
def test_the_mass_matrix_of_a_physical_rig_is_positive_definite(mass, com, arm, hub, own, slim, alpha):
    rig = Geometry(pendulum_mass=mass, pendulum_com=com, arm_length=arm, arm_inertia=hub, I2xx=slim * own, I2yy=own,
                   I2zz=own)  # fmt: skip
    k = lumped_constants(rig)
    M = mass_matrix(alpha, k["C1"], k["C3"], k["C6"], k["J_theta"])
    assert np.linalg.eigvalsh(M).min() > 0.0


@pytest.mark.few(1)
@pytest.mark.parametrize("zero", ZEROS)
def test_energy_is_conserved_without_friction(zero):
    tilt = {"tilt_x": 0.03, "tilt_y": -0.05, "arm_moment": 0.04}
    model = rotary_pendulum(zero=zero, **FRICTIONLESS, cable_stiffness=0.05, theta_rest=0.2, alpha_rest=0.1, **tilt)
    run = solve_ivp(lambda t, x: f(model, x), (0, 5), [0.1, 1.0, 1.9, -2.0], "DOP853", rtol=1e-12, atol=1e-12)
    start, *_, end = held = energy(model, run.y.T)
    assert np.ptp(run.y[2]) > 1.0
    np.testing.assert_allclose(held, start, rtol=1e-9)
    assert end > 0.0


@settings(deadline=None, max_examples=60)
@given(
    rates=st.tuples(st.floats(-30, 30), st.floats(-30, 30)), alpha=st.floats(-4, 4), zero=st.sampled_from(ZEROS),
    friction=st.tuples(*[st.floats(0, 1)] * 6), slip=st.floats(1e-3, 1),
)  # fmt: skip
def test_friction_never_feeds_energy_in_at_order_one(rates, alpha, zero, friction, slip):
    names = ("b_theta", "b_alpha", "coulomb_theta", "coulomb_alpha", "drag_theta", "drag_alpha")
    model = rotary_pendulum(zero=zero, slip_speed=slip)
    x = np.array([0.0, rates[0], alpha, rates[1]])
    rubbed, free = (f(model, x, **dict(zip(names, k, strict=True))) for k in (friction, (0.0,) * 6))
    p = {parameter.name: parameter.value for parameter in model.parameters}
    torque = mass_matrix(alpha, p["C1"], p["C3"], p["C6"], p["J_theta"]) @ (rubbed - free)[[1, 3]]
    assert torque @ x[[1, 3]] <= 1e-9 * (1 + np.abs(torque) @ np.abs(x[[1, 3]]))


def test_the_motor_turns_voltage_into_torque_and_a_torque_is_taken_as_it_is():
    x = [0.0, 0.0, 0.3, 0.0]
    volts, torque = rotary_pendulum(), rotary_pendulum(actuation="torque")
    assert volts.inputs == ("voltage",)
    assert torque.inputs == ("torque",)
    per_volt = volts.parameter("torque_per_volt").value
    np.testing.assert_allclose(f(volts, x, [2.0]), f(torque, x, [2.0 * per_volt]), rtol=1e-14)


def test_positive_voltage_drives_theta_negative_on_the_srv02():
    assert f(rotary_pendulum("srv02-rotpen"), [0.0] * 4, [1.0])[1] < 0.0


def test_time_scale_leaves_the_right_hand_side_alone():
    model, x = rotary_pendulum(), [0.1, 0.2, 0.3, 0.4]
    np.testing.assert_array_equal(f(model, x), f(model, x, time_scale=0.15))


# --- the compiled right-hand side ------------------------------------------------------------------


@pytest.mark.parametrize("zero", ZEROS)
def test_compiled_and_plain_right_hand_side_agree(zero):
    model = rotary_pendulum(zero=zero, coulomb_theta=0.01, coulomb_alpha=0.02, drag_alpha=0.1, alpha_rest=0.05)
    compiled = compile_rhs(model.rhs)
    x, u, out = np.array([0.1, 2.0, 0.7, -3.0]), np.array([1.5]), np.empty(4)
    compiled(0.0, x, u, model.parameter_vector(), out)
    np.testing.assert_allclose(out, f(model, x, u), rtol=1e-13)


@pytest.mark.parametrize("equation", TABLE["model"]["equations"].values(), ids=[*TABLE["model"]["equations"]])
def test_what_the_right_hand_side_reads_and_writes_is_known_before_a_run(equation):
    """No access is checked in a run."""
    model = rotary_pendulum().equipped(equation.get("only", ())[:1])
    reach = _largest_indices(model.rhs.py_func)
    assert reach is not None
    assert 4 <= reach[1] <= len(model.states)
    assert 4 <= reach[4] <= len(model.states) * (1 + bool(model.relaxing))
    assert reach[3] == len(model.parameters)


def test_a_model_survives_pickling():
    model = rotary_pendulum(zero="upright")
    assert pickle.loads(pickle.dumps(model)) == model


# --- known numbers ---------------------------------------------------------------------------------


def linearised(model, **overrides):
    """The Jacobian at rest, by central differences."""
    steps = 1e-6 * np.eye(4)
    return np.array([(f(model, +d, **overrides) - f(model, -d, **overrides)) / 2e-6 for d in steps]).T


def linear_response(A, order, t, x0):
    """E_q(A t^q) x0, the Mittag-Leffler function of a matrix, by its series in 60 digits."""
    with mp.workdps(60):
        term, total = mp.matrix(x0.tolist()), mp.matrix(4, 1)
        for k in range(250):
            total += term / mp.gamma(mp.mpf(order) * k + 1)
            term = mp.matrix(A.tolist()) * term * mp.mpf(t) ** mp.mpf(order)
        return np.array([float(value) for value in total])


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("t", "theta", "alpha"), [(0.25, -6.29774, -5.31332), (0.5, -2.99532, 1.69933), (2.0, -2.73794, -0.07197)]
)
def test_the_linearised_pendulum_is_m2_with_theta_counted_backwards(t, theta, alpha):
    """M2 takes α − π as its angle, this model π − α: the coupling has the other sign, and so has θ."""
    constants = dict(C1=0.00427484, C3=0.00426644, C4=0.19385737, J_theta=0.01000255, b_theta=0.0024, b_alpha=0.0024)
    A = linearised(rotary_pendulum(**FRICTIONLESS | constants))
    x = linear_response(A, 0.9146, t, np.radians([0.0, 0.0, 10.0, 0.0]))
    np.testing.assert_allclose(np.degrees(x[[0, 2]]), [-theta, alpha], atol=1.1e-5)
    mirrored = linearised(rotary_pendulum(**FRICTIONLESS | constants | {"C3": -0.00426644}))
    y = linear_response(mirrored, 0.9146, t, np.radians([0.0, 0.0, 10.0, 0.0]))
    np.testing.assert_allclose(np.degrees(y[[0, 2]]), [theta, alpha], atol=1.1e-5)


def half_a_second(model, orders, x0, steps):
    """(20)-(24) on x − x(0), in plain Python."""
    h = 0.5 / steps
    weights = np.ones((steps + 1, 4))
    for k in range(steps):
        weights[k + 1] = (1 - (orders + 1) / (k + 1)) * weights[k]  # (19)
    y = np.zeros((steps + 1, 4))
    for n in range(1, steps + 1):
        y[n] = h**orders * f(model, x0 + y[n - 1]) - (weights[1 : n + 1] * y[n - 1 :: -1]).sum(0)
    return x0 + y[-1]


def test_the_right_hand_side_gives_t33():
    model = rotary_pendulum(
        C1=2.2e-3, C2=2.2e-3, C3=1.6e-3, C4=0.127 * 9.81 * 0.15, C5=4e-3, I2xx=2e-5, b_theta=1.5e-3, b_alpha=5e-4
    )
    orders, x0 = model.state_orders({"lambda": 0.8623, "mu": 0.9146}), np.radians([0.0, 0.0, 10.0, 0.0])
    coarse, fine = (half_a_second(model, orders, x0, steps) for steps in (800, 1600))
    extrapolated = 2 * fine - coarse  # the scheme is of first order
    known = [0.0295960364, 0.1391439455, 0.0544580951, -0.2948027320]
    np.testing.assert_allclose(extrapolated, known, rtol=2e-3)


# --- rigs ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("zero", ZEROS)
@pytest.mark.parametrize("rig", RIGS)
def test_every_rig_builds_and_falls_towards_hanging(rig, zero):
    model = rotary_pendulum(rig, zero=zero)
    assert model.zero == zero
    fall = f(model, [0.0, 0.0, 0.1, 0.0])[3]
    assert fall < 0.0 if zero == "hanging" else fall > 0.0
    assert np.isfinite(f(model, [0.1, 1.0, 2.0, -3.0])).all()


@pytest.mark.parametrize("rig", RIGS)
def test_every_rig_hangs_stably(rig):
    slow = linearised(rotary_pendulum(rig, zero="hanging"))
    assert np.linalg.eigvals(slow).real.max() < 1e-6


@pytest.mark.parametrize("rig", RIGS)
def test_every_rig_says_where_its_numbers_come_from_and_takes_its_fitted_friction(rig):
    assert len(RIGS[rig].source) > 100
    model = rotary_pendulum(rig, **RIGS[rig].fitted_friction)
    assert RIGS[rig].source in model.source
    energies = energy(model, [[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    assert energies[0] < energies[1]


@pytest.mark.parametrize(
    ("rig", "frequency", "why"),
    [
        ("srv02-rotpen", 6.73, "M1 of the test problems"),
        ("odrive-furuta", 9.34, "its free swings: 87.2 rad²/s²"),
        ("stepper-freeswing", 10.95, "its free swings: 119.9 rad²/s²"),
    ],
)
def test_the_pendulum_of_a_rig_swings_at_its_known_frequency(rig, frequency, why):
    model = rotary_pendulum(rig)
    alone = math.sqrt(model.parameter("C4").value / model.parameter("C1").value)
    assert alone == pytest.approx(frequency, rel=0.005), why


def test_optional_terms_are_zero_in_every_rig():
    for rig in RIGS:
        model = rotary_pendulum(rig)
        off = ("coulomb_theta", "coulomb_alpha", "drag_theta", "drag_alpha", "cable_stiffness", "alpha_rest", "tilt_x",
               "tilt_y")  # fmt: skip
        for name in off:
            assert model.parameter(name).value == 0.0, (rig, name)


def test_the_parameters_stand_in_the_order_of_the_contract():
    assert rotary_pendulum().parameter_names == (
        "C1", "C3", "C4", "C6", "J_theta", "b_theta", "b_alpha", "coulomb_theta", "coulomb_alpha", "slip_speed",
        "drag_theta", "drag_alpha", "cable_stiffness", "theta_rest", "alpha_rest", "torque_per_volt", "time_scale",
        "stiction_theta", "stribeck_speed_theta", "presliding_theta", "presliding_damping_theta", "springpot_theta",
        "springpot_order_theta", "stiction_alpha", "stribeck_speed_alpha", "presliding_alpha",
        "presliding_damping_alpha", "springpot_alpha", "springpot_order_alpha", "play_theta", "arm_stiffness",
        "arm_damping", "hub_inertia", "back_emf", "dead_zone", "saturation", "tilt_x", "tilt_y", "arm_moment",
    )  # fmt: skip
    assert all(parameter.unit and parameter.description for parameter in rotary_pendulum().parameters)


def test_the_papers_c2_c5_and_i2xx_become_c6_and_j_theta():
    model = rotary_pendulum(C2=2.2e-3, C5=4e-3, I2xx=2e-5, C6=2.18e-3)
    assert model.parameter("C6").value == pytest.approx(2.18e-3)
    assert model.parameter("J_theta").value == pytest.approx(4.02e-3)


# --- Model and Parameter ---------------------------------------------------------------------------


def oscillator(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -p[0] * x[0]


SIMPLE = Model(
    name="oscillator", rhs=oscillator, states=("y", "D^q y"), orders=("q", "q"), outputs={"y": 0}, inputs=(),
    parameters=(Parameter("stiffness", "1/s^2", 4.0, "a spring", lower=0.0),), zero="", source="a test",
)  # fmt: skip


def test_with_parameters_leaves_the_model_itself_alone():
    stiffer = SIMPLE.with_parameters(stiffness=9.0)
    assert (SIMPLE.parameter_vector()[0], stiffer.parameter_vector()[0]) == (4.0, 9.0)


def test_a_state_whose_order_is_known_has_the_number_and_nobody_names_it():
    model = replace(SIMPLE, states=("y", "rate", "memory"), orders=(1.0, 1.0, "q"))
    assert model.order_names == ("q",)
    assert model.state_orders({"q": 0.4}).tolist() == [1.0, 1.0, 0.4]
    assert replace(model, orders=(1.0, 1.0, 0.5)).state_orders({}).tolist() == [1.0, 1.0, 0.5]
    with pytest.raises(InputError, match=r"unknown oscillator order 'memory'"):
        model.state_orders({"q": 0.4, "memory": 0.5})


def test_order_names_may_carry_pythons_trailing_underscore():
    orders = rotary_pendulum().state_orders(dict(lambda_=0.8, mu=0.9))
    np.testing.assert_array_equal(orders, [0.8, 0.8, 0.9, 0.9])


def test_an_order_whose_own_name_ends_so_keeps_its_underscore():
    model = replace(SIMPLE, orders=("mu_", "mu_"))
    assert model.state_orders({"mu_": 0.4}).tolist() == [0.4, 0.4]
    assert fracid.simulate(model, orders={"mu_": 0.4}, initial={}, step=0.1, end=1.0).orders.tolist() == [0.4, 0.4]


def test_initial_states_are_given_by_name_and_default_to_zero():
    x = rotary_pendulum().state_vector({"alpha": 0.2, "D^lambda theta": -1.0})
    np.testing.assert_array_equal(x, [0.0, -1.0, 0.2, 0.0])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: rotary_pendulum("srv02"), r"unknown rig 'srv02': did you mean srv02-rotpen.*stepper-freeswing"),
        (lambda: rotary_pendulum(zero="down"), "zero = 'down': expected 'hanging' or 'upright'"),
        (lambda: rotary_pendulum(actuation="current"), "actuation = 'current': expected 'voltage'"),
        (lambda: rotary_pendulum(J_teta=1e-2), "rotary-pendulum parameter 'J_teta': did you mean J_theta"),
        (lambda: rotary_pendulum(C2=1e-3), "C2 alone: C2, C5 and I2xx go together"),
        (lambda: rotary_pendulum(C2=1e-3, C5=1e-2, I2xx=0.0, C6=5.0), "C6 = 5.0, but C2, C5 and I2xx make it 0.001"),
        (lambda: rotary_pendulum(C2="a", C5=1, I2xx=0), "C2 = 'a': expected a finite number"),
        (lambda: rotary_pendulum(C1=0.0), "C1 = 0.0 kg m.2 is outside its physical bounds"),
        (lambda: rotary_pendulum(b_alpha=math.nan), "b_alpha = nan: expected a finite number"),
        (lambda: rotary_pendulum(b_alpha=True), "b_alpha = True: expected a finite number"),
        (lambda: SIMPLE.parameter_vector({"stiffnes": 1.0}), r"did you mean stiffness\?"),
        (lambda: SIMPLE.parameter_vector({"stiffness": -1.0}), "outside its physical bounds"),
        (lambda: replace(SIMPLE, orders=("q", 2.5)), "2.5 in orders; expected a name, or a number between 0 and 2"),
        (lambda: SIMPLE.state_orders({}), "the order 'q' .* is missing: give {'q': 1.0}"),
        (lambda: SIMPLE.state_orders({"q": 2.5}), "order q = 2.5: expected a number between 0 and 2"),
        (lambda: SIMPLE.state_orders({"q": 0}), "order q = 0: expected a number between 0 and 2"),
        (lambda: SIMPLE.state_orders({"q": "1"}), "order q = '1': expected a number"),
        (lambda: SIMPLE.state_orders({"q": 1.0, "mu": 1.0}), "unknown oscillator order 'mu'"),
        (lambda: SIMPLE.state_vector({"z": 1.0}), "unknown oscillator state 'z'"),
        (lambda: SIMPLE.state_vector({"y": math.inf}), "initial state y = inf: expected a finite number"),
        (lambda: Parameter("b c", "s", 1.0, ""), "must be a Python identifier, not 'b c'"),
        (lambda: replace(SIMPLE, orders=("q",)), "2 states and 1 order names"),
        (lambda: replace(SIMPLE, orders="qq"), "orders = 'qq': expected a tuple"),
        (lambda: replace(SIMPLE, states=("y", "y")), "'y' stands twice in states"),
        (lambda: replace(SIMPLE, outputs={"y": 2}), "output 'y' points to state 2; expected an index from 0 to 1"),
        (lambda: replace(SIMPLE, outputs=("y",)), r"outputs = \('y',\): expected each output with .* \{\"alpha\": 0\}"),
        (lambda: replace(SIMPLE, parameters=("k",)), "parameters = 'k': expected a tuple of fracid.models.Parameter"),
        (lambda: replace(SIMPLE, zero="left"), "zero = 'left'; expected one of"),
        (lambda: replace(SIMPLE, integer_orders={"r": 0}), "unknown order in integer_orders of oscillator 'r'"),
        (lambda: replace(SIMPLE, integer_orders={"q": 2}), "q = 2; expected 0, 1, or None where no integer"),
        (lambda: replace(SIMPLE, integer_orders={"q": True}), "integer_orders q = True: expected 0, 1, or None"),
        (lambda: replace(SIMPLE, rhs="f"), r"rhs = 'f': expected a function rhs\(t, x, u, p, out\)"),
        (lambda: Geometry(pendulum_mass=-1, pendulum_com=1, arm_length=1, arm_inertia=1, I2yy=1, I2zz=1),
         "pendulum_mass = -1: expected a finite number"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_with_its_value_and_what_was_expected(call, message):
    with pytest.raises(InputError, match=message):
        call()


# --- models by name --------------------------------------------------------------------------------

USERS_FILE = """
from fracid.models import Model, Parameter

def rhs(t, x, u, p, out):
    out[0] = -p[0] * x[0]

model = Model(name="decay", rhs=rhs, states=("y",), orders=("q",), outputs={"y": 0}, inputs=(),
              parameters=(Parameter("rate", "1/s", 1.0, "of decay"),), zero="", source="mine")

def make(rig="a"):
    return model.with_parameters(rate={"a": 2.0, "b": 3.0}[rig])

def wrong():
    return 5

number = 5
"""


@pytest.fixture
def users_folder(tmp_path):
    (tmp_path / "mine.py").write_text(USERS_FILE)
    (tmp_path / "broken.py").write_text("x = 1\ny = 1 / 0\n")
    (tmp_path / "typo.py").write_text("x = (\n")
    return tmp_path


def test_a_built_in_model_is_found_by_name():
    model = model_from_name("rotary-pendulum", "qube-servo2", "upright", "torque", parameters={"C1": 1e-3})
    assert (model.zero, model.inputs, model.parameter("C1").value) == ("upright", ("torque",), 1e-3)


@pytest.mark.parametrize(("gain", "lag"), [(2.0, 3.0), (1.0, 2.0), (0.5, 0.05)])
def test_round_constants_do_not_make_the_rate_of_a_state_of_another(gain, lag):
    def rhs(t, x, u, p, out):
        out[0], out[1], out[2] = p[0] * x[0], (x[0] + p[1] * 0.1 - x[1]) / p[1], x[1]

    constants = Parameter("gain", "1", gain, "of itself"), Parameter("lag", "s", lag, "behind it")
    model = Model("three", rhs, ("a", "b", "c"), (1.0, 1.0, 1.0), {"c": 2}, (), constants, "", "a test")
    assert model.rates == {2: 1}


@pytest.mark.parametrize(
    ("name", "options", "rate"),
    [
        ("mine.py:model", {}, 1.0),
        ("mine.py:model", {"zero": "", "parameters": {"rate": 7.0}}, 7.0),
        ("mine.py:make", {}, 2.0),
        ("mine.py:make", {"rig": "b"}, 3.0),
    ],
)
def test_a_users_file_gives_a_model_or_a_function_that_makes_one(users_folder, name, options, rate):
    model = model_from_name(name, folder=users_folder, **options)
    assert model.parameter("rate").value == rate


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("rotary_pendulum", {}, r"unknown model .*'rotary_pendulum': did you mean rotary-pendulum or pendulum\?"),
        ("rotary-pendulum", {"parameters": {"C9": 1.0}}, "unknown rotary-pendulum parameter 'C9'"),
        ("none.py:model", {}, "there is no file .*none.py"),
        ("mine.py", {}, 'expected a file and a name in it, like "my_rig.py:model"'),
        ("mine.txt:model", {}, "expected a file and a name in it"),
        ("mine.py:modle", {}, r"unknown name in .*mine.py 'modle': did you mean model"),
        ("mine.py:number", {}, "is 5: expected a fracid Model or a function"),
        ("mine.py:wrong", {}, "is 5: expected a fracid Model or a function"),
        ("mine.py:wrong", {"rig": "b"}, "cannot be called with {'rig': 'b'}"),
        ("mine.py:make", {"rig": "c"}, "KeyError: 'c'"),
        ("mine.py:model", {"rig": "b"}, "is a Model, which knows no rig: leave rig out"),
        ("mine.py:model", {"zero": "upright"}, "has zero = '', not 'upright'"),
        ("broken.py:x", {}, "broken.py, line 2, does not run: ZeroDivisionError"),
        ("typo.py:x", {}, "typo.py, line 1, does not run: SyntaxError"),
    ],
)
def test_a_wrong_model_name_is_told_in_our_words(users_folder, name, options, message):
    with pytest.raises(InputError, match=message):
        model_from_name(name, folder=users_folder, **options)
