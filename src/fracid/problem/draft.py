"""A project file drafted from a recording: its columns guessed, its reasons in comments, and it runs as it is.

What the columns mean is found from their names first (``theta``, ``joint0/position``, ``pend_angle``), then from how
they move: the pendulum swings, the arm follows; commands and rates are neither.  Units come from the header, else from
the numbers: an encoder's step is a turn over a familiar number of counts, in one of the units.

What is left free is what such a recording determines:

=========================== =============================================================================
the recording               leaves free
=========================== =============================================================================
arm and pendulum move       both orders, the inertias, the friction of both joints; gravity C4 is given,
                            for a free response determines only ratios of constants
the arm stands still        the pendulum's order, its inertia and its friction; λ is 1: nothing shows it;
                            the coupling C3 is 0, for what holds the arm is not in the model
an input drives it          also the motor's torque per volt
small swings                C6 stays: it shows with the square of the angle
=========================== =============================================================================

Where it begins:

=========================== =============================================================================
the recording               begins at
=========================== =============================================================================
held still, then let go     the release, which :mod:`fracid.recording.report` finds: at rest, at a moment
                            between two samples that the fit finds
let go near upright         a turn of the swing well below: how it left the top, a hair decides
set swinging by hand        the turn from which on the swing decays evenly: the hand is off
driven, or at rest          its first sample
=========================== =============================================================================

Where it begins at a turn below the top, the samples before it are its past, unless they are broken, uneven or without
the arm.
"""

from __future__ import annotations

import json
import math
import os
import re
import shlex
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from fracid.arrays import BoolArray, ByName, FloatArray, spacing
from fracid.errors import InputError
from fracid.findings import Words, with_code
from fracid.models import RIGS, Model, rotary_pendulum
from fracid.models.pendulum import TABLE
from fracid.problem.experiment import held_inputs
from fracid.problem.toml_text import toml_value
from fracid.recording import Recording, SignalReport, inspect_recording
from fracid.recording.channel import UNITS
from fracid.recording.clock import time_column
from fracid.recording.columns import unit_of_header
from fracid.recording.dropout import dropouts, without_dropouts
from fracid.recording.faults import clock_jumps, other_clock, wraps
from fracid.recording.guess import Columns, guess_columns, guessed_units, is_angle, jumps
from fracid.recording.measures import GAP
from fracid.recording.readers.table import Table, read_table
from fracid.recording.report import LONG_GAP, swinging
from fracid.signals.swing import (
    common_period,
    final_value,
    half_periods,
    half_swings,
    quickening,
    releases,
    stands,
    swing_period,
)

SAYS = Words("problem/draft.toml")

REST_ERROR, MIDDLE_ERROR = math.radians(2), math.radians(11)
"""Of what rests, and of the middle of what swings: nearer to hanging its zero is the file's."""

BRIDGED = 0.25
"""Of a swing: a longer gap is not bridged by a line."""

MOTOR = "torque_per_volt"
"""What an input is seen by."""

COUPLING = "C3"
"""What an angle that counts the other way reverses."""

BEGUN = ("C1", "C3", "C6", "J_theta", "b_theta", "b_alpha", "coulomb_theta", "coulomb_alpha", "cable_stiffness", MOTOR)
"""The constants that a draft may be told to begin with."""

ENOUGH = 64
"""Samples of a swing."""

MANY_TIMES, MANY_SAMPLES = 4, 100_000
"""A recording with so many times as many, and so many in all, could have fewer."""

FEWEST = 50
"""Samples of a part that is fitted."""

STILL = 1e-2
"""An arm that moves by less than this part of the pendulum stands still."""

SMALL = math.radians(20)
"""Swings to each side below which C6 does not show."""

SPAN: float = TABLE["span"]
"""A constant is looked for within this factor of the rig's."""

LIKE = 1.5
"""A rig whose pendulum swings faster or slower than the recording's by the root of this lends it no inertias."""

TOP = math.radians(150)
"""Beyond this it is near upright, where a hair decides how it falls."""

AT_REST = 0.05
"""A pendulum that swings by less than this part of its largest swing is at rest."""

QUICK, COUNTS = 5e-3, 8
"""Small swings that are quicker by this part show a joint that gives; those below so many of the encoder's steps show
nothing."""


