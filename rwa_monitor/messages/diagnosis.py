"""The diagnosis of a window, made from the plain results of the diagnosis room."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, ClassVar, Final

from pydantic import Field

from rwa_monitor.changepoints.stage_results import Method
from rwa_monitor.diagnosis.window_diagnosis import WindowDiagnosis
from rwa_monitor.messages.base import ClockNs, Count, Message, Name, Number, Slot, Verdict, dump_json

# Fields of a `WindowDiagnosis` that the message, and its provenance, have as they are.
UNCHANGED: Final = ("coverage", "verdict", "reason", "fit", "model_adequate", "suspected_effect", "explanation")
MADE_WITH: Final = ("method", "model_sha256", "wheel_sha256", "prior_sha256")


class Quantity(Message):
    """A value with its standard deviation; null where the window does not show it."""

    value: Number | None
    std: Number | None
    unit: str


class Anomaly(Message):
    """One possible anomaly; severity 0 at the nominal bound, 1 at the median of the learned anomaly."""

    active: bool
    probability: Annotated[float, Field(ge=0, le=1)]
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
    confidence: Annotated[float, Field(ge=0, le=1)]


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


class Diagnosis(Message):
    """The diagnosis of one window, [window_start_ns, window_end_ns). Nothing in it depends on the wall clock.

    `samples` is the window's length in slots, `coverage` the share of slots with a good sample.
    """

    kind: ClassVar[str] = "diagnosis"

    spacecraft: Name
    wheel: Name
    source: str | None = None
    window_start_ns: ClockNs
    window_end_ns: ClockNs
    samples: Count
    coverage: Annotated[float, Field(ge=0, le=1)]
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

    def content(self) -> dict[str, Any]:
        """Return the message as plain content; `source` only where there is one."""
        content = self.model_dump(mode="python")
        if self.source is None:
            del content["source"]
        return content

    def to_json(self) -> bytes:
        return dump_json(self.content())


def diagnosis_message(
    diagnosis: WindowDiagnosis,
    *,
    spacecraft: str,
    wheel: str,
    window_start_ns: int,
    window_end_ns: int,
    period_ns: int,
    partial: bool,
    software: str,
    source: str | None = None,
) -> Diagnosis:
    """Turn the diagnosis of a window into its message.

    Parameters
    ----------
    diagnosis
        Of the window.
    spacecraft, wheel
        From the bus key; "" and the wheel's name for a table.
    window_start_ns, window_end_ns, period_ns, partial
        Where the window lies, as in `monitor.core.WindowDiagnosed`.
    software
        Name and version.
    source
        File, only for tables.
    """
    fss = {system.name: {name: [*getattr(system, name)] for name in Sojourns.model_fields} for system in diagnosis.fss}
    content = {name: getattr(diagnosis, name) for name in UNCHANGED} | {
        "spacecraft": spacecraft,
        "wheel": wheel,
        "source": source,
        "window_start_ns": window_start_ns,
        "window_end_ns": window_end_ns,
        "samples": diagnosis.slots,
        "partial": partial,
        "anomalies": {anomaly.name: anomaly for anomaly in diagnosis.anomalies},
        "friction": {"base_dry": diagnosis.base_dry, "viscous": diagnosis.viscous, "fss": fss},
        "changepoints": [
            {**asdict(one), "time_ns": window_start_ns + one.index * period_ns} for one in diagnosis.changepoints
        ],
        "provenance": {"software": software, **{name: getattr(diagnosis, name) for name in MADE_WITH}},
    }
    return Diagnosis.model_validate(content, from_attributes=True)
