"""Models of one's own leave as programs too: what C, JavaScript and Octave simulate is what fracid simulates."""

import json
import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat

import fracid
from fracid.export.c import c_model
from fracid.export.javascript import javascript_model
from fracid.export.matlab import matlab_model
from fracid.export.recursion import Case, Recursion
from fracid.models.library import MODEL as LIBRARY
from fracid.models.library import inputs_of, table_of
from fracid.models.written.equations import Equation, Equations
from languages import GCC, NODE, OCTAVE
from own_models import own_models

NAMES = ("duffing", "flexible link", "supercapacitor", "model maxwell1", *LIBRARY)
ORDERS = {
    "r": 0.8,
    "q": 0.93,
    "lambda": 0.95,
    "mu": 0.9,
    "nu": 0.3,
}  # whose first steps are not solved together with later ones
STEPS = 300

MAIN = """
#include <stdio.h>
#include <string.h>
#include "fracid_model.h"
static fracid_state s;
int main(void)
{
    double x[FRACID_STATES], u[2][FRACID_INPUTS];
    if (fread(x, sizeof x, 1, stdin) != 1 || fread(u, sizeof u, 1, stdin) != 1) return 2;
    fracid_init(&s, x, u[1]);
    fwrite(x, sizeof x, 1, stdout);
    while (fread(u, sizeof u, 1, stdin) == 1 && !fracid_step(&s, u[0], x)) {
        if (memcmp(u[0], u[1], sizeof u[0])) fracid_jump(&s, u[1]);
        fwrite(x, sizeof x, 1, stdout);
    }
    return 0;
}
"""


def problem_of(name):
    """Driven by a smooth input from rest; of the library with every element there, as its twin is driven."""
    model, step = own_models()[name], 1e-2
    t = np.linspace(0, 3, STEPS + 1)[:, None]
    u = 0.5 * np.sin(3.0 * t) * np.ones(len(model.inputs))
    if "length" in model.inputs:
        u = np.hstack([1.0 + 0.1 * np.sin(t) ** 2, 0.2 * np.sin(t) * np.cos(t)])
    if name in LIBRARY:
        off = [p.name for p in fracid.model(name).parameters if not p.value]
        model = fracid.model(name, **{n: 1e-3 * (1 + k) for k, n in enumerate(off)})
        model = model.with_parameters(**{n: 0.2 for n in model.parameter_names if n.startswith("springpot_order")})
        step = table_of(name)["twin"]["step"] / 4
        columns = inputs_of(name, time := step * np.arange(STEPS + 1.0))
        columns |= {rate: np.gradient(columns[of], step) for rate, of in model.input_rates.items()}
        u = np.column_stack([columns.get(n, model.input_defaults.get(n, 0.0) + 0 * time) for n in model.inputs])
        u[:20] = u[20]  # while the first steps are solved together, C has the input of the moment alone
    e = fracid.Experiment("twin", step, np.zeros((STEPS + 1, len(model.outputs))), u)
    orders = {n: ORDERS[n] for n in model.order_names}
    return fracid.Problem(model, (e,), orders, outputs=tuple(model.outputs), initial_state="held")


@pytest.fixture(scope="module")
def problems():
    found = {name: problem_of(name) for name in NAMES if name in own_models()}
    return {name: (p, p.simulate(p.start, p.experiments[0]).states) for name, p in found.items()}


def same(found, ours, name):
    np.testing.assert_allclose(found, ours, rtol=0, atol=1e-9 * np.ptp(ours, axis=0).max(), err_msg=name)
    assert np.all(np.abs(found - ours).max(axis=0) <= 1e-9 * np.ptp(ours, axis=0)), name


def tables_and_case(p):
    return Recursion.of(p, p.start), Case.of(p, p.start, p.experiments[0])


