"""The Zenoh bus with secure defaults: no listening endpoint and no scouting unless configured.

Zenoh's callbacks run in threads of their own and only append to a bounded inbox, which one thread of the monitor
empties. When the inbox is full, a callback waits for room, so that reliable publishers slow down to the monitor's pace
and nothing is lost. If there is none for `TIMEOUT_S`, because the monitor is stalled, the message is dropped and
counted: a longer wait would close the connection, and lose more than one message without a count. Dropped messages are
requested again when the inbox is empty. Memory is bounded in any case.
"""

import heapq
import json
import math
import re
import secrets
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, closing, suppress
from itertools import accumulate
from operator import itemgetter
from pathlib import Path
from threading import Event, Thread
from typing import Any, Final, Literal, NamedTuple, Self, TypeVar

import zenoh
from zenoh import ext

from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.messages import MAX_MESSAGE_BYTES, PERIOD_S, EncodedMessage, SamplesMessage, samples_json
from rwa_monitor.monitor.backfill import Arrival, Backfill, Inbox, ask_publisher
from rwa_monitor.samples import MIN_TIME_NS, NANOSECONDS_PER_SECOND, Samples, Timeliness
from rwa_monitor.telemetry.files import MAX_DEPTH, read_text
from rwa_monitor.wheel.file_content import MAX_CONTENT_BYTES
from rwa_monitor.words import Log

# Messages of each publisher queried at a start. It must be set: without it the first live message ends Zenoh's wait for
# the history, which is discarded as older (seen in 1 of 8 starts while messages flow, Zenoh 1.10).
MAX_HISTORY: Final = 1_000_000
OUTPUT_HISTORY: Final = 100  # messages of each wheel and kind (diagnosis, changepoints, …) kept for late subscribers
ALL_SAMPLES: Final = "rwa/*/*/samples"  # spacecraft, wheel

# Settings that replace Zenoh's defaults. A value of the configuration file that differs from Zenoh's default takes
# precedence; shared memory and plug-ins stay off in any case.
_SECURE: Final[dict[str, Any]] = {
    "listen/endpoints": [],
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    # Reconnect within one second after a short outage, not within four: a publisher's history is limited.
    "connect/retry": {"period_init_ms": 200, "period_max_ms": 1_000, "period_increase_factor": 2.0},
    "transport/link/rx/max_message_size": 2 * MAX_MESSAGE_BYTES,
    # A subscriber that is stuck may block the monitor for one second [µs], not for five.
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,
}
_FIXED: Final[dict[str, Any]] = {
    # A killed publisher leaves its segment behind, and a read-only /dev/shm makes `open` fail.
    "transport/shared_memory/enabled": False,
    # Plug-ins run code from files that a configuration names.
    "plugins_loading/enabled": False,
}
_JSON5_STRING_OR_COMMENT: Final = re.compile(r"""//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'""", re.DOTALL)
# Protocol and address; those of an internet protocol name a port. Zenoh takes ?metadata and #config behind them.
_ENDPOINT: Final = re.compile(r"(?:tcp|udp|tls|quic|ws)/\S+:\d{1,5}(?:[?#]\S*)?|(?!tcp|udp|tls|quic|ws)[a-z0-9_-]+/\S+")


class BusOptions(NamedTuple):
    """The Zenoh options of the command line, under their usual names.

    Attributes
    ----------
    mode
        -m: peer, client or router. By default, a session that only connects is a client if a router answers: peers
        behind a router do not reach each other. If none answers yet it is a peer, which waits for one.
    connect, listen
        -e, -l: endpoints such as "tcp/127.0.0.1:7447". Without both: a bus inside the process, without a socket.
    config
        -c: a Zenoh configuration file; the other options change its settings.
    no_multicast_scouting
        Accepted because every Zenoh tool has it; scouting is off anyway unless the file turns it on.
    """

    mode: Literal["peer", "client", "router"] | None = None
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    config: Path | None = None
    no_multicast_scouting: bool = False


