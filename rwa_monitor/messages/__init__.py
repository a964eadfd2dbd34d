"""The messages on the bus: their fields, their JSON, their schemas.

Every message is one JSON object on the key rwa/{spacecraft}/{wheel}/{kind}, with the Zenoh encoding
application/json;rwa.<Message>; in a recording the same name is the schema. Times are integer nanoseconds of the wheel's
own clock. `schemas/` is generated from here (`make schemas`) and is the contract for every field.

Output is deterministic: fixed order of keys, shortest decimal form of every number, no NaN. Input is limited in size
before it is parsed, and a message that does not fit its model is refused with the place and the reason. In the order of
the data flow: samples are received; changepoints, health and status report on the open window; the diagnosis closes it;
a discrepancy report is the result of a search.
"""

from __future__ import annotations

import json
import math
import re
from typing import Annotated, Any, ClassVar, Final, Literal, NamedTuple, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import from_json

from rwa_monitor.errors import InputError
from rwa_monitor.samples import MAX_TIME_NS, TABLE_CHANNELS, FloatArray, Samples, Timeliness

MAX_MESSAGE_BYTES: Final = 8 * 2**20  # 100,000 samples of three channels are some 6 MB
MAX_SAMPLES: Final = 100_000  # of one message: 3.5 hours at 8 Hz
MAX_CLOCK_NS: Final = 2**62  # of times in outputs: beyond every sample, and sums of two fit in 64 bits
MAX_COUNT: Final = 2**53  # integers that every JSON reader keeps exactly
MAX_WHEELS: Final = 4_096  # of one process: 2.7 MB each with windows of 80,000 slots; `--shard` divides more
PERIOD_S: Final = 1.0  # of all periodic work: status, heartbeat, keep-alive, flush, checks
INTERVALS_TILL_LATE: Final = 3.0  # without it, after which something periodic counts as gone
LOG_PERIOD_S: Final = 10.0  # between log lines or records about something continuous

Count = Annotated[int, Field(ge=0, le=MAX_COUNT)]
TimeNs = Annotated[int, Field(ge=0, le=MAX_TIME_NS)]
ClockNs = Annotated[int, Field(ge=-MAX_CLOCK_NS, le=MAX_CLOCK_NS)]
Slot = Annotated[int, Field(ge=-MAX_COUNT, le=MAX_COUNT)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
Name = Annotated[str, Field(max_length=200)]
Verdict = Literal["nominal", "anomalous", "inconclusive"]
Method = Literal["joint", "paper"]
AlarmLevel = Literal["normal", "watch", "warning", "distress", "critical"]
AlarmPhase = Literal["quiet", "active", "acknowledged", "returned"]
NotLive = Literal["stored", "replay"]


class Message(BaseModel):
    """Base of all messages."""

    model_config = ConfigDict(frozen=True, strict=True, extra="ignore")

    kind: ClassVar[str]  # last part of the key
    omitted: ClassVar[tuple[str, ...]] = ()  # fields that are left out where they are None

    @classmethod
    def schema_name(cls) -> str:
        """Return the name of the schema, such as rwa.Diagnosis; that of `SamplesMessage` is rwa.Samples."""
        return f"rwa.{cls.__name__.removesuffix('Message')}"

    @classmethod
    def encoding(cls) -> str:
        """Return the Zenoh encoding."""
        return f"application/json;{cls.schema_name()}"

    @classmethod
    def json_schema(cls) -> dict[str, Any]:
        """Return the JSON Schema (draft 2020-12) of the message."""
        schema = cls.model_json_schema(mode="validation" if cls.kind == "samples" else "serialization")
        schema["title"] = cls.schema_name()
        return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}

    @classmethod
    def parse(cls, payload: bytes, source: str) -> Self:
        """Parse a message.

        Raises
        ------
        InputError
            If it is too large or no JSON, or if a field is missing or wrong; names the field.
        """
        if len(payload) > MAX_MESSAGE_BYTES:
            raise InputError(source, f"has {len(payload)} bytes, more than {MAX_MESSAGE_BYTES}")
        try:
            return cls.model_validate_json(payload)
        except ValidationError as error:
            raise InputError.of_validation(source, error) from error

    def to_json(self) -> bytes:
        """Return the message as JSON; the same values always give the same bytes."""
        left_out = {name for name in self.omitted if getattr(self, name) is None}
        return dump_json(self.model_dump(exclude=left_out))

    def encoded(self, spacecraft: str, wheel: str, time_ns: int = 0) -> EncodedMessage:
        """Return the message of a wheel in the form for bus and recording, with a time on the wheel's clock [ns]."""
        return EncodedMessage(key_of(type(self), spacecraft, wheel), self.schema_name(), self.to_json(), time_ns)


