"""A unit of co-simulation gives what fracid simulates, in tools that know nothing of fracid."""

import re
import subprocess
import zipfile
from ctypes import CDLL
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu

import fracid
from fracid.estimation.records import Estimate
from fracid.export.fmu import description, fmu, sources
from fracid.export.identified import Identified
from languages import GCC
from own_models import of_file

pytestmark = pytest.mark.skipif(GCC is None, reason="gcc is not installed")

ORDERS = {"mu": 0.93, "lambda": 0.95, "q": 0.9, "nu": 0.3}
CASES = {
    "rotary-pendulum": {"coulomb_alpha": 1e-5, "back_emf": 0.01, "b_alpha": 2e-4},
    "pendulum": {},
    "joint": {"gravity": 0.1, "coulomb_angle": 0.03, "springpot_angle": 0.01},
    "relaxation": {"k_1": 30.0},
    "oscillator": {"k3": 9000.0},
    "capacitor": {"C1": 3.0, "leak": 2e-3, "C_1": 2.0},
    "titin": {"c": 0.3},
}
STEPS, STEP = 400, 1e-2


def problem_of(name, between="line", **options):
    """Driven by what begins after eight steps, and fractional."""
    model = of_file("real/titin/model.py").model if name == "titin" else fracid.model(name)
    model = model.with_parameters(**CASES[name])
    t = STEP * np.arange(STEPS + 1)
    wave = np.where(t > 8 * STEP, np.sin(2.0 * t - 16 * STEP) ** 2, 0.0)
    columns = [0.3 * wave if n not in model.input_rates else 0.0 * t for n in model.inputs]
    if name == "titin":
        columns[0] = 0.95 + 0.2 * wave
    u = np.column_stack(columns) if columns else np.zeros((1, 1))
    for rate, of in model.input_rates.items():
        u[1:, model.inputs.index(rate)] = np.diff(u[:, model.inputs.index(of)]) / STEP
    initial = {"alpha": 0.3} if "alpha" in model.outputs and not model.inputs else {}
    e = fracid.Experiment("twin", STEP, np.zeros((STEPS + 1, len(model.outputs))), u, initial=initial,
                          between=dict.fromkeys(model.inputs, between))  # fmt: skip
    orders = {n: ORDERS[n] for n in model.order_names}
    return fracid.Problem(model, (e,), orders, initial_state="held", outputs=tuple(model.outputs), **options)


def of(problem):
    return Identified("a twin", problem, problem.start, steps=STEPS)


def archive(folder, problem, version="2"):
    data, notes = fmu(of(problem), version)
    assert not notes
    path = folder / f"model-{version}.fmu"
    path.write_bytes(data)
    return path


def driven(problem):
    """The inputs as FMPy takes them."""
    e, names = problem.experiments[0], problem.model.inputs
    rows = np.column_stack([STEP * np.arange(STEPS + 1), e.inputs]) if names else None
    return None if rows is None else np.array([*map(tuple, rows)], dtype=[(n, "f8") for n in ("time", *names)])


def simulated(path, problem, names, **more):
    """What FMPy simulates, a column a variable."""
    options = {"stop_time": STEPS * STEP, "output_interval": STEP} | more
    run = fmpy.simulate_fmu(str(path), output=names, **options)
    return np.column_stack([run[n] for n in names])


def agree(found, ours):
    assert np.all(np.ptp(ours, axis=0) > 1e-3)
    assert np.all(np.abs(found - ours).max(axis=0) <= 1e-9 * np.ptp(ours, axis=0))


def states(problem):
    return [f"state.{n}" for n in problem.model.states]


@pytest.mark.few(1)
@pytest.mark.parametrize("version", ["2", "3"])
@pytest.mark.parametrize("name", CASES)
def test_with_inputs_that_are_held_it_steps_as_fracid_does(tmp_path, name, version):
    problem = problem_of(name, "hold")
    path = archive(tmp_path, problem, version)
    assert validate_fmu(str(path)) == []
    agree(
        simulated(path, problem, states(problem), input=driven(problem)),
        problem.simulate(problem.start, problem.experiments[0]).states,
    )


