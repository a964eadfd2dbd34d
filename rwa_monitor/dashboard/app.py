"""The dashboard's web application: the page, REST under /api, the feed over one WebSocket.

Reading needs no token, changing does. Requests that name another host or come from another origin are refused, so that
no other web page can reach a dashboard on this machine.

Metrics are in the text exposition format of Prometheus, version 0.0.4
(https://prometheus.io/docs/instrumenting/exposition_formats/): base units, names that end in their unit, counters that
end in _total. Unknown values are left out.
"""

from __future__ import annotations

import asyncio
import secrets
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Container, Iterable, Sequence
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, get_args

from fastapi import Depends, FastAPI, Query, Request, Response, WebSocket, WebSocketDisconnect
from fastapi.concurrency import run_in_threadpool
from fastapi.exceptions import RequestValidationError
from fastapi.middleware import Middleware
from fastapi.middleware.trustedhost import TrustedHostMiddleware
from fastapi.responses import FileResponse, JSONResponse
from fastapi.security import HTTPBearer
from fastapi.staticfiles import StaticFiles
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from prometheus_client.registry import Collector
from pydantic import BaseModel, ConfigDict, Field, StringConstraints
from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Receive, Scope, Send

from rwa_monitor import __version__, messages
from rwa_monitor.dashboard.feed import AlarmNotifier, Client, frame, pulse
from rwa_monitor.dashboard.fleet import (
    REMEMBERED,
    Fleet,
    Received,
    VerdictHistory,
    Wheel,
    array_json,
    object_json,
    record_entry,
)
from rwa_monitor.dashboard.recordings import RecordingFile, list_recordings, recorded_samples, replay_json
from rwa_monitor.errors import InputError
from rwa_monitor.history.alarms import STORED_ALARM
from rwa_monitor.history.database import AlarmRecord, HistoryError, RetirementEvent, TrendRecord, trends
from rwa_monitor.messages import (
    AlarmLevel,
    Changepoints,
    Diagnosis,
    Discrepancy,
    SamplesMessage,
    Status,
    Verdict,
)
from rwa_monitor.reporting.diagnoses import EstimateRecord
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, SECONDS_PER_DAY
from rwa_monitor.words import RELEASE, SOFTWARE

SAMPLES: Final = ("used", "masked", "late", "duplicate", "rejected")
MESSAGES: Final = ("missed", "dropped", "rejected")


def metrics(fleet: Fleet, alarms: Sequence[AlarmRecord], retired: Container[tuple[str, str]]) -> str:
    """Return all metrics as text.

    Parameters
    ----------
    fleet
        All live wheels.
    alarms
        All open alarms.
    retired
        Spacecraft and wheel of retired wheels, which have no metrics.
    """
    found = _Metrics()
    with fleet.lock:
        for spacecraft, wheel, known in fleet.wheels():
            if (spacecraft, wheel) not in retired and not wheel.endswith(messages.REPLAY):
                _add_wheel(partial(found.add, spacecraft=spacecraft, wheel=wheel), known)
    counts = Counter(
        (alarm.level, STORED_ALARM if alarm.name.endswith(STORED_ALARM) else alarm.phase)
        for alarm in alarms
        if (alarm.spacecraft, alarm.wheel) not in retired
    )
    for level in get_args(AlarmLevel):
        for phase in ("active", "acknowledged", "returned"):
            about = "Open alarms by level, and whether they are acknowledged."
            found.add("rwa_alarms", about, counts[level, phase], level=level, phase=phase)
        about = "Alarms of stored telemetry, with times of then, that nobody has acknowledged, by level."
        found.add("rwa_stored_alarms", about, counts[level, STORED_ALARM], level=level)
    found.add("rwa_dashboard_info", "Always 1; the labels name what runs.", 1, software=SOFTWARE, build=__version__)
    return generate_latest(found).decode()


