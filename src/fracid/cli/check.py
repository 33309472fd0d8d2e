"""``fracid check FILE``: what a recording is worth, as a table, a sketch and a one-line verdict."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from fracid.cli.app import How, command, each_once, new_console, print_table, say, say_next, typed, warn
from fracid.errors import DataError, InputError
from fracid.tasks.display import shown
from fracid.workflows.records import words_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from rich.console import Console

    from fracid.recording import Recording, Report
    from fracid.recording.guess import Columns


@command
def check(file: Path, how: How) -> None:
    """Check a recording: clock, signals, release, fitness for use.

    Exit code 0 if it is good or usable, 3 if it is unfit.
    """
    with shown("recording") as observer:
        from fracid.recording import inspect_recording
        from fracid.workflows.overview import write_overview

        clock = time_from_text(how.time, how.rate)
        own, notes = ({}, []) if how.column else _columns_of_model(file, clock, how.variable)
        recording = inspect_recording(file, own or columns_from_texts(how.column), time=clock, stop=how.stop,
                                      start=start_from_text(how.start), variable=how.variable,
                                      guess_units=True)  # fmt: skip
        recording = replace(recording, report=recording.report.of_model(_inputs(recording)))
        figure = None if how.out is None else write_overview(recording, how.out, observer)
    head = {"name": recording.name, "file": str(recording.path), "sha256": recording.sha256, "step": recording.step}
    record = head | recording.report.to_dict() | {"figure": str(figure) if figure else None}
    how.answer(record, lambda _: print_check(recording, figure, notes))
    if not recording.report.faults and not how.json_:
        _say_next(recording, {name: vars(how)[name] for name in ("column", "time", "rate", "variable")}, own)
    if recording.report.level == "unfit":
        raise typer.Exit(DataError.exit_code)


def _columns_of_model(file: Path, clock: Any, variable: str | None) -> tuple[Columns, list[str]]:
    """The columns of a table of one model, as ``fracid init`` takes them, and notes; none of a rotary pendulum's."""
    from fracid.findings import Note
    from fracid.problem.roles import ROTARY, likely_models
    from fracid.recording import inspect_recording

    raw = inspect_recording(file, time=clock, variable=variable)
    likely = likely_models([*raw.signals])
    if len(likely) != 1 or ROTARY in likely:
        return {}, []

    from fracid.models import model
    from fracid.problem.model_draft import channels_of

    ((name, roles),) = likely.items()
    found = channels_of(model(name), roles, raw)
    notes = [str(note) for note in raw.report.notes if isinstance(note, Note) and note.code == "left-out"]
    notes += [f"{signal} is taken from {roles[signal]!r}, {why}." for signal, (_, why) in found.items()]
    return {signal: fields for signal, (fields, _) in found.items()}, notes


def _inputs(recording: Recording) -> set[str]:
    """Signals that are called like inputs of the models that it may be of."""
    from fracid.models.library import table_of
    from fracid.problem.roles import likely_models

    return {n for name in likely_models([*recording.signals]) for n in table_of(name)["model"].get("inputs", ())}


def _say_next(recording: Recording, options: Mapping[str, Any], own: Columns) -> None:
    found = {f.code: f for f in recording.report.findings}
    again, why = dict(options), ""
    if "still" in found:
        say_next(new_console(), (typed("check", recording.path, *words_of(options), "--column", "alpha=COLUMN"),
                                 "if another column is the pendulum's angle"))  # fmt: skip
    if recording.report.level == "unfit":
        return
    if "wrong-clock" in found and options["time"] is options["rate"] is None:
        from fracid.recording.clock import time_column
        from fracid.recording.faults import other_clock
        from fracid.recording.readers.table import read_table

        column = time_column(read_table(recording.path, options["variable"]), None)
        option, text = other_clock(found["wrong-clock"].number, column)
        again[option.removeprefix("--")], why = text, "if that is its clock"
    if columns := _in_doubt(recording, options, own):
        again["column"] = columns
        why = "if these are the columns and units; else change them: rad, deg, turns, counts"
    steps = [(typed("check", recording.path, *words_of(again)), why)] if why else []
    words = [*words_of(again if "wrong-clock" in found else options)]
    steps += [(typed("init", recording.path, *words, *which), why) for which, why in models_for(recording, own)]
    say_next(new_console(), *steps)


