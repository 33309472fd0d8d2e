"""A servo that lifts and drops a mass by its own loop: what is known in one recording alone, and what a fit finds."""

from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.problem import Free, Problem
from fracid.problem.project import load_project

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