def session_config(options: BusOptions) -> zenoh.Config:
    """Return the Zenoh configuration of the options; raises InputError naming the option that is wrong."""
    config, default = zenoh.Config(), zenoh.Config()
    if options.config is not None:
        # Zenoh's own configuration has 8 levels; its parser overflows the stack at some ten thousand.
        if _depth(read_text(options.config, MAX_CONTENT_BYTES)) > MAX_DEPTH:
            reason = f"is no Zenoh configuration: it is nested deeper than {MAX_DEPTH} levels"
            raise InputError(str(options.config), reason)
        try:
            config = zenoh.Config.from_file(options.config)
        except zenoh.ZError as error:
            raise InputError(str(options.config), f"is no Zenoh configuration: {error}") from error
    settings = {key: value for key, value in _SECURE.items() if config.get_json(key) == default.get_json(key)}
    if options.no_multicast_scouting:
        settings["scouting/multicast/enabled"] = False
    if options.mode or config.get_json("mode") == "null":
        settings["mode"] = options.mode or "peer"
    for key, value in (settings | _FIXED).items():
        config.insert_json5(key, json.dumps(value))
    for kind, endpoints in (("connect", options.connect), ("listen", options.listen)):
        for endpoint in endpoints:
            if not _ENDPOINT.fullmatch(endpoint):
                reason = f"{endpoint!r} is no endpoint: write tcp/HOST:PORT, such as tcp/127.0.0.1:7447"
                raise InputError(f"--{kind}", reason)
        if endpoints:
            try:
                config.insert_json5(f"{kind}/endpoints", json.dumps(endpoints))
            except zenoh.ZError as error:
                raise InputError(f"--{kind}", f"{endpoints} is not understood: {_plain(error)}") from error
    return config


def _plain(error: zenoh.ZError) -> str:
    """Return Zenoh's error message without the locations in its source code."""
    return re.sub(r" at /\S+\.rs:\d+\.?", "", str(error))


def _depth(json5: str) -> int:
    """Return how deep a JSON5 text is nested; brackets in strings and comments do not count."""
    brackets = re.findall(r"[\[\]{}]", _JSON5_STRING_OR_COMMENT.sub("", json5))
    return max(accumulate((1 if bracket in "[{" else -1 for bracket in brackets), initial=0))


def open_session(options: BusOptions) -> zenoh.Session:
    """Open a Zenoh session; use it with `with`, as an open session keeps the process from ending.

    Raises
    ------
    InputError
        If an option or the configuration file is wrong.
    RwaMonitorError
        If the bus cannot be reached, or an address is taken.
    """
    config = session_config(options)
    if options.mode == "client" and not options.connect and options.config is None:
        raise InputError("--mode", "a client needs an endpoint to connect to (-e tcp/HOST:PORT)")
    zenoh.init_log_from_env_or("error")
    if options.mode is None and options.config is None and options.connect and not options.listen:
        with suppress(zenoh.ZError):  # no router answers: a peer can wait for one
            return zenoh.open(session_config(options._replace(mode="client")))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        where = ", ".join((*options.connect, *options.listen)) or str(options.config or "embedded")
        raise RwaMonitorError(f"the bus cannot be opened ({where}): {_plain(error)}") from error


# ---- subscriptions and publications of the monitor -------------------------------------------------------------------


def check_wheels(key_expression: str) -> None:
    """Raise InputError unless this key expression matches the key of some wheel's samples."""
    try:
        matches = zenoh.KeyExpr(key_expression).intersects(zenoh.KeyExpr(ALL_SAMPLES))
    except zenoh.ZError as error:
        raise InputError("--wheels", f"{key_expression!r} is no key expression: {error}") from error
    if not matches:
        raise InputError("--wheels", f"{key_expression!r} takes no samples: they come on {ALL_SAMPLES}")


