"""The bridge from space packets to the bus: UDP datagrams in, samples of wheels out.

Bounded in all it keeps: a datagram is at most 64 kB, a wheel's samples wait for a batch or for `PERIOD_S`, wheels are
those of the map. What comes faster than it is read, the system drops: the packets' sequence count shows it.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from threading import Event
from typing import Any, Final, NamedTuple

from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.messages import LOG_PERIOD_S, PERIOD_S
from rwa_monitor.monitor.bus import IDLE_WAIT_S, SamplesPublisher
from rwa_monitor.telemetry.ccsds_packets import PacketDecoder, WheelPackets, packet_notes, split_packets
from rwa_monitor.words import Log, counted

MAX_DATAGRAM_BYTES: Final = 65_535  # what UDP's length field can hold
RECEIVE_BUFFER_BYTES: Final = 4 * 2**20  # asked for; the system may give less


class UdpAddress(NamedTuple):
    """Where datagrams come in, or go to."""

    host: str
    port: int

    @classmethod
    def parse(cls, text: str, option: str) -> UdpAddress:
        """Read [HOST:]PORT; the host is 127.0.0.1 by default, and an IPv6 address stands in brackets."""
        host, _, port = text.rpartition(":")
        if not port.isascii() or not port.isdecimal() or not 0 < int(port) < 2**16:
            raise InputError(option, f"{text!r} is no [HOST:]PORT such as 127.0.0.1:5005")
        return cls(host.removeprefix("[").removesuffix("]") or "127.0.0.1", int(port))

    def open(self) -> tuple[socket.socket, Any]:
        """Return a socket for it, and it as the socket takes it; raises RwaMonitorError if there is none such."""
        try:
            family, kind, protocol, _, place = socket.getaddrinfo(*self, type=socket.SOCK_DGRAM)[0]
        except OSError as error:
            raise RwaMonitorError(f"{self.host}: there is no such address: {error.strerror or error}") from error
        return socket.socket(family, kind, protocol), place


@contextmanager
def listening(address: UdpAddress) -> Iterator[socket.socket]:
    """Give a socket that receives what is sent to an address; raises RwaMonitorError if that cannot be had."""
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
    """Turns datagrams into batches of samples and hands them on.

    Parameters
    ----------
    decoder
        Reads the packets.
    sinks
        Where each wheel's samples go, by key.
    batch_samples
        Samples of one message at most.

    Attributes
    ----------
    datagrams, samples
        How many came in, how many went out.
    """

    def __init__(self, decoder: PacketDecoder, sinks: Mapping[str, SamplesPublisher], batch_samples: int) -> None:
        self.datagrams = 0
        self.samples = 0
        self._decoder = decoder
        self._sinks = sinks
        self._batch_samples = batch_samples
        self._sent_s = float("-inf")

    def take(self, datagram: bytes) -> None:
        """Take a datagram of one packet or several, one after the other."""
        self.datagrams += 1
        packets = list(split_packets(datagram))
        rest = datagram[sum(map(len, packets)) :]
        if rest or not datagram:
            packets.append(rest)  # no whole packet: the decoder counts it as such
        for packet in packets:
            for wheel in self._decoder.take(packet):
                if len(wheel) >= self._batch_samples:
                    self._send(wheel)

    def tick(self, now_s: float) -> None:
        """Send what waits, each `PERIOD_S`."""
        if now_s - self._sent_s >= PERIOD_S:
            self._sent_s = now_s
            self.send_all()

    def send_all(self) -> None:
        """Send all that waits."""
        for wheel in self._decoder.wheels:
            if len(wheel):
                self._send(wheel)

    def _send(self, wheel: WheelPackets) -> None:
        samples = wheel.samples()
        self._sinks[wheel.key].put(samples)
        self.samples += len(samples)

    def counts(self) -> dict[str, Any]:
        """Return what became of everything so far, as JSON has it."""
        counts = asdict(self._decoder.counts)
        counts["unknown_apids"] = sorted(counts["unknown_apids"])
        return {"datagrams": self.datagrams, **counts, "samples": self.samples}

    def warnings(self) -> list[str]:
        """Return what was left out and what is missing so far."""
        counts = self._decoder.counts
        bad = [f"{counted(counts.bad, 'packet')} cannot be read, the first: {counts.first_bad}"] if counts.bad else []
        return [*bad, *packet_notes(counts)]


def run_bridge(
    bridge: Bridge,
    receiver: socket.socket,
    stop: Event,
    log: Log,
    on_tick: Callable[[float], None] = lambda _: None,
) -> None:
    """Hand on what a socket receives until stopped; what is left out is logged, each line once.

    `on_tick` is called with the time of a clock that only goes forward [s], many times a second.
    """
    logged: set[str] = set()

    def log_warnings() -> None:
        for line in bridge.warnings():
            if line not in logged:
                log(line)
                logged.add(line)

    next_warnings_s = 0.0
    while not stop.is_set():
        with suppress(TimeoutError):
            bridge.take(receiver.recv(MAX_DATAGRAM_BYTES))
        now_s = time.monotonic()
        bridge.tick(now_s)
        on_tick(now_s)
        if now_s >= next_warnings_s:
            next_warnings_s = now_s + LOG_PERIOD_S
            log_warnings()
    bridge.send_all()
    log_warnings()
