"""`identify`: learns a wheel file from recordings of one healthy wheel."""

from __future__ import annotations

from pathlib import Path

import click

from rwa_monitor.cli import options as cli


@click.command(short_help="Learn a wheel's nominal friction, noise and switching laws.")
@cli.option("-o --output", cli.FILE, "W.toml", "Wheel file to write.", required=True)
@cli.option(
    "--wheel",
    cli.FILE,
    "START.toml",
    "What is known already: name, motor constants, limits.  [default: name and sample period from the data]",
)
@cli.motor_off_option
@cli.flag("--no-systems", "Learn nominal friction and noise only, for short recordings.")
@cli.recordings_options
def identify(
    output: Path,
    wheel: Path | None,
    motor_off: bool,
    no_systems: bool,
    recordings: cli.Recordings,
) -> int:
    """Learn a wheel file from recordings of one healthy wheel.

    Where there is too little data to learn a switching system's law, nothing is written and the command reports how
    much more is needed. What is learned is taken for nominal, so a failing wheel's recordings hide its failure: the
    command reports drifting friction, and diagnoses the recordings with the wheel file, which is not written where they
    are anomalous with it.
    """
    from rwa_monitor.batch.tasks import not_nominal
    from rwa_monitor.discrepancy.bench import as_measured
    from rwa_monitor.identification.identify import bare_wheel, identify
    from rwa_monitor.telemetry.files import write_text

    start = cli.known_wheel(wheel, motor_off=motor_off)
    samples, start = recordings.of_one_wheel(start)
    bench = as_measured(samples, start or bare_wheel(recordings.files[0].stem, samples[0][1]))
    cli.log(*bench.notes)
    with cli.status_line("learning"):
        learned = identify(bench.recordings, bench.wheel, systems=not no_systems)
    with cli.status_line("diagnosing what was learned from"):
        warning = not_nominal(bench.recordings, learned.wheel)
    head = "".join(f"# {note}\n" for note in learned.notes)
    write_text(output, head + learned.wheel.to_toml())
    cli.log(*learned.notes)
    cli.log(f"written to {output}")
    cli.log(warning)
    return recordings.status
