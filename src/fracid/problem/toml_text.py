"""Project files as text: values in TOML's words."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from fracid.problem.unknowns import Free, Tied, Value


def toml_value(value: Any) -> str:
    """A value in TOML's words, a table in one line.

    Examples
    --------
    >>> toml_value({"start": 0.1, "unit": "N m", "free": True})
    '{ start = 0.1, unit = "N m", free = true }'
    """
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{toml_key(k)} = {toml_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, float):
        return repr(float(f"{value:.12g}"))
    return json.dumps(value, ensure_ascii=False)


def toml_document(tables: Mapping[str, Any]) -> str:
    """A file of tables, lists of tables, and tables in tables.

    Examples
    --------
    >>> print(toml_document({"model": {"name": "joint", "orders": {"mu": 0.9}}, "recording": [{"file": "a.csv"}]}))
    [model]
    name = "joint"
    <BLANKLINE>
    [model.orders]
    mu = 0.9
    <BLANKLINE>
    [[recording]]
    file = "a.csv"
    <BLANKLINE>
    """
    return "\n\n".join("\n".join(part) for name, table in tables.items() for part in _parts(name, table)) + "\n"


def reached(file: str, home: Path, folder: Path) -> str:
    """What a project file in the folder `home` calls so, as one in another folder calls it.

    Examples
    --------
    >>> reached("data/swing.csv", Path("rigs"), Path("runs/design"))
    '../../rigs/data/swing.csv'
    """
    if Path(file).is_absolute():
        return file
    return os.path.relpath(home.resolve() / file, folder.resolve()).replace(os.sep, "/")


def _parts(name: str, table: Any) -> Iterator[list[str]]:
    if isinstance(table, list):
        yield from ([f"[[{name}]]", *_lines(own)] for own in table)
        return
    within = {k: v for k, v in table.items() if isinstance(v, Mapping)}
    yield [f"[{name}]", *_lines({k: v for k, v in table.items() if k not in within})]
    yield from ([f"[{name}.{toml_key(k)}]", *_lines(v)] for k, v in within.items())


def _lines(table: Mapping[str, Any]) -> Iterator[str]:
    return (f"{toml_key(k)} = {toml_value(v)}" for k, v in table.items())


def toml_key(name: str) -> str:
    """A key, in quotes where it needs them.

    Examples
    --------
    >>> toml_key("b_alpha"), toml_key("release 92°")
    ('b_alpha', '"release 92°"')
    """
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def plain_value(value: Value, at: float | None = None, own: Any = None) -> Any:
    """An order or a parameter as a project file has it: a number, a range from `at` on, or another's name.

    Its `own` table in another file says what else is known of it, such as its unit.

    Examples
    --------
    >>> plain_value(Free(0.1, 0.0, math.inf), 0.2), plain_value(2), plain_value(2, own={"start": 1, "unit": "K"})
    ({'start': 0.2, 'lower': 0.0}, 2.0, {'value': 2.0, 'unit': 'K'})
    """
    kept = {k: own[k] for k in ("unit", "prior", "scale", "hard") if k in own} if isinstance(own, Mapping) else {}
    if isinstance(value, Tied):
        return value.to
    if not isinstance(value, Free):
        return {"value": float(value), "unit": kept["unit"]} if "unit" in kept else float(value)
    start = value.start if at is None else min(max(at, value.lower), value.upper)
    ends = {"start": start, "lower": value.lower, "upper": value.upper}
    return {k: v for k, v in ends.items() if math.isfinite(v)} | kept