@dataclass(frozen=True)
class Draft:
    """What :func:`draft_project` gives."""

    text: str
    """The project file."""
    columns: Columns
    notes: tuple[str, ...]
    """What was guessed, in sentences."""


@dataclass(frozen=True)
class Source:
    """Where the samples of a draft come from, and where the draft goes."""

    file: Path
    time: Mapping[str, Any] | None
    variable: str | None
    folder: Path = Path()

    def read(self, columns: Mapping[str, Mapping[str, Any]] | None = None, **part: Any) -> Recording:
        """The recording, however unfit."""
        return inspect_recording(self.file, columns, time=self.time, variable=self.variable, **part)

    def fit(self, columns: Mapping[str, Mapping[str, Any]], inputs: Collection[str], **part: Any) -> Recording:
        """The recording as the draft takes it, its blanks bridged; one of which nothing can be made is refused.

        Those of outputs too where one is measured now and then; of one that drops out the part without is looked for.
        """
        recording = self.read(columns, **part)
        if why_uneven(recording):
            recording = self.read(columns, uneven=True, **part)
        outputs = [n for n in columns if n not in inputs]
        rarely = any(spacing(np.isfinite(recording.signals[n])) > 1 for n in outputs)
        recording = recording.bridge_blanks(outputs if rarely else ())
        for why in recording.report.unusable:
            raise InputError(f"{self.file.name}: {why}")
        return recording

    @property
    def table(self) -> Table:
        """What stands in the file."""
        return read_table(self.file, self.variable)

    def text(self, template: str, recordings: Sequence[tuple[Recording, ByName, Columns]], **values: Any) -> str:
        """A project file from its template; recordings with the constants that each knows for itself, and columns."""
        from jinja2 import Environment, PackageLoader, StrictUndefined

        def path(recording: Recording) -> str:
            return os.path.relpath(Path(recording.path).resolve(), self.folder.resolve()).replace(os.sep, "/")

        jinja = Environment(loader=PackageLoader("fracid.problem", "."), undefined=StrictUndefined, trim_blocks=True,
                            lstrip_blocks=True, keep_trailing_newline=True)  # fmt: skip
        jinja.filters |= {"toml": toml_value, "with_code": with_code, "at": lambda text, column=40: text.ljust(column)}
        words = {"line": toml_line, "free": toml_range, "path": path, "time": self.time, "variable": self.variable,
                 "uneven": why_uneven, "with_between": with_between}  # fmt: skip
        return jinja.get_template(template).render(words | values, recordings=recordings)


def moving_inputs(recording: Recording, model: Model) -> set[str]:
    """The inputs that move."""
    return {s.name for s in recording.report.signals if s.range > 0} & {*model.inputs}


def doubts(recording: Recording, model: Model, name: str = "") -> tuple[str, ...]:
    """What may be wrong with a recording, with its name where it is one of several."""
    findings = recording.report.of_model(model.inputs).findings
    return tuple(f"May be wrong: {name}{': ' * bool(name)}{f}" for f in findings)


def let_go_again(recording: Recording, model: Model) -> tuple[float | None, tuple[str, ...]]:
    """When a hand takes what was let go again [s], None where it does not; and what to type for other releases."""
    r, swing = recording.report.release, swinging(recording.signals, recording.units)
    if r is None or moving_inputs(recording, model) or len(spans := releases(recording.time, swing)) < 2:
        return None, ()
    (start, stop), *others = sorted(spans, key=lambda span: abs(span[0] - r))
    pairs = "; ".join(f"from = {a:.6g}, to = {b:.6g}" for a, b in sorted(others))
    said = SAYS("releases", name=recording.name, count=len(spans), start=start, stop=stop, pairs=pairs)
    return None if stop == recording.time[-1] else float(f"{stop:.6g}"), (said,)


def with_between(fields: Mapping[str, Any], name: str, recording: Recording, model: Model) -> dict[str, Any]:
    """The fields of a signal, with ``between`` of an input that moves and whose rate the model does not take."""
    if name not in moving_inputs(recording, model) - {*model.input_rates.values()}:
        return {**fields}
    held = name in held_inputs(recording.units, model) or jumps(recording.time, recording.signals[name])
    return {**fields, "between": "hold" if held else "line", **fields}


