"""A wheel's samples on their way to the page: friction where it is derived, the open window's samples, their rhythm."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from rwa_monitor.changepoints.evidence import evidence_curve
from rwa_monitor.messages import Diagnosis, Message, Number, TimeNs, dump_json
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, FloatArray, IntArray, Samples, SlotGrid, concatenate
from rwa_monitor.wheel.torque_balance import half_width, mended_friction, torque_per_ampere
from rwa_monitor.wheel.wheel import Wheel

EVIDENCE_POINTS: Final = 1_500  # a screen is some 1,500 pixels wide
SPARSEST: Final = 8  # slots per sample up to which a stretch is laid on the slot grid
LEAST_KEPT: Final = 0.9  # share of a window's good samples that must be at hand for its curve

LEAST_STALE_S: Final = 10.0
FIRST_STALE_S: Final = 60.0  # while nothing is known of the rhythm
RHYTHMS: Final = 8  # messages whose intervals are looked at
LATE_FACTOR: Final = 3.0  # a message that is three intervals late does not come
FASTEST: Final = 2_000.0  # times real time: what comes faster is read out of a memory, and is no rhythm


class Evidence(Message):
    """The wGLR of a window, thinned so that no peak is lost, and the threshold that a jump must clear.

    `statistic` is in variances of its own noise. `open` is true while the window is not closed.
    """

    kind: ClassVar[str] = "evidence"

    window_start_ns: int
    open: bool
    time_ns: list[TimeNs]
    statistic: list[Annotated[float, Field(ge=0, allow_inf_nan=False)]]
    threshold: Number


class DerivedFriction:
    """Gives samples a friction torque where they have none: from motor torque or current, with the wheel's constants.

    The derivative needs some slots on either side, so that samples leave as much later; samples that hold a friction
    torque, and those from which none can be derived, pass as they are.
    """

    def __init__(self, wheel: Wheel) -> None:
        self.wheel = wheel
        self._half = half_width(wheel.friction.derivative, wheel.sample_period_s)
        self._tail: Samples | None = None
        self._left_ns = -1  # time of the last sample that has left

    def add(self, samples: Samples) -> Samples:
        """Take samples in; return those whose friction is known now."""
        torque = samples.motor_torque_Nm
        if torque is None and samples.motor_current_A is not None and self.wheel.torque_constant_Nm_A is not None:
            current_A = samples.motor_current_A
            torque = torque_per_ampere(current_A, samples.speed_rad_s, self.wheel) * current_A
        if samples.friction_torque_Nm is not None or torque is None or self.wheel.inertia_kg_m2 is None:
            return samples
        joined = Samples(samples.time_ns, samples.speed_rad_s, motor_torque_Nm=torque)
        tail, period_ns = self._tail, self.wheel.period_ns
        if tail is not None and 0 < joined.time_ns[0] - tail.time_ns[-1] <= 2 * self._half * period_ns:
            joined = concatenate([tail, joined])
        slot = SlotGrid(int(joined.time_ns[0]), period_ns).slot_of(joined.time_ns)
        if np.any(np.diff(slot) <= 0) or slot[-1] >= SPARSEST * len(joined):
            self._tail = None
            return samples
        assert joined.motor_torque_Nm is not None  # given above, in both parts
        speed, torque = _on_grid(slot, joined.speed_rad_s), _on_grid(slot, joined.motor_torque_Nm)
        friction = mended_friction(speed, torque, self.wheel)[slot]
        end = int(slot[-1]) - self._half
        self._tail = joined[slot > end - self._half]
        ready = (slot <= end) & (joined.time_ns > self._left_ns)
        if ready.any():
            self._left_ns = int(joined.time_ns[ready][-1])
        return Samples(joined.time_ns[ready], joined.speed_rad_s[ready], friction[ready])


def _on_grid(slots: IntArray, values: NDArray[np.floating[Any]]) -> FloatArray:
    """Return values at their slots, NaN where there is none between."""
    grid = np.full(int(slots.max()) + 1, np.nan)
    grid[slots] = values
    return grid


@dataclass(slots=True)
class OpenWindow:
    """The samples since the last window's end, in half the memory: 16 bytes each."""

    _messages: deque[tuple[IntArray, NDArray[np.float32], NDArray[np.float32]]] = field(default_factory=deque)
    count: int = 0

    def add(self, samples: Samples) -> None:
        """Keep time, speed and friction of samples; those without friction do not count here."""
        friction = samples.friction_torque_Nm
        if friction is not None and len(samples):
            speed = samples.speed_rad_s.astype(np.float32)
            self._messages.append((samples.time_ns, speed, friction.astype(np.float32)))
            self.count += len(samples)

    def keep_from(self, time_ns: int) -> None:
        """Drop what is older than a time; whole messages only, so that a few samples more may stay."""
        while self._messages and self._messages[0][0][-1] < time_ns:
            self.count -= self._messages.popleft()[0].size

    def clear(self) -> None:
        """Drop everything."""
        self.keep_from(2**62)

    def evidence(self, window: Diagnosis, wheel: Wheel) -> Evidence | None:
        """Return the curve of a window that was diagnosed; None where its samples are not at hand any more."""
        period_ns = (window.window_end_ns - window.window_start_ns) // max(window.samples, 1)
        return self._evidence(
            window.window_start_ns,
            window.window_end_ns,
            period_ns,
            window.friction.viscous.value,
            wheel,
            least=int(LEAST_KEPT * window.coverage * window.samples),
        )

    def evidence_so_far(self, last: Diagnosis | None, wheel: Wheel) -> Evidence | None:
        """Return the curve of the window that is still open, with the slope of the last one."""
        if not self._messages:
            return None
        start_ns = int(self._messages[0][0][0]) if last is None else last.window_end_ns
        slope = last.friction.viscous.value if last else None
        if slope is None:
            slope = wheel.nominal.viscous_Nm_s_rad if wheel.nominal else 0.0
        return self._evidence(start_ns, None, wheel.period_ns, slope, wheel, least=0)

    def _evidence(
        self, start_ns: int, end_ns: int | None, period_ns: int, slope: float | None, wheel: Wheel, *, least: int
    ) -> Evidence | None:
        if slope is None or period_ns <= 0 or not self._messages:
            return None
        time_ns, *values = (np.concatenate(parts) for parts in zip(*self._messages, strict=True))
        inside = (time_ns >= start_ns) & (time_ns < (np.iinfo(np.int64).max if end_ns is None else end_ns))
        slots = SlotGrid(start_ns, period_ns).slot_of(time_ns[inside])
        if slots.size < max(least, 1) or int(slots.max()) >= SPARSEST * slots.size:
            return None
        speed, friction = (_on_grid(slots, value[inside]) for value in values)
        used = np.isfinite(friction) & (np.abs(speed) > (wheel.window.dead_band_rad_s or 0.0))
        curve = evidence_curve(speed, friction, used, slope, EVIDENCE_POINTS)
        if curve is None:
            return None
        return Evidence(
            window_start_ns=start_ns,
            open=end_ns is None,
            time_ns=(start_ns + curve.index * period_ns).tolist(),
            statistic=np.round(curve.statistic, 3).tolist(),
            threshold=curve.threshold,
        )


