"""HDF5, and MATLAB's version 7.3, which is HDF5.

A file of HDF5 may point out of itself: links to other files, data that lie in other files.  None of them is
followed, nor is any soft link: a recording is what stands in its file.  A dataset may be declared of any size and hold
nothing, and may be packed in chunks of any size: both are looked at before anything is read.
"""

from __future__ import annotations

import zlib
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracid.errors import DataError
from fracid.recording.readers.content import (
    COMPLEX,
    DEEPEST,
    EMPTY,
    LISTS,
    SPARSE,
    TEXT,
    Content,
    LeftOut,
    Tally,
    reading,
    refuse_bomb,
    why_no_numbers,
)
from fracid.recording.readers.matlab import object_left_out

EXPANDS = 1032
"""Zeros packed by gzip, at the most."""

NUMERIC = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
"""MATLAB's classes of numbers."""


def read_hdf5(path: Path) -> Content:
    """Read the datasets of a file, groups as nested mappings.

    Raises
    ------
    DataError
        It is damaged, no HDF5 file, or would unpack to more numbers than a recording has.
    """
    import h5py

    with reading(path, "HDF5 file", (DataError, MemoryError)), h5py.File(path, "r") as file:
        return _group(file, Tally(path), ())


def _group(group: Any, tally: Tally, ancestors: tuple[int, ...]) -> Content:
    """Read a group; ``#refs#`` is where MATLAB hides its own bookkeeping."""
    return {name: _item(group, name, tally, ancestors) for name in group if not name.startswith("#")}


def _item(group: Any, name: str, tally: Tally, ancestors: tuple[int, ...]) -> NDArray[np.generic] | LeftOut | Content:
    """Read what has a name in a group, which lies within those at some addresses."""
    import h5py

    if not isinstance(group.get(name, getlink=True), h5py.HardLink):
        return LeftOut("is a link to elsewhere, which is not followed")
    item = group[name]
    address = h5py.h5o.get_info(item.id).addr
    if isinstance(item, h5py.Dataset):
        return _dataset(item, tally)
    if not isinstance(item, h5py.Group):
        return LeftOut("is a type, not data")
    if "MATLAB_sparse" in item.attrs:
        return SPARSE
    if address in ancestors or len(ancestors) >= DEEPEST:
        return LeftOut("is a group that was read before, or lies too deep")
    return _group(item, tally, (*ancestors, address))


def _dataset(dataset: Any, tally: Tally) -> NDArray[np.generic] | LeftOut:
    """Read a dataset of real numbers, or say why not."""
    kind = dataset.attrs.get("MATLAB_class", b"double")
    kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
    if "MATLAB_object_decode" in dataset.attrs or kind not in (*NUMERIC, "char", "cell", "struct"):
        return object_left_out(kind)
    if kind == "char":
        return TEXT
    if kind == "cell":
        return LeftOut("is a cell array; save its numbers as arrays")
    if dataset.shape is None or dataset.size == 0 or "MATLAB_empty" in dataset.attrs:
        return EMPTY
    if dataset.is_virtual or dataset.external:
        return LeftOut("lies in another file, which is not opened")
    plain = _plain(dataset.dtype)
    if plain is not None:
        return plain
    # as many numbers of eight bytes as what is read has bytes: whole chunks
    tally.add(dataset.dtype.itemsize / 8 * max(dataset.size, prod(dataset.chunks or (1,))))
    _refuse_packed_bomb(dataset, tally.path)
    return np.asarray(dataset[()])


def _plain(dtype: np.dtype[Any]) -> LeftOut | None:
    """Return why a type is none of real numbers, or of records of them, and None if it is."""
    import h5py

    if dtype.names:
        if set(dtype.names) in ({"real", "imag"}, {"r", "i"}):
            return COMPLEX
        numbers = all(dtype[n].kind in "fiub" for n in dtype.names)
        return None if numbers else LeftOut("is a record that holds no numbers")
    if isinstance(h5py.check_vlen_dtype(dtype), np.dtype):  # not str or bytes; NumPy's float64 also equals None
        return LISTS
    return None if dtype.kind in "fiub" else why_no_numbers(dtype.kind) or LeftOut("is no array of numbers")


def _refuse_packed_bomb(dataset: Any, path: Path) -> None:
    """A chunk packed by gzip may hold more than it should; libhdf5 would unpack it all."""
    if dataset.compression != "gzip" or EXPANDS * path.stat().st_size < 2**28:
        return
    expected = prod(dataset.chunks) * dataset.dtype.itemsize
    for k in range(dataset.id.get_num_chunks()):
        chunk = dataset.id.get_chunk_info(k)
        if EXPANDS * chunk.size >= 2**26:
            _, raw = dataset.id.read_direct_chunk(chunk.chunk_offset)
            if len(zlib.decompressobj().decompress(raw, 2 * expected + 1024)) > 2 * expected:
                refuse_bomb(path, float("inf"))
