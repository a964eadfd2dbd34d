"""The bridge: datagrams on a real socket in, samples on a real bus out, and everything else counted."""

import json
import signal
import socket
from collections.abc import Iterator
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest

from rwa_monitor.dashboard.space_packets import Bridge, UdpAddress, listening, run_bridge
from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.messages import PERIOD_S, SamplesMessage
from rwa_monitor.monitor.bus import BusOptions, open_session
from rwa_monitor.samples import CHANNELS, Samples, concatenate
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.telemetry.ccsds_packets import PacketDecoder
from rwa_monitor.wheel.wheel import built_in_wheel
from tests.monitor.processes import PATIENCE_S, Listener, free_udp, process, told_before, wait_for
from tests.monitor.support import free_port
from tests.telemetry import packets as made
from tests.telemetry.packet_writer import FIRST_APID, example_decoding, packets_of

KEYS = {f"rwa/sat/wheel_{number}/samples": CHANNELS for number in (1, 2)}


class Kept:
    """A sink that keeps what it gets."""

    def __init__(self) -> None:
        self.batches: list[Samples] = []
        self.closed = False

    def put(self, samples: Samples) -> None:
        self.batches.append(samples)

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def kept() -> dict[str, Kept]:
    return {key: Kept() for key in KEYS}


@pytest.fixture
def bridge(kept: dict[str, Kept]) -> Bridge:
    return Bridge(PacketDecoder(example_decoding(KEYS), "test"), kept, batch_samples=8)


# ---- batches ---------------------------------------------------------------------------------------------------------


def test_samples_go_out_in_batches_or_when_they_have_waited(bridge: Bridge, kept: dict[str, Kept]) -> None:
    one, two = kept.values()
    bridge.tick(100.0)
    for packet in packets_of(made.samples(19), FIRST_APID):
        bridge.take(packet)
    bridge.tick(99.9 + PERIOD_S)
    assert [len(batch) for batch in one.batches] == [8, 8]
    bridge.tick(100.0 + PERIOD_S)
    assert [len(batch) for batch in one.batches] == [8, 8, 3]
    bridge.take(next(packets_of(made.samples(1), FIRST_APID + 1)))
    assert two.batches == []
    bridge.send_all()
    assert [len(batch) for batch in two.batches] == [1]
    assert (bridge.counts()["samples"], bridge.counts()["decoded"]) == (20, 20)


def test_a_datagram_may_hold_several_packets(bridge: Bridge, kept: dict[str, Kept]) -> None:
    packets = made.packets(8)
    bridge.take(b"".join(packets))
    assert [len(batch) for batch in kept["rwa/sat/wheel_1/samples"].batches] == [8]
    assert bridge.counts()["datagrams"] == 1


@pytest.mark.parametrize(
    "datagram", [b"", b"\x00", b"\xff" * 65_507, made.packets(1)[0][:-1], b"GET / HTTP/1.1\r\n\r\n"]
)
def test_what_is_no_packet_is_counted_once(bridge: Bridge, datagram: bytes) -> None:
    bridge.take(datagram)
    counts = bridge.counts()
    assert (counts["datagrams"], counts["packets"], counts["samples"]) == (1, 1, 0)
    assert counts["bad"] + counts["unknown"] == 1
    logged: list[str] = []
    bridge.log_warnings(logged.append)
    assert len(logged) == 1


# ---- sockets ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["", "host", "1:2:x", "0", "65536", "-1", "²", "127.0.0.1:"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="no \\[HOST:\\]PORT"):
        UdpAddress.parse(text, "--udp")


def test_an_address_that_is_taken_or_is_none_is_reported() -> None:
    address = free_udp()
    with listening(address), pytest.raises(RwaMonitorError, match="cannot be listened on"), listening(address):
        pass
    with pytest.raises(RwaMonitorError, match="there is no such address"), listening(UdpAddress("300.1.2.3", 1)):
        pass


@pytest.fixture
def running(bridge: Bridge) -> Iterator[UdpAddress]:
    """Run the bridge in a thread on a real socket."""
    stop, log_lines = Event(), list[str]()
    with listening(UdpAddress("127.0.0.1", 0)) as receiver:
        thread = Thread(target=run_bridge, args=(bridge, receiver, stop, log_lines.append))
        thread.start()
        try:
            yield UdpAddress(*receiver.getsockname())
        finally:
            stop.set()
            thread.join(PATIENCE_S)
            assert not thread.is_alive()