class WheelMessage(Message):
    """Base of what is reported of a wheel."""

    spacecraft: Name
    wheel: Name


class EncodedMessage(NamedTuple):
    """A message in the form for bus and recording.

    `topic` is the key on the bus, `schema` the name of its schema, `payload` its JSON. `time_ns` is its time on the
    wheel's clock, 0 where it has none; `publish_ns` the wall clock of the machine that recorded it, 0 before that.
    """

    topic: str
    schema: str
    payload: bytes
    time_ns: int = 0
    publish_ns: int = 0

    @property
    def encoding(self) -> str:
        """The Zenoh encoding."""
        return f"application/json;{self.schema}"


def dump_json(content: Any) -> bytes:
    """Return plain content as compact JSON, keys in their given order.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    return json.dumps(content, separators=(",", ":"), allow_nan=False, ensure_ascii=False).encode()


KEY_PREFIX: Final = "rwa"
REPLAY: Final = "@replay"  # suffix of the name of a wheel whose telemetry is a replay
# Names of spacecraft and wheels on the bus: no wildcards of key expressions, no parts of a path such as "..".
_NAME: Final = re.compile(r"[A-Za-z0-9_@+~-][A-Za-z0-9_.@+~-]{0,99}")


def key_of(message: type[Message], spacecraft: str, wheel: str) -> str:
    """Return the key, and topic, of a message."""
    return f"{KEY_PREFIX}/{spacecraft}/{wheel}/{message.kind}"


def split_key(key: str) -> tuple[str, str, str]:
    """Return spacecraft, wheel and kind of a key.

    Raises
    ------
    InputError
        If the key is not rwa/{spacecraft}/{wheel}/{kind}, or a name holds more than letters, digits and _.@+~-.
    """
    parts = key.split("/")
    if len(parts) != 4 or parts[0] != KEY_PREFIX or not all(_NAME.fullmatch(part) for part in parts[1:]):
        raise InputError(
            key, "is no key of the form rwa/{spacecraft}/{wheel}/{kind}, names of letters, digits and _.@+~-"
        )
    return parts[1], parts[2], parts[3]


def replay_key(key: str) -> str:
    """Return the key for a replay of the telemetry of a key; raises as `split_key`."""
    spacecraft, wheel, kind = split_key(key)
    return f"{KEY_PREFIX}/{spacecraft}/{wheel.removesuffix(REPLAY)}{REPLAY}/{kind}"


# ---- samples ---------------------------------------------------------------------------------------------------------


# NaN and Infinity are not JSON, but some writers use them: they are accepted, and masked, like null.
Readings = Annotated[list[float | None], Field(max_length=MAX_SAMPLES)]


class SamplesMessage(Message):
    """Telemetry of a wheel: arrays of one length, null where a value was not measured.

    `publisher` is a random name per start of a publisher and `batch` counts its messages, so that a gap is seen; any
    publisher that writes the arrays is served without them. `data` is "stored" where they were kept before they were
    sent, in any order, and "live" from a publisher of a wheel whose stored samples come, too; such messages are
    numbered apart. It is "replay" for a recording, or a rehearsal, which is served beside the wheel (`replay_key`). The
    channels from `angle_rad` on are recorded, and used by searches only.
    """

    kind: ClassVar[str] = "samples"

    publisher: Annotated[str, Field(max_length=64)] = ""
    batch: Count | None = None
    data: Timeliness | None = None
    time_ns: Annotated[list[TimeNs], Field(min_length=1, max_length=MAX_SAMPLES)]
    speed_rad_s: Readings
    friction_torque_Nm: Readings | None = None
    motor_current_A: Readings | None = None
    motor_torque_Nm: Readings | None = None
    motor_voltage_V: Readings | None = None
    bearing_temperature_degC: Readings | None = None
    angle_rad: Readings | None = None
    body_momentum_Nms: Readings | None = None
    bus_voltage_V: Readings | None = None
    drive_power_W: Readings | None = None

    @model_validator(mode="after")
    def _equal_lengths(self) -> Self:
        for name in TABLE_CHANNELS:
            values = getattr(self, name)
            if values is not None and len(values) != len(self.time_ns):
                raise ValueError(f"{name} has {len(values)} values, time_ns has {len(self.time_ns)}")
        return self

    def samples(self) -> Samples:
        """Return the samples as arrays, NaN where a value was not measured."""
        channels = {
            name: np.array(values, dtype=np.float64)  # None becomes NaN
            for name in TABLE_CHANNELS
            if (values := getattr(self, name)) is not None
        }
        return Samples(time_ns=np.array(self.time_ns, dtype=np.int64), **channels)


def is_json(payload: bytes) -> bool:
    """Return whether a message is JSON of any kind; one that is not may be truncated or damaged."""
    try:
        from_json(payload[:MAX_MESSAGE_BYTES])
    except ValueError:
        return False
    return True


def samples_json(samples: Samples, publisher: str, batch: int, data: Timeliness | None = None) -> bytes:
    """Return samples as the JSON of a `SamplesMessage`, null where a value is not finite."""
    content: dict[str, Any] = {"publisher": publisher, "batch": batch} | ({"data": data} if data else {})
    content["time_ns"] = samples.time_ns.tolist()
    for name in TABLE_CHANNELS:
        values: FloatArray | None = getattr(samples, name)
        if values is not None:
            finite = np.isfinite(values)
            content[name] = (values if finite.all() else np.where(finite, values, np.array(None))).tolist()
    return dump_json(content)


# ---- diagnosis -------------------------------------------------------------------------------------------------------


class Quantity(Message):
    """A value with its standard deviation; null where the window does not determine it."""

    value: Number | None
    std: Number | None
    unit: str


class Anomaly(Message):
    """One possible anomaly; severity 0 at the nominal bound, 1 at the median of the learned anomaly."""

    active: bool
    probability: Share
    severity: Number | None
    severity_std: Number | None
    estimate: Number | None
    nominal_low: Number | None
    nominal_high: Number | None
    unit: str


class Sojourns(Message):
    """What one switching system did in the window: configuration, friction and first slot of each sojourn."""

    configuration: list[Slot]
    friction_Nm: list[Number]
    start_index: list[Slot]


class Friction(Message):
    """Friction split into its parts."""

    base_dry: Quantity
    viscous: Quantity
    fss: dict[str, Sojourns]


class AttributedChangepoint(Message):
    """A jump of friction: first slot of the new level, size, and the switching system that made it."""

    index: Slot
    time_ns: ClockNs
    jump_Nm: Number
    std_Nm: Number
    fss: str
    confidence: Share


class Residuals(Message):
    """How well the friction model fits the window; null where the samples are too few."""

    rmse_Nm: Number | None
    excess_rmse_Nm: Number | None
    noise_std_Nm: Number | None


class Provenance(Message):
    """What the diagnosis was made with; `prior_sha256` is the hash of the state carried over from earlier windows."""

    software: str
    method: Method
    model_sha256: str
    wheel_sha256: str
    prior_sha256: str


class Diagnosis(WheelMessage):
    """The diagnosis of one window, [window_start_ns, window_end_ns). Nothing in it depends on the wall clock.

    `samples` is the window's length in slots, `coverage` the share of slots with a good sample. `data` is "stored"
    where stored samples are in it, or changed the state before it: of several such ones of a window the latest holds.
    """

    kind: ClassVar[str] = "diagnosis"
    omitted: ClassVar[tuple[str, ...]] = ("source", "data")

    source: str | None = None
    data: Literal["stored"] | None = None
    window_start_ns: ClockNs
    window_end_ns: ClockNs
    samples: Count
    coverage: Share
    partial: bool
    verdict: Verdict
    reason: str
    anomalies: dict[str, Anomaly]
    friction: Friction
    changepoints: list[AttributedChangepoint]
    fit: Residuals
    model_adequate: bool
    suspected_effect: str | None
    explanation: str
    provenance: Provenance


# ---- changepoints, health and status ---------------------------------------------------------------------------------


class ProvisionalJump(Message):
    """A jump as soon as it is confirmed; `confidence` that noise alone has no such jump in a whole window."""

    index: Slot
    time_ns: ClockNs
    jump_Nm: Number
    std_Nm: Number
    confidence: Share


class Changepoints(WheelMessage):
    """Jumps of the running window, provisional until its diagnosis."""

    kind: ClassVar[str] = "changepoints"

    window_start_ns: ClockNs
    changepoints: list[ProvisionalJump]


class HealthAlarm(Message):
    """An open alarm: what several windows amount to, and whether it is acknowledged."""

    level: AlarmLevel
    phase: AlarmPhase
    acknowledged_by: str | None


class Health(WheelMessage):
    """A wheel's health in brief: `severity` of its worst active anomaly, `alarms` the names of all of them.

    `alarm_states` are the open alarms by name, where a dashboard keeps them; a monitor has none. `data` is there where
    the window is not of live telemetry; then nothing is in `alarms`.
    """

    kind: ClassVar[str] = "health"
    omitted: ClassVar[tuple[str, ...]] = ("alarm_states", "data")

    verdict: Verdict
    severity: Number
    reason: str
    window_end_ns: ClockNs
    alarms: list[str]
    alarm_states: dict[str, HealthAlarm] | None = None
    data: NotLive | None = None


MODEL_LACKS: Final = (
    "The friction model lacks something this wheel has. rwa-monitor discrepancy names it, but a drift can be the fault"
    " itself: do not extend the wheel file while friction moves."
)


def health_message(diagnosis: Diagnosis, data: NotLive | None = None) -> Health:
    """Return the health that follows from a wheel's latest diagnosis; `data` of None is that of the diagnosis."""
    data = data or diagnosis.data
    alarmed = diagnosis.verdict == "anomalous"
    active = {name: anomaly for name, anomaly in diagnosis.anomalies.items() if alarmed and anomaly.active}
    reason = diagnosis.reason if diagnosis.model_adequate else f"{diagnosis.reason} {MODEL_LACKS}"
    return Health(
        spacecraft=diagnosis.spacecraft,
        wheel=diagnosis.wheel,
        verdict=diagnosis.verdict,
        severity=max((anomaly.severity or 0.0 for anomaly in active.values()), default=0.0),
        reason=reason,
        window_end_ns=diagnosis.window_end_ns,
        alarms=[] if data else list(active),
        data=data,
    )