def _subscriber(session: zenoh.Session, key_expression: str, inbox: Inbox) -> Any:
    """Subscribe to messages from now on, and to the earlier ones that their publishers still keep."""
    return ext.declare_advanced_subscriber(
        session,
        key_expression,
        inbox.receive,
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=MAX_HISTORY),
        recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
    )


def reliable_publisher(
    session: zenoh.Session, key: str, encoding: str, kept: int, *, repeats_number: bool = True
) -> Any:
    """Declare a publisher that keeps its last `kept` messages for late subscribers; its `undeclare` drops them.

    It sends the number of its last message periodically, or, without `repeats_number`, only when that changes. If that
    notice is lost (an outage, a subscriber about to join), so is the end of the stream until the next message.
    """
    return ext.declare_advanced_publisher(
        session,
        key,
        encoding=encoding,
        congestion_control=zenoh.CongestionControl.BLOCK,
        cache=ext.CacheConfig(max_samples=kept),
        sample_miss_detection=ext.MissDetectionConfig(
            heartbeat=PERIOD_S if repeats_number else None,
            sporadic_heartbeat=None if repeats_number else PERIOD_S,
        ),
        publisher_detection=True,
    )


class HealthAnswers:
    """Answers queries on rwa/**/health with the latest health of each wheel that this process published.

    A monitor publishes it when a window closes, and a dashboard when an alarm changes: every answer carries its
    publication time, and of several answers Zenoh passes on the latest.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._latest: dict[str, tuple[EncodedMessage, Any]] = {}
        self._queryable: Any = session.declare_queryable("rwa/**/health", self._on_query)

    def stamp(self, message: EncodedMessage) -> Any:
        """Keep a wheel's health for queries; returns the timestamp with which to publish it."""
        timestamp = self._session.new_timestamp()
        self._latest[message.topic] = message, timestamp
        return timestamp

    def close(self) -> None:
        """Answer no more queries, not even those that arrive after `undeclare`."""
        self._latest.clear()
        with suppress(zenoh.ZError):  # the session may have been closed already
            self._queryable.undeclare()

    def _on_query(self, query: zenoh.Query) -> None:
        """Answer one query; called in Zenoh's threads."""
        for key, (health, timestamp) in dict(self._latest).items():  # a copy: `stamp` may run meanwhile
            if query.key_expr.intersects(zenoh.KeyExpr(key)):
                query.reply(key, health.payload, encoding=health.encoding, timestamp=timestamp)
        query.drop()  # type: ignore[no-untyped-call]


