"""The Python of the pages runs, and prints what they say that it prints."""

import contextlib
import io
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LONG = ("residuals", "identification", "uncertainty", "theory", "choosing", "coming-from", "upright")
"""Pages that take seconds."""
PAGES = (
    "docs/solver.md",
    "docs/compare.md",
    "docs/export.md",
    "docs/figures.md",
    "docs/recording.md",
    "docs/friction.md",
    "docs/limits.md",
    "docs/honesty.md",
    "README.md",
    *(pytest.param(f"docs/{page}.md", marks=pytest.mark.broad) for page in LONG),
)
LINKED = sorted(str(page.relative_to(ROOT)) for page in (*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")))


def blocks(page):
    """The Python blocks of a page that need no recording, in one string: later ones use the names of earlier ones."""
    found = re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    return [code for code in found if "load_project" not in code]


def beside(code):
    """What stands beside each print, or in the line below where it would not fit."""
    return re.findall(r"^print\((?:.*|\n(?:    .*\n)+)\)(?:  |\n)# (.*)$", code, re.MULTILINE)


@pytest.mark.few(3)
@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_prints_is_what_stands_beside_it(page):
    code = "\n".join(blocks(page))
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, page, "exec"), {"__name__": "page"})
    assert printed.getvalue().splitlines() == beside(code)
    assert printed.getvalue()


@pytest.mark.parametrize("page", LINKED)
def test_links_and_pictures_of_a_page_are_there(page):
    targets = re.findall(r"\]\((?!https?:|#)([^)#]+)", (ROOT / page).read_text(encoding="utf-8"))
    assert [t for t in targets if not ((ROOT / page).parent / t).exists()] == []
