"""Processing of a wheel's slots before they are diagnosed: kept, validated, turned into friction torque.

Three steps, in the order of the flow, pure:

    ring buffer          the last slots, in arrays of fixed size, allocated once
    sensor validation    slots with readings of a faulty sensor that no wheel can cause are masked, counted and reported
    friction source      the friction torque, given or derived from current, less the effects the wheel is known to have
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rwa_monitor.changepoints.evidence import UNKNOWN_ERROR_K, ViscousSpeed
from rwa_monitor.kernels.ingest import HANGING_SLOTS, HANGS, OUTSTANDING_SLOTS, STANDS_OUT, judge
from rwa_monitor.kernels.running_sums import BLOCK
from rwa_monitor.samples import BoolArray, FloatArray, IntArray, Samples
from rwa_monitor.wheel.effects.base import Channels, Memory, begun
from rwa_monitor.wheel.effects.catalogue import effect_torque, mean_effects, viscous_effects
from rwa_monitor.wheel.effects.drag_laws import SEASON_K, ORIGIN_degC
from rwa_monitor.wheel.torque_balance import (
    Source,
    corrected_friction,
    differentiate_over_gaps,
    friction_torque,
    inertia_of,
    motor_torque,
    slots_around,
)
from rwa_monitor.wheel.wheel import Wheel

# ---- the ring buffer -------------------------------------------------------------------------------------------------
# Slot k is stored at position k modulo the array's size. A slot without a sample is empty; one with a bad value (NaN)
# is filled but not good. Whether a slot was filled is kept for `capacity` slots; values, of which only the newest are
# processed, for `values_capacity`.


SPEED: Final = "speed_rad_s"
TORQUE: Final = "torque_Nm"
OPTIONAL: Final = ("motor_torque_Nm", "bearing_temperature_degC")


class RingBuffer:
    """The last slots of a wheel.

    Parameters
    ----------
    capacity
        Number of slots for which to keep whether they were filled.
    optional
        Which of the `OPTIONAL` channels to keep besides speed and torque.
    values_capacity
        Number of slots for which to keep the values.

    Attributes
    ----------
    begin, end
        The slots held: [begin, end).
    channels
        Names of the channels kept.
    """

    def __init__(self, capacity: int, optional: tuple[str, ...], values_capacity: int) -> None:
        self.capacity = capacity
        self.values_capacity = min(values_capacity, capacity)
        self.end = 0
        self._first = 0
        self._filled: NDArray[np.uint8] = np.zeros(capacity, dtype=np.uint8)
        self.channels = (SPEED, TORQUE, *optional)
        self._values: dict[str, FloatArray] = {name: np.zeros(self.values_capacity) for name in self.channels}

    @property
    def begin(self) -> int:
        """First slot that is still held."""
        return max(self._first, self.end - self.capacity)

    @property
    def values_begin(self) -> int:
        """First slot whose values are still held."""
        return max(self._first, self.end - self.values_capacity)

    def clear(self, begin: int = 0) -> None:
        """Drop all slots and begin again at slot `begin`."""
        self.end = self._first = begin

    def extend(self, end: int, slots: IntArray, values: Mapping[str, FloatArray]) -> None:
        """Append the slots [self.end, end): those in `slots` with their values, the others empty.

        Parameters
        ----------
        end
            New end; at most `values_capacity` beyond the old one.
        slots
            int64 (n,), strictly increasing, within the appended range.
        values
            float64 (n,) for every channel.
        """
        start, count = self.end, end - self.end
        rows = slots - start
        filled = np.zeros(count, dtype=np.uint8)
        filled[rows] = 1
        _put(self._filled, start, filled)
        for name, array in self._values.items():
            spread = values[name]
            if slots.size < count:
                spread = np.full(count, np.nan)
                spread[rows] = values[name]
            _put(array, start, spread)
        self.end = end

    def restore(self, begin: int, filled: BoolArray, values: Mapping[str, FloatArray]) -> None:
        """Hold the slots [begin, begin + n) and nothing else.

        Parameters
        ----------
        begin
            First slot.
        filled
            bool (n,), at most `capacity`: which slots have a sample.
        values
            float64 (m,) for every channel, m ≤ n: values of the last m slots, NaN where empty.
        """
        self.clear(begin)
        self.end = begin + filled.size
        _put(self._filled, begin, filled.astype(np.uint8))
        for name, array in self._values.items():
            last = values[name][-self.values_capacity :]
            _put(array, self.end - last.size, last)

    def is_filled(self, slots: IntArray) -> BoolArray:
        """Return which slots have a sample, bool (n,); False for slots that are no longer, or not yet, held."""
        held = (slots >= self.begin) & (slots < self.end)
        return np.asarray(held & (self._filled[slots % self.capacity] == 1), dtype=np.bool_)

    def read(self, name: str, start: int, stop: int) -> FloatArray:
        """Return a channel's slots [start, stop), float64, to be read only; NaN where empty, not held or not kept.

        A view of the buffer itself where the slots are contiguous there: `extend` and `overwrite` change it.
        """
        array = self._values.get(name)
        if array is not None and self._first <= start < stop <= self.end and start >= self.end - array.size:
            at = start % array.size
            if at + stop - start <= array.size:
                return array[at : at + stop - start]
        result = np.full(stop - start, np.nan)
        if array is not None:
            kept = np.arange(max(start, self.values_begin), min(stop, self.end))
            result[kept - start] = array[kept % array.size]
        return result

    def read_required(self, start: int, stop: int) -> tuple[FloatArray, FloatArray]:
        """Return speed and torque of the slots [start, stop), as `read` does."""
        return self.read(SPEED, start, stop), self.read(TORQUE, start, stop)

    def overwrite(self, name: str, start: int, values: FloatArray) -> None:
        """Replace a channel's slots [start, start + n), whose values must be held."""
        _put(self._values[name], start, values)


