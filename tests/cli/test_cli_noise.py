"""``fracid noise``: of a run folder and of a project, as a table, JSON, CSV and a figure; gone on with; refusals."""

import csv
import json

import pytest

from program import fit_in, run
from twins import write_release

pytestmark = pytest.mark.usefixtures("without_rivals")

PROJECT = """
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

QUICK = ("--levels", "0.1", "--counts", "4096", "--executor", "threads")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A project with a twin of 2 s, and its run."""
    folder = tmp_path_factory.mktemp("noise")
    write_release(folder / "swing.csv", alpha=0.35, step=5e-3, end=2.0)
    fit_in(folder, PROJECT)
    return folder


def test_of_a_run_it_writes_table_figure_and_record_beside_it(capsys, folder):
    code, out, err = run(capsys, "noise", folder / "run", "--seeds", "3", *QUICK)
    assert (code, err) == (0, "")
    (row,) = [line for line in out.splitlines() if line.startswith("μ ")]
    assert row.split()[1] == "0.95"
    assert "0.1° of noise, 4096 counts" in out
    assert "intervals of 95 % contain the true value" in out
    where = folder / "run" / "noise"
    record = json.loads((where / "noise.json").read_text(encoding="utf-8"))
    fitted = json.loads((folder / "run" / "result.json").read_text(encoding="utf-8"))
    assert record["truth"] == {"mu": fitted["orders"]["mu"]["value"]}
    mu = record["cells"][0]["unknowns"]["mu"]
    assert abs(mu["bias"]) < 5 * mu["spread"] < 1e-2
    with (where / "noise.csv").open(encoding="utf-8", newline="") as file:
        (line,) = csv.DictReader(file)
    assert (line["unknown"], float(line["bias"]), line["intervals"]) == ("mu", mu["bias"], "3")
    assert (where / "figures" / "noise.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.broad
def test_of_a_project_it_fits_first_and_tells_programs_alone(capsys, folder, tmp_path):
    code, out, err = run(capsys, "noise", folder / "rig.toml", "--seeds", "2", *QUICK, "--out", tmp_path, "--json")
    record = json.loads(out)
    assert code == 0
    assert {json.loads(line)["event"] for line in err.splitlines()} == {"stage", "progress"}
    assert record["truth"]["mu"] == pytest.approx(0.95, abs=1e-4)
    assert (record["optimiser"], record["cost"], record["seeds"]) == ("multistart", "rmse", 2)


@pytest.mark.broad
def test_more_seeds_and_levels_go_on_from_what_is_done(capsys, folder, tmp_path):
    few = ("noise", folder / "run", "--out", tmp_path, "--executor", "threads", "--counts", "4096", "--json")
    _, out, _ = run(capsys, *few, "--seeds", "2", "--levels", "0.1")
    first = json.loads(out)["repetitions"]
    journal = tmp_path / "journal.jsonl"
    before = journal.read_bytes()
    _, out, err = run(capsys, *few, "--seeds", "3", "--levels", "0.1,0.2")
    assert journal.read_bytes().startswith(before)
    assert len(journal.read_text(encoding="utf-8").splitlines()) == 1 + 6
    assert [e["earlier"] for e in map(json.loads, err.splitlines()) if "earlier" in e][-1] == 2
    assert first.items() <= json.loads(out)["repetitions"].items()


@pytest.mark.broad
def test_another_study_in_the_same_folder_is_refused(capsys, folder, tmp_path):
    same = ("noise", folder / "run", "--out", tmp_path, "--seeds", "1", *QUICK)
    assert run(capsys, *same)[0] == 0
    code, _, err = run(capsys, *same, "--cost", "itae")
    assert code == 2
    assert 'cost was "rmse" and is "itae"' in err


@pytest.mark.broad
def test_another_cost_and_optimiser_are_taken(capsys, folder, tmp_path):
    code, out, _ = run(capsys, "noise", folder / "run", "--seeds", "1", *QUICK, "--out", tmp_path, "--json", "--cost",
                       "iae", "--optimiser", "genetic")  # fmt: skip
    record = json.loads(out)
    assert code == 0
    assert (record["optimiser"], record["cost"]) == ("genetic", "iae")


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ["--levels", "0.1;0.2"],
            "--levels '0.1;0.2' is not possible; expected numbers from 0 on: --levels 0.05,0.1,0.2",
        ),
        (["--levels", "-1"], "--levels '-1' is not possible"),
        (["--counts", "1"], "--counts 1 is not possible; expected counts a turn, e.g. 4096, or 0"),
        (["--levels", "0.1,0.1"], "name one twice"),
        (["--levels", "400"], "expected a number from 0 to π, in radians"),
        (["--optimiser", "annealing"], "annealing"),
        (["--cost", "rsme"], "did you mean rmse"),
        (["--executor", "process"], "There is no executor 'process'"),
    ],
)
def test_what_cannot_be_is_a_sentence_and_exit_code_2(capsys, folder, tmp_path, options, message):
    code, out, err = run(capsys, "noise", folder / "run", "--out", tmp_path, *options)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert message in err


def test_a_folder_that_is_no_run_is_refused(capsys, tmp_path):
    code, _, err = run(capsys, "noise", tmp_path)
    assert code == 2
    assert "is no run folder" in err
