"""Where the dashboard reports alarms: on pages, to another service, on the bus."""

from __future__ import annotations

import urllib.error
import urllib.request
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from threading import Event, Lock, Thread
from typing import Any, Final, Self
from urllib.parse import urlsplit

import zenoh

from rwa_monitor.dashboard.feed import Hub
from rwa_monitor.dashboard.fleet import record_entry
from rwa_monitor.errors import InputError
from rwa_monitor.history.records import AlarmRecord
from rwa_monitor.history.store import History
from rwa_monitor.messages import Health, HealthAlarm, health_message, key_of


@dataclass(frozen=True, slots=True)
class AlarmNotifier:
    """The feed of the pages, the webhook, the health on the bus; they may be used from any thread."""

    hub: Hub
    webhook: Webhook
    health: HealthPublisher

    def publish(self, alarm: AlarmRecord) -> None:
        """Report a change of an alarm; on the bus in the health of its wheel, if that has a window.

        Raises
        ------
        HistoryError
            If the history cannot be read; pages and webhook have it then.
        """
        self.show(alarm)
        self.health.publish(alarm.spacecraft, alarm.wheel)

    def show(self, alarm: AlarmRecord) -> None:
        """Report a change of an alarm to pages and webhook."""
        self.hub.post(record_entry(alarm, "alarm"))
        self.webhook.post(alarm)


# ---- the webhook -----------------------------------------------------------------------------------------------------


TIMEOUT_S: Final = 5.0
FIRST_WAIT_S: Final = 1.0  # before it is tried again; twice as long after each failure
LONGEST_WAIT_S: Final = 60.0
MAX_WAITING: Final = 1_000  # changes; of more, the oldest are given up
IDLE_WAIT_S: Final = 0.5


class Webhook:
    """Posts each change of an alarm to a URL, as JSON, until it is taken; use it with `with`.

    It works in a thread of its own, so that nothing waits for the other side.

    Parameters
    ----------
    url
        http or https; None for no webhook.
    hub
        Where it notes that the other side does not answer.

    Raises
    ------
    InputError
        If the URL is none.
    """

    def __init__(self, url: str | None, hub: Hub) -> None:
        if url is not None and (urlsplit(url).scheme not in {"http", "https"} or not urlsplit(url).hostname):
            raise InputError("--webhook", f"{url!r} is no http or https URL")
        self._url = url
        self._hub = hub
        self._waiting: deque[bytes] = deque(maxlen=MAX_WAITING)
        self._stop, self._wake = Event(), Event()
        self._thread = Thread(target=self._run, name="webhook", daemon=True)

    def __enter__(self) -> Self:
        if self._url is not None:
            self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._wake.set()
        if self._url is not None:
            self._thread.join()

    def post(self, alarm: AlarmRecord) -> None:
        """Have a change of an alarm posted; from any thread."""
        if self._url is not None:
            self._waiting.append(alarm.to_json())
            self._wake.set()

    def _run(self) -> None:
        wait_s = FIRST_WAIT_S
        while not self._stop.is_set():
            if not self._waiting:
                self._wake.clear()
                self._wake.wait(IDLE_WAIT_S)
                continue
            payload = self._waiting[0]
            trouble = self._post(payload)
            if trouble:
                self._hub.note("webhook", f"The webhook does not take alarms: {trouble}. {len(self._waiting)} wait.")
                self._stop.wait(wait_s)
                wait_s = min(2.0 * wait_s, LONGEST_WAIT_S)
                continue
            if self._waiting and self._waiting[0] is payload:
                self._waiting.popleft()
            self._hub.note("webhook", "")
            wait_s = FIRST_WAIT_S

    def _post(self, payload: bytes) -> str:
        """Post once; returns in words what went wrong, "" where nothing did."""
        assert self._url is not None  # nothing runs without one
        request = urllib.request.Request(  # noqa: S310 - http or https, as checked at the start
            self._url, data=payload, headers={"Content-Type": "application/json"}
        )
        try:
            with urllib.request.urlopen(request, timeout=TIMEOUT_S):  # noqa: S310
                return ""
        except urllib.error.HTTPError as error:
            with error:
                return f"it answers {error.code}"
        except (OSError, ValueError) as error:
            return str(getattr(error, "reason", error))


# ---- health on the bus -----------------------------------------------------------------------------------------------


class HealthPublisher:
    """Publishes …/health at each change of an alarm, and answers queries for it; use it with `with`, in any thread.

    The monitor publishes a wheel's health at each window's close. How many windows in a row were bad, and who has
    acknowledged what, only the dashboard has. So at each change of an alarm the dashboard publishes the health again,
    with the state of all alarms. Both answer queries on rwa/**/health; every answer carries the time at which it was
    published, of which Zenoh gives the latest for each wheel.

    Parameters
    ----------
    session
        An open Zenoh session; it is left open.
    history
        Of windows and alarms.
    """

    def __init__(self, session: zenoh.Session, history: History) -> None:
        self._session = session
        self._history = history
        self._publishing = Lock()
        self._latest: dict[str, tuple[bytes, Any]] = {}
        self._queryable: Any = session.declare_queryable("rwa/**/health", self._answer)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        with suppress(zenoh.ZError):  # the session may have been closed under us
            self._queryable.undeclare()

    def publish(self, spacecraft: str, wheel: str) -> None:
        """Publish the health of a wheel: its latest diagnosis, and all its alarms that are not closed.

        Raises
        ------
        HistoryError
            If the history cannot be read.
        """
        with self._publishing:  # else what was read before a change could be published after it
            latest = self._history.windows(spacecraft, wheel, 1)
            if not latest:
                return
            alarms = states(self._history.open_alarms(spacecraft, wheel))
            health = health_message(latest[0]).model_copy(update={"alarm_states": alarms})
            key, payload = key_of(Health, spacecraft, wheel), health.to_json()
            timestamp = self._session.new_timestamp()
            self._latest[key] = payload, timestamp
            with suppress(zenoh.ZError):  # the session is closed; a later query is answered
                self._session.put(key, payload, encoding=Health.encoding(), timestamp=timestamp)

    def _answer(self, query: zenoh.Query) -> None:
        """Called in Zenoh's threads."""
        for key, (payload, timestamp) in dict(self._latest).items():  # a copy: others publish meanwhile
            if query.key_expr.intersects(zenoh.KeyExpr(key)):
                query.reply(key, payload, encoding=Health.encoding(), timestamp=timestamp)
        query.drop()  # type: ignore[no-untyped-call]


def states(alarms: Iterable[AlarmRecord]) -> dict[str, HealthAlarm]:
    """Return the open ones of a wheel's alarms, by name, as the health message has them."""
    found = {}
    for alarm in alarms:
        if alarm.closed_ns is None:
            seen = [line.person for line in alarm.trail if line.event == "acknowledged"]
            by = seen[-1] if seen and alarm.phase == "acknowledged" else None
            found[alarm.name] = HealthAlarm(level=alarm.level, phase=alarm.phase, acknowledged_by=by)
    return found