def models_for(recording: Recording, own: Columns) -> list[tuple[tuple[str, ...], str]]:
    """What ``fracid init`` is to be told of the model, and what it then does: what it cannot decide is asked here."""
    from fracid.problem.roles import likely_models

    likely = likely_models([str(c["column"]) for c in own.values()] if own else list(recording.signals))
    if len(likely) == 1:
        return [((), f"writes a project of the model {next(iter(likely))}, which runs as it is")]
    if likely:
        return [(("--model", n), f"if it is of the model {n}") for n in likely]
    return [(("--model", "NAME", "--column", "NAME=COLUMN"), "no model has columns of these names: see fracid models")]


def _doubted(recording: Recording) -> dict[str, str]:
    """Signals whose unit is in doubt → the unit to try: taken as radians for nothing says otherwise, or misread."""
    from fracid.findings import with_code

    report = recording.report
    taken = {note.where for note in with_code(report.reading, "taken-as-rad")}
    unsaid = {s.name: "rad" for s in report.signals if s.name in taken & recording.assumed and not s.counts_per_turn}
    return unsaid | {f.where: MISREAD[f.code] for f in report.findings if f.code in MISREAD}


def _in_doubt(recording: Recording, options: Mapping[str, Any], own: Columns) -> list[str]:
    """The columns as ``--column`` takes them, with the units to try; none where no unit is in doubt."""
    from fracid.problem.draft import guess_file

    doubted = _doubted(recording)
    columns: Columns = own or columns_from_texts(options["column"]) or {}
    if doubted and not columns:
        try:
            time = time_from_text(options["time"], options["rate"])
            columns, _ = guess_file(recording.path, time=time, variable=options["variable"])
        except InputError:  # nothing moves
            return []
    units = {name: {"unit": unit} for name, unit in doubted.items()}
    return [f"{n}={text_of_column(fields | units.get(n, {}))}" for n, fields in columns.items()] if doubted else []


# ------------------------------------------------------------------ from text to arguments


def column_from_text(text: str) -> tuple[str, dict[str, Any]]:
    """Parse ``alpha=2,unit=deg,zero=rest``."""
    name, _, rest = text.partition("=")
    if not name or rest[:1] in ("", ","):
        raise InputError(f"--column {text!r} is not possible; expected NAME=COLUMN, e.g. --column alpha=2,unit=deg.")
    return name, _channel(f"--column {text!r}", rest)


def _channel(option: str, text: str) -> dict[str, Any]:
    """Parse ``2,unit=deg``: a column, by name or place, or ``constant=3``, with what is said of it."""
    column, *fields = text.split(",")
    key, value = _field(column) if column.startswith("constant=") else ("column", _number(column))
    return {key: value} | each_once(option, map(_field, fields))


def text_of_column(fields: Mapping[str, Any]) -> str:
    """``2,unit=rad``: as :func:`column_from_text` reads it."""
    return ",".join(str(v) if k == "column" else f"{k}={v}" for k, v in fields.items())


def columns_from_texts(texts: list[str] | None) -> dict[str, dict[str, Any]] | None:
    """Parse what ``--column`` was given, None for nothing; a signal that has two columns is refused."""
    return each_once("--column", map(column_from_text, texts)) if texts else None


def _field(text: str) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    return key.strip(), _number(value) if equals else True


