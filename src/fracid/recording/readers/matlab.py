r"""MATLAB's files up to v7.2: version 4, and version 5 with or without compression.

SciPy's reader trusts what a file says of itself: of 1,400 damaged files one ended the Python process.  A recording
needs little of the format, and all of it fits here, with each length checked before it is used.

Version 5 [MAT]_ is a header of 128 bytes and elements, each a tag (type, bytes) and its data, padded to eight bytes::

    miCOMPRESSED  zlib of one element
    miMATRIX      flags (class, complex)   dimensions   name   data
                  numbers    one element, of any type that holds them
                  struct     length of a field name, the names, then for each struct and field a miMATRIX
                  object     name, "MCOS", class: its data lie elsewhere in the file, in a form that is not published

A tag whose upper half is not zero holds up to four bytes of data itself.  Version 4 is matrices alone: five
numbers (type, rows, columns, complex, length of the name), the name, the data.

References
----------
.. [MAT] The MathWorks, MAT-File Format (2023), chapter 1.
"""

from __future__ import annotations

import math
import struct
import tomllib
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracid.recording.readers.content import (
    COMPLEX,
    DEEPEST,
    EMPTY,
    SPARSE,
    TEXT,
    Content,
    LeftOut,
    damaged,
    most_numbers,
    refuse_bomb,
)
from fracid.safety.door import opened, own_text

NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Version 5's types of data that hold numbers."""

MATRIX, COMPRESSED = 14, 15

CELL, STRUCT, OLD_OBJECT, CHAR, SPARSE_CLASS, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17

NUMERIC = range(6, 16)
"""Classes of an array."""

IS_COMPLEX = 0x0800

OLD_NUMBERS = ("f8", "f4", "i4", "i2", "u2", "u1")
"""Version 4's."""

MATLAB_OBJECT: dict[str, str] = tomllib.loads(own_text("recording/readers/matlab.toml"))
"""What to do with objects, by their class."""


def is_hdf5(path: Path) -> bool:
    """Tell whether a .mat file is of version 7.3."""
    with opened(path) as file:
        start = file.read(520)
    return b"MATLAB 7.3" in start[:128] or b"\x89HDF\r\n\x1a\n" in (start[:8], start[512:])


def object_left_out(kind: str) -> LeftOut:
    """Say what to do with a MATLAB object of a class."""
    return LeftOut(MATLAB_OBJECT.get(kind, f"is a MATLAB object of class {kind[:40]!r}; save its numbers as arrays"))


_Variable = NDArray[np.generic] | LeftOut | Content | list[Content]
"""What a name has."""

_Parts = Iterator[tuple[int, memoryview]]
"""Type and data of one element after the other."""

NOTHING = 0, memoryview(b"")
"""In place of an element that is not there."""


class _Damaged(Exception):
    """A length or a type that cannot be."""


def read_mat(path: Path) -> Content:
    """Read the variables of a file.

    Raises
    ------
    DataError
        It is damaged, no MATLAB file, or would unpack to more numbers than a recording has.
    """
    try:
        with opened(path) as file:
            head = file.read(128)
            is_new = head[126:] in (b"IM", b"MI") and 0 not in head[:4]
            if head and not is_new:
                _old_header(head, 0)  # before gigabytes of anything are read
            raw = head + file.read()
        return dict(_version5(raw, path) if is_new else _version4(raw))
    except _Damaged as error:
        raise damaged(path, "MATLAB file", error) from None
    except zlib.error as error:
        raise damaged(path, "MATLAB file", f"what is packed in it is broken: {error}") from None


# --- version 5 ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Reader:
    """Where in which bytes, with what byte order."""

    raw: memoryview
    order: str
    """``<`` or ``>``."""
    path: Path
    depth: int = 0
    """Structs within which it lies."""

    def elements(self, start: int) -> _Parts:
        """Return type and data of one element after the other."""
        while start < len(self.raw):
            if start + 8 > len(self.raw):
                if any(self.raw[start:]):
                    raise _Damaged("it ends in the middle of a tag")
                return
            first, size = struct.unpack_from(self.order + "II", self.raw, start)
            if small := first >> 16:
                kind, size, at, after = first & 0xFFFF, small, start + 4, start + 8
                if size > 4:
                    raise _Damaged(f"a small element of {size} bytes")
            else:
                kind, at = first, start + 8
                after = at + size + (-size % 8 if kind != COMPRESSED else 0)
            if at + size > len(self.raw):
                raise _Damaged(f"an element should have {size} bytes where {len(self.raw) - at} are left")
            yield kind, self.raw[at : at + size]
            start = after


