"""A checkpoint: the whole state of a wheel's monitor core, as JSON, so that another one can go on from there.

Every recording begins with one checkpoint for each wheel: a recording alone is enough to replay it, and after a crash
the last one is enough to go on. Floats are written in full; a core that was resumed gives the same bits. The samples of
open windows, nearly all of a checkpoint, are written as they lie in memory, in base64: their digits would take four
times the work.
"""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Sequence
from typing import Annotated, Final, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PlainSerializer, PlainValidator, ValidationError

from rwa_monitor.changepoints.evidence import Gathered
from rwa_monitor.errors import InputError
from rwa_monitor.messages import ClockNs, Count, SamplesMessage, Slot, samples_json
from rwa_monitor.monitor.ingest.sequencer import Batch, Sequencer
from rwa_monitor.monitor.ingest.slot_assignment import Rows
from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.telemetry.friction import FrictionSource
from rwa_monitor.telemetry.ring_buffer import RingBuffer
from rwa_monitor.telemetry.sensor_validation import MEMORY, Channel, SensorValidation
from rwa_monitor.wheel.torque_balance import Source

CHECKPOINT_VERSION: Final = 2
MAX_CHECKPOINT_BYTES: Final = 256 * 2**20  # 8 overlapping windows of 80,000 slots are some 30 MB


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class HeldBatch(_Part):
    """A message that waits for others."""

    number: Slot | None
    message: SamplesMessage

    @classmethod
    def of(cls, batch: Batch) -> Self:
        """Keep a message of the sequencer."""
        payload = samples_json(batch.samples, batch.publisher, batch.number or 0)
        return cls(number=batch.number, message=SamplesMessage.parse(payload, "checkpoint"))

    def batch(self) -> Batch:
        """Return the message of the sequencer."""
        return Batch(self.message.publisher, self.number, self.message.samples())


# What a sequencer's state holds as the sequencer does.
_SEQUENCE: Final = ("current", "expected", "takeover_uncertain", "largest", "replaced", "latest_ns")


class SequencerState(_Part):
    """State of `sequencer.Sequencer`; in the file a takeover is called a challenge."""

    model_config = ConfigDict(populate_by_name=True)

    current: str | None
    expected: Slot | None
    held: list[HeldBatch]
    skipped: list[Slot]
    takeover: list[HeldBatch] = Field(alias="challenge")
    takeover_uncertain: bool = Field(alias="challenge_doubtful")
    largest: Slot
    replaced: list[str]
    latest_ns: int | None

    @classmethod
    def of(cls, sequencer: Sequencer) -> Self:
        """Keep what waits in a sequencer, and what it has counted to."""
        return cls(
            held=[HeldBatch.of(batch) for batch in sequencer.held.values()],
            skipped=list(sequencer.skipped),
            takeover=[HeldBatch.of(batch) for batch in sequencer.takeover],
            **{name: getattr(sequencer, name) for name in _SEQUENCE},
        )

    def restore(self, sequencer: Sequencer) -> None:
        """Let a new sequencer go on from here."""
        for name in _SEQUENCE:
            setattr(sequencer, name, getattr(self, name))
        sequencer.held = {held.number: held.batch() for held in self.held if held.number is not None}
        sequencer.skipped = dict.fromkeys(self.skipped)
        sequencer.takeover = [held.batch() for held in self.takeover]


class GridState(_Part):
    """Where the slot grid stands; `origin_ns` is None before the first sample of an epoch."""

    origin_ns: ClockNs | None
    frontier: Slot
    last_ns: ClockNs | None


class SlotsState(_Part):
    """The slots [begin, end) of the ring buffer that are still needed, and the values of the last of them.

    Null in `values` stands for NaN.
    """

    begin: Slot
    end: Slot
    filled: list[Count]  # slots that a sample came for, as lengths of runs: missing, filled, missing, …
    values: dict[str, list[float | None]]

    @classmethod
    def of(cls, ring: RingBuffer, begin: int, values_begin: int) -> Self:
        """Keep the slots from `begin` on, and the values from `values_begin` on."""
        begin, values_begin = max(begin, ring.begin), max(values_begin, ring.values_begin)
        slots = np.arange(begin, ring.end, dtype=np.int64)
        values = {name: _with_null(ring.read(name, values_begin, ring.end)) for name in ring.channels}
        return cls(begin=begin, end=ring.end, filled=_run_lengths(ring.is_filled(slots)), values=values)

    @property
    def consistent(self) -> bool:
        """Whether the numbers fit each other."""
        lengths = {len(values) for values in self.values.values()}
        return sum(self.filled) == self.end - self.begin and len(lengths) == 1 and max(lengths) <= sum(self.filled)

    def restore(self, ring: RingBuffer) -> None:
        """Put the slots into a ring buffer."""
        filled = np.repeat(np.arange(len(self.filled)) % 2 == 1, self.filled)
        ring.restore(self.begin, filled, {name: _with_nan(values) for name, values in self.values.items()})


class WaitingSample(_Part):
    """A sample that the next one judges: its time and its values, null for NaN."""

    time_ns: ClockNs
    values: dict[str, float | None]

    @classmethod
    def of(cls, rows: Rows) -> Self:
        """Keep the one sample of `rows`."""
        values = {name: _with_null(array)[0] for name, array in rows.values.items()}
        return cls(time_ns=int(rows.time_ns[0]), values=values)

    def rows(self) -> Rows:
        """Return the sample as it was."""
        values = {name: _with_nan([value]) for name, value in self.values.items()}
        return Rows(np.array([self.time_ns], dtype=np.int64), values)


