"""The feed: messages from the bus are sent to every open page, in frames, over one WebSocket each.

A frame is a JSON array of entries {key, received_wall_ns, beside, message}; `message` follows the bus's schema of its
key. Samples, changepoints and complete statuses are sent only to the pages that show their wheel. All other statuses
of a frame are summarised in one entry, the pulse. A page that does not keep up is disconnected and connects again,
rather than falling behind unnoticed.

Messages go to the fleet, to the history and to the feed. While the history cannot be written, its windows wait, and
nothing else is delayed.
"""

import asyncio
import itertools
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import InitVar, dataclass
from functools import cache
from threading import Lock
from typing import Final, Self

import zenoh

from rwa_monitor import messages
from rwa_monitor.dashboard.fleet import (
    KEYS,
    REMEMBERED,
    Fleet,
    Received,
    Wheel,
    array_json,
    object_json,
    record_entry,
    thinned_json,
)
from rwa_monitor.errors import InputError
from rwa_monitor.history.alarms import ALL_WHEELS, STORED_ALARM
from rwa_monitor.history.database import AlarmRecord, HistoryError, MonitorState, RetirementEvent
from rwa_monitor.history.store import History
from rwa_monitor.messages import PERIOD_S, Diagnosis, Discrepancy, Health, HealthAlarm, SamplesMessage, Status
from rwa_monitor.monitor.bus import BusOptions, BusThread, BusWatch, HealthAnswers
from rwa_monitor.samples import SECONDS_PER_HOUR
from rwa_monitor.words import Log, time_text

FRAME_PERIOD_S: Final = 0.1
MAX_FRAMES: Final = 100  # queued for one page
BEAT_KEY: Final = "dashboard/beat"
PULSE_KEY: Final = "dashboard/pulse"
CLOSE_UP: Final = frozenset({"samples", "changepoints"})  # only for pages that show the wheel


class Client:
    """One open page: the frames queued for it, and the wheel whose samples it shows."""

    def __init__(self) -> None:
        self.frames: asyncio.Queue[str | None] = asyncio.Queue(MAX_FRAMES)
        self.watches = ""

    def put(self, frame: str) -> None:
        """Queue a frame, or disconnect the page if its queue is full."""
        try:
            self.frames.put_nowait(frame)
        except asyncio.QueueFull:
            self.frames.get_nowait()
            self.frames.put_nowait(None)


class Hub:
    """Collects entries and sends them to pages. Other threads use `post`, `watched`, `notes` only."""

    def __init__(self) -> None:
        self.clients: set[Client] = set()
        # Troubles of the dashboard itself, a sentence each, by the part affected; "" where there is none.
        self.notes = {"bus": "", "history": ""}
        self._posted: deque[Received] = deque(maxlen=MAX_WAITING)  # its appends are atomic

    def post(self, received: Received) -> None:
        """Add an entry, from any thread; it is dropped while no page is open."""
        if self.clients:
            self._posted.append(received)

    def watched(self, wheel: str) -> bool:
        """Return whether a page shows the samples of a wheel ("spacecraft/wheel")."""
        return any(client.watches == wheel for client in tuple(self.clients))

    async def run(self) -> None:
        """Send frames until cancelled."""
        clock = asyncio.get_running_loop().time
        beat_due = 0.0
        while True:
            await asyncio.sleep(FRAME_PERIOD_S)
            now = clock()
            entries: list[Received] = []
            if now >= beat_due:
                beat_due = now + PERIOD_S  # a page without a beat for some seconds reports that the server is gone
                beat = messages.dump_json({"wall_ns": time.time_ns(), "notes": [*filter(None, self.notes.values())]})
                entries.append(Received(BEAT_KEY, beat, time.time_ns()))
            self._send_frames(entries)

    def _send_frames(self, entries: list[Received]) -> None:
        """Send the collected entries to the pages, after these."""
        statuses: dict[str, Received] = {}
        close_up: list[Received] = []
        for _ in range(len(self._posted)):
            received = self._posted.popleft()
            if received.brief:
                statuses[received.wheel] = received
            elif received.key.rpartition("/")[2] in CLOSE_UP:
                close_up.append(received)
            else:
                entries.append(received)
        entries += pulse(statuses.values())

        @cache
        def frame_of(wheel: str) -> str:
            """Return the frame of the pages that show a wheel, "" where it has no entries."""
            own = [entry for entry in close_up if entry.wheel == wheel]
            shown = [*entries, *([statuses[wheel]] if wheel in statuses else ()), *own]
            return frame(shown) if shown else ""

        for client in tuple(self.clients):
            if text := frame_of(client.watches):
                client.put(text)


