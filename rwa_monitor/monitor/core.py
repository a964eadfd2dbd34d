"""The monitor core of one wheel: samples in, events out. Pure: no clock, no network, no file.

    messages → sequencer → slot assignment → ring buffer → sensor validation → friction less known effects
    → open windows → diagnosis

Live monitor, replay and the diagnosis of tables all use this core, so that they agree by construction, and its result
does not depend on how the samples are divided into messages.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar, Final, Literal, NamedTuple, Self

import numpy as np

from rwa_monitor import messages
from rwa_monitor.changepoints.evidence import ConfirmedCandidate, WindowAccumulator
from rwa_monitor.diagnosis.features import Features
from rwa_monitor.diagnosis.model import Model
from rwa_monitor.diagnosis.window import diagnose_window
from rwa_monitor.errors import InputError
from rwa_monitor.messages import Changepoints, Diagnosis, EncodedMessage, Message, Method, NotLive, ProvisionalJump
from rwa_monitor.monitor.checkpoint import Checkpoint, Slots
from rwa_monitor.monitor.ingest import PIECE_SLOTS, Batch, Counts, Rows, Sequencer, SlotAssignment, Trouble
from rwa_monitor.monitor.stored import MAX_WINDOWS, StoredTelemetry
from rwa_monitor.paper import method as paper
from rwa_monitor.samples import (
    NANOSECONDS_PER_SECOND,
    SECONDS_PER_HOUR,
    FloatArray,
    IntArray,
    Samples,
    SlotGrid,
    Timeliness,
)
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.telemetry.slots import (
    BLOCK_SLOTS,
    LAG_SLOTS,
    TORQUE,
    Channel,
    Fault,
    FrictionSource,
    RingBuffer,
    SensorValidation,
    speed_limit,
)
from rwa_monitor.wheel.torque_balance import Source, motor_torque, source_of, without_motor
from rwa_monitor.wheel.wheel import Wheel
from rwa_monitor.words import time_text


class WheelCore:
    """The monitor of one wheel.

    Parameters
    ----------
    wheel
        Its constants.
    model
        The learned classifiers of nominal and anomalous friction; None leaves anomalies undecided.
    method
        "joint" or "paper".
    carried
        The state that earlier windows handed on; None for none.
    sequencer
        Sequencer of a checkpoint, with the messages that wait; None for a new one.

    Attributes
    ----------
    counts
        What became of every sample so far.
    assignment
        Assigns samples to slots.
    windows
        The slots, and the windows over them.

    Raises
    ------
    InputError
        If the wheel's windows overlap more than 64-fold, or its effects cannot be built.
    """

    def __init__(
        self,
        wheel: Wheel,
        model: Model | None,
        *,
        method: Method = "joint",
        carried: CarriedState | None = None,
        sequencer: Sequencer | None = None,
    ) -> None:
        self.wheel = wheel
        self.model = model
        self.method = method
        self._sequencer = sequencer or Sequencer()
        self.counts = self._sequencer.counts
        self.windows = Windows(wheel, model, method, CarriedState.empty() if carried is None else carried, self.counts)
        self.assignment = SlotAssignment(wheel, self.counts)
        self._source: Source | Literal[""] = ""  # the channel friction is taken from; set by the first message
        self._reported_missing = False
        self._settings_check = SettingsCheck(wheel)
        self._stored: StoredTelemetry | None = None  # of a wheel whose publishers distinguish live and stored samples

    @property
    def why_masked(self) -> dict[str, int]:
        """Number of complete samples from which friction could not be derived, by reason in words."""
        friction = self.windows.friction
        return {
            "where the speed bends too sharply for friction to be derived": friction.at_corners,
            "with the current at its limit or in its dead zone": friction.at_limit,
        }

    @property
    def carried(self) -> CarriedState:
        """The state that the windows so far hand to the next one."""
        return self.windows.carried

    # ---- in ---------------------------------------------------------------------------------------------------------

    def feed(
        self,
        samples: Samples,
        publisher: str = "",
        batch: int | None = None,
        data: Timeliness | None = None,
    ) -> list[Event]:
        """Process samples, divided into messages in any way, and return the events in order.

        Parameters
        ----------
        samples
            One message, or a whole table.
        publisher
            Who sent it; "" where it is not named.
        batch
            Its number, counted up by one by each publisher; None where it has none.
        data
            "stored" for samples that were kept before they were sent: they may arrive in any order, late by hours, and
            do not enter the live windows. "live" for the others of a publisher that distinguishes them; "replay" is
            treated the same. None where the publisher does not distinguish.

        Raises
        ------
        InputError
            If `check` would; no sample is taken then.
        """
        samples = without_motor(samples, self.wheel)
        if not self._source:
            self._source = source_of(samples, self.wheel)
            if self._source != self.windows.friction.source:
                self.windows.begin_source(self._source)
        if data is not None and self._stored is None and len(samples):
            grid, first_ns = self.assignment.grid, int(samples.time_ns[0])
            period_ns, slots = self.wheel.period_ns, self.wheel.window.samples
            # The windows of live samples, which stored samples then complete; else a phase that does not depend on
            # which sample arrives first.
            step_ns = period_ns if grid is None and data == "stored" else period_ns * slots
            self._stored = StoredTelemetry(period_ns, slots, (grid.origin_ns if grid else first_ns) % step_ns)
            if self.windows.carried_ns is not None:
                self._stored.note(self.windows.carried_ns, without_positions(self.carried))
        if data == "stored":
            return self._take_stored(samples)
        events = self._take_all(self._sequencer.put(Batch(publisher, batch, samples), self.assignment.last_ns))
        if self._stored is not None:
            for event in events:
                if isinstance(event, WindowDiagnosed):
                    self._stored.note(event.diagnosis.window_end_ns, event.carried)
        return events + self._diagnose_stored()

    def finish(self) -> list[Event]:
        """End the telemetry: process what waits, close the open window as it is, and return the events."""
        events = self._take_all(self._sequencer.flush(self.assignment.last_ns))
        waited, self.assignment.waiting = self.assignment.waiting, None
        if waited is not None:
            events += self._place(waited, last=True)
        events += self.windows.end_epoch()
        self.assignment.grid = None  # the next sample begins a new epoch
        return events + self._diagnose_stored(to_the_end=True)

    def check(self, samples: Samples) -> None:
        """Raise InputError if friction is neither given in the first message nor can be derived from it."""
        if not self._source:
            source_of(without_motor(samples, self.wheel), self.wheel)

    # ---- samples into slots -----------------------------------------------------------------------------------------

    def _take_all(self, ready: Iterable[Batch | Trouble]) -> list[Event]:
        events: list[Event] = []
        for one in ready:
            if isinstance(one, Trouble):
                events.append(one)
                continue
            rows, found = self._rows(one.samples)
            if self._stored is not None:
                self._stored.add(rows, None)
            events += found + self._place(rows, passed=one.passed)
        return events

    def _rows(self, samples: Samples) -> tuple[Rows, list[Event]]:
        """Return the samples within the wheel's limits, and reports on settings that do not fit them."""
        friction = self.windows.friction
        torque = friction.torque(samples)
        allowed = self.assignment.reject_beyond_limits(samples)
        beyond = 0 if allowed is None else int(np.count_nonzero(~allowed))
        events: list[Event] = self._settings_check.check(samples.time_ns, beyond)
        if torque is None:
            torque = np.full(len(samples), np.nan)
            if not self._reported_missing:
                self._reported_missing = True
                text = f"samples without {self._source}, which this wheel's friction comes from: they are masked"
                events.append(Trouble("channel missing", text))
        values = {"speed_rad_s": samples.speed_rad_s, "torque_Nm": torque}
        for name in friction.optional:
            measured = motor_torque(samples, self.wheel) if name == "motor_torque_Nm" else getattr(samples, name)
            values[name] = np.full(len(samples), np.nan) if measured is None else measured
        time_ns = samples.time_ns
        if allowed is not None:
            time_ns = time_ns[allowed]
            values = {name: np.where(np.isfinite(array), array, np.nan)[allowed] for name, array in values.items()}
        return Rows(time_ns, values), events

    def _place(self, rows: Rows, *, passed: bool = False, last: bool = False) -> list[Event]:
        """Assign samples to slots, and add the slots to the windows."""
        events: list[Event] = []
        windows = self.windows
        for placed in self.assignment.place(rows, windows.ring, passed=passed, last=last):
            if isinstance(placed, Trouble):
                events.append(placed)
            elif isinstance(placed, SlotGrid):
                events += windows.end_epoch()
                windows.begin_epoch(placed)
            else:
                events += windows.write(int(placed.slots[-1]) + 1, placed.slots, placed.values)
        return events

    # ---- stored samples -------------------------------------------------------------------------------------------

    def _take_stored(self, samples: Samples) -> list[Event]:
        assert self._stored is not None
        self.counts.received += len(samples)
        self.counts.queued += len(samples)
        rows, events = self._rows(samples)
        if self._stored.add(rows, self.counts):
            hours = self._stored.kept * self.wheel.window.samples * self.wheel.sample_period_s / SECONDS_PER_HOUR
            text = f"stored samples older than the latest {hours:.1f} hours: they are recorded, and not diagnosed"
            events.append(Trouble("stored samples late", text))
        return events + self._diagnose_stored()

    def _diagnose_stored(self, *, to_the_end: bool = False) -> list[Event]:
        """Diagnose the windows of stored samples that are due; later live windows continue from their state."""
        stored, events = self._stored, list[Event]()
        if stored is None:
            return events
        if to_the_end and stored.waiting is not None:
            rows, stored.waiting, stored.newest = stored.waiting, None, None
            stored.add(rows, self.counts)
        for grid, window, before, follows in stored.due(to_the_end=to_the_end):
            carried = before if follows else without_positions(before)
            windows = Windows(self.wheel, self.model, self.method, carried, Counts())
            windows.begin_source(self._source or windows.friction.source)
            windows.begin_epoch(grid)
            slots, happened = window.slots(), list[Event]()
            for end in (*range(PIECE_SLOTS, self.wheel.window.samples, PIECE_SLOTS), self.wheel.window.samples):
                piece = slots[slice(*np.searchsorted(slots, (windows.ring.end, end)))]
                happened += windows.write(end, piece, {name: array[piece] for name, array in window.values.items()})
            happened += windows.end_epoch()
            (diagnosed,) = [event for event in happened if isinstance(event, WindowDiagnosed)]
            stored_one = diagnosed.diagnosis.model_copy(update={"data": "stored"})
            events.append(diagnosed._replace(diagnosis=stored_one))
            self.windows.continue_from(diagnosed)
            stored.note(stored_one.window_end_ns, diagnosed.carried)
        return events

    # ---- checkpoints ------------------------------------------------------------------------------------------------

    def checkpoint(self) -> bytes:
        """Return the JSON of a `Checkpoint`, from which `resume` makes an equal core; equal cores give equal bytes."""
        grid = self.assignment.grid
        checkpoint = Checkpoint(
            source=self._source,
            reported_missing=self._reported_missing,
            carried=self.carried,
            sequencer=self._sequencer,
            waiting=self.assignment.waiting,
            origin_ns=grid.origin_ns if grid else None,
            frontier=self.windows.ring.end,
            last_ns=self.assignment.last_ns,
            stored=self._stored,
            **self.windows.state(),
        )
        # pydantic's writer suits, as every number is finite; json.dumps takes thirteen times as long.
        return checkpoint.model_dump_json().encode()

    @classmethod
    def resume(cls, checkpoint: Checkpoint, wheel: Wheel, model: Model | None) -> Self:
        """Return a core that continues from a checkpoint of a core with the same wheel and model.

        Raises
        ------
        InputError
            As the constructor, or if the checkpoint does not fit the wheel.
        """
        core = cls(wheel, model, carried=checkpoint.carried, sequencer=checkpoint.sequencer)
        if checkpoint.source:
            core._source = checkpoint.source
            core.windows.begin_source(checkpoint.source)
        core._reported_missing = checkpoint.reported_missing
        origin_ns, assignment = checkpoint.origin_ns, core.assignment
        assignment.grid = None if origin_ns is None else SlotGrid(origin_ns, wheel.period_ns)
        assignment.last_ns, assignment.waiting = checkpoint.last_ns, checkpoint.waiting
        core.windows.resume(checkpoint)
        core._stored = checkpoint.stored
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
        One for each window, the last one perhaps partial; its `carried` is the initial state for a following table.

    Raises
    ------
    InputError
        If friction is neither given nor can be derived.
    """
    core = WheelCore(wheel, model, method=method, carried=None if carried is None else without_positions(carried))
    for event in (*core.feed(samples), *core.finish()):
        if isinstance(event, WindowDiagnosed):
            yield event


# ---- from slots to the diagnoses of windows --------------------------------------------------------------------------
# Slots are processed in blocks that end at fixed slots of the grid, at most a few slots behind the newest.


class _OpenWindow(NamedTuple):
    """A window that is being filled: its first slot and its accumulated evidence."""

    start: int
    accumulator: WindowAccumulator


class Windows:
    """The slots of one wheel, the windows that are open over them, and the state carried over from the closed ones.

    Parameters
    ----------
    wheel, model, method, carried
        As for `core.WheelCore`.
    counts
        Where to count slots that were accepted as good and are masked later.

    Attributes
    ----------
    carried, carried_ns
        The state that the windows closed so far hand to the next one, and the end of the last of them, None for none.
    ring, screen, friction
        Ring buffer, sensor validation and derivation of friction, made anew for each source of friction.
    grid
        The slot grid of the current epoch.

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
        self.carried_ns: int | None = None
        self.counts = counts
        self.grid = SlotGrid(0, wheel.period_ns)
        self._samples, self._hop = wheel.window.samples, wheel.window.hop_slots
        # A smaller hop would cost memory without more information.
        if self._samples > MAX_WINDOWS * self._hop:
            raise InputError(
                f"wheel {wheel.name}",
                f"is below 1/{MAX_WINDOWS} of window.samples ({self._samples})",
                "window.hop",
            )
        self.begin_source("friction_torque_Nm")

    @property
    def fill(self) -> float:
        """Share of the oldest open window that has passed, 0 … 1."""
        return min((self._done - self._open[0].start) / self._samples, 1.0) if self._open else 0.0

    # ---- beginnings and ends ----------------------------------------------------------------------------------------

    def begin_source(self, source: Source) -> None:
        """Take friction from a source, and start with empty slots."""
        self.friction = FrictionSource(self.wheel, source)
        # The ring buffer holds the values of a piece and its surroundings only: open windows keep their own.
        around = PIECE_SLOTS + LAG_SLOTS + 3 * (self.friction.reach + BLOCK_SLOTS)
        self.ring = RingBuffer(self._samples + around, self.friction.optional, values_capacity=around)
        self._begin_slots()

    def _begin_slots(self) -> None:
        self._done = 0  # slots whose friction has gone into the open windows
        self._next_start = 0  # first slot of the next window to open
        self._last_end = 0  # first slot after the last window that was closed
        self._open: list[_OpenWindow] = []
        # Derived friction is validated after its derivation: motor torque may be much larger than friction.
        torque_limit_Nm = float("inf") if self.friction.derived else self.friction.limit_Nm
        self.screen = SensorValidation(speed_limit(self.wheel), torque_limit_Nm)
        self.friction.reset()

    def begin_epoch(self, grid: SlotGrid) -> None:
        """Begin again with slot 0 of a new grid."""
        self.grid = grid
        self.ring.clear()
        self._begin_slots()

    def end_epoch(self) -> list[Event]:
        """Close the oldest open window as it is; if windows overlap, it has all slots that no closed window has."""
        events = self.advance(to_the_end=True)
        if self._open and self._done > max(self._last_end, self._open[0].start):
            events.append(self._close(self._open[0]))
        self._open.clear()
        self.carried = without_positions(self.carried)
        return events

    def continue_from(self, diagnosed: WindowDiagnosed) -> None:
        """Use the state after a window for the next one to close, if it lies between the last closed one and that."""
        next_ns = self.grid.time_of(self._open[0].start if self._open else self._done)
        end_ns = diagnosed.diagnosis.window_end_ns
        follows = self.carried_ns is None or end_ns >= self.carried_ns
        if follows and (not self.ring.end or end_ns <= next_ns):
            self.carried, self.carried_ns = without_positions(diagnosed.carried), end_ns

    # ---- slots into windows -----------------------------------------------------------------------------------------

    def write(self, end: int, slots: IntArray, values: Mapping[str, FloatArray]) -> list[Event]:
        """Write the slots up to `end`, at most `PIECE_SLOTS` and also those without a sample, to the ring buffer."""
        self.ring.extend(end, slots, values)
        return self.advance()

    def advance(self, *, to_the_end: bool = False) -> list[Event]:
        """Process all blocks that are complete, including the stencil around them."""
        if to_the_end:
            seen = ready = self.ring.end
        else:
            seen = self.ring.end - 1  # the last slot only serves to validate those before it
            ready = max(seen - LAG_SLOTS, self._border_before(seen)) - self.friction.reach
            next_block = (self._done // BLOCK_SLOTS + 1) * BLOCK_SLOTS
            if self._done != self._next_start and ready < min(next_block, self._border):
                return []  # no complete block, and validating many slots takes no longer than validating one
        masked, faults = self.screen.run(self.ring, seen, self._border_before)
        events = self._mask(masked, faults)
        while True:
            end = self._open[0].start + self._samples if self._open else self._done + 1
            # A full window is closed when a sample beyond it, and beyond the stencil, has arrived.
            if end <= self._done and (to_the_end or end + self.friction.reach < self.ring.end):
                events.append(self._close(self._open.pop(0)))
            if self._done == self._next_start and self._done < self.ring.end:
                self._open.append(_OpenWindow(self._done, WindowAccumulator(self.wheel)))
                self._next_start += self._hop
            border = self._border
            stop = min(border, ready)
            if stop < border and not to_the_end:
                stop = stop // BLOCK_SLOTS * BLOCK_SLOTS
            if stop <= self._done:
                return events
            events += self._process_slots(stop)
            if stop < border:
                return events

    @property
    def _border(self) -> int:
        """Where the next window begins, or the oldest ends."""
        return min(self._next_start, self._open[0].start + self._samples) if self._open else self._next_start

    def _border_before(self, slot: int) -> int:
        """Return the last slot up to `slot` at which a window closed; 0 before the first."""
        first = self._samples + self.friction.reach
        return first + (slot - first) // self._hop * self._hop if slot >= first else 0

    def _process_slots(self, stop: int) -> list[Event]:
        """Add the slots [done, stop) to all open windows."""
        start, self._done = self._done, stop
        speed, torque = self.ring.read_required(start, stop)
        friction, masked, faults, viscous = self.friction.friction(self.ring, start, stop, torque)
        there = np.ones(stop - start, dtype=np.bool_)  # missing values are NaN
        confirmed = [window.accumulator.append(speed, friction, there, viscous) for window in self._open]
        events = self._mask(masked, faults)
        if not confirmed or not confirmed[0]:
            return events
        # Where windows overlap, the first one to hold a slot reports it.
        first = self._open[0].start
        return events + [
            self._provisional(first, jump) for jump in confirmed[0] if first + jump.index >= self._last_end
        ]

    def _mask(self, masked: int, faults: list[Fault]) -> list[Event]:
        """Count slots that were accepted as good and are masked now, and return the reports of their faults."""
        self.counts.used -= masked
        self.counts.masked += masked
        return [self._fault(fault) for fault in faults]

    def _fault(self, fault: Fault) -> Trouble:
        channel = self.friction.source if fault.channel == TORQUE else fault.channel
        kind = "repeats one value, as a sensor that hangs" if fault.hangs else "stands out from the samples around it"
        return Trouble(f"{channel} {kind}", f"{channel} {kind}, at {time_text(self.grid.time_of(fault.slot))}: masked")

    # ---- windows into diagnoses -------------------------------------------------------------------------------------

    def _provisional(self, window_start: int, candidate: ConfirmedCandidate) -> Changepoints:
        jump = ProvisionalJump(
            index=candidate.index,
            time_ns=self.grid.time_of(window_start + candidate.index),
            jump_Nm=candidate.jump * self.wheel.torque_unit_Nm,
            std_Nm=candidate.std * self.wheel.torque_unit_Nm,
            confidence=candidate.confidence,
        )
        start_ns = self.grid.time_of(window_start)
        return Changepoints(spacecraft="", wheel="", window_start_ns=start_ns, changepoints=[jump])

    def _close(self, window: _OpenWindow) -> WindowDiagnosed:
        """Diagnose a window, full or not."""
        evidence = window.accumulator.close()
        diagnose = paper.diagnose_window if self.method == "paper" else diagnose_window
        start_ns = self.grid.time_of(window.start)
        diagnosis, features, carried = diagnose(evidence, self.wheel, self.model, self.carried, start_ns)
        self.carried = without_positions(carried) if diagnosis.partial else carried
        self._last_end = window.start + evidence.slots
        self.carried_ns = diagnosis.window_end_ns
        return WindowDiagnosed(diagnosis, features, self.carried)

    # ---- checkpoints ------------------------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """Return the fields of a checkpoint, by name, that hold the slots still needed and the state of processing."""
        needed = min([self._done, *(window.start for window in self._open)])
        around = 2 * self.friction.reach + BLOCK_SLOTS + LAG_SLOTS
        channels = (self.screen.speed, self.screen.torque, self.friction.channel)
        return {
            "epoch_origin_ns": self.grid.origin_ns,
            "slots": Slots.of(self.ring, needed - around, self._done - around),
            "screened": self.screen.done,
            "channels": tuple(channel.state.copy() for channel in channels),
            "angle_rad": self.friction.angle_rad,
            "last_speed_rad_s": self.friction.last_speed_rad_s,
            "memories": self.friction.memories,
            "done": self._done,
            "next_start": self._next_start,
            "last_end": self._last_end,
            "carried_ns": self.carried_ns,
            "open": [(window.start, window.accumulator.gathered()) for window in self._open],
        }

    def resume(self, checkpoint: Checkpoint) -> None:
        """Continue from the state of other windows of the same wheel with the same source of friction.

        Raises
        ------
        InputError
            If the checkpoint does not fit the wheel.
        """
        stored, window = checkpoint.stored, self.wheel.window.samples
        fits = stored is None or stored.fits(self.wheel.period_ns, window, self.ring.channels)
        if not fits or not checkpoint.fits(self.ring, len(self.friction.memories)):
            raise InputError("checkpoint", f"does not fit the wheel {self.wheel.name}")
        self.grid = SlotGrid(checkpoint.epoch_origin_ns, self.wheel.period_ns)
        checkpoint.slots.restore(self.ring)
        self.screen.done = checkpoint.screened
        self.screen.speed, self.screen.torque, self.friction.channel = map(Channel, checkpoint.channels)
        self.friction.angle_rad = checkpoint.angle_rad
        self.friction.last_speed_rad_s = checkpoint.last_speed_rad_s
        self.friction.memories = list(checkpoint.memories)
        self._done, self._next_start, self._last_end = checkpoint.done, checkpoint.next_start, checkpoint.last_end
        self.carried_ns = checkpoint.carried_ns
        for start, gathered in checkpoint.open:
            accumulator = WindowAccumulator(self.wheel)
            try:
                accumulator.resume(gathered)
            except ValueError as error:
                raise InputError("checkpoint", f"does not fit the wheel {self.wheel.name}: {error}") from error
            self._open.append(_OpenWindow(start, accumulator))


def without_positions(carried: CarriedState) -> CarriedState:
    """Return the state without configuration and age of the switching systems: no window follows at once."""
    systems = tuple(system.model_copy(update={"configuration": None, "age": None}) for system in carried.fss)
    return carried.model_copy(update={"fss": systems})


# ---- whether samples fit the wheel file at all -----------------------------------------------------------------------


ENOUGH: Final = 64  # time steps to estimate the period; samples beyond a limit that are more than single outliers
PERIOD_DIFFERS: Final = 1.25  # ratio of the periods: jitter and single missing samples change the median by less
SHARE_BEYOND: Final = 0.1  # of all samples


class SettingsCheck:
    """Checks whether a wheel's samples fit its file as they arrive: the sample period, and limits in the right unit.

    With either mistake the diagnoses look like any other, but rest on half the samples or fewer; each is reported once.

    Parameters
    ----------
    wheel
        The wheel whose constants the samples should fit.
    """

    def __init__(self, wheel: Wheel) -> None:
        self._wheel = wheel
        self._times: IntArray | None = np.zeros(0, dtype=np.int64)  # of the first samples; None after the check
        self._seen = self._beyond = 0
        self._limits_reported = False

    def check(self, time_ns: IntArray, beyond: int) -> list[Event]:
        """Take the next samples into account, and return a report for each mistake found for the first time.

        Parameters
        ----------
        time_ns
            int64 (n,): their times.
        beyond
            How many of them are beyond the wheel's limits.
        """
        events = [] if self._times is None else self._check_period(self._times, time_ns)
        self._seen += time_ns.size
        self._beyond += beyond
        if beyond and not self._limits_reported and self._beyond >= max(ENOUGH, SHARE_BEYOND * self._seen):
            self._limits_reported = True
            text = f"{self._beyond} of {self._seen} samples are beyond the wheel's limits and rejected"
            events.append(Trouble("limits", f"{text}: is the speed in rpm, or is the wheel file another wheel's?"))
        return events

    def _check_period(self, before_ns: IntArray, time_ns: IntArray) -> list[Event]:
        self._times = np.concatenate([before_ns, time_ns[: ENOUGH + 1 - before_ns.size]])
        if self._times.size <= ENOUGH:
            return []
        steps = np.diff(self._times)
        self._times = None
        steps = steps[steps > 0] / NANOSECONDS_PER_SECOND  # repeated messages and clock steps back do not count
        period_s, expected_s = float(np.median(steps)) if steps.size else 0.0, self._wheel.sample_period_s
        if steps.size < ENOUGH // 2 or expected_s / PERIOD_DIFFERS <= period_s <= expected_s * PERIOD_DIFFERS:
            return []
        question = f"is sample_period_s = {expected_s:.6g} of the wheel file right?"
        return [Trouble("sample period", f"{question} The samples come every {period_s:.3g} s")]


# ---- events and the messages for them, common to live monitor and replay ---------------------------------------------


class WindowDiagnosed(NamedTuple):
    """A window was closed and diagnosed.

    Attributes
    ----------
    diagnosis
        Of the window, without spacecraft, wheel and file.
    features
        Input of the classifiers, for training; they do not leave the program.
    carried
        The wheel's state after it.
    """

    diagnosis: Diagnosis
    features: Features
    carried: CarriedState

    def message(self, spacecraft: str, wheel: str, source: str | None = None) -> Diagnosis:
        """Return the diagnosis as a message; for a table, `spacecraft` is "" and `source` its file."""
        return self.diagnosis.model_copy(update={"spacecraft": spacecraft, "wheel": wheel, "source": source})


# A Changepoints event is one jump, as soon as it is confirmed; as in a diagnosis, the wheel is not named yet.
Event = Changepoints | WindowDiagnosed | Trouble


class Carried(Message):
    """The state that a window hands to the next one, and its hash; recorded with the diagnosis, not published."""

    kind: ClassVar[str] = "carried"

    window_end_ns: int
    sha256: str
    state: dict[str, Any]


def outputs_of(
    events: Iterable[Event], spacecraft: str, wheel: str, data: NotLive | None = None
) -> list[EncodedMessage]:
    """Return the messages for events of a wheel, in order; all but `Carried` are published.

    The messages of a replay differ from those of the live telemetry by their keys only. `data` states the timeliness of
    samples that are not live: old by the clock when they arrived, or a replay. Only the health reports it.
    """
    outputs: list[EncodedMessage] = []
    name = wheel.removesuffix(messages.REPLAY)
    for event in events:
        if isinstance(event, Changepoints):
            found = event.model_copy(update={"spacecraft": spacecraft, "wheel": name})
            outputs.append(found.encoded(spacecraft, wheel, found.changepoints[0].time_ns))
        elif isinstance(event, WindowDiagnosed):
            diagnosis, end_ns = event.message(spacecraft, name), event.diagnosis.window_end_ns
            state = event.carried.model_dump(mode="json")
            carried = Carried(window_end_ns=end_ns, sha256=event.carried.sha256(), state=state)
            of_window = (diagnosis, carried, messages.health_message(diagnosis, data))
            outputs += [message.encoded(spacecraft, wheel, end_ns) for message in of_window]
    return outputs
