"""Plays one history on real processes, and checks the result."""

import json
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import Any, Final

import numpy as np

from rwa_monitor.messages import PERIOD_S, EncodedMessage, SamplesMessage, dump_json
from rwa_monitor.monitor.core import WheelCore
from rwa_monitor.monitor.ingest import Counts
from rwa_monitor.monitor.recording import read_recording, recordings_of
from rwa_monitor.monitor.replay import replay
from rwa_monitor.samples import Samples
from rwa_monitor.telemetry.table import table_writer
from tests.faults.history import LOSING, MAX_DELAY_S, Fault, History, make_history, wheel
from tests.faults.rig import Rig
from tests.monitor.processes import wait_for
from tests.monitor.support import adds_up, diagnoses, messages_of, model
from tests.program import run

# In these histories the monitor must be there from the beginning; in the others the bus may be first.
NEEDS_MONITOR: Final = frozenset({"second_publisher", "disk_fails", *LOSING})
FLUSHED_S: Final = PERIOD_S + 0.3
QUIET_S: Final = 6.0  # without new data: missing messages have been requested again without success and are lost


@dataclass(slots=True)
class Outcome:
    """Result of a history.

    Attributes
    ----------
    problems
        A line for each promise that was broken.
    sent, lost
        Samples that the publishers sent, and those of them that are in no diagnosis.
    told
        Messages that the last status reports as missing.
    windows
        Diagnoses compared.
    wrong
        Diagnoses that differ from those of `diagnose`, or are missing.
    recordings
        Files of the chain.
    stops_s
        How long the monitor took to end, each time it was signalled to.
    """

    number: int
    kinds: tuple[str, ...]
    problems: list[str] = field(default_factory=list)
    sent: int = 0
    lost: int = 0
    told: int = 0
    windows: int = 0
    wrong: int = 0
    recordings: int = 0
    stops_s: list[float] = field(default_factory=list)
    took_s: float = 0.0
    talk: str = ""


def run_trial(seed: int, number: int, *, root: bool) -> Outcome:
    """Make a history, play it and check the result."""
    history = make_history(seed, number, root=root)
    outcome = Outcome(number, history.kinds)
    begin_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="rwa-faults-") as folder:
        disk, files = "disk_full" in history.kinds, "rotation" in history.kinds
        try:
            with Rig(Path(folder), history.kept, small_disk=disk, small_files=files) as rig:
                _happen(history, rig, outcome)
                _check(history, rig, outcome)
        except (AssertionError, OSError) as error:
            outcome.problems.append(str(error).splitlines()[0])
        log = Path(folder) / "talk.log"
        outcome.talk = log.read_text() if log.exists() else ""
    if "Traceback" in outcome.talk:
        outcome.problems.append("a traceback on stderr")
    outcome.took_s = time.monotonic() - begin_s
    return outcome


# ---- what happens ----------------------------------------------------------------------------------------------------


def _happen(history: History, rig: Rig, outcome: Outcome) -> None:
    """Send all messages, with the faults between them, and wait until nothing new arrives."""
    sent = Counter[str]()
    for place, put in enumerate(history.puts):
        for fault in history.faults:
            if fault.until == place:
                _end(fault, rig)
            if fault.at == place:
                _begin(fault, rig, sent, outcome)
        rig.put(put)
        sent[_wheel_of(put.key)] += put.samples
        if place == 0 and set(history.kinds) & NEEDS_MONITOR:
            wait_for(lambda: _received(rig, "wheel_1") > 0, "the first message")
    expected = {_wheel_of(key): _oracle(samples)[0] for key, samples in history.sent.items()}
    if history.recoverable:
        for name, counts in expected.items():
            wait_for(
                lambda name=name, counts=counts: _taken(rig, name) >= counts.used + counts.masked, f"all of {name}"
            )
            wait_for(lambda name=name, counts=counts: rig.status(name)["samples_queued"] == 0, f"the queue of {name}")
    else:
        _wait_until_quiet(rig, expected)
    for key, samples in history.sent.items() if history.recoverable else ():
        name, count = _wheel_of(key), len(_oracle(samples)[1])
        wait_for(lambda name=name, count=count: len(set(rig.heard["diagnosis", name])) >= count, "all diagnoses")
    if history.loses_recording:
        wait_for(lambda: all(rig.status(name)["recording"] for name in expected), "the recording to go on")
    _stop(rig, outcome)


def _stop(rig: Rig, outcome: Outcome) -> None:
    status, took_s = rig.stop_monitor()
    outcome.stops_s.append(took_s)
    if status != 0:
        outcome.problems.append(f"the monitor ended with exit code {status}")


