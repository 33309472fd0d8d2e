"""Formats that a package reads, in a process of its own (:mod:`fracid.safety.apart`).

=============  ====================  =============================================================================
ending         package               read as
=============  ====================  =============================================================================
.xlsx          python-calamine       the text of its first sheet with numbers, as a .csv; ``variable`` names another
.tdms          nptdms                channels, each under its group; a group's time from its waveform's step
.mf4 .mdf      asammdf               channels in physical units; a formula that a file brings is not evaluated
.mcap          mcap-ros2-support     messages of ROS 2 and JSON, by topic
.db3           rosbags               a bag of ROS 2: the same, of standard messages, and of those that it defines
=============  ====================  =============================================================================

Channels and topics with clocks of their own come onto the clock of the longest: what comes between two of its samples
stands at the next, and is missing at the others, as a command is that is logged when it changes.
"""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from importlib.util import find_spec
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.errors import DataError, InputError
from fracid.recording.readers.arrays import walk
from fracid.recording.readers.content import LISTS, TEXT, Content, LeftOut, damaged, refuse_bomb
from fracid.recording.readers.records import Columns
from fracid.safety.apart import answer_apart
from fracid.safety.door import opened
from fracid.safety.json_files import json_of
from fracid.safety.text import ascii_short

Column = NDArray[np.generic] | LeftOut

Found = dict[str, Column]

FORMULA = LeftOut("is converted by a formula of the file, which is not evaluated; save it converted")

MOST_ELEMENTS = 100
"""Of a list in a message that is columns; an image is none."""


# --- in the process that reads --------------------------------------------------------------------------


def _xlsx(path: Path) -> Found:
    """Each sheet as a text that tabs divide."""
    from python_calamine import CalamineWorkbook

    with opened(path) as file:
        book = CalamineWorkbook.from_filelike(file)
        sheets = {name: book.get_sheet_by_name(name) for name in book.sheet_names}
        refuse_bomb(path, sum(sheet.height * sheet.width for sheet in sheets.values()))
        texts = {name: "\n".join("\t".join(map(_cell, row)) for row in s.iter_rows()) for name, s in sheets.items()}
        _refuse_entities(path, file)
    return {name: LeftOut("is a sheet without numbers", text) for name, text in texts.items()}


def _refuse_entities(path: Path, file: BinaryIO) -> None:
    """Refuse words that stand for others, which a workbook may not have: calamine leaves them out, 1&e;5 is 1 to it."""

    def refuse(*_: object) -> None:
        raise DataError(f"{path.name} declares XML entities, as no workbook does. Save it again from a spreadsheet.")

    with zipfile.ZipFile(file) as archive:
        for name in archive.namelist():
            if name.startswith("xl/") and name.endswith(".xml"):
                parser = expat.ParserCreate()
                parser.StartDoctypeDeclHandler = refuse
                with archive.open(name) as part:
                    parser.ParseFile(part)


def _cell(value: Any) -> str:
    return " ".join(str(value.isoformat() if hasattr(value, "isoformat") else value).split()).replace('"', "'")


def _tdms(path: Path) -> Found:
    from nptdms import TdmsFile

    found: Found = {}
    with opened(path) as opening, TdmsFile.open(opening) as file:
        channels = [channel for group in file.groups() for channel in group.channels()]
        refuse_bomb(path, sum(map(len, channels)))
        for channel in channels:
            step, start = (channel.properties.get(f"wf_{what}", 0.0) for what in ("increment", "start_offset"))
            if step:
                found[f"{channel.group_name}.time [s]"] = float(start) + float(step) * np.arange(float(len(channel)))
            unit = channel.properties.get("unit_string") or channel.properties.get("NI_UnitDescription")
            found[f"{channel.group_name}.{channel.name}{f' [{unit}]' if unit else ''}"] = _column(channel[:])
    return found


