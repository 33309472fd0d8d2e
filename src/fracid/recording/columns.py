"""Which columns of a table are signals, in which units, and which are left out.

Where the caller names no columns, signals are all that vary; the clock, blank columns, constant columns and a second
clock are left out, and the report names them.  A unit is the channel's own, or the header's, or, with a sentence
that says so, rad (rad/s for a velocity).  A column that is asked for twice, or is the clock, is refused
(:func:`refuse_shared`); blanks of a held signal take the last value before them (:func:`hold_blanks`).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from itertools import takewhile
from operator import eq

import numpy as np

from fracid.arrays import BoolArray, FloatArray
from fracid.errors import DataError, InputError, brief
from fracid.findings import Finding, Note, Words
from fracid.recording.channel import COUNTING, UNITS, Channel, Specs, header_unit, name_and_unit_behind
from fracid.recording.clock import CLOCK_STAMP, short_text, unevenness
from fracid.recording.readers.arrays import SINGLE
from fracid.recording.readers.content import TEXT
from fracid.recording.readers.table import Table

SAYS = Words("recording/columns.toml")

MOST_SIGNALS = 200
"""That are looked at where none is named: each takes milliseconds, and a rig has a dozen."""

# ---------------------------------------------------------------------------- channels


def choose_channels(
    table: Table, columns: Specs | None, time: int | None, rows: BoolArray
) -> tuple[dict[str, Channel], list[str]]:
    """Return the channels asked for, or all columns that vary, and what was guessed."""
    if columns is not None:
        if not isinstance(columns, Mapping) or not columns:
            raise InputError(f"columns = {brief(columns)} names no signal; expected e.g. {{'alpha': 2}}.")
        return {name: Channel.of(spec, name) for name, spec in columns.items()}, []
    others = [j for j in range(len(table.names)) if j != time and (unevenness(table.values[:, j]) or 1) > 1e-12]
    blank = {j for j in others if np.isnan(table.values[rows, j]).all()}
    still = {j for j in others if j not in blank and np.all(table.values[rows, j] == table.values[rows, j][0])}
    late = [j for j in others if time is not None and table.values[0, j] > CLOCK_STAMP]
    clocks = {j for j in late if np.all(np.diff(table.values[:, j]) >= 0)}  # dates that increase, or stay for a day
    counts = {j for j in others if not table.units[j] and np.all(np.diff(table.values[:, j]) == 1.0)}  # of the rows
    if not (indices := [j for j in others if j not in blank | still | clocks | counts] or [*still] or [*counts]):
        names = ", ".join(table.names[j] for j in [*blank][:20]) or ", ".join(table.names[:20])
        reason = " ".join(_left_out(table)) or f"{'Blank throughout' if blank else 'Its columns'}: {names}."
        raise DataError(f"{table.source} holds no signal besides its time. {reason}")
    indices, beyond = indices[:MOST_SIGNALS], len(indices) - MOST_SIGNALS
    sentences = [f"No columns were named: signals are {', '.join(repr(table.names[j]) for j in indices)}."]
    if beyond > 0:
        sentences.append(f"Left out as beyond {MOST_SIGNALS} signals: {beyond} columns; name those that are meant.")
    sentences += _left_out(table)
    for group, why in [(blank, "blank where time is stamped"), ([j for j in still if j not in indices], "constant")]:
        if group:
            left = ", ".join(repr(table.names[j]) for j in group)
            sentences.append(Note(f"Left out as {why}: {left}.", "blank" if group is blank else "constant"))
    twice = {name for name, count in Counter(table.names).items() if count > 1}
    first, last = min(table.names[j] for j in indices), max(table.names[j] for j in indices)
    shared = re.match(r".*[/.]|", first[: sum(takewhile(bool, map(eq, first, last)))])
    cut = len(shared[0]) if shared and len(indices) > 1 else 0  # /joint_states/joint0/position: joint0/position
    label = {j: f"{table.names[j][cut:]}{f' ({j})' * (table.names[j] in twice)}" for j in indices}
    return {label[j]: Channel(j) for j in indices}, sentences


def _left_out(table: Table) -> list[str]:
    """Say what of the file is no column and might have been meant to be one."""
    odd = [f"{name} {why}" for name, why in table.left_out.items() if why not in (TEXT.why, SINGLE)]
    more = f"; and {len(odd) - 3} more" if len(odd) > 3 else ""
    return [Note(f"Left out: {'; '.join(map(short_text, odd[:3]))}{more}.", "left-out")] if odd else []


def refuse_shared(table: Table, channels: Mapping[str, Channel], time: int | None) -> None:
    """Refuse a column that is asked for twice, or is the clock: a slip of the finger."""
    owners = {} if time is None else {time: "time"}
    for name, channel in channels.items():
        j = table.find(channel.column)
        if j in owners:
            raise InputError(SAYS("same-column", name=name, owner=owners[j], j=j, column=short_text(table.names[j]),
                                  table=table))  # fmt: skip
        owners[j] = name


NO_ANGLE = re.compile(r"[/^²³%]|^[kMmµn]?(W|J|K|Pa|bar|Hz|F|H|C|g|L|l|Ohm|Ω)$|^(°|deg ?)[CF]$")
"""Of a header that names no unit of a channel: a quotient, a power, a share, or a unit of something else."""


def unit_of_header(table: Table, column: int) -> str | None:
    """The unit that a header says of a column; None if it says none that a channel has."""
    return header_unit(table.units[column] or name_and_unit_behind(table.names[column])[1], table.names[column])


def channel_with_unit(table: Table, name: str, channel: Channel, guessed: bool) -> tuple[Channel, str | Finding | None]:
    """Return the channel with a unit (its own, the header's, or rad), and what is to be said of that."""
    column, counts = table.find(channel.column), channel.counts_per_turn
    header = table.units[column] or name_and_unit_behind(table.names[column])[1]
    counting, unit = header.lower() in COUNTING, unit_of_header(table, column)
    if counts is not None and channel.unit != "counts":
        if channel.unit is not None or not counting:
            raise InputError(SAYS("counts-without-unit", name=name, counts=counts, unit=channel.unit or "not given"))
        unit = "counts"
    elif channel.unit is not None:
        if unit is None or unit == channel.unit or channel.scale != 1.0:  # a factor converts one into the other
            return channel, None
        ratio = UNITS[channel.unit][0] / UNITS[unit][0]
        return channel, SAYS.finding("other-unit", name, max(ratio, 1 / ratio), 1.0, taken=channel.unit, header=unit)
    if unit:
        return replace(channel, unit=unit), Note(f"{name} is in {unit}, as the header says.", "unit-of-header", name)
    unit = "rad/s" if "velocity" in table.names[column].lower() else "rad"
    if not header:
        return replace(channel, unit=unit), Note(f"{name} has no unit: taken as {unit}.", f"taken-as-{unit}", name)
    if not guessed and counting:
        raise InputError(SAYS("counts-of-header", name=name))
    unit = "1" if guessed or NO_ANGLE.search(header) else unit  # who names a column says what it is
    said = SAYS("header-taken-as", name=name, header=short_text(header), unit="a number" if unit == "1" else unit)
    return replace(channel, unit=unit), Note(said, said.code, name)


def hold_blanks(raw: FloatArray, name: str, channel: Channel) -> tuple[FloatArray, str]:
    """Fill blanks with the last value before them; a command before its first is 0, and else those stay."""
    blank, before = np.isnan(raw), ""
    raw = raw[np.maximum.accumulate(np.where(blank, 0, np.arange(raw.size)))]
    if channel.unit in ("V", "N m"):
        raw, before = np.where(np.isnan(raw), 0.0, raw), " (0 before the first)"
    return raw, f"{name}: {blank.sum()} blanks hold the last value{before}."