class Status(WheelMessage):
    """How the monitor of a wheel is doing: received = used + masked + late + duplicate + rejected + queued samples.

    `messages_rejected` and `messages_missed` count this wheel's messages, `messages_dropped` and `queue_depth` those of
    the process. `window_fill` is the share of the running window that has passed, `recording` the file, null without
    one, `data` what the latest samples were, `on_wall_clock` whether the wheel's clock has been seen to agree with the
    monitor's. Times of the monitor's own clock end in `_wall_ns`, durations in `_s`.
    """

    kind: ClassVar[str] = "status"

    samples_received: Count
    samples_used: Count
    samples_masked: Count
    samples_late: Count
    samples_duplicate: Count
    samples_rejected: Count
    samples_queued: Count
    slots_missed: Count
    messages_rejected: Count
    messages_dropped: Count
    messages_missed: Count
    queue_depth: Count
    window_fill: Share
    last_error: str | None
    recording: str | None
    software: str
    model_sha256: str
    publisher: str
    windows: Count
    last_sample_ns: ClockNs | None
    diagnosis_s: Number | None
    now_wall_ns: TimeNs
    data: Timeliness = "live"
    on_wall_clock: bool = False


# ---- discrepancy -----------------------------------------------------------------------------------------------------


TOLERATED_RISE: Final = 0.01  # relative, of the held-out RMSE: a base model's false jumps may absorb so much noise


