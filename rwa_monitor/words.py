"""How times, counts and lists are told to a person."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from typing import Final

import numpy as np

from rwa_monitor.samples import NANOSECONDS_PER_SECOND

FIRST_UTC_S: Final = 631_152_000  # 1990: a clock that tells less does not count from 1970, so that it tells no UTC
MILLISECOND_NS: Final = 1_000_000
MICROSECOND_NS: Final = 1_000
MOST_S: Final = 2**62 // NANOSECONDS_PER_SECOND  # what a clock of ns in 64 bits tells, and sums of two times, too


def time_text(time_ns: int) -> str:
    """Return a time on a wheel's clock as ISO 8601 UTC with milliseconds, or in seconds where it tells no UTC.

    Examples
    --------
    >>> time_text(1_788_220_800_004_000_000)
    '2026-09-01T00:00:00.004Z'
    >>> time_text(10_000_000_000)
    '10.000 s'
    """
    if time_ns < FIRST_UTC_S * NANOSECONDS_PER_SECOND:
        return f"{time_ns / NANOSECONDS_PER_SECOND:.3f} s"
    return f"{np.datetime64((time_ns + MILLISECOND_NS // 2) // MILLISECOND_NS, 'ms')}Z"


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


def counted(count: int, what: str) -> str:
    """Return a count with what is counted, in the singular or plural.

    Examples
    --------
    >>> counted(1, "window"), counted(12_500, "sample")
    ('1 window', '12500 samples')
    """
    return f"{count} {what}{'' if count == 1 else 's'}"


def is_or_are(count: int) -> str:
    """Return the verb that goes with `counted`."""
    return "is" if count == 1 else "are"


def first_few(names: Sequence[str], most: int) -> str:
    """Return a list of names in one line, with the number of those beyond the first `most`.

    Examples
    --------
    >>> first_few(["rw1", "rw2", "rw3"], 2), first_few(["rw1", "rw2"], 2)
    ('rw1, rw2 and 1 more', 'rw1, rw2')
    """
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(names[:most])}{more}"
