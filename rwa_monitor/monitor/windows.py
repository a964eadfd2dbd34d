"""From the slots of one wheel to the diagnoses of its windows: the second half of the monitor core.

    ring buffer → sensor validation → friction less known effects → open windows → diagnosis

Pure, as the core is. Work is done in blocks that end at fixed slots of the grid, at most a few slots behind the newest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from rwa_monitor.changepoints.evidence import ConfirmedCandidate, WindowAccumulator
from rwa_monitor.changepoints.stage_results import Method
from rwa_monitor.diagnosis.model import Model
from rwa_monitor.diagnosis.verdict import MIN_COVERAGE
from rwa_monitor.diagnosis.window import diagnose_window
from rwa_monitor.errors import InputError
from rwa_monitor.messages import ProvisionalJump
from rwa_monitor.monitor.checkpoint import (
    Checkpoint,
    EffectsState,
    GatheredState,
    ScreenState,
    SlotsState,
    WindowsState,
)
from rwa_monitor.monitor.events import Event, ProvisionalChangepoint, SensorFault, WindowDiagnosed
from rwa_monitor.monitor.ingest.sequencer import Counts
from rwa_monitor.monitor.ingest.slot_assignment import PIECE_SLOTS
from rwa_monitor.monitor.settings_check import with_sample_period
from rwa_monitor.paper import method as paper
from rwa_monitor.samples import SlotGrid
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.telemetry.friction import BLOCK_SLOTS, FrictionSource, Source
from rwa_monitor.telemetry.ring_buffer import RingBuffer
from rwa_monitor.telemetry.sensor_validation import (
    LAG_SLOTS,
    TORQUE,
    Fault,
    SensorValidation,
    friction_limit,
    speed_limit,
)
from rwa_monitor.wheel.wheel import Wheel

MAX_OPEN_WINDOWS: Final = 64  # windows that may overlap; a smaller hop would cost memory without more information
_THERE: Final = np.ones(4096, dtype=np.bool_)  # slots of a message, all there


@dataclass(slots=True)
class _OpenWindow:
    """A window that is being filled: its first slot and what it has gathered."""

    start: int
    accumulator: WindowAccumulator


class Windows:
    """The slots of one wheel, the windows that are open over them, and the state carried over from the closed ones.

    Parameters
    ----------
    wheel, model, method, carried
        As for `core.WheelCore`.
    counts
        Where to count slots that were taken as good and are masked later.

    Attributes
    ----------
    carried
        The state that the windows closed so far hand to the next one.
    ring, screen, friction
        What the slots go through, anew for each source of friction.
    grid
        The slot grid of the running epoch.

    Raises
    ------
    InputError
        If the wheel's windows overlap more than 64-fold, or its effects cannot be built.
    """

    def __init__(
        self, wheel: Wheel, model: Model | None, method: Method, carried: CarriedState, counts: Counts
    ) -> None:
        self.wheel = wheel
        self.model = model
        self.method = method
        self.carried = carried
        self.counts = counts
        self.grid = SlotGrid(0, wheel.period_ns)
        self._samples, self._hop = wheel.window.samples, wheel.window.hop_slots
        if self._samples > MAX_OPEN_WINDOWS * self._hop:
            raise InputError(
                f"wheel {wheel.name}",
                f"is below 1/{MAX_OPEN_WINDOWS} of window.samples ({self._samples})",
                "window.hop",
            )
        self.begin_source("friction_torque_Nm")

    @property
    def fill(self) -> float:
        """Share of the oldest open window that has passed, 0 … 1."""
        return min((self._done - self._open[0].start) / self._samples, 1.0) if self._open else 0.0

    # ---- beginnings and ends ----------------------------------------------------------------------------------------

    def begin_source(self, source: Source) -> None:
        """Start with empty slots; values of a piece and what is around it: open windows keep their own."""
        self.friction = FrictionSource(self.wheel, source)
        # Friction that is derived is judged when it is known: a motor may do much more than friction does.
        self.screen = SensorValidation(
            speed_limit(self.wheel), float("inf") if self.friction.derived else friction_limit(self.wheel)
        )
        around = PIECE_SLOTS + LAG_SLOTS + 3 * (self.friction.reach + BLOCK_SLOTS)
        self.ring = RingBuffer(self._samples + around, self.friction.optional, values_capacity=around)
        self._begin_slots()

    def _begin_slots(self) -> None:
        self._done = 0  # slots whose friction has gone into the open windows
        self._next_start = 0  # first slot of the next window to open
        self._last_end = 0  # first slot after the last window that was closed
        self._open: list[_OpenWindow] = []
        self._border = 0  # where the next window begins or ends
        self.screen.reset()
        self.friction.reset()

    def begin_epoch(self, grid: SlotGrid) -> None:
        """Begin again with slot 0 of a new grid."""
        self.grid = grid
        self.ring.clear()
        self._begin_slots()

    def end_epoch(self) -> list[Event]:
        """Close the oldest open window as it is; of overlapping ones it holds all slots that no window had yet."""
        events = self.advance(to_the_end=True)
        if self._open and self._done > max(self._last_end, self._open[0].start):
            events.append(self._close(self._open[0]))
        self._open.clear()
        self.carried = without_positions(self.carried)
        return events

    # ---- slots into windows -----------------------------------------------------------------------------------------

    def advance(self, *, to_the_end: bool = False) -> list[Event]:
        """Work off all blocks that are complete, the stencil around them included."""
        if to_the_end:
            seen = ready = self.ring.end
        else:
            seen = self.ring.end - 1  # the last slot only judges those before it
            ready = max(seen - LAG_SLOTS, self._border_before(seen)) - self.friction.reach
            next_block = (self._done // BLOCK_SLOTS + 1) * BLOCK_SLOTS
            if self._done != self._next_start and ready < min(next_block, self._border):
                return []  # nothing to work off, and many slots are screened in the time of one
        masked, faults = self.screen.run(self.ring, seen, self._border_before)
        events = self._mask(masked, faults) if masked or faults else []
        while True:
            if self._open and self._window_complete(to_the_end=to_the_end):
                events.append(self._close(self._open.pop(0)))
                self._find_border()
            if self._done == self._next_start and self._done < self.ring.end:
                accumulator = WindowAccumulator(self.wheel)
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
        first = self._samples + self.friction.reach
        return first + (slot - first) // self._hop * self._hop if slot >= first else 0

    def _window_complete(self, *, to_the_end: bool) -> bool:
        """Return whether the oldest window is full and a sample beyond it, and beyond the stencil, has come."""
        end = self._open[0].start + self._samples
        return end <= self._done and (to_the_end or end + self.friction.reach < self.ring.end)

    def _work_off(self, stop: int) -> list[Event]:
        """Add the slots [done, stop) to all open windows."""
        start, self._done = self._done, stop
        speed, torque = self.ring.read_required(start, stop)
        friction, masked, faults = self.friction.friction(self.ring, start, stop, torque)
        count = stop - start
        there = _THERE[:count] if count <= _THERE.size else np.ones(count, dtype=np.bool_)  # missing values are NaN
        confirmed = [window.accumulator.append(speed, friction, there) for window in self._open]
        events = self._mask(masked, faults) if masked or faults else []
        if not confirmed or not confirmed[0]:
            return events
        # Where windows overlap, the first one to hold a slot reports it.
        first = self._open[0].start
        return events + [
            self._provisional(first, jump) for jump in confirmed[0] if first + jump.index >= self._last_end
        ]

    def _mask(self, masked: int, faults: list[Fault]) -> list[Event]:
        """Count slots that were taken as good and are masked now, and return why."""
        self.counts.used -= masked
        self.counts.masked += masked
        return [
            SensorFault(
                self.friction.source if fault.channel == TORQUE else fault.channel,
                fault.hangs,
                self.grid.time_of(fault.slot),
            )
            for fault in faults
        ]

    # ---- windows into diagnoses -------------------------------------------------------------------------------------

    def _provisional(self, window_start: int, candidate: ConfirmedCandidate) -> ProvisionalChangepoint:
        jump = ProvisionalJump(
            index=candidate.index,
            time_ns=self.grid.time_of(window_start + candidate.index),
            jump_Nm=candidate.jump * self.wheel.torque_unit_Nm,
            std_Nm=candidate.std * self.wheel.torque_unit_Nm,
            confidence=candidate.confidence,
        )
        return ProvisionalChangepoint(self.grid.time_of(window_start), jump)

    def _close(self, window: _OpenWindow) -> WindowDiagnosed:
        """Diagnose a window, full or not."""
        end = min(window.start + self._samples, self._done)
        partial = end < window.start + self._samples
        evidence = window.accumulator.close()
        diagnose = paper.diagnose_window if self.method == "paper" else diagnose_window
        diagnosis, self.carried = diagnose(evidence, self.wheel, self.model, self.carried)
        if diagnosis.used < MIN_COVERAGE * diagnosis.slots:
            good = np.isfinite(window.accumulator.gathered().x)
            diagnosis = with_sample_period(diagnosis, good, self.wheel.sample_period_s)
        if partial:
            self.carried = without_positions(self.carried)
        self._last_end = end
        return WindowDiagnosed(
            start_ns=self.grid.time_of(window.start),
            end_ns=self.grid.time_of(end),
            period_ns=self.grid.period_ns,
            partial=partial,
            diagnosis=diagnosis,
            carried=self.carried,
        )

    # ---- checkpoints ------------------------------------------------------------------------------------------------

    def states(self) -> dict[str, Any]:
        """Return what a checkpoint holds of the slots that are still needed, and of what works on them, by its name."""
        needed = min([self._done, *(window.start for window in self._open)])
        around = 2 * self.friction.reach + BLOCK_SLOTS + LAG_SLOTS
        return {
            "epoch_origin_ns": self.grid.origin_ns,
            "slots": SlotsState.of(self.ring, needed - around, self._done - around),
            "screen": ScreenState.of(self.screen),
            "effects": EffectsState.of(self.friction),
            "windows": WindowsState(
                done=self._done,
                next_start=self._next_start,
                last_end=self._last_end,
                open=[window.start for window in self._open],
                gathered=[GatheredState.of(window.accumulator.gathered()) for window in self._open],
            ),
        }

    def resume(self, checkpoint: Checkpoint) -> None:
        """Go on from the state of other windows of the same wheel, friction from the same source.

        Raises
        ------
        InputError
            If it does not fit the wheel.
        """
        slots, effects, windows = checkpoint.slots, checkpoint.effects, checkpoint.windows
        fits = (
            0 <= slots.end - slots.begin <= self.ring.capacity
            and slots.consistent
            and set(slots.values) == set(self.ring.channels)
            and len(effects.memories) == len(self.friction.memories)
            and slots.begin <= min([windows.done, *windows.open])
            and windows.done <= slots.end
            and len(windows.gathered) == len(windows.open)
        )
        if not fits:
            raise InputError("checkpoint", f"does not fit the wheel {self.wheel.name}")
        self.grid = SlotGrid(checkpoint.epoch_origin_ns, self.wheel.period_ns)
        slots.restore(self.ring)
        checkpoint.screen.restore(self.screen)
        effects.restore(self.friction)
        self._done, self._next_start, self._last_end = windows.done, windows.next_start, windows.last_end
        for start, gathered in zip(windows.open, windows.gathered, strict=True):
            accumulator = WindowAccumulator(self.wheel)
            accumulator.resume(gathered.gathered())
            self._open.append(_OpenWindow(start, accumulator))
        self._find_border()


def without_positions(carried: CarriedState) -> CarriedState:
    """Return the state without where the switching systems stand: the next window does not follow at once."""
    systems = tuple(system.model_copy(update={"configuration": None, "age": None}) for system in carried.fss)
    return carried.model_copy(update={"fss": systems})