class Uncertain(Message):
    """A parameter of an effect; `note` is why it is not determined, where it is not (at its bound, …)."""

    value: Number
    std: Number | None
    unit: str
    note: str | None = None


class FoundEffect(Message):
    """An effect that the wheel's model lacks."""

    name: str
    family: Literal["mean", "noise", "switching"]
    equivalent: list[str]
    separate_by: str
    parameters: dict[str, Uncertain]
    p_value: Share
    delta_deviance: Number
    formula: str | None = None


class NearestEffect(Message):
    """The catalogue's effect nearest to the unexplained part, and the share of its sum of squares that it explains."""

    effect: str
    share: Number


class Unexplained(Message):
    """Something is left that no known effect explains."""

    signature: str
    size_Nm: Number
    nearest: NearestEffect | None = None

    def beside(self, signature: str, size_Nm: float) -> Unexplained:
        """Return this combined with something else unexplained, whose signature comes first."""
        both = {"signature": f"{signature}; and {self.signature}", "size_Nm": math.hypot(size_Nm, self.size_Nm)}
        return self.model_copy(update=both)


class Untested(Message):
    """An effect that this data cannot test, and the channel or manoeuvre it lacks."""

    effect: str
    missing: str


class DiagnosisQuality(Message):
    """Detection and false positive rates of the diagnosis, and false changepoints per window where counted."""

    detection: Number
    false_positive: Number
    false_changepoints: Number | None = None