JITTER, FEW = 0.02, 20_000
"""Of half of the steps, relative, from which on they are no grid; in so few samples: more are fitted on one, faster."""


def why_uneven(recording: Recording) -> str:
    """Why samples are to stay where they are: they crowd in a quarter of the record, or jitter; else nothing.

    Examples
    --------
    >>> t = np.append(np.arange(0, 1, 0.01), np.arange(1, 100, 1.0))
    >>> why_uneven(Recording.of("relaxes", t, {"force": 1 / (1 + t)}))
    'its samples crowd where much happens'
    """
    dt = np.diff(recording.time)
    if recording.report.clock.crowded:
        return "its samples crowd where much happens"
    jitters = len(dt) < FEW and np.median(np.abs(dt - np.median(dt))) > JITTER * np.median(dt)
    return "its stamps jitter, and straight lines between samples are not the motion" if jitters else ""


def guess_file(
    file: str | Path, *, time: Mapping[str, Any] | None = None, variable: str | None = None
) -> tuple[Columns, tuple[str, ...]]:
    """Guess the columns of a file: those of :func:`guess_columns`, and a command that is logged when it changes.

    Parameters and errors are those of :func:`draft_project`.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "log.csv"
    >>> rows = [f"{k / 100},{math.cos(k / 10):.4f},{'' if k % 50 else k}" for k in range(200)]
    >>> _ = path.write_text("stamp,pendulum,command\\n" + "\\n".join(rows))
    >>> guess_file(path)[0]["voltage"]
    {'column': 'command', 'unit': 'V', 'fill': 'hold'}
    """
    source = Source(Path(file), time, variable)
    raw, table = source.read(), source.table
    columns, notes = guess_columns(raw, table.names)
    if "voltage" not in columns and (command := _rare_command(table)):
        of_header = UNITS.get(unit_of_header(table, table.find(command)) or "", (1.0, ""))[1] == "V"
        columns["voltage"] = {"column": command} | ({} if of_header else {"unit": "V"}) | {"fill": "hold"}
        unit = "whose unit the header says" if of_header else "in volts"
        return columns, (*notes, SAYS("rare-command", command=command, unit=unit))
    return columns, notes + with_code(raw.report.reading, "blank") * ("voltage" not in columns)


def draft_project(
    file: str | Path,
    columns: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    time: Mapping[str, Any] | None = None,
    variable: str | None = None,
    rig: str | None = None,
    folder: str | Path = ".",
    starts: Mapping[str, float] | None = None,
) -> Draft:
    """Draft a project file for a recording of a rotary pendulum.

    Parameters
    ----------
    file : path
        The recording.
    columns : mapping, optional
        Signal (``alpha``, ``theta``, ``voltage``) → its fields, as in a project file; guessed if left out.
    time, variable
        As in a project file.
    rig : str, optional
        Rig whose constants are the initial values; ``srv02-rotpen`` if left out.
    folder : path
        Where the project file will be: the recording's path is written as seen from there.
    starts : mapping, optional
        Where the search of constants begins, in place of the rig's and of guesses [SI].

    Raises
    ------
    InputError
        If the recording cannot be read, the rig is unknown, or no column can be the pendulum's angle.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> t = np.arange(0, 8, 0.01)
    >>> alpha = 0.3 * np.exp(-t / 3) * np.cos(6 * t)
    >>> np.savez(folder / "swing.npz", time=t, alpha=alpha)
    >>> draft = draft_project(folder / "swing.npz", folder=folder)
    >>> _ = (folder / "rig.toml").write_text(draft.text)
    >>> from fracid import load_project
    >>> load_project(folder / "rig.toml").problem.names[:2]
    ('mu', 'C1')
    """
    source, rig_name = Source(Path(file), time, variable, Path(folder)), rig or "srv02-rotpen"
    rotary_pendulum(rig_name)  # refuses an unknown one
    if columns is None:
        column_specs, notes = guess_file(file, time=time, variable=variable)
        notes += (SAYS("no-arm"),) * ("theta" not in column_specs)
    else:
        column_specs, notes = {n: dict(c) for n, c in columns.items()}, ()
        if "alpha" not in column_specs:
            raise InputError("No column is named for alpha, the pendulum's angle; type --column alpha=COLUMN.")
    part: dict[str, float | None] = {}

    def read() -> Recording:
        return source.fit(column_specs, ("voltage",), **part)

    refuse_other_clock(read(), source, ("alpha", "theta"))
    for complete in (_units, _wraps):
        notes = (*notes, *complete(read(), column_specs))
    part, why = _window(read())
    notes += why
    notes = (*notes, *_zeros(read(), column_specs))
    taken, why = let_go_again(read(), rotary_pendulum(rig_name))
    part, notes = part | ({"stop": taken} if taken else {}), notes + why
    recording = read()
    notes += with_code(recording.report.reading, "interpolated")
    notes += doubts(recording, rotary_pendulum(rig_name))
    if rig is None and not starts:
        notes += (SAYS("no-rig", rig_name=rig_name, rigs=", ".join(n for n in RIGS if n != rig_name)),)
    page = _PendulumPage(recording, rig_name, part, starts=starts or {})
    text = source.text("rotary-pendulum.j2", [(recording, {}, column_specs)], page=page, columns=column_specs,
                       guessed=rig is None, rigs=RIGS, outputs=[*page.joints], enough=ENOUGH, taken=taken)  # fmt: skip
    return Draft(text, column_specs, notes)


