"""Parquet, by pyarrow, which is an extra: ``pip install 'fracid[parquet]'``."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from fracid.errors import installed
from fracid.recording.readers.content import NO_NUMBERS, Content, reading, refuse_bomb, same_name


def read_parquet(path: Path) -> Content:
    """Read the columns of numbers, dates and spans of time.

    Raises
    ------
    InputError
        pyarrow is not installed.
    DataError
        The file is damaged, or would unpack to more numbers than a recording has.
    """
    with installed("reading Parquet needs pyarrow: type pip install 'fracid[parquet]'"):
        from pyarrow import parquet
    limits = {"thrift_string_size_limit": 2**24, "thrift_container_size_limit": 2**20}
    with reading(path, "Parquet file"), parquet.ParquetFile(path, **limits) as file:
        return _columns(file, path)


def _columns(file: Any, path: Path) -> Content:
    from pyarrow import types

    schema = file.schema_arrow
    count = Counter(schema.names)
    numbers = types.is_integer, types.is_floating, types.is_boolean, types.is_timestamp, types.is_duration
    names = [f.name for f in schema if any(is_one(f.type) for is_one in numbers) and count[f.name] == 1]
    refuse_bomb(path, file.metadata.num_rows * len(names))
    # the sum of the groups' own: asking for a column's ends the process where its statistics are damaged (Arrow 26)
    groups = map(file.metadata.row_group, range(file.metadata.num_row_groups))
    refuse_bomb(path, sum(max(0, group.total_byte_size) for group in groups) / 8)
    others: dict[str, Any] = {n: same_name(times) if times > 1 else NO_NUMBERS for n, times in count.items()}
    table = file.read(columns=names, use_threads=False)
    return others | {name: table.column(name).to_numpy() for name in table.column_names if name in names}
