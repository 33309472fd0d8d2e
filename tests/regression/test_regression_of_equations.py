"""Constants of any model of equations, by linear regression from the tree of its equations."""

import json
from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.problem import Experiment, Free, Problem
from fracid.regression.equations import regress_equations
from helpers.program import run


def drive(t):
    return 3 * np.sin(2 * t) + 2 * np.sin(9 * t)


def problem_of(name, free, orders, initial=None, force=None, outputs=None, off=1.7, **constants):
    """A twin with little noise; what is free starts well off."""
    model, t = fracid.model(name, **constants), np.arange(0, 8.001, 2e-3)
    u = None if force is None else force * drive(t)[:, None]
    twin = fracid.simulate(model, orders=orders, initial=initial or {}, step=2e-3, end=8.0, inputs=u)
    outputs = outputs or [*model.output_states]
    y = twin.states[:, [model.output_states[n] for n in outputs]]
    y = y + 1e-4 * np.ptp(y, axis=0) * np.random.default_rng(1).standard_normal(y.shape)
    ranges = {n: Free(off * model.parameter(n).value, 1e-9, 1e5) for n in free}
    zeros = np.zeros((1, max(1, len(model.inputs))))
    return Problem(
        model, (Experiment("twin", 2e-3, y, zeros if u is None else u),), orders, ranges, outputs=tuple(outputs)
    )


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("name", "free", "options"),
    [
        ("pendulum", ("J", "b_angle", "coulomb_angle"),
         {"orders": {"mu": 0.95}, "initial": {"angle": 1.0}, "coulomb_angle": 1e-3}),
        ("oscillator", ("m", "k", "k3", "b_displacement"), {"orders": {"mu": 1.0}, "force": 1.0}),
        ("two-mass", ("J_motor", "J_load", "k", "d"), {"orders": {"lambda": 1.0, "mu": 1.0}, "force": 0.1}),
    ],
)  # fmt: skip
def test_constants_come_out_of_the_equations(name, free, options):
    problem = problem_of(name, free, **options)
    found = regress_equations(problem)
    assert [*found.parameters] == [*free]
    for n in free:
        constant, truth = found.parameters[n], problem.model.parameter(n).value
        assert constant.value == pytest.approx(truth, rel=0.15), n
        assert constant.identified, (n, constant.verdict)
        assert abs(constant.value - truth) < 2.5 * constant.standard_error, n  # what a window smooths away is in it
    assert found.to_json()["estimator"] == "huber"
    assert "J" not in str(found.warnings)
    assert "nan" not in f"{found}{found.left_over}{found._repr_html_()}".lower()


def test_a_force_that_is_held_between_its_samples_damps_nothing():
    model, step, finer = fracid.model("oscillator"), 0.01, 20
    force = np.repeat(np.random.default_rng(1).uniform(-5, 5, 200), 10)
    fine = np.append(np.repeat(force, finer), 0.0)[:, None]
    twin = fracid.simulate(model, orders={"mu": 1.0}, initial={}, step=step / finer, end=20.0, inputs=fine)
    y = twin.states[:-1:finer, :1]
    y = y + 1e-4 * np.ptp(y) * np.random.default_rng(1).standard_normal(y.shape)
    steps = Experiment("steps", step, y, force[:, None], between={"force": "hold"})
    free = {n: Free(1.7 * model.parameter(n).value, 1e-9, 1e5) for n in ("m", "k", "b_displacement")}
    found = regress_equations(Problem(model, (steps,), {"mu": 1.0}, free, outputs=("displacement",)))
    damping = found.parameters["b_displacement"]
    assert abs(damping.value - model.parameter("b_displacement").value) < 2.5 * damping.standard_error


def test_what_was_not_measured_or_is_masked_has_no_rows_of_equations_either():
    free = ("m", "k", "b_displacement")
    problem = problem_of("oscillator", free, {"mu": 1.0}, force=10.0, outputs=["displacement"])
    (e,) = problem.experiments
    lost, line = (e.time > 3.0) & (e.time < 4.5), e.measured.copy()
    line[lost] = np.interp(e.time[lost], e.time[~lost], line[~lost, 0])[:, None]
    masked = replace(e, measured=np.where(lost[:, None], 9.0, e.measured), mask=((3.0, 4.5),))
    blank = replace(e, measured=line, blanks=(((3.0, 4.5),),))
    for beside in (masked, blank):
        found = regress_equations(replace(problem, experiments=(beside,)))
        for n in free:
            assert found.parameters[n].value == pytest.approx(problem.model.parameter(n).value, rel=0.03), n
    with pytest.raises(InputError, match="twin has no rows once its gaps and what is masked are left out"):
        regress_equations(replace(problem, experiments=(replace(e, mask=((0.01, 7.99),)),)))


def test_what_is_not_linear_is_named_and_held():
    at = {"orders": {"mu": 1.0}, "initial": {"angle": 1.0}, "coulomb_angle": 1e-3}
    found = regress_equations(problem_of("pendulum", ("J", "coulomb_angle", "slip_speed"), off=1.0, **at))
    assert [*found.parameters] == ["J", "coulomb_angle"]
    assert found.warnings[0] == "slip_speed: the equations are not linear in it; held at the project's start."