class ChannelState(_Part):
    """State of a `sensor_validation.Channel`; null for NaN."""

    recent: list[float | None]
    last: float | None
    step: float
    bend: float
    restless: float
    repeated: float
    restless_before: float
    rough: float
    steps: float

    @classmethod
    def of(cls, channel: Channel) -> Self:
        """Keep what is remembered of a channel."""
        memory: dict[str, float | None] = dict(zip(MEMORY, channel.memory.tolist(), strict=True))
        last = _with_null(channel.memory)[MEMORY.index("last")]
        return cls(**{**memory, "recent": _with_null(channel.recent), "last": last})

    def channel(self) -> Channel:
        """Return the channel as it was."""
        return Channel.of(_with_nan(self.recent), _with_nan([getattr(self, name) for name in MEMORY]))


class ScreenState(_Part):
    """State of `sensor_validation.SensorValidation`."""

    done: Slot
    speed: ChannelState
    torque: ChannelState

    @classmethod
    def of(cls, screen: SensorValidation) -> Self:
        """Keep the state of the sensor validation."""
        return cls(done=screen.done, speed=ChannelState.of(screen.speed), torque=ChannelState.of(screen.torque))

    def restore(self, screen: SensorValidation) -> None:
        """Let the sensor validation of the same wheel go on from here."""
        screen.done, screen.speed, screen.torque = self.done, self.speed.channel(), self.torque.channel()


class EffectsState(_Part):
    """What the wheel's effects, and the friction before them, remember of the slots so far."""

    friction: ChannelState
    angle_rad: float
    last_speed_rad_s: float
    memories: list[list[float] | None]

    @classmethod
    def of(cls, friction: FrictionSource) -> Self:
        """Keep what the effects remember."""
        return cls(
            angle_rad=friction.angle_rad,
            last_speed_rad_s=friction.last_speed_rad_s,
            friction=ChannelState.of(friction.channel),
            memories=[None if memory is None else memory.tolist() for memory in friction.memories],
        )

    def restore(self, friction: FrictionSource) -> None:
        """Let the friction of the same wheel go on from here."""
        friction.angle_rad, friction.last_speed_rad_s = self.angle_rad, self.last_speed_rad_s
        friction.channel = self.friction.channel()
        friction.memories = [None if memory is None else _with_nan(memory) for memory in self.memories]


def _floats(value: object) -> FloatArray:
    """Return an array, float64 (n,), or the base64 of one in little-endian float64, as an array."""
    if not isinstance(value, str | np.ndarray):
        raise ValueError("must be text in base64")
    array = value if isinstance(value, np.ndarray) else np.frombuffer(b64decode(value, validate=True), dtype="<f8")
    if np.isinf(array).any():
        raise ValueError("must be finite numbers")
    return array.astype(np.float64)


def _base64(array: FloatArray) -> str:
    return b64encode(array.astype("<f8", copy=False).tobytes()).decode("ascii")


Floats = Annotated[FloatArray, PlainValidator(_floats), PlainSerializer(_base64, return_type=str)]


class GatheredState(_Part):
    """The samples that an open window has gathered; NaN where not good."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    x: Floats
    z: Floats
    turns: list[int]

    @classmethod
    def of(cls, gathered: Gathered) -> Self:
        """Keep what a window's accumulator has gathered."""
        return cls(x=gathered.x, z=gathered.z, turns=gathered.turns.tolist())

    def gathered(self) -> Gathered:
        """Return what the accumulator goes on with."""
        return Gathered(self.x, self.z, np.array(self.turns, dtype=np.int64))


class WindowsState(_Part):
    """Where the windows stand: first slots of the open ones, of the next one, and what has been worked off.

    `gathered` holds the samples of the open windows.
    """

    done: Slot
    next_start: Slot
    last_end: Slot
    open: list[Slot]
    gathered: list[GatheredState]


class Checkpoint(_Part):
    """The whole state of a `core.WheelCore` besides its wheel, its model and its method."""

    version: Annotated[int, Field(ge=CHECKPOINT_VERSION, le=CHECKPOINT_VERSION)] = CHECKPOINT_VERSION
    source: Source | Literal[""]
    said_missing: bool
    counts: dict[str, Count]
    carried: CarriedState
    sequencer: SequencerState
    waiting: WaitingSample | None
    epoch_origin_ns: ClockNs
    grid: GridState
    slots: SlotsState
    screen: ScreenState
    effects: EffectsState
    windows: WindowsState

    def to_json(self) -> bytes:
        """Write the checkpoint; the same state always gives the same bytes."""
        # Every number is finite; json.dumps takes thirteen times as long.
        return self.model_dump_json(by_alias=True).encode()

    @classmethod
    def from_json(cls, data: bytes, source: str) -> Self:
        """Read a checkpoint; raises InputError naming the place where it is damaged."""
        if len(data) > MAX_CHECKPOINT_BYTES:
            raise InputError(source, f"has {len(data)} bytes, more than {MAX_CHECKPOINT_BYTES}")
        try:
            return cls.model_validate_json(data)
        except ValidationError as error:
            raise InputError.of_validation(source, error) from error


def _with_null(values: FloatArray) -> list[float | None]:
    listed: list[float | None] = values.tolist()
    for place in np.flatnonzero(np.isnan(values)).tolist():  # few
        listed[place] = None
    return listed


def _with_nan(values: Sequence[float | None]) -> FloatArray:
    return np.array(values, dtype=np.float64)


def _run_lengths(flags: BoolArray) -> list[int]:
    """Return the lengths of alternating runs of False and True, beginning with False (perhaps of length 0)."""
    if flags.size == 0:
        return []
    borders = np.flatnonzero(np.diff(flags)) + 1
    lengths: list[int] = np.diff(np.concatenate(([0], borders, [flags.size]))).tolist()
    return [0, *lengths] if flags[0] else lengths
