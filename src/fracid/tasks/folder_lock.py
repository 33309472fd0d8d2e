"""A lock on a run folder: one process writes into it at a time.

The operating system holds the lock on the file ``.lock`` for as long as it is open, so a process that is killed
releases it; the file names the process and machine for the message of the next.  One process may take it several times.
A folder with links in it is refused (:func:`refuse_links`), since writing there could overwrite a file elsewhere.
"""

from __future__ import annotations

import errno
import json
import os
import socket
import sys
import threading
import time
from contextlib import suppress
from io import RawIOBase
from pathlib import Path
from types import TracebackType
from typing import Any

from fracid.errors import InputError
from fracid.safety.json_files import json_of

__all__ = ["FolderLock", "Json", "line_content", "refuse_links"]

Json = Any
"""A plain JSON value: dict with names for keys, list, str, float, int, bool, None."""


def line_content(text: bytes) -> dict[str, Json] | None:
    """One line; None where it is damaged."""
    try:
        content = json_of(text)
    except ValueError:
        return None
    return content if isinstance(content, dict) else None


# --- one process a folder ---------------------------------------------------------------------------


LOCK = ".lock"


class FolderLock:
    """A folder for one process alone, until :meth:`release` or the process's end, however it ends.

    The same process may take it again; it is free once each has been released.

    Raises
    ------
    InputError
        If another process has it (the message says which), or the folder cannot be written, or holds a link.

    Examples
    --------
    >>> import tempfile
    >>> with FolderLock(Path(tempfile.mkdtemp())):
    ...     pass  # nobody else writes here
    """

    def __init__(self, folder: Path) -> None:
        """Take it."""
        refuse_links(folder)
        self.path = folder.resolve() / LOCK
        with _GUARD:
            file, holders = _HELD.get(self.path, (None, 0))
            _HELD[self.path] = (file or _locked(self.path), holders + 1)

    def release(self) -> None:
        """Let go of it."""
        with _GUARD:
            file, holders = _HELD.pop(self.path)
            if holders > 1:
                _HELD[self.path] = (file, holders - 1)
            else:
                file.truncate(0)
                file.close()

    def __enter__(self) -> FolderLock:
        """Give itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Let go of it."""
        self.release()


def refuse_links(folder: Path) -> None:
    """Refuse a run folder with links in it: what is written there must not end elsewhere, over a file of the caller's.

    Pipes and devices too: who reads them waits for ever.

    Raises
    ------
    InputError
        Naming the first, in the folder or anywhere below.

    Examples
    --------
    >>> import tempfile
    >>> refuse_links(Path(tempfile.mkdtemp()))
    """
    for place, folders, files in os.walk(folder):
        for entry in (Path(place, name) for name in sorted(folders) + sorted(files)):
            if entry.is_symlink():
                raise InputError(
                    f"{entry} is a link, and what is written to a run folder stays in it: remove the link, or give "
                    "another folder."
                )
            if not (entry.is_file() or entry.is_dir()):
                raise InputError(f"{entry} is no plain file but a pipe or a device: remove it, or give another folder.")


WITHOUT_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EINVAL}
"""What a file system without locks answers."""

_GUARD = threading.Lock()

_HELD: dict[Path, tuple[RawIOBase, int]] = {}
"""This process's locks: the open file, and how many hold it."""


def _locked(path: Path) -> RawIOBase:
    try:
        file = path.open("a+b", buffering=0)
    except OSError as error:
        raise InputError(
            f"The folder {path.parent} cannot be written: {error.strerror}. Give another: --out DIR."
        ) from None
    if not _lock(file):
        file.seek(0)
        who = (line_content(file.read()) or {}) if sys.platform != "win32" else {}
        file.close()
        since = f", since {who['since']}" if "since" in who else ""
        raise InputError(
            f"Another process is at work in {path.parent}: number {who.get('pid', '?')} on {who.get('host', '?')}"
            f"{since}. Wait for its end, or give another folder: --out DIR."
        )
    file.truncate(0)
    who = {"pid": os.getpid(), "host": socket.gethostname(), "since": time.strftime("%Y-%m-%d %H:%M:%S")}
    with suppress(OSError):  # a full disk: the lock holds without the name
        file.write(json.dumps(who).encode())
    return file


def _lock(file: RawIOBase) -> bool:
    """Lock an open file, for as long as it is open; False if another process has it.

    On a file system without locks, as some of networks and containers are, nobody is kept out.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            file.seek(0)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in WITHOUT_LOCKS
    return True