def _version5(raw: bytes, path: Path) -> Iterator[tuple[str, _Variable]]:
    reader = _Reader(memoryview(raw), "<" if raw[126:128] == b"IM" else ">", path)
    room = 8 * most_numbers(len(raw))  # bytes that may be unpacked
    for kind, data in reader.elements(128):
        if kind == COMPRESSED:
            data, room = _unpacked(replace(reader, raw=data), room)
        elif kind != MATRIX:
            raise _Damaged(f"an element of type {kind} where a variable should be")
        name, value = _matrix(replace(reader, raw=data))
        if name:  # one without a name is the storehouse of MATLAB's objects
            yield name, value


def _unpacked(packed: _Reader, room: int) -> tuple[memoryview, int]:
    """Return the data of the one element that is packed, and how many bytes are left."""
    stream = zlib.decompressobj()
    unpacked = stream.decompress(packed.raw, room + 1)
    refuse_bomb(packed.path, math.inf if len(unpacked) > room else 0)
    if not stream.eof:
        raise _Damaged("what is packed in it has no end")
    kind, data = next(replace(packed, raw=memoryview(unpacked)).elements(0), NOTHING)
    if kind != MATRIX:
        raise _Damaged("no variable is packed where one should be")
    return data, room - len(unpacked)


def _matrix(reader: _Reader) -> tuple[str, _Variable]:
    """Return name and value of a variable or field."""
    if not len(reader.raw):
        return "", EMPTY
    if reader.depth > DEEPEST:
        return "", LeftOut(f"lies more than {DEEPEST} structs deep")
    parts = reader.elements(0)
    flags = _whole(parts, reader, "flags")
    if flags.size < 1:
        raise _Damaged("a variable without flags")
    kind, is_complex = int(flags[0]) & 0xFF, bool(int(flags[0]) & IS_COMPLEX)
    if kind == OPAQUE:
        name, _, of_class = (_text(parts) for _ in range(3))
        return name, object_left_out(of_class)
    shape = tuple(int(n) for n in _whole(parts, reader, "dimensions"))
    if len(shape) < 2 or len(shape) > 32 or min(shape) < 0:
        raise _Damaged(f"a variable of dimensions {shape[:5]}")
    return _text(parts), _value(reader, parts, kind, is_complex, shape)


def _value(reader: _Reader, parts: _Parts, kind: int, is_complex: bool, shape: tuple[int, ...]) -> _Variable:
    if kind == STRUCT:
        return _structs(reader, parts, math.prod(shape))
    if kind == CHAR:
        return LeftOut(TEXT.why, _letters(reader, parts))
    others = {
        CELL: LeftOut("is a cell array; save its numbers as arrays"),
        SPARSE_CLASS: SPARSE,
        FUNCTION: LeftOut("is a function handle"),
        OLD_OBJECT: object_left_out("an older kind"),
    }
    if kind in others:
        return others[kind]
    if kind not in NUMERIC:
        raise _Damaged(f"a variable of class {kind}")
    if is_complex:
        return COMPLEX
    values = _some(parts, reader, "numbers")
    if values.size != math.prod(shape):
        raise _Damaged(f"a variable of {'×'.join(map(str, shape[:5]))} has {values.size} numbers")
    return np.squeeze(values.reshape(shape, order="F"))