def refuse_other_clock(recording: Recording, source: Source, angles: Collection[str]) -> None:
    """Refuse a clock in another unit, with which the constants would be nobody's, as `angles` of a pendulum show it.

    Whoever says the unit of time, or the rate, is believed.
    """
    said = (source.time or {}).keys() & {"unit", "rate"}
    for f in recording.report.findings:
        if f.code == "wrong-clock" and f.where in angles and not said:
            column = time_column(source.table, source.time)
            typed = shlex.join(["fracid", "init", str(source.file), *other_clock(f.number, column)])
            sentence = re.split(" Type | Give ", str(f))[0]
            raise InputError(f"{source.file.name}: {sentence} Type {typed}; or --time {column},unit=s, if it is right.")


# --- what the columns are ----------------------------------------------------------------------------


def _units(recording: Recording, columns: Columns) -> Iterator[str]:
    """Units of the columns that say none."""
    for name, (fields, why) in guessed_units(recording, named=True).items():
        columns[name] |= fields
        yield f"{name} is taken to be {why}."


def _wraps(recording: Recording, columns: Columns) -> Iterator[str]:
    """Angles whose count was wrapped are unwrapped."""
    for name in (n for n in ("alpha", "theta") if n in columns and wraps(recording.signals[n]).any()):
        columns[name] |= {"unwrap": True}
        yield f"{name} jumps by whole turns, where its count was wrapped: unwrap undoes that."


def _zeros(recording: Recording, columns: Columns) -> Iterator[str]:
    """Where the angles are zero, if nothing says it."""
    for name, zero_of in {"alpha": _zero, "theta": _arm_zero}.items():
        if name in columns and "zero" not in columns[name]:
            zero, why = zero_of(next(s for s in recording.report.signals if s.name == name), recording)
            columns[name] |= zero
            yield from [why] if why else ()


def _zero(s: SignalReport, recording: Recording) -> tuple[dict[str, Any], str]:
    """Where alpha is zero when it hangs: at the end of the record, where it rests there or about which it swings."""
    swinging = recording.signals[s.name][np.isfinite(recording.signals[s.name])]
    rest = s.rest if s.at_rest else final_value(swinging)
    if rest is None:
        return {}, "alpha does not come to rest, so its zero is the file's: is it 0 where the pendulum hangs?"
    turns, at = round(rest / math.pi), "rests at" if s.at_rest else "swings to the end about"
    if abs(rest - turns * math.pi) > (REST_ERROR if s.at_rest else MIDDLE_ERROR):
        why = f"alpha {at} {math.degrees(rest):.1f}°, which is taken for hanging."
        return {"zero": "rest" if s.at_rest else round(rest, 6)}, why
    if turns == 0 or (turns % 2 and _stands(recording, turns * math.pi)):
        return {}, ""
    where = "upright" if turns % 2 else "some turns away"
    return {"zero": round(turns * math.pi, 9)}, f"alpha {at} {180 * turns}°: the encoder's zero is {where}."


