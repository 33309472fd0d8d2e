"""The notebooks are stored as they were executed, and executed again they print and draw the same."""

import re
import subprocess
import sys
import tempfile
from base64 import b64decode
from io import BytesIO
from pathlib import Path

import nbformat
import pytest
from PIL import Image

from printed import differences, far_apart

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
    return "\n".join(text_of(o) for cell in code(notebook) for o in cell.outputs)


def text_of(output):
    """What a reader reads: streams, and tables and cards without their marks."""
    if output.output_type == "stream":
        return output.text
    return re.sub(r"<[^>]+>", "\n", output.data.get("text/html", output.data.get("text/plain", "")))


def pictures(notebook):
    drawn = [o.data["image/png"] for cell in code(notebook) for o in cell.outputs if "image/png" in o.get("data", {})]
    return [Image.open(BytesIO(b64decode(p))).convert("L") for p in drawn]


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
    drawn = enumerate(zip(pictures(stored(path)), pictures(again), strict=True))
    assert [number for number, pair in drawn if far_apart(*pair)] == []
    assert differences(printed(stored(path)), printed(again)) == []
