"""What stands in a file of a run folder, read as if a stranger had sent it or a dying disc had kept it.

::

    bytes, not too many, of a plain file  ──  text  ──  JSON without NaN, infinity, depth  ──  of its shape  ──  used

A shape is written as what it describes:

=====================  =========================================================================================
``float``              a number, below 10¹⁰⁰ in size; ``int`` a whole one; ``bool``; ``str`` of 10⁵ characters at most
``None``               null
``(float, None)``      one of these
``[float]``            a list of such; ``Pair(float)`` of two
``Word("a|b")``        one of these words
``{"a": …, "b?": …}``  what has these keys, ``b`` or not, and perhaps more
``Names(float)``       whatever names, each with such a value
=====================  =========================================================================================

So whoever uses a file that passed need not ask again, and who does not pass is told where: ``orders.mu.value``.
"""

from __future__ import annotations

import json
import re
import stat
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from math import isfinite
from pathlib import Path
from typing import Any

from fracid.errors import InputError

__all__ = [
    "EVALUATION",
    "LONGEST",
    "MOST",
    "Names",
    "Pair",
    "Shape",
    "Word",
    "fault_of",
    "json_of",
    "lines_of",
    "must_be",
    "read_as",
    "short_text",
    "text_of",
]

Shape = Any
"""See the module's table."""

MOST = 1 << 26
"""Bytes of a JSON file: of what fracid writes, a study of 10⁵ repetitions comes near."""

LONGEST = 1 << 24
"""Bytes of a line of a log."""

REACH = 1e100
"""Sizes of numbers below this: their squares are finite."""

DEEPEST = 32
"""JSON in JSON; a result has seven."""

TEXT = 100_000
"""Characters of a text."""

LONGEST_NAME = 500
"""Characters of a name: a start value's has that of its recording."""


@dataclass(frozen=True)
class Names:
    """Any names, each with such a value."""

    of: Shape


@dataclass(frozen=True)
class Pair:
    """A list of two, or of as many as are said."""

    of: Shape
    count: int = 2


@dataclass(frozen=True)
class Word:
    """One of some words, by a regular expression."""

    pattern: str


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
    >>> text_of(Path(__file__)).startswith('\"\"\"What stands')
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
        found = json.loads(text, parse_constant=_no_number)
    except RecursionError:
        raise ValueError("it lies too deep in itself") from None
    level, depth = [found], 0
    while level:
        if (depth := depth + 1) > DEEPEST:
            raise ValueError("it lies too deep in itself")
        level = [*chain.from_iterable(_inner(value) for value in level)]
    return found


def _no_number(word: str) -> Any:
    raise ValueError(f"{word} is no number")


def _inner(value: Any) -> Iterator[Any]:
    if isinstance(value, dict):
        yield from value.values()
    elif isinstance(value, list):
        yield from value


def read_as(path: Path, shape: Shape, wrote: str, between: Callable[[Any], str] = lambda _: "") -> Any:
    """Read a JSON file of a run folder.

    Parameters
    ----------
    path : Path
    shape : shape
        What it must look like.
    wrote : str
        The command that writes it again.
    between : function (value) -> str, optional
        What does not fit together in it, in words; empty where all does.

    Raises
    ------
    OSError
        If it is not there, or cannot be read.
    InputError
        If it does not look so; says where.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "noise.json"
    >>> _ = file.write_text('{"seeds": "many"}')
    >>> read_as(file, {"seeds": int}, "fracid noise RUN")
    Traceback (most recent call last):
    fracid.errors.InputError: ...noise.json is damaged: seeds is 'many'; expected a whole number. Write it again: fracid
    noise RUN.
    """
    found, fault = None, ""
    try:
        found = json_of(text_of(path))
    except ValueError as error:
        fault = f"it cannot be read as JSON ({short_text(error)})"
    if fault := fault or fault_of(found, shape) or between(found):
        raise InputError(f"{path} is damaged: {fault}. Write it again: {wrote}.")
    return found


def must_be(value: Any, shape: Shape, path: Path, wrote: str) -> Any:
    """Give what was read of a file back, if it is of that shape.

    Raises
    ------
    InputError
        If it is not; says where.

    Examples
    --------
    >>> must_be({"seeds": 3}, {"seeds": int}, Path("noise.json"), "fracid noise")
    {'seeds': 3}
    """
    if fault := fault_of(value, shape):
        raise InputError(f"{path} is damaged: {fault}. Write it again: {wrote}.")
    return value


def short_text(value: object) -> str:
    """On a line that can be printed, and not long."""
    text = str(value)
    return repr(text if len(text) <= 60 else f"{text[:40]}...")[1:-1]


