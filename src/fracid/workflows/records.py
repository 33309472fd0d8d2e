"""What every workflow writes alike: a table as CSV, and the command that does the same."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from fracid.safety.text import csv_cell


def csv_text(rows: Sequence[Mapping[str, Any]]) -> str:
    r"""Give rows as a table, of which no spreadsheet runs a cell; a row without a column has an empty cell there.

    Examples
    --------
    >>> csv_text([{"name": "mu", "value": 0.9}, {"name": "length", "value": 0.3, "unit": "m"}])
    'name,value,unit\r\nmu,0.9,\r\nlength,0.3,m\r\n'
    """
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(dict.fromkeys(name for row in rows for name in row)))
    writer.writeheader()
    writer.writerows({n: csv_cell(v) if isinstance(v, str) else v for n, v in row.items()} for row in rows)
    return text.getvalue()


def command_of(command: str, place: Path, options: Mapping[str, object]) -> list[str]:
    """Give the words of the command that does the same: what ``environment.json`` says of a call from Python.

    Parameters
    ----------
    command : str
    place : Path
        The project, or the folder of the run.
    options : mapping
        By the names of the command's options; None, False and an empty list are left out, True is a flag, and a list
        is the option several times, as is a mapping: name=value.

    Examples
    --------
    >>> command_of("fit", Path("rig.toml"), {"out": "runs/a", "seed": None, "cut": True, "multi_start": 16})
    ['fit', 'rig.toml', '--out', 'runs/a', '--cut', '--multi-start', '16']
    >>> command_of("control", Path("runs/a"), {"input_": "torque", "off": {"angle": 0.2}})
    ['control', 'runs/a', '--input', 'torque', '--off', 'angle=0.2']
    """
    return [command, str(place), *words_of(options)]


def words_of(options: Mapping[str, object]) -> Iterator[str]:
    """Give options as one types them; see :func:`command_of`.

    Examples
    --------
    >>> [*words_of({"jobs": 2, "json": True, "rate": 1000.0, "trust": False})]
    ['--jobs', '2', '--json', '--rate', '1000']
    """
    for name, value in options.items():
        option = f"--{name.rstrip('_').replace('_', '-')}"
        pairs = [f"{n}={v}" for n, v in value.items()] if isinstance(value, Mapping) else value
        values: Iterable[object] = pairs if isinstance(pairs, list | tuple) else [pairs]
        for v in values:
            if v is not None and v is not False:
                yield option
            if not isinstance(v, bool | None):
                yield f"{v}".removesuffix(".0" * isinstance(v, float))
