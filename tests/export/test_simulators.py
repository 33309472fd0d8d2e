"""Rigs as rigid bodies: MuJoCo moves them as fracid does, and nothing is left out in silence."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.estimation.records import Estimate
from fracid.export import simulators
from fracid.export.identified import Identified

STEPS, STEP = 1000, 2e-3
RIGS = {
    "pendulum": ({"drag_angle": 1e-4, "b_angle": 1e-3, "angle_rest": 0.1}, {"angle": 1.0}, 0.02),
    "joint": ({"gravity": 0.1, "spring_angle": 0.05, "angle_rest": 0.1, "level": 0.2, "drag_angle": 1e-3, "mass": 0.2,
               "length": 0.08}, {}, 0.1),
    "cart-pole": ({"drag_angle": 1e-3}, {"angle": 0.6}, 2.0),
    "two-mass": ({"load_rest": 0.1}, {}, 0.1),
    "rotary-pendulum": ({"b_theta": 1e-2, "b_alpha": 2e-4, "drag_alpha": 1e-5, "cable_stiffness": 1e-2,
                         "theta_rest": 0.1, "alpha_rest": 0.02, "back_emf": 1e-3}, {"alpha": 0.5}, 1.0),
}  # fmt: skip
POSTURES = [(n, zero) for n in RIGS for zero in ("hanging", "upright") if zero == "hanging" or fracid.model(n).zero]


def found(name, zero="hanging", orders=1.0, **constants):
    values, initial, drive = RIGS[name]
    model = fracid.model(name, **({"zero": zero} if zero != "hanging" else {})).with_parameters(**values | constants)
    t = STEP * np.arange(STEPS + 1)
    u = np.zeros((STEPS + 1, len(model.inputs)))
    u[:, 0] = drive * np.sin(3 * t + 0.5 * t * t)
    e = fracid.Experiment("twin", STEP, np.zeros((STEPS + 1, len(model.outputs))), u, initial=initial)
    problem = fracid.Problem(model, (e,), dict.fromkeys(model.order_names, orders), initial_state="held",
                             outputs=tuple(model.outputs))  # fmt: skip
    return Identified("a twin", problem, problem.start)


def off(model):
    """How far MuJoCo is off, of the range."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install mujoco")
    rig = simulators.rig_of(model, "MuJoCo")
    says = simulators.error_in_mujoco(rig, simulators.mjcf(rig))
    pairs = [part.split(" (of ") for part in says.split(" by ")[1].split("), ")]
    return max(float(error.split()[1]) / float(size.split(")")[0]) for error, size in pairs)


@pytest.mark.few(4)
@pytest.mark.parametrize(("name", "zero"), POSTURES)
def test_mujoco_moves_a_rig_as_fracid_does(name, zero):
    assert off(found(name, zero)) < 1e-4


def test_dry_friction_is_one_in_mujoco_too_and_its_error_is_said():
    assert 1e-6 < off(found("rotary-pendulum", coulomb_theta=1e-3, coulomb_alpha=1e-4)) < 1e-3


def test_a_rotary_pendulum_whose_arm_points_the_other_way_moves_alike():
    assert off(found("rotary-pendulum", C3=-4e-3)) < 1e-4


def test_a_servos_loop_and_friction_that_grows_with_the_load_are_said_to_be_left_out():
    rig = simulators.rig_of(found("joint", gain=0.3, load_angle=0.1), "MuJoCo")
    assert [text.rpartition(" [")[2] for text in rig.lost] == ["position-loop].", "load-friction]."]


def test_a_fractional_order_is_refused_with_what_to_type():
    with pytest.raises(InputError, match=r"order mu is 0.9, .*\[order\]. Fit with mu = 1, or take --to fmu"):
        simulators.rig_of(found("pendulum", orders=0.9), "MuJoCo")


def test_a_model_that_is_no_rig_is_refused_by_name():
    model = found("pendulum")
    own = replace(model, problem=replace(model.problem, model=replace(model.problem.model, name="mine")))
    with pytest.raises(InputError, match="'mine' is none of the library's rigs"):
        simulators.rig_of(own, "URDF")


def test_constants_that_no_bodies_have_are_refused():
    with pytest.raises(InputError, match=r"No rigid bodies have these constants: .*\[body\]"):
        simulators.rig_of(found("rotary-pendulum", C6=5e-3), "MuJoCo")


@pytest.mark.few(2)
@pytest.mark.parametrize("name", RIGS)
def test_every_constant_is_carried_over_or_said_with_a_code(name):
    model = found(name)
    for parameter in model.problem.model.parameters:
        if parameter.value == 0.0 and not parameter.needs and parameter.lower <= 1e-3:
            changed = found(name, **{parameter.name: 1e-3})
            rig = simulators.rig_of(changed, "MuJoCo")
            silent = parameter.name.startswith(tuple(simulators.TABLE["silent"]["names"]))
            carried = simulators.mjcf(rig) != simulators.mjcf(simulators.rig_of(model, "MuJoCo"))
            assert carried or silent or any(t.startswith(f"{parameter.name} = 0.001") and "[" in t for t in rig.lost)


def test_the_files_say_what_is_lost_and_the_intervals_of_what_is_not():
    model = found("joint", stiction_angle=0.01)
    model = replace(model, estimates={"J": Estimate(5e-3, "kg m^2", True, interval95=(4e-3, 6e-3))})
    rig = simulators.rig_of(model, "URDF")
    said = [*rig.lost, *simulators.lost_in_urdf(rig)]
    text = simulators.urdf(rig, simulators.heading(rig, said))
    for words in ("stiction_angle = 0.01 N m is left out", "[stribeck]", "[spring]", "95 % interval [0.004, 0.006]"):
        assert words in text
    joint = ElementTree.fromstring(text).find("joint")
    assert joint.find("dynamics").get("damping") == repr(model.constants["b_angle"].value)


def test_what_a_run_is_called_ends_no_comment():
    rig = simulators.rig_of(replace(found("pendulum"), run="--><evil/>"), "MuJoCo")
    text = simulators.mjcf(rig, simulators.heading(rig, ()))
    assert ElementTree.fromstring(text).find(".//evil") is None
