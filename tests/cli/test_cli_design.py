"""``fracid design``: of a run, of a project and of a rig; as a table, JSON and a sheet; refusals."""

import json
import tomllib

import numpy as np
import pytest

import fracid
from program import fit_in, run
from twins import write_release

PROJECT = """
[model]
rig = "srv02-rotpen"
[model.parameters]
b_alpha = { start = 3e-4, lower = 0.0, upper = 1e-2 }
[model.orders]
lambda = 0.9
mu = { start = 1.0, lower = 0.5, upper = 1.2 }
[[recording]]
name = "release 20°"
file = "swing.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
initial = { theta = 0.0, alpha = 0.35 }
[fit]
initial_state = "held"
substeps = 2
"""

QUICK = ("--release", "20,60,100", "--seconds", "2", "--rate", "200")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A project with a twin of 2 s, and its run."""
    folder = tmp_path_factory.mktemp("design")
    write_release(folder / "swing.csv", alpha=0.35, step=5e-3, end=2.0)
    fit_in(folder, PROJECT)
    return folder


def test_of_a_run_it_prints_the_plan_and_writes_the_sheet_beside_it(capsys, folder):
    code, out, err = run(capsys, "design", folder / "run", "--for", "mu", "--experiments", "2", *QUICK)
    assert (code, err) == (0, "")
    (row,) = [line for line in out.splitlines() if line.startswith("mu ")]
    assert float(row.partition("95 % interval ")[2].split()[0]) > 1.5  # times narrower
    assert "release from 100°" in out
    assert "--out runs/run-next" in " ".join(out.split())
    assert {"sheet.txt", "next.toml", "plan.json"} <= {p.name for p in (folder / "run" / "design").iterdir()}
    project = (folder / "run" / "design" / "next.toml").read_text(encoding="utf-8")
    assert '[model]\nrig = "srv02-rotpen"\n' in project
    assert " times narrower than ± " in row


def test_the_next_project_fits_the_recordings_so_far_and_those_to_come(capsys, folder):
    assert run(capsys, "design", folder / "rig.toml", "--experiments", "1", *QUICK, "--out", folder / "next")[0] == 0
    project = tomllib.loads((folder / "next" / "next.toml").read_text(encoding="utf-8"))
    first, second = project["recording"]
    assert (first["name"], second["name"]) == ("release 20°", "2: 100°")
    assert (folder / "next" / first["file"]).resolve() == (folder / "swing.csv").resolve()
    assert (first["initial"]["alpha"], second["file"]) == (0.35, "recording-1.csv")
    assert project["fit"]["initial_state"] == "rest"  # as the new one, which is no less than what "held" finds


@pytest.mark.broad
def test_a_release_planned_beside_a_recording_that_starts_in_motion_starts_at_rest(capsys, folder):
    (folder / "moving.toml").write_text(PROJECT.replace('"held"', '"estimate"'), encoding="utf-8")
    out = folder / "beside"
    assert run(capsys, "design", folder / "moving.toml", "--experiments", "1", *QUICK, "--out", out)[0] == 0
    released = fracid.Twin.of_model(fracid.rotary_pendulum(), initial={"alpha": 1.7}, step=5e-3, end=3.0, hold=1.0)
    fracid.save_recording(released.record(released.simulate()), out / "recording-1.csv")
    problem = fracid.load_project(out / "next.toml").problem
    so_far, planned = ([u.name for u in problem.unknowns if u.experiment == e.name] for e in problem.experiments)
    assert "D^lambda theta(0) [release 20°]" in so_far
    assert planned == ["theta(0) [2: 100°]", "alpha(0) [2: 100°]", "release_time [2: 100°]"]


def test_a_plan_compares_with_the_intervals_that_the_run_states(folder):
    saved = fracid.load_run(folder / "run")
    plan = fracid.design(saved, fracid.DesignSpace(release=60, seconds=2, rate=200), experiments=1)
    low, high = saved.result["orders"]["mu"]["interval95"]
    expected = plan.expected["mu"].interval95
    gain = plan.gain_over(saved)
    assert gain["mu"] == pytest.approx((high - low) / (expected[1] - expected[0]))
    assert gain["mu"] > 1
    assert set(gain) <= {"mu", "b_alpha"}


@pytest.mark.broad
def test_of_a_project_it_fits_first_and_tells_programs_alone(capsys, folder, tmp_path):
    code, out, err = run(capsys, "design", folder / "rig.toml", "--for", "mu", *QUICK, "--out", tmp_path, "--json")
    record = json.loads(out)
    assert code == 0
    assert {json.loads(line)["event"] for line in err.splitlines()} <= {"progress", "stage"}
    low, high = record["expected"]["mu"]["interval95"]
    assert (low + high) / 2 == pytest.approx(0.95, abs=1e-3)
    assert high - low < 1e-3
    assert len(record["experiments"]) == 3


LAG = """
import fracid

