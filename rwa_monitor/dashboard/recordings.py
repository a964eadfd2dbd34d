"""Recordings for the page: the list of them, and the content of one as entries of the feed."""

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Final

from rwa_monitor import messages
from rwa_monitor.dashboard.feed import BATCH
from rwa_monitor.dashboard.fleet import (
    MAX_POINTS,
    DecimatedSamples,
    DerivedFriction,
    Fleet,
    Received,
    array_json,
    object_json,
    thinned_json,
)
from rwa_monitor.errors import InputError
from rwa_monitor.history.store import History
from rwa_monitor.messages import Diagnosis, Discrepancy, Health, Message, SamplesMessage
from rwa_monitor.monitor.recording import (
    RECORDING_SUFFIX,
    Recording,
    read_chain,
    read_recording,
    time_span,
)
from rwa_monitor.monitor.setup import Setup

SHOWN: Final = {message.schema_name(): message for message in messages.MESSAGES if message is not Health}


class RecordingFile(Message):
    """One recording of the folder; the first and last time in it on the wheels' clocks, None where none is known."""

    name: str
    size_bytes: int
    changed_wall_ns: int
    first_ns: int | None = None
    last_ns: int | None = None


def list_recordings(folder: Path) -> list[RecordingFile]:
    """Return the recordings of a folder, the latest first; none where the folder does not exist."""
    paths = sorted(folder.glob(f"*{RECORDING_SUFFIX}"), reverse=True)
    return [_file(path, (facts := path.stat()).st_size, facts.st_mtime_ns) for path in paths if path.is_file()]


@lru_cache(maxsize=10_000)
def _file(path: Path, size_bytes: int, changed_wall_ns: int) -> RecordingFile:
    """Return a recording's entry in the list; its times are read again only when its size or time stamp changes."""
    span = None
    with suppress(InputError):  # an unreadable file is listed, too
        span = time_span(path)
    first_ns, last_ns = span or (None, None)
    return RecordingFile(
        name=path.name, size_bytes=size_bytes, changed_wall_ns=changed_wall_ns, first_ns=first_ns, last_ns=last_ns
    )


def replay_json(folder: Path, name: str) -> bytes:
    """Return a recording as JSON: problems, and entries {time_ns, key, message}, samples thinned.

    Raises
    ------
    InputError
        If the folder holds no recording of that name, or it cannot be read.
    """
    if name not in {entry.name for entry in list_recordings(folder)}:
        raise InputError(name, "is no recording here")
    recording = read_recording(folder / name)
    entries = array_json(_entries(recording))
    # The page shows which parts are damaged.
    return object_json({"problems": messages.dump_json(recording.problems), "entries": entries})


def recorded_samples(folder: Path, window: Diagnosis) -> bytes:
    """Return the samples of a window that the recordings of a folder hold, thinned, as the JSON of a `SamplesMessage`.

    "null" where there are none.
    """
    start_ns, end_ns = window.window_start_ns, window.window_end_ns
    topic = messages.key_of(SamplesMessage, window.spacecraft, window.wheel)
    decimated = DecimatedSamples()
    for entry in reversed(list_recordings(folder)):
        if entry.first_ns is None or entry.last_ns is None or entry.first_ns >= end_ns or entry.last_ns < start_ns:
            continue
        with suppress(InputError):  # damaged, or too large: the samples of the others are shown
            recording = read_recording(folder / entry.name)
            setup = Setup.found_in(recording) or Setup()
            derived = DerivedFriction(setup.wheel(window.spacecraft, window.wheel))
            for message in recording.messages:
                if message.topic == topic:
                    samples = derived.add(SamplesMessage.parse(message.payload, topic).samples())
                    decimated.add(samples[(start_ns <= samples.time_ns) & (samples.time_ns < end_ns)])
    return decimated.message()


def latest_setup(folder: Path) -> Setup | None:
    """Return the setup of the latest recording of a folder that has one; None where there is none."""
    for entry in list_recordings(folder):
        with suppress(InputError):  # damaged, or too large: an earlier one is used
            if setup := Setup.found_in(read_recording(folder / entry.name)):
                return setup
    return None


def _entries(recording: Recording) -> Iterator[bytes]:
    """Yield the entries of the feed, with `time_ns`, for a recording's messages, in its order."""
    fleet = Fleet(Setup.found_in(recording))
    counts: Counter[str] = Counter()
    for message in recording.messages:
        if message.schema == SamplesMessage.schema_name():
            counts[message.topic] += len(SamplesMessage.parse(message.payload, message.topic).time_ns)
    for message in recording.messages:
        if message.schema not in SHOWN:
            continue
        shown = SHOWN[message.schema].parse(message.payload, f"{recording.path.name}: {message.topic}")
        name = messages.split_key(message.topic)[:2]
        wheel = fleet.wheel(*name) or fleet.begin(*name, [])
        entry = Received(message.topic, shown.to_json(), message.publish_ns)
        if wheel is not None and isinstance(shown, SamplesMessage):
            wheel.decimated.stride = max(wheel.decimated.stride, -(-counts[message.topic] // MAX_POINTS))
            picked = fleet.take_samples(wheel, shown.samples(), message.publish_ns)
            if not len(picked):
                continue
            entry = entry._replace(payload=thinned_json(picked))
        elif wheel is not None and isinstance(shown, Diagnosis):
            entry = fleet.take(wheel, shown, entry)
        yield entry.to_json(time_ns=messages.dump_json(message.time_ns))


# ---- import into the history -----------------------------------------------------------------------------------------


def import_recordings(history: History, path: Path) -> tuple[int, int]:
    """Import a recording, or all of a folder; returns how many windows there are, and how many of them were new.

    Raises
    ------
    InputError
        If there is no recording there, or one holds a message that cannot be parsed.
    HistoryError
        If the database cannot be written; windows imported before remain.
    """
    windows = new = 0
    for recording in read_chain(path):
        late = {(one.spacecraft, one.wheel, one.window_end_ns) for one in recording.parsed(Health) if one.data}
        diagnoses = [
            one.model_copy(update={"data": "stored"}) if (one.spacecraft, one.wheel, one.window_end_ns) in late else one
            for one in recording.parsed(Diagnosis)
        ]
        for found in recording.parsed(Discrepancy):
            history.add_discrepancy(found)
        windows += len(diagnoses)
        for begin in range(0, len(diagnoses), BATCH):
            new += history.add(*diagnoses[begin : begin + BATCH])[0]
    return windows, new
