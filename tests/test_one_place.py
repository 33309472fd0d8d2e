"""A new method, cost, optimiser or model is added in one place: here one of each, and all that follows takes it."""

import ast
import json
import subprocess
import sys
import textwrap
from functools import cache

import numpy as np
import pytest
from numba import types

import fracid
from fracid import models, optimise
from fracid.cli.completion import keys
from fracid.export.recursion import Recursion
from fracid.models import RIGS, model_from_name, rotary_pendulum
from fracid.optimise import OPTIMISERS
from fracid.plots.appearance import cost_label
from fracid.problem.costs import COSTS, Cost, Loss
from fracid.report.equations import equations
from fracid.selection.integer_rival import freed_friction
from fracid.selection.ladder import ladder
from fracid.solver.compilation import evaluate, when_called
from fracid.solver.loop_arguments import RUN
from fracid.solver.methods import METHODS, Method
from program import fit_in, run
from sources import nodes
from twins import frictions

OPTIMISER = '''
import numpy as np

from fracid.optimise.base import Entry, Evaluation, Optimiser, Outcome, Space


def pattern(space: Space, rng: np.random.Generator, *, rounds: int = 25) -> Optimiser:
    """Try a step each way along each unknown; halve it where none is better."""
    (best,), step = (yield space.start[None]), 0.1 * (space.upper - space.lower)
    for _ in range(rounds):
        points = np.vstack([best.point + np.diag(step), best.point - np.diag(step)])
        nearest = min((yield np.clip(points, space.lower, space.upper)), key=lambda e: e.cost)
        best, step = (nearest, step) if nearest.cost < best.cost else (best, step / 2)
    return Outcome.GENERATIONS_DONE


OPTIMISER = Entry("pattern", pattern, polish=True)
'''

MODEL = '''
import math

from fracid.models.base import Model, Parameter
from fracid.models.friction import VISCOUS, Friction

SEAL = Friction("seal", power=0, begins=1e-3, off=0.0)


def rhs(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -p[0] * math.sin(x[0]) - p[1] * x[1] - p[2] * math.tanh(x[1] / 0.05)


def door(**values):
    """A door that swings about a leaning hinge."""
    return Model(
        name="swing-door", rhs=rhs, states=("phi", "D^nu phi"), orders=("nu", "nu"), outputs={"phi": 0}, inputs=(),
        parameters=(Parameter("stiffness", "1/s^2", 9.0, "of gravity", symbol=("k", "")),
                    Parameter("hinge", "1/s", 0.2, "of the hinge", symbol=("b", "φ"), friction=VISCOUS.at("phi")),
                    Parameter("lip", "1/s^2", 0.0, "of the seal", symbol=("s", "φ"), friction=SEAL.at("phi"))),
        zero="hanging", source="an example", angles=("phi",), pendulum="phi",
    ).with_parameters(**values)


MODEL = {"swing-door": door}
'''

PROJECT = """
[model]
name = "swing-door"
[model.orders]
nu = 1.0
[model.parameters]
hinge = { start = 0.4, lower = 0.0, upper = 1.0 }
[fit]
method = "euler"
cost = "quartic"
optimiser = "pattern"
initial_state = "held"
[[recording]]
file = "swing.csv"
phi = { column = "phi", unit = "rad" }
initial = { phi = 0.5 }
"""


