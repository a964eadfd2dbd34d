"""What the API gives or takes beside the bus's messages and the history's records."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from rwa_monitor.dashboard.telemetry import Evidence
from rwa_monitor.history.records import MAX_NAME, MAX_NOTE, AlarmRecord, RetirementEvent
from rwa_monitor.history.store import MAX_SHELVED_S
from rwa_monitor.messages import Changepoints, Diagnosis, Discrepancy, SamplesMessage, Status


class _Shown(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Acknowledgement(_Shown):
    """Who has seen an alarm, with a note."""

    name: Annotated[str, Field(min_length=1, max_length=MAX_NAME)]
    note: Annotated[str, Field(max_length=MAX_NOTE)] = ""


class Shelving(Acknowledgement):
    """Who shelves an alarm, for how long, and why; 0 s ends it."""

    seconds: Annotated[float, Field(ge=0, le=MAX_SHELVED_S)]


class Retirement(Acknowledgement):
    """Who retires a wheel, and why; or brings it back to the list, with `aside` false."""

    aside: bool


class TelemetryState(_Shown):
    """When a wheel's samples came last [ns, this machine's clock], and how long after that they are stale [s]."""

    wall_ns: int | None
    stale_after_s: float


class VerdictState(_Shown):
    """Since when a wheel's verdict is as it is [ns, the wheel's clock], over how many windows, and where it goes."""

    since_ns: int | None
    windows: int
    change: str | None


class Beat(_Shown):
    """The server's clock [ns], and what is wrong with the dashboard itself, in words."""

    wall_ns: int
    notes: list[str]


class PulseOfWheel(_Shown):
    """What a status comes to for a page that does not look at the wheel; why all messages were refused, else null."""

    heard_wall_ns: int
    window_fill: float
    telemetry: TelemetryState
    refused: str | None


class Software(_Shown):
    """The name and version of the dashboard."""

    software: str


class Entry(_Shown):
    """One entry of the feed, or of a recording.

    The key names the message: as on the bus, rwa/{spacecraft}/{wheel}/{kind}, with the kinds `alarm`, `aside` (an audit
    event of a retired wheel) and `evidence` beside the bus's own; dashboard/beat, dashboard/software, or
    dashboard/pulse, which is by "{spacecraft}/{wheel}".
    `received_wall_ns` is null for what is from the history. Beside a status stands when samples came last, beside a
    diagnosis the history of the verdict. `time_ns`, on the wheel's clock, is of recordings only.
    """

    time_ns: int | None = None
    key: str
    received_wall_ns: int | None
    beside: TelemetryState | VerdictState | None
    message: (
        Diagnosis | Status | Changepoints | SamplesMessage | Discrepancy | Evidence | AlarmRecord | RetirementEvent
        | Beat | Software
        | dict[str, PulseOfWheel]
    )  # fmt: skip


class WheelNow(_Shown):
    """One wheel as it is now: samples, thinned; changepoints of the open window; the wGLR; latest report and status."""

    samples: SamplesMessage | None
    changepoints: list[Changepoints]
    evidence: list[Evidence]
    discrepancy: Discrepancy | None
    status: Status | None


class Replay(_Shown):
    """A recording, samples thinned: what could not be read, and entries in the order of the file."""

    problems: list[str]
    entries: list[Entry]


class Refusal(_Shown):
    """Why there is no answer."""

    error: str
