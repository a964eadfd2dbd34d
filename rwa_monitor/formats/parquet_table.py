"""Parquet sample tables: the same columns as in CSV, as numbers; null is a value that was not measured (NaN)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from rwa_monitor.errors import InputError
from rwa_monitor.formats.columns import SampleTable, check_rows, check_time, lay_out
from rwa_monitor.formats.files import atomic_write, display_name, unreadable
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, FloatArray, IntArray, Samples

FIRST_ROW: Final = 1  # as a person counts: a Parquet table has no header row

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
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            names = file.schema_arrow.names
            layout = lay_out(names, source)
            check_rows(file.metadata.num_rows, source)  # said by the footer, before anything is unpacked
            ((time_name, _),) = layout.time.items()
            table = file.read([time_name, *layout.channels])
    except (pa.ArrowException, EOFError) as error:
        raise InputError(source, f"is no readable Parquet file: {str(error).splitlines()[0]}") from error
    except OSError as error:  # Arrow reports damaged pages so, with a text and without a code
        if error.errno is not None:
            raise unreadable(path, error) from error
        raise InputError(source, f"is no readable Parquet file: {str(error).splitlines()[0]}") from error
    time_ns = _nanoseconds(table[time_name], time_name, source)
    check_time(time_ns, time_name, source, FIRST_ROW)
    channels = {name: _numbers(table[name], name, source) for name in layout.channels}
    return SampleTable(Samples(time_ns=time_ns, **channels), layout.ignored)


def write_parquet(samples: Samples, path: Path) -> None:
    """Write samples as a Parquet table that `read_parquet` gives back bit for bit; NaN stays NaN."""
    names, arrays = zip(*samples.channels(), strict=True)
    table = pa.table([pa.array(values) for values in arrays], names=names)
    with atomic_write(path) as part:
        # With checksums, a bit that flips on a disk is an error when the table is read, not another number.
        pq.write_table(table, part, compression="zstd", write_page_checksum=True)


def _numbers(column: Column, name: str, source: str) -> FloatArray:
    """Return a column's values as float64, null as NaN."""
    kind = column.type
    if pa.types.is_null(kind):
        return np.full(len(column), np.nan)
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
        raise InputError(source, f"holds {kind}, not numbers", f"column {name}")
    return np.asarray(pc.cast(column, pa.float64(), safe=False).to_numpy(), dtype=np.float64)


def _nanoseconds(column: Column, name: str, source: str) -> IntArray:
    """Return the times [ns] of a column in s or ns."""
    missing = pc.index(pc.is_null(column), True).as_py()
    if missing >= 0:
        raise InputError(source, "is empty; every row needs a time", f"row {missing + FIRST_ROW}, column {name}")
    if name == "time_ns":
        if not pa.types.is_integer(column.type):
            raise InputError(source, f"holds {column.type}, not integers", f"column {name}")
        try:
            return np.asarray(pc.cast(column, pa.int64()).to_numpy(), dtype=np.int64)
        except pa.ArrowInvalid as error:
            raise InputError(source, "holds a time beyond 64 bits of nanoseconds", f"column {name}") from error
    seconds = _numbers(column, name, source)
    # Whole seconds and the rest apart: their product with 1e9 together would lose the last digits of a late time.
    whole = np.floor(seconds)
    usable = np.abs(whole) < np.iinfo(np.int64).max // NANOSECONDS_PER_SECOND
    if not usable.all():
        at = int(np.argmin(usable))
        reason = f"{seconds[at]} is not a time that 64 bits of nanoseconds hold"
        raise InputError(source, reason, f"row {at + FIRST_ROW}, column {name}")
    rest_ns = np.rint((seconds - whole) * NANOSECONDS_PER_SECOND)
    return np.asarray(whole.astype(np.int64) * NANOSECONDS_PER_SECOND + rest_ns.astype(np.int64), dtype=np.int64)
