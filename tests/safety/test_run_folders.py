"""A run folder from a stranger or a dying disc is refused in a sentence, or does no harm."""

import json
import os
import re
import shutil
from pathlib import Path
from typing import Literal

import pytest
from pydantic import create_model

import fracid
import fuzz_runs
from fracid.errors import InputError
from fracid.safety.json_files import json_of
from fracid.safety.schema import Block, Interval, Number, fault_of, lines_of
from fracid.schemas.run_record import EvaluationLine
from fracid.selection.comparison_records import fault_of_fitted
from fracid.tasks.folder_lock import refuse_links
from fracid.tasks.journal import Journal, whole_lines
from fracid.validation.study_records import fault_of_repetition
from fracid.workflows.redrawing import _of_profiles
from program import run

# --- schemas ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "kind", "fault"),
    [
        (1, float, ""),
        (True, float, "a is true; expected a number"),
        (1e100, float, r"a is 1e\+100; expected a number below 1e\+100 in size"),
        (10**400, float, r"a is 10+\.\.\.; expected a number of fewer digits"),
        (1.0, int, "a is 1.0; expected a whole number"),
        (True, int, "a is true; expected a whole number"),
        ("x" * 200_000, str, r"a is 'x+\.\.\.'; expected a text of 100000 characters at most"),
        ("\x1b[2J", float, r"a is '\\x1b\[2J'; expected a number"),
        ("\u202e", float, r"a is '\\u202e'; expected a number"),
        (None, Number, ""),
        (None, float, "a is null; expected a number"),
        ([1], Interval | None, "a has 1 entries; expected 2"),
        ([1, 2, 3], Interval, "a has 3 entries; expected 2"),
        ("12", Interval, "a is '12'; expected a list"),
        ([1, "2"], list[float], "a.1 is '2'; expected a number"),
        ({"x" * 501: 1}, dict[str, float], "a has a name of more than 500 characters"),
        ("fit\n", Literal["fit", "validate"], "expected 'fit' or 'validate'"),
        ([], dict[str, float], "a is a list; expected names with values"),
        ([], EvaluationLine, "a is a list; expected names with values"),
        ("swing", EvaluationLine, "a is 'swing'; expected names with values"),
        ({"more": 1, "point": {}}, EvaluationLine, ""),
        ({}, EvaluationLine, "a has no point"),
    ],
)
def test_a_value_is_of_its_schema_or_where_it_is_not_is_said(value, kind, fault):
    said = fault_of({"a": value}, create_model("One", __base__=Block, a=(kind, ...)))
    assert re.search(fault, said) if fault else said == ""


@pytest.mark.parametrize(
    "text", ["NaN", "[1, -Infinity]", "9" * 5000, "[" * 100_000, "[" * 40 + "]" * 40, '{"a":' * 200, "", "\x00", "{"]
)
def test_what_no_run_writes_is_no_json(text):
    with pytest.raises(ValueError, match=r"\w|:"):
        json_of(text)


