"""The sample table: telemetry of one wheel as CSV or Parquet, with fixed column names and units.

A table is read whole or refused, with file, row, column and reason. Unknown columns are left out and returned by name,
to be reported. Values that are not finite are kept: they are masked and counted later.
"""

import csv
import decimal
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from decimal import Decimal
from itertools import islice
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rwa_monitor.errors import InputError, needs_extra
from rwa_monitor.messages import MAX_CLOCK_NS
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, TABLE_CHANNELS, FloatArray, IntArray, Samples
from rwa_monitor.telemetry import files
from rwa_monitor.telemetry.files import display_name
from rwa_monitor.telemetry.pulses import speed_of_pulses
from rwa_monitor.words import first_few

TIME_COLUMNS: Final = ("time_ns", "time_s")  # the exact one first: it is used where a table has both
PULSE_COLUMNS: Final = ("pulse_time_ns", "pulse_time_s")  # of a table of pulses, which has no speed
SPEED, ANGLE, ANGLE_IN_DEGREES = "speed_rad_s", "angle_rad", "angle_deg"
_COLUMNS: Final = (*TABLE_CHANNELS, ANGLE_IN_DEGREES)
MAX_ROWS: Final = 20_000_000  # 29 days at 8 Hz, 1.1 GB with all channels
MAX_COLUMNS: Final = 1_000
MAX_TABLE_BYTES: Final = 2_000_000_000  # of a file
ROWS_AT_ONCE: Final = 50_000  # read or written; as text they take 20 times the memory of their values


class SampleTable(NamedTuple):
    """A table as it was read.

    Attributes
    ----------
    samples
        The telemetry; time strictly increases, there is at least one sample.
    notes
        How the rows were used, and which columns were left out, a sentence each.
    """

    samples: Samples
    notes: Sequence[str] = ()


class Layout(NamedTuple):
    """The columns of a table; in a table of pulses the speed is not measured, but follows from the times.

    Attributes
    ----------
    time, time_at
        Name of the time column, and its position in the table.
    channels
        Name → position in the table, in the order of `TABLE_CHANNELS`, an angle in degrees last.
    ignored
        Names of all other columns.
    """

    time: str
    time_at: int
    channels: dict[str, int]
    ignored: list[str]


def lay_out(names: Sequence[str], source: str) -> Layout:
    """Find the columns of a table by their names.

    Raises
    ------
    InputError
        If a required column is missing, or a known one is there twice.
    """
    if len(names) > MAX_COLUMNS:
        raise InputError(source, f"has {len(names)} columns; the limit is {MAX_COLUMNS}")
    for name in (*TIME_COLUMNS, *PULSE_COLUMNS, *_COLUMNS):
        if names.count(name) > 1:
            raise InputError(source, "is there twice", f"column {name}")
    time = [name for name in TIME_COLUMNS if name in names]
    missing = [] if SPEED in names else [SPEED]
    pulses = [name for name in PULSE_COLUMNS if name in names]
    if missing and pulses:
        time, missing = pulses, []
    if not time:
        missing = [" or ".join(reversed(TIME_COLUMNS)), *missing]
    if missing:
        others = f", and so is {', '.join(missing[1:])}" if len(missing) > 1 else ""
        there = first_few([repr(name[:40]) for name in names])
        reason = f"is missing{others}; the table has {there} (docs/formats.md)"
        raise InputError(source, reason, f"column {missing[0]}")
    channels = {name: names.index(name) for name in _COLUMNS if name in names}
    if {ANGLE, ANGLE_IN_DEGREES} <= channels.keys():
        raise InputError(source, f"is there beside {ANGLE}: leave one of them out", f"column {ANGLE_IN_DEGREES}")
    ignored = [name for name in names if name not in (time[0], *channels)]
    return Layout(time[0], names.index(time[0]), channels, ignored)