class Unit:
    """An instance of an FMU of version 2.0, step by step."""

    def __init__(self, path, folder, **values):
        description = fmpy.read_model_description(str(path))
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self.fmu = FMU2Slave(guid=description.guid, unzipDirectory=fmpy.extract(str(path), str(folder)),
                             modelIdentifier=description.coSimulation.modelIdentifier, instanceName="one")  # fmt: skip
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.set(values)
        self.fmu.exitInitializationMode()

    def set(self, values):
        self.fmu.setReal([self.references[n] for n in values], [*values.values()])

    def get(self, names):
        return self.fmu.getReal([self.references[n] for n in names])

    def along(self, problem, names, steps=range(STEPS)):
        """The inputs with their slopes; a row a step."""
        inputs, u, rows = problem.model.inputs, problem.experiments[0].inputs, []
        which = [self.references[n] for n in inputs]
        for n in steps:
            if inputs:
                self.set(dict(zip(inputs, u[n], strict=True)))
                slope = (u[n + 1] - u[n]) / STEP
                self.fmu.setRealInputDerivatives(which, [1] * len(which), [*slope])
            self.fmu.doStep(n * STEP, STEP)
            rows.append(self.get(names))
        return np.array(rows)


@pytest.mark.broad
@pytest.mark.parametrize("name", CASES)
def test_with_the_slopes_of_its_inputs_its_outputs_are_those_of_fracid(tmp_path, name):
    problem = problem_of(name)
    names = [*states(problem), *problem.model.outputs]
    found = Unit(archive(tmp_path, problem), tmp_path / "unit").along(problem, names)
    run = problem.simulate(problem.start, problem.experiments[0])
    agree(found, np.hstack([run.states, problem.fitted(problem.start, problem.experiments[0])])[1:])


@pytest.mark.broad
def test_where_an_input_jumps_an_output_is_that_before_it_until_the_new_value_is_set(tmp_path):
    problem = problem_of("capacitor", "hold")
    (e,), shown = problem.experiments, ["state.v", *problem.model.outputs]
    unit, R = Unit(archive(tmp_path, problem), tmp_path / "unit"), problem.model.parameter("R").value
    before, after = np.zeros((2, STEPS))
    for n in range(STEPS):
        unit.set({"current": e.inputs[n, 0]})
        unit.fmu.doStep(n * STEP, STEP)
        v, before[n] = unit.get(shown)
        assert before[n] == pytest.approx(v + R * e.inputs[n, 0], abs=1e-12)
        unit.set({"current": e.inputs[n + 1, 0]})
        after[n] = unit.get(shown)[1]
    ours = problem.fitted(problem.start, e)[1:]
    agree(after[:, None], ours)
    assert np.max(np.abs(before - ours[:, 0])) == pytest.approx(R * np.max(np.abs(np.diff(e.inputs[:, 0]))))


@pytest.mark.broad
def test_a_state_that_is_saved_is_gone_on_from_and_survives_as_bytes(tmp_path):
    problem = problem_of("joint")
    unit = Unit(archive(tmp_path, problem), tmp_path / "unit")
    unit.along(problem, ["angle"], range(150))
    state = unit.fmu.getFMUstate()
    first = unit.along(problem, ["angle"], range(150, STEPS))
    unit.fmu.setFMUstate(unit.fmu.deSerializeFMUstate(unit.fmu.serializeFMUstate(state)))
    np.testing.assert_array_equal(unit.along(problem, ["angle"], range(150, STEPS)), first)


@pytest.mark.broad
def test_two_instances_with_parameters_and_starts_of_their_own_do_not_disturb_each_other(tmp_path):
    problem = problem_of("rotary-pendulum")
    path = archive(tmp_path, problem)
    changed = {"b_alpha": 1e-3, "state.alpha": 0.2}
    one, other = Unit(path, tmp_path / "one"), Unit(path, tmp_path / "other", **changed)
    rows = [[u.along(problem, ["alpha"], [n])[0, 0] for u in (one, other)] for n in range(STEPS)]
    model = problem.model.with_parameters(b_alpha=1e-3)
    moved = replace(problem.experiments[0], initial={"alpha": 0.2})
    second = replace(problem, model=model, experiments=(moved,))
    ours = [p.fitted(p.start, p.experiments[0])[1:, 1] for p in (problem, second)]
    agree(np.array(rows), np.column_stack(ours))


