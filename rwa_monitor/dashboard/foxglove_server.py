"""Serves messages of the bus live to Foxglove, by foxglove-sdk, on the topics that `rwa-monitor foxglove` writes."""

from typing import Final

import foxglove
import zenoh
from foxglove import Channel, Context, Schema
from foxglove.websocket import ChannelView, Client, ServerListener

from rwa_monitor.dashboard.fleet import KEYS
from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.messages import EncodedMessage, dump_json
from rwa_monitor.monitor.bus import BusThread
from rwa_monitor.reporting.foxglove import LOG_SCHEMA, Translator, schemas
from rwa_monitor.words import SOFTWARE

HOST: Final = "127.0.0.1"
MAX_TOPICS: Final = 50_000  # further ones are not shown; a thousand wheels have some ten thousand
BACKLOG: Final = 16_384  # messages queued for a slow client; a batch of telemetry is some hundred


class FoxgloveServer(BusThread, ServerListener):
    """Serves Foxglove on loopback. It only sends: data from clients is not used.

    A client that subscribes to a topic gets its latest message at once, as diagnoses come minutes or hours apart.

    Parameters
    ----------
    session
        An open Zenoh session; it is left open.
    port
        On loopback; 0 for any free port.

    Raises
    ------
    RwaMonitorError
        If the port is taken.
    """

    def __init__(self, session: zenoh.Session, port: int) -> None:
        self._context = Context()
        self._schemas = {
            name: Schema(name=name, encoding="jsonschema", data=dump_json(schema)) for name, schema in schemas().items()
        }
        self._latest: dict[str, tuple[Channel, EncodedMessage]] = {}  # by topic; used from several threads
        try:
            self._server = foxglove.start_server(
                name=SOFTWARE,
                host=HOST,
                port=port,
                server_listener=self,
                context=self._context,
                message_backlog_size=BACKLOG,
            )
        except (OSError, RuntimeError) as error:
            raise RwaMonitorError(f"port {port} cannot be used: {error}; --foxglove names another") from error
        self._translator = Translator()
        super().__init__(session, "foxglove server", KEYS)

    @property
    def address(self) -> str:
        """The address that Foxglove connects to."""
        return f"ws://{HOST}:{self._server.port}"

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        self._server.stop()

    def receive(self, key: str, payload: bytes) -> None:
        try:
            views = self._translator.translate(key, payload)
        except InputError:
            return
        for view in views:
            self._show(view)

    def _show(self, view: EncodedMessage) -> None:
        if view.topic in self._latest:
            channel, _ = self._latest[view.topic]
        elif len(self._latest) < MAX_TOPICS:
            schema = self._schemas[view.schema]
            channel = Channel(view.topic, schema=schema, message_encoding="json", context=self._context)
        else:
            return
        self._latest[view.topic] = channel, view
        channel.log(view.payload, log_time=view.time_ns)

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Send a topic's latest message again; called in the server's threads.

        It goes to all clients of the topic, as the SDK cannot address the new one. A repeated value is harmless; lines
        of the log would appear twice, and are not repeated.
        """
        del client
        kept = self._latest.get(channel.topic)
        if kept is not None and kept[1].schema != LOG_SCHEMA:
            kept[0].log(kept[1].payload, log_time=kept[1].time_ns)
