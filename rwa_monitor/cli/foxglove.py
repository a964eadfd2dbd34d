"""`foxglove`: recordings as Foxglove shows them."""

from __future__ import annotations

from pathlib import Path

import click

from rwa_monitor.cli.console import UNREADABLE, log
from rwa_monitor.cli.options import FILE, recording_output_option


@click.command(name="foxglove", short_help="Recordings for Foxglove, with a layout.")
@click.argument("recordings", nargs=-1, required=True, type=FILE, metavar="RECORDING...")
@recording_output_option
def command(recordings: tuple[Path, ...], output: Path) -> int:
    """Write recordings (files, or folders of them) as one MCAP file that Foxglove and Lichtblick plot.

    Every sample is a message, friction's parts and its jumps have topics, and what concerns an operator is a
    foxglove.Log. OUT.layout.json is the layout for it, and for the same wheels live (dashboard --foxglove).
    """
    from rwa_monitor.monitor.recording.copies import write_foxglove
    from rwa_monitor.words import counted

    written = write_foxglove(recordings, output)
    log(*written.problems)
    log(f"{output}: {counted(written.messages, 'message')}; the layout for Foxglove is {written.layout}")
    return UNREADABLE if written.problems else 0
