"""A servo that lifts and drops a mass by its own loop: what is known in one recording alone, and what a fit finds."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.problem import Free, Problem
from fracid.problem.project import load_project
from fracid.workflows.draft import write_draft

pytestmark = pytest.mark.usefixtures("without_rivals")

RECORDINGS = Path(__file__).parents[2] / "examples" / "real" / "xl330"

TRUE = {"J": 2e-3, "torque_constant": 0.3, "resistance": 2.0, "b_angle": 0.012, "load_angle": 0.15}
FIXED = {"mass": 0.5, "torque_per_volt": 0.0, "slip_speed": 1e-2}
STEP, SAMPLES = 0.005, 900


def moved(gain, seed, model=fracid.model("joint", **FIXED, **TRUE)):
    """A recording of a gain: a sine, a hold, and from 3 s on no torque."""
    t = STEP * np.arange(SAMPLES)
    signals = {"goal": np.where(t < 2, 1.2 * np.sin(3 * t), 1.0), "torque_enable": (t < 3).astype(float)}
    u = np.column_stack([signals.get(n, 0 * t) for n in model.inputs])
    run = fracid.simulate(model.with_parameters(gain=gain), initial={}, step=STEP, end=t[-1], inputs=u, method="bdf2",
                          between="hold")  # fmt: skip
    angle = run.states[:, :1] + 1e-3 * np.random.default_rng(seed).standard_normal((SAMPLES, 1))
    return fracid.Experiment(f"gain {gain}", STEP, angle, u, constants={"gain": gain},
                             between=dict.fromkeys(model.inputs, "hold"))  # fmt: skip


@pytest.mark.broad
def test_the_constants_of_a_servo_under_load_lie_in_their_intervals():
    ranges = {n: Free(1.4 * v, v / 10, 10 * v) for n, v in TRUE.items()}
    experiments = (moved(0.3, 1), moved(1.0, 2))
    problem = Problem(fracid.model("joint"), experiments, {"mu": 1.0}, FIXED | ranges, initial_state="held",
                      method="bdf2")  # fmt: skip
    fit = fracid.identify(problem, jobs=2)
    for name, true in TRUE.items():
        low, high = fit.parameters[name].interval95
        assert low < true < high, name
        assert high - low < 0.3 * true, name


def test_a_constant_that_one_recording_knows_holds_in_it_alone():
    strong, weak = moved(1.0, 1), moved(0.1, 1)
    problem = Problem(fracid.model("joint"), (strong, weak), {"mu": 1.0}, FIXED | TRUE, initial_state="held",
                      method="bdf2")  # fmt: skip
    assert problem.cost(problem.start) < 2e-3
    swapped = replace(weak, constants={"gain": 1.0})
    assert replace(problem, experiments=(strong, swapped)).cost(problem.start) > 0.1


def test_a_recording_that_knows_a_parameter_that_the_model_has_not_is_refused(tmp_path):
    np.savez(tmp_path / "log.npz", time=STEP * np.arange(200), angle=np.sin(np.arange(200) / 20))
    text = '[model]\nname = "joint"\n[[recording]]\nfile = "log.npz"\nangle = { column = "angle" }\n'
    (tmp_path / "rig.toml").write_text(text + "parameters = { gains = 0.3 }")
    with pytest.raises(InputError, match=r"'gains'.*gain"):
        load_project(tmp_path / "rig.toml")
    (tmp_path / "rig.toml").write_text(text + "parameters = { gain = 0.3, mass = 0.5 }")
    assert dict(load_project(tmp_path / "rig.toml").problem.experiments[0].constants) == {"gain": 0.3, "mass": 0.5}


def servo_log(folder, name, about=0.0, **beside):
    """One of the servo's recordings as BAM writes its logs, its angles about another zero."""
    rows = csv.DictReader((RECORDINGS / f"{name}.csv").read_text(encoding="utf-8").splitlines())
    entries = [{"timestamp": float(r["t"]), "position": about + float(r["position"]), "input_volts": 7.3,
                "goal_position": about + float(r["goal"]), "torque_enable": r["torque_enable"] == "1"}
               for r in rows]  # fmt: skip
    beside = {"mass": 0.49, "length": 0.1, "kp": int(name[2:5]), "vin": 7.4, "motor": "xl330"} | beside
    path = folder / f"{name}.json"
    path.write_text(json.dumps({n: v for n, v in beside.items() if v is not None} | {"entries": entries}))
    return path


def drafted(folder, *logs, says=""):
    notes = write_draft(logs[0], folder / "servo.toml", None, more=logs[1:]).notes
    assert not says or any(says in note for note in notes)
    return load_project(folder / "servo.toml").problem


def test_a_draft_takes_the_constants_that_a_servos_log_says_and_its_loop(tmp_path):
    problem = drafted(tmp_path, servo_log(tmp_path, "kp100_lift_and_drop", arm_mass=0.1))
    said = {"mass": 0.49, "length": 0.1, "supply": 7.4, "gain": 0.2877, "gravity": 0.1 * 9.80665 * 0.05}
    assert {n: problem.parameters[n] for n in said} == pytest.approx(said, rel=1e-4)
    free = {n for n, v in problem.parameters.items() if isinstance(v, Free)}
    assert free == {"J", "level", "resistance", "torque_constant", "b_angle", "coulomb_angle", "load_angle",
                    "load_directional_angle"}  # fmt: skip
    inputs = dict(zip(problem.model.inputs, problem.experiments[0].inputs.T, strict=True))
    assert not inputs["voltage"].any()
    assert {*inputs["torque_enable"]} == {0.0, 1.0}
    assert problem.experiments[0].between["torque_enable"] == "hold"


