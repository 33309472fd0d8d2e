"""Load a recording from a file: table, clock, columns, units, report.

=========================  ==========================================================================
:func:`load_recording`     raises :class:`~fracid.errors.DataError` for a recording that is unfit to fit
:func:`inspect_recording`  returns it with a report that says why it is unfit
=========================  ==========================================================================

Both keep the file's SHA-256, and refuse a file that changes while it is read.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from fracid.arrays import BoolArray, FloatArray
from fracid.errors import DataError, InputError, brief
from fracid.findings import Finding
from fracid.recording.channel import COUNTING, SAYS, Channel, Specs, constant, measurable
from fracid.recording.clock import read_clock, short_text, unrolled
from fracid.recording.columns import channel_with_unit, choose_channels, hold_blanks, refuse_shared, unit_of_header
from fracid.recording.faults import still
from fracid.recording.guess import Fields, guessed_units, is_angle
from fracid.recording.readers.table import Table, read_table
from fracid.recording.recording import Recording, demand_fitness, read_only
from fracid.recording.report import measure
from fracid.safety.door import opened
from fracid.safety.paths import path_of


def load_recording(
    path: str | Path,
    columns: Specs | None = None,
    *,
    time: Mapping[str, Any] | int | str | None = None,
    start: float | str | None = None,
    stop: float | None = None,
    resample: bool | float | str | None = None,
    name: str | None = None,
    variable: str | None = None,
    outputs: Collection[str] = (),
) -> Recording:
    """Load a recording that is fit for use.

    Parameters
    ----------
    path : str or Path
        The file: text, .mat, .npz, .npy, HDF5, Parquet, JSON, Excel, TDMS, MDF or a bag of ROS 2.
    columns : mapping, optional
        Signal name to column, or to the fields of a :class:`Channel`; ``{"constant": 3.0, "unit": "A"}`` is an input
        that no column has, for it does not change.  None guesses; the report says what.
    time : mapping, optional
        ``{"column": 0}``, ``{"column": "t", "unit": "ms"}`` or ``{"rate": 1000}`` [Hz].  None guesses.
    start, stop : float, optional
        The part to keep [s], both included; `start` may be ``"release"``.
    resample : optional
        True for a uniform grid of the recording's own step, a number for that step [s], ``"needed"`` for
        True only where time jitters by more than 1 % of a step or has gaps, and samples do not crowd in a part of the
        record.  ``"uneven"`` says that samples are meant to lie unevenly: a fit takes them where they are.
    name : str, optional
        None is the file's name without its ending.
    variable : str, optional
        Which array of a .mat, .npz or HDF5 file.
    outputs : collection of str
        Signals that may be missing in any number of samples, as outputs that are assayed now and then are.

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        No such file, format, column or option.
    DataError
        The file is damaged, or the recording unfit: many missing samples, time that does not increase, a long gap.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "swing.csv"
    >>> _ = file.write_text("t;alpha\\n0,0;10\\n0,1;9\\n0,2;7\\n")
    >>> load_recording(file, {"alpha": {"column": "alpha", "unit": "deg"}}).signals["alpha"].round(3)
    array([0.175, 0.157, 0.122])
    """
    recording = inspect_recording(
        path, columns, time=time, start=start, stop=stop, name=name, variable=variable,
        uneven=isinstance(resample, str) and resample == "uneven",
    )  # fmt: skip
    return resampled(recording.bridge_blanks(outputs), resample)


def resampled(recording: Recording, resample: bool | float | str | None) -> Recording:
    """Bring a recording onto the grid that :func:`load_recording` was asked for.

    Raises
    ------
    InputError
        For another word than "needed".
    DataError
        If it is unfit.

    Examples
    --------
    >>> import numpy as np
    >>> jittering = Recording.of("twin", np.array([0, 0.11, 0.19, 0.3]), {"alpha": np.arange(4.0)})
    >>> resampled(jittering, 0.1).time
    array([0. , 0.1, 0.2, 0.3])
    """
    demand_fitness(recording)
    if not (isinstance(resample, Real | None) or (isinstance(resample, str) and resample in ("needed", "uneven"))):
        raise InputError(SAYS("other-resample", resample=brief(resample)))
    off = isinstance(resample, bool) and not resample
    if off or resample in (None, "uneven") or (resample == "needed" and (recording.uneven or recording.step)):
        return recording
    return recording.resample(None if resample in (True, "needed") else float(resample))


def inspect_recording(
    path: str | Path,
    columns: Specs | None = None,
    *,
    time: Mapping[str, Any] | int | str | None = None,
    start: float | str | None = None,
    stop: float | None = None,
    name: str | None = None,
    variable: str | None = None,
    guess_units: bool = False,
    uneven: bool = False,
) -> Recording:
    """Read a recording however unfit it is, so that its report can say why.

    Parameters and errors are those of :func:`load_recording`, but for unfitness and these:

    Parameters
    ----------
    guess_units : bool
        Where neither the caller nor the file says a unit take the one that the numbers speak for, as
        ``fracid init`` does (:func:`fracid.recording.guess.guessed_units`), where else it is radians.
    uneven : bool
        Whether samples are meant to lie unevenly.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "swing.csv"
    >>> _ = file.write_text("t,alpha\\n0,0.1\\n1,\\n2,0.3\\n")
    >>> inspect_recording(file).report.level
    'unfit'
    """
    path = path_of(path, "'release.csv'. Of arrays: fracid.Recording.of(name, time, signals)")
    before = _state(path)
    table = read_table(path, variable)
    named = columns.items() if isinstance(columns, Mapping) else ()
    kept = {n: c for n, c in named if isinstance(c, Mapping) and "constant" in c}
    fixed, unsaid = {n: constant(n, c) for n, c in kept.items()}, {n for n, c in kept.items() if "unit" not in c}
    if kept:
        columns = {n: c for n, c in named if n not in kept}
    clock, rows, source = read_clock(table, time)
    clock, rows, repeats = _without_repeats(table, clock, rows)
    channels, more = choose_channels(table, columns, source.column, rows)
    if columns is not None:
        refuse_shared(table, channels, source.column)
    dead = tuple(_left_out(table, rows, channels, source.column)) if columns is None else ()
    digest, reading = _digest(path), (*table.notes, *source.sentences, *repeats, *more)

    def recording(channels: Mapping[str, Channel], guesses: Mapping[str, str]) -> Recording:
        signals, assumed, said = _signals(table, rows, channels, columns is None, guesses=guesses)
        values, units = {n: x for n, (x, _) in signals.items()}, {n: unit for n, (_, unit) in signals.items()}
        report = measure(clock, values, units, (*reading, *(s for s in said if isinstance(s, str))), uneven=uneven)
        values |= {n: np.full(clock.size, value) for n, (value, _) in fixed.items()}
        findings = (*source.findings, *dead, *(one for one in said if isinstance(one, Finding)), *report.findings)
        read = Recording(
            name or path.stem, path, digest, read_only(clock), signals={n: read_only(x) for n, x in values.items()},
            units=units | {n: unit for n, (_, unit) in fixed.items()},
            report=replace(report, findings=findings), assumed=assumed | unsaid,
            held=frozenset(n for n, c in channels.items() if c.fill == "hold"),
        )  # fmt: skip
        return read if uneven else read.between_edges()

    whole = recording(channels, {})
    guessed = _guesses(whole, table, channels, columns is not None) if guess_units else {}
    if guessed:
        channels = {n: replace(c, **guessed[n][0]) if n in guessed else c for n, c in channels.items()}
        whole = recording(channels, {n: sentence for n, (_, sentence) in guessed.items()})
    if _state(path) != before:
        raise DataError(f"{path.name} changed while it was read. Is it still being written? Read it when it is done.")
    return whole if start is None and stop is None else whole.trim(start, stop)


def _without_repeats(table: Table, clock: FloatArray, rows: BoolArray) -> tuple[FloatArray, BoolArray, tuple[str, ...]]:
    """Leave rows out that repeat the one before, stamp and values: written twice, they say nothing new."""
    values = table.values[rows]
    same = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
    twice = np.concatenate([[False], np.all(same, axis=1) & (np.diff(clock) == 0)])[: clock.size]
    if not (count := int(twice.sum())):
        return clock, rows, ()
    rows = rows.copy()
    rows[np.flatnonzero(rows)[twice]] = False
    said = "row repeats the one before and was" if count == 1 else "rows repeat the one before and were"
    return clock[~twice], rows, (f"{count:,} {said} left out: the same time and the same values.",)


def _signals(
    table: Table, rows: BoolArray, channels: Mapping[str, Channel], chosen: bool, guesses: Mapping[str, str]
) -> tuple[dict[str, tuple[FloatArray, str]], frozenset[str], list[str | Finding]]:
    """Signal → samples and unit; the signals whose unit nobody says; and what was done, and found."""
    signals, assumed, sentences = dict[str, tuple[FloatArray, str]](), set[str](), list[str | Finding]()
    for signal, given in channels.items():
        column = table.find(given.column)
        channel, unit_said = channel_with_unit(table, signal, given, guessed=chosen)
        raw, beyond = measurable(table.values[:, column], channel.scale)
        sentences += [f"{signal}: {beyond}"] if beyond else []
        unsaid = not unit_of_header(table, column) and (signal in guesses or given.unit is None)
        if unsaid or given.unit == "counts":  # what has a unit of its own is no count
            raw, again = unrolled(raw)
            sentences += [f"{short_text(table.names[column])!r} {again}: the count is continued."] if again else []
        if channel.fill == "hold":
            raw, filled = hold_blanks(raw, signal, channel)
            sentences.append(filled)
        signals[signal] = (channel.convert(raw[rows].copy(), signal), channel.signal_unit)
        if not (given.unit or unit_of_header(table, column)) and channel.unit != "counts":
            assumed.add(signal)
        sentences += [said] if (said := guesses.get(signal, unit_said)) else []
    return signals, frozenset(assumed), sentences


def _left_out(table: Table, rows: BoolArray, channels: Mapping[str, Channel], time: int | None) -> Iterator[Finding]:
    """A column that is called the pendulum's angle and left out, for it never changes."""
    taken = {table.find(c.column) for c in channels.values()} | {time}
    left = [j for j, name in enumerate(table.names) if j not in taken and is_angle(name)]
    dead = [j for j in left if rows.any() and np.ptp(table.values[rows, j]) == 0.0]
    for j in dead:
        channel, name = Channel(j, unit=unit_of_header(table, j) or "1"), table.names[j]  # a number if nothing says
        yield still(name, float(channel.convert(table.values[rows, j][:1].copy(), name)[0]), channel.signal_unit)


def _guesses(recording: Recording, table: Table, channels: Mapping[str, Channel], named: bool) -> dict[str, Fields]:
    """Signal → the fields that its numbers speak for, and the sentence on them; none where they are radians."""
    guesses = {}
    for n, (fields, why) in guessed_units(recording, named=named).items():
        header = table.units[table.find(channels[n].column)]
        if fields.get("unit") != recording.units[n] and (not header or header.lower() in COUNTING):
            guesses[n] = fields, f"{n} {'says no counts a turn' if header else 'has no unit'}: taken to be {why}."
        elif "fill" in fields and channels[n].fill is None:
            guesses[n] = {"fill": fields["fill"]}, f"{n} is taken to be {why}."
    return guesses


def _state(path: Path) -> tuple[int, int] | None:
    """Return what changes when a file is written to."""
    with suppress(OSError, ValueError):  # for read_table to tell
        status = path.stat()
        return status.st_size, status.st_mtime_ns
    return None


def _digest(path: Path) -> str:
    try:
        with opened(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
