"""A table of numbers from a file of any known format.

===================  =============================================================
ending               read as
===================  =============================================================
.csv .tsv .txt .dat  text of any dialect (:mod:`fracid.recording.text`)
.mat                 MATLAB v4 to v7.2 (scipy.io) and v7.3 (HDF5); structs are walked, and so are the signals
                     of a Simulink "Structure With Time", each under its label (not in v7.3)
.npz .npy            NumPy
.h5 .hdf5            HDF5; groups are walked
.parquet             Parquet, needs ``pip install 'fracid[parquet]'``
===================  =============================================================

A binary file holds named arrays.  Which of them is the recording: the one named by
``variable``; else the only matrix, whose longer axis is time; else all vectors of one
length, each a column under its own name.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracid.errors import DataError, InputError
from fracid.foreign import printable
from fracid.recording.text import read_text

__all__ = ["READERS", "Table", "read_table"]


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
        for names in (self.names, tuple(map(_bare, self.names))):  # "theta [deg]", or "theta" for short
            if names.count(str(key)) > 1:
                raise InputError(f"{self.source} has {names.count(str(key))} columns named {key!r}: give its position.")
            if key in names:
                return names.index(str(key))
        if str(key).isdecimal() and int(key) < len(self.names):
            return int(key)
        raise InputError(self._no_column(key))

    def _no_column(self, key: int | str) -> str:
        listed = ", ".join(f"{j} {name!r}" for j, name in enumerate(self.names))
        close = difflib.get_close_matches(str(key), self.names, n=1, cutoff=0.5)
        hint = f" Did you mean {close[0]!r}?" if close else ""
        return f"{self.source} has no column {key!r}.{hint} Its columns, by position or name: {listed}."


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
    if not path.is_file():
        raise InputError(f"no file {path}{' (it is a folder)' if path.is_dir() else ''}: {_nearby(path)}")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path.name}: unknown ending {path.suffix!r}; fracid reads {' '.join(READERS)}.")
    try:
        empty = path.stat().st_size == 0
        table = None if empty else reader(path, variable)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from error
    if table is None or not table.values.size:
        raise DataError(f"{path.name} is empty. A recording needs at least two rows of numbers.")
    table = _without_empty_columns(table)
    return replace(table, names=tuple(map(printable, table.names)), units=tuple(map(printable, table.units)))


def _bare(name: str) -> str:
    """Return the name without a unit in brackets."""
    return re.sub(r"\s*[\[(][^\])]*[\])]\s*$", "", name)


def _nearby(path: Path) -> str:
    here = sorted(p.name for p in path.parent.glob("*") if p.is_file()) if path.parent.is_dir() else []
    close = difflib.get_close_matches(path.name, here, n=1)
    return f"did you mean {path.with_name(close[0])}?" if close else "check the path, it is taken from where you are."


def _without_empty_columns(table: Table) -> Table:
    """Drop the nameless empty last column that a delimiter at each line's end makes."""
    if (
        len(table.names) > 1
        and table.names[-1] == f"column {len(table.names) - 1}"
        and np.isnan(table.values[:, -1]).all()
    ):
        return Table(table.values[:, :-1], table.names[:-1], table.units[:-1], table.source, table.header)
    return table


def _text(path: Path, variable: str | None) -> Table:
    _no_variable(path, variable)
    text = read_text(path)
    names, units = zip(*map(_name_and_unit, text.names, text.units, range(len(text.names))), strict=True)
    return Table(text.values, names, units, path.name, text.header)


def _no_variable(path: Path, variable: str | None) -> None:
    if variable is not None:
        raise InputError(f"{path.name} is one table: leave out the variable {variable!r} and choose columns.")


def _name_and_unit(name: str, unit: str, position: int) -> tuple[str, str]:
    """Take the unit from the line of units or from the name: ``theta [deg]``, ``theta (deg)``."""
    inside = re.search(r"[\[(]([^\])]*)[\])]\s*$", unit or name)
    return name or f"column {position}", (inside[1] if inside else unit).strip()


def _mat(path: Path, variable: str | None) -> Table:
    with path.open("rb") as file:
        if b"MATLAB 7.3" in file.read(128):
            return _hdf5(path, variable)
    from scipy.io import loadmat

    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except Exception as error:  # SciPy raises ten kinds here, depending on the damage
        raise DataError(f"{path.name} is damaged or is no MATLAB file ({error}). Save it again.") from error
    return _choose({k: v for k, v in content.items() if not k.startswith("__")}, variable, path)


def _npz(path: Path, variable: str | None) -> Table:
    try:
        content = np.load(path, allow_pickle=False)
        if isinstance(content, np.ndarray):
            content = {path.stem: content}
        return _choose({k: content[k] for k in content}, variable, path)
    except (DataError, InputError):
        raise
    except Exception as error:  # zip, header or pickle: NumPy raises each its own kind
        raise DataError(f"{path.name} is damaged or holds objects instead of numbers ({error}).") from error


def _hdf5(path: Path, variable: str | None) -> Table:
    import h5py

    try:
        with h5py.File(path) as file:
            return _choose(_groups(file), variable, path)
    except OSError as error:
        raise DataError(f"{path.name} is damaged or is no HDF5 file ({error}).") from error


def _groups(group: Any) -> dict[str, Any]:
    """Read a group as nested dicts; ``#refs#`` is where MATLAB hides its own bookkeeping."""
    return {k: _groups(v) if hasattr(v, "keys") else v[()] for k, v in group.items() if not k.startswith("#")}


