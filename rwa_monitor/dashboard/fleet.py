"""The current state of the fleet: the latest message of each kind of each wheel, in memory."""

import time
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rwa_monitor import messages
from rwa_monitor.history.database import AlarmRecord, RetirementEvent
from rwa_monitor.messages import Changepoints, Diagnosis, Discrepancy, Message, Status
from rwa_monitor.monitor.setup import Setup
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, FloatArray, IntArray, Samples, SlotGrid, concatenate
from rwa_monitor.wheel.torque_balance import corrected_friction, motor_torque, slots_around
from rwa_monitor.wheel.wheel import Wheel as WheelConstants

KEYS: Final = "rwa/*/*/*"  # on the bus
MAX_PROVISIONAL: Final = 200  # changepoints of an open window that are kept
REMEMBERED: Final = 50  # windows that a verdict history keeps, and is initialised with


# ---- samples for the page: derived friction, and the intervals between messages --------------------------------------


MAX_SLOTS_PER_SAMPLE: Final = 8  # slots per sample up to which samples are assigned to the slot grid
LEAST_STALE_S: Final = 10.0
FIRST_STALE_S: Final = 60.0  # until the first message
KEPT_INTERVALS: Final = 8  # intervals between messages that are kept
MAX_LIVE_SPEED: Final = 2_000.0  # times real time: messages at shorter intervals are from a history, and do not count


class DerivedFriction:
    """Derives the friction torque of samples without one from motor torque or current, with the wheel's constants.

    The derivative needs some slots on either side, so that samples are returned with that delay; samples that have a
    friction torque, and those from which none can be derived, are returned as they are.
    """

    def __init__(self, wheel: WheelConstants) -> None:
        self.wheel = wheel
        self._before, self._after = slots_around(wheel)
        self._tail: Samples | None = None
        self._returned_ns = -1  # time of the last sample that was returned

    def add(self, samples: Samples) -> Samples:
        """Add samples; return those whose friction is known now."""
        torque = motor_torque(samples, self.wheel)
        if samples.friction_torque_Nm is not None or torque is None or self.wheel.inertia_kg_m2 is None:
            return samples
        temp = _known(samples.bearing_temperature_degC, len(samples))
        joined = Samples(samples.time_ns, samples.speed_rad_s, motor_torque_Nm=torque, bearing_temperature_degC=temp)
        tail, period_ns = self._tail, self.wheel.period_ns
        if tail is not None and 0 < joined.time_ns[0] - tail.time_ns[-1] <= (self._before + self._after) * period_ns:
            joined = concatenate([tail, joined])
        slot = SlotGrid(int(joined.time_ns[0]), period_ns).slot_of(joined.time_ns)
        if np.any(np.diff(slot) <= 0) or slot[-1] >= MAX_SLOTS_PER_SAMPLE * len(joined):
            self._tail = None
            return samples
        assert joined.motor_torque_Nm is not None  # given above, in both parts
        speed, torque = _on_grid(slot, joined.speed_rad_s), _on_grid(slot, joined.motor_torque_Nm)
        friction = corrected_friction(speed, torque, self.wheel)[slot]
        end = int(slot[-1]) - self._after
        self._tail = joined[slot > end - self._before]
        ready = (slot <= end) & (joined.time_ns > self._returned_ns)
        if ready.any():
            self._returned_ns = int(joined.time_ns[ready][-1])
        left = joined[ready]
        return Samples(
            left.time_ns, left.speed_rad_s, friction[ready], bearing_temperature_degC=left.bearing_temperature_degC
        )


def _on_grid(slots: IntArray, values: NDArray[np.floating[Any]]) -> FloatArray:
    """Return values on the slot grid, NaN in slots without one."""
    grid = np.full(int(slots.max()) + 1, np.nan)
    grid[slots] = values
    return grid


