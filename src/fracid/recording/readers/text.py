r"""Numbers from text files of any dialect.

A text recording is: comments, perhaps a line of names, perhaps a line of units, then rows
of numbers.  The dialect is found by trial rather than by rule: each pair (delimiter,
decimal sign) of ``DIALECTS`` splits a sample of the lines, and the one under which most of
them are numbers with one common count of fields wins; a header of the same count breaks
ties.  So ``1,5;2,5`` is two numbers with a decimal comma and ``1,5`` is two integers,
unless a header of one name says that it is one number.  Quotes decide: ``"1,5","2,5"`` is
two numbers.  A date and time, ``2024-01-31 12:00:00.5`` or ``31.1.2024 12:00:00``, is seconds; the first number of one
that has no year in front is the day, unless it cannot be in all rows.

Comment lines begin with ``#``, ``%`` or ``//``.  Blank cells, ``nan``, ``na`` and ``null``
are missing samples (NaN).  A column of words alone, such as ``frame_id``, is left out; text among the numbers is an
error that names line and column.
What a person would read without a second thought is read, and said: UTF-16, old Latin-1,
decimal commas.  What could be meant in two ways is refused: rows of two dialects, a comma
that is both separator and decimal sign.

A file is read line by line, twice: once for its encoding and a sample of its lines, once
for its numbers, so that 10⁷ rows take no more memory than twice their numbers.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from io import TextIOWrapper
from itertools import chain, islice, product
from pathlib import Path

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import DataError
from fracid.recording.readers.arrays import Table, is_unit, name_and_unit
from fracid.recording.readers.content import DATES, NO_NUMBERS, SAYS, seconds_of_stamp
from fracid.safety.door import opened
from fracid.safety.text import ascii_short

BLANK = frozenset({"", "nan", "-nan", "na", "n/a", "null", "none", "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#ind"})
"""The last four are how Windows writes NaN."""

COMMENT = ("#", "%", "//")

NUMBER = {
    decimal: re.compile(rf"[+-]?(?:[0-9]++(?:{sign}[0-9]*)?|{sign}[0-9]++)(?:e[+-]?[0-9]++)?|[+-]?inf(?:inity)?", re.I)
    for decimal, sign in ((".", r"\."), (",", "(?:,(?=[0-9]))"))
}
"""A number as an instrument writes it, by its decimal sign.  No digit can be matched in two ways, so that a line of ten
thousand of them takes no longer than to read it."""

THOUSANDS = re.compile(
    r"(?<![\w.:])[1-9][0-9]{0,2}([,.'’ \u00a0\u202f])[0-9]{3}(?:\1[0-9]{3})*(?:[.,][0-9]+)?(?!\w| [^\W\d])"
)
"""A number with a separator between its thousands, and no unit."""

WHOLE = re.compile(r"[+-]?[0-9]+")

QUOTED = re.compile(r'(?<![^\n,;|\t ])"(?:[^"]|"")*"')
"""A cell in quotes, which may have ends of lines."""

NUMERAL = re.compile(r"(?:.*[,;|\t])?[^\w,;|\t]*[0-9]|[+-]?inf", re.I)
"""How a number begins, whatever is wrong with it, also behind a delimiter: ``s;0,5`` is no word."""

SEPARATOR = re.compile('"?sep=.?"?', re.I)
"""A line for Excel above a table."""

GROUPED = 20
"""Numbers of a column that may be thousands: fewer with three digits behind the point are decimals."""

MOST_COLUMNS = 10_000
"""Cells in a line beyond which a file is no table of samples."""

MARKS = {"utf-32": (codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE), "utf-16": (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)}
"""How texts of more than a byte a letter begin: UTF-32 first, which begins as UTF-16 does, too."""

CHUNK = 2**20
"""Read at a time [bytes]."""

BLOCK = 10_000
"""Rows that are made numbers at a time."""

SAMPLE = 2**16
"""Of the text by which the dialect is found [characters]; at least five lines."""


@dataclass(frozen=True)
class Dialect:
    """How a line is cut into numbers."""

    delimiter: str | None
    """None is white space of any length."""
    decimal: str
    """``.`` or ``,``."""
    date: str = ""
    """In which order a date is written, where that and a time count as numbers."""
    left_out: frozenset[int] = frozenset()
    """Columns of words alone."""

    def split(self, line: str) -> list[str]:
        """Cut a line into cells without their quotes and blanks, and without columns of words."""
        line = line.strip("\r\n ")
        cells = line.split(self.delimiter)
        if '"' in line and self.delimiter:
            with suppress(csv.Error):  # a cell of more than 131,072 characters is none that was quoted for its commas
                cells = next(csv.reader([line], delimiter=self.delimiter, skipinitialspace=True))
        return [cell.strip().strip('"').strip() for j, cell in enumerate(cells) if j not in self.left_out]

    def number(self, cell: str) -> float:
        """Return the number of a cell that holds one, NaN of one that is blank."""
        if cell.lower() in BLANK:
            return float("nan")
        if self.date and (stamp := seconds_of_stamp(cell, self.date)) is not None:
            return stamp
        return float(cell.replace(",", "."))

    def is_number(self, cell: str) -> bool:
        """Tell whether the cell holds a number and is not blank; Python's float takes 1_000 and ١٢ as well."""
        stamp = self.date and seconds_of_stamp(cell, self.date) is not None
        return bool(stamp) or NUMBER[self.decimal].fullmatch(cell) is not None

    def cuts_into_numbers(self, line: str) -> bool:
        """Tell whether a line is several numbers and nothing else."""
        cells = self.split(line)
        return 1 < len(cells) <= MOST_COLUMNS and all(map(self.is_number, cells))

    def __str__(self) -> str:
        """In words."""
        cut = {None: "blanks", "\t": "tabs", ",": "commas", ";": "semicolons", "|": "bars"}[self.delimiter]
        return f"cells between {cut}, decimal {'comma' if self.decimal == ',' else 'point'}"


