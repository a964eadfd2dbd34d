"""`manoeuvre`: the shortest change of speed that decides dry or viscous friction."""

from __future__ import annotations

from dataclasses import asdict
from json import dumps
from pathlib import Path
from typing import Literal

import click

from rwa_monitor.cli import options as cli


@click.command(short_help="Find the shortest change of speed that decides dry or viscous.")
@click.argument("friction", type=click.Choice(["dry", "viscous"]))
@cli.wheel_option
@cli.model_option
@cli.option("--speed", cli.Real(0, min_open=True), "RAD_S", "Where the wheel runs.  [default: its nominal speed]")
@cli.option("--certainty", cli.Real(0.5, 1.0, min_open=True, max_open=True), "P", "Wanted.", default=0.95)
@cli.flag("--json", "Print one JSON object.")
def manoeuvre(
    friction: Literal["dry", "viscous"],
    wheel: Path | None,
    model: Path | None,
    speed: float | None,
    certainty: float,
    json: bool,
) -> int:
    """Find the shortest change of speed that decides whether dry or viscous friction is nominal.

    At one speed the two cannot be separated, and a window of it is inconclusive. One line for each size of the change:
    any crossing, spin-down or dwell that changes the speed as much, and lasts as long, serves. Once it was flown, the
    window that holds it is diagnosed with it. Which manoeuvre separates causes of a missing effect: `discrepancy
    --plan`. Exit code 1 where no change of the speed decides.
    """
    from rwa_monitor.diagnosis.manoeuvre import deciding_manoeuvres
    from rwa_monitor.telemetry.configuration import read_model, read_wheel

    found = deciding_manoeuvres(read_wheel(wheel), read_model(model), friction, certainty, speed)
    if json:
        click.echo(dumps({"friction": friction, "certainty": certainty, "manoeuvres": [asdict(one) for one in found]}))
    elif found:
        from rich.table import Table

        table = Table("change (rad/s)", "hold each speed (s)", "changes", "in all (s)")
        for one in found:
            table.add_row(f"{one.change_rad_s:.3g}", f"{one.hold_s:.0f}", str(one.changes), f"{one.duration_s:.0f}")
        cli.console_of_stdout().print(table)
    else:
        cli.log("no change of speed within the wheel's limits decides it within a day")
    return 0 if found else cli.FAILED