def rhs(t, x, u, p, out):
    out[0], out[1] = p[0] * u[0] - p[1] * x[0], (x[0] - x[1]) / 0.05  # a cell, and the low-pass of its logger

model = fracid.Model("lag", rhs, ("cell", "read"), ("q", 1.0), {"volts": 1}, parameters=(
    fracid.Parameter("gain", "V/A", 2.0, "of the current", lower=0.0), fracid.Parameter("rate", "1/s", 1.0, "of loss"),
), inputs=("current",), zero="", source="")
"""

LAG_PROJECT = """
[model]
name = "lag.py:model"
[model.parameters]
gain = { start = 1.9, lower = 0.5, upper = 5.0 }
rate = { start = 1.1, lower = 0.1, upper = 5.0 }
[model.orders]
q = { start = 0.9, lower = 0.5, upper = 1.0 }
[[recording]]
file = "lag.csv"
volts = { column = "volts", unit = "V" }
current = { column = "current", unit = "A", between = "line" }
initial = { cell = 0.0 }
[fit]
initial_state = "rest"
"""


WRITTEN = LAG_PROJECT.replace("""name = "lag.py:model"
""", """name = "cell"
inputs = { current = "A" }
[model.equations]
cell = { equals = "gain*current - rate*cell", order = "q" }
[model.outputs]
volts = { equals = "cell", unit = "V" }
""").replace('{ column = "current", unit = "A", between = "line" }', '"current"')  # fmt: skip


@pytest.mark.broad
@pytest.mark.parametrize(
    ("text", "says"),
    [
        (LAG_PROJECT, 'current = { column = "current", unit = "A", between = "hold" }'),
        (WRITTEN, 'cell = { equals = "gain*current - rate*cell", order = "q" }'),
        (
            WRITTEN.replace("5.0 }\n[model.orders]", '5.0, unit = "s^-q" }\n[model.orders]'),
            'upper = 5.0, unit = "s^-q" }',
        ),
        (WRITTEN, 'current = { column = "current", between = "hold" }'),
    ],
)
def test_a_model_of_ones_own_is_driven_and_not_released(capsys, tmp_path, text, says):
    (tmp_path / "lag.py").write_text(LAG, encoding="utf-8")
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    time = np.linspace(0, 4, 81)
    volts = 1.5 * (1 - np.exp(-time)) + 1e-2 * np.random.default_rng(1).standard_normal(81)
    table = np.column_stack([time, time > 0, volts])
    np.savetxt(tmp_path / "lag.csv", table, delimiter=",", header="time [s],current [A],volts [V]", comments="")
    code, out, err = run(
        capsys, "design", tmp_path / "rig.toml", "--trust", "--seconds", "4", "--rate", "20", "--experiments", "1",
        "--voltage", "pulses,0.5,2,3", "--out", tmp_path / "next",
    )  # fmt: skip
    assert (code, err) == (0, "")
    assert "from rest, pulses" in out
    project = (tmp_path / "next" / "next.toml").read_text(encoding="utf-8")
    assert "initial = { cell = 0.0 }" in project
    assert says in project


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--for", "beta"), "there is no 'beta'"),
        (("--release", "far"), "--release 'far' is not possible"),
        (("--voltage", "square,1,2,3"), "expected multisine,0.2,8,6"),
        (("--limit", "theta"), "expected NAME=VALUE: --limit theta=2.5"),
        (("--arm", "loose"), "unknown arm 'loose'; the known ones are free, clamped"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(capsys, tmp_path, options, told):
    code, out, err = run(
        capsys, "design", "qube-servo2", "--seconds", "1", "--rate", "100", "--out", tmp_path, *options
    )
    assert (code, out) == (2, "")
    assert told in err
    assert len(err.splitlines()) == 1
