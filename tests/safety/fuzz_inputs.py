"""Hostile files for the readers: good seed files, bent in ways that real damage and malice bend them.

Every input is a pure function of reader and number, ``input_of("mat", 1234)``, so that a failure is found again by its
number alone.  One to eight changes are made to a seed:

=============  =====================================================================================
on             changes
=============  =====================================================================================
any bytes      a bit flipped, a byte or a whole number of 2, 4 or 8 bytes set to an extreme (a length
               field of 4 GiB, say), a block cut out, doubled, moved, overwritten, the end cut off,
               the end of another seed spliced on
text           a cell, a separator, a line, an encoding changed; characters that no logger writes
.npy header    its dictionary's type, order and shape changed
.npz .mat      the same *inside* the packing, which is then packed again, so that its checksum holds
project file   a value, a key, a line, a table changed for another; brackets a thousand deep
=============  =====================================================================================

A search, ``input_of("search", 1234)``, begins with a project that is written anew: all its keys are ones that there
are, most of its values are sensible, and some are numbers at the edge of what can be computed with.
"""

from __future__ import annotations

import io
import json
import random
import re
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))
from logs import answer_here, db3, mcap, mdf, tdms, xlsx

__all__ = ["PACKAGED", "READERS", "answer_here", "input_of", "swings"]

EXTREMES = (0, 1, 2, 7, 8, 127, 128, 255, 256, 4096, 65535, 65536, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**63 - 1)
T = np.arange(40) / 100
ALPHA = 0.8 * np.cos(5 * T)
THETA = np.round(300 * np.sin(3 * T))

# --- seeds ----------------------------------------------------------------------------------------------


def _table(separator: str, decimal: str, head: str) -> bytes:
    columns = zip(T[:16], THETA[:16], ALPHA[:16], strict=True)
    rows = [[f"{x:.6g}".replace(".", decimal) for x in row] for row in columns]
    return "\n".join([head.replace(",", separator), *map(separator.join, rows), ""]).encode()


def _text_seeds() -> list[bytes]:
    comma = _table(",", ".", "t,theta,alpha")
    return [
        comma,
        _table(";", ",", "t [s];theta [counts];alpha [rad]"),
        _table("\t", ".", "# a rig\n% of mine\nt,theta,alpha\ns,deg,rad"),
        _table(" ", ".", ""),
        comma.decode().encode("utf-16"),
        comma.replace(b"theta", b"\xb0theta"),
        b"\xef\xbb\xbf" + comma.replace(b"\n", b"\r\n"),
        b"time,a,u\n0,1,\n0.1,2,3\n0.2,,nan\n0.3,5,null\n",
    ]


def _mat_seeds() -> list[bytes]:
    from scipy.io import savemat
    from scipy.sparse import csc_array

    columns = {"t": T, "theta": THETA.astype(np.int16), "alpha": ALPHA}
    kinds = [
        columns,
        {"data": np.column_stack([T, THETA, ALPHA])},
        {"log": {"time": T, "signals": {"values": ALPHA, "label": "alpha"}}},
        {"t": T, "s": csc_array(np.eye(4)), "z": ALPHA * 1j, "c": np.array([1, "a", T], dtype=object), "n": "name"},
    ]
    v5 = [b"MATLAB 5.0 MAT-file of a test".ljust(116) + _saved(savemat, kind)[116:] for kind in kinds]  # no date
    return [*v5, *(_saved(savemat, kind, format="4") for kind in (kinds[0], kinds[1]))]


def _saved(save: Callable[..., object], *content: object, **options: object) -> bytes:
    file = io.BytesIO()
    save(file, *content, **options)
    return file.getvalue()


def _npy_seeds() -> list[bytes]:
    fields = np.zeros(40, dtype=[("t", float), ("alpha", ">f4"), ("n", "<i2")])
    fields["t"], fields["alpha"] = T, ALPHA
    arrays = [np.column_stack([T, THETA, ALPHA]), np.asfortranarray(np.vstack([T, ALPHA])), fields, THETA.astype(">i4")]
    return [_saved(np.save, array) for array in arrays]


def _npz_seeds() -> list[bytes]:
    kinds = [{"t": T, "theta": THETA, "alpha": ALPHA}, {"data": np.column_stack([T, THETA, ALPHA])}]
    return [
        _saved(save, **kind)
        for kind in kinds
        for save in (lambda f, **k: np.savez(f, **k), lambda f, **k: np.savez_compressed(f, **k))
    ]


