"""Outputs that are no states: y = h(t, x, u, p)."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fracid
from fracid import Experiment, Free, InputError, Problem, Sensor
from fracid.export import export_run
from helpers import program

pytestmark = pytest.mark.usefixtures("without_rivals")

STEP, SAMPLES = 5e-3, 800
T = STEP * np.arange(SAMPLES)
FILE = """
import fracid


def rhs(t, x, u, p, out):
    out[0] = x[1]
    out[1] = u[0] - p[0] * x[0] - p[1] * x[1]


def force(t, x, u, p):
    return p[0] * x[0] + p[1] * x[1] + 0.5 * u[0]


model = fracid.Model(
    "spring", rhs, ("length", "rate"), ("q", 1.0), {"force": force, "length": 0}, ("pull",),
    (fracid.Parameter("stiffness", "N/m", 30.0, "of the spring"), fracid.Parameter("damping", "N s/m", 1.0, "of it")),
    "", "a test",
)
"""
_scope: dict = {"__name__": "spring"}
exec(FILE, _scope)
SPRING = _scope["model"]
PULL = np.repeat([0.0, 2.0, -1.0, 0.5], SAMPLES // 4)


def measured(stiffness=40.0, damping=0.8, noise=1e-3):
    """Force and length of a spring that is pulled, by an independent integrator."""
    x, states = np.array([0.1, 0.0]), []
    for pull in PULL:
        states.append(x)
        x = solve_ivp(lambda t, x, u: [x[1], u - stiffness * x[0] - damping * x[1]], (0, STEP), x, "DOP853",
                      args=(pull,), rtol=1e-10, atol=1e-12).y[:, -1]  # fmt: skip
    states = np.array(states)
    y = np.column_stack([states @ [stiffness, damping] + 0.5 * PULL, states[:, 0]])
    return y + noise * np.random.default_rng(1).standard_normal(y.shape)


def problem(y, outputs=("force",), model=SPRING, **more):
    e = Experiment("twin", STEP, y, PULL[:, None], initial={"length": 0.1, "rate": 0.0}, between={"pull": "hold"},
                   units={"force": "N", "length": "m"}, **more)  # fmt: skip
    free = {"stiffness": Free(30.0, 10.0, 90.0), "damping": Free(1.0, 0.0, 5.0)}
    return Problem(model, (e,), {"q": 1.0}, free, outputs=outputs, substeps=4)


@pytest.mark.few(1)
@pytest.mark.parametrize("outputs", [("force",), ("force", "length")])
def test_a_model_is_identified_from_a_force(outputs):
    p = problem(measured()[:, : len(outputs)], outputs)
    assert p.names == ("stiffness", "damping")
    fit = fracid.identify(p)
    for name, truth in {"stiffness": 40.0, "damping": 0.8}.items():
        low, high = fit.parameters[name].interval95
        assert low < truth < high, name
    assert fit.recordings["twin"].rmse["force"] == pytest.approx(1e-3, rel=0.1)
    assert fit.recordings["twin"].unit("force") == "N"


@pytest.mark.broad
def test_states_that_a_function_alone_shows_are_asked_for_where_it_does_not_begin_at_rest():
    twin = problem(measured()[:, :1]).experiments[0]
    free = {"stiffness": 40.0, "damping": Free(1.0, 0.0, 5.0)}
    asks = r'force begins at 4.*where length and rate start.*initial = { "length" = { start = 0.0999,'
    with pytest.raises(InputError, match=asks):
        Problem(SPRING, (replace(twin, initial={}),), {"q": 1.0}, free, outputs=("force",), substeps=4)
    asked = {"length": Free(0.1, -0.3, 0.5), "rate": Free(0.0, -2.0, 2.0)}
    fit = fracid.identify(
        Problem(SPRING, (replace(twin, initial=asked),), {"q": 1.0}, free, outputs=("force",), substeps=4)
    )
    assert fit.recordings["twin"].rmse["force"] == pytest.approx(1e-3, rel=0.1)


def test_an_output_sees_the_input_after_a_jump():
    p = problem(measured(noise=0.0)[:, :1])
    at_truth = p.fitted(np.array([40.0, 0.8]), p.experiments[0])
    assert abs(at_truth - p.experiments[0].measured).max() < 2e-4


@pytest.mark.broad
def test_a_force_may_be_late():
    y = measured()[:, :1]
    late = np.vstack([y[:1], y[:1], y[:-2]])
    fit = fracid.identify(problem(late, sensors={"force": Sensor(delay=Free(0.004, 0.0, 0.02))}))
    assert fit.parameters["delay_force"].value == pytest.approx(2 * STEP, abs=0.05 * STEP)


def test_another_function_is_not_what_the_memo_keeps():
    def half(t, x, u, p):
        return 0.5 * p[0] * x[0]

    p = problem(measured()[:, :1])
    q = replace(p, model=replace(SPRING, outputs={"force": half, "length": 0}))
    assert p.simulator._key(p.start, p.experiments[0]) != q.simulator._key(q.start, q.experiments[0])


@pytest.mark.parametrize(
    ("outputs", "message"),
    [
        ({"force": lambda t, x: 0.0}, r"the output 'force' fails: TypeError: .*; expected a function h\(t, x, u, p\)"),
        ({"force": lambda t, x, u, p: x[7]}, "the output 'force' fails: IndexError"),
        ({"force": lambda t, x, u, p: "much"}, "the output 'force' returns 'much'; expected one number"),
        ({"force": "x"}, r"outputs force = 'x': expected each output with .* a function h\(t, x, u, p\)"),
    ],
)
def test_an_output_that_cannot_be_is_refused_in_one_sentence(outputs, message):
    with pytest.raises(InputError, match=message):
        replace(SPRING, outputs=outputs)


@pytest.mark.broad
def test_a_project_with_a_force_goes_all_the_way(tmp_path, capsys):
    (tmp_path / "spring.py").write_text(FILE)
    y = measured()
    np.savetxt(tmp_path / "pull.csv", np.column_stack([T, y[:, 0], PULL]), delimiter=",", header="time,force,pull",
               comments="")  # fmt: skip
    (tmp_path / "rig.toml").write_text(
        '[model]\nname = "spring.py:model"\n[model.parameters]\ndamping = 0.8\n'
        "stiffness = { start = 30.0, lower = 10.0, upper = 90.0 }\n"
        "[model.orders]\nq = 1.0\n"
        '[[recording]]\nfile = "pull.csv"\nforce = { column = "force", unit = "N", bias = { start = 0.0, lower = -1.0, '
        'upper = 1.0 } }\npull = { column = "pull", unit = "1", between = "hold" }\ninitial = { length = 0.1 }\n'
        "mask = [[1.0, 1.2]]\n"
    )
    run = tmp_path / "run"
    code, _, err = program.run(capsys, "fit", tmp_path / "rig.toml", "--out", run, "--trust")
    assert code == 0, err
    saved = fracid.load_run(run, trust=True)
    assert saved.result["parameters"]["bias_force"]["unit"] == "N"
    assert saved.result["recordings"]["pull"]["samples"] == SAMPLES - 41
    export = export_run(saved, tmp_path / "out")
    assert any("force is a function of them, which it lacks" in note for note in export.notes)
    assert any("without delay, gain, bias and lowpass of force" in note for note in export.notes)
    assert program.run(capsys, "resid", run, "--trust")[0] == 0
    with pytest.raises(InputError, match="has a delay, gain, bias or lowpass, which a simulated recording does not"):
        fracid.Twin.of_problem(saved.problem, saved.x, saved.problem.experiments[0])
