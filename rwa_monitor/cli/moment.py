"""Times that a person gives on the command line."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from decimal import Decimal
from typing import Any, Final

import click

NANOSECONDS_PER_SECOND: Final = 1_000_000_000  # as in samples.py, which brings NumPy with it
MICROSECOND_NS: Final = 1_000
MOST_S: Final = 2**62 // NANOSECONDS_PER_SECOND  # what a clock of ns in 64 bits tells, and sums of two times, too


class Moment(click.ParamType[int]):
    """A time on the wheels' clock [ns], given as ISO 8601 in UTC or in seconds."""

    name = "time"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the time."""
        try:
            return value if isinstance(value, int) else time_of(value)
        except ValueError:
            self.fail(f"{value!r} is no time such as 2026-09-17T03:00Z, or 1234.5 on a clock in seconds", param, ctx)


def time_of(text: str) -> int:
    """Return the time on a wheel's clock [ns] that a person wrote: ISO 8601, in UTC where nothing else is said, or s.

    Raises
    ------
    ValueError
        If it is neither, or lies beyond what a clock of ours tells.

    Examples
    --------
    >>> time_of("2026-09-01"), time_of("2026-09-01T02:00+02:00"), time_of("10.5")
    (1788220800000000000, 1788220800000000000, 10500000000)
    """
    try:
        seconds = Decimal(text.removesuffix("s").strip())
    except ArithmeticError:
        moment = datetime.fromisoformat(text.strip())
        since = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)) - datetime(1970, 1, 1, tzinfo=UTC)
        return since // timedelta(microseconds=1) * MICROSECOND_NS
    if not seconds.is_finite() or abs(seconds) > MOST_S:
        raise ValueError(f"{text} s lies beyond every clock")
    return int(seconds * NANOSECONDS_PER_SECOND)