class _Metrics(Collector):
    """All metrics, in the order in which they were first added."""

    def __init__(self) -> None:
        self._families: dict[str, GaugeMetricFamily | CounterMetricFamily] = {}

    def add(self, name: str, about: str, value: float | None, **labels: str) -> None:
        """Add a sample to a metric, which is a counter if its name ends in "_total"; a value of None adds none."""
        if value is None:
            return
        if name not in self._families:
            family = CounterMetricFamily if name.endswith("_total") else GaugeMetricFamily
            self._families[name] = family(name, about, labels=list(labels))
        self._families[name].add_metric(list(labels.values()), value)

    def collect(self) -> Iterable[Metric]:
        return self._families.values()


def _add_wheel(add: Callable[..., None], known: Wheel) -> None:
    """Add the metrics of a wheel; `add` labels each with the wheel's name."""
    if known.diagnosis is not None:
        _add_diagnosis(add, known.diagnosis)
    arrivals = known.arrivals
    if arrivals.wall_ns is not None:
        about = "Time since samples of the wheel came last."
        add("rwa_wheel_telemetry_age_seconds", about, _age_s(arrivals.wall_ns))
        about = "Age at which its samples are stale."
        add("rwa_wheel_telemetry_stale_after_seconds", about, arrivals.stale_after_s)
    if known.status is not None:
        about = "Time since the wheel's monitor reported last."
        add("rwa_monitor_status_age_seconds", about, _age_s(known.latest[Status.kind].wall_ns))
        _add_status(add, known.status)


def _age_s(wall_ns: int | None) -> float | None:
    return None if wall_ns is None else (time.time_ns() - wall_ns) / NANOSECONDS_PER_SECOND


def _add_diagnosis(add: Callable[..., None], window: Diagnosis) -> None:
    for verdict in get_args(Verdict):
        about = "1 for the verdict of the latest window, 0 for the others."
        add("rwa_wheel_verdict", about, window.verdict == verdict, verdict=verdict)
    add("rwa_wheel_model_adequate", "1 where the friction model fits the wheel.", window.model_adequate)
    add("rwa_wheel_coverage_ratio", "Share of the latest window with a good sample.", window.coverage)
    for part, one in window.anomalies.items():
        add("rwa_wheel_anomaly_probability", "Probability that a part is anomalous.", one.probability, part=part)
        about = "0 at the nominal bound, 1 at the median of the learned anomaly."
        add("rwa_wheel_severity", about, one.severity, part=part)
        about = "Estimate of a part, in the unit that is its label."
        add("rwa_wheel_estimate", about, one.estimate, part=part, unit=one.unit)
        about = "Upper nominal bound of a part, in its unit."
        add("rwa_wheel_nominal_high", about, one.nominal_high, part=part, unit=one.unit)


def _add_status(add: Callable[..., None], status: Status) -> None:
    add("rwa_monitor_queue_messages", "Messages that wait in the wheel's monitor.", status.queue_depth)
    add("rwa_monitor_slots_missed_total", "Slots of the wheel that no sample came for.", status.slots_missed)
    add("rwa_monitor_windows_total", "Windows of the wheel that were diagnosed.", status.windows)
    for what, about, outcomes in (
        ("samples", "Samples of the wheel by what became of them.", SAMPLES),
        ("messages", "Messages that were of no use, and why.", MESSAGES),
    ):
        for outcome in outcomes:
            add(f"rwa_monitor_{what}_total", about, getattr(status, f"{what}_{outcome}"), outcome=outcome)


# ---- the web application ---------------------------------------------------------------------------------------------


STATIC: Final = Path(__file__).parent / "static"
MAX_BODY_BYTES: Final = 16_384
MAX_NAME: Final = 100  # characters of a person's name
MAX_NOTE: Final = 2_000
MAX_SHELVED_S: Final = 7 * SECONDS_PER_DAY
MAX_WINDOWS: Final = 1_000
MAX_ESTIMATES: Final = 20_000  # of four parts, 9 windows a day: some 18 months
DEFAULT_LIMIT: Final = 200
HEADERS: Final = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}


# ---- models of the API that are neither messages of the bus nor records of the history -------------------------------


class _Shown(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Acknowledgement(_Shown):
    """Who has seen an alarm, with a note."""

    name: Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=MAX_NAME)]
    note: Annotated[str, StringConstraints(strip_whitespace=True, max_length=MAX_NOTE)] = ""


