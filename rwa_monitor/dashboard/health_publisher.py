"""Tells the bus of alarms: …/health at each change of an alarm, and to whoever asks for it.

The monitor tells a wheel's health at each window's close. What it cannot know is what the dashboard keeps: how many
windows in a row were bad, and who has acknowledged what. So at each change of an alarm the dashboard tells the health
again, with the state of all alarms. Both answer questions on rwa/**/health; every answer carries the time at which it
was published, of which Zenoh gives the asker the latest for each wheel.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from threading import Lock
from typing import Any, Self

import zenoh

from rwa_monitor.history.records import AlarmRecord
from rwa_monitor.history.store import History
from rwa_monitor.messages import Health, HealthAlarm, health_message, key_of


class Herald:
    """The dashboard's voice on the bus; use it with `with`. It may be called from any thread.

    Parameters
    ----------
    session
        An open Zenoh session; it is left open.
    history
        What is known of windows and alarms.
    """

    def __init__(self, session: zenoh.Session, history: History) -> None:
        self._session = session
        self._history = history
        self._telling = Lock()
        self._latest: dict[str, tuple[bytes, Any]] = {}
        self._queryable: Any = session.declare_queryable("rwa/**/health", self._answer)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        with suppress(zenoh.ZError):  # the session may have been closed under us
            self._queryable.undeclare()

    def tell(self, spacecraft: str, wheel: str) -> None:
        """Publish the health of a wheel: its latest diagnosis, and all its alarms that are not closed.

        Raises
        ------
        HistoryError
            If the history cannot be read.
        """
        with self._telling:  # else what was read before a change could be told after it
            latest = self._history.windows(spacecraft, wheel, 1)
            if not latest:
                return
            alarms = states(self._history.open_alarms(spacecraft, wheel))
            health = health_message(latest[0]).model_copy(update={"alarm_states": alarms})
            key, payload = key_of(Health, spacecraft, wheel), health.to_json()
            timestamp = self._session.new_timestamp()
            self._latest[key] = payload, timestamp
            with suppress(zenoh.ZError):  # nobody is there to hear it; who asks later is answered
                self._session.put(key, payload, encoding=Health.encoding(), timestamp=timestamp)

    def _answer(self, query: zenoh.Query) -> None:
        """Called in Zenoh's threads."""
        for key, (payload, timestamp) in dict(self._latest).items():  # a copy: others tell meanwhile
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
