"""``fracid regress``: of a project and of a recording, as a table and as JSON; what it knows, what it refuses."""

import json
import sys

import jsonschema
import numpy as np
import pytest

import fracid
from fracid.cli.app import main
from fracid.regression import LUMPED
from fracid.runs.json_schemas import json_schema
from fracid.validation.unknown_past import whole_recordings
from twins import write_release

RIG = fracid.rotary_pendulum("srv02-rotpen", b_theta=1e-2, b_alpha=3e-4, coulomb_theta=4e-3, coulomb_alpha=2.5e-4)
TRUE = {n: RIG.parameter(n).value for n in LUMPED}
COUNT = 2 * np.pi / 4096
GIVEN = ["--order", "lambda=0.95", "--order", "mu=0.97"]

FREE = """
[model]
rig = "srv02-rotpen"
[model.parameters]
b_theta = 1e-2
b_alpha = 3e-4
coulomb_theta = 4e-3
coulomb_alpha = 2.5e-4
C1 = { start = 8e-3, lower = 1e-3, upper = 1e-1 }
J_theta = { start = 3e-3, lower = 1e-4, upper = 1e-1 }
"""
SWING = """
[[recording]]
file = "swing.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A release from 60° at 1 kHz after a plateau of 0.8 s, 4096 counts, as a file and in projects."""
    folder = tmp_path_factory.mktemp("regress")
    orders = {"lambda": 0.95, "mu": 0.97}
    write_release(folder / "swing.csv", RIG, orders=orders, alpha=np.radians(60), step=1e-3, finer=5, end=4.0,
                  plateau=0.8, counts=True)  # fmt: skip
    texts = {
        "rig": FREE + SWING,
        "moving": FREE + SWING + "from = 1.45\n",
        "orders": '[model]\nrig = "srv02-rotpen"\n' + SWING,
        "tied": FREE + 'C3 = "C1"\n' + SWING,
        "alone": FREE + SWING + '[fit]\noutputs = ["alpha"]\n',
        "two": FREE + SWING + 'name = "one"\n' + SWING + 'name = "two"\n',
    }
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    return folder


def run(capsys, *arguments):
    """Return exit code, standard output and standard error of the program."""
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in ("regress", *arguments)])
    out, err = capsys.readouterr()
    return stop.value.code or 0, out, err


def record(capsys, *arguments):
    code, out, err = run(capsys, *arguments, "--json")
    assert (code, err) == (0, "")
    return json.loads(out)


# --- what it gives -----------------------------------------------------------------------------------------


def test_a_projects_free_constants_are_found_and_given_as_a_start_and_nothing_is_written(capsys, folder, monkeypatch):
    monkeypatch.chdir(folder)
    files = set(folder.rglob("*"))
    code, out, err = run(capsys, "rig.toml", *GIVEN)
    assert (code, err) == (0, "")
    for name in ("C1", "J_theta"):
        (row,) = [line for line in out.splitlines() if line.startswith(name + " ")]
        assert "kg m^2" in row
        assert row.split()[-1] == "identified"
        assert float(row.split()[1]) == pytest.approx(TRUE[name], rel=0.02)
    assert "orders    lambda = 0.95 (given), mu = 0.97 (given)" in out
    (start,) = [line for line in out.splitlines() if line.lstrip().startswith("start ")]
    assert "C1 = 0.00" in start
    assert "(from 0.008)" in start
    assert "α swings by" in out
    assert "In simulated releases of this size at given orders the inertias were within 1 %" in out
    assert set(folder.rglob("*")) == files


