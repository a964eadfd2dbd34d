"""`doctor`: checks an installation, a configuration, a bus connection, and reports what to do about what is wrong."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from rwa_monitor import __version__
from rwa_monitor.cli.console import FAILED
from rwa_monitor.cli.options import BYTES_PER_GB, FILE, bus_options, model_option, wheel_folder_option, wheel_option
from rwa_monitor.errors import InputError, RwaMonitorError

if TYPE_CHECKING:
    import zenoh

    from rwa_monitor.monitor.bus import BusOptions
    from rwa_monitor.monitor.setup import Setup, WheelKey

CONNECT_S: Final = 3.0  # how long a router or peer has to answer
LISTEN_S: Final = 2.0  # how long the doctor subscribes to the bus: a monitor publishes every second
NAMED: Final = 8  # wheels that a line names, of many


@click.command(name="doctor", short_help="Check installation, configuration and bus connection.")
@wheel_option
@model_option
@wheel_folder_option
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
) -> int:
    """Check this installation, wheels and model, the folder for recordings, and, with -e or -l, the bus.

    Give it the options of `run`. One line for each check on stdout. Exit code 1 if one failed.
    """

    def setup() -> Setup:
        """Return what a monitor with these options would diagnose with."""
        from rwa_monitor.monitor.setup import Setup, WheelSet
        from rwa_monitor.telemetry.configuration import read_model, read_wheel, read_wheel_folder

        own_wheels = read_wheel_folder(wheel_folder) if wheel_folder else {}
        return Setup(WheelSet(read_wheel(wheel_file), own_wheels), read_model(model_file), "joint")

    failed: list[str] = []

    def check(name: str, look: Callable[[], str], *needs: str) -> None:
        """Print what `look` found, or the error that it raises; it is not called where a check that it needs failed."""
        if lacking := [need for need in needs if need in failed]:
            click.echo(f"–       {name}: not checked before {' and '.join(lacking)}")
            return
        try:
            click.echo(f"ok      {name}: {look()}")
        # Whatever is wrong with an installation, the other checks shall still be done and this one named.
        except Exception as error:  # noqa: BLE001
            kind = "" if isinstance(error, RwaMonitorError) else f"{type(error).__name__}: "
            click.echo(f"FAILED  {name}: {kind}{' '.join(str(error).split())}")
            failed.append(name)

    check("python", lambda: f"{'.'.join(map(str, sys.version_info[:3]))}, rwa-monitor {__version__}")
    check("packages", _packages)
    check("extras", _extras)
    check("kernels", _kernels)
    check("settings", lambda: _settings(ctx))
    check("wheel", lambda: _wheel(wheel_file))
    check("model", lambda: _model(model_file, wheel_file), "wheel")
    if wheel_folder is not None:
        check("wheels", lambda: look_at_wheel_folder(wheel_folder))
    if record is not None:
        check("record", lambda: look_at_recordings(record, setup()), "wheel", "model", "wheels")
    if bus.connect or bus.listen or bus.config:
        check("bus", lambda: look_at_bus(bus, _own_wheels(wheel_folder)))
    return FAILED if failed else 0


# ---- installation ----------------------------------------------------------------------------------------------------

# What requirements-monitor.txt leaves out of what the program needs: see docs/onboard.md.
NOT_ON_BOARD: Final = frozenset({"jinja2", "joblib", "scikit-learn"})
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


def _extras() -> str:
    """Return which extras are there; a missing one is no fault, it only leaves something out."""
    required = _required()
    return ", ".join(
        f"no {extra} ({purpose}: pip install 'rwa-monitor[{extra}]')"
        if _missing(required.get(extra, [extra]))
        else f"{extra} ({purpose})"
        for extra, purpose in EXTRAS.items()
    )


def _required() -> dict[str, list[str]]:
    """Return the packages that the program needs ("") and that each extra does."""
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
    from importlib.metadata import Distribution

    return [name for name in names if not any(Distribution.discover(name=name))]


def _kernels() -> str:
    """Diagnose a small simulated window: the kernels, and all rooms that use them, do their work."""
    import time

    import numpy as np

    from rwa_monitor.diagnosis.model import built_in_model
    from rwa_monitor.monitor.core import diagnose_samples
    from rwa_monitor.simulation.record import simulate
    from rwa_monitor.simulation.scenario import Scenario
    from rwa_monitor.wheel.wheel import built_in_wheel

    wheel, model = built_in_wheel(), built_in_model()
    telemetry = simulate(Scenario(duration_s=250.0), wheel, np.random.default_rng(0))
    began = time.perf_counter()
    (window,) = diagnose_samples(telemetry.samples, wheel, model)
    elapsed = time.perf_counter() - began
    return f"{window.diagnosis.slots} simulated slots diagnosed in {elapsed:.2f} s"


def _settings(ctx: click.Context) -> str:
    """Return what the settings file and the environment set, which is checked already; name what sets nothing."""
    import json
    import os

    from rwa_monitor.cli.settings import unknown_variables

    root = ctx.find_root()
    assert isinstance(root.command, click.Group)
    unknown = unknown_variables(os.environ, root.command, root)
    if unknown:
        named = ", ".join(f"{name}{hint}" for name, hint in unknown.items())
        raise RwaMonitorError(f"no option is set by {named}; the form is RWA_MONITOR_<COMMAND>_<OPTION>")
    file = root.params.get("settings")
    options = json.dumps(root.default_map) if root.default_map else "all options at their defaults"
    return f"{file or 'no file'}; {options}"


def _wheel(wheel_file: Path | None) -> str:
    """Check that the wheel file can be used, and return what it lacks."""
    from rwa_monitor.monitor.service import first_verdict
    from rwa_monitor.telemetry.configuration import read_wheel
    from rwa_monitor.words import counted

    wheel = read_wheel(wheel_file)
    notes = "; ".join(wheel.missing())
    lacking = f"it lacks what rwa-monitor identify learns, or you know: {notes}" if notes else "complete"
    parts = (f"{wheel.name}, {counted(len(wheel.fss), 'switching system')}", first_verdict([wheel]), lacking)
    return "; ".join(part for part in parts if part)


def _model(model_file: Path | None, wheel_file: Path | None) -> str:
    """Check that the model can be used, and with this wheel."""
    from rwa_monitor.diagnosis.model import models_for
    from rwa_monitor.telemetry.configuration import read_model, read_wheel

    model, wheel = read_model(model_file), read_wheel(wheel_file)
    names = sorted(anomaly.name for anomaly in model.anomalies)
    found = f"{', '.join(names)}, from {model.trained.windows} windows ({model.trained.source})"
    unknown, stated = [], []
    for name, known in zip(wheel.anomalies, models_for(wheel, model), strict=True):
        if known is None or not known.knows_friction:
            unknown.append(name)
        elif known is not model.anomaly(name):
            stated.append(name)
    if stated:
        found += f"; has no anomaly of this wheel's {', '.join(stated)}: judged by the wheel file's healthy friction"
    if unknown:
        found += f"; no file gives this wheel's healthy {', '.join(unknown)}: not judged, rwa-monitor identify"
    return found


# ---- what a live monitor needs ---------------------------------------------------------------------------------------


def look_at_wheel_folder(folder: Path) -> str:
    """Check that the wheel files of single wheels can be used, and return what they lack and what lies beside them."""
    from rwa_monitor.telemetry.configuration import read_wheel_folder
    from rwa_monitor.words import counted, first_few

    wheels = read_wheel_folder(folder)
    lacking = [f"{_name(key)}: {note}" for key, wheel in wheels.items() for note in wheel.missing()]
    found = f"{counted(len(wheels), 'wheel')} ({first_few([_name(key) for key in wheels], NAMED)})"
    if loose := sorted(file.name for file in folder.glob("*.toml")):
        found += f"; no wheel's: {first_few(loose, NAMED)}, the place is SPACECRAFT/WHEEL.toml"
    return f"{found}; {'; '.join(lacking[:NAMED]) or 'complete'}"


def look_at_recordings(folder: Path, setup: Setup) -> str:
    """Check that a monitor can record in a folder, and return what it would go on from.

    Raises
    ------
    RwaMonitorError
        If the folder cannot be written, is another monitor's, or the disk is full.
    """
    import os
    import shutil

    from rwa_monitor.monitor.recording.recorder import MIN_FREE_BYTES, FolderLock, last_recording

    if not folder.exists():
        parent = next(one for one in folder.absolute().parents if one.exists())
        if not (parent.is_dir() and os.access(parent, os.W_OK)):
            raise RwaMonitorError(f"{folder} is not there and cannot be made in {parent}")
        return f"{folder} is not there yet; {_free(shutil.disk_usage(parent).free)}"
    with FolderLock(folder):
        pass
    free = shutil.disk_usage(folder).free
    if free <= MIN_FREE_BYTES:
        raise RwaMonitorError(f"{folder}: {_free(free)}, of which {MIN_FREE_BYTES / BYTES_PER_GB:.2g} GB stay free")
    last = last_recording(folder)
    found = f"goes on from {last.name}{_stale(last, setup)}" if last else "holds no recording yet"
    return f"{folder} can be written, {_free(free)}; {found}"


def _stale(last: Path, setup: Setup) -> str:
    """Return of which wheels a recording was made with something else than now, "" where of none."""
    from rwa_monitor.messages import SamplesMessage, split_key
    from rwa_monitor.monitor.recording.reader import read_recording
    from rwa_monitor.monitor.setup import Setup
    from rwa_monitor.words import first_few

    try:
        recording = read_recording(last)
        before = Setup.of(recording)
    except InputError as error:
        return f", which cannot be used ({error.place or error.reason}): the one before it is taken"
    keys = {split_key(one.topic)[:2] for one in recording.messages if one.schema == SamplesMessage.schema_name()}
    other = sorted(_name(key) for key in keys if before.identity_of(*key) != setup.identity_of(*key))
    return f", made with another wheel file, model or method of {first_few(other, NAMED)}: begun anew" if other else ""


def _own_wheels(wheel_folder: Path | None) -> set[WheelKey]:
    """Return the wheels that have a file in a folder; none where it cannot be used, which another check reports."""
    from rwa_monitor.telemetry.configuration import read_wheel_folder

    try:
        return set(read_wheel_folder(wheel_folder)) if wheel_folder else set()
    except InputError:
        return set()


def look_at_bus(bus: BusOptions, own_wheels: set[WheelKey]) -> str:
    """Check that the bus can be reached with the options, and return who publishes on it.

    Raises
    ------
    RwaMonitorError
        If it shall connect, and nobody answers.
    """
    import time
    from threading import Event

    from rwa_monitor.monitor.bus import BusWatch, endpoints, open_session
    from rwa_monitor.words import counted, first_few

    def listed(wheels: set[WheelKey]) -> str:
        names = sorted(map(_name, wheels))
        return f"{counted(len(names), 'wheel')} ({first_few(names, NAMED)})" if names else "no wheel"

    with open_session(bus) as session:
        watch = BusWatch(session, endpoints(bus))
        patient_until_s = time.monotonic() + CONNECT_S
        while watch.trouble() and time.monotonic() < patient_until_s:
            Event().wait(0.1)
        if watch.trouble():
            raise RwaMonitorError(
                f"nothing answers at {', '.join(bus.connect) or bus.config}; is a router or peer there?"
            )
        sending, monitored = _publishers(session)
        routers, peers = len(list(session.info.routers_zid())), len(list(session.info.peers_zid()))
    if not routers + peers:
        return f"open, but nobody has connected in {LISTEN_S:.0f} s"
    found = (
        f"open, with {counted(routers, 'router')} and {counted(peers, 'peer')} connected; in {LISTEN_S:.0f} s received"
    )
    found += f" telemetry of {listed(sending)}, monitors of {listed(monitored)}"
    if unserved := sorted(_name(key) for key in sending - monitored):
        found += f"; nobody monitors {first_few(unserved, NAMED)}"
    unused = sorted(_name(key) for key in own_wheels - sending - monitored)
    return f"{found}; wheel files of wheels without messages: {first_few(unused, NAMED)}" if unused else found


def _publishers(session: zenoh.Session) -> tuple[set[WheelKey], set[WheelKey]]:
    """Return the wheels whose samples, and those whose monitor's status came within a while."""
    from threading import Event

    from rwa_monitor.messages import SamplesMessage, Status, split_key

    found: dict[str, set[WheelKey]] = {SamplesMessage.kind: set(), Status.kind: set()}

    def take(sample: zenoh.Sample) -> None:
        try:
            spacecraft, wheel, kind = split_key(str(sample.key_expr))
        except InputError:  # somebody else's
            return
        if kind in found:
            found[kind].add((spacecraft, wheel))

    subscriber = session.declare_subscriber("rwa/*/*/*", take)
    Event().wait(LISTEN_S)
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    return found[SamplesMessage.kind], found[Status.kind]


def _name(key: WheelKey) -> str:
    return "/".join(key)


def _free(count: int) -> str:
    return f"{count / BYTES_PER_GB:.3g} GB of the disk are free"
