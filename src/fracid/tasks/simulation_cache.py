"""What simulations gave, kept on disk while a run is unfinished: so a run that was killed repeats none of them.

All that an identification spends its time on is simulations, and a simulation is a function of some twenty numbers
(orders, constants, initial state) and of what stays (the right-hand side, inputs, step, method).  So the
file maps a hash of these onto the simulated outputs, and a resumed run, :mod:`fracid.cli.resume`, simply
begins again: what was simulated is read instead, until it comes to where it was killed.  Every number
being the same to the bit, so is the way there, and the result.

::

    stamp  ·  key, length, check sum, array or reason  ·  key, length, check sum, …

Records are handed to the operating system as they end, so they outlive the process.  They are not forced to the disk:
after a power cut, on another machine and after a change of the program the stamp differs, and the file
begins empty.  It takes no more than :data:`MOST` bytes, and half of what the disk has left: what comes after that
stays in memory, as far as there is room for it.  It is removed when the run ends, and where the disk is full, for the
run's result matters more.
"""

from __future__ import annotations

import os
import platform
import shutil
import struct
import threading
from collections import OrderedDict
from contextlib import AbstractContextManager
from io import BytesIO
from pathlib import Path
from zlib import crc32

import numpy as np
from numpy.lib.format import MAGIC_PREFIX, header_data_from_array_1_0, read_array, write_array_header_1_0

from fracid.arrays import FloatArray
from fracid.errors import Failure, FailureReason, Unfinished
from fracid.safety.door import appended, text_of
from fracid.tasks.journal import append_whole

RECORD = struct.Struct("<16sQI")
"""Key, length, and the check sum of both with what follows: an array as NumPy writes it, or why there is none.

NumPy writes the order in memory too, on which a sum's last bits depend."""


MOST = 256 << 20
"""Bytes of a file at most."""

Place = tuple[int, int, int]
"""Offset and size [bytes], check sum."""


