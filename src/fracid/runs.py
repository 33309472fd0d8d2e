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
import threading
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fracid.errors import InputError

if TYPE_CHECKING:
    from fracid.identify import Fit
    from fracid.project import Project

__all__ = ["EVALUATIONS", "FIGURES", "open_folder", "versions", "write_result", "write_text", "write_whole"]

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
        for old in (folder / EVALUATIONS, folder / "result.json", *_figures(folder)):
            old.unlink(missing_ok=True)
        environment = {"versions": versions(), "platform": platform.platform(), "command": sys.argv[1:]}
        write_text(folder / "environment.json", json.dumps(environment, indent=2) + "\n")
    except (FileExistsError, NotADirectoryError):
        raise InputError(f"{folder} is no folder, or lies below a file; give another: --out DIR.") from None
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be written: {error.strerror}. Give another: --out DIR.") from None
    return folder


def _figures(folder: Path) -> list[Path]:
    """Figures of an earlier run: of recordings, perhaps, that this one does not have."""
    return [path for kind in ("*.svg", "*.png") for path in (folder / FIGURES).glob(kind)]


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that a result depends on.

    Examples
    --------
    >>> sorted(versions())
    ['fracid', 'numba', 'numpy', 'pymoo', 'python', 'scipy']
    """
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found


def write_text(path: Path, text: str) -> None:
    """Write a text whole or not at all; see :func:`write_whole`.

    Raises
    ------
    OSError
        If it cannot be written; an earlier file of that name then stays as it was.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_text(folder / "note.txt", "done")
    >>> [path.name for path in folder.iterdir()]
    ['note.txt']
    """
    write_whole(path, text.encode())


def write_whole(path: Path, content: bytes) -> None:
    """Write to a neighbour first, then rename: the file is the old one or the new one, never a part.

    Raises
    ------
    OSError
        If it cannot be written; an earlier file of that name then stays as it was.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "two.bin"
    >>> write_whole(file, b"12")
    >>> file.read_bytes()
    b'12'
    """
    neighbour = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}")
    try:
        neighbour.write_bytes(content)
        with neighbour.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(neighbour, path)
    finally:
        neighbour.unlink(missing_ok=True)


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