def test_json_holds_the_same_and_out_writes_it(capsys, folder, tmp_path):
    found = record(capsys, folder / "rig.toml", *GIVEN, "--out", tmp_path / "new")
    assert found == json.loads((tmp_path / "new" / "regression.json").read_text(encoding="utf-8"))
    jsonschema.validate(found, json.loads(json_schema("regression.json")))
    c = found["parameters"]["C1"]
    assert set(c) == {"value", "unit", "standard_error", "interval95", "bias", "kind", "verdict"}
    assert c["interval95"][1] - c["interval95"][0] == pytest.approx(3.92 * c["standard_error"], rel=1e-3)
    orders = {"lambda": 0.95, "mu": 0.97}  # those that the constants belong to
    assert found["start"] == orders | {n: found["parameters"][n]["value"] for n in ("C1", "J_theta")}
    assert found["data_sha256"]["swing"]
    assert found["orders"]["mu"] == {"value": 0.97, "interval95": None}
    assert found["amplitude"] == pytest.approx(np.radians(60), rel=0.15)


@pytest.mark.broad
def test_an_order_that_is_not_given_is_searched_and_becomes_a_start(capsys, folder):
    found = record(capsys, folder / "rig.toml", "--order", "lambda=0.95")
    low, high = found["orders"]["mu"]["interval95"]
    assert low < 0.97 < high
    assert found["start"]["mu"] == found["orders"]["mu"]["value"]
    assert found["start"]["lambda"] == 0.95


def test_a_recording_needs_its_columns_and_one_known_constant(capsys, folder):
    swing = [folder / "swing.csv", "--column", "theta=theta", "--column", "alpha=alpha", "--rig", "srv02-rotpen"]
    code, out, err = run(capsys, *swing, *GIVEN, "--known", "C4=0.1944", "--from", "release", "--to", "4")
    assert (code, err) == (0, "")
    for name in LUMPED:
        assert name in out
    assert "  start " not in out
    assert "is taken from the rig" not in out
    found = record(capsys, *swing, *GIVEN)
    assert found["parameters"]["C4"]["verdict"] == "known"
    (note,) = found["notes"]
    assert note.startswith("C4 = 0.1944 N m is taken from the rig: one constant must be known")
    assert note.endswith("type --known C4=VALUE.")


@pytest.mark.few(1)
@pytest.mark.parametrize("estimator", ["tls", "huber", "tukey", "ols"])
def test_the_estimator_is_the_one_asked_for(capsys, folder, estimator):
    found = record(capsys, folder / "rig.toml", *GIVEN, "--estimator", estimator)
    assert found["estimator"] == estimator


@pytest.mark.broad
def test_terms_take_the_place_of_what_is_free_and_a_known_constant_scales_all(capsys, folder):
    terms = [word for n in LUMPED if n != "J_theta" for word in ("--term", n)]
    one, two = (
        record(capsys, folder / "rig.toml", *GIVEN, *terms, "--known", f"J_theta={J}")["parameters"]
        for J in (0.01, 0.02)
    )
    assert list(one) == list(LUMPED)
    assert two["C1"]["value"] == pytest.approx(2 * one["C1"]["value"], rel=0.02)


def test_where_a_project_frees_no_constant_the_nine_are_looked_for(capsys, folder):
    found = record(capsys, folder / "orders.toml", *GIVEN)
    assert list(found["parameters"]) == list(LUMPED)
    assert "is taken from the project" in found["notes"][0]


@pytest.mark.broad
def test_a_start_in_motion_is_not_searched_for_orders_and_the_release_mends_it(capsys, folder):
    moving = record(capsys, folder / "moving.toml")
    assert moving["notes"][-1].startswith("swing: starts in motion, so lambda and mu are not searched. Type --from rel")
    assert moving["orders"]["mu"] == {"value": 1.0, "interval95": None}
    released = record(capsys, folder / "moving.toml", *GIVEN, "--from", "release")
    assert released["notes"] == []
    assert released["parameters"]["C1"]["value"] == pytest.approx(TRUE["C1"], rel=0.02)
    (whole,) = whole_recordings(fracid.load_project(folder / "moving.toml"))
    assert whole.time[0] == 0.0


@pytest.mark.broad
def test_an_arm_that_is_not_scored_is_left_out(capsys, folder):
    code, out, _ = run(capsys, folder / "alone.toml", *GIVEN, "--json")
    found = json.loads(out)
    assert code == 3  # for this arm moves
    assert set(found["parameters"]) == {"C1", "C4", "b_alpha", "coulomb_alpha"}
    assert any("its arm is taken as clamped" in w for w in found["warnings"])