def in_c(folder, p):
    """The states by the compiled function, whose inputs jump where they are held."""
    tables, case = tables_and_case(p)
    for file, text in {**c_model(tables, case, "a test"), "main.c": MAIN}.items():
        (folder / file).write_text(text, encoding="utf-8")
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wdouble-promotion", "-O2"]
    done = subprocess.run([GCC, *strict, "fracid_model.c", "main.c", "-o", "model", "-lm"], cwd=folder,
                          capture_output=True, text=True, check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr
    sides = [np.broadcast_to(side, (case.steps + 1, side.shape[1])) for side in case.driven_after]
    given = np.concatenate([case.past[-1], np.stack(sides, axis=1).ravel()]).tobytes()
    done = subprocess.run([folder / "model"], input=given, capture_output=True, check=False)
    return np.frombuffer(done.stdout).reshape(-1, len(p.model.states))


def held(model, method="pi2", step=5e-3, order=0.9):
    """Driven by inputs that are held and jump from the first step on."""
    u = np.random.default_rng(1).choice([-1.0, 1.0, 1.0], (201, 1)) * np.ones(len(model.inputs))
    e = fracid.Experiment("twin", step, np.zeros((201, len(model.outputs))), u,
                          between=dict.fromkeys(model.inputs, "hold"))  # fmt: skip
    orders = dict.fromkeys(model.order_names, order)
    return fracid.Problem(model, (e,), orders, outputs=tuple(model.outputs), initial_state="held", method=method)


def in_octave(folder, problems):
    """The states by ``model()`` of each problem, all in one process."""
    lines = []
    for k, p in enumerate(problems):
        (folder / str(k)).mkdir()
        (folder / str(k) / "model.m").write_text(matlab_model(*tables_and_case(p), "a test"), encoding="utf-8")
        lines.append(f"clear all; cd {folder / str(k)}; [t, x] = model(); save('-v6', 'out.mat', 'x');")
    (folder / "script.m").write_text("\n".join(lines) + "\n")
    done = subprocess.run([OCTAVE, "-q", "script.m"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [loadmat(folder / str(k) / "out.mat")["x"] for k in range(len(problems))]


HELD = [("rotary-pendulum", "pi2"), ("capacitor", "pi2"), ("joint", "gl")]


def mixing_tank():
    """A state that relaxes, with a rate that jumps with the flow."""
    T = Equation("(2 + flow)/V*(20 - T)", forgets="(2 + flow)/V", size="V")
    return Equations({"T": T}, {}, {"flow": "1"}).model("tank", [fracid.Parameter("V", "1", 4.0, "")])


@pytest.mark.broad
@pytest.mark.skipif(GCC is None, reason="gcc is not installed")
def test_in_c_they_step_as_fracid_does(problems, tmp_path):
    for name, (p, ours) in problems.items():
        same(in_c(tmp_path, p), ours, name)


@pytest.mark.skipif(GCC is None, reason="gcc is not installed")
@pytest.mark.parametrize("order", [0.9, 0.5, 0.3])
def test_in_c_an_input_that_jumps_at_every_step_is_that_of_the_fit_however_many_steps_are_solved_together(
    order, tmp_path
):
    p = held(fracid.model("capacitor"), order=order)
    same(in_c(tmp_path, p), p.simulate(p.start, p.experiments[0]).states, "capacitor")


@pytest.mark.skipif(GCC is None, reason="gcc is not installed")
def test_in_c_what_relaxes_forgets_after_a_jump_of_its_input_as_fracid_does(tmp_path):
    p = held(mixing_tank(), step=0.5)
    same(in_c(tmp_path, p), p.simulate(p.start, p.experiments[0]).states, "tank")


@pytest.mark.broad
@pytest.mark.skipif(NODE is None, reason="Node is not installed")
def test_in_javascript_they_simulate_as_fracid_does(problems, tmp_path):
    for k, (p, _) in enumerate(problems.values()):
        (tmp_path / f"m{k}.mjs").write_text(javascript_model(p, p.start, p.experiments[0], "run"), encoding="utf-8")
    lines = [f'import {{ simulate as s{k} }} from "./m{k}.mjs";' for k in range(len(problems))]
    lines.append("const rows = (r) => [r.states, r.outputs].map((a) => a.map((v) => Array.from(v)));")
    runs = ", ".join(f"rows(s{k}())" for k in range(len(problems)))
    (tmp_path / "run.mjs").write_text("\n".join([*lines, f"process.stdout.write(JSON.stringify([{runs}]));"]))
    done = subprocess.run([NODE, "run.mjs"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for (name, (p, ours)), (states, outputs) in zip(problems.items(), json.loads(done.stdout), strict=True):
        same(np.array(states), ours, name)
        same(np.array(outputs), p.fitted(p.start, p.experiments[0]), name)


def vessel_in_pascal():
    """A vessel that follows its supply."""
    t = 0.05 * np.arange(STEPS + 1)[:, None]
    vessel = Equations({"pressure": Equation("(supply - pressure)/T", "q", "Pa")}, {}, {"supply": "Pa"})
    model = vessel.model("vessel", [fracid.Parameter("T", "s", 0.8, "")])
    e = fracid.Experiment("filling", 0.05, 1e5 * (1 - np.exp(-t)), 1e5 * (t > 0), initial={"pressure": 0.0},
                          units={"pressure": "Pa"})  # fmt: skip
    return fracid.Problem(model, (e,), {"q": 0.9}, initial_state="held")


@pytest.mark.skipif(GCC is None or NODE is None, reason="gcc or Node is not installed")
def test_a_model_in_pascal_leaves_its_limits_in_no_language_where_the_fit_does_not(tmp_path):
    p = vessel_in_pascal()
    ours, (tables, case) = p.simulate(p.start, p.experiments[0]).states, tables_and_case(p)
    same(in_c(tmp_path, p), ours, "C")
    text = javascript_model(p, p.start, p.experiments[0], "run")
    (tmp_path / "run.mjs").write_text(f"{text}\nconsole.log(JSON.stringify(simulate().states.map(x => x[0])));")
    done = subprocess.run([NODE, "run.mjs"], cwd=tmp_path, capture_output=True, text=True, check=True)
    same(np.array(json.loads(done.stdout))[:, None], ours, "JavaScript")
    assert f"<= {p.simulator.limit})" in matlab_model(tables, case, "run")


@pytest.mark.skipif(NODE is None, reason="Node is not installed")
def test_the_calls_that_a_module_shows_run_a_driven_model(tmp_path):
    p = problem_of("duffing")
    text = javascript_model(p, p.start, p.experiments[0], "run")
    calls = re.findall(r"//  .*(simulate\(.*\));", text)
    assert len(calls) == 3
    shown = "\n".join(f"console.log({call}.completed);" for call in calls)
    (tmp_path / "run.mjs").write_text(f"{text}\n{shown}", encoding="utf-8")
    done = subprocess.run([NODE, "run.mjs"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout == "true\n" * 3, done.stderr


WRONG = {
    "{ orders: { mu: 1 } }": "unknown order mu: expected r",
    "{ parameters: { damping: 0 } }": "unknown parameter damping: expected ",
    "{ setps: 10 }": "unknown option setps: expected initial, step,",
    "{ initial: [0] }": "initial has 1 numbers: expected 3",
    "{ steps: 2, inputs: [0, 1] }": "inputs has 2 numbers: expected 1 or 3",
    "{ steps: 1, inputs: [0, 1], jumps: [0] }": "jumps has 1 numbers: expected 2",
}


@pytest.mark.skipif(NODE is None, reason="Node is not installed")
def test_a_module_refuses_what_it_does_not_know_in_place_of_passing_over_it(tmp_path):
    p = problem_of("duffing")
    calls = "".join(f"\ntry {{ simulate({call}); }} catch (e) {{ console.log(e.message); }}" for call in WRONG)
    (tmp_path / "run.mjs").write_text(javascript_model(p, p.start, p.experiments[0], "run") + calls, encoding="utf-8")
    done = subprocess.run([NODE, "run.mjs"], cwd=tmp_path, capture_output=True, text=True, check=True)
    for said, expected in zip(done.stdout.splitlines(), WRONG.values(), strict=True):
        assert said.startswith(expected)


def spinning(name, other):
    """Two constants of a model of one's own, whose names may be anything."""

    def rhs(t, x, u, p, out):
        out[0] = -p[0] * x[0] - p[1] * x[0] ** 3

    parameters = tuple(fracid.Parameter(n, "1", v, "") for n, v in ((name, 0.5), (other, 0.1)))
    return fracid.Model("spin", rhs, ("w",), ("mu",), {"w": 0}, (), parameters, "", "")


def problem_in(model):
    e = fracid.Experiment("decay", 0.01, np.zeros((101, 1)), np.zeros((1, 0)), initial={"w": 1.0})
    return fracid.Problem(model, (e,), {"mu": 0.9}, initial_state="held")


@pytest.mark.parametrize(("write", "names"), [
    (c_model, ("γ", "u3b3")), (matlab_model, ("γ", "u3b3")), (matlab_model, ("a" * 63, "a" * 64)),
], ids=["C", "MATLAB", "MATLAB, long"])  # fmt: skip
def test_two_names_that_would_become_one_are_refused(write, names):
    with pytest.raises(fracid.InputError, match=rf"{names[0]} and {names[1]} would both be called .*rename one"):
        write(*tables_and_case(problem_in(spinning(*names))), "run")


@pytest.mark.skipif(GCC is None, reason="gcc is not installed")
def test_a_parameter_may_be_called_as_a_word_of_the_compilers_own(tmp_path):
    words = ("asm", "linux", "unix", "typeof", "M_PI", "NULL", "true", "i386")
    for names in zip(words[::2], words[1::2], strict=True):
        for file, text in c_model(*tables_and_case(problem_in(spinning(*names))), "run").items():
            (tmp_path / file).write_text(text, encoding="utf-8")
        subprocess.run([GCC, "-c", "fracid_model.c"], cwd=tmp_path, check=True)  # in its own dialect


@pytest.mark.skipif(NODE is None, reason="Node is not installed")
@pytest.mark.parametrize(("name", "method"), [*HELD, ("tank", "pi2")])
def test_in_javascript_an_input_that_is_held_in_the_fit_is_held(name, method, tmp_path):
    p = held(mixing_tank(), step=0.5) if name == "tank" else held(fracid.model(name), method)
    e = p.experiments[0]
    text = javascript_model(p, p.start, e, "run")
    rows = "[run.states, run.outputs].map(a => a.map(v => Array.from(v)))"
    (tmp_path / "run.mjs").write_text(f"{text}\nconst run = simulate();\nconsole.log(JSON.stringify({rows}));")
    done = subprocess.run([NODE, "run.mjs"], cwd=tmp_path, capture_output=True, text=True, check=True)
    states, outputs = map(np.array, json.loads(done.stdout))
    same(states, p.simulate(p.start, e).states, name)
    same(outputs, p.fitted(p.start, e), name)


@pytest.mark.broad
@pytest.mark.skipif(OCTAVE is None, reason="Octave is not installed")
def test_in_octave_they_simulate_as_fracid_does(problems, tmp_path):
    found = in_octave(tmp_path, [p for p, _ in problems.values()])
    for x, (name, (_, ours)) in zip(found, problems.items(), strict=True):
        same(x, ours, name)


@pytest.mark.skipif(OCTAVE is None, reason="Octave is not installed")
def test_in_octave_an_input_that_is_held_in_the_fit_is_held(tmp_path):
    problems = [held(fracid.model(name), method) for name, method in HELD]
    problems += [held(mixing_tank(), step=0.5), held(fracid.model("pendulum"), "pi3")]
    low = dict.fromkeys(fracid.model("pendulum").order_names, 0.6)
    problems.append(replace(held(fracid.model("pendulum"), "pi2-implicit"), orders=low))
    for p, x in zip(problems, in_octave(tmp_path, problems), strict=True):
        same(x, p.simulate(p.start, p.experiments[0]).states, f"{p.model.name}, {p.method}")
