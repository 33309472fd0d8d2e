"""Parquet, by pyarrow, which is an extra: ``pip install 'fracid[parquet]'``."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from fracid.errors import DataError, InputError
from fracid.recording.readers.content import Content, LeftOut, damaged, refuse_bomb, same_name


def read_parquet(path: Path) -> Content:
    """Read the columns of numbers and dates.

    Raises
    ------
    InputError
        pyarrow is not installed.
    DataError
        The file is damaged, or would unpack to more numbers than a recording has.
    """
    try:
        from pyarrow import parquet
    except ImportError as error:
        raise InputError("reading Parquet needs pyarrow: type pip install 'fracid[parquet]'") from error
    try:
        with parquet.ParquetFile(path, thrift_string_size_limit=2**24, thrift_container_size_limit=2**20) as file:
            return _columns(file, path)
    except DataError:
        raise
    except Exception as error:  # pyarrow has its own tree of errors; damaged lengths are asked of the memory
        raise damaged(path, "Parquet file", str(error).replace(str(path), path.name)) from None


def _columns(file: Any, path: Path) -> Content:
    from pyarrow import types

    schema, size = file.schema_arrow, path.stat().st_size
    count = Counter(schema.names)
    names = [f.name for f in schema if _is_column(f.type, types) and count[f.name] == 1]
    refuse_bomb(path, file.metadata.num_rows * len(names), size)
    refuse_bomb(path, _declared(file.metadata) / 8, size)
    others: dict[str, Any] = {
        n: same_name(count[n]) if count[n] > 1 else LeftOut("is no column of numbers")
        for n in schema.names if n not in set(names)
    }  # fmt: skip
    table = file.read(columns=names, use_threads=False)
    return others | {name: table.column(name).to_numpy() for name in table.column_names if name in names}


def _declared(metadata: Any) -> int:
    """Return the bytes that all pages are said to unpack to."""
    # the sum of the groups' own: asking for a column's ends the process where its statistics are damaged (Arrow 26)
    return sum(max(0, metadata.row_group(k).total_byte_size) for k in range(metadata.num_row_groups))


def _is_column(kind: Any, types: Any) -> bool:
    return any(is_one(kind) for is_one in (types.is_integer, types.is_floating, types.is_boolean, types.is_timestamp))
