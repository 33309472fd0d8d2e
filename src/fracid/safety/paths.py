"""A path that is not what was expected of it: what it is, and what to type in its place.

==============  =============================================================
kind            how it is known
==============  =============================================================
``project``     a file that ends in .toml
``recording``   a file that :mod:`fracid.recording` reads by its ending, and no JSON of a run or study
``run``         a folder with a ``result.json``, or a ``run.json`` of a fit
``study``       a folder with a ``compare.json`` or ``noise.json``
==============  =============================================================

:func:`refuse_mistaken` raises where a path is of another kind than was asked for, or is not there at all; the sentence
ends with a command.  Whoever reads a kind of path calls it first, so that library and program say the same.
"""

from __future__ import annotations

import difflib
import os
import shlex
import tomllib
from contextlib import suppress
from itertools import islice
from os import PathLike
from os.path import exists, isdir, isfile
from pathlib import Path
from typing import Literal

from fracid.errors import InputError
from fracid.safety.door import own_text, text_of
from fracid.safety.json_files import json_of

Kind = Literal["project", "recording", "run", "study"]

SAID = tomllib.loads(own_text("safety/paths.toml"))
"""What is wanted → what it is → what to say."""

RECORDINGS: tuple[str, ...] = tuple(SAID["recordings"])
"""Endings of recordings: the keys of :data:`fracid.recording.readers.table.READERS`, which a test compares."""

STUDIES: dict[str, str] = SAID["studies"]
"""What a study writes → its command."""

NAMED = 1000
"""Names among which the one that was meant is looked for."""


def path_of(given: str | PathLike[str], example: str) -> Path:
    """The path that a caller of the library gave.

    Raises
    ------
    InputError
        If it is none, but a table, say.

    Examples
    --------
    >>> path_of([1, 2], "'rig.toml'")
    Traceback (most recent call last):
    fracid.errors.InputError: A list is no path; expected e.g. 'rig.toml'.
    """
    if not isinstance(given, str | PathLike):
        raise InputError(f"A {type(given).__name__} is no path; expected e.g. {example}.")
    return Path(given)


def kind_of(path: Path) -> Kind | None:
    """What there is at a path; None for nothing, or for what fracid does not know.

    Examples
    --------
    >>> kind_of(Path("/nowhere/rig.toml")) is None
    True
    """
    if isdir(path):
        if exists(path / "result.json") or exists(path / "run.json"):
            return "run"
        return "study" if any(exists(path / name) for name in STUDIES) else None
    if not isfile(path):
        return None
    if path.suffix.lower() == ".toml":
        return "project"
    of_a_run = path.suffix == ".json" and kind_of(path.parent) is not None
    return "recording" if path.suffix.lower() in RECORDINGS and not of_a_run else None


def refuse_mistaken(path: Path, target: Kind) -> None:
    """Raise, with what to type, if a path is of another kind, or not there.

    Parameters
    ----------
    path : Path
    target : str
        ``project``, ``recording`` or ``run``.

    Raises
    ------
    InputError

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> (folder / "swing.csv").touch()
    >>> refuse_mistaken(folder / "swing.csv", "project")
    Traceback (most recent call last):
    fracid.errors.InputError: .../swing.csv is a recording, not a project. Write a project of it: fracid init
    .../swing.csv.
    >>> refuse_mistaken(folder / "swong.csv", "recording")
    Traceback (most recent call last):
    fracid.errors.InputError: There is no .../swong.csv. Did you mean .../swing.csv?
    """
    kind = kind_of(path)
    if kind == target:
        return
    if kind is not None:
        raise InputError(f"{path} is {_instead(path, target, kind)}.")
    if not exists(path):
        raise InputError(f"There is no {path}. {_nearest(path, target)}")


def _instead(path: Path, target: Kind, kind: Kind) -> str:
    """What it is, and what to type."""
    run = Path("runs") / path.stem
    study = next((command for name, command in STUDIES.items() if exists(path / name)), "")
    fitted = f"; its run may be {_typed(run)}" if kind_of(run) == "run" else ""
    return str(SAID[target][kind]).format(path=_typed(path), project=_project_of(path), study=study, fitted=fitted)


def _project_of(folder: Path) -> str:
    """The project that a run was made of, as it was typed."""
    with suppress(OSError, ValueError, LookupError, TypeError, AttributeError, StopIteration):
        words = json_of(text_of(folder / "environment.json"))["command"]
        return _typed(Path(next(word for word in words if word.endswith(".toml"))))
    return "PROJECT"


def _nearest(path: Path, target: Kind) -> str:
    """The one meant, or what there is to choose from."""
    beside = path.parent
    if not isdir(beside):
        return f"There is no folder {beside} either; paths begin at {Path.cwd()}."
    there = {p.name: p for p in beside_each_other(beside) if not p.name.startswith(".") and kind_of(p) == target}
    by_stem = {Path(name).stem: p for name, p in there.items()}
    if close := difflib.get_close_matches(path.stem, by_stem, n=1):
        return f"Did you mean {_typed(by_stem[close[0]])}?"
    if not there and target == "run":
        there = {p.name: p for p in beside_each_other(beside / "runs") if kind_of(p) == "run"}
    if not there:
        return f"No other {target} is in {beside.resolve()}. {SAID['missing'].get(target, 'Check the path')}."
    names = [_typed(p) for p in there.values()]
    return f"There {'is' if len(names) == 1 else 'are'} {', '.join(names[:5])}{' ...' if len(names) > 5 else ''}."


def beside_each_other(folder: Path) -> list[Path]:
    """What lies in a folder, for a message: sorted, of a folder of thousands some, of none and a closed one nothing.

    Examples
    --------
    >>> beside_each_other(Path("/nowhere"))
    []
    """
    with suppress(OSError), os.scandir(folder) as entries:
        return sorted(folder / entry.name for entry in islice(entries, NAMED))
    return []


def default_folder(name: str) -> Path:
    """Where a command writes that is given no ``--out``: no link, for it was not named and may lead anywhere.

    Raises
    ------
    InputError
        If ``runs``, or what lies in it under that name, is a link.

    Examples
    --------
    >>> str(default_folder("rig"))
    'runs/rig'
    """
    folder = Path("runs") / name
    for link in (folder.parent, folder):
        if link.is_symlink():
            raise InputError(f"{link} is a link and leads elsewhere; name the folder to write to: --out {folder}.")
    return folder


def _typed(path: Path) -> str:
    """A path as one types it."""
    return shlex.quote(str(path))
