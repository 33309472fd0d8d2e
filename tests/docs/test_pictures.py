"""Pictures of the pages are those that the program draws now."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).parents[2]
SAME = 0.5
"""By which pixels may differ on average, of 255: fonts and machines round differently."""


@pytest.mark.parametrize("name", [
    *(pytest.param(name, marks=pytest.mark.broad) for name in ("rig-hanging", "rig-upright", "recording")),
    *(pytest.param(name, marks=pytest.mark.slow) for name in ("posterior", "posterior-predictive")),
])  # fmt: skip
def test_a_picture_is_what_its_line_of_the_script_draws(tmp_path, name):
    spec = importlib.util.spec_from_file_location("figures_of_the_pages", ROOT / "benchmarks" / "figures.py")
    figures = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(figures)
    figures.write(figures.FIGURES[name](), tmp_path / "drawn.png")
    shown, drawn = (Image.open(p).convert("L") for p in (figures.IMAGES / f"figure-{name}.png", tmp_path / "drawn.png"))
    assert shown.size == drawn.size
    assert np.abs(np.asarray(shown, float) - np.asarray(drawn, float)).mean() < SAME