def test_a_log_gives_its_good_lines_and_a_pipe_none(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    assert [*lines_of(tmp_path / "pipe", Block)] == []
    path = tmp_path / "log"
    path.write_bytes(
        b'{"point": {"mu": 1}}\n{"point": 3}\n\xff\n[[[\n{"point": {"mu": 1e999}}\n{"point": {"mu": 2}}\n{"po'
    )
    assert [line["point"]["mu"] for line in lines_of(path, EvaluationLine)] == [1, 2]


# --- a run -------------------------------------------------------------------------------------------


def changed(*where, to):
    """Another value at a place of result.json."""

    def change(sent):
        said = whole = json.loads((sent / "result.json").read_text())
        for key in where[:-1]:
            said = said[key]
        if to is None:
            del said[where[-1]]
        else:
            said[where[-1]] = None if to == "null" else to
        (sent / "result.json").write_text(json.dumps(whole))

    return change


START = {"origin": "given", "start": {"mu": 1.0}, "cost_on_first_swing": 0.1, "end": {"mu": 1.0}, "cost": None,
         "ended": "left", "joined": "given", "evaluations": 3}  # fmt: skip

DAMAGED = {
    "a text for a number": (changed("orders", "mu", "value", to="<b>"), "orders.mu.value is '<b>'; expected a number"),
    "a number beyond sense": (changed("orders", "mu", "value", to=1e300), "orders.mu.value is 1e+300; expected a nu"),
    "a value out of its bounds": (
        changed("orders", "mu", "value", to=1.3),
        "mu = 1.3 is outside of its bounds, 0.9 to",
    ),
    "no such block": (changed("recordings", to=None), "result.json is damaged: it has no recordings"),
    "a list for names": (changed("parameters", to=[]), "parameters is a list; expected names with values"),
    "an order missing": (changed("orders", "mu", to=None), "it has no order 'mu'"),
    "an order without a value": (changed("orders", "mu", "value", to="null"), "it has no value of mu"),
    "another recording": (changed("recordings", "other", to={}), "recordings.other has no use"),
    "no recording": (changed("recordings", to={}), "its recordings are others"),
    "an output missing": (
        changed("recordings", "swing", "rmse", "alpha", to=None),
        "the outputs of 'swing' are others",
    ),
    "another use": (changed("recordings", "swing", "use", to="[red]"), "expected 'fit' or 'validate'"),
    "half an interval": (
        changed("orders", "mu", "interval95", to=[1]),
        "orders.mu.interval95 has 1 entries; expected 2",
    ),
    "a start that joined itself": (changed("starts", to=[START]), "the start given joined one that is not there"),
    "a warning that is none": (changed("warnings", to=[{}]), "warnings.0 is names with values; expected a text"),
    "a text of ten million letters": (changed("outcome", to="x" * 10**7), "outcome is 'xxxx"),
    "a pipe": (lambda sent: os.mkfifo(sent / "figures" / "pipe"), "pipe is no plain file but a pipe or a device"),
    "a link far below": (
        lambda sent: [(sent / "a" / "b" / "c").mkdir(parents=True), (sent / "a" / "b" / "c" / "d").symlink_to("/etc")],
        "a/b/c/d is a link, and what is written to a run folder stays in it",
    ),
    "a folder for a file": (
        lambda sent: [(sent / "result.json").unlink(), (sent / "result.json").mkdir()],
        "The fit in run was finished, but its result.json cannot be read; fit it again",
    ),
    "lists in lists": (lambda sent: (sent / "result.json").write_text("[" * 10**5), "its result.json cannot be read"),
    "a project of bits": (lambda sent: (sent / "project.toml").write_bytes(b"\xff\x00"), "no project.toml that can be"),
    "a project without an end": (
        lambda sent: os.truncate(sent / "project.toml", 1 << 40),
        "no project.toml that can be read",
    ),
}


@pytest.mark.few(3)
@pytest.mark.parametrize("fault", DAMAGED)
def test_a_damaged_run_is_refused_in_a_sentence(capsys, sent, fault):
    change, words = DAMAGED[fault]
    (sent / "figures").mkdir(exist_ok=True)
    change(sent)
    with pytest.raises(InputError) as error:
        fracid.load_run(sent)
    assert words in str(error.value)
    for command in ("resid", "report", "draw", "export", "reproduce"):
        code, out, err = run(capsys, command, sent)
        assert (code, out, len(err.splitlines())) == (2, "", 1)
        assert words in err


def test_a_good_run_is_read(sent):
    assert fracid.load_run(sent).notes == ()


@pytest.mark.parametrize("spoil", ["result.json", "run.json"])
def test_a_finished_run_that_lost_a_file_is_not_said_to_have_it(capsys, sent, spoil):
    (sent / spoil).unlink()
    for more in ([], ["--json"]):
        code, out, err = run(capsys, "resume", sent, *more)
        assert (code, out) == (2, "")
        assert "cannot be read" in err or "no run.json" in err


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("option", "value"), [("seed", "1"), ("starts", 1.5), ("project", None), ("cut", "no"), ("executor", 3)]
)
def test_options_that_nobody_could_have_typed_are_refused(capsys, sent, option, value):
    state = json.loads((sent / "run.json").read_text())
    state["options"][option] = value
    for finished in (True, False):
        (sent / "run.json").write_text(json.dumps(state | {"finished": finished}))
        code, _, err = run(capsys, "reproduce" if finished else "resume", sent)
        assert code == 2
        assert f"run.json is damaged: options.{option} is " in err


# --- what lies beside ----------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["profiles.json", "compare.json", "environment.json"])
@pytest.mark.parametrize("content", ["{", "[]", '{"profiles": {}}', '{"command": [1]}'])
def test_a_report_leaves_out_what_is_damaged_beside_it_and_says_so(sent, name, content):
    (sent / name).write_text(content)
    if content == '{"profiles": {}}' and name == "environment.json":
        return  # it has nothing that is wrong
    page = fracid.write_report(sent).read_text()
    assert f"{name} is damaged: " in page
    assert "It is left out here." in page


