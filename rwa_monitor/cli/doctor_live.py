"""What `doctor` looks at for a live monitor: its folders, and who is on the bus."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from rwa_monitor.cli.options import BYTES_PER_GB
from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.words import counted, first_few

if TYPE_CHECKING:
    import zenoh

    from rwa_monitor.live.bus import BusOptions
    from rwa_monitor.live.rebuild import Setup
    from rwa_monitor.live.wheel_set import WheelKey

CONNECT_S: Final = 3.0  # how long a router or peer has to answer
LISTEN_S: Final = 2.0  # how long the bus is listened to: a monitor speaks every second
NAMED: Final = 8  # wheels that a line names, of many


def look_at_wheel_folder(folder: Path) -> str:
    """Check that the wheel files of single wheels can be used, and say what they lack and what lies beside them."""
    from rwa_monitor.formats.wheel_file import read_wheel_folder

    wheels = read_wheel_folder(folder)
    lacking = [f"{_name(key)}: {note}" for key, wheel in wheels.items() for note in wheel.missing()]
    told = f"{counted(len(wheels), 'wheel')} ({first_few([_name(key) for key in wheels], NAMED)})"
    if loose := sorted(file.name for file in folder.glob("*.toml")):
        told += f"; no wheel's: {first_few(loose, NAMED)}, the place is SPACECRAFT/WHEEL.toml"
    return f"{told}; {'; '.join(lacking[:NAMED]) or 'complete'}"


def look_at_recordings(folder: Path, setup: Setup) -> str:
    """Check that a monitor can record in a folder, and say what it would go on from.

    Raises
    ------
    RwaMonitorError
        If the folder cannot be written, is another monitor's, or the disk is full.
    """
    import os
    import shutil

    from rwa_monitor.live.recorder import MIN_FREE_BYTES, FolderLock, last_recording

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
    past = f"goes on from {last.name}{_stale(last, setup)}" if last else "holds no recording yet"
    return f"{folder} can be written, {_free(free)}; {past}"


def _stale(last: Path, setup: Setup) -> str:
    """Say of which wheels a recording was made with something else than now, "" where of none."""
    from rwa_monitor.live.rebuild import Setup
    from rwa_monitor.live.recording import read_recording
    from rwa_monitor.messages import SamplesMessage, split_key

    try:
        recording = read_recording(last)
        before = Setup.of(recording)
    except InputError as error:
        return f", which cannot be used ({error.place or error.reason}): the one before it is taken"
    keys = {split_key(one.topic)[:2] for one in recording.messages if one.schema == SamplesMessage.schema_name()}
    other = sorted(_name(key) for key in keys if before.identity_of(*key) != setup.identity_of(*key))
    return f", made with another wheel file, model or method of {first_few(other, NAMED)}: begun anew" if other else ""


def look_at_bus(bus: BusOptions, own_wheels: set[WheelKey]) -> str:
    """Check that the bus can be reached as the options say, and say who is heard on it.

    Raises
    ------
    RwaMonitorError
        If it was told to connect, and nobody answers.
    """
    import time
    from threading import Event

    from rwa_monitor.live.bus import endpoints, open_session
    from rwa_monitor.live.bus_watch import BusWatch

    with open_session(bus) as session:
        watch = BusWatch(session, endpoints(bus))
        patient_until_s = time.monotonic() + CONNECT_S
        while watch.trouble() and time.monotonic() < patient_until_s:
            Event().wait(0.1)
        if watch.trouble():
            raise RwaMonitorError(
                f"nothing answers at {', '.join(bus.connect) or bus.config}; is a router or peer there?"
            )
        sending, monitored = _heard(session)
        routers, peers = len(list(session.info.routers_zid())), len(list(session.info.peers_zid()))
    if not routers + peers:
        return f"open, but nobody has connected in {LISTEN_S:.0f} s"
    told = f"open, with {counted(routers, 'router')} and {counted(peers, 'peer')} connected; in {LISTEN_S:.0f} s heard"
    told += f" telemetry of {_told(sending)}, monitors of {_told(monitored)}"
    if unserved := sorted(_name(key) for key in sending - monitored):
        told += f"; nobody monitors {first_few(unserved, NAMED)}"
    unused = sorted(_name(key) for key in own_wheels - sending - monitored)
    return f"{told}; wheel files of wheels that were not heard: {first_few(unused, NAMED)}" if unused else told


def _heard(session: zenoh.Session) -> tuple[set[WheelKey], set[WheelKey]]:
    """Return the wheels whose samples, and those whose monitor's status came within a while."""
    from threading import Event

    from rwa_monitor.messages import SamplesMessage, Status, split_key

    found: dict[str, set[WheelKey]] = {SamplesMessage.kind: set(), Status.kind: set()}

    def hear(sample: zenoh.Sample) -> None:
        try:
            spacecraft, wheel, kind = split_key(str(sample.key_expr))
        except InputError:  # somebody else's
            return
        if kind in found:
            found[kind].add((spacecraft, wheel))

    subscriber = session.declare_subscriber("rwa/*/*/*", hear)
    Event().wait(LISTEN_S)
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    return found[SamplesMessage.kind], found[Status.kind]


def _told(wheels: set[WheelKey]) -> str:
    return f"{counted(len(wheels), 'wheel')} ({first_few(sorted(map(_name, wheels)), NAMED)})" if wheels else "no wheel"


def _name(key: WheelKey) -> str:
    return "/".join(key)


def _free(count: int) -> str:
    return f"{count / BYTES_PER_GB:.3g} GB of the disk are free"
