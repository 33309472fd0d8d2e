"""A project file drafted for a recording of a model of the library, other than the rotary pendulum.

Which column is what comes from :mod:`fracid.problem.roles`, units from the header, from the step of an encoder, or from
the model; the constants begin where :mod:`fracid.problem.first_values` has them.  What is free is what the recording
says something of; a constant that must be measured, such as a mass where nothing drives the rig, is fixed, and optional
elements that the recording does not ask for stand as comments.  Constants that a log says beside its samples are fixed:
those that all recordings have alike among the parameters, others with their recording.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from fracid.arrays import FloatArray, on_grid
from fracid.errors import InputError, refuse_unknown
from fracid.findings import Words, with_code
from fracid.models import Model, Parameter, model
from fracid.models.base import ZEROS
from fracid.models.library import table_of
from fracid.models.written.formulas import formula
from fracid.models.written.tree import Number
from fracid.problem.draft import (
    FEWEST,
    Draft,
    Source,
    doubts,
    let_go_again,
    moving_inputs,
    refuse_other_clock,
    with_between,
)
from fracid.problem.experiment import first_samples
from fracid.problem.first_values import FirstValues, first_values
from fracid.problem.roles import named_columns, roles_of
from fracid.problem.sensors import QUANTITIES, integrated, with_rates
from fracid.recording import Recording, Table
from fracid.recording.columns import unit_of_header
from fracid.recording.guess import Columns, Fields, in_one_unit, place_or_name, unit_of

SAYS = Words("problem/model_draft.toml")

SPAN = 10.0
"""A constant is looked for within this factor of its first value."""

STILL = 2.0
"""Steps of an encoder within which it is at a standstill: it rounds, and its lines between samples do not."""

DRIVES = ("V", "A", "N", "N m")
"""The units of what may drive a rig."""

SLIGHT = 0.1
"""An angle of rest that is looked for from 0 [rad]."""

POOR = 0.5
"""Below this share the equations at their first values hardly explain a recording."""

WELL = 0.98
"""Above this no gear is looked for."""


def draft_of_model(
    name: str, file: str | Path, columns: Mapping[str, Mapping[str, Any]] | None = None, *,
    time: Mapping[str, Any] | None = None, variable: str | None = None, zero: str | None = None,
    folder: str | Path = ".", more: Sequence[Path] = (),
) -> Draft:  # fmt: skip
    """Draft a project file for a recording of a model of the library.

    Parameters
    ----------
    name : str
        As ``fracid models`` lists it; the rotary pendulum's is :func:`fracid.draft_project`.
    file : path
    columns : mapping, optional
        Signal → its fields, as in a project file; guessed from the header if left out.
    time, variable
        As in a project file.
    zero : str, optional
        Of a model with a pendulum.
    folder : path
        Where the project file will be.
    more : sequence of Path
        Further recordings with the same columns.

    Raises
    ------
    InputError
        If a column that the model needs is missing, or the recording cannot be read.

    Examples
    --------
    >>> import fracid, tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> t = np.arange(0, 10, 0.01)
    >>> np.savez(folder / "mass.npz", time=t, x=0.1 * np.exp(-t) * np.cos(7 * t))
    >>> draft = draft_of_model("oscillator", folder / "mass.npz", {"displacement": {"column": "x"}}, folder=folder)
    >>> [line.split("=")[0].strip() for line in draft.text.splitlines() if line.startswith(("k ", "b_"))]
    ['k', 'b_displacement']
    """
    return _ModelPage(name, Source(Path(file), time, variable, Path(folder)), more, columns, zero=zero).draft()


def channels_of(model: Model, roles: Mapping[str, str], raw: Recording) -> dict[str, Fields]:
    """The channels of a model's signals, signal → column, and what their units are taken from.

    Examples
    --------
    >>> raw = Recording.of("log", np.arange(9.0), {"q": np.arange(9.0)}, units={"q": "rad"})
    >>> channels_of(model("joint"), {"angle": "q"}, raw)
    {'angle': ({'column': 'q'}, 'whose unit the header says')}
    """
    guesses = in_one_unit(raw, {n: (column, *_unit(model, n, raw, column)) for n, column in roles.items()})
    other = {note.where for note in with_code(raw.report.reading, "header-taken-as")}
    other -= {c for c, fields, _ in guesses.values() if "counts_per_turn" in fields}  # of which there is more to say
    return {n: ({"column": place_or_name(c)} | fields, why + SAYS("other-header", name=n, column=c) * (c in other))
            for n, (c, fields, why) in guesses.items()}  # fmt: skip


def _unit(model: Model, name: str, raw: Recording, column: str) -> Fields:
    """The unit of a signal that no header says, and what it is taken from."""
    unit, own = model.unit_of(name), raw.units[column]
    if column in raw.assumed:
        return unit_of(raw, column, "angle") if unit == "rad" else ({"unit": unit}, f"in {unit}, the model's unit")
    if own != unit:
        raise InputError(SAYS("other-unit", name=name, column=column, model=model, unit=unit, own=own))
    return {}, "whose unit the header says"


def _start(quantity: float | Mapping[str, float]) -> float:
    """Where the search for a sensor's quantity begins: a number's own value."""
    return quantity["start"] if isinstance(quantity, Mapping) else quantity


def states_with_unit(spec: Mapping[str, Any]) -> dict[str, str]:
    """The states that others depend on and whose first value nothing else says → their units, of ``[model]``.

    Examples
    --------
    >>> states_with_unit(table_of("capacitor")["model"])
    {'v': 'V'}
    """
    texts = [(n, str(row)) for part in ("definitions", "equations", "outputs") for n, row in spec.get(part, {}).items()]
    units = {n: row["unit"] for n, row in spec["equations"].items() if row.keys() & {"unit", "only"} == {"unit"}}
    return {n: u for n, u in sorted(units.items()) if any(re.search(rf"\b{n}\b", text) for k, text in texts if k != n)}


class _ModelPage:
    """What the template, ``model.j2``, asks about recordings."""

    def __init__(
        self, name: str, source: Source, more: Sequence[Path], columns: Mapping[str, Mapping[str, Any]] | None,
        zero: str | None,
    ) -> None:  # fmt: skip
        self.name, self.source, self.file, self.table = name, source, source.file, table_of(name)
        sources = [replace(source, file=file) for file in (source.file, *more)]
        self.rows: Mapping[str, Mapping[str, Any]] = self.table["model"]["parameters"]
        self.stems = [one.file.stem for one in sources]
        zeros = ZEROS[:2] if zero is None and "angle" in self.table["model"] else (zero,)
        either = [with_rates(model(name, **({"zero": z} if z else {})), columns or ()) for z in zeros]
        self.model: Model = either[0]
        self.notes: list[str] = []
        tables, self.logs = [one.table for one in sources], [one.read() for one in sources]
        self.beside = [dict(self._beside(table.beside)) for table in tables]
        self.raws = {c: next(r for r in self.logs if c in r.signals) for raw in self.logs for c in raw.signals}
        self.guessed: Columns = {}
        self.columns = self._columns(columns or {}, tables)
        self.channels = [self._columns_in(table) for table in tables]
        self.outputs = [n for n in self.model.outputs if n in self.columns]
        special = self.table.get("with", {})
        self.special: Mapping[str, Any] = next((special[n] for n in special if n in self.columns), {})
        alike = {n: v for n, v in self.beside[0].items() if all(log.get(n) == v for log in self.beside)}
        if unsaid := ", ".join(n for n in self.special.get("asks", ()) if n not in self.beside[0]):
            self.notes.append(f"Nothing beside the samples says {unsaid}: write what you know into [model.parameters].")
        self.fixed: dict[str, float] = self.special.get("parameters", {}) | alike
        self.own = [{n: v for n, v in log.items() if n not in alike} for log in self.beside]
        self.taken: dict[str, float] = {}
        self.recordings = [self._recording_of(*one) for one in zip(sources, self.channels, strict=True)]
        hanging, about = self.special.get("hanging", {}), self._quarter_turn()
        self.free = self.special.get("free", {}) | {n: [about + end for end in ends] for n, ends in hanging.items()}
        self.notes += [SAYS("hanging", name=n, degrees=math.degrees(about)) for n in hanging if about]
        gains = {row.get("scales") for row in self.rows.values()}
        kept = {n for n, c in self.columns.items() if c.get("constant")}
        self.always = ("always", "driven" if any(moving_inputs(r, self.model) for r in self.recordings) else "undriven")
        self.scaled = any((moving_inputs(r, self.model) | kept) - gains for r in self.recordings)  # by a known gain
        either = [with_rates(m, self.columns) for m in either]
        found = [(m, 1.0, FirstValues({}, {}, 1.0) if self.special else self._first_values(m, 1.0)) for m in either]
        for m, gear in product(either, self._gears()):
            if all(first.explained < WELL for _, _, first in found):
                found.append((m, gear, self._first_values(m, gear)))
        self.model, gear, self.first = max(found, key=lambda one: one[2].explained)
        if gear != 1.0:
            drive, geared = self.table["geared"]
            ends = sorted((gear / SPAN, SPAN * gear))
            for channels in (self.columns, *self.channels):
                channels[geared]["gain"] = {"start": gear, "lower": ends[0], "upper": ends[1]}
            self.notes.append(SAYS("geared", drive=drive, geared=geared, gear=gear))
        missing = self.unsaid if (poor := self.first.explained < POOR) else {*self.unsaid} & {*self.table["needs"]}
        self.notes += [SAYS("poor", percent=100 * self.first.explained, name=self.name)] * poor
        self.notes += [SAYS("no-input", name=n, unit=self.model.input_unit(n)) for n in missing]
        self.notes += [SAYS("unused-drive", name=n, unit=self.model.input_unit(n), column=c, drive=unit)
                       for n in self.unsaid[:1] for c, unit in self.unused.items() if unit in DRIVES]  # fmt: skip

    def _columns_in(self, table: Table) -> Columns:
        """The columns in one file: a unit that was guessed is that of a header which says none."""
        said = {n for n, c in self.columns.items() if "column" in c and unit_of_header(table, table.find(c["column"]))}
        return {n: c | ({} if n in said else self.guessed.get(n, {})) for n, c in self.columns.items()}

    def _recording_of(self, source: Source, columns: Columns) -> Recording:
        read = {n: {k: v for k, v in c.items() if k not in (*QUANTITIES, "between")} for n, c in columns.items()}
        file, recording = source.file, source.fit(read, self.model.inputs)
        refuse_other_clock(recording, source, (self.model.pendulum,))
        if len(recording.time) < FEWEST:
            raise InputError(f"{file.name} has {len(recording.time)} samples; expected {FEWEST} or more.")
        if not any(s.range > 0 for s in recording.report.signals if s.name in self.model.outputs):
            raise InputError(SAYS("still", file=file, outputs=", ".join(self.outputs)))
        if self.stems.count(file.stem) > 1:  # a logger's name, in the folder of each run
            recording = replace(recording, name=f"{file.resolve().parent.name} {file.stem}")
        taken, why = let_go_again(recording, self.model)
        self.notes += why
        self.taken |= {recording.name: taken} if taken else {}
        recording = recording.trim(None, taken) if taken else recording
        return replace(recording, report=recording.report.of_model(self.model.inputs))

    def _quarter_turn(self) -> float:
        """The one nearest to the middle of the motion, about which a load is taken to hang [rad]."""
        angles = [r.signals[n] for r in self.recordings for n in self.outputs if self.model.output_unit(n) == "rad"]
        middle = (min(map(np.nanmin, angles), default=0.0) + max(map(np.nanmax, angles), default=0.0)) / 2
        return math.pi / 2 * round(float(middle) / (math.pi / 2))

    @property
    def fit(self) -> Mapping[str, Any]:
        """What such recordings ask of the fit, also where none of them moves in its first samples."""
        still = all(np.ptp(r.signals[s.name][: first_samples(r.report.clock.step)]) <= STILL * (s.resolution or 0.0)
                    for r in self.recordings for s in r.report.signals if s.name in self.outputs)  # fmt: skip
        return {**self.special.get("fit", {}), **(self.special.get("still", {}) if still else {})}

    @property
    def unsaid(self) -> list[str]:
        """The inputs of which nobody says anything, where no input has a column."""
        said = {*self.columns, *self.model.input_rates, *self.model.input_defaults}
        return [] if {*self.model.inputs} & {*self.columns} else [n for n in self.model.inputs if n not in said]

    def is_released(self, recording: Recording) -> bool:
        """Whether it is held and let go, and nothing drives it."""
        return recording.report.release is not None and not moving_inputs(recording, self.model)

    def _beside(self, values: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
        """The constants that a log says beside its samples: numbers, and what its words mean."""
        rows = self.table.get("beside", {})
        meant = [rows[word].get(values.get(word), {}) for word in rows if word != "constants"]
        said = [pair for part in (values, *meant) for pair in part.items()]
        names = {n: Number(float(v)) for n, v in said if isinstance(v, int | float)}
        for constant, text in rows.get("constants", {}).items():
            p = self.model.parameter(constant)
            with suppress(InputError):  # the log does not have all names of the formula
                value = formula(text, names)
                if isinstance(value, Number) and p.lower <= value.value <= p.upper:
                    yield constant, value.value

    def _columns(self, given: Mapping[str, Mapping[str, Any]], tables: Sequence[Table]) -> Columns:
        """What each column is, with its unit; those that are named are believed, and the others guessed."""
        refuse_unknown(f"signal of {self.name} in --column", (*self.model.outputs, *self.model.inputs), *given)
        logs = zip(tables, self.logs, strict=True)
        named = {c: n for table, log in logs for c, n in named_columns(table, log.signals, given).items()}
        free = [c for c in self.raws if c not in named]
        roles = {n: c for n, c in roles_of(self.name, [*given, *free]).items() if n not in given and c in free}
        for signal, row in self.table.get("with", {}).items():
            if signal in (there := {*roles, *given}):
                idle = row["without"] if row["by"] in self.beside[0] or row["unless"] not in there else [signal]
                roles = {n: c for n, c in roles.items() if n not in idle}
        shown = ", ".join(self.raws)
        left = {*self.raws} - {*roles.values()} or self.model.input_rates  # nothing moves without such an input
        for name in (n for n in self.table["needs"] if not given and n not in roles and left):
            raise InputError(SAYS("no-column", file=self.file, name=name, model=self.name, signals=shown))
        columns: Columns = {n: dict(c) for n, c in given.items()}
        bare = {n for n, c in given.items() if not c.keys() & {"unit", "scale", *QUANTITIES}}
        sensors = {n: s for n, c in roles.items() if n in self.model.outputs and (s := self._sensor(n, c))}
        for name, sensor in sensors.items():
            columns |= self._taken(name, *sensor)
        guessed = {c: n for c, n in named.items() if n in bare} | {c: n for n, c in roles.items() if n not in sensors}
        for name, column, field, why in self._guesses(guessed):
            columns.setdefault(name, {"column": field})
            self.notes.append(f"{name} is taken from {column!r}, {why}.")
            self.notes += [SAYS("counts", name=name, column=column)] * ("counts_per_turn" in self.guessed[name])
        if not given:
            columns |= self._of_sensors(columns)
        if not {*columns} & {*self.model.outputs}:
            raise InputError(SAYS("no-output", file=self.file, outputs=', '.join(self.model.outputs), name=self.name,
                                  signals=shown, first=next(iter(self.model.outputs))))  # fmt: skip
        units = {n: self.model.unit_of(n) for n in given if "unit" not in columns[n]}
        self.guessed |= {n: {"unit": unit} for n, unit in units.items() if unit != "rad"}
        taken = [*roles.values(), *(c.get("column") for c in columns.values())]
        self.unused = {c: raw.units[c] for c, raw in self.raws.items() if c not in taken and not given}
        if self.unused:
            self.notes.append(f"Not used: {', '.join(map(repr, self.unused))}.")
        return columns

    def _guesses(self, columns: Mapping[str, str]) -> Iterator[tuple[str, str, int | str, str]]:
        """Signals, their columns, and what their units are taken from; one that is guessed is kept apart."""
        logs = [({n: c for c, n in columns.items() if c in raw.signals}, raw) for raw in self.logs]
        each = [(raw, channels_of(self.model, roles, raw)) for roles, raw in logs]
        for column, name in columns.items():
            found = [channels[name] for raw, channels in each if column in raw.signals]
            guesses = [one for one in found if len(one[0]) > 1]
            (fields, why), some = (guesses or found)[0], len(guesses) % len(found) > 0
            self.guessed[name] = self.guessed.get(name, {}) | {k: v for k, v in fields.items() if k != "column"}
            yield name, column, fields["column"], why + ", where no header says it" * some

    def _sensor(self, output: str, column: str) -> tuple[str, dict[str, Any]] | None:
        """What a column shows of an output, as its unit says: a rate, an acceleration, a potentiometer's volts."""
        raw = self.raws[column]
        own, unit, y = self.model.output_unit(output), raw.units[column], raw.signals[column]
        if unit in (rates := {f"{own}/s": "_rate", f"{own}/s^2": "_acceleration"}):
            return output + rates[unit], {"column": column}
        if (own, unit) == ("rad", "m/s^2"):
            return f"{output}_acceleration", {"column": column, "radius": {"start": 0.2, "lower": 0.0, "upper": 2.0}}
        if own in ("rad", "m") and unit == "V" and "V" not in self.model.input_units.values():
            middle, width = float(np.nanmean(y)), float(np.nanmax(y) - np.nanmin(y))
            gain = {"start": width, "lower": width / SPAN, "upper": SPAN * width}
            bias = {"start": middle, "lower": middle - width, "upper": middle + width}
            return output, {"column": column, "gain": gain, "bias": bias}
        return None

    def _of_sensors(self, columns: Columns) -> Columns:
        """Gyroscope, accelerometer, potentiometer, by their units, where one output alone can be what they show.

        Beside an encoder a rate is mostly made of its counts, and says nothing more; an accelerometer does.
        """
        outputs, found = [*self.model.outputs], dict(columns)
        encoders = {n for n, c in columns.items() if "gain" not in c}
        for column in (c for c in self.raws if c not in [f.get("column") for f in columns.values()]):
            shown = [(o, *s) for o in outputs if (s := self._sensor(o, column))]
            new = len(shown) == 1 and shown[0][1] not in found
            if new and ("radius" in shown[0][2] or shown[0][0] not in encoders):
                found |= self._taken(*shown[0])
        return found

    def _taken(self, output: str, name: str, fields: dict[str, Any]) -> Columns:
        self.model = with_rates(self.model, [name])
        self.notes.append(SAYS("sensor", name=name, column=fields["column"], output=output))
        return {name: fields}

    def _gears(self) -> list[float]:
        """What an output behind a gear may move for each turn of the drive: about what it did.

        Where both swing against each other no slope is that of the gear; one of whole teeth is looked for beside each.
        """
        pair = self.table.get("geared", ("", ""))
        if not {*pair} <= {*self.columns} or "gain" in self.columns[pair[1]]:
            return []
        x, y = (self.recordings[0].signals[n] - np.nanmean(self.recordings[0].signals[n]) for n in pair)
        both = float(np.nansum(x * y))
        ends = both / float(np.nansum(x * x)), float(np.nansum(y * y)) / both
        slopes = [*ends, math.copysign(math.sqrt(ends[0] * ends[1]), both)]
        return [*dict.fromkeys(float(round(g)) if abs(g) > 1 else 1 / round(1 / g) for g in slopes), *slopes]

    def _first_values(self, model: Model, gear: float) -> FirstValues:
        r, rows = next((r for r in self.recordings if moving_inputs(r, model)), self.recordings[0]), self.rows
        r = r.trim("release") if self.is_released(r) else r
        time = np.arange(r.time[0], r.time[-1], step := r.report.clock.step)
        held = {n for n in r.signals if with_between(self.columns.get(n, {}), n, r, model).get("between") == "hold"}
        signals: dict[str, FloatArray] = {n: on_grid(r.time, np.nan_to_num(s), time, step, held=n in held)
                                          for n, s in r.signals.items()}  # fmt: skip
        for n, c in ((n, c) for n, c in self.columns.items() if n in signals):
            own = gear if n in self.table.get("geared", ())[1:] else 1.0
            gain, bias = _start(c.get("gain", own)), _start(c.get("bias", 0.0))
            signals[n] = gain * signals[n] + bias if n in model.inputs else (signals[n] - bias) / gain
        for n, (of, degree) in sorted(self.model.derived.items(), key=lambda one: one[1][1]):
            signals.setdefault(of, integrated(signals.pop(n), step, degree)[0])
        starts = {s: float(signals[o][0]) for s, o in self.near.items() if o}
        sought = [n for n in rows if self.sought(n) and not (rows[n]["start"] == 0.0 and self.grows(n))]
        free = [n for n in sought if rows[n]["start"] != 0.0 or rows[n].get("free") in self.always or self._slides(n)]
        optional = [n for n in sought if rows[n]["start"] == 0.0 and not self._slides(n)]

        def beginning_at(rests: Mapping[str, float]) -> FirstValues:
            about = {n: x - rests.get(model.rest_of(n), 0.0) for n, x in signals.items()}
            found = first_values(model, step, about, free, optional=optional, starts=starts)
            return replace(found, values={n: v + rests.get(n, 0.0) for n, v in found.values.items()})

        return max(map(beginning_at, ({}, self.middles)[: 1 + bool(self.middles)]), key=lambda found: found.explained)

    @cached_property
    def middles(self) -> dict[str, float]:
        """Parameter that says where an output rests → about what it moves; an angle to a turn, or to half of one.

        A pendulum's, whose `zero` says whether it hangs there, is left at 0 where it is slight or something drives it.
        """
        r, found = self.recordings[0], dict[str, float]()
        for n in (n for n in self.outputs if self.model.rest_of(n) and "bias" not in self.columns[n]):
            rest, middle = self.model.rest_of(n), float(np.nanmedian(r.signals[n][len(r.time) // 3 :]))
            if self.model.output_unit(n) == "rad":
                middle -= (turn := math.pi if self.model.zero else 2 * math.pi) * round(middle / turn)
            free = self.rows[rest].get("free") in self.always
            if free or (not self.sought(rest) and abs(middle) > SLIGHT and not moving_inputs(r, self.model)):
                found[rest] = middle
        return found

    def sought(self, name: str) -> bool:
        """Whether a parameter is to be found from the recording."""
        return not self.is_gauge(name) and not self.rows[name].keys() & {"known", "needs"}

    def is_gauge(self, name: str) -> bool:
        """Whether a parameter must be known, for the recording tells all others as multiples of it."""
        return not self.scaled and self.rows[name].get("gauge", False)

    def _slides(self, name: str) -> bool:
        """Whether it is a dry friction, which every rig has: too small to be seen in the equations, it ends a swing."""
        return name in self.model.friction and self.model.friction[name].dry

    def grows(self, name: str) -> bool:
        """Whether a state of its own comes with a parameter."""
        return any(isinstance(e, dict) and e.get("only") == name for e in self.table["model"]["equations"].values())

    @cached_property
    def rests(self) -> list[str]:
        """Offsets of sensors that a file's zero leaves open, and angles of rest that the recordings ask for."""
        named = {self.model.rest_of(n) for n, c in self.columns.items() if "bias" not in c and c.get("zero") != "rest"}
        return [p.name for p in self.model.parameters if p.name in named
                and (p.name in self.first.values or (p.unit == "rad" and not self.sought(p.name)))]  # fmt: skip

    def draft(self) -> Draft:
        """The text, what was guessed, and the columns."""
        special = self.special.get("columns", {})
        columns = [{n: c | special.get(n, {}) for n, c in channels.items()} for channels in self.channels]
        text = self.source.text(
            "model.j2", [*zip(self.recordings, self.own, columns, strict=True)], page=self, model=self.model,
            special=self.special, outputs=self.outputs, units={self.model.unit_of(n) for n in self.outputs},
        )  # fmt: skip
        named = len(self.recordings) > 1
        found = (note for r in self.recordings for note in doubts(r, self.model, r.name if named else ""))
        return Draft(text, self.channels[0], (*self.notes, *found))

    def range(self, p: Parameter, start: float) -> tuple[float, float, float]:
        """Start and bounds: a factor about what is positive; from 0 on what may be 0; else to both sides."""
        reach = self.first.reach.get(p.name, 0.0)
        if self._slides(p.name):
            start = max(start, self.model.friction[p.name].begins * reach)
        off = p.value == 0.0 or p.name in self.model.friction
        wide = SPAN * max(abs(start), reach if off or start == 0.0 else 0.0)
        lower = (0.0 if off or p.lower == 0.0 else start / SPAN) if p.lower >= 0.0 else -wide
        return start, max(lower, p.lower), min(wide, p.upper)

    def states_of(self, order: str) -> list[str]:
        """The states that have an order."""
        return [s for s, q in zip(self.model.states, self.model.orders, strict=True) if q == order]

    @cached_property
    def near(self) -> dict[str, str]:
        """State that nothing measures and others depend on → the output near whose first sample it begins, or ""."""
        alike = {self.model.output_unit(n): n for n in self.outputs if "gain" not in self.columns[n]}
        told = {self.model.derived.get(n, (n,))[0] for n in self.columns}
        return {n: alike.get(unit, "") for n, unit in states_with_unit(self.table["model"]).items() if n not in told}

    def begins(self, recording: Recording) -> Iterator[tuple[str, float, float]]:
        """Those states, with that first sample and how far it and 0 are apart."""
        for state, output in ((s, o) for s, o in self.near.items() if o):
            y = recording.signals[output][np.isfinite(recording.signals[output])]
            yield state, float(y[0]), float(np.ptp(np.append(y, 0.0)))
