"""`doctor`: checks an installation, a configuration, a bus connection, and reports what to do about what is wrong."""

from __future__ import annotations

import re
import shutil
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from rwa_monitor import __version__
from rwa_monitor.cli import options as cli
from rwa_monitor.errors import InputError, RwaMonitorError

if TYPE_CHECKING:
    import zenoh


# How long to wait for a router or peer to answer, and for messages of monitors, which publish every second.
ANSWER_S: Final = 3.0


@click.command(short_help="Check installation, configuration and bus connection.")
@cli.wheel_option
@cli.model_option
@cli.wheel_folder_option
@cli.option("--record", cli.FILE, "DIR", "The folder in which `run` shall record.")
@cli.bus_options
def doctor(
    wheel: Path | None,
    model: Path | None,
    wheel_folder: Path | None,
    record: Path | None,
    bus: cli.BusOptions,
) -> int:
    """Check this installation, wheels and model, the folder for recordings, and, with -e or -l, the bus.

    Give it the options of `run`. One line for each check on stdout. Exit code 1 if one failed.
    """
    failed: list[str] = []

    def check(name: str, look: Callable[[], str]) -> None:
        """Print the result of `look`, or the error that it raises."""
        try:
            click.echo(f"ok      {name}: {look()}")
        # With any fault of an installation, this check is named and the others are still done.
        except Exception as error:  # noqa: BLE001
            kind = "" if isinstance(error, RwaMonitorError) else f"{type(error).__name__}: "
            click.echo(f"FAILED  {name}: {kind}{' '.join(str(error).split())}")
            failed.append(name)

    check("python", lambda: f"{'.'.join(map(str, sys.version_info[:3]))}, rwa-monitor {__version__}")
    check("packages", _packages)
    check("kernels", _kernels)
    check("wheel", lambda: _wheel(wheel))
    check("model", lambda: _model(model))
    if wheel_folder is not None:
        check("wheels", lambda: look_at_wheel_folder(wheel_folder))
    if record is not None:
        check("record", lambda: look_at_recordings(record))
    if bus.connect or bus.listen or bus.config:
        check("bus", lambda: look_at_bus(bus))
    return cli.FAILED if failed else 0


# ---- installation ----------------------------------------------------------------------------------------------------

# Requirements of the program that requirements-monitor.txt leaves out: see docs/onboard.md.
NOT_ON_BOARD: Final = frozenset({"jinja2", "joblib", "scikit-learn"})


def _packages() -> str:
    """Check that all required packages are installed; return their versions, and the extras that lack packages."""
    from importlib.metadata import requires, version

    needed: defaultdict[str, list[str]] = defaultdict(list)  # by extra, "" for the program itself
    for line in requires("rwa-monitor") or ():
        extra = re.search(r"extra == ['\"]([^'\"]+)['\"]", line)
        needed[extra[1] if extra else ""].append(re.split(r"[^A-Za-z0-9._-]", line, maxsplit=1)[0])
    missing = {extra: _missing(names) for extra, names in needed.items() if extra not in {"build", "dev"}}
    without = missing.pop("")
    if not NOT_ON_BOARD.issuperset(without):
        raise RwaMonitorError(f"{', '.join(without)} missing; run `pip install .` again")
    there = [f"{name} {version(name)}" for name in needed[""] if name not in without]
    if without:
        there.append(f"no {', '.join(without)} (a monitor alone needs none)")
    extras = [f"no {extra} (pip install 'rwa-monitor[{extra}]')" for extra, lacking in missing.items() if lacking]
    return f"{', '.join(there)}; extras: {', '.join(extras) or 'all'}"


def _missing(names: Iterable[str]) -> list[str]:
    """Return which of some packages are not installed."""
    from importlib.metadata import Distribution

    return [name for name in names if not any(Distribution.discover(name=name))]


def _kernels() -> str:
    """Check the kernels, and the packages that use them, by diagnosing a small simulated window."""
    import rwa_monitor as rwa

    samples = rwa.simulate(rwa.Scenario(duration_s=250.0)).samples
    began = time.perf_counter()
    (diagnosis,) = rwa.diagnose(samples)
    return f"{diagnosis.samples} simulated slots diagnosed in {time.perf_counter() - began:.2f} s"


