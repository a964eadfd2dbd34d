"""What a person can do about rows of a table whose time does not increase: a command, where rows only repeat others."""

from __future__ import annotations

import shlex
from typing import Final

import numpy as np

from rwa_monitor.samples import IntArray, Samples
from rwa_monitor.words import counted, first_few

LISTED: Final = 8  # rows that a line names
LONGEST_COMMAND: Final = 300  # characters; a message has room for no more
ROWS_OUT_OF_ORDER: Final = "sort the rows by time and leave repeated ones out"


def ordering_advice(samples: Samples, source: str, first_row: int, time_column: int, *, all_columns: bool) -> str:
    """Say what brings a table's rows into order.

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
    """Return the samples that say the same as an earlier one of their time, int64 (k,), in order.

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
