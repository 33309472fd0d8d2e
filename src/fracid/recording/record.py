"""A recording: one clock and its signals, with what was measured of them."""

from __future__ import annotations

import hashlib
import math
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, takewhile
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fracid.errors import DataError, InputError
from fracid.findings import Finding
from fracid.foreign import LONGEST_NAME, printable
from fracid.recording.channel import COUNTING, ELSEWHERE, UNITS, Channel, header_unit, hold
from fracid.recording.report import Report, measure
from fracid.recording.table import Table, read_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fracid.style import Style

__all__ = ["Recording", "inspect_recording", "load_recording"]

Array = NDArray[np.float64]

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
TIME_SPELLINGS = {
    **dict.fromkeys(("sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("msec", "msecs", "millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(
        ("usec", "micros", "microsecond", "microseconds", "\u03bcs"), "us"
    ),  # the Greek letter, not the sign
    **dict.fromkeys(("nsec", "nanosecond", "nanoseconds"), "ns"),
    **dict.fromkeys(("minute", "minutes"), "min"),
    **dict.fromkeys(("hr", "hour", "hours"), "h"),
}
"""Other spellings of units of time in headers."""
TIME_NAME = re.compile(r"(^|[^a-z])(t|time|timestamp|stamp|seconds?|secs?|zeit)([^a-z]|$)")
"""A column that is named like time."""
RATE_NAME = re.compile(r"sampl\w*[ _-]*(rate|freq)|^fs$|rate[ _-]*hz")
"""A name in a header that is the samples a second."""
CLOCK_STAMP = 1e6
"""A first time beyond this [s], twelve days, is a date: time is then counted from the first sample."""


SHORTEST_STEP, LONGEST_TIME = 1e-15, 1e15
"""Of a clock [s]."""
LARGEST = 1e100
"""No instrument gives more, in whatever unit; squares of more have no number."""
EVEN = 0.05
"""Relative scatter of its steps below which a column is a clock."""
OTHER_RATE = 1.02
"""A rate that is so many times another is not the same, rounded."""
MOST_RESAMPLED = 50
"""Samples of a finer grid for each of the recording's."""


@dataclass(frozen=True)
class Recording:
    """Measured signals over one clock."""

    name: str
    path: Path
    sha256: str
    """Of the file."""
    time: Array
    """Shape (n_samples,) [s]; the file's own, from the first sample where the file gives dates."""
    signals: Mapping[str, Array]
    """Name to samples, shape (n_samples,) [rad for angles]."""
    units: Mapping[str, str]
    """Name to rad, rad/s, V, N m or 1."""
    report: Report
    held: frozenset[str] = field(default=frozenset())
    """Signals that keep their value between samples (commands), so are never interpolated linearly."""

    @property
    def step(self) -> float | None:
        """Step of the uniform grid [s], None where the samples lie on none: :meth:`resample` first."""
        clock = self.report.clock
        return clock.duration / (clock.samples - 1) if clock.samples > 1 and clock.uniform else None

    def plot(self, *, zero: str = "", style: str | Style = "screen") -> Figure:
        """Each signal whole, and close up about the release; see :func:`fracid.plots.recording_overview`.

        Parameters
        ----------
        zero : str
            Where the pendulum's angle is zero, where that is known: "hanging" or "upright".
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.style`.

        Examples
        --------
        >>> twin = Recording.of("twin", np.arange(5.0), {"alpha": np.arange(5.0)})
        >>> twin.plot(zero="hanging").axes[0].get_ylabel()
        '$\\\\alpha$, 0 = hanging [°]'
        """
        from fracid.plots import recording_overview

        return recording_overview(self, zero=zero, style=style)

    def trim(self, start: float | str | None = None, stop: float | None = None) -> Recording:
        """Return the part from `start` to `stop` [s], both included; time keeps its zero.

        Parameters
        ----------
        start : float, "release" or None
            None is the first sample.
        stop : float, optional
            None is the last sample.

        Raises
        ------
        InputError
            Fewer than two samples lie there.
        DataError
            `start` is "release" and none was found.

        Examples
        --------
        >>> twin = Recording.of("twin", np.arange(5.0), {"alpha": np.arange(5.0)})
        >>> twin.trim(1.0, 3.0).time
        array([1., 2., 3.])
        """
        low = self._start(start)
        high = np.inf if stop is None else _seconds("to", stop)
        slack = 1e-6 * (self.report.clock.step if self.report.clock.samples > 1 else 0.0)
        inside = (self.time >= low - slack) & (self.time <= high + slack)
        if inside.sum() < 2:
            span = f"{self.time[0]:.6g} to {self.time[-1]:.6g} s" if self.time.size else "no time at all"
            raise InputError(
                f"{self.name}: from {low:.6g} to {high:.6g} s holds {inside.sum()} samples; it spans {span}."
            )
        return self._with(self.time[inside], {n: x[inside] for n, x in self.signals.items()}, self.report.resampled)

    def _start(self, start: float | str | None) -> float:
        if start is None:
            return -np.inf
        if start != "release":
            if isinstance(start, str):
                raise InputError(f'from = {start!r} is not possible; expected a time [s] or "release".')
            return _seconds("from", start)
        if self.report.release is None:
            raise DataError(f"{self.name}: no release found ({self.report.release_reason}). Give from as a time [s].")
        return self.report.release

    def resample(self, step: float | None = None) -> Recording:
        """Return the recording on a uniform grid: commands held, all else interpolated linearly.

        Parameters
        ----------
        step : float, optional
            [s]; None takes the recording's own, rounded to three digits.

        Returns
        -------
        Recording
            Its report says how, and names each gap that was bridged.

        Raises
        ------
        InputError
            `step` is not positive or leaves fewer than two samples.
        DataError
            Time does not increase, or samples are missing.

        Examples
        --------
        >>> twin = Recording.of("twin", np.array([0, 0.11, 0.19, 0.3]), {"alpha": np.arange(4.0)})
        >>> twin.resample(0.1).time
        array([0. , 0.1, 0.2, 0.3])
        """
        _demand(self)
        clock = self.report.clock
        h = float(f"{clock.step:.3g}") if step is None else float(step)
        if not 0 < h <= clock.duration:
            raise InputError(f"step = {step!r} s is not possible; expected above 0 and at most {clock.duration:.6g} s.")
        if clock.duration / h > MOST_RESAMPLED * max(clock.samples, 10_000):
            raise InputError(
                f"{self.name}: a step of {h:.3g} s makes {clock.duration / h:.3g} samples out of {clock.samples}; "
                "give a longer one: resample = 0.001."
            )
        grid = self.time[0] + h * np.arange(int(clock.duration / h * (1 + 1e-12)) + 1)
        signals = {n: self._at(n, grid) for n in self.signals}
        gaps = "".join(
            f" The gap of {1e3 * g:.3g} ms after {t:.4g} s was bridged by a line."
            for t, g in sorted(clock.gaps, key=lambda gap: -gap[1])[:5]
        )
        more = f" So were {len(clock.gaps) - 5} more gaps." if len(clock.gaps) > 5 else ""
        held = f" ({', '.join(sorted(self.held))}: last value held)" if self.held else ""
        how = f"Resampled to a step of {1e3 * h:.6g} ms by linear interpolation{held}.{gaps}{more}"
        new = self._with(grid, signals, how)
        # a line between two encoder steps lies on no lattice: what was measured before still holds
        kept = tuple(
            replace(s, resolution=r.resolution, counts_per_turn=r.counts_per_turn, noise=r.noise)
            for s, r in zip(new.report.signals, self.report.signals, strict=True)
        )
        return replace(new, report=replace(new.report, signals=kept))

    def _at(self, name: str, grid: Array) -> Array:
        x = self.signals[name]
        if name in self.held:
            return np.asarray(x[np.searchsorted(self.time, grid + 1e-12, side="right") - 1])
        return np.asarray(np.interp(grid, self.time, x))

    def split(self, at: float) -> tuple[Recording, Recording]:
        """Return the parts before and from `at` [s].

        Raises
        ------
        InputError
            A part would hold fewer than two samples.

        Examples
        --------
        >>> twin = Recording.of("twin", np.arange(5.0), {"alpha": np.arange(5.0)})
        >>> [len(part.time) for part in twin.split(2.0)]
        [2, 3]
        """
        return self.trim(None, float(np.nextafter(at, -np.inf)) - 2e-6 * self.report.clock.step), self.trim(at)

    def _with(self, time: Array, signals: Mapping[str, Array], resampled: str | None) -> Recording:
        report = measure(time, signals, self.units, self.report.reading, resampled)
        of_the_file = tuple(f for f in self.report.findings if f.where == "time")
        report = replace(report, findings=(*of_the_file, *report.findings))
        return replace(self, time=_frozen(time), signals={n: _frozen(x) for n, x in signals.items()}, report=report)

    @classmethod
    def of(
        cls, name: str, time: Array, signals: Mapping[str, Array], units: Mapping[str, str] | None = None
    ) -> Recording:
        """Return a recording of arrays that come from no file.

        Parameters
        ----------
        name : str
        time : ndarray, shape (n_samples,)
            [s]
        signals : mapping
            Name to samples, shape (n_samples,).
        units : mapping, optional
            Name to unit; rad where it says nothing.

        Raises
        ------
        InputError
            A signal is not as long as time.

        Examples
        --------
        >>> Recording.of("twin", np.arange(5.0), {"alpha": np.zeros(5)}).step
        1.0
        """
        time = _array(f"{name}: time", time)
        arrays = {n: _array(f"{name}: {n}", x) for n, x in signals.items()}
        if not arrays:
            raise InputError(f"{name}: no signal; expected e.g. {{'alpha': samples}}.")
        if not np.all(np.isfinite(time)):
            raise InputError(f"{name}: {np.count_nonzero(~np.isfinite(time))} time stamps are not finite.")
        for n, unit in (units or {}).items():
            if n not in arrays or unit not in {of for _, of in UNITS.values()}:
                raise InputError(
                    f"{name}: the unit {unit!r} of {n!r} is not possible; expected for {', '.join(arrays)} one of "
                    f"{', '.join(dict.fromkeys(of for _, of in UNITS.values()))}. Degrees: numpy.radians(samples)."
                )
        for n, x in arrays.items():
            if x.shape != time.shape or time.ndim != 1:
                raise InputError(
                    f"{name}: {n} has shape {x.shape} and time {time.shape}; expected (n_samples,) for both."
                )
        known = {n: (units or {}).get(n, "rad") for n in arrays}
        digest = hashlib.sha256(b"".join(map(np.ndarray.tobytes, (time, *arrays.values())))).hexdigest()
        report = measure(time, arrays, known)
        return cls(name, Path(), digest, _frozen(time), {n: _frozen(x) for n, x in arrays.items()}, known, report)


def load_recording(
    path: str | Path,
    columns: Mapping[str, Channel | Mapping[str, Any] | int | str] | None = None,
    *,
    time: Mapping[str, Any] | int | str | None = None,
    start: float | str | None = None,
    stop: float | None = None,
    resample: bool | float | str | None = None,
    name: str | None = None,
    variable: str | None = None,
) -> Recording:
    """Load a recording that is fit for use.

    Parameters
    ----------
    path : str or Path
        The file: text, .mat, .npz, .npy, HDF5 or Parquet.
    columns : mapping, optional
        Signal name to column, or to the fields of a :class:`Channel`.  None guesses; the report says what.
    time : mapping, optional
        ``{"column": 0}``, ``{"column": "t", "unit": "ms"}`` or ``{"rate": 1000}`` [Hz].  None guesses.
    start, stop : float, optional
        The part to keep [s], both included; `start` may be ``"release"``.
    resample : optional
        True for a uniform grid of the recording's own step, a number for that step [s], ``"needed"`` for
        True only where time jitters by more than 1 % of a step or has gaps.
    name : str, optional
        None is the file's name without its ending.
    variable : str, optional
        Which array of a .mat, .npz or HDF5 file.

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        No such file, format, column or option.
    DataError
        The file is damaged, or the recording unfit: missing samples, time that does not increase, a long gap.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "swing.csv"
    >>> _ = file.write_text("t;alpha\\n0,0;10\\n0,1;9\\n0,2;7\\n")
    >>> load_recording(file, {"alpha": {"column": "alpha", "unit": "deg"}}).signals["alpha"].round(3)
    array([0.175, 0.157, 0.122])
    """
    recording = inspect_recording(path, columns, time=time, start=start, stop=stop, name=name, variable=variable)
    _demand(recording)
    if resample is None or resample is False or (resample == "needed" and recording.step is not None):
        return recording
    if not isinstance(resample, Real) and resample != "needed":
        raise InputError(f'resample = {resample!r} is not possible; expected true, a step [s] or "needed".')
    return recording.resample(None if resample in (True, "needed") else float(resample))


def inspect_recording(
    path: str | Path,
    columns: Mapping[str, Channel | Mapping[str, Any] | int | str] | None = None,
    *,
    time: Mapping[str, Any] | int | str | None = None,
    start: float | str | None = None,
    stop: float | None = None,
    name: str | None = None,
    variable: str | None = None,
) -> Recording:
    """Read a recording however unfit it is, so that its report can say why.

    Parameters and errors are those of :func:`load_recording`, but for unfitness.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "swing.csv"
    >>> _ = file.write_text("t,alpha\\n0,0.1\\n1,\\n2,0.3\\n")
    >>> inspect_recording(file).report.level
    'unfit'
    """
    if not isinstance(path, str | PathLike):
        raise InputError(f"{path!r} is no path of a file; expected e.g. 'release.csv'.")
    path = Path(path)
    before = _state(path)
    table = read_table(path, variable)
    clock, rows, said = _time(table, time)
    channels, more = _channels(table, columns, said.column, rows)
    if columns is not None:
        _refuse_shared(table, channels, said.column)
    reading = [*table.notes, *said.sentences, *more]
    signals, units, held = {}, {}, set()
    for signal, channel in channels.items():
        channel, unit_said = _with_unit(table, signal, channel, guessed=columns is None)
        raw, beyond = _measurable(table.values[:, table.find(channel.column)])
        reading += [f"{signal}: {beyond}"] if beyond else []
        if channel.fill == "hold":
            raw, filled = _held(raw, signal, channel)
            reading.append(filled)
            held.add(signal)
        signals[signal] = channel.convert(raw[rows].copy(), signal)
        units[signal] = channel.signal_unit
        reading += [unit_said] if unit_said else []
    report = measure(clock, signals, units, tuple(reading))
    report = replace(report, findings=(*said.findings, *report.findings))
    frozen = {n: _frozen(x) for n, x in signals.items()}
    digest = _digest(path)
    if _state(path) != before:
        raise DataError(f"{path.name} changed while it was read. Is it still being written? Read it when it is done.")
    whole = Recording(name or path.stem, path, digest, _frozen(clock), frozen, units, report, frozenset(held))
    return whole if start is None and stop is None else whole.trim(start, stop)


def _state(path: Path) -> tuple[int, int] | None:
    """Return what changes when a file is written to."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None  # for read_table to tell
    return found.st_size, found.st_mtime_ns


def _digest(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None


def _measurable(raw: Array) -> tuple[Array, str]:
    """Return the samples without those that no instrument gives, and a sentence on them."""
    beyond = int(np.count_nonzero(np.abs(raw) > LARGEST))  # infinite ones too; NaN is not
    if not beyond:
        return raw, ""
    plural = "s are" if beyond > 1 else " is"
    return (
        np.where(np.abs(raw) > LARGEST, np.nan, raw),
        f"{beyond} sample{plural} infinite or beyond {LARGEST:g}, and taken as missing.",
    )


def _demand(recording: Recording) -> None:
    if recording.report.faults:
        first, others = recording.report.faults[:2], len(recording.report.faults) - 2
        more = f" And {others} more fault{'s' * (others > 1)}: fracid check lists them." if others > 0 else ""
        raise DataError(f"{recording.name}: {' '.join(first)}{more}")


def _seconds(name: str, given: Any) -> float:
    if not isinstance(given, Real):
        raise InputError(f"{name} = {given!r} is not possible; expected a time [s].")
    return float(given)


def _array(name: str, given: Any) -> Array:
    """Turn samples that a caller has into numbers, or say what is wrong; what is masked is missing."""
    try:
        if np.asarray(given).dtype.kind not in "fiub":
            raise TypeError
        return np.ma.filled(np.ma.asarray(given, dtype=float), np.nan)
    except (TypeError, ValueError):
        raise InputError(f"{name} is no array of real numbers: of time seconds, of angles radians.") from None


def _frozen(array: Array) -> Array:
    array = np.array(array, dtype=float)
    array.setflags(write=False)
    return array


# ------------------------------------------------------------------------------- time


@dataclass(frozen=True)
class _Said:
    """What reading the time did."""

    column: int | None
    sentences: tuple[str, ...]
    findings: tuple[Finding, ...] = ()


def _time(table: Table, given: Mapping[str, Any] | int | str | None) -> tuple[Array, NDArray[np.bool_], _Said]:
    """Return time stamps, the rows that have one, and what was done."""
    spec = dict(given) if isinstance(given, Mapping) else {} if given is None else {"column": given}
    unknown = set(spec) - {"column", "unit", "rate"}
    if unknown or (spec and ("rate" in spec) == ("column" in spec)):
        raise InputError(
            f"time = {given!r} is not possible; expected "
            "{column = 0}, {column = 0, unit = 'ms'} or {rate = 1000}."
        )
    if "rate" in spec:
        return _from_rate(table, spec["rate"])
    if not spec and len(table.names) == 1 and (rate := _header_rate(table.header)):
        return (*_from_rate(table, rate)[:2], _Said(None, (f"The rate is {rate:g} Hz, as the header says.",)))
    guessed = not spec
    column = _guess_time(table) if guessed else table.find(spec["column"])
    header = TIME_SPELLINGS.get(table.units[column].lower(), table.units[column])
    unit = spec.get("unit") or (header if header in SECONDS else "s")
    if unit not in SECONDS:
        raise InputError(f"time: unit = {unit!r} is not possible; expected one of {', '.join(SECONDS)}.")
    stamps = _measurable(table.values[:, column])[0] * SECONDS[unit]
    rows = np.isfinite(stamps)
    stamps = stamps[rows]
    if not stamps.size:
        raise DataError(f"{table.source}: the time column {table.names[column]!r} is blank throughout.")
    sentences = [f"Time is taken from {table.names[column]!r} [{unit}]."] if guessed else []
    if header and header not in SECONDS and "unit" not in spec:
        sentences.append(f"The header has time in {_short(header)!r}, which is no unit of time here: it is taken as s.")
    if not rows.all():
        sentences.append(f"{(~rows).sum()} of {rows.size} rows have no time stamp and were left out.")
    if abs(stamps[0]) > CLOCK_STAMP:
        sentences.append(f"Time is counted from the first stamp, {stamps[0]:.6f} s.")
        stamps = stamps - stamps[0]
    _refuse_no_clock(stamps, table)
    return stamps, rows, _Said(column, tuple(sentences))


def _refuse_no_clock(stamps: Array, table: Table) -> None:
    """Refuse what is no time at all; a clock that jitters, repeats or goes back is for the report to tell."""
    steps = np.abs(np.diff(stamps))
    steps = steps[steps > 0]
    if steps.size and not (steps.min() > SHORTEST_STEP and np.ptp(stamps) < LONGEST_TIME):
        raise DataError(
            f"{table.source}: time has steps from {steps.min():.3g} to {steps.max():.3g} s over "
            f"{np.ptp(stamps):.3g} s, as no clock has. Is it another column, or in another unit?"
        )


def _from_rate(table: Table, rate: Any) -> tuple[Array, NDArray[np.bool_], _Said]:
    if not isinstance(rate, Real) or isinstance(rate, bool) or not 0 < float(rate) < np.inf:
        raise InputError(f"rate = {rate!r} is not possible; expected samples a second, e.g. 1000.")
    n, rate = len(table.values), float(rate)
    _refuse_no_clock(np.array([0.0, 1 / rate]), table)
    return np.arange(n) / rate, np.ones(n, dtype=bool), _Said(None, (), tuple(_other_rates(table, rate)))


def _other_rates(table: Table, rate: float) -> Iterator[Finding]:
    """Say that a column of time runs evenly at another rate, units apart."""
    for j, name in enumerate(table.names):
        uneven = _unevenness(table.values[:, j]) if TIME_NAME.search(name[:LONGEST_NAME].lower()) else None
        if uneven is None or uneven > EVEN:
            continue
        stamps = table.values[:, j]
        with np.errstate(over="ignore", invalid="ignore"):
            step = float(np.median(np.diff(stamps[np.isfinite(stamps)])))
        if not 1e-12 < step < 1e12:  # no clock's
            continue
        own = 1 / step
        times = [rate / (own / seconds) for seconds in SECONDS.values()]
        nearest = min(times, key=lambda r: abs(math.log(r)))
        if abs(math.log(nearest)) > math.log(OTHER_RATE):
            yield Finding(
                "wrong-clock", "time", times[0], OTHER_RATE, "times the rate of its column",
                f"the rate is {rate:g} Hz, as given, and the column {_short(name)!r} runs at {own:.6g} Hz: one of the "
                "two is wrong. Leave the rate out to take the column.",
            )  # fmt: skip


def _header_rate(header: Sequence[str]) -> float | None:
    """Return the samples a second of a header such as ``sample_rate, duration`` over ``1000, 5``."""
    split = [[cell.strip() for cell in re.split(r"[,;\t]|\s{2,}", line.lstrip("#%/ "))] for line in header]
    for names, values in pairwise(split):
        for name, value in zip(names, values, strict=False):
            if (
                RATE_NAME.search(name[:LONGEST_NAME].lower())
                and re.fullmatch(r"\d+(\.\d+)?", value)
                and float(value) > 0
            ):
                return float(value)
    return None


def _guess_time(table: Table) -> int:
    """Return the column that increases most evenly, of those named like time if there are any."""
    named = [j for j, name in enumerate(table.names) if TIME_NAME.search(name.lower())]
    among = named or range(len(table.names))
    evenness = {j: e for j in among if (e := _unevenness(table.values[:, j])) is not None}
    if named and not evenness:  # a clock that repeats or goes back: the report will say so
        return named[0]
    if not evenness:
        header = f" The header says: {_short(' | '.join(table.header))}." if table.header else ""
        sideways = " It has more columns than rows: should it be turned?" if _is_wide(table) else ""
        raise InputError(
            f"{table.source}: no column increases like time.{header}{sideways} Give the rate [Hz] or the time column."
        )
    return min(evenness, key=lambda j: evenness[j])


def _is_wide(table: Table) -> bool:
    rows, columns = table.values.shape
    return bool(columns > max(rows, 20))


def _short(text: str) -> str:
    return printable(" ".join(text.split()))[:200]


def _unevenness(column: Array) -> float | None:
    dt = np.diff(_measurable(column)[0][np.isfinite(column)])
    if dt.size == 0 or not np.all(dt > 0):
        return None
    with np.errstate(over="ignore"):
        return float(np.std(dt) / np.median(dt))


# ---------------------------------------------------------------------------- channels


def _channels(
    table: Table,
    columns: Mapping[str, Channel | Mapping[str, Any] | int | str] | None,
    time: int | None,
    rows: NDArray[np.bool_],
) -> tuple[dict[str, Channel], list[str]]:
    """Return the channels asked for, or all columns that vary, and what was guessed."""
    if columns is not None:
        if not isinstance(columns, Mapping) or not columns:
            raise InputError(f"columns = {columns!r} names no signal; expected e.g. {{'alpha': 2}}.")
        return {name: Channel.of(given, name) for name, given in columns.items()}, []
    others = [j for j in range(len(table.names)) if j != time and (_unevenness(table.values[:, j]) or 1) > 1e-12]
    blank = {j for j in others if np.isnan(table.values[rows, j]).all()}
    still = {j for j in others if j not in blank and _is_still(table.values[rows, j])}
    kept = [j for j in others if j not in blank | still and not _is_clock(table, j, time)] or [*still]
    if not kept:
        raise DataError(_no_signal(table, blank))
    sentences = [f"No columns were named: signals are {', '.join(repr(table.names[j]) for j in kept)}."]
    sentences += _left_out(table)
    for left, why in [
        (blank, "blank where time is stamped"),
        ([j for j in still if j not in kept], "constant"),
    ]:
        if left:
            sentences.append(f"Left out as {why}: {', '.join(repr(table.names[j]) for j in left)}.")
    twice = {name for name, count in Counter(table.names).items() if count > 1}
    shared = re.match(r".*[/.]|", _common([table.names[j] for j in kept]))
    cut = len(shared[0]) if shared and len(kept) > 1 else 0  # /joint_states/joint0/position: joint0/position
    label = {j: f"{table.names[j][cut:]}{f' ({j})' * (table.names[j] in twice)}" for j in kept}
    return {label[j]: Channel(j) for j in kept}, sentences


def _is_still(column: Array) -> bool:
    return bool(np.all(column == column[0]))


def _no_signal(table: Table, blank: Collection[int]) -> str:
    """Return why nothing but time is there."""
    names = ", ".join(table.names[:20])
    said = " ".join(_left_out(table)) or (
        f"Blank throughout: {', '.join(table.names[j] for j in [*blank][:20])}." if blank else f"Its columns: {names}."
    )
    return f"{table.source} holds no signal besides its time. {said}"


def _left_out(table: Table) -> list[str]:
    """Say what of the file is no column and might have been meant to be one."""
    odd = [f"{name} {why}" for name, why in table.left_out.items() if why not in ("is text", "is a single number")]
    more = f"; and {len(odd) - 3} more" if len(odd) > 3 else ""
    return [f"Left out: {'; '.join(map(_short, odd[:3]))}{more}."] if odd else []


def _common(names: list[str]) -> str:
    """Return the longest text that all names begin with."""
    alike = (len(set(letters)) == 1 for letters in zip(*names, strict=False))
    return names[0][: sum(takewhile(bool, alike))]


def _is_clock(table: Table, j: int, time: int | None) -> bool:
    """Tell whether a column is a second clock: dates that increase."""
    return time is not None and _unevenness(table.values[:, j]) is not None and table.values[0, j] > CLOCK_STAMP


def _refuse_shared(table: Table, channels: Mapping[str, Channel], time: int | None) -> None:
    """Refuse a column that is asked for twice, or is the clock: a slip of the finger."""
    used = {} if time is None else {time: "time"}
    for name, channel in channels.items():
        j = table.find(channel.column)
        if j in used:
            raise InputError(
                f"{name} and {used[j]} are both column {j}, {_short(table.names[j])!r}, of {table.source}; give each "
                "its own."
            )
        used[j] = name


def _with_unit(table: Table, name: str, channel: Channel, *, guessed: bool) -> tuple[Channel, str | None]:
    """Return the channel with a unit (its own, the header's, or rad) and a sentence if it is not its own."""
    column, counts = table.find(channel.column), channel.counts_per_turn
    header = table.units[column]
    counting = header.lower() in COUNTING
    if counts is not None and channel.unit != "counts":
        if channel.unit is not None or not counting:
            raise InputError(
                f'{name}: counts_per_turn = {counts} is for unit = "counts", and its unit is '
                f'{channel.unit or "not given"}; type unit = "counts", or leave counts_per_turn out.'
            )
        return replace(channel, unit="counts"), f"{name} is in counts, as the header says."
    if channel.unit is not None:
        return channel, None
    unit = header_unit(header)
    if unit:
        return replace(channel, unit=unit), f"{name} is in {unit}, as the header says."
    unit = "rad/s" if "velocity" in table.names[column].lower() else "rad"
    if not header:
        return replace(channel, unit=unit), f"{name} has no unit: taken as {unit}."
    if not guessed and counting:
        raise InputError(
            f"{name} is in counts, as the header says; type counts_per_turn = 4096, or what its encoder has."
        )
    if not guessed and header.lower() in ELSEWHERE:
        known, scale = ELSEWHERE[header.lower()]
        raise InputError(f'{name} is in {header}, as the header says; type unit = "{known}", scale = {scale}.')
    return replace(channel, unit=unit), f"{name}: what the header says of it, {_short(header)!r}, is taken as {unit}."


def _held(raw: Array, name: str, channel: Channel) -> tuple[Array, str]:
    """Fill blanks with the last value; a command before its first is 0."""
    blanks = int(np.isnan(raw).sum())
    raw, before = hold(raw), ""
    if channel.unit in ("V", "N m"):
        raw, before = np.where(np.isnan(raw), 0.0, raw), " (0 before the first)"
    return raw, f"{name}: {blanks} blanks hold the last value{before}."