def test_a_constant_without_effect_is_held_and_named():
    problem = problem_of("oscillator", ("m", "k"), {"mu": 1.0}, force=1.0)
    free = {**problem.parameters, "slip_speed": Free(0.01, 1e-3, 1.0)}  # of dry friction, which is 0 here
    found = regress_equations(replace(problem, parameters=free))
    assert [*found.parameters] == ["m", "k"]
    assert found.warnings[0] == "slip_speed: no equation depends on it; held at the project's start."


@pytest.mark.broad
def test_equations_that_do_not_fit_identify_nothing():
    """The cart-pole's masses multiply each other in its determinant: one is held, at a start that is far off."""
    problem = problem_of("cart-pole", ("M", "ml", "g"), {"lambda": 1.0, "mu": 1.0}, {"angle": 0.5}, force=1.0)
    found = regress_equations(problem)
    assert "ml, g: the equations are not linear in them" in found.warnings[0]
    assert not found.parameters["M"].identified
    assert any("The speed's equation fits by 32 % only" in w for w in found.warnings)


@pytest.mark.broad
def test_a_free_response_determines_only_ratios():
    problem = problem_of("pendulum", ("gravity", "J", "b_angle"), {"mu": 1.0}, {"angle": 1.0})
    with pytest.raises(InputError, match=r"only ratios of gravity, J, b_angle\. Fix one of them"):
        regress_equations(problem)


def test_a_state_that_nothing_measures_is_named():
    problem = problem_of("two-mass", ("J_motor", "k"), {"lambda": 1.0, "mu": 1.0}, force=0.1, outputs=["motor"])
    with pytest.raises(
        InputError, match=r"The equation of motor_rate has load, load_rate, which nothing measures here"
    ):
        regress_equations(problem)


def test_an_output_that_is_a_function_is_linear_too():
    """Of a strip the springpot's state has no constant but its order."""
    model, t = fracid.model("relaxation", k=100.0, c=50.0), np.arange(0, 20, 0.02)
    stretch = 0.02 * np.minimum(t, 1.0)
    u = np.column_stack([stretch, np.gradient(stretch, 0.02)])
    twin = fracid.simulate(model, orders={"nu": 0.3}, initial={}, step=0.02, end=t[-1], inputs=u)
    force = 100.0 * stretch + 50.0 * twin.states[:, 0]
    free = {"k": Free(30.0, 0.0, 1e3), "c": Free(90.0, 0.0, 1e3)}
    strip = Experiment("strip", 0.02, force[:, None], u, units={"force": "N"})
    found = regress_equations(Problem(model, (strip,), {"nu": 0.3}, free, outputs=("force",), initial_state="held"))
    assert found.parameters["k"].value == pytest.approx(100.0, rel=2e-2)
    assert found.parameters["c"].value == pytest.approx(50.0, rel=2e-2)


AXIS = """[model]
name = "axis"
inputs = { force = "N" }
[model.equations]
position = "speed"
speed = "(force - b*speed - f*tanh(speed/0.01))/m"
[model.outputs]
position = { equals = "position", unit = "m" }
[model.parameters]
m = { start = 5.0, lower = 0.1, upper = 100.0, unit = "kg" }
b = { start = 1.0, lower = 0.0, upper = 100.0 }
f = { start = 0.5, lower = 0.0, upper = 10.0 }
[[recording]]
file = "axis.npz"
force = { column = "force", unit = "N", between = "line" }
position = { column = "position", unit = "m" }
"""


def test_the_command_takes_a_project_of_equations(tmp_path, capsys):
    t = np.arange(0, 8, 2e-3)
    project = AXIS.replace("start = 5.0", "start = 2.0").replace("start = 1.0", "start = 3.0")
    np.savez(tmp_path / "axis.npz", time=t, force=5 * drive(t), position=0 * t)
    (tmp_path / "truth.toml").write_text(project, encoding="utf-8")
    truth = fracid.load_project(tmp_path / "truth.toml").problem
    twin = fracid.simulate(truth.model.with_parameters(**truth.parameter_starts), orders={}, initial={}, step=2e-3,
                          end=t[-1], inputs=5 * drive(t)[:, None])  # fmt: skip
    np.savez(tmp_path / "axis.npz", time=t, force=5 * drive(t), position=twin.states[:, 0])
    (tmp_path / "axis.toml").write_text(AXIS, encoding="utf-8")
    code, out, _ = run(capsys, "regress", tmp_path / "axis.toml", "--json")
    result = json.loads(out)
    assert code == 0
    for name, value in (("m", 2.0), ("b", 3.0), ("f", 0.5)):
        assert result["parameters"][name]["value"] == pytest.approx(value, rel=0.1), name
        assert result["start"][name] == pytest.approx(result["parameters"][name]["value"])
    assert run(capsys, "regress", tmp_path / "axis.toml")[0] == 0
