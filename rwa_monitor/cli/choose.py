"""Choices before a measurement: `tune` the detector, find the `manoeuvre` whose change of speed decides a diagnosis."""

from dataclasses import asdict
from json import dumps
from pathlib import Path
from typing import Literal

import click

from rwa_monitor.cli import options as cli

SEED = 20260126  # of the simulated check: the same options give the same figures


@click.command(short_help="Choose window, prior weight and threshold of the detector.")
@cli.option("--missed", float, "P", "Wanted probability of missing a jump.", required=True)
@cli.option("--run-length", float, "N", "Wanted mean number of samples between false alarms.", required=True)
@cli.option("--jump", float, "SIGMAS", "Size of the jump, in noise deviations.", required=True)
@cli.flag("--json", "Print one JSON object.")
def tune(missed: float, run_length: float, jump: float, json: bool) -> int:
    """Choose the smallest detection window that keeps both wanted rates, and check it by simulation.

    In closed form for white noise at constant speed; colour and outliers are measured by the monitor itself,
    which scales its statistic accordingly. The check draws rare events where they happen, so that it has figures also
    for rates that nobody could wait for; exit code 1 where it contradicts a wanted rate.
    """
    import numpy as np

    from rwa_monitor.changepoints.tuning import check, tune

    tuning = tune(missed, run_length, jump)
    counted = check(tuning, jump, 0.0, np.random.default_rng(SEED))
    kept = counted.keeps(missed, run_length)
    if json:
        click.echo(dumps({**asdict(tuning), "check": {**asdict(counted), "kept": kept}}))
    else:
        rates = counted.missed, counted.run_length, counted.alarm_run_length
        misses, between, alarms = (f"{one.value:.3g} ({one.low:.3g} to {one.high:.3g})" for one in rates)
        click.echo(
            f"half window w   {tuning.half_width} slots on each side\n"
            f"threshold       {tuning.threshold:.2f} (GLR/σ²)\n"
            f"prior weight    W_b = {tuning.prior_weight:.2g} (normalised, σ = 0.024)\n"
            f"information     λ = {tuning.information:.1f}\n"
            f"predicted       missed {tuning.missed:.3g}, run length {tuning.run_length:.3g} samples\n"
            f"simulated       missed {misses}, run length {between} samples, {alarms} between alarms; "
            f"{counted.trials} windows each\n"
            f"wanted          {'kept' if kept else 'NOT kept'}: missed {missed:.3g}, "
            f"run length {run_length:.3g} samples"
        )
    return 0 if kept else cli.FAILED


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
    from rwa_monitor.monitor.setup import read_model, read_wheel

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
