"""`recover`: saves what a cut or damaged recording still holds."""

from __future__ import annotations

from pathlib import Path

import click

from rwa_monitor.cli.exit_codes import UNREADABLE
from rwa_monitor.cli.options import FILE
from rwa_monitor.cli.talk import say


@click.command(name="recover", short_help="Save what a damaged recording still holds.")
@click.argument("recording", type=FILE, metavar="FILE.mcap")
@click.option("-o", "--output", type=FILE, required=True, metavar="OUT.mcap", help="Where to write; must not exist.")
@click.pass_context
def command(ctx: click.Context, recording: Path, output: Path) -> None:
    """Save every whole chunk of a cut or damaged recording, and only true messages.

    What is lost is said on stderr, and the exit code is 3 then; so is, of each wheel, from when to when its samples
    are saved.
    """
    from rwa_monitor.live.recover import recover
    from rwa_monitor.words import counted

    recovery = recover(recording, output)
    for line in recovery.lost:
        say(line)
    for line in recovery.spans:
        say(line)
    say(f"{output}: {counted(recovery.messages, 'message')} saved")
    ctx.exit(UNREADABLE if recovery.lost else 0)
