"""The OpenAPI document of the REST interface, with the bus's schemas; the feed stands in it as a stream of the same."""

from __future__ import annotations

from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field
from pydantic.json_schema import models_json_schema

from rwa_monitor.dashboard.telemetry import Evidence
from rwa_monitor.dashboard.trends import TrendRecord
from rwa_monitor.history.records import MAX_NAME, MAX_NOTE, AlarmRecord, EstimateRecord, WheelLine
from rwa_monitor.history.store import MAX_SHELVED_S
from rwa_monitor.messages import Changepoints, Diagnosis, Discrepancy, Health, SamplesMessage, Status
from rwa_monitor.version import RELEASE

MAX_WINDOWS: Final = 1_000
MAX_ESTIMATES: Final = 20_000  # of four parts, 9 windows a day: some 18 months


class _Shown(BaseModel):
    """What the API gives or takes beside the bus's messages."""

    model_config = ConfigDict(extra="forbid", strict=True)


class Acknowledgement(_Shown):
    """Who has seen an alarm, and what there is to say of it."""

    name: Annotated[str, Field(min_length=1, max_length=MAX_NAME)]
    note: Annotated[str, Field(max_length=MAX_NOTE)] = ""


class Shelving(Acknowledgement):
    """Who sets an alarm aside, for how long, and why; 0 s brings it back."""

    seconds: Annotated[float, Field(ge=0, le=MAX_SHELVED_S)]


class PuttingAside(Acknowledgement):
    """Who puts a wheel aside that is retired, and why; or brings it back."""

    aside: bool


class TelemetryState(_Shown):
    """When a wheel's samples came last [ns, this machine's clock], and how long after that they are stale [s]."""

    wall_ns: int | None
    stale_after_s: float


class CourseState(_Shown):
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

    The key says what the message is: as on the bus, rwa/{spacecraft}/{wheel}/{kind}, with the kinds `alarm`, `aside`
    and `evidence` beside the bus's own; dashboard/beat, dashboard/software, or dashboard/pulse, which is by
    "{spacecraft}/{wheel}".
    `received_wall_ns` is null for what is from the history. Beside a status stands when samples came last, beside a
    diagnosis the course of the windows before. `time_ns`, on the wheel's clock, is of recordings only.
    """

    time_ns: int | None = None
    key: str
    received_wall_ns: int | None
    beside: TelemetryState | CourseState | None
    message: (
        Diagnosis | Status | Changepoints | SamplesMessage | Discrepancy | Evidence | AlarmRecord | WheelLine | Beat
        | Software
        | dict[str, PulseOfWheel]
    )  # fmt: skip


class WheelNow(_Shown):
    """One wheel as it is now: samples, thinned; changepoints of the open window; the wGLR; latest report and status."""

    samples: SamplesMessage | None
    changepoints: list[Changepoints]
    evidence: list[Evidence]
    discrepancy: Discrepancy | None
    status: Status | None


class RecordingFile(_Shown):
    """One recording of the folder, and the first and last time in it on the wheels' clocks."""

    name: str
    size_bytes: int
    changed_wall_ns: int
    first_ns: int | None
    last_ns: int | None


class Replay(_Shown):
    """A recording, samples thinned: what could not be read, and entries in the order of the file."""

    problems: list[str]
    entries: list[Entry]


class Refusal(_Shown):
    """Why there is no answer."""

    error: str


SHOWN: Final = (
    Diagnosis, Status, Changepoints, SamplesMessage, Discrepancy, Health, Evidence, AlarmRecord, EstimateRecord,
    WheelLine, TrendRecord, Acknowledgement, Shelving, PuttingAside, Entry, Beat, PulseOfWheel, Software, WheelNow,
    RecordingFile, Replay, Refusal,
)  # fmt: skip