@pytest.mark.few(1)
@pytest.mark.parametrize(("jump", "start"), [(0.0, "rest"), (0.5, "estimate")])
def test_a_servos_draft_begins_at_rest_where_its_log_does_and_else_finds_how_it_begins(tmp_path, jump, start):
    """The slope of its first samples was taken for its rate: a goal that has just jumped bends them."""
    t = STEP * np.arange(400)
    angle = 0.4 * np.sin(np.maximum(t - 0.2, 0.0)) + jump * (1 - np.cos(np.minimum(12 * t, np.pi)))
    np.savez(tmp_path / "log.npz", time=t, goal=np.round(angle / 1.5e-3) * 1.5e-3, q=np.round(angle / 1.5e-3) * 1.5e-3)
    assert drafted(tmp_path, tmp_path / "log.npz").initial_state == start


def test_a_load_that_hangs_where_a_servo_counts_its_middle_is_sought_there(tmp_path):
    """Of 4096 counts a turn 2048: the level was sought about 0, where gravity pulls the other way."""
    problem = drafted(tmp_path, servo_log(tmp_path, "kp100_sin_sin"))
    assert problem.parameters["level"] == Free(0.0, -0.2, 0.2)
    raw = servo_log(tmp_path, "kp100_sin_sin", about=np.pi)
    says = "level is sought about 180°, the quarter turn nearest to the middle of the motion: is it where the load"
    level = drafted(tmp_path, raw, says=says).parameters["level"]
    assert (level.start, level.lower, level.upper) == pytest.approx((np.pi, np.pi - 0.2, np.pi + 0.2), abs=6e-3)


def test_logs_with_other_gains_and_masses_have_them_with_their_recording(tmp_path):
    light, heavy = servo_log(tmp_path, "kp100_sin_sin"), servo_log(tmp_path, "kp400_up_and_down", mass=1.0)
    problem = drafted(tmp_path, light, heavy)
    own = [dict(e.constants) for e in problem.experiments]
    assert own == [pytest.approx({"gain": 0.2877, "mass": 0.49}), pytest.approx({"gain": 1.1508, "mass": 1.0})]
    assert "gain" not in problem.names
    assert problem.parameters["length"] == 0.1


@pytest.mark.few(2)
@pytest.mark.parametrize("beside", [{"kp": None}, {"motor": "another"}, {"kp": "high"}, {"kp": -3}])
def test_a_gain_that_a_log_does_not_say_is_free(tmp_path, beside):
    problem = drafted(
        tmp_path, servo_log(tmp_path, "kp100_sin_sin", **beside), says="Nothing beside the samples says gain: write"
    )
    assert "gain" in problem.names
    assert problem.parameters["mass"] == 0.49


@pytest.mark.broad
def test_a_recorded_torque_drives_a_joint_whose_gain_nobody_says(tmp_path):
    t = STEP * np.arange(400)
    np.savez(tmp_path / "log.npz", time=t, q_ref=np.sin(t), q=np.sin(t - 0.1), tau=0.1 * np.cos(5 * t))
    problem = drafted(tmp_path, tmp_path / "log.npz")
    moved = problem.experiments[0].inputs.any(axis=0)
    assert dict(zip(problem.model.inputs, moved, strict=True))["torque"]
    assert "gain" not in problem.names


def test_several_recordings_of_a_rotary_pendulum_are_no_draft(tmp_path):
    np.savez(tmp_path / "swing.npz", time=STEP * np.arange(200), alpha=np.sin(np.arange(200) / 20))
    with pytest.raises(InputError, match=r"is of one recording.*add a \[\[recording\]\]"):
        drafted(tmp_path, tmp_path / "swing.npz", tmp_path / "swing.npz")


@pytest.mark.broad
def test_a_design_says_which_mass_to_hang_on_next(tmp_path):
    free = {n: Free(v, v / 10, 10 * v) for n, v in TRUE.items()}
    problem = Problem(fracid.model("joint"), (moved(1.0, 1),), {"mu": 1.0}, FIXED | free, initial_state="held",
                      method="bdf2")  # fmt: skip
    can = {"seconds": 2.0, "rate": 100, "voltage": fracid.Pulses(0.3, 0.3, peak=1.2), "initial_state": "held"}
    names = ("torque_constant",)
    plans = {
        masses: fracid.design(problem, fracid.DesignSpace(**can, constants={"mass": masses}), experiments=1, of=names)
        for masses in (0.02, 1.0, (0.02, 1.0))
    }
    error = {m: plan.expected["torque_constant"].standard_error for m, plan in plans.items()}
    best = min(0.02, 1.0, key=error.__getitem__)
    assert error[0.02] / error[1.0] != pytest.approx(1.0, abs=0.02)
    assert dict(plans[0.02, 1.0].experiments[0].constants) == {"mass": best}
    plans[0.02, 1.0].write(tmp_path)
    assert f"parameters = {{ gain = 1.0, mass = {best} }}" in (tmp_path / "next.toml").read_text(encoding="utf-8")
    with pytest.raises(InputError, match="resistance is free"):
        fracid.design(problem, fracid.DesignSpace(**can, constants={"resistance": 1.0}))


@pytest.mark.broad
def test_an_unedited_draft_of_three_logs_separates_the_motor_from_its_friction(tmp_path):
    names = ("kp100_lift_and_drop", "kp200_sin_sin", "kp400_sin_time_square")
    fit = fracid.identify(drafted(tmp_path, *(servo_log(tmp_path, n) for n in names)), jobs=2)
    assert max(r.rmse["angle"] for r in fit.recordings.values()) < 0.035
    for name, published in (("torque_constant", 0.286), ("resistance", 2.0)):  # BAM's m5.json, without intervals
        low, high = fit.parameters[name].interval95
        assert low < published < high
        assert fit.parameters[name].identifiable == "identifiable"
