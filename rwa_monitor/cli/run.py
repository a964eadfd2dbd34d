"""`run`: the live monitor, until SIGINT or SIGTERM."""

from __future__ import annotations

import os
import re
from pathlib import Path

import click

from rwa_monitor.cli import options as cli


def _shard(ctx: click.Context, param: click.Parameter, value: str) -> tuple[int, int]:
    """Parse I/N: share I of N processes among which the wheels are divided."""
    del ctx, param
    match = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", value)
    share, of = (int(match[1]), int(match[2])) if match else (0, 0)
    if not 1 <= share <= of:
        raise click.BadParameter(f"{value!r} is not I/N with 1 ≤ I ≤ N, such as 2/4")
    return share, of


@click.command(short_help="Monitor wheels live on a Zenoh bus.")
@cli.option("--wheels", str, "KEYEXPR", "Keys of the samples to take.", default="rwa/*/*/samples")
@cli.fleet_options
@cli.option("--record", cli.FILE, "DIR", "Record everything in this folder, and continue from what it holds.")
@cli.option(
    "--record-limit",
    cli.Real(min=0.1),
    "GB",
    "Keep at most so many gigabytes of recordings: the oldest files are deleted. Without it all are kept.",
)
@cli.option(
    "--shard",
    str,
    "I/N",
    "Serve share I of N: the wheels are divided among N of these.",
    default="1/1",
    callback=_shard,
)
@cli.option(
    "--stored-after",
    cli.Real(min=0.0),
    "S",
    "Age of samples from which they count as stored, not live, by this machine's clock, where their publisher does"
    " not state it, and the wheel's clock agrees with it; 0: never.  [default: 600]",
)
@cli.option("--alive", cli.FILE, "FILE", "Touched every second, for a container's health check.")
@cli.bus_options
def run(
    wheels: str,
    setup: cli.Setup,
    record: Path | None,
    record_limit: float | None,
    shard: tuple[int, int],
    stored_after: float | None,
    alive: Path | None,
    bus: cli.BusOptions,
) -> None:
    """Monitor wheels live: subscribe to their samples, diagnose, publish and record.

    Answers on rwa/{spacecraft}/{wheel}/… with status, provisional changepoints, health, and a diagnosis for each
    window. Stops cleanly on SIGINT and SIGTERM. Under systemd it notifies when it is ready, and its watchdog.
    """
    from rwa_monitor.monitor.service import STORED_AFTER_S, RunOptions, Supervisor, run

    for name, one in [(setup.common.name, setup.common), *(("/".join(key), own) for key, own in setup.own.items())]:
        cli.log(*(f"{name}: {note}" for note in one.missing()))
    cli.warn_if_alone(bus)
    if record is None:
        cli.log("nothing is recorded; give --record DIR to be able to replay")
    options = RunOptions(
        wheels=wheels,
        setup=setup,
        record=record,
        max_record_bytes=None if record_limit is None else int(record_limit * 1e9),
        bus=bus,
        shard=shard,
        stored_after_s=STORED_AFTER_S if stored_after is None else stored_after,
    )
    with cli.stop_on_signals() as stop:
        run(options, stop, log=cli.log, supervisor=Supervisor(os.environ, alive))
