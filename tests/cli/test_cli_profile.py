"""``fracid profile``: of a run folder and of a project, as a table, JSON and a figure; exit codes, no traceback."""

import json
import shutil

import jsonschema
import numpy as np
import pytest

from fracid.runs.json_schemas import json_schema
from memos import Counting
from program import fit_in, run
from twins import write_release

pytestmark = pytest.mark.usefixtures("without_rivals")

PROJECT = """
[model.parameters]
b_alpha = { start = 2e-4, lower = 0.0, upper = 1e-2 }
[[recording]]
name = "release 20°"
file = "swing.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
initial = { theta = 0.0, alpha = 0.35 }
[fit]
initial_state = "held"
"""


def write_twin(file, seed=1):
    write_release(file, alpha=0.35, step=5e-3, end=2.0, noise=1e-3, seed=seed)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A project with a twin of 2 s, and its run."""
    folder = tmp_path_factory.mktemp("profile")
    write_twin(folder / "swing.csv")
    fit_in(folder, PROJECT)
    return folder


# --- what it gives ----------------------------------------------------------------------------------------


@pytest.mark.broad
def test_a_run_is_profiled_into_its_own_folder_with_a_table_and_a_figure(capsys, folder):
    code, out, err = run(capsys, "profile", folder / "run")
    assert (code, err) == (0, "")
    assert "The 95 % intervals of λ and μ are closed." in out
    for line in ("lambda", "mu"):
        (row,) = [text for text in out.splitlines() if text.startswith(line + " ")]
        assert row.count("±") == 3
        assert "sandwich ±" in row
    assert "profiles.json" in out
    record = json.loads((folder / "run" / "profiles.json").read_text(encoding="utf-8"))
    assert list(record["profiles"]) == ["lambda", "mu"]
    fitted = json.loads((folder / "run" / "result.json").read_text(encoding="utf-8"))
    for name, p in record["profiles"].items():
        assert p["value"] == pytest.approx(fitted["orders"][name]["value"], abs=1e-6)
        assert p["interval95"] == pytest.approx(fitted["orders"][name]["interval95"], abs=2e-5)
    assert (folder / "run" / "figures" / "profiles.png").read_bytes().startswith(b"\x89PNG")


def test_every_interval_says_its_method_and_every_unknown_its_verdict(capsys, folder, tmp_path):
    code, out, err = run(capsys, "profile", folder / "run", "--parameter", "mu", "--json", "--out", tmp_path)
    assert code == 0
    events = [json.loads(line) for line in err.splitlines()]
    assert [e["what"] for e in events if e["event"] == "progress"][-1:] == ["points"]
    stages = [e["name"] for e in events if e["event"] == "stage"]
    assert stages == ["run", "profiles", "intervals", "bootstrap", "identifiability", "figures"]
    record = json.loads(out)
    assert record == json.loads((tmp_path / "profiles.json").read_text(encoding="utf-8"))
    jsonschema.validate(record, json.loads(json_schema("profiles.json")))
    assert record["profiles"]["mu"]["method"].startswith("profile likelihood")
    rows = record["intervals"]["free_parameters"]
    assert rows == record["intervals"]["unknowns"]  # until the version after this one
    assert set(rows["mu"]) == {"sandwich", "white", "bootstrap", "profile", "effective_samples"}
    assert set(rows["b_alpha"]) == {"sandwich", "white", "bootstrap", "effective_samples"}
    widths = [np.ptp(rows["mu"][method]) for method in ("sandwich", "white", "bootstrap", "profile")]
    assert max(widths) < 2 * min(widths)
    assert set(record["intervals"]["methods"]) == {"sandwich", "white", "bootstrap", "profile"}
    assert {v["sentence"] for v in record["identifiability"].values()} == {"identifiable"}
    assert record["spread"] is None
    assert record["bootstrap"]["method"].endswith("one-step")


@pytest.mark.broad
def test_a_project_is_fitted_first_and_two_unknowns_are_profiled_together(capsys, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = ["--parameter", "mu", "--parameter", "b_alpha", "--joint", "mu, b_alpha", "--points", 5]
    code, out, _ = run(capsys, "profile", folder / "rig.toml", *options)
    assert code == 0
    assert "b_alpha" in out
    record = json.loads((tmp_path / "runs" / "rig-profile" / "profiles.json").read_text(encoding="utf-8"))
    assert record["joint"]["names"] == ["mu", "b_alpha"]
    assert np.shape(record["joint"]["rise"]) == (5, 5)


@pytest.mark.broad
def test_several_recordings_are_fitted_alone_too_and_a_disagreement_is_said(capsys, folder, tmp_path):
    write_twin(tmp_path / "swing.csv")
    table = np.loadtxt(tmp_path / "swing.csv", delimiter=",", skiprows=1)
    table[:, 0] *= 1.02  # a clock that is 2 % slow
    np.savetxt(tmp_path / "slow.csv", table, delimiter=",", header="time,theta,alpha", comments="")
    head, recording, fit = (
        PROJECT.partition("[[recording]]")[0],
        PROJECT.split("[[recording]]")[1].split("[fit]")[0],
        "[fit]\n",
    )
    second = recording.replace("release 20°", "slow").replace("swing.csv", "slow.csv")
    text = head + "[[recording]]" + recording + "[[recording]]" + second + fit + 'initial_state = "held"\n'
    (tmp_path / "two.toml").write_text(text, encoding="utf-8")
    code, out, _ = run(capsys, "profile", tmp_path / "two.toml", "--parameter", "mu", "--points", 5, "--out", tmp_path)
    assert code == 0
    assert "mu differs from recording to recording by" in out
    record = json.loads((tmp_path / "profiles.json").read_text(encoding="utf-8"))
    assert record["spread"]["recordings"] == ["release 20°", "slow"]


@pytest.mark.broad
def test_a_run_with_an_output_that_is_measured_now_and_then_is_profiled_without_a_bootstrap(capsys, folder, tmp_path):
    table = np.loadtxt(folder / "swing.csv", delimiter=",", skiprows=1)
    table[np.arange(len(table)) % 10 > 0, 1] = np.nan
    np.savetxt(tmp_path / "swing.csv", table, delimiter=",", header="time,theta,alpha", comments="")
    (tmp_path / "rig.toml").write_text(PROJECT, encoding="utf-8")
    code, _, _ = run(capsys, "profile", tmp_path / "rig.toml", "--parameter", "mu", "--points", 4, "--out", tmp_path)
    record = json.loads((tmp_path / "profiles.json").read_text(encoding="utf-8"))
    assert (code, "measured less often" in record["bootstrap"]) == (0, True)


@pytest.mark.broad
def test_what_cannot_be_told_is_said_below_the_table(capsys, folder, tmp_path):
    write_twin(tmp_path / "swing.csv")
    (tmp_path / "arm.toml").write_text('[model]\nrig = "stepper-freeswing"\n' + PROJECT, encoding="utf-8")
    code, out, _ = run(
        capsys, "profile", tmp_path / "arm.toml", "--parameter", "lambda", "--points", 4, "--out", tmp_path
    )
    assert code == 0
    assert "θ hardly moves" in out
    assert "Without a closed 95 % interval: λ" in out


@pytest.mark.broad
def test_profiles_json_is_the_same_for_any_jobs(capsys, folder, tmp_path):
    found = []
    for jobs in (1, 3):
        run(capsys, "profile", folder / "run", "--points", 4, "--jobs", jobs, "--out", tmp_path / str(jobs))
        found.append((tmp_path / str(jobs) / "profiles.json").read_bytes())
    assert found[0] == found[1]


# --- what it refuses ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("options", "words"), [
    (["--parameter", "b_alpa"], "unknown name 'b_alpa': did you mean b_alpha"),
    (["--parameter", "b_theta"], "b_theta is not free, so it has no profile"),
    (["--joint", "mu"], "--joint 'mu' is not possible; expected two names, e.g. --joint mu,b_alpha"),
    (["--points", "2"], "points = 2; expected a whole number, 4 or more"),
])  # fmt: skip
def test_a_callers_mistake_is_told_and_ends_with_2(capsys, folder, options, words):
    code, out, err = run(capsys, "profile", folder / "run", *options)
    assert (code, out) == (2, "")
    assert words in err


def test_a_folder_that_is_no_run_is_told(capsys, tmp_path):
    code, _, err = run(capsys, "profile", tmp_path)
    assert code == 2
    assert "is no run folder: it has no result.json" in err


def test_a_run_whose_recording_has_changed_is_told(capsys, folder, tmp_path):
    shutil.copytree(folder, tmp_path / "all")
    write_twin(tmp_path / "all" / "swing.csv", seed=2)
    code, _, err = run(capsys, "profile", tmp_path / "all" / "run")
    assert code == 2
    assert "The recording 'release 20°' is not the one that" in err


def test_a_model_that_never_reaches_the_end_ends_with_3(capsys, folder, tmp_path):
    write_twin(tmp_path / "swing.csv")
    (tmp_path / "bad.toml").write_text(
        PROJECT.replace("[model.parameters]", "[model.parameters]\nC3 = 0.1"), encoding="utf-8"
    )
    code, _, err = run(capsys, "profile", tmp_path / "bad.toml", "--out", tmp_path)
    assert code == 3
    assert "det M = 0" in err


@pytest.mark.broad
def test_a_profile_that_was_killed_goes_on_by_the_same_command_and_ends_the_same(capsys, folder, tmp_path, monkeypatch):
    words = ("profile", folder / "run", "--points", "4", "--out")
    assert run(capsys, *words, tmp_path / "whole")[0] == 0

    def killed(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as before_the_end:
        before_the_end.setattr("fracid.workflows.profiles.bootstrap", killed)
        assert run(capsys, *words, tmp_path / "again")[0] != 0
    assert not (tmp_path / "again" / "profiles.json").exists()
    counts = []

    class Told(Counting):
        def remove(self):
            counts.append((self.computed, len(self._places)))
            super().remove()

    monkeypatch.setattr("fracid.workflows.profiles.Memo", Told)
    assert run(capsys, *words, tmp_path / "again")[0] == 0
    ((computed, kept),) = counts
    assert computed < 0.5 * kept
    for name in ("whole", "again"):
        assert not (tmp_path / name / ".memo").exists()
    assert (tmp_path / "again" / "profiles.json").read_bytes() == (tmp_path / "whole" / "profiles.json").read_bytes()
