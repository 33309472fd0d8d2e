"""``fracid control``: its table, JSON and figure; resumed; refused in a sentence."""

import json
import shutil
from contextlib import nullcontext

import jsonschema
import numpy as np
import pytest

import fracid
from fracid.errors import Unfinished
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
    assert (
        len([line for line in out.splitlines() if line.startswith("LQR ") and " of 3 draws " in line]) == 8
    )  # six, the chosen one on all draws, and the answer
    assert "LQR holds upright in 3 of 3 draws (95 % interval" in out
    assert "in 95 % of the draws" in out
    assert "control.json" in out
    assert "Nothing drove the recordings" in out


@pytest.mark.broad
def test_the_record_keeps_its_schema_and_the_same_command_simulates_nothing(capsys, folder):
    run(capsys, "control", folder, *HOW)
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


@pytest.mark.broad
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


def stopped_after(count):
    """An observer who presses Ctrl-C after so many trials."""

    def tell(progress):
        if progress.done >= count:
            raise KeyboardInterrupt

    return fracid.Observer(progress=lambda what: nullcontext(tell))


@pytest.mark.broad
def test_what_python_began_is_resumed_as_the_same_study(capsys, folder):
    drawn = {"points": np.linspace(0.94, 0.96, 9)[:, None], "log_weights": np.full(9, -np.log(9.0))}
    (folder / "posterior").mkdir()
    np.savez(folder / "posterior" / "draws.npz", **drawn)
    how = {
        "kind": "swing", "posture": "upright", "at": {"theta": 0.1}, "input_": "voltage", "limit": 12.0, "rate": 400.0,
        "delay": 5e-4, "off": {"alpha": 3.0}, "within": {"alpha": 0.7, "theta": 6.0}, "seconds": 6.0, "draws": 2,
        "seed": 5, "posterior": True, "trust": True,
    }  # fmt: skip
    whole, begun = folder.parent / "whole", folder.parent / "begun"
    with pytest.raises(Unfinished):
        fracid.run_control(folder, out=begun, observer=stopped_after(1), **how)
    assert not (begun / "control.json").exists()
    code, _, err = run(capsys, "resume", begun)
    assert (code, err) == (0, "")
    assert json.loads((begun / "control.json").read_text(encoding="utf-8")) == (
        fracid.run_control(folder, out=whole, **how).result
    )
