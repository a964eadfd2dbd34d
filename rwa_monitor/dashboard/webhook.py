"""Tells another service of alarms: one HTTP POST for each change, as JSON, in a thread that holds nobody up."""

from __future__ import annotations

import urllib.error
import urllib.request
from collections import deque
from threading import Event, Thread
from typing import Final, Self
from urllib.parse import urlsplit

from rwa_monitor.dashboard.feed import Hub
from rwa_monitor.errors import InputError
from rwa_monitor.history.records import AlarmRecord

TIMEOUT_S: Final = 5.0
FIRST_WAIT_S: Final = 1.0  # before it is tried again; twice as long after each failure
LONGEST_WAIT_S: Final = 60.0
MAX_WAITING: Final = 1_000  # changes; of more, the oldest are given up
IDLE_WAIT_S: Final = 0.5


class Webhook:
    """Posts alarms to a URL, each until it is taken; use it with `with`.

    Parameters
    ----------
    url
        http or https; None to tell nobody.
    hub
        Where it says that the other side does not answer.

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

    def tell(self, alarm: AlarmRecord) -> None:
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
