"""The monitor core of one wheel: samples in, events out. Pure: no clock, no network, no file.

    messages → sequencer → slot assignment → ring buffer → sensor validation → friction less known effects
    → open windows → diagnosis

Live monitor, replay and the diagnosis of tables all feed this one core, so that they agree by construction, and its
result does not depend on how the samples are cut into messages.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields
from typing import Literal, Self

import numpy as np

from rwa_monitor.changepoints.stage_results import Method
from rwa_monitor.diagnosis.model import Model
from rwa_monitor.errors import InputError
from rwa_monitor.monitor.checkpoint import Checkpoint, GridState, SequencerState, WaitingSample
from rwa_monitor.monitor.events import (
    ChannelMissing,
    EpochStarted,
    Event,
    StraySamples,
    WindowDiagnosed,
)
from rwa_monitor.monitor.ingest.sequencer import Batch, Counts, Sequencer
from rwa_monitor.monitor.ingest.slot_assignment import PIECE_SLOTS, Rows, SlotAssignment
from rwa_monitor.monitor.settings_check import SettingsCheck
from rwa_monitor.monitor.windows import Windows, without_positions
from rwa_monitor.samples import FloatArray, IntArray, Samples, SlotGrid
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.telemetry.friction import Source, motor_torque, source_of
from rwa_monitor.wheel.torque_balance import without_motor
from rwa_monitor.wheel.wheel import Wheel


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
        The state that earlier windows handed on; None for none.

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
        self.counts = Counts()
        self._windows = Windows(wheel, model, method, CarriedState.empty() if carried is None else carried, self.counts)
        limits, most_torque_Nm = wheel.limits, wheel.max_motor_torque_Nm
        self._sequencer = Sequencer(self.counts)
        self._assignment = SlotAssignment(wheel.period_ns, wheel.window.samples, limits, most_torque_Nm, self.counts)
        self._source: Source | Literal[""] = ""  # the channel that friction comes from; the first message decides
        self._reported_missing = False
        self._settings_check = SettingsCheck(wheel)
        self._waiting: Rows | None = None  # one sample that the next one judges

    @property
    def why_masked(self) -> dict[str, int]:
        """Why friction could not be derived from samples whose values are there, and of how many, in words."""
        friction = self._windows.friction
        return {
            "where the speed bends too sharply for friction to be derived": friction.at_corners,
            "with the current at its limit": friction.at_limit,
        }

    @property
    def carried(self) -> CarriedState:
        """The state that the windows so far hand to the next one."""
        return self._windows.carried

    @property
    def last_sample_ns(self) -> int | None:
        """Time of the latest sample that was taken into the wheel's grid; a wild time is none."""
        return self._assignment.last_ns

    # ---- in ---------------------------------------------------------------------------------------------------------

    def feed(self, samples: Samples, publisher: str = "", batch: int | None = None) -> list[Event]:
        """Take samples in any cut and return what happened, in order.

        Parameters
        ----------
        samples
            One message, or a whole table.
        publisher
            Who sent it; "" where it is not named.
        batch
            Its number, counted up by one by each publisher; None where it has none.

        Raises
        ------
        InputError
            If `check` would; nothing is taken then.
        """
        samples = without_motor(samples, self.wheel)
        if not self._source:
            self._source = source_of(samples, self.wheel)
            if self._source != self._windows.friction.source:
                self._windows.begin_source(self._source)
        ready, notes = self._sequencer.put(Batch(publisher, batch, samples), self._assignment.last_ns)
        events: list[Event] = list(notes)
        for message in ready:
            events += self._take(message)
        return events

    def finish(self) -> list[Event]:
        """Take what waits, close the open window as it is, and return what happened: nothing more will come."""
        ready, notes = self._sequencer.flush(self._assignment.last_ns)
        events: list[Event] = list(notes)
        for message in ready:
            events += self._take(message)
        if self._waiting is not None:
            events += self._place(self._waiting, last=True)
            self._waiting = None
        events += self._windows.end_epoch()
        self._assignment.end_epoch()
        return events

    @property
    def window_fill(self) -> float:
        """Share of the oldest open window that has passed, 0 … 1."""
        return self._windows.fill

    def check(self, samples: Samples) -> None:
        """Raise InputError if friction is neither given in the first message nor can be derived from it."""
        if not self._source:
            source_of(without_motor(samples, self.wheel), self.wheel)

    # ---- samples into slots -----------------------------------------------------------------------------------------

    def _take(self, message: Batch) -> list[Event]:
        samples, friction = message.samples, self._windows.friction
        torque = friction.torque(samples)
        clean = torque is not None and self._assignment.is_clean(samples)  # then there is nothing to look for
        events: list[Event] = self._settings_check.check(samples, clean=clean)
        if torque is None:
            torque = np.full(len(samples), np.nan)
            if not self._reported_missing:
                self._reported_missing = True
                events.append(ChannelMissing(self._source))
        values = {"speed_rad_s": samples.speed_rad_s, "torque_Nm": torque}
        for name in friction.optional:
            measured = motor_torque(samples, self.wheel) if name == "motor_torque_Nm" else getattr(samples, name)
            values[name] = np.full(len(samples), np.nan) if measured is None else measured
        if not clean:
            values = {name: np.where(np.isfinite(array), array, np.nan) for name, array in values.items()}
        rows = Rows(samples.time_ns, values)
        allowed = None if clean else self._assignment.reject_beyond_limits(samples)
        if allowed is not None:
            rows = rows[np.flatnonzero(allowed)]
        return events + self._place(rows, passed=message.passed)

    def _place(self, rows: Rows, *, passed: bool = False, last: bool = False) -> list[Event]:
        """Bring samples into their slots; one that the next sample must judge waits for it."""
        events: list[Event] = []
        if self._waiting is not None and not passed and not last and len(rows):
            rows, self._waiting = self._waiting.followed_by(rows), None
        good, windows = rows.good(), self._windows
        strays: list[int] = []
        start = 0
        while start < len(rows):
            piece = self._assignment.next_piece(
                rows.time_ns, good, start, windows.ring.is_filled, passed=passed, last=last
            )
            if piece.waits:
                self._waiting = rows[start : start + 1]
                break
            if piece.stray:
                strays.append(int(rows.time_ns[start]))
            if piece.epoch is not None:
                events += windows.end_epoch()
                windows.begin_epoch(piece.epoch)
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
        ring = self._windows.ring
        while ring.end < self._assignment.frontier:
            end = min(ring.end + PIECE_SLOTS, self._assignment.frontier)
            if slots.size and ring.end <= slots[0] and end == self._assignment.frontier:  # all at once
                ring.extend(end, slots, values)
            else:
                rows = slice(*np.searchsorted(slots, (ring.end, end)))
                ring.extend(end, slots[rows], {name: array[rows] for name, array in values.items()})
            events += self._windows.advance()
        return events

    # ---- checkpoints ------------------------------------------------------------------------------------------------

    def checkpoint(self) -> Checkpoint:
        """Return the whole state of the core; `resume` makes an equal core of it."""
        grid = self._assignment.grid
        return Checkpoint(
            source=self._source,
            said_missing=self._reported_missing,
            counts=asdict(self.counts),
            carried=self.carried,
            sequencer=SequencerState.of(self._sequencer),
            waiting=None if self._waiting is None else WaitingSample.of(self._waiting),
            grid=GridState(
                origin_ns=grid.origin_ns if grid else None,
                frontier=self._assignment.frontier,
                last_ns=self._assignment.last_ns,
            ),
            **self._windows.states(),
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
            core._windows.begin_source(checkpoint.source)
        core._reported_missing = checkpoint.said_missing
        unknown = set(checkpoint.counts) - {field.name for field in fields(core.counts)}
        if unknown:
            raise InputError("checkpoint", f"{min(unknown)[:40]!r} is nothing that is counted", "counts")
        for name, count in checkpoint.counts.items():  # the sequencer and the slot assignment count in the same place
            setattr(core.counts, name, count)
        checkpoint.sequencer.restore(core._sequencer)
        state, assignment = checkpoint.grid, core._assignment
        assignment.grid = None if state.origin_ns is None else SlotGrid(state.origin_ns, wheel.period_ns)
        assignment.frontier, assignment.last_ns = state.frontier, state.last_ns
        if checkpoint.waiting is not None:
            if set(checkpoint.waiting.values) != set(core._windows.ring.channels):
                raise InputError("checkpoint", f"does not fit the wheel {wheel.name}")
            core._waiting = checkpoint.waiting.rows()
        core._windows.resume(checkpoint)
        return core


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
    core = WheelCore(wheel, model, method=method, carried=None if carried is None else without_positions(carried))
    for event in (*core.feed(samples), *core.finish()):
        if isinstance(event, WindowDiagnosed):
            yield event