DIALECTS = tuple(
    Dialect(delimiter, decimal, date)
    for date in ("", *DATES)
    for delimiter, decimal in [(",", "."), (";", ","), (";", "."), ("\t", "."), ("\t", ","), (None, "."), (None, ","),
                               ("|", "."), ("|", ","), (",", ",")]
)  # fmt: skip
"""The first under which most lines are numbers is taken; the last one needs quotes, for it is the first without."""


@dataclass(frozen=True)
class _Lines:
    """A text that can be read more than once, and some of its lines."""

    name: str
    """Of the file, for messages."""
    read: Callable[[], Iterable[str]]
    """All lines, with or without their ends."""
    sample: list[str]
    """From everywhere in the text."""
    tail: str
    """What stands after the last end of a line."""

    def rows(self) -> Iterator[tuple[int, str]]:
        """Return (number from 1, line) of those that are neither blank nor comments."""
        return ((i, line) for i, line in enumerate(self.read(), 1) if _counts(line))


def _counts(line: str) -> bool:
    return not line.isspace() and line != "" and not line.lstrip().startswith(COMMENT)


# --- from bytes to lines --------------------------------------------------------------------------------


def read_text(path: Path) -> Table:
    """Read a file of text, whatever its encoding, line ends and dialect.

    Raises
    ------
    DataError
        As :func:`parse_text`, and if the file is no text: zero bytes, or cut off in the middle of a character.
    """
    encoding, notes = _encoding(path)
    try:
        sample, tail = _sample(path, encoding)
    except UnicodeError:
        if encoding != "utf-8-sig":
            raise DataError(SAYS("other-encoding", path=path, encoding=encoding.upper())) from None
        encoding, notes = "latin-1", ("The text is not UTF-8: read as Latin-1.",)  # as which anything can be read
        sample, tail = _sample(path, encoding)

    def read() -> Iterator[str]:
        with TextIOWrapper(opened(path), encoding) as file:
            yield from file

    table = _parse(_Lines(path.name, read, sample, tail))
    return replace(table, notes=(*notes, *table.notes))


