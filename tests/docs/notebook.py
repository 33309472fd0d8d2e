"""Execute a notebook anew, in place:  python tests/docs/notebook.py examples/paper.ipynb   (make notebook)

The notebook is its own source: change it in Jupyter, then execute it with this, which leaves nothing in the file that
differs from run to run: no times, no random names of cells, no version of the kernel.  `test_notebook.py` executes it
again and holds what it prints against what is stored.
"""

import os
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

LIMIT = 600
"""For one cell [s]."""


def executed(path):
    """The notebook with the outputs of this run; an error in a cell is raised with its traceback."""
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as own:  # no history and no settings of the user's
        surroundings = {"IPYTHONDIR": own, "JUPYTER_CONFIG_DIR": own, "PYTHONUTF8": "1"}
        client = NotebookClient(
            notebook,
            timeout=LIMIT,
            kernel_name="python3",
            extra_arguments=["--log-level=40"],  # it warns of its own port at this machine
            record_timing=False,
            coalesce_streams=True,
            resources={"metadata": {"path": str(path.parent)}},
        )
        client.execute(env=os.environ | surroundings)
    return settled(notebook)


def settled(notebook):
    """The same without what differs from run to run."""
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook.metadata = nbformat.from_dict({"kernelspec": kernel, "language_info": {"name": "python"}})
    notebook.nbformat, notebook.nbformat_minor = 4, 5
    for number, cell in enumerate(notebook.cells, 1):
        cell.id, cell.metadata = f"cell-{number:02}", nbformat.from_dict({})
        if "outputs" in cell:
            cell.outputs = [o for o in cell.outputs if not is_progress(o)]
        for output in cell.get("outputs", []):
            if "data" in output and "image/png" in output.data:
                output.data.pop("text/plain", None)  # <Figure size ...>
    return notebook


def is_progress(output):
    """Whether it says which stages took how long: only slow machines show that."""
    return output.output_type == "display_data" and output.data.get("text/plain", "").startswith("✓ ")


if __name__ == "__main__":
    for name in sys.argv[1:]:
        found = executed(Path(name))
        nbformat.write(found, name)
        sys.stdout.write(f"{name}: {len(found.cells)} cells, {Path(name).stat().st_size / 1e3:.0f} kB\n")