# What a fault does when it begins, and when it ends; some need more than the rig, see `_begin`.
BEGINS: Final[dict[str, Callable[[Rig], None]]] = {
    "kill_monitor": lambda rig: rig.kill(rig.monitor),
    "pause_monitor": lambda rig: rig.signal_monitor(signal.SIGSTOP),
    "kill_router": lambda rig: rig.kill(rig.router),
    "cut_link": lambda rig: rig.link.cut(),
    "outage_beyond_history": lambda rig: rig.link.cut(),
    "publisher_dies_in_outage": lambda rig: rig.link.cut(),
    "freeze_link": lambda rig: rig.link.freeze(),
    "restart_publisher": Rig.renew_publisher,
    "disk_full": Rig.fill_disk,
    "disk_fails": Rig.fail_disk,
}
ENDS: Final[dict[str, Callable[[Rig], None]]] = {
    "kill_monitor": Rig.start_monitor,
    "restart_monitor": Rig.start_monitor,
    "flipped_recording": Rig.start_monitor,
    "pause_monitor": lambda rig: rig.signal_monitor(signal.SIGCONT),
    "kill_router": Rig.start_router,
    "cut_link": lambda rig: rig.link.heal(),
    "freeze_link": lambda rig: rig.link.heal(),
    "outage_beyond_history": lambda rig: rig.link.heal(),
    "publisher_dies_in_outage": lambda rig: (rig.renew_publisher(), rig.link.heal()),
    "disk_full": Rig.free_disk,
    "disk_fails": Rig.mend_disk,
}


def _begin(fault: Fault, rig: Rig, sent: Counter[str], outcome: Outcome) -> None:
    if fault.name == "restart_monitor":
        _stop(rig, outcome)
        return
    if fault.name == "flipped_recording":
        wait_for(lambda: any(rig.recordings.glob("*.mcap")), "a recording")
        rig.kill(rig.monitor)
        rig.flip_bit(fault.delay_s / MAX_DELAY_S)
        return
    if fault.name == "kill_monitor":
        Event().wait(fault.delay_s / 8)
    if fault.name == "restart_publisher":
        for name, count in sent.items():
            wait_for(lambda name=name, count=count: _received(rig, name) >= count, f"all of {name} so far")
        # What is younger than a second may be on no disk yet: a monitor killed then needs the publisher's history.
        Event().wait(FLUSHED_S)
    BEGINS[fault.name](rig)


def _end(fault: Fault, rig: Rig) -> None:
    if fault.name not in {"restart_publisher", "kill_monitor", "restart_monitor", "flipped_recording"}:
        Event().wait(fault.delay_s)
    if fault.name in ENDS:
        ENDS[fault.name](rig)


def _wheel_of(key: str) -> str:
    return key.split("/")[2]


def _taken(rig: Rig, name: str) -> int:
    status = rig.status(name)
    return int(status["samples_used"] + status["samples_masked"]) if status else 0


def _received(rig: Rig, name: str) -> int:
    """Count the samples of the first wheel's own publishers that the monitor has, less what it has twice."""
    status = rig.status(name)
    return int(status["samples_received"] - status["samples_duplicate"]) if status else 0


def _wait_until_quiet(rig: Rig, names: Iterable[str]) -> None:
    names = list(names)
    wait_for(lambda: any(rig.status(name) for name in names), "a status")
    before, since = -1, time.monotonic()
    while time.monotonic() - since < QUIET_S:
        now = sum(rig.status(name).get("samples_received", 0) for name in names)
        if now != before:
            before, since = now, time.monotonic()
        Event().wait(0.05)


# ---- what must have come of it ---------------------------------------------------------------------------------------


def _oracle(samples: Samples) -> tuple[Counts, list[bytes]]:
    """Diagnose a table whole."""
    core = WheelCore(wheel(), model())
    events = core.feed(samples)
    return core.counts, diagnoses(messages_of(events))


def _check(history: History, rig: Rig, outcome: Outcome) -> None:
    problems = outcome.problems
    messages = [message for path in recordings_of(rig.recordings) for message in read_recording(path).messages]
    outcome.recordings = len(recordings_of(rig.recordings))
    for key, samples in history.sent.items():
        name = _wheel_of(key)
        status = rig.status(name)
        outcome.sent += len(samples)
        if not status and not history.recoverable:  # a wheel from which no message arrived
            outcome.lost += len(samples)
            continue
        outcome.told += status["messages_missed"]
        recorded = [m.payload for m in messages if m.topic == key.replace("samples", "diagnosis")]
        heard = rig.heard["diagnosis", name]
        counts, made = _oracle(samples)
        expected = [payload.replace(b"wheel_1", name.encode()) for payload in made]
        if not history.recoverable:
            # Diagnoses of the samples that reached the monitor; the replay checks that they are right.
            expected = list(dict.fromkeys(heard)) if history.loses_recording else recorded
            # To a monitor that joins late nothing is missing: one that was killed before its first second was recorded,
            # or one that received nothing of a wheel before the outage.
            # The last few messages that a publisher keeps may still wait for those before them, and are then queued.
            told = status["messages_missed"] or status["samples_queued"]
            told = told or "kill_monitor" in history.kinds or name != "wheel_1"
            if not told and "outage_beyond_history" in history.kinds:
                problems.append(f"{name}: messages were lost and none is said to be missing")
        if rig.flipped is not None:  # a diagnosis whose inputs were lost is made again, when they come again
            recorded = list(dict.fromkeys(recorded))
        _compare(outcome, name, expected, recorded, heard, whole=not history.loses_recording)
        outcome.lost += counts.used + counts.masked - _taken(rig, name)
        if history.recoverable and not outcome.problems:
            _ask_diagnose(rig.folder, samples, name, expected, outcome)
        _check_account(name, rig, messages, key, problems, whole=not history.loses_recording)
    if history.recoverable and outcome.lost:
        problems.append(f"{outcome.lost} samples were lost")
    if history.recoverable and not history.loses_recording:
        refused = {message.payload for message in messages if message.topic.endswith("/refused")}
        if refused != set(history.garbage):
            problems.append("messages refused and messages that cannot be read differ")
    if "second_publisher" in history.kinds and "two live publishers" not in rig.log.read_text():
        problems.append("two live publishers were not reported")
    _check_replay(history, rig, problems)


