"""`identify` learns a wheel file from recordings of one healthy wheel; `train` the classifiers from labelled ones."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rwa_monitor.cli import options as cli
from rwa_monitor.errors import InputError

if TYPE_CHECKING:
    from rwa_monitor.wheel.wheel import Wheel


start_option = cli.option(
    "--wheel",
    cli.FILE,
    "START.toml",
    "What is known already: name, motor constants, limits.  [default: name and sample period from the data]",
)


@click.command(short_help="Learn a wheel's nominal friction, noise and switching laws.")
@cli.option("-o --output", cli.FILE, "W.toml", "Wheel file to write.", required=True)
@cli.as_one("start", cli.known_wheel, start_option, cli.motor_off_option)
@cli.flag("--no-systems", "Learn nominal friction and noise only, for short recordings.")
@cli.recordings_options
def identify(output: Path, start: Wheel | None, no_systems: bool, recordings: cli.Recordings) -> int:
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


@click.command(short_help="Learn the classifiers from labelled recordings.")
@click.argument("labels_file", type=cli.FILE, metavar="LABELS.csv")
@cli.option("--wheel", cli.FILE, "W.toml", "Constants of the wheel.", required=True)
@cli.option("-o --output", cli.FILE, "MODEL.json", "Where to write the model.", required=True)
@cli.scheduler_option
@cli.workers_option
def train(labels_file: Path, wheel: Path, output: Path, scheduler: str | None, workers: int | None) -> None:
    """Learn the classifiers from labelled recordings.

    LABELS.csv has the columns file,dry,viscous,<switching systems>, with 0 or 1; file names are relative to it, and a
    label holds for all windows of its file. A last window that is not full is left out where there are full ones. A
    file with a wheel of its own beside it (FILE.wheel.toml, as `simulate dataset` writes it) is read with that one.
    """
    from rwa_monitor.batch.tasks import ReadFeatures, map_files
    from rwa_monitor.diagnosis.training import LabelledFeatures, train
    from rwa_monitor.monitor.setup import read_wheel
    from rwa_monitor.paper.classification import with_classifiers
    from rwa_monitor.telemetry.files import display_name, write_text
    from rwa_monitor.telemetry.labels import read_labels
    from rwa_monitor.words import counted

    constants = read_wheel(wheel)
    files = read_labels(labels_file)
    reader = ReadFeatures(constants)
    outcomes = map_files(reader, [file.path for file in files], scheduler=scheduler, workers=workers)
    joint, paper, failed = [], [], 0
    for file, outcome in zip(files, cli.track(outcomes, len(files), "reading windows"), strict=True):
        if outcome.result is None:
            cli.log(outcome.error)
            failed += 1
        else:
            joint += [LabelledFeatures(features, file.anomalies) for features, _ in outcome.result]
            paper += [LabelledFeatures(features, file.anomalies) for _, features in outcome.result]
    if failed:
        # Otherwise nobody would notice that the model was learned from only some of the labelled files.
        raise InputError(
            display_name(labels_file), f"{failed} of {len(files)} files cannot be used; nothing is written"
        )
    names = [display_name(path) for path in (labels_file, wheel, output)]
    again = shlex.join(["rwa-monitor", "train", names[0], "--wheel", names[1], "-o", names[2]])
    model = with_classifiers(train(joint, constants, source=labels_file.name, command=again), paper)
    write_text(output, model.to_json())
    cli.log(f"{names[2]}: learned from {counted(len(joint), 'window')} of {counted(len(files), 'file')}")
