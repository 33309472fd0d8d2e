"""SECURITY.md promises nothing without a test, and names none that is not there."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def promises():
    """The points of what is promised, each on one line."""
    text = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    promised = text[text.index("## What is promised") : text.index("## What is not promised")]
    return [
        " ".join(point.split()) for point in re.findall(r"^- (.*?)(?=^- |^\n|\Z)", promised, re.DOTALL | re.MULTILINE)
    ]


def test_each_promise_names_tests_and_all_of_them_are_there():
    tests = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    there = set(re.findall(r"^def (test_\w+)", tests, re.MULTILINE))
    named = [(point, set(re.findall(r"`(test_\w+)`", point))) for point in promises()]
    assert len(named) > 35
    assert [point for point, names in named if not names] == []
    assert set().union(*(names for _, names in named)) - there == set()
