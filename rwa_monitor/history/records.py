"""The records of the history, as the API shows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal

from pydantic import Field

from rwa_monitor.errors import InputError
from rwa_monitor.messages import Message, Number
from rwa_monitor.monitor.trends import FrictionEstimate

LevelWord = Literal["normal", "watch", "warning", "distress", "critical"]
PhaseWord = Literal["quiet", "active", "acknowledged", "returned"]
EventWord = Literal[
    "raised", "escalated", "eased", "returned", "relapsed", "acknowledged", "cleared", "shelved", "unshelved"
]


class AlarmLine(Message):
    """One line of an alarm's audit trail; `person` is "" where no person did it."""

    event: EventWord
    level: LevelWord
    time_ns: int
    wall_ns: int
    person: str
    note: str


class AlarmRecord(Message):
    """One alarm from its rise to its end; `closed_ns` is null while it is open, `advice` what to do about it.

    Until `shelved_until_wall_ns`, on this machine's clock, it is shelved.
    """

    id: int
    spacecraft: str
    wheel: str
    name: str
    phase: PhaseWord
    level: LevelWord
    peak: LevelWord
    reason: str
    advice: str
    raised_ns: int
    changed_ns: int
    closed_ns: int | None
    shelved_until_wall_ns: int | None
    trail: list[AlarmLine]


@dataclass(frozen=True, slots=True)
class MonitorState:
    """Whether the monitor of a wheel reports.

    Attributes
    ----------
    spacecraft, wheel
        The wheel's.
    silent
        True where it has not reported for too long.
    time_ns
        The latest time known of the wheel [ns, the wheel's clock]; None where none is.
    reason
        In one sentence, since when; "" where it reports.
    """

    spacecraft: str
    wheel: str
    silent: bool
    time_ns: int | None = None
    reason: str = ""


class RetirementEvent(Message):
    """One audit event on the list of wheels: retired by a person, brought back by one, or back with its telemetry.

    `time_ns` is the end of the latest window that was known when it was retired, `wall_ns` the time of the event, on
    this machine's clock.
    """

    spacecraft: str
    wheel: str
    event: Literal["put_aside", "brought_back", "spoke_again"]
    time_ns: int | None
    wall_ns: int
    person: str
    note: str

    @property
    def retired(self) -> bool:
        """Whether the wheel is retired after this."""
        return self.event == "put_aside"


class EstimateRecord(FrictionEstimate):
    """One estimate of one window, with its nominal range and what was diagnosed of it."""

    name: str
    probability: Annotated[float, Field(ge=0, le=1)]
    severity: Number | None
    active: bool


# ---- who did something -----------------------------------------------------------------------------------------------


MAX_NAME: Final = 100  # characters of a person's name
MAX_NOTE: Final = 2_000


def signed(person: str, note: str) -> tuple[str, str]:
    """Return name and note as they are kept.

    Raises
    ------
    InputError
        If the name is missing, or one of both too long.
    """
    person, note = person.strip(), note.strip()
    if not person or len(person) > MAX_NAME or len(note) > MAX_NOTE:
        raise InputError("name", f"is needed, of at most {MAX_NAME} characters, and a note of at most {MAX_NOTE}")
    return person, note