class ArrivalTimes:
    """When a wheel's samples last arrived, and after what time they are stale, by this machine's clock.

    Telemetry may arrive every second, every half minute, or once in a pass: the limit follows from the wheel's own
    intervals. Until enough are known, the next message is expected after the time that the latest one spans.
    """

    def __init__(self) -> None:
        self.wall_ns: int | None = None
        self._span_s = FIRST_STALE_S / messages.INTERVALS_TILL_LATE
        self._last_sample_ns: int | None = None
        self._intervals: deque[float] = deque(maxlen=KEPT_INTERVALS)

    def take_samples(self, time_ns: IntArray, wall_ns: int) -> None:
        """Register a message of samples."""
        self._span_s = float(time_ns[-1] - time_ns[0]) / NANOSECONDS_PER_SECOND
        if self.wall_ns is not None:
            interval_s = (wall_ns - self.wall_ns) / NANOSECONDS_PER_SECOND
            if interval_s > self._span_s / MAX_LIVE_SPEED:
                self._intervals.append(interval_s)
        self.wall_ns = wall_ns

    def take_status(self, last_sample_ns: int | None, wall_ns: int) -> None:
        """Register the latest sample of a status: its progress is used if no samples are received.

        The first status starts the interval, since the age of its sample is unknown.
        """
        goes_on = last_sample_ns is not None and last_sample_ns != self._last_sample_ns
        if self.wall_ns is None or (goes_on and not self._intervals):
            self.wall_ns = wall_ns
        self._last_sample_ns = last_sample_ns

    @property
    def stale_after_s(self) -> float:
        """Silence after which the samples are stale [s]."""
        known = len(self._intervals) >= KEPT_INTERVALS // 2
        expected_s = max(self._intervals) if known else self._span_s
        return max(LEAST_STALE_S, messages.INTERVALS_TILL_LATE * expected_s)

    def shown(self) -> dict[str, float | None]:
        """Return the content of `beside` of a status in the feed."""
        return {"wall_ns": self.wall_ns, "stale_after_s": round(self.stale_after_s, 3)}


# ---- samples decimated for plots -------------------------------------------------------------------------------------


MAX_POINTS: Final = 6_000  # a screen is some 1,500 pixels wide, and a plot spans up to two windows


class DecimatedSamples:
    """The latest samples of one wheel, every `stride`-th of them; the stride doubles when they are too many.

    Samples are decimated, not averaged, so that plots show the noise. Samples before `keep_from` are dropped.
    """

    def __init__(self) -> None:
        self.stride = 1
        self._phase = 0  # samples to skip before the next one that is picked
        self._kept = _shown(Samples(np.zeros(0, dtype=np.int64), np.zeros(0)))

    def add(self, samples: Samples) -> Samples:
        """Add samples; returns those that were picked, in the form that is shown."""
        picked = _shown(samples[self._phase :: self.stride])
        self._phase = (self._phase - len(samples)) % self.stride
        self._kept = concatenate([self._kept, picked])
        if len(self._kept) > MAX_POINTS:
            self._thin()
        return picked

    @property
    def last_ns(self) -> int:
        """Time of the last sample that was picked, -1 before the first [ns]."""
        return int(self._kept.time_ns[-1]) if len(self._kept) else -1

    def keep_from(self, time_ns: int) -> None:
        """Drop samples before a time; the stride doubles if more than half of `MAX_POINTS` remain."""
        self._kept = self._kept[self._kept.time_ns >= time_ns]
        if len(self._kept) > MAX_POINTS // 2:
            self._thin()

    def _thin(self) -> None:
        self.stride *= 2
        self._phase = 0
        self._kept = self._kept[::2]

    def message(self) -> bytes:
        """Return the samples as the JSON of a `SamplesMessage`, "null" where there are none."""
        return thinned_json(self._kept) if len(self._kept) else b"null"


def thinned_json(picked: Samples) -> bytes:
    """Return samples that were picked as the JSON of a `SamplesMessage`."""
    if np.isnan(_known(picked.bearing_temperature_degC, len(picked))).all():  # most wheels have no sensor for it
        picked = replace(picked, bearing_temperature_degC=None)
    return messages.samples_json(picked, publisher="", batch=0)


