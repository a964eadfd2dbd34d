"""The state of the fleet just now: the latest message of each kind of each wheel, in memory."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Final, Literal

from rwa_monitor.dashboard.telemetry import DecimatedSamples, DerivedFriction, Evidence, OpenWindow, Rhythm
from rwa_monitor.history.records import AlarmRecord, RetirementEvent
from rwa_monitor.messages import Changepoints, Diagnosis, Discrepancy, Message, Status, dump_json, key_of
from rwa_monitor.monitor.setup import WheelSet
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.wheel import Wheel as WheelConstants
from rwa_monitor.wheel.wheel import built_in_wheel

MAX_WHEELS: Final = 5_000
SHOWN_WINDOWS: Final = 2  # closed ones, that a picture spans beside the open one
MAX_PROVISIONAL: Final = 200  # changepoints of a running window that are kept
MAX_OPEN_SAMPLES: Final = 8_000_000  # of all open windows: 128 MB, 100 wheels with windows of 80,000 slots
NOTICEABLE: Final = 0.1  # change of the severity from one window to the next that is worth an arrow
ERRORS: Final = 2.0  # and in standard deviations of the change: less is scatter of the estimates
REMEMBERED: Final = 50  # windows that a verdict history is begun with

Change = Literal["worse", "better", "steady"]


@dataclass(frozen=True, slots=True)
class Received:
    """A message in JSON, its key, and when it was received [ns, this machine's clock; None: from the history].

    `beside` is what the dashboard adds, as JSON: to a status, when samples came last (`Rhythm`); to a diagnosis, what
    earlier windows show (`VerdictHistory`). `brief` is the part for pages that do not show this wheel, "" for all.
    """

    key: str
    payload: bytes
    wall_ns: int | None
    beside: bytes = b"null"
    brief: bytes = b""

    @property
    def wheel(self) -> str:
        """Spacecraft and wheel, as the page names them."""
        return self.key.split("/", 1)[1].rpartition("/")[0]

    def to_json(self) -> bytes:
        """Return it as an entry of the feed."""
        wall = b"null" if self.wall_ns is None else str(self.wall_ns).encode()
        head = b'{"key":"' + self.key.encode() + b'","received_wall_ns":' + wall + b',"beside":' + self.beside
        return head + b',"message":' + self.payload + b"}"


def record_entry(record: AlarmRecord | RetirementEvent, kind: str) -> Received:
    """Return a change of an alarm, or an audit event of the list of wheels, as an entry of the feed."""
    return Received(f"rwa/{record.spacecraft}/{record.wheel}/{kind}", record.to_json(), time.time_ns())


@dataclass(slots=True)
class VerdictHistory:
    """Since when a wheel has its present verdict, and whether it gets worse.

    Attributes
    ----------
    since_ns
        Beginning of the first of the windows in a row with the present verdict [ns, wheel's clock].
    windows
        How many these are.
    change
        Where the worst severity goes, steady where its errors allow that; None unless the last two windows are
        anomalous.
    """

    since_ns: int | None = None
    windows: int = 0
    change: Change | None = None
    _last: Diagnosis | None = None

    def extend(self, diagnoses: Iterable[Diagnosis]) -> None:
        """Take in windows, the oldest first; one that is not later than the last one changes nothing."""
        for window in diagnoses:
            before = self._last
            if before is not None and window.window_end_ns <= before.window_end_ns:
                continue
            same = before is not None and before.verdict == window.verdict
            if not same:
                self.since_ns, self.windows = window.window_start_ns, 0
            self.windows += 1
            self.change = None
            if same and before is not None and window.verdict == "anomalous":
                self.change = _change(before, window)
            self._last = window

    def to_json(self) -> bytes:
        """Return it as it goes with a diagnosis in the feed."""
        return dump_json({"since_ns": self.since_ns, "windows": self.windows, "change": self.change})


def _change(before: Diagnosis, after: Diagnosis) -> Change:
    """Return where the worst severity goes from one anomalous window to the next."""
    (was, was_std), (now, now_std) = _worst(before), _worst(after)
    step = now - was
    if abs(step) <= max(NOTICEABLE, ERRORS * math.hypot(was_std, now_std)):
        return "steady"
    return "worse" if step > 0.0 else "better"


def _worst(window: Diagnosis) -> tuple[float, float]:
    """Return the largest severity of a window's active anomalies and its standard deviation; 0 where none is known."""
    found = [(one.severity, one.severity_std or 0.0) for one in window.anomalies.values() if one.active]
    return max(((severity, std) for severity, std in found if severity is not None), default=(0.0, 0.0))


@dataclass(slots=True)
class Wheel:
    """What is known of one wheel; `latest` holds the last message of each kind."""

    derived: DerivedFriction
    latest: dict[str, Received] = field(default_factory=dict)
    provisional: list[Received] = field(default_factory=list)
    decimated: DecimatedSamples = field(default_factory=DecimatedSamples)
    open_window: OpenWindow = field(default_factory=OpenWindow)
    rhythm: Rhythm = field(default_factory=Rhythm)
    verdicts: VerdictHistory = field(default_factory=VerdictHistory)
    diagnosis: Diagnosis | None = None
    status: Status | None = None
    curves: deque[bytes] = field(default_factory=lambda: deque(maxlen=SHOWN_WINDOWS))
    curve_due_ns: int = 0

    @property
    def constants(self) -> WheelConstants:
        """What the wheel is, where its friction is derived."""
        return self.derived.wheel


class Fleet:
    """All wheels. One thread writes; the threads of the API read.

    Parameters
    ----------
    constants
        Of the wheels, for friction that is derived from current; None: the built-in wheel's.
    """

    def __init__(self, constants: WheelSet | None = None) -> None:
        self.lock = Lock()
        self.constants = constants or WheelSet(built_in_wheel())
        self._open_samples = 0
        self._wheels: dict[tuple[str, str], Wheel] = {}

    def wheel(self, spacecraft: str, wheel: str) -> Wheel | None:
        """Return a wheel; None where it is not known."""
        with self.lock:
            return self._wheels.get((spacecraft, wheel))

    def begin(self, spacecraft: str, wheel: str, earlier: list[Diagnosis]) -> Wheel | None:
        """Return a wheel, known from now on with its earlier windows; None where there are too many."""
        with self.lock:
            if len(self._wheels) >= MAX_WHEELS:
                return None
            constants = self.constants.of(spacecraft, wheel)
            known = self._wheels.setdefault((spacecraft, wheel), Wheel(DerivedFriction(constants)))
            known.verdicts.extend(earlier)
            return known

    def names(self) -> list[tuple[str, str]]:
        """Return spacecraft and name of all wheels, sorted."""
        with self.lock:
            return sorted(self._wheels)

    def wheels(self) -> list[tuple[str, str, Wheel]]:
        """Return all wheels with their names, sorted; to be looked at while the lock is held."""
        return [(*name, self._wheels[name]) for name in sorted(self._wheels)]

    def take(self, wheel: Wheel, message: Message, received: Received) -> tuple[Received, Received | None]:
        """Bring a message into the picture of its wheel.

        Returns
        -------
        shown, curve
            The message as it is shown; and the wGLR of the window that it closes, if it is a diagnosis.
        """
        with self.lock:
            match message:
                case Discrepancy():
                    wheel.latest[Discrepancy.kind] = received
                case Status():
                    wheel.status = message
                    wall_ns = received.wall_ns or 0
                    wheel.rhythm.take_status(message.last_sample_ns, wall_ns)
                    rhythm = wheel.rhythm.to_json()
                    pulse = b'{"heard_wall_ns":%d,"window_fill":%.4f,"telemetry":%b,"refused":%b}' % (
                        wall_ns,
                        message.window_fill,
                        rhythm,
                        dump_json(_refused(message)),
                    )
                    received = replace(received, beside=rhythm, brief=pulse)
                    wheel.latest[Status.kind] = received
                case Changepoints():
                    wheel.provisional = [*wheel.provisional, received][-MAX_PROVISIONAL:]
                case Diagnosis():
                    wheel.verdicts.extend([message])
                    received = replace(received, beside=wheel.verdicts.to_json())
                    return received, self._close(wheel, message, received)
            return received, None

    def _close(self, wheel: Wheel, window: Diagnosis, received: Received) -> Received | None:
        wheel.latest[Diagnosis.kind] = received
        wheel.diagnosis = window
        wheel.provisional.clear()
        # The picture spans this window and as much before it.
        wheel.decimated.keep_from(2 * window.window_start_ns - window.window_end_ns)
        curve = wheel.open_window.evidence(window, wheel.constants)
        before = wheel.open_window.count
        # Windows may overlap: what the next one holds is kept.
        hop = wheel.constants.window.hop_slots / wheel.constants.window.samples
        length_ns = window.window_end_ns - window.window_start_ns
        wheel.open_window.keep_from(window.window_start_ns + int(min(hop, 1.0) * length_ns))
        self._open_samples += wheel.open_window.count - before
        if curve is None:
            return None
        key = key_of(Evidence, window.spacecraft, window.wheel)
        wheel.curves.append(curve.to_json())
        return Received(key, wheel.curves[-1], received.wall_ns)

    def take_samples(self, wheel: Wheel, samples: Samples, wall_ns: int, *, watched: bool) -> Samples:
        """Bring samples into the picture; returns those that are picked for it.

        The open windows' samples are kept while there is room for them; one that a page shows goes before others.
        """
        with self.lock:
            wheel.rhythm.take_samples(samples.time_ns, wall_ns)
            known = wheel.derived.add(samples)
            before = wheel.open_window.count
            if self._open_samples + len(known) <= MAX_OPEN_SAMPLES or watched:
                wheel.open_window.add(known)
            else:
                wheel.open_window.clear()
            if wheel.open_window.count > MAX_OPEN_SAMPLES:
                wheel.open_window.clear()  # a wheel that is never diagnosed
            self._open_samples += wheel.open_window.count - before
            return wheel.decimated.add(known)

    def snapshot(self) -> list[Received]:
        """Return the latest diagnosis and status of every wheel, for a page that opens."""
        with self.lock:
            kinds = (Diagnosis.kind, Status.kind)
            return [wheel.latest[kind] for wheel in self._wheels.values() for kind in kinds if kind in wheel.latest]


def _refused(status: Status) -> str | None:
    """Return why a wheel of which no message could be used has none; None where one was, or none has come."""
    if status.samples_received or not status.messages_rejected:
        return None
    return status.last_error or "the monitor gives no reason"
