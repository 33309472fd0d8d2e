"""What the columns of a rotary pendulum's recording are, and in which units: from their names, then from how they move.

A name tells first (``theta``, ``joint0/position``, ``pend_angle``), then the motion: the pendulum swings, the arm
follows; commands and rates are neither.  A unit comes from the header, else from the numbers:

==================================================  ===================================================
the numbers                                         taken for
==================================================  ===================================================
whole, through more than 50                         counts of 4096 a turn
an encoder's step, which is a turn over a familiar  degrees or radians, in which it is
number of counts
a range above two turns in radians                  degrees: more than a pendulum does
a command, or what is called like an input          volts
==================================================  ===================================================

``fracid check`` and ``fracid init`` both take what is found here; a project file says its units itself.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.findings import with_code
from fracid.recording.columns import SAYS
from fracid.recording.faults import BOTH_SIDES, FEW_COUNTS, familiar_counts, turns_to_both_sides
from fracid.recording.recording import Recording
from fracid.safety.door import own_text

Columns = dict[str, dict[str, Any]]
"""Signal → the fields of its channel, ``column`` first."""

Fields = tuple[dict[str, Any], str]
"""Of the unit of a signal, and what these are guessed from."""

Guess = tuple[str, dict[str, Any], str]
"""A signal of a recording, the fields of its unit, and what these are guessed from."""

NAMES: dict[str, str] = tomllib.loads(own_text("models/rotary-pendulum.toml"))["columns"]
"""How the columns of angles and inputs are called, in words of a header."""

OTHER = r"dot|veloc|speed|rate|\bd_|deriv|accel|effort$|torque|stamp|offset|current|temp"
"""Who is called so is no angle."""

NOTHING = "in radians, as nothing says otherwise"
"""Where numbers say nothing of the unit."""

DIGITS = 1e6
"""Steps: what moves through more lies on the lattice of a file's digits, not of an encoder."""

LEVELS = 12
"""A column that has no more values than this, and keeps each for long, is a command."""

JUMP, EVEN, MOST = 0.125, 10.0, 0.5
"""A jump is more than this part of a signal's range, as the steps of a slow one that a converter rounds are not, and so
many times the steps before and after it; and the part of all steps, squared, that jumps are where it goes by them."""


def is_angle(name: str, what: str = "alpha") -> bool:
    """Whether a column is called the pendulum's angle, or the arm's.

    Examples
    --------
    >>> is_angle("pend_angle"), is_angle("alpha_dot"), is_angle("theta"), is_angle("theta", "theta")
    (True, False, False, True)
    """
    return bool(re.search(NAMES[what], name.lower())) and not re.search(OTHER, name.lower())


def guess_columns(recording: Recording, header: Sequence[str] = ()) -> tuple[Columns, tuple[str, ...]]:
    """Guess which column is the pendulum's angle, which the arm's, which the input, and their units.

    Parameters
    ----------
    recording : Recording
        Read without naming columns: each signal is a column of the file.
    header : sequence of str
        The columns' full names, where signals have shorter ones.

    Returns
    -------
    dict
        ``alpha``, and ``theta`` and ``voltage`` where there are such, → the fields of a channel.
    tuple of str
        What was guessed, in sentences.

    Raises
    ------
    InputError
        If no column moves.

    Examples
    --------
    >>> t = np.arange(0, 8, 0.01)
    >>> swing = np.round(4096 / 6.2832 * 0.3 * np.exp(-t / 3) * np.cos(6 * t))
    >>> found, _ = guess_columns(Recording.of("log", t, {"motor": 0.1 * swing, "pend": swing, "pend_dot": swing}))
    >>> found["alpha"], found["theta"]["column"]
    ({'column': 'pend', 'unit': 'counts', 'counts_per_turn': 4096}, 'motor')
    """
    roles = _roles(recording)
    found = _with_units(recording, roles)
    columns: Columns = {what: {"column": place_or_name(name, header)} | f for what, (name, f, _) in found.items()}
    notes = [f"{what} is taken from {name!r}, {why}." for what, (name, _, why) in found.items()]
    others = [n for n in _angles(recording) if n not in roles.values()]
    if others and "voltage" not in columns:
        notes.append(f"Not used: {', '.join(map(repr, others))}. The motor's voltage: --column voltage=COLUMN,unit=V.")
    return columns, tuple(notes)


