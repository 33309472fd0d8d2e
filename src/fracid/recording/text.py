r"""Numbers from text files of any dialect.

A text recording is: comments, perhaps a line of names, perhaps a line of units, then rows
of numbers.  The dialect is found by trial rather than by rule: each pair (delimiter,
decimal sign) of ``DIALECTS`` splits a sample of the lines, and the one under which most of
them are numbers with one common count of fields wins; a header of the same count breaks
ties.  So ``1,5;2,5`` is two numbers with a decimal comma and ``1,5`` is two integers,
unless a header of one name says that it is one number.

Comment lines begin with ``#``, ``%`` or ``//``.  Blank cells, ``nan``, ``na`` and ``null``
are missing samples (NaN).  Text among the numbers is an error that names line and column.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fracid.errors import DataError

__all__ = ["DIALECTS", "Dialect", "TextTable", "parse_text", "read_text"]

BLANK = frozenset({"", "nan", "na", "n/a", "null", "none"})
COMMENT = ("#", "%", "//")


@dataclass(frozen=True)
class Dialect:
    """How a line is cut into numbers."""

    delimiter: str | None
    """None is white space of any length."""
    decimal: str
    """``.`` or ``,``."""

    def split(self, line: str) -> list[str]:
        """Cut a line into cells without their quotes and blanks."""
        return [cell.strip().strip('"').strip() for cell in line.strip("\r\n ").split(self.delimiter)]

    def number(self, cell: str) -> float:
        """Return the cell's number, NaN where it is blank; ValueError where it is text."""
        if cell.lower() in BLANK:
            return float("nan")
        if self.decimal == ",":
            if "." in cell or cell.endswith(","):
                raise ValueError(cell)
            cell = cell.replace(",", ".")
        if "_" in cell:  # Python reads 1_000 as a number; no instrument writes it
            raise ValueError(cell)
        return float(cell)

    def is_number(self, cell: str) -> bool:
        """Tell whether the cell holds a number and is not blank."""
        try:
            self.number(cell)
        except ValueError:
            return False
        return cell.lower() not in BLANK


DIALECTS = tuple(
    Dialect(delimiter, decimal)
    for delimiter, decimal in [
        (",", "."),
        (";", ","),
        (";", "."),
        ("\t", "."),
        ("\t", ","),
        (None, "."),
        (None, ","),
    ]
)


@dataclass(frozen=True)
class TextTable:
    """What a text file holds."""

    values: NDArray[np.float64]
    """Shape (n_rows, n_columns), NaN where a cell is blank."""
    names: tuple[str, ...]
    """From the header, empty strings without one."""
    units: tuple[str, ...]
    """From a line of units under the names, empty strings without one."""
    header: tuple[str, ...]
    """Every line before the numbers, as it stands in the file."""


def read_text(path: Path) -> TextTable:
    """Read a file of text, whatever its encoding, line ends and dialect."""
    return parse_text(_decode(path.read_bytes(), path), path.name)


def _decode(raw: bytes, path: Path) -> str:
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16")
    if b"\0" in raw[:4096]:
        raise DataError(f"{path.name} is not text: it holds zero bytes. Is it a binary file with a wrong ending?")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # an old logger's degree sign


def parse_text(text: str, name: str = "text") -> TextTable:
    r"""Parse the text of a recording.

    Parameters
    ----------
    text : str
        The file's content.
    name : str
        The file's name, for messages.

    Returns
    -------
    TextTable

    Raises
    ------
    DataError
        The text is empty, holds no row of numbers, a row with another count of cells, or
        text in a numeric column; the message says in which line and column.

    Examples
    --------
    >>> parse_text("t;angle\n0,0;1,5\n0,1;1,25\n").values
    array([[0.  , 1.5 ], [0.1 , 1.25]])
    """
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not lines:
        raise DataError(f"{name} is empty. A recording needs at least two rows of numbers.")
    rows = [(i, line) for i, line in lines if not line.lstrip().startswith(COMMENT)]
    dialect, width = _sniff([line for _, line in rows])
    first = next((k for k, (_, line) in enumerate(rows) if _is_row(dialect, width, line)), None)
    if first is None:
        raise DataError(f"{name} holds no row of numbers; its first line is {lines[0][1].strip()[:60]!r}.")
    start = rows[first][0]
    header = [line.strip() for i, line in lines if i < start]
    names, units = _names(dialect, width, header, name)
    return TextTable(_numbers(dialect, width, rows[first:], names, name), names, units, tuple(header))


