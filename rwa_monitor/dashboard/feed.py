"""The feed: what comes from the bus goes to every open page, in frames, over one WebSocket each.

A frame is a JSON array of entries {key, received_wall_ns, beside, message}; `message` follows the bus's schema of its
key. What only the view of one wheel shows goes to the pages that show that wheel: samples, changepoints,
the whole status. Of all other statuses a frame holds one pulse. A page that does not keep up is disconnected and
connects again, rather than falling behind unnoticed.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import suppress
from threading import Lock
from typing import Final, Self

import zenoh

from rwa_monitor.dashboard.fleet import Received, record_entry
from rwa_monitor.history.alarms import ALL_WHEELS, STORED_ALARM
from rwa_monitor.history.records import AlarmRecord
from rwa_monitor.history.store import History
from rwa_monitor.messages import PERIOD_S, Health, HealthAlarm, dump_json, health_message
from rwa_monitor.monitor.bus import HealthAnswers

FRAME_PERIOD_S: Final = 0.1
MAX_FRAMES: Final = 100  # that wait for one page
MAX_POSTED: Final = 20_000  # entries that wait for a frame
BEAT_KEY: Final = "dashboard/beat"
PULSE_KEY: Final = "dashboard/pulse"
CLOSE_UP: Final = frozenset({"samples", "changepoints"})  # only for pages that show the wheel


class Client:
    """One open page: the frames that wait for it, and the wheel whose samples it shows."""

    def __init__(self) -> None:
        self.frames: asyncio.Queue[str | None] = asyncio.Queue(MAX_FRAMES)
        self.watches = ""

    def put(self, frame: str) -> None:
        """Queue a frame, or disconnect the page."""
        try:
            self.frames.put_nowait(frame)
        except asyncio.QueueFull:
            with suppress(asyncio.QueueEmpty):
                self.frames.get_nowait()
            self.frames.put_nowait(None)


class Hub:
    """Gathers what comes and hands it out. Everything but `post` and `note` belongs to the event loop."""

    def __init__(self) -> None:
        self.clients: set[Client] = set()
        self.notes: dict[str, str] = {}  # what is wrong with the dashboard itself, in words, by what it is
        self._posted: deque[Received] = deque(maxlen=MAX_POSTED)  # its appends are atomic

    def post(self, received: Received) -> None:
        """Take a message, from any thread; it is dropped while no page is open."""
        if self.clients:
            self._posted.append(received)

    def note(self, what: str, trouble: str) -> None:
        """Report to every page what is wrong with something of the dashboard, "" where nothing is."""
        if trouble:
            self.notes[what] = trouble
        else:
            self.notes.pop(what, None)

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
                beat_due = now + PERIOD_S  # a page without a beat for some seconds takes the server for gone
                beat = dump_json({"wall_ns": time.time_ns(), "notes": [*self.notes.values()]})
                entries.append(Received(BEAT_KEY, beat, time.time_ns()))
            self._hand_out(entries)

    def _hand_out(self, entries: list[Received]) -> None:
        """Hand out what has been gathered, behind these entries."""
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
        frames: dict[str, str] = {}  # pages that show the same get the same
        for client in tuple(self.clients):
            watches = client.watches
            if watches not in frames:
                own = [entry for entry in close_up if entry.wheel == watches]
                shown = [*entries, *([statuses[watches]] if watches in statuses else ()), *own]
                frames[watches] = frame(shown) if shown else ""
            if frames[watches]:
                client.put(frames[watches])


def pulse(statuses: Iterable[Received]) -> list[Received]:
    """Return what several statuses come to in brief, as one entry; none of none."""
    beats = b",".join(b'"%b":%b' % (one.wheel.encode(), one.brief) for one in statuses)
    return [Received(PULSE_KEY, b"{" + beats + b"}", time.time_ns())] if beats else []


def frame(entries: Iterable[Received]) -> str:
    """Return entries as one frame."""
    return array_json(entry.to_json() for entry in entries).decode()


def array_json(parts: Iterable[bytes]) -> bytes:
    """Return JSON values as one array."""
    return b"[" + b",".join(parts) + b"]"


# ---- alarms on their way out -----------------------------------------------------------------------------------------


class AlarmNotifier:
    """Reports changes of alarms, to the pages and in …/health, for which it answers; use it with `with`, in any thread.

    The monitor publishes a wheel's health at each window's close. How many windows in a row were bad, and who has
    acknowledged what, only the dashboard has. So at each change of an alarm the dashboard publishes the health again,
    with the state of all alarms. Both answer queries on rwa/**/health.

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
        self._session = session
        self._history = history
        self._publishing = Lock()
        self._health = HealthAnswers(session)
        self._queryable = self._health.offer()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        with suppress(zenoh.ZError):  # the session may have been closed under us
            self._queryable.undeclare()

    def publish(self, *alarms: AlarmRecord) -> None:
        """Report changes of alarms to the pages, and on the bus in the health of each wheel that has a window.

        Raises
        ------
        HistoryError
            If the history cannot be read; the pages have them then.
        """
        for alarm in alarms:
            self.hub.post(record_entry(alarm, "alarm"))
        for name in dict.fromkeys((alarm.spacecraft, alarm.wheel) for alarm in alarms):
            self._publish_health(*name)

    def _publish_health(self, spacecraft: str, wheel: str) -> None:
        """Publish the health of a wheel: its latest diagnosis, and all its alarms that are not closed.

        Of all wheels of a spacecraft there is no diagnosis, only what they share.
        """
        with self._publishing:  # else what was read before a change could be published after it
            latest, records = self._history.windows(spacecraft, wheel, 1), self._history.open_alarms(spacecraft, wheel)
            if latest:
                health = health_message(latest[0])
            elif wheel == ALL_WHEELS:
                health = shared_health(spacecraft, records)
            else:
                return
            health = health.model_copy(update={"alarm_states": states(records)})
            message = health.encoded(spacecraft, wheel)
            timestamp = self._health.stamp(message)
            with suppress(zenoh.ZError):  # the session is closed; a later query is answered
                self._session.put(message.topic, message.payload, encoding=message.encoding, timestamp=timestamp)


def shared_health(spacecraft: str, alarms: Sequence[AlarmRecord]) -> Health:
    """Return the health of what all wheels of a spacecraft share, by its open alarms."""
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
    """Return open alarms of a wheel, by name, as the health message has them."""
    found = {}
    for alarm in alarms:
        if alarm.name.endswith(STORED_ALARM):
            continue  # it is of earlier, and health of now
        seen = [line.person for line in alarm.trail if line.event == "acknowledged"]
        by = seen[-1] if seen and alarm.phase == "acknowledged" else None
        found[alarm.name] = HealthAlarm(level=alarm.level, phase=alarm.phase, acknowledged_by=by)
    return found