def _wheel(wheel_file: Path | None) -> str:
    """Check that the wheel file can be used, and return what it lacks."""
    from rwa_monitor.monitor.setup import read_wheel
    from rwa_monitor.words import counted

    wheel = read_wheel(wheel_file)
    notes = "; ".join(wheel.missing())
    lacking = f"it lacks what rwa-monitor identify learns, or you know: {notes}" if notes else "complete"
    return f"{wheel.name}, {counted(len(wheel.fss), 'switching system')}; {lacking}"


def _model(model_file: Path | None) -> str:
    """Check that the model can be used."""
    from rwa_monitor.monitor.setup import read_model

    model = read_model(model_file)
    names = sorted(anomaly.name for anomaly in model.anomalies)
    return f"{', '.join(names)}, from {model.trained.windows} windows ({model.trained.source})"


# ---- environment of a live monitor -----------------------------------------------------------------------------------


def look_at_wheel_folder(folder: Path) -> str:
    """Check that the wheel files of single wheels can be used, and return what they lack."""
    from rwa_monitor.monitor.setup import read_wheel_folder
    from rwa_monitor.words import FEW, counted, first_few

    wheels = read_wheel_folder(folder)
    lacking = [f"{'/'.join(key)}: {note}" for key, wheel in wheels.items() for note in wheel.missing()]
    found = f"{counted(len(wheels), 'wheel')} ({first_few(['/'.join(key) for key in wheels])})"
    return f"{found}; {'; '.join(lacking[:FEW]) or 'complete'}"


def look_at_recordings(folder: Path) -> str:
    """Check that a monitor can record in a folder, and return which recording it would continue from.

    Raises
    ------
    RwaMonitorError
        If the folder cannot be written, is in use by another monitor, or the disk is full.
    """
    from rich.filesize import decimal

    from rwa_monitor.monitor.recorder import MIN_FREE_BYTES, locked

    if not folder.exists():
        return f"{folder} is not there yet"
    with locked(folder):
        pass
    free = shutil.disk_usage(folder).free
    found = f"{folder}: {decimal(free)} of the disk are free"
    if free <= MIN_FREE_BYTES:
        raise RwaMonitorError(f"{found}, of which {decimal(MIN_FREE_BYTES)} stay free")
    last = max(folder.glob("*.mcap"), default=None)
    return f"{found}; {f'goes on from {last.name}' if last else 'holds no recording yet'}"


def look_at_bus(bus: cli.BusOptions) -> str:
    """Check that the bus can be reached with the options, and return who publishes on it.

    Raises
    ------
    RwaMonitorError
        If it should connect, and nothing answers.
    """
    from rwa_monitor.monitor.bus import BusWatch, open_session
    from rwa_monitor.words import counted, first_few

    with open_session(bus) as session:
        watch = BusWatch(session, bus)
        patient_until_s = time.monotonic() + ANSWER_S
        while watch.trouble() and time.monotonic() < patient_until_s:
            time.sleep(0.1)
        if watch.trouble():
            raise RwaMonitorError(
                f"nothing answers at {', '.join(bus.connect) or bus.config}; is a router or peer there?"
            )
        found = _publishers(session)
        routers, peers = len(list(session.info.routers_zid())), len(list(session.info.peers_zid()))
    if not routers + peers:
        return f"open, but nobody has connected in {ANSWER_S:.0f} s"
    wheels = found["samples"], found["status"]
    sending, monitored = (f"{counted(len(one), 'wheel')} ({first_few(sorted(one)) or 'none'})" for one in wheels)
    unserved = first_few(sorted(found["samples"] - found["status"]))
    return (
        f"open, with {counted(routers, 'router')} and {counted(peers, 'peer')} connected; in {ANSWER_S:.0f} s received"
        f" telemetry of {sending}, monitors of {monitored}{unserved and f'; nobody monitors {unserved}'}"
    )


def _publishers(session: zenoh.Session) -> defaultdict[str, set[str]]:
    """Return the wheels of which a message arrived within `ANSWER_S`, by the kind of the message."""
    from rwa_monitor.messages import split_key

    found: defaultdict[str, set[str]] = defaultdict(set)

    def take(sample: zenoh.Sample) -> None:
        with suppress(InputError):  # a key of another program
            spacecraft, wheel, kind = split_key(str(sample.key_expr))
            found[kind].add(f"{spacecraft}/{wheel}")

    subscriber = session.declare_subscriber("rwa/*/*/*", take)
    time.sleep(ANSWER_S)
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    return found