def pulse(statuses: Iterable[Received]) -> list[Received]:
    """Return the brief forms of several statuses as one entry; no entry for no status."""
    beats = {one.wheel: one.brief for one in statuses}
    return [Received(PULSE_KEY, object_json(beats), time.time_ns())] if beats else []


def frame(entries: Iterable[Received]) -> str:
    """Return entries as one frame."""
    return array_json(entry.to_json() for entry in entries).decode()


# ---- publication of alarms -------------------------------------------------------------------------------------------


class AlarmNotifier:
    """Publishes changes of alarms to the pages and in …/health; use it with `with`, in any thread.

    The monitor publishes a wheel's health when a window closes. The states of alarms, and who has acknowledged them,
    only the dashboard has. So at each change of an alarm the dashboard publishes the health again, with the states of
    all alarms. Both answer queries on rwa/**/health.

    Parameters
    ----------
    session
        An open Zenoh session; it is left open.
    history
        Of windows and alarms.

    Attributes
    ----------
    hub
        The feed of the pages.
    """

    def __init__(self, session: zenoh.Session, history: History) -> None:
        self.hub = Hub()
        self.session = session
        self.history = history
        self._publishing = Lock()
        self._health = HealthAnswers(session)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._health.close()

    def publish(self, *alarms: AlarmRecord) -> None:
        """Publish changes of alarms to the pages, and on the bus in the health of each wheel that has a window.

        Raises
        ------
        HistoryError
            If the history cannot be read; the changes have been sent to the pages then.
        """
        for alarm in alarms:
            self.hub.post(record_entry(alarm, "alarm"))
        for name in dict.fromkeys((alarm.spacecraft, alarm.wheel) for alarm in alarms):
            self._publish_health(*name)

    def _publish_health(self, spacecraft: str, wheel: str) -> None:
        """Publish the health of a wheel: its latest diagnosis, and all its open alarms.

        For all wheels of a spacecraft together there is no diagnosis, only their common alarms.
        """
        with self._publishing:  # else a state read before a change could be published after it
            latest, records = self.history.windows(spacecraft, wheel, 1), self.history.open_alarms(spacecraft, wheel)
            if latest:
                health = messages.health_message(latest[0])
            elif wheel == ALL_WHEELS:
                health = shared_health(spacecraft, records)
            else:
                return
            health = health.model_copy(update={"alarm_states": states(records)})
            message = health.encoded(spacecraft, wheel)
            timestamp = self._health.stamp(message)
            with suppress(zenoh.ZError):  # the session is closed
                self.session.put(message.topic, message.payload, encoding=message.encoding, timestamp=timestamp)


def shared_health(spacecraft: str, alarms: Sequence[AlarmRecord]) -> Health:
    """Return the health of all wheels of a spacecraft together, from their common open alarms."""
    raised = [alarm for alarm in alarms if alarm.level != "normal"]
    return Health(
        spacecraft=spacecraft,
        wheel=ALL_WHEELS,
        verdict="anomalous" if raised else "nominal",
        severity=0.0,
        reason=" ".join(alarm.reason for alarm in raised) or "Nothing moved in all wheels.",
        window_end_ns=max((alarm.changed_ns for alarm in alarms), default=0),
        alarms=[alarm.name for alarm in raised],
    )


