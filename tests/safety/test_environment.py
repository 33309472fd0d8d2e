"""What lies in the folder that one stands in does nothing: modules, and settings of other packages."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fracid.safety.environment import ignore_settings, safe_children
from program import RELEASE

MODULES = ("multiprocessing", "numpy", "struct", "tempfile", "typer", "matplotlib", "numba")
"""That the program, or a process that it starts, imports from where they are installed."""

PROGRAM = "from fracid.cli import main\nif __name__ == '__main__':\n    main()\n"


@pytest.fixture
def strange(tmp_path):
    """A folder where everything says that it ran."""
    folder = tmp_path / "strange"
    folder.mkdir()
    for name in MODULES:
        text = f"import pathlib\npathlib.Path({str(tmp_path)!r}, 'ran-{name}').touch()\nraise SystemExit(7)\n"
        (folder / f"{name}.py").write_text(text)
    (folder / "matplotlibrc").write_text("text.usetex: True\nfigure.edgecolor: 123456\ntext.color: fedcba\n")
    (folder / ".numba_config.yaml").write_text(f"cache_dir: {folder}/compiled\n")
    time = np.arange(0.0, 1.0, 0.01)
    rows = np.column_stack([time, 1e-3 * np.sin(9 * time), 0.35 * np.cos(8 * time)])
    np.savetxt(folder / "swing.csv", rows, delimiter=",", header="time,theta,alpha", comments="")
    (folder / "rig.toml").write_text(RELEASE)
    return folder


def done(folder, *words, **environment):
    """What a command prints that is run there and succeeds."""
    safe = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    ended = subprocess.run([sys.executable, *map(str, words)], cwd=folder, env=safe | environment, capture_output=True,
                           text=True, check=False)  # fmt: skip
    assert (ended.returncode, ended.stderr) == (0, ""), ended.stderr
    return ended.stdout


@pytest.mark.broad
def test_a_fit_in_a_strangers_folder_takes_nothing_from_it_but_what_was_named(strange, tmp_path):
    program = tmp_path / "program.py"  # as the installed program: Python looks beside it, not where one stands
    program.write_text(PROGRAM)
    done(strange, program, "fit", "rig.toml", "--out", "run", "--jobs", "2")
    assert not list(tmp_path.glob("ran-*"))
    assert not (strange / "compiled").exists()
    drawn = [path.read_text().lower() for path in (strange / "run" / "figures").glob("*.svg")]
    assert len(drawn) >= 3
    assert not any("#123456" in text or "#fedcba" in text for text in drawn)


@pytest.mark.broad
def test_as_a_module_of_python_it_imports_nothing_from_there_either(strange, tmp_path):
    assert done(strange, "-m", "fracid", "--version").startswith("fracid ")
    assert "swing.csv" in done(strange, "-m", "fracid", "check", "swing.csv")
    assert not list(tmp_path.glob("ran-*"))


def test_python_from_which_it_is_imported_keeps_its_own_ways(strange, tmp_path):
    ask = "import os; from fracid.safety.environment import safe_children\nwith safe_children(): pass\n"
    assert done(tmp_path, "-c", f"{ask}print(os.environ.get('PYTHONSAFEPATH'))") == "None\n"
    assert done(tmp_path, "-c", f"{ask}print(os.environ.get('PYTHONSAFEPATH'))", PYTHONSAFEPATH="2") == "2\n"


@pytest.mark.broad
def test_where_a_command_is_about_to_go_counts_too(strange, tmp_path):
    for name in MODULES:
        (strange / f"{name}.py").unlink()
    ask = "import os, sys; from pathlib import Path; from fracid.safety.environment import ignore_settings\n"
    ask += f"ignore_settings(Path({str(strange)!r})); here = os.getcwd(); os.chdir({str(strange)!r})\n"
    ask += "import matplotlib; from numba.core import config; config.reload_config()\n"
    ask += "print(here, matplotlib.rcParams['text.color'], config.CACHE_DIR or '-')"
    assert done(tmp_path, "-c", ask).split() == [str(tmp_path), "black", "-"]


def test_without_such_files_nothing_is_imported(tmp_path):
    ask = "import sys; from pathlib import Path; from fracid.safety.environment import ignore_settings\n"
    ask += "ignore_settings(Path()); print({'numba', 'matplotlib', 'numpy'} & set(sys.modules))"
    assert done(tmp_path, "-c", ask) == "set()\n"


def test_the_environment_is_given_back_after_an_error(monkeypatch):
    monkeypatch.setenv("PYTHONSAFEPATH", "mine")
    with pytest.raises(OSError, match="no"), safe_children():
        raise OSError("no")
    assert os.environ["PYTHONSAFEPATH"] == "mine"
    ignore_settings(Path("/nowhere"))
