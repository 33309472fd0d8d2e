"""The notebooks are stored as they were executed, and executed again they print the same."""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import nbformat
import pytest

from printed import differences

FOLDER = Path(__file__).parents[2]
NOTEBOOKS = {FOLDER / "examples" / f"{name}.ipynb": n for name, n in
             {"paper": 10, "recording": 2, "solver": 2, "lab": 2}.items()}  # fmt: skip
"""With the pictures that each has at least."""
LARGEST = 1.5e6  # bytes

every_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def stored(path):
    return nbformat.read(path, as_version=4)


def code(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def printed(notebook):
    return "".join(o.text for cell in code(notebook) for o in cell.outputs if o.output_type == "stream")


def pictures(notebook):
    return [o for cell in code(notebook) for o in cell.outputs if "image/png" in o.get("data", {})]


@every_notebook
def test_it_is_stored_with_its_outputs_executed_from_top_to_bottom(path):
    cells = code(stored(path))
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    kinds = {o.get("name", o.output_type) for cell in cells for o in cell.outputs}
    assert kinds <= {"stdout", "display_data", "execute_result"}  # neither errors nor warnings
    assert len(pictures(stored(path))) >= NOTEBOOKS[path]
    assert path.stat().st_size < LARGEST


@every_notebook
def test_nothing_in_it_is_of_one_machine_or_one_run(path):
    text = path.read_text(encoding="utf-8")
    places = (FOLDER, Path.home(), Path(tempfile.gettempdir()), Path(sys.prefix))
    assert not [p for p in places if f"{p}/" in text]
    assert not re.search(r'<Figure|"execution"|iopub|/site-packages/| at 0x', text)


@every_notebook
def test_links_lead_somewhere(path):
    text = "".join(cell.source for cell in stored(path).cells if cell.cell_type == "markdown")
    targets = re.findall(r"\]\((?!https?:|#)([^)#]+)", text)
    assert targets
    assert [t for t in targets if not (path.parent / t).exists()] == []


@pytest.mark.slow  # half a minute of one core each
@every_notebook
def test_executed_again_it_prints_the_same(path, tmp_path):
    copy = tmp_path / path.name
    copy.write_bytes(path.read_bytes())
    command = [sys.executable, str(FOLDER / "tests" / "docs" / "notebook.py"), str(copy)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    again = nbformat.read(copy, as_version=4)
    assert len(pictures(again)) == len(pictures(stored(path)))
    assert differences(printed(stored(path)), printed(again)) == []