@pytest.mark.broad
def test_between_its_own_steps_it_is_read_from_the_line_between_them_and_longer_ones_are_many(tmp_path):
    problem = problem_of("oscillator")
    e = replace(problem.experiments[0], inputs=np.zeros((1, 1)), initial={"displacement": 0.1})
    problem = replace(problem, experiments=(e,))
    path, ours = archive(tmp_path, problem), problem.fitted(problem.start, e)
    fine, coarse = (simulated(path, problem, ["displacement"], output_interval=k * STEP) for k in (0.5, 5))
    agree(fine[::2], ours)
    agree(fine[1::2], (ours[1:] + ours[:-1]) / 2)
    agree(coarse, ours[::5])


@pytest.fixture(scope="module")
def oscillator(tmp_path_factory):
    """One, and the archive of it."""
    problem = problem_of("oscillator")
    return problem, archive(tmp_path_factory.mktemp("oscillator"), problem)


def test_a_run_that_fails_is_told_through_the_logger(tmp_path, oscillator):
    problem, path = oscillator
    unit = Unit(path, tmp_path / "unit", k3=-1e12, **{"state.displacement": 1.0})
    with pytest.raises(fmpy.fmi1.FMICallException):
        unit.along(problem, ["displacement"])


def test_a_parameter_cannot_be_changed_once_the_run_has_begun(tmp_path, oscillator):
    problem, path = oscillator
    unit = Unit(path, tmp_path / "unit")
    unit.along(problem, ["displacement"], [0])
    with pytest.raises(fmpy.fmi1.FMICallException):
        unit.set({"k": 3.0})


def test_the_archive_is_the_same_to_the_byte_and_its_description_has_units_and_intervals(tmp_path):
    problem = problem_of("capacitor")
    found = replace(of(problem), estimates={"R": Estimate(0.05, "Ohm", True, interval95=(0.04, 0.06))})
    made = fmu(found)
    assert made == fmu(found)
    (tmp_path / "model.fmu").write_bytes(made[0])
    described = {v.name: v for v in fmpy.read_model_description(str(tmp_path / "model.fmu")).modelVariables}
    assert (described["R"].unit, described["R"].start) == ("Ohm", "0.05")
    assert described["R"].description == "resistance in series, 95 % interval [0.04, 0.06]"
    assert (described["order.q"].variability, described["voltage"].unit) == ("constant", "V")


@pytest.mark.few(1)
@pytest.mark.parametrize("version", ["2", "3"])
def test_the_sources_agree_with_the_headers_of_the_standard_and_compile_without_a_warning(tmp_path, version):
    for name in ("pendulum", "joint"):
        for file, text in sources(of(problem_of(name)), version).items():
            (tmp_path / file).write_text(text, encoding="utf-8")
        headers = Path(fmpy.__file__).parent / "c-code"
        command = [GCC, "-std=c11", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-c", f"-I{headers}"]
        for more in ([], ["-include", f"fmi{version}Functions.h"]):
            done = subprocess.run([*command, *more, "fmu.c"], cwd=tmp_path, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr


@pytest.mark.few(1)
@pytest.mark.parametrize("version", ["2", "3"])
def test_every_function_of_the_standard_is_in_the_library(tmp_path, version):
    header = (Path(fmpy.__file__).parent / "c-code" / f"fmi{version}Functions.h").read_text(encoding="utf-8")
    names = set(re.findall(r"fmi\dFullName\((fmi\w+)\)", header))
    with zipfile.ZipFile(archive(tmp_path, problem_of("pendulum"), version)) as file:
        (library,) = [n for n in file.namelist() if n.startswith("binaries/")]
        loaded = CDLL(file.extract(library, tmp_path))
    assert len(names) > 30
    exchange = "EventMode|DiscreteStates|ContinuousTime|SetTime|Integrator|ContinuousStates|GetDerivatives|Indicators"
    assert not [n for n in names if not hasattr(loaded, n) and not (version == "2" and re.search(exchange, n))]


def test_what_a_model_is_called_is_no_code_and_no_xml():
    evil = '*/ int evil; /* <evil a="b">\x00'
    problem = problem_of("oscillator")
    parameters = tuple(replace(p, unit=evil, description=evil) for p in problem.model.parameters)
    model = replace(problem.model, name=evil, source=evil, parameters=parameters)
    named = Identified(evil, replace(problem, model=model), problem.start, steps=STEPS)
    for version in "23":
        for text in sources(named, version).values():
            assert "evil" not in re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
        ElementTree.fromstring(description(named, version, "{1}").encode())