class Shelving(Acknowledgement):
    """Who shelves an alarm, for how long, and why; 0 s ends it."""

    seconds: Annotated[float, Field(ge=0, le=MAX_SHELVED_S, allow_inf_nan=False)]


class Retirement(Acknowledgement):
    """Who retires a wheel, and why; or brings it back to the list, with `retire` false."""

    retire: bool


class TelemetryState(_Shown):
    """When a wheel's samples came last [ns, this machine's clock], and how long after that they are stale [s]."""

    wall_ns: int | None
    stale_after_s: float


class VerdictState(_Shown):
    """Since when a wheel's verdict is as it is [ns, the wheel's clock], over how many windows."""

    since_ns: int | None
    windows: int


class Beat(_Shown):
    """The server's clock [ns], and what is wrong with the dashboard itself, in words."""

    wall_ns: int
    notes: list[str]


class PulseOfWheel(_Shown):
    """Summary of a status for a page that does not show the wheel; why all messages were refused, else null."""

    reported_wall_ns: int
    window_fill: float
    telemetry: TelemetryState
    refused: str | None


class Entry(_Shown):
    """One entry of the feed, or of a recording.

    The key names the message: as on the bus, rwa/{spacecraft}/{wheel}/{kind}, with the kinds `alarm` and `retirement`
    (an audit event of a retired wheel) beside the bus's own; dashboard/beat, or dashboard/pulse, which is by
    "{spacecraft}/{wheel}".
    `received_wall_ns` is null for what is from the history. Beside a status stands when samples came last, beside a
    diagnosis the history of the verdict. `time_ns`, on the wheel's clock, is of recordings only.
    """

    time_ns: int | None = None
    key: str
    received_wall_ns: int | None
    beside: TelemetryState | VerdictState | None
    message: (
        Diagnosis | Status | Changepoints | SamplesMessage | Discrepancy | AlarmRecord | RetirementEvent
        | Beat
        | dict[str, PulseOfWheel]
    )  # fmt: skip


class WheelNow(_Shown):
    """One wheel as it is now: samples, thinned; changepoints of the open window; latest report and status."""

    samples: SamplesMessage | None
    changepoints: list[Changepoints]
    discrepancy: Discrepancy | None
    status: Status | None


class RecentWindows(_Shown):
    """The latest windows of a wheel, the oldest first: end [ns, wheel's clock], verdict, fit, worst severity."""

    window_end_ns: list[int]
    verdict: list[Verdict]
    model_adequate: list[bool]
    severity: list[float]


class Replay(_Shown):
    """A recording, samples thinned: what could not be read, and entries in the order of the file."""

    problems: list[str]
    entries: list[Entry]


class Refusal(_Shown):
    """Why there is no answer."""

    error: str


# ---- the application -------------------------------------------------------------------------------------------------