def _hdf5_seeds() -> list[bytes]:
    import h5py

    def vectors(h: h5py.File) -> None:
        h["t"], h["alpha"] = T, ALPHA
        h["alpha"].attrs["unit"] = "rad"

    def packed(h: h5py.File) -> None:
        group = h.create_group("run/one")
        for name, x in (("t", T), ("alpha", ALPHA)):
            group.create_dataset(name, data=x, chunks=(16,), maxshape=(None,), compression="gzip", shuffle=True)

    def awkward(h: h5py.File) -> None:
        vectors(h)
        h["record"] = np.zeros(40, dtype=[("a", "<f8"), ("b", ">i2")])
        h["names"] = np.array([b"a", b"bc"])
        h["soft"], h["far"] = h5py.SoftLink("/t"), h5py.ExternalLink("no.h5", "/t")
        h["text"] = "variable length"
        h["matrix"] = np.zeros((3, 40))

    seeds = []
    with TemporaryDirectory() as folder:
        file = Path(folder, "seed.h5")
        for fill in (vectors, packed, awkward):
            for options in ({"libver": "earliest"}, {"libver": "latest"}):
                with h5py.File(file, "w", track_order=False, **options) as h:
                    fill(h)
                seeds.append(file.read_bytes())
        with h5py.File(file, "w", userblock_size=512) as h:
            vectors(h)
        seeds.append(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + file.read_bytes()[128:])
    return seeds


def _parquet_seeds() -> list[bytes]:
    import pyarrow
    from pyarrow import parquet

    plain = {"t": T, "theta": THETA.astype(np.int64), "alpha": ALPHA}
    awkward = {"t": T, "who": ["me"] * 40, "gap": [None, 1.5] * 20, "when": (1e9 * T).astype("M8[ns]")}
    tables = [pyarrow.table(plain), pyarrow.table(awkward)]
    options: list[dict[str, object]] = [
        {"compression": "none", "use_dictionary": False},
        {"compression": "none"},
        {"compression": "snappy", "data_page_version": "2.0"},
        {"compression": "zstd"},
    ]
    return [_saved(lambda f, t=t, o=o: parquet.write_table(t, f, **o)) for t in tables for o in options]


def _json_seeds() -> list[bytes]:
    columns = {"timestamp": T.tolist(), "theta": THETA.tolist(), "alpha": ALPHA.tolist()}
    records = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    stamped = [{"stamp": {"sec": k, "nanosec": 7}, "q": [a, 0, None], "on": k > 9} for k, a in enumerate(ALPHA)]
    dated = [{"time": f"2024-01-01T12:00:{k}Z", "alpha": a} for k, a in enumerate(ALPHA[:50])]
    kinds = [columns, records, {"mass": 0.49, "motor": "xl330", "entries": records}, stamped, dated]
    return [*(json.dumps(kind).encode() for kind in kinds), "\n".join(map(json.dumps, records)).encode()]


JSON_VALUES = ("null", "true", "NaN", "-Infinity", "1e999", "1" * 5000, '"x"', "[]", "{}", "[1,2]", '{"a":1}', "[[[]]]",
               '"' + "x" * 9000 + '"', "[" * 500, '{"0":1,"1":2}', '"2024-01-01"', "-", '"\\ud800"')  # fmt: skip


def _json(rng: random.Random) -> bytes:
    seeds = _seeds("json")
    raw = rng.choice(seeds)
    for _ in range(_times(rng)):
        numbers = [*re.finditer(rb"-?[0-9][0-9.e-]*", raw)]
        if rng.random() < 0.4 or not numbers:
            raw = _changed(raw, rng, seeds)
            continue
        at = rng.choice(numbers)
        raw = raw[: at.start()] + rng.choice(JSON_VALUES).encode() + raw[at.end() :]
    return raw


def _xlsx_seeds() -> list[bytes]:
    rows = [["t [s]", "theta [counts]", "alpha"], *zip(T, THETA, ALPHA, strict=True)]
    sheets = [{"Data": rows}, {"About": [["a rig"], ["of mine"]], "Data & more": [["title"], *rows]}]
    return [xlsx(of, packing) for of in sheets for packing in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)]


def _tdms_seeds() -> list[bytes]:
    rate = {"wf_increment": 0.01, "wf_start_offset": 0.0, "unit_string": "V"}
    kinds = [
        {"t": T, "alpha": ALPHA},
        {"alpha": (ALPHA, rate), "n": (THETA.astype(np.int16), rate), "who": ["me"] * 40},
    ]
    return [*(tdms({"log": kind}) for kind in kinds), tdms({"a": kinds[0], "b": kinds[1]})]


