# ruff: noqa: E501, T201  (a table of sentences; a command, which prints)
"""The catalogue of bad input: what is wrong with a file, what fracid says, the exit code.

One table; ``tests/safety/test_bad_input.py`` has a test for each row, and ``docs/bad-input.md`` is written from it::

    python tests/safety/bad_input.py --write
    python tests/safety/bad_input.py --large      measures 10⁷ samples and 10,000 recordings: three minutes
    python tests/safety/bad_input.py --fuzzed     what fuzzing has run so far, from runs/fuzz

To add a row, write what is wrong, the file's name, what makes its bytes, the sentence, and the code.  The sentence is
what fracid prints, literally; ``…`` stands for what is left out of it.  Code 0 means that the file is used, and the
sentence is a note on it.
"""

from __future__ import annotations

import json
import math
import os
import struct
import subprocess
import sys
import tomllib
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import h5py
import numpy as np
import pyarrow
from scipy.sparse import csc_array

sys.path.insert(0, str(Path(__file__).parent))
import corpus

__all__ = ["LARGE", "PROJECTS", "RECORDINGS", "Row", "page"]

HERE = Path(__file__).parent
GOOD = corpus.swing(400)
T, THETA, ALPHA = GOOD.values()
MATRIX = np.column_stack([T, THETA, ALPHA])


def lazily(make: Callable[..., bytes]) -> Callable[..., Callable[[], bytes]]:
    """What makes bytes, when a test asks for them."""
    return lambda *of, **options: lambda: make(*of, **options)


@dataclass(frozen=True)
class Row:
    """One case."""

    wrong: str
    """What is wrong with the file."""
    file: str
    """Its name."""
    make: Callable[[], bytes] | Callable[[Path], None]
    """Its bytes, or for what is no plain file a function that makes it."""
    says: str
    """What fracid says; parts are joined by … ."""
    code: int
    group: str = ""

    def write(self, folder: Path) -> Path:
        """Make the file in a folder."""
        path = folder / self.file
        if self.make.__code__.co_argcount:  # type: ignore[union-attr]
            self.make(path)  # type: ignore[call-arg]
        else:
            path.write_bytes(self.make())  # type: ignore[call-arg,arg-type]
        return path


# --- makers ---------------------------------------------------------------------------------------------

Bytes = Callable[[], bytes]
mat, npz, mat73, parquet = (lazily(make) for make in (corpus.mat, corpus.npz, corpus.mat73, corpus.parquet))


def text(head: str = "t,theta,alpha", columns: Iterable[np.ndarray] = (T, THETA, ALPHA), **options: Any) -> Bytes:
    """A text recording."""
    return lazily(corpus.text)(head, columns, **options)


def put(line: int, words: str) -> Callable[[list[str]], object]:
    """Replace a line, counted from 1."""
    return lambda lines: lines.__setitem__(line - 1, words)


def with_column(j: int, at: int | slice, value: float) -> list[np.ndarray]:
    """The columns with a value put in."""
    columns = [T.copy(), THETA.copy(), ALPHA.copy()]
    columns[j][at] = value
    return columns


def element(kind: int, data: bytes) -> bytes:
    """One element of a .mat file of version 5."""
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


MAT5 = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"


def mat_object(of_class: str) -> Bytes:
    """A variable ``ts`` that is a MATLAB object."""
    words = [element(1, word.encode()) for word in ("ts", "MCOS", of_class)]
    inner = element(6, struct.pack("<II", 17, 0)) + b"".join(words) + element(14, b"")
    return lambda: MAT5 + element(14, inner)


def mat_length() -> bytes:
    """The length field of the last variable's numbers becomes 4 GiB."""
    whole = corpus.mat(GOOD)
    at = whole.rindex(struct.pack("<II", 9, 8 * T.size))
    return whole[: at + 4] + b"\xff\xff\xff\xff" + whole[at + 8 :]


def mat_bomb() -> bytes:
    """A gigabyte of zeros, packed; most of it is missing, for nobody gets that far."""
    packer = zlib.compressobj(9)
    head = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", 125_000_000, 1)) + element(1, b"alpha")
    start = struct.pack("<II", 14, len(head) + 8 + 10**9) + head + struct.pack("<II", 9, 10**9)
    packed = packer.compress(start) + packer.compress(bytes(64 * 10**6)) + packer.flush()
    return MAT5 + struct.pack("<II", 15, len(packed)) + packed


def npy_header(shape: str) -> Bytes:
    """An array of another shape than its bytes have."""
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117) + b"\n"
    return lambda: b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + MATRIX.tobytes()


def npz_bomb() -> bytes:
    """A file of 800 MB of zeros, packed; most of it is missing."""
    member = npy_header("(100000000,)")()[:128] + bytes(64 * 10**6)
    return corpus.archive([("alpha.npy", member)], zipfile.ZIP_DEFLATED)


