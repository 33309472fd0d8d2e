"""A run for other programs: model.m simulates in Octave what fracid simulates, files hold what the run found."""

import csv
import json
import math
import re
import shutil
import subprocess
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import loadmat, savemat

import fracid
from folders import driven
from fracid.errors import InputError
from fracid.export import FORMATS, ON_REQUEST, export_run
from fracid.export.c import c_model, error_of_single
from fracid.export.identified import Identified, columns_of
from fracid.export.javascript import javascript_model
from fracid.export.markup import literal, program
from fracid.export.matlab import _plain, matlab_model
from fracid.export.recursion import Case, Recursion
from fracid.export.state_space import integer_model, linear_sentences
from fracid.export.whole import written
from fracid.models import Parameter
from fracid.models.written.equations import Equation, Equations
from fracid.problem.toml_text import toml_value
from fracid.runs.saved import load_run
from fracid.safety.door import own_text
from fracid.solver.memory import compressed, full, short
from fracid.workflows.simulation import twin_of
from program import run

pytestmark = pytest.mark.usefixtures("without_rivals")

octave = pytest.mark.skipif(shutil.which("octave-cli") is None, reason="Octave is not installed")

FRICTION = {"coulomb_theta": 2e-3, "coulomb_alpha": 1e-5, "drag_alpha": 1e-5, "cable_stiffness": 1e-3,
            "theta_rest": 0.1, "alpha_rest": -0.01}  # fmt: skip


def problem_of(orders=(0.8623, 0.9146), method="pi2", *, zero="hanging", drive=False, past=0, steps=250, h=2e-3,
               memory=None, **constants):  # fmt: skip
    """A pendulum released from 0.3 rad, or driven from rest; `past` samples of a run come before the start."""
    rig = fracid.rotary_pendulum("srv02-rotpen", zero=zero, **(constants or FRICTION))
    q = dict(zip(("lambda", "mu"), orders, strict=True))
    initial = {"alpha": 0.0 if drive else 0.3}
    if past:
        run = fracid.simulate(rig, orders=q, initial=initial, step=h, end=h * (steps + past))
        swing = fracid.Experiment(
            "twin", h, run.states[past:, [0, 2]], np.zeros((1, 1)), past=run.states[:past, [0, 2]]
        )
    else:
        inputs = driven(steps) if drive else np.zeros((1, 1))
        swing = fracid.Experiment("twin", h, np.zeros((steps + 1, 2)), inputs, initial=initial)
    options = {"initial_state": "measured" if past else "held", "method": method, "memory": memory or compressed()}
    return fracid.Problem(rig, (swing,), q, **options)


VARIANTS = {
    "pi2, released": problem_of(),
    "pi2, driven": problem_of(drive=True),
    "pi2, upright": problem_of(zero="upright"),
    "pi2, low orders, several corrections": problem_of((0.5, 0.6)),
    "pi2, an order above 1": problem_of((1.1, 0.95)),
    "pi2, integer orders": problem_of((1.0, 1.0), drive=True),
    "pi2, steep dry friction": problem_of((0.95, 0.9), coulomb_theta=3e-2, slip_speed=1e-3),
    "pi2, a measured past": problem_of(past=300),
    "pi2, full memory": problem_of(memory=full()),
    "pi2, short memory": problem_of(memory=short(50)),
    "pi2, another unit of time": problem_of(time_scale=0.1),
    "pi3, released": problem_of(method="pi3", b_alpha=2e-4),
    "pi3, driven": problem_of((0.9, 1.0), method="pi3", drive=True, b_alpha=2e-4),
    "pi3, integer orders": problem_of((1.0, 1.0), method="pi3"),
    "pi2-implicit": problem_of(method="pi2-implicit", drive=True),
    "gl": problem_of(method="gl"),
    "gl, short memory": problem_of(method="gl", memory=short(50)),
    "gl-sequential, driven": problem_of((1.0, 0.95), method="gl-sequential", drive=True),
    "gl-paper": problem_of(method="gl-paper"),
}


