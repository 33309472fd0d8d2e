"""ARCHITECTURE.md has a line for every package, and its picture is that of the code."""

import pytest

from scripts import ROOT, module_of


def drawing():
    return module_of("docs/_site/architecture.py")


def test_every_package_and_file_has_its_line_in_the_tree():
    package = ROOT / "src" / "fracid"
    folders = {path.parent.name for path in package.glob("*/__init__.py")}
    files = {path.stem for path in package.glob("*.py")} - {"__init__", "__main__"}
    assert set(drawing().titles()) == folders | files


@pytest.mark.broad
def test_the_picture_has_the_arrows_of_the_code():
    """Sizes may lag behind; boxes and arrows may not."""

    def without_sizes(picture):
        return [part for part in picture.replace(">", ">\n").split("\n") if not part.endswith("k</text>")]

    now = drawing()
    stored = now.PICTURE.read_text(encoding="utf-8")
    assert without_sizes(stored) == without_sizes(now.drawn()), "type: python docs/_site/architecture.py"


def test_every_file_that_the_page_names_is_there():
    import re

    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8").split("```")[2]
    named = set(re.findall(r"`((?:[a-z_]+/)*[a-z_]+\.(?:py|md))`", text))
    places = (ROOT, ROOT / "src" / "fracid", ROOT / "src" / "fracid" / "recording" / "readers")
    assert {name for name in named if not any((place / name).exists() for place in places)} == set()
