"""Hostile files for the readers: good ones of :mod:`corpus`, bent in ways that real damage and malice bend them.

Every input is a pure function of reader and number, ``input_of("mat", 1234)``, so that a failure is found again by its
number alone.  To a seed one strategy makes one to eight changes:

=============  =====================================================================================
on             changes
=============  =====================================================================================
any bytes      a bit flipped, a byte or a whole number of 2, 4 or 8 bytes set to an extreme (a length
               field of 4 GiB, say), a block cut out, doubled, moved, overwritten, the end cut off,
               the end of another seed spliced on
text           a cell, a separator, a line, an encoding changed; characters that no logger writes
JSON           a number changed for something else
.npy header    its dictionary's type, order and shape changed
.npz .xlsx     a member, or its name, changed *inside* the packing, so that its checksum holds
.mat           the same inside of what is packed
Parquet        the footer, with its length put right
project file   a value, a key, a line, a table changed for another; brackets a thousand deep
=============  =====================================================================================

A search, ``input_of("search", 1234)``, begins with a project written anew from ``search.toml.in``: all its keys
are ones that there are, most of its values are sensible, and some are numbers at the edge of what can be computed with.
"""

from __future__ import annotations

import io
import random
import re
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterable
from functools import cache, partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from corpus import SEEDS, archive

__all__ = ["PACKAGED", "READERS", "Strategy", "any_bytes", "input_of", "times"]

Strategy = Callable[[bytes, random.Random, list[bytes]], bytes]
"""One change to bytes, of which others of their kind stand beside."""

EXTREMES = (0, 1, 2, 7, 8, 127, 128, 255, 256, 4096, 65535, 65536, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**63 - 1)


def times(rng: random.Random) -> Iterable[int]:
    """For so many changes: one half of the inputs has a single one, one in a hundred eight."""
    return range(min(8, 1 + int(rng.expovariate(0.7))))


