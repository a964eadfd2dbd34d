"""CCSDS space packets (133.0-B-2) over UDP: verdicts and alarms are sent, telemetry is received for the bus.

One list of fields defines both the packets that are sent and their XTCE definition.
Each wheel has an APID of its own, and two kinds of packets: the diagnosis of a window, and the states of all its alarms
whenever one changes. A text that is too long is cut, an unknown number is NaN, and a part or an alarm that the
definition does not name is left out; the highest level of such alarms is reported as `other`.

The memory of the bridge is bounded: a datagram is at most 64 kB, a wheel's samples wait for a batch or for `PERIOD_S`,
and only the wheels of the map are served. Datagrams that arrive faster than they are read are dropped by the operating
system: the packets' sequence count reveals it.
"""

from __future__ import annotations

import math
import re
import socket
import struct
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from functools import cache, partial
from operator import attrgetter
from threading import Event
from typing import Any, Final, NamedTuple, Self, get_args

import zenoh

from rwa_monitor.diagnosis.findings import DRY_UNIT, VISCOUS_UNIT
from rwa_monitor.diagnosis.model import Model, models_for
from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.history.alarms import BOUNDS, MODEL_ALARM, MONITOR_ALARM, WINDOW_POLICY, Level
from rwa_monitor.messages import LOG_PERIOD_S, PERIOD_S, AlarmLevel, AlarmPhase, Diagnosis, Health, Verdict, split_key
from rwa_monitor.monitor.bus import IDLE_WAIT_S, OUTPUT_HISTORY, BusThread, SamplesPublisher
from rwa_monitor.samples import NANOSECONDS_PER_SECOND
from rwa_monitor.telemetry.ccsds_packets import (
    HEADER,
    SEQUENCE_MODULUS,
    UNSEGMENTED,
    PacketDecoder,
    packet_notes,
    split_packets,
)
from rwa_monitor.telemetry.reader import MAX_APID
from rwa_monitor.wheel.wheel import Wheel
from rwa_monitor.words import SOFTWARE, Log, counted

SECONDARY: Final = struct.Struct(">IHB")  # after the primary header: seconds, fraction [2⁻¹⁶ s], kind
TEXT_BYTES: Final = 256
OTHER: Final = "other"  # alarms that have no name in the definition
KINDS: Final[Mapping[str, type[Diagnosis | Health]]] = {"diagnosis": Diagnosis, "alarms": Health}
ENUMERATIONS: Final[Mapping[str, tuple[str, ...]]] = {
    "Kind": tuple(KINDS),
    "Verdict": get_args(Verdict),
    "Part": ("not_judged", "none", "open", "may_be_active", "active"),
    "Model": ("fits", "lacks_something"),
    "Data": ("live", "stored"),
    "Level": get_args(AlarmLevel),
    "Phase": get_args(AlarmPhase),
}
# Label → XTCE's level of concern; that of one window is a watch at most, that of an alarm is the alarm's level.
CONCERN: Final = {level: level for level in get_args(AlarmLevel)[1:]} | dict.fromkeys(
    ("anomalous", "active", "lacks_something"), "watch"
)


class Field(NamedTuple):
    """A parameter of a packet: its name, the name of its type in the definition, its value in a message."""

    name: str
    type: str
    value: Callable[[Any], Any]

    def packed(self, message: Diagnosis | Health) -> bytes:
        """Return the value in the form of the packet."""
        value = self.value(message)
        if self.type == "Text":
            text = value.encode()[: TEXT_BYTES - 1].decode(errors="ignore")  # no incomplete character at the end
            return struct.pack(f"{TEXT_BYTES}s", text.encode())
        if self.type in ENUMERATIONS:
            return struct.pack("B", ENUMERATIONS[self.type].index(value))
        return struct.pack(">d", math.nan if value is None else value)


class Packet(NamedTuple):
    """One kind of packet of one wheel."""

    wheel: str
    apid: int
    kind: str
    fields: list[Field]


