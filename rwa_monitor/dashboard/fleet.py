"""What the dashboard knows of the fleet just now: the latest message of each kind of each wheel, in memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from threading import Lock
from typing import Final

from rwa_monitor.dashboard.trace import Trace
from rwa_monitor.messages import Changepoints, Diagnosis, Message, Status

MAX_WHEELS: Final = 5_000
MAX_PROVISIONAL: Final = 200  # changepoints of a running window that are kept


@dataclass(frozen=True, slots=True)
class Received:
    """A message in JSON, its key, and when it was received [ns, this machine's clock; None: from the history]."""

    key: str
    payload: bytes
    wall_ns: int | None

    def to_json(self) -> bytes:
        """Return it as an entry of the feed."""
        wall = b"null" if self.wall_ns is None else str(self.wall_ns).encode()
        return b'{"key":"' + self.key.encode() + b'","received_wall_ns":' + wall + b',"message":' + self.payload + b"}"


@dataclass(slots=True)
class Wheel:
    """What is known of one wheel; `latest` holds the last message of each kind."""

    latest: dict[str, Received] = field(default_factory=dict)
    provisional: list[Received] = field(default_factory=list)
    trace: Trace = field(default_factory=Trace)
    watched: bool = False


class Fleet:
    """All wheels. One thread writes; the threads of the API read."""

    def __init__(self) -> None:
        self.lock = Lock()
        self._wheels: dict[tuple[str, str], Wheel] = {}

    def wheel(self, spacecraft: str, wheel: str) -> Wheel | None:
        """Return a wheel, known from now on; None where there are too many."""
        key = (spacecraft, wheel)
        with self.lock:
            if key not in self._wheels:
                if len(self._wheels) >= MAX_WHEELS:
                    return None
                self._wheels[key] = Wheel()
            return self._wheels[key]

    def names(self) -> list[tuple[str, str]]:
        """Return spacecraft and name of all wheels, sorted."""
        with self.lock:
            return sorted(self._wheels)

    def take(self, wheel: Wheel, message: Message, received: Received) -> None:
        """Bring a message into the picture of its wheel."""
        with self.lock:
            match message:
                case Status():
                    wheel.latest[Status.kind] = received
                case Changepoints():
                    wheel.provisional = [*wheel.provisional, received][-MAX_PROVISIONAL:]
                case Diagnosis():
                    wheel.latest[Diagnosis.kind] = received
                    wheel.provisional.clear()
                    wheel.trace.keep_from(2 * message.window_start_ns - message.window_end_ns)

    def snapshot(self) -> list[Received]:
        """Return the latest diagnosis and status of every wheel, for a page that opens."""
        with self.lock:
            return [received for wheel in self._wheels.values() for received in wheel.latest.values()]
