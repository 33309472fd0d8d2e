"""An observer knows the states, constants and orders of a model, and how well it knows them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import gamma

import fracid
from fracid import observer
from fracid.errors import InputError
from fracid.solver.kalman import weights

STEP, N, NOISE, FORCE = 0.01, 800, 1e-3, 2e-3
MODEL = fracid.model("pendulum")
INTENSITY = (FORCE / MODEL.parameter("J").value) ** 2 * STEP
SPREAD = {"angle": 0.01, "rate": 0.05}


def twin(seed, mu=0.93, force=FORCE, **constants):
    """States of a pendulum that an unknown torque drives, and its angle as a sensor has it."""
    random = np.random.default_rng(seed)
    u = force * random.standard_normal((N, 1))
    initial = {"angle": 1.0 + SPREAD["angle"] * random.standard_normal(), "rate": 0.05 * random.standard_normal()}
    e = fracid.Experiment("twin", STEP, np.zeros((N, 1)), u, initial=initial, between={"torque": "hold"})
    problem = fracid.Problem(MODEL.with_parameters(**constants), (e,), {"mu": mu}, initial_state="held")
    states = problem.simulate(problem.start, e).states
    return states, states[:, :1] + NOISE * random.standard_normal((N, 1))


def fit_of(measured, mu=0.93, **more):
    e = fracid.Experiment("twin", STEP, measured, np.zeros((1, 1)), initial={"angle": 1.0}, **more)
    problem = fracid.Problem(MODEL, (e,), {"mu": mu}, initial_state="held")
    return SimpleNamespace(problem=problem, x=problem.start)


@pytest.fixture(scope="module")
def watch():
    """With the intensity of the force that drives the twins."""
    made = observer(fit_of(twin(0)[1]), noise={"angle": NOISE}, initial=SPREAD, drive=1.0)
    made.start.drive[:] = 0.0, INTENSITY
    return made


def nees(made, states):
    track = made.run(states[1])
    error = np.array([track.states[n][-1] for n in MODEL.states]) - states[0][-1]
    return error @ np.linalg.solve(made.covariance, error), np.mean(track.nis)


def test_the_modes_are_the_kernel_of_the_order_and_their_slopes_that_of_its_change():
    lowest, count = 1e-3, 16
    rates = lowest * np.exp(np.arange(count))
    c, dc, more = np.zeros(count + 3), np.zeros(count + 3), np.zeros(count + 3)
    t = np.geomspace(5e-3, 30, 40)
    modes = np.vstack([np.zeros_like(t), np.ones_like(t), np.exp(-rates[:, None] * t), np.zeros_like(t)])
    for q in (0.3, 0.6, 0.93, 1.0, 1.1):
        weights.py_func(q, np.array([lowest, 1.0, count]), count + 3, c, dc, 0)
        np.testing.assert_allclose(c @ modes, t ** (q - 1) / gamma(q), rtol=3e-3)
        weights.py_func(q + 1e-3, np.array([lowest, 1.0, count]), count + 3, more, np.zeros(count + 3), 0)
        np.testing.assert_allclose(dc, (more - c) / 1e-3, rtol=0.02, atol=1e-4 * np.abs(dc).max())


@pytest.mark.broad
@pytest.mark.parametrize("mu", [0.93, 1.0])
def test_without_a_sensor_it_goes_as_the_model_goes(mu):
    states, measured = twin(1, mu, force=0.0)
    made = observer(fit_of(measured, mu), noise={"angle": NOISE}, drive=0.0)
    made.now.xi[made.now.begin[:2]] = states[0]
    track = made.run(np.full_like(measured, np.nan))
    assert (len(made.start.xi) == 2) == (mu == 1.0)
    for i, n in enumerate(MODEL.states):
        assert np.abs(track.states[n] - states[:, i]).max() < 1e-3 * np.ptp(states[:, i])
    assert np.all(track.count == 0)


def test_over_twins_its_errors_and_innovations_are_as_large_as_it_says(watch):
    found = []
    for seed in range(1, 31):
        watch.reset()
        found.append(nees(watch, twin(seed)))
    states, innovations = np.mean(found, axis=0)
    assert 1.3 < states < 2.8  # 95 % of the mean of 30 draws of χ² with 2 degrees of freedom
    assert 0.97 < innovations < 1.03


def test_an_unknown_drive_spreads_the_states_as_held_torques_of_its_size_do():
    fit = fit_of(twin(0)[1], between={"torque": "hold"})
    made, steps = observer(fit, noise={"angle": NOISE}, initial=dict.fromkeys(SPREAD, 0.0), drive=1.0), 6
    made.start.drive[:] = 0.0, INTENSITY

    def after(torque):
        made.reset()
        track = made.run(np.full((steps + 1, 1), np.nan), torque)
        return np.array([track.states[n][-1] for n in MODEL.states])

    still = after(np.zeros((steps + 1, 1)))
    moved = [after(FORCE * (np.arange(steps + 1) == k)[:, None]) - still for k in range(steps)]
    np.testing.assert_allclose(made.covariance, np.transpose(moved) @ moved, rtol=5e-3)


def test_the_drive_that_makes_a_recording_most_likely_is_that_which_drove_it():
    made = observer(fit_of(twin(0)[1]), noise={"angle": NOISE})
    assert made.start.drive[0] == 0.0
    assert 0.5 < made.start.drive[1] / INTENSITY < 2.0


def test_held_inputs_that_are_known_leave_no_drive():
    u = 0.05 * np.random.default_rng(2).standard_normal((N, 1))
    e = fracid.Experiment("twin", STEP, np.zeros((N, 1)), u, initial={"angle": 1.0}, between={"torque": "hold"})
    problem = fracid.Problem(MODEL, (e,), {"mu": 0.93}, initial_state="held")
    noisy = problem.simulate(problem.start, e).states[:, :1] + NOISE * np.random.default_rng(1).standard_normal((N, 1))
    problem = replace(problem, experiments=(replace(e, measured=noisy),))
    made = observer(SimpleNamespace(problem=problem, x=problem.start), noise={"angle": NOISE})
    assert made.start.drive[1] < 1e-3 * (0.05 / MODEL.parameter("J").value) ** 2 * STEP


def test_an_output_with_a_held_input_jumps_with_it_and_nothing_else_is_moved():
    capacitor, random = fracid.model("capacitor"), np.random.default_rng(1)
    orders = dict.fromkeys(capacitor.order_names, 0.95)
    u = np.repeat(random.choice([-1.0, 0.0, 1.0], (20, 1)), 20, axis=0)
    v = fracid.simulate(capacitor, orders=orders, initial={}, step=0.1, end=39.9, inputs=u, between="hold").states[
        :, :1
    ]
    y = v + capacitor.parameter("R").value * u + NOISE * random.standard_normal(u.shape)
    e = fracid.Experiment("twin", 0.1, y, u, initial={"v": 0.0}, between={"current": "hold"})
    problem = fracid.Problem(capacitor, (e,), orders, initial_state="held")
    made = observer(SimpleNamespace(problem=problem, x=problem.start), noise={"voltage": NOISE}, drive=0.0)
    track = made.run(y, u)
    assert np.abs(track.innovations).max() < 5 * NOISE
    made.reset()
    for k in range(100):  # as a controller goes, which knows its input after the estimate
        step = made.step(y[k] + (u[max(k - 1, 0)] - u[k]) * capacitor.parameter("R").value, u[max(k - 1, 0)])
        made.now.u[:] = u[k]
    assert step.states["v"][0] == pytest.approx(track.states["v"][99], abs=1e-9)


def test_where_a_sensor_drops_out_it_says_that_it_knows_less_and_finds_back(watch):
    states, measured = twin(3)
    measured[300:400] = np.nan
    watch.reset()
    track = watch.run(measured)
    error, deviation = track.states["angle"] - states[:, 0], track.deviations["angle"]
    assert deviation[399] > 5 * deviation[299]
    assert deviation[500] < 1.5 * deviation[299]
    assert np.all(np.abs(error[300:]) < 5 * deviation[300:])


def test_a_friction_that_changes_and_a_wrong_order_are_found():
    _, measured = twin(5, force=1e-4, b_angle=6e-4)
    made = observer(fit_of(measured), noise={"angle": NOISE}, slow={"b_angle": 1e-5, "mu": 1e-4}, drive=1e-3,
                    initial=SPREAD | {"b_angle": 4e-4, "mu": 0.05})  # fmt: skip
    made.now.xi[len(made.now.z) + 1] = 0.97
    track = made.run(measured)
    assert abs(track.states["mu"][-1] - 0.93) < max(3 * track.deviations["mu"][-1], 3e-3)
    assert abs(track.states["b_angle"][-1] - 6e-4) < max(3 * track.deviations["b_angle"][-1], 6e-5)
    assert track.deviations["mu"][-1] < 5e-3


def test_sample_by_sample_is_the_same_as_all_at_once(watch):
    _, measured = twin(7)
    watch.reset()
    whole = watch.run(measured[:50])
    watch.reset()
    rates = [watch.step(row).states["rate"][0] for row in measured[:50]]
    np.testing.assert_array_equal(rates, whole.states["rate"])


@pytest.mark.broad
def test_inputs_in_lines_and_held_ones_go_as_fracid_takes_them_at_a_finer_step_too():
    joint, t = fracid.model("joint"), STEP * np.arange(400)
    u = np.outer(0.2 * np.sin(5 * t), [name == "torque" for name in joint.inputs])
    for kind in ("line", "hold"):
        e = fracid.Experiment("twin", STEP, np.zeros((400, 1)), u, between=dict.fromkeys(joint.inputs, kind))
        problem = fracid.Problem(joint, (e,), {"mu": 1.0}, initial_state="held", substeps=2)
        states = problem.simulate(problem.start, e).states[::2]
        measured = replace(e, measured=states[:, :1] + 1e-6 * np.random.default_rng(1).standard_normal((400, 1)))
        made = observer(SimpleNamespace(problem=replace(problem, experiments=(measured,)), x=problem.start),
                        noise={"angle": 1e-6}, drive=0.0)  # fmt: skip
        track = made.run(np.full((400, 1), np.nan), u)
        assert np.abs(track.states["angle"] - states[:, 0]).max() < 2e-4 * np.ptp(states[:, 0])


REFUSED = {
    "'beta'": {"sensors": ("beta",)},
    "'C9'": {"slow": {"C9": 0.0}},
    "b_angle drifts by -1 in 1 s; expected 0 or more": {"slow": {"b_angle": -1.0}},
    "coulomb_angle is 0, of which no tenth": {"slow": {"coulomb_angle": 0.0}},
    "slip_speed cannot be observed from angle": {"slow": {"slip_speed": 0.0}},
    "J and gravity and b_angle cannot be distinguished": {"slow": dict.fromkeys(("J", "gravity", "b_angle"), 0.0)},
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_it_cannot_do_is_refused_in_a_sentence(words):
    with pytest.raises(InputError, match=words):
        observer(fit_of(twin(1)[1]), **REFUSED[words])


def test_the_derivative_of_a_state_is_refused_as_a_sensor():
    fit = fit_of(twin(1)[1])
    outputs = {**MODEL.outputs, "angle_rate": MODEL.outputs["angle"]}
    fit.problem = replace(fit.problem, model=replace(MODEL, outputs=outputs, derived={"angle_rate": ("angle", 1)}))
    with pytest.raises(InputError, match="angle_rate is the derivative of a state"):
        observer(fit, ("angle_rate",))


def test_an_arm_that_nothing_holds_is_not_observed_from_the_pendulum():
    rig = fracid.rotary_pendulum()
    run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 0.95}, initial={"alpha": 0.3}, step=5e-3, end=2.0)
    noisy = run.states[:, [0, 2]] + 1e-4 * np.random.default_rng(1).standard_normal((len(run.states), 2))
    e = fracid.Experiment("twin", 5e-3, noisy, np.zeros((1, 1)), initial={"alpha": 0.3})
    problem = fracid.Problem(rig, (e,), {"lambda": 1.0, "mu": 0.95}, initial_state="held")
    with pytest.raises(InputError, match="theta cannot be observed from alpha: along the recording"):
        observer(SimpleNamespace(problem=problem, x=problem.start), ("alpha",))


def test_presliding_channels_and_other_units_of_time_are_refused():
    joint = fracid.model("joint").with_parameters(coulomb_angle=0.1, presliding_angle=0.01)
    e = fracid.Experiment("twin", STEP, np.zeros((50, 1)), np.zeros((1, len(fracid.model("joint").inputs))))
    problem = fracid.Problem(joint, (e,), {"mu": 1.0}, initial_state="held")
    with pytest.raises(InputError, match="z forgets within a step"):
        observer(SimpleNamespace(problem=problem, x=problem.start))
    slow = fracid.rotary_pendulum(time_scale=0.1)
    e = fracid.Experiment("twin", STEP, np.zeros((50, 2)), np.zeros((1, 1)))
    problem = fracid.Problem(slow, (e,), {"lambda": 0.9, "mu": 0.9}, initial_state="held")
    with pytest.raises(InputError, match="time_scale = 1"):
        observer(SimpleNamespace(problem=problem, x=problem.start))
    delayed = fit_of(twin(1)[1], sensors={"angle": fracid.Sensor(delay=1e-3)})
    with pytest.raises(InputError, match="delay, gain, bias and lowpass of angle"):
        observer(delayed)