def check_rows(rows: int, source: str) -> None:
    """Raise InputError unless a table has at least one row and at most `MAX_ROWS`."""
    if rows == 0:
        raise InputError(source, "has no rows")
    if rows > MAX_ROWS:
        raise InputError(source, f"has {rows:,} rows; the limit is {MAX_ROWS:,}: split it, and use --carry")


def _check_time(time_ns: IntArray, column: str, source: str, first_row: int) -> None:
    """Raise InputError, naming the row, unless time strictly increases over a span that slots can count."""
    late = time_ns[1:] <= time_ns[:-1]
    if late.any():
        at = int(np.argmax(late)) + 1
        before, here = (_as_written(int(time_ns[i]), column) for i in (at - 1, at))
        reason = f"time does not increase ({here} after {before}); sort the rows by time and leave repeated ones out"
        raise InputError(source, reason, f"row {first_row + at}, column {column}")
    span_ns = int(time_ns[-1]) - int(time_ns[0])  # Python's integers: the difference may exceed int64
    if 2 * span_ns >= MAX_CLOCK_NS:  # the slot of a sample is computed in int64 from twice its time
        raise InputError(source, f"covers {span_ns / NANOSECONDS_PER_SECOND:.3g} s, more than 73 years", column)


def _as_written(time_ns: int, column: str) -> str:
    """Write a time in the unit of its column, exactly."""
    if column.endswith("_ns"):
        return f"{time_ns} ns"
    return f"{Decimal(time_ns).scaleb(-9).normalize():f} s"


# ---- columns, whatever the file: names, units, limits, and the checks that every table must pass ---------------------


PARQUET_MAGIC: Final = b"PAR1"
MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
# The record that follows: its opcode, its length, and as its first field the profile, a text after its length.
_ROS2: Final = re.compile(re.escape(MCAP_MAGIC) + rb".{9}\x04\x00\x00\x00ros2", re.DOTALL)

PACKET_SUFFIXES: Final = (".ccsds", ".bin")  # space packets have no first bytes of their own either

FileFormat = Literal["csv", "parquet", "mcap", "packets", "ros2"]