class MonitorBus:
    """The monitor's use of a session: takes samples, publishes messages, answers queries about health.

    Parameters
    ----------
    session
        An open session; it is left open at the end.

    Attributes
    ----------
    inbox
        Where messages of samples arrive.
    backfill
        Closes the gaps in the messages of the inbox.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self.inbox = Inbox()
        self.backfill = Backfill(ask_publisher(session, self.inbox.wake), self.inbox.max_bytes)
        self._declared: list[Any] = []
        self._publishers: dict[str, Any] = {}
        self._health = HealthAnswers(session)

    def subscribe(self, key_expression: str) -> None:
        """Take samples from now on, and the earlier ones that their publishers still keep."""
        self._declared.append(_subscriber(self.session, key_expression, self.inbox))

    def take(self) -> Arrival | None:
        """Return the next message, None when there is none yet."""
        message = self.backfill.take(self.inbox.take)
        if message is None:  # dropped messages are requested again when there is nothing else to do
            for dropped in self.inbox.take_lost():
                self.backfill.miss(dropped)
        return message

    def waiting(self) -> int:
        """Count the messages that wait."""
        return len(self.inbox) + len(self.backfill)

    def show_alive(self) -> None:
        """Declare a liveliness token, which shows that the monitor is alive."""
        self._declared.append(self.session.liveliness().declare_token(f"rwa/@monitor/{self.session.zid()}/alive"))

    def publish(self, message: EncodedMessage) -> None:
        """Publish a message; all but `status` reliably and with a history for late subscribers."""
        key, kind = message.topic, message.topic.rpartition("/")[2]
        if key not in self._publishers:
            if kind == "status":
                self._publishers[key] = self.session.declare_publisher(key, encoding=message.encoding)
            else:
                kept = 1 if kind == "health" else OUTPUT_HISTORY
                self._publishers[key] = reliable_publisher(
                    self.session, key, message.encoding, kept, repeats_number=kind == "diagnosis"
                )
        timestamp = self._health.stamp(message) if kind == "health" else None
        self._publishers[key].put(message.payload, timestamp=timestamp)

    def close(self) -> None:
        """Undeclare everything; messages that still arrive are ignored."""
        self._health.close()
        self.inbox.close()
        for entity in [*reversed(self._declared), *self._publishers.values()]:
            with suppress(zenoh.ZError):  # the session may have been closed already
                entity.undeclare()
        self._declared.clear()
        self._publishers.clear()


# ---- connection watch ------------------------------------------------------------------------------------------------


class BusWatch:
    """Watches whether a session that was opened with endpoints to connect to is connected.

    Parameters
    ----------
    session
        An open session.
    options
        Those that it was opened with; without an endpoint to connect to, nothing is watched.

    Raises
    ------
    InputError
        As `session_config`.
    """

    def __init__(self, session: zenoh.Session, options: BusOptions) -> None:
        self._session = session
        wanted = json.loads(session_config(options).get_json("connect/endpoints"))
        if isinstance(wanted, dict):  # by mode
            wanted = [endpoint for of_mode in wanted.values() for endpoint in of_mode or ()]
        self._where = [str(endpoint) for endpoint in wanted or ()]
        self._logged = ""
        self._due_s = 0.0

    def trouble(self) -> str:
        """Return a sentence on what is wrong, "" where nothing is."""
        if not self._where:
            return ""
        try:
            info = self._session.info
            connected = any((*info.routers_zid(), *info.peers_zid()))
        except zenoh.ZError as error:
            return f"The bus is gone: {error}."
        where = " or ".join(self._where)
        return "" if connected else f"The bus is gone: there is no connection to {where}. Trying again."

    def log_changes(self, now_s: float, log: Log) -> None:
        """Check the connections if that is due; log each loss and each recovery of the bus once."""
        if now_s < self._due_s:
            return
        self._due_s = now_s + PERIOD_S
        trouble = self.trouble()
        if trouble != self._logged:
            log(trouble or "connected to the bus again")
        self._logged = trouble


# ---- a subscription with a thread of its own -------------------------------------------------------------------------


IDLE_WAIT_S: Final = 0.1  # between two checks of what is due by the clock


class BusThread:
    """Subscriptions and the one thread that processes their messages; use it with `with`.

    Messages that were published before are requested, too.

    Parameters
    ----------
    session
        An open Zenoh session; it is left open.
    name
        Of the thread.
    key_expressions
        What to subscribe to.
    """

    def __init__(self, session: zenoh.Session, name: str, *key_expressions: str) -> None:
        self._inbox = Inbox()
        self._stop = Event()
        self._thread = Thread(target=self._run, name=name, daemon=True)
        self._subscribers = [_subscriber(session, one, self._inbox) for one in key_expressions]

    def __enter__(self) -> Self:
        """Start the thread, which begins with the messages since the subscription."""
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Stop the thread, and wait for its end."""
        self._stop.set()
        self._inbox.close()
        for subscriber in self._subscribers:
            with suppress(zenoh.ZError):  # the session may have been closed already
                subscriber.undeclare()
        self._inbox.wake.set()
        self._thread.join()

    def receive(self, key: str, payload: bytes) -> None:
        """Process a message; the payload of an oversized one is cut one byte above the limit."""
        raise NotImplementedError

    def on_idle(self) -> None:
        """Do periodic work; called whenever the inbox is empty, and every `IDLE_WAIT_S` while it stays so."""

    def _run(self) -> None:
        while not self._stop.is_set():
            self._inbox.wake.clear()
            while not self._stop.is_set() and (message := self._inbox.take()) is not None:
                self.receive(message.key, message.payload)
            self.on_idle()
            self._inbox.wake.wait(IDLE_WAIT_S)