def guessed_units(recording: Recording, *, named: bool) -> dict[str, Fields]:
    """The units of the signals of which neither the caller nor the file says one.

    Parameters
    ----------
    recording : Recording
        Read with radians for them.
    named : bool
        Whether the caller named its columns: then ``alpha``, ``theta`` and ``voltage`` are what they are called.

    Returns
    -------
    dict
        Signal → the fields of its channel, and what they are guessed from.

    Examples
    --------
    >>> t = np.arange(0, 8, 0.01)
    >>> guessed_units(Recording.of("log", t, {"alpha": 30 * np.cos(6 * t)}), named=True)["alpha"][0]
    {'unit': 'deg'}
    """
    roles = {n: n for n in NAMES if n in recording.signals} if named else {}
    if not named:
        with suppress(InputError):  # nothing moves
            roles = _roles(recording)
    units = _with_units(recording, roles).values()
    return {n: (fields, why) for n, fields, why in units if n in recording.assumed or "fill" in fields}


def _angles(recording: Recording) -> list[str]:
    """Which signals may be an angle: they move, and are not called a rate if any other is there."""
    moving = [s.name for s in recording.report.signals if s.range > 0 and s.unit in ("rad", "1")]
    return [n for n in moving if not re.search(OTHER, n.lower())] or moving


def _roles(recording: Recording) -> dict[str, str]:
    """``alpha``, ``theta``, ``voltage`` → the signal that it is."""
    reports, angles = {s.name: s for s in recording.report.signals}, _angles(recording)
    if not angles:
        raise InputError(SAYS("no-angle", path=recording.path))
    dead = [str(f) for f in recording.report.findings if f.code == "still"]
    if dead and not any(is_angle(n) for n in angles):
        raise InputError(f"{recording.path.name}: {dead[0]} Another column for it: --column alpha=COLUMN.")
    moving = [n for n, s in reports.items() if s.range > 0]
    roles = {what: _first(what, moving if what == "voltage" else angles) for what in NAMES}
    commands = [n for n in angles if n not in roles.values() and len(angles) > 1 and _is_command(recording.signals[n])]
    roles["voltage"] = roles["voltage"] or next(iter(commands), None)
    others = [reports[n] for n in angles if n not in roles.values()]
    stepped = all(s.resolution and s.range < DIGITS * s.resolution for s in others)  # for units may differ
    travel = {s.name: s.range / (s.resolution or 1.0) if stepped else s.range for s in others}
    rest = iter(sorted(travel, key=lambda n: travel[n], reverse=True))
    roles["alpha"] = roles["alpha"] or next(rest, angles[0])
    roles["theta"] = roles["theta"] or next(rest, None)
    if roles["theta"] == roles["alpha"]:
        roles["theta"] = None
    return {what: name for what, name in roles.items() if name is not None}


def _first(what: str, names: Mapping[str, Any] | list[str]) -> str | None:
    """The first name that matches and is no rate: of several, one that says it is a position or an angle."""
    matches = [n for n in names if is_angle(n, what)]
    return next((n for n in matches if re.search(r"pos|ang", n.lower())), matches[0] if matches else None)


def place_or_name(name: str, header: Sequence[str] = ()) -> int | str:
    """A column's full name; its place, where it has none, or one that is no word.

    Examples
    --------
    >>> place_or_name("column 3"), place_or_name("position", ("time", "joint/position")), place_or_name("q 1", ("q 1",))
    (3, 'joint/position', 0)
    """
    if place := re.fullmatch(r"column (\d+)", name):
        return int(place[1])
    full = [h for h in header if h == name] or [h for h in header if h.endswith(name)] or [name]
    return full[0] if re.fullmatch(r"[\w/.:-]+", full[0]) or full[0] not in header else header.index(full[0])


def _with_units(recording: Recording, roles: Mapping[str, str]) -> dict[str, Guess]:
    """``alpha``, ``theta``, ``voltage`` → what is guessed of its unit."""
    return in_one_unit(recording, {what: (name, *unit_of(recording, name, what)) for what, name in roles.items()})


