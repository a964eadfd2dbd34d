"""The monitor core of one wheel: samples in, events out. Pure: no clock, no network, no file.

    messages → sequencer → order guard → ring buffer → friction → less the wheel's effects → open windows → diagnosis

Live monitor, replay and the diagnosis of tables all feed this one core, so that they agree by construction. Whatever is
computed over several slots at once is computed in blocks that are cut at multiples of 64 slots and at the borders of
windows, never where a message happens to end: the result does not depend on how samples arrive.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from rwa_monitor.diagnosis.evidence import ConfirmedCandidate, WindowAccumulator
from rwa_monitor.diagnosis.model import Model
from rwa_monitor.diagnosis.results import Method
from rwa_monitor.diagnosis.state import CarriedState
from rwa_monitor.diagnosis.window import diagnose_window
from rwa_monitor.diagnosis.window_diagnosis import WindowDiagnosis
from rwa_monitor.errors import InputError
from rwa_monitor.live.order_guard import (
    PIECE_SLOTS,
    Batch,
    Counts,
    MessagesMissed,
    OrderGuard,
    PublisherChanged,
    PublisherConflict,
    Sequencer,
)
from rwa_monitor.live.ring_buffer import OPTIONAL, RingBuffer
from rwa_monitor.physics.effects.base import Channels, Memory
from rwa_monitor.physics.effects.catalogue import mean_effects
from rwa_monitor.physics.torque_balance import differentiate, friction_torque, half_width, inertia_of
from rwa_monitor.physics.wheel import Wheel
from rwa_monitor.samples import FloatArray, IntArray, Samples
from rwa_monitor.slots import SlotGrid

BLOCK_SLOTS: Final = 64  # effects are evaluated in blocks of this many slots, anchored at slot 0
MAX_OPEN_WINDOWS: Final = 64  # windows that may overlap; a smaller hop would cost memory without telling more


# ---- events ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class EpochStarted:
    """The slot grid begins anew: the wheel's first sample, or a clock step of more than a window.

    Attributes
    ----------
    origin_ns
        Time of slot 0.
    step_ns
        By how much the clock stepped; 0 at the first sample.
    """

    origin_ns: int
    step_ns: int


@dataclass(frozen=True, slots=True)
class ProvisionalChangepoint:
    """A jump of friction, as soon as it is confirmed; the window's diagnosis has the last word on it.

    Attributes
    ----------
    window_start_ns
        Of the window it lies in.
    index, time_ns
        First slot of the new level, within the window, and its time.
    jump_Nm, std_Nm
        Size, positive up, and its standard deviation.
    confidence
        Probability that noise alone has no such jump in a whole window.
    """

    window_start_ns: int
    index: int
    time_ns: int
    jump_Nm: float
    std_Nm: float
    confidence: float


@dataclass(frozen=True, slots=True)
class WindowDiagnosed:
    """A window was closed and diagnosed.

    Attributes
    ----------
    start_ns, end_ns, period_ns
        The window is [start, end): `end_ns` is the time of the first slot after it.
    partial
        True where samples or an epoch ended before the window was full.
    diagnosis
        What it says.
    carried
        The wheel's state after it.
    """

    start_ns: int
    end_ns: int
    period_ns: int
    partial: bool
    diagnosis: WindowDiagnosis
    carried: CarriedState


@dataclass(frozen=True, slots=True)
class ChannelMissing:
    """A message lacks the channel that this wheel's friction comes from; its samples are masked."""

    channel: str


Event = (
    EpochStarted
    | ProvisionalChangepoint
    | WindowDiagnosed
    | ChannelMissing
    | PublisherChanged
    | PublisherConflict
    | MessagesMissed
)


# ---- the core --------------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class _OpenWindow:
    """A window that is being filled: its first slot and what it has gathered."""

    start: int
    accumulator: WindowAccumulator


