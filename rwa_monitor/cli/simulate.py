"""`simulate`: simulated telemetry of wheels, with the whole truth, to files or to the bus."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from rwa_monitor.cli import options as cli

if TYPE_CHECKING:
    from rwa_monitor.simulation.datasets import LabelledWindow

DEFAULT_KEY: Final = "rwa/simulated/wheel_{n}/samples"

scenario_option = cli.option(
    "--scenario", cli.FILE, "S.toml", "What happens to the wheel.  [default: a healthy wheel in orbit]"
)
seed_option = cli.option("--seed", cli.Whole(0), "N", "The same seed gives the same bytes.", default=0)
output_option = cli.option("-o --output", cli.FILE, "PATH", "Where to write.", required=True)


@click.group(short_help="Make telemetry: recording, data set, live wheel.", no_args_is_help=False)
def simulate() -> None:
    """Simulate telemetry: one recording, a labelled data set, or a live wheel."""


@simulate.command(short_help="Write one recording and its truth.")
@scenario_option
@cli.wheel_option
@seed_option
@output_option
def recording(scenario: Path | None, wheel: Path | None, seed: int, output: Path) -> None:
    """Write one recording: CSV or Parquet by the suffix of -o FILE (.csv, .parquet).

    The truth is written next to it: FILE.truth.json (labels, jumps, scenario) and FILE.truth.pq (every slot, as
    Parquet); so does the wheel where it is not the built-in one: FILE.wheel.toml.
    """
    from rwa_monitor.telemetry.labels import write_truth
    from rwa_monitor.telemetry.table import table_writer

    write = table_writer(output)
    window = _simulate(scenario, wheel, seed, output.stem)
    write(window.telemetry.samples, output)
    cli.log(write_truth(window, output, seed=seed))
    cli.log(f"{len(window.telemetry.samples)} samples in {output}, the truth beside it")


@simulate.command(short_help="Write labelled windows, to train with.")
@cli.option("--recipe", str, "NAME", "What the windows are like; a wrong name lists them.", required=True)
@cli.option("--count", cli.Whole(1), "N", "Windows to make.", required=True)
@seed_option
@output_option
@cli.option("--format", click.Choice(["parquet", "csv"]), None, "Of the sample tables.", default="parquet")
def dataset(recipe: str, count: int, seed: int, output: Path, format: str) -> None:  # noqa: A002
    """Write labelled windows into the folder -o DIR: one sample table each, labels.csv, and the truth of each.

    The wheel file of each window is written next to its table, since recipes draw wheels too.
    """
    from rwa_monitor.simulation.datasets import generate
    from rwa_monitor.telemetry.files import make_folder
    from rwa_monitor.telemetry.labels import write_labels, write_truth
    from rwa_monitor.telemetry.table import table_writer
    from rwa_monitor.words import counted

    windows = cli.track(generate(recipe, count, seed), count, "simulating")
    rows: list[dict[str, str]] = []
    left_out = ""
    for window in windows:
        if not rows:
            # Only now, so that an unknown recipe leaves no empty folder behind.
            make_folder(output)
        table = output / f"{window.name}.{format}"
        table_writer(table)(window.telemetry.samples, table)
        left_out = write_truth(window, table, recipe=recipe, seed=seed)
        rows.append({"file": table.name, **{name: str(int(active)) for name, active in window.labels.items()}})
    write_labels(rows, output / "labels.csv")
    cli.log(left_out)
    cli.log(f"{counted(len(rows), 'window')} in {output}, labels in {output / 'labels.csv'}")


@simulate.command(short_help="Publish one recording on the bus.")
@scenario_option
@cli.wheel_option
@seed_option
@cli.speed_option
@cli.option("--key", str, "KEY", "The samples on the bus; {n} counts wheels.", default=DEFAULT_KEY)
@cli.option("--count", cli.Whole(1, 4096), "N", "So many wheels at once.", default=1)
@cli.option("--batch", cli.Whole(1, 100_000), "N", "Samples of one message.", default=256)
@cli.bus_options
def publish(
    scenario: Path | None,
    wheel: Path | None,
    seed: int,
    speed: float,
    key: str,
    count: int,
    batch: int,
    bus: cli.BusOptions,
) -> None:
    """Publish one recording on the bus in the pace of its own time, as a satellite's computer would.

    Ends when the scenario does, or on SIGINT or SIGTERM. The same scenario, wheel and seed give the samples of
    `simulate recording`; with --count the second wheel has the next seed, and so on.
    """
    from rwa_monitor.monitor.bus import BusWatch, send

    if count > 1 and "{n}" not in key:
        raise click.BadParameter("with --count, KEY needs {n} where the number of the wheel stands", param_hint="--key")
    keys = [key.replace("{n}", str(number)) for number in range(1, count + 1)]
    telemetry = {
        key: _simulate(scenario, wheel, seed + number, "published").telemetry.samples for number, key in enumerate(keys)
    }
    with cli.on_bus(bus) as (stop, session):
        sent = send(session, telemetry, speed=speed, batch_samples=batch, stop=stop)
        trouble = BusWatch(session, bus).trouble()
    if trouble:
        cli.log(f"{trouble.removesuffix(' Trying again.')} Nobody can have received the last samples.")
    total = sum(len(samples) for samples in telemetry.values())
    cli.log(f"{sent} of {total} samples published on {keys[0]}{f' … {keys[-1]}' if count > 1 else ''}")


def _simulate(scenario_file: Path | None, wheel_file: Path | None, seed: int, name: str) -> LabelledWindow:
    """Simulate a recording by the options."""
    import numpy as np

    from rwa_monitor.monitor.setup import read_scenario, read_wheel
    from rwa_monitor.simulation.datasets import LabelledWindow
    from rwa_monitor.simulation.record import simulate

    scenario, wheel = read_scenario(scenario_file), read_wheel(wheel_file)
    telemetry = simulate(scenario, wheel, np.random.default_rng(seed))
    return LabelledWindow(name, wheel, scenario, telemetry)
