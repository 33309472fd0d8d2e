"""Columns from records: a JSON log, or the messages of a bag.

A sample is a record with named values, ``{"timestamp": 0.01, "position": 0.3}``; records in records and short lists
give columns with dotted names, ``joint.velocity.0``.  What one sample lacks is missing there.

===================================================  ===============================================================
JSON                                                 read as
===================================================  ===============================================================
``[{"t": 0, "x": 1}, …]``, or a record on each line  a row each
``{"t": [0, …], "x": [1, …]}``                       a column each
``{"mass": 0.49, …, "entries": [{"t": 0, …}, …]}``   the records; single values beside them are handed on
===================================================  ===============================================================
"""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.recording.readers.content import (
    LISTS,
    TEXT,
    Content,
    LeftOut,
    Tally,
    damaged,
    seconds_of_stamp,
)
from fracid.safety.door import bytes_of
from fracid.safety.json_files import json_of


def read_json(path: Path) -> tuple[Content, dict[str, Any]]:
    """Read the records or columns of a JSON file, and the single values that stand beside them.

    Raises
    ------
    DataError
        It is no JSON, or its records have so many names that a table of them would be mostly blank.
    """
    try:
        value = _value(bytes_of(path).decode("utf-8-sig"))
    except ValueError as error:
        raise damaged(path, "JSON file", str(error).replace(str(path), "it")) from None
    columns = Columns(path)
    if not isinstance(value, dict):
        return {path.stem: columns.of(value if isinstance(value, list) else [value])}, {}
    singles = {name: v for name, v in value.items() if not isinstance(v, list | dict)}
    return columns.inside({name: v for name, v in value.items() if name not in singles}), singles


def _value(text: str) -> Any:
    """JSON, or a line of JSON for each sample."""
    try:
        return json_of(text, parse_constant=float, parse_int=float)
    except ValueError:
        lines = [line for line in text.splitlines() if line.strip()]
        if not all(line.lstrip().startswith("{") for line in lines) or len(lines) < 2:
            raise
        return json_of(f"[{','.join(lines)}]", parse_constant=float, parse_int=float)


class Columns(Tally):
    """What was made of the records of a file so far."""

    def of(self, samples: list[Any]) -> FloatArray | LeftOut | Content:
        """Make a column of the values of one name, sample by sample, or columns where these have names themselves.

        Raises
        ------
        DataError
            Together they have more cells than a recording of that size has numbers.

        Examples
        --------
        >>> Columns(Path(__file__)).of([{"t": 0.0, "q": [1, 2]}, {"t": 0.1, "q": None}])
        {'t': array([0. , 0.1]), 'q': {'0': array([ 1., nan]), '1': array([ 2., nan])}}
        """
        there = [v for v in samples if v is not None]
        kinds = {type(v) for v in there}
        if kinds <= {bool, int, float}:
            return np.array([np.nan if v is None else v for v in samples], dtype=np.float64)
        if kinds == {str}:
            stamps = [np.nan if v is None else seconds_of_stamp(v) for v in samples]
            return TEXT if None in stamps else np.array(stamps, dtype=np.float64)
        if kinds == {list}:
            if len({len(v) for v in there}) > 1:
                return LISTS
            samples = [v and dict(enumerate(v)) for v in samples]
        elif kinds != {dict}:
            return LeftOut("holds values of several kinds")
        names = dict.fromkeys(chain.from_iterable(v for v in samples if v))
        self.add(len(names) * len(samples))
        return {str(name): self.of([v.get(name) if v else None for v in samples]) for name in names}

    def inside(self, tables: dict[str, Any]) -> Content:
        """Make columns of a table of lists, of tables and of single values."""
        return {name: self.inside(v) if isinstance(v, dict) and not _is_numbered(v)
                else self.of([*v.values()] if isinstance(v, dict) else v if isinstance(v, list) else [v])
                for name, v in tables.items()}  # fmt: skip


def _is_numbered(table: dict[str, Any]) -> bool:
    """Tell whether a table is a column by the numbers of its rows, as pandas writes it."""
    return [*table] == [str(k) for k in range(len(table))]
