"""The page of the posterior shows what its command prints of the release that the README makes."""

import re
from pathlib import Path

import pytest

from program import run
from test_readme import commands
from test_tutorial import not_printed

PAGE = (Path(__file__).parents[2] / "docs" / "posterior.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_page_prints_what_the_program_does(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    typed = [words for words in commands("I have a recording") if words[0] in ("simulate", "init", "fit")]
    for words in (*typed, ["posterior", "runs/release", "--draws", "4000"]):
        code, output, said = run(capsys, *words)
        assert code == 0, (words, said)
    (block,) = re.findall(r"with `--draws 4000`:\n\n```\n(.*?)```", PAGE, re.DOTALL)
    assert not_printed(block, output) == []