def _put(array: NDArray[Any], start: int, values: NDArray[Any]) -> None:
    """Write the values of the slots from `start` on, wrapping around at the array's end."""
    at = start % array.size
    if at + values.size <= array.size:
        array[at : at + values.size] = values
    else:
        array[np.arange(at, at + values.size) % array.size] = values


# ---- sensor validation -----------------------------------------------------------------------------------------------
#     hangs        a channel that varied before repeats one value, bit for bit, in slot after slot
#     stands out   a few slots differ from those before and after them by more than a wheel can change and undo so soon
#
# Slots are judged in order, each with one slot after it. A fault may include slots shortly before: a slot is held back
# for `LAG_SLOTS`, but never beyond the end of a window, which closes with the first slot after it. So to judge a window
# takes no more than that one slot, and the result does not depend on how samples arrive.


# Multiple of the largest nominal friction of all switching systems together that may appear or vanish within a slot:
# anomalies of the paper are about twice the nominal friction. A system without stated friction counts as 1 dry torque.
LARGEST_FACTOR: Final = 2.0
LAG_SLOTS: Final = max(HANGING_SLOTS, OUTSTANDING_SLOTS)

# The memory of a channel: the last value that was not missing; the last first and second difference; the share of the
# recent slots in which the second difference changed its sign; how often the last value has been repeated, and that
# share when the repetition began; the sum of recent absolute steps from slot to slot, and their number, both decaying.
MEMORY: Final = 8