def lines_of(path: Path, shape: Shape) -> Iterator[Any]:
    """The lines of a log that are as they should be; none where there is no log, or one that cannot be read.

    Examples
    --------
    >>> list(lines_of(Path("/nowhere/evaluations.jsonl"), dict))
    []
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            return
        with path.open("rb") as file:
            while line := file.readline(LONGEST):
                try:
                    found = json_of(line)
                except ValueError:
                    continue
                if not fault_of(found, shape):
                    yield found
    except OSError:
        return


# --- shapes ------------------------------------------------------------------------------------------


def fault_of(value: Any, shape: Shape, where: str = "") -> str:
    """Where a value is not of a shape, in words; empty where it is.

    Examples
    --------
    >>> fault_of({"mu": {"value": [1]}}, Names({"value": (float, None)}))
    'mu.value is a list; expected a number or null'
    >>> fault_of({"mu": {}}, Names({"value": float, "unit?": str}))
    'mu has no value'
    """
    if isinstance(shape, tuple):
        faults = [fault_of(value, one, where) for one in shape]
        if not all(faults):
            return ""
        inner = [fault for one, fault in zip(shape, faults, strict=True) if _same_kind(value, one)]
        return inner[0] if inner else _unlike(value, shape, where)
    if isinstance(shape, type) or shape is None:
        return "" if _is(value, shape) else _unlike(value, shape, where)
    if isinstance(shape, Word):
        good = isinstance(value, str) and re.fullmatch(shape.pattern, value, re.ASCII)
        return "" if good else _unlike(value, shape, where)
    if not _same_kind(value, shape):
        return _unlike(value, shape, where)
    if isinstance(shape, Pair) and len(value) != shape.count:
        return f"{_named(where)} has {len(value)} entries; expected {shape.count}"
    if isinstance(shape, dict):
        return _of_keys(value, shape, where)
    inner_shape = shape[0] if isinstance(shape, list) else shape.of
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    if isinstance(value, dict) and any(len(name) > LONGEST_NAME for name in value):
        return f"{_named(where)} has a name of more than {LONGEST_NAME} characters"
    return next((fault for key, v in pairs if (fault := fault_of(v, inner_shape, _below(where, key)))), "")


def _of_keys(value: Mapping[str, Any], shape: Mapping[str, Shape], where: str) -> str:
    for key, inner in shape.items():
        name = key.removesuffix("?")
        if name in value:
            if fault := fault_of(value[name], inner, _below(where, name)):
                return fault
        elif name == key:
            return f"{_named(where)} has no {name}"
    return ""


def _is(value: Any, shape: type | None) -> bool:
    if shape is None:
        return value is None
    if shape is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and _in_reach(value)
    if shape is int:
        return isinstance(value, int) and not isinstance(value, bool) and abs(value) < 1 << 63
    if shape is str:
        return isinstance(value, str) and len(value) <= TEXT
    return isinstance(value, shape)


def _in_reach(value: float) -> bool:
    return abs(value) < REACH and isfinite(value)


def _same_kind(value: Any, shape: Shape) -> bool:
    """Whether it is a mapping, or a list, where one is expected."""
    if isinstance(shape, dict | Names):
        return isinstance(value, dict)
    return isinstance(shape, list | Pair) and isinstance(value, list)


def _below(where: str, key: object) -> str:
    name = str(key) if len(str(key)) <= 60 else f"{str(key)[:40]}..."
    return f"{where}.{name}" if where else name


def _named(where: str) -> str:
    return where or "it"


WORDS: dict[Any, str] = {float: "a number", int: "a whole number", str: "a text", bool: "true or false", None: "null",
                         dict: "names with values", list: "a list"}  # fmt: skip


def _words(shape: Shape) -> str:
    if isinstance(shape, tuple):
        return " or ".join(map(_words, shape))
    if isinstance(shape, Word):
        return shape.pattern.replace("|", " or ")
    if isinstance(shape, dict | Names):
        return WORDS[dict]
    return WORDS[list] if isinstance(shape, list | Pair) else WORDS[shape]


def _unlike(value: Any, shape: Shape, where: str) -> str:
    shown = {dict: WORDS[dict], list: WORDS[list], type(None): "null"}.get(type(value))
    if shown is None:
        shown = f"'{short_text(value)}'" if isinstance(value, str) else short_text(value)
    return f"{_named(where)} is {shown}; expected {_words(shape)}"


EVALUATION = {"point": Names(float)}
"""A line of evaluations.jsonl."""