def _mdf(path: Path) -> Found:
    from asammdf import MDF
    from asammdf.blocks import mdf_v3, mdf_v4, v2_v3_blocks, v4_blocks

    for blocks in (v2_v3_blocks, v4_blocks):  # what the file says would be run as Python
        blocks.evaluate, blocks.lambdify = _not_evaluated, _no_formula
    mdf_v3.NamedTemporaryFile = mdf_v4.NamedTemporaryFile = lambda **_: BytesIO()  # it is for what is appended
    groups: dict[str, tuple[FloatArray, Found]] = {}
    with opened(path) as opening, MDF(opening) as file:
        refuse_bomb(path, sum(g.channel_group.cycles_nr * len(g.channels) for g in file.groups))
        for k, group in enumerate(file.groups):
            columns: Found = {}
            for j, channel in enumerate(group.channels):
                if j != file.masters_db.get(k):
                    try:
                        signal = file.get(group=k, index=j)
                        columns[f"{channel.name}{f' [{signal.unit}]' if signal.unit else ''}"] = _column(signal.samples)
                    except _Formula:
                        columns[channel.name] = FORMULA
            groups[f"group {k}"] = np.asarray(file.get_master(k), dtype=np.float64), columns
    return _on_one_clock(groups)


class _Formula(Exception):
    """A file has a formula of its own."""


def _not_evaluated(*_: Any, **__: Any) -> Any:
    raise TypeError  # then asammdf computes by NumPy what is a fixed formula of the format


def _no_formula(*_: Any, **__: Any) -> Any:
    raise _Formula


def _mcap(path: Path) -> Found:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    factory = DecoderFactory()

    def messages() -> Iterator[tuple[str, int, Any]]:
        with opened(path) as file:
            for schema, channel, message in make_reader(file).iter_messages():
                in_json = channel.message_encoding == "json"
                decode = json_of if in_json else factory.decoder_for(channel.message_encoding, schema)
                kind = f"{channel.message_encoding} of {schema.name if schema else 'no schema'}"
                yield channel.topic, message.log_time, decode(message.data) if decode else LeftOut(_unread(kind))

    return _topics(path, messages())


