"""The sample table: telemetry of one wheel as CSV or Parquet, with fixed column names and units.

A table is read whole or refused: with its file, row, column and reason. Columns that are not known are left out and
returned by name, to be reported. Values that are not finite stay as they are: they are masked
later, where they are also counted.
"""

from __future__ import annotations

import csv
import decimal
import io
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import Any, Final, Literal

import numpy as np

from rwa_monitor.errors import InputError, needs_extra
from rwa_monitor.samples import FloatArray, IntArray, Samples
from rwa_monitor.telemetry.columns import (
    MAX_ROWS,
    MAX_TABLE_BYTES,
    ROWS_AT_ONCE,
    SampleTable,
    check_rows,
    lay_out,
    table_of,
)
from rwa_monitor.telemetry.files import atomic_write, decode_utf8, display_name, read_bytes, unreadable
from rwa_monitor.telemetry.pulses import speed_of_pulses

PARQUET_MAGIC: Final = b"PAR1"
MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
# The record that follows: its opcode, its length, and as its first field the profile, a text after its length.
ROS2_PROFILE: Final = b"\x04\x00\x00\x00ros2"
_PROFILE_AT: Final = len(MCAP_MAGIC) + 1 + 8

PACKET_SUFFIXES: Final = (".ccsds", ".bin")  # space packets have no first bytes of their own either

FileFormat = Literal["csv", "parquet", "mcap", "packets", "ros2"]


def parquet() -> ModuleType:
    """Return `parquet_table`, which belongs to an extra and whose Arrow takes a third of a second to import.

    Raises
    ------
    MissingExtraError
        If what it needs is not installed.
    """
    with needs_extra("parquet"):
        from rwa_monitor.telemetry import parquet_table  # noqa: PLC0415
    return parquet_table


def file_format(path: Path) -> FileFormat:
    """Return a file's format: by its first bytes, and where it has none of its own, by its suffix; else it is CSV.

    Raises
    ------
    InputError
        If the file cannot be read, is empty, or has another format than its suffix.
    """
    try:
        with path.open("rb") as file:
            head = file.read(_PROFILE_AT + len(ROS2_PROFILE))
    except OSError as error:
        raise unreadable(path, error) from error
    if not head:
        raise InputError(display_name(path), "is empty")
    if head.startswith(PARQUET_MAGIC):
        return "parquet"
    if head.startswith(MCAP_MAGIC):
        return "ros2" if head[_PROFILE_AT:] == ROS2_PROFILE else "mcap"
    suffix = path.suffix.lower()
    if suffix in (".parquet", ".mcap"):
        raise InputError(display_name(path), f"is no {suffix[1:]} file (its first bytes are {head[:8]!r})")
    return "packets" if suffix in PACKET_SUFFIXES else "csv"


def read_table(path: Path, pulses_per_turn: int | None = None) -> SampleTable:
    """Read a sample table, CSV or Parquet, or a table of pulses, of which the speed is worked out.

    Parameters
    ----------
    path
        The table.
    pulses_per_turn
        Of the wheel; None where that is not known.

    Raises
    ------
    InputError
        If the table cannot be used; names the file, the row, the column and the reason.
    MissingExtraError
        If what it takes to read Parquet is not installed.
    """
    table: SampleTable = parquet().read_parquet(path) if file_format(path) == "parquet" else read_csv(path)
    if not table.are_pulses:
        return table
    source = display_name(path)
    if pulses_per_turn is None:
        raise InputError(
            source, "holds pulses: how many make a turn is pulses_per_turn, under [wheel] in the wheel file"
        )
    turning = speed_of_pulses(table.samples, pulses_per_turn, source)
    note = f"{source}: {turning.in_words(len(table.samples), pulses_per_turn)}"
    return SampleTable(turning.samples, table.ignored_columns, notes=(note,))


# ---- CSV: comma-separated UTF-8, one header row; read as text, so that every bad value can be named ------------------


MAX_HEADER_BYTES: Final = 100_000
FIRST_DATA_ROW: Final = 2  # as a person counts: the header is row 1

_PLAIN_DECIMAL: Final = re.compile(r"([+-]?[0-9]{1,18})(?:\.([0-9]*))?")
_ANY_DECIMAL: Final = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,9})?")
_LARGEST_INT64: Final = np.iinfo(np.int64).max
_PLACES: Final = {"_s": 9, "_ns": 0}  # of a nanosecond in the unit with which the column's name ends
_CONTEXT: Final = decimal.Context(prec=40, Emax=decimal.MAX_EMAX, Emin=decimal.MIN_EMIN)


def read_csv(path: Path) -> SampleTable:
    """Read a CSV sample table.

    Raises
    ------
    InputError
        If it cannot be used; names the file, the row (the header is row 1), the column and the reason.
    """
    source = display_name(path)
    # A closing blank line is nobody's mistake; one in the middle is a row without values, and is refused as such.
    content = read_bytes(path, MAX_TABLE_BYTES).removeprefix(b"\xef\xbb\xbf").rstrip(b"\r\n")
    if max(content.count(b"\n"), content.count(b"\r")) > MAX_ROWS:
        raise InputError(source, f"has more rows than the limit of {MAX_ROWS:,}: split it, and use --carry")
    decode_utf8(content, path)
    reader = csv.reader(io.TextIOWrapper(io.BytesIO(content), encoding="utf-8", newline=""), strict=True)
    names = _header(content, reader, source)
    layout = lay_out(names, source)
    times, channels = [], {name: [np.zeros(0)] for name in layout.channels}
    row = FIRST_DATA_ROW
    for rows in _rows(reader, len(names), source):
        times.append(_nanoseconds([fields[layout.time_at].strip() for fields in rows], layout.time, source, row))
        for name, at in layout.channels.items():
            channels[name].append(_numbers([fields[at].strip() for fields in rows], name, source, row))
        row += len(rows)
    check_rows(row - FIRST_DATA_ROW, source)
    joined = {name: np.concatenate(parts) for name, parts in channels.items()}
    return table_of(np.concatenate(times), joined, layout, source, FIRST_DATA_ROW)