def arrow() -> Any:
    """Return pyarrow, which belongs to an extra, has no type hints, and takes a third of a second to import.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    with needs_extra("parquet"):
        import pyarrow  # noqa: PLC0415, ICN001
        import pyarrow.compute  # noqa: PLC0415
        import pyarrow.parquet  # noqa: PLC0415
    return pyarrow


def file_format(path: Path) -> FileFormat:
    """Return a file's format: by its first bytes; where the format has no signature, by its suffix; else CSV.

    Raises
    ------
    InputError
        If the file cannot be read, is empty, or has another format than its suffix.
    """
    with files.opened(path) as file:
        head = file.read(files.PIECE_BYTES)
    if not head:
        raise InputError(display_name(path), "is empty")
    if head.startswith(PARQUET_MAGIC):
        return "parquet"
    if head.startswith(MCAP_MAGIC):
        return "ros2" if _ROS2.match(head) else "mcap"
    suffix = path.suffix.lower()
    if suffix in (".parquet", ".mcap"):
        raise InputError(display_name(path), f"is no {suffix[1:]} file (its first bytes are {head[:8]!r})")
    return "packets" if suffix in PACKET_SUFFIXES else "csv"


def read_table(path: Path, pulses_per_turn: int | None = None) -> SampleTable:
    """Read a sample table, CSV or Parquet, or a table of pulses, from which the speed is computed.

    Parameters
    ----------
    path
        The table.
    pulses_per_turn
        Of the wheel; None where not known.

    Raises
    ------
    InputError
        If the table cannot be used; names the file, the row, the column and the reason.
    MissingExtraError
        If the table is Parquet and pyarrow is not installed.
    """
    source = display_name(path)
    layout, time_ns, channels = (_read_parquet if file_format(path) == "parquet" else _read_csv)(path, source)
    if ANGLE_IN_DEGREES in channels:
        channels[ANGLE] = np.radians(channels.pop(ANGLE_IN_DEGREES))
    notes = [f"columns ignored: {', '.join(layout.ignored)}"] if layout.ignored else []
    if layout.time not in PULSE_COLUMNS:
        return SampleTable(Samples(time_ns=time_ns, **channels), notes)
    if pulses_per_turn is None:
        raise InputError(
            source, "holds pulses: how many make a turn is pulses_per_turn, under [wheel] in the wheel file"
        )
    pulses = Samples(time_ns=time_ns, **{SPEED: np.full(time_ns.size, np.nan), **channels})
    turning = speed_of_pulses(pulses, pulses_per_turn, source)
    return SampleTable(turning.samples, [turning.in_words(len(pulses), pulses_per_turn), *notes])


# ---- CSV: comma-separated UTF-8, one header row; read as text, so that every bad value can be named ------------------


_DECIMAL: Final = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,9})?")
_LARGEST_INT64: Final = np.iinfo(np.int64).max
_PLACES: Final = {"_s": 9, "_ns": 0}  # decimal places of a nanosecond in the unit that ends the column's name
_CONTEXT: Final = decimal.Context(prec=40, Emax=decimal.MAX_EMAX, Emin=decimal.MIN_EMIN)


def _read_csv(path: Path, source: str) -> tuple[Layout, IntArray, dict[str, FloatArray]]:
    """Read the rows of a CSV table: its layout, the times, and the other columns, each in the unit of its name."""
    # Blank lines at the end are accepted; one in the middle is a row without values, and is refused as such.
    content = files.read_bytes(path, MAX_TABLE_BYTES).removeprefix(b"\xef\xbb\xbf").rstrip(b"\r\n")
    if max(content.count(b"\n"), content.count(b"\r")) > MAX_ROWS:
        raise InputError(source, f"has more rows than the limit of {MAX_ROWS:,}: split it, and use --carry")
    files.decode_utf8(content, path)
    reader = csv.reader(io.TextIOWrapper(io.BytesIO(content), encoding="utf-8", newline=""), strict=True)
    names = _header(content, reader, source)
    layout = lay_out(names, source)
    times, channels = [], {name: [np.zeros(0)] for name in layout.channels}
    first = row = reader.line_num + 1  # as a person counts: the header is row 1
    for rows in _rows(reader, len(names), source):
        times.append(_nanoseconds([fields[layout.time_at].strip() for fields in rows], layout.time, source, row))
        for name, at in layout.channels.items():
            channels[name].append(_numbers([fields[at].strip() for fields in rows], name, source, row))
        row += len(rows)
    check_rows(row - first, source)
    time_ns = np.concatenate(times)
    _check_time(time_ns, layout.time, source, first)
    return layout, time_ns, {name: np.concatenate(parts) for name, parts in channels.items()}


def write_csv(samples: Samples, path: Path) -> None:
    """Write samples as a CSV that `read_table` reads back bit for bit; the same samples give the same bytes.

    Time is written in nanoseconds, values with the fewest digits that reproduce them, NaN as an empty field.
    """
    names, arrays = zip(*samples.channels(), strict=True)
    with files.atomic_write(path) as part, part.open("w", encoding="ascii", newline="") as file:
        file.write(f"{','.join(names)}\n")
        for first in range(0, len(samples), ROWS_AT_ONCE):
            columns = [_texts(values[first : first + ROWS_AT_ONCE]) for values in arrays]
            file.writelines(f"{','.join(fields)}\n" for fields in zip(*columns, strict=True))


def _texts(values: FloatArray | IntArray) -> list[str]:
    """Return numbers as they are written: the fewest digits, no `.0`, nothing for NaN."""
    return [repr(value).removesuffix(".0").replace("nan", "") for value in values.tolist()]


def _header(content: bytes, reader: Any, source: str) -> list[str]:
    """Return the names in the first row."""
    if not re.match(rb"[^\r\n]{1,%d}(?![^\r\n])" % files.PIECE_BYTES, content):
        reason = f"has no header of at most {files.PIECE_BYTES:,} bytes"
        raise InputError(source, reason, "row 1")
    try:
        names = [name.strip() for name in next(reader)]
    except csv.Error as error:
        raise InputError(source, f"is no CSV: {error}", "row 1") from error
    if reader.line_num > 1:
        raise InputError(source, "is no CSV: a field in quotes has no end in its row", "row 1")
    if any("\x00" in name for name in names):
        raise InputError(source, "is no CSV: its first row holds zero bytes", "row 1")
    if len(names) == 1 and (other := re.search("[;\t#]", names[0])):
        reason = f"holds {other[0]!r} and no comma: the first row is the names of the columns, separated by commas"
        raise InputError(source, reason, "row 1")
    return names


def _rows(reader: Any, count: int, source: str) -> Iterator[list[list[str]]]:
    """Yield the rows after the header, many at once, as their fields; an empty line is a row of empty fields."""
    done = reader.line_num
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
            # `float` also accepts 1_0 and digits of other scripts.
            values[at] = float(text or "nan") if text.isascii() and "_" not in text else float("")
        except ValueError as error:
            raise InputError(source, f"{text[:40]!r} is not a number", f"row {row + at}, column {column}") from error
    return values


def _nanoseconds(texts: Sequence[str], column: str, source: str, row: int) -> IntArray:
    """Return times [ns] from their texts in s or ns, in decimal arithmetic throughout."""
    times, places = np.empty(len(texts), dtype=np.int64), _PLACES[column[column.rindex("_") :]]
    for at, text in enumerate(texts):
        time_or_reason = _nanoseconds_of(text, places)
        if isinstance(time_or_reason, str):
            raise InputError(source, time_or_reason, f"row {row + at}, column {column}")
        times[at] = time_or_reason
    return times


def _nanoseconds_of(text: str, places: int) -> int | str:
    """Return one time in 10^-places s, rounded to the nearest, or the reason why it is none."""
    if not text:
        return "is empty; every row needs a time"
    if not _DECIMAL.fullmatch(text):
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


WRITERS: Final[dict[str, Callable[[Samples, Path], None]]] = {
    ".csv": write_csv,
    ".parquet": lambda samples, path: write_parquet(dict(samples.channels()), path),
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


# ---- Parquet: the same columns as numbers; null is a value that was not measured (NaN) -------------------------------


MAX_UNPACKED_BYTES: Final = 4_000_000_000  # of all columns; 20 million rows of 7 channels are 1.3 GB


def _read_parquet(path: Path, source: str) -> tuple[Layout, IntArray, dict[str, FloatArray]]:
    """Read the rows of a Parquet table, as `_read_csv` does; the first is row 1."""
    pa = arrow()
    with files.refusing(path):
        try:
            if path.stat().st_size > MAX_TABLE_BYTES:
                raise InputError(source, f"is larger than the limit of {MAX_TABLE_BYTES:,} bytes")
            with pa.parquet.ParquetFile(path, pre_buffer=False, page_checksum_verification=True) as file:
                layout = lay_out(file.schema_arrow.names, source)
                _check_footer(file, (layout.time, *layout.channels), source)
                table = _read_columns(file, [layout.time, *layout.channels], source)
        except (pa.ArrowException, EOFError, UnicodeDecodeError, OSError) as error:
            if getattr(error, "errno", None) is not None:  # without a code Arrow reports damaged pages so
                raise
            raise InputError(source, f"is no readable Parquet file: {files.first_line(error)}") from error
    time_ns = _column_nanoseconds(table[layout.time], layout.time, source)
    _check_time(time_ns, layout.time, source, 1)
    return layout, time_ns, {name: _column_numbers(table[name]) for name in layout.channels}


def _check_footer(file: Any, columns: Sequence[str], source: str) -> None:
    """Raise InputError where the footer states too many rows or bytes, or a wanted column without numbers."""
    metadata, schema, types = file.metadata, file.schema_arrow, arrow().types
    numbers = types.is_null, types.is_integer, types.is_floating, types.is_decimal  # without any value: one of NaN
    check_rows(metadata.num_rows, source)
    for name in columns:
        kind = schema.field(name).type
        if not any(is_kind(kind) for is_kind in numbers):
            raise InputError(source, f"holds {kind}, not numbers", f"column {name}")
    # Of all columns: reading the size of a single one in a damaged file ends the process (pyarrow 26, uncaught error).
    unpacked = sum(metadata.row_group(at).total_byte_size for at in range(metadata.num_row_groups))
    if unpacked > MAX_UNPACKED_BYTES:
        raise InputError(source, f"unpacks to {unpacked:,} bytes; the limit is {MAX_UNPACKED_BYTES:,}")


def _read_columns(file: Any, names: list[str], source: str) -> Any:
    """Return columns as a table, read in pieces: a row group may claim more rows than memory holds, the footer few."""
    pa = arrow()
    promised, batches, rows = file.metadata.num_rows, [], 0
    # On this thread: Arrow's own threads take half as much time again in total, and compete with the other processes
    # where many recordings are read at once.
    for batch in file.iter_batches(batch_size=ROWS_AT_ONCE, columns=names, use_threads=False):
        rows += len(batch)
        if rows > promised:
            break
        batches.append(batch)
    if rows != promised:
        raise InputError(source, f"holds {'more' if rows > promised else 'fewer'} rows than its footer states")
    return pa.Table.from_batches(batches)


def write_parquet(columns: Mapping[str, NDArray[Any]], path: Path) -> None:
    """Write arrays of one length as a Parquet table that is read back bit for bit; NaN stays NaN."""
    pa = arrow()
    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    with files.atomic_write(path) as part:
        # With checksums, a bit error on a disk raises an error when the table is read, instead of another number.
        pa.parquet.write_table(table, part, compression="zstd", write_page_checksum=True)


def _column_numbers(column: Any) -> FloatArray:
    """Return a column's values as float64, null as NaN."""
    pa = arrow()
    return np.asarray(pa.compute.cast(column, pa.float64(), safe=False).to_numpy(), dtype=np.float64)


