"""The dashboard's web application: the page, REST under /api, the feed over one WebSocket.

Reading needs no token, changing does. Requests that name another host or come from another origin are refused, so that
no other web page can reach a dashboard on this machine.
"""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ValidationError
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from rwa_monitor.dashboard.alarm_notifier import Voices, alarm_entry
from rwa_monitor.dashboard.feed import Client, frame, pulse
from rwa_monitor.dashboard.fleet import Fleet, Received
from rwa_monitor.dashboard.listener import aside_entry
from rwa_monitor.dashboard.metrics import CONTENT_TYPE, metrics
from rwa_monitor.dashboard.openapi import (
    MAX_ESTIMATES,
    MAX_WINDOWS,
    Acknowledgement,
    PuttingAside,
    Shelving,
    openapi,
)
from rwa_monitor.dashboard.recordings import list_recordings, replay_json
from rwa_monitor.dashboard.trends import trends
from rwa_monitor.errors import InputError
from rwa_monitor.history.database import HistoryError
from rwa_monitor.history.records import AlarmRecord, WheelLine
from rwa_monitor.history.retired_wheels import Aside
from rwa_monitor.history.store import History
from rwa_monitor.messages import Diagnosis, Discrepancy, Status, dump_json, key_of
from rwa_monitor.samples import NANOSECONDS_PER_SECOND
from rwa_monitor.version import SOFTWARE

STATIC: Final = Path(__file__).parent / "static"
MAX_BODY_BYTES: Final = 16_384
MAX_WATCH: Final = 300  # characters of a wheel that a page asks for
Wanted = TypeVar("Wanted", bound=BaseModel)
HEADERS: Final = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}


@dataclass(frozen=True, slots=True)
class Sources:
    """What the application shows: fleet, history, what is put aside, folder of recordings or None; voices and token."""

    fleet: Fleet
    history: History
    aside: Aside
    voices: Voices
    recordings: Path | None
    token: str


def create_app(sources: Sources) -> Starlette:
    """Return the application."""
    api = Api(sources)

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        del app
        feeding = asyncio.create_task(sources.voices.hub.run())
        yield
        feeding.cancel()

    return Starlette(
        routes=[
            Route("/", lambda _: FileResponse(STATIC / "index.html")),
            Route("/api/openapi.json", lambda _: JSONResponse(openapi())),
            Route("/api/fleet", api.fleet),
            Route("/api/wheels/{spacecraft}/{wheel}", api.wheel),
            Route("/api/wheels/{spacecraft}/{wheel}/windows", api.windows),
            Route("/api/wheels/{spacecraft}/{wheel}/estimates", api.estimates),
            Route("/api/wheels/{spacecraft}/{wheel}/trend", api.trend),
            Route("/api/wheels/{spacecraft}/{wheel}/aside", api.deeds, methods=["GET"]),
            Route("/api/wheels/{spacecraft}/{wheel}/aside", api.put_aside, methods=["POST"]),
            Route("/api/alarms", api.alarms),
            Route("/api/alarms/{alarm:int}/acknowledge", api.acknowledge, methods=["POST"]),
            Route("/api/alarms/{alarm:int}/shelve", api.shelve, methods=["POST"]),
            Route("/api/recordings", api.recordings),
            Route("/api/recordings/{name}", api.recording),
            Route("/metrics", api.metrics),
            WebSocketRoute("/api/feed", api.feed),
            Mount("/static", StaticFiles(directory=STATIC)),
        ],
        middleware=[
            Middleware(TrustedHostMiddleware, allowed_hosts=["127.0.0.1", "localhost"]),
            Middleware(SameOrigin),
        ],
        exception_handlers={HTTPException: _told, InputError: _refused, HistoryError: _unavailable},
        lifespan=lifespan,
    )