LUGRE = {f"{name}_{joint}": value for joint, part in (("theta", 1.0), ("alpha", 1e-2)) for name, value in {
    "coulomb": 1e-2 * part, "stiction": 5e-3 * part, "presliding": 5e-3, "presliding_damping": 1e-2 * part,
}.items()}  # fmt: skip
TWO_BODIES = {"play_theta": 5e-3, "arm_stiffness": 300.0, "arm_damping": 0.05, "hub_inertia": 1e-3, **LUGRE}

ELEMENTS = {
    "Stribeck": problem_of(coulomb_theta=5e-3, stiction_theta=5e-3, stiction_alpha=1e-5),
    "Dahl": problem_of((1.0, 1.0), coulomb_theta=1e-2, presliding_theta=5e-3),
    "LuGre in both joints": problem_of((1.0, 1.0), **LUGRE),
    "LuGre, fractional orders": problem_of((0.9, 0.95), **LUGRE),
    "LuGre, pi2-implicit": problem_of((1.0, 1.0), method="pi2-implicit", drive=True, **LUGRE),
    "LuGre, pi3": problem_of((1.0, 1.0), method="pi3", **LUGRE),
    "LuGre, gl": problem_of((1.0, 1.0), method="gl", **LUGRE | {"presliding_theta": 0.1, "presliding_alpha": 0.1}),
    "no friction that could give": problem_of((1.0, 1.0), coulomb_theta=0.0, presliding_theta=5e-3),
    "springpots": problem_of((1.0, 1.0), springpot_theta=5e-3, springpot_alpha=1e-4, springpot_order_alpha=0.2),
    "springpot and Dahl": problem_of((1.0, 1.0), springpot_theta=5e-3, coulomb_alpha=1e-4, presliding_alpha=5e-3),
    "play": problem_of((1.0, 1.0), play_theta=5e-3),
    "elastic arm": problem_of((0.95, 0.9), drive=True, arm_stiffness=50.0, arm_damping=0.01),
    "two bodies, LuGre": problem_of((1.0, 1.0), **TWO_BODIES),
    "a tilted axis": problem_of((0.95, 0.9), tilt_x=0.03, tilt_y=-0.05),
    "a tilted axis, an elastic arm": problem_of((1.0, 1.0), zero="upright", arm_stiffness=50.0, tilt_x=0.03, C3=-4e-3),
    "a motor as it is": problem_of(drive=True, back_emf=0.01, dead_zone=0.3, saturation=2.0),
}


def one_state(level, **outputs):
    constants = [Parameter("a", "1", 2e-3, ""), Parameter("area", "1", 0.02, "")]
    outputs = {n: Equation(e) for n, e in {"level": "level", **outputs}.items()}
    model = Equations({"level": level}, outputs, {"pump": "1"}).model("tank", constants)
    e = fracid.Experiment("filling", 0.1, np.zeros((101, len(outputs))), 2e-3 * driven(100), initial={"level": 0.3})
    orders = dict.fromkeys(model.order_names, 0.95)
    return fracid.Problem(model, (e,), orders, outputs=tuple(outputs), initial_state="held")


ONE_STATE = {
    "one state": one_state(Equation("(pump - a*sqrt(level))/area", "mu"), outflow="a*sqrt(level)"),
    "one state, which relaxes": one_state(Equation("pump/area - a*level", forgets="a", size="area")),
}
VARIANTS |= ELEMENTS | ONE_STATE


def tables_and_case(problem):
    return Recursion.of(problem, problem.start), Case.of(problem, problem.start, problem.experiments[0])


