"""The twelve recordings of a servo that come with fracid, and what their page says of them."""

from pathlib import Path

import numpy as np
import pytest

import fracid
from fracid.selection.ladder import ladder
from twins import frictions

PROJECT = Path(__file__).parents[2] / "examples" / "real" / "xl330" / "xl330.toml"


def absolute(fit, use):
    """Mean absolute error over the recordings of a use [mrad]."""
    errors = [np.mean(np.abs(r.measured["angle"] - r.fitted["angle"])) for r in fit.recordings.values() if r.use == use]
    return 1e3 * np.mean(errors)


def test_the_licence_of_the_servo_lies_beside_its_recordings():
    assert "Apache License" in (PROJECT.parent / "LICENSE").read_text(encoding="utf-8")


def test_the_servos_friction_grows_with_its_load():
    """At the constants of the page, without a search."""
    problem = fracid.load_project(PROJECT).problem
    found = {"J": 2.12e-3, "level": -0.0227, "resistance": 1.75, "torque_constant": 0.28, "b_angle": 0.0116,
             "coulomb_angle": 8e-4, "load_angle": 0.082, "load_directional_angle": 0.477}  # fmt: skip
    at = np.array([found[n] for n in problem.names])
    errors = np.concatenate([e.ravel() for e in problem.errors(at)])
    assert 1e3 * np.mean(np.abs(errors)) < 28.5
    none = np.array([0.0 if n.startswith("load") else found[n] for n in problem.names])
    assert problem.cost(none) > 2 * problem.cost(at)


@pytest.mark.broad
def test_a_servo_is_compared_by_the_frictions_of_servos_and_on_the_gain_that_is_held_out():
    project = fracid.load_project(PROJECT)
    assert {e.name[:6] for e in project.validation} == {"kp 400"}
    climbed = frictions(ladder(project.problem, others=project.validation))
    assert climbed[-1] == "viscous + Coulomb + load + Stribeck + presliding + elastic arm"
    assert len(climbed) == 6


@pytest.mark.slow
def test_the_servo_and_a_gain_that_was_held_out_are_met_to_28_mrad_every_value_with_interval_and_verdict():
    fit = fracid.identify(fracid.load_project(PROJECT), jobs=2)
    assert (8 * absolute(fit, "fit") + 4 * absolute(fit, "validate")) / 12 < 28.0
    assert absolute(fit, "validate") < 45.0
    free = [e for e in fit.parameters.values() if e.free]
    assert len(free) == 8
    assert all(e.interval95 and e.identifiable for e in free)