def states(alarms: Iterable[AlarmRecord]) -> dict[str, HealthAlarm]:
    """Return open alarms of a wheel, by name, in the form of the health message."""
    found = {}
    for alarm in alarms:
        if alarm.name.endswith(STORED_ALARM):
            continue  # it is about the past, health about the present
        seen = [line.person for line in alarm.trail if line.event == "acknowledged"]
        by = seen[-1] if seen and alarm.phase == "acknowledged" else None
        found[alarm.name] = HealthAlarm(level=alarm.level, phase=alarm.phase, acknowledged_by=by)
    return found


# ---- messages from the bus -------------------------------------------------------------------------------------------


MAX_WAITING: Final = 10_000  # entries that wait for a frame, and windows that wait for the history
BATCH: Final = 100  # windows, or monitor states, in one transaction: alarms of a thousand wheels take some seconds
# Silence from which a monitor raises an alarm: a restart takes some seconds, and a monitor that diagnoses many wheels
# at once may be late by some seconds, too.
SILENT_S: Final = 30 * PERIOD_S


class Listener(BusThread):
    """Receives messages of the bus for the dashboard.

    Parameters
    ----------
    fleet, notifier
        Messages go to the fleet, and to the notifier's history and pages; they come from the notifier's session.
    log
        Called with each line of the log.
    bus
        Options that the session was opened with.
    silent_s
        Silence from which a wheel's monitor raises an alarm [s]; 0 for none.

    Raises
    ------
    HistoryError
        If the history cannot be read.
    """

    def __init__(self, fleet: Fleet, notifier: AlarmNotifier, log: Log, bus: BusOptions, silent_s: float) -> None:
        self.fleet, self.log = fleet, log
        self.notifier, self.hub, self.history = notifier, notifier.hub, notifier.history
        self._waiting: deque[Diagnosis | Discrepancy | RetirementEvent] = deque(maxlen=MAX_WAITING)
        # Windows whose samples were old by the clock when they arrived.
        self._late: deque[tuple[str, str, int]] = deque(maxlen=MAX_WAITING)
        self._retry_due_s = self._check_due_s = self._prune_due_s = 0.0
        self._watch = BusWatch(notifier.session, bus)
        self._monitors = MonitorWatch(silent_s, self.history.monitors())
        super().__init__(notifier.session, "dashboard listener", KEYS)

    def on_idle(self) -> None:
        """Do what is due by the clock: store waiting windows, check monitors, bus and database."""
        now_s = time.monotonic()
        check_is_due = now_s >= self._check_due_s
        if check_is_due:
            self._check_due_s = now_s + PERIOD_S
            trouble = self._watch.trouble()
            self.hub.notes["bus"] = trouble
            if now_s >= self._retry_due_s:  # before storing, which may take long: all messages so far have been read
                self._report_monitors(trouble)
        if self._waiting and now_s >= self._retry_due_s:
            self._store()
        if check_is_due and not self._waiting:
            self._use_history(self._show_others)
        if now_s >= self._prune_due_s:
            self._prune_due_s = now_s + SECONDS_PER_HOUR
            self._use_history(self.history.prune)

    def _report_monitors(self, trouble: str) -> None:
        """Store which monitors report and which are silent, and publish the alarms that this changes."""
        changes = self._monitors.changes(self.history.retired.names(), trouble)[:BATCH]  # the others later

        def write() -> None:
            changed = self.history.take_monitors(changes)
            self._monitors.mark_stored(changes)
            self.notifier.publish(*changed)

        if changes:
            self._use_history(write)

    def _show_others(self) -> None:
        """Show which wheels other dashboards on the same history have retired or brought back."""
        for event in self.history.retired.refresh():
            self.hub.post(record_entry(event, "retirement"))

    def _use_history(self, work: Callable[[], object]) -> bool:
        """Do something with the history, and log and show the error if that fails; return whether it succeeded."""
        try:
            work()
        except HistoryError as error:
            self._retry_due_s = time.monotonic() + PERIOD_S
            if not self.hub.notes["history"]:
                self.log(str(error))
            self.hub.notes["history"] = f"{error}. {len(self._waiting)} windows wait to be stored."
            return False
        self.hub.notes["history"] = ""
        return True

    def receive(self, key: str, payload: bytes) -> None:
        """Process one message; one that cannot be parsed is dropped."""
        if len(self._waiting) >= BATCH:
            self.on_idle()
        try:
            spacecraft, wheel, kind = messages.split_key(key)
            if kind not in messages.KINDS:
                return
            message = messages.KINDS[kind].parse(payload, key)
            if isinstance(message, SamplesMessage) and message.data == "replay":
                key = messages.replay_key(key)
                wheel = messages.split_key(key)[1]
        except InputError:
            return
        if isinstance(message, Health):
            if message.data == "stored":
                self._late.append((spacecraft, wheel, message.window_end_ns))
            return
        known = self._wheel(spacecraft, wheel)
        if known is None:
            return
        wall_ns, replayed = time.time_ns(), wheel.endswith(messages.REPLAY)
        if isinstance(message, SamplesMessage):
            self._receive_samples(known, key, message, wall_ns)
            return
        if isinstance(message, Diagnosis):
            if (spacecraft, wheel, message.window_end_ns) in self._late:
                message = message.model_copy(update={"data": "stored"})
            self._telemetry_arrived(spacecraft, wheel, message.window_end_ns)
        elif isinstance(message, Status) and not replayed:
            self._monitors.take_status(spacecraft, wheel, message.last_sample_ns)
            # The age of the sample is unknown in the first status.
            if known.status is not None and message.last_sample_ns not in {None, known.status.last_sample_ns}:
                self._telemetry_arrived(spacecraft, wheel)
        self.hub.post(self.fleet.take(known, message, Received(key, message.model_dump_json().encode(), wall_ns)))
        # Replays are not stored in the history.
        if isinstance(message, Diagnosis | Discrepancy) and not replayed:
            self._waiting.append(message)

    def _receive_samples(self, known: Wheel, key: str, message: SamplesMessage, wall_ns: int) -> None:
        spacecraft, wheel, _ = messages.split_key(key)
        self._telemetry_arrived(spacecraft, wheel)
        if not wheel.endswith(messages.REPLAY):
            self._monitors.expect(spacecraft, wheel)
        elif message.time_ns[0] < known.decimated.last_ns:
            known = self.fleet.begin(spacecraft, wheel, []) or known  # a replay that starts again
        if message.data == "stored":
            return  # plots and message intervals are of live samples only
        picked = self.fleet.take_samples(known, message.samples(), wall_ns)
        if len(picked) and self.hub.watched(f"{spacecraft}/{wheel}"):
            self.hub.post(Received(key, thinned_json(picked), wall_ns))

    def _telemetry_arrived(self, spacecraft: str, wheel: str, window_end_ns: int | None = None) -> None:
        """Bring a wheel back to the list if it is retired, and queue the event for the history."""
        event = self.history.retired.telemetry_arrived(spacecraft, wheel, window_end_ns)
        if event is not None:
            self.hub.post(record_entry(event, "retirement"))
            self._waiting.append(event)

    def _wheel(self, spacecraft: str, wheel: str) -> Wheel | None:
        """Return a wheel; a new one with its earlier windows from the history. None where there are too many."""
        known = self.fleet.wheel(spacecraft, wheel)
        if known is not None:
            return known
        earlier: list[Diagnosis] = []
        with suppress(HistoryError):  # then without earlier windows; `_store` reports the error
            earlier = self.history.windows(spacecraft, wheel, REMEMBERED)
        return self.fleet.begin(spacecraft, wheel, earlier)

    def _store(self) -> None:
        """Write waiting messages to the history, and publish changes of alarms."""
        while self._waiting and self._use_history(self._store_some):
            pass

    def _store_some(self) -> None:
        """Store waiting windows in one transaction: flushing one to the disk takes as long as flushing a hundred."""
        some = list(itertools.islice(self._waiting, BATCH))
        diagnoses = [message for message in some if isinstance(message, Diagnosis)]
        self.history.retired.record(message for message in some if isinstance(message, RetirementEvent))
        _, changed = self.history.add(*diagnoses)
        for message in some:
            if isinstance(message, Discrepancy):
                self.history.add_discrepancy(message)
            self._waiting.popleft()
        self.notifier.publish(*changed)


