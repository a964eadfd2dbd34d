"""Parquet sample tables: the same columns as in CSV, as numbers; null is a value that was not measured (NaN).

What a file states of its sizes and types is compared with limits before anything in it is unpacked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from rwa_monitor.errors import InputError
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, FloatArray, IntArray, Samples
from rwa_monitor.telemetry.columns import (
    MAX_TABLE_BYTES,
    ROWS_AT_ONCE,
    SampleTable,
    check_rows,
    lay_out,
    table_of,
)
from rwa_monitor.telemetry.files import atomic_write, display_name, first_line, unreadable

FIRST_ROW: Final = 1  # as a person counts: a Parquet table has no header row

MAX_UNPACKED_BYTES: Final = 4_000_000_000  # of all columns; 20 million rows of 7 channels are 1.3 GB
MAX_FOOTER_ENTRIES: Final = 1_000_000  # of a list in the footer, and characters of a text in it

# A column; pyarrow has no types of its own.
Column = Any


def read_parquet(path: Path) -> SampleTable:
    """Read a Parquet sample table.

    Raises
    ------
    InputError
        If it cannot be used; names the file, the row (the first is row 1), the column and the reason.
    """
    source = display_name(path)
    try:
        if path.stat().st_size > MAX_TABLE_BYTES:
            raise InputError(source, f"is larger than the limit of {MAX_TABLE_BYTES:,} bytes")
        with pq.ParquetFile(
            path,
            pre_buffer=False,
            page_checksum_verification=True,
            thrift_string_size_limit=MAX_FOOTER_ENTRIES,
            thrift_container_size_limit=MAX_FOOTER_ENTRIES,
        ) as file:
            layout = lay_out(file.schema_arrow.names, source)
            _check_footer(file, (layout.time, *layout.channels), source)
            table = _read_columns(file, [layout.time, *layout.channels], source)
    except (pa.ArrowException, EOFError, UnicodeDecodeError) as error:
        raise InputError(source, f"is no readable Parquet file: {first_line(error)}") from error
    except OSError as error:  # Arrow reports damaged pages so, with a text and without a code
        if error.errno is not None:
            raise unreadable(path, error) from error
        raise InputError(source, f"is no readable Parquet file: {first_line(error)}") from error
    time_ns = _nanoseconds(table[layout.time], layout.time, source)
    channels = {name: _numbers(table[name]) for name in layout.channels}
    return table_of(time_ns, channels, layout, source, FIRST_ROW)


def _check_footer(file: Any, columns: Sequence[str], source: str) -> None:
    """Raise InputError where the footer promises too much, or a column that is wanted and holds no numbers."""
    metadata, schema = file.metadata, file.schema_arrow
    check_rows(metadata.num_rows, source)
    for name in columns:
        kind = schema.field(name).type
        if not _is_number(kind):
            raise InputError(source, f"holds {kind}, not numbers", f"column {name}")
    # Of all columns: to look at one of a damaged file ends the process (pyarrow 26, an exception nobody catches).
    unpacked = sum(metadata.row_group(at).total_byte_size for at in range(metadata.num_row_groups))
    if unpacked > MAX_UNPACKED_BYTES:
        raise InputError(source, f"unpacks to {unpacked:,} bytes; the limit is {MAX_UNPACKED_BYTES:,}")


def _read_columns(file: Any, names: list[str], source: str) -> Any:
    """Return columns as a table, in pieces: a row group may claim to hold more rows than memory, and the footer few."""
    promised, batches, rows = file.metadata.num_rows, [], 0
    # On this thread: Arrow's own take half as much time again in all, and get in the way of the other processes where
    # many recordings are read at once.
    for batch in file.iter_batches(batch_size=ROWS_AT_ONCE, columns=names, use_threads=False):
        rows += len(batch)
        if rows > promised:
            break
        batches.append(batch)
    if rows != promised:
        raise InputError(source, f"holds {'more' if rows > promised else 'fewer'} rows than its footer states")
    return pa.Table.from_batches(batches)


def _is_number(kind: Any) -> bool:
    """Return whether a column's values are numbers; a column without any value is one of NaN."""
    types = pa.types
    return bool(types.is_null(kind) or types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind))


def write_parquet(samples: Samples, path: Path) -> None:
    """Write samples as a Parquet table that `read_parquet` gives back bit for bit; NaN stays NaN."""
    write_columns(dict(samples.channels()), path)


def write_columns(columns: Mapping[str, np.ndarray[Any, Any]], path: Path) -> None:
    """Write arrays of one length as a table."""
    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    with atomic_write(path) as part:
        # With checksums, a bit that flips on a disk is an error when the table is read, not another number.
        pq.write_table(table, part, compression="zstd", write_page_checksum=True)


def _numbers(column: Column) -> FloatArray:
    """Return a column's values as float64, null as NaN."""
    return np.asarray(pc.cast(column, pa.float64(), safe=False).to_numpy(), dtype=np.float64)


def _nanoseconds(column: Column, name: str, source: str) -> IntArray:
    """Return the times [ns] of a column in s or ns."""
    missing = pc.index(pc.is_null(column), True).as_py()
    if missing >= 0:
        raise InputError(source, "is empty; every row needs a time", f"row {missing + FIRST_ROW}, column {name}")
    if name.endswith("_ns"):
        if not pa.types.is_integer(column.type):
            raise InputError(source, f"holds {column.type}, not integers", f"column {name}")
        try:
            return np.asarray(pc.cast(column, pa.int64()).to_numpy(), dtype=np.int64)
        except pa.ArrowInvalid as error:
            raise InputError(source, "holds a time beyond 64 bits of nanoseconds", f"column {name}") from error
    seconds = _numbers(column)
    # Whole seconds and the rest apart: their product with 1e9 together would lose the last digits of a late time.
    whole = np.floor(seconds)
    usable = np.abs(whole) < np.iinfo(np.int64).max // NANOSECONDS_PER_SECOND
    if not usable.all():
        at = int(np.argmin(usable))
        reason = f"{seconds[at]} is not a time that 64 bits of nanoseconds hold"
        raise InputError(source, reason, f"row {at + FIRST_ROW}, column {name}")
    rest_ns = np.rint((seconds - whole) * NANOSECONDS_PER_SECOND)
    return np.asarray(whole.astype(np.int64) * NANOSECONDS_PER_SECOND + rest_ns.astype(np.int64), dtype=np.int64)
