"""To whom the dashboard tells of alarms: pages, another service, the bus."""

from __future__ import annotations

import time
from dataclasses import dataclass

from rwa_monitor.dashboard.feed import Hub
from rwa_monitor.dashboard.fleet import Received
from rwa_monitor.dashboard.health_publisher import Herald
from rwa_monitor.dashboard.webhook import Webhook
from rwa_monitor.history.records import AlarmRecord


@dataclass(frozen=True, slots=True)
class Voices:
    """The feed of the pages, the webhook, the voice on the bus; they may be used from any thread."""

    hub: Hub
    webhook: Webhook
    herald: Herald

    def announce(self, alarm: AlarmRecord) -> None:
        """Tell of a change of an alarm; on the bus in the health of its wheel, if that has a window.

        Raises
        ------
        HistoryError
            If the history cannot be read; pages and webhook are told then.
        """
        self.show(alarm)
        self.herald.tell(alarm.spacecraft, alarm.wheel)

    def show(self, alarm: AlarmRecord) -> None:
        """Tell pages and webhook of a change of an alarm."""
        self.hub.post(alarm_entry(alarm))
        self.webhook.tell(alarm)


def alarm_entry(alarm: AlarmRecord) -> Received:
    """Return an alarm as an entry of the feed."""
    return Received(f"rwa/{alarm.spacecraft}/{alarm.wheel}/alarm", alarm.to_json(), time.time_ns())
