"""The twelve recordings of a servo that come with fracid, and what their page says of them."""

import re
from pathlib import Path

import numpy as np
import pytest

import fracid
from fracid.problem.project import project_from_text

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
    found = {"J": 1.99e-3, "level": -0.019, "resistance": 1.68, "torque_constant": 0.237, "b_angle": 0.0144,
             "coulomb_angle": 0.0, "load_angle": 0.048, "load_directional_angle": 0.49}  # fmt: skip
    at = np.array([found[n] for n in problem.names])
    errors = np.concatenate([e.ravel() for e in problem.errors(at)])
    assert 1e3 * np.mean(np.abs(errors)) < 28.5
    none = np.array([0.0 if n.startswith("load") else found[n] for n in problem.names])
    assert problem.cost(none) > 2 * problem.cost(at)


@pytest.mark.slow
def test_the_servo_is_met_to_28_mrad_with_an_interval_and_a_verdict_for_every_value():
    fit = fracid.identify(fracid.load_project(PROJECT), jobs=2)
    assert absolute(fit, "fit") < 28.0
    free = [e for e in fit.parameters.values() if e.free]
    assert len(free) == 8
    assert all(e.interval95 and e.identifiable for e in free)


@pytest.mark.slow
def test_a_gain_that_was_held_out_is_predicted():
    text = re.sub(r'(file  = "kp400.*?)\n\n', r'\1\nuse = "validate"\n\n', PROJECT.read_text("utf-8"), flags=re.S)
    fit = fracid.identify(project_from_text(text, PROJECT), jobs=2)
    assert sum(r.use == "validate" for r in fit.recordings.values()) == 4
    assert absolute(fit, "validate") < 45.0
