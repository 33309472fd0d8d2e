"""The simulated rigs that attack fracid's claims: each scheme against theory, and against schemes of others."""

import ast
import inspect
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import erfcx, gamma

import fracid
from scripts import module_of

COUNT = 2 * np.pi / 4096


@pytest.fixture(scope="module")
def rigs():
    """benchmarks/independent_rigs.py, which is no package."""
    return module_of("benchmarks/independent_rigs.py", "independent_rigs")


def released(rigs, angle, rate=0.0):
    x = np.zeros(len(rigs.STATES))
    x[[2, 8]], x[1] = angle, rate
    return x


def bare(rigs, **constants):
    """An arm alone, inertia 1, without friction."""
    zero = dict.fromkeys(("C3", "C4", "C6", "b_theta", "b_alpha", "coulomb_theta", "coulomb_alpha", "cable"), 0.0)
    return rigs.Rig(**zero | {"J_theta": 1.0} | constants)


def test_nothing_of_fracid_is_in_the_twins(rigs):
    tree = ast.parse(inspect.getsource(rigs))
    imports = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    imports |= {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert not {name for name in imports if name.split(".")[0] == "fracid"}


def test_the_equations_are_those_that_fracid_derives_on_its_own(rigs):
    p = rigs.Rig(drag_theta=2e-3, drag_alpha=1e-4, torque_per_volt=-0.1, lean_x=0.03,
                 lean_y=-0.02)  # fmt: skip
    names = {"arm_moment", "b_theta", "b_alpha", "coulomb_theta", "coulomb_alpha", "slip_speed", "drag_theta",
             "drag_alpha", "C1", "C3", "C4", "C6", "J_theta", "torque_per_volt"}  # fmt: skip
    model = fracid.rotary_pendulum(**{n: getattr(p, n) for n in names}, cable_stiffness=p.cable,
                                   tilt_x=p.lean_x, tilt_y=p.lean_y)  # fmt: skip
    rng, out, theirs = np.random.default_rng(1), np.zeros(11), np.zeros(4)
    for x in rng.uniform(-3, 3, (20, 11)):
        rigs.rates(0.0, x, 2.0, 0.0, p, np.zeros(2), out, np.zeros(2))
        model.rhs(0.0, x[:4], np.array([2.0]), model.parameter_vector(), theirs)
        np.testing.assert_allclose(out[:4], theirs, rtol=1e-9)


@pytest.mark.parametrize("geared", [False, True])
def test_without_friction_energy_stays(rigs, geared):
    lossless = dict.fromkeys(("b_theta", "b_alpha", "coulomb_theta", "coulomb_alpha"), 0.0)
    hub = {"hub_inertia": 2e-3, "shaft_stiffness": 30.0} if geared else {}
    p = rigs.Rig(**lossless, **hub, cable_cubic=0.1, lean_x=0.03, lean_y=-0.02)
    energy = rigs.energy(p, rigs.ordinary(p, released(rigs, 2.0), step=1e-4, end=5.0, kept=50))
    assert np.ptp(energy) < 1e-8 * 0.19


@pytest.mark.few(2)
@pytest.mark.parametrize("name", ["none", "lugre", "elastic", "alpha-lowpass", "fading"])
def test_runge_kutta_agrees_with_dop853(rigs, name):
    twin, holding, slip = rigs.drawn_twin(name, rigs.KINDS[name].severities[-1], 1), np.zeros(2), np.zeros(2)

    def f(t, x):
        out = np.zeros(11)
        rigs.rates(t, x, 0.0, 0.0, twin.rig, slip, out, holding)
        out[9:] = 0
        return out

    x = rigs.ordinary(twin.rig, released(rigs, 1.3), step=twin.step, end=1.5, kept=round(1e-2 / twin.step))
    run = solve_ivp(f, (0, 1.5), released(rigs, 1.3), "DOP853", np.linspace(0, 1.5, 151), rtol=1e-10, atol=1e-12)
    assert np.abs(x[:, [0, 2]] - run.y[[0, 2]].T).max() < 1e-3 * COUNT


def test_bristles_are_springs_of_stiffness_sigma_0_in_a_slow_reversal(rigs):
    p = rigs.Rig(friction=rigs.BRISTLE, coulomb_theta=0.03, stiction_theta=0.07, presliding_theta=0.01, cable=0.0)
    time = np.arange(0, 20, 0.01)
    torque = 1e-3 * np.sin(2 * np.pi * 0.1 * time)  # a hundredth of what breaks the joint away
    x = rigs.ordinary(p, released(rigs, 0.0), step=1e-4, end=20.0 - 0.01, kept=100,
                      drive=rigs.Drive(torque / p.torque_per_volt, period=0.01, held=False))  # fmt: skip
    slope = np.polyfit(x[1000:, 0], torque[1000:], 1)[0]
    assert slope == pytest.approx((0.03 + 0.07) / 0.01, rel=0.03)


def test_a_stuck_joint_stands_still_until_its_breakaway_torque(rigs):
    p = rigs.Rig(friction=rigs.SET_VALUED, coulomb_theta=0.03, stiction_theta=0.02, cable=0.0, b_theta=0.0)
    torque = np.array([0.0] + [0.0499] * 20 + [0.0501] * 20)
    x = rigs.ordinary(
        p, released(rigs, 0.0), step=1e-3, end=4.0, drive=rigs.Drive(torque / p.torque_per_volt, period=0.1)
    )
    assert np.all(x[:2101, [0, 1]] == 0.0)
    assert x[-1, 0] > 0.01


def test_set_valued_friction_of_a_linear_swing_takes_2f_over_k_a_half_swing(rigs):
    """The exact solution of a mass on a spring: turning points lie 2·f/k lower each, and it sticks within f/k."""
    k, f = 4.0, 0.1
    p = bare(rigs, friction=rigs.SET_VALUED, cable=k, coulomb_theta=f)
    x0 = np.zeros(11)
    x0[0] = 0.33
    x = rigs.ordinary(p, x0, step=1e-3, end=12.0)
    turns = 0.33 - 2 * f / k * np.arange(7)  # 0.33 … 0.03
    at = np.round(np.arange(7) * math.pi / 2 / 1e-3).astype(int)
    np.testing.assert_allclose(x[at, 0], turns * (-1.0) ** np.arange(7), atol=2e-6)
    assert np.all(x[11100:, 1] == 0.0)
    assert x[-1, 0] == pytest.approx(0.02, abs=1e-8)


@pytest.mark.broad
def test_fractional_relaxation_is_the_mittag_leffler_function(rigs):
    """D^½ v = −v, v(0) = 1: v = exp(t)·erfc(√t)."""
    p = bare(rigs, b_theta=1.0)
    x = rigs.fractional(p, released(rigs, 0.0, 1.0), orders=(0.5, 1.0), step=1e-3, end=4.0)
    t = 1e-3 * np.arange(len(x))
    assert np.abs(x[100:, 1] - erfcx(np.sqrt(t[100:]))).max() < 1e-4
    finer = rigs.fractional(p, released(rigs, 0.0, 1.0), orders=(0.5, 1.0), step=2.5e-4, end=4.0)
    errors = [np.abs(y[-1, 1] - erfcx(2.0)) for y in (x, finer)]
    assert errors[1] < errors[0] / 4


def test_a_mass_on_a_springpot_is_the_exact_solution(rigs):
    """v' = −c·I^{1−ν} v, v(0) = 1: v = E_{2−ν}(−c·t^{2−ν})."""
    c, nu = 3.0, 0.3
    p = bare(rigs, springpot_theta=c)
    x = rigs.fractional(p, released(rigs, 0.0, 1.0), springpot_orders=(nu, 0.5), step=1e-3, end=4.0)
    z = -c * (1e-3 * np.arange(len(x))) ** (2 - nu)
    exact = sum(z**k / gamma((2 - nu) * k + 1) for k in range(60))
    assert np.abs(x[:, 1] - exact).max() < 1e-5


def test_the_sums_by_halves_are_the_plain_sums(rigs):
    """At orders 1 both schemes solve the same equations."""
    p, initial = rigs.Rig(), released(rigs, 1.0)
    plain = rigs.ordinary(p, initial, step=1e-3, end=3.0)
    assert np.abs(rigs.fractional(p, initial, step=2e-4, end=3.0)[::5, :4] - plain[:, :4]).max() < 1e-3


def test_fractional_orders_agree_with_the_solver_that_they_are_to_test(rigs):
    p = rigs.Rig(coulomb_theta=0.0, coulomb_alpha=0.0)
    orders = {"lambda": 0.85, "mu": 0.92}
    names = ("C1", "C3", "C4", "C6", "J_theta", "b_theta", "b_alpha")
    model = fracid.rotary_pendulum(**{n: getattr(p, n) for n in names}, cable_stiffness=p.cable)
    theirs = fracid.simulate(model, orders=orders, initial={"alpha": 1.0}, step=1e-4, end=2.0).states
    ours = rigs.fractional(p, released(rigs, 1.0), orders=(0.85, 0.92), step=1e-4, end=2.0)[:, :4]
    assert np.abs(ours - theirs)[:, [0, 2]].max() < 0.01 * COUNT


def test_a_recording_is_whole_encoder_steps_held_before_the_release(rigs):
    r = rigs.recording("none", 1, seed=2, seconds=2.0, rate=250, release=40.0, plateau=0.5)
    steps = r.alpha / COUNT
    assert r.time.size == 626
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert np.ptp(r.alpha[r.time < r.truth.begin]) <= 2 * COUNT
    assert math.degrees(r.alpha[0]) == pytest.approx(40, abs=0.2)
    assert 0.5 <= r.truth.begin < 0.504


def test_takes_of_a_seed_share_the_rig_and_nothing_else(rigs):
    one, two, other = (rigs.recording("pulses", 1, seed=s, take=k, seconds=3.0) for s, k in ((1, 0), (1, 1), (2, 0)))
    assert one.truth.rig == two.truth.rig != other.truth.rig
    assert not np.array_equal(one.voltage, two.voltage)
    again = rigs.recording("pulses", 1, seed=1, take=0, seconds=3.0)
    assert np.array_equal(one.alpha, again.alpha)


def test_a_signal_that_is_read_late_is_the_same_signal_later(rigs):
    twin = rigs.Twin(rigs.Rig(), rigs.Sensor(counts=1e9, noise=0.0, alpha_late=4e-3))
    time = np.arange(0, 1, 2e-3)
    x = rigs.ordinary(twin.rig, released(rigs, 1.0), step=1e-4, end=1.0)
    _, alpha = rigs._read(twin, x, 1e-4, time, np.random.default_rng(1))
    np.testing.assert_allclose(alpha[2:], x[: 20 * (time.size - 2) : 20, 2], atol=1e-8)


def test_there_are_fifteen_kinds_of_integer_order_truth_and_fractional_ones(rigs):
    kinds = rigs.KINDS.values()
    assert sum(not k.fractional for k in kinds) >= 15
    assert sum(k.fractional for k in kinds) >= 5


@pytest.mark.broad
def test_every_kind_makes_a_recording_that_its_kind_shapes(rigs, tmp_path):
    plain = {}
    for k in rigs.KINDS.values():
        r = rigs.recording(k.name, k.severities[-1], seed=4, seconds=0.8, plateau=0.2)
        file = rigs.write(r, tmp_path)
        assert np.isfinite(np.loadtxt(file, delimiter=",", skiprows=1)).all()
        plain.setdefault(r.alpha.tobytes() + r.theta.tobytes(), []).append(k.name)
    assert [names for names in plain.values() if len(names) > 1] == []


@pytest.mark.broad
def test_coupled_joints_that_stick_are_the_limit_of_ever_steeper_smooth_friction(rigs):
    stuck = rigs.Rig(friction=rigs.SET_VALUED, coulomb_theta=0.05, coulomb_alpha=0.02)
    x = rigs.ordinary(stuck, released(rigs, 1.3), step=1e-4, end=3.0, kept=100)
    errors = []
    for slip_speed in (1e-2, 1e-3):
        smooth = stuck._replace(friction=rigs.TANH, slip_speed=slip_speed)
        y = rigs.ordinary(smooth, released(rigs, 1.3), step=1e-5, end=3.0, kept=1000)
        errors.append(np.abs(x - y)[:, [0, 2]].max())
    assert np.mean(x[:, 1] == 0.0) > 0.2  # the arm sticks now and then
    assert errors[1] < errors[0] / 5