class DiagnosisGain(Message):
    """Quality of the diagnosis without and with the effects found."""

    before: DiagnosisQuality
    after: DiagnosisQuality


class _Rmse(Message):
    """RMSE of friction without and with the effects found."""

    rmse_base_Nm: Number
    rmse_extended_Nm: Number

    @property
    def is_a_loss(self) -> bool:
        """Whether it is worse with the effects."""
        return self.rmse_extended_Nm > (1.0 + TOLERATED_RISE) * self.rmse_base_Nm


class SimulatedGain(_Rmse):
    """RMSE of the wheel file simulated on the searched records without and with the effects; `note` if it is worse."""

    note: str = ""


class SearchedAgain(Message):
    """What a search of a part of the data finds, and gains on the rest (`held_out`), of which it saw nothing."""

    effects: list[Name]
    held_out: list[str]
    rmse_base_Nm: Number
    rmse_extended_Nm: Number
    log_score_base: Number
    log_score_extended: Number

    def in_words(self) -> str:
        """Return findings and gain in one sentence."""
        return (
            f"searched again without {', '.join(self.held_out)}: {' + '.join(self.effects) or 'nothing'} found; there"
            f" RMSE {self.rmse_base_Nm:.4g} → {self.rmse_extended_Nm:.4g} N m, log score {self.log_score_base:.4f} →"
            f" {self.log_score_extended:.4f} per sample"
        )


class Gain(_Rmse):
    """What the effects found are worth on held-out data: recordings named, or blocks of the searched ones."""

    log_score_base: Number
    log_score_extended: Number
    noise_std_Nm: Number
    changepoints_base: Count
    changepoints_extended: Count
    diagnosis: DiagnosisGain | None
    simulated: SimulatedGain | None = None
    held_out: list[str] = Field(default=[])
    # What the search finds and gains without the data that it is evaluated on: other recordings or time segments, and
    # other ranges of speed; None where not requested.
    searched_again: SearchedAgain | None = None
    searched_again_by_speed: SearchedAgain | None = None

    @property
    def is_a_loss(self) -> bool:
        """Whether the extension is worse than the base model on held-out data.

        By RMSE, and by log score unless the RMSE falls without more jumps: noise with a long memory predicts a sample
        from the one before so well that a base model may lack any law and still have the higher log score.
        """
        falls = self.rmse_extended_Nm < (1.0 - TOLERATED_RISE) * self.rmse_base_Nm
        falls = falls and self.changepoints_extended <= self.changepoints_base
        return super().is_a_loss or (self.log_score_extended < self.log_score_base and not falls)

    @property
    def only_by_fewer_jumps(self) -> bool:
        """Whether the only gain on held-out data is fewer jumps: the RMSE does not decrease."""
        return not self.is_a_loss and self.rmse_extended_Nm > self.rmse_base_Nm


class Discrepancy(WheelMessage):
    """What the simulation of a wheel gets wrong, the strongest effect first; from the samples start_ns … end_ns."""

    kind: ClassVar[str] = "discrepancy"

    start_ns: ClockNs
    end_ns: ClockNs
    verdict: Literal["adequate", "inadequate", "untestable"]
    effects: list[FoundEffect]
    unexplained: Unexplained | None
    untested: list[Untested]
    gain: Gain | None


MESSAGES: Final[tuple[type[Message], ...]] = (SamplesMessage, Status, Changepoints, Diagnosis, Discrepancy, Health)
KINDS: Final = {message.kind: message for message in MESSAGES}