@when_called(types.UniTuple(types.int64, 2)(types.int64, RUN, types.float64[:, ::1]))
def euler(rhs, run, out):
    """Step forward at order 1: the loop of a method."""
    x, f = run.past[-1].copy(), np.zeros(len(run.slope))
    for n in range(1, run.steps + 1):
        evaluate(rhs, run.start + (n - 1) * run.h, x, run.u[0], run.p, f)
        x += run.gain * f
        if n % run.every == 0:
            out[n // run.every] = x
    return run.steps, 0


def add(package, folder, name, text, patch):
    """A file more in a package, though it lies elsewhere."""
    folder.mkdir()
    (folder / f"{name}.py").write_text(textwrap.dedent(text), encoding="utf-8")
    patch.setattr(package, "__path__", [*package.__path__, str(folder)])
    return package._collected()


@pytest.fixture(scope="module")
def added(tmp_path_factory):
    """One of each more than there are."""
    folder = tmp_path_factory.mktemp("one-place")
    quartic = Loss(lambda e: e**4, lambda e: 4 * e**3, lambda e, _: 12 * float(np.mean(e**2)), lambda e: e**4)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(METHODS, "euler", Method("gl", 1, euler, follows=1.0))
        patch.setitem(COSTS, "quartic", Cost("quartic", lambda t: np.full(len(t), 1 / len(t)), quartic, "rad⁴"))
        patch.setattr(optimise, "OPTIMISERS", add(optimise, folder / "optimise", "pattern", OPTIMISER, patch))
        patch.setattr(models, "MODELS", add(models, folder / "models", "door", MODEL, patch))
        yield folder
    for name in ("fracid.optimise.pattern", "fracid.models.door"):
        sys.modules.pop(name)


@pytest.fixture(scope="module")
def problem(added):
    door = model_from_name("swing-door", parameters={"hinge": 0.2})
    swing = fracid.simulate(door, orders={"nu": 1.0}, initial={"phi": 0.5}, step=1e-2, end=4.0)
    (added / "swing.csv").write_text(
        "time,phi\n" + "".join(f"{t:.2f},{x:.9f}\n" for t, x in zip(swing.time, swing.states[:, 0], strict=True))
    )
    (added / "door.toml").write_text(PROJECT, encoding="utf-8")
    return fracid.load_project(added / "door.toml").problem


def test_the_help_and_the_completion_list_them(added, capsys):
    assert "euler" in keys("methods")
    assert "quartic" in keys("costs")
    assert "pattern" in keys("optimisers")
    out = " ".join(run(capsys, "noise", "--help")[1].replace("│", " ").split())
    assert "quartic" in out
    assert "pattern" in out
    assert "euler" in run(capsys, "simulate", "--help")[1]


@pytest.mark.broad
def test_a_fit_by_their_names_runs_and_is_examined(problem, added):
    fit_in(added, PROJECT)
    found = json.loads((added / "run" / "result.json").read_text())
    assert (found["optimiser"], found["cost"]["name"], found["method"]) == ("pattern", "quartic", "euler")
    assert found["parameters"]["hinge"]["value"] == pytest.approx(0.2, abs=0.1)  # Euler's step is long: it adds motion


def test_the_report_and_the_figures_have_their_words(problem):
    model, units = problem.model, {"value": 1.0, "free": True}
    result = {"orders": {"nu": units}, "parameters": {n: units for n in model.parameter_names}, "recordings": {}}
    symbols, numbers = equations(model, result, driven=False).values()
    assert "φ" in symbols
    assert "ν" in symbols
    assert "tanh" in numbers
    assert cost_label("quartic") == ("QUARTIC", "[rad⁴]")
    assert problem.outputs == ("phi",)


def test_the_ladder_and_the_rival_have_its_friction(problem):
    found = ladder(problem)
    assert frictions(found) == ("viscous", "viscous + seal")
    assert set(found["viscous + seal, orders free"].problem.names) == {"nu", "hinge", "lip"}
    assert set(freed_friction(problem, None)) == {"lip"}  # the hinge is free already


def test_what_a_method_does_not_say_is_refused_in_words(problem):
    with pytest.raises(fracid.InputError, match="euler is written in no other language"):
        _ = Recursion.of(problem, problem.start).exported


# --- nothing else lists them -----------------------------------------------------------------------------------------


def texts(nodes):
    """Those of some nodes that are texts."""
    return {n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)}


@cache
def listed():
    """The texts of each list, tuple, set and mapping of each file."""
    return {
        path: [texts(n.keys if isinstance(n, ast.Dict) else n.elts) for n in of_file
               if isinstance(n, ast.Dict | ast.List | ast.Tuple | ast.Set)]
        for path, of_file in nodes().items()
    }  # fmt: skip


@pytest.mark.parametrize(
    ("table", "home"),
    [
        (METHODS, "solver/methods.py"),
        (COSTS, "problem/costs.py"),
        (OPTIMISERS, "optimise"),
        (RIGS, "models/rigs.py"),
    ],
)
def test_no_other_file_has_a_copy_of_a_table(table, home):
    for path, lists in listed().items():
        assert path.startswith(home) or all(len(names & {*table}) < 3 for names in lists), path


def test_only_what_is_of_the_rotary_pendulum_alone_names_its_constants():
    of_it = ("models/", "regression/", "problem/draft.py", "experiments/")
    names = {*rotary_pendulum().parameter_names} - {"time_scale"}
    for path, of_file in nodes().items():
        assert path.startswith(of_it) or names.isdisjoint(texts(of_file)), path


def test_a_program_that_starts_imports_no_table():
    code = "import sys, fracid.cli; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
