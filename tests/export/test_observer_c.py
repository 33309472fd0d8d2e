"""An observer in C estimates what the one in Python does."""

import re
import shutil
import subprocess
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.export.c import along_recording
from fracid.export.c_observer import c_observer, error_of_observer
from fracid.filtering import first_samples, observer
from fracid.models.written.equations import Equation, Equations
from languages import STRICT

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")

STEP, SAMPLES = 0.01, 400
CASES = {
    "pendulum": (fracid.model("pendulum"), {"mu": 0.93}, {"angle": 1.0}, {}, {}),
    "friction and order are estimated": (
        fracid.model("pendulum"), {"mu": 0.93}, {"angle": 1.0},
        {"slow": {"b_angle": 1e-5, "mu": 1e-4}, "initial": {"b_angle": 4e-4, "mu": 0.05}}, {},
    ),
    "inputs in lines, a finer step": (
        fracid.rotary_pendulum("srv02-rotpen", coulomb_theta=1e-3), {"lambda": 1.0, "mu": 0.95}, {"alpha": 0.3}, {},
        {"substeps": 2},
    ),
    "held inputs": (fracid.model("joint", gravity=0.1), {"mu": 1.0}, {"angle": 0.3}, {}, {"held": True}),
    "an output with a held input": (
        fracid.model("capacitor"), {n: 0.9 for n in fracid.model("capacitor").order_names}, {}, {}, {"held": True},
    ),
    "an output that is a function": (
        fracid.model("capacitor"), {n: 0.9 for n in fracid.model("capacitor").order_names}, {}, {}, {},
    ),
}  # fmt: skip


DECAY = Equations({"x": Equation("-k*x", "q")}).model("decay", [fracid.Parameter("k", "1/s", 1.0, "")])
CASES["no input"] = (DECAY, {"q": 0.9}, {"x": 1.0}, {}, {})


def case(name):
    """An observer of a simulated recording, its samples and its inputs; some samples are missing."""
    model, orders, initial, how, more = CASES[name]
    random, t = np.random.default_rng(1), STEP * np.arange(SAMPLES)
    u = 0.3 * np.sin(3 * t)[:, None] * (np.arange(len(model.inputs)) == 0) if model.inputs else np.zeros((1, 0))
    between = dict.fromkeys(model.inputs, "hold" if more.get("held") else "line")
    outputs = tuple(model.shown)
    e = fracid.Experiment("twin", STEP, np.zeros((SAMPLES, len(outputs))), u, initial=initial, between=between)
    problem = fracid.Problem(model, (e,), orders, initial_state="held", outputs=outputs,
                             substeps=more.get("substeps", 1))  # fmt: skip
    y = problem.simulate(problem.start, e).states[:: problem.substeps]
    p = problem.unpack(problem.start, e)[1]
    columns = [y[:, h] if isinstance(h, int) else [h(0.0, *row, p) for row in zip(y, u, strict=True)]
               for h in model.shown.values()]  # fmt: skip
    measured = np.column_stack(columns)
    noise = {n: 1e-3 * float(np.ptp(v)) for n, v in zip(outputs, measured.T, strict=True)}
    measured += random.standard_normal(measured.shape) * [*noise.values()]
    problem = replace(problem, experiments=(replace(e, measured=measured),))
    watch = observer(SimpleNamespace(problem=problem, x=problem.start), noise=noise, drive=0.1, **how)
    measured, inputs = first_samples(problem, watch.sensors, SAMPLES)
    measured[200:230] = np.nan
    return watch, measured, inputs


@pytest.mark.few(1)
@pytest.mark.parametrize("name", CASES)
def test_along_a_recording_it_estimates_what_python_does(name):
    watch, y, u = case(name)
    run = along_recording({"observer.c": c_observer(watch, y, u, "a run")}, "export/observer_run.c.in", single=False)
    track = watch.run(y, u)
    ours = np.column_stack([*track.states.values(), *track.deviations.values()])
    found = run(y, u, len(y), np.zeros_like(ours))
    assert np.ptp(found[:, 0]) > 1e-3
    np.testing.assert_allclose(found / np.abs(ours).max(axis=0), ours / np.abs(ours).max(axis=0), atol=1e-8)


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["friction and order are estimated", "inputs in lines, a finer step"])
def test_it_compiles_without_a_warning_and_passes_its_own_test_unless_it_is_wrong(tmp_path, name):
    text = c_observer(*case(name), "a run */ int evil;")
    for content, code in ((text, 0), (text.replace("o->c[j] * a[j]", "-o->c[j] * a[j]"), 1)):
        (tmp_path / "observer.c").write_text(content)
        command = ["cc", *STRICT, "-O1", "-DFRACID_OBSERVER_TEST", "observer.c", "-o", "test", "-lm"]
        subprocess.run(command, cwd=tmp_path, check=True)
        assert subprocess.run([tmp_path / "test"], check=False, capture_output=True).returncode == code


def test_its_head_says_units_how_columns_are_read_and_what_the_deviations_leave_out():
    head = c_observer(*case("pendulum"), "a run", columns=["angle = 1"]).partition("#include")[0]
    assert "y is angle [rad], NAN for a sensor that is missing; u is torque [N m]" in head
    assert " *     angle = 1\n" in head
    assert "where the constants are those of the" in head
    assert float(re.search(r"some (\S+) kB", head)[1]) > 0


def test_in_single_precision_it_is_off_by_a_small_part_of_its_uncertainty_and_says_so():
    watch, y, u = case("pendulum")
    text = c_observer(watch, y, u, "a run", single=True)
    assert "double" not in re.sub(r"/\*.*?\*/", "", text.partition("#ifdef FRACID_OBSERVER_TEST")[0], flags=re.DOTALL)
    said = error_of_observer(text, watch, y, u, single=True)
    parts = np.array(re.findall(r"(\S+) \(of (\S+)\)", said), float)
    assert np.all(parts[:, 0] > 0)
    assert np.all(parts[:, 0] < 0.05 * parts[:, 1])


def test_a_run_is_exported_on_request_and_what_has_no_observer_is_refused(tmp_path, plain):
    run = fracid.load_run(plain / "run")
    made = fracid.export_run(run, tmp_path, ["observer"], slow={"b_alpha": 1e-6})
    assert [path.name for path in made.files] == ["observer.c"]
    assert ", b_alpha\n * of rotary-pendulum" in made.files[0].read_text(encoding="utf-8")
    assert "observer.c is off Python's by at most" in made.notes[-1]
    with pytest.raises(InputError, match=r"'beta'.*There is no observer\.c"):
        fracid.export_run(run, tmp_path, ["observer"], slow={"beta": 1e-6})


def test_a_model_without_inputs_has_an_observer():
    watch, y, u = case("no input")
    text = c_observer(watch, y, u, "a run")
    assert u.shape == (1, 0)
    assert "u is nothing" in text
    assert "over" in error_of_observer(text, watch, y, u, single=False).lower()
