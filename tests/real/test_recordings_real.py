"""Recordings of real rigs: every file loads as it is, and the pendulum is identified from two of them.

The recordings are others' and are not part of the project; see helpers/recordings.py.
"""

import numpy as np
import pytest

from fracid.identification import identify
from fracid.problem.project import load_project
from recordings import FOLDER, needs

pytestmark = needs()

SRV02 = """
[model]
rig = "srv02-rotpen"
[[recording]]
file = "{file}"
time  = {{ column = 0 }}
theta = {{ column = 1, unit = "rad" }}
alpha = {{ column = 2, unit = "rad", zero = 3.141592653589793 }}
{more}
"""
ODRIVE = """
[model]
rig = "odrive-furuta"
[[recording]]
file = "{file}"
time  = {{ column = "/joint_states/header/stamp" }}
theta = {{ column = "/joint_states/joint0/position", unit = "rad", zero = {theta} }}
alpha = {{ column = "/joint_states/joint1/position", unit = "rad", zero = {alpha} }}
{more}
"""
STEPPER = """
[model]
rig = "stepper-freeswing"
[model.orders]
lambda = 1.0                 # the arm is clamped
[[recording]]
file = "{file}"
time  = {{ rate = 1000 }}
alpha = {{ column = 0, unit = "deg", scale = 0.99 }}
{more}
"""
VOLTS = 'voltage = { column = "/effort_control/data.0", unit = "V", fill = "hold" }'


@pytest.fixture
def project(tmp_path):
    """A function that writes a project file for a recording and reads it."""

    def read(template, file, more="", fit="", **options):
        text = template.format(file=FOLDER / file, more=more, **options)
        (tmp_path / "rig.toml").write_text(text + fit, encoding="utf-8")
        return load_project(tmp_path / "rig.toml")

    return read


@pytest.mark.parametrize(
    ("template", "file", "options", "step", "seconds", "largest"),
    [
        (SRV02, "srv02-rotpen/release_92deg.mat", {}, 2e-3, 55.8, 92.5),
        (SRV02, "srv02-rotpen/release_16deg.mat", {}, 2e-3, 49.1, 18.0),
        (SRV02, "srv02-rotpen/pulse_10V.mat", {"more": 'voltage = { column = 3, unit = "V" }'}, 2e-3, 50.8, 83.7),
        (ODRIVE, "odrive-furuta/fall_a.csv", {"theta": -0.46, "alpha": 0.0}, 2e-3, 40.3, 180.3),
        (ODRIVE, "odrive-furuta/fall_b.csv", {"theta": '"rest"', "alpha": '"rest"'}, 2e-3, 30.5, 178.4),
        (ODRIVE, "odrive-furuta/sine_2V.csv", {"theta": 326.2, "alpha": 0.0, "more": VOLTS}, 2e-3, 4.45, 91.0),
        (STEPPER, "stepper-freeswing/pendulum_free_swing_data_01.txt", {}, 1e-3, 5.0, 134.5),
        (STEPPER, "stepper-freeswing/pendulum_free_swing_data_02.txt", {}, 1e-3, 5.0, 155.8),
        (STEPPER, "stepper-freeswing/pendulum_free_swing_data_03.txt", {}, 1e-3, 5.0, 63.3),
    ],
)
def test_every_file_loads_as_it_is(project, template, file, options, step, seconds, largest):
    found = project(template, file, **options)
    (e,) = found.problem.experiments
    assert e.step == pytest.approx(step, rel=1e-6)
    assert e.time[-1] == pytest.approx(seconds, abs=0.06)
    assert np.degrees(np.abs(e.measured[:, -1]).max()) == pytest.approx(largest, abs=0.1)
    largest = 10.0 if "10V" in file else 4.0 if "2V" in file else 0.0
    assert np.ptp(e.inputs) == pytest.approx(largest, rel=1e-5)  # where stamps jitter a step has its mean
    assert bool(found.notes) == (template is ODRIVE)  # its clock jitters: resampled, and said


