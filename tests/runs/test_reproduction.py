"""A run done again gives the same result to the last bit, and what does not is told, what was found first."""

import copy
import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import fracid
from fracid.cli import main
from fracid.errors import InputError
from fracid.problem import problem as of_problem
from fracid.runs import environment
from fracid.runs.reproduction import ELSEWHERE, compared
from program import RELEASE, fit_in, run

pytestmark = pytest.mark.usefixtures("without_rivals")


def edited(path, change):
    """A JSON file with something changed."""
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    path.write_text(json.dumps(content), encoding="utf-8")


def moved(by):
    """A result whose order is off by that part of itself."""

    def move(result):
        result["orders"]["mu"]["value"] *= 1 + by

    return move


def older(result):
    """Of another version of NumPy."""
    result["inputs"]["the version of numpy"] = "1.0"


@pytest.fixture(scope="module")
def kept():
    return []


@pytest.fixture
def done_once(kept, monkeypatch):
    """Have the fit of `plain` done again once for all that ask what is said of it."""
    identify = fracid.identify

    def again(*given, **options):
        kept[:] = kept or [identify(*given, **options)]
        return kept[0]

    monkeypatch.setattr("fracid.identification.identify", again)


# --- doing it again ----------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize("jobs", [1, 2, 8])
def test_done_again_it_is_the_same_to_the_bit_for_any_number_of_threads(plain, jobs):
    found = fracid.reproduce(plain / "run", jobs=jobs)
    assert found.differences == ()
    assert (found.identical, found.reproduced, found.changed) == (True, True, {})
    assert found.values > 100
    assert found.verdict == f"Identical: all {found.values} values are the same to the last bit."


@pytest.mark.few(1)
def test_a_fit_whose_runs_go_together_or_alone_as_they_come_is_the_same_to_the_bit(sent, monkeypatch):
    monkeypatch.setattr(of_problem, "WORTH", 100)
    shutil.rmtree(sent)
    fit_in(Path(), RELEASE)
    assert fracid.reproduce(sent).differences == ()


@pytest.mark.broad
def test_the_command_says_so_and_writes_nothing_into_the_run(capsys, sent):
    before = {path: path.read_bytes() for path in sent.rglob("*") if path.is_file()}
    code, out, err = run(capsys, "reproduce", sent, "--out", "again")
    assert (code, err) == (0, "")
    assert "values are the same to the last bit" in out
    assert {path: path.read_bytes() for path in sent.rglob("*") if path.is_file()} == before
    again, result = (json.loads(path.read_text()) for path in (Path("again/result.json"), sent / "result.json"))
    assert again["orders"] == result["orders"]


@pytest.mark.usefixtures("done_once")
@pytest.mark.few(1)
@pytest.mark.parametrize("by", [1e-15, 1e-12, 1e-3])
def test_on_the_same_machine_a_last_bit_is_a_difference(capsys, sent, by):
    edited(sent / "result.json", moved(by))
    code, out, _ = run(capsys, "reproduce", sent)
    assert code == 1
    assert "orders.mu.value" in out
    assert "Not reproduced: 1 of" in out
    assert "That is a fault of fracid" in out


@pytest.mark.usefixtures("done_once")
@pytest.mark.few(1)
@pytest.mark.parametrize(("by", "code"), [(1e-12, 0), (0.9 * ELSEWHERE, 0), (1.2 * ELSEWHERE, 1), (1e-3, 1)])
def test_with_other_versions_what_was_found_may_be_off_by_so_much(capsys, sent, by, code):
    edited(sent / "result.json", moved(by))
    edited(sent / "run.json", older)
    found, out, _ = run(capsys, "reproduce", sent, "--json")
    said = json.loads(out)
    assert (found, said["reproduced"], said["identical"]) == (code, code == 0, False)
    assert said["changed"] == {"the version of numpy": ["1.0", np.__version__]}
    assert said["differences"][0]["where"] == "orders.mu.value"
    assert ("1e-09 is allowed" in said["verdict"]) == (code == 1)
    assert "The version of numpy (1.0, now" in said["verdict"]


