"""``fracid control``: its table, JSON and figure; resumed; refused in a sentence."""

import json
import shutil

import jsonschema
import pytest

import fracid
from fracid.runs.json_schemas import json_schema
from program import run

HOW = ("--limit", 10, "--draws", 3, "--seconds", 3)


@pytest.fixture(scope="module")
def folder(plain, tmp_path_factory):
    """A run, free to be written into."""
    return shutil.copytree(plain, tmp_path_factory.mktemp("control") / "rig") / "run"


def test_the_terminal_shows_designs_share_and_margins_with_their_bands(capsys, folder):
    code, out, err = run(capsys, "control", folder, *HOW)
    assert (code, err) == (0, "")
    assert len([line for line in out.splitlines() if line.startswith("LQR ") and " of 3 " in line]) == 7
    assert "LQR holds upright in 3 of 3 draws (95 % interval" in out
    assert "in 95 % of the draws" in out
    assert "control.json" in out
    assert "Nothing drove the recordings" in out


def test_the_record_keeps_its_schema_and_the_same_command_simulates_nothing(capsys, folder):
    code, out, err = run(capsys, "control", folder, *HOW, "--json")
    assert code == 0
    record = json.loads((folder / "control" / "control.json").read_text(encoding="utf-8"))
    jsonschema.validate(record, json.loads(json_schema("control.json")))
    assert json.loads(out) == record
    assert record["share"] == 1.0
    assert len(record["trials"]) == 3
    page = (folder / "control" / "control.html").read_text(encoding="utf-8")
    assert "LQR holds upright in 3 of 3 draws" in page
    assert "The worst draw, moving" in page
    moving = (folder / "control" / "figures" / "motion.svg").read_text(encoding="utf-8")
    assert "<animate" in moving
    again = fracid.run_control(folder, limit=10, draws=3, seconds=3.0)
    assert again.result == record
    assert {path.name for path in again.figures} >= {"motion.svg"}
    progress = [json.loads(line) for line in err.splitlines() if '"earlier"' in line]
    assert progress
    assert all(line["earlier"] == line["done"] for line in progress)


def test_a_swing_up_is_shown_kept_and_read_again(capsys, folder):
    how = ("--kind", "swing", "--limit", 10, "--draws", 2, "--seconds", 6, "--out", folder.parent / "swing")
    code, out, err = run(capsys, "control", folder, *how)
    assert (code, err) == (0, "")
    assert "swing-up and LQR holds upright in 2 of 2 draws" in " ".join(out.split())
    assert "it is up after" in " ".join(out.split())
    record = json.loads((folder.parent / "swing" / "control.json").read_text(encoding="utf-8"))
    jsonschema.validate(record, json.loads(json_schema("control.json")))
    assert "fracid_controller_step" in (folder.parent / "swing" / "controller.c").read_text(encoding="utf-8")
    assert "swing-up" in (folder.parent / "swing" / "control.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "type --limit"),
        (("--limit", 10, "--posture", "lying"), "unknown posture 'lying'"),
        (("--limit", 10, "--at", "beta=1"), "beta"),
        (("--limit", 10, "--input", "torque"), "unknown input 'torque'"),
    ],
)
def test_what_cannot_be_controlled_is_refused(capsys, folder, options, words):
    code, out, err = run(capsys, "control", folder, *options, "--out", folder.parent / "other")
    assert (code, out) == (2, "")
    assert words in err
