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
import stat
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from os.path import isfile
from pathlib import Path

from fracid.errors import DataError, InputError
from fracid.recording.readers.arrays import Table as Table
from fracid.recording.readers.arrays import choose, with_whole_stamps
from fracid.recording.readers.content import SAYS, Content, LeftOut
from fracid.recording.readers.hdf5 import read_hdf5
from fracid.recording.readers.matlab import is_hdf5, read_mat
from fracid.recording.readers.numpy_files import read_npy, read_npz
from fracid.recording.readers.packages import FORMATS, read_by_package
from fracid.recording.readers.parquet import read_parquet
from fracid.recording.readers.records import read_json
from fracid.recording.readers.text import MOST_COLUMNS, parse_text, read_text
from fracid.safety.json_files import short_text
from fracid.safety.paths import beside_each_other, kind_of, refuse_mistaken
from fracid.safety.text import LONGEST_NAME, ascii_short, printable

SINGLES = 12
"""Values beside the records that are named, at most."""


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
        target = path.resolve()
        if not path.is_symlink() or target.is_relative_to(path.parent.resolve()):
            raise
        # a stranger's link may lead to any file, whose lines are not to be told
        raise DataError(SAYS("elsewhere", path=path, target=printable(str(target)))) from None
    if table is None or not table.values.size:
        raise DataError(SAYS("empty", name=path.name))
    if len(table.names) > MOST_COLUMNS:
        raise DataError(SAYS("many-columns", path=path, columns=len(table.names), MOST_COLUMNS=MOST_COLUMNS))
    named = replace(table, names=tuple(map(_one_line, table.names)), units=tuple(map(_one_line, table.units)))
    return with_whole_stamps(named)


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


def _nearby(path: Path) -> str:
    here = [p.name for p in beside_each_other(path.parent) if isfile(p)]
    close = difflib.get_close_matches(path.name, here, n=1)
    return f"did you mean {path.with_name(close[0])}?" if close else f"check the path; it leads to {path.resolve()}."


def _one_table(read: Callable[[Path], Table], path: Path, variable: str | None) -> Table:
    """Of a format that has no variables."""
    if variable is not None:
        raise InputError(f"{path.name} is one table: leave out the variable {variable!r} and choose columns.")
    return read(path)


def _arrays(read: Callable[[Path], Content], path: Path, variable: str | None) -> Table:
    """Of a format that holds named arrays."""
    return choose(read(path), variable, path)


def _json(path: Path, variable: str | None) -> Table:
    content, beside = read_json(path)
    said = ", ".join(f"{short_text(name)} = {short_text(v)}" for name, v in list(beside.items())[:SINGLES])
    notes = (f"Beside its samples it has {said}.",) if said else ()
    return replace(choose(content, variable, path), notes=notes, beside=beside)


def _workbook(path: Path, variable: str | None) -> Table:
    """Read the sheet of that name, else the first one with numbers."""
    sheets = {name: other.text for name, other in read_by_package(path).items() if isinstance(other, LeftOut)}
    if variable is not None and variable not in sheets:
        known = ", ".join(map(ascii_short, sheets))
        raise InputError(SAYS("no-sheet", path=path, variable=ascii_short(variable), sheets=known))
    refused = DataError(SAYS("empty", name=path.name))
    for sheet in sheets if variable is None else [variable]:
        source = f"{path.name}:{printable(sheet)}" if len(sheets) > 1 else path.name
        try:
            table = parse_text(sheets[sheet], source)
        except DataError as error:
            refused = error
        else:
            others = ", ".join(ascii_short(name) for name in sheets if name != sheet)
            note = f"The sheet {ascii_short(sheet)} is read, and not {others}; to take another, type variable = NAME."
            return replace(table, notes=(*table.notes, note)) if others and variable is None else table
    raise refused


READERS: dict[str, Callable[[Path, str | None], Table]] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat", ".lvm", ".asc", ".prn"), partial(_one_table, read_text)),
    ".mat": partial(_arrays, lambda path: read_hdf5(path) if is_hdf5(path) else read_mat(path)),
    ".npz": partial(_arrays, read_npz),
    ".npy": partial(_arrays, read_npy),
    **dict.fromkeys((".h5", ".hdf5"), partial(_arrays, read_hdf5)),
    ".parquet": partial(_one_table, lambda path: choose(read_parquet(path), None, path)),
    **dict.fromkeys((".json", ".jsonl"), _json),
    **{ending: partial(_arrays, read_by_package) for ending in FORMATS},
    ".xlsx": _workbook,
}
