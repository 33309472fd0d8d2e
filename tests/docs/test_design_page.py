"""The commands of docs/design.md's way from a bad recording to a good one run, and print what stands below them."""

import re
import shlex
from pathlib import Path

import pytest

from program import run
from test_tutorial import not_printed

PAGE = (Path(__file__).parents[2] / "docs" / "design.md").read_text(encoding="utf-8")


APART = 0.15
"""The first recording says little: what a search finds in it differs by half an interval between machines."""


@pytest.mark.slow
def test_the_way_from_a_bad_recording_to_a_good_one_prints_what_the_page_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    steps = re.findall(r"```(\w+)\n(.*?)```", PAGE.split("## From a bad recording")[1], re.DOTALL)
    output = ""
    for kind, block in steps:
        if kind == "text":
            assert not_printed(block, output, APART) == []
        for line in block.replace("\\\n", "").splitlines() if kind == "console" else ():
            code, output, said = run(capsys, *shlex.split(line.removeprefix("$ fracid ")))
            assert code == 0, (line, said)
    assert len([kind for kind, _ in steps if kind == "text"]) == 3