def _mdf_seeds() -> list[bytes]:
    groups = [(T, {"alpha": (ALPHA, "rad"), "n": (THETA.astype(np.int16), "")}), (T[::10], {"u": (ALPHA[::10], "V")})]
    kinds: list[dict[str, object]] = [{}, {"compression": 1}, {"compression": 2}]
    return [*(mdf(groups, **kind) for kind in kinds), mdf(groups, "4.20"), mdf(groups, "3.30"), mdf(groups[:1], "2.14")]


def _mcap_seeds() -> list[bytes]:
    from mcap.writer import CompressionType

    commands = [(0.1, 1.0), (0.2, 2.0)]
    return [mcap(T, ALPHA, some, compression=kind) for some in ([], commands) for kind in CompressionType]


def _db3_seeds() -> list[bytes]:
    return [db3(T, ALPHA, [(0.1, 1.0)], definitions=known) for known in (False, True)]


PACKAGED = {
    "xlsx": ((".xlsx",), _xlsx_seeds),
    "tdms": ((".tdms",), _tdms_seeds),
    "mdf": ((".mf4", ".mdf"), _mdf_seeds),
    "mcap": ((".mcap",), _mcap_seeds),
    "db3": ((".db3",), _db3_seeds),
}


def _of_package(name: str, rng: random.Random) -> bytes:
    """Bytes changed; of a workbook half of them within a sheet, which is then packed again."""
    seeds = _seeds(name)
    raw = rng.choice(seeds)
    if name == "xlsx" and rng.random() < 0.5:
        with zipfile.ZipFile(io.BytesIO(raw)) as packed:
            members = {m: packed.read(m) for m in packed.namelist()}
        at = rng.choice([*members])
        for _ in range(_times(rng)):
            members[at] = _changed(members[at], rng, [*members.values()])
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
            for member, content in members.items():
                packed.writestr(zipfile.ZipInfo(member), content)
        return file.getvalue()
    for _ in range(_times(rng)):
        raw = _changed(raw, rng, seeds)
    return raw


def _project_seeds() -> list[bytes]:
    recording = '[[recording]]\nfile = "swing.csv"\ntime = { column = 0 }\nalpha = { column = 2, unit = "rad" }\n'
    whole = """[model]
name = "rotary-pendulum"
rig = "srv02-rotpen"
zero = "hanging"
actuation = "torque"
[model.parameters]
C4 = 0.1944
b_alpha = { start = 2e-4, lower = -1e-2, upper = 1e-2, prior = { mean = 1e-4, sd = 1e-3 }, scale = 1e-4 }
b_theta = "b_alpha"
[model.orders]
lambda = { start = 1.0, lower = 0.6, upper = 1.2 }
mu = { tie = "lambda" }
[[recording]]
name = "first 92°"
file = "swing.csv"
time = { column = "t", unit = "s" }
theta = { column = 1, unit = "counts", counts_per_turn = 4096, sign = -1, zero = 0.1 }
alpha = { column = 2, unit = "deg", scale = 0.99, unwrap = true }
from = 0.05
to = 0.3
use = "fit"
weight = 2.0
initial = { alpha = 0.1 }
resample = 0.01
[[recording]]
name = "second"
file = "swing.csv"
theta = 1
alpha = "alpha"
from = 0.31
use = "validate"
[fit]
per_recording = ["theta_rest"]
cost = "rmse"
weights = "noise"
outputs = ["theta", "alpha"]
initial_state = "rest"
method = "pi2"
memory = "compressed"
tolerance = 1e-10
optimiser = "multistart"
starts = 2
seed = 1
"""
    return [recording.encode(), whole.encode(), (recording + '[fit]\npreset = "paper"\n').encode()]


# --- changes to any bytes -------------------------------------------------------------------------------


