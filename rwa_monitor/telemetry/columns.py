"""The columns of a sample table, whatever the file: names, units, limits, and the checks that every table must pass."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Final

import numpy as np

from rwa_monitor.errors import InputError, closest
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, TABLE_CHANNELS, FloatArray, IntArray, Samples
from rwa_monitor.telemetry.foreign import header_hint
from rwa_monitor.words import counted, first_few

TIME_COLUMNS: Final = ("time_ns", "time_s")  # the exact one first: it counts where a table has both
PULSE_COLUMNS: Final = ("pulse_time_ns", "pulse_time_s")  # of a table that is one of pulses, without a speed
REQUIRED_CHANNELS: Final = ("speed_rad_s",)
# A column in another unit than the channel's: the channel, and what is its unit in that of the column.
IN_OTHER_UNITS: Final = {"angle_deg": ("angle_rad", np.pi / 180.0)}
_COLUMNS: Final = (*TABLE_CHANNELS, *IN_OTHER_UNITS)
MAX_ROWS: Final = 20_000_000  # 29 days at 8 Hz, 1.1 GB with all channels
MAX_COLUMNS: Final = 1_000
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
        Name → position in the table, in the order of `TABLE_CHANNELS`, those in other units last.
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
    missing = [name for name in REQUIRED_CHANNELS if name not in names]
    pulses = [name for name in PULSE_COLUMNS if name in names]
    if missing and pulses:
        time, missing = pulses, []
    if not time:
        missing = [" or ".join(reversed(TIME_COLUMNS)), *missing]
    if missing:
        raise InputError(source, _missing_columns(names, missing), f"column {missing[0]}")
    channels = {name: names.index(name) for name in _COLUMNS if name in names}
    for name, (channel, _) in IN_OTHER_UNITS.items():
        if name in channels and channel in channels:
            raise InputError(source, f"is there beside {channel}: leave one of them out", f"column {name}")
    known = {time[0], *channels}
    ignored = tuple(name for name in names if name not in known)
    return Layout(time[0], names.index(time[0]), channels, ignored)


def _missing_columns(names: Sequence[str], missing: list[str]) -> str:
    """Report what is missing, and what the table probably is instead."""
    reason = "is missing"
    if len(missing) > 1:
        reason += f", and so is {', '.join(missing[1:])}"
    if hint := header_hint(names):
        return f"{reason}; {hint}"
    shown = ", ".join(repr(name[:40]) for name in names[:8])
    near = _nearest_columns(names, missing)
    if len(missing) > 1:
        near += f"; a table of pulses has {PULSE_COLUMNS[1]} alone"
    elif {"angle_rad", *IN_OTHER_UNITS} & set(names):
        near += "; of an angle [rad] it is the slope, numpy.gradient(numpy.unwrap(angle_rad), time_s)"
    return f"{reason}; the table has {shown}{', …' if len(names) > 8 else ''}{near}"


def _nearest_columns(names: Sequence[str], missing: Sequence[str]) -> str:
    """Report which columns may be those that are missing, "" where none is near."""
    found = []
    for name in names[:MAX_COLUMNS]:
        meant = closest(name, [known for wanted in missing for known in wanted.split(" or ")])
        if meant is not None and "rpm" in name.lower():
            found.append(f"is {name[:40]!r} in rpm? Times 0.1047198 it is {meant}")
        elif meant is not None:
            found.append(f"is {name[:40]!r} in the unit of {meant}? Then rename it")
    return f"; {'; '.join(found)}" if found else ""


def unknown_columns(names: Sequence[str]) -> str:
    """Name columns that are left out, each with the known one that it may have been meant to be."""
    shown = []
    for name in names:
        meant = closest(name, (*TIME_COLUMNS, *PULSE_COLUMNS, *_COLUMNS))
        shown.append(f"{name} (did you mean {meant}?)" if meant else name)
    return ", ".join(shown)


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
    for name, (channel, factor) in IN_OTHER_UNITS.items():
        if name in channels:
            channels[channel] = factor * channels.pop(name)
    are_pulses = layout.time in PULSE_COLUMNS
    if are_pulses:
        channels.setdefault(REQUIRED_CHANNELS[0], np.full(time_ns.size, np.nan))
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
        advice = ordering_advice(samples, source, first_row, layout.time_at, all_columns=not layout.ignored)
        raise InputError(
            source,
            f"time does not increase ({here} after {before}); {advice}",
            f"row {first_row + at}, column {column}",
        )
    span_ns = int(time_ns[-1]) - int(time_ns[0])  # Python's integers: the difference may exceed int64
    if span_ns >= MAX_SPAN_NS:
        raise InputError(source, f"covers {span_ns / NANOSECONDS_PER_SECOND:.3g} s, more than 73 years", column)


def _as_written(time_ns: int, column: str) -> str:
    """Write a time in the unit of its column, exactly."""
    if column.endswith("_ns"):
        return f"{time_ns} ns"
    return f"{Decimal(time_ns).scaleb(-9).normalize():f} s"


# ---- advice on rows whose time does not increase ---------------------------------------------------------------------


LISTED: Final = 8  # rows that a line names
LONGEST_COMMAND: Final = 300  # characters; a message has room for no more
ROWS_OUT_OF_ORDER: Final = "sort the rows by time and leave repeated ones out"


def ordering_advice(samples: Samples, source: str, first_row: int, time_column: int, *, all_columns: bool) -> str:
    """Report what brings a table's rows into order.

    Parameters
    ----------
    samples
        All rows; their time does not strictly increase.
    source
        The file, as it was named.
    first_row
        The row that the first sample stands in, as a person counts.
    time_column
        The position of the time among the columns.
    all_columns
        Whether every column was read: two samples that are alike are then two lines that are alike.
    """
    repeated = _repeated(samples)
    left = np.delete(samples.time_ns, repeated)
    if not repeated.size or np.any(left[1:] <= left[:-1]):
        return ROWS_OUT_OF_ORDER
    rows = first_few([str(first_row + int(at)) for at in repeated], LISTED)
    repeats = f"row {rows} repeats an earlier one" if repeated.size == 1 else f"rows {rows} repeat earlier ones"
    return f"{repeats} exactly: leave {counted(repeated.size, 'row')} out{_command(source, time_column, all_columns)}"


def _command(source: str, time_column: int, all_columns: bool) -> str:
    """Return the command that does it, ready to be pasted; "" where a text tool cannot."""
    if not source.endswith(".csv"):
        return ""
    key = "$0" if all_columns else f"${time_column + 1}"
    separator = "" if all_columns else "-F, "
    new = f"{source.removesuffix('.csv')}_once.csv"
    command = f"awk {separator}'!seen[{key}]++' {shlex.quote(source)} > {shlex.quote(new)}"
    return f": {command}" if len(command) <= LONGEST_COMMAND else ""


def _repeated(samples: Samples) -> IntArray:
    """Return the samples that are the same as an earlier one of their time, int64 (k,), in order.

    A value that is missing in both is alike. Of those with one time each is compared with the first.
    """
    order = np.argsort(samples.time_ns, kind="stable")
    time_ns = samples.time_ns[order]
    begins = np.concatenate(([True], time_ns[1:] != time_ns[:-1]))
    first = order[np.maximum.accumulate(np.where(begins, np.arange(order.size), 0))]
    at, first = order[~begins], first[~begins]
    alike = np.ones(at.size, dtype=np.bool_)
    for _, values in samples.channels():
        here, before = values[at], values[first]
        alike &= (here == before) | (np.isnan(here) & np.isnan(before))
    return np.sort(at[alike])
