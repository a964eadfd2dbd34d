"""`recover`: saves what a cut or damaged recording still holds."""

from __future__ import annotations

from pathlib import Path

import click

from rwa_monitor.cli.console import UNREADABLE, log
from rwa_monitor.cli.options import FILE, recording_output_option


@click.command(name="recover", short_help="Save what a damaged recording still holds.")
@click.argument("recording", type=FILE, metavar="FILE.mcap")
@recording_output_option
def command(recording: Path, output: Path) -> int:
    """Save every whole chunk of a cut or damaged recording, and only true messages.

    What is lost is logged on stderr, and the exit code is 3 then; so is, of each wheel, from when to when its samples
    are saved.
    """
    from rwa_monitor.monitor.recording.copies import recover
    from rwa_monitor.words import counted

    recovery = recover(recording, output)
    log(*recovery.lost, *recovery.spans)
    log(f"{output}: {counted(recovery.messages, 'message')} saved")
    return UNREADABLE if recovery.lost else 0
