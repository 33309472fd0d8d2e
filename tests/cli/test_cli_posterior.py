"""``fracid posterior``: its table, JSON, draws and figures; resumed; what it refuses, in a sentence."""

import json
import shutil

import jsonschema
import numpy as np
import pytest

import fracid
from fracid.bayes import laplace
from fracid.runs.json_schemas import json_schema
from program import run


@pytest.fixture(scope="module")
def drawn(plain, tmp_path_factory):
    """A run, and the folder of its posterior."""
    folder = tmp_path_factory.mktemp("posterior")
    shutil.copytree(plain, folder / "rig")
    finished = fracid.run_posterior(folder / "rig" / "run", draws=400, trust=False)
    return folder / "rig" / "run", finished


def test_draws_are_written_beside_a_record_that_keeps_its_schema(drawn):
    _, finished = drawn
    record = json.loads(finished.path.read_text(encoding="utf-8"))
    jsonschema.validate(record, json.loads(json_schema("posterior.json")))
    low, high = record["unknowns"]["mu"]["interval95"]
    assert low < json.loads((drawn[0] / "result.json").read_text())["orders"]["mu"]["value"] < high
    assert record["trusted"]
    with np.load(finished.draws) as file:
        assert file["names"].tolist() == ["mu"]
        mean = np.exp(file["log_weights"]) @ file["points"][:, 0]
    assert mean == pytest.approx(record["unknowns"]["mu"]["mean"])
    assert {path.suffix for path in finished.figures} == {".png", ".svg"}


@pytest.mark.broad
def test_the_same_command_reads_the_journal_and_simulates_nothing(capsys, drawn, monkeypatch):
    folder, finished = drawn
    monkeypatch.setattr(laplace, "log_likelihoods", lambda *_: pytest.fail("it simulates"))
    code, out, err = run(capsys, "posterior", folder, "--draws", 400, "--json")
    assert code == 0
    progress = [line for line in err.splitlines() if '"earlier"' in line]
    assert progress
    assert all('"earlier": 400' in line for line in progress)
    assert json.loads(out) == json.loads(finished.path.read_text(encoding="utf-8"))


@pytest.mark.broad
def test_more_draws_and_another_seed_go_into_the_same_folder(capsys, drawn, tmp_path):
    shutil.copytree(drawn[0].parent, tmp_path / "rig")
    code, out, _ = run(capsys, "posterior", tmp_path / "rig" / "run", "--draws", 500, "--seed", 2, "--json")
    assert code == 0
    assert json.loads(out)["draws"] == 500


def test_the_terminal_shows_interval_prior_verdict_and_evidence(capsys, drawn):
    folder, _ = drawn
    code, out, err = run(capsys, "posterior", folder, "--draws", 400)
    assert (code, err) == (0, "")
    (row,) = [line for line in out.splitlines() if line.startswith("mu ")]
    assert "0.9 … 1.1" in row
    assert "The draws can be trusted" in out
    assert "Log evidence, relative to the greatest likelihood: −" in out.replace("-", "−")
    assert "draws.npz" in out


@pytest.mark.broad
def test_a_saved_run_and_its_posterior_are_cards(drawn):
    folder, finished = drawn
    assert "The draws can be trusted" in repr(finished.posterior)
    assert len(repr(finished.posterior).splitlines()) <= 8
    again = fracid.load_run(folder).posterior(draws=400)
    np.testing.assert_array_equal(again.points, finished.posterior.points)


def test_draws_go_to_arviz(drawn):
    pytest.importorskip("arviz_base")
    _, finished = drawn
    data = finished.posterior.to_arviz(300)
    assert data["posterior"]["mu"].shape == (1, 300)


@pytest.mark.parametrize(("words", "sentence"), [
    (("--method", "laplas"), "unknown method 'laplas': did you mean laplace"),
    (("--draws", 50), "greater than or equal to 100"),
    (("--out", "."), "holds files that are not a run's"),
])  # fmt: skip
def test_an_impossible_option_is_refused_in_a_sentence(capsys, drawn, monkeypatch, tmp_path, words, sentence):
    (tmp_path / "mine.txt").touch()
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, "posterior", drawn[0], *words)
    assert code == 2
    assert sentence in " ".join(err.replace("│", " ").split())


def test_a_fit_that_was_interrupted_is_refused(capsys, sent):
    path = sent / "result.json"
    result = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(result | {"outcome": "interrupted: the best so far is kept"}), encoding="utf-8")
    code, _, err = run(capsys, "posterior", sent)
    assert code == 2
    assert "was interrupted before its minimum, about which a posterior is drawn: type fracid fit" in err


def test_a_project_in_place_of_a_run_is_refused_with_what_to_type(capsys, drawn):
    code, _, err = run(capsys, "posterior", drawn[0].parent / "rig.toml")
    assert code == 2
    assert "is a project, not the folder of a run. Fit it first: fracid fit" in err
