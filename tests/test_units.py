"""What is no angle is shown in its own unit: in figures, in sentences, in the unknowns' units."""

import re
from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid import Experiment, Free, Model, Parameter, Problem
from fracid.estimation.records import RecordingFit
from fracid.twins.encoder import simulated
from fracid.units import shown_unit, with_unit
from fracid.validation.monte_carlo import _read, planned
from fracid.workflows.monte_carlo import _grid

pytestmark = pytest.mark.usefixtures("without_rivals")

TIME = np.arange(0, 10, 0.01)


def rhs(t, x, u, p, out):
    out[0] = -p[0] * x[0] + u[0]


CELL = Model(
    name="cell", rhs=rhs, states=("v",), orders=("q",), outputs={"voltage": 0}, inputs=("current",),
    parameters=(Parameter("rate", "1/s^q", 0.5, "of discharge", lower=0.0),), zero="", source="a test",
)  # fmt: skip


def recorded(unit):
    """A release as RecordingFit has it, of an output in that unit."""
    noise = 1e-3 * np.random.default_rng(1).standard_normal(TIME.size)
    fitted = np.exp(-0.5 * TIME) * np.cos(6 * TIME)
    return RecordingFit("run", "fit", TIME, {"y": fitted + noise}, {"y": fitted}, 1e-3, {}, {}, units={"y": unit})


def texts(figure):
    from matplotlib.text import Text

    return [t.get_text() for t in figure.findobj(Text) if t.get_text()]


@pytest.mark.few(1)
@pytest.mark.parametrize("unit", ["V", "m", "A", "1", "N m"])
@pytest.mark.parametrize("draw", ["plot", "plot_residuals", "tests"])
def test_a_figure_of_what_is_no_angle_has_no_degrees(unit, draw):
    fit = recorded(unit)
    figure = fit.plot() if draw == "plot" else fit.plot_residuals(tests=draw == "tests")
    assert not [t for t in texts(figure) if "°" in t]
    label = "–" if unit == "1" else unit
    assert any(f"[{label}]" in t for t in texts(figure))


def test_figures_of_an_angle_are_in_degrees_whether_its_unit_is_said_or_not():
    said, unsaid = recorded("rad"), replace(recorded("rad"), units={})
    assert texts(said.plot()) == texts(unsaid.plot())
    assert any("[°]" in t for t in texts(said.plot()))


@pytest.mark.parametrize("unit", ["V", "1"])
def test_sentences_of_a_residual_say_its_unit(unit):
    level = fracid.residual_analysis(recorded(unit), "y").sentences["level"]
    said = re.match(r"rms ([\d.]+\d)(.*?)\. No rounding", level)
    assert float(said[1]) == pytest.approx(1e-3, rel=0.1)
    assert said[2].strip() == ("" if unit == "1" else unit)
    off = replace(recorded(unit), fitted={"y": recorded(unit).measured["y"] - 0.5})
    assert "°" not in fracid.residual_analysis(off, "y").sentences["whiteness"]


def test_a_recordings_unit_goes_with_the_problem_to_the_fit_and_to_the_units_of_the_unknowns():
    current = np.where(TIME > 1, 0.0, 1.0)
    run = fracid.simulate(CELL, orders={"q": 0.9}, initial={}, step=0.01, end=9.99, inputs=current[:, None])
    signals = {"current": current, "voltage": run.states[:, 0]}
    recording = fracid.Recording.of("cell", TIME, signals, {"current": "A", "voltage": "V"})
    cell = Experiment.of(recording, CELL, ["voltage"])
    problem = Problem(
        CELL, (cell,), {"q": Free(1.0, 0.5, 1.2)}, {"rate": Free(1.0, 0.0, 5.0)}, outputs=("voltage",),
        initial_state="rest",
    )  # fmt: skip
    assert {u.name: u.unit for u in problem.unknowns} == {"q": "", "rate": "1/s^q", "v(0) [cell]": "V"}
    fit = fracid.identify(problem)
    assert fit.recordings["cell"].unit("voltage") == "V"
    assert fit.orders["q"].value == pytest.approx(0.9, abs=1e-6)


@pytest.mark.parametrize(
    ("unit", "value", "text"),
    [("rad", np.pi, "180°"), ("rad/s", np.pi, "180°/s"), ("V", 1.5, "1.5 V"), ("1", 1.5, "1.5"), ("", 2.0, "2")],
)
def test_a_value_is_written_with_the_unit_in_which_it_is_shown(unit, value, text):
    assert with_unit(value, unit) == text
    assert value * shown_unit(unit)[1] == pytest.approx(float(re.match(r"[\d.]+", text)[0]))


def voltages():
    """Ten seconds of a cell that is charged and let alone."""
    current = np.where(TIME > 1, 0.0, 1.0)
    signals = {"current": current, "voltage": 0 * TIME}
    recording = fracid.Recording.of("cell", TIME, signals, {"current": "A", "voltage": "V"})
    cell = Experiment.of(recording, CELL, ["voltage"], {"v": 0.0})
    return Problem(CELL, (cell,), {"q": Free(1.0, 0.5, 1.2)}, outputs=("voltage",), initial_state="held")


@pytest.mark.broad
def test_levels_of_noise_are_in_the_unit_of_the_output():
    study = fracid.noise_study(voltages(), np.array([0.9]), levels=[1e-3], resolutions=[0.0, 2e-3], seeds=2)
    assert [cell.label for cell in study.cells] == ["0.001 V of noise, no rounding", "0.001 V of noise, 0.002 V"]
    assert study.cells[1].counts is None
    assert any("[V]" in t for t in texts(study.plot()))


def test_relative_levels_are_multiples_of_each_outputs_own_residual():
    problem, truth = voltages(), np.array([0.9])
    size = problem.levels(truth)["voltage"]
    plan = planned(problem, truth, levels=[0.5, 2.0], seeds=1, relative=True)
    assert plan.how["sizes"] == [size]
    (exact,) = simulated(plan.problem, truth).experiments
    noise = [_read(exact, level, 0.0, np.random.default_rng(1), [size]) - exact.measured for level in (0.5, 2.0)]
    assert [np.std(n) / size for n in noise] == pytest.approx([0.5, 2.0], rel=0.1)
    study = plan.run()
    assert [cell.label for cell in study.cells] == [f"{k} × RMS of noise, no rounding" for k in ("0.5", "2")]
    assert study.to_json()["sizes"] == {"voltage": size}
    assert any("[× RMS]" in t for t in texts(study.plot()))


def test_multiples_of_a_residual_that_is_0_are_refused():
    problem, truth = voltages(), np.array([0.9])
    exact = simulated(problem, truth, finer=1)
    with pytest.raises(fracid.InputError, match="The residual of voltage is 0"):
        planned(exact, truth, levels=[1.0], seeds=1, relative=True)


def test_of_outputs_that_are_no_angles_the_command_takes_multiples_and_no_counts():
    assert _grid(voltages(), None, None, False, True) == {
        "levels": (0.5, 1.0, 2.0), "resolutions": (0.0,), "relative": True}  # fmt: skip
    assert _grid(voltages(), [3.0], None, False, True)["levels"] == [3.0]
    assert _grid(voltages(), [1e-3], [2e-3], False, False) == {
        "levels": [1e-3], "resolutions": [2e-3], "relative": False}  # fmt: skip
    with pytest.raises(fracid.InputError, match=r"--counts is of angles, and the recordings have voltage in V"):
        _grid(voltages(), None, [4096.0], False, True)