def test_a_picture_of_what_is_damaged_is_refused(capsys, sent):
    for name in ("profiles.json", "compare.json"):
        (sent / name).write_text('{"notes": 3}')
    with pytest.raises(InputError, match=r"run/profiles\.json is damaged: it has no cost"):
        next(_of_profiles(fracid.load_run(sent)))
    code, _, err = run(capsys, "draw", sent, "--style", "screen", "--format", "svg")
    assert (code, "run/compare.json is damaged: it has no structures" in err) == (2, True)


def test_a_study_with_a_damaged_file_is_refused(capsys, tmp_path):
    for text, words in (("{", "cannot be read as JSON"), ('{"truth": {}}', "it has no cost"), (
        json.dumps({"truth": {"mu": 1}, "cost": "rmse", "optimiser": "x", "seeds": 1, "cells": []}), "it has no cell",
    )):  # fmt: skip
        (tmp_path / "noise.json").write_text(text)
        code, _, err = run(capsys, "draw", tmp_path)
        assert (code, words in err) == (2, True)


# --- journals ------------------------------------------------------------------------------------------

FOUND = {"evaluations": 3, "cost_of_truth": 0.1, "failure": "", "cost": 0.1, "values": {"mu": 1.0},
         "standard_errors": {"mu": None}, "intervals": {"mu": None}, "fractional": None}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "good"),
    [({}, True), ({"cost": "0.1"}, False), ({"values": {}}, False), ({"values": {"mu": [1]}}, False),
     ({"cost": None, "failure": "diverged"}, True), ({"failure": 3}, False)],
)  # fmt: skip
def test_a_journals_line_counts_only_if_it_is_a_result_of_its_study(tmp_path, change, good):
    def fault(_key, said):
        return fault_of_repetition(said, ["mu"])

    with Journal(tmp_path / "journal.jsonl", {"seeds": 2}) as journal:
        journal.append("seed 1", FOUND | change)
        journal.append("seed 2", FOUND)
    with Journal(tmp_path / "journal.jsonl", {"seeds": 2}, fault) as journal:
        assert set(journal.done) == ({"seed 1", "seed 2"} if good else {"seed 2"})
        assert ("damaged lines (2) are passed over" in "".join(journal.notes)) is not good


def test_a_score_has_the_outputs_of_its_study():
    score = {"rmse": {"alpha": 0.1}, "fit_percent": {"alpha": 99}, "itae": {"alpha": None}, "failed": ""}
    row = {"friction": "viscous", "fractional": False, "name": "viscous, orders 1", "paper": False, "cost": 0.1,
           "parameters": 1, "bic_above_best": None, "orders": {}, "values": {}, "at_bound": [],
           "in_sample": {"one": score}, "held_out": {}, "outcome": ""}  # fmt: skip
    said = {"row": row, "squares": 0.1, "samples": 9}
    assert fault_of_fitted(said, ["alpha"]) == ""
    assert fault_of_fitted(said, ["alpha", "theta"]) == "in_sample.one.rmse has no theta"


def test_a_line_without_an_end_fills_no_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("fracid.tasks.journal.LONGEST", 10)
    (tmp_path / "log").write_bytes(b"one\n" + b"x" * 35 + b"\ntwo\n" + b"y" * 35)
    assert list(whole_lines(tmp_path / "log")) == [(b"one", 4), (b"", 40), (b"two", 44)]


def test_a_folder_of_files_has_no_links(tmp_path):
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "b" / "c.txt").touch()
    refuse_links(tmp_path)


# --- any ------------------------------------------------------------------------------------------------


def test_an_input_of_the_fuzzing_is_found_again_by_its_number(sent, tmp_path):
    good = Path.cwd()
    for name in ("compared", "noisy"):
        shutil.copytree(sent, good / name)
    for number in range(12):
        said = [fuzz_runs.spoilt(number, good, tmp_path / f"{number} {k}")[1] for k in range(2)]
        assert said[0] == said[1]


@pytest.mark.slow(minutes=2)
def test_for_some_minutes_no_spoilt_run_folder_does_harm(tmp_path):
    ended, failures = fuzz_runs.fuzz(fuzz_runs.made(tmp_path / "good"), range(10**6), seconds=120)
    assert failures == {}
    assert sum(ended.values()) > 20