def any_bytes(raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    """Damage as a disc or a line does it, or malice that knows of length fields."""
    if not raw:
        return rng.randbytes(rng.choice((1, 8, 200)))
    at, to = rng.randrange(len(raw)), rng.randrange(len(raw))
    size = min(rng.choice((1, 2, 4, 8, 16, 64, 512)), len(raw) - at)
    start, block, end = raw[:at], raw[at : at + size], raw[at + size :]
    number, other = _number(rng), rng.choice(others)
    even = at - at % len(number) if rng.random() < 0.7 else at
    byte = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
    return rng.choice((
        start + bytes([raw[at] ^ 1 << rng.randrange(8)]) + raw[at + 1 :], start + bytes([byte]) + raw[at + 1 :],
        *(raw[:even] + number + raw[even + len(number) :],) * 2, start + end,
        start + block * rng.choice((2, 2, 2, 100)) + end, raw[:to] + block + raw[to + size :], start,
        start + other[rng.randrange(len(other)) if other else 0 :], start + rng.randbytes(size) + end,
    ))  # fmt: skip


def _number(rng: random.Random) -> bytes:
    """Return an extreme whole number, perhaps negative or off by one, in 2, 4 or 8 bytes of either order."""
    size = rng.choice((2, 4, 4, 8))
    value = (rng.choice(EXTREMES) + rng.choice((0, 0, 0, -1, 1))) * rng.choice((1, 1, 1, -1))
    return (value % (1 << 8 * size)).to_bytes(size, rng.choice(("little", "little", "big")))


# --- strategies that know the format --------------------------------------------------------------------

CELLS = (
    "", " ", "nan", "NaN", "null", "inf", "-inf", "1e999", "-1e308", "1e-320", "5e-324", "1_000", "0x10", "--1",
    "-", "+", ".", ",", "1,5", "1.5", "1.234,5", "12:30:01", "2024-01-01", '"', "'1'", "\0", "\0\0\0", "\ufeff",
    "\x1b[31m", "١٢", "9" * 400, "e", "1e", "abc", "°", "1 2", "#", "//", "%", "\x85", "\u2028", "\x0c", "a\\b",
    "t [ms]", "(s)", "time", "1.7e9", "1e16", "True", "=1+1", "9" * 20_000 + "x", "9" * 9000 + "." + "9" * 9000 + "e",
    "sampl" * 4000, "sampl" + "_" * 20_000, "a" + " " * 20_000 + "b", "(" * 20_000, "joint2" * 3000, "x" * 9000 + " [",
)  # fmt: skip
ENCODINGS = ("utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "latin-1", "cp1252", "utf-7", "cp500")
ENDS = (b"\r\n", b"\r", b"\n\n", b"\r\r\n", b"\0\n", b" \n", b",\n")


def _text(raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    lines, kind = raw.split(b"\n"), rng.randrange(14)
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    separator = next((s for s in (b"\t", b";", b",", b" ") if s in lines[at]), b",")
    some = slice(*sorted((at, to)))
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
        lines[some] = [line.replace(b".", b",") for line in lines[some]] if rng.random() < 0.5 else []
    elif kind == 7:
        lines[some] = lines[some] * rng.choice((2, 3, 20))
    elif kind == 8:
        return raw.decode("utf-8", "replace").encode(rng.choice(ENCODINGS), "replace")
    elif kind == 9:
        return raw.replace(b"\n", rng.choice(ENDS))
    else:
        return any_bytes(raw, rng, others)
    return b"\n".join(lines)


JSON_VALUES = ("null", "true", "NaN", "-Infinity", "1e999", "1" * 5000, '"x"', "[]", "{}", "[1,2]", '{"a":1}', "[[[]]]",
               '"' + "x" * 9000 + '"', "[" * 500, '{"0":1,"1":2}', '"2024-01-01"', "-", '"\\ud800"')  # fmt: skip


def _json(raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    numbers = [*re.finditer(rb"-?[0-9][0-9.e-]*", raw)]
    if not numbers:
        return any_bytes(raw, rng, others)
    at = rng.choice(numbers)
    return raw[: at.start()] + rng.choice(JSON_VALUES).encode() + raw[at.end() :]


def _packed_mat(raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    """A file of one packed element, or packed so."""
    kind, length = struct.unpack("<II", raw[128:136])
    element = zlib.decompress(raw[136 : 136 + length]) if kind == 15 else raw[128:]
    packed = zlib.compress(any_bytes(element, rng, [other[128:] for other in others]), 1)
    return raw[:128] + struct.pack("<II", 15, len(packed)) + packed


DESCRIPTIONS = (
    "'|O'", "'<U9'", "'|S4'", "'<c16'", "'<M8[ns]'", "'<m8[s]'", "'<f2'", "'>f4'", "'<i8'", "'|b1'", "'<u8'",
    "'|V8'", "'|V0'", "'<U0'", "'<f16'", "[('t', '<f8'), ('a', '|O')]", "[('t', '<f8', (3,))]", "[]", "'x'", "3",
    "None", "[('t', [('u', '<f8')])]", "'<f8', 'x': 1",
)  # fmt: skip
SHAPES = (
    "()", "(0,)", "(1,)", "(40,)", "(-1,)", "(40, 0)", "(3, 40)", "(99999999999,)", "(2147483648, 3)", "(1, 1, 40)",
    "(4294967296, 4294967296)", "(True,)", "(1.5,)", "'40'", "40", "(10**9,)", "(" * 90 + ")" * 90,
)  # fmt: skip
NPY = {"descr": DESCRIPTIONS, "fortran_order": ("False", "True", "0"), "shape": SHAPES}


def _npy(raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    """Change the header's dictionary, keeping its length field right, or else any bytes."""
    header = re.match(rb"\x93NUMPY\x01\x00..({.*?} *\n)", raw, re.DOTALL)
    if header is None or rng.random() < 0.5:
        return any_bytes(raw, rng, others)
    key = rng.choice((*NPY, "shape"))
    changed = re.sub(
        rf"('{key}': ).*?(, '(?:fortran_order|shape)'|, }})",
        lambda found: found[1] + rng.choice(NPY[key]) + found[2], header[1].decode("latin-1").rstrip(), count=1,
    ).encode("latin-1", "replace")  # fmt: skip
    changed += b" " * (-(len(changed) + 11) % 64) + b"\n"
    return raw[:8] + struct.pack("<H", len(changed) % 65536) + changed + raw[header.end() :]


MEMBERS = ("u.npy", "../u.npy", "/u", "x" * 300, "a/b.npy", "é.npy", "v.txt")


def _member(strategy: Strategy, raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    """A change to a file within a zip file, or to its name."""
    with zipfile.ZipFile(io.BytesIO(raw)) as packed:
        members = {name: packed.read(name) for name in packed.namelist()}
    at = rng.choice([*members])
    changed = strategy(members.pop(at), rng, [*members.values(), others[0]])
    members[rng.choice(MEMBERS) if rng.random() < 0.2 else at] = changed
    return archive(members.items(), rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)))


def _not_padding(raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    """Most of a small file is padding: change what is there."""
    for _ in range(4):
        changed = any_bytes(raw, rng, others)
        at = next((i for i in range(0, len(raw), 64) if raw[i : i + 64] != changed[i : i + 64]), 0)
        if len(changed) != len(raw) or any(raw[max(0, at - 64) : at + 128]):
            break
    return changed


def _footer(raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    """That of Parquet, with its length put right."""
    length = int.from_bytes(raw[-8:-4], "little")
    footer = any_bytes(raw[-8 - length : -8], rng, [other[-900:-8] for other in others])
    return raw[: -8 - length] + footer + struct.pack("<I", len(footer)) + b"PAR1"


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


def _project(raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    lines, kind = raw.split(b"\n"), rng.randrange(10)
    at, to = sorted((rng.randrange(len(lines)), rng.randrange(len(lines))))
    key, equals, value = lines[at].partition(b" = ")
    if kind < 4 and equals:
        old = value.split()[2] if value.startswith(b"{ ") and len(value.split()) > 3 and rng.random() < 0.6 else value
        new = rng.choice(VALUES).encode()
        value = value.replace(old.rstrip(b","), new) if rng.random() < 0.9 else value + b" " + new
        lines[at] = key + equals + value
    elif kind == 4 and equals:
        keys = [line.partition(b" = ")[0] for line in b"\n".join(others).split(b"\n") if b" = " in line]
        lines[at] = rng.choice((key + b"e", key[1:], key[::-1], rng.choice(keys))) + equals + value
    elif kind == 5:
        lines.insert(at, rng.choice(LINES).encode() if rng.random() < 0.6 else rng.choice(lines))
    elif kind == 6:
        del lines[at]
    elif kind == 7:
        lines = lines + lines[at:to] if rng.random() < 0.5 else lines[:at] + lines[to:]
    else:
        return any_bytes(raw, rng, others)
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


class _Written:
    """A project of keys that there are: of the lines of ``search.toml.in`` some, of their values a few at an edge.

    A line stands with the chance before its bar; what is in ``<what of what>`` is written by the method ``what``.
    """

    def __init__(self, rng: random.Random) -> None:
        self.rng, self.edgy, self.parts = rng, rng.choice((0.02, 0.1, 0.3)), 0

    def text(self, template: str) -> str:
        """The project."""
        lines = {name: text.splitlines() for name, _, text in (p.partition("\n") for p in template.split("--- ")[1:])}
        names = ["model", *["recording"] * self.rng.choice((1, 1, 1, 2)), "fit"]
        return "\n".join(self._line(*re.fullmatch(r"(?:([\d.]+)\| )?(.*)", line).groups("1"))
                         for name in names for line in lines[name])  # fmt: skip

    def _line(self, chance: str, line: str) -> str:
        while (found := re.search(r"<(\w+) ([^<>]*)>", line)) is not None:  # the innermost first
            line = line[: found.start()] + getattr(self, found[1])(*found[2].split()) + line[found.end() :]
        return self.perhaps(chance, line)

    def perhaps(self, chance: str, *words: str) -> str:
        return " ".join(words) if self.rng.random() < float(chance) else ""

    def one(self, *of: str) -> str:
        return self.rng.choice(of)

    def number(self, *usual: str) -> str:
        return self.rng.choice(EDGES if self.rng.random() < self.edgy else usual)

    def whole(self, *usual: str) -> str:
        return self.rng.choice(WHOLE if self.rng.random() < self.edgy else usual)

    def value(self, centre: str, width: str, tie: str = "") -> str:
        """One that is free, tied, or fixed."""
        kind, middle, half = self.rng.random(), float(centre), float(width)
        if kind >= 0.7:
            return f'"{tie}"' if kind < 0.8 and tie else self.number(centre)
        ends = [float(self.number(repr(x))) for x in (middle - half, middle, middle + half)]
        low, start, high = sorted(ends) if self.rng.random() < 0.9 else ends
        scale = self.perhaps("0.2", f", scale = {self.number('1e-3', '1.0')}")
        prior = self.perhaps("0.2", f", prior = {{ mean = {start!r}, sd = {self.number('1e-3', '0.1')} }}")
        return f"{{ start = {start!r}, lower = {low!r}, upper = {high!r}{scale}{prior} }}"

    def constants(self) -> str:
        """Some of the rig's."""
        some = self.rng.sample(CONSTANTS, self.rng.choice((0, 0, 1, 2, 3)))
        ranges = {name: ("0.0", "0.5") if "rest" in name else ("1e-3", "0.99e-3") for name in some}
        return "\n".join(f"{n} = {self.value(*of, self.rng.choice(CONSTANTS))}" for n, of in ranges.items())

    def channel(self) -> str:
        """How a signal is read."""
        counts = f'unit = "counts", counts_per_turn = {self.whole("4096")}'
        words = {
            "0.3": f"scale = {self.number('0.99', '2.0')}",
            "0.30": f"zero = {self.number('0.1', '3.14159')}",
            "0.2": "sign = -1",
            "0.20": "unwrap = true",
            ".3": self.one('unit = "deg"', 'unit = "rad"', counts),
        }
        return "".join(self.perhaps(chance, f", {word}") for chance, word in words.items())  # fmt: skip

    def sensor(self) -> str:
        """What may stand between a channel and the model."""
        usual = {
            "delay": ("0.01", "0.009"),
            "gain": ("1.0", "0.5"),
            "bias": ("0.0", "0.1"),
            "lowpass": ("0.02", "0.01"),
        }
        return "".join(self.perhaps("0.07", f", {name} = {self.value(*of)}") for name, of in usual.items())

    def part(self) -> str:
        """Which recording it is."""
        self.parts += 1
        return f"{self.parts}"

    def validated(self) -> str:
        """The second may be no part of the fit."""
        return self.perhaps("0.3" if self.parts > 1 else "0", 'use = "validate"')


def _search(rng: random.Random) -> bytes:
    template = Path(__file__).with_name("search.toml.in").read_text(encoding="utf-8")
    return _Written(rng).text(template).encode()


# --- the table ------------------------------------------------------------------------------------------

PACKAGED = ("xlsx", "tdms", "mdf", "mcap", "db3")
"""Formats that a package reads."""
ANY = (any_bytes,)
READERS: dict[str, tuple[tuple[str, ...], tuple[Strategy, ...]]] = {
    "text": ((".csv", ".tsv", ".txt", ".dat", ".lvm", ".asc", ".prn"), (_text,)),
    "mat": ((".mat",), (any_bytes, _packed_mat)),
    "npy": ((".npy",), (_npy,)),
    "npz": ((".npz",), (any_bytes, partial(_member, _npy))),
    "hdf5": ((".h5", ".hdf5"), (_not_padding,)),
    "parquet": ((".parquet",), (any_bytes, _footer)),
    "json": ((".json", ".jsonl"), (any_bytes, _json)),
    "xlsx": ((".xlsx",), (any_bytes, partial(_member, any_bytes))),
    "tdms": ((".tdms",), ANY),
    "mdf": ((".mf4", ".mdf"), ANY),
    "mcap": ((".mcap",), ANY),
    "db3": ((".db3",), ANY),
    "project": ((".toml",), (_project,)),
    "search": ((".toml",), ()),
}
"""Reader to endings, and strategies of which one bends an input."""


@cache
def _seeds(reader: str) -> list[bytes]:
    return SEEDS[reader]()


def input_of(reader: str, number: int) -> tuple[str, bytes]:
    """Return ending and bytes of one input; the first numbers are the seeds themselves."""
    endings, strategies = READERS[reader]
    rng, seeds = random.Random(f"{reader} {number}"), [] if reader == "search" else _seeds(reader)
    if number < len(seeds):
        raw = seeds[number]
    elif not seeds:
        raw = _search(rng)
    else:
        raw, strategy = rng.choice(seeds), rng.choice(strategies)
        for _ in times(rng):
            raw = strategy(raw, rng, seeds)
    return ".mat" if raw.startswith(b"MATLAB 7.3") else endings[number % len(endings)], raw