def _changed(raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    """Return the bytes with one change."""
    if not raw:
        return rng.randbytes(rng.choice((1, 8, 200)))
    at, kind = rng.randrange(len(raw)), rng.randrange(10)
    size = min(rng.choice((1, 2, 4, 8, 16, 64, 512)), len(raw) - at)
    block = raw[at : at + size]
    if kind == 0:
        return raw[:at] + bytes([raw[at] ^ 1 << rng.randrange(8)]) + raw[at + 1 :]
    if kind == 1:
        return raw[:at] + bytes([rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))]) + raw[at + 1 :]
    if kind in (2, 3):
        number = _number(rng)
        at -= at % len(number) if rng.random() < 0.7 else 0
        return raw[:at] + number + raw[at + len(number) :]
    if kind == 4:
        return raw[:at] + raw[at + size :]
    if kind == 5:
        return raw[:at] + block * rng.choice((2, 2, 2, 100)) + raw[at + size :]
    if kind == 6:
        to = rng.randrange(len(raw))
        return raw[:to] + block + raw[to + size :]
    if kind == 7:
        return raw[:at]
    if kind == 8:
        other = rng.choice(others)
        return raw[:at] + other[rng.randrange(len(other)) :]
    return raw[:at] + rng.randbytes(size) + raw[at + size :]


def _number(rng: random.Random) -> bytes:
    """Return an extreme whole number, perhaps negative or off by one, in 2, 4 or 8 bytes of either order."""
    size = rng.choice((2, 4, 4, 8))
    value = (rng.choice(EXTREMES) + rng.choice((0, 0, 0, -1, 1))) * rng.choice((1, 1, 1, -1))
    return (value % (1 << 8 * size)).to_bytes(size, rng.choice(("little", "little", "big")))


def _times(rng: random.Random) -> int:
    """Return how many changes: one half of the inputs has a single one, one in a hundred eight."""
    return min(8, 1 + int(rng.expovariate(0.7)))


# --- changes that know the format -----------------------------------------------------------------------

CELLS = (
    "", " ", "nan", "NaN", "null", "inf", "-inf", "1e999", "-1e308", "1e-320", "5e-324", "1_000", "0x10", "--1",
    "-", "+", ".", ",", "1,5", "1.5", "1.234,5", "12:30:01", "2024-01-01", '"', "'1'", "\0", "\0\0\0", "\ufeff",
    "\x1b[31m", "١٢", "9" * 400, "e", "1e", "abc", "°", "1 2", "#", "//", "%", "\x85", "\u2028", "\x0c", "a\\b",
    "t [ms]", "(s)", "time", "1.7e9", "1e16", "True", "=1+1", "9" * 20_000 + "x", "9" * 9000 + "." + "9" * 9000 + "e",
    "sampl" * 4000, "sampl" + "_" * 20_000, "a" + " " * 20_000 + "b", "(" * 20_000, "joint2" * 3000, "x" * 9000 + " [",
)  # fmt: skip
ENCODINGS = ("utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "latin-1", "cp1252", "utf-7", "cp500")


def _text(rng: random.Random) -> bytes:
    seeds = _seeds("text")
    raw = rng.choice(seeds)
    for _ in range(_times(rng)):
        raw = _changed_text(raw, rng) if rng.random() < 0.7 else _changed(raw, rng, seeds)
    return raw


def _changed_text(raw: bytes, rng: random.Random) -> bytes:
    lines = raw.split(b"\n")
    at, kind = rng.randrange(len(lines)), rng.randrange(10)
    separator = next((s for s in (b"\t", b";", b",", b" ") if s in lines[at]), b",")
    if kind < 3:
        cells = lines[at].split(separator)
        cells[rng.randrange(len(cells))] = rng.choice(CELLS).encode("utf-8")
        lines[at] = separator.join(cells)
    elif kind == 3:
        lines[at] = lines[at].replace(separator, rng.choice((b",", b";", b"\t", b" ", b"|", b", ", b"")))
    elif kind == 4:
        lines[at] = rng.choice((b"", b"# note", b"1", b"1,2,3,4", b"\0" * 512, b"x" * 5000, b"," * 5000, b"1 " * 3000))
    elif kind == 5:
        lines.insert(at, rng.choice(lines))
    elif kind == 6:
        a, b = sorted((at, rng.randrange(len(lines))))
        lines[a:b] = [line.replace(b".", b",") for line in lines[a:b]] if rng.random() < 0.5 else []
    elif kind == 7:
        a, b = sorted((at, rng.randrange(len(lines))))
        lines[a:b] = lines[a:b] * rng.choice((2, 3, 20))
    elif kind == 8:
        text, encoding = raw.decode("utf-8", "replace"), rng.choice(ENCODINGS)
        return text.encode(encoding, "replace")
    else:
        return raw.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b"\r\r\n", b"\0\n", b" \n", b",\n")))
    return b"\n".join(lines)