# ---- watch on the monitors -------------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Monitor:
    """The monitor of one wheel; `stored` is its silence as stored in the history, None if nothing is stored.

    `last_s`, and `since` in words, are the time of its last status, or before the first when waiting for it began.
    """

    last_s: float
    since: str
    has_reported: bool = False
    time_ns: int | None = None
    stored: bool | None = None


@dataclass(eq=False)
class MonitorWatch:
    """Watches which wheels have a monitor that reports; a silent one raises an alarm.

    A monitor publishes the status of each of its wheels once a second. It is expected from its first status on, also by
    a dashboard that is started after it died: the history keeps which wheels ever had one. It is also expected where
    samples arrive: with `run --wheels` and `--shard` a wheel may have no monitor. Silence is measured on a monotonic
    clock, from this dashboard's start at the earliest.

    Parameters
    ----------
    silent_s
        Silence from which a monitor raises an alarm [s]; 0 for none.
    expected
        Wheels, by spacecraft and name, whose monitor is in the history, and whether its alarm is raised.
    clock_s, wall_ns
        A monotonic clock [s], and this machine's wall clock [ns].
    """

    silent_s: float
    expected: InitVar[Mapping[tuple[str, str], bool]]
    clock_s: Callable[[], float] = time.monotonic
    wall_ns: Callable[[], int] = time.time_ns

    def __post_init__(self, expected: Mapping[tuple[str, str], bool]) -> None:
        """Expect the monitors of the history from now on."""
        since = f"this dashboard was started, at {time_text(self.wall_ns())}"
        self._monitors = {name: _Monitor(self.clock_s(), since, stored=alarmed) for name, alarmed in expected.items()}

    def take_status(self, spacecraft: str, wheel: str, time_ns: int | None) -> None:
        """Register a status of a wheel's monitor, and the time of the wheel's latest sample [ns], if it has one."""
        known = self._monitors.setdefault((spacecraft, wheel), _Monitor(0.0, ""))
        known.last_s, known.since, known.has_reported = self.clock_s(), time_text(self.wall_ns()), True
        known.time_ns = known.time_ns if time_ns is None else time_ns

    def expect(self, spacecraft: str, wheel: str) -> None:
        """Register that samples of a wheel arrived: it should have a monitor."""
        if (spacecraft, wheel) not in self._monitors:
            since = f"samples of this wheel came first, at {time_text(self.wall_ns())}"
            self._monitors[spacecraft, wheel] = _Monitor(self.clock_s(), since)

    def changes(self, retired: Collection[tuple[str, str]], trouble: str) -> list[MonitorState]:
        """Return the monitors whose state, reporting or silent, differs from that in the history.

        Parameters
        ----------
        retired
            Wheels whose monitors are no longer expected.
        trouble
            A sentence on what is wrong with the dashboard's own connection; "" where nothing is.
        """
        if not self.silent_s:
            return []
        now_s = self.clock_s()
        found = []
        for name, one in self._monitors.items():
            silence_s = now_s - one.last_s
            silent = silence_s > self.silent_s
            if not silent and not one.has_reported:
                continue  # expected, without a status yet: the stored state remains
            if silent != one.stored and not (silent and name in retired):
                reason = f"No monitor has reported since {one.since}: {silence_s:.0f} s and longer. {trouble}".rstrip()
                found.append(MonitorState(*name, silent, one.time_ns, reason if silent else ""))
        return found

    def mark_stored(self, states: Iterable[MonitorState]) -> None:
        """Register that the history holds these states."""
        for state in states:
            self._monitors[state.spacecraft, state.wheel].stored = state.silent