def in_one_unit(recording: Recording, guesses: Mapping[str, Guess]) -> dict[str, Guess]:
    """Take the unit of another angle where nothing says one, and counts for whole numbers beside counts.

    Examples
    --------
    >>> t = np.arange(0, 8, 0.01)
    >>> log = Recording.of("log", t, {"goal": 5.0 * np.sin(t), "q": 0.087890625 * np.round(50 * np.sin(t))})
    >>> in_one_unit(log, {name: (name, *unit_of(log, name, "angle")) for name in log.signals})["goal"]
    ('goal', {'unit': 'deg'}, 'as q is')
    """
    angles = {what: one for what, one in guesses.items() if one[1].get("unit") in ("rad", "deg", "counts")}
    sure, found = {what: fields for what, (_, fields, why) in angles.items() if why != NOTHING}, dict(guesses)
    for what, (name, fields, why) in angles.items():
        whole = not np.any(np.nan_to_num(recording.signals[name]) % 1.0)
        alike = (n for n, f in sure.items() if n != what and (whole if f["unit"] == "counts" else why == NOTHING))
        if fields["unit"] != "counts" and (other := next(alike, None)):
            found[what] = name, sure[other], f"as {other} is"
    return found


def unit_of(recording: Recording, name: str, what: str) -> Fields:
    """Unit and counts of a signal, and a clause that says what they are guessed from.

    Examples
    --------
    >>> unit_of(Recording.of("log", np.arange(0, 8, 0.01), {"q": np.linspace(0, 900.0, 800)}), "q", "angle")
    ({'unit': 'deg'}, 'in degrees: two turns of radians are more than a pendulum does')
    """
    s = next(s for s in recording.report.signals if s.name == name)
    rare = {"fill": "hold"} if what == "voltage" and np.isnan(recording.signals[name]).any() else {}
    logged = ": a command that is logged when it changes" if rare else ""
    of_header = any(note.where == name for note in with_code(recording.report.reading, "unit-of-header"))
    if of_header and (what != "voltage" or recording.units[name] == "V"):
        return {**rare}, f"whose unit the header says{logged}"
    if what == "voltage":
        return {"unit": "V"} | rare, f"in volts{logged}"
    q = s.resolution
    if q is not None and abs(q - 1) < 1e-6 and s.range > FEW_COUNTS:
        return {"unit": "counts", "counts_per_turn": 4096}, "counts of 4096 a turn: its numbers are whole"
    if q and familiar_counts(360 / q) and not familiar_counts(2 * math.pi / q):
        return {"unit": "deg"}, f"in degrees: its step is that of {360 / q:.0f} counts a turn"
    if q and familiar_counts(2 * math.pi / q):
        return {"unit": "rad"}, f"in radians: its step is that of {2 * math.pi / q:.0f} counts a turn"
    if s.range > 4 * math.pi and s.range < 2000:
        return {"unit": "deg"}, "in degrees: two turns of radians are more than a pendulum does"
    if what == "alpha" and turns_to_both_sides(s, recording.signals[name])[0] >= BOTH_SIDES:
        return {"unit": "deg"}, "in degrees: in radians it would turn over to both sides, again and again"
    return {"unit": "rad"}, NOTHING


def jumps(time: FloatArray, x: FloatArray) -> bool:
    """Whether a signal goes by jumps, as a test stand's steps and pulses do: beside one it keeps still for as long.

    Examples
    --------
    >>> t = np.arange(0, 8, 0.01)
    >>> jumps(t, np.sign(np.sin(t))), jumps(t, np.round(20 * np.sin(t)) / 20)
    (True, False)
    """
    dt, steps = np.diff(time), np.abs(np.diff(x))
    before = np.abs(x[:-1] - np.interp(time[:-1] - dt, time, x))
    after = np.abs(np.interp(time[1:] + dt, time, x) - x[1:])
    least = np.maximum(JUMP * np.ptp(x), EVEN * np.maximum(before, after))[1:-1]
    return bool(np.sum(np.where(steps[1:-1] > least, steps[1:-1], 0.0) ** 2) > MOST * np.sum(steps**2))


def _is_command(x: FloatArray) -> bool:
    """Whether a column has a few values alone, and keeps each for long: steps and pulses."""
    return 2 <= np.unique(x[np.isfinite(x)]).size <= LEVELS and int(np.count_nonzero(np.diff(x))) < 0.01 * x.size
