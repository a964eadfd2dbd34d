"""`identify`: a wheel file learned from recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rwa_monitor.cli.console import log, status_line
from rwa_monitor.cli.options import FILE, motor_off_option
from rwa_monitor.cli.recordings import AT_ONCE, Recordings, known_wheel, recordings_options

if TYPE_CHECKING:
    from rwa_monitor.batch.tasks import Identify


@click.command(name="identify", short_help="Learn a wheel's nominal friction, noise and switching laws.")
@click.option(
    "-o", "--output", required=True, type=FILE, metavar="W.toml", help="Wheel file to write; with --each the folder."
)
@click.option(
    "--wheel",
    "wheel_file",
    type=FILE,
    metavar="START.toml",
    help="What is known already: name, motor constants, limits.  [default: name and sample period from the data]",
)
@motor_off_option
@click.option("--no-systems", is_flag=True, help="Learn nominal friction and noise only, for short recordings.")
@click.option("--each", is_flag=True, help="Each file is a wheel of its own: a wheel file for each, many at once.")
@recordings_options
def command(
    output: Path,
    wheel_file: Path | None,
    motor_off: bool,
    no_systems: bool,
    each: bool,
    recordings: Recordings,
) -> int:
    """Learn a wheel file from recordings of one healthy wheel.

    Where there is too little data to learn a switching system's law, nothing is written and the command reports how
    much more is needed. What is learned is taken for nominal, so a failing wheel's recordings hide its failure: the
    command reports drifting friction, and diagnoses the recordings with the wheel file, which is not written where they
    are anomalous with it. With --each the files are learned one by one, side by side.
    """
    from rwa_monitor.batch.tasks import Identify, not_nominal
    from rwa_monitor.discrepancy.bench import as_measured
    from rwa_monitor.identification.identify import bare_wheel, identify
    from rwa_monitor.telemetry.files import write_text

    start = known_wheel(wheel_file, motor_off=motor_off)
    if each:
        return _each(recordings, output, Identify(start, recordings.decoding, not no_systems))
    if recordings.at_once:
        raise click.UsageError(f"{AT_ONCE} need --each: several files are one wheel")
    samples, start = recordings.of_one_wheel(start)
    bench = as_measured(samples, start or bare_wheel(recordings.files[0].stem, samples[0][1]))
    log(*bench.notes)
    with status_line("learning"):
        learned = identify(bench.recordings, bench.wheel, systems=not no_systems)
    with status_line("diagnosing what was learned from"):
        warning = not_nominal(bench.recordings, learned.wheel)
    head = "".join(f"# {note}\n" for note in learned.notes)
    write_text(output, head + learned.wheel.to_toml())
    log(*learned.notes)
    log(f"written to {output}")
    log(warning)
    return recordings.status


def _each(recordings: Recordings, folder: Path, task: Identify) -> int:
    """Learn a wheel from each file, and return the exit code."""
    from rwa_monitor.telemetry.files import make_folder, write_text
    from rwa_monitor.words import counted

    names = [f"{file.name}.wheel.toml" for file in recordings.files]
    if len(set(names)) < len(names):
        raise click.UsageError("with --each the files need different names: each names its wheel file")
    if folder.suffix == ".toml" and not folder.is_dir():
        raise click.UsageError("with --each -o names a folder: each recording gets a wheel file of its own there")
    make_folder(folder)
    written = 0
    for done in recordings.each(task, "learning"):
        for row in done.rows:
            write_text(folder / f"{Path(row['source']).name}.wheel.toml", row["message"])
            written += 1
    log(f"{counted(written, 'wheel file')} of {counted(len(names), 'recording')} written to {folder}")
    return recordings.status