def _db3(path: Path) -> Found:
    import sqlite3
    from contextlib import closing

    from mcap_ros2._dynamic import generate_dynamic
    from rosbags.typesys import Stores, get_typestore

    standard = get_typestore(Stores.ROS2_HUMBLE)
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as file:
        file.execute("PRAGMA trusted_schema = OFF")
        tables = {name for (name,) in file.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")}
        query = "SELECT topic_type, encoded_message_definition FROM message_definitions WHERE encoding = 'ros2msg'"
        own = dict(file.execute(query)) if "message_definitions" in tables else {}
        topics = {k: (name, kind) for k, name, kind in file.execute("SELECT id, name, type FROM topics")}
        decoders: dict[str, Callable[[bytes], Any]] = {
            kind: generate_dynamic(kind, text)[kind] for kind, text in own.items() if kind not in standard.types
        }
        decoders |= {kind: partial(standard.deserialize_cdr, typename=kind) for kind in standard.types}

        def messages() -> Iterator[tuple[str, int, Any]]:
            for k, stamp, data in file.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp"):
                name, kind = topics[k]
                yield name, stamp, decoders[kind](data) if kind in decoders else LeftOut(_unread(kind))

        return _topics(path, messages())


def _unread(kind: str) -> str:
    return f"is a topic of messages that are not read, {ascii_short(kind)[1:-1]}"


def _topics(path: Path, messages: Iterable[tuple[str, int, Any]]) -> Found:
    """Messages, each with its topic and its time [ns], as columns."""
    logs: dict[str, list[tuple[int, Any]]] = {}
    left: Found = {}
    for topic, stamp, message in messages:
        if isinstance(message, LeftOut):
            left[topic] = message
        else:
            logs.setdefault(topic, []).append((stamp, _plain(message)))
    first = min((log[0][0] for log in logs.values()), default=0)
    columns = Columns(path)
    groups = {}
    for topic, log in logs.items():
        made = columns.of([sample for _, sample in log])
        content = made if isinstance(made, Mapping) and len(logs) == 1 else {topic if len(logs) > 1 else "data": made}
        groups[topic] = np.array([1e-9 * (stamp - first) for stamp, _ in log]), dict(walk(content, ""))
    return _on_one_clock(groups) | left


def _plain(value: Any) -> Any:
    """A message as records, lists and numbers; lists beside as many names, as of joints, are records by these."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    names = getattr(value, "__slots__", getattr(value, "__dataclass_fields__", ()))
    if names or isinstance(value, Mapping):
        record = dict(value) if isinstance(value, Mapping) else {n: getattr(value, n) for n in names if n[0] != "_"}
        record = {str(n): _plain(v) for n, v in record.items()}
        joints = record.get("name")
        if isinstance(joints, list) and all(isinstance(joint, str) for joint in joints):
            lists = {n: v for n, v in record.items() if isinstance(v, list) and n != "name"}
            record |= {n: dict(zip(joints, v, strict=True)) for n, v in lists.items() if len(v) == len(joints)}
        return record
    if len(value) > MOST_ELEMENTS or isinstance(value, bytes):
        return None
    return [_plain(v) for v in (value.tolist() if hasattr(value, "tolist") else value)]


def _on_one_clock(groups: Mapping[str, tuple[FloatArray, Found]]) -> Found:
    """Put groups beside each other on the clock of the longest."""
    groups = {name: (time, columns) for name, (time, columns) in groups.items() if time.size and columns}
    if not groups:
        return {}
    longest = max(groups, key=lambda name: groups[name][0].size)
    clock = groups[longest][0]
    found: Found = {"time [s]": clock}
    for group, (time, columns) in groups.items():
        at = np.minimum(np.searchsorted(clock, time), clock.size - 1)
        for name, column in columns.items():
            whole = f"{group}.{name}" if name in found else name
            if isinstance(column, LeftOut) or group == longest:
                found[whole] = column
            elif "stamp" not in name:
                sparse = np.full(clock.size, math.nan)
                sparse[at] = column
                found[whole] = sparse
    return found


def _column(samples: Any) -> Column:
    """Samples as numbers, or why they are none."""
    array = np.asarray(samples)
    if array.dtype.kind in "SUO":
        return TEXT
    if array.dtype.kind not in "fiub" or array.ndim != 1:
        return LISTS
    return np.asarray(array, dtype=np.float64)


# --- between the two ------------------------------------------------------------------------------------


class Format(NamedTuple):
    """A format, and the package that reads it."""

    title: str
    extra: str
    modules: tuple[str, ...]
    read: Callable[[Path], Found]


FORMATS = {
    ".xlsx": Format("Excel workbook", "xlsx", ("python_calamine",), _xlsx),
    ".tdms": Format("TDMS file", "tdms", ("nptdms",), _tdms),
    **dict.fromkeys((".mf4", ".mdf"), Format("MDF file", "mdf", ("asammdf",), _mdf)),
    ".mcap": Format("MCAP file", "ros", ("mcap", "mcap_ros2"), _mcap),
    ".db3": Format("bag of ROS 2", "ros", ("rosbags", "mcap_ros2"), _db3),
}


def answer(path: Path, ending: str) -> bytes:
    """Read a file in this process: a line of JSON on what it has, and its numbers; of a damaged one, what is wrong."""
    try:
        found = FORMATS[ending].read(path)
        numbers = {name: column for name, column in found.items() if not isinstance(column, LeftOut)}
        refuse_bomb(path, sum(column.size for column in numbers.values()))
    except MemoryError:
        raise
    except DataError as error:
        return json.dumps({"refused": str(error)}).encode()
    except BaseException as error:  # a package has its own tree of errors, and what Rust panics with is no Exception
        return json.dumps({"damaged": str(error) or type(error).__name__}).encode()
    others = {name: (c.why, c.text) for name, c in found.items() if isinstance(c, LeftOut)}
    head = {"numbers": {name: column.size for name, column in numbers.items()}, "others": others}
    return b"".join([json.dumps(head).encode(), b"\n", *(column.tobytes() for column in numbers.values())])


def read_by_package(path: Path) -> Content:
    """Read a file by the package for its ending, in a process of its own.

    Raises
    ------
    InputError
        The package is not installed.
    DataError
        The file is damaged, or takes more memory or time than one of its size does.
    """
    ending = path.suffix.lower()
    form = FORMATS[ending]
    if missing := [module for module in form.modules if find_spec(module) is None]:
        raise InputError(f"reading {path.name} needs {missing[0]}: type pip install 'fracid[{form.extra}]'")
    try:
        raw = answer_apart(f"{__name__}:answer", path, ending, packages=form.modules)
    except ValueError as error:
        raise damaged(path, form.title, error) from None
    line, _, numbers = raw.partition(b"\n")
    head = json.loads(line)
    if "refused" in head:
        raise DataError(head["refused"])
    if "damaged" in head:
        raise damaged(path, form.title, head["damaged"])
    ends = np.cumsum([0, *head["numbers"].values()])
    values = np.frombuffer(numbers)
    columns = {name: values[a:b] for name, (a, b) in zip(head["numbers"], pairwise(ends), strict=True)}
    return columns | {name: LeftOut(*other) for name, other in head["others"].items()}
