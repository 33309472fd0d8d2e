"""Every file of examples/ runs, and finds the truth that it made.

A new file in that folder is run by itself; one that prints ``NAME value   95 %: low to high   truth …`` is held to it,
and so is one whose output docs/examples.md shows.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import fracid
from printed import differences
from scripts import module_of

FOLDER = Path(__file__).parents[2] / "examples"
OWN = ("duffing", "flexible_link", "supercapacitor", "own_cost")
DRAWS = ("simulate.py", "identify_release.py", "noise_study.py", *(f"{name}.py" for name in OWN[:3]))

PAGE = FOLDER.parent / "docs" / "examples.md"
BLOCK = re.compile(r"^```text\n\$ python examples/(\S+)\n(.*?)^```", re.DOTALL | re.MULTILINE)
SHOWN = dict(BLOCK.findall(PAGE.read_text(encoding="utf-8")))
"""What the page says that each example prints, by its file."""

FOUND = re.compile(r"(\S+)\s+(\S+)\s+95 %: (\S+) to (\S+)\s+truth (\S+)")
SURE = 2.5
"""Half widths of a 95 % interval beyond which nothing is by chance."""


@pytest.fixture
def folder(tmp_path):
    """A copy of the examples, in a tree like the project's: what they write stays in it."""
    for written in ("examples", "docs/images", "src/fracid/twins"):
        (tmp_path / written).mkdir(parents=True)
    for path in (*FOLDER.glob("*.py"), *FOLDER.glob("*.toml")):
        shutil.copy(path, tmp_path / "examples")
    return tmp_path / "examples"


def ran(path):
    """What an example prints; any warning is an error."""
    surroundings = os.environ | {"PYTHONWARNINGS": "error", "NO_COLOR": "1", "COLUMNS": "120", "PYTHONUTF8": "1"}
    done = subprocess.run(
        [sys.executable, path.name], cwd=path.parent, env=surroundings, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    return done.stdout


ELSEWHERE = ("make_twins.py", "what_an_experiment_shows.py", "which_experiment_next.py")
"""What test_twins.py runs, and what takes minutes: their tables are a page's."""

EXAMPLES = sorted(path.name for path in FOLDER.glob("*.py") if path.name not in ELSEWHERE)


@pytest.mark.broad
@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs_without_a_warning_and_finds_its_truth(folder, name):
    printed = ran(folder / name)
    assert printed.strip()
    for what, *numbers in FOUND.findall(printed):
        value, low, high, truth = map(float, numbers)
        assert abs(value - truth) < SURE * (high - low) / 2, (what, printed)
    if name in SHOWN:
        shown = SHOWN[name].removeprefix("…\n")
        last = printed.splitlines()[-len(shown.splitlines()) :]
        assert differences(shown, "\n".join(last), skip=r"\d ms ") == []
    if name in DRAWS:
        assert (folder / name).with_suffix(".png").stat().st_size > 10_000


@pytest.mark.few(2)
@pytest.mark.parametrize("name", OWN)
def test_the_project_file_of_an_example_says_what_its_python_says(folder, name):
    example = module_of(folder / f"{name}.py")
    example.record(np.random.default_rng(1))
    said, written = example.problem(), fracid.load_project(folder / f"{name}.toml", trust=True).problem
    assert written.names == said.names or {n.split(" [")[0] for n in written.names} == {
        n.split(" [")[0] for n in said.names
    }
    assert [u.range for u in written.unknowns] == [u.range for u in said.unknowns]
    assert (written.outputs, written.substeps, written.weights) == (said.outputs, said.substeps, said.weights)
    assert written.cost(written.start) == said.cost(said.start)


@pytest.mark.few(2)
@pytest.mark.parametrize("name", OWN)
def test_code_of_an_examples_own_is_not_run_unasked(folder, name):
    example = module_of(folder / f"{name}.py")
    example.record(np.random.default_rng(1))
    with pytest.raises(fracid.InputError, match="trust"):
        fracid.load_project(folder / f"{name}.toml")


def test_the_page_names_every_example():
    text = PAGE.read_text(encoding="utf-8")
    assert [p.name for p in FOLDER.glob("*.*") if p.suffix in (".py", ".toml", ".ipynb") and p.name not in text] == []


@pytest.mark.slow  # 20 s of one core
def test_a_model_of_ones_own_goes_all_the_way_from_the_command_line(folder):
    module_of(folder / "supercapacitor.py").record(np.random.default_rng(1))
    for command in ("fit supercapacitor.toml", "resid runs/supercapacitor", "export runs/supercapacitor"):
        program = [sys.executable, "-m", "fracid", *command.split(), "--trust"]
        done = subprocess.run(program, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert "Traceback" not in done.stderr
        if command.startswith("fit"):
            assert re.search(r"fit +0\.00\d+ V +99\.\d+ %", done.stdout)
            assert "°" not in done.stdout
        assert "fracid compare" not in done.stdout  # without friction there is no ladder
    assert (folder / "runs" / "supercapacitor" / "report.html").is_file()
