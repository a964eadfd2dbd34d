"""The events of a wheel's monitor core, in the order in which they happen, and the messages made of them.

Live monitor and replay share both.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Final

from rwa_monitor.diagnosis.window_diagnosis import WindowDiagnosis
from rwa_monitor.messages import Changepoints, Diagnosis, Message, ProvisionalJump, Sojourns, health_message, key_of
from rwa_monitor.monitor.ingest.sequencer import Trouble
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.version import SOFTWARE

# Fields of a `WindowDiagnosis` that the message, and its provenance, have as they are.
UNCHANGED: Final = ("coverage", "verdict", "reason", "fit", "model_adequate", "suspected_effect", "explanation")
MADE_WITH: Final = ("method", "model_sha256", "wheel_sha256", "prior_sha256")


@dataclass(frozen=True, slots=True)
class ProvisionalChangepoint:
    """A jump of friction, as soon as it is confirmed; provisional until the diagnosis of the window it lies in."""

    window_start_ns: int
    jump: ProvisionalJump


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
        Of the window.
    carried
        The wheel's state after it.
    """

    start_ns: int
    end_ns: int
    period_ns: int
    partial: bool
    diagnosis: WindowDiagnosis
    carried: CarriedState

    def message(self, spacecraft: str, wheel: str, source: str | None = None) -> Diagnosis:
        """Return the diagnosis as a message; of a table `spacecraft` is "" and `source` its file."""
        found = self.diagnosis
        content = {name: getattr(found, name) for name in UNCHANGED} | {
            "spacecraft": spacecraft,
            "wheel": wheel,
            "source": source,
            "window_start_ns": self.start_ns,
            "window_end_ns": self.end_ns,
            "samples": found.slots,
            "partial": self.partial,
            "anomalies": {anomaly.name: anomaly for anomaly in found.anomalies},
            "friction": {
                "base_dry": found.base_dry,
                "viscous": found.viscous,
                "fss": {
                    system.name: {name: [*getattr(system, name)] for name in Sojourns.model_fields}
                    for system in found.fss
                },
            },
            "changepoints": [
                {**asdict(one), "time_ns": self.start_ns + one.index * self.period_ns} for one in found.changepoints
            ],
            "provenance": {"software": SOFTWARE, **{name: getattr(found, name) for name in MADE_WITH}},
        }
        return Diagnosis.model_validate(content, from_attributes=True)


Event = ProvisionalChangepoint | WindowDiagnosed | Trouble


# ---- the messages made of them ---------------------------------------------------------------------------------------


class Carried(Message):
    """The state that a window hands to the next one, and its hash; recorded beside the diagnosis, not published."""

    kind: ClassVar[str] = "carried"

    window_end_ns: int
    sha256: str
    state: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Output:
    """One message of the monitor.

    Attributes
    ----------
    key
        Bus key and topic.
    message
        Its class.
    payload
        JSON.
    time_ns
        On the wheel's clock; None where it has no time on it.
    """

    key: str
    message: type[Message]
    payload: bytes
    time_ns: int | None

    @property
    def schema(self) -> str:
        """Name of the schema."""
        return self.message.schema_name()

    @property
    def published(self) -> bool:
        """Whether it goes to the bus, and not into the recording alone."""
        return self.message is not Carried


def output_of(message: Message, time_ns: int | None, spacecraft: str, wheel: str) -> Output:
    """Return a message of a wheel as an output."""
    return Output(key_of(type(message), spacecraft, wheel), type(message), message.to_json(), time_ns)


def outputs_of(events: Iterable[Event], spacecraft: str, wheel: str) -> list[Output]:
    """Return the outputs for events of a wheel, in order."""
    outputs: list[Output] = []
    for event in events:
        if isinstance(event, ProvisionalChangepoint):
            found = Changepoints(
                spacecraft=spacecraft, wheel=wheel, window_start_ns=event.window_start_ns, changepoints=[event.jump]
            )
            outputs.append(output_of(found, event.jump.time_ns, spacecraft, wheel))
        elif isinstance(event, WindowDiagnosed):
            diagnosis, end_ns = event.message(spacecraft, wheel), event.end_ns
            state = event.carried.model_dump(mode="json")
            carried = Carried(window_end_ns=end_ns, sha256=event.carried.sha256(), state=state)
            outputs += [output_of(each, end_ns, spacecraft, wheel) for each in (diagnosis, carried)]
            outputs.append(health_output(diagnosis))
    return outputs


def health_output(diagnosis: Diagnosis) -> Output:
    """Return the health message that goes with a diagnosis."""
    return output_of(health_message(diagnosis), diagnosis.window_end_ns, diagnosis.spacecraft, diagnosis.wheel)