@pytest.fixture(scope="module")
def in_octave(tmp_path_factory):
    """What model.m gives for each variant, all in one process."""
    folder = tmp_path_factory.mktemp("octave")
    lines = []
    for i, problem in enumerate(VARIANTS.values()):
        tables, case = tables_and_case(problem)
        (folder / str(i)).mkdir()
        (folder / str(i) / "model.m").write_text(matlab_model(tables, case, "a test"), encoding="utf-8")
        savemat(folder / str(i) / "in.mat", {"x0": case.past, "u": case.driven.before, "n": float(case.steps)})
        lines.append(
            f"clear all; cd {folder / str(i)}; load in.mat; [t, x] = model(x0, u, n); "
            "[~, alone] = model(); save('-v6', 'out.mat', 't', 'x', 'alone');"
        )
    run_octave(folder, "\n".join(lines))
    return {name: loadmat(folder / str(i) / "out.mat") for i, name in enumerate(VARIANTS)}


def run_octave(folder, script):
    (folder / "script.m").write_text(script + "\n", encoding="utf-8")
    done = subprocess.run(["octave-cli", "-q", "script.m"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@octave
@pytest.mark.parametrize("name", VARIANTS)
def test_model_m_simulates_what_fracid_simulates(in_octave, name):
    problem, found = VARIANTS[name], in_octave[name]
    ours = problem.simulate(problem.start, problem.experiments[0])
    assert ours.completed
    assert np.ptp(ours.states[:, -2:]) > 1e-3
    np.testing.assert_allclose(found["t"][:, 0], ours.time - ours.time[0], atol=1e-12)
    np.testing.assert_allclose(found["x"], ours.states, atol=1e-6)


# --- C ---------------------------------------------------------------------------------------------

compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")

MAIN = """
#include <stdio.h>
#include <stdlib.h>
#include "fracid_model.h"
static fracid_state s;
int main(int argc, char **argv)
{
    double x[FRACID_STATES], u[FRACID_INPUTS];
    if (argc < 2 || fread(x, sizeof x, 1, stdin) != 1 || fread(u, sizeof u, 1, stdin) != 1) return 2;
    fracid_init(&s, x, u);
    fwrite(x, sizeof x, 1, stdout);
    for (long n = atol(argv[1]); n > 0; n--) {
        if (fread(u, sizeof u, 1, stdin) != 1 || fracid_step(&s, u, x)) return 3;
        fwrite(x, sizeof x, 1, stdout);
    }
    return 0;
}
"""


def in_c(folder, problem, real="double"):
    """The states of the run by the compiled function, and the exit code."""
    tables, case = tables_and_case(problem)
    texts = c_model(tables, case, "a test", single=real == "float")
    for name, text in {**texts, "main.c": MAIN.replace("double", real)}.items():
        (folder / name).write_text(text, encoding="utf-8")
    strict = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wdouble-promotion"]
    done = subprocess.run([*strict, "-O2", "fracid_model.c", "main.c", "-o", "model", "-lm"], cwd=folder,
                          capture_output=True, text=True, check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr
    kind = {"double": "f8", "float": "f4"}[real]
    inputs = np.broadcast_to(case.driven.before, (case.steps + 1, 1))
    given = np.concatenate([case.past[-1], inputs.ravel()]).astype(kind).tobytes()
    done = subprocess.run([folder / "model", str(case.steps)], input=given, capture_output=True, check=False)
    return np.frombuffer(done.stdout, kind).reshape(-1, len(problem.model.states)), done.returncode


STEPPED_TOGETHER = "pi3, driven"  # five steps at once, whose inputs a controller does not know
IN_C = [n for n in VARIANTS if "past" not in n and n != STEPPED_TOGETHER]


@pytest.mark.few(2)
@compiler
@pytest.mark.parametrize("name", IN_C)
def test_the_c_function_steps_as_fracid_does(tmp_path, name):
    problem = VARIANTS[name]
    found, code = in_c(tmp_path, problem)
    ours = problem.simulate(problem.start, problem.experiments[0])
    assert code == 0
    np.testing.assert_allclose(found, ours.states, atol=1e-9)


@pytest.mark.few(1)
@compiler
@pytest.mark.parametrize("name", ["a motor as it is", "LuGre, fractional orders", "LuGre, gl", "elastic arm"])
def test_in_single_precision_the_c_function_is_off_by_little(tmp_path, name):
    problem = VARIANTS[name]
    found, code = in_c(tmp_path, problem, "float")
    exact = problem.simulate(problem.start, problem.experiments[0]).states
    assert code == 0
    assert "In single precision" in (tmp_path / "fracid_model.h").read_text(encoding="utf-8")
    assert "double" not in re.sub(r"/\*.*?\*/", "", (tmp_path / "fracid_model.c").read_text(), flags=re.DOTALL)
    np.testing.assert_allclose(found[:, [0, 2]], exact[:, [0, 2]], atol=2e-5)


@pytest.mark.broad
@compiler
def test_single_precision_says_how_far_it_is_off_along_the_recording(tmp_path):
    problem = VARIANTS["elastic arm"]
    tables, case = tables_and_case(problem)
    said = error_of_single(tables, case)
    assert said in c_model(tables, case, "a run", single=True, error=said)["fracid_model.h"]
    off = np.abs(in_c(tmp_path, problem)[0] - in_c(tmp_path, problem, "float")[0]).max(axis=0)
    shown = [float(v) for v in re.findall(r" (\d\S*?)[,.](?= |$)", said.split("at most")[1])]
    np.testing.assert_allclose(shown, off, rtol=0.5)


@compiler
def test_single_precision_is_measured_without_inputs_and_with_inputs_that_jump():
    decay = Equations({"x": Equation("-x", "q")}).model("decay", [])
    e = fracid.Experiment("decay", 0.01, np.zeros((101, 1)), np.zeros((1, 0)), initial={"x": 1.0})
    held = problem_of((1.0, 1.0), drive=True)
    swing = replace(held.experiments[0], between={"voltage": "hold"})
    for problem in (fracid.Problem(decay, (e,), {"q": 0.9}, initial_state="held"), replace(held, experiments=(swing,))):
        assert "it is off the double-precision function by at most" in error_of_single(*tables_and_case(problem))


@compiler
def test_in_c_inputs_that_change_while_the_first_steps_are_solved_together_cost_little(tmp_path):
    problem = VARIANTS[STEPPED_TOGETHER]
    found, _ = in_c(tmp_path, problem)
    ours = problem.simulate(problem.start, problem.experiments[0]).states
    assert np.all(np.abs(found - ours).max(axis=0) < 2e-3 * np.ptp(ours, axis=0))


@compiler
def test_a_run_that_fails_in_c_is_told(tmp_path):
    impossible = problem_of(C3=0.1)  # no masses make such a matrix
    found, code = in_c(tmp_path, impossible)
    ours = impossible.simulate(impossible.start, impossible.experiments[0])
    assert not ours.completed
    assert code == 3
    np.testing.assert_allclose(found, ours.states)


# --- a run folder ----------------------------------------------------------------------------------


@pytest.fixture
def fitted(two_recordings):
    return two_recordings / "run"


@pytest.fixture(scope="module")
def exported(two_recordings, tmp_path_factory):
    folder, without_figures = (
        tmp_path_factory.mktemp("export"),
        [name for name in FORMATS if name not in (*ON_REQUEST, "state-space")],
    )
    return folder, export_run(load_run(two_recordings / "run"), folder, without_figures)


def test_equations_without_a_value_everywhere_have_programs_and_say_that_they_have_no_linear_model():
    tank, e = ONE_STATE["one state"], ONE_STATE["one state"].experiments[0]
    assert 'OUTPUTS = ["level", "outflow"]' in javascript_model(tank, tank.start, e, "run")
    assert "fracid_output" in c_model(*tables_and_case(tank), "run")["fracid_model.c"]
    system = replace(integer_model(tank), around=None)
    assert system.linear == {}
    assert any("no linear model" in said for said in linear_sentences(system))
    with pytest.raises(InputError, match="About empty there is no linear model"):
        system.linearised("empty", np.zeros(1), system.parameters)
    assert system.linearised("half full", np.full(1, 0.5), system.parameters).F < 0
    assert one_state(Equation("pump/area", "mu"), above="log(level - 1)").model.shown


def test_results_mat_holds_values_intervals_and_curves(fitted, exported):
    folder, _ = exported
    saved, found = load_run(fitted), loadmat(folder / "results.mat", simplify_cells=True)
    mu = saved.result["orders"]["mu"]
    assert found["orders"]["mu"]["value"] == mu["value"]
    np.testing.assert_array_equal(found["orders"]["mu"]["interval95"], mu["interval95"])
    assert found["orders"]["lambda"]["free"] == 0
    assert found["parameters"]["C1"]["value"] == saved.result["parameters"]["C1"]["value"]
    assert found["options"]["method"] == "pi2"
    for recording in found["recordings"]:
        ours = saved.recordings[recording["name"]]
        assert recording["use"] == ours.use
        for output in ("theta", "alpha"):
            np.testing.assert_array_equal(recording["fitted"][output], ours.fitted[output])
            np.testing.assert_array_equal(recording["measured"][output], ours.measured[output])
            np.testing.assert_array_equal(recording["residual"][output], ours.residual(output))


@pytest.mark.broad
def test_results_mat_of_a_recording_in_windows_has_the_start_of_its_first(tmp_path):
    t = np.arange(0.0, 6.0, 0.02)
    np.savetxt(tmp_path / "swing.csv", np.column_stack([t, 0.2 * np.exp(-t / 9) * np.cos(6.7 * t)]), delimiter=",",
               header="t,angle", comments="")  # fmt: skip
    (tmp_path / "swing.toml").write_text("""
[model]
name = "pendulum"
[model.parameters]
b_angle = { start = 1e-3, lower = 0.0, upper = 1.0 }
[[recording]]
file = "swing.csv"
angle = { column = "angle", unit = "rad" }
[fit]
windows = 2.0
""")
    fracid.run(tmp_path / "swing.toml", out=tmp_path / "run")
    saved = load_run(tmp_path / "run")
    export_run(saved, tmp_path, ["matlab"])
    found = loadmat(tmp_path / "results.mat", simplify_cells=True)["recordings"]
    first = saved.problem.experiments[0]
    assert first.name == "swing, window 1"
    assert (found["name"], found["time"].size) == ("swing", t.size)
    assert found["steps"] * found["step"] == pytest.approx(first.time[-1])
    simulated = twin_of(str(tmp_path / "run"), recording=None, zero=None, friction=False, released=False, trust=False)
    assert simulated.end == pytest.approx(t[-1])
    assert simulated.initial == {n: e.value for n, e in saved.recordings["swing"].initial.items()}


@pytest.mark.broad
@octave
def test_in_octave_the_files_alone_give_every_recording_as_it_was_fitted(exported):
    folder, _ = exported
    said = run_octave(folder, """
        d = load('results.mat');
        for j = 1:numel(d.recordings)
          r = d.recordings{j};
          [t, x] = model(r.past_states, r.inputs, r.steps, r.step, r.constants, r.inputs_after);
          printf('%s %.3g\\n', r.use, max(max(abs(x(:, [1 3]) - [r.fitted.theta, r.fitted.alpha]))));
        end
        [t, x] = model();
        printf('%d %d %d\\n', numel(t), size(x));""")  # fmt: skip
    fit, validate, alone = said.strip().splitlines()
    assert alone == "401 401 4"
    assert fit.split()[0] == "fit"
    assert validate.split()[0] == "validate"
    assert max(float(fit.split()[1]), float(validate.split()[1])) < 1e-6


def test_the_equations_stand_in_the_file_with_numbers_and_the_papers_equation_numbers(exported):
    text = (exported[0] / "model.m").read_text(encoding="utf-8")
    for words in ("% (1)", "% (8)", "% (9)", "% (10)", "p.C1 = 0.00", "mu = 0.9", "alpha = 0 is hanging"):
        assert words in text
    assert "release 20°" in text
    assert "\t" not in text


def test_what_a_recording_is_called_is_no_code(tmp_path):
    tables, case = tables_and_case(problem_of())
    named = replace(case, name="bad\nerror('run')")
    text = matlab_model(tables, named, "runs\nerror('run')")
    assert not any(line.lstrip().startswith("error('run')") for line in text.splitlines())


def test_what_a_model_its_states_and_units_are_called_is_no_code_in_c():
    evil = "*/ int evil; /*"
    problem = problem_of()
    named = tuple(replace(p, unit=evil, description=evil) for p in problem.model.parameters)
    states = (evil, *problem.model.states[1:])
    model = replace(problem.model, name=evil, states=states, source=evil, inputs=(evil,), parameters=named)
    tables, case = tables_and_case(problem)
    for single in (False, True):
        texts = c_model(replace(tables, model=model), replace(case, name=evil), evil, single=single)
        for text in texts.values():
            assert "evil" not in re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)


def test_a_table_holds_time_measured_fitted_residual_and_the_input(fitted, exported):
    saved = load_run(fitted)
    for file, name in (("release-20.csv", "release 20°"), ("driven.csv", "driven")):
        with (exported[0] / file).open(encoding="utf-8", newline="") as lines:
            heading, *rows = csv.reader(lines)
        table = dict(zip(heading, np.array(rows, dtype=float).T, strict=True))
        ours = saved.recordings[name]
        np.testing.assert_array_equal(table["time [s]"], ours.time)
        np.testing.assert_array_equal(table["alpha fitted [rad]"], ours.fitted["alpha"])
        np.testing.assert_array_equal(table["theta residual [rad]"], ours.residual("theta"))
        assert ("voltage [V]" in table) == (name == "driven")
    np.testing.assert_array_equal(table["voltage [V]"], driven(300)[:, 0])


def test_the_json_file_is_the_result_with_its_curves(fitted, exported):
    found, saved = json.loads((exported[0] / "export.json").read_text(encoding="utf-8")), load_run(fitted)
    assert found["orders"] == saved.result["orders"]
    assert found["curves"]["driven"]["fitted"]["alpha"] == saved.recordings["driven"].fitted["alpha"].tolist()


def test_the_c_function_of_a_run_remembers_hours_and_model_m_its_recordings(exported):
    header, program = ((exported[0] / name).read_text(encoding="utf-8") for name in ("fracid_model.h", "model.m"))
    assert "good for 10000000 steps (13.9 h at this step)" in header
    assert "good for 10000 steps" in program


def test_a_springpot_of_another_order_in_each_recording_has_no_program():
    rig = fracid.rotary_pendulum(springpot_theta=1e-3)
    e = fracid.Experiment("twin", 2e-3, np.zeros((100, 2)), np.zeros((1, 1)))
    order = {"springpot_order_theta": fracid.Free(0.5, 0.1, 0.9)}
    same = fracid.Problem(rig, (e, replace(e, name="other")), {"lambda": 1.0, "mu": 1.0}, order)
    assert Recursion.of(same, same.start).orders[-1] == 0.5
    own = replace(same, per_recording=("springpot_order_theta",))
    with pytest.raises(InputError, match=r"^Each recording has its own springpot_order_theta"):
        Recursion.of(own, own.start)


def test_a_program_says_whose_constants_it_has_and_keeps_their_intervals():
    rig = fracid.rotary_pendulum("srv02-rotpen")
    e = fracid.Experiment("first", 2e-3, np.zeros((100, 2)), np.zeros((1, 1)))
    own = {"b_alpha": fracid.Free(1e-4, 0.0, 1e-2)}
    problem = fracid.Problem(rig, (e, replace(e, name="other")), {"lambda": 1.0, "mu": 1.0}, own, ("b_alpha",))
    found = SimpleNamespace(parameters={"b_alpha": SimpleNamespace(interval95=(9e-5, 2e-4))})
    run = SimpleNamespace(folder=Path("runs/two"), problem=problem, x=problem.start, parameters={}, orders={},
                          recordings={"first": found})  # fmt: skip
    model = Identified.of_run(run)
    assert model.constants["b_alpha"].interval == (9e-5, 2e-4)
    assert "from two, with the constants of the recording 'first'" in c_model(model.tables, model.case, model.run)[
        "fracid_model.h"]  # fmt: skip


@octave
@pytest.mark.parametrize("name", ["pi2, driven", "gl-sequential, driven", "pi2, a measured past"])
def test_model_m_without_arguments_has_the_recordings_inputs_and_past(in_octave, name):
    np.testing.assert_array_equal(in_octave[name]["alone"], in_octave[name]["x"])


def test_a_field_of_results_mat_has_a_name_of_its_own():
    assert list(_plain({"γ": 1.0, "u_2": 2.0})) == ["u3b3", "u_2"]
    with pytest.raises(InputError, match=r"a-b and a_b would be one field of results\.mat, a_b; rename one"):
        _plain({"a-b": 1.0, "a_b": 2.0})


def test_the_inputs_and_the_past_of_the_recording_stand_in_model_m():
    for name in ("pi2, driven", "gl-sequential, driven", "pi2, a measured past"):
        tables, case = tables_and_case(VARIANTS[name])
        text = matlab_model(tables, case, "a test")
        assert f"x0 = {literal(case.past)};\n  u = {literal(case.driven.before)};\n  after = u;" in text


def door(seal):
    """A door with a seal."""

    def rhs(t, x, u, p, out):
        out[0] = x[1]
        out[1] = -p[0] * math.sin(x[0]) - p[1] * x[1] - p[2] * math.tanh(x[1] / 0.05)

    parameters = (Parameter("stiffness", "1/s^2", 9.0, ""), Parameter("hinge", "1/s", 0.2, ""),
                  Parameter("lip", "1/s^2", seal, ""), Parameter("width", "m", 0.8, "in no equation"))  # fmt: skip
    return fracid.Model("door", rhs, ("phi", "rate"), ("nu", "nu"), {"phi": 0}, ("torque",), parameters, "", "")


@pytest.mark.parametrize("write", ["C", "MATLAB", "JavaScript"])
def test_a_program_that_lacks_a_constant_which_is_not_zero_is_refused_by_name(write, monkeypatch):
    swing = fracid.Experiment("swing", 1e-2, np.zeros((100, 1)), np.zeros((1, 1)), initial={"phi": 0.3})

    def program(model):
        p = fracid.Problem(model, (swing,), {"nu": 0.9}, {"hinge": fracid.Free(0.2, 0.0, 1.0)}, initial_state="held")
        if write == "JavaScript":
            return javascript_model(p, p.start, swing, "run")
        return {"C": c_model, "MATLAB": matlab_model}[write](*tables_and_case(p), "run")

    assert "lip" in str(program(door(seal=3e-3)))
    whole = door(seal=3e-3).program
    lacking = replace(whole.body[1], value=whole.body[1].value.operands[0])  # without its last term
    monkeypatch.setattr(fracid.Model, "program", replace(whole, body=(whole.body[0], lacking)))
    with pytest.raises(InputError, match=r"of .door. lacks lip = 0.003 1/s\^2, which it runs with"):
        program(door(seal=3e-3))


def numpy_door(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -p[0] * np.sinh(x[0]) - p[1] * np.power(abs(x[1]), 1.5) - p[2] * np.tanh(x[1] / 0.05) - np.exp(x[0] * 200)


def test_the_functions_of_numpy_are_those_of_math_but_for_their_rounding():
    assert "tanh" in written(replace(door(seal=3e-3), rhs=numpy_door), "c")


def test_the_integer_order_model_is_made_of_the_right_hand_side_itself():
    swing = fracid.Experiment("swing", 1e-2, np.zeros((100, 1)), np.zeros((1, 1)), initial={"phi": 0.3})
    p = fracid.Problem(door(seal=3e-3), (swing,), {"nu": 1.0}, initial_state="held")
    np.testing.assert_allclose(integer_model(p).linear["rest"].F, [[0, 1], [-9.0, -0.2 - 3e-3 / 0.05]], rtol=1e-6)


# --- the command -----------------------------------------------------------------------------------


def test_the_command_says_what_it_wrote_and_writes_nothing_else(capsys, fitted, tmp_path):
    code, out, err = run(capsys, "export", fitted, "--out", tmp_path / "new" / "here", "--to", "matlab", "--json")
    assert (code, err) == (0, "")
    record = json.loads(out)
    assert sorted(record["files"]) == sorted(str(p) for p in tmp_path.rglob("*") if p.is_file())
    assert {"model.m", "results.mat"} <= {p.name for p in (tmp_path / "new" / "here").iterdir()}


@pytest.mark.parametrize(("options", "words"), [
    (["--to", "matlap"], "did you mean matlab"),
    (["--to", "excel"], "unknown format 'excel'"),
])  # fmt: skip
def test_a_callers_mistake_is_told_and_ends_with_2(capsys, fitted, tmp_path, options, words):
    code, out, err = run(capsys, "export", fitted, "--out", tmp_path / "out", *options)
    assert (code, out) == (2, "")
    assert words in err
    assert not (tmp_path / "out").exists()


def test_what_cannot_be_written_keeps_nothing_else_from_being_written(fitted, tmp_path, monkeypatch):
    monkeypatch.setattr("fracid.export.javascript.no_javascript", lambda _: "There is no JavaScript today.")
    with pytest.raises(InputError, match=r"no JavaScript today.*All else is in"):
        export_run(load_run(fitted), tmp_path, ["javascript", "csv"])
    assert list(tmp_path.glob("*.csv"))


def test_a_run_of_which_every_simulation_fails_is_not_exported(fitted, tmp_path):
    run = load_run(fitted)
    grows = replace(run.problem.model, rhs=lambda t, x, u, p, out: out.fill(1e9 * (1 + x[0] ** 2)))
    with pytest.raises(InputError, match="There is nothing to export: release 20°: diverged"):
        export_run(replace(run, problem=replace(run.problem, model=grows)), tmp_path / "out", ["c", "csv"])
    assert not (tmp_path / "out").exists()


def test_how_columns_are_read_is_what_the_project_file_says(fitted):
    text = (fitted / "project.toml").read_text(encoding="utf-8")
    lines = columns_of(load_run(fitted))
    assert [line.partition(" =")[0] for line in lines] == ["theta", "alpha"]
    assert all(line in text for line in lines)


def test_columns_are_those_of_the_first_recording_that_is_fitted_and_rest_is_explained(fitted):
    run = load_run(fitted)
    held_out, first = tomllib.loads(run.project.text)["recording"][::-1]
    assert run.problem.experiments[0].name == first["name"]
    tables = [held_out | {"alpha": {"column": 2, "sign": -1}}, first | {"alpha": {"column": 2, "zero": "rest"}}]
    text = "".join(f"[[recording]]\nalpha = {toml_value(table['alpha'])}\n" for table in tables)
    project = replace(run.project, text=text, recordings=run.project.recordings[::-1])
    lines = columns_of(replace(run, project=project))
    assert lines == ['alpha = { column = 2, zero = "rest" }']
    assert "where the rig rests" in program(own_text("export/columns.c.in"), columns=lines, star=" * ")


def test_a_folder_that_is_no_run_or_cannot_be_written_is_told(capsys, fitted, tmp_path):
    assert "is no run folder" in run(capsys, "export", tmp_path)[2]
    (tmp_path / "file").write_text("")
    code, _, err = run(capsys, "export", fitted, "--out", tmp_path / "file", "--to", next(iter(FORMATS)))
    assert code == 2
    assert "cannot be written" in err
