"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import threading
from pathlib import Path

__all__ = ["write_text", "write_whole"]


def write_text(path: Path, text: str) -> None:
    """Write a text whole or not at all; see :func:`write_whole`.

    Raises
    ------
    OSError
        If it cannot be written; an earlier file of that name then stays as it was.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_text(folder / "note.txt", "done")
    >>> [path.name for path in folder.iterdir()]
    ['note.txt']
    """
    write_whole(path, text.encode())


def write_whole(path: Path, content: bytes) -> None:
    """Write to a neighbour first, then rename: the file is the old one or the new one, never a part.

    Raises
    ------
    OSError
        If it cannot be written; an earlier file of that name then stays as it was.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "two.bin"
    >>> write_whole(file, b"12")
    >>> file.read_bytes()
    b'12'
    """
    neighbour = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}")
    try:
        neighbour.write_bytes(content)
        with neighbour.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(neighbour, path)
    finally:
        neighbour.unlink(missing_ok=True)
