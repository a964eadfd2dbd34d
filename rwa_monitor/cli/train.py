"""`train`: labelled recordings in, a model out."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rwa_monitor.cli.options import FILE
from rwa_monitor.cli.progress import track
from rwa_monitor.cli.talk import say
from rwa_monitor.errors import InputError

if TYPE_CHECKING:
    from rwa_monitor.diagnosis.training import LabelledFeatures
    from rwa_monitor.formats.labels import LabelledFile
    from rwa_monitor.physics.wheel import Wheel


@click.command(name="train", short_help="Learn the classifiers from labelled recordings.")
@click.argument("labels_file", type=FILE, metavar="LABELS.csv")
@click.option("--wheel", "wheel_file", type=FILE, metavar="W.toml", required=True, help="Constants of the wheel.")
@click.option("-o", "--output", type=FILE, required=True, metavar="MODEL.json", help="Where to write the model.")
def command(labels_file: Path, wheel_file: Path, output: Path) -> None:
    """Learn the classifiers from labelled recordings.

    LABELS.csv has the columns file,dry,viscous,<switching systems>, with 0 or 1; file names are relative to it, and a
    label holds for all windows of its file. A last window that is not full is left out where there are full ones. A
    file with a wheel of its own beside it (FILE.wheel.toml, as `simulate dataset` writes it) is read with that one.
    """
    from rwa_monitor.diagnosis.training import train
    from rwa_monitor.formats.files import display_name
    from rwa_monitor.formats.labels import read_labels
    from rwa_monitor.formats.model_file import write_model
    from rwa_monitor.formats.wheel_file import read_wheel

    wheel = read_wheel(wheel_file)
    files = read_labels(labels_file)
    windows = [window for file in track(files, len(files), "reading windows") for window in _windows(file, wheel)]
    names = [display_name(path) for path in (labels_file, wheel_file, output)]
    again = shlex.join(["rwa-monitor", "train", names[0], "--wheel", names[1], "-o", names[2]])
    model = train(windows, wheel, source=labels_file.name, command=again)
    write_model(model, output)
    say(f"{names[2]}: learned from {len(windows)} windows of {len(files)} files")


def _windows(file: LabelledFile, wheel: Wheel) -> Iterator[LabelledFeatures]:
    """Yield what the classifiers see of a file's windows, by both methods."""
    from rwa_monitor.diagnosis.training import LabelledFeatures
    from rwa_monitor.formats.files import display_name
    from rwa_monitor.formats.table import read_table
    from rwa_monitor.formats.truth import beside
    from rwa_monitor.formats.wheel_file import read_wheel
    from rwa_monitor.live.core import diagnose_samples

    own = beside(file.path, ".wheel.toml")
    if own.exists():
        own_wheel = read_wheel(own)
        if own_wheel.anomalies != wheel.anomalies:
            raise InputError(display_name(own), f"has {own_wheel.anomalies}, not {wheel.anomalies}", "anomalies")
        wheel = own_wheel
    samples = read_table(file.path).samples
    joint = list(diagnose_samples(samples, wheel, None, method="joint"))
    paper = list(diagnose_samples(samples, wheel, None, method="paper"))
    full = [not window.partial for window in joint]
    for by_joint, by_paper in zip(joint, paper, strict=True):
        if not by_joint.partial or not any(full):
            yield LabelledFeatures(by_joint.diagnosis.features, by_paper.diagnosis.features, file.anomalies)