def _encoding(path: Path) -> tuple[str, tuple[str, ...]]:
    """Return the encoding, and a sentence where it is not the usual one."""
    with opened(path) as file:
        start = file.read(4096)
    for encoding, marks in MARKS.items():
        if start.startswith(marks):
            return encoding, (f"The text is {encoding.upper()}.",)
    even, odd = start[0::2], start[1::2]
    for zeros, others, encoding in ((odd, even, "utf-16-le"), (even, odd, "utf-16-be")):
        if len(start) > 8 and zeros.count(0) > 0.9 * len(zeros) and 0 not in others:
            return encoding, ("The text is UTF-16 without a mark that says so.",)
    if b"\0" in start:
        raise DataError(f"{path.name} is not text: it holds zero bytes. Is it a binary file with a wrong ending?")
    return "utf-8-sig", ()


def _sample(path: Path, encoding: str) -> tuple[list[str], str]:
    """Return lines from everywhere in a file that count, and what stands after the last end of a line."""
    lines: list[str] = []
    tail, lines_before = "", 0
    with TextIOWrapper(opened(path), encoding) as file:
        while chunk := file.read(CHUNK):
            if "\0" in chunk:
                line = lines_before + chunk[: chunk.index("\0")].count("\n") + 1
                raise DataError(SAYS("zero-bytes", path=path, line=line))
            before, end, rest = chunk.rpartition("\n")
            lines += filter(_counts, before.split("\n", 20)[1:-1] if lines else before.split("\n"))
            lines_before, tail = lines_before + chunk.count("\n"), rest if end else tail + rest
    return [*lines, *filter(_counts, [tail])], tail