@pytest.mark.usefixtures("done_once")
@pytest.mark.parametrize("before", ["0" * 64, ""])
def test_with_another_source_of_the_same_version_the_code_differs_and_fracid_is_not_at_fault(sent, before):
    edited(sent / "result.json", moved(1e-3))
    edited(sent / "run.json", lambda state: state.update(code=before))
    found = fracid.reproduce(sent)
    assert not found.reproduced
    assert found.verdict.endswith("The code of fracid: not as before.")
    assert "fault of fracid" not in found.verdict


@pytest.mark.parametrize("name", ["solver/solve.py", "models/library/joint.toml"])
def test_the_hash_of_the_code_is_another_where_a_module_or_a_models_file_is(name, tmp_path, monkeypatch):
    monkeypatch.setattr(environment, "__file__", str(tmp_path / "runs" / "environment.py"))
    file = tmp_path / name
    file.parent.mkdir(parents=True)
    hashes = {environment.code.__wrapped__() for text in ("one", "two") if file.write_text(text)}
    assert len(hashes) == 2


@pytest.mark.usefixtures("done_once")
@pytest.mark.broad
def test_another_processor_is_told(sent):
    edited(sent / "environment.json", lambda said: said.update(processor="a slide rule"))
    found = fracid.reproduce(sent)
    assert found.identical
    assert "The processor (a slide rule, now " in found.verdict


def unfinished(sent):
    edited(sent / "run.json", lambda said: said.update(finished=False))


def another_recording(sent):
    lines = Path("swing.csv").read_text().splitlines()
    Path("swing.csv").write_text("\n".join(lines[:-1]))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (unfinished, "is not finished; type fracid resume"),
        (another_recording, "is not the one that"),
        (lambda sent: (sent / "result.json").unlink(), "was finished, but its result.json cannot be read"),
        (lambda sent: (sent / "run.json").unlink(), "has no run.json"),
        (lambda sent: (sent / "project.toml").write_text(RELEASE.replace("swing", "swung")), "cannot be read as"),
    ],
)
def test_what_cannot_be_done_again_is_told(capsys, sent, spoil, message):
    spoil(sent)
    code, out, err = run(capsys, "reproduce", sent)
    assert (code, out) == (2, "")
    assert message in err


# --- a study -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def studied(plain, tmp_path_factory):
    """A noise study of two repetitions, in threads."""
    folder = shutil.copytree(plain, tmp_path_factory.mktemp("studied") / "plain")
    words = ["noise", "run", "--levels", "0.1", "--counts", "0", "--seeds", "2", "--executor", "threads"]
    words += ["--out", "noise"]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(sys, "argv", ["fracid", *words])
        with pytest.raises(SystemExit) as stop:
            main(words)
    assert not stop.value.code
    return folder / "noise"


@pytest.mark.broad
@pytest.mark.parametrize("spoiled", [False, True])
def test_a_study_is_typed_again(capsys, studied, tmp_path, monkeypatch, spoiled):
    shutil.copytree(studied, tmp_path / "noise")
    monkeypatch.chdir(tmp_path)
    if spoiled:
        edited(tmp_path / "noise" / "noise.json", lambda said: said["truth"].update(mu=0.5))
    code, out, err = run(capsys, "reproduce", "noise", "--json")
    assert (code, err) == (int(spoiled), "")
    assert [d["where"] for d in json.loads(out)["differences"]] == (["truth.mu"] if spoiled else [])
    assert Path.cwd() == tmp_path


@pytest.mark.broad
def test_a_study_of_other_data_is_not_the_same(capsys, studied, tmp_path, monkeypatch):
    shutil.copytree(studied, tmp_path / "noise")
    monkeypatch.chdir(tmp_path)
    journal = tmp_path / "noise" / "journal.jsonl"
    head, *lines = journal.read_text().splitlines()
    said = json.loads(head)
    (project,) = (key for key in said["study"] if key.startswith("the project file"))
    said["study"][project] = "another"
    journal.write_text("\n".join([json.dumps(said), *lines, ""]))
    code, _, err = run(capsys, "reproduce", "noise")
    assert code == 2
    assert f"cannot be done again: {project} has changed since" in err