def create_app(api: Api, token: str, origin: str | None) -> FastAPI:
    """Return the application; changes need the token, and pages of `origin`, if given, may read.

    FastAPI's documentation pages are off, as they load scripts from other sites.
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        del app
        feeding = asyncio.create_task(api.notifier.hub.run())
        yield
        feeding.cancel()

    app = FastAPI(
        title="rwa-monitor dashboard",
        version=RELEASE,
        description="Reading needs no token, changing does. Times in ns; `wall` is this machine's clock.",
        openapi_url="/api/openapi.json",
        docs_url=None,
        redoc_url=None,
        lifespan=lifespan,
        middleware=[
            Middleware(TrustedHostMiddleware, allowed_hosts=["127.0.0.1", "localhost"]),
            Middleware(Guard, token=token, origin=origin),
        ],
        exception_handlers=dict.fromkeys((HTTPException, RequestValidationError, InputError, HistoryError), _refused),
        responses={422: {"model": Refusal}, 503: {"model": Refusal}},
    )
    _add_routes(app, api)
    app.mount("/static", StaticFiles(directory=STATIC))
    return app


def _add_routes(app: FastAPI, api: Api) -> None:
    app.add_route("/", lambda _: FileResponse(STATIC / "index.html"), include_in_schema=False)
    app.add_route("/metrics", api.metrics, include_in_schema=False)
    app.add_api_websocket_route("/api/feed", api.feed)
    wheel = "/api/wheels/{spacecraft}/{wheel}"
    get = app.add_api_route
    refused: dict[int | str, dict[str, Any]] = {401: {"model": Refusal}, 404: {"model": Refusal}}
    get("/api/feed", api.frames, response_model=list[Entry])
    get("/api/fleet", api.fleet, response_model=list[Entry])
    get("/api/verdicts", api.verdicts, response_model=dict[str, RecentWindows])
    get(wheel, api.wheel, response_model=WheelNow, responses=refused)
    get(f"{wheel}/samples", api.samples, response_model=SamplesMessage | None)
    get(f"{wheel}/windows", api.windows, response_model=list[Diagnosis])
    get(f"{wheel}/estimates", api.estimates)
    get(f"{wheel}/trend", api.trend)
    get(f"{wheel}/retirement", api.retirement)
    get("/api/alarms", api.alarms)
    get("/api/recordings", api.recordings)
    get("/api/recordings/{name}", api.recording, response_model=Replay)
    token = Depends(HTTPBearer(scheme_name="token", auto_error=False))  # `Guard` has checked it
    for path, change in (
        (f"{wheel}/retirement", api.retire),
        ("/api/alarms/{alarm:int}/acknowledge", api.acknowledge),
        ("/api/alarms/{alarm:int}/shelve", api.shelve),
    ):
        get(path, change, methods=["POST"], responses=refused, dependencies=[token])


class Guard:
    """Refuses requests of other web pages, and changes without the token, before their body is read.

    It adds `HEADERS` to every answer.
    """

    def __init__(self, app: ASGIApp, token: str, origin: str | None) -> None:
        self.app, self._token, self._origin = app, token, origin.encode() if origin else None
        self._headers = HEADERS | ({"Access-Control-Allow-Origin": origin} if origin else {})

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""

        async def with_headers(message: Any) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(self._headers)
            await send(message)

        status, reason = self._refusal(scope)
        if not reason:
            await self.app(scope, receive, with_headers)
        elif scope["type"] == "websocket":
            await WebSocket(scope, receive, send).close(1008)
        else:
            await JSONResponse({"error": reason}, status)(scope, receive, with_headers)

    def _refusal(self, scope: Scope) -> tuple[int, str]:
        """Return the status and reason of a refusal, "" for none."""
        headers = dict(scope.get("headers", []))
        reads = scope.get("method", "GET") in {"GET", "HEAD"}
        own = b"http://" + headers.get(b"host", b"")
        if headers.get(b"origin", own) not in (own, self._origin if reads else own):
            return 403, "another origin has no access"
        if reads:
            return 200, ""
        if not secrets.compare_digest(headers.get(b"authorization", b""), f"Bearer {self._token}".encode()):
            return 401, "the token is missing or wrong; it is printed where the dashboard was started"
        size = headers.get(b"content-length", b"")
        if not size.isdigit() or len(size) > len(str(MAX_BODY_BYTES)) or int(size) > MAX_BODY_BYTES:
            return 413, f"more than {MAX_BODY_BYTES} bytes, or not stated how many"
        return 200, ""


class Api:
    """The request handlers. FastAPI runs those that are not coroutines in a thread pool.

    Answers made of messages of the bus are written as bytes from stored JSON: FastAPI documents them, but neither
    validates nor serialises them.

    Parameters
    ----------
    fleet
        The live wheels.
    notifier
        Publishes changes of alarms; has the history.
    recordings
        Folder of the recordings.
    """

    def __init__(self, fleet: Fleet, notifier: AlarmNotifier, recordings: Path) -> None:
        self._fleet, self._history, self.notifier, self._folder = fleet, notifier.history, notifier, recordings
        self._earlier: dict[tuple[str, str], tuple[bytes, VerdictHistory]] = {}  # with their latest diagnosis

    def _first_frame(self) -> str:
        try:
            first = self._snapshot()
        except HistoryError:
            first = self._fleet.snapshot()
        return frame([*(entry for entry in first if not entry.brief), *pulse(entry for entry in first if entry.brief)])

    def fleet(self) -> Response:
        """Answer with the latest diagnosis and status of every wheel, and all open alarms, as entries of the feed."""
        return _json(frame(self._snapshot()).encode())

    def _snapshot(self) -> list[Received]:
        """Return the entries that a page needs first: live wheels, others of the history, alarms, retired wheels."""
        history, live = self._history, self._fleet.snapshot()
        known = {entry.key for entry in live}
        earlier = [
            Received(messages.key_of(Diagnosis, *name), payload, None) for name, payload in history.latest().items()
        ]
        earlier = [entry for entry in earlier if entry.key not in known]
        retired = [record_entry(event, "retirement") for event in history.retired.latest()]
        return [*live, *earlier, *(record_entry(alarm, "alarm") for alarm in history.alarms()), *retired]

    def verdicts(self) -> Response:
        """Answer with the verdicts of the latest windows of every wheel, by "{spacecraft}/{wheel}"."""
        with self._fleet.lock:
            known = {(spacecraft, wheel): [*one.verdicts.recent] for spacecraft, wheel, one in self._fleet.wheels()}
        for name, latest in self._history.latest().items():
            if name in known:
                continue
            if self._earlier.get(name, (b"", None))[0] != latest:
                verdicts = VerdictHistory()
                verdicts.extend(self._history.windows(*name, REMEMBERED))
                self._earlier[name] = latest, verdicts
            known[name] = [*self._earlier[name][1].recent]
        fields = RecentWindows.model_fields
        columns = {"/".join(name): zip(*rows, strict=True) for name, rows in known.items() if rows}
        return _json(messages.dump_json({name: dict(zip(fields, rows, strict=True)) for name, rows in columns.items()}))

    def wheel(self, spacecraft: str, wheel: str) -> Response:
        """Answer with the thinned samples and the provisional changepoints of one wheel."""
        parts = dict.fromkeys(WheelNow.model_fields, b"null") | {"changepoints": b"[]"}
        known = self._fleet.wheel(spacecraft, wheel)
        if known is not None:
            with self._fleet.lock:
                parts["samples"] = known.decimated.message()
                parts["changepoints"] = array_json(entry.payload for entry in known.provisional)
                parts |= {kind: known.latest[kind].payload for kind in parts if kind in known.latest}
        elif not self._history.windows(spacecraft, wheel, 1):
            raise HTTPException(404, "no such wheel")
        if parts["discrepancy"] == b"null":
            parts["discrepancy"] = self._history.discrepancy(spacecraft, wheel) or b"null"
        return _json(object_json(parts))

    def samples(self, spacecraft: str, wheel: str) -> Response:
        """Answer with the thinned samples of one wheel's latest window that the recordings hold; null for none."""
        latest = self._history.windows(spacecraft, wheel, 1)
        return _json(recorded_samples(self._folder, latest[0]) if latest else b"null")

    def windows(
        self, spacecraft: str, wheel: str, limit: Annotated[int, Query(ge=1, le=MAX_WINDOWS)] = DEFAULT_LIMIT
    ) -> Response:
        """Answer with the latest diagnoses of one wheel, the oldest first."""
        windows = self._history.windows(spacecraft, wheel, limit)
        return _json(array_json(window.to_json() for window in windows))

    def estimates(
        self, spacecraft: str, wheel: str, limit: Annotated[int, Query(ge=1, le=MAX_ESTIMATES)] = DEFAULT_LIMIT
    ) -> list[EstimateRecord]:
        """Answer with the latest estimates of one wheel, the oldest first."""
        return self._history.estimates(spacecraft, wheel, limit)

    def trend(self, spacecraft: str, wheel: str) -> list[TrendRecord]:
        """Answer with the trends of one wheel's estimates."""
        return trends(self._history.estimates(spacecraft, wheel, MAX_ESTIMATES))

    def retirement(self, spacecraft: str, wheel: str) -> list[RetirementEvent]:
        """Answer with who has retired a wheel and brought it back, the oldest event first."""
        return self._history.retired.events(spacecraft, wheel)

    def retire(self, spacecraft: str, wheel: str, who: Retirement) -> RetirementEvent:
        """Retire a wheel that sends no telemetry, or bring it back; needs the token."""
        if who.retire:
            self._check_quiet(spacecraft, wheel)
        event = self._history.retired.change(spacecraft, wheel, who.name, who.note, retire=who.retire)
        self.notifier.hub.post(record_entry(event, "retirement"))
        return event

    def _check_quiet(self, spacecraft: str, wheel: str) -> None:
        """Refuse to retire a wheel that is unknown, or that still sends telemetry."""
        known = self._fleet.wheel(spacecraft, wheel)
        if known is None:
            if not self._history.windows(spacecraft, wheel, 1):
                raise HTTPException(404, "no such wheel")
            return
        with self._fleet.lock:
            last_ns, stale_after_s = known.arrivals.wall_ns, known.arrivals.stale_after_s
        if last_ns is not None and time.time_ns() - last_ns < stale_after_s * NANOSECONDS_PER_SECOND:
            reason = f"its telemetry is of now: it can be retired when none has come for {stale_after_s:.0f} s"
            raise InputError(f"{spacecraft}/{wheel}", reason)

    def alarms(self) -> list[AlarmRecord]:
        """Answer with all open alarms and the latest closed ones."""
        return self._history.alarms()

    def acknowledge(self, alarm: int, who: Acknowledgement) -> AlarmRecord:
        """Acknowledge an alarm, and report that to pages and bus; needs the token."""
        self.notifier.publish(changed := self._history.acknowledge(alarm, who.name, who.note))
        return changed

    def shelve(self, alarm: int, who: Shelving) -> AlarmRecord:
        """Shelve an alarm for a while, and report that to pages and bus; needs the token."""
        self.notifier.publish(changed := self._history.shelve(alarm, who.name, who.seconds, who.note))
        return changed

    def metrics(self, request: Request) -> Response:
        """Answer with all metrics, for Prometheus."""
        del request
        text = metrics(self._fleet, self._history.alarms(closed=0), self._history.retired.names())
        return Response(text, media_type=CONTENT_TYPE_PLAIN_0_0_4)

    def recordings(self) -> list[RecordingFile]:
        """Answer with the recordings there are, the latest first."""
        return list_recordings(self._folder)

    def recording(self, name: str) -> Response:
        """Answer with one recording as entries of the feed, samples thinned."""
        return _json(replay_json(self._folder, name))

    def frames(self) -> Response:
        """Entries as they come, in frames over a WebSocket; a page asks for close-ups with {"watch": "{wheel}"}."""
        return JSONResponse({"error": "this is a WebSocket"}, 426)

    async def feed(self, socket: WebSocket) -> None:
        """Serve one page until it disconnects."""
        await socket.accept()
        client = Client()
        self.notifier.hub.clients.add(client)
        sending: asyncio.Task[None] | None = None
        try:
            await socket.send_text(await run_in_threadpool(self._first_frame))
            sending = asyncio.create_task(_send(socket, client))
            # The page names the wheel that it shows, {"watch": "spacecraft/wheel"}, to get its samples.
            async for asked in socket.iter_json():
                if isinstance(asked, dict):
                    client.watches = str(asked.get("watch", ""))
        except (KeyError, ValueError):  # bytes, or a text that is not JSON
            await socket.close(1003, "no JSON")
        finally:
            self.notifier.hub.clients.discard(client)
            if sending is not None:
                sending.cancel()


async def _send(socket: WebSocket, client: Client) -> None:
    """Send a page's queued frames until it disconnects, or is too slow."""
    with suppress(WebSocketDisconnect, RuntimeError):
        while (text := await client.frames.get()) is not None:
            await socket.send_text(text)
        await socket.close(1013, "too slow")


def _json(content: bytes) -> Response:
    return Response(content, media_type="application/json")


async def _refused(request: Request, error: Exception) -> Response:
    """Answer a request that failed with a `Refusal`."""
    del request
    if isinstance(error, HTTPException):
        return JSONResponse({"error": error.detail}, error.status_code)
    if isinstance(error, RequestValidationError):
        first = error.errors()[0]
        return JSONResponse({"error": f"{'.'.join(map(str, first['loc'][1:] or first['loc']))}: {first['msg']}"}, 422)
    return JSONResponse({"error": str(error)}, 503 if isinstance(error, HistoryError) else 422)