def _number(text: str) -> int | float | str | bool:
    """Return the number that the text is, else the text."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


def time_from_text(column: str | None, rate: float | None) -> dict[str, Any] | None:
    """Parse ``0,unit=ms``, or take a rate."""
    if column is not None and rate is not None:
        raise InputError("give --time or --rate, not both.")
    if rate is not None:
        return {"rate": rate}
    return None if column is None else _channel("--time", column)


def start_from_text(text: str | None) -> float | str | None:
    """Parse a time, or ``release``."""
    value = None if text is None else _number(text)
    if isinstance(value, str) and value != "release":
        raise InputError(f"--from {text!r} is not possible; expected a time [s] or release.")
    return value


# ------------------------------------------------------------------ from results to text


def print_check(recording: Recording, figure: Path | None, notes: Sequence[str] = ()) -> None:
    """Show what a recording is worth."""
    from rich.markup import escape

    console, report = new_console(), recording.report
    console.print(f"[bold]{escape(recording.name)}[/bold]  {escape(str(recording.path))}")
    for what, value in report.rows():
        console.print(f"  {what:9} {escape(value)}", soft_wrap=True)
    in_degrees = {f.where: 180 / pi for f in report.findings if f.code == "radians-as-degrees"}
    print_signals(console, report, dict.fromkeys(_doubted(recording), 1.0) | in_degrees)
    print_sketches(console, recording)
    warn(console, *[*notes, *_folded(report.notes)][:MOST], mark="  • ")
    _print_rest(console, len(_folded(report.notes)), "notes")
    colour = {"good": "green", "usable": "yellow", "unfit": "red"}[report.level]
    say(console, f"[bold {colour}]{escape(report.verdict)}[/]")
    console.print(f"figure: {escape(str(figure))}" if figure else "[dim]figure: add --out DIR[/dim]", soft_wrap=True)


def print_signals(console: Console, report: Report, factors: Mapping[str, float]) -> None:
    """A table; where the terminal is too narrow for one, a line each."""
    from rich.markup import escape

    rows = report.signal_rows(factors)[:MOST]
    columns = ([name, *(row[name] for row in rows)] for name in rows[0] if name != "rest")
    narrowest = sum(2 + max(map(len, cells)) for cells in columns)
    if narrowest + len("(-1.09°") > console.width:
        for row in rows:
            text = ", ".join(f"{name} {value}" for name, value in row.items() if name != "signal")
            console.print(f"[bold]{escape(row['signal'])}[/bold]: {escape(text)}")
        return
    print_table(console, [*rows[0]], ([*row.values()] for row in rows), fold=("rest",))


def _folded(notes: Iterable[str]) -> list[str]:
    """Notes, of which those on units that nothing speaks for are one."""
    from fracid.findings import with_code

    notes = [*notes]
    unsaid = with_code(notes, "taken-as-rad")
    if len(unsaid) < 2:
        return notes
    names = ", ".join(note.where for note in unsaid)
    return [*(note for note in notes if note not in unsaid), f"{names}: no unit is given; taken as rad."]


def _print_rest(console: Console, count: int, what: str) -> None:
    if count > MOST:
        console.print(f"  and {count - MOST:,} more {what}: add --json for all", soft_wrap=True)


def print_sketches(console: Console, recording: Recording) -> None:
    """Draw each signal over time in a few lines of text."""
    from rich.markup import escape

    wide = max(map(len, recording.signals))
    for name, signal in islice(recording.signals.items(), MOST):
        for k, line in enumerate(_sketch(recording.time, signal, max(20, min(100, console.width - wide - 4)))):
            console.print(f"  {escape(name if k == 0 else ''):{wide}} [cyan]{line}[/cyan]", soft_wrap=True)
    _print_rest(console, len(recording.signals), "signals")


MISREAD = {"degrees-as-radians": "deg", "radians-as-degrees": "rad", "counts-as-radians": "counts"}
"""Findings on the unit of a signal, and the one that it may be in."""

MOST = 50
"""Signals, and notes, that are shown: nobody reads thousands."""

DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
"""Braille: the bit of each dot, by column of two and row of four."""


def _sketch(time: NDArray[np.float64], signal: NDArray[np.float64], width: int, height: int = 4) -> list[str]:
    """Draw a signal over time in Braille dots, `width` by `height` characters."""
    import numpy as np

    mask = np.isfinite(signal) & np.isfinite(time)
    if mask.sum() < 2 or np.ptp(time[mask]) == 0 or np.ptp(signal[mask]) == 0:
        return ["(constant)"]
    t, x = time[mask], signal[mask]
    across = ((t - t.min()) / np.ptp(t) * (2 * width - 1)).astype(int)
    down = ((x.max() - x) / np.ptp(x) * (4 * height - 1)).round().astype(int)
    cells = np.zeros((height, width), dtype=int)
    for i in np.unique(across):
        rows = down[across == i]
        for j in range(rows.min(), rows.max() + 1):
            cells[j // 4, i // 2] |= DOTS[i % 2][j % 4]
    return ["".join(chr(0x2800 + cell) for cell in row) for row in cells]