class SameOrigin:
    """Refuses what another web page's script asks for, and adds the headers that every answer has."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        headers = dict(scope.get("headers", []))
        origin, host = headers.get(b"origin"), headers.get(b"host", b"")
        if origin is not None and origin != b"http://" + host:
            if scope["type"] == "websocket":
                await WebSocket(scope, receive, send).close(1008)
            else:
                await JSONResponse({"error": "another origin has no access"}, 403)(scope, receive, send)
            return

        async def with_headers(message: Any) -> None:
            if message["type"] == "http.response.start":
                message["headers"] += [(name.encode(), value.encode()) for name, value in HEADERS.items()]
            await send(message)

        await self.app(scope, receive, with_headers)


class Api:
    """The handlers, over the sources. Those that are no coroutines run in threads of their own."""

    def __init__(self, sources: Sources) -> None:
        self.sources = sources
        self._first = Shared(self._first_frame)

    def _first_frame(self) -> str:
        first = [Received("dashboard/software", dump_json({"software": SOFTWARE}), None)]
        try:
            first += self._snapshot()
        except HistoryError:
            first += self.sources.fleet.snapshot()
        return frame([*(entry for entry in first if not entry.brief), *pulse(entry for entry in first if entry.brief)])

    def fleet(self, request: Request) -> Response:
        """Answer with the latest diagnosis and status of every wheel, as entries of the feed."""
        del request
        return _json(frame(self._snapshot()).encode())

    def _snapshot(self) -> list[Received]:
        """Return what a page needs first: live wheels, those only the history knows, the alarms, what is put aside."""
        history, live = self.sources.history, self.sources.fleet.snapshot()
        known = {entry.key for entry in live}
        past = [Received(key_of(Diagnosis, *name), payload, None) for name, payload in history.latest().items()]
        past = [entry for entry in past if entry.key not in known]
        deeds = [aside_entry(line) for line in self.sources.aside.lines()]
        return [*live, *past, *(alarm_entry(alarm) for alarm in history.alarms()), *deeds]

    def wheel(self, request: Request) -> Response:
        """Answer with the thinned samples and the provisional changepoints of one wheel."""
        name = (request.path_params["spacecraft"], request.path_params["wheel"])
        if name not in self.sources.fleet.names():
            if name not in self.sources.history.wheels():
                raise HTTPException(404, "no such wheel")
            return _json(_wheel_json(b"null", [], [], self.sources.history.discrepancy(*name), b"null"))
        wheel = self.sources.fleet.wheel(*name)
        assert wheel is not None  # it is known, as asked above
        with self.sources.fleet.lock:
            samples, jumps = wheel.trace.message(), [entry.payload for entry in wheel.provisional]
            curves = [*wheel.curves]
            so_far = wheel.open_window.evidence_so_far(wheel.diagnosis, wheel.constants)
            found = wheel.latest.get(Discrepancy.kind)
            status = wheel.latest.get(Status.kind)
        curves += [so_far.to_json()] if so_far else []
        known = found.payload if found else self.sources.history.discrepancy(*name)
        return _json(_wheel_json(samples, jumps, curves, known, status.payload if status else b"null"))

    def windows(self, request: Request) -> Response:
        """Answer with the latest diagnoses of one wheel, the oldest first."""
        diagnoses = self.sources.history.windows(*_wheel(request), limit=_limit(request))
        return _json(b"[" + b",".join(diagnosis.to_json() for diagnosis in diagnoses) + b"]")

    def estimates(self, request: Request) -> Response:
        """Answer with the latest estimates of one wheel, the oldest first."""
        estimates = self.sources.history.estimates(*_wheel(request), limit=_limit(request, MAX_ESTIMATES))
        return _json(b"[" + b",".join(estimate.to_json() for estimate in estimates) + b"]")

    def trend(self, request: Request) -> Response:
        """Answer with the trends of one wheel's estimates."""
        history = self.sources.history
        found = trends(history.estimates(*_wheel(request), limit=MAX_ESTIMATES), history.policy)
        return _json(b"[" + b",".join(trend.to_json() for trend in found) + b"]")

    def deeds(self, request: Request) -> Response:
        """Answer with who has put a wheel aside and brought it back, the oldest first."""
        lines = self.sources.history.wheel_list.lines(*_wheel(request))
        return _json(b"[" + b",".join(line.to_json() for line in lines) + b"]")

    async def put_aside(self, request: Request) -> Response:
        """Put a wheel aside that is not heard, or bring it back; needs the token."""
        who = await self._allowed(request, PuttingAside)
        name, aside = _wheel(request), self.sources.aside

        def change() -> WheelLine:
            if not who.aside:
                return aside.bring_back(*name, who.name, who.note)
            self._check_quiet(*name)
            return aside.put(*name, who.name, who.note)

        line = await run_in_threadpool(change)
        self.sources.voices.hub.post(aside_entry(line))
        return _json(line.to_json())

    def _check_quiet(self, spacecraft: str, wheel: str) -> None:
        """Refuse to put a wheel aside that nobody knows, or whose telemetry comes."""
        known = self.sources.fleet.wheel(spacecraft, wheel)
        if known is None:
            if (spacecraft, wheel) not in self.sources.history.wheels():
                raise HTTPException(404, "no such wheel")
            return
        with self.sources.fleet.lock:
            heard_ns, stale_after_s = known.rhythm.wall_ns, known.rhythm.stale_after_s
        if heard_ns is not None and time.time_ns() - heard_ns < stale_after_s * NANOSECONDS_PER_SECOND:
            reason = f"its telemetry is of now: it can be put aside when none has come for {stale_after_s:.0f} s"
            raise InputError(f"{spacecraft}/{wheel}", reason)

    def alarms(self, request: Request) -> Response:
        """Answer with all open alarms and the latest closed ones."""
        del request
        return _json(b"[" + b",".join(a.model_dump_json().encode() for a in self.sources.history.alarms()) + b"]")

    async def acknowledge(self, request: Request) -> Response:
        """Acknowledge an alarm; needs the token."""
        who = await self._allowed(request, Acknowledgement)
        history, number = self.sources.history, request.path_params["alarm"]
        return await self._change(lambda: history.acknowledge(number, who.name, who.note))

    async def shelve(self, request: Request) -> Response:
        """Shelve an alarm for a while; needs the token."""
        who = await self._allowed(request, Shelving)
        history, number = self.sources.history, request.path_params["alarm"]
        return await self._change(lambda: history.shelve(number, who.name, who.seconds, who.note))

    async def _allowed(self, request: Request, wanted: type[Wanted]) -> Wanted:
        """Return what a request wants changed; refuses it without the token, or where it is not understood."""
        given = request.headers.get("authorization", "")
        if not secrets.compare_digest(given.encode(), f"Bearer {self.sources.token}".encode()):
            raise HTTPException(401, "the token is missing or wrong; it is printed where the dashboard was started")
        body = b""
        async for piece in request.stream():
            body += piece
            if len(body) > MAX_BODY_BYTES:
                raise HTTPException(413, f"more than {MAX_BODY_BYTES} bytes")
        try:
            return wanted.model_validate_json(body)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            raise HTTPException(422, f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from error

    async def _change(self, work: Callable[[], AlarmRecord]) -> Response:
        """Change an alarm, and tell pages and bus of it."""

        def change() -> AlarmRecord:
            alarm = work()
            self.sources.voices.announce(alarm)
            return alarm

        alarm = await run_in_threadpool(change)
        return _json(alarm.to_json())

    def metrics(self, request: Request) -> Response:
        """Answer with all metrics, for Prometheus."""
        del request
        sources = self.sources
        alarms, aside = sources.history.alarms(closed=0), sources.aside.names()
        text = metrics(sources.fleet, alarms, len(sources.voices.hub.clients), aside)
        return Response(text, media_type=CONTENT_TYPE)

    def recordings(self, request: Request) -> Response:
        """Answer with the recordings there are."""
        del request
        return _json(dump_json([asdict(entry) for entry in list_recordings(self.sources.recordings)]))

    def recording(self, request: Request) -> Response:
        """Answer with one recording as entries of the feed."""
        return _json(replay_json(self.sources.recordings, request.path_params["name"]))

    async def feed(self, socket: WebSocket) -> None:
        """Serve one page until it leaves."""
        await socket.accept()
        client = Client()
        self.sources.voices.hub.clients.add(client)
        try:
            await socket.send_text(await self._first.get())
            await _until_first(_send(socket, client), _listen(socket, client))
        finally:
            self.sources.voices.hub.clients.discard(client)


class Shared:
    """Work for several who ask at once: whoever asks gets what was begun afterwards, and so misses nothing since."""

    def __init__(self, work: Callable[[], str]) -> None:
        self._work = work
        self._one_at_a_time = asyncio.Lock()
        self._next: asyncio.Task[str] | None = None

    async def get(self) -> str:
        """Return what the next run of the work gives."""
        if self._next is None:
            self._next = asyncio.create_task(self._run())
        return await asyncio.shield(self._next)

    async def _run(self) -> str:
        async with self._one_at_a_time:
            self._next = None  # who asks from now on waits for another one
            return await run_in_threadpool(self._work)


async def _send(socket: WebSocket, client: Client) -> None:
    while (text := await client.frames.get()) is not None:
        await socket.send_text(text)
    await socket.close(1013, "too slow")


async def _listen(socket: WebSocket, client: Client) -> None:
    """Take what the page asks for: {"watch": "spacecraft/wheel"}, of which it gets the samples."""
    while True:
        asked = await socket.receive_json()
        if isinstance(asked, dict):
            client.watches = str(asked.get("watch", ""))[:MAX_WATCH]


async def _until_first(*works: Any) -> None:
    """Run works until one of them ends; a page that has left is no error."""
    tasks = [asyncio.ensure_future(work) for work in works]
    await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in tasks:
        task.cancel()
        with suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError, ValueError):
            await task