def parse_text(text: str, name: str = "text") -> Table:
    r"""Parse the text of a recording.

    Parameters
    ----------
    text : str
        The file's content.
    name : str
        The file's name, for messages.

    Returns
    -------
    Table

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
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return _parse(_Lines(name, lambda: lines, [*filter(_counts, lines)], lines[-1]))


# --- from lines to numbers ------------------------------------------------------------------------------


def _parse(lines: _Lines) -> Table:
    if not lines.sample and not any(True for line in lines.read() if line.strip()):
        raise DataError(SAYS("empty", name=lines.name))
    dialect, width = _sniff(lines)
    first = next((i for i, line in lines.rows() if _is_row(dialect, width, line)), None)
    if first is None:
        raise DataError(_no_row(lines))
    above = "\n".join(map(str.strip, islice(lines.read(), first - 1)))
    joined = QUOTED.sub(lambda cell: " ".join(cell[0].split()), above)  # a name may have ends of lines
    header = [line for line in joined.split("\n") if line and not SEPARATOR.fullmatch(line)]
    _refuse_comma_twice(dialect, width, header, lines)
    remarks = _numbers_in_header(dialect, width, header, lines.name)
    names, units = _names(dialect, width, header, lines.name)
    every, count = replace(dialect, left_out=frozenset()), width + len(dialect.left_out)
    others = _names(every, count, header, lines.name)[0] if dialect.left_out else ()
    left_out = {others[j] or f"column {j}": NO_NUMBERS.why for j in sorted(dialect.left_out)}
    values = _numbers(dialect, width, lines, first, names=names)
    _refuse_thousands(dialect, width, lines, values, names=names)
    if width > 1 and not names[-1] and np.isnan(values[:, -1]).all():  # a delimiter at each line's end
        values = values[:, :-1]
        names, units = (names[:-1], units[:-1]) if any(names) else _names(dialect, width - 1, header, lines.name)
    notes = [*remarks, *_doubts(dialect, width, header, names, lines=lines)]
    if dialect.decimal == ",":
        notes.insert(0, "Its numbers have decimal commas.")
    names, units = zip(*map(name_and_unit, names, units, range(len(names))), strict=True)
    return Table(values, names, units, lines.name, header=tuple(header), notes=tuple(notes), left_out=left_out)


def _is_row(dialect: Dialect, width: int, line: str) -> bool:
    """Tell whether a line is `width` cells, at least one a number and the rest numbers or blank."""
    cells = dialect.split(line)
    return len(cells) == width and any(map(dialect.is_number, cells)) and not _text_cells(dialect, cells)


def _text_cells(dialect: Dialect, cells: list[str]) -> list[int]:
    return [j for j, cell in enumerate(cells) if not dialect.is_number(cell) and cell.lower() not in BLANK]


def _sniff(lines: _Lines) -> tuple[Dialect, int]:
    """Return the dialect, and its count of cells, under which most of a sample of lines are numbers."""
    mean = sum(map(len, lines.sample)) / max(1, len(lines.sample))
    most = min(200, max(5, int(SAMPLE / max(1.0, mean))))
    sample = lines.sample[:: max(1, len(lines.sample) // most)][-most:]
    best, best_score = (DIALECTS[5], 1), (-1, False)
    worded = (replace(d, left_out=words) for d in DIALECTS if (words := _words(d, [*map(d.split, sample)])))
    for dialect in (*DIALECTS, *worded):
        rows = [dialect.split(line) for line in sample]
        if max(map(len, rows), default=0) > MOST_COLUMNS:
            raise DataError(SAYS("wide-line", lines=lines, cells=max(map(len, rows)), MOST_COLUMNS=MOST_COLUMNS))
        counts = Counter(len(c) for c in rows if any(map(dialect.is_number, c)) and not _text_cells(dialect, c))
        for width, hits in counts.most_common(1):
            first = (dialect.split(line) for line in lines.sample[:5])
            titled = any(len(cells) == width and len(_text_cells(dialect, cells)) == width for cells in first)
            if (hits, titled) > best_score:
                best, best_score = (dialect, width), (hits, titled)
    return best


def _words(dialect: Dialect, rows: list[list[str]]) -> frozenset[int]:
    """Columns of words alone: no cell beside numbers is one, or begins like one, or has one behind a delimiter."""
    rows = [cells for cells in rows if any(map(dialect.is_number, cells))]
    width = Counter(map(len, rows)).most_common(1)[0][0] if rows else 0
    columns = zip(*(cells for cells in rows if len(cells) == width), strict=True)
    texts = ([cell for cell in cells if cell.lower() not in BLANK] for cells in columns)
    return frozenset(j for j, cells in enumerate(texts) if cells and not any(map(NUMERAL.match, cells)))


def _no_row(lines: _Lines) -> str:
    """Return why there is no row: the first cell of a line from the middle that is no number."""
    if not lines.sample:
        return f"{lines.name} holds no row of numbers: all its lines are comments."
    line = lines.sample[len(lines.sample) // 2]
    number = next((i for i, other in enumerate(lines.read(), 1) if other.rstrip("\r\n") == line.rstrip("\r\n")), 0)
    cure = _thousands(line) or SAYS("expected")
    return SAYS("no-numbers", lines=lines, number=number, text=ascii_short(line.strip()), cure=cure)


def _thousands(text: str) -> str:
    """What to write for numbers of a text that have their thousands separated; "" where there are none."""
    signs = {found[1]: found[0] for found in reversed([*THOUSANDS.finditer(text)])}
    if len(signs) > 1:
        return SAYS("either-thousands", numbers=" or ".join(map(ascii_short, reversed(signs.values()))))
    return "".join(SAYS("thousands", number=ascii_short(n), plain=n.replace(sign, "")) for sign, n in signs.items())


# --- the header -----------------------------------------------------------------------------------------


def _numbers_in_header(dialect: Dialect, width: int, header: list[str], file: str) -> list[str]:
    """Refuse rows of another dialect above the numbers; one or two lines may be a logger's settings, and are said."""
    lines = (line for line in header if not line.startswith(COMMENT))
    rows = [(line, other) for line, other in product(lines, DIALECTS) if other.cuts_into_numbers(line)]
    count = len({line for line, _ in rows})
    if count > 2:
        raise DataError(SAYS("two-kinds", file=file, count=count, first=ascii_short(rows[0][0]), count_first=rows[0][1],
                             width=width, s='s' * (width != 1), dialect=dialect))  # fmt: skip
    return [_left_out([*dict(rows)], "numbers")] if rows else []