def openapi() -> dict[str, Any]:
    """Return the OpenAPI 3.1 document."""
    _, definitions = models_json_schema(
        [(model, "validation") for model in SHOWN], ref_template="#/components/schemas/{model}"
    )
    wheel, alarm = [_in_path("spacecraft"), _in_path("wheel")], [_in_path("alarm", "integer")]
    path = "/api/wheels/{spacecraft}/{wheel}"
    feed = _operation("The same messages as they come, as a WebSocket of frames: arrays of entries", _list(Entry))
    feed["responses"]["101"] = {"description": 'A page may send {"watch": "{spacecraft}/{wheel}"} for close-ups of it'}
    windows, estimates = _limit(MAX_WINDOWS), _limit(MAX_ESTIMATES)
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "rwa-monitor dashboard",
            "version": RELEASE,
            "description": "Reading needs no token, changing does. Times in ns; `wall` is this machine's clock.",
        },
        "paths": {
            "/api/fleet": {"get": _operation("Latest messages of every wheel, and all open alarms", _list(Entry))},
            path: {"get": _operation("One wheel as it is now", _one(WheelNow), wheel, refused=404)},
            f"{path}/windows": {"get": _operation("Diagnoses", _list(Diagnosis), [*wheel, windows])},
            f"{path}/estimates": {"get": _operation("Estimates", _list(EstimateRecord), [*wheel, estimates])},
            f"{path}/trend": {"get": _operation("Trends of the estimates", _list(TrendRecord), wheel)},
            f"{path}/aside": {
                "get": _operation("Who has put the wheel aside, and since when it is back", _list(WheelLine), wheel),
                "post": _change("Put a wheel aside, or bring it back", PuttingAside, WheelLine, wheel),
            },
            "/api/alarms": {"get": _operation("Open alarms and the latest closed ones", _list(AlarmRecord))},
            "/api/alarms/{alarm}/acknowledge": {
                "post": _change("Acknowledge an alarm", Acknowledgement, AlarmRecord, alarm)
            },
            "/api/alarms/{alarm}/shelve": {
                "post": _change("Shelve an alarm for a while", Shelving, AlarmRecord, alarm)
            },
            "/api/recordings": {"get": _operation("Recordings, the latest first", _list(RecordingFile))},
            "/api/recordings/{name}": {"get": _operation("One recording, thinned", _one(Replay), [_in_path("name")])},
            "/api/feed": {"get": feed},
        },
        "components": {
            "schemas": definitions.get("$defs", {}),
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}},
        },
    }


def _change(
    summary: str, body: type[BaseModel], answer: type[BaseModel], parameters: list[dict[str, Any]]
) -> dict[str, Any]:
    change = _operation(summary, _one(answer), parameters, refused=401)
    change["requestBody"] = {"required": True, "content": {"application/json": {"schema": _one(body)}}}
    change["security"] = [{"token": []}]
    return change


def _in_path(name: str, kind: str = "string") -> dict[str, Any]:
    return {"name": name, "in": "path", "required": True, "schema": {"type": kind}}


def _limit(most: int) -> dict[str, Any]:
    return {
        "name": "limit",
        "in": "query",
        "schema": {"type": "integer", "minimum": 1, "maximum": most, "default": 200},
    }


def _one(model: type[BaseModel]) -> dict[str, Any]:
    return {"$ref": f"#/components/schemas/{model.__name__}"}


def _list(model: type[BaseModel]) -> dict[str, Any]:
    return {"type": "array", "items": _one(model)}


def _operation(
    summary: str, schema: dict[str, Any], parameters: list[dict[str, Any]] | None = None, refused: int = 422
) -> dict[str, Any]:
    refusal = {"application/json": {"schema": _one(Refusal)}}
    return {
        "summary": summary,
        "parameters": parameters or [],
        "responses": {
            "200": {"description": summary, "content": {"application/json": {"schema": schema}}},
            str(refused): {"description": "Refused", "content": refusal},
            "503": {"description": "The history cannot be used just now", "content": refusal},
        },
    }
