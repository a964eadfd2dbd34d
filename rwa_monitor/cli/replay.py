"""`replay`: runs a recording's inputs through the same core again; checks that it says the same, or publishes them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rwa_monitor.cli.exit_codes import FAILED, UNREADABLE
from rwa_monitor.cli.moment import Moment
from rwa_monitor.cli.options import FILE, bus_options, speed_option, warn_if_alone
from rwa_monitor.cli.progress import counting
from rwa_monitor.cli.talk import say

if TYPE_CHECKING:
    from rwa_monitor.live.bus import BusOptions
    from rwa_monitor.live.replay import Report


@click.command(name="replay", short_help="Re-run a recording, and check that it says the same.")
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
@click.pass_context
def command(
    ctx: click.Context,
    recordings: tuple[Path, ...],
    verify: bool,
    exact: bool,
    long_report: bool,
    from_ns: int | None,
    publish: bool,
    speed: float,
    bus: BusOptions,
) -> None:
    """Re-run a recording: a file, or a folder as a chain of files.

    All of it is run, for a diagnosis depends on what was before; --from leaves out what was before only from what is
    told. Without --verify the replayed messages are printed, one JSON object {topic, message} a line. With it, the
    report; the exit code is 1 when something differs. It is 3 when all that could be read agrees, and something could
    not.
    """
    from rwa_monitor.live.replay import replay

    if publish and (verify or exact):
        raise click.UsageError("--publish only sends; it cannot be combined with --verify or --exact")
    if from_ns is not None and (verify or exact):
        raise click.UsageError("--verify and --exact compare all of a recording; they take no --from")
    paths = recordings[0] if len(recordings) == 1 else recordings
    if publish:
        _publish(paths, speed, from_ns, bus)
        return
    with counting("replaying", "messages") as on_message:
        report = replay(paths, on_message, from_ns)
    if verify or exact:
        click.echo(report.long() if long_report else report.short())
    else:
        for topic, message in report.messages:
            click.echo(json.dumps({"topic": topic, "message": json.loads(message)}, ensure_ascii=False))
    for line in (*report.notes, *report.unreadable):
        say(line)
    ctx.exit(_status(report, verify, exact))


def _status(report: Report, verify: bool, exact: bool) -> int:
    """Return the exit code: a difference weighs more than what could not be read."""
    if (verify or exact) and not report.equal:
        return FAILED
    if exact and not report.bytes_equal:
        return FAILED
    return UNREADABLE if report.unreadable else 0


def _publish(paths: Path | tuple[Path, ...], speed: float, from_ns: int | None, bus: BusOptions) -> None:
    """Send the recorded inputs in the pace of their own time."""
    from rwa_monitor.cli.signals import stop_on_signals
    from rwa_monitor.live.bus import open_session
    from rwa_monitor.live.replay import replay_to_bus
    from rwa_monitor.words import counted

    warn_if_alone(bus)
    with stop_on_signals() as stop, open_session(bus) as session:
        sent = replay_to_bus(paths, session, speed=speed, from_ns=from_ns, stop=stop)
    say(f"{counted(sent, 'message')} published")
