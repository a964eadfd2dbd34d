"""`replay`: runs a recording's inputs through the same core again; checks that the results agree, or publishes them."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from rwa_monitor.cli.console import FAILED, UNREADABLE, log, status_line, stop_on_signals
from rwa_monitor.cli.options import FILE, bus_options, speed_option, warn_if_alone

if TYPE_CHECKING:
    from rwa_monitor.monitor.bus import BusOptions

NANOSECONDS_PER_SECOND: Final = 1_000_000_000  # as in samples.py, which brings NumPy with it
MICROSECOND_NS: Final = 1_000
MOST_S: Final = 2**62 // NANOSECONDS_PER_SECOND  # what a clock of ns in 64 bits holds, and sums of two times, too


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
    """Return the time on a wheel's clock [ns] that a person wrote: ISO 8601, in UTC where no zone is given, or s.

    Raises
    ------
    ValueError
        If it is neither, or lies beyond what a clock of ours holds.

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


@click.command(name="replay", short_help="Re-run a recording, and check that the results agree.")
@click.argument("recordings", nargs=-1, required=True, type=FILE, metavar="RECORDING...")
@click.option("--verify", is_flag=True, help="Compare with what the recording holds, to 1e-9 relative.")
@click.option("--exact", is_flag=True, help="Demand equal bytes; means --verify.")
@click.option("--long", "long_report", is_flag=True, help="List every difference, not only their number per field.")
@click.option(
    "--from",
    "from_ns",
    type=Moment(),
    metavar="TIME",
    help="Print, or publish, only what is of this time or later: 2026-09-17T03:00Z, or seconds of the wheels' clock.",
)
@click.option("--publish", is_flag=True, help="Publish the recorded inputs on the bus instead.")
@speed_option
@bus_options
def command(
    recordings: tuple[Path, ...],
    verify: bool,
    exact: bool,
    long_report: bool,
    from_ns: int | None,
    publish: bool,
    speed: float,
    bus: BusOptions,
) -> int:
    """Re-run a recording: a file, or a folder as a chain of files.

    All of it is run, for a diagnosis depends on what was before; --from leaves out what was before only from what is
    printed. Without --verify the replayed messages are printed, one JSON object {topic, message} a line. With it, the
    report; the exit code is 1 when something differs. It is 3 when all that could be read agrees, and something could
    not.
    """
    from rwa_monitor.monitor.replay import replay

    compare = verify or exact
    if publish and compare:
        raise click.UsageError("--publish only sends; it cannot be combined with --verify or --exact")
    if from_ns is not None and compare:
        raise click.UsageError("--verify and --exact compare all of a recording; they take no --from")
    paths = recordings[0] if len(recordings) == 1 else recordings
    if publish:
        return _publish(paths, speed, from_ns, bus)
    with status_line("replaying") as progress:
        report = replay(paths, lambda done: progress(f"{done:,} messages"), from_ns)
    if compare:
        click.echo(report.long() if long_report else report.short())
    else:
        for topic, message in report.messages:
            click.echo(json.dumps({"topic": topic, "message": json.loads(message)}, ensure_ascii=False))
    log(*report.notes, *report.unreadable)
    # A difference weighs more than what could not be read.
    if (compare and not report.equal) or (exact and not report.bytes_equal):
        return FAILED
    return UNREADABLE if report.unreadable else 0


def _publish(paths: Path | tuple[Path, ...], speed: float, from_ns: int | None, bus: BusOptions) -> int:
    """Send the recorded inputs in the pace of their own time."""
    from rwa_monitor.monitor.bus import open_session
    from rwa_monitor.monitor.publisher import replay_to_bus
    from rwa_monitor.words import counted

    warn_if_alone(bus)
    with stop_on_signals() as stop, open_session(bus) as session:
        sent = replay_to_bus(paths, session, speed=speed, from_ns=from_ns, stop=stop)
    log(f"{counted(sent, 'message')} published")
    return 0
