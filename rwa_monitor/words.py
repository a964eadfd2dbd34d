"""The name of the program in its output, and text for times, counts and lists.

The version of the installed package, which names the commit it was built from, is `rwa_monitor.__version__`.
"""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from rwa_monitor.samples import NANOSECONDS_PER_SECOND

# The release that computed a result, for output that must be the same bytes wherever and whenever it is made. Raised by
# hand with a release that changes a diagnosis. The package's version is not used there: it counts commits, so that
# equal diagnoses would differ.
RELEASE: Final = "0.1.0"
SOFTWARE: Final = f"rwa-monitor {RELEASE}"
# A clock with an earlier time is taken not to count from 1970, and so not to give UTC.
FIRST_UTC_NS: Final = int(np.datetime64("1990", "ns").astype(np.int64))
Log = Callable[[str], None]  # takes a line of a log
FEW: Final = 8  # names in one line


def time_text(time_ns: int) -> str:
    """Return a time on a wheel's clock as ISO 8601 UTC with milliseconds, or in seconds where it gives no UTC.

    Examples
    --------
    >>> time_text(1_788_220_800_004_000_000)
    '2026-09-01T00:00:00.004Z'
    >>> time_text(10_000_000_000)
    '10.000 s'
    """
    if time_ns < FIRST_UTC_NS:
        return f"{time_ns / NANOSECONDS_PER_SECOND:.3f} s"
    return f"{np.datetime64((time_ns + 500_000) // 1_000_000, 'ms')}Z"


def counted(count: int, what: str) -> str:
    """Return a count with what is counted, in the singular or plural.

    Examples
    --------
    >>> counted(1, "window"), counted(12_500, "sample")
    ('1 window', '12500 samples')
    """
    return f"{count} {what}{'' if count == 1 else 's'}"


def first_few(names: Sequence[str]) -> str:
    """Return a list of names in one line, with the number of those beyond the first `FEW`.

    Examples
    --------
    >>> first_few(["rw1", "rw2"]), first_few([f"rw{n}" for n in range(10)])
    ('rw1, rw2', 'rw0, rw1, rw2, rw3, rw4, rw5, rw6, rw7 and 2 more')
    """
    more = f" and {len(names) - FEW} more" if len(names) > FEW else ""
    return f"{', '.join(names[:FEW])}{more}"