def test_no_file_of_the_folder_is_left_out():
    pendulums = ("odrive-furuta", "srv02-rotpen", "stepper-freeswing")
    files = [p for rig in pendulums for p in (FOLDER / rig).iterdir() if p.suffix in (".mat", ".csv", ".txt")]
    assert len(files) == 9


# --- identified -----------------------------------------------------------------------------------------

FREE = """
[model.parameters]
C1 = { start = 4.27e-3, lower = 1e-3, upper = 1e-2 }
C3 = { start = 4.27e-3, lower = 1e-3, upper = 2e-2 }
C6 = { start = 4.27e-3, lower = 1e-3, upper = 2e-2 }
J_theta = { start = 1.0e-2, lower = 1e-3, upper = 1e-1 }
b_theta = { start = 2.4e-3, lower = 0.0, upper = 1.0 }
b_alpha = { start = 2e-4, lower = -1e-2, upper = 1e-2 }
coulomb_theta = { start = 1e-2, lower = 0.0, upper = 0.1 }
coulomb_alpha = { start = 1e-4, lower = 0.0, upper = 1e-2 }
cable_stiffness = { start = 1e-2, lower = 0.0, upper = 1.0 }
theta_rest = { start = 0.0, lower = -1.0, upper = 1.0 }
"""
INTEGER = "[model.orders]\nlambda = 1.0\nmu = 1.0\n"


def test_a_pendulum_on_a_stuck_arm_is_identified_with_its_friction(project):
    friction = """
[model.parameters]
J_theta = 1e3                # the arm sticks
C1 = { start = 2.5e-4, lower = 1e-5, upper = 1e-2 }
b_alpha = { start = 1e-5, lower = -1e-3, upper = 1e-3 }
coulomb_alpha = { start = 6e-5, lower = 0.0, upper = 1e-2 }
"""
    fit = identify(project(ODRIVE, "odrive-furuta/fall_b.csv", "from = 4.0", friction + INTEGER,
                           theta='"rest"', alpha='"rest"'), jobs=2)  # fmt: skip
    assert np.degrees(fit.recordings["fall_b"].rmse["alpha"]) < 0.35
    assert fit.recordings["fall_b"].fit_percent["alpha"] > 98


@pytest.mark.slow
def test_release_from_92_degrees_is_identified_to_a_third_of_a_degree(project):
    fit = identify(project(SRV02, "srv02-rotpen/release_92deg.mat", "from = 9.85\nto = 44.85", FREE), jobs=2)
    assert fit.outcome.startswith("converged")
    assert all(np.degrees(value) < 0.30 for value in fit.recordings["release_92deg"].rmse.values())
    assert all(0.9 < order.value < 1.1 and order.interval95 for order in fit.orders.values())
    assert fit.discretisation.warning == ""


@pytest.mark.slow
def test_release_from_16_degrees_ends_with_free_orders_and_friction(project):
    fit = identify(project(SRV02, "srv02-rotpen/release_16deg.mat", 'from = "release"\nto = 42.0', FREE), jobs=2)
    assert fit.outcome.startswith("converged")
    assert all(np.degrees(value) < 0.30 for value in fit.recordings["release_16deg"].rmse.values())


@pytest.mark.slow
def test_the_papers_recipe_ends_with_an_answer_and_an_honest_picture_of_it(project):
    bounds = "{ start = 1.0, lower = 0.6, upper = 1.2 }"
    recipe = f"[model.orders]\nlambda = {bounds}\nmu = {bounds}\n[fit]\npreset = 'paper'\n"
    fit = identify(project(SRV02, "srv02-rotpen/release_16deg.mat", 'from = "release"', FREE + recipe), jobs=2)
    assert fit.evaluations == 520
    assert fit.recordings["release_16deg"].fit_percent["alpha"] < 1  # orders alone cannot mend wrong constants
    said = " ".join(fit.warnings)
    assert "gl-paper sums raw x" in said
    assert "Only α is scored" in said
    assert "There are no intervals: the model does not fit" in said
    assert "better than a constant for alpha" in said