def _structs(reader: _Reader, parts: _Parts, count: int) -> Content | list[Content] | LeftOut:
    """Return one struct as its fields, several as a list."""
    length = _whole(parts, reader, "the length of field names")
    _, names = next(parts, NOTHING)
    size = int(length[0]) if length.size else 0
    if size <= 0 or len(names) % size:
        raise _Damaged(f"field names of {size} letters in {len(names)} bytes")
    fields = [_until_zero(names[k : k + size]) for k in range(0, len(names), size)]
    structs: list[Content] = []
    for _ in range(count if fields else 0):
        record = {}
        for field in fields:
            kind, data = next(parts, NOTHING)
            if kind != MATRIX:
                raise _Damaged(f"the field {field[:40]!r} is missing")
            record[field] = _matrix(replace(reader, raw=data, depth=reader.depth + 1))[1]
        structs.append(record)
    return EMPTY if not structs else structs[0] if len(structs) == 1 else structs


def _letters(reader: _Reader, parts: _Parts) -> str:
    """Return the start of a text, such as the label of a signal."""
    kind, data = next(parts, NOTHING)
    encoding = {4: "utf-16", 16: "utf-8", 17: "utf-16"}.get(kind, "latin-1")
    ordered = encoding + ("-le" if reader.order == "<" else "-be") * (encoding == "utf-16")
    return bytes(data[:200]).decode(ordered, "replace")


def _whole(parts: _Parts, reader: _Reader, what: str) -> NDArray[np.generic]:
    """Return the whole numbers of the next element."""
    values = _some(parts, reader, what)
    if values.dtype.kind not in "iu":
        raise _Damaged(f"{what} that are no whole numbers")
    return values


def _some(parts: _Parts, reader: _Reader, what: str) -> NDArray[np.generic]:
    """Return the numbers of the next element."""
    kind, data = next(parts, NOTHING)
    if kind not in NUMBERS:
        raise _Damaged(f"{what} of type {kind}")
    dtype = np.dtype(reader.order + NUMBERS[kind])
    if len(data) % dtype.itemsize:
        raise _Damaged(f"{what} of {len(data)} bytes")
    return np.frombuffer(data, dtype)


def _text(parts: _Parts) -> str:
    return _until_zero(next(parts, NOTHING)[1])


def _until_zero(raw: memoryview) -> str:
    return bytes(raw).split(b"\0")[0].decode("latin-1")


# --- version 4 ------------------------------------------------------------------------------------------


def _version4(raw: bytes) -> Iterator[tuple[str, _Variable]]:
    at = 0
    while at < len(raw):
        dtype, full, rows, columns, is_complex, length = _old_header(raw, at)
        start = at + 20 + length
        end = start + rows * columns * dtype.itemsize * (1 + is_complex)
        if end > len(raw):
            left = max(0, len(raw) - start)
            raise _Damaged(f"a matrix of {rows}×{columns} should have {end - start} bytes, {left} are left")
        name = _until_zero(memoryview(raw)[at + 20 : start])
        if full or is_complex:
            yield name, COMPLEX if is_complex and not full else TEXT if full == 1 else SPARSE
        else:
            values = np.frombuffer(raw, dtype, rows * columns, start)
            yield name, np.squeeze(values.reshape((rows, columns), order="F"))
        at = end


def _old_header(raw: bytes, at: int) -> tuple[np.dtype[Any], int, int, int, int, int]:
    """Return what kind of number a matrix has, of what kind it is, its rows and columns, and the length of its name."""
    if at + 20 > len(raw):
        raise _Damaged("it ends in the middle of a header")
    for order in "<>":
        kind, rows, columns, is_complex, length = struct.unpack_from(order + "5i", raw, at)
        if 0 <= kind < 5000:
            break
    # type M0PT: M is the byte order, 0 or 1 for IEEE; P the kind of number; T full, text or sparse
    machine, number, full = kind // 1000, kind // 10 % 10, kind % 10
    if machine != "<>".index(order) or kind // 100 % 10 or number >= len(OLD_NUMBERS) or full > 2:
        raise _Damaged("no MATLAB header")
    if min(rows, columns) < 0 or is_complex not in (0, 1) or not 0 < length <= 4096:
        raise _Damaged(f"a matrix of {rows}×{columns}")
    return np.dtype(order + OLD_NUMBERS[number]), full, rows, columns, is_complex, length