def _shown(samples: Samples) -> Samples:
    """Return time, speed, friction and bearing temperature of samples, NaN where not measured."""
    speed, friction = np.round(samples.speed_rad_s, 9), np.round(_known(samples.friction_torque_Nm, len(samples)), 9)
    temp = _known(samples.bearing_temperature_degC, len(samples))
    return Samples(samples.time_ns, speed, friction, bearing_temperature_degC=temp)


def _known(values: FloatArray | None, count: int) -> FloatArray:
    """Return values, NaN where they were not measured."""
    return np.full(count, np.nan) if values is None else values


# ---- the latest message of each kind of each wheel -------------------------------------------------------------------


def array_json(parts: Iterable[bytes]) -> bytes:
    """Return JSON values as one array."""
    return b"[" + b",".join(parts) + b"]"


def object_json(parts: Mapping[str, bytes]) -> bytes:
    """Return JSON values by their names as one object."""
    return b"{" + b",".join(b'"%b":%b' % (name.encode(), part) for name, part in parts.items()) + b"}"


class Received(NamedTuple):
    """A message in JSON, its key, and when it was received [ns, this machine's clock; None: from the history].

    `beside` is JSON that the dashboard adds: to a status, when samples last arrived (`ArrivalTimes`); to a diagnosis,
    since when its verdict holds (`VerdictHistory`). `brief` is a short form for pages that do not show this wheel,
    empty if all pages get the message.
    """

    key: str
    payload: bytes
    wall_ns: int | None
    beside: bytes = b"null"
    brief: bytes = b""

    @property
    def wheel(self) -> str:
        """Spacecraft and wheel, as "spacecraft/wheel"."""
        return self.key.split("/", 1)[1].rpartition("/")[0]

    def to_json(self, **more: bytes) -> bytes:
        """Return the message as an entry of the feed, with more fields before its own."""
        key, wall_ns = messages.dump_json(self.key), messages.dump_json(self.wall_ns)
        own = {"key": key, "received_wall_ns": wall_ns, "beside": self.beside, "message": self.payload}
        return object_json(more | own)


def record_entry(record: AlarmRecord | RetirementEvent, kind: str) -> Received:
    """Return a change of an alarm, or an audit event of the list of wheels, as an entry of the feed."""
    return Received(f"rwa/{record.spacecraft}/{record.wheel}/{kind}", record.to_json(), time.time_ns())


@dataclass(slots=True)
class VerdictHistory:
    """Since when a wheel has its current verdict.

    Attributes
    ----------
    since_ns
        Beginning of the first of the successive windows with the current verdict [ns, wheel's clock].
    windows
        Number of these windows.
    recent
        End [ns, wheel's clock], verdict, whether the friction model fits, and worst severity of the latest windows, the
        oldest first.
    """

    since_ns: int | None = None
    windows: int = 0
    recent: deque[tuple[int, str, bool, float]] = field(default_factory=lambda: deque(maxlen=REMEMBERED))

    def extend(self, diagnoses: Iterable[Diagnosis]) -> None:
        """Add windows, the oldest first; one that is not later than the last one is ignored."""
        for window in diagnoses:
            last_ns, verdict, *_ = self.recent[-1] if self.recent else (None, None)
            if last_ns is not None and window.window_end_ns <= last_ns:
                continue
            if verdict != window.verdict:
                self.since_ns, self.windows = window.window_start_ns, 0
            self.windows += 1
            severity = messages.health_message(window).severity
            self.recent.append((window.window_end_ns, window.verdict, window.model_adequate, severity))

    def to_json(self) -> bytes:
        """Return the content of `beside` of a diagnosis in the feed."""
        return messages.dump_json({"since_ns": self.since_ns, "windows": self.windows})