def npz_twice() -> bytes:
    """An archive with two members of one name, as one that was appended to has."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return corpus.archive((f"{name}.npy", corpus.npy(x)) for name, x in [*GOOD.items(), ("alpha", THETA)])


def hdf5(fill: Callable[[h5py.File], object], good: bool = True) -> Bytes:
    """What is filled in, beside what is good."""
    return lambda: corpus.hdf5(lambda h: (h5_good(h) if good else None, fill(h)))


def h5_good(h: h5py.File) -> None:
    h["t"], h["alpha"] = T, ALPHA


def h5_object(kind: str) -> Callable[[h5py.File], None]:
    def fill(h: h5py.File) -> None:
        h["ts"] = np.array([[0xDD000000, 2, 1, 1, 1, 1]], dtype="u4")
        h["ts"].attrs["MATLAB_class"] = np.bytes_(kind)
        h["ts"].attrs["MATLAB_object_decode"] = np.int32(3)

    return fill


def h5_sparse(h: h5py.File) -> None:
    h["t"] = T
    h.create_group("S").attrs["MATLAB_sparse"] = np.uint64(5)


def h5_loop(h: h5py.File) -> None:
    group = h.create_group("g")
    group["again"] = group


def h5_lists(h: h5py.File) -> None:
    h.create_dataset("lists", (400,), h5py.vlen_dtype(np.float64))[0] = T[:3]


def parquet_twice() -> bytes:
    """A table with two columns of one name."""
    return corpus.parquet(pyarrow.Table.from_arrays([pyarrow.array(x) for x in (T, THETA, ALPHA, ALPHA)],
                                                    ["t", "u", "alpha", "alpha"]))  # fmt: skip


def json_log(**columns: object) -> Bytes:
    """Columns in JSON; single values stand beside them."""
    return lambda: corpus.json_log(GOOD | columns)


def json_lines() -> bytes:
    return "\n".join(json.dumps(dict(zip(GOOD, row, strict=True))) for row in zip(*GOOD.values(), strict=True)).encode()


def cut(raw: Bytes) -> Bytes:
    """The first half."""
    return lambda: (whole := raw())[: len(whole) // 2]


def noise(start: bytes = b"") -> Bytes:
    return lambda: start + np.random.default_rng(1).bytes(2000)


# --- recordings -----------------------------------------------------------------------------------------

EMPTY = "is empty. A recording needs at least two rows of numbers."
NOT_TEXT = "is not text: it holds zero bytes. Is it a binary file with a wrong ending?"
UNPACKS = "unpacks to more than … numbers, as no recording of that size does. Is it damaged?"
COMPLEX = "is complex; save its real part, or real and imaginary part as two arrays"

TEXTS = [
    Row("empty", "log.csv", lambda: b"", f"log.csv {EMPTY}", 3),
    Row("blank lines alone", "log.csv", lambda: b"\n \n\n", f"log.csv {EMPTY}", 3),
    Row("a header alone", "log.csv", text(columns=(T[:0],) * 3),
        "log.csv holds no row of numbers; its line 1, for example, is 't,theta,alpha'. Expected numbers like", 3),
    Row("binary", "log.csv", noise(), f"log.csv {NOT_TEXT}", 3),
    Row("prose, or a page of the web", "log.csv", lambda: b"<html>\n<body>not found</body>\n",
        "log.csv holds no row of numbers; its line", 3),
    Row("cut off in a line", "log.csv", text(change=put(101, "0.990000,0.0")),
        "log.csv, line 101: 2 cells where other lines have 3 ('0.990000,0.0'). Was the line cut off while it was written?",
        3),
    Row("cut off in the last number", "log.csv", text(change=put(401, "3.99,-0.05,0.3"), end=""),
        "The last line, '3.99,-0.05,0.3', has no end: its last number may have been cut off.", 0),
    Row("ragged rows", "log.csv", text(change=lambda lines: lines.__setitem__(200, lines[200] + ",7")),
        "log.csv, line 201: 4 cells where other lines have 3", 3),
    Row("UTF-16", "log.csv", text(encoding="utf-16"), "The text is UTF-16.", 0),
    Row("UTF-16 without its mark", "log.csv", text(encoding="utf-16-le"), "The text is UTF-16 without a mark that says so.", 0),
    Row("UTF-16, cut off", "log.csv", lambda: text(encoding="utf-16")()[:-1],
        "log.csv begins as UTF-16 text and goes on as something else. Was it cut off while it was written?", 3),
    Row("a byte-order mark", "log.csv", text(encoding="utf-8-sig"), "good: 400 samples", 0),
    Row("Latin-1", "log.csv", text(head="t,theta [°],alpha [°]", encoding="latin-1"),
        "The text is not UTF-8: read as Latin-1.", 0),
    Row("line ends of the old Macintosh", "log.csv", lambda: text()().replace(b"\n", b"\r"), "good: 400 samples", 0),
    Row("zero bytes at the start", "log.csv", text(change=put(2, "0\0,0,0")), f"log.csv {NOT_TEXT}", 3),
    Row("zero bytes at the end, from a power cut", "log.csv", lambda: text()() + bytes(512),
        "log.csv, line 402: zero bytes among the text. Did the logger lose power?", 3),
    Row("decimal commas", "log.csv", text(separator=";", decimal=","), "Its numbers have decimal commas.", 0),
    Row("decimal commas and commas between the cells", "log.csv", text(decimal=","),
        "log.csv has 3 names above rows of 6 cells: is the comma both the separator and the decimal sign?", 3),
    Row("a point among decimal commas", "log.csv", text(separator=";", decimal=",", change=put(9, "0,07;0.5;0,1")),
        "log.csv, line 9, column 1 (theta): '0.5' is not a number.", 3),
    Row("thousands separators", "log.csv", text(head="t;alpha", change=lambda lines: lines.__setitem__(
        slice(1, None), [f"{k};1.234,5" for k in range(50)])),
        "'1.234,5' has a separator between its thousands: save the numbers without, as 1234,5.", 3),
    Row("dates as time", "log.csv", text(head="t,alpha", change=lambda lines: lines.__setitem__(
        slice(1, None), [f"2024-01-01 12:00:{k / 10:06.3f},{k % 7}" for k in range(50)])),
        "Time is counted from the first stamp, 1704110400.000000 s.", 0),
    Row("dates that no calendar has", "log.csv", text(head="t,alpha", change=lambda lines: lines.__setitem__(
        slice(1, None), [f"2024-02-31 12:00:{k},1.5" for k in range(10, 50)])),
        "Expected numbers like 0.01 or -1.5e-3, without units and thousands separators; dates like 2024-01-31 12:00:00.", 3),
    Row("decimal commas in quotes", "log.csv", text(change=lambda lines: lines.__setitem__(
        slice(1, None), ['"' + x.replace(",", '","').replace(".", ",") + '"' for x in lines[1:]])),
        "Its numbers have decimal commas.", 0),
    Row("names with commas in quotes", "log.csv", text(head='"Time; s","Angle; deg",alpha', change=lambda lines: lines.__setitem__(
        0, lines[0].replace(";", ","))), "Angle, deg is in deg, as the header says.", 0),
    Row("other separators from the middle on", "log.csv",
        text(change=lambda lines: lines.__setitem__(slice(200, None), [x.replace(",", ";") for x in lines[200:]])),
        "log.csv has rows of two kinds: 199 like '0.000000,0.000000,0.800000' (cells between commas, decimal point), and "
        "then 3 cells a row (cells between semicolons, decimal point). Write all rows alike.", 3),
    Row("another separator in one line", "log.csv", text(change=put(201, "1.99;0.03;0.7")),
        "log.csv, line 201: 1 cell where other lines have 3 ('1.99;0.03;0.7').", 3),
    Row("numbers above the table", "log.csv", text(head="8, 3\nt,theta,alpha"),
        "Above the table a line of numbers was left out: '8, 3'.", 0),
    Row("fewer names than columns", "log.csv", text(head="t,alpha"),
        "The header has 2 names and the rows 3 cells: columns are called by their position.", 0),
    Row("text among the numbers", "log.csv", text(change=put(3, "0.01,stuck,0.8")),
        "log.csv, line 3, column 1 (theta): 'stuck' is not a number. Correct it or leave it blank.", 3),
    Row("a number of 300,000 digits and a letter", "log.csv", text(change=put(3, f"0.01,{'9' * 300_000}x,0.8")),
        "log.csv, line 3, column 1 (theta): '9999999999999999999999999999999999999999...' is not a number.", 3),
    Row("a name of 300,000 characters", "log.csv", text(head="t," + "sampl" * 60_000 + ",alpha"),
        "good: 400 samples", 0),
    Row("dozens of columns", "log.csv", text(head="t," + ",".join(f"c{k}" for k in range(60)),
        columns=(T, *(ALPHA + k for k in range(60)))), "and 10 more signals: add --json for all", 0),
    Row("time from left to right", "log.csv", lambda: (",".join(["1"] * 20_000) + "\n").encode() * 3,
        "log.csv has a line of 20000 cells; fracid reads 10000 columns at most. Time must run downwards", 3),
    Row("a terminal's commands in the header", "log.csv", text(head="t,\x1b[31mtheta,alpha"), r"\x1b[31mtheta", 0),
    Row("an ending that says nothing", "log.doc", text(), "log.doc: unknown ending '.doc'; fracid reads .csv .tsv .txt", 2),
]  # fmt: skip

SAMPLES = [
    Row("one sample", "log.csv", text(columns=(T[:1], THETA[:1], ALPHA[:1])),
        "1 sample; a recording needs at least two.", 3),
    Row("two samples", "log.csv", text(columns=(T[:2], THETA[:2], ALPHA[:2])),
        "2 samples are too few to identify a model from", 3),
    Row("no clock", "log.csv", text(head="theta,alpha", columns=(THETA, ALPHA)),
        "log.csv: no column increases like time. … Give the rate [Hz] or the time column: --rate HZ, --time COLUMN.", 2),
    Row("a row twice", "log.csv", text(change=lambda lines: lines.insert(51, lines[50])),
        "1 row repeats the one before and was left out: the same time and the same values.", 0),
    Row("a time stamp twice", "log.csv",
        text(change=lambda lines: lines.insert(51, f"{lines[50].partition(',')[0]},{lines[20].partition(',')[2]}")),
        "time does not increase: 1 stamp repeats the one before, the first at 0.49 s.", 3),
    Row("time that goes back", "log.csv", text(change=lambda lines: lines.insert(51, lines[20])),
        "1 stamp goes back, the first in row 51: 0.19 s after 0.49 s. … or split the file there.", 3),
    Row("time that runs backwards", "log.csv", text(columns=(T[::-1], THETA, ALPHA)),
        "time does not increase: 399 stamps go back", 3),
    Row("a clock whose name has its unit", "log.csv", text(head="t_ms,theta,alpha", columns=(1000 * T, THETA, ALPHA)),
        "Time is in ms, as its name 't_ms' says.", 0),
    Row("a clock that is headed by its unit", "log.csv", text(head="ms,theta,alpha", columns=(1000 * T, THETA, ALPHA)),
        "Time is in ms, as its name 'ms' says.", 0),
    Row("degrees of which nobody says so", "log.csv", text(columns=(T, np.degrees(THETA), np.degrees(ALPHA))),
        "alpha has no unit: taken to be in degrees: two turns of radians are more than a pendulum does.", 0),
    Row("a volt of which nobody says so", "log.csv", text(head="t,theta,alpha,u", columns=(T, THETA, ALPHA, 5 * THETA)),
        "u has no unit: taken to be in volts.", 0),
    Row("an angle whose count was wrapped", "log.csv", text(columns=(T, THETA, (ALPHA + 2 * np.pi) % (2 * np.pi))),
        "between two samples it jumps by a whole turn, … was its count wrapped? Type unwrap = true in its table.", 0),
    Row("a clock that was set", "log.csv", text(columns=(np.where(T > 2, T + 0.15, T), THETA, ALPHA)),
        "samples are missing in 1 gap (0.16 s after 2 s) … its clock jumps by 0.16 s after 2 s, and the motion goes on as if it had not", 0),
    Row("a clock of 32 bits that begins again", "log.csv", text(head="micros,theta,alpha", columns=((4.293e9 + 1e6 * T) % 2**32, THETA, ALPHA)),
        "'micros' begins again at 2³² once: the clock is continued.", 0),
    Row("infinite time stamps", "log.csv", text(columns=with_column(0, 7, np.inf)),
        "1 of 400 rows have no time stamp and were left out.", 0),
    Row("time as no clock has it", "log.csv", text(head="t,alpha", columns=(T, ALPHA), change=lambda lines: lines.
        __setitem__(slice(1, None), [f"{k}e30,{a}" for k, a in enumerate(ALPHA)])),
        "log.csv: time has steps from 1e+30 to 1e+30 s over 3.99e+32 s, as no clock has. Is it another column, or in another unit?", 3),
    Row("a constant signal beside others", "log.csv", text(columns=with_column(1, slice(None), 0.0)),
        "Left out as constant: 'theta'.", 0),
    Row("constant signals alone", "log.csv", text(columns=(T, 0 * T, 0 * T + 1)),
        "no signal moves: is this the right file, and are its sensors connected?", 3),
    Row("a column of NaN", "log.csv", text(columns=with_column(1, slice(None), np.nan)),
        "Left out as blank where time is stamped: 'theta'.", 0),
    Row("columns of NaN alone", "log.csv", text(columns=(T, T * np.nan, T * np.nan)),
        "log.csv holds no signal besides its time. Blank throughout: theta, alpha.", 3),
    Row("a missing sample", "log.csv", text(columns=with_column(2, 7, np.nan)),
        "alpha misses 1 sample at 0.07 s (0.25 %): a fit interpolates and does not score it", 0),
    Row("an infinite sample", "log.csv", text(columns=with_column(2, 7, np.inf)),
        "alpha: 1 sample is infinite or beyond 1e+100, and taken as missing.", 0),
    Row("samples of 10³⁰⁸", "log.npz", npz({"t": T, "alpha": with_column(2, slice(7, 9), 1e308)[2]}),
        "alpha: 2 samples are infinite or beyond 1e+100, and taken as missing.", 0),
    Row("a long gap", "log.csv", text(columns=(np.where(T > 2, T + 1, T), THETA, ALPHA)),
        "a gap of 1.01 s after 2 s is 20 % of the recording.", 3),
]  # fmt: skip

BINARY = [
    Row("empty", "run.mat", lambda: b"", f"run.mat {EMPTY}", 3, "MATLAB"),
    Row("binary, but no MATLAB file", "run.mat", noise(b"\x01\x02\x03\x04"), "run.mat is damaged or is no MATLAB file", 3),
    Row("text", "run.mat", text(), "run.mat is damaged or is no MATLAB file (no MATLAB header). Save it again.", 3),
    Row("version 4: good", "run.mat", mat(GOOD, format="4"), "good: 400 samples", 0),
    Row("version 4, cut off", "run.mat", cut(mat(GOOD, format="4")), "run.mat is damaged or is no MATLAB file (a matrix of 1×400 "
        "should have 3200 bytes", 3),
    Row("version 4 with 2³¹−1 rows", "run.mat",
        lambda: mat(GOOD, format="4")().replace(struct.pack("<5i", 0, 1, 400, 0, 2), struct.pack("<5i", 0, 2**31 - 1, 400, 0, 2)),
        "run.mat is damaged or is no MATLAB file (a matrix of 2147483647×400 should have", 3),
    Row("version 5, cut off", "run.mat", cut(mat(GOOD)), "run.mat is damaged or is no MATLAB file (an element should have", 3),
    Row("version 5, a length field of 4 GiB", "run.mat", mat_length,
        "run.mat is damaged or is no MATLAB file (a", 3),
    Row("version 7, cut off", "run.mat", cut(mat(GOOD, do_compression=True)), "run.mat is damaged or is no MATLAB file", 3),
    Row("version 7, a gigabyte of zeros packed", "run.mat", mat_bomb, UNPACKS, 3),
    Row("a sparse matrix", "run.mat", mat({"t": T, "S": csc_array(np.eye(5))}), "Left out: S is a sparse matrix; save full(…) of it.", 3),
    Row("a complex array", "run.mat", mat({**GOOD, "alpha": ALPHA * 1j}), f"Left out: alpha {COMPLEX}.", 0),
    Row("a cell array", "run.mat", mat({"c": np.array([1, "a"], dtype=object)}),
        "run.mat holds no arrays of numbers. What it holds: c is a cell array; save its numbers as arrays.", 3),
    Row("text in variables", "run.mat", mat({"who": "me"}),
        "run.mat holds no arrays of numbers. What it holds: who is text.", 3),
    Row("single numbers", "run.mat", mat({"t": 1.0, "alpha": 2.0}),
        "run.mat holds single numbers (t, alpha); a recording needs at least two samples.", 3),
    Row("a timeseries object", "run.mat", mat_object("timeseries"),
        "ts is a MATLAB timeseries; in MATLAB type s = struct(ts); save('f.mat', '-struct', 's').", 3),
    Row("a table", "run.mat", mat_object("table"),
        "ts is a MATLAB table; in MATLAB type s = table2struct(T, 'ToScalar', true); save('f.mat', '-struct', 's').", 3),
    Row("a timetable", "run.mat", mat_object("timetable"), "ts is a MATLAB timetable; in MATLAB type s =", 3),
    Row("three dimensions", "run.mat", mat({"t": T, "a": np.zeros((3, 4, 5))}),
        "Left out: a has 3 dimensions; save one vector for each signal.", 3),
    Row("vectors of different lengths", "run.mat", mat({**GOOD, "u": T[:399]}),
        "Left out: u has 399 numbers where others have 400.", 0),
    Row("several matrices", "run.mat", mat({"a": np.zeros((9, 2)), "b": np.zeros((9, 2))}),
        "run.mat holds several arrays: a 9×2, b 9×2. Choose one: variable = 'a'.", 2),
    Row("version 7.3: good", "run.mat", mat73(h5_good), "good: 400 samples", 0),
    Row("version 7.3, cut off", "run.mat", cut(mat73(h5_good)), "run.mat is damaged or is no HDF5 file", 3),
    Row("version 7.3, a timeseries", "run.mat", mat73(h5_object("timeseries")),
        "ts is a MATLAB timeseries; in MATLAB type s = struct(ts)", 3),
    Row("version 7.3, a sparse matrix", "run.mat", mat73(h5_sparse),
        "Left out: S is a sparse matrix; save full(…) of it.", 3),
    Row("empty", "run.npz", lambda: b"", f"run.npz {EMPTY}", 3, "NumPy"),
    Row("cut off", "run.npz", cut(npz(GOOD)), "run.npz is damaged or is no NumPy file (File is not a zip file). Save it again.", 3),
    Row("text", "run.npz", text(), "run.npz is damaged or is no NumPy file", 3),
    Row("an archive of nothing", "run.npz", npz({}), "run.npz holds no arrays of numbers.", 3),
    Row("a gigabyte of zeros packed", "run.npz", npz_bomb, UNPACKS, 3),
    Row("Python objects", "run.npz", npz({"t": np.array([1, "a"], dtype=object)}),
        "t holds Python objects, which fracid does not open: that would run code", 3),
    Row("complex", "run.npz", npz({**GOOD, "alpha": ALPHA * 1j}), f"Left out: alpha {COMPLEX}.", 0),
    Row("two arrays of one name", "run.npz", npz_twice, "Left out: alpha is the name of 2; give each its own.", 0),
    Row("dates as time", "run.npz", npz({"t": np.datetime64("2024-01-01") + np.arange(400) * np.timedelta64(10, "ms"),
                                         "alpha": ALPHA}), "Time is counted from the first stamp", 0),
    Row("pickled objects", "run.npy", lambda: corpus.npy(np.array([1, "a"], dtype=object), allow_pickle=True),
        "holds Python objects, which fracid does not open: that would run code", 3),
    Row("cut off", "run.npy", cut(lambda: corpus.npy(np.column_stack([T, ALPHA]))),
        "run.npy is damaged or is no NumPy file (its array of 400×2 should have 6400 bytes", 3),
    Row("a shape of 10¹¹ rows", "run.npy", npy_header("(99999999999, 3)"),
        "run.npy is damaged or is no NumPy file (its array of 99999999999×3 should have", 3),
    Row("a shape below zero", "run.npy", npy_header("(-1, 3)"), "run.npy is damaged or is no NumPy file", 3),
    Row("empty", "run.h5", lambda: b"", f"run.h5 {EMPTY}", 3, "HDF5"),
    Row("cut off", "run.h5", cut(hdf5(lambda _: None)), "run.h5 is damaged or is no HDF5 file (Unable to", 3),
    Row("text", "run.h5", text(), "run.h5 is damaged or is no HDF5 file (Unable to", 3),
    Row("a dataset of 10¹² numbers, none of them there", "run.h5", hdf5(lambda h: h.create_dataset("z", (10**12,), "f8", chunks=(10**6,))), UNPACKS, 3),
    Row("160 MB of zeros packed", "run.h5", hdf5(lambda h: h.create_dataset("z", data=np.zeros(2 * 10**7), chunks=(10**6,), compression=9)), UNPACKS, 3),
    Row("a group that holds itself", "run.h5", hdf5(h5_loop),
        "Left out: g.again is a group that was read before, or lies too deep.", 0),
    Row("a link to another file", "run.h5", hdf5(lambda h: h.__setitem__("far", h5py.ExternalLink("/etc/other.h5", "/t"))),
        "Left out: far is a link to elsewhere, which is not followed.", 0),
    Row("data that lie in another file", "run.h5", hdf5(lambda h: h.create_dataset("far", (8,), "u1", external=[("/etc/hostname", 0, 8)])),
        "Left out: far lies in another file, which is not opened.", 0),
    Row("complex", "run.h5", hdf5(lambda h: h.__setitem__("z", ALPHA * 1j)), f"Left out: z {COMPLEX}.", 0),
    Row("text and nothing else", "run.h5", hdf5(lambda h: h.__setitem__("who", "me"), good=False),
        "run.h5 holds no arrays of numbers. What it holds: who is text.", 3),
    Row("a list of numbers for each sample", "run.h5", hdf5(h5_lists),
        "Left out: lists holds a list of numbers for each sample; save one number for each.", 0),
    Row("empty", "run.parquet", lambda: b"", f"run.parquet {EMPTY}", 3, "Parquet"),
    Row("cut off", "run.parquet", cut(parquet(GOOD)), "run.parquet is damaged or is no Parquet file", 3),
    Row("text", "run.parquet", text(), "run.parquet is damaged or is no Parquet file", 3),
    Row("160 MB of zeros packed", "run.parquet", parquet({"t": np.zeros(2 * 10**7)}), UNPACKS, 3),
    Row("no rows", "run.parquet", parquet({"t": T[:0], "alpha": T[:0]}),
        "run.parquet holds no arrays of numbers. What it holds: t is empty; alpha is empty.", 3),
    Row("missing samples", "run.parquet", parquet({"t": T, "alpha": [None, *ALPHA[1:]]}), "alpha misses 1 sample at 0 s (0.25 %)", 0),
    Row("two columns of one name", "run.parquet", parquet_twice, "Left out: alpha is the name of 2; give each its own.", 0),
    Row("words", "run.parquet", parquet(GOOD | {"who": ["me"] * 400}),
        "Left out: who is no column of numbers.", 0),
    Row("empty", "run.json", lambda: b"", f"run.json {EMPTY}", 3, "JSON"),
    Row("cut off", "run.json", cut(json_log()), "run.json is damaged or is no JSON file", 3),
    Row("text", "run.json", text(), "run.json is damaged or is no JSON file (Expecting value", 3),
    Row("a line for each sample", "run.jsonl", json_lines, "good: 400 samples", 0),
    Row("NaN, which JSON has not", "run.json", json_log(alpha=[math.nan, *ALPHA[1:]]), "alpha misses 1 sample at 0 s (0.25 %)", 0),
    Row("single values beside the samples", "run.json", json_log(mass=0.49, motor="xl330"),
        "Beside its samples it has mass = 0.49, motor = xl330.", 0),
    Row("single values alone", "run.json", lambda: b'{"mass": 0.49}', "run.json holds no arrays of numbers.", 3),
    Row("lists in lists in lists", "run.json", lambda: b"[" * 5000, "run.json is damaged or is no JSON file (it lies too deep in itself)", 3),
    Row("records of which each has a name of its own", "run.json", lambda: json.dumps([{f"c{k}": 0} for k in range(3000)]).encode(),
        UNPACKS, 3),
    Row("text among the numbers", "run.json", json_log(theta=["stuck", *THETA[1:]]), "Left out: theta holds values of several kinds.", 0),
]  # fmt: skip


def _link_to_itself(path: Path) -> None:
    path.symlink_to(path)


def _unreadable(path: Path) -> None:
    path.write_bytes(text()())
    path.chmod(0)


FILES = [
    Row("no such file", "swing.csv", lambda path: path.with_name("swings.csv").write_bytes(text()()),
        "no file … swing.csv: did you mean … swings.csv?", 2),
    Row("a folder", "swing.csv", lambda path: path.mkdir(), "(it is a folder)", 2),
    Row("a pipe, which may never end", "swing.csv", lambda path: os.mkfifo(path),
        "is no plain file but a pipe or a device; save the recording to a file.", 2),
    Row("a device, which never ends", "swing.csv", lambda path: path.symlink_to("/dev/zero"),
        "is no plain file but a pipe or a device; save the recording to a file.", 2),
    Row("a link that leads to itself", "swing.csv", _link_to_itself, "cannot be read: Too many levels of symbolic links.", 2),
    Row("a link to a file of the system", "swing.csv", lambda path: path.symlink_to("/etc/passwd"),
        "swing.csv is a link to /etc/passwd, which is no recording; what stands there is not quoted.", 3),
    Row("no permission", "swing.csv", _unreadable, "swing.csv cannot be read: Permission denied.", 2),
    Row("a name of 300 letters", "x" * 300 + ".csv", lambda _: None, "cannot be read: File name too long.", 2),
]  # fmt: skip


def _grouped(rows: list[Row], group: str) -> list[Row]:
    """The rows with their group; a row that names one begins it."""
    found = []
    for row in rows:
        group = row.group or group
        found.append(replace(row, group=group))
    return found


RECORDINGS = [*_grouped(TEXTS, "Text"), *_grouped(SAMPLES, "Samples"), *_grouped(BINARY, ""), *_grouped(FILES, "Files")]


# --- projects -------------------------------------------------------------------------------------------

ONE = '[[recording]]\nfile = "swing.csv"\ntime = { column = "t" }\nalpha = { column = "alpha" }\n'

MADE: dict[str, Callable[[], bytes] | Callable[[Path], None]] = {
    "binary": noise(b"\xff\xfe"),
    "UTF-16": lambda: ONE.encode("utf-16"),
    "a byte-order mark": lambda: b"\xef\xbb\xbf" + ONE.encode(),
    "tables a thousand deep": lambda: f"{ONE}x = {'[' * 5000}".encode(),
    "a key of a thousand parts": lambda: f"{ONE}a{'.a' * 1000} = 1".encode(),
    "a number of 5000 digits": lambda: f"{ONE}[fit]\nseed = {'9' * 5000}".encode(),
    "three thousand copies of one recording": lambda: (ONE * 3000).encode(),
    "a pipe": lambda path: os.mkfifo(path),
}
"""What no text is, or a long one."""


def project(wrong: str, says: str, *, words: str = ONE, alpha: str = "", add: str = "", code: int = 2) -> Row:
    """A row of bad_projects.toml."""
    words = words.replace('"alpha" }', f'"alpha", {alpha} }}') if alpha else words
    return Row(wrong, "rig.toml", MADE.get(wrong, lambda: (words + add).encode()), says, code, "Project files")


PROJECTS = [
    project(**row) for row in tomllib.loads((HERE / "bad_projects.toml").read_text(encoding="utf-8"))["project"]
]


# --- the page -------------------------------------------------------------------------------------------

PAGE = HERE.parents[1] / "docs" / "bad-input.md"


def page() -> str:
    """Return the page, with what was measured kept from the page that is there."""
    parts = []
    for group in dict.fromkeys(row.group for row in [*RECORDINGS, *PROJECTS]):
        rows = [row for row in [*RECORDINGS, *PROJECTS] if row.group == group]
        command = "`fracid fit rig.toml` says" if group == "Project files" else "`fracid check` says"
        parts.append(f"## {group}\n\n| wrong | file | {command} | code |\n|---|---|---|---|\n")
        parts += [f"| {r.wrong} | `{_short(r.file)}` | {_cell(r.says)} | {r.code} |\n" for r in rows]
        parts.append("\n")
    measured = {name: _kept(name) for name in ("large", "fuzzed")}
    template = (HERE / "bad_input.md.in").read_text(encoding="utf-8").removesuffix("\n")
    return template.format(tables="".join(parts).rstrip("\n"), **measured)


def _short(name: str) -> str:
    return name if len(name) < 40 else f"{name[:3]}…{name[-7:]}"


def _cell(says: str) -> str:
    """A sentence as code; what goes on after it is dots."""
    more = "" if says.endswith((".", "?")) else " …"
    return f"`{says.replace('|', chr(92) + '|')}{more}`" if says else "—"


def _marks(name: str) -> tuple[str, str]:
    return f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"


def _kept(name: str) -> str:
    """Return what stands between the marks of a part that is measured, with them."""
    start, end = _marks(name)
    there = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    inside = there.split(start)[1].split(end)[0] if start in there else ""
    return f"{start}{inside}{end}"


def _put(name: str, lines: list[str]) -> None:
    """Write a part that is measured into the page."""
    start, end = _marks(name)
    before, rest = PAGE.read_text(encoding="utf-8").split(start)
    PAGE.write_text(before + start + "\n".join([*lines, "", end]) + rest.split(end)[1], encoding="utf-8")


# --- what is measured -----------------------------------------------------------------------------------

READ = """
import resource, sys, time
from fracid import {call}
begin = time.process_time()
{call}(sys.argv[1])
print(time.process_time() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""


def _measured(call: str, file: Path) -> str:
    """Read a file in a process of its own; return processor time and peak memory as cells of a table."""
    done = subprocess.run(
        [sys.executable, "-c", READ.format(call=call), file], capture_output=True, text=True, check=True
    )
    seconds, megabytes = map(float, done.stdout.split())
    return f"{file.stat().st_size / 1e6:.0f} MB | {seconds:.1f} s | {megabytes:.0f} MB"


def long_recording(path: Path) -> np.ndarray:
    """Write 10⁷ samples; gives them."""
    time = np.arange(10**7) / 1000
    alpha = np.round(4096 * np.cos(time)) * 2e-4
    if path.suffix == ".npz":
        np.savez(path, t=time, alpha=alpha)
        return alpha
    with path.open("w") as file:
        for k in range(0, time.size, 10**5):
            pairs = zip(time[k : k + 10**5], alpha[k : k + 10**5], strict=True)
            file.writelines(f"{t:.3f},{a:.4f}\n" for t, a in pairs)
    return alpha


def many_recordings(path: Path) -> None:
    """Write a project of 10,000 recordings, and those."""
    words = ['[model.orders]\nlambda = 1.0\nmu = 0.95\n[fit]\ninitial_state = "held"\n']
    for k in range(10_000):
        np.save(path.with_name(f"{k}.npy"), np.column_stack([T[:20], np.cos(5 * T[:20]) + 1e-6 * k]))
        words.append(f'[[recording]]\nfile = "{k}.npy"\ntime = {{ column = 0 }}\nalpha = {{ column = 1 }}\n')
    path.write_text("".join(words))


LARGE = {
    "long.csv": ("10⁷ samples of two columns, text", long_recording, "load_recording"),
    "long.npz": ("10⁷ samples of two columns, `.npz`", long_recording, "load_recording"),
    "rig.toml": ("a project of 10,000 recordings", many_recordings, "load_project"),
}
"""File → what it is, what writes it, what reads it."""


def large() -> list[str]:
    """Measure long recordings and a project of many."""
    lines = ["| | file | processor time | peak memory |", "|---|---|---|---|"]
    with TemporaryDirectory() as folder:
        for name, (what, write, call) in LARGE.items():
            write(Path(folder, name))
            lines.append(f"| {what} | {_measured(call, Path(folder, name))} |")
    return [
        *lines,
        "",
        "By `python tests/safety/bad_input.py --large`; peak memory is the whole process, fracid's modules included.",
    ]


def fuzzed() -> list[str]:
    """What was run so far."""
    lines = [
        "| reader | inputs | taken | refused in a line | failed | and of earlier source |",
        "|---|---|---|---|---|---|",
    ]
    import fuzz

    found = {reader: fuzz.kept(reader, PAGE.parents[1] / "runs" / "fuzz") for reader in fuzz.READERS}
    for reader, kept in found.items():
        n, taken, bad = fuzz.counts(kept)
        lines.append(f"| {reader} | {n:,} | {taken:,} | {n - taken - bad:,} | {bad} | {kept['before']:,} |")
    fewest = min(fuzz.counts(kept)[0] for kept in found.values())
    aim = "" if fewest >= 1_000_000 else " The aim is a million of each: `make fuzz` goes on from here."
    return [
        *lines,
        "",
        f"The counts are for the current readers and earlier versions; every failure found has been fixed.{aim}",
        "`python tests/safety/fuzz.py --table` prints the count. A million of a reader take 6 to 16 minutes of one processor. Those",
        "that a package reads (`xlsx` to `db3`) have had thousands: a million of them take hours. Beside",
        "these `python tests/safety/fuzz_guided.py READER` follows the branches of the code with atheris.",
    ]


if __name__ == "__main__":
    for option, part in (("--large", large), ("--fuzzed", fuzzed)):
        if option in sys.argv:
            _put(option[2:], part())
    if "--write" in sys.argv:
        PAGE.write_text(page(), encoding="utf-8")
    print(f"{len(RECORDINGS) + len(PROJECTS)} rows: {PAGE}")
