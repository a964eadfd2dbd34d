"""The columns of a sample table, whatever the file: names, units, limits, and the checks that every table must pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Final

import numpy as np

from rwa_monitor.errors import InputError
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, TABLE_CHANNELS, FloatArray, IntArray, Samples

TIME_COLUMNS: Final = ("time_ns", "time_s")  # the exact one first: it counts where a table has both
PULSE_COLUMNS: Final = ("pulse_time_ns", "pulse_time_s")  # of a table that is one of pulses, without a speed
SPEED, ANGLE, ANGLE_IN_DEGREES = "speed_rad_s", "angle_rad", "angle_deg"
_COLUMNS: Final = (*TABLE_CHANNELS, ANGLE_IN_DEGREES)
MAX_ROWS: Final = 20_000_000  # 29 days at 8 Hz, 1.1 GB with all channels
MAX_COLUMNS: Final = 1_000
MAX_TABLE_BYTES: Final = 2_000_000_000  # of a file
ROWS_AT_ONCE: Final = 50_000  # read or written; as texts they take 20 times the memory of their values
MAX_SPAN_NS: Final = 2**61  # 73 years: the slot of a sample is reckoned in int64 with twice its time


@dataclass(frozen=True, slots=True)
class SampleTable:
    """A table as it was read.

    Attributes
    ----------
    samples
        The telemetry; time strictly increases, there is at least one sample.
    ignored_columns
        Names of the columns that were left out, in the table's order.
    are_pulses
        Whether each row is a pulse of the wheel: its speed is then not measured, but follows from the times.
    notes
        What was made of the rows, a sentence each.
    """

    samples: Samples
    ignored_columns: tuple[str, ...]
    are_pulses: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Layout:
    """Which column of a table holds what.

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
    ignored: tuple[str, ...]


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
        there = ", ".join(repr(name[:40]) for name in names[:8])
        reason = f"is missing{others}; the table has {there}{', …' if len(names) > 8 else ''} (docs/formats.md)"
        raise InputError(source, reason, f"column {missing[0]}")
    channels = {name: names.index(name) for name in _COLUMNS if name in names}
    if {ANGLE, ANGLE_IN_DEGREES} <= channels.keys():
        raise InputError(source, f"is there beside {ANGLE}: leave one of them out", f"column {ANGLE_IN_DEGREES}")
    known = {time[0], *channels}
    ignored = tuple(name for name in names if name not in known)
    return Layout(time[0], names.index(time[0]), channels, ignored)


def check_rows(rows: int, source: str) -> None:
    """Raise InputError unless a table has at least one row and at most `MAX_ROWS`."""
    if rows == 0:
        raise InputError(source, "has no rows")
    if rows > MAX_ROWS:
        raise InputError(source, f"has {rows:,} rows; the limit is {MAX_ROWS:,}: split it, and use --carry")


def table_of(
    time_ns: IntArray, columns: Mapping[str, FloatArray], layout: Layout, source: str, first_row: int
) -> SampleTable:
    """Return a table once its time is checked.

    Parameters
    ----------
    time_ns, columns
        All rows, at least one: time, and the columns of the layout, each in the unit of its name.
    layout, source
        Of the table.
    first_row
        The row that the first sample stands in, as a person counts.

    Raises
    ------
    InputError
        If time does not strictly increase, or its span is too long.
    """
    channels = dict(columns)
    if ANGLE_IN_DEGREES in channels:
        channels[ANGLE] = np.radians(channels.pop(ANGLE_IN_DEGREES))
    are_pulses = layout.time in PULSE_COLUMNS
    if are_pulses:
        channels.setdefault(SPEED, np.full(time_ns.size, np.nan))
    samples = Samples(time_ns=time_ns, **channels)
    _check_time(samples, layout, source, first_row)
    return SampleTable(samples, layout.ignored, are_pulses)


def _check_time(samples: Samples, layout: Layout, source: str, first_row: int) -> None:
    """Raise InputError, naming the row, unless time strictly increases over a span that slots can count."""
    time_ns, column = samples.time_ns, layout.time
    late = time_ns[1:] <= time_ns[:-1]
    if late.any():
        at = int(np.argmax(late)) + 1
        before, here = (_as_written(int(time_ns[i]), column) for i in (at - 1, at))
        reason = f"time does not increase ({here} after {before}); sort the rows by time and leave repeated ones out"
        raise InputError(source, reason, f"row {first_row + at}, column {column}")
    span_ns = int(time_ns[-1]) - int(time_ns[0])  # Python's integers: the difference may exceed int64
    if span_ns >= MAX_SPAN_NS:
        raise InputError(source, f"covers {span_ns / NANOSECONDS_PER_SECOND:.3g} s, more than 73 years", column)


def _as_written(time_ns: int, column: str) -> str:
    """Write a time in the unit of its column, exactly."""
    if column.endswith("_ns"):
        return f"{time_ns} ns"
    return f"{Decimal(time_ns).scaleb(-9).normalize():f} s"