class Fault(NamedTuple):
    """Readings of a channel that no wheel can cause; their slots are masked.

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
            Largest change of the channel within a slot, in its unit; infinity where not known.

        Returns
        -------
        kind
            int8 (n,): 0, HANGS or STANDS_OUT, for what is found with this slot and the one after it.
        since
            int64 (n,): how many slots before it the fault begins.

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
    """Return the largest friction that can appear or vanish within a slot [N m]; infinity if not known."""
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
        Largest changes of the channels within a slot; infinity where not known.
    done
        Number of slots judged; those that are not held back any more are final.
    speed, torque
        Judge the channels.
    """

    speed_limit_rad_s: float
    torque_limit_Nm: float
    done: int = 0
    speed: Channel = field(default_factory=Channel)
    torque: Channel = field(default_factory=Channel)

    def run(self, ring: RingBuffer, stop: int, border_before: Callable[[int], int]) -> tuple[int, list[Fault]]:
        """Judge the slots up to `stop`, and mask the invalid ones in the ring buffer.

        Parameters
        ----------
        ring
            Holds them, those held back, and the slot `stop` unless nothing more will come.
        stop
            First slot that is not judged yet.
        border_before
            Returns the last border, up to a given slot, before which all slots are final once it has been judged.

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
        judged = {
            SPEED: self.speed.judge(speed[:-1], speed[1:], self.speed_limit_rad_s),
            TORQUE: self.torque.judge(torque[:-1], torque[1:], self.torque_limit_Nm),
        }
        if not any(judged.values()):
            return 0, []
        turning = speed[:-1] != 0.0  # before anything is masked
        held = max(start - LAG_SLOTS, ring.values_begin)  # the first slot that may still be masked
        good = _count_good(ring, held, stop)
        faults = []
        for name, found in judged.items():
            if found is None:
                continue
            kind, since = found
            # At rest a tachometer reads zero, and so may the current: that is no fault.
            wrong = (kind == STANDS_OUT) | ((kind == HANGS) & turning)
            values = ring.read(name, held, stop).copy()
            values[start - held :][wrong] = np.nan
            for k in np.flatnonzero(wrong & ((kind == STANDS_OUT) | (since > 0))).tolist():
                first = max(start + k - int(since[k]), border_before(start + k))
                values[first - held : start + k - held] = np.nan
                faults.append(Fault(name, bool(kind[k] == HANGS), first))
            ring.overwrite(name, held, values)
        return good - _count_good(ring, held, stop), sorted(faults, key=lambda fault: fault.slot)


def _count_good(ring: RingBuffer, start: int, stop: int) -> int:
    speed, torque = ring.read_required(start, stop)
    return int(np.count_nonzero(np.isfinite(speed) & np.isfinite(torque)))


# ---- friction --------------------------------------------------------------------------------------------------------
# Computations over several slots work in blocks that are cut at multiples of 64 slots of the grid and at the borders of
# windows, never where a message happens to end, so that results are bit-identical however samples arrive.


BLOCK_SLOTS: Final = BLOCK
TEMPERATURE: Final = "bearing_temperature_degC"


# The error of a bearing temperature that is not measured is its possible drift since: at the rate of an oscillation by
# ±3 K in 95 min (an orbit's eclipses), up to the seasonal range. Working assumptions.
DRIFT_K_S: Final = 3.3e-3
STUCK_S: Final = 300.0  # in which that drift is 1 K: shorter repetitions are harmless
STUCK_RUNS: Final = 10.0  # times the longest earlier repetition of one value, beyond which a channel is stuck
BEARING_DEGC: Final = (-100.0, 200.0)  # °C: no lubricant lasts beyond


def held_temperature(
    measured_degC: FloatArray, period_s: float, start_degC: float, memory: Memory = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the bearing temperature in every slot; where missing, the last one is held, with a growing error.

    A channel that varied before and repeats one value for long is stuck: that value is as old as the repetition. One
    that never varied may be a steady temperature in coarse digits, and is accepted.

    Parameters
    ----------
    measured_degC, period_s
        float64 (n,), consecutive slots, NaN where it was not measured [°C]; from slot to slot [s].
    start_degC
        Used before the first one is known [°C].
    memory
        The memory that the call for the slots just before returned; None at the start of an epoch.

    Returns
    -------
    temperature, error
        float64 (n,) each [°C], [K].
    memory
        float64 (4,): the last temperature known, NaN before the first; for how many slots it has been missing; how
        often it was repeated; the largest number of repetitions of any earlier value.
    """
    last, missing, repeated, most = begun(memory, np.nan, 0.0, 0.0, 0.0)
    values = np.append(last, measured_degC)
    at = np.arange(values.size)
    known = (values > BEARING_DEGC[0]) & (values < BEARING_DEGC[1])
    known[0] = True  # the value in memory, even NaN, is the one to hold
    known_at = np.maximum.accumulate(np.where(known, at, 0))
    held = values[known_at]
    missing_for = at - known_at + np.where(known_at == 0, missing, 0.0)
    changed = np.append(False, held[1:] != held[:-1]) & known
    changed_at = np.maximum.accumulate(np.where(changed, at, 0))
    repeated_for = at - changed_at + np.where(changed_at == 0, repeated, 0.0)
    # Length of each run of one value at its end, if neither missing nor stuck.
    ended = np.where(changed[1:] & (missing_for[:-1] == 0.0), repeated_for[:-1] + 1.0, 0.0)
    ended[np.isnan(held[:-1]) | (ended * period_s > STUCK_S)] = 0.0
    most_before = np.maximum.accumulate(np.append(most, ended))
    stuck = (most_before > 0.0) & (repeated_for > np.maximum(STUCK_RUNS * most_before, STUCK_S / period_s))
    age_s = period_s * np.where(stuck, np.maximum(repeated_for, missing_for), missing_for)
    unknown = np.isnan(held)
    error = np.where(unknown, SEASON_K, np.minimum(DRIFT_K_S * age_s, SEASON_K))
    memory = np.array([held[-1], missing_for[-1], repeated_for[-1], most_before[-1]])
    return np.where(unknown, start_degC, held)[1:], error[1:], memory


