"""`doctor`: checks an installation, a configuration, a bus connection, and says what to do about what is wrong."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from rwa_monitor import __version__
from rwa_monitor.cli.exit_codes import FAILED
from rwa_monitor.cli.options import FILE, bus_options, model_option, wheel_option
from rwa_monitor.errors import InputError, RwaMonitorError

if TYPE_CHECKING:
    from rwa_monitor.live.bus import BusOptions
    from rwa_monitor.live.rebuild import Setup
    from rwa_monitor.live.wheel_set import WheelKey

MIN_PYTHON = (3, 11)


@dataclass(frozen=True, slots=True)
class Check:
    """One thing to look at: `look` returns what it found, or raises what is wrong; not where what it `needs` failed."""

    name: str
    look: Callable[[], str]
    needs: tuple[str, ...] = ()


@click.command(name="doctor", short_help="Check installation, configuration and bus connection.")
@wheel_option
@model_option
@click.option("--wheel-folder", type=FILE, metavar="DIR", help="Wheel files of single wheels, as for `run`.")
@click.option("--record", type=FILE, metavar="DIR", help="The folder in which `run` shall record.")
@bus_options
@click.pass_context
def command(
    ctx: click.Context,
    wheel_file: Path | None,
    model_file: Path | None,
    wheel_folder: Path | None,
    record: Path | None,
    bus: BusOptions,
) -> None:
    """Check this installation, wheels and model, the folder for recordings, and, with -e or -l, the bus.

    Give it the options of `run`. One line for each check on stdout. Exit code 1 if one failed.
    """
    from rwa_monitor.cli.doctor_live import look_at_bus, look_at_recordings, look_at_wheel_folder

    checks = [
        Check("python", _python),
        Check("packages", _packages),
        Check("extras", _extras),
        Check("kernels", _kernels),
        Check("settings", lambda: _settings(ctx)),
        Check("wheel", lambda: _wheel(wheel_file)),
        Check("model", lambda: _model(model_file, wheel_file), ("wheel",)),
    ]
    loaded: tuple[str, ...] = ("wheel", "model")
    if wheel_folder is not None:
        checks.append(Check("wheels", lambda: look_at_wheel_folder(wheel_folder)))
        loaded = (*loaded, "wheels")
    if record is not None:
        setup = partial(_setup, wheel_file, model_file, wheel_folder)
        checks.append(Check("record", lambda: look_at_recordings(record, setup()), loaded))
    if bus.connect or bus.listen or bus.config:
        checks.append(Check("bus", lambda: look_at_bus(bus, _own_wheels(wheel_folder))))
    failed: list[str] = []
    for check in checks:
        if lacking := [name for name in check.needs if name in failed]:
            click.echo(f"–       {check.name}: not checked before {' and '.join(lacking)}")
            continue
        try:
            found = f"ok      {check.name}: {check.look()}"
        except RwaMonitorError as error:
            found = f"FAILED  {check.name}: {' '.join(str(error).split())}"
            failed.append(check.name)
        # Whatever is wrong with an installation, the other checks shall still be done and this one named.
        except Exception as error:  # noqa: BLE001
            found = f"FAILED  {check.name}: {type(error).__name__}: {' '.join(str(error).split())}"
            failed.append(check.name)
        click.echo(found)
    ctx.exit(FAILED if failed else 0)


def _own_wheels(wheel_folder: Path | None) -> set[WheelKey]:
    """Return the wheels that have a file in a folder; none where it cannot be used, which another check says."""
    from rwa_monitor.formats.wheel_file import read_wheel_folder

    try:
        return set(read_wheel_folder(wheel_folder)) if wheel_folder else set()
    except InputError:
        return set()


def _setup(wheel_file: Path | None, model_file: Path | None, wheel_folder: Path | None) -> Setup:
    """Return what a monitor with these options would diagnose with."""
    from rwa_monitor.formats.model_file import read_model
    from rwa_monitor.formats.wheel_file import read_wheel, read_wheel_folder
    from rwa_monitor.live.rebuild import Setup
    from rwa_monitor.live.wheel_set import WheelSet

    own_wheels = read_wheel_folder(wheel_folder) if wheel_folder else {}
    return Setup(WheelSet(read_wheel(wheel_file), own_wheels), read_model(model_file), "joint")


def _python() -> str:
    """Check the interpreter."""
    version = ".".join(str(part) for part in sys.version_info[:3])
    if sys.version_info < MIN_PYTHON:
        raise RwaMonitorError(f"{version}; 3.11 or newer is needed")
    return f"{version}, rwa-monitor {__version__}"


# What requirements-monitor.txt leaves out of what the program needs: see docs/onboard.md.
NOT_ON_BOARD: Final = frozenset({"jinja2", "joblib", "scikit-learn"})


def _packages() -> str:
    """Check that every package that the program needs is there."""
    from importlib.metadata import version

    needed = _required()[""]
    missing = _missing(needed)
    if not NOT_ON_BOARD.issuperset(missing):
        raise RwaMonitorError(f"{', '.join(missing)} missing; run `pip install .` again")
    there = [f"{name} {version(name)}" for name in needed if name not in missing]
    without = [f"no {', '.join(missing)} (a monitor alone needs none)"] if missing else []
    return ", ".join(there + without)


# What each extra is for, in the order in which a person meets them.
EXTRAS: Final = {
    "dashboard": "the page",
    "postgresql": "its history in PostgreSQL",
    "foxglove": "Foxglove live",
    "parquet": "Parquet tables, results of many recordings",
    "plot": "pictures",
    "pandas": "data frames",
    "fleet": "work on a Dask cluster",
    "ccsds": "space packets",
    "ros2": "ROS 2 bags",
}


def _extras() -> str:
    """Say which extras are there; a missing one is no fault, it only leaves something out."""
    required = _required()
    missing = {extra: _missing(required.get(extra, [extra])) for extra in EXTRAS}
    found = [
        f"{extra} ({purpose})" if not missing[extra] else f"no {extra} ({purpose}: pip install 'rwa-monitor[{extra}]')"
        for extra, purpose in EXTRAS.items()
    ]
    return ", ".join(found)


def _required() -> dict[str, list[str]]:
    """Return the packages that the program needs ("") and that each extra does."""
    import re
    from importlib.metadata import PackageNotFoundError, requires

    try:
        requirements = requires("rwa-monitor") or []
    except PackageNotFoundError as error:
        raise RwaMonitorError("rwa-monitor itself is not installed; run `pip install .` in its folder") from error
    found: dict[str, list[str]] = {"": []}
    for line in requirements:
        extra = re.search(r"extra == ['\"]([^'\"]+)['\"]", line)
        name = re.split(r"[^A-Za-z0-9._-]", line, maxsplit=1)[0]
        found.setdefault(extra[1] if extra else "", []).append(name)
    return found


def _missing(names: Iterable[str]) -> list[str]:
    """Return those of some packages that are not installed."""
    from importlib.metadata import PackageNotFoundError, version

    missing = []
    for name in names:
        try:
            version(name)
        except PackageNotFoundError:
            missing.append(name)
    return missing


def _kernels() -> str:
    """Diagnose a small simulated window: the kernels, and all rooms that use them, do their work."""
    import time

    import numpy as np

    from rwa_monitor.diagnosis.model import built_in_model
    from rwa_monitor.live.core import diagnose_samples
    from rwa_monitor.physics.scenario import Scenario
    from rwa_monitor.physics.telemetry import simulate
    from rwa_monitor.physics.wheel import built_in_wheel

    wheel, model = built_in_wheel(), built_in_model()
    telemetry = simulate(Scenario(duration_s=250.0), wheel, np.random.default_rng(0))
    began = time.perf_counter()
    (window,) = diagnose_samples(telemetry.samples, wheel, model)
    elapsed = time.perf_counter() - began
    return f"{window.diagnosis.slots} simulated slots diagnosed in {elapsed:.2f} s"


def _settings(ctx: click.Context) -> str:
    """Say what stands in the settings file and the environment, which is checked already; name what sets nothing."""
    import json
    import os

    from rwa_monitor.cli.settings import near_variable, unknown_variables

    root = ctx.find_root()
    assert isinstance(root.command, click.Group)
    unknown = unknown_variables(os.environ, root.command, root)
    if unknown:
        named = ", ".join(f"{name}{near_variable(name, root.command, root)}" for name in unknown)
        raise RwaMonitorError(f"no option is set by {named}; the form is RWA_MONITOR_<COMMAND>_<OPTION>")
    file = root.params.get("settings")
    options = json.dumps(root.default_map) if root.default_map else "all options at their defaults"
    return f"{file or 'no file'}; {options}"


def _wheel(wheel_file: Path | None) -> str:
    """Check that the wheel file can be used, and say what it lacks."""
    from rwa_monitor.formats.wheel_file import read_wheel
    from rwa_monitor.live.wheel_words import first_verdict
    from rwa_monitor.words import counted

    wheel = read_wheel(wheel_file)
    notes = wheel.missing()
    told = f"{wheel.name}, {counted(len(wheel.fss), 'switching system')}"
    wait = first_verdict([wheel])
    told = f"{told}; {wait}" if wait else told
    if not notes:
        return f"{told}; complete"
    return f"{told}; it lacks what rwa-monitor identify learns, or you know: {'; '.join(notes)}"


def _model(model_file: Path | None, wheel_file: Path | None) -> str:
    """Check that the model can be used, and with this wheel."""
    from rwa_monitor.diagnosis.model import models_for
    from rwa_monitor.formats.model_file import read_model
    from rwa_monitor.formats.wheel_file import read_wheel

    model, wheel = read_model(model_file), read_wheel(wheel_file)
    taught = [anomaly.name for anomaly in model.anomalies]
    told = f"{', '.join(sorted(taught))}, from {model.trained.windows} windows ({model.trained.source})"
    unknown, stated = [], []
    for name, known in zip(wheel.anomalies, models_for(wheel, model), strict=True):
        if known is None or not known.knows_friction:
            unknown.append(name)
        elif known is not model.anomaly(name):
            stated.append(name)
    if stated:
        told += f"; knows no anomaly of this wheel's {', '.join(stated)}: judged by the wheel file's healthy friction"
    if unknown:
        told += f"; nothing says what this wheel's healthy {', '.join(unknown)} is: not judged, rwa-monitor identify"
    return told