# ---- publishing telemetry as a satellite's computer does: reliably, numbered, with a history -------------------------


HISTORY_MESSAGES: Final = 8_192  # 3 days of one wheel at 8 Hz in messages of 256; some 120 MB if all are kept
Content = TypeVar("Content")


def messages_publisher(session: zenoh.Session, key: str, history: int = HISTORY_MESSAGES) -> Any:
    """Declare a publisher of messages of samples that keeps the last `history` of them for outages."""
    return reliable_publisher(session, key, SamplesMessage.encoding(), history)


class SamplesPublisher:
    """Numbers one wheel's samples and publishes them reliably, under a random name; `data` as in `SamplesMessage`."""

    def __init__(self, session: zenoh.Session, key: str, data: Timeliness | None = None) -> None:
        self.name = secrets.token_hex(8)
        self.data = data
        self.batch = 0
        self._publisher = messages_publisher(session, key)

    def put(self, samples: Samples) -> None:
        """Publish samples as the next message."""
        self._publisher.put(samples_json(samples, self.name, self.batch, self.data))
        self.batch += 1

    def close(self) -> None:
        """Leave the bus, and drop the history."""
        self._publisher.undeclare()


def send(
    session: zenoh.Session,
    telemetry: Mapping[str, Samples],
    *,
    speed: float = 1.0,
    batch_samples: int = 256,
    linger_s: float = PERIOD_S,
    stop: Event,
) -> int:
    """Publish samples of one or more wheels paced by their own timestamps.

    Parameters
    ----------
    session
        An open Zenoh session.
    telemetry
        Samples by bus key ("rwa/<spacecraft>/<wheel>/samples").
    speed
        Times faster than real time; `math.inf` for as fast as the bus takes it.
    batch_samples
        Largest number of samples in a message. A message is sent when its last sample is due.
    linger_s
        How long to stay on the bus afterwards [s]: closing right after the last message may lose it, as it is sent
        after `put` returns, and late subscribers get the history meanwhile.
    stop
        Ends it early when set.

    Returns
    -------
    int
        Samples sent.
    """
    sent = 0
    first_ns = min((int(samples.time_ns[0]) for samples in telemetry.values() if len(samples)), default=0)
    batches = (_batches(key, samples, batch_samples) for key, samples in telemetry.items())
    with ExitStack() as stack:
        publishers = {key: stack.enter_context(closing(SamplesPublisher(session, key))) for key in telemetry}
        for key, batch in paced(heapq.merge(*batches, key=itemgetter(0)), speed, stop, first_ns):
            publishers[key].put(batch)
            sent += len(batch)
        stop.wait(linger_s)
    return sent


def paced(
    messages: Iterable[tuple[int, str, Content]], speed: float, stop: Event, first_ns: int | None = None
) -> Iterator[tuple[str, Content]]:
    """Yield key and content of messages when they are due; the pace begins with `first_ns`, or the first of them."""
    begin_s = time.monotonic()
    for due_ns, key, content in messages:
        first_ns = due_ns if first_ns is None else first_ns
        due_s = begin_s + (due_ns - first_ns) / NANOSECONDS_PER_SECOND / speed
        if stop.wait(0.0 if math.isinf(speed) else max(0.0, due_s - time.monotonic())):
            return
        yield key, content


def _batches(key: str, samples: Samples, size: int) -> Iterator[tuple[int, str, Samples]]:
    """Cut a wheel's telemetry into messages: (time when it is due, that of the last sample; key; samples)."""
    due_ns = MIN_TIME_NS
    for start in range(0, len(samples), size):
        batch = samples[start : start + size]
        due_ns = max(due_ns, int(batch.time_ns[-1]))  # where the clock steps back, the order is kept
        yield due_ns, key, batch
