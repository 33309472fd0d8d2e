"""``fracid compare``: tables, files and figures; the journal goes on; exit codes and mistakes in words."""

import csv
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import fracid
from fracid.cli.app import main
from program import run
from recordings import from_there, needs
from twins import write_release

PROJECT = """
[model]
rig = "stepper-freeswing"
[model.parameters]
C1 = { start = 9.8e-5, lower = 5e-5, upper = 2e-4 }
[model.orders]
lambda = 1.0
[[recording]]
name = "high"
file = "high.csv"
alpha = { column = "alpha", unit = "rad" }
initial = { alpha = 0.6 }
[[recording]]
name = "low"
file = "low.csv"
alpha = { column = "alpha", unit = "rad" }
initial = { alpha = 0.3 }
use = "validate"
[fit]
initial_state = "held"
"""
QUICK = ("--keep", "drag_theta", "--keep", "drag_alpha", "--rung", "viscous", "--rung", "Coulomb")


def write_swing(file, angle, seed, end=3.0):
    rig = fracid.rotary_pendulum("stepper-freeswing", coulomb_alpha=5e-5)
    write_release(file, rig, orders={"lambda": 1.0, "mu": 1.0}, alpha=angle, step=1e-2, end=end, outputs=("alpha",),
                  noise=1e-3, seed=seed)  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A project with two swings, and its comparison with the amplitude test."""
    folder = tmp_path_factory.mktemp("compare")
    for name, angle, seed in (("high", 0.6, 1), ("low", 0.3, 2)):
        write_swing(folder / f"{name}.csv", angle, seed)
    (folder / "rig.toml").write_text(PROJECT, encoding="utf-8")
    with pytest.raises(SystemExit) as stop:
        main(["compare", str(folder / "rig.toml"), "--out", str(folder / "run"), "--amplitude", "--jobs", "2", *QUICK])
    assert not stop.value.code
    return folder


@pytest.fixture
def folder(made, tmp_path, monkeypatch):
    """A copy of it, to be changed; its figures were drawn once."""
    shutil.copytree(made, tmp_path / "copy")
    monkeypatch.setattr("fracid.plots.save", lambda *_: [tmp_path / "figure.png"])
    return tmp_path / "copy"


# --- what it gives ----------------------------------------------------------------------------------------


def test_the_ladder_is_printed_with_its_verdict_and_where_everything_is(capsys, folder):
    code, out, err = run(capsys, "compare", folder / "rig.toml", "--out", folder / "run", "--amplitude", *QUICK)
    assert (code, err) == (0, "")
    rows = [line.split() for line in out.splitlines()]
    assert [row[:2] for row in rows if row[:1] == ["viscous"]] == [["viscous", "1"], ["viscous", "free"]] * 3
    assert "free ←" in out
    assert "free values  BIC" in out
    assert "held out: low" in out
    assert "effective samples" in out
    assert "mu " in out
    assert out.count("Orders make no difference, an integer-order model predicts as well") == 1
    assert "One held-out recording is not enough" in out
    for name in ("compare.json", "compare.csv", f"{folder.parent}: figure"):
        assert name in out


@pytest.mark.broad
def test_posterior_odds_are_a_column_of_a_comparison_that_was_made_without(capsys, folder):
    before = json.loads((folder / "run" / "compare.json").read_text(encoding="utf-8"))
    code, out, err = run(capsys, "compare", folder / "rig.toml", "--out", folder / "run", "--evidence", *QUICK)
    assert (code, err) == (0, "")
    assert "log odds" in out
    assert "+0.0" in out
    after = json.loads((folder / "run" / "compare.json").read_text(encoding="utf-8"))
    odds = [structure.pop("log_odds") for structure in after["structures"]]
    assert max(odds) == 0.0
    assert [structure.pop("log_odds") for structure in before["structures"]] == [None] * 4
    assert after | {"amplitude": {}} == before | {"amplitude": {}}


def test_the_run_folder_holds_numbers_table_and_figures(made):
    record = json.loads((made / "run" / "compare.json").read_text(encoding="utf-8"))
    assert [s["name"] for s in record["structures"]] == [
        "viscous, orders 1", "viscous, orders free", "viscous + Coulomb, orders 1", "viscous + Coulomb, orders free",
    ]  # fmt: skip
    assert record["held_out"] == ["low"]
    assert set(record["data_sha256"]) == {"high", "low"}
    assert set(record["amplitude"]) == {"viscous, orders free", record["best"]["fractional"]}
    assert all(test["windows"] for test in record["amplitude"].values())
    with (made / "run" / "compare.csv").open(encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 4 * 2
    first = record["structures"][0]
    assert float(lines[0]["rmse_deg"]) == pytest.approx(np.degrees(first["in_sample"]["high"]["rmse"]["alpha"]))
    for name in ("ladder.png", "ladder.svg", "amplitude-viscous-orders-free.png"):
        assert (made / "run" / "figures" / name).stat().st_size > 1000


def test_the_best_structure_is_a_project_that_fits_as_well_from_where_it_was_found(made):
    record = json.loads((made / "run" / "compare.json").read_text(encoding="utf-8"))
    (best,) = (s for s in record["structures"] if s["name"] == record["best"]["integer"])
    project = fracid.load_project(made / "run" / "best.toml")
    assert [r.path.name for r in project.recordings] == ["high.csv", "low.csv"]
    assert project.problem.cost(project.problem.start) == pytest.approx(best["cost"], rel=1e-6)
    assert project.problem.orders == {"lambda": 1.0, "mu": 1.0}


def test_the_curves_of_every_structure_are_those_of_its_score(made):
    record = json.loads((made / "run" / "compare.json").read_text(encoding="utf-8"))
    found = json.loads((made / "run" / "curves.json").read_text(encoding="utf-8"))
    assert list(found["recordings"]) == ["low", "high"]  # held out ones first
    for structure in record["structures"]:
        for name, scores in (structure["in_sample"] | structure["held_out"]).items():
            error = np.subtract(found["recordings"][name]["measured"]["alpha"],
                                found["structures"][structure["name"]][name]["alpha"])  # fmt: skip
            assert np.sqrt(np.mean(error**2)) == pytest.approx(scores["rmse"]["alpha"], rel=1e-2)


def test_json_is_alone_on_standard_output_and_the_same_as_the_file(capsys, folder):
    before = (folder / "run" / "compare.json").read_text(encoding="utf-8")
    code, out, err = run(
        capsys, "compare", folder / "rig.toml", "--out", folder / "run", "--amplitude", "--json", *QUICK
    )
    assert code == 0
    assert out == before  # also: what the journal has gives the same numbers
    assert {json.loads(line)["event"] for line in err.splitlines()} == {"stage", "progress"}


# --- going on -----------------------------------------------------------------------------------------------


LAGS = """
[model]
name = "lag"
inputs = { u = "1" }
[model.equations]
x = { equals = "b*u - a*x", order = "q" }
[model.outputs]
x = { equals = "x", unit = "1" }
[model.parameters]
a = { start = 1.0, lower = 0.01, upper = 50.0 }
b = { start = 1.0, lower = 0.01, upper = 50.0 }
[[recording]]
file = "lag.csv"
u = 1
x = 2
[[alternative]]
name = "integer lag"
[alternative.equations]
x = "b*u - a*x"
[alternative.outputs]
x = { equals = "x", unit = "1" }
[alternative.parameters]
a = { start = 1.0, lower = 0.01, upper = 50.0 }
b = { start = 1.0, lower = 0.01, upper = 50.0 }
"""


@pytest.mark.broad
def test_an_alternative_without_orders_stands_in_the_table(capsys, tmp_path):
    t = np.arange(0, 5, 0.05)
    x = 1 - np.exp(-t) + 1e-2 * np.random.default_rng(1).standard_normal(100)
    np.savetxt(tmp_path / "lag.csv", np.c_[t, t >= 0, x], delimiter=",", header="t,u,x", comments="")
    (tmp_path / "lag.toml").write_text(LAGS, encoding="utf-8")
    code, out, err = run(capsys, "compare", tmp_path / "lag.toml", "--out", tmp_path / "run")
    assert (code, err) == (0, "")
    assert re.search(r"integer lag +1 +3 ", out)


@pytest.mark.broad
def test_the_same_command_goes_on_from_its_journal_and_ends_the_same(capsys, folder):
    journal, result = folder / "run" / "journal.jsonl", folder / "run" / "compare.json"
    whole, before = journal.read_bytes(), result.read_bytes()
    assert len(whole.splitlines()) == 1 + 1 + 4 + 2 + 5 + 2  # the project, fits, steps, all again, amplitude
    result.unlink()
    journal.write_bytes(b"\n".join(whole.splitlines()[:3]) + b'\n{"key": "visc')  # killed in writing the third
    code, _, err = run(capsys, "compare", folder / "rig.toml", "--out", folder / "run", "--amplitude", *QUICK)
    assert code == 0
    assert "was cut off in writing and is removed" in err
    assert result.read_bytes() == before
    assert journal.read_bytes().startswith(b"\n".join(whole.splitlines()[:3]))


def test_what_is_not_finished_is_not_given_up_for_another_comparison(capsys, folder):
    (folder / "run" / "compare.json").unlink()
    code, _, err = run(capsys, "compare", folder / "rig.toml", "--out", folder / "run", "--seed", 7, *QUICK)
    assert code == 2
    assert "seed was 1 and is 7" in err
    assert "fracid resume" in err


@pytest.mark.broad
def test_what_is_finished_gives_way_to_another_comparison(capsys, folder):
    (folder / "rig.toml").write_text(PROJECT.replace('use = "validate"', ""), encoding="utf-8")
    code, out, _ = run(capsys, "compare", folder / "rig.toml", "--out", folder / "run", *QUICK)
    assert code == 0
    assert "No recording was held out, so this is no proof" in out
    record = json.loads((folder / "run" / "compare.json").read_text(encoding="utf-8"))
    assert record["held_out"] == []


@pytest.mark.slow
def test_threads_processes_and_leave_one_out_agree_to_the_bit(capsys, folder):
    records = []
    for executor in ("threads", "processes"):
        code, out, _ = run(capsys, "compare", folder / "rig.toml", "--out", folder / executor, "--leave-one-out",
                           "--executor", executor, "--jobs", 2, "--json", *QUICK)  # fmt: skip
        assert code == 0
        records.append(json.loads(out))
    assert records[0] == records[1]
    assert records[0]["held_out"] == ["high", "low"]


# --- mistakes -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--keep", "b_alfa"), "unknown parameter to keep 'b_alfa': did you mean b_alpha?"),
        (("--executor", "thread"), "There is no executor 'thread'"),
        (("--preset", "papers"), "papers"),
    ],
)
def test_mistakes_are_answered_in_words(capsys, folder, arguments, says):
    code, out, err = run(capsys, "compare", folder / "rig.toml", "--out", folder / "other", *arguments)
    assert (code, out) == (2, "")
    assert says in err
    assert "Traceback" not in err


@pytest.mark.broad
def test_one_recording_cannot_be_left_out(capsys, folder):
    text = PROJECT[: PROJECT.index('[[recording]]\nname = "low"')] + '[fit]\ninitial_state = "held"\n'
    (folder / "rig.toml").write_text(text, encoding="utf-8")
    code, _, err = run(capsys, "compare", folder / "rig.toml", "--out", folder / "other", "--leave-one-out")
    assert code == 2
    assert "takes two at least" in err


def test_a_folder_of_somebody_else_is_refused(capsys, folder):
    (folder / "other").mkdir()
    (folder / "other" / "thesis.tex").write_text("", encoding="utf-8")
    code, _, err = run(capsys, "compare", folder / "rig.toml", "--out", folder / "other")
    assert code == 2
    assert "holds files that are not a run's" in err


def test_a_fit_is_not_cleared_away(capsys, folder):
    (folder / "run" / "result.json").write_text("{}", encoding="utf-8")
    code, _, err = run(capsys, "compare", folder / "rig.toml", "--out", folder / "run", *QUICK)
    assert code == 2
    assert "holds a fit; give fracid compare a folder of its own" in err
    assert (folder / "run" / "result.json").exists()


# --- a real rig -------------------------------------------------------------------------------------------------

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """A function that compares the structures on the recordings of a real SRV02 by the command line."""
    folder = tmp_path_factory.mktemp("real")
    text = (ROOT / "examples" / "real" / "srv02-compare.toml").read_text(encoding="utf-8")
    (folder / "srv02.toml").write_text(from_there(text), encoding="utf-8")

    def compared(name, *options):
        with pytest.raises(SystemExit) as stop:
            main(["compare", str(folder / "srv02.toml"), "--out", str(folder / name), "--json", *options])
        assert not stop.value.code
        return json.loads((folder / name / "compare.json").read_text(encoding="utf-8"))

    return compared


@needs()
@pytest.mark.slow
def test_a_real_rig_needs_dry_friction_and_cable_and_no_orders_and_the_numbers_repeat(real, capsys):
    sliding = [word for rung in ("viscous", "Coulomb", "drag", "cable") for word in ("--rung", rung)]
    record = real("one", "--jobs", "2", "--amplitude", *sliding)
    assert len(record["structures"]) == 8
    by_name = {s["name"]: s for s in record["structures"]}
    plain, paper, dry, ladder, free = (
        by_name[f"viscous{more}"] for more in (", orders 1", ", orders free", " + Coulomb, orders 1",
                                               " + Coulomb + drag + cable, orders 1",
                                               " + Coulomb + drag + cable, orders free")
    )  # fmt: skip
    fitted, low = ({s["name"]: np.degrees([*s[use][name]["rmse"].values()]) for s in record["structures"]}
                   for use, name in (("in_sample", "release 92°"), ("held_out", "release 16°")))  # fmt: skip
    assert fitted[ladder["name"]].max() < 0.24  # a good ladder
    assert low[ladder["name"]].max() < 0.2
    assert low[paper["name"]].max() > 5 * low[dry["name"]].max()  # the paper's structure
    assert low[plain["name"]].max() > low[paper["name"]].max()
    assert ladder["bic_above_best"] < free["bic_above_best"] + 10  # two more unknowns that explain next to nothing
    for order in free["orders"].values():
        assert order["interval95"][0] <= 1 <= order["interval95"][1]
    assert "The paper's structure" in record["verdict"]
    assert record["amplitude"]["viscous, orders free"]["friction_in_disguise"]
    again = real("two", "--jobs", "1", "--amplitude", *sliding)
    assert again == record
