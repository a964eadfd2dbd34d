"""The monitor core of one wheel: samples in, events out. Pure: no clock, no network, no file.

    messages → sequencer → order guard → ring buffer → screen → friction less known effects → open windows → diagnosis

Live monitor, replay and the diagnosis of tables all feed this one core, so that they agree by construction, and its
result does not depend on how the samples are cut into messages.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Final, Literal, Self

import numpy as np

from rwa_monitor.diagnosis.evidence import ConfirmedCandidate, WindowAccumulator
from rwa_monitor.diagnosis.model import Model
from rwa_monitor.diagnosis.results import Method
from rwa_monitor.diagnosis.state import CarriedState
from rwa_monitor.diagnosis.window import diagnose_window
from rwa_monitor.errors import InputError
from rwa_monitor.live.checkpoint import (
    ChannelState,
    Checkpoint,
    EffectsState,
    GatheredState,
    GridState,
    HeldBatch,
    ScreenState,
    SequencerState,
    SlotsState,
    WaitingSample,
    WindowsState,
)
from rwa_monitor.live.events import (
    ChannelMissing,
    EpochStarted,
    Event,
    ProvisionalChangepoint,
    SensorFault,
    StraySamples,
    WindowDiagnosed,
)
from rwa_monitor.live.friction import BLOCK_SLOTS, FrictionSource, Source, source_of
from rwa_monitor.live.order_guard import PIECE_SLOTS, OrderGuard, Rows, finite_or_nan
from rwa_monitor.live.ring_buffer import RingBuffer
from rwa_monitor.live.screen import LAG_SLOTS, TORQUE, Fault, Screen, friction_limit, speed_limit
from rwa_monitor.live.sequencer import Batch, Counts, Sequencer
from rwa_monitor.live.settings_check import SettingsCheck
from rwa_monitor.physics.wheel import Wheel
from rwa_monitor.samples import FloatArray, IntArray, Samples
from rwa_monitor.slots import SlotGrid

MAX_OPEN_WINDOWS: Final = 64  # windows that may overlap; a smaller hop would cost memory without telling more


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
        self._sequencer = Sequencer(self.counts)
        self._guard = OrderGuard(wheel.period_ns, self._samples, wheel.limits, wheel.max_motor_torque_Nm, self.counts)
        self._grid = SlotGrid(0, wheel.period_ns)  # of the running epoch
        self._source: Source | Literal[""] = ""  # the channel that friction comes from; the first message decides
        self._said_missing = False
        self._settings_check = SettingsCheck(wheel)
        self._waiting: Rows | None = None  # one sample that the next one judges
        self._begin_source("friction_torque_Nm")

    @property
    def last_sample_ns(self) -> int | None:
        """Time of the latest sample that was taken into the wheel's grid; a wild time is none."""
        return self._guard.last_ns

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
            If `check` does; nothing is taken then.
        """
        self.check(samples)
        if not self._source:
            self._source = source_of(samples, self.wheel)
            if self._source != self._friction.source:
                self._begin_source(self._source)
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
        if self._waiting is not None:
            events += self._place(self._waiting, last=True)
            self._waiting = None
        events += self._end_epoch()
        self._guard.end_epoch()
        return events

    @property
    def buffer_bytes(self) -> int:
        """Memory of the ring buffer [bytes]."""
        return self._ring.nbytes

    @property
    def window_fill(self) -> float:
        """Share of the oldest open window that has passed, 0 … 1."""
        return min((self._done - self._open[0].start) / self._samples, 1.0) if self._open else 0.0

    def check(self, samples: Samples) -> None:
        """Raise InputError if friction is neither given in the first message nor can be derived from it."""
        if not self._source:
            source_of(samples, self.wheel)

    def _begin_source(self, source: Source) -> None:
        """Start with empty slots; values of a piece and what is around it: open windows keep their own."""
        self._friction = FrictionSource(self.wheel, source)
        # Friction that is derived is judged when it is known: a motor may do much more than friction does.
        self._screen = Screen(
            speed_limit(self.wheel), float("inf") if self._friction.derived else friction_limit(self.wheel)
        )
        around = PIECE_SLOTS + LAG_SLOTS + 3 * (self._friction.reach + BLOCK_SLOTS)
        self._ring = RingBuffer(self._samples + around, self._friction.optional, values_capacity=around)
        self._begin_slots()

    def _begin_slots(self) -> None:
        self._done = 0  # slots whose friction has gone into the open windows
        self._next_start = 0  # first slot of the next window to open
        self._last_end = 0  # first slot after the last window that was closed
        self._open: list[_OpenWindow] = []
        self._border = 0  # where the next window begins or ends
        self._screen.reset()
        self._friction.reset()

    def _begin_epoch(self, grid: SlotGrid) -> None:
        self._grid = grid
        self._ring.clear()
        self._begin_slots()

    # ---- samples into slots -----------------------------------------------------------------------------------------

    def _take(self, message: Batch) -> list[Event]:
        samples = message.samples
        torque = self._friction.torque(samples)
        clean = torque is not None and self._guard.is_clean(samples)  # nearly always: there is nothing to look for
        events: list[Event] = self._settings_check.look(samples, clean=clean)
        if torque is None:
            torque = np.full(len(samples), np.nan)
            if not self._said_missing:
                self._said_missing = True
                events.append(ChannelMissing(self._source))
        values = {"speed_rad_s": samples.speed_rad_s, "torque_Nm": torque}
        for name in self._friction.optional:
            measured = self._friction.motor_torque(samples) if name == "motor_torque_Nm" else getattr(samples, name)
            values[name] = np.full(len(samples), np.nan) if measured is None else measured
        straight = clean and not (self._friction.derived or message.passed or self._waiting is not None)
        if straight and self._guard.take_next(samples.time_ns):
            self._ring.append(len(samples), values)
            return events + self._advance()
        if not clean:
            values = {name: finite_or_nan(array) for name, array in values.items()}
        rows = Rows(samples.time_ns, values)
        allowed = None if clean else self._guard.reject_beyond_limits(samples)
        if allowed is not None:
            rows = rows[np.flatnonzero(allowed)]
        return events + self._place(rows, passed=message.passed)

    def _place(self, rows: Rows, *, passed: bool = False, last: bool = False) -> list[Event]:
        """Bring samples into their slots; one that the next sample must judge waits for it."""
        events: list[Event] = []
        if self._waiting is not None and not passed and not last and len(rows):
            rows, self._waiting = self._waiting.followed_by(rows), None
        good = rows.good()
        strays: list[int] = []
        start = 0
        while start < len(rows):
            piece = self._guard.next_piece(rows.time_ns, good, start, self._ring.is_filled, passed=passed, last=last)
            if piece.waits:
                self._waiting = rows[start : start + 1]
                break
            if piece.stray:
                strays.append(int(rows.time_ns[start]))
            if piece.epoch is not None:
                events += self._end_epoch()
                self._begin_epoch(piece.epoch)
                events.append(EpochStarted(piece.epoch.origin_ns, piece.step_ns))
            taken = rows if piece.slots.size == len(rows) else rows[piece.rows]
            events += self._write(piece.slots, taken.values)
            start = piece.stop
        if strays:
            events.append(StraySamples(len(strays), strays[0]))
        return events

    def _write(self, slots: IntArray, values: Mapping[str, FloatArray]) -> list[Event]:
        """Bring new slots, and the empty ones before them, into the ring buffer piece by piece."""
        events: list[Event] = []
        while self._ring.end < self._guard.frontier:
            end = min(self._ring.end + PIECE_SLOTS, self._guard.frontier)
            if slots.size and self._ring.end <= slots[0] and end == self._guard.frontier:  # all at once
                self._ring.extend(end, slots, values)
            else:
                rows = slice(*np.searchsorted(slots, (self._ring.end, end)))
                self._ring.extend(end, slots[rows], {name: array[rows] for name, array in values.items()})
            events += self._advance()
        return events

    # ---- slots into windows -----------------------------------------------------------------------------------------

    def _advance(self, *, to_the_end: bool = False) -> list[Event]:
        """Work off all blocks that are complete, the stencil around them included."""
        if to_the_end:
            seen = ready = self._ring.end
        else:
            seen = self._ring.end - 1  # the last slot only judges those before it
            ready = max(seen - LAG_SLOTS, self._border_before(seen)) - self._friction.reach
            next_block = (self._done // BLOCK_SLOTS + 1) * BLOCK_SLOTS
            if self._done != self._next_start and ready < min(next_block, self._border):
                return []  # nothing to work off, and many slots are screened in the time of one
        masked, faults = self._screen.run(self._ring, seen, self._border_before)
        events = self._told(masked, faults) if masked or faults else []
        while True:
            if self._open and self._window_complete(to_the_end=to_the_end):
                events.append(self._close(self._open.pop(0)))
                self._find_border()
            if self._done == self._next_start and self._done < self._ring.end:
                accumulator = WindowAccumulator(self.wheel, self.method)
                self._open.append(_OpenWindow(self._done, accumulator))
                self._next_start += self._hop
                self._find_border()
            stop = min(self._border, ready)
            if stop < self._border and not to_the_end:
                stop = stop // BLOCK_SLOTS * BLOCK_SLOTS
            if stop <= self._done:
                return events
            events += self._work_off(stop)
            if stop < self._border:
                return events

    def _find_border(self) -> None:
        """Bring it up to date after a window was opened or closed."""
        self._border = min([self._next_start, *(window.start + self._samples for window in self._open)])

    def _border_before(self, slot: int) -> int:
        """Return the last slot up to `slot` with which a window closed; 0 before the first."""
        first = self._samples + self._friction.reach
        return first + (slot - first) // self._hop * self._hop if slot >= first else 0

    def _window_complete(self, *, to_the_end: bool) -> bool:
        """Tell whether the oldest window is full and a sample beyond it, and beyond the stencil, has come."""
        end = self._open[0].start + self._samples
        return end <= self._done and (to_the_end or end + self._friction.reach < self._ring.end)

    def _work_off(self, stop: int) -> list[Event]:
        """Add the slots [done, stop) to all open windows."""
        start, self._done = self._done, stop
        speed = self._ring.read("speed_rad_s", start, stop)
        friction, masked, faults = self._friction.friction(self._ring, start, stop)
        if self._friction.reach:  # otherwise it is what the ring buffer holds
            self._ring.overwrite("torque_Nm", start, friction)
        there = np.ones(stop - start, dtype=np.bool_)  # where values are missing they are NaN
        confirmed = [window.accumulator.append(speed, friction, there) for window in self._open]
        events = self._told(masked, faults) if masked or faults else []
        if not confirmed:
            return events
        # Where windows overlap, the first one to hold a slot tells of it.
        first = self._open[0].start
        return events + [
            self._provisional(first, jump) for jump in confirmed[0] if first + jump.index >= self._last_end
        ]

    def _told(self, masked: int, faults: list[Fault]) -> list[Event]:
        """Count slots that were taken as good and are masked now, and tell why."""
        self.counts.used -= masked
        self.counts.masked += masked
        return [
            SensorFault(
                self._source if fault.channel == TORQUE else fault.channel, fault.hangs, self._grid.time_of(fault.slot)
            )
            for fault in faults
        ]

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

    # ---- checkpoints ------------------------------------------------------------------------------------------------

    def checkpoint(self) -> Checkpoint:
        """Return everything the core knows; `resume` makes an equal core of it."""
        sequencer, guard, friction = self._sequencer, self._guard, self._friction
        needed = min([self._done, *(window.start for window in self._open)])
        around = 2 * friction.reach + BLOCK_SLOTS + LAG_SLOTS
        return Checkpoint(
            source=self._source,
            said_missing=self._said_missing,
            counts=asdict(self.counts),
            carried=self.carried,
            sequencer=SequencerState(
                current=sequencer.current,
                expected=sequencer.expected,
                held=[HeldBatch.of(batch) for batch in sequencer.held.values()],
                skipped=list(sequencer.skipped),
                challenge=[HeldBatch.of(batch) for batch in sequencer.challenge],
                challenge_doubtful=sequencer.challenge_doubtful,
                largest=sequencer.largest,
                replaced=list(sequencer.replaced),
                latest_ns=sequencer.latest_ns,
            ),
            waiting=None if self._waiting is None else WaitingSample.of(self._waiting),
            epoch_origin_ns=self._grid.origin_ns,
            grid=GridState(
                origin_ns=guard.grid.origin_ns if guard.grid else None, frontier=guard.frontier, last_ns=guard.last_ns
            ),
            slots=SlotsState.of(self._ring, needed - around, self._done - around),
            screen=ScreenState.of(self._screen),
            effects=EffectsState(
                angle_rad=friction.angle_rad,
                last_speed_rad_s=friction.last_speed_rad_s,
                friction=ChannelState.of(friction.channel),
                memories=[None if memory is None else memory.tolist() for memory in friction.memories],
            ),
            windows=WindowsState(
                done=self._done,
                next_start=self._next_start,
                last_end=self._last_end,
                open=[window.start for window in self._open],
                gathered=[GatheredState.of(window.accumulator.gathered()) for window in self._open],
            ),
        )

    @classmethod
    def resume(cls, checkpoint: Checkpoint, wheel: Wheel, model: Model | None, *, method: Method) -> Self:
        """Return a core that goes on from a checkpoint of a core with the same wheel, model and method.

        Raises
        ------
        InputError
            As the constructor, or if the checkpoint does not fit the wheel.
        """
        core = cls(wheel, model, method=method, carried=checkpoint.carried)
        if checkpoint.source:
            core._source = checkpoint.source
            core._begin_source(checkpoint.source)
        core._said_missing = checkpoint.said_missing
        unknown = set(checkpoint.counts) - {field.name for field in fields(core.counts)}
        if unknown:
            raise InputError("checkpoint", f"{min(unknown)[:40]!r} is nothing that is counted", "counts")
        for name, count in checkpoint.counts.items():  # the sequencer and the guard count in the same place
            setattr(core.counts, name, count)
        core._resume_order(checkpoint)
        core._resume_slots(checkpoint)
        return core

    def _resume_order(self, checkpoint: Checkpoint) -> None:
        state, grid = checkpoint.sequencer, checkpoint.grid
        sequencer, guard = self._sequencer, self._guard
        sequencer.current, sequencer.expected = state.current, state.expected
        sequencer.held = {held.number: held.batch() for held in state.held if held.number is not None}
        sequencer.skipped = dict.fromkeys(state.skipped)
        sequencer.challenge = [held.batch() for held in state.challenge]
        sequencer.challenge_doubtful = state.challenge_doubtful
        sequencer.largest, sequencer.replaced = state.largest, list(state.replaced)
        sequencer.latest_ns = state.latest_ns
        guard.grid = None if grid.origin_ns is None else SlotGrid(grid.origin_ns, self.wheel.period_ns)
        guard.frontier, guard.last_ns = grid.frontier, grid.last_ns
        self._grid = SlotGrid(checkpoint.epoch_origin_ns, self.wheel.period_ns)

    def _resume_slots(self, checkpoint: Checkpoint) -> None:
        slots, effects, windows = checkpoint.slots, checkpoint.effects, checkpoint.windows
        fits = (
            0 <= slots.end - slots.begin <= self._ring.capacity
            and slots.consistent
            and set(slots.values) == set(self._ring.channels)
            and (checkpoint.waiting is None or set(checkpoint.waiting.values) == set(self._ring.channels))
            and len(effects.memories) == len(self._friction.memories)
            and slots.begin <= min([windows.done, *windows.open])
            and windows.done <= slots.end
            and (windows.gathered is None or len(windows.gathered) == len(windows.open))
        )
        if not fits:
            raise InputError("checkpoint", f"does not fit the wheel {self.wheel.name}")
        slots.restore(self._ring)
        if checkpoint.screen is not None:
            checkpoint.screen.restore(self._screen)
        else:  # of a version that did not screen: it begins now
            self._screen.done = windows.done
        self._waiting = None if checkpoint.waiting is None else checkpoint.waiting.rows()
        self._friction.angle_rad = effects.angle_rad
        self._friction.last_speed_rad_s = effects.last_speed_rad_s
        if effects.friction is not None:
            self._friction.channel = effects.friction.channel()
        self._friction.memories = [None if m is None else np.array(m, dtype=np.float64) for m in effects.memories]
        self._done, self._next_start, self._last_end = windows.done, windows.next_start, windows.last_end
        for place, start in enumerate(windows.open):
            accumulator = WindowAccumulator(self.wheel, self.method)
            if windows.gathered is not None:
                accumulator.resume(windows.gathered[place].gathered())
            else:
                speed = slots.read("speed_rad_s", start, self._done)
                friction = slots.read("torque_Nm", start, self._done)
                accumulator.append(speed, friction, np.isfinite(speed) & np.isfinite(friction))
            self._open.append(_OpenWindow(start, accumulator))
        self._find_border()


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
