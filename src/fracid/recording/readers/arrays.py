"""From the named arrays of a file to one table: which of them is the recording.

The one named by ``variable``; else the only matrix, whose longer axis is time, and behind its columns the vectors of
that length; else all vectors of one length, each a column under its own name.  What is left out is kept with its
reason.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.errors import DataError, InputError
from fracid.recording.channel import UNIT_WORDS
from fracid.recording.readers.content import EMPTY, Content, LeftOut, refuse_bomb, seconds
from fracid.safety.text import ascii_short

Array = NDArray[np.generic]


AFTER_COMMA = rf",\s*({'|'.join(map(re.escape, sorted(UNIT_WORDS)))})\s*$"
"""A unit in a name that was quoted for its comma."""

SINGLE = "is a single number"
"""Why an array is left out that is no column."""

LISTED, SHOWN = 12, 20
"""Arrays, and columns, in a message, at most."""


@dataclass(frozen=True)
class Table:
    """Columns of numbers, as they stand in a file."""

    values: FloatArray
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
        numbered = tuple(f"{name} ({j})" for j, name in enumerate(self.names))  # as columns of one name are called
        ends = () if str(key).isdecimal() else (f"/{key}", f".{key}")  # without what all names begin with
        short = tuple(str(key) if name.endswith(ends) else name for name in self.names)
        for names in (self.names, tuple(map(_bare, self.names)), numbered, short):  # "theta [deg]", or "theta"
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
        columns = _shortened([f"{j} {ascii_short(name)}" for j, name in enumerate(self.names)], SHOWN)
        bare = {_bare(name): name for name in reversed(self.names)}
        close = [bare[name] for name in difflib.get_close_matches(str(key), bare, n=1, cutoff=0.5)]
        hint = f" Did you mean {ascii_short(close[0])}?" if close else ""
        label = ascii_short(key) if isinstance(key, str) else key
        return f"{self.source} has no column {label}.{hint} Its columns, by position or name: {columns}."


def _bare(name: str) -> str:
    """Return the name without a unit in brackets."""
    return re.sub(rf"\s*[\[(][^\])\[(]*[\])]\s*$|{AFTER_COMMA}", "", name)


def choose(content: Content, variable: str | None, path: Path) -> Table:
    """Take the recording from a file's arrays, by the rule at the top of this page.

    Raises
    ------
    InputError
        There is no such variable, or several matrices to choose from.
    DataError
        There is nothing that could be a recording.
    """
    flat = _flatten(content)
    source = path.name
    if variable is not None:
        flat = _named(flat, variable, path)
        source = f"{path.name}:{variable}"
    arrays = {name: a for name, a in flat.items() if not isinstance(a, LeftOut) and a.size > 1}
    left_out = {name: a.why for name, a in flat.items() if isinstance(a, LeftOut)}
    left_out |= {name: SINGLE for name, a in flat.items() if not isinstance(a, LeftOut) and a.size == 1}
    if not arrays:
        raise DataError(_nothing(path, left_out))
    refuse_bomb(path, sum(a.size for a in arrays.values()))
    matrices = {name: a for name, a in arrays.items() if np.squeeze(a).ndim == 2}
    longest = max(max(a.shape) for a in arrays.values())
    if [max(m.shape) for m in matrices.values()] == [longest]:
        (name, matrix), *_ = matrices.items()
        beside = {n: a.ravel() for n, a in arrays.items() if n != name and a.size == max(matrix.shape)}
        others = [n for n in arrays if n not in (name, *beside)]
        left_out |= {n: f"has {arrays[n].size} numbers beside the matrix {name!r}" for n in others}
        return stack([*_columns(matrix), *beside.items()], source, left_out)
    if matrices:
        first = ascii_short(next(iter(matrices)))
        raise InputError(f"{path.name} holds several arrays: {_list(arrays)}. Choose one: variable = {first}.")
    longest = max(a.size for a in arrays.values())
    odd = {n: f"has {a.size} numbers where others have {longest}" for n, a in arrays.items() if a.size != longest}
    return stack([(n, a.ravel()) for n, a in arrays.items() if n not in odd], source, left_out | odd)


def stack(columns: Sequence[tuple[str, Array]], source: str, left_out: Mapping[str, str]) -> Table:
    """Put vectors of one length, each with its name, beside each other."""
    names, units = zip(*(name_and_unit(name, "", j) for j, (name, _) in enumerate(columns)), strict=True)
    values = np.empty((len(columns[0][1]), len(columns)))
    with np.errstate(all="ignore"):  # numbers beyond float64 become infinite, signalling NaNs quiet
        for j, (_, column) in enumerate(columns):
            values[:, j] = column
        values += 0.0
    return Table(values, names, units, source, left_out=left_out)


def with_whole_stamps(table: Table) -> Table:
    """Join the seconds and nanoseconds of a time, which ROS writes apart.

    Examples
    --------
    >>> table = Table(np.array([[8.0, 5e8, 0.1]]), ("stamp.secs", "stamp.nsecs", "x"), ("", "", ""), "log.csv")
    >>> with_whole_stamps(table).names, with_whole_stamps(table).values.tolist()
    (('stamp', 'x'), [[8.5, 0.1]])
    """
    for fraction in table.names:
        seconds = re.sub(r"n(?:ano)?(sec(?:ond)?s?)$", r"\1", fraction, flags=re.IGNORECASE)
        if seconds != fraction and seconds in table.names:
            i, j = table.names.index(seconds), table.names.index(fraction)
            stamp = re.sub(r"[\W_]*sec(?:ond)?s?$", "", seconds, flags=re.IGNORECASE) or seconds
            names, values = [*table.names], table.values.copy()
            names[i], values[:, i] = stamp, values[:, i] + 1e-9 * values[:, j]
            note = f"{stamp} is {seconds} and {fraction} together."
            table = replace(table, names=(*names[:j], *names[j + 1 :]), units=(*table.units[:j], *table.units[j + 1 :]),
                            values=np.delete(values, j, axis=1), notes=(*table.notes, note))  # fmt: skip
    return table


def name_and_unit(name: str, unit: str, position: int) -> tuple[str, str]:
    """Take the unit from the line of units or from the name: ``theta [deg]``, ``theta (deg)``, ``theta, deg``.

    Of ``position[0]`` it is the place in an array.

    Examples
    --------
    >>> name_and_unit("theta[deg]", "", 0), name_and_unit("position[0]", "", 0), name_and_unit("rabbits [1]", "", 0)
    (('theta[deg]', 'deg'), ('position[0]', ''), ('rabbits [1]', '1'))
    """
    inside = re.search(r"(?!(?<=\w)\[\d+\])[\[(]([^\])]*)[\])]\s*$|" + AFTER_COMMA, (unit or name)[-200:])
    return name or f"column {position}", (inside[1] or inside[2] or "" if inside else unit).strip()


def is_unit(word: str) -> bool:
    """Whether a word is a unit, or stands in brackets as one.

    Examples
    --------
    >>> is_unit("ms"), is_unit("(°)"), is_unit("theta [deg]")
    (True, True, False)
    """
    return bool({word, word.lower()} & UNIT_WORDS) or (word[:1] in ("[", "(") and word[-1] in "])")


def _nothing(path: Path, left_out: Mapping[str, str]) -> str:
    """Return why there is no recording."""
    start = f"{path.name} holds no arrays of numbers."
    if single := [name for name, why in left_out.items() if why == SINGLE]:
        names = _shortened([ascii_short(n)[1:-1] for n in single])
        start = f"{path.name} holds single numbers ({names}); a recording needs at least two samples."
    if others := [f"{ascii_short(n)[1:-1]} {why}" for n, why in left_out.items() if n not in single]:
        return f"{start} What it holds: {'; '.join(others[:3])}{'; and more' * (len(others) > 3)}."
    return start if single else f"{start} Save them as plain arrays: save('f.mat', 't', 'theta', 'alpha')."


def _named(flat: Mapping[str, Array | LeftOut], variable: str, path: Path) -> dict[str, Array | LeftOut]:
    """Return the array of that name, or all within the struct or group of that name."""
    if not (matches := {k: a for k, a in flat.items() if k == variable or k.startswith(f"{variable}.")}):
        arrays = {k: a for k, a in flat.items() if not isinstance(a, LeftOut)}
        raise InputError(f"{path.name} has no variable {ascii_short(variable)}. It holds: {_list(arrays)}.")
    return {k.removeprefix(f"{variable}."): a for k, a in matches.items()}


def _list(arrays: Mapping[str, Array]) -> str:
    entries = [f"{ascii_short(k)[1:-1]} {'×'.join(map(str, a.shape))}" for k, a in arrays.items() if a.size > 1]
    return _shortened(entries)


def _shortened(entries: list[str], most: int = LISTED) -> str:
    more = f" and {len(entries) - most} more" if len(entries) > most else ""
    return (", ".join(entries[:most]) or "nothing") + more


# --- structs and groups ---------------------------------------------------------------------------------


def _flatten(content: Content) -> dict[str, Array | LeftOut]:
    """Turn structs, groups and named fields into dotted names: ``data.theta``."""
    flat = dict(walk(content, ""))
    alone = len({k.split(".")[0] for k in flat}) == 1 and len(flat) > 1  # one struct holds all: its name adds nothing
    return {k.split(".", 1)[1]: a for k, a in flat.items()} if alone else flat


def walk(content: Content, prefix: str) -> Iterator[tuple[str, Array | LeftOut]]:
    """What lies in structs and groups, each under the names that lead to it."""
    for key, item in content.items():
        name = f"{prefix}{key}"
        inner = _fields(item)
        if inner is not None:
            yield from walk(inner, f"{name}.")
        else:
            yield name, _numeric(item)


def _fields(item: Any) -> Content | None:
    if isinstance(item, list):
        return _signals(item)
    if isinstance(item, Mapping):
        return item
    names = getattr(getattr(item, "dtype", None), "names", None)
    return {name: item[name] for name in names} if names else None


def _signals(structs: list[Content]) -> Content | None:
    """The signals of a Simulink "Structure With Time", an array of structs with values and label, by their labels."""
    if not all("values" in s for s in structs):
        return None
    labels = [str(getattr(s.get("label"), "text", "")).strip() for s in structs]
    names = [n if n.isidentifier() and labels.count(n) == 1 else f"signal{k}" for k, n in enumerate(labels, 1)]
    return dict(zip(names, (s["values"] for s in structs), strict=True))


def _numeric(item: Any) -> Array | LeftOut:
    """Return what can be a column or a matrix of them, dates as seconds, or why it cannot."""
    if isinstance(item, LeftOut):
        return item
    if isinstance(item, list):
        return LeftOut(f"is an array of {len(item)} structs")
    array: Array = seconds(item) if item.dtype.kind in "mM" else item
    if array.dtype.kind not in "fiub":
        return LeftOut(f"is of type {ascii_short(str(array.dtype))[1:-1]}")
    if array.size == 0:
        return EMPTY
    if np.squeeze(array).ndim > 2:
        return LeftOut(f"has {np.squeeze(array).ndim} dimensions; save one vector for each signal")
    return array if array.ndim else array.reshape(1)


# --- a matrix -------------------------------------------------------------------------------------------


def _columns(array: Array) -> list[tuple[str, Array]]:
    """A matrix with time downwards: its longer axis; of a square, the one that has a clock."""
    values = np.squeeze(array)
    rows, columns = values.shape
    sideways = rows < columns or (rows == columns and _increases(values.T) and not _increases(values))
    return [(f"column {j}", column) for j, column in enumerate(values if sideways else values.T)]


def _increases(values: Any) -> bool:
    with np.errstate(invalid="ignore"):
        return bool(np.any(np.all(values[1:] > values[:-1], axis=0)))
