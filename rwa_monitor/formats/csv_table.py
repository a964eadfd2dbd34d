"""CSV sample tables: comma-separated UTF-8, one header row; read as text, so that every bad value can be named.

An empty field is a value that was not measured (NaN). Time in seconds is read as the decimal number it is written as,
never through a float, and rounded to the nearest nanosecond.
"""

from __future__ import annotations

import csv
import decimal
import re
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv

from rwa_monitor.errors import InputError
from rwa_monitor.formats.columns import (
    MAX_ROWS,
    REQUIRED_CHANNELS,
    TIME_COLUMNS,
    SampleTable,
    check_rows,
    lay_out,
    table_of,
)
from rwa_monitor.formats.files import atomic_write, decode_utf8, display_name, first_line, read_bytes
from rwa_monitor.formats.foreign import (
    encoding_hint,
    fields_hint,
    header_hint,
    kind_of,
    number_hint,
    oddities,
    separator_hint,
)
from rwa_monitor.samples import FloatArray, IntArray, Samples

MAX_CSV_BYTES: Final = 2_000_000_000
MAX_HEADER_BYTES: Final = 100_000
FIRST_DATA_ROW: Final = 2  # as a person counts: the header is row 1

_PLAIN_INTEGER: Final = r"^-?[0-9]{1,18}$"
# Seconds that fit a 128-bit decimal with 18 places without rounding, and int64 in nanoseconds: below 8e9 s.
_PLAIN_DECIMAL: Final = r"^[+-]?([0-9]{1,9}|[0-7][0-9]{9})(\.[0-9]{0,18})?$"
_ANY_DECIMAL: Final = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,9})?")
_FIRST_LINE: Final = re.compile(rb"([^\r\n]*)(\r\n|\r|\n|$)")
_LARGEST_INT64: Final = 2**63 - 1

# Texts of one column; pyarrow has no types of its own.
Texts = Any


def read_csv(path: Path) -> SampleTable:
    """Read a CSV sample table.

    Raises
    ------
    InputError
        If it cannot be used; names the file, the row (the header is row 1), the column and the reason.
    """
    source = display_name(path)
    # A closing blank line is nobody's mistake; one in the middle is a row without values, and is refused as such.
    content = read_bytes(path, MAX_CSV_BYTES).removeprefix(b"\xef\xbb\xbf").rstrip(b"\r\n")
    if max(content.count(b"\n"), content.count(b"\r")) > MAX_ROWS:
        raise InputError(source, f"has more rows than the limit of {MAX_ROWS:,}: split it, and use --carry")
    if foreign := kind_of(content):
        raise InputError(source, foreign)
    decode_utf8(content, path)
    try:
        return _table(content, source)
    except InputError as error:
        if others := _others(content, error.reason):
            raise InputError(source, f"{error.reason}; {others}", error.place) from error
        raise


def _others(content: bytes, reason: str) -> str:
    """Say what else a table would be refused for, after the first reason; "" for nothing."""
    head = content[:MAX_HEADER_BYTES].decode(errors="replace")
    wanted = (" or ".join(reversed(TIME_COLUMNS)), *REQUIRED_CHANNELS)
    others = [phrase for word, phrase in oddities(head, wanted) if word not in reason]
    return f"it also has {', '.join(others)}: docs/formats.md has one recipe for all that" if others else ""


def _table(content: bytes, source: str) -> SampleTable:
    """Return what a text says as a table."""
    names, rows = _header_and_rows(content, source)
    layout = lay_out(names, source)
    columns = _texts(rows, len(names), [*layout.time.values(), *layout.channels.values()], source)
    ((time_name, time_at),) = layout.time.items()
    check_rows(len(columns[time_at]), source)
    time_ns = _nanoseconds(columns[time_at], time_name, source)
    channels = {name: _numbers(columns[at], name, source) for name, at in layout.channels.items()}
    return table_of(Samples(time_ns=time_ns, **channels), layout, source, FIRST_DATA_ROW)


def write_csv(samples: Samples, path: Path) -> None:
    """Write samples as a CSV that `read_csv` gives back bit for bit; the same samples give the same bytes.

    Time is written in nanoseconds, values with the fewest digits that give them back, NaN as an empty field.
    """
    names, arrays = zip(*samples.channels(), strict=True)
    columns = [pa.array(values, from_pandas=True) for values in arrays]  # from_pandas: NaN becomes null
    options = pa_csv.WriteOptions(include_header=False, quoting_style="none")
    with atomic_write(path) as part, part.open("wb") as file:
        file.write(f"{','.join(names)}\n".encode())
        pa_csv.write_csv(pa.table(columns, names=names), file, options)


def _header_and_rows(content: bytes, source: str) -> tuple[list[str], memoryview]:
    """Return the names in the first row, and the bytes of all others."""
    first = _FIRST_LINE.match(content)
    line = first.group(1) if first else b""
    if first is None or not line.strip():
        raise InputError(source, "has no header", "row 1")
    if len(line) > MAX_HEADER_BYTES:
        raise InputError(source, f"is longer than the limit of {MAX_HEADER_BYTES:,} bytes", "row 1")
    if b"\x00" in line:
        raise InputError(source, f"is no CSV: its first row holds zero bytes; {encoding_hint(content)}", "row 1")
    header = line.decode()
    try:
        (names,) = csv.reader([header], strict=True)
    except csv.Error as error:
        raise InputError(source, f"is no CSV: {error}", "row 1") from error
    if hint := separator_hint(header, content[first.end() : first.end() + MAX_HEADER_BYTES].decode(errors="replace")):
        raise InputError(source, hint, "row 1")
    if first.end() == len(content):
        raise InputError(source, _with_hint("has a header and no rows", header_hint(names)))
    return [name.strip() for name in names], memoryview(content)[first.end() :]


