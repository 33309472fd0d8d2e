"""``fracid init`` of a driven rig: the draft begins where a search can succeed."""

import numpy as np
import pytest

import fracid
from fracid.validation.reversed_signs import wrong_sign
from fracid.workflows.draft import write_draft

STEP, TIME = 4e-3, np.arange(0, 8.0002, 4e-3)


def multisine(first):
    """Volts, none before `first`."""
    phases = np.random.default_rng(3).uniform(0, 2 * np.pi, 13)
    tones = sum(np.sin(2 * np.pi * f * TIME + p) for f, p in zip(np.arange(0.2, 4.0, 0.3), phases, strict=True))
    return np.where(first > TIME, 0.0, 3.0 * tones / np.max(np.abs(tones)))


def recorded(folder, torque_per_volt, first=0.0, way=1):
    """A QUBE whose motor brakes by its back-EMF, its angles from 2048 counts a turn."""
    rig = fracid.rotary_pendulum("qube-servo2", torque_per_volt=torque_per_volt, b_theta=5e-4, coulomb_theta=1e-3,
                                 cable_stiffness=2e-3)  # fmt: skip
    u = multisine(first)
    run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={}, step=STEP, end=TIME[-1],
                          inputs=u[:, None], between="hold")  # fmt: skip
    angles = np.round(run.states[:, [0, 2]] * [1, way] * 1024 / np.pi) * np.pi / 1024
    path = folder / "multisine.csv"
    table = np.column_stack([TIME, u, angles])
    np.savetxt(path, table, delimiter=",", header="t,voltage,theta,alpha", comments="", fmt="%.9g")
    return path, rig


@pytest.mark.broad
@pytest.mark.parametrize(("sign", "first"), [(1, 0.0), (-1, 1.0)])
def test_a_multisine_begins_where_its_regression_is_whatever_the_motors_direction(tmp_path, sign, first):
    path, rig = recorded(tmp_path, 0.005 * sign, first)
    draft = write_draft(path, tmp_path / "rig.toml", None)
    project = fracid.load_project(tmp_path / "rig.toml")
    start = dict(zip(project.problem.names, project.problem.start, strict=True))
    other = project.problem.model.parameter("C4").value / rig.parameter("C4").value  # all scales with C4
    for name in ("C1", "C3", "J_theta", "torque_per_volt"):
        assert start[name] == pytest.approx(other * rig.parameter(name).value, rel=0.05)
    assert draft.notes[-1] == "The constants begin where a linear regression has them."
    assert project.recordings[0].time[0] == 0.0  # what is at rest before the input begins is no release
    assert project.problem.initial_state == "estimate"


@pytest.mark.broad
def test_an_angle_that_counts_the_other_way_leaves_the_coupling_its_size_and_its_sign_to_be_found(tmp_path):
    path, rig = recorded(tmp_path, 0.005, way=-1)
    draft = write_draft(path, tmp_path / "rig.toml", None)
    problem = fracid.load_project(tmp_path / "rig.toml").problem
    coupling = problem.model.parameter("C4").value / rig.parameter("C4").value * rig.parameter("C3").value
    assert problem.parameters["C3"].start == pytest.approx(coupling, rel=0.05)
    assert draft.notes[-1].endswith("C3 but for its sign: alpha or theta may count the other way.")
    assert [(f.code, f.where) for f in wrong_sign(problem, 1)] == [("wrong-sign", "multisine: alpha")]