def _left_out(lines: list[str], of: str) -> str:
    count = f"{len(lines)} lines of {of} were" if len(lines) > 1 else f"a line of {of} was"
    return f"Above the table {count} left out: {ascii_short(lines[0])}."


def _is_setting(dialect: Dialect, width: int, line: str) -> bool:
    """Tell whether a line above the numbers is a word and numbers, ``x-axis,1,2``, as instruments write settings."""
    first, *cells = dialect.split(line)
    word = first and not NUMERAL.match(first) and not line.startswith(COMMENT)
    return bool(word) and width == len(cells) + 1 and any(map(dialect.is_number, cells))


def _names(dialect: Dialect, width: int, header: list[str], file: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return names and units: the last header line of `width` words that are no units, and the one under it."""
    split = [dialect.split(line.lstrip("#%/ ") if line.startswith(COMMENT) else line) for line in header]
    split = [cells[:width] if {*map(str.lower, cells[width:])} <= {"", "comment"} else cells for cells in split]
    beside = [line.startswith(COMMENT) or _is_setting(dialect, width, line) for line in header]
    for line, cells, passed_over in zip(header, split, beside, strict=True):
        texts = _text_cells(dialect, cells)
        plain = any(map(NUMBER[dialect.decimal].fullmatch, cells))
        if 0 < len(texts) < width == len(cells) and plain and not passed_over:
            cell = cells[texts[0]]
            raise DataError(SAYS("not-a-number", file=file, text=ascii_short(cell), column=texts[0],
                                 row=ascii_short(line), cure=_thousands(cell) or SAYS("correct")))  # fmt: skip
    titles = {k: cells for k, cells in enumerate(split) if len(cells) == width and _text_cells(dialect, cells)}
    # a comment, or a setting, is a header only where nothing better is: prose has commas too
    titles = {k: cells for k, cells in titles.items() if not beside[k]} or titles
    if width == 1:  # a list of names is not that of one column
        titles = {k: cells for k, cells in titles.items() if not re.search(r"[,;|\t]", cells[0])}
    blank, whole = ("",) * width, {k: cells for k, cells in titles.items() if all(cells)} or titles
    named = [k for k, cells in whole.items() if not any(map(is_unit, cells))] or [*whole][:1]
    last = named[-1] if named else -2
    names = tuple(titles.get(last, blank))
    return names, names if all(map(is_unit, names)) else tuple(titles.get(last + 1, blank))


def _doubts(dialect: Dialect, width: int, header: list[str], names: tuple[str, ...], lines: _Lines) -> Iterator[str]:
    """That a header was passed over for its count of names, and that the last number may have lost its end."""
    cells = dialect.split(header[-1]) if header and not any(names) and not header[-1].startswith(COMMENT) else []
    if 1 < len(cells) == len(_text_cells(dialect, cells)):
        yield f"The header has {len(cells)} names and the rows {width} cells: columns are called by their position."
    if settings := [line for line in header if _is_setting(dialect, width, line)]:
        yield _left_out(settings, "a word and numbers")
    if dialect.date in ("dmy", "mdy"):
        yield f"Dates are read as {DATES[dialect.date]}."
    others, end = lines.sample[-200:-1], lines.tail
    if end.strip() and len(others) >= 4 and len(end) < min(map(len, others)):
        yield f"The last line, {ascii_short(end.strip())}, has no end: its last number may have been cut off."


def _refuse_comma_twice(dialect: Dialect, width: int, header: list[str], lines: _Lines) -> None:
    """``t,alpha`` above ``0,01,1,5``, or ``10,1,5``: the comma separates the cells, and is in them."""
    rows = map(dialect.split, reversed(header))
    last: list[str] = next((cells for cells in rows if not all(map(dialect.is_number, cells))), [])
    samples = (row for row in map(dialect.split, lines.sample[-200:]) if len(row) == width)
    twice = width == 2 * len(last) or (len(last) < width < 2 * len(last) and all(map(WHOLE.fullmatch, chain(*samples))))
    if dialect == DIALECTS[0] and twice and len(_text_cells(dialect, last)) == len(last):
        raise DataError(SAYS("names-above", file=lines.name, cells=len(last), width=width))


def _refuse_thousands(dialect: Dialect, width: int, lines: _Lines, values: FloatArray, names: tuple[str, ...]) -> None:
    """``12.345`` beside ``987``: three digits behind each sign, none of it below 1, nothing above 999 without one."""
    values = np.clip(np.nan_to_num(values), -1e9, 1e9)
    decimals, thousandths = values != np.round(values), values == np.round(values, 3)
    maybe = decimals.any(axis=0) & np.all(~decimals | (thousandths & (np.abs(values) > 1)), axis=0)
    for j in np.flatnonzero(maybe).tolist():
        column = (cells[j] for cells in map(dialect.split, lines.sample) if len(cells) == width)
        numbers = {cell.lstrip("+-") for cell in column if dialect.is_number(cell)}
        grouped = {cell for cell in numbers if dialect.decimal in cell}
        longest = max(map(len, numbers - grouped), default=4)
        if len(grouped) >= GROUPED and all(map(THOUSANDS.fullmatch, grouped)) and longest < 4:
            plain = min(grouped).replace(dialect.decimal, "")
            raise DataError(SAYS("two-meanings", file=lines.name, column=_column(j, names), number=min(grouped),
                                 plain=plain))  # fmt: skip


# --- the numbers ----------------------------------------------------------------------------------------


def _numbers(dialect: Dialect, width: int, lines: _Lines, first: int, names: tuple[str, ...]) -> FloatArray:
    """Parse the rows from line `first` on, block by block."""
    rows = ((i, line) for i, line in lines.rows() if i >= first)
    blocks = iter(lambda: list(islice(rows, BLOCK)), [])
    return np.concatenate([_block(dialect, width, block, names, file=lines.name) for block in blocks])


def _block(dialect: Dialect, width: int, rows: list[tuple[int, str]], names: tuple[str, ...], file: str) -> FloatArray:
    """Parse some rows: by NumPy where every cell is a plain number, cell by cell otherwise."""
    texts = [line.replace(",", ".") if dialect.decimal == "," else line for _, line in rows]
    points = dialect.decimal == "," and any("." in line for _, line in rows)
    if not (points or dialect.date or dialect.left_out or dialect.delimiter == dialect.decimal):
        with suppress(ValueError):
            values = np.loadtxt(texts, delimiter=dialect.delimiter, comments=None, quotechar='"', ndmin=2)
            if values.shape == (len(rows), width):
                return values
    return np.array([_row(dialect, width, i, line, names=names, file=file) for i, line in rows])


def _row(dialect: Dialect, width: int, i: int, line: str, names: tuple[str, ...], file: str) -> list[float]:
    cells = dialect.split(line)
    if any(names) and tuple(cells) == names:
        raise DataError(SAYS("header-again", file=file, i=i))
    if len(cells) != width:
        raise DataError(SAYS("cells", file=file, i=i, count=len(cells), s='s' * (len(cells) != 1), width=width,
                             text=ascii_short(line.strip())))  # fmt: skip
    for j in _text_cells(dialect, cells):
        raise DataError(SAYS("text-in-row", file=file, i=i, column=_column(j, names), text=ascii_short(cells[j]),
                             cure=_thousands(cells[j]) or SAYS("correct")))  # fmt: skip
    return [dialect.number(cell) for cell in cells]


def _column(j: int, names: tuple[str, ...]) -> str:
    return f"column {j} ({ascii_short(names[j])[1:-1]})" if names[j] else f"column {j}"
