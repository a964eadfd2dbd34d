"""The events of a wheel's monitor core, in the order in which they happen, and the messages made of them.

Live monitor and replay share both.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar, NamedTuple

from rwa_monitor.diagnosis.features import Features
from rwa_monitor.messages import (
    REPLAY,
    Changepoints,
    Diagnosis,
    EncodedMessage,
    Message,
    NotLive,
    ProvisionalJump,
    health_message,
)
from rwa_monitor.monitor.ingest import Trouble
from rwa_monitor.switching.carried_state import CarriedState


class ProvisionalChangepoint(NamedTuple):
    """A jump of friction, as soon as it is confirmed; provisional until the diagnosis of the window it lies in."""

    window_start_ns: int
    jump: ProvisionalJump


class WindowDiagnosed(NamedTuple):
    """A window was closed and diagnosed.

    Attributes
    ----------
    diagnosis
        Of the window; no spacecraft, wheel or file is named in it.
    features
        What the classifiers saw, for training; they do not leave the program.
    carried
        The wheel's state after it.
    """

    diagnosis: Diagnosis
    features: Features
    carried: CarriedState

    def message(self, spacecraft: str, wheel: str, source: str | None = None) -> Diagnosis:
        """Return the diagnosis as a message; of a table `spacecraft` is "" and `source` its file."""
        return self.diagnosis.model_copy(update={"spacecraft": spacecraft, "wheel": wheel, "source": source})


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
            diagnosis, end_ns = event.message(spacecraft, name), event.diagnosis.window_end_ns
            state = event.carried.model_dump(mode="json")
            carried = Carried(window_end_ns=end_ns, sha256=event.carried.sha256(), state=state)
            of_window = (diagnosis, carried, health_message(diagnosis, data))
            outputs += [message.encoded(spacecraft, wheel, end_ns) for message in of_window]
    return outputs