def _wheel_json(
    samples: bytes, jumps: list[bytes], curves: list[bytes], discrepancy: bytes | None, status: bytes
) -> bytes:
    parts = [b'"samples":' + samples, b'"changepoints":[' + b",".join(jumps) + b"]"]
    parts += [b'"evidence":[' + b",".join(curves) + b"]", b'"discrepancy":' + (discrepancy or b"null")]
    parts.append(b'"status":' + status)
    return b"{" + b",".join(parts) + b"}"


def _wheel(request: Request) -> tuple[str, str]:
    return request.path_params["spacecraft"], request.path_params["wheel"]


def _limit(request: Request, most: int = MAX_WINDOWS) -> int:
    text = request.query_params.get("limit", "200")
    if not (text.isascii() and text.isdigit() and len(text) <= len(str(most)) and 1 <= int(text) <= most):
        raise HTTPException(422, f"limit: a number from 1 to {most}")
    return int(text)


def _json(content: bytes) -> Response:
    return Response(content, media_type="application/json")


async def _told(request: Request, error: Exception) -> Response:
    del request
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": error.detail}, error.status_code)


async def _refused(request: Request, error: Exception) -> Response:
    del request
    return JSONResponse({"error": str(error)}, 422)


async def _unavailable(request: Request, error: Exception) -> Response:
    del request
    return JSONResponse({"error": str(error)}, 503)