class Rhythm:
    """When a wheel's samples came last, and how long it takes to call them stale, by this machine's clock.

    Telemetry comes every second, every half minute, or once in a pass: late is what is late for this wheel. Until its
    rhythm is known, a message is expected when the time that it spans has passed again.
    """

    def __init__(self) -> None:
        self.wall_ns: int | None = None
        self._span_s = FIRST_STALE_S / LATE_FACTOR
        self._last_sample_ns: int | None = None
        self._intervals: deque[float] = deque(maxlen=RHYTHMS)

    def take_samples(self, time_ns: IntArray, wall_ns: int) -> None:
        """Note a message of samples."""
        self._span_s = float(time_ns[-1] - time_ns[0]) / NANOSECONDS_PER_SECOND
        if self.wall_ns is not None:
            interval_s = (wall_ns - self.wall_ns) / NANOSECONDS_PER_SECOND
            if interval_s > self._span_s / FASTEST:
                self._intervals.append(interval_s)
        self.wall_ns = wall_ns

    def take_status(self, last_sample_ns: int | None, wall_ns: int) -> None:
        """Note the latest sample of a status: where no samples are received, its progress stands for them.

        The first one begins the wait, as it does not show how old its sample is.
        """
        goes_on = last_sample_ns is not None and last_sample_ns != self._last_sample_ns
        if self.wall_ns is None or (goes_on and not self._intervals):
            self.wall_ns = wall_ns
        self._last_sample_ns = last_sample_ns

    @property
    def stale_after_s(self) -> float:
        """Silence after which the samples are no longer those of now [s]."""
        known = len(self._intervals) >= RHYTHMS // 2
        expected_s = max(self._intervals) if known else self._span_s
        return max(LEAST_STALE_S, LATE_FACTOR * expected_s)

    def to_json(self) -> bytes:
        """Return it as it goes with a status in the feed."""
        return dump_json({"wall_ns": self.wall_ns, "stale_after_s": round(self.stale_after_s, 3)})


# ---- samples thinned for a picture -----------------------------------------------------------------------------------


MAX_POINTS: Final = 6_000  # a screen is some 1,500 pixels wide, and a picture spans up to two windows


class DecimatedSamples:
    """The latest samples of one wheel, every `stride`-th of them; the stride doubles where they span too long a time.

    Samples are picked, not averaged: noise looks as it is. What lies before `keep_from` may be dropped.
    """

    def __init__(self) -> None:
        self.stride = 1
        self._phase = 0  # samples to skip before the next one that is picked
        self._kept = Samples(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))

    def add(self, samples: Samples) -> Samples:
        """Take samples in; returns those that were picked."""
        picked = samples[self._phase :: self.stride]
        self._phase = (self._phase - len(samples)) % self.stride
        self._kept = concatenate([self._kept, Samples(picked.time_ns, picked.speed_rad_s, _friction(picked))])
        if len(self._kept) > MAX_POINTS:
            self._thin()
        return picked

    def keep_from(self, time_ns: int) -> None:
        """Drop what is older than a time; the stride is small again where there is room for it."""
        self._kept = self._kept[self._kept.time_ns >= time_ns]
        if len(self._kept) > MAX_POINTS // 2:
            self._thin()

    def _thin(self) -> None:
        self.stride *= 2
        self._phase = 0
        self._kept = self._kept[::2]

    def message(self) -> bytes:
        """Return the samples as the JSON of a `SamplesMessage`, "null" where it is empty."""
        return thinned_json(self._kept) if len(self._kept) else b"null"


def thinned_json(samples: Samples) -> bytes:
    """Return time, speed and friction of samples as the JSON of a `SamplesMessage`."""
    return dump_json(
        {
            "time_ns": samples.time_ns.tolist(),
            "speed_rad_s": _readings(samples.speed_rad_s),
            "friction_torque_Nm": _readings(_friction(samples)),
        }
    )


def _friction(samples: Samples) -> FloatArray:
    """Return the friction of samples, NaN where it was not measured."""
    friction = samples.friction_torque_Nm
    return np.full(len(samples), np.nan) if friction is None else friction


def _readings(values: FloatArray) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in np.round(values, 9).tolist()]
