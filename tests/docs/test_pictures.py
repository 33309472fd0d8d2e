"""Pictures of the pages are those that the program draws now."""

import importlib.util
import re
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from printed import far_apart
from scripts import module_of

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
        "fitted", "fitted-journal", "residuals", "residual-tests", "linear", "starts", "cost", "profiles", "cut",
        "ladder", "amplitude", "noise", "posterior", "posterior-predictive", "example-duffing",
        "example-flexible-link", "example-simulate", "example-supercapacitor",
    )),
])  # fmt: skip
def test_a_picture_is_what_its_line_of_the_script_draws(tmp_path, name):
    figures = script()
    figures.write(figures.FIGURES[name](), tmp_path / "drawn.png")
    assert alike(figures.path_of(name), tmp_path / "drawn.png")


def test_the_test_above_draws_every_picture_of_the_script():
    (marks,) = (m for m in test_a_picture_is_what_its_line_of_the_script_draws.pytestmark if m.name == "parametrize")
    assert {p.values[0] for p in marks.args[1]} == set(script().FIGURES)


def alike(shown, drawn):
    """Pixels of a PNG; of an SVG its texts, and where its lines lie to a point."""
    if shown.suffix == ".png":
        return not far_apart(*(Image.open(path).convert("L") for path in (shown, drawn)))
    texts, lines = zip(*(content_of(path.read_text(encoding="utf-8")) for path in (shown, drawn)), strict=True)
    return texts[0] == texts[1] and all(map(near, *lines)) and len(lines[0]) == len(lines[1])


def content_of(svg):
    points = (re.findall(r"-?\d+\.\d+", line) for line in re.findall(r' d="([^"]+)"', svg))
    return re.findall("<!-- (.*?) -->", svg), [np.array(p, float) for p in points]


def near(a, b):
    return a.shape == b.shape and bool((np.abs(a - b) < 1).all())


def drawn_starts_and_chaos(orders):
    orders.draw_starts(orders.IMAGES / "solver-start.png")
    orders.draw_chaos(orders.IMAGES / "solver-chaos.png")


SCRIPTS = {
    "benchmarks/friction.py": lambda script: script.main(["elements"]),
    "benchmarks/servo.py": lambda script: script.main(),
    "benchmarks/titin.py": lambda script: script.main(),
    "benchmarks/orders.py": drawn_starts_and_chaos,
    "examples/theory_pictures.py": lambda script: script.main(),
    "examples/what_an_experiment_shows.py": lambda script: script.draw(),
}
"""Script → what draws its pictures."""


@pytest.mark.slow
@pytest.mark.parametrize("path", SCRIPTS)
@pytest.mark.filterwarnings("ignore::fracid.solver.solve.PaperSchemeWarning")
@pytest.mark.filterwarnings("ignore::fracid.solver.arguments.AtRestWarning")
def test_pictures_of_other_scripts_are_what_they_draw(tmp_path, monkeypatch, path):
    made = module_of(path)
    shown = ROOT / "docs" / "images"
    monkeypatch.setattr(made, "IMAGES", tmp_path)
    SCRIPTS[path](made)
    drawn = sorted(tmp_path.iterdir())
    assert drawn
    assert [p.name for p in drawn if not alike(shown / p.name, p)] == []


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
