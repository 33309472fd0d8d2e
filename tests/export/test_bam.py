"""A servo's file for BAM: BAM's own equations, written here a second time, accelerate it as fracid does."""

import json
import math

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.export.identified import Identified
from fracid.export.simulators import bam

MOTOR = {"gain": 0.6, "mass": 0.5, "length": 0.12, "J": 2e-3, "torque_constant": 0.3, "resistance": 2.5,
         "b_angle": 0.015, "coulomb_angle": 0.01, "slip_speed": 1e-6, "torque_per_volt": 0.0, "angle_rest": 0.02,
         "level": -0.05}  # fmt: skip
LOAD, DIRECTION = {"load_angle": 0.2}, {"load_directional_angle": 0.15}
STRIBECK = {"stiction_angle": 0.02, "stribeck_speed_angle": 0.3}
MODELS = {"m1": {}, "m2": STRIBECK, "m3": LOAD, "m4": LOAD | STRIBECK, "m5": LOAD | DIRECTION | STRIBECK}
FIRST_VALUES = {
    "m1": {"friction_base": 0.05, "friction_viscous": 0.1, "q_offset": 0.0},
    "m2": {"friction_stribeck": 0.05, "dtheta_stribeck": 0.2, "alpha": 1.35},
    "m3": {"load_friction_base": 0.05},
    "m4": {"load_friction_stribeck": 0.05},
    "m5": {"load_friction_motor": 0.05, "load_friction_external": 0.05, "load_friction_motor_stribeck": 0.05,
           "load_friction_external_stribeck": 0.05},
}  # fmt: skip
"""BAM's, where a file says nothing; M4 has those of M2 and M3, M5 those of M2."""
PARTS = {"m4": ("m1", "m2", "m3", "m4"), "m5": ("m1", "m2", "m5")}


def identified(orders=1.0, **constants):
    model = fracid.model("joint", **MOTOR | constants)
    e = fracid.Experiment("lift", 5e-3, np.zeros((50, 1)), np.zeros((1, 4)))
    problem = fracid.Problem(model, (e,), {"mu": orders}, initial_state="held")
    return Identified("a servo", problem, problem.start)


def acceleration_by_bam(data, goal, q, dq, mass, length, gain, supply):
    """Rhoban/bam, model.py, testbench.py and simulate.py, of a joint that moves."""
    p = {}
    for part in PARTS.get(data["model"], ("m1", data["model"])):
        p |= FIRST_VALUES[part]
    p = {n: data.get(n, v) for n, v in p.items()}
    duty = min(max(gain * (goal - q), -1.0), 1.0)
    motor = data["kt"] * supply * duty / data["R"] - data["kt"] ** 2 * dq / data["R"]
    external = -mass * 9.80665 * length * math.sin(q + p["q_offset"])
    loss = p["friction_base"]
    peak = math.exp(-(abs(dq / p["dtheta_stribeck"]) ** p["alpha"])) if "alpha" in p else 0.0
    loss += peak * p.get("friction_stribeck", 0.0)
    if data["model"] == "m5":
        loss += abs(external * p["load_friction_external"] - motor * p["load_friction_motor"])
        loss += peak * abs(external * p["load_friction_external_stribeck"] - motor * p["load_friction_motor_stribeck"])
    elif data["model"] in ("m3", "m4"):
        loss += (p["load_friction_base"] + peak * p.get("load_friction_stribeck", 0.0)) * abs(external - motor)
    friction = -math.copysign(loss + p["friction_viscous"] * abs(dq), dq)
    return (motor + external + friction) / (mass * length**2 + data["armature"])


@pytest.mark.parametrize("name", MODELS)
def test_bam_accelerates_a_servo_as_fracid_does(name):
    found = identified(**MODELS[name])
    data, lost = bam(found, "xl330")
    data = json.loads(json.dumps(data))
    assert (data["model"], data["actuator"], lost) == (name, "xl330", [])
    assert data["source"] == f"Identified by fracid {fracid.__version__} from a servo"  # BAM reads the names it knows
    model, c = found.problem.model, {n: q.value for n, q in found.constants.items()}
    rng, out = np.random.default_rng(1), np.zeros(len(model.states))
    for goal, q, dq in rng.uniform(-1.5, 1.5, (200, 3)):
        u = [{"goal": goal, "torque_enable": 1.0}.get(n, 0.0) for n in model.inputs]
        model.rhs.py_func(0.0, [q, dq, 0.0, 0.0], u, found.case.parameters, out)
        theirs = acceleration_by_bam(data, goal, q, dq, c["mass"], c["length"], c["gain"], c["supply"])
        assert out[1] == pytest.approx(theirs, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "code"),
    [("presliding_angle", "presliding"), ("springpot_angle", "springpot"), ("drag_angle", "drag"),
     ("spring_angle", "spring"), ("gravity", "gravity")],
)  # fmt: skip
def test_what_bam_lacks_is_said_with_its_code(name, code):
    _, lost = bam(identified(**{name: 0.01}), "xl330")
    assert len(lost) == 1
    assert lost[0].startswith(f"{name} = 0.01")
    assert lost[0].endswith(f"[{code}].")


def test_an_order_below_1_and_a_joint_without_a_loop_are_refused():
    with pytest.raises(InputError, match=r"order mu is 0.9, and BAM has .*\[order\]"):
        bam(identified(orders=0.9), "xl330")
    with pytest.raises(InputError, match=r"with a gain above 0 \[model\]"):
        bam(identified(gain=0.0), "xl330")