def _stands(recording: Recording, top: float = 0.0) -> bool:
    """Whether a motor balances the pendulum about an angle of the encoder."""
    signals, step = recording.signals, recording.step
    if step is None or not np.ptp(signals.get("voltage", 0.0)) > 0:
        return False
    return stands(signals["alpha"] - top, signals.get("theta"), step)


def _arm_zero(s: SignalReport, recording: Recording) -> tuple[dict[str, Any], str]:
    """An arm that is turns away from zero is brought back: nothing depends on its angle but the cable."""
    first = float(next(iter(recording.signals[s.name]), 0.0))
    where, zero = ("ends", s.rest) if s.at_rest or not math.isfinite(first) else ("begins", first)
    if not abs(zero) >= 1.0:
        return {}, ""
    return {"zero": round(zero, 6)}, f"theta {where} at {zero:.4g} rad, which is taken for its zero."


# --- which part of it ----------------------------------------------------------------------------------


def _window(recording: Recording) -> tuple[dict[str, float | None], tuple[str, ...]]:
    """The part that clock and samples leave whole, with most swings between gaps and jumps, and why; {} for all."""
    t, alpha = recording.time, recording.signals["alpha"]
    whole = np.ones(t.size, dtype=bool)  # held signals have no blanks
    gone = dropouts(t, recording.signals, recording.units)
    sound = without_dropouts(recording.signals, gone)
    sampled = np.all([whole, *(np.isfinite(x) for n, x in sound.items() if n not in recording.held)], axis=0)
    broken = _breaks(recording) | ~sampled[1:] | ~sampled[:-1]
    pieces = [p[sampled[p]] for p in np.split(np.arange(t.size), np.flatnonzero(broken) + 1)]
    pieces = [p for p in pieces if p.size >= FEWEST]
    if not pieces or not broken.any():
        return {}, ()
    best = max(pieces, key=lambda p: (half_swings(alpha[p]).size, p.size))
    before, after = t[: best[0]], t[best[-1] + 1 :]
    # where a clock goes back times come twice
    low = max(t[best[0]], np.nextafter(np.max(before, initial=-np.inf), np.inf))
    high = min(t[best[-1]], np.nextafter(np.min(after, initial=np.inf), -np.inf))
    if np.count_nonzero((t[best] >= low) & (t[best] <= high)) < max(FEWEST, best.size // 2):
        return {}, ()
    names = " and ".join(dict.fromkeys(d.signal for d in gone))
    sound_is = f"{names} does not drop out" if gone else "no sample is missing and the clock is even"
    start = None if best[0] == 0 else math.ceil(1e6 * low) / 1e6
    stop = None if best[-1] == t.size - 1 else math.floor(1e6 * high) / 1e6
    return {"start": start, "stop": stop}, (f"From {low:.4g} to {high:.4g} s {sound_is}: that part is fitted.",)


def _breaks(recording: Recording) -> BoolArray:
    """After which samples the clock goes back, repeats itself, jumps, or misses a part of a swing, shape (n - 1,)."""
    t, alpha = recording.time, recording.signals["alpha"]
    dt, clock = np.diff(t), recording.report.clock
    if not clock.step > 0:
        return np.zeros(dt.size, dtype=bool)
    swing = np.asarray(alpha[np.isfinite(alpha)])
    period = clock.step * swing_period(swing) if swing.size >= FEWEST else math.inf
    long = max(min(BRIDGED * period, LONG_GAP * clock.duration), GAP * clock.step)
    spans = chain(recording.bridged, *recording.blanks.values())
    blank = np.any([(a < t[:-1]) & (t[:-1] < b) for a, b in spans if b - a > long], axis=0)
    jumps = np.isin(t[:-1], [at for at, _ in clock_jumps(t, alpha)])
    return np.asarray((dt <= 0) | (dt > long) | blank | jumps)


# --- how it moves ------------------------------------------------------------------------------------


def _rare_command(table: Table) -> str | None:
    """A column that is called like an input, is blank in part, and has more than one value."""
    commands = ((n, x) for n, x in zip(table.names, table.values.T, strict=True) if is_angle(n, "voltage"))
    return next((n for n, x in commands if not np.isfinite(x).all() and np.unique(x[np.isfinite(x)]).size > 1), None)


def _way(recording: Recording) -> float:
    """1 if the arm, still until then, first goes with the voltage, -1 if against it, 0 where that cannot be seen."""
    if not {"voltage", "theta"} <= set(recording.signals):
        return 0.0
    u, theta = np.nan_to_num(recording.signals["voltage"]), np.nan_to_num(recording.signals["theta"])
    on = np.flatnonzero(u != 0)
    if not on.size:
        return 0.0
    end = min(on[0] + round(0.25 / recording.report.clock.step), theta.size)
    turned = np.flatnonzero(u[on[0] : end] * u[on[0]] <= 0)
    displacement = theta[on[0] : on[0] + turned[0] if turned.size else end] - theta[on[0]]
    furthest = float(displacement[np.argmax(np.abs(displacement))])
    observable = abs(furthest) > 0.02 * float(theta.max() - theta.min())
    return math.copysign(1.0, furthest * float(u[on[0]])) if observable else 0.0


def _free_from(time: FloatArray, alpha: FloatArray) -> float | None:
    """The turn from which on a swing decays evenly, well below the top; None from the first sample on."""
    passes = np.flatnonzero(np.diff(np.signbit(alpha))) + 1
    swings = [s for s in np.split(np.arange(alpha.size), passes) if s.size > 2]
    turns = np.array([s[np.argmax(np.abs(alpha[s]))] for s in swings], dtype=np.intp)
    high = np.abs(alpha[turns])
    wide = int(np.count_nonzero(high > 0.2 * high.max())) if high.size else 0
    if wide < 4:
        return None
    decay = np.log(high[: wide - 1] / high[1:wide])
    even = np.abs(decay - np.median(decay)) < max(2 * abs(float(np.median(decay))), 0.1)
    at_rest = turns[0] <= 0.02 * (turns[1] - turns[0])  # it begins at a turn
    if at_rest and even[0] and high[0] <= TOP:
        return None
    good = [k for k in range(1, wide - 1) if even[k] and high[k] <= TOP]
    return float(time[turns[good[0]]]) if good else None


# --- the page ------------------------------------------------------------------------------------------


class _PendulumPage:
    """What the template, ``rotary-pendulum.j2``, asks about a recording."""

    sharp = TABLE["model"]["parameters"]["slip_speed"]["between"]
    """Slip speeds of dry friction [rad/s] between which it is sought: nobody has measured it, and intervals depend on
    it."""

    def __init__(self, recording: Recording, rig: str, window: Mapping[str, Any], starts: ByName) -> None:
        self.recording, self.rig, self.window, self.starts = recording, rig, window, starts
        self.model = rotary_pendulum(rig)
        self.own = {p.name: p.value for p in self.model.parameters}
        signals, reports = recording.signals, {s.name: s for s in recording.report.signals}
        self.alpha = alpha = reports["alpha"]
        swing = max(abs(alpha.maximum - alpha.rest), abs(alpha.minimum - alpha.rest))
        self.small, self.degrees = swing < SMALL, math.degrees(swing)
        self.arm = "theta" in reports and reports["theta"].range > STILL * alpha.range
        self.driven = "voltage" in reports and reports["voltage"].range > 0
        self.joints = {"theta": "arm", "alpha": "pendulum"} if self.arm else {"alpha": "pendulum"}
        self.stands = _stands(recording)
        release = recording.report.release
        self.first = 0 if release is None else int(np.searchsorted(recording.time, release))
        self.at_the_top = bool(release is not None and abs(signals["alpha"][self.first]) > TOP)
        self.held = release is not None and not self.driven and not self.at_the_top
        self.turn = None if self.driven or self.held else _free_from(recording.time, np.nan_to_num(signals["alpha"]))

    @cached_property
    def motor(self) -> tuple[float, float, float, str]:
        """Where the search for the torque per volt begins, its bounds, and which way the arm goes, if that is seen."""
        k, given = self.own[MOTOR] or 0.05, self.starts.get(MOTOR)
        way = _way(self.recording) if given is None else given or -1.0
        start = given if given is not None else math.copysign(k, way or k)
        far = abs(start) * SPAN**2
        low, high = sorted((start / SPAN**2, start * SPAN**2)) if way else (-far, far)
        goes = f"the arm goes {'with' if way > 0 else 'against'} the voltage" if way else "either way"
        return start, low, high, f"{goes} [N m/V]"

    @property
    def most(self) -> float:
        """Dry friction of a motor that turns [N m]."""
        voltage = float(np.nanmax(np.abs(self.recording.signals["voltage"]))) if self.driven else 0.0
        return max(self.own["C4"], SPAN * abs(self.motor[0]) * voltage)

    def friction(self, name: str, start: float, reach: float, meaning: str = "") -> str:
        """The line of a constant that is 0 or more."""
        start = self.starts.get(name, start)
        return toml_range(name, start, 0.0, max(reach, SPAN * start), comment=meaning or self.meaning(name))

    def inertia(self, name: str) -> str:
        """The line of an inertia: of a pendulum whose arm stands still from its period, else the rig's."""
        own = self._inertia if name == "C1" and not self.arm else self.own[name] * self._slower
        start = abs(self.starts.get(name, own))  # a coupling below 0 is of angles that count in two directions
        return toml_range(name, start, start / SPAN, start * SPAN, comment=self.meaning(name))

    def meaning(self, name: str) -> str:
        """What a constant is, and its unit."""
        p = self.model.parameter(name)
        return f"{p.description.split(' (')[0]} [{p.unit}]"

    @property
    def quicker(self) -> float:
        """By which part small swings of a clamped rig are quicker than its large ones; 0 where that is nothing."""
        if self.arm or self.driven:  # an arm that sticks quickens the pendulum too
            return 0.0
        part = quickening(self._swing, COUNTS * (self.alpha.resolution or 0.0))
        return part if part > QUICK else 0.0

    @property
    def _swing(self) -> FloatArray:
        """The pendulum about its rest, from its release on."""
        return np.nan_to_num(self.recording.signals["alpha"] - self.alpha.rest)[self.first :]

    @cached_property
    def _inertia(self) -> float:
        """C1 of a pendulum whose arm stands still, from its period: C4/ω²."""
        crossings, _ = half_periods(self._swing, AT_REST * np.abs(self._swing).max())
        half = self.recording.report.clock.step * float(np.median(np.diff(crossings) if crossings.size > 1 else 0.0))
        return self.own["C4"] * (half / math.pi) ** 2 or self.own["C1"]

    @cached_property
    def _slower(self) -> float:
        """By what all inertias of the rig are to be multiplied so that its pendulum swings as in the recording.

        At small angles ω² is C4 / (C1 − C3²/J_theta) where the arm is free, C4 / C1 where its friction holds it, and
        between the two otherwise; 1 where the recording's is there, or near, or where something drives it.
        """
        if not self.arm or self.driven:
            return 1.0
        C1, free = self.own["C1"], self.own["C1"] - self.own["C3"] ** 2 / self.own["J_theta"]
        factor = min(self._inertia / free, 1.0) if self._inertia < free else max(self._inertia / C1, 1.0)
        return factor if not 1 / LIKE < factor < LIKE else 1.0

    @cached_property
    def period(self) -> float:
        """Samples of a swing."""
        return common_period(np.column_stack([self.recording.signals[n] for n in self.joints]))

    @property
    def every(self) -> float:
        """A step for a recording that has many more samples than its swings need [s], else 0."""
        every, r = self.period / ENOUGH, self.recording
        many = every >= MANY_TIMES and len(r.time) >= MANY_SAMPLES
        return float(f"{every * r.report.clock.step:.1g}") if many else 0.0


def toml_line(key: str, value: str, comment: str = "") -> str:
    """Return a key with a text, and a comment behind it.

    Examples
    --------
    >>> toml_line("use", "fit")
    'use = "fit"'
    """
    line = f"{key} = {json.dumps(value, ensure_ascii=False)}"
    return f"{line:<40}# {comment}" if comment else line


def toml_range(name: str, start: float, lower: float, upper: float, comment: str) -> str:
    """Return a parameter with its range, and a comment behind it.

    Examples
    --------
    >>> toml_range("k", 2.0, 1.0, 3.0, "its stiffness").split("  ")[0]
    'k = { start = 2, lower = 1, upper = 3 }'
    """
    table = f"{name} = {{ start = {start:.4g}, lower = {lower:.3g}, upper = {upper:.3g} }}"
    return f"{table:<69} # {comment}"