def _diagnosis_fields(parts: Sequence[str]) -> list[Field]:
    """Return the fields of a diagnosis packet, for a wheel with these possible anomalies."""

    def of_part(part: str, what: str, one: Diagnosis) -> Any:
        return getattr(one.anomalies[part], what) if part in one.anomalies else None

    def state(part: str, one: Diagnosis) -> str:
        if of_part(part, "nominal_low", one) is None:
            return "not_judged"
        if of_part(part, "active", one):
            return "active" if one.verdict == "anomalous" else "may_be_active"
        return "none" if one.verdict != "inconclusive" and one.model_adequate else "open"

    estimates = {"dry": "Dry", "viscous": "Viscous"}
    fields = [
        Field("WHEEL", "Text", lambda one: f"{one.spacecraft}/{one.wheel}"),
        Field("VERDICT", "Verdict", attrgetter("verdict")),
        Field("REASON", "Text", attrgetter("reason")),
        Field("MODEL", "Model", lambda one: "fits" if one.model_adequate else "lacks_something"),
        Field("DATA", "Data", lambda one: one.data or "live"),
        Field("COVERAGE", "Number", attrgetter("coverage")),
    ]
    for part in parts:
        fields += [
            Field(f"{part}_STATE", "Part", partial(state, part)),
            Field(f"{part}_PROBABILITY", "Number", partial(of_part, part, "probability")),
            Field(f"{part}_SEVERITY", "Number", partial(of_part, part, "severity")),
            Field(f"{part}_ESTIMATE", estimates.get(part, "Torque"), partial(of_part, part, "estimate")),
        ]
    return fields


def _alarm_fields(names: Sequence[str]) -> list[Field]:
    """Return the fields of an alarm packet: level and phase of each of these alarms, and of the worst other one."""

    def of(name: str, what: str, health: Health) -> str:
        states = health.alarm_states or {}
        chosen = [state for one, state in states.items() if one == name or (name == OTHER and one not in names)]
        worst = max(chosen, key=lambda state: Level[state.level.upper()], default=None)
        return str(getattr(worst, what)) if worst else {"level": "normal", "phase": "quiet"}[what]

    return [
        Field(f"ALARM_{name}_{what.upper()}", what.capitalize(), partial(of, name, what))
        for name in (*names, OTHER)
        for what in ("level", "phase")
    ]


