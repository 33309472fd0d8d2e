"""A table of numbers from a file of any known format.

===================  =============================================================
ending               read as
===================  =============================================================
.csv .tsv .txt .dat  text of any dialect (:mod:`fracid.recording.readers.text`)
.mat                 MATLAB v4 to v7.2 (:mod:`fracid.recording.readers.matlab`) and v7.3 (HDF5); structs are walked, and
                     so are the signals of a Simulink "Structure With Time", each under its label (not in v7.3)
.npz .npy            NumPy
.h5 .hdf5            HDF5; groups are walked
.parquet             Parquet, needs ``pip install 'fracid[parquet]'``
.xlsx .tdms .mdf     by packages, which are extras (:mod:`fracid.recording.readers.packages`)
.mf4 .mcap .db3
.json .jsonl         records or columns (:mod:`fracid.recording.readers.records`)
===================  =============================================================

A binary file holds named arrays; :mod:`fracid.recording.readers.arrays` says which of them is the recording.  Only a
plain file is opened, no pipe and no device, and one that changes while it is read is refused.
"""

from __future__ import annotations

import difflib
import re
import stat
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracid.errors import DataError, InputError
from fracid.recording.readers.arrays import AFTER_COMMA, choose, name_and_unit
from fracid.recording.readers.content import Content, LeftOut
from fracid.recording.readers.hdf5 import read_hdf5
from fracid.recording.readers.matlab import is_hdf5, read_mat
from fracid.recording.readers.numpy_files import read_npy, read_npz
from fracid.recording.readers.packages import FORMATS, read_by_package
from fracid.recording.readers.parquet import read_parquet
from fracid.recording.readers.records import read_json
from fracid.recording.readers.text import MOST_COLUMNS, TextTable, parse_text, read_text
from fracid.safety.json_files import short_text
from fracid.safety.paths import beside_each_other, kind_of, refuse_mistaken
from fracid.safety.text import LONGEST_NAME, ascii_short, printable

SINGLES = 12
"""Values beside the records that are named, at most."""

LISTED = 20
"""Columns in a message, at most."""


@dataclass(frozen=True)
class Table:
    """Columns of numbers, as they stand in a file."""

    values: NDArray[np.float64]
    """Shape (n_rows, n_columns), NaN where a cell is blank."""
    names: tuple[str, ...]
    """``column 0``, ``column 1``, ... where the file names none."""
    units: tuple[str, ...]
    """What the header says, an empty string where it says nothing."""
    source: str
    """File, and variable where one was chosen, for messages."""
    header: tuple[str, ...] = ()
    """The lines before the numbers of a text file."""
    notes: tuple[str, ...] = ()
    """What was guessed on reading, in sentences."""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """What is in the file and no column: its name, and why, as it goes on after the name."""
    beside: Mapping[str, Any] = field(default_factory=dict)
    """Single values that stand beside the samples, by name."""

    def find(self, key: int | str) -> int:
        """Return a column's position from its position (from 0) or name.

        Raises
        ------
        InputError
            There is no such column, or several of that name.

        Examples
        --------
        >>> Table(np.zeros((2, 2)), ("t", "theta"), ("", ""), "a.csv").find("theta")
        1
        """
        if isinstance(key, int) and 0 <= key < len(self.names):
            return key
        for names in (self.names, tuple(map(_bare, self.names))):  # "theta [deg]", or "theta" for short
            if names.count(str(key)) > 1:
                many = f"{names.count(str(key))} columns named {ascii_short(str(key))}"
                raise InputError(f"{self.source} has {many}: give its position.")
            if key in names:
                return names.index(str(key))
        if str(key).isdecimal() and int(key) < len(self.names):
            return int(key)
        raise InputError(self._no_column(key))

    def _no_column(self, key: int | str) -> str:
        if str(key) in self.left_out:
            return f"{self.source}: {ascii_short(str(key))} {self.left_out[str(key)]}."
        columns = ", ".join(f"{j} {ascii_short(name)}" for j, name in enumerate(self.names[:LISTED]))
        more = f" and {len(self.names) - LISTED} more" if len(self.names) > LISTED else ""
        bare = {_bare(name): name for name in reversed(self.names)}
        close = [bare[name] for name in difflib.get_close_matches(str(key), bare, n=1, cutoff=0.5)]
        hint = f" Did you mean {ascii_short(close[0])}?" if close else ""
        label = ascii_short(key) if isinstance(key, str) else key
        return f"{self.source} has no column {label}.{hint} Its columns, by position or name: {columns}{more}."


def read_table(path: str | Path, variable: str | None = None) -> Table:
    """Read a file into a table.

    Parameters
    ----------
    path : str or Path
        The file; its ending says the format.
    variable : str, optional
        Which array of a .mat, .npz or HDF5 file to take.

    Returns
    -------
    Table

    Raises
    ------
    InputError
        No such file, an unknown ending, no such variable, or a choice that must be made.
    DataError
        The file is empty, damaged, or holds no numbers.

    Examples
    --------
    >>> read_table("swing.docx")
    Traceback (most recent call last):
    fracid.errors.InputError: no file swing.docx...
    """
    path = Path(path)
    if kind_of(path) is not None:  # else _size tells
        refuse_mistaken(path, "recording")
    size = _size(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path.name}: unknown ending {path.suffix!r}; fracid reads {' '.join(READERS)}.")
    try:
        table = reader(path, variable) if size else None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    except MemoryError:
        raise DataError(f"{path.name} needs more memory than there is; cut it into parts.") from None
    except DataError:
        if (target := _elsewhere(path)) is None:
            raise
        raise DataError(
            f"{path.name} is a link to {printable(str(target))}, which is no recording; what stands there is not "
            "quoted. To see why, give that file itself."
        ) from None
    if table is None or not table.values.size:
        raise DataError(f"{path.name} is empty. A recording needs at least two rows of numbers.")
    if len(table.names) > MOST_COLUMNS:
        raise DataError(
            f"{path.name} has {len(table.names)} columns; fracid reads {MOST_COLUMNS} at most. Time must run downwards."
        )
    table = _without_empty_columns(table)
    return replace(table, names=tuple(map(_one_line, table.names)), units=tuple(map(_one_line, table.units)))