def _is_row(dialect: Dialect, width: int, line: str) -> bool:
    """Tell whether a line is `width` cells, at least one a number and the rest numbers or blank."""
    cells = dialect.split(line)
    return len(cells) == width and any(map(dialect.is_number, cells)) and not _text_cells(dialect, cells)


def _text_cells(dialect: Dialect, cells: list[str]) -> list[int]:
    return [j for j, cell in enumerate(cells) if cell.lower() not in BLANK and not dialect.is_number(cell)]


def _sniff(lines: list[str]) -> tuple[Dialect, int]:
    """Return the dialect, and its count of cells, under which most of a sample of lines are numbers."""
    sample = lines[:: max(1, len(lines) // 200)][-200:]
    best, best_score = (DIALECTS[5], 1), (-1, False)
    for dialect in DIALECTS:
        rows = [cells for cells in map(dialect.split, sample) if any(map(dialect.is_number, cells))]
        counts = Counter(len(cells) for cells in rows if not _text_cells(dialect, cells))
        if not counts:
            continue
        width, hits = counts.most_common(1)[0]
        titled = any(
            len(cells) == width and len(_text_cells(dialect, cells)) == width for cells in map(dialect.split, lines[:5])
        )
        if (hits, titled) > best_score:
            best, best_score = (dialect, width), (hits, titled)
    return best


def _names(dialect: Dialect, width: int, header: list[str], file: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return names and units: the first header line of `width` words, rather no comment, and the one under it."""
    split = [dialect.split(line.lstrip("#%/ ") if line.startswith(COMMENT) else line) for line in header]
    for line, cells in zip(header, split, strict=True):
        texts = _text_cells(dialect, cells)
        if 0 < len(texts) < width == len(cells) and any(map(dialect.is_number, cells)) and line[0] not in "#%/":
            raise DataError(
                f"{file}: {cells[texts[0]]!r} in column {texts[0]} of the line {line[:60]!r} is not a number."
            )
    blank = ("",) * width
    titles = [k for k, cells in enumerate(split) if len(cells) == width and _text_cells(dialect, cells)]
    # a comment is a header only where nothing better is: prose has commas too
    titles = [k for k in titles if not header[k].startswith(COMMENT)] or titles
    if not titles:
        return blank, blank
    below = any(b == a + 1 for a, b in pairwise(titles[:2]))
    return tuple(split[titles[0]]), tuple(split[titles[1]]) if below else blank


def _numbers(
    dialect: Dialect, width: int, rows: list[tuple[int, str]], names: tuple[str, ...], file: str
) -> NDArray[np.float64]:
    """Parse the rows: by NumPy where every cell is a plain number, cell by cell otherwise."""
    lines = [line.replace(",", ".") if dialect.decimal == "," else line for _, line in rows]
    try:
        values = np.loadtxt(lines, delimiter=dialect.delimiter, comments=None, ndmin=2)
    except ValueError:
        values = np.empty((0, 0))
    if values.shape == (len(rows), width):
        return values
    return np.array([_row(dialect, width, i, line, names, file) for i, line in rows])


def _row(dialect: Dialect, width: int, i: int, line: str, names: tuple[str, ...], file: str) -> list[float]:
    cells = dialect.split(line)
    if len(cells) != width:
        raise DataError(
            f"{file}, line {i}: {len(cells)} cells where other lines have {width} ({line.strip()[:60]!r}). "
            "Was the line cut off while it was written? Complete or delete it."
        )
    for j in _text_cells(dialect, cells):
        column = f"column {j} ({names[j]})" if names[j] else f"column {j}"
        raise DataError(f"{file}, line {i}, {column}: {cells[j]!r} is not a number. Correct it or leave it blank.")
    return [dialect.number(re.sub(r"^\+", "", cell)) for cell in cells]
