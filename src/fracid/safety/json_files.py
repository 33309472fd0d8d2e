"""JSON of a run folder, read as if a stranger had sent it or a dying disc had kept it: the limits before its schema.

::

    bytes, not too many, of a plain file  ──  text  ──  JSON without NaN, infinity, depth  ──  of its schema  ──  used

The schemas, and what of a value is not of one, are in :mod:`fracid.safety.schema`.
"""

from __future__ import annotations

import json
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import Any

__all__ = ["LONGEST", "MOST", "REACH", "excess_of", "json_of", "place", "short_text", "shown", "text_of"]

MOST = 1 << 26
"""Bytes of a JSON file: of what fracid writes, a study of 10⁵ repetitions comes near."""

LONGEST = 1 << 24
"""Bytes of a line of a log."""

REACH = 1e100
"""Sizes of numbers below this: their squares are finite."""

WHOLE_REACH = 1 << 63
"""The same of whole ones."""

DEEPEST = 32
"""JSON in JSON; a result has seven."""

TEXT = 100_000
"""Characters of a text."""

LONGEST_NAME = 500
"""Characters of a name: a start value's has that of its recording."""


def text_of(path: Path, most: int = MOST) -> str:
    """Read a text file that cannot hang, and is not larger than one of its kind can be.

    Raises
    ------
    OSError
        If it is not there, no plain file or cannot be read.
    ValueError
        If it is too large, or no UTF-8.

    Examples
    --------
    >>> text_of(Path(__file__)).startswith('\"\"\"JSON of a run folder')
    True
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(f"{path} is no plain file")
    with path.open("rb") as file:
        raw = file.read(most + 1)
    if len(raw) > most:
        raise ValueError(f"{path} has more than {most} bytes")
    return raw.decode("utf-8")


def json_of(text: str | bytes) -> Any:
    """JSON's value, if it has nothing that fracid does not write.

    Raises
    ------
    ValueError
        For what is no JSON, NaN and infinity, numbers of thousands of digits, and lists in lists in lists.

    Examples
    --------
    >>> json_of('{"mu": 0.9}')
    {'mu': 0.9}
    >>> json_of("[NaN]")
    Traceback (most recent call last):
    ValueError: NaN is no number
    """
    try:
        value = json.loads(text, parse_constant=_no_number)
    except RecursionError:
        raise ValueError("it lies too deep in itself") from None
    level, depth = [value], 0
    while level:
        if (depth := depth + 1) > DEEPEST:
            raise ValueError("it lies too deep in itself")
        level = [inner for outer in level for _, inner in _pairs(outer)]
    return value


def _no_number(word: str) -> Any:
    raise ValueError(f"{word} is no number")


def _pairs(value: Any) -> Iterable[tuple[str | int, Any]]:
    """What lies in a value of JSON, each with its name or its number."""
    if isinstance(value, dict):
        return value.items()
    return enumerate(value) if isinstance(value, list) else ()


def excess_of(value: Any) -> str:
    """Where a value of JSON is larger than anything that fracid writes, in words; empty where it is not.

    Examples
    --------
    >>> excess_of({"mu": {"interval95": [0.9, 1e300]}})
    'mu.interval95.1 is 1e+300; expected a number below 1e+100 in size'
    >>> excess_of({"mu": 0.9})
    ''
    """
    fault = _excess(value)
    return "" if fault is None else f"{place(fault[0])} {fault[1]}"


def _excess(value: Any) -> tuple[tuple[str | int, ...], str] | None:
    """The first place and what is wrong there; the places above are put before it on the way back."""
    excess = ""
    if isinstance(value, str):
        excess = f"expected a text of {TEXT} characters at most" if len(value) > TEXT else ""
    elif isinstance(value, float):
        excess = "" if abs(value) < REACH else f"expected a number below {REACH:g} in size"
    elif isinstance(value, int):
        excess = "" if abs(value) < WHOLE_REACH else "expected a number of fewer digits"
    elif isinstance(value, dict) and any(len(name) > LONGEST_NAME for name in value):
        return (), f"has a name of more than {LONGEST_NAME} characters"
    for key, inner in _pairs(value):
        if fault := _excess(inner):
            return (key, *fault[0]), fault[1]
    return ((), f"is {shown(value)}; {excess}") if excess else None


def place(path: tuple[str | int, ...]) -> str:
    """Where something stands, in words: ``orders.mu.value``, or ``it`` for the whole.

    Examples
    --------
    >>> place(("orders", "mu", "value")), place(())
    ('orders.mu.value', 'it')
    """
    names = (str(key) for key in path)
    return ".".join(name if len(name) <= 60 else f"{name[:40]}..." for name in names) or "it"


def shown(value: Any) -> str:
    """A value of JSON on a line that can be printed, and not long.

    Examples
    --------
    >>> shown("mu"), shown([1]), shown(None), shown(True)
    ("'mu'", 'a list', 'null', 'true')
    """
    if isinstance(value, dict | list):
        return "names with values" if isinstance(value, dict) else "a list"
    if value is None or isinstance(value, bool):
        return json.dumps(value)
    return f"'{short_text(value)}'" if isinstance(value, str) else short_text(value)


def short_text(value: object) -> str:
    """On a line that can be printed, and not long."""
    text = str(value)
    return repr(text if len(text) <= 60 else f"{text[:40]}...")[1:-1]
