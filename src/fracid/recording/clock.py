"""The clock of a recording: which column or rate gives the time, and in which unit.

In this order, the first that applies:

1. what the caller names: ``{column = 0, unit = "ms"}`` or ``{rate = 1000}``; with ``zero = "first"`` time is counted
   from the first sample;
2. a rate in the header of a file with one column (``sample_rate`` over ``1000``);
3. of the columns whose name means time, or else of all, the one that increases most evenly.

The unit is the caller's, the header's, that in which the first stamp is a date of this century, or s.  Rows without a
time stamp are left out, a first stamp beyond twelve days is a date, from which time is then counted, and a counter that
begins again is continued (:func:`unrolled`).  Every guess is a sentence for the report.  What is no clock at all is
refused here; jitter, gaps and repeated stamps are measured (:mod:`fracid.recording.measures`) and reported.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from numbers import Real
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fracid.arrays import BoolArray, FloatArray
from fracid.errors import DataError, InputError, brief
from fracid.findings import Finding, Note, Words
from fracid.recording.channel import TABLES, measurable
from fracid.recording.readers.table import Table
from fracid.safety.text import LONGEST_NAME, printable

SAYS = Words("recording/clock.toml")

SECONDS: dict[str, float] = {n: row["factor"] for n, row in TABLES["time"].items()}

TIME_SPELLINGS = {other: n for n, row in TABLES["time"].items() for other in row.get("also", ())}
"""Other spellings of units of time in headers."""

TIME_NAME = re.compile(r"(^|[^a-z])(t|time|timestamp|stamp|elapsed|seconds?|secs?|zeit)([^a-z]|$)")
"""A column that is named like time."""

RATE_NAME = re.compile(r"sampl\w*[ _-]*(rate|freq)|^fs$|rate[ _-]*hz")
"""A name in a header that is the samples a second."""

CLOCK_STAMP = 1e6
"""A first time beyond this [s], twelve days, is a date: time is then counted from the first sample."""

SHORTEST_STEP, LONGEST_TIME = 1e-15, 1e15
"""Of a clock [s]."""

DATES = 9.5e8, 4.1e9
"""Between which a count of seconds is a date of this century."""

DAYS = (36_526, 73_051), (730_486, 767_011)
"""The same of a count of days, as spreadsheets and MATLAB have it."""

MOST_DAYS, DAYS_STEP = 1.0, 2e-5
"""Such counts are days where the record is shorter than one, and a step than this: of seconds it were 20 µs."""

DAY = 86400.0
"""[s]"""

WRAPS = {2.0**8: "2⁸", 2.0**16: "2¹⁶", DAY: "midnight", 2.0**24: "2²⁴", 2.0**32: "2³²"}
"""After how many ticks the counters of microcontrollers begin again, micros() of 32 bits after 71 minutes; and a time
of day."""

AROUND, LIKE = 8, 2.0
"""Samples to each side of where a count begins again; so many times the largest step of these is its step there."""

SMOOTH, LEVELS = 0.125, 12
"""Of a wrap: all steps of a count that turns both ways are smaller; and what has no more values is a command."""

EVEN = 0.05
"""Relative scatter of its steps below which a column is a clock."""

OTHER_RATE = 1.02
"""A rate that is so many times another is not the same, rounded."""


# ------------------------------------------------------------------------------- time


@dataclass(frozen=True)
class _Said:
    """What reading the time did."""

    column: int | None
    sentences: tuple[str, ...]
    findings: tuple[Finding, ...] = ()


def read_clock(table: Table, time: Mapping[str, Any] | int | str | None) -> tuple[FloatArray, BoolArray, _Said]:
    """Return time stamps, the rows that have one, and what was done."""
    spec = dict(time) if isinstance(time, Mapping) else {} if time is None else {"column": time}
    extras = set(spec) - {"column", "unit", "rate", "zero"}
    if extras or (spec and ("rate" in spec) == ("column" in spec)) or spec.get("zero", "first") != "first":
        raise InputError(SAYS("other-time", time=time))
    if "rate" in spec:
        return _from_rate(table, spec["rate"])
    if not spec and len(table.names) == 1 and (rate := _header_rate(table.header)):
        return (*_from_rate(table, rate)[:2], _Said(None, (f"The rate is {rate:g} Hz, as the header says.",)))
    guessed = not spec
    column = _guess_time(table) if guessed else table.find(spec["column"])
    header = TIME_SPELLINGS.get(table.units[column].lower(), table.units[column]) or _name_unit(table.names[column])
    ticks, again = unrolled(measurable(table.values[:, column])[0])
    unit = spec.get("unit") or (header if header in SECONDS else _unit_of_date(ticks))
    if unit not in SECONDS:
        raise InputError(f"time: unit = {unit!r} is not possible; expected one of {', '.join(SECONDS)}.")
    stamps = ticks * SECONDS[unit]
    rows = np.isfinite(stamps)
    stamps = stamps[rows]
    if not stamps.size:
        raise DataError(f"{table.source}: the time column {table.names[column]!r} is blank throughout.")
    name, unsaid = short_text(table.names[column]), header and "unit" not in spec
    far = abs(stamps[0]) > CLOCK_STAMP and "zero" not in spec
    said = (
        (unit not in (spec.get("unit"), header, "s"), Note(SAYS("date", first=ticks[rows][0], unit=unit), "clock")),
        (guessed, Note(f"Time is taken from {table.names[column]!r} [{unit}].", "clock")),
        (unsaid and unit == "s" and header not in SECONDS, SAYS("no-unit-of-time", header=short_text(header))),
        (unsaid and not table.units[column], Note(f"Time is in {header}, as its name {name!r} says.", "clock")),
        (again, f"{name!r} {again}: the clock is continued."),
        (not rows.all(), f"{(~rows).sum()} of {rows.size} rows have no time stamp and were left out."),
        (far, Note(f"Time is counted from the first stamp, {stamps[0]:.6f} s.", "clock")),
    )
    if far or "zero" in spec:
        stamps = stamps - stamps[0]
    _refuse_no_clock(stamps, table)
    return stamps, rows, _Said(column, tuple(sentence for holds, sentence in said if holds))


def time_column(table: Table, time: Mapping[str, Any] | int | str | None) -> str | None:
    """The name of the column that :func:`read_clock` takes, its place where it has none; None where a rate is given."""
    column = read_clock(table, time)[2].column
    return None if column is None else table.names[column].removeprefix("column ")


def _unit_of_date(ticks: FloatArray) -> str:
    """The unit in which the first stamp is a date of this century, counted from 1970 or in days; s for none."""
    ticks = ticks[np.isfinite(ticks)]
    first = next(iter(ticks), 0.0)
    short = ticks.size > 1 and np.ptp(ticks) < MOST_DAYS and np.ptp(ticks) < DAYS_STEP * (ticks.size - 1)
    if short and any(low <= first < high for low, high in DAYS):
        return "d"
    return next((unit for unit in ("ms", "us", "ns") if DATES[0] < first * SECONDS[unit] < DATES[1]), "s")


def _name_unit(name: str) -> str:
    """The unit that a name of time ends in, ``t_ns`` or ``timeMs``, or is, ``ms`` or ``hours``; "" for none."""
    parted = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name[-LONGEST_NAME:]).lower()
    *head, end = re.findall(r"[^\W\d_]+", parted) or [""]
    unit = TIME_SPELLINGS.get(end, end)
    # alone h is a height, too
    of_time = TIME_NAME.search(" ".join(head)) if head else end in TIME_SPELLINGS or SECONDS.get(unit, 1.0) < 1.0
    return unit if unit in SECONDS and of_time else ""


def _refuse_no_clock(stamps: FloatArray, table: Table) -> None:
    """Refuse what is no time at all; a clock that jitters, repeats or goes back is for the report to tell."""
    steps = np.abs(np.diff(stamps))
    steps = steps[steps > 0]
    if steps.size and not (steps.min() > SHORTEST_STEP and np.ptp(stamps) < LONGEST_TIME):
        raise DataError(SAYS("no-clock", table=table, least=steps.min(), most=steps.max(), seconds=np.ptp(stamps)))


def _from_rate(table: Table, rate: Any) -> tuple[FloatArray, BoolArray, _Said]:
    if not isinstance(rate, Real) or isinstance(rate, bool) or not 0 < float(rate) < np.inf:
        raise InputError(f"rate = {brief(rate)} is not possible; expected samples a second, e.g. 1000.")
    n, rate = len(table.values), float(rate)
    _refuse_no_clock(np.array([0.0, 1 / rate]), table)
    return np.arange(n) / rate, np.ones(n, dtype=bool), _Said(None, (), tuple(_other_rates(table, rate)))


def _other_rates(table: Table, rate: float) -> Iterator[Finding]:
    """Say that a column of time runs evenly at another rate, units apart."""
    for j, name in enumerate(table.names):
        uneven = unevenness(table.values[:, j]) if TIME_NAME.search(name[:LONGEST_NAME].lower()) else None
        if uneven is None or uneven > EVEN:
            continue
        stamps = table.values[:, j]
        with np.errstate(over="ignore", invalid="ignore"):
            step = float(np.median(np.diff(stamps[np.isfinite(stamps)])))
        if not 1e-12 < step < 1e12:  # no clock's
            continue
        own = 1 / step
        times = [rate / (own / seconds) for seconds in SECONDS.values()]
        if min(abs(math.log(r)) for r in times) > math.log(OTHER_RATE):
            yield SAYS.finding("other-rate", "time", times[0], OTHER_RATE, rate=rate, column=short_text(name), own=own)


def _header_rate(header: Sequence[str]) -> float | None:
    """Return the samples a second of a header such as ``sample_rate, duration`` over ``1000, 5``."""
    split = [[cell.strip() for cell in re.split(r"[,;\t]|\s{2,}", line.lstrip("#%/ "))] for line in header]
    for names, values in pairwise(split):
        for name, value in zip(names, values, strict=False):
            whole = RATE_NAME.search(name[:LONGEST_NAME].lower()) and re.fullmatch(r"\d+(\.\d+)?", value)
            if whole and float(value) > 0:
                return float(value)
    return None


def _guess_time(table: Table) -> int:
    """Return the column that increases most evenly, of those named like time if there are any."""

    def uneven(j: int) -> float | None:
        return unevenness(unrolled(measurable(table.values[:, j])[0])[0])

    named = [j for j, name in enumerate(table.names) if TIME_NAME.search(name.lower())]
    in_a_unit = [j for j, name in enumerate(table.names) if _name_unit(name) and uneven(j) is not None]
    evenness = {j: e for j in named or in_a_unit or range(len(table.names)) if (e := uneven(j)) is not None}
    if named and not evenness:  # a clock that repeats or goes back: the report will say so
        return named[0]
    if not evenness:
        header = f" The header says: {short_text(' | '.join(table.header))}." if table.header else ""
        rows, columns = table.values.shape
        wide = " It has more columns than rows: should it be turned?" if columns > max(rows, 20) else ""
        whole = columns > 2 and np.array_equal(table.values, np.round(table.values), equal_nan=True)
        raise InputError(SAYS("no-time", table=table, header=header, wide=wide or whole * f" {SAYS('commas')}"))
    return min(evenness, key=lambda j: evenness[j])


def short_text(text: str) -> str:
    """On one line that can be printed, 200 characters at most."""
    return printable(" ".join(text.split()))[:200]


def unrolled(column: FloatArray) -> tuple[FloatArray, str]:
    """A counter that is continued where it begins again, and how often it does; else the column.

    It has whole numbers, unless it is a time of day, and its steps where it begins again are like those beside: what
    was started anew, two logs in one file, or an error that is written as 65535 has others.

    Examples
    --------
    >>> count, again = unrolled(np.round(300 * np.sin(np.arange(0, 9, 0.05))) % 2**16)
    >>> count.min(), count.max(), again
    (np.float64(-300.0), np.float64(300.0), 'begins again at 2¹⁶ 2 times')
    """
    there = np.isfinite(column)
    ticks = column[there]
    far = np.diff(ticks)
    wrap = min((w for w in WRAPS if ticks.size and np.ptp(ticks) < w), default=math.inf)
    begins = np.abs(far) > wrap / 2
    if not begins.any() or (wrap != DAY and np.any(ticks % 1.0)):
        return column, ""
    steps = far - wrap * np.sign(far) * begins
    sizes = np.abs(steps)
    others = np.where(begins, 0.0, sizes)
    beside = sliding_window_view(np.pad(others, AROUND), 2 * AROUND + 1)[begins].max(axis=1)
    like = LIKE * np.maximum(beside, np.min(others, where=others > 0, initial=wrap))
    counts = steps.min() >= 0 or (sizes.max() < SMOOTH * wrap and np.unique(ticks).size > LEVELS)
    if not (others.any() and np.all(sizes[begins] <= like) and counts):
        return column, ""
    column = column.copy()
    below = wrap * (steps.min() < 0 and ticks[0] > wrap / 2)  # what turns both ways began below 0
    column[there] = ticks[0] - below + np.concatenate([[0.0], np.cumsum(steps)])
    times = "once" if begins.sum() == 1 else f"{begins.sum()} times"
    return column, f"begins again at {WRAPS[wrap]} {times}"


def unevenness(column: FloatArray) -> float | None:
    """Spread of a column's increments relative to their median; None where it does not always increase."""
    dt = np.diff(measurable(column)[0][np.isfinite(column)])
    if dt.size == 0 or not np.all(dt > 0):
        return None
    with np.errstate(over="ignore"):
        return float(np.std(dt) / np.median(dt))
