"""JSON of a run folder, read as if a stranger had sent it or a dying disc had kept it: the limits before its schema.

::

    bytes, not too many, of a plain file  ──  text  ──  JSON without NaN, infinity, depth  ──  of its schema  ──  used

The schemas, and what of a value is not of one, are in :mod:`fracid.safety.schema`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import is_dataclass
from typing import Any, TypeVar

from fracid.safety.text import ascii_short, shortened

_Value = TypeVar("_Value")

LONGEST = 1 << 24
"""Bytes of a line of a log."""

REACH = 1e100
"""Sizes of numbers below this: their squares are finite."""

WHOLE_REACH = 1 << 63
"""The same of whole ones."""

MOST_VALUES = 1 << 22
"""Of lists, tables and what is in them: each takes up to a hundred bytes of memory, and two of the file."""

DEEPEST = 32
"""JSON in JSON; a result has seven."""

TEXT = 100_000
"""Characters of a text."""

LONGEST_NAME = 500
"""Characters of a name: a start value's has that of its recording."""


def plain(value: Any) -> Any:
    """The same as JSON has it: no array, no tuple, no dataclass, and null for what is not finite.

    Examples
    --------
    >>> plain({"ends": (0.5, float("nan"))})
    {'ends': [0.5, None]}
    """
    value = value.tolist() if hasattr(value, "tolist") else vars(value) if is_dataclass(value) else value
    if isinstance(value, Mapping):
        return {name: plain(v) for name, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    return json_number(value) if isinstance(value, float) else value


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


def json_document(record: Mapping[str, Any]) -> str:
    """Give a record as the text of a file, without NaN or infinity.

    Examples
    --------
    >>> print(json_document({"mu": 0.9}), end="")
    {
      "mu": 0.9
    }
    """
    return json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def json_of(text: str | bytes, **numbers: Any) -> Any:
    """JSON's value, if it has nothing that fracid does not write.

    Parameters
    ----------
    text : str or bytes
    numbers
        As of :func:`json.loads`: ``parse_constant = float`` takes NaN and infinity, as of other programs.

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
    text = text if isinstance(text, str) else text.decode()
    if sum(map(text.count, ",[{")) > MOST_VALUES:
        raise ValueError(f"it holds more than {MOST_VALUES} values")
    try:
        value = json.loads(text, **{"parse_constant": _no_number} | numbers)
    except RecursionError:
        raise ValueError("it lies too deep in itself") from None
    level, depth = [value], 0
    while level:
        if (depth := depth + 1) > DEEPEST:
            raise ValueError("it lies too deep in itself")
        level = [inner for outer in level for _, inner in _pairs(outer)]
    return value


def object_of(text: str | bytes | None) -> dict[str, Any] | None:
    """JSON's object, as a line of a log or a record is one; None of what is none, damaged or not there.

    Examples
    --------
    >>> object_of('{"mu": 0.9}'), object_of('{"mu": 0.'), object_of("[1]"), object_of(None)
    ({'mu': 0.9}, None, None, None)
    """
    with suppress(ValueError):
        content = json_of(text or "")
        return content if isinstance(content, dict) else None
    return None


def _no_number(word: str) -> Any:
    raise ValueError(f"{word} is no number")


def _pairs(value: Any) -> Iterable[tuple[str | int, Any]]:
    """What lies in a value of JSON, each with its name or its number."""
    if isinstance(value, dict):
        return value.items()
    return enumerate(value) if isinstance(value, list) else ()


def excess_of(value: Any, at: tuple[str | int, ...] = ()) -> str:
    """Where a value of JSON is larger than anything that fracid writes, in words; empty where it is not.

    `at` is where the value itself stands.

    Examples
    --------
    >>> excess_of({"mu": {"interval95": [0.9, 1e300]}})
    'mu.interval95.1 is 1e+300; expected a number below 1e+100 in size'
    >>> excess_of({"mu": 0.9})
    ''
    """
    excess = ""
    if isinstance(value, str):
        excess = f"expected a text of {TEXT} characters at most" if len(value) > TEXT else ""
    elif isinstance(value, float):
        excess = "" if abs(value) < REACH else f"expected a number below {REACH:g} in size"
    elif isinstance(value, int):
        excess = "" if abs(value) < WHOLE_REACH else "expected a number of fewer digits"
    elif isinstance(value, dict) and any(len(name) > LONGEST_NAME for name in value):
        return f"{place(at)} has a name of more than {LONGEST_NAME} characters"
    for key, inner in _pairs(value):
        if fault := excess_of(inner, (*at, key)):
            return fault
    return f"{place(at)} is {shown(value)}; {excess}" if excess else ""


def place(path: tuple[str | int, ...]) -> str:
    """Where something stands, in words: ``orders.mu.value``, or ``it`` for the whole.

    Examples
    --------
    >>> place(("orders", "mu", "value")), place(())
    ('orders.mu.value', 'it')
    """
    return ".".join(shortened(str(key)) for key in path) or "it"


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
    return ascii_short(str(value))[1:-1]
