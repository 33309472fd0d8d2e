"""``fracid resid``: of a run folder, as sentences, JSON and figures; exit codes, no traceback."""

import json
import shutil
import sys
from pathlib import Path

import jsonschema
import pytest
from matplotlib.figure import Figure

from fracid.cli.app import main
from fracid.runs.json_schemas import json_schema
from fracid.validation.residual_analyses import first_part
from program import fit_in, leave_figures_out
from recordings import from_there, needs
from twins import RIG, write_release

pytestmark = pytest.mark.usefixtures("without_rivals")

PROJECT = """
[model.orders]
lambda = 1.0
mu = { start = 1.0, lower = 0.6, upper = 1.2 }
[[recording]]
name = "release 20°"
file = "swing.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
initial = { theta = 0.0, alpha = 0.35 }
[[recording]]
name = "again"
file = "again.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
initial = { theta = 0.0, alpha = 0.35 }
use = "validate"
[fit]
initial_state = "held"
substeps = 1  # as the twins are made
"""


def write_twin(file, seed, **friction):
    """A pendulum with dry friction that the model of the project may lack."""
    write_release(file, RIG.with_parameters(**friction), orders={"lambda": 1.0, "mu": 1.0}, alpha=0.35, step=5e-3,
                  end=4.0, noise=1e-3, seed=seed)  # fmt: skip


def fitted(folder, *, lacking):
    """A project, and its run as `fracid fit` leaves it; lacking: the twins have friction that the model has not."""
    dry = {"coulomb_alpha": 5e-4} if lacking else {}
    write_twin(folder / "swing.csv", 1, **dry)
    write_twin(folder / "again.csv", 2, **dry)
    fit_in(folder, PROJECT)
    return folder


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return fitted(tmp_path_factory.mktemp("good"), lacking=False)


@pytest.fixture(scope="module")
def lacking(tmp_path_factory):
    return fitted(tmp_path_factory.mktemp("lacking"), lacking=True)


@pytest.fixture
def undrawn(monkeypatch):
    """Figures take a second each."""
    monkeypatch.setattr("fracid.plots.save", lambda *_: ())


def run(capsys, *arguments):
    """Return exit code, standard output with single blanks, and standard error of the program."""
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return stop.value.code or 0, " ".join(out.split()), err


# --- what it gives ----------------------------------------------------------------------------------------


def test_of_a_right_model_noise_is_left_of_every_recording_and_output(capsys, good, undrawn):
    code, out, err = run(capsys, "resid", good / "run")
    assert (code, err) == (0, "")
    for heading in (
        "release 20°, theta",
        "release 20°, alpha",
        "again, theta (held out)",
        "again, alpha (held out)",
    ):
        assert heading in out
    for question in ("whiteness", "spectrum", "normality", "variance", "level"):
        assert out.count(f" {question} ") == 4
    record = json.loads((good / "run" / "residuals.json").read_text(encoding="utf-8"))
    for name, outputs in record["recordings"].items():
        for output, found in outputs.items():
            assert found["whiteness"]["white"], (name, output)
            assert found["normality"]["ppcc"] > 0.985


