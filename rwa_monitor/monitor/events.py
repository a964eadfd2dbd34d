"""The events of a wheel's monitor core, in the order in which they happen, and the messages made of them.

Live monitor and replay share both.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any, ClassVar, Final, Literal, NamedTuple

from rwa_monitor.diagnosis.window_diagnosis import WindowDiagnosis
from rwa_monitor.messages import (
    REPLAY,
    Changepoints,
    Diagnosis,
    EncodedMessage,
    Message,
    NotLive,
    ProvisionalJump,
    Sojourns,
    health_message,
)
from rwa_monitor.monitor.ingest import Trouble
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.words import SOFTWARE

# Fields of a `WindowDiagnosis` that the message, and its provenance, have as they are.
UNCHANGED: Final = ("coverage", "verdict", "reason", "fit", "model_adequate", "suspected_effect", "explanation")
MADE_WITH: Final = ("method", "model_sha256", "wheel_sha256", "prior_sha256")


class ProvisionalChangepoint(NamedTuple):
    """A jump of friction, as soon as it is confirmed; provisional until the diagnosis of the window it lies in."""

    window_start_ns: int
    jump: ProvisionalJump


class WindowDiagnosed(NamedTuple):
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
    data
        "stored" where stored telemetry, or what it changed, was diagnosed; None where it was live.
    """

    start_ns: int
    end_ns: int
    period_ns: int
    partial: bool
    diagnosis: WindowDiagnosis
    carried: CarriedState
    data: Literal["stored"] | None = None

    def message(self, spacecraft: str, wheel: str, source: str | None = None) -> Diagnosis:
        """Return the diagnosis as a message; of a table `spacecraft` is "" and `source` its file."""
        found = self.diagnosis
        content = {name: getattr(found, name) for name in UNCHANGED} | {
            "spacecraft": spacecraft,
            "wheel": wheel,
            "source": source,
            "data": self.data,
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


def outputs_of(
    events: Iterable[Event], spacecraft: str, wheel: str, data: NotLive | None = None
) -> list[EncodedMessage]:
    """Return the messages for events of a wheel, in order; all but `Carried` are published.

    What a replay gives is, but for its key, what its telemetry gave live. `data` is what the samples were where that is
    not live: old by the clock when they came, or a replay. The health alone gives notice of it.
    """
    outputs: list[EncodedMessage] = []
    name = wheel.removesuffix(REPLAY)
    for event in events:
        if isinstance(event, ProvisionalChangepoint):
            found = Changepoints(
                spacecraft=spacecraft, wheel=name, window_start_ns=event.window_start_ns, changepoints=[event.jump]
            )
            outputs.append(found.encoded(spacecraft, wheel, event.jump.time_ns))
        elif isinstance(event, WindowDiagnosed):
            diagnosis, end_ns = event.message(spacecraft, name), event.end_ns
            state = event.carried.model_dump(mode="json")
            carried = Carried(window_end_ns=end_ns, sha256=event.carried.sha256(), state=state)
            of_window = (diagnosis, carried, health_message(diagnosis, data))
            outputs += [message.encoded(spacecraft, wheel, end_ns) for message in of_window]
    return outputs