def _mat(rng: random.Random) -> bytes:
    seeds = _seeds("mat")
    raw = rng.choice(seeds)
    if rng.random() < 0.5:
        for _ in range(_times(rng)):
            raw = _changed(raw, rng, seeds)
        return raw
    head, element = raw[:128], raw[128:]
    for _ in range(_times(rng)):
        element = _changed(element, rng, [s[128:] for s in seeds])
    packed = zlib.compress(element, 1)
    return head + struct.pack("<II", 15, len(packed)) + packed


DESCRIPTIONS = (
    "'|O'", "'<U9'", "'|S4'", "'<c16'", "'<M8[ns]'", "'<m8[s]'", "'<f2'", "'>f4'", "'<i8'", "'|b1'", "'<u8'",
    "'|V8'", "'|V0'", "'<U0'", "'<f16'", "[('t', '<f8'), ('a', '|O')]", "[('t', '<f8', (3,))]", "[]", "'x'", "3",
    "None", "[('t', [('u', '<f8')])]", "'<f8', 'x': 1",
)  # fmt: skip
SHAPES = (
    "()", "(0,)", "(1,)", "(40,)", "(-1,)", "(40, 0)", "(3, 40)", "(99999999999,)", "(2147483648, 3)", "(1, 1, 40)",
    "(4294967296, 4294967296)", "(True,)", "(1.5,)", "'40'", "40", "(10**9,)", "(" * 90 + ")" * 90,
)  # fmt: skip