class WheelCore:
    """The monitor of one wheel.

    Parameters
    ----------
    wheel
        Its constants.
    model
        What nominal and anomalous friction look like; None leaves anomalies undecided.
    method
        "joint" or "paper".
    carried
        What earlier windows told; None for nothing.

    Attributes
    ----------
    counts
        What became of every sample so far.

    Raises
    ------
    InputError
        If the wheel's windows overlap more than 64-fold, or its effects cannot be built.
    """

    def __init__(
        self, wheel: Wheel, model: Model | None, *, method: Method = "joint", carried: CarriedState | None = None
    ) -> None:
        self.wheel = wheel
        self.model = model
        self.method = method
        self.carried = carried if carried is not None else CarriedState.empty()
        self.counts = Counts()

        self._samples, self._hop = wheel.window.samples, wheel.window.hop_slots
        if self._samples > MAX_OPEN_WINDOWS * self._hop:
            raise InputError(
                f"wheel {wheel.name}",
                f"is below 1/{MAX_OPEN_WINDOWS} of window.samples ({self._samples})",
                "window.hop",
            )
        self._effects = mean_effects(wheel)
        self._sequencer = Sequencer(self.counts)
        self._guard = OrderGuard(wheel.period_ns, self._samples, wheel.limits, wheel.torque_constant_Nm_A, self.counts)
        self._source = ""  # the channel that friction comes from; decided by the first message
        self._reach = 0  # slots that the derivative's stencil reaches to either side
        self._said_missing = False
        self._grid = SlotGrid(0, wheel.period_ns)  # of the running epoch
        self._begin_ring(())

    # ---- in ---------------------------------------------------------------------------------------------------------

    def feed(self, samples: Samples, publisher: str = "", batch: int | None = None) -> list[Event]:
        """Take samples in any cut and return what happened, in order.

        Parameters
        ----------
        samples
            One message, or a whole table.
        publisher
            Who sent it; "" when it does not say.
        batch
            Its number, counted up by one by each publisher; None when it does not say.

        Raises
        ------
        InputError
            If friction is neither given nor can be derived; nothing is taken then.
        """
        if not self._source:
            self._choose_source(samples)
        ready, notes = self._sequencer.put(Batch(publisher, batch, samples), self._guard.last_ns)
        events: list[Event] = list(notes)
        for message in ready:
            events += self._take(message)
        return events

    def finish(self) -> list[Event]:
        """Take what waits, close the open window as it is, and return what happened: nothing more will come."""
        ready, notes = self._sequencer.flush(self._guard.last_ns)
        events: list[Event] = list(notes)
        for message in ready:
            events += self._take(message)
        events += self._end_epoch()
        self._guard.end_epoch()
        return events

    def _choose_source(self, samples: Samples) -> None:
        wheel = self.wheel
        if samples.friction_torque_Nm is not None:
            source = "friction_torque_Nm"
        elif wheel.inertia_kg_m2 is not None and samples.motor_torque_Nm is not None:
            source = "motor_torque_Nm"
        elif None not in (wheel.inertia_kg_m2, wheel.torque_constant_Nm_A) and samples.motor_current_A is not None:
            source = "motor_current_A"
        else:
            raise InputError(
                f"wheel {wheel.name}",
                "friction_torque_Nm is missing, and friction cannot be derived: that takes motor_current_A with "
                "torque_constant_Nm_A and inertia_kg_m2 of the wheel, or motor_torque_Nm with inertia_kg_m2",
            )
        self._source = source
        if source != "friction_torque_Nm" or self._effects:
            self._reach = half_width(wheel.friction.derivative, wheel.sample_period_s)
        needed = frozenset[str]().union(*(effect.needs for effect in self._effects))
        self._begin_ring(tuple(name for name in OPTIONAL if name in needed))

    def _begin_ring(self, optional: tuple[str, ...]) -> None:
        """Start with empty slots; room for the open windows, a piece before them and the stencil around it."""
        capacity = self._samples + PIECE_SLOTS + 2 * (self._reach + BLOCK_SLOTS)
        self._ring = RingBuffer(capacity, optional)
        self._begin_slots()

    def _begin_slots(self) -> None:
        self._done = 0  # slots whose friction has gone into the open windows
        self._next_start = 0  # first slot of the next window to open
        self._last_end = 0  # first slot after the last window that was closed
        self._open: list[_OpenWindow] = []
        self._angle_rad = 0.0
        self._last_speed = 0.0
        self._memories: list[Memory] = [None] * len(self._effects)

    def _begin_epoch(self, grid: SlotGrid) -> None:
        self._grid = grid
        self._ring.clear()
        self._begin_slots()

    # ---- samples into slots -----------------------------------------------------------------------------------------

    def _take(self, message: Batch) -> list[Event]:
        samples = message.samples
        events: list[Event] = []
        torque = self._torque(samples)
        if torque is None:
            torque = np.full(len(samples), np.nan)
            if not self._said_missing:
                self._said_missing = True
                events.append(ChannelMissing(self._source))
        good = np.isfinite(samples.speed_rad_s) & np.isfinite(torque)
        values = {
            "speed_rad_s": np.where(np.isfinite(samples.speed_rad_s), samples.speed_rad_s, np.nan),
            "torque_Nm": np.where(np.isfinite(torque), torque, np.nan),
            "motor_torque_Nm": _or_unknown(self._motor_torque(samples), len(samples)),
            "bearing_temperature_degC": _or_unknown(samples.bearing_temperature_degC, len(samples)),
        }
        allowed = ~self._guard.beyond_limits(samples)
        start = 0
        while start < len(samples):
            piece = self._guard.next_piece(message, allowed, good, start, self._ring.is_filled)
            if piece.epoch is not None:
                events += self._end_epoch()
                self._begin_epoch(piece.epoch)
                events.append(EpochStarted(piece.epoch.origin_ns, piece.step_ns))
            events += self._write(piece.slots, {name: array[piece.rows] for name, array in values.items()})
            start = piece.stop
        return events

    def _motor_torque(self, samples: Samples) -> FloatArray | None:
        if samples.motor_torque_Nm is not None:
            return samples.motor_torque_Nm
        if samples.motor_current_A is not None and self.wheel.torque_constant_Nm_A is not None:
            return self.wheel.torque_constant_Nm_A * samples.motor_current_A
        return None

    def _torque(self, samples: Samples) -> FloatArray | None:
        """Return the torque that friction comes from: itself, or the motor torque."""
        if self._source == "friction_torque_Nm":
            return samples.friction_torque_Nm
        if self._source == "motor_torque_Nm":
            return samples.motor_torque_Nm
        return None if samples.motor_current_A is None else self._motor_torque(samples)

    def _write(self, slots: IntArray, values: dict[str, FloatArray]) -> list[Event]:
        """Bring new slots, and the empty ones before them, into the ring buffer piece by piece."""
        events: list[Event] = []
        while self._ring.end < self._guard.frontier:
            end = min(self._ring.end + PIECE_SLOTS, self._guard.frontier)
            rows = slice(*np.searchsorted(slots, (self._ring.end, end)))
            self._ring.extend(end, slots[rows], {name: array[rows] for name, array in values.items()})
            events += self._advance()
        return events

    # ---- slots into windows -----------------------------------------------------------------------------------------

    def _advance(self, *, to_the_end: bool = False) -> list[Event]:
        """Work off all blocks that are complete, the stencil around them included."""
        events: list[Event] = []
        ready = self._ring.end - (0 if to_the_end else self._reach)
        while True:
            if self._open and self._window_complete(to_the_end=to_the_end):
                events.append(self._close(self._open.pop(0)))
            if self._done == self._next_start and self._done < self._ring.end:
                accumulator = WindowAccumulator(self.wheel, self.method)
                self._open.append(_OpenWindow(self._done, accumulator))
                self._next_start += self._hop
            border = min([self._next_start, *(window.start + self._samples for window in self._open)])
            stop = min(border, ready)
            if stop < border and not to_the_end:
                stop = stop // BLOCK_SLOTS * BLOCK_SLOTS
            if stop <= self._done:
                return events
            events += self._work_off(stop)

    def _window_complete(self, *, to_the_end: bool) -> bool:
        """Tell whether the oldest window is full and a sample beyond it, and beyond the stencil, has come."""
        end = self._open[0].start + self._samples
        return end <= self._done and (to_the_end or end + self._reach < self._ring.end)

    def _work_off(self, stop: int) -> list[Event]:
        """Add the slots [done, stop) to all open windows."""
        start, self._done = self._done, stop
        speed = self._ring.read("speed_rad_s", start, stop)
        friction = self._friction(start, stop)
        self._ring.overwrite("torque_Nm", start, friction)
        good = np.isfinite(speed) & np.isfinite(friction)
        confirmed = [window.accumulator.append(speed, friction, good) for window in self._open]
        if not confirmed:
            return []
        # Where windows overlap, the first one to hold a slot tells of it.
        first = self._open[0].start
        return [self._provisional(first, jump) for jump in confirmed[0] if first + jump.index >= self._last_end]

    def _friction(self, start: int, stop: int) -> FloatArray:
        """Return the friction torque of the slots [start, stop) without the wheel's effects [N m]."""
        torque = self._ring.read("torque_Nm", start, stop)
        if self._reach == 0:
            return torque
        reach = self._reach
        around = self._ring.read("speed_rad_s", start - reach, stop + reach)
        acceleration = differentiate(around, self.wheel.friction.derivative, self.wheel.sample_period_s)
        acceleration = acceleration[reach : reach + stop - start]
        if self._source != "friction_torque_Nm":
            torque = friction_torque(torque, acceleration, inertia_of(self.wheel))
        low = start
        while self._effects and low < stop:
            high = min((low // BLOCK_SLOTS + 1) * BLOCK_SLOTS, stop)
            block = slice(low - start, high - start)
            torque[block] -= self._effect_torque(low, high, acceleration[block])
            low = high
        return torque

    def _effect_torque(self, start: int, stop: int, acceleration: FloatArray) -> FloatArray:
        """Return the torque of all effects in one block of slots [N m]."""
        period_s = self.wheel.sample_period_s
        speed = self._ring.read("speed_rad_s", start, stop)
        good = np.isfinite(speed)
        # Where a speed is missing, the wheel turns on with the last one known.
        held = speed.copy()
        for i in range(held.size):
            if not good[i]:
                held[i] = held[i - 1] if i else self._last_speed
        angle = np.add.accumulate(np.concatenate(([self._angle_rad], held * period_s)))[1:]
        self._angle_rad, self._last_speed = float(angle[-1]), float(held[-1])
        optional = {
            name: self._ring.read(name, start, stop) if name in self._ring.channels else None for name in OPTIONAL
        }
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
        total = np.zeros(stop - start)
        for i, effect in enumerate(self._effects):
            torque, self._memories[i] = effect.torque(channels, self._memories[i])
            total += torque
        return total

    # ---- windows into diagnoses -------------------------------------------------------------------------------------

    def _provisional(self, window_start: int, candidate: ConfirmedCandidate) -> ProvisionalChangepoint:
        return ProvisionalChangepoint(
            window_start_ns=self._grid.time_of(window_start),
            index=candidate.index,
            time_ns=self._grid.time_of(window_start + candidate.index),
            jump_Nm=candidate.jump * self.wheel.torque_unit_Nm,
            std_Nm=candidate.std * self.wheel.torque_unit_Nm,
            confidence=candidate.confidence,
        )

    def _close(self, window: _OpenWindow) -> WindowDiagnosed:
        """Diagnose a window, full or not."""
        end = min(window.start + self._samples, self._done)
        partial = end < window.start + self._samples
        evidence = window.accumulator.close()
        diagnosis, self.carried = diagnose_window(evidence, self.wheel, self.model, self.carried, self.method)
        if partial:
            self.carried = _forget_positions(self.carried)
        self._last_end = end
        return WindowDiagnosed(
            start_ns=self._grid.time_of(window.start),
            end_ns=self._grid.time_of(end),
            period_ns=self._grid.period_ns,
            partial=partial,
            diagnosis=diagnosis,
            carried=self.carried,
        )

    def _end_epoch(self) -> list[Event]:
        """Close the oldest open window as it is; of overlapping ones it holds all slots that no window had yet."""
        events = self._advance(to_the_end=True)
        if self._open and self._done > max(self._last_end, self._open[0].start):
            events.append(self._close(self._open[0]))
        self._open.clear()
        self.carried = _forget_positions(self.carried)
        return events


def _or_unknown(values: FloatArray | None, size: int) -> FloatArray:
    return np.full(size, np.nan) if values is None else values


def _forget_positions(carried: CarriedState) -> CarriedState:
    """Return the state without where the switching systems stand: the next window does not follow at once."""
    systems = tuple(system.model_copy(update={"configuration": None, "age": None}) for system in carried.fss)
    return carried.model_copy(update={"fss": systems})


def diagnose_samples(
    samples: Samples,
    wheel: Wheel,
    model: Model | None,
    *,
    method: Method = "joint",
    carried: CarriedState | None = None,
) -> Iterator[WindowDiagnosed]:
    """Diagnose a whole table, window by window, through the core of the live monitor.

    Parameters
    ----------
    samples
        The table.
    wheel, model, method, carried
        As for `WheelCore`.

    Yields
    ------
    WindowDiagnosed
        One for each window, the last one perhaps partial; its `carried` is what a following table starts with.

    Raises
    ------
    InputError
        If friction is neither given nor can be derived.
    """
    core = WheelCore(wheel, model, method=method, carried=None if carried is None else _forget_positions(carried))
    for event in (*core.feed(samples), *core.finish()):
        if isinstance(event, WindowDiagnosed):
            yield event