def _parquet(path: Path, variable: str | None) -> Table:
    _no_variable(path, variable)
    try:
        from pyarrow import parquet
    except ImportError as error:
        raise InputError("reading Parquet needs pyarrow: type pip install 'fracid[parquet]'") from error
    try:
        table = parquet.read_table(path)
    except Exception as error:  # pyarrow has its own tree of errors
        raise DataError(f"{path.name} is damaged or is no Parquet file ({error}).") from error
    columns = {name: table.column(name).to_numpy() for name in table.column_names}
    return _stack({k: v for k, v in columns.items() if _is_numeric(v)}, path.name)


READERS: dict[str, Callable[[Path, str | None], Table]] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat"), _text),
    ".mat": _mat,
    **dict.fromkeys((".npz", ".npy"), _npz),
    **dict.fromkeys((".h5", ".hdf5"), _hdf5),
    ".parquet": _parquet,
}


def _choose(content: Mapping[str, Any], variable: str | None, path: Path) -> Table:
    """Take the recording from a file's arrays, by the rule at the top of this page."""
    arrays = {name: a for name, a in _flatten(content).items() if _is_numeric(a) and a.size > 1}
    source = path.name
    if variable is not None:
        arrays = _named(arrays, variable, path)
        source = f"{path.name}:{variable}"
    if not arrays:
        raise DataError(
            f"{path.name} holds no arrays of numbers. Objects (timetable, timeseries) must be saved as plain "
            "arrays: save('f.mat', 't', 'theta', 'alpha')."
        )
    matrices = {name: a for name, a in arrays.items() if np.squeeze(a).ndim == 2}
    if len(matrices) == 1 and _is_longest(next(iter(matrices.values())), arrays):
        return _matrix(next(iter(matrices.values())), source)
    if matrices:
        raise InputError(
            f"{path.name} holds several arrays: {_list(arrays)}. Choose one: variable = {next(iter(matrices))!r}."
        )
    longest = max(a.size for a in arrays.values())
    return _stack({name: a.ravel() for name, a in arrays.items() if a.size == longest}, source)


def _is_longest(matrix: NDArray[Any], arrays: Mapping[str, NDArray[Any]]) -> bool:
    return bool(max(matrix.shape) >= max(max(a.shape) for a in arrays.values()))


def _named(arrays: Mapping[str, NDArray[Any]], variable: str, path: Path) -> dict[str, NDArray[Any]]:
    """Return the array of that name, or all within the struct or group of that name."""
    found = {k: a for k, a in arrays.items() if k == variable or k.startswith(f"{variable}.")}
    if not found:
        raise InputError(f"{path.name} has no variable {variable!r}. It holds: {_list(arrays)}.")
    return {k.removeprefix(f"{variable}."): a for k, a in found.items()}


def _list(arrays: Mapping[str, NDArray[Any]]) -> str:
    return ", ".join(f"{k} {'×'.join(map(str, a.shape))}" for k, a in arrays.items()) or "nothing"


def _flatten(content: Mapping[str, Any], prefix: str = "") -> dict[str, NDArray[Any]]:
    """Turn structs, groups and named fields into dotted names: ``data.theta``."""
    flat: dict[str, NDArray[Any]] = {}
    for name, item in content.items():
        inner = _fields(item)
        flat.update(_flatten(inner, f"{prefix}{name}.") if inner is not None else {f"{prefix}{name}": np.asarray(item)})
    top = {k.split(".")[0] for k in flat}
    alone = not prefix and len(top) == 1 and len(flat) > 1  # one struct holds all: its name adds nothing
    return {k.split(".", 1)[1]: a for k, a in flat.items()} if alone else flat


def _fields(item: Any) -> Mapping[str, Any] | None:
    if isinstance(item, Mapping):
        return item
    if hasattr(item, "_fieldnames"):  # a MATLAB struct, as SciPy gives it
        return {name: getattr(item, name) for name in item._fieldnames}
    names = getattr(getattr(item, "dtype", None), "names", None)
    return {name: item[name] for name in names} if names else _signals(item)


def _signals(item: Any) -> Mapping[str, Any] | None:
    """The signals of a Simulink "Structure With Time", an array of structs with values and label, by their labels."""
    structs = item.ravel().tolist() if isinstance(item, np.ndarray) and item.dtype == object else []
    if not structs or not all(hasattr(s, "_fieldnames") and "values" in s._fieldnames for s in structs):
        return None
    labels = [str(getattr(s, "label", "")).strip() for s in structs]
    named = [n if n.isidentifier() and labels.count(n) == 1 else f"signal{k}" for k, n in enumerate(labels, 1)]
    return dict(zip(named, (s.values for s in structs), strict=True))


def _is_numeric(array: NDArray[Any]) -> bool:
    return array.dtype.kind in "fiub" and (array.ndim == 1 or np.squeeze(array).ndim in (1, 2))


def _matrix(array: NDArray[Any], source: str) -> Table:
    """Lay a matrix out with time downwards: its longer axis; of a square, the one that has a clock."""
    values = np.squeeze(np.asarray(array, dtype=float))
    rows, columns = values.shape
    sideways = rows < columns or (rows == columns and _increases(values.T) and not _increases(values))
    values = values.T if sideways else values
    return Table(values, tuple(f"column {j}" for j in range(values.shape[1])), ("",) * values.shape[1], source)


def _increases(values: NDArray[np.float64]) -> bool:
    return bool(np.any(np.all(np.diff(values, axis=0) > 0, axis=0)))


def _stack(columns: Mapping[str, NDArray[Any]], source: str) -> Table:
    if not columns:
        raise DataError(f"{source} holds no column of numbers.")
    names, units = zip(*(_name_and_unit(name, "", j) for j, name in enumerate(columns)), strict=True)
    return Table(np.column_stack([np.asarray(a, dtype=float) for a in columns.values()]), names, units, source)
