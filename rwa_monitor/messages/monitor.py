"""What a monitor publishes between diagnoses: provisional changepoints, a wheel's health, its own status."""

from __future__ import annotations

from typing import Annotated, ClassVar, Final, Literal

from pydantic import Field

from rwa_monitor.messages.base import ClockNs, Count, Message, Name, Number, Slot, TimeNs, Verdict, dump_json
from rwa_monitor.messages.diagnosis import Diagnosis


class ProvisionalJump(Message):
    """A jump as soon as it is confirmed; `confidence` that noise alone has no such jump in a whole window."""

    index: Slot
    time_ns: ClockNs
    jump_Nm: Number
    std_Nm: Number
    confidence: Annotated[float, Field(ge=0, le=1)]


class Changepoints(Message):
    """Jumps of the running window, provisional until its diagnosis."""

    kind: ClassVar[str] = "changepoints"

    spacecraft: Name
    wheel: Name
    window_start_ns: ClockNs
    changepoints: list[ProvisionalJump]


class HealthAlarm(Message):
    """An open alarm: what several windows amount to, and whether it is acknowledged."""

    level: Literal["normal", "watch", "warning", "distress", "critical"]
    phase: Literal["quiet", "active", "acknowledged", "returned"]
    acknowledged_by: str | None


class Health(Message):
    """A wheel's health in brief: `severity` of its worst active anomaly, `alarms` the names of all of them.

    `alarm_states` are the open alarms by name, where a dashboard keeps them; a monitor has none.
    """

    kind: ClassVar[str] = "health"

    spacecraft: Name
    wheel: Name
    verdict: Verdict
    severity: Number
    reason: str
    window_end_ns: ClockNs
    alarms: list[str]
    alarm_states: dict[str, HealthAlarm] | None = None

    def to_json(self) -> bytes:
        content = self.model_dump(mode="python")
        if self.alarm_states is None:
            del content["alarm_states"]
        return dump_json(content)


MODEL_LACKS: Final = (
    "The friction model lacks something this wheel has. rwa-monitor discrepancy names it, but a drift can be the fault"
    " itself: do not extend the wheel file while friction moves."
)


def health_message(diagnosis: Diagnosis) -> Health:
    """Return the wheel's health by its latest diagnosis."""
    active = {name: anomaly for name, anomaly in diagnosis.anomalies.items() if anomaly.active}
    alarmed = diagnosis.verdict == "anomalous"
    reason = diagnosis.reason if diagnosis.model_adequate else f"{diagnosis.reason} {MODEL_LACKS}"
    return Health(
        spacecraft=diagnosis.spacecraft,
        wheel=diagnosis.wheel,
        verdict=diagnosis.verdict,
        severity=max((anomaly.severity or 0.0 for anomaly in active.values()), default=0.0) if alarmed else 0.0,
        reason=reason,
        window_end_ns=diagnosis.window_end_ns,
        alarms=list(active) if alarmed else [],
    )


class Status(Message):
    """How the monitor of a wheel is doing: received = used + masked + late + duplicate + rejected + queued samples.

    `messages_rejected` and `messages_missed` count this wheel's messages, `messages_dropped` and `queue_depth` those of
    the process. `window_fill` is the share of the running window that has passed, `recording` the file, null without
    one. Times of the monitor's own clock end in `_wall_ns`, durations in `_s`.
    """

    kind: ClassVar[str] = "status"

    spacecraft: Name
    wheel: Name
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
    window_fill: Annotated[float, Field(ge=0, le=1)]
    last_error: str | None
    recording: str | None
    software: str
    model_sha256: str
    publisher: str
    windows: Count
    last_sample_ns: ClockNs | None
    diagnosis_s: Number | None
    now_wall_ns: TimeNs
