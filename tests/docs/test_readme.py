"""The README's cards work as written, and what would be cited is what is installed."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest

from fracid import load_run
from program import run

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def commands(card):
    """The words of each command of a card, without its remark."""
    section = README.split(f"\n## {card}\n")[1].split("\n## ")[0].replace("\\\n", " ")
    return [shlex.split(line, comments=True)[1:] for line in re.findall(r"^\$ (fracid .*)$", section, re.MULTILINE)]


def test_the_links_between_the_cards_lead_to_their_headings():
    anchors = {"#" + title.lower().replace(" ", "-") for title in re.findall(r"^## (.*)$", README, re.MULTILINE)}
    linked = re.findall(r"\]\((#[^)]*)\)", README)
    assert len(linked) == 4
    assert set(linked) <= anchors


def test_a_package_index_shows_no_link_or_picture_that_it_cannot_resolve():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    shown = README
    for change in project["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]["substitutions"]:
        shown, count = re.subn(change["pattern"], change["replacement"], shown)
        assert count, change
    assert re.findall(r"!?\[[^\]]*\]\((?!https:)[^)]*\)", shown) == []
    assert "<img" not in shown
    assert len(shown) > 0.7 * len(README)


def test_no_line_of_code_is_wider_than_a_page_that_shows_it():
    blocks = re.findall(r"```.*?```", README, re.DOTALL)
    assert [line for block in blocks for line in block.splitlines() if len(line) > 80] == []


@pytest.mark.broad
@pytest.mark.parametrize(
    ("card", "folder", "order", "true"),
    [("I have a recording", "release", "lambda", 1.0), ("I teach a lab", "student7", "mu", 0.95)],
)
def test_a_card_works_as_written(tmp_path, monkeypatch, capsys, card, folder, order, true):
    monkeypatch.chdir(tmp_path)
    typed = commands(card)
    assert len(typed) >= 3
    for words in typed:
        code, _, err = run(capsys, *words)
        assert code == 0, (words, err)
    low, high = load_run(tmp_path / "runs" / folder).result["orders"][order]["interval95"]
    assert low < true < high
    assert (tmp_path / "runs" / folder / "report.html").exists()


def test_the_version_to_cite_is_that_of_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = dict(re.findall(r"^([a-z-]+): (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE))
    assert citation["version"] == project["version"]
    assert citation["title"] == project["name"]
    assert citation["license"] == project["license"]
