"""The notebook of the paper is stored as it was executed, and executed again it prints the same."""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import nbformat
import pytest

from printed import differences

FOLDER = Path(__file__).parents[2]
PAPER = FOLDER / "examples" / "paper.ipynb"
LARGEST = 1.5e6  # bytes


def stored():
    return nbformat.read(PAPER, as_version=4)


def code(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def printed(notebook):
    return "".join(o.text for cell in code(notebook) for o in cell.outputs if o.output_type == "stream")


def pictures(notebook):
    return [o for cell in code(notebook) for o in cell.outputs if "image/png" in o.get("data", {})]


def test_it_is_stored_with_its_outputs_executed_from_top_to_bottom():
    cells = code(stored())
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    kinds = {o.get("name", o.output_type) for cell in cells for o in cell.outputs}
    assert kinds <= {"stdout", "display_data", "execute_result"}  # neither errors nor warnings
    assert len(pictures(stored())) >= 10
    assert PAPER.stat().st_size < LARGEST


def test_nothing_in_it_is_of_one_machine_or_one_run():
    text = PAPER.read_text(encoding="utf-8")
    places = (FOLDER, Path.home(), Path(tempfile.gettempdir()), Path(sys.prefix))
    assert not [p for p in places if f"{p}/" in text]
    assert not re.search(r'<Figure|"execution"|iopub|/site-packages/', text)


def test_links_lead_somewhere():
    text = "".join(cell.source for cell in stored().cells if cell.cell_type == "markdown")
    targets = re.findall(r"\]\((?!https?:|#)([^)#]+)", text)
    assert targets
    assert [t for t in targets if not (PAPER.parent / t).exists()] == []


@pytest.mark.slow  # half a minute of one core
def test_executed_again_it_prints_the_same(tmp_path):
    copy = tmp_path / PAPER.name
    copy.write_bytes(PAPER.read_bytes())
    command = [sys.executable, str(FOLDER / "tests" / "docs" / "notebook.py"), str(copy)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    again = nbformat.read(copy, as_version=4)
    assert len(pictures(again)) == len(pictures(stored()))
    assert differences(printed(stored()), printed(again)) == []
