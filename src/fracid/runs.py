"""The run folder: everything that one identification leaves behind.

::

    runs/NAME/
    ├── result.json          Fit.to_json() with hashes of the data, versions and timing
    ├── project.toml         the project file as it was used
    ├── environment.json     versions, machine, command line
    ├── evaluations.jsonl    every evaluation of the cost, as it ended (written by the optimiser's log)
    └── figures/             SVG and PNG

The same inputs and seed give the same ``result.json`` but for its ``timing`` block, for any number of
threads.  A file is written whole or not at all.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import tempfile
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fracid.errors import InputError

if TYPE_CHECKING:
    from fracid.identify import Fit
    from fracid.project import Project

__all__ = ["EVALUATIONS", "FIGURES", "open_folder", "versions", "write_result", "write_text"]

EVALUATIONS = "evaluations.jsonl"
FIGURES = "figures"

_PACKAGES = ("fracid", "numpy", "scipy", "numba", "pymoo")


def open_folder(folder: Path) -> Path:
    """Make a run folder, and clear it of an earlier run's own files.

    Raises
    ------
    InputError
        If it cannot be written, or holds files that no run of fracid wrote.

    Examples
    --------
    >>> import tempfile
    >>> open_folder(Path(tempfile.mkdtemp()) / "first").name
    'first'
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()) and not (folder / "environment.json").exists():
            raise InputError(f"{folder} holds files that are not a run's; give an empty or a new folder: --out DIR.")
        (folder / EVALUATIONS).unlink(missing_ok=True)
        (folder / "result.json").unlink(missing_ok=True)
        environment = {"versions": versions(), "platform": platform.platform(), "command": sys.argv[1:]}
        write_text(folder / "environment.json", json.dumps(environment, indent=2) + "\n")
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be written: {error.strerror}. Give another: --out DIR.") from None
    return folder


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that a result depends on."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all: to a neighbour first, then renamed."""
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_result(folder: Path, fit: Fit, project: Project, timing: Mapping[str, float]) -> dict[str, Any]:
    """Write ``result.json`` and ``project.toml``; gives the former's content.

    Raises
    ------
    InputError
        If the disk will not take them.
    """
    result = fit.to_json() | {
        "preset": project.preset,
        "data_sha256": {r.name: r.sha256 for r in project.recordings},
        "versions": versions(),
        "timing": {stage: round(seconds, 3) for stage, seconds in timing.items()},
    }
    try:
        write_text(folder / "result.json", json.dumps(result, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
        write_text(folder / "project.toml", project.text)
    except OSError as error:
        raise InputError(f"The result cannot be written to {folder}: {error.strerror}.") from None
    return result
