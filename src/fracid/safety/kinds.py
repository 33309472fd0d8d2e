"""What a record's fields are to be, by their annotations: an argument of another kind is refused by its name."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from numbers import Integral, Real
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from fracid.errors import InputError, brief, refuse_unknown
from fracid.safety.door import own_text

SAID = tomllib.loads(own_text("safety/kinds.toml"))
"""What a class is called, or how one of it is made; of some fields what they hold."""


def refuse_other_kinds(record: Any, whose: str = "") -> None:
    """Refuse a dataclass of which a field is not what it says.

    Parameters
    ----------
    record : dataclass
    whose : str
        What the message begins with.

    Raises
    ------
    InputError
        With the first such field, or the first entry of a mapping or a tuple.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass
    ... class Point:
    ...     x: float
    >>> refuse_other_kinds(Point("left"))
    Traceback (most recent call last):
    fracid.errors.InputError: x = 'left': expected a number.
    """
    for f in fields(record):
        words = SAID["fields"].get(f"{type(record).__name__}.{f.name}", "")
        _refuse(f"{whose}{f.name}", getattr(record, f.name), _hints(type(record))[f.name], words)


_hints: Any = cache(get_type_hints)


def _refuse(name: str, value: Any, kind: Any, words: str = "") -> None:
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Literal:
        refuse_unknown(name, inner, value)
    elif origin is Mapping and isinstance(value, Mapping):
        for key, entry in value.items():
            _refuse(f"{name} {key}", entry, inner[1], words)
    elif origin is tuple and isinstance(value, tuple | list):  # a list does as well
        for entry, its in zip(value, inner[:1] * len(value) if inner[-1] is ... else inner, strict=False):
            _refuse(name, entry, its, words)
    elif not isinstance(value, plain := _plain(kind)) or (isinstance(value, bool) and Real in plain):
        words = words or " or ".join(SAID.get(k.__name__, k.__name__) for k in plain)
        raise InputError(f"{name} = {brief(value)}: expected {words}.")


def _plain(kind: Any) -> tuple[type, ...]:
    """Of which of these classes a value may be."""
    origins = (get_origin(k) or k for k in (get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)))
    return tuple({float: Real, int: Integral, Any: object, Literal: str}.get(k, k) for k in origins)