def test_ties_are_let_go_and_it_says_so(capsys, folder):
    found = record(capsys, folder / "tied.toml", *GIVEN)
    assert found["notes"] == ["C3: tied in the project, estimated separately here: the regression ignores ties."]
    assert found["parameters"]["C3"]["value"] == pytest.approx(TRUE["C3"], rel=0.03)


@pytest.mark.broad
def test_several_recordings_are_taken_together_or_each_by_itself(capsys, folder):
    both = record(capsys, folder / "two.toml", *GIVEN)
    each = record(capsys, folder / "two.toml", *GIVEN, "--each")
    assert set(each["recordings"]) == {"one", "two"}
    assert both["samples"] == 2 * each["recordings"]["one"]["samples"]
    code, out, _ = run(capsys, folder / "two.toml", *GIVEN, "--each")
    assert code == 0
    assert [line.split(":")[0] for line in out.splitlines() if line.endswith(" rows")] == ["one", "two"]


def test_what_cannot_be_believed_is_said_below_the_table_and_ends_with_3(capsys, folder, tmp_path):
    small = np.loadtxt(folder / "swing.csv", delimiter=",", skiprows=1)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((len(small), 2))
    small[:, 1:] = 0.15 * small[:, 1:] + noise
    np.savetxt(tmp_path / "swing.csv", small, delimiter=",", header="time,theta,alpha", comments="")
    (tmp_path / "rig.toml").write_text(FREE + SWING, encoding="utf-8")
    code, out, err = run(capsys, tmp_path / "rig.toml", *GIVEN)
    assert (code, err) == (3, "")
    rows = [line for line in out.splitlines() if line.startswith(("C1 ", "J_theta "))]
    assert len(rows) == 2
    assert not any(row.split()[-1] == "identified" for row in rows)
    (start,) = [line for line in out.splitlines() if line.lstrip().startswith("start ")]
    assert "C1" not in start
    assert "times theirs: expect more" in out


def test_help_names_the_estimators(capsys):
    code, out, _ = run(capsys, "--help")
    assert code == 0
    assert "tukey" in out


# --- what it refuses -----------------------------------------------------------------------------------------


@pytest.mark.few(4)
@pytest.mark.parametrize(("options", "words"), [
    (["--known", "C4"], "--known 'C4' is not possible; expected NAME=VALUE: --known C4=0.1944"),
    (["--known", "C44=1"], "unknown constant 'C44'"),
    (["--order", "mu=one"], "--order 'one' is not possible; expected numbers with commas: --order mu=1.0"),
    (["--order", "my=1"], "unknown order 'my'; the known ones are lambda, mu"),
    (["--term", "friction"], "unknown constant 'friction'"),
    (["--rig", "qube-servo2"], "--rig is for a recording; the project file says it of each of its own"),
    (["--cutoff", "0.1"], "cutoff = 0.1 Hz; expected between"),
    (["--from", "soon"], "--from 'soon' is not possible; expected a time [s] or release"),
])  # fmt: skip
def test_a_callers_mistake_is_told_and_ends_with_2(capsys, folder, options, words):
    code, out, err = run(capsys, folder / "rig.toml", *options)
    assert (code, out) == (2, "")
    assert words in err


def test_a_recording_whose_angle_is_not_named_is_told_what_to_type(capsys, folder):
    code, _, err = run(capsys, folder / "swing.csv")
    assert code == 2
    assert "Type --column alpha=2,unit=deg and --column theta=1; fracid check" in err


def test_a_folder_that_cannot_be_written_is_told(capsys, folder):
    code, _, err = run(capsys, folder / "rig.toml", *GIVEN, "--out", folder / "swing.csv")
    assert code == 2
    assert "cannot be written" in err


def test_the_module_of_the_command_is_light():
    import subprocess

    code = "import sys, fracid.cli.regression; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