@dataclass(slots=True)
class Wheel:
    """The state of one wheel; `latest` holds the last message of each kind."""

    derived: DerivedFriction
    latest: dict[str, Received] = field(default_factory=dict)
    provisional: deque[Received] = field(default_factory=lambda: deque(maxlen=MAX_PROVISIONAL))
    decimated: DecimatedSamples = field(default_factory=DecimatedSamples)
    arrivals: ArrivalTimes = field(default_factory=ArrivalTimes)
    verdicts: VerdictHistory = field(default_factory=VerdictHistory)
    diagnosis: Diagnosis | None = None
    status: Status | None = None


class Fleet:
    """All wheels. One thread writes; the threads of the API read.

    Parameters
    ----------
    setup
        Has the constants of the wheels, to derive friction from current; None for the built-in wheel's.
    """

    def __init__(self, setup: Setup | None = None) -> None:
        self.lock = Lock()
        self.setup = setup or Setup()
        self._wheels: dict[tuple[str, str], Wheel] = {}

    def wheel(self, spacecraft: str, wheel: str) -> Wheel | None:
        """Return a wheel; None where it is not known."""
        with self.lock:
            return self._wheels.get((spacecraft, wheel))

    def begin(self, spacecraft: str, wheel: str, earlier: list[Diagnosis]) -> Wheel | None:
        """Add a wheel, or reset it, with its earlier windows; None where there are too many wheels."""
        with self.lock:
            if len(self._wheels) >= messages.MAX_WHEELS:
                return None
            known = Wheel(DerivedFriction(self.setup.wheel(spacecraft, wheel)))
            known.verdicts.extend(earlier)
            self._wheels[spacecraft, wheel] = known
            return known

    def wheels(self) -> list[tuple[str, str, Wheel]]:
        """Return all wheels with their names, sorted; the caller must hold the lock while it reads them."""
        return [(*name, self._wheels[name]) for name in sorted(self._wheels)]

    def take(self, wheel: Wheel, message: Message, received: Received) -> Received:
        """Update the state of a wheel with a message; returns the message in the form that is shown."""
        with self.lock:
            match message:
                case Discrepancy():
                    wheel.latest[Discrepancy.kind] = received
                case Status():
                    wheel.status = message
                    wall_ns = received.wall_ns or 0
                    wheel.arrivals.take_status(message.last_sample_ns, wall_ns)
                    arrivals, fill = wheel.arrivals.shown(), round(message.window_fill, 4)
                    pulse = {"reported_wall_ns": wall_ns, "window_fill": fill, "telemetry": arrivals}
                    brief = messages.dump_json(pulse | {"refused": _refused(message)})
                    received = received._replace(beside=messages.dump_json(arrivals), brief=brief)
                    wheel.latest[Status.kind] = received
                case Changepoints():
                    wheel.provisional.append(received)
                case Diagnosis():
                    wheel.verdicts.extend([message])
                    received = received._replace(beside=wheel.verdicts.to_json())
                    latest = wheel.diagnosis
                    if message.data and latest is not None and message.window_end_ns < latest.window_end_ns:
                        return received  # of a dump: the wheel's state is that of its latest window
                    wheel.latest[Diagnosis.kind] = received
                    wheel.diagnosis = message
                    wheel.provisional.clear()
                    # Plots span this window and as much time before it.
                    wheel.decimated.keep_from(2 * message.window_start_ns - message.window_end_ns)
            return received

    def take_samples(self, wheel: Wheel, samples: Samples, wall_ns: int) -> Samples:
        """Add samples to the plots of a wheel; returns those that are picked for them."""
        with self.lock:
            wheel.arrivals.take_samples(samples.time_ns, wall_ns)
            return wheel.decimated.add(wheel.derived.add(samples))

    def snapshot(self) -> list[Received]:
        """Return the latest diagnosis and status of every wheel, for a page that opens."""
        with self.lock:
            kinds = (Diagnosis.kind, Status.kind)
            return [wheel.latest[kind] for wheel in self._wheels.values() for kind in kinds if kind in wheel.latest]


def _refused(status: Status) -> str | None:
    """Return why all messages of a wheel were refused; None where one was not, or none has arrived."""
    if status.samples_received or not status.messages_rejected:
        return None
    return status.last_error or "the monitor gives no reason"
