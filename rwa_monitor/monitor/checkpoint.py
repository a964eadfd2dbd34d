"""A checkpoint: the whole state of a wheel's monitor core, as JSON, from which another core can continue.

Every recording begins with one checkpoint of each wheel: a recording alone is enough to replay it, and after a crash
the last recording is enough to continue. Floats are written in full, so that a resumed core gives the same bits. Arrays
are written in their binary form (see `samples.FloatArray`): decimal digits would take four times the work.
"""

from typing import ClassVar, Final, Literal, Self

import numpy as np

from rwa_monitor.changepoints.evidence import Gathered
from rwa_monitor.messages import ClockNs, Count, Slot
from rwa_monitor.monitor.ingest import Rows, Sequencer, fits
from rwa_monitor.monitor.stored import StoredTelemetry
from rwa_monitor.samples import MAX_TIME_NS, MIN_TIME_NS, BoolArray, FloatArray
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.telemetry.slots import Channel, RingBuffer
from rwa_monitor.wheel.file_content import Hashed, Strict
from rwa_monitor.wheel.torque_balance import Source

MAX_CHECKPOINT_BYTES: Final = 256 * 2**20  # 8 overlapping windows of 80,000 slots are some 30 MB


class Slots(Strict):
    """The slots of the ring buffer that are still needed, and the values of the last of them.

    Attributes
    ----------
    begin
        The first slot.
    filled
        Which slots have a sample, as run lengths: missing, filled, missing, …
    values
        float64 (n,) of each channel, those of the last n slots.
    """

    begin: Slot
    filled: list[Count]
    values: dict[str, FloatArray]

    @classmethod
    def of(cls, ring: RingBuffer, begin: int, values_begin: int) -> Self:
        """Keep the slots from `begin` on, and the values from `values_begin` on."""
        begin, values_begin = max(begin, ring.begin), max(values_begin, ring.values_begin)
        return cls(
            begin=begin,
            filled=_run_lengths(ring.is_filled(np.arange(begin, ring.end, dtype=np.int64))),
            values={name: ring.read(name, values_begin, ring.end).copy() for name in ring.channels},
        )

    @property
    def end(self) -> int:
        """The slot after the last one kept."""
        return self.begin + sum(self.filled)

    def fits(self, ring: RingBuffer) -> bool:
        """Return whether a ring buffer could have held these slots."""
        slots, kept = sum(self.filled), max((values.size for values in self.values.values()), default=0)
        return kept <= slots <= ring.capacity and fits(self.values, kept, ring.channels)

    def restore(self, ring: RingBuffer) -> None:
        """Put the slots into a ring buffer that they fit."""
        ring.restore(self.begin, np.repeat(np.arange(len(self.filled)) % 2 == 1, self.filled), self.values)


class Checkpoint(Hashed):
    """The whole state of a `core.WheelCore` except its wheel and its model.

    Attributes
    ----------
    source, reported_missing
        The channel that friction is taken from, and whether its absence was reported.
    carried
        The state that earlier windows handed on.
    sequencer, waiting
        The messages and the one sample that wait, and the counts of all samples.
    origin_ns, frontier, last_ns
        State of the slot assignment; `origin_ns` is None before the first sample of an epoch.
    epoch_origin_ns, slots, screened, channels
        The ring buffer, the first slot not validated yet, and the state of the validation of speed, torque and derived
        friction.
    angle_rad, last_speed_rad_s, memories
        State of the wheel's effects after the slots so far.
    done, next_start, last_end, open
        The slots processed, the first slot of the next window, the end of the last closed window, and of each open
        window its first slot and accumulated evidence.
    carried_ns, stored
        End of the window that `carried` is from, and the stored telemetry of a wheel that has some.
    """

    what: ClassVar[str] = "checkpoint"
    limit: ClassVar[int] = MAX_CHECKPOINT_BYTES

    version: Literal[3] = 3
    source: Source | Literal[""]
    reported_missing: bool
    carried: CarriedState
    sequencer: Sequencer
    waiting: Rows | None
    origin_ns: ClockNs | None
    frontier: Slot
    last_ns: ClockNs | None
    epoch_origin_ns: ClockNs
    slots: Slots
    screened: Slot
    channels: tuple[FloatArray, FloatArray, FloatArray]
    angle_rad: float
    last_speed_rad_s: float
    memories: list[FloatArray | None]
    done: Slot
    next_start: Slot
    last_end: Slot
    open: list[tuple[Slot, Gathered]]
    carried_ns: ClockNs | None = None
    stored: StoredTelemetry | None = None

    def fits(self, ring: RingBuffer, memories: int) -> bool:
        """Return whether the checkpoint fits a core with this ring buffer and number of effect memories."""
        waiting = self.waiting
        return (
            self.slots.fits(ring)
            and len(self.memories) == memories
            and self.slots.begin <= min([self.done, *(start for start, _ in self.open)])
            and self.done <= self.slots.end
            and all(state.shape == Channel().state.shape for state in self.channels)
            and not any(
                np.isinf(values).any()
                for _, gathered in self.open
                for values in (gathered.x, gathered.z, *(gathered.heat or ()))
            )
            and (
                waiting is None
                or (
                    len(waiting) == 1
                    and MIN_TIME_NS <= waiting.time_ns[0] <= MAX_TIME_NS
                    and fits(waiting.values, 1, ring.channels)
                )
            )
        )


def _run_lengths(flags: BoolArray) -> list[int]:
    """Return the lengths of alternating runs of False and True, beginning with False (perhaps of length 0)."""
    borders = np.flatnonzero(np.diff(flags, prepend=False))
    lengths: list[int] = np.diff(np.concatenate(([0], borders, [flags.size]))).tolist()
    return lengths if flags.size else []
