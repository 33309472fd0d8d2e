"""A lock on a run folder: one thread of one process writes into it at a time.

The operating system holds the lock on the file ``.lock`` for as long as it is open, so a process that is killed
releases it; the file names the process and machine for the message of the next.  A process that is forked off has none
of it.  (``filelock``, a library for this, holds as much; it opens the file itself and not by the door, so it stays out:
15,700 lines for forty of these.)
A folder with links in it is refused (:func:`refuse_links`), since writing there could overwrite a file elsewhere.
"""

from __future__ import annotations

import errno
import json
import os
import socket
import sys
import time
from contextlib import AbstractContextManager, suppress
from io import RawIOBase
from itertools import islice
from pathlib import Path
from typing import Any

from fracid.errors import InputError, writing
from fracid.safety.door import appended
from fracid.safety.json_files import object_of
from fracid.safety.text import shortened
from fracid.tasks import SAYS

Json = Any
"""A plain JSON value: dict with names for keys, list, str, float, int, bool, None."""


# --- one process a folder ---------------------------------------------------------------------------


LOCK = ".lock"


class FolderLock(AbstractContextManager["FolderLock"]):
    """A folder for one thread alone, until its block's or the process's end, however it ends.

    Raises
    ------
    InputError
        If another has it (the message says which), or the folder cannot be written, or holds a link.

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
        if self.path in _HELD:
            raise InputError(f"This process is at work in {folder} already. Wait for its end, or give another folder.")
        _HELD[self.path] = self._file = _locked(self.path)

    def __exit__(self, *_: object) -> None:
        """Let go of it; in a process that was forked off since there is nothing to let go of."""
        if _HELD.get(self.path) is self._file:
            del _HELD[self.path]
            self._file.truncate(0)
            self._file.close()


def held_folders() -> list[Path]:
    """The folders that this process is at work in, the first taken first.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp()).resolve()
    >>> with FolderLock(folder):
    ...     folder in held_folders()
    True
    """
    return [path.parent for path in _HELD]


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
    left, count = [os.fspath(folder)], 0
    while left:
        entries = _entries(left.pop())
        count += len(entries)
        if count > MOST_ENTRIES:
            raise InputError(f"{folder} holds more than {MOST_ENTRIES} files, which no run does; give another folder.")
        for entry in entries:
            if entry.is_symlink():
                raise InputError(SAYS("link", path=entry.path))
            if entry.is_dir(follow_symlinks=False):
                left.append(entry.path)
            elif not entry.is_file(follow_symlinks=False):
                raise InputError(SAYS("no-plain-file", path=entry.path))


def _entries(place: str) -> list[os.DirEntry[str]]:
    """What lies in a folder, sorted, and no more than a run has; nothing where there is none."""
    try:
        with os.scandir(place) as entries:
            return sorted(islice(entries, MOST_ENTRIES + 1), key=lambda entry: entry.name)
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:  # no right, or a path that is too long
        raise InputError(SAYS("no-look", folder=shortened(place), why=error.strerror)) from None


MOST_ENTRIES = 100_000
"""Files and folders in a run folder: of each recording there are three figures in two formats."""

WITHOUT_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.EINVAL}
"""What a file system without locks answers."""

_HELD: dict[Path, RawIOBase] = {}
"""The locks of this process: their files."""


def _forget() -> None:
    """In a process that was forked off: the locks are its parent's, which has them for as long as any has the file."""
    for file in _HELD.values():
        file.close()
    _HELD.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


def _locked(path: Path) -> RawIOBase:
    with writing(f"The folder {path.parent}"):
        file = appended(path)
    if not _lock(file):
        file.seek(0)
        who = {"pid": "?", "host": "?"} | ((object_of(file.read()) or {}) if sys.platform != "win32" else {})
        file.close()
        since = f", since {who['since']}" if "since" in who else ""
        raise InputError(SAYS("at-work", folder=path.parent, who=who, since=since))
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