class FrictionSource:
    """Turns the slots of a ring buffer into friction torque, in order, from the beginning of an epoch on.

    Parameters
    ----------
    wheel
        Constants, derivative filter and effects.
    source
        The channel that friction comes from.

    Attributes
    ----------
    before, reach
        Slots before one and after it on which its friction depends; 0 where it is given and nothing else needs them.
    optional
        Channels besides speed and torque that the wheel's effects need.
    limit_Nm
        Largest friction that can appear or vanish within a slot.
    derived
        Whether friction is not given.
    channel
        Judges derived friction, with the effects still in it: slots where it stands out are masked.
    angle_rad, last_speed_rad_s, memories
        State of the effects after the slots so far; the last memory is that of `held_temperature`, where one needs it.
    at_corners, at_limit
        Samples masked since this process began: where the speed bends too sharply for friction to be derived, and with
        the current at its limit or in its dead zone.
    """

    def __init__(self, wheel: Wheel, source: Source) -> None:
        self.wheel = wheel
        self.source = source
        self.effects = mean_effects(wheel)
        self.own_viscous = bool(viscous := viscous_effects(wheel))
        others = [effect for effect in self.effects if not (viscous and effect.scales_with_viscous)]
        self.adds_by_temperature = any(TEMPERATURE in effect.needs for effect in others)
        self.derived = source != "friction_torque_Nm"
        needs_acceleration = self.derived or self.effects
        self.before, self.reach = slots_around(wheel) if needs_acceleration else (0, 0)
        needed = frozenset[str]().union(*(effect.needs for effect in self.effects))
        self.optional = tuple(name for name in OPTIONAL if name in needed)
        self.limit_Nm = friction_limit(wheel)
        self.at_corners = self.at_limit = 0
        self.reset()

    def reset(self) -> None:
        """Begin a new epoch."""
        self.channel = Channel()
        self.angle_rad = 0.0
        self.last_speed_rad_s = 0.0
        self.memories: list[Memory] = [None] * (len(self.effects) + (TEMPERATURE in self.optional))

    # ---- samples → the torque in the ring buffer -----------------------------------------------------------------

    def torque(self, samples: Samples) -> FloatArray | None:
        """Return the torque that friction comes from, float64 (n,) [N m]; None where the channel is missing."""
        if self.source != "motor_current_A":
            return samples.friction_torque_Nm if self.source == "friction_torque_Nm" else samples.motor_torque_Nm
        torque, limits = motor_torque(samples, self.wheel), self.wheel.limits
        if torque is None or samples.motor_current_A is None:
            return None
        # At its limit the current is saturated, in a dead zone it reads zero: what torque is needed is not known.
        size = np.abs(samples.motor_current_A)
        unknown = (size >= (limits.max_current_A or np.inf)) | ((size == 0.0) & (limits.min_current_A is not None))
        self.at_limit += int(np.count_nonzero(unknown))
        return np.where(unknown, np.nan, torque)

    # ---- slots → friction ----------------------------------------------------------------------------------------

    def friction(
        self, ring: RingBuffer, start: int, stop: int, torque: FloatArray
    ) -> tuple[FloatArray, int, list[Fault], ViscousSpeed | None]:
        """Return the friction torque of the slots [start, stop), where it stands out, and its viscous speed.

        Parameters
        ----------
        ring
            Holds the slots, `before` more before and `reach` more after them, as far as there are any.
        start, stop
            `start` is where the last call ended; both multiples of 64, or borders of windows or of the epoch.
        torque
            float64 (stop - start,), the torque in the ring buffer there.

        Returns
        -------
        torque
            float64 (stop - start,) [N m], NaN where it is not known, stands out, or the speed has a corner.
        masked
            Number of slots where it was known and is not valid.
        faults
            One for each time that derived friction stands out.
        viscous
            The quantity to which viscous friction is proportional; None where that is the speed.
        """
        if self.reach == 0:
            return torque, 0, [], None
        speed, motor = ring.read_required(start - self.before, stop + self.reach)
        acceleration = differentiate_over_gaps(speed, self.wheel.friction.derivative, self.wheel.sample_period_s)
        here = slice(self.before, self.before + stop - start)
        friction = corrected_friction(speed, motor, self.wheel, acceleration)[here] if self.derived else torque.copy()
        acceleration = acceleration[here]
        masked, faults = 0, list[Fault]()
        if self.derived:
            at_corners = int(np.count_nonzero(np.isfinite(torque) & np.isfinite(acceleration) & np.isnan(friction)))
            self.at_corners += at_corners
            masked, faults = self._mask_outstanding(ring, start, stop, acceleration, friction)
            masked += at_corners
        viscous = self._subtract_effects(ring, start, stop, acceleration, friction)
        return friction, masked, faults, viscous

    def _mask_outstanding(
        self, ring: RingBuffer, start: int, stop: int, acceleration: FloatArray, torque: FloatArray
    ) -> tuple[int, list[Fault]]:
        """Judge the derived friction of the slots [start, stop), and mask the slots that stand out in it.

        Returns the number of masked slots and the faults. The last slot of a block is judged by the one after it, whose
        acceleration may not be known yet, but is nearly the same. Masking reaches back to the beginning of the block at
        most: slots before may have been passed on.
        """
        ends = np.arange(start + 1, stop + 1)
        last = np.flatnonzero((ends % BLOCK_SLOTS == 0) | (ends == stop))
        after = np.append(torque[1:], np.nan)
        following = ring.read(TORQUE, start + 1, stop + 1)[last]
        after[last] = friction_torque(following, acceleration[last], inertia_of(self.wheel))
        judged = self.channel.judge(torque, after, self.limit_Nm)
        masked, faults = 0, []
        if judged is not None:
            kind, since = judged
            for k in np.flatnonzero(kind == STANDS_OUT).tolist():
                block = (start + k) // BLOCK_SLOTS * BLOCK_SLOTS
                first = max(k - int(since[k]), block - start, 0)
                masked += int(np.isfinite(torque[first : k + 1]).sum())
                torque[first : k + 1] = np.nan
                faults.append(Fault("friction", False, start + first))
        return masked, faults

    def _subtract_effects(
        self, ring: RingBuffer, start: int, stop: int, acceleration: FloatArray, torque: FloatArray
    ) -> ViscousSpeed | None:
        """Subtract the effects of the slots [start, stop) from their torque, in place; return the viscous speed."""
        low, blocks = start, []
        while self.effects and low < stop:
            high = min((low // BLOCK_SLOTS + 1) * BLOCK_SLOTS, stop)
            block = slice(low - start, high - start)
            added, viscous = self._effect_torque(ring, low, high, acceleration[block], torque[block])
            torque[block] -= added
            blocks.append(viscous)
            low = high
        return ViscousSpeed(*map(np.concatenate, zip(*blocks, strict=True))) if self.own_viscous and blocks else None

    def _effect_torque(
        self, ring: RingBuffer, start: int, stop: int, acceleration: FloatArray, friction: FloatArray
    ) -> tuple[FloatArray, ViscousSpeed]:
        """Return the torque that effects add in one block of slots [N m], and the viscous speed."""
        period_s = self.wheel.sample_period_s
        speed = ring.read(SPEED, start, stop)
        good = np.isfinite(speed)
        # Where a speed is missing, the angle is continued with the last one known.
        latest = np.maximum.accumulate(np.where(good, np.arange(1, speed.size + 1), 0))
        held = np.append(self.last_speed_rad_s, speed)[latest]
        angle = np.add.accumulate(np.concatenate(([self.angle_rad], held * period_s)))[1:]
        self.angle_rad, self.last_speed_rad_s = float(angle[-1]), float(held[-1])
        optional = {name: ring.read(name, start, stop) if name in ring.channels else None for name in OPTIONAL}
        effects, *of_temperature = self.memories[: len(self.effects)], *self.memories[len(self.effects) :]
        temperature, error = np.full(speed.size, np.nan), np.zeros(speed.size)
        if (measured := optional[TEMPERATURE]) is not None:
            start_degC = self.wheel.temperature.middle if self.wheel.temperature else ORIGIN_degC
            temperature, error, *of_temperature = held_temperature(measured, period_s, start_degC, *of_temperature)
        channels = Channels(
            time_s=np.arange(start, stop, dtype=np.float64) * period_s,
            speed_rad_s=speed,
            direction=np.sign(speed),
            acceleration_rad_s2=acceleration,
            angle_rad=angle,
            motor_torque_Nm=optional["motor_torque_Nm"],
            bearing_temperature_degC=temperature if TEMPERATURE in ring.channels else None,
            sample_period_s=period_s,
            good=good,
        )
        viscous = self.wheel.nominal.viscous_Nm_s_rad if self.wheel.nominal else 0.0
        torque, viscous_speed, effects = effect_torque(self.effects, channels, friction, viscous, effects)
        self.memories = [*effects, *of_temperature]
        if self.adds_by_temperature:
            torque = np.where(error < UNKNOWN_ERROR_K, torque, np.nan)
        return torque, ViscousSpeed(viscous_speed, temperature, error)
