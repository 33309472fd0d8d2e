"""NumPy's ``.npy`` and ``.npz``; Python objects in them are never opened, for that runs code."""

from __future__ import annotations

import warnings
import zipfile
from collections import Counter
from math import prod
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from fracid.recording.readers.content import Content, LeftOut, reading, refuse_bomb, same_name, why_no_numbers
from fracid.safety.door import opened

PICKLED = LeftOut("holds Python objects, which fracid does not open: that would run code; save arrays of numbers")

HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
"""By version of the format; 3.0 is for names of fields that are not Latin."""


def read_npy(path: Path) -> Content:
    """Read an array; one with named fields gives them as columns.

    Raises
    ------
    DataError
        It is damaged, or holds objects.
    """
    with reading(path, "NumPy file"), opened(path) as file:
        return {path.stem: _array(file, path.stat().st_size)}


def read_npz(path: Path) -> Content:
    """Read the arrays of an archive.

    Raises
    ------
    DataError
        It is damaged, or would unpack to more numbers than a recording has.
    """
    with reading(path, "NumPy file"), opened(path) as file, zipfile.ZipFile(file) as archive:
        members = archive.infolist()
        refuse_bomb(path, sum(m.file_size for m in members) / 8)
        names = Counter(m.filename.removesuffix(".npy") for m in members)
        by_name = {m.filename.removesuffix(".npy"): m for m in members}
        return {n: _member(archive, m) if names[n] == 1 else same_name(names[n]) for n, m in by_name.items()}


def _member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[np.generic] | LeftOut:
    if not member.filename.endswith(".npy"):
        return LeftOut("is no array")
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        return LeftOut("is packed by a method that NumPy does not use")
    with archive.open(member) as file:
        return _array(file, member.file_size)


def _array(file: IO[bytes], size: int) -> NDArray[np.generic] | LeftOut:
    """Read one array from a file of so many bytes; no more memory is taken than these."""
    version = npy.read_magic(file)
    if version not in HEADERS:
        raise ValueError(f"its format {version[0]}.{version[1]} is not known")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of Python, which parses the header: of a damaged one, it is about escapes
        shape, fortran, dtype = HEADERS[version](file)
    if left_out := PICKLED if dtype.hasobject else why_no_numbers(dtype.kind):
        return left_out
    expected = prod(shape) * dtype.itemsize
    if any(n < 0 for n in shape) or expected > size:
        extent = "×".join(map(str, shape[:5]))
        raise ValueError(f"its array of {extent} should have {expected} bytes in a file of {size}")
    raw = file.read(expected)
    if len(raw) != expected:
        raise ValueError(f"its array should have {expected} bytes, and {len(raw)} are there")
    if not dtype.itemsize:
        return LeftOut("holds nothing")
    return np.frombuffer(raw, dtype).reshape(shape, order="F" if fortran else "C")
