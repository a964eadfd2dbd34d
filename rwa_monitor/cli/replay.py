"""`replay` runs a recording's inputs through the same core again; `recover` and `foxglove` copy recordings."""

from __future__ import annotations

import json
from pathlib import Path

import click

from rwa_monitor.cli import options as cli


@click.command(short_help="Re-run a recording, and check that the results agree.")
@click.argument("recordings", nargs=-1, required=True, type=cli.FILE, metavar="RECORDING...")
@cli.flag("--verify", "Compare with what the recording holds, to 1e-9 relative.")
@cli.flag("--exact", "Demand equal bytes; means --verify.")
@cli.flag("--long", "List every difference, not only their number per field.")
@cli.flag("--publish", "Publish the recorded inputs on the bus instead.")
@cli.speed_option
@cli.bus_options
def replay(
    recordings: tuple[Path, ...],
    verify: bool,
    exact: bool,
    long: bool,
    publish: bool,
    speed: float,
    bus: cli.BusOptions,
) -> int:
    """Re-run a recording: a file, or a folder as a chain of files.

    Without --verify the replayed messages are printed, one JSON object {topic, message} a line. With it, the report;
    the exit code is 1 when something differs. It is 3 when all that could be read agrees, and something could not.
    """
    from rwa_monitor.monitor.replay import replay

    compare = verify or exact
    if publish and compare:
        raise click.UsageError("--publish only sends; it cannot be combined with --verify or --exact")
    if publish:
        return _publish(recordings, speed, bus)
    with cli.status_line("replaying") as progress:
        report = replay(recordings, lambda recording, _: progress(f"{recording.share:.0%} of {recording.path.name}"))
    if compare:
        click.echo(report.long() if long else report.short())
    else:
        for topic, message in report.messages:
            click.echo(json.dumps({"topic": topic, "message": json.loads(message)}, ensure_ascii=False))
    cli.log(*report.notes, *report.unreadable)
    # A difference takes precedence over parts that could not be read.
    if (compare and not report.equal) or (exact and not report.bytes_equal):
        return cli.FAILED
    return cli.UNREADABLE if report.unreadable else 0


def _publish(paths: tuple[Path, ...], speed: float, bus: cli.BusOptions) -> int:
    """Send the recorded inputs, paced by their own time."""
    from rwa_monitor.monitor.replay import replay_to_bus
    from rwa_monitor.words import counted

    with cli.on_bus(bus) as (stop, session):
        sent = replay_to_bus(paths, session, speed=speed, stop=stop)
    cli.log(f"{counted(sent, 'message')} published")
    return 0


# ---- copies of recordings --------------------------------------------------------------------------------------------


@click.command(short_help="Save what a damaged recording still holds.")
@click.argument("recording", type=cli.FILE, metavar="FILE.mcap")
@cli.recording_output_option
def recover(recording: Path, output: Path) -> int:
    """Save every whole chunk of a cut or damaged recording, and only true messages.

    What is lost is logged on stderr, and the exit code is 3 then.
    """
    from rwa_monitor.monitor.recorder import recover
    from rwa_monitor.words import counted

    saved = recover(recording, output)
    cli.log(*saved.problems, f"{output}: {counted(saved.messages, 'message')} saved")
    return cli.UNREADABLE if saved.problems else 0


@click.command(short_help="Recordings for Foxglove, with a layout.")
@click.argument("recordings", nargs=-1, required=True, type=cli.FILE, metavar="RECORDING...")
@cli.recording_output_option
def foxglove(recordings: tuple[Path, ...], output: Path) -> int:
    """Write recordings (files, or folders of them) as one MCAP file that Foxglove and Lichtblick plot.

    Every sample is a message, friction's parts and its jumps have topics, and what concerns an operator is a
    foxglove.Log. OUT.layout.json is the layout for it, and for the same wheels live (dashboard --foxglove).
    """
    from rwa_monitor.monitor.recorder import layout_of, write_foxglove
    from rwa_monitor.words import counted

    written = write_foxglove(recordings, output)
    found = f"{output}: {counted(written.messages, 'message')}; the layout for Foxglove is {layout_of(output)}"
    cli.log(*written.problems, found)
    return cli.UNREADABLE if written.problems else 0
