"""`identify`: a wheel file learned from recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rwa_monitor.cli.exit_codes import UNREADABLE
from rwa_monitor.cli.options import FILE
from rwa_monitor.cli.talk import say
from rwa_monitor.errors import InputError

if TYPE_CHECKING:
    from rwa_monitor.physics.wheel import Wheel
    from rwa_monitor.samples import Samples


@click.command(name="identify", short_help="Learn a wheel's nominal friction, noise and switching laws.")
@click.argument("files", nargs=-1, required=True, type=FILE, metavar="FILE...")
@click.option("-o", "--output", required=True, type=FILE, metavar="W.toml", help="Wheel file to write.")
@click.option(
    "--wheel",
    "wheel_file",
    type=FILE,
    metavar="START.toml",
    help="What is known already: name, motor constants, limits.  [default: name and sample period from the data]",
)
@click.option("--no-systems", is_flag=True, help="Learn nominal friction and noise only, for short recordings.")
@click.pass_context
def command(
    ctx: click.Context, files: tuple[Path, ...], output: Path, wheel_file: Path | None, no_systems: bool
) -> None:
    """Learn a wheel file from recordings of one healthy wheel.

    Where there is too little data to learn a switching system's law, nothing is written and the command says how much
    more is needed.
    """
    from rwa_monitor.cli.progress import status_line
    from rwa_monitor.cli.recordings import read_recordings
    from rwa_monitor.discrepancy.identification import identify
    from rwa_monitor.formats.files import write_text
    from rwa_monitor.formats.wheel_file import read_wheel

    start = read_wheel(wheel_file) if wheel_file else None
    recordings = read_recordings(files)
    start = start or recordings.wheel or _bare_wheel(files[0].stem, recordings.samples[0][1])
    with status_line("learning"):
        learned = identify(recordings.samples, start, systems=not no_systems)
    head = "".join(f"# {note}\n" for note in learned.notes)
    write_text(output, head + learned.wheel.to_toml())
    for note in learned.notes:
        say(note)
    say(f"written to {output}")
    ctx.exit(UNREADABLE if recordings.unreadable else 0)


def _bare_wheel(name: str, samples: Samples) -> Wheel:
    """Return a wheel of which only name and sample period are known."""
    import numpy as np

    from rwa_monitor.physics.wheel import Wheel
    from rwa_monitor.samples import NANOSECONDS_PER_SECOND

    if len(samples) < 2:
        raise InputError(name, "holds too few samples to tell the sample period")
    period_ns = float(np.median(np.diff(samples.time_ns)))
    return Wheel(name=name, sample_period_s=period_ns / NANOSECONDS_PER_SECOND)