def _one_line(name: str) -> str:
    """Return a name that fits into a line; what is longer than any name is cut, and costs no search through it."""
    return printable(name[:LONGEST_NAME]).replace("\n", "\\n").replace("\t", "\\t")


def _size(path: Path) -> int:
    """Return the size of a plain file [bytes], or say why there is none: a pipe or a device may never end."""
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"no file {path}: {_nearby(path)}") from None
    except ValueError:
        raise InputError(f"no file {ascii_short(str(path))}: no file's name holds a zero byte.") from None
    except OSError as error:  # no permission, a link that leads to itself, a name too long
        raise InputError(f"{ascii_short(str(path))[1:-1]} cannot be read: {error.strerror or error}.") from None
    if stat.S_ISDIR(status.st_mode):
        raise InputError(f"no file {path} (it is a folder): {_nearby(path)}")
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path} is no plain file but a pipe or a device; save the recording to a file.")
    return status.st_size


def _elsewhere(path: Path) -> Path | None:
    """Where a link leads to, out of its folder: a stranger's may lead to any file, whose lines are not to be told."""
    target = path.resolve()
    return target if path.is_symlink() and not target.is_relative_to(path.parent.resolve()) else None


def _bare(name: str) -> str:
    """Return the name without a unit in brackets."""
    return re.sub(rf"\s*[\[(][^\])\[(]*[\])]\s*$|{AFTER_COMMA}", "", name)


def _nearby(path: Path) -> str:
    here = [p.name for p in beside_each_other(path.parent) if isfile(p)]
    close = difflib.get_close_matches(path.name, here, n=1)
    return f"did you mean {path.with_name(close[0])}?" if close else f"check the path; it leads to {path.resolve()}."


def _without_empty_columns(table: Table) -> Table:
    """Drop the nameless empty last column that a delimiter at each line's end makes."""
    if (
        len(table.names) > 1
        and table.names[-1] == f"column {len(table.names) - 1}"
        and np.isnan(table.values[:, -1]).all()
    ):
        return replace(table, values=table.values[:, :-1], names=table.names[:-1], units=table.units[:-1])
    return table


def _text(path: Path, variable: str | None) -> Table:
    _no_variable(path, variable)
    return _of_text(read_text(path), path.name)


def _of_text(text: TextTable, source: str) -> Table:
    names, units = zip(*map(name_and_unit, text.names, text.units, range(len(text.names))), strict=True)
    return Table(text.values, names, units, source, text.header, notes=text.notes)


def _no_variable(path: Path, variable: str | None) -> None:
    if variable is not None:
        raise InputError(f"{path.name} is one table: leave out the variable {variable!r} and choose columns.")


def _mat(path: Path) -> Content:
    return read_hdf5(path) if is_hdf5(path) else read_mat(path)


def _arrays(read: Callable[[Path], Content]) -> Callable[[Path, str | None], Table]:
    """Return the reader of a format that holds named arrays."""

    def reader(path: Path, variable: str | None) -> Table:
        choice = choose(read(path), variable, path)
        return Table(choice.values, choice.names, choice.units, choice.source, left_out=choice.left_out)

    return reader


def _parquet(path: Path, variable: str | None) -> Table:
    _no_variable(path, variable)
    return _arrays(read_parquet)(path, None)


def _json(path: Path, variable: str | None) -> Table:
    content, beside = read_json(path)
    said = ", ".join(f"{short_text(name)} = {short_text(v)}" for name, v in list(beside.items())[:SINGLES])
    notes = (f"Beside its samples it has {said}.",) if said else ()
    return replace(_arrays(lambda _: content)(path, variable), notes=notes, beside=beside)


def _workbook(path: Path, variable: str | None) -> Table:
    """Read the sheet of that name, else the first one with numbers."""
    sheets = {name: other.text for name, other in read_by_package(path).items() if isinstance(other, LeftOut)}
    if variable is not None and variable not in sheets:
        raise InputError(
            f"{path.name} has no sheet {ascii_short(variable)}. It has: {', '.join(map(ascii_short, sheets))}."
        )
    refused = DataError(f"{path.name} is empty. A recording needs at least two rows of numbers.")
    for sheet in sheets if variable is None else [variable]:
        source = f"{path.name}:{printable(sheet)}" if len(sheets) > 1 else path.name
        try:
            table = _of_text(parse_text(sheets[sheet], source), source)
        except DataError as error:
            refused = error
        else:
            others = ", ".join(ascii_short(name) for name in sheets if name != sheet)
            note = f"The sheet {ascii_short(sheet)} is read, and not {others}; to take another, type variable = NAME."
            return replace(table, notes=(*table.notes, note)) if others and variable is None else table
    raise refused


READERS: dict[str, Callable[[Path, str | None], Table]] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat"), _text),
    ".mat": _arrays(_mat),
    ".npz": _arrays(read_npz),
    ".npy": _arrays(read_npy),
    **dict.fromkeys((".h5", ".hdf5"), _arrays(read_hdf5)),
    ".parquet": _parquet,
    **dict.fromkeys((".json", ".jsonl"), _json),
    **{ending: _arrays(read_by_package) for ending in FORMATS},
    ".xlsx": _workbook,
}
