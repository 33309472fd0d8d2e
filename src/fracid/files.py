"""Files that are written whole or not at all, and the numbers in them."""

from __future__ import annotations

import math
import os
import threading
from pathlib import Path
from typing import TypeVar

__all__ = ["from_json", "json_number", "write_text", "write_whole"]

_Value = TypeVar("_Value")


def json_number(value: float | None) -> float | None:
    """A number as JSON has it, which knows neither NaN nor infinity: null in their place.

    Examples
    --------
    >>> json_number(0.5), json_number(float("inf")), json_number(None)
    (0.5, None, None)
    """
    return float(value) if value is not None and math.isfinite(value) else None


def from_json(value: _Value | None, otherwise: _Value) -> _Value:
    """A value of JSON, where null stands for what JSON cannot say.

    Examples
    --------
    >>> from_json(0.5, math.inf), from_json(None, math.inf)
    (0.5, inf)
    """
    return otherwise if value is None else value


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
