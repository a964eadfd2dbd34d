"""What a monitor holds in memory: its open windows, not what has passed, and no second copy of all of them."""

import gc
import tracemalloc
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import _lru_cache_wrapper
from pathlib import Path
from threading import Event

from rwa_monitor.messages import MAX_WHEELS, PERIOD_S, samples_json
from rwa_monitor.monitor.backfill import Arrival
from rwa_monitor.monitor.bus import BusOptions, MonitorBus, open_session
from rwa_monitor.monitor.recorder import MAX_FILE_AGE_S
from rwa_monitor.monitor.recording import MAX_FLEET_FILE_BYTES, read_recording, recordings_of
from rwa_monitor.monitor.replay import recover_state
from rwa_monitor.monitor.setup import Setup
from rwa_monitor.wheel.wheel import Wheel
from tests.monitor.processes import Driven
from tests.monitor.support import model, telemetry, wheel

MESSAGE = 256  # samples of one
SLOTS, MESSAGES = 80_000, 60  # of a window that is open, and those that fill a part of it


@dataclass
class Sending(Driven):
    """A monitor, and the wheels that send to it."""

    sent_bytes: int = 0

    def send(self, wheels: int, messages: range) -> None:
        """Send messages of each wheel."""
        for number in messages:
            payload = samples_json(telemetry(104 * MESSAGE)[number * MESSAGE : (number + 1) * MESSAGE], "p", number)
            for place in range(wheels):
                self.monitor.receive(Arrival(f"rwa/sat/wheel_{place}/samples", payload))
                self.sent_bytes += len(payload)
            self.now_s += PERIOD_S
            self.monitor.tick()


@contextmanager
def driven(folder: Path, of_wheel: Wheel, max_file_bytes: int) -> Iterator[Sending]:
    with open_session(BusOptions()) as session, closing(MonitorBus(session)) as bus:
        driver = Sending(folder, of_wheel, bus, max_file_bytes)
        yield driver
        driver.monitor.close()


@contextmanager
def traced() -> Iterator[None]:
    """Count what Python and numpy allocate."""
    gc.collect()
    tracemalloc.start()
    try:
        yield
    finally:
        tracemalloc.stop()


def taken(folder: Path, wheels: int) -> tuple[int, int, int]:
    """Return what a new recording takes while open windows are brought over [bytes], and its size then.

    And what a start from it takes, and gives back when it is done.
    """
    with driven(folder, wheel(SLOTS), max_file_bytes=2**30) as driver:
        driver.send(wheels, range(MESSAGES))
        driver.now_s += MAX_FILE_AGE_S
        with traced():
            for _ in range(wheels + 1):
                driver.now_s += PERIOD_S
                driver.monitor.tick()
            new_file = tracemalloc.get_traced_memory()[1]
        assert len(recordings_of(folder)) == 2
        size = recordings_of(folder)[1].stat().st_size
        driver.send(wheels, range(MESSAGES, MESSAGES + 10))
    with traced():
        past = recover_state(folder, Setup(wheel(SLOTS), model=model()), Event(), lambda _: None)
        held, peak = tracemalloc.get_traced_memory()
    assert len(past.cores) == wheels
    return new_file, size, peak - held


def test_a_new_file_takes_the_memory_of_one_checkpoint_however_many_wheels_there_are(tmp_path: Path) -> None:
    """All at once, those of fifty wheels took 140 MB for ten seconds: the soak's memory rose with each higher peak.

    When a recording was read whole at a start, that of 400 full windows took 5 GB, and their cores one.
    """
    # Of eight wheels the recording is larger already than the piece that is read at a time.
    few, size_of_few, start_of_few = taken(tmp_path / "few", 8)
    many, size_of_many, start_of_many = taken(tmp_path / "many", 32)
    assert size_of_many > 3.5 * size_of_few  # else the checkpoints are not what fills it
    assert many < 1.5 * few
    assert start_of_many < 1.5 * start_of_few
    # A file grows to twice what it begins with; that of as many wheels as one process takes is still read again.
    full = (size_of_many - size_of_few) / 24 * SLOTS / (MESSAGES * MESSAGE)
    assert 2.0 * full * MAX_WHEELS < MAX_FLEET_FILE_BYTES


def held_bytes() -> int:
    """Return what is allocated now, without what functions remember by their arguments: that has bounds of its own."""
    for found in gc.get_objects():
        if isinstance(found, _lru_cache_wrapper):
            found.cache_clear()
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


def test_nothing_is_kept_of_windows_that_were_closed_and_of_files_that_were_ended(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    with driven(folder, wheel(), max_file_bytes=80_000) as driver, traced():
        driver.send(2, range(24))
        held, sent_bytes, files = held_bytes(), driver.sent_bytes, len(recordings_of(folder))
        driver.send(2, range(24, 104))
        grown, heard_bytes = held_bytes() - held, driver.sent_bytes - sent_bytes
    ended = recordings_of(folder)[files:]
    assert len(ended) > 10
    said_bytes = sum(
        len(message.payload)
        for path in ended
        for message in read_recording(path).messages
        if not message.topic.endswith("/samples")
    )
    # A quarter of the smaller one: what is open at the two moments differs a little.
    assert grown < 0.25 * min(said_bytes, heard_bytes)
