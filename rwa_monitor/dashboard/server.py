"""Runs the dashboard: bus, history and web server, in threads of their own."""

import re
import secrets
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Thread
from typing import Final, NamedTuple

import uvicorn
import zenoh

from rwa_monitor.dashboard.app import Api, create_app
from rwa_monitor.dashboard.feed import SILENT_S, AlarmNotifier, Listener
from rwa_monitor.dashboard.fleet import Fleet
from rwa_monitor.dashboard.recordings import latest_setup
from rwa_monitor.errors import InputError, RwaMonitorError, needs_extra
from rwa_monitor.history.store import History
from rwa_monitor.monitor.bus import BusOptions
from rwa_monitor.monitor.setup import Setup
from rwa_monitor.wheel.wheel import Wheel
from rwa_monitor.words import Log

HOST: Final = "127.0.0.1"
DEFAULT_PORT: Final = 8750
HISTORY_NAME: Final = "history.sqlite3"
SHUTDOWN_S: Final = 2


class DashboardOptions(NamedTuple):
    """Settings of the dashboard.

    Attributes
    ----------
    port
        On loopback; 0 for any free port; None for the default one, or any free port if that is taken.
    record
        Folder of the recordings.
    wheel
        Constants of the wheels, to derive friction from current; None for those of the latest recording in the folder,
        or else of the built-in wheel.
    bus
        Options that the session was opened with: the page shows if none of their endpoints can be reached.
    history
        URL of a PostgreSQL database for the history; None for a file in the folder.
    silent_s
        Silence from which a wheel's monitor raises an alarm [s]; 0 for none.
    foxglove
        Port on loopback that Foxglove connects to, 0 for any free one; None for no server.
    allow_origin
        Origin, "http://HOST:PORT", of other pages that may read; None for no other.
    token
        Required for changes; None for a random one.
    """

    port: int | None
    record: Path
    token: str | None = None
    wheel: Wheel | None = None
    bus: BusOptions = BusOptions()
    history: str | None = None
    silent_s: float = SILENT_S
    foxglove: int | None = None
    allow_origin: str | None = None

    @property
    def history_place(self) -> Path | str:
        """Where the history is kept."""
        return self.history or self.record / HISTORY_NAME


class Running(NamedTuple):
    """A running dashboard: its address without and with the token."""

    address: str
    address_with_token: str


@contextmanager
def serve(options: DashboardOptions, session: zenoh.Session, log: Log = print) -> Iterator[Running]:
    """Serve the dashboard while the context lasts.

    Raises
    ------
    RwaMonitorError
        If a port is taken, or foxglove-sdk is needed and not installed.
    InputError
        If the history cannot be opened, or the origin is not valid.
    """
    if options.allow_origin and not re.fullmatch(r"https?://[^/\s*]+", options.allow_origin):
        raise InputError("--allow-origin", f"{options.allow_origin!r} is no origin, such as http://127.0.0.1:8080")
    token = options.token or secrets.token_urlsafe(16)
    with ExitStack() as stack:
        history = stack.enter_context(History(options.history_place))
        fleet = Fleet(Setup(options.wheel) if options.wheel else latest_setup(options.record))
        listening = stack.enter_context(_socket(options.port))
        notifier = stack.enter_context(AlarmNotifier(session, history))
        app = create_app(Api(fleet, notifier, options.record), token, options.allow_origin)
        config = uvicorn.Config(
            app,
            log_level="error",
            ws="websockets-sansio",
            ws_max_size=4096,
            ws_per_message_deflate=False,  # on loopback compression costs more time than it saves
            timeout_graceful_shutdown=SHUTDOWN_S,
        )
        server = uvicorn.Server(config)
        thread = Thread(target=server.run, kwargs={"sockets": [listening]}, name="dashboard server", daemon=True)
        thread.start()
        stack.callback(thread.join)
        stack.callback(setattr, server, "should_exit", True)
        while not server.started and thread.is_alive():  # if the server cannot start, its thread ends at once
            thread.join(0.01)
        if not server.started:
            raise RwaMonitorError("the dashboard's server did not start")
        stack.enter_context(Listener(fleet, notifier, log, options.bus, options.silent_s))
        if options.foxglove is not None:
            with needs_extra("foxglove"):
                from rwa_monitor.dashboard.foxglove_server import FoxgloveServer  # noqa: PLC0415 - an extra of its own
            foxglove = stack.enter_context(FoxgloveServer(session, options.foxglove))
            log(f"Foxglove connects to {foxglove.address}")
        port = listening.getsockname()[1]
        if options.port is None and port != DEFAULT_PORT:
            log(f"port {DEFAULT_PORT} is taken by another program; the page is elsewhere")
        address = f"http://{HOST}:{port}/"
        yield Running(address, f"{address}#token={token}")


def _socket(port: int | None) -> socket.socket:
    # asyncio sends small answers at once (TCP_NODELAY), not after 40 ms, only if the socket is declared as TCP.
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, DEFAULT_PORT if port is None else port))
    except OSError as error:
        listening.close()
        if port is None:
            return _socket(0)
        raise RwaMonitorError(f"port {port} cannot be used: {error.strerror}; --port names another") from error
    return listening
