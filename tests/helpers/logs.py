"""Small recordings in formats that packages read."""

import io
import sqlite3
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.sax.saxutils import escape

import numpy as np

__all__ = ["answer_here", "db3", "mcap", "mdf", "tdms", "xlsx"]


def answer_here(function, path, ending, packages=()):
    """What fracid's process apart answers, from this one."""
    from fracid.recording.readers import packages as readers

    try:
        return readers.answer(path, ending)
    except MemoryError:
        raise ValueError("reading it takes more memory than a file of its size does") from None


def xlsx(sheets, packing=zipfile.ZIP_DEFLATED):
    """A workbook: name of a sheet → rows of texts and numbers."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", packing) as packed:

        def put(name, text):
            packed.writestr(zipfile.ZipInfo(name), f'<?xml version="1.0" encoding="UTF-8"?>{text}', packing)

        main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
        rels = "http://schemas.openxmlformats.org/package/2006/relationships"
        kind = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
        types = "http://schemas.openxmlformats.org/package/2006/content-types"
        put(
            "[Content_Types].xml",
            f'<Types xmlns="{types}"><Default Extension="xml" ContentType="application/xml"/></Types>',
        )
        put("_rels/.rels", f'<Relationships xmlns="{rels}"><Relationship Id="r1" Type="{kind}/officeDocument" '
            'Target="xl/workbook.xml"/></Relationships>')  # fmt: skip
        listed = "".join(
            f'<sheet name="{escape(name)}" sheetId="{k}" r:id="s{k}"/>' for k, name in enumerate(sheets, 1)
        )
        put("xl/workbook.xml", f'<workbook xmlns="{main}" xmlns:r="{kind}"><sheets>{listed}</sheets></workbook>')
        links = "".join(f'<Relationship Id="s{k}" Type="{kind}/worksheet" Target="worksheets/sheet{k}.xml"/>'
                        for k, _ in enumerate(sheets, 1))  # fmt: skip
        put("xl/_rels/workbook.xml.rels", f'<Relationships xmlns="{rels}">{links}</Relationships>')
        for k, rows in enumerate(sheets.values(), 1):
            lines = "".join(f"<row>{''.join(map(cell, row))}</row>" for row in rows)
            put(f"xl/worksheets/sheet{k}.xml", f'<worksheet xmlns="{main}"><sheetData>{lines}</sheetData></worksheet>')
    return file.getvalue()


def cell(value):
    if isinstance(value, str):
        return f'<c t="inlineStr"><is><t>{escape(value)}</t></is></c>'
    return f"<c><v>{float(value)!r}</v></c>"


def tdms(groups):
    """Name of a group → name of a channel → samples, or samples and properties."""
    from nptdms import ChannelObject, TdmsWriter

    file = io.BytesIO()
    with TdmsWriter(file) as writer:
        for group, channels in groups.items():
            writer.write_segment([
                ChannelObject(group, name, *(given if isinstance(given, tuple) else (given,)))
                for name, given in channels.items()
            ])  # fmt: skip
    return file.getvalue()


def mdf(groups, version="4.10", **options):
    """Pairs of a clock and name → (samples, unit or conversion)."""
    from asammdf import MDF, Signal

    with TemporaryDirectory() as folder:
        path = Path(folder, "made.mf4")
        with MDF(version=version) as file:
            for time, channels in groups:
                signals = [
                    Signal(x, time, name=n, **({"unit": by} if isinstance(by, str) else {"conversion": by}))
                    for n, (x, by) in channels.items()
                ]
                file.append(signals)
            saved = file.save(path, overwrite=True, **options)
        return Path(saved).read_bytes()


JOINTS = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""

COMMAND = "float64 data\n"


def mcap(time, position, commands=(), **options):
    """Joint states, commands (time, value) of a message of one's own, and the same commands as JSON."""
    from mcap.writer import CompressionType
    from mcap_ros2.writer import Writer

    file = io.BytesIO()
    writer = Writer(file, compression=options.get("compression", CompressionType.ZSTD))
    joints = writer.register_msgdef("sensor_msgs/msg/JointState", JOINTS)
    command = writer.register_msgdef("my_msgs/msg/Command", COMMAND)
    messages = [*((t, "/joint_states", joints, state(t, q)) for t, q in zip(time, position, strict=True)),
                *((t, "/command", command, {"data": u}) for t, u in commands)]  # fmt: skip
    for t, topic, schema, message in sorted(messages, key=lambda m: m[0]):
        stamp = 1_700_000_000_000_000_000 + round(1e9 * t)
        writer.write_message(topic, schema, message, log_time=stamp, publish_time=stamp)
    writer.finish()
    return file.getvalue()


def state(t, q):
    stamp = {"sec": 1_700_000_000 + int(t), "nanosec": round(1e9 * (t % 1)) % 10**9}
    return {"header": {"stamp": stamp, "frame_id": "base"}, "name": ["arm", "pendulum"], "position": [0.0, float(q)],
            "velocity": [], "effort": []}  # fmt: skip


def db3(time, position, commands=(), definitions=False):
    """A bag of ROS 2 in SQLite."""
    from mcap_ros2._dynamic import serialize_dynamic
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    own = serialize_dynamic("my_msgs/msg/Command", COMMAND)["my_msgs/msg/Command"]
    types = store.types

    def joint(t, q):
        s = state(t, q)
        stamp = types["builtin_interfaces/msg/Time"](**s["header"]["stamp"])
        header = types["std_msgs/msg/Header"](stamp, "base")
        numbers = (np.array(s[n], dtype=float) for n in ("position", "velocity", "effort"))
        message = types["sensor_msgs/msg/JointState"](header, s["name"], *numbers)
        return bytes(store.serialize_cdr(message, "sensor_msgs/msg/JointState"))

    with TemporaryDirectory() as folder:
        path = Path(folder, "made.db3")
        file = sqlite3.connect(path)
        file.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
        file.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
        file.execute("INSERT INTO topics VALUES (1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr')")
        file.execute("INSERT INTO topics VALUES (2, '/command', 'my_msgs/msg/Command', 'cdr')")
        if definitions:
            file.execute(
                "CREATE TABLE message_definitions(topic_type TEXT, encoding TEXT, encoded_message_definition TEXT)"
            )
            file.execute("INSERT INTO message_definitions VALUES ('my_msgs/msg/Command', 'ros2msg', ?)", (COMMAND,))
        rows = [*((t, 1, joint(t, q)) for t, q in zip(time, position, strict=True)),
                *((t, 2, own({"data": u})) for t, u in commands)]  # fmt: skip
        file.executemany("INSERT INTO messages(timestamp, topic_id, data) VALUES (?, ?, ?)",
                         [(10**18 + round(1e9 * t), topic, data) for t, topic, data in rows])  # fmt: skip
        file.commit()
        file.close()
        return path.read_bytes()
