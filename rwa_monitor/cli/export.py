"""`export`: writes the friction model of a wheel file for other simulators."""

from pathlib import Path

import click

from rwa_monitor.cli import options as cli


@click.command(short_help="Write a wheel's friction model for other simulators.")
@click.argument("wheel", type=cli.FILE, metavar="WHEEL.toml")
@cli.option(
    "--to target", click.Choice(["c", "fmu", "basilisk", "json", "detector"]), None, "What to write.", required=True
)
@cli.option("-o --output", cli.FILE, "OUT", "Folder to write to.", required=True)
def export(wheel: Path, target: str, output: Path) -> int:
    """Write the friction model of a wheel file, its effects included, for other simulators.

    c: rwa_friction.h and rwa_friction.c, C99 without allocation.

    fmu: rwa_friction.fmu, FMI 3.0 for model exchange and co-simulation, with sources and a binary for Linux, which the
    system's C compiler builds.

    basilisk: rwa_friction_basilisk.py, Basilisk's own message fitted, with what that costs, and the exact model.

    json: rwa_friction.json, constants and formulas.

    detector: rwa_detector_settings.h, of the detector for flight software that `make detector` builds.

    What the model does not hold (noise, what changes when the dry level jumps) is logged, and is stated in the files.
    """
    from rwa_monitor.export import FORMATS
    from rwa_monitor.export.model import friction_model
    from rwa_monitor.monitor.setup import read_wheel
    from rwa_monitor.telemetry.files import display_name, write_files

    model = friction_model(read_wheel(wheel), display_name(wheel))
    write_files(output, FORMATS[target](model), "-o")
    cli.log(*(f"not held: {part.effect.name}: {part.effect.not_exported}" for part in model.left_out))
    cli.log(f"written to {display_name(output)}")
    return 0
