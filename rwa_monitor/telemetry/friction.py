"""The friction torque of a wheel's slots: given or derived from current, less the effects the wheel is known to have.

Whatever is computed over several slots at once is computed in blocks that are cut at multiples of 64 slots of the grid
and at the borders of windows, never where a message happens to end, so that the bits do not depend on how samples
arrive.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.kernels.ingest import STANDS_OUT
from rwa_monitor.samples import FloatArray, Samples
from rwa_monitor.telemetry.ring_buffer import OPTIONAL, RingBuffer
from rwa_monitor.telemetry.sensor_validation import Channel, Fault, friction_limit
from rwa_monitor.wheel.effects.base import Channels, Memory
from rwa_monitor.wheel.effects.catalogue import effect_torque, mean_effects
from rwa_monitor.wheel.torque_balance import (
    Source,
    differentiate_over_gaps,
    friction_torque,
    half_width,
    inertia_of,
    mended_friction,
    motor_torque,
)
from rwa_monitor.wheel.wheel import Wheel

BLOCK_SLOTS: Final = 64


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
    reach
        Slots that the derivative's stencil reaches to either side; 0 where nothing needs it.
    optional
        Channels besides speed and torque that the wheel's effects need.
    limit_Nm
        What friction can do within a slot.
    derived
        Whether friction is not given.
    channel
        Judges derived friction, with the effects still in it: slots where it stands out are masked.
    angle_rad, last_speed_rad_s, memories
        What the effects keep of the slots so far.
    at_corners, at_limit
        Samples masked since this process began: where the speed bends too sharply for friction to be derived, and with
        the current at its limit.
    """

    def __init__(self, wheel: Wheel, source: Source) -> None:
        self.wheel = wheel
        self.source = source
        self.effects = mean_effects(wheel)
        self.derived = source != "friction_torque_Nm"
        needs_acceleration = self.derived or self.effects
        self.reach = half_width(wheel.friction.derivative, wheel.sample_period_s) if needs_acceleration else 0
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
        self.memories: list[Memory] = [None] * len(self.effects)

    # ---- samples → what the ring buffer keeps --------------------------------------------------------------------

    def torque(self, samples: Samples) -> FloatArray | None:
        """Return the torque that friction comes from, float64 (n,) [N m]; None where the channel is missing."""
        if self.source != "motor_current_A":
            return samples.friction_torque_Nm if self.source == "friction_torque_Nm" else samples.motor_torque_Nm
        torque, limit_A = motor_torque(samples, self.wheel), self.wheel.limits.max_current_A
        if torque is None or samples.motor_current_A is None:
            return None
        # At its limit the current is saturated, and the torque that would be needed is not known.
        if limit_A is None:
            return torque
        saturated = np.abs(samples.motor_current_A) >= limit_A
        self.at_limit += int(np.count_nonzero(saturated))
        return np.where(saturated, np.nan, torque)

    # ---- slots → friction ----------------------------------------------------------------------------------------

    def friction(
        self, ring: RingBuffer, start: int, stop: int, torque: FloatArray
    ) -> tuple[FloatArray, int, list[Fault]]:
        """Return the friction torque of the slots [start, stop), and where it stands out.

        Parameters
        ----------
        ring
            Holds the slots and `reach` more on either side, as far as there are any.
        start, stop
            Go on where the last call ended; both multiples of 64, or borders of windows or of the epoch.
        torque
            float64 (stop - start,), what the ring buffer holds of it there.

        Returns
        -------
        torque
            float64 (stop - start,) [N m], NaN where it is not known, stands out, or a corner of the speed hides it.
        masked
            Slots where it was known and is not valid.
        faults
            One for each time that derived friction stands out.
        """
        if self.reach == 0:
            return torque, 0, []
        speed, motor = ring.read_required(start - self.reach, stop + self.reach)
        acceleration = differentiate_over_gaps(speed, self.wheel.friction.derivative, self.wheel.sample_period_s)
        here = slice(self.reach, self.reach + stop - start)
        friction = mended_friction(speed, motor, self.wheel, acceleration)[here] if self.derived else torque.copy()
        acceleration = acceleration[here]
        masked = 0
        faults: list[Fault] = []
        if self.derived:
            masked = int(np.count_nonzero(np.isfinite(torque) & np.isfinite(acceleration) & np.isnan(friction)))
            self.at_corners += masked
            stand_out, faults = self._mask_what_stands_out(ring, start, stop, acceleration, friction)
            masked += stand_out
        self._take_effects_out(ring, start, stop, acceleration, friction)
        return friction, masked, faults

    def _mask_what_stands_out(
        self, ring: RingBuffer, start: int, stop: int, acceleration: FloatArray, torque: FloatArray
    ) -> tuple[int, list[Fault]]:
        """Judge the derived friction of the slots [start, stop), mask in it what is not valid; return as `friction`.

        The last slot of a block is judged by the one after it, whose acceleration may not be known yet, but is nearly
        the same. What stands out is masked from the beginning of its block on at most: slots before may be gone.
        """
        slots = np.arange(start, stop)
        last = np.flatnonzero((slots + 1) % BLOCK_SLOTS == 0)
        if last.size == 0 or last[-1] != slots.size - 1:
            last = np.append(last, slots.size - 1)
        after = np.append(torque[1:], np.nan)
        following = ring.read("torque_Nm", start + 1, stop + 1)[last]
        after[last] = friction_torque(following, acceleration[last], inertia_of(self.wheel))
        judged = self.channel.judge(torque, after, self.limit_Nm)
        masked = 0
        faults: list[Fault] = []
        if judged is not None:
            kind, since = judged
            for k in np.flatnonzero(kind == STANDS_OUT).tolist():
                block = (start + k) // BLOCK_SLOTS * BLOCK_SLOTS
                first = max(k - int(since[k]), block - start, 0)
                masked += int(np.isfinite(torque[first : k + 1]).sum())
                torque[first : k + 1] = np.nan
                faults.append(Fault("friction", False, start + first))
        return masked, faults

    def _take_effects_out(
        self, ring: RingBuffer, start: int, stop: int, acceleration: FloatArray, torque: FloatArray
    ) -> None:
        """Subtract the effects of the slots [start, stop) from their torque, in place."""
        low = start
        while self.effects and low < stop:
            high = min((low // BLOCK_SLOTS + 1) * BLOCK_SLOTS, stop)
            block = slice(low - start, high - start)
            torque[block] -= self._effect_torque(ring, low, high, acceleration[block], torque[block])
            low = high

    def _effect_torque(
        self, ring: RingBuffer, start: int, stop: int, acceleration: FloatArray, friction: FloatArray
    ) -> FloatArray:
        """Return the torque of all effects in one block of slots [N m]."""
        period_s = self.wheel.sample_period_s
        speed = ring.read("speed_rad_s", start, stop)
        good = np.isfinite(speed)
        # Where a speed is missing, the wheel turns on with the last one known.
        held = np.append(self.last_speed_rad_s, speed)
        for i in np.flatnonzero(~good).tolist():
            held[i + 1] = held[i]
        held = held[1:]
        angle = np.add.accumulate(np.concatenate(([self.angle_rad], held * period_s)))[1:]
        self.angle_rad, self.last_speed_rad_s = float(angle[-1]), float(held[-1])
        optional = {name: ring.read(name, start, stop) if name in ring.channels else None for name in OPTIONAL}
        channels = Channels(
            time_s=np.arange(start, stop, dtype=np.float64) * period_s,
            speed_rad_s=speed,
            direction=np.sign(speed),
            acceleration_rad_s2=acceleration,
            angle_rad=angle,
            motor_torque_Nm=optional["motor_torque_Nm"],
            bearing_temperature_degC=optional["bearing_temperature_degC"],
            dry_level_Nm=None,
            sample_period_s=period_s,
            good=good,
        )
        viscous = self.wheel.nominal.viscous_Nm_s_rad if self.wheel.nominal else 0.0
        torque, self.memories = effect_torque(self.effects, channels, friction, viscous, self.memories)
        return torque
