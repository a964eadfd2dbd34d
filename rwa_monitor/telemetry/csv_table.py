"""CSV sample tables: comma-separated UTF-8, one header row; read as text, so that every bad value can be named.

An empty field is a value that was not measured (NaN). Time in seconds is read as the decimal number it is written as,
never through a float, and rounded to the nearest nanosecond.
"""

from __future__ import annotations

import csv
import decimal
import io
import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np

from rwa_monitor.errors import InputError
from rwa_monitor.samples import FloatArray, IntArray, Samples
from rwa_monitor.telemetry.columns import (
    MAX_ROWS,
    REQUIRED_CHANNELS,
    TIME_COLUMNS,
    SampleTable,
    check_rows,
    lay_out,
    table_of,
)
from rwa_monitor.telemetry.files import atomic_write, decode_utf8, display_name, read_bytes
from rwa_monitor.telemetry.foreign import (
    encoding_hint,
    fields_hint,
    header_hint,
    kind_of,
    number_hint,
    oddities,
    separator_hint,
)

MAX_CSV_BYTES: Final = 2_000_000_000
MAX_HEADER_BYTES: Final = 100_000
FIRST_DATA_ROW: Final = 2  # as a person counts: the header is row 1

_PLAIN_DECIMAL: Final = re.compile(r"([+-]?[0-9]{1,18})(?:\.([0-9]*))?")
_ANY_DECIMAL: Final = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,9})?")
_FIRST_LINE: Final = re.compile(rb"([^\r\n]*)(\r\n|\r|\n|$)")
_LARGEST_INT64: Final = 2**63 - 1
_PLACES: Final = {"_s": 9, "_ns": 0}  # of a nanosecond in the unit with which the column's name ends
_CONTEXT: Final = decimal.Context(prec=40, Emax=decimal.MAX_EMAX, Emin=decimal.MIN_EMIN)
_ROWS_AT_ONCE: Final = 50_000  # as texts, which take 20 times the memory of their values


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
    """Report what else a table would be refused for, after the first reason; "" for nothing."""
    head = content[:MAX_HEADER_BYTES].decode(errors="replace")
    wanted = (" or ".join(reversed(TIME_COLUMNS)), *REQUIRED_CHANNELS)
    others = [phrase for word, phrase in oddities(head, wanted) if word not in reason]
    return f"it also has {', '.join(others)}: docs/formats.md has one recipe for all that" if others else ""


def _table(content: bytes, source: str) -> SampleTable:
    """Return the table that a text holds."""
    names, begin = _header(content, source)
    layout = lay_out(names, source)
    times, channels = [], {name: [np.zeros(0)] for name in layout.channels}
    row = FIRST_DATA_ROW
    for rows in _rows(content, begin, len(names), source):
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
        for first in range(0, len(samples), _ROWS_AT_ONCE):
            columns = [_texts(values[first : first + _ROWS_AT_ONCE]) for values in arrays]
            file.writelines(f"{','.join(fields)}\n" for fields in zip(*columns, strict=True))


def _texts(values: FloatArray | IntArray) -> list[str]:
    """Return numbers as they are written: the fewest digits, no `.0`, nothing for NaN."""
    return [repr(value).removesuffix(".0").replace("nan", "") for value in values.tolist()]


def _header(content: bytes, source: str) -> tuple[list[str], int]:
    """Return the names in the first row, and where the others begin."""
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
    return [name.strip() for name in names], first.end()


def _rows(content: bytes, begin: int, count: int, source: str) -> Iterator[list[list[str]]]:
    """Yield the rows after the header, many at once, as their fields; an empty line is a row of empty fields."""
    data = io.BytesIO(content)
    data.seek(begin)
    reader = csv.reader(io.TextIOWrapper(data, encoding="utf-8", newline=""), strict=True)
    done = 0
    try:
        while rows := [fields or [""] * count for fields in islice(reader, _ROWS_AT_ONCE)]:
            for row, fields in enumerate(rows, start=done + FIRST_DATA_ROW):
                if len(fields) != count:
                    reason = f"has {len(fields)} fields, the header has {count}"
                    raise InputError(source, _with_hint(reason, fields_hint(",".join(fields), count)), f"row {row}")
            if reader.line_num > done + len(rows):
                at = next(at for at, fields in enumerate(rows) if any({"\n", "\r"} & set(field) for field in fields))
                raise InputError(source, "a field in quotes has no end in its row", f"row {done + at + FIRST_DATA_ROW}")
            done += len(rows)
            yield rows
    except csv.Error as error:
        raise InputError(source, f"is no CSV: {error}", f"row {reader.line_num + FIRST_DATA_ROW - 1}") from error


def _numbers(texts: Sequence[str], column: str, source: str, row: int) -> FloatArray:
    """Return a column's values from their texts, the first of which stands in `row`; an empty field is NaN."""
    values = np.empty(len(texts))
    for at, text in enumerate(texts):
        try:
            # Python's own also takes 1_0 and digits of other scripts.
            values[at] = float(text or "nan") if text.isascii() and "_" not in text else float("")
        except ValueError as error:
            reason = _with_hint(f"{text[:40]!r} is not a number", number_hint(text[:40]))
            raise InputError(source, reason, f"row {row + at}, column {column}") from error
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
        return _with_hint(f"{text[:40]!r} is not a finite number", number_hint(text[:40]))
    value = decimal.Decimal(text).scaleb(places, _CONTEXT)
    # Compared before it becomes an integer: 1e999999 would be one of a million digits.
    if value.copy_abs() > _LARGEST_INT64:
        return f"{text[:40]} is beyond the times that 64 bits of nanoseconds hold"
    nearest = value.to_integral_value(decimal.ROUND_HALF_EVEN, _CONTEXT)
    if places == 0 and nearest != value:
        return f"{text[:40]} is no whole number of nanoseconds"
    return int(nearest)


def _with_hint(reason: str, hint: str) -> str:
    return f"{reason}; {hint}" if hint else reason
