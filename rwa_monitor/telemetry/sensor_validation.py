"""Sensor validation: slots that show what a broken sensor does and no wheel can are masked, counted and reported.

    hangs        a channel that was restless repeats one value, bit for bit, in slot after slot
    stands out   a few slots differ from those before and after them by more than a wheel can do and undo in that time

Slots are judged in order, each with one slot after it. What is found may concern slots shortly before: a slot is held
back for `LAG_SLOTS`, but never beyond the end of a window, which closes with the first slot behind it. So a window's
slots are judged by no more than that slot, and the result does not depend on how samples arrive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rwa_monitor.kernels.ingest import HANGING_SLOTS, HANGS, OUTSTANDING_SLOTS, STANDS_OUT, judge
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.telemetry.ring_buffer import RingBuffer
from rwa_monitor.wheel.wheel import Wheel

# Friction of all switching systems together, at so many times their largest nominal friction, may come and go within a
# slot: anomalies of the paper are about twice the nominal friction. A system without given friction counts as one dry
# torque.
LARGEST_FACTOR: Final = 2.0
LAG_SLOTS: Final = max(HANGING_SLOTS, OUTSTANDING_SLOTS)

SPEED: Final = "speed_rad_s"
TORQUE: Final = "torque_Nm"

# The memory of a channel: the last value that was not missing; the last first and second difference; the share of the
# recent slots in which the second difference changed its sign; how often the last value has been repeated, and that
# share when the repetition began; the sum of recent steps from slot to slot, in absolute value, and how many they are,
# which both fade.
MEMORY: Final = 8


class Fault(NamedTuple):
    """A channel shows what no wheel does; such slots are masked.

    Attributes
    ----------
    channel
        Of the ring buffer, or "friction".
    hangs
        True where it repeats one value, False where it stands out.
    slot
        The first.
    """

    channel: str
    hangs: bool
    slot: int


@dataclass(slots=True)
class Channel:
    """Judges the slots of one channel, in order.

    Attributes
    ----------
    state
        float64 (11,): the last three values, latest last, NaN where missing; then the memory of those before.
    """

    state: FloatArray = field(
        default_factory=lambda: np.array([np.nan] * (OUTSTANDING_SLOTS + 1) + [0.0] * (MEMORY - 1))
    )

    def judge(self, values: FloatArray, after: FloatArray, limit: float) -> tuple[NDArray[np.int8], IntArray] | None:
        """Judge the next slots.

        Parameters
        ----------
        values, after
            float64 (n,): the slots, and for each the slot after it, NaN where missing.
        limit
            What the channel can do within a slot, in its unit; infinity where that is not known.

        Returns
        -------
        kind
            int8 (n,): 0, HANGS or STANDS_OUT, for what is found with this slot and the one after it.
        since
            int64 (n,): how many slots before it that begins.

        None instead of both where nothing is found.
        """
        kind, since = np.zeros(values.size, dtype=np.int8), np.zeros(values.size, dtype=np.int64)
        found = judge(values, after, limit, self.state, kind, since)
        return (kind, since) if found else None


def speed_limit(wheel: Wheel) -> float:
    """Return the largest change of speed within a slot that the motor can make [rad/s]; infinity if not known."""
    torque = wheel.max_motor_torque_Nm
    if torque is None or wheel.inertia_kg_m2 is None:
        return float("inf")
    return torque / wheel.inertia_kg_m2 * wheel.sample_period_s


def friction_limit(wheel: Wheel) -> float:
    """Return the largest friction that can come and go within a slot [N m]; infinity if not known."""
    if wheel.nominal is None:
        return float("inf")
    highest = [max(part.high for part in system.friction) if system.friction else 1.0 for system in wheel.fss]
    return wheel.nominal.dry_torque_Nm * (1.0 + LARGEST_FACTOR * sum(highest))


@dataclass(slots=True)
class SensorValidation:
    """Validates the channels of a wheel's ring buffer as they were measured, from the beginning of an epoch on.

    Attributes
    ----------
    speed_limit_rad_s, torque_limit_Nm
        What the channels can do within a slot; infinity where that is not known.
    done
        Slots judged; those that are not held back any more are final.
    speed, torque
        Judge the channels.
    """

    speed_limit_rad_s: float
    torque_limit_Nm: float
    done: int = 0
    speed: Channel = field(default_factory=Channel)
    torque: Channel = field(default_factory=Channel)

    def reset(self) -> None:
        """Begin a new epoch."""
        self.done, self.speed, self.torque = 0, Channel(), Channel()

    def run(self, ring: RingBuffer, stop: int, border_before: Callable[[int], int]) -> tuple[int, list[Fault]]:
        """Judge the slots up to `stop`, and mask in the ring buffer what cannot be.

        Parameters
        ----------
        ring
            Holds them, those held back, and the slot `stop` unless nothing more will come.
        stop
            First slot that is left for later.
        border_before
            Gives the last slot, up to a given one, before which all are final when it has been seen.

        Returns
        -------
        masked
            Slots that were good and are not any more.
        faults
            What was found, in order.
        """
        start, self.done = self.done, max(self.done, stop)
        if stop <= start:
            return 0, []
        speed, torque = ring.read_required(start, stop + 1)
        in_speed = self.speed.judge(speed[:-1], speed[1:], self.speed_limit_rad_s)
        in_torque = self.torque.judge(torque[:-1], torque[1:], self.torque_limit_Nm)
        if in_speed is None and in_torque is None:
            return 0, []
        turning = speed[:-1] != 0.0  # before anything is masked
        held = max(start - LAG_SLOTS, ring.values_begin)  # the first slot that may still be masked
        good: BoolArray | None = None  # before anything was masked
        faults = []
        for name, judged in ((SPEED, in_speed), (TORQUE, in_torque)):
            if judged is None:
                continue
            kind, since = judged
            # A tachometer at rest shows zero, and so may the current: that is no fault.
            wrong = (kind == STANDS_OUT) | ((kind == HANGS) & turning)
            if not wrong.any():
                continue
            good = _good(ring, held, stop) if good is None else good
            values = ring.read(name, held, stop).copy()
            values[start - held :][wrong] = np.nan
            for k in np.flatnonzero(wrong & ((kind == STANDS_OUT) | (since > 0))).tolist():
                first = max(start + k - int(since[k]), border_before(start + k))
                values[first - held : start + k - held] = np.nan
                faults.append(Fault(name, bool(kind[k] == HANGS), first))
            ring.overwrite(name, held, values)
        masked = 0 if good is None else int(good.sum() - _good(ring, held, stop).sum())
        return masked, sorted(faults, key=lambda fault: fault.slot)


def _good(ring: RingBuffer, start: int, stop: int) -> BoolArray:
    return np.isfinite(ring.read(SPEED, start, stop)) & np.isfinite(ring.read(TORQUE, start, stop))