def _texts(rows: memoryview, count: int, wanted: list[int], source: str) -> dict[int, Texts]:
    """Return the fields of the wanted columns as trimmed texts, by position."""
    refused: list[Any] = []

    def refuse(row: Any) -> str:
        refused.append(row)
        return "error"

    names = [str(position) for position in range(count)]
    try:
        table = pa_csv.read_csv(
            pa.BufferReader(rows),
            # One thread: only then are rows counted.
            read_options=pa_csv.ReadOptions(column_names=names, use_threads=False),
            parse_options=pa_csv.ParseOptions(ignore_empty_lines=False, invalid_row_handler=refuse),
            convert_options=pa_csv.ConvertOptions(
                column_types=dict.fromkeys(names, pa.string()),
                include_columns=[str(position) for position in wanted],
                strings_can_be_null=False,
                check_utf8=False,  # checked above, with the row named
            ),
        )
    except pa.ArrowInvalid as error:
        if refused:
            row = refused[0]
            reason = f"has {row.actual_columns} fields, the header has {row.expected_columns}"
            reason = _with_hint(reason, fields_hint(row.text or "", row.expected_columns))
            raise InputError(source, reason, f"row {row.number + FIRST_DATA_ROW - 1}") from error
        raise InputError(source, f"is no CSV: {first_line(error)}") from error
    return {position: pc.utf8_trim_whitespace(table[str(position)]) for position in wanted}


def _numbers(texts: Texts, column: str, source: str) -> FloatArray:
    """Return a column's values; an empty field is NaN."""
    measured = pc.if_else(pc.equal(texts, ""), "nan", texts)
    try:
        values = pc.cast(measured, pa.float64())
    except pa.ArrowInvalid as error:
        at = _first_refused(measured)
        text = texts[at].as_py()[:40]
        reason = _with_hint(f"{text!r} is not a number", number_hint(text))
        raise InputError(source, reason, f"row {at + FIRST_DATA_ROW}, column {column}") from error
    return np.asarray(values.to_numpy(), dtype=np.float64)


def _first_refused(texts: Texts) -> int:
    """Return the position of the first text that is no number, by halving: the conversion itself is the judge."""
    first, end = 0, len(texts)
    while end - first > 1:
        middle = (first + end) // 2
        try:
            pc.cast(texts.slice(first, middle - first), pa.float64())
        except pa.ArrowInvalid:
            end = middle
        else:
            first = middle
    return first


def _nanoseconds(texts: Texts, column: str, source: str) -> IntArray:
    """Return times [ns] from their texts in s or ns; decimal from end to end."""
    places = 9 if column == "time_s" else 0
    if places == 0 and pc.all(pc.match_substring_regex(texts, _PLAIN_INTEGER)).as_py():
        return np.asarray(pc.cast(texts, pa.int64()).to_numpy(), dtype=np.int64)
    if places == 9 and pc.all(pc.match_substring_regex(texts, _PLAIN_DECIMAL)).as_py():
        exact = pc.cast(texts, pa.decimal128(28, 18))
        nearest = pc.cast(pc.round(exact, places, "half_to_even"), pa.decimal128(20, 9))
        scaled = pc.multiply(nearest, pa.scalar(decimal.Decimal(10**places), pa.decimal128(10, 0)))
        return np.asarray(pc.cast(scaled, pa.int64()).to_numpy(), dtype=np.int64)
    # The rare ones, one by one: exponents, more digits, and whatever is no time at all.
    times = np.empty(len(texts), dtype=np.int64)
    for at, text in enumerate(texts.to_pylist()):
        time_or_reason = _nanoseconds_of(text, places)
        if isinstance(time_or_reason, str):
            raise InputError(source, time_or_reason, f"row {at + FIRST_DATA_ROW}, column {column}")
        times[at] = time_or_reason
    return times


def _nanoseconds_of(text: str, places: int) -> int | str:
    """Return one time in 10^-places s, rounded to the nearest, or the reason why it is none."""
    if not text:
        return "is empty; every row needs a time"
    if not _ANY_DECIMAL.fullmatch(text):
        return _with_hint(f"{text[:40]!r} is not a finite number", number_hint(text[:40]))
    with decimal.localcontext(prec=40, Emax=decimal.MAX_EMAX, Emin=decimal.MIN_EMIN) as context:
        context.traps[decimal.Inexact] = False
        value = decimal.Decimal(text).scaleb(places)
        # Compared before it becomes an integer: 1e999999 would be one of a million digits.
        if abs(value) > _LARGEST_INT64:
            return f"{text[:40]} is beyond the times that 64 bits of nanoseconds hold"
        nearest = value.to_integral_value(decimal.ROUND_HALF_EVEN)
    if places == 0 and nearest != value:
        return f"{text[:40]} is no whole number of nanoseconds"
    return int(nearest)


def _with_hint(reason: str, hint: str) -> str:
    return f"{reason}; {hint}" if hint else reason