class PacketWriter:
    """Makes packets of the messages of some wheels, and the definition of these packets.

    Parameters
    ----------
    wheels
        "SPACECRAFT/WHEEL" of each, in the order of their APIDs.
    apid
        Of the first wheel.
    wheel, model
        The wheel file and the classifiers that the wheels are diagnosed with: they determine the possible anomalies and
        the nominal ranges.

    Raises
    ------
    InputError
        If a name is not valid, two parameters would have the same name, or there are too few APIDs.
    """

    def __init__(self, wheels: Sequence[str], apid: int, wheel: Wheel, model: Model | None) -> None:
        if apid + len(wheels) - 1 > MAX_APID:
            raise InputError("--apid", f"{len(wheels)} wheels from {apid} on need APIDs above {MAX_APID}, the last one")
        self._wheel, self._model = wheel, model
        parts = wheel.anomalies
        alarms = _alarm_fields((*parts, MODEL_ALARM, MONITOR_ALARM))
        fields = {"diagnosis": _diagnosis_fields(parts), "alarms": alarms}
        self._packets: dict[str, Packet] = {}  # by the key of the message
        for number, name in enumerate(wheels):
            for kind, message in KINDS.items():
                key = f"rwa/{name}/{message.kind}"
                split_key(key)
                prefix = re.sub(r"[^A-Za-z0-9_@+~-]", "_", name)  # characters that XTCE allows in a name
                named = [field._replace(name=re.sub(r"[./:\[\]\s]", "_", field.name)) for field in fields[kind]]
                self._packets[key] = Packet(prefix, apid + number, kind, named)
        counts = Counter(f"{one.wheel}_{field.name}" for one in self._packets.values() for field in one.fields)
        name, count = counts.most_common(1)[0]
        if count > 1 or len(self._packets) < len(KINDS) * len(wheels):
            raise InputError(name, "would name two parameters: give each wheel once, no two alike but for their dots")
        self._sequence: Counter[int] = Counter()
        kept = {"diagnosis": OUTPUT_HISTORY, "alarms": 1}  # alarms may return to an earlier state
        self._recent = {key: deque[int](maxlen=kept[one.kind]) for key, one in self._packets.items()}

    def definition(self) -> str:
        """Return the XTCE definition of all packets."""
        import jinja2  # noqa: PLC0415 - sending does not need it, and a monitor alone does not install it

        numbers = {
            "Number": ("", ()),
            "Torque": (DRY_UNIT, ()),
            "Dry": (DRY_UNIT, self._ranges(0)),
            "Viscous": (VISCOUS_UNIT, self._ranges(1)),
        }
        known = {"software": SOFTWARE, "text_bytes": TEXT_BYTES, "windows": WINDOW_POLICY.k, "concern": CONCERN}
        environment = jinja2.Environment(
            loader=jinja2.PackageLoader(__package__, ""), autoescape=True, undefined=jinja2.StrictUndefined
        )
        return environment.get_template("space_packets.xtce.xml.jinja").render(
            known, enumerations=ENUMERATIONS, numbers=numbers, packets=self._packets.values()
        )

    def _ranges(self, part: int) -> list[tuple[str, float, float]]:
        """Return level, lower and upper bound of the ranges of dry or viscous friction outside which a level begins."""
        learned, nominal = models_for(self._wheel, self._model)[part], self._wheel.nominal
        if learned is None or nominal is None or (levels := learned.levels[0]) is None:
            return []
        step = levels.severity_unit
        bounds = [(0.0, Level.WATCH), *(BOUNDS if step else ())]
        unit = (nominal.dry_torque_Nm, nominal.viscous_Nm_s_rad)[part]
        low = unit * levels.nominal_low  # values below it are a watch at most: the template uses it for that level only
        return [(level.word, low, unit * (levels.nominal_high + size * (step or 0.0))) for size, level in bounds]

    def take(self, key: str, payload: bytes) -> bytes | None:
        """Return a message's packet; None if it is of another wheel, was sent already, or has no states of alarms.

        Raises
        ------
        InputError
            If the message cannot be parsed, or its time does not fit into a packet.
        """
        if key not in self._packets:
            return None
        _, apid, kind, fields = self._packets[key]
        message = KINDS[kind].parse(payload, key)
        if isinstance(message, Health) and message.alarm_states is None:
            return None
        seconds, rest_ns = divmod(message.window_end_ns, NANOSECONDS_PER_SECOND)
        if not 0 <= seconds < 2**32:
            raise InputError(key, f"is {seconds} s; the time of a packet is 0 to {2**32 - 1} s", "window_end_ns")
        head = SECONDARY.pack(seconds, rest_ns * 2**16 // NANOSECONDS_PER_SECOND, [*KINDS].index(kind))
        content = head + b"".join(field.packed(message) for field in fields)
        if hash(content) in self._recent[key]:  # the bus may deliver a message more than once
            return None
        self._recent[key].append(hash(content))
        count = self._sequence[apid] % SEQUENCE_MODULUS
        self._sequence[apid] += 1
        has_secondary = 1 << 11
        return HEADER.pack(has_secondary | apid, UNSEGMENTED * SEQUENCE_MODULUS | count, len(content) - 1) + content


class PacketSender(BusThread):
    """Sends a packet for each diagnosis, and each change of alarms, on the bus; use it with `with`.

    Parameters
    ----------
    session
        An open Zenoh session; it is left open.
    writer
        Makes the packets.
    address
        Where packets are sent.
    log
        Called with each line of the log, once for equal lines.

    Attributes
    ----------
    packets
        How many were sent.

    Raises
    ------
    RwaMonitorError
        If there is no such address.
    """

    def __init__(self, session: zenoh.Session, writer: PacketWriter, address: UdpAddress, log: Log) -> None:
        self.packets = 0
        self._session, self._writer, self._log = session, writer, cache(log)
        self._socket, self._place = address.open()
        super().__init__(session, "space packets", *(f"rwa/*/*/{message.kind}" for message in KINDS.values()))

    def __enter__(self) -> Self:
        # Query the current alarms: a dashboard publishes changes only, and a monitor's answers have no alarms.
        for reply in self._session.get("rwa/**/health", consolidation=zenoh.ConsolidationMode.NONE):
            if reply.ok is not None:
                self.receive(str(reply.ok.key_expr), reply.ok.payload.to_bytes())
        return super().__enter__()

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        self._socket.close()

    def receive(self, key: str, payload: bytes) -> None:
        """Send the packet of a message, if there is one."""
        try:
            packet = self._writer.take(key, payload)
            if packet is not None:
                self._socket.sendto(packet, self._place)
                self.packets += 1
        except (InputError, OSError) as error:
            self._log(f"a packet is not sent: {error}")


# ---- telemetry from packets to the bus -------------------------------------------------------------------------------


MAX_DATAGRAM_BYTES: Final = 65_535  # the largest value of UDP's length field
RECEIVE_BUFFER_BYTES: Final = 4 * 2**20  # requested; the system may grant less


class UdpAddress(NamedTuple):
    """Address that datagrams are received on, or sent to."""

    host: str
    port: int

    @classmethod
    def parse(cls, text: str, option: str) -> UdpAddress:
        """Parse [HOST:]PORT; the host is 127.0.0.1 by default, an IPv6 address is in brackets."""
        host, _, port = text.rpartition(":")
        if not port.isascii() or not port.isdecimal() or not 0 < int(port) < 2**16:
            raise InputError(option, f"{text!r} is no [HOST:]PORT such as 127.0.0.1:5005")
        return cls(host.removeprefix("[").removesuffix("]") or "127.0.0.1", int(port))

    def open(self) -> tuple[socket.socket, Any]:
        """Return a socket for the address, and its resolved form; RwaMonitorError if it cannot be resolved."""
        try:
            family, kind, protocol, _, place = socket.getaddrinfo(*self, type=socket.SOCK_DGRAM)[0]
        except OSError as error:
            raise RwaMonitorError(f"{self.host}: there is no such address: {error.strerror or error}") from error
        return socket.socket(family, kind, protocol), place


@contextmanager
def listening(address: UdpAddress) -> Iterator[socket.socket]:
    """Open a socket that receives datagrams at an address; raises RwaMonitorError if that is not possible."""
    receiver, place = address.open()
    with receiver:
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        receiver.settimeout(IDLE_WAIT_S)
        try:
            receiver.bind(place)
        except OSError as error:
            where = f"{address.host} port {address.port}"
            raise RwaMonitorError(f"{where} cannot be listened on: {error.strerror or error}") from error
        yield receiver


class Bridge:
    """Converts datagrams to batches of samples and publishes them.

    Parameters
    ----------
    decoder
        Decodes the packets.
    sinks
        Publishers of each wheel's samples, by key.
    batch_samples
        Samples from which a message is sent.

    Attributes
    ----------
    datagrams, samples
        Datagrams received, samples published.
    """

    def __init__(self, decoder: PacketDecoder, sinks: Mapping[str, SamplesPublisher], batch_samples: int) -> None:
        self.datagrams = 0
        self.samples = 0
        self._decoder = decoder
        self._sinks = sinks
        self._batch_samples = batch_samples
        self._sent_s = -math.inf

    def take(self, datagram: bytes) -> None:
        """Process a datagram of one or several successive packets."""
        self.datagrams += 1
        packets = list(split_packets(datagram))
        rest = datagram[sum(map(len, packets)) :]
        if rest or not datagram:
            packets.append(rest)  # an incomplete packet: the decoder counts it as such
        for packet in packets:
            self._decoder.take(packet)
            self.send_all(self._batch_samples)

    def tick(self, now_s: float) -> None:
        """Send the waiting samples every `PERIOD_S`."""
        if now_s - self._sent_s >= PERIOD_S:
            self._sent_s = now_s
            self.send_all()

    def send_all(self, least: int = 1) -> None:
        """Send the waiting samples of all wheels that have at least so many."""
        for wheel in self._decoder.wheels:
            if len(wheel) >= least:
                samples = wheel.samples()
                self._sinks[wheel.map.key].put(samples)
                self.samples += len(samples)

    def counts(self) -> dict[str, Any]:
        """Return the counts of datagrams, packets and samples so far, for JSON."""
        counts = asdict(self._decoder.counts)
        counts["unknown_apids"] = sorted(counts["unknown_apids"])
        return {"datagrams": self.datagrams, **counts, "samples": self.samples}

    def log_warnings(self, log: Log) -> None:
        """Log what has been left out or is missing so far."""
        counts = self._decoder.counts
        if counts.bad:
            log(f"{counted(counts.bad, 'packet')} cannot be read, the first: {counts.first_bad}")
        for note in packet_notes(counts):
            log(note)


def run_bridge(
    bridge: Bridge,
    receiver: socket.socket,
    stop: Event,
    log: Log,
    on_tick: Callable[[float], None] = lambda _: None,
) -> None:
    """Process the datagrams of a socket until stopped; what is left out is logged, equal lines once.

    `on_tick` is called with the time of a monotonic clock [s], several times a second.
    """
    log, next_warnings_s = cache(log), 0.0
    while not stop.is_set():
        with suppress(TimeoutError):
            bridge.take(receiver.recv(MAX_DATAGRAM_BYTES))
        now_s = time.monotonic()
        bridge.tick(now_s)
        on_tick(now_s)
        if now_s >= next_warnings_s:
            next_warnings_s = now_s + LOG_PERIOD_S
            bridge.log_warnings(log)
    bridge.send_all()
    bridge.log_warnings(log)
