"""Pictures of the pages are those that the program draws now."""

import importlib.util
import re
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

import pytest
from PIL import Image

from printed import far_apart

ROOT = Path(__file__).parents[2]
MODELS = sorted(p.stem.removeprefix("figure-") for p in (ROOT / "docs" / "images").glob("figure-model-*.png"))


@cache
def script():
    """benchmarks/figures.py, whose fits are made once for all pictures."""
    spec = importlib.util.spec_from_file_location("figures_of_the_pages", ROOT / "benchmarks" / "figures.py")
    figures = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(figures)
    return figures


@pytest.mark.parametrize("name", [
    *(pytest.param(name, marks=pytest.mark.broad) for name in ("rig-hanging", "rig-upright", "recording", *MODELS)),
    *(pytest.param(name, marks=pytest.mark.slow) for name in (
        "fitted", "fitted-journal", "residuals", "residual-tests", "linear", "starts", "posterior",
        "posterior-predictive",
    )),
])  # fmt: skip
def test_a_picture_is_what_its_line_of_the_script_draws(tmp_path, name):
    figures = script()
    figures.write(figures.FIGURES[name](), tmp_path / "drawn.png")
    shown, drawn = (Image.open(p).convert("L") for p in (figures.IMAGES / f"figure-{name}.png", tmp_path / "drawn.png"))
    assert not far_apart(shown, drawn)


def test_of_every_picture_stands_what_makes_it():
    table = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("## Pictures")[1]
    rows = [
        (re.findall(r"`([^`]+)`", pictures), command)
        for pictures, command in re.findall(r"^\| (`.*?) \| (.*) \|$", table, re.M)
    ]
    pictures = sorted(p.name for p in (ROOT / "docs" / "images").iterdir())
    found = {name: sum(any(fnmatch(name, p) for p in patterns) for patterns, _ in rows) for name in pictures}
    assert {name: times for name, times in found.items() if times != 1} == {}
    assert [p for patterns, _ in rows for p in patterns if not any(fnmatch(name, p) for name in pictures)] == []
    scripts = [s for _, command in rows for s in re.findall(r"[\w/-]+\.(?:py|toml)", command)]
    assert [s for s in scripts if not (ROOT / s).is_file()] == []