class Memo(AbstractContextManager["Memo"]):
    """Simulated outputs by key, in a file that only grows, up to a size.

    Parameters
    ----------
    path : Path
        Made if it is missing, emptied if its stamp is another.
    most : int
        Bytes of the file.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "memo"
    >>> with Memo(path) as memo:
    ...     memo.find(b"k" * 16) is None, memo.keep(b"k" * 16, np.array([[0.1, 0.2]]))
    (True, array([[0.1, 0.2]]))
    >>> with Memo(path) as memo:
    ...     memo.find(b"k" * 16)
    array([[0.1, 0.2]])
    """

    emptied: bool = False
    """Whether there was something that could not be used: another program's, or from before the machine's restart."""

    def __init__(self, path: Path, most: int = MOST) -> None:
        """Open it and read where everything is; what a killed process wrote in part is cut off."""
        self._path, self._lock = path, threading.Lock()
        self._most, self._overflow = min(most, shutil.disk_usage(path.parent).free // 2), Recent(most // 2)
        self._full = False
        self._file = appended(path)
        self._places, end = self._whole()
        self.emptied = end == 0 < path.stat().st_size
        self._file.truncate(end)
        self._end = end or append_whole(self._file, [_stamp()], 0)

    def _whole(self) -> tuple[dict[bytes, Place], int]:
        """Where each key's numbers are, and where the last whole record ends."""
        file, stamp, places = self._file, _stamp(), dict[bytes, Place]()
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        if file.read(len(stamp)) != stamp:
            return {}, 0
        end = len(stamp)
        while len(header := file.read(RECORD.size)) == RECORD.size:
            key, length, checked = RECORD.unpack(header)
            offset = end + RECORD.size
            if offset + length > size:
                break
            places[key] = offset, length, checked
            end = file.seek(offset + length)
        return places, end

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:
        """Close the file; nothing is read or kept any more."""
        with self._lock:
            self._places.clear()
            self._file.close()

    def remove(self) -> None:
        """Close and delete the file."""
        self.close()
        self._path.unlink(missing_ok=True)

    def find(self, key: bytes) -> FloatArray | Failure | None:
        """The outputs of this key, or why there are none; None where that is not known."""
        place = self._places.get(key)
        return self._overflow.find(key) if place is None else self._at(key, *place)

    def keep(self, key: bytes, outputs: FloatArray | Failure) -> FloatArray | Failure:
        """Keep the outputs of this key, or why there are none, and give them back."""
        if self._full:
            return self._overflow.keep(key, outputs)
        content = _content(outputs)
        size, checked = sum(map(len, content)), _sum(key, *content)
        try:
            with self._lock:
                offset = self._end + RECORD.size
                self._full = self._full or offset + size > self._most
                if not (self._file.closed or self._full):
                    self._end = append_whole(self._file, [RECORD.pack(key, size, checked), *content], self._end)
                    self._places[key] = offset, size, checked
        except Unfinished:  # no room: the run goes on without
            self.remove()
        return outputs

    def _at(self, key: bytes, offset: int, size: int, checked: int) -> FloatArray | Failure | None:
        with self._lock:
            self._file.seek(offset)
            content = self._file.read(size)
        if _sum(key, content) != checked:
            return None  # a bit has turned on the disk: it is simulated again
        if content.startswith(MAGIC_PREFIX):
            return np.asarray(read_array(BytesIO(content)))
        reason, _, detail = content.decode(errors="replace").partition(" ")
        cause = FailureReason.__members__.get(reason)
        return None if cause is None else Failure(cause, detail)  # another's file: it is simulated again


def _content(outputs: FloatArray | Failure) -> list[bytes | memoryview]:
    """In parts, whose numbers stay where they are: copies would take three times as long as the rest."""
    if isinstance(outputs, Failure):
        return [f"{outputs.reason.name} {outputs.detail}".encode()]
    header = header_data_from_array_1_0(outputs)
    write_array_header_1_0(head := BytesIO(), header)
    return [head.getvalue(), outputs.ravel("F" if header["fortran_order"] else "C").view(np.uint8).data]


def _stamp() -> bytes:
    """This program on this machine since it was started, 16 bytes."""
    from hashlib import blake2b

    package = Path(__file__).parents[1]
    paths = *package.rglob("*.py"), *package.rglob("*.toml")  # models are equations in files
    files = sorted((str(p), p.stat().st_size, p.stat().st_mtime_ns) for p in paths)
    booted = Path("/proc/sys/kernel/random/boot_id")
    since = text_of(booted) if booted.exists() else platform.node()
    return blake2b(repr((since, np.__version__, files)).encode(), digest_size=16).digest()


def _sum(key: bytes, *content: bytes | memoryview) -> int:
    checked = crc32(RECORD.pack(key, sum(map(len, content)), 0))
    for part in content:
        checked = crc32(part, checked)
    return checked


class Recent:
    """The latest simulated outputs, in memory: what one unknown of many recordings changes is simulated, the rest read.

    Parameters
    ----------
    most : int
        Bytes: what a check of the step simulates, the fit at half the step begins with.

    Examples
    --------
    >>> recent = Recent()
    >>> recent.keep(b"k", np.zeros((1, 1))) is recent.find(b"k")
    True
    """

    def __init__(self, most: int = 128 << 20) -> None:
        """Begin empty."""
        self._most, self._size, self._lock = most, 0, threading.Lock()
        self._outputs: OrderedDict[bytes, FloatArray | Failure] = OrderedDict()

    def find(self, key: bytes) -> FloatArray | Failure | None:
        """The outputs of this key, or why there are none; None where that is not known."""
        with self._lock:
            if key in self._outputs:
                self._outputs.move_to_end(key)
            return self._outputs.get(key)

    def keep(self, key: bytes, outputs: FloatArray | Failure) -> FloatArray | Failure:
        """Keep the outputs of this key, or why there are none, and give them back."""
        with self._lock:
            if key not in self._outputs:
                self._outputs[key] = outputs
                self._size += getattr(outputs, "nbytes", 0)
            while self._size > self._most:
                self._size -= getattr(self._outputs.popitem(last=False)[1], "nbytes", 0)
        return outputs
