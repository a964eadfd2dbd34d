"""`tune`: window, prior weight and threshold of the changepoint detector for wanted rates."""

from __future__ import annotations

import json
from dataclasses import asdict

import click

SEED = 20260126  # of the simulated check: the same wishes give the same figures


@click.command(name="tune", short_help="Choose window, prior weight and threshold of the detector.")
@click.option("--missed", type=float, required=True, metavar="P", help="Wanted probability of missing a jump.")
@click.option(
    "--run-length", type=float, required=True, metavar="N", help="Wanted mean number of samples between false alarms."
)
@click.option("--jump", type=float, required=True, metavar="SIGMAS", help="Size of the jump, in noise deviations.")
@click.option(
    "--acceleration",
    type=float,
    default=0.0,
    show_default=True,
    metavar="A",
    help="Steady change of ω/ω_nominal from sample to sample for which it must hold; 0: constant speed.",
)
@click.option(
    "--slope-error",
    type=click.FloatRange(min=0, min_open=True),
    default=0.3,
    show_default=True,
    metavar="E",
    help="Possible error of the nominal viscous coefficient, normalised.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def command(
    missed: float, run_length: float, jump: float, acceleration: float, slope_error: float, as_json: bool
) -> None:
    """Choose the smallest detection window that keeps both wanted rates, and check it by simulation.

    In closed form for white noise and a steady acceleration; colour and tails are measured by the monitor itself, which
    scales its statistic accordingly.
    """
    import numpy as np

    from rwa_monitor.diagnosis.tuning import check, tune

    tuning = tune(missed, run_length, jump, acceleration=acceleration, slope_error=slope_error)
    counted = check(tuning, jump, acceleration, np.random.default_rng(SEED))
    if as_json:
        click.echo(json.dumps({**asdict(tuning), "check": asdict(counted)}))
        return
    click.echo(f"half window w   {tuning.half_width} slots on each side")
    click.echo(f"threshold       {tuning.threshold:.2f} (GLR/σ²)")
    click.echo(f"prior weight    W_b = {tuning.prior_weight:.2g} (normalised, σ = 0.024)")
    click.echo(f"information     λ = {tuning.information:.1f}")
    click.echo(f"predicted       missed {tuning.missed:.3g}, run length {tuning.run_length:.3g} samples")
    click.echo(
        f"simulated       missed {counted.missed:.3g}, {counted.false_alarms} false alarms in {counted.samples} samples"
    )