def _changed_npy(raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    """Change the header's dictionary, keeping its length field right, or else any bytes."""
    end = raw.find(b"}")
    if not raw.startswith(b"\x93NUMPY\x01") or end < 0 or rng.random() < 0.5:
        return _changed(raw, rng, others)
    descr, order, shape = rng.choice(DESCRIPTIONS), rng.choice(("False", "True", "0")), rng.choice(SHAPES)
    old = raw[10 : end + 1].decode("latin-1")
    parts = {
        "descr": old.split("'descr': ")[-1].split(", 'fortran_order'")[0],
        "fortran_order": old.split("'fortran_order': ")[-1].split(", 'shape'")[0],
        "shape": old.split("'shape': ")[-1].rstrip("} ,"),
    }
    parts |= dict([rng.choice((("descr", descr), ("fortran_order", order), ("shape", shape), ("shape", shape)))])
    header = ("{" + ", ".join(f"'{k}': {v}" for k, v in parts.items()) + "}").encode("latin-1", "replace")
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    start = 10 + int.from_bytes(raw[8:10], "little")
    return raw[:8] + struct.pack("<H", len(header) % 65536) + header + raw[start:]


def _npy(rng: random.Random) -> bytes:
    seeds = _seeds("npy")
    raw = rng.choice(seeds)
    for _ in range(_times(rng)):
        raw = _changed_npy(raw, rng, seeds)
    return raw


def _npz(rng: random.Random) -> bytes:
    seeds = _seeds("npz")
    raw = rng.choice(seeds)
    if rng.random() < 0.4:
        for _ in range(_times(rng)):
            raw = _changed(raw, rng, seeds)
        return raw
    inner = _seeds("npy")
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as packed:
        for name in (
            "t.npy",
            "alpha.npy",
            rng.choice(("u.npy", "../u.npy", "/u", "x" * 300, "a/b.npy", "é.npy", "v.txt")),
        ):
            member = rng.choice(inner) if rng.random() < 0.7 else b"0 1\n1 2\n"
            for _ in range(_times(rng) - 1):
                member = _changed_npy(member, rng, inner)
            packed.writestr(zipfile.ZipInfo(name), member)
    raw = file.getvalue()
    return _changed(raw, rng, seeds) if rng.random() < 0.2 else raw


def _hdf5(rng: random.Random) -> bytes:
    seeds = _seeds("hdf5")
    raw = rng.choice(seeds)
    for _ in range(_times(rng)):
        # most of a small file is padding: change what is there
        changed = _changed(raw, rng, seeds)
        for _ in range(3):
            if changed != raw and not _only_padding(raw, changed):
                break
            changed = _changed(raw, rng, seeds)
        raw = changed
    return raw


def _only_padding(raw: bytes, changed: bytes) -> bool:
    if len(raw) != len(changed):
        return False
    at = next((i for i in range(0, len(raw), 64) if raw[i : i + 64] != changed[i : i + 64]), 0)
    return not any(raw[max(0, at - 64) : at + 128])


def _parquet(rng: random.Random) -> bytes:
    seeds = _seeds("parquet")
    raw = rng.choice(seeds)
    for _ in range(_times(rng)):
        length = int.from_bytes(raw[-8:-4], "little") if len(raw) > 12 else 0
        if rng.random() < 0.6 and 0 < length < len(raw) - 12:  # the footer, with its length put right
            footer = _changed(raw[-8 - length : -8], rng, [s[-900:-8] for s in seeds])
            raw = raw[: -8 - length] + footer + struct.pack("<I", len(footer)) + b"PAR1"
        else:
            raw = _changed(raw, rng, seeds)
    return raw


VALUES = (
    "true", "false", "-1", "0", "1", "1e999", "-1e-320", "nan", "inf", "9" * 30, "9" * 5000, "0x" + "f" * 4000,
    '""', '"x"', '"lambda"', '"mu"', '"\\u0000"', '"\\u001b[31m"', '"../../../etc/passwd"', '"/dev/zero"',
    '"x' + "y" * 5000           + '"', "[]", "[1]", "[[1]]", "{}", "{ a = 1 }", "1979-05-27", "07:32:00",
    '["alpha"]', '["theta", "theta"]', "{ start = 1.0, lower = 2.0, upper = 0.5 }",
    "{ start = 1.0, lower = 0.5, upper = 1.5 }", '{ tie = "mu" }', "{ column = -1 }", "{ column = 99 }",
    '{ column = "theta", unit = "deg" }', "{ rate = 1e-300 }", "{ rate = 100 }", '"release"', '"needed"',
    '"measured"', "1e-9", "1e15", "2.5", '"\U0001f600"', "'''\n'''",
)  # fmt: skip
LINES = (
    "[model]", "[model.orders]", "[fit]", "[[recording]]", "[recording]", "[fit.x.y]", "a.b.c = 1", "[[model]]",
    "]", "= 1", "x = ", 'release_time = { start = 0.1, lower = 0.0, upper = 0.2 }', 'history = "measured"',
    "seed = 7", 'variable = "x"', "lambda = 0.9", "mu = 1.1", 'initial_state = "held"', "beta = 1", "__class__ = 1",
    '"" = 1', '"a.b" = 1', "substeps = 3", "x = " + "[" * 2000, "x = " + "{a=" * 2000, "a" + ".a" * 3000 + " = 1",
)  # fmt: skip


def _project(rng: random.Random) -> bytes:
    seeds = _seeds("project")
    raw = rng.choice(seeds)
    for _ in range(_times(rng)):
        raw = _changed_project(raw, rng, seeds)
    return raw


def _changed_project(raw: bytes, rng: random.Random, seeds: list[bytes]) -> bytes:
    lines, kind = raw.split(b"\n"), rng.randrange(10)
    at = rng.randrange(len(lines))
    key, equals, value = lines[at].partition(b" = ")
    if kind < 4 and equals:
        old = value.split()[2] if value.startswith(b"{ ") and len(value.split()) > 3 and rng.random() < 0.6 else value
        new = rng.choice(VALUES).encode()
        value = value.replace(old.rstrip(b","), new) if rng.random() < 0.9 else value + b" " + new
        lines[at] = key + equals + value
    elif kind == 4 and equals:
        keys = [line.partition(b" = ")[0] for line in b"\n".join(seeds).split(b"\n") if b" = " in line]
        lines[at] = rng.choice((key + b"e", key[1:], key[::-1], rng.choice(keys))) + equals + value
    elif kind == 5:
        lines.insert(at, rng.choice(LINES).encode() if rng.random() < 0.6 else rng.choice(lines))
    elif kind == 6:
        del lines[at]
    elif kind == 7:
        a, b = sorted((at, rng.randrange(len(lines))))
        lines = lines + lines[a:b] if rng.random() < 0.5 else lines[:a] + lines[b:]
    else:
        return _changed(raw, rng, seeds)
    return b"\n".join(lines)


# --- projects that a search begins with -----------------------------------------------------------------

EDGES = (
    "0.0", "-0.0", "5e-324", "1e-320", "1e-300", "1e-154", "1e-101", "1e-100", "1e-50", "1e-12", "1e-6", "-1e-6",
    "0.9999999999999999", "1.0", "1.0000000000000002", "-1.0", "2.0", "3.5", "1e3", "-1e3", "1e6", "1e12", "1e50",
    "1e99", "1e100", "1e101", "1e154", "-1e154", "1e200", "1e300", "1e308", "-1e308", "1.7976931348623157e308",
)  # fmt: skip
WHOLE = ("0", "1", "2", "3", "7", "100", "4096", "65536", "1000000", "2147483648", "1000000000000", "9" * 18)
CONSTANTS = (
    "C1", "C3", "C4", "C6", "b_theta", "b_alpha", "coulomb_theta", "coulomb_alpha", "drag_alpha", "cable_stiffness",
    "theta_rest", "alpha_rest", "J_theta", "stiction_theta", "stribeck_speed_theta", "presliding_theta",
    "presliding_alpha", "presliding_damping_alpha", "springpot_alpha", "springpot_order_alpha", "play_theta",
    "arm_stiffness", "hub_inertia", "back_emf", "dead_zone",
)  # fmt: skip


def swings() -> bytes:
    """The recording of these projects: a pendulum that swings out, its arm, and a voltage."""
    t = np.arange(120) / 50
    columns = zip(t, 0.1 * np.sin(5 * t), 0.8 * np.exp(-0.1 * t) * np.cos(5 * t), np.sign(np.sin(t)), strict=True)
    return "\n".join(["t,theta,alpha,u", *(",".join(f"{x:.6f}" for x in row) for row in columns), ""]).encode()


def _search(rng: random.Random) -> bytes:
    """Tables of keys that there are; of their values a few are at an edge."""
    edgy = rng.choice((0.02, 0.1, 0.3))

    def number(*usual: str) -> str:
        return rng.choice(EDGES) if rng.random() < edgy else rng.choice(usual)

    def whole(*usual: str) -> str:
        return rng.choice(WHOLE) if rng.random() < edgy else rng.choice(usual)

    def maybe(chance: float, *lines: str) -> list[str]:
        return [*lines] if rng.random() < chance else []

    def free(centre: str, width: str) -> str:
        middle, half = float(centre), float(width)
        low, start, high = (float(number(repr(x))) for x in (middle - half, middle, middle + half))
        if rng.random() < 0.9:
            low, start, high = sorted((low, start, high))
        table = f"start = {start!r}, lower = {low!r}, upper = {high!r}"
        table += f", scale = {number('1e-3', '1.0')}" * (rng.random() < 0.2)
        prior = f", prior = {{ mean = {start!r}, sd = {number('1e-3', '0.1')} }}" * (rng.random() < 0.2)
        return f"{{ {table}{prior} }}"

    def value(centre: str, width: str, tie: str = "") -> str:
        kind = rng.random()
        return free(centre, width) if kind < 0.7 else f'"{tie}"' if kind < 0.8 and tie else number(centre)

    def sensor() -> list[str]:
        """What may stand between a channel and the model."""
        usual = {
            "delay": ("0.01", "0.009"),
            "gain": ("1.0", "0.5"),
            "bias": ("0.0", "0.1"),
            "lowpass": ("0.02", "0.01"),
        }
        some = rng.sample([*usual], rng.choice((1, 1, 2)))
        return [f"{name} = {value(*usual[name])}" for name in some] if rng.random() < 0.2 else []

    lines = ["[model]", *maybe(0.5, 'rig = "srv02-rotpen"'), *maybe(0.2, 'zero = "upright"')]
    lines += [*maybe(0.2, f'actuation = "{rng.choice(("torque", "voltage"))}"'), "[model.parameters]"]
    for name in rng.sample(CONSTANTS, rng.choice((0, 0, 1, 2, 3))):
        centre, width = ("0.0", "0.5") if "rest" in name else ("1e-3", "0.99e-3")
        lines.append(f"{name} = {value(centre, width, rng.choice(CONSTANTS))}")
    lines.append("[model.orders]")
    lines += maybe(0.6, f"lambda = {value('1.0', '0.4', 'mu')}") + maybe(0.6, f"mu = {value('1.0', '0.2')}")
    release = rng.random() < 0.2
    for part in range(rng.choice((1, 1, 1, 2))):
        lines += ["[[recording]]", f'name = "swing {part}"', 'file = "swing.csv"', 'time = { column = "t" }']
        for signal in ("alpha", "theta")[: rng.choice((1, 2, 2))]:
            more = maybe(0.3, f"scale = {number('0.99', '2.0')}") + maybe(0.3, f"zero = {number('0.1', '3.14159')}")
            more += maybe(0.2, "sign = -1") + maybe(0.2, "unwrap = true")
            counts = f'unit = "counts", counts_per_turn = {whole("4096")}'
            fields = ", ".join(
                [
                    f'column = "{signal}"',
                    *more,
                    *sensor(),
                    *maybe(0.3, rng.choice(('unit = "deg"', 'unit = "rad"', counts))),
                ]
            )
            lines.append(f"{signal} = {{ {fields} }}")
        if rng.random() < 0.3:
            kind = rng.choice(("hold", "line", "band-limited"))
            table = ['column = "u"', *maybe(0.5, 'unit = "V"'), *sensor(), *maybe(0.5, f'between = "{kind}"')]
            lines.append(f"voltage = {{ {', '.join(table)} }}")
        lines += maybe(0.15, f"mask = [[{number('0.0', '0.5')}, {number('1.0', '2.0')}]]")
        lines += maybe(0.3, f"from = {number('0.2', '1.0')}", *maybe(0.3, 'history = "measured"'))
        lines += maybe(0.2, f"to = {number('1.5', '2.0')}")
        lines += maybe(0.2, f"weight = {number('2.0', '0.5')}") + maybe(0.2, f"initial = {{ alpha = {number('0.8')} }}")
        lines += maybe(release, f"release_time = {value('0.1', '0.05')}")
        lines += maybe(0.15, f"resample = {number('0.02', '0.01')}")
        lines += maybe(0.3 * part, 'use = "validate"')
    lines.append("[fit]")
    for key, choices in (
        ("cost", ("rmse", "ise", "huber", "iae", "itse", "itae")),
        ("weights", ("equal", "noise")),
        ("initial_state", ("rest", "held") if release else ("estimate", "rest", "measured", "held")),
        ("method", ("pi2", "gl", "gl-sequential", "gl-paper", "bdf2", "pi2-implicit")),
        ("memory", ("full", "compressed", "short(100)", "short(1000000000000)")),
        ("optimiser", ("multistart", "least-squares", "differential-evolution", "cma", "nelder-mead", "genetic")),
    ):
        lines += maybe(1.0 if release and key == "initial_state" else 0.25, f'{key} = "{rng.choice(choices)}"')
    lines += maybe(0.2, f"tolerance = {number('1e-8', '1e-3')}")
    lines += maybe(0.2, f"substeps = {rng.choice(('2', '3', '3', '1000000000000'))}")
    lines += maybe(0.2, f"starts = {whole('2', '3')}") + maybe(0.2, f"seed = {whole('5')}")
    own, outputs = (
        ('["alpha_rest"]', '["theta_rest", "alpha_rest"]', '["C4"]'),
        ('["alpha"]', '["theta", "alpha"]', "[]"),
    )
    lines += maybe(0.15, f"per_recording = {rng.choice(own)}") + maybe(0.15, f"outputs = {rng.choice(outputs)}")
    lines += maybe(0.1, 'preset = "paper"')
    return "\n".join([*lines, ""]).encode()


# --- the table ------------------------------------------------------------------------------------------

READERS: dict[str, tuple[tuple[str, ...], Callable[[], list[bytes]], Callable[[random.Random], bytes]]] = {
    "text": ((".csv", ".tsv", ".txt", ".dat"), _text_seeds, _text),
    "mat": ((".mat",), _mat_seeds, _mat),
    "npy": ((".npy",), _npy_seeds, _npy),
    "npz": ((".npz",), _npz_seeds, _npz),
    "hdf5": ((".h5", ".hdf5"), _hdf5_seeds, _hdf5),
    "parquet": ((".parquet",), _parquet_seeds, _parquet),
    "json": ((".json", ".jsonl"), _json_seeds, _json),
    **{name: (endings, seeds, partial(_of_package, name)) for name, (endings, seeds) in PACKAGED.items()},
    "project": ((".toml",), _project_seeds, _project),
    "search": ((".toml",), _project_seeds, _search),
}
"""Reader to endings, seeds, and what makes an input from a generator of random numbers."""


@cache
def _seeds(reader: str) -> list[bytes]:
    return READERS[reader][1]()


def input_of(reader: str, number: int) -> tuple[str, bytes]:
    """Return ending and bytes of one input; the first numbers are the seeds themselves."""
    endings, _, make = READERS[reader]
    seeds = _seeds(reader)
    ending = endings[number % len(endings)]
    raw = seeds[number] if number < len(seeds) else make(random.Random(f"{reader} {number}"))
    return ".mat" if raw.startswith(b"MATLAB 7.3") else ending, raw