def _check_replay(history: History, rig: Rig, problems: list[str]) -> None:
    """Check that the chain replays; of a chain with a damaged recording, that each of the others does."""
    parts: list[Path | list[Path]] = [rig.recordings]
    if rig.flipped is not None:
        parts = [path for path in recordings_of(rig.recordings) if path != rig.flipped]
    for part in parts:
        report = replay(part)
        unreadable = report.unreadable and not history.loses_recording and "kill_monitor" not in history.kinds
        if report.differences or not report.bytes_equal or unreadable:
            problems.append(f"the recording does not replay: {report.long()} {report.unreadable}")


def _compare(
    outcome: Outcome, name: str, expected: list[bytes], recorded: list[bytes], heard: list[bytes], *, whole: bool
) -> None:
    """Check diagnoses: in the recordings each once and in order, on the bus each at least once."""
    outcome.windows += len(expected)
    missing = [payload for payload in expected if payload not in heard]
    false = [payload for payload in {*heard, *recorded} if payload not in expected]
    outcome.wrong += len(missing) + len(false)
    if missing:
        outcome.problems.append(f"{name}: {len(missing)} of {len(expected)} diagnoses were never on the bus")
    if false:
        outcome.problems.append(f"{name}: {len(false)} diagnoses are not those of the table")
    if (whole and recorded != expected) or len(set(recorded)) < len(recorded):
        outcome.problems.append(f"{name}: {len(recorded)} diagnoses recorded, {len(set(recorded))} different ones")


def _check_account(
    name: str, rig: Rig, messages: list[EncodedMessage], key: str, problems: list[str], *, whole: bool
) -> None:
    """Check the sums of every status, and the last one against the recorded samples."""
    topic = key.replace("samples", "status")
    for payload in (*rig.heard["status", name], *(m.payload for m in messages if m.topic == topic)):
        status = json.loads(payload)
        if not adds_up(status):
            problems.append(f"{name}: the account does not add up: {payload.decode()}")
            return
    recorded = sum(len(SamplesMessage.parse(m.payload, "").time_ns) for m in messages if m.topic == key)
    received = rig.status(name)["samples_received"]
    if whole and recorded != received:
        problems.append(f"{name}: {received} samples received, {recorded} recorded")


def _ask_diagnose(folder: Path, samples: Samples, name: str, expected: list[bytes], outcome: Outcome) -> None:
    """Compare with `rwa-monitor diagnose --json` of the sent table; a table's time must increase."""
    if np.diff(samples.time_ns).min() <= 0:
        return
    table, wheel_file = folder / f"{name}.parquet", folder / "wheel.toml"
    table_writer(table)(samples, table)
    wheel_file.write_text(wheel().to_toml())
    result = run("diagnose", table, "--wheel", wheel_file, "--json")
    if result.exit_code != 0:
        outcome.problems.append(f"{name}: `diagnose` ends with {result.exit_code} on the table: {result.stderr}")
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    said_of_table = [_as_on_the_bus(line, name) for line in lines[: len(expected)]]
    if said_of_table != expected:
        outcome.wrong += sum(a != b for a, b in zip(said_of_table, expected, strict=False))
        outcome.problems.append(f"{name}: `diagnose` says something else of the table")


def _as_on_the_bus(line: dict[str, Any], name: str) -> bytes:
    """Return a line of `diagnose` under the wheel's name on the bus, and without its file."""
    return dump_json({**{k: v for k, v in line.items() if k != "source"}, "spacecraft": "sat", "wheel": name})


def losing(kinds: Iterable[str]) -> bool:
    """Return whether one of these faults loses samples for good."""
    return bool(set(kinds) & set(LOSING))
