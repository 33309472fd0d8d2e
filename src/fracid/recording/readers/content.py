"""What a file may hold beside numbers, and how much of it is taken.

A reader gives a file's content as named arrays, in structs and groups as the file has them.  What is no array of
real numbers stands there as :class:`LeftOut`, with the reason and what to do about it, so that who asks for it is told.

A few bytes may unpack to any number of zeros.  So a file gives :func:`most_numbers` at the most, eight for each of its
bytes: more than any recording has, and the memory that reading takes is bounded by the size of the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.errors import DataError
from fracid.findings import Words
from fracid.safety.text import printable

SAYS = Words("recording/readers/text.toml")

FEW_NUMBERS = 2**22
"""Any file may unpack to so many."""

NUMBERS_A_BYTE = 8
"""Packed by gzip, the clock of a recording alone needs a byte a sample."""

DEEPEST = 32
"""Structs within structs, groups within groups."""


@dataclass(frozen=True)
class LeftOut:
    """What stands in a file and is no array of real numbers."""

    why: str
    """Goes on after its name: ``is complex; save its real part …``."""
    text: str = ""
    """Its letters, where it is a text."""


Content = Mapping[str, "NDArray[np.generic] | LeftOut | Content | list[Content]"]
"""By name; a list is an array of structs."""

COMPLEX = LeftOut("is complex; save its real part, or real and imaginary part as two arrays")

EMPTY = LeftOut("is empty")

SPARSE = LeftOut("is a sparse matrix; save full(…) of it")

TEXT = LeftOut("is text")

NO_NUMBERS = LeftOut("is no column of numbers")

LISTS = LeftOut("holds a list of numbers for each sample; save one number for each")


def why_no_numbers(kind: str) -> LeftOut | None:
    """Why an array of a kind of NumPy's is none of real numbers: it is complex, or text; None for any other.

    Examples
    --------
    >>> why_no_numbers("U") is TEXT, why_no_numbers("f")
    (True, None)
    """
    return {"c": COMPLEX, "S": TEXT, "U": TEXT, "O": TEXT}.get(kind)


def same_name(count: int) -> LeftOut:
    """Say that a name means nothing: which of them is meant nobody knows."""
    return LeftOut(f"is the name of {count}; give each its own")


def most_numbers(size: int) -> int:
    """Return how many numbers a file of so many bytes may unpack to.

    Examples
    --------
    >>> most_numbers(1000), most_numbers(10**9)
    (4194304, 8000000000)
    """
    return max(FEW_NUMBERS, NUMBERS_A_BYTE * size)


def refuse_bomb(path: Path, numbers: float) -> None:
    """Refuse a file that unpacks to more numbers than a recording of its size has.

    Raises
    ------
    DataError
        With both figures.
    """
    size = path.stat().st_size
    if numbers > most_numbers(size):
        raise DataError(SAYS("unpacks", path=path, size=size, most=most_numbers(size)))


@dataclass
class Tally:
    """What was read of a file so far."""

    path: Path
    numbers: float = 0.0

    def add(self, more: float) -> None:
        """Refuse what is too much, alone or with what came before it."""
        self.numbers += more
        refuse_bomb(self.path, self.numbers)


def damaged(path: Path, kind: str, what: object) -> DataError:
    """Return the error of a file that is not what its ending says, with a library's own words in short.

    Examples
    --------
    >>> str(damaged(Path("a.npy"), "NumPy file", "no header"))
    'a.npy is damaged or is no NumPy file (no header). Save it again.'
    """
    words = " ".join(str(what).replace(str(path), path.name).split()).rstrip(".") or type(what).__name__
    return DataError(f"{path.name} is damaged or is no {kind} ({printable(words)[:120]}). Save it again.")


@contextmanager
def reading(path: Path, kind: str, own: tuple[type[Exception], ...] = (DataError,)) -> Iterator[None]:
    """Whatever a library says of a file, all but `own` errors, means that the file is damaged.

    Each has its own errors for one damage or another: OSError, ValueError, KeyError, TypeError, SyntaxError, …

    Raises
    ------
    DataError
    """
    try:
        yield
    except own:
        raise
    except Exception as error:
        raise damaged(path, kind, error) from None


def seconds(dates: NDArray[np.generic]) -> FloatArray:
    """Return dates and spans of time, of NumPy's types M and m, as numbers [s]; NaN where there is none.

    Examples
    --------
    >>> seconds(np.array(["1970-01-01T00:01", "NaT"], dtype="M8[ms]"))
    array([60., nan])
    """
    spans: Any = dates - np.datetime64(0, "s") if dates.dtype.kind == "M" else dates  # type: ignore[operator]
    return np.asarray(spans / np.timedelta64(1, "s"), dtype=np.float64)


STAMP = re.compile(
    r"(?P<date>[0-9]{1,4}([-/.])[0-9]{1,2}\2[0-9]{1,4})?[T ]?"
    r"(?:(?P<hour>[0-9]{1,2})(?P<time>:[0-9]{2}:[0-9]{2}(?:[.,][0-9]{1,12})?)"
    r"(?: ?(?P<half>[AP]M))?(?P<zone>Z|[+-][0-9]{2}:?[0-9]{2})?(?: ?(?:UTC|GMT))?)?",
    re.I,
)
"""A date, a time of day, or both, as ISO 8601 has them; the time also with AM or PM, and UTC behind it."""

DATES = {"ymd": "year, month, day", "dmy": "day, month, year", "mdy": "month, day, year"}
"""Orders in which dates are written, and in words."""

MINUTES = re.compile(r"([0-9]{1,3}):([0-5][0-9][.,][0-9]{1,12})")
"""Minutes and seconds, as spreadsheets show a time that is below one."""

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def seconds_of_stamp(text: str, date: str = "ymd") -> float | None:
    """Return a date and time as seconds since 1970, of a time alone since midnight; None for what is neither.

    Examples
    --------
    >>> seconds_of_stamp("1970-01-02T00:00:00.5Z"), seconds_of_stamp("12:01:00 AM"), seconds_of_stamp("1.5")
    (86400.5, 60.0, None)
    >>> seconds_of_stamp("2.1.1970 00:00:01", "dmy"), seconds_of_stamp("2.1.70", "dmy")
    (86401.0, None)
    >>> seconds_of_stamp("01:00.5")
    60.5
    """
    if minutes := MINUTES.fullmatch(text):
        return 60.0 * int(minutes[1]) + float(minutes[2].replace(",", "."))
    stamp = STAMP.fullmatch(text)
    if stamp is None or not (stamp["date"] or stamp["time"]):
        return None
    hour, half = int(stamp["hour"] or 0), (stamp["half"] or "").upper()
    if half:
        hour = hour % 12 + 12 * (half == "PM")
    parts = dict(zip(date, re.split("[-/.]", stamp["date"]), strict=True)) if stamp["date"] else {"y": "1970"}
    day = f"{parts['y']}-{parts.get('m', '1'):0>2}-{parts.get('d', '1'):0>2}"
    with suppress(ValueError):  # the 31st of February
        moment = datetime.fromisoformat(
            f"{day}T{hour:02}{stamp['time'] or ':00:00'}{stamp['zone'] or ''}".replace(",", ".").upper()
        )
        return ((moment if moment.tzinfo else moment.replace(tzinfo=UTC)) - EPOCH).total_seconds()
    return None