@pytest.mark.broad
@pytest.mark.parametrize("spoiled", [False, True])
def test_a_controller_is_designed_again(capsys, plain, tmp_path, monkeypatch, spoiled):
    shutil.copytree(plain, tmp_path / "plain")
    monkeypatch.chdir(tmp_path)
    words = ["control", "plain/run", "--limit", "10", "--draws", "2", "--seconds", "2", "--out", "loop"]
    monkeypatch.setattr(sys, "argv", ["fracid", *words])
    assert run(capsys, *words)[0] == 0
    if spoiled:
        edited(tmp_path / "loop" / "control.json", lambda said: said["worst"].update(mu=0.5))
    code, out, err = run(capsys, "reproduce", "loop", "--json")
    assert (code, err) == (int(spoiled), "")
    assert [d["where"] for d in json.loads(out)["differences"]] == (["worst.mu"] if spoiled else [])


# --- value by value ----------------------------------------------------------------------------------

RESULT = {
    "cost": {"name": "rmse", "value": 0.5},
    "orders": {"mu": {"value": 0.9, "interval95": [0.8, 1.0], "reason": ""}},
    "parameters": {"b": {"value": 1e-15, "interval95": [-1e-3, 1e-3]}},
    "recordings": {"swing": {"rmse": {"alpha": 0.1}, "samples": 9}},
    "warnings": ["one", "two"],
    "alternative": {"cost": 0.6},
    "p": 0.3,
    "versions": {"numpy": "2"},
    "timing": {"total": 1.0},
}

CHANGES = [
    ({"timing": {"total": 9.0}, "versions": {}}, [], True),
    ({"cost": {"name": "rmse", "value": 0.5 * (1 + 1e-12)}}, ["cost.value"], True),
    ({"cost": {"name": "rmse", "value": 0.5 * (1 + 1e-8)}}, ["cost.value"], False),
    ({"cost": {"name": "rmse", "value": None}}, ["cost.value"], False),
    ({"cost": {"name": "huber", "value": 0.5}}, ["cost.name"], False),
    ({"parameters": {"b": {"value": 2e-15, "interval95": [-1e-3, 1e-3]}}}, ["parameters.b.value"], True),
    ({"parameters": {"b": {"value": 2e-9, "interval95": [-1e-3, 1e-3]}}}, ["parameters.b.value"], False),
    ({"alternative": {"cost": 0.7}}, ["alternative.cost"], True),
    ({"recordings": {"swing": {"rmse": {"alpha": 0.11}, "samples": 9}}}, ["recordings.swing.rmse.alpha"], False),
    ({"recordings": {"swing": {"rmse": {"alpha": 0.1}, "samples": 9.0}}}, ["recordings.swing.samples"], True),
    ({"warnings": ["one", "other"]}, ["warnings.1"], True),
    ({"warnings": ["one"]}, ["warnings"], True),
    ({"p": 0.4}, ["p"], True),
    ({"new": 1}, ["new"], True),
    ({"orders": {}}, ["orders.mu.value", "orders.mu.interval95", "orders.mu.reason"], False),
]


@pytest.mark.parametrize(("change", "places", "reproduced"), CHANGES)
def test_what_differs_is_found_and_what_was_found_decides(change, places, reproduced):
    found = compared(RESULT, copy.deepcopy(RESULT) | change, {"the platform": ("a", "b")})
    assert [d.where for d in found.differences] == places
    assert found.reproduced == reproduced
    assert found.identical == (not places)
    assert compared(RESULT, copy.deepcopy(RESULT) | change).reproduced == (not places)  # nothing else has changed
    json.dumps(found.to_json(), allow_nan=False)


def test_what_was_found_is_told_first_and_the_largest_of_it():
    other = copy.deepcopy(RESULT) | {"p": 0.9, "cost": {"name": "rmse", "value": 0.6}}
    other["orders"]["mu"]["value"] = 0.90001
    assert [d.where for d in compared(RESULT, other).differences] == ["cost.value", "orders.mu.value", "p"]


def test_a_run_that_is_none_is_told(capsys, tmp_path):
    with pytest.raises(InputError, match="is no run folder"):
        fracid.reproduce(tmp_path)
    (tmp_path / "regression.json").write_text("{}")
    code, out, err = run(capsys, "reproduce", tmp_path)
    assert (code, out) == (2, "")
    assert "cannot be done again: expected what fracid fit, compare, noise, posterior or control wrote" in err