def write_csv(samples: Samples, path: Path) -> None:
    """Write samples as a CSV that `read_csv` gives back bit for bit; the same samples give the same bytes.

    Time is written in nanoseconds, values with the fewest digits that give them back, NaN as an empty field.
    """
    names, arrays = zip(*samples.channels(), strict=True)
    with atomic_write(path) as part, part.open("w", encoding="ascii", newline="") as file:
        file.write(f"{','.join(names)}\n")
        for first in range(0, len(samples), ROWS_AT_ONCE):
            columns = [_texts(values[first : first + ROWS_AT_ONCE]) for values in arrays]
            file.writelines(f"{','.join(fields)}\n" for fields in zip(*columns, strict=True))


def _texts(values: FloatArray | IntArray) -> list[str]:
    """Return numbers as they are written: the fewest digits, no `.0`, nothing for NaN."""
    return [repr(value).removesuffix(".0").replace("nan", "") for value in values.tolist()]


def _header(content: bytes, reader: Any, source: str) -> list[str]:
    """Return the names in the first row."""
    if not re.match(rb"[^\r\n]{1,%d}(?![^\r\n])" % MAX_HEADER_BYTES, content):
        reason = f"has no header of at most {MAX_HEADER_BYTES:,} bytes"
        raise InputError(source, reason, "row 1")
    try:
        names = [name.strip() for name in next(reader)]
    except csv.Error as error:
        raise InputError(source, f"is no CSV: {error}", "row 1") from error
    if reader.line_num > 1:
        raise InputError(source, "is no CSV: a field in quotes has no end in its row", "row 1")
    if any("\x00" in name for name in names):
        raise InputError(source, "is no CSV: its first row holds zero bytes", "row 1")
    return names


def _rows(reader: Any, count: int, source: str) -> Iterator[list[list[str]]]:
    """Yield the rows after the header, many at once, as their fields; an empty line is a row of empty fields."""
    done = 1  # the header
    try:
        while rows := [fields or [""] * count for fields in islice(reader, ROWS_AT_ONCE)]:
            for row, fields in enumerate(rows, start=done + 1):
                if len(fields) != count:
                    raise InputError(source, f"has {len(fields)} fields, the header has {count}", f"row {row}")
            if reader.line_num > done + len(rows):
                at = next(at for at, fields in enumerate(rows) if any({"\n", "\r"} & set(field) for field in fields))
                raise InputError(source, "a field in quotes has no end in its row", f"row {done + at + 1}")
            done += len(rows)
            yield rows
    except csv.Error as error:
        raise InputError(source, f"is no CSV: {error}", f"row {reader.line_num}") from error


def _numbers(texts: Sequence[str], column: str, source: str, row: int) -> FloatArray:
    """Return a column's values from their texts, the first of which stands in `row`; an empty field is NaN."""
    values = np.empty(len(texts))
    for at, text in enumerate(texts):
        try:
            # Python's own also takes 1_0 and digits of other scripts.
            values[at] = float(text or "nan") if text.isascii() and "_" not in text else float("")
        except ValueError as error:
            raise InputError(source, f"{text[:40]!r} is not a number", f"row {row + at}, column {column}") from error
    return values


def _nanoseconds(texts: Sequence[str], column: str, source: str, row: int) -> IntArray:
    """Return times [ns] from their texts in s or ns; decimal from end to end."""
    times, places = np.empty(len(texts), dtype=np.int64), _PLACES[column[column.rindex("_") :]]
    for at, text in enumerate(texts):
        time_or_reason = _nanoseconds_of(text, places)
        if isinstance(time_or_reason, str):
            raise InputError(source, time_or_reason, f"row {row + at}, column {column}")
        times[at] = time_or_reason
    return times


def _nanoseconds_of(text: str, places: int) -> int | str:
    """Return one time in 10^-places s, rounded to the nearest, or the reason why it is none."""
    if plain := _PLAIN_DECIMAL.fullmatch(text):
        whole, parts = plain.groups(default="")
        time = int(whole + parts.ljust(places, "0"))
        if len(parts) <= places and abs(time) <= _LARGEST_INT64:
            return time
    if not text:
        return "is empty; every row needs a time"
    if not _ANY_DECIMAL.fullmatch(text):
        return f"{text[:40]!r} is not a finite number"
    value = decimal.Decimal(text).scaleb(places, _CONTEXT)
    # Compared before it becomes an integer: 1e999999 would be one of a million digits.
    if value.copy_abs() > _LARGEST_INT64:
        return f"{text[:40]} is beyond the times that 64 bits of nanoseconds hold"
    nearest = value.to_integral_value(decimal.ROUND_HALF_EVEN, _CONTEXT)
    if places == 0 and nearest != value:
        return f"{text[:40]} is no whole number of nanoseconds"
    return int(nearest)


# ---- writing ---------------------------------------------------------------------------------------------------------


def _write_parquet(samples: Samples, path: Path) -> None:
    parquet().write_parquet(samples, path)


WRITERS: Final[dict[str, Callable[[Samples, Path], None]]] = {
    ".csv": write_csv,
    ".parquet": _write_parquet,
}


def table_writer(path: Path) -> Callable[[Samples, Path], None]:
    """Return the function that writes samples in the format that the file's suffix names.

    Raises
    ------
    InputError
        If no format has the suffix.
    """
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputError(display_name(path), f"must end in {' or '.join(WRITERS)}: the suffix chooses the format")
    return writer