@pytest.mark.broad
def test_the_figures_go_into_the_folder(capsys, good, tmp_path):
    code, out, _ = run(
        capsys, "resid", good / "run", "--recording", "release 20°", "--output", "alpha", "--out", tmp_path
    )
    assert code == 0
    assert "residuals-release-20-alpha" in "".join(out.split())
    assert (tmp_path / "figures" / "residuals-release-20-alpha.svg").read_bytes().startswith(b"<?xml")
    assert (tmp_path / "figures" / "residuals-release-20-alpha.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.broad
def test_a_choice_that_replaces_the_analyses_of_all_says_so(capsys, good, tmp_path, undrawn):
    for options, replaced in (((), False), (("--output", "alpha"), True), ((), False)):
        code, _, err = run(capsys, "resid", good / "run", *options, "--out", tmp_path)
        assert code == 0
        assert ("residuals.json is replaced: it has what was chosen alone." in " ".join(err.split())) == replaced


@pytest.mark.broad
def test_of_a_model_without_friction_the_swing_is_left(capsys, lacking, tmp_path, undrawn):
    code, out, _ = run(capsys, "resid", lacking / "run", "--output", "alpha", "--out", tmp_path)
    assert code == 0
    assert "the model lacks something" in out
    record = json.loads((tmp_path / "residuals.json").read_text(encoding="utf-8"))
    for found in record["recordings"].values():
        assert list(found) == ["alpha"]
        assert not found["alpha"]["whiteness"]["white"]
        assert found["alpha"]["spectrum"]["line"]["harmonic"] == 1
        assert found["alpha"]["whiteness"]["effective_samples"] < 0.1 * found["alpha"]["samples"]


def test_of_a_very_long_recording_the_first_part_is_tested_and_drawn(capsys, good, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr("fracid.workflows.residuals.first_part", lambda r: first_part(r, 500))
    monkeypatch.setattr("fracid.plots.residual_diagnostics", lambda r, *_, **__: drawn.append(r.time.size) or Figure())
    with pytest.raises(SystemExit):
        main(["resid", str(good / "run"), "--recording", "again", "--out", str(tmp_path)])
    told = capsys.readouterr()
    assert "again has 801 samples: the first 500 are tested and drawn." in told.out + told.err
    assert "release 20° has" not in told.out + told.err
    assert drawn == [500, 500]


@pytest.mark.broad
def test_json_is_what_the_file_holds_and_nothing_else(capsys, good, tmp_path, undrawn):
    with pytest.raises(SystemExit):
        main(["resid", str(good / "run"), "--recording", "again", "--json", "--out", str(tmp_path)])
    out, err = capsys.readouterr()
    assert [json.loads(line)["name"] for line in err.splitlines()] == ["run", "tests of the residuals", "figures"]
    assert out == (tmp_path / "residuals.json").read_text(encoding="utf-8")
    record = json.loads(out)
    jsonschema.validate(record, json.loads(json_schema("residuals.json")))
    assert list(record["recordings"]) == ["again"]
    assert list(record["recordings"]["again"]) == ["theta", "alpha"]
    assert record["recordings"]["again"]["theta"]["use"] == "validate"
    assert record["notes"] == []


@pytest.mark.broad
def test_values_that_do_not_give_the_saved_rmse_are_told(capsys, good, tmp_path, undrawn):
    shutil.copytree(good, tmp_path / "copy")
    path = tmp_path / "copy" / "run" / "result.json"
    result = json.loads(path.read_text(encoding="utf-8"))
    result["orders"]["mu"]["value"] += 0.05
    path.write_text(json.dumps(result), encoding="utf-8")
    code, out, _ = run(capsys, "resid", tmp_path / "copy" / "run", "--recording", "again")
    assert code == 0
    assert "! again: simulated again with the saved values, the RMSE of alpha is" in out


# --- what it refuses ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("options", "words"), [
    (["--output", "alfa"], "unknown output of"),
    (["--output", "alfa"], "did you mean alpha"),
    (["--recording", "release"], "unknown recording of"),
])  # fmt: skip
def test_a_callers_mistake_is_told_and_ends_with_2(capsys, good, options, words):
    code, out, err = run(capsys, "resid", good / "run", *options)
    assert (code, out) == (2, "")
    assert words in err


def test_a_folder_or_file_that_is_no_run_is_told(capsys, good, tmp_path):
    said = {
        tmp_path: "is no run folder: it has no result.json",
        tmp_path / "nowhere": "There is no",
        good / "rig.toml": "rig.toml is a project, not the folder of a run. Fit it first: fracid fit",
    }
    for path, sentence in said.items():
        code, _, err = run(capsys, "resid", path)
        assert code == 2
        assert sentence in err


def test_a_run_whose_recording_has_changed_is_told(capsys, good, tmp_path):
    shutil.copytree(good, tmp_path / "copy")
    write_twin(tmp_path / "copy" / "swing.csv", 3)
    code, _, err = run(capsys, "resid", tmp_path / "copy" / "run")
    assert code == 2
    assert "The recording 'release 20°' is not the one that" in err


def test_a_folder_that_cannot_be_written_is_told(capsys, good, tmp_path):
    (tmp_path / "file").write_text("")
    code, out, err = run(capsys, "resid", good / "run", "--out", tmp_path / "file")
    assert (code, out) == (2, "")
    assert "cannot be written" in err


def test_a_run_that_never_reached_the_end_ends_with_3(capsys, good, tmp_path, undrawn):
    shutil.copytree(good, tmp_path / "copy")
    bad = PROJECT.replace("[model.orders]", "[model.parameters]\nC3 = 0.1\n[model.orders]")
    for path in (tmp_path / "copy" / "rig.toml", tmp_path / "copy" / "run" / "project.toml"):
        path.write_text(bad, encoding="utf-8")
    code, out, err = run(capsys, "resid", tmp_path / "copy" / "run", "--output", "alpha")
    assert code == 3
    assert "No run of the model reached the end of release 20° or again: there is no residual." in err
    assert "There is no residual: the simulation failed" in out


# --- a real rig --------------------------------------------------------------------------------------------

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@needs()
def test_what_the_page_says_of_a_real_rig_is_what_is_found(capsys, tmp_path, monkeypatch):
    text = (ROOT / "examples" / "srv02-release.toml").read_text(encoding="utf-8")
    (tmp_path / "srv02.toml").write_text(from_there(text), encoding="utf-8")
    leave_figures_out(monkeypatch)
    monkeypatch.setattr("fracid.plots.save", lambda *_: ())
    monkeypatch.setattr(sys, "argv", ["fracid", "fit", "srv02.toml"])
    run(capsys, "fit", tmp_path / "srv02.toml", "--out", tmp_path / "run", "--json")
    code, _, _ = run(capsys, "resid", tmp_path / "run", "--recording", "release 92°", "--output", "alpha")
    assert code == 0
    record = json.loads((tmp_path / "run" / "residuals.json").read_text(encoding="utf-8"))
    found = record["recordings"]["release 92°"]["alpha"]
    page = (ROOT / "docs" / "residuals.md").read_text(encoding="utf-8")
    for question in ("whiteness", "spectrum", "normality", "variance", "level"):
        assert f"| {question} | {found[question]['sentence']} |" in page