def test_noise_on_the_socket_leaves_the_bridge_at_work(running: UdpAddress, bridge: Bridge) -> None:
    rng = np.random.default_rng(3)
    good = made.packets(64)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for number, packet in enumerate(good):
            spoiled = bytearray(packet)
            spoiled[rng.integers(len(spoiled))] ^= rng.integers(1, 256)
            for datagram in (bytes(spoiled), rng.bytes(rng.integers(0, 2_000)), packet):
                sender.sendto(datagram, (running.host, running.port))
            wait_for(lambda sent=3 * number + 3: bridge.datagrams >= sent, "datagrams")  # type: ignore[misc]
    counts = bridge.counts()
    assert counts["decoded"] >= len(good)
    assert counts["bad"] + counts["unknown"] >= len(good)
    assert counts["packets"] == sum(counts[name] for name in ("decoded", "bad", "unknown", "idle", "other"))


def described(folder: Path) -> tuple[Path, Path]:
    """Write the example's definition and a map of one wheel."""
    decoding = example_decoding({"rwa/sat/wheel_1/samples": CHANNELS})
    (folder / "map.toml").write_text(decoding.map.text)
    (folder / "wheel.xml").write_text(decoding.xtce.text)
    return folder / "wheel.xml", folder / "map.toml"


# ---- the program -----------------------------------------------------------------------------------------------------


@pytest.mark.processes
def test_only_loopback_is_listened_on_without_a_warning(tmp_path: Path) -> None:
    for host, warned in (("0.0.0.0:", True), ("", False)):
        xtce, telemetry_map = described(tmp_path)
        udp = f"{host}{free_udp().port}"
        lines = told_before("bridging UDP", "bridge", "--udp", udp, "--xtce", xtce, "--map", telemetry_map)
        assert any("takes packets from everybody who reaches it" in line for line in lines) == warned


@pytest.mark.processes
@pytest.mark.parametrize("data", [None, "stored"])
def test_from_simulated_packets_over_udp_to_the_bus(tmp_path: Path, data: str | None) -> None:
    """A socket → `bridge` → a subscriber: what is published is what was simulated."""
    sent = simulate(Scenario(duration_s=60.0), built_in_wheel(), np.random.default_rng(0)).samples
    xtce, telemetry_map = described(tmp_path)
    endpoint, address = f"tcp/127.0.0.1:{free_port()}", free_udp()
    udp = f"{address.host}:{address.port}"
    how = ("--xtce", xtce, "--map", telemetry_map, "--batch", "100", "-e", endpoint, *(["--stored"] if data else []))
    with (
        open_session(BusOptions(listen=(endpoint,))) as session,
        process("bridge", "--udp", udp, *how) as child,
    ):
        listener = Listener(session)
        assert f"bridging UDP 127.0.0.1 port {address.port}" in child.stderr.readline()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for packet in packets_of(sent, FIRST_APID):
                sender.sendto(packet, (address.host, address.port))
        wait_for(lambda: len(received(listener)) == 480, "all samples")
        child.send_signal(signal.SIGTERM)
        out, _ = child.communicate(timeout=60)
        read = received(listener)
    counts = json.loads(out)
    assert child.returncode == 0
    assert (counts["datagrams"], counts["decoded"], counts["samples"]) == (480, 480, 480)
    assert (counts["bad"], counts["gaps"]) == (0, 0)
    assert np.abs(read.time_ns - sent.time_ns).max() <= 30
    np.testing.assert_allclose(read.speed_rad_s, sent.speed_rad_s, atol=5.1e-6, rtol=0)
    assert {SamplesMessage.parse(payload, "test").data for payload in listener.kind("samples")} == {data}


def received(listener: Listener) -> Samples:
    parts = [SamplesMessage.parse(payload, "test").samples() for payload in listener.kind("samples")]
    return concatenate(parts) if parts else Samples(np.array([], dtype=np.int64), np.array([]))
