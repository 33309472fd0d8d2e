"""The one door to the disk: what is read, and what is written, whoever made the folder that it lies in.

===================  ================================================================================================
:func:`opened`       to read: a plain file alone; a pipe, a device, a socket, which may never end, is not waited for
:func:`bytes_of`     all of it, and no more than one of its kind has
:func:`text_of`      the same, as text; :func:`text_if_any` where there may be none
:func:`own_text`     a file of fracid's own, that it was installed with
:func:`appended`     to add to its end, or to lock it: a plain file of this folder, no link that leads to another's
:func:`nowhere`      what keeps nothing
:func:`write_whole`  a new content, all of it or none; a link in its place is replaced and not followed
:func:`write_files`  several, into a folder that is made if need be
===================  ================================================================================================

No other module opens a file; ``tests/safety/test_door.py`` looks for it, and names the libraries that open theirs.
"""

from __future__ import annotations

import errno
import os
import stat
import threading
from collections.abc import Mapping
from contextlib import AbstractContextManager, suppress
from io import BufferedReader, FileIO
from pathlib import Path
from typing import TextIO

from fracid.errors import writing

MOST = 1 << 26
"""Bytes of a JSON file: of what fracid writes, a study of 10⁵ repetitions comes near."""

PIECE = 1 << 18
"""Bytes that are read at once."""

PACKAGE = Path(__file__).parents[1]

UNWAITED = getattr(os, "O_NONBLOCK", 0)
"""A pipe that nobody writes to is opened at once, and found to be one."""

UNLINKED = getattr(os, "O_NOFOLLOW", 0)


def opened(path: Path) -> BufferedReader:
    """Open a plain file to read its bytes.

    Raises
    ------
    OSError
        If it is not there, no plain file or cannot be read.

    Examples
    --------
    >>> with opened(Path(__file__)) as file:
    ...     file.read(3)
    b'\"\"\"'
    """
    return open(path, "rb", opener=_plain)


def bytes_of(path: Path, most: int = MOST) -> bytes:
    """Read a plain file that is not larger than one of its kind can be.

    Raises
    ------
    OSError
        As :func:`opened`.
    ValueError
        If it is too large.

    Examples
    --------
    >>> bytes_of(Path(__file__), most=3)
    Traceback (most recent call last):
    ValueError: ...door.py has more than 3 bytes
    """
    raw = bytearray()
    with opened(path) as file:
        while part := file.read(PIECE):  # the kernel's own files, as of /proc, are not read by megabytes
            raw += part
            if len(raw) > most:
                raise ValueError(f"{path} has more than {most} bytes")
    return bytes(raw)


def text_of(path: Path, most: int = MOST, encoding: str = "utf-8") -> str:
    """Read a plain file of text that is not larger than one of its kind can be.

    Raises
    ------
    OSError
        As :func:`opened`.
    ValueError
        If it is too large, or not in that encoding.

    Examples
    --------
    >>> text_of(Path(__file__)).startswith('\"\"\"The one door')
    True
    """
    return bytes_of(path, most).decode(encoding)


def text_if_any(path: Path, most: int = MOST, encoding: str = "utf-8") -> str | None:
    """Read a text as :func:`text_of` does; None where there is none that can be read.

    Examples
    --------
    >>> text_if_any(Path("nowhere")) is None
    True
    """
    with suppress(OSError, ValueError):
        return text_of(path, most, encoding)
    return None


def own_text(name: str) -> str:
    """Read a file that fracid was installed with.

    Examples
    --------
    >>> own_text("safety/door.py").startswith('\"\"\"The one door')
    True
    """
    return text_of(PACKAGE / name)


def appended(path: Path) -> FileIO:
    """Open a plain file to add to its end and to read it, unbuffered; it is made if it is not there.

    Raises
    ------
    OSError
        If it is a link or no plain file, or cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> with appended(Path(tempfile.mkdtemp()) / "log") as file:
    ...     file.write(b"one")
    3
    """
    return FileIO(path, "ab+", opener=lambda path, how: _plain(path, how | UNLINKED))


def _plain(path: str, how: int) -> int:
    """Open what is a plain file before and after: opening a device can already do something."""
    with suppress(FileNotFoundError):
        _refuse_unplain(os.stat(path), path)
    file = os.open(path, how | UNWAITED, 0o666)
    try:
        _refuse_unplain(os.fstat(file), path)
    except OSError:
        os.close(file)
        raise
    return file


def _refuse_unplain(status: os.stat_result, path: str) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), path)
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "it is no plain file but a pipe or a device", path)


def nowhere() -> TextIO:
    """Open what takes any text and keeps none: in place of a closed standard output, whose number a file would get.

    Examples
    --------
    >>> with nowhere() as file:
    ...     file.write("one")
    3
    """
    return open(os.devnull, "w", encoding="utf-8")


def write_files(
    folder: Path, contents: Mapping[str, str | bytes], told: AbstractContextManager[None] | None = None
) -> tuple[Path, ...]:
    """Write texts and bytes under their names, each whole or not at all, into a folder that is made if need be.

    Parameters
    ----------
    folder : Path
    contents : mapping
        Name → what is written.
    told : context manager, optional
        Says what cannot be written, the folder if left out; see :func:`fracid.errors.writing`.

    Raises
    ------
    InputError
        If the disk will not take them.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp()) / "run"
    >>> [path.name for path in write_files(folder, {"note.txt": "done"})]
    ['note.txt']
    """
    with told or writing(f"The folder {folder}"):
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in contents.items():
            write_whole(folder / name, content)
    return tuple(folder / name for name in contents)


def write_whole(path: Path, content: str | bytes) -> None:
    r"""Write to a neighbour first, then rename: the file is the old one or the new one, never a part.

    What is no text in a text, as of a file's name of any bytes, is written out: ``\udcff``.

    Raises
    ------
    OSError
        If it cannot be written; an earlier file of that name then stays as it was.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "two.bin"
    >>> write_whole(file, b"12")
    >>> bytes_of(file)
    b'12'
    """
    neighbour = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}")
    try:
        neighbour.unlink(missing_ok=True)
        with neighbour.open("xb") as file:  # new: what another put there is neither followed nor waited for
            file.write(content if isinstance(content, bytes) else content.encode(errors="backslashreplace"))
            file.flush()
            os.fsync(file.fileno())
        os.replace(neighbour, path)
    finally:
        neighbour.unlink(missing_ok=True)
