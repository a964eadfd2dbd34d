"""The friction torque of a wheel's slots: given or derived from current, less the effects the wheel is known to have.

Whatever is computed over several slots at once is computed in blocks that are cut at multiples of 64 slots of the grid
and at the borders of windows, never where a message happens to end, so that the bits do not depend on how samples
arrive.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.changepoints.evidence import UNKNOWN_K, ViscousSpeed
from rwa_monitor.kernels.ingest import STANDS_OUT
from rwa_monitor.samples import FloatArray, Samples
from rwa_monitor.telemetry.ring_buffer import OPTIONAL, RingBuffer
from rwa_monitor.telemetry.sensor_validation import Channel, Fault, friction_limit
from rwa_monitor.wheel.effects.base import Channels, Memory, begun
from rwa_monitor.wheel.effects.catalogue import effect_torque, mean_effects, viscous_effects
from rwa_monitor.wheel.effects.viscosity_temperature import REFERENCE_K, ZERO_CELSIUS_K
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
TEMPERATURE: Final = "bearing_temperature_degC"


# A bearing's temperature that is not known is as far off as it may have moved: as fast as one that swings by ±3 K in
# 95 min, an orbit's eclipses, and no further than the seasons go. Working assumptions.
DRIFT_K_S: Final = 3.3e-3
LARGEST_ERROR_K: Final = 15.0
STUCK_S: Final = 300.0  # in which that drift is 1 K: shorter repetitions do no harm
STUCK_RUNS: Final = 10.0  # times the longest repetition of one value before
BEARING_DEGC: Final = (-100.0, 200.0)  # °C: no lubricant lasts beyond


def held_temperature(
    measured_degC: FloatArray, period_s: float, start_degC: float, memory: Memory = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the bearing's temperature in every slot: where it is missing the last one holds, ever more uncertain.

    A channel that was restless and repeats one value for long is stuck: that value is as old as it is. One that never
    moved may be a quiet bearing in coarse digits, and is believed.

    Parameters
    ----------
    measured_degC, period_s
        float64 (n,), consecutive slots, NaN where it was not measured [°C]; from slot to slot [s].
    start_degC
        Before the first one is known [°C].
    memory
        What an earlier call returned for the slots just before; None at the start of an epoch.

    Returns
    -------
    temperature, error
        float64 (n,) each [°C], [K].
    memory
        float64 (4,): the last temperature known, NaN before the first; for how many slots it has been missing; how
        often it was repeated; the most that any was.
    """
    last, missing, repeated, most = begun(memory, np.nan, 0.0, 0.0, 0.0)
    values = np.append(last, measured_degC)
    at = np.arange(values.size)
    known = (values > BEARING_DEGC[0]) & (values < BEARING_DEGC[1])
    known[0] = True  # whatever it is, it goes on
    known_at = np.maximum.accumulate(np.where(known, at, 0))
    held = values[known_at]
    missing_for = at - known_at + np.where(known_at == 0, missing, 0.0)
    changed = np.append(False, held[1:] != held[:-1]) & known
    changed_at = np.maximum.accumulate(np.where(changed, at, 0))
    repeated_for = at - changed_at + np.where(changed_at == 0, repeated, 0.0)
    # How long a run was that ended, if it was neither missing nor stuck.
    ended = np.where(changed[1:] & (missing_for[:-1] == 0.0), repeated_for[:-1] + 1.0, 0.0)
    ended[np.isnan(held[:-1]) | (ended * period_s > STUCK_S)] = 0.0
    most_before = np.maximum.accumulate(np.append(most, ended))
    stuck = (most_before > 0.0) & (repeated_for > np.maximum(STUCK_RUNS * most_before, STUCK_S / period_s))
    age_s = period_s * np.where(stuck, np.maximum(repeated_for, missing_for), missing_for)
    unknown = np.isnan(held)
    error = np.where(unknown, LARGEST_ERROR_K, np.minimum(DRIFT_K_S * age_s, LARGEST_ERROR_K))
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
        What the effects keep of the slots so far, and at last `held_temperature` where one needs the temperature.
    at_corners, at_limit
        Samples masked since this process began: where the speed bends too sharply for friction to be derived, and with
        the current at its limit.
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
        self.memories: list[Memory] = [None] * (len(self.effects) + (TEMPERATURE in self.optional))

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
    ) -> tuple[FloatArray, int, list[Fault], ViscousSpeed | None]:
        """Return the friction torque of the slots [start, stop), where it stands out, and its viscous speed.

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
        viscous
            What viscous friction is in proportion to; None where that is the speed.
        """
        if self.reach == 0:
            return torque, 0, [], None
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
        viscous = self._take_effects_out(ring, start, stop, acceleration, friction)
        return friction, masked, faults, viscous

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
        """Return the torque that effects add in one block of slots [N m], and what viscous friction follows."""
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
        effects, *of_temperature = self.memories[: len(self.effects)], *self.memories[len(self.effects) :]
        temperature, error = np.full(speed.size, np.nan), np.zeros(speed.size)
        if (measured := optional[TEMPERATURE]) is not None:
            start_degC = self.wheel.temperature.middle if self.wheel.temperature else REFERENCE_K - ZERO_CELSIUS_K
            temperature, error, *of_temperature = held_temperature(measured, period_s, start_degC, *of_temperature)
        channels = Channels(
            time_s=np.arange(start, stop, dtype=np.float64) * period_s,
            speed_rad_s=speed,
            direction=np.sign(speed),
            acceleration_rad_s2=acceleration,
            angle_rad=angle,
            motor_torque_Nm=optional["motor_torque_Nm"],
            bearing_temperature_degC=temperature if TEMPERATURE in ring.channels else None,
            dry_level_Nm=None,
            sample_period_s=period_s,
            good=good,
        )
        viscous = self.wheel.nominal.viscous_Nm_s_rad if self.wheel.nominal else 0.0
        torque, viscous_speed, effects = effect_torque(self.effects, channels, friction, viscous, effects)
        self.memories = [*effects, *of_temperature]
        if self.adds_by_temperature:
            torque = np.where(error < UNKNOWN_K, torque, np.nan)
        return torque, ViscousSpeed(viscous_speed, temperature, error)