def _column_nanoseconds(column: Any, name: str, source: str) -> IntArray:
    """Return the times [ns] of a column in s or ns."""
    pa = arrow()
    missing = pa.compute.index(pa.compute.is_null(column), True).as_py()
    if missing >= 0:
        raise InputError(source, "is empty; every row needs a time", f"row {missing + 1}, column {name}")
    if name.endswith("_ns"):
        if not pa.types.is_integer(column.type):
            raise InputError(source, f"holds {column.type}, not integers", f"column {name}")
        try:
            return np.asarray(pa.compute.cast(column, pa.int64()).to_numpy(), dtype=np.int64)
        except pa.ArrowInvalid as error:
            raise InputError(source, "holds a time beyond 64 bits of nanoseconds", f"column {name}") from error
    seconds = _column_numbers(column)
    # Whole seconds and the rest separately: multiplied by 1e9 together, late times would lose their last digits.
    whole = np.floor(seconds)
    usable = np.abs(whole) < np.iinfo(np.int64).max // NANOSECONDS_PER_SECOND
    if not usable.all():
        at = int(np.argmin(usable))
        reason = f"{seconds[at]} is not a time that 64 bits of nanoseconds hold"
        raise InputError(source, reason, f"row {at + 1}, column {name}")
    rest_ns = np.rint((seconds - whole) * NANOSECONDS_PER_SECOND)
    return whole.astype(np.int64) * NANOSECONDS_PER_SECOND + rest_ns.astype(np.int64)
