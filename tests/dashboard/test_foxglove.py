"""Foxglove live: a real WebSocket client subscribes, as the app does, and hears what the bus says."""

from __future__ import annotations

import json
import socket
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from rwa_monitor.dashboard.server import DashboardOptions, serve
from rwa_monitor.errors import RwaMonitorError
from rwa_monitor.formats.foxglove import LOG_SCHEMA, LogLevel, schemas
from rwa_monitor.samples import NANOSECONDS_PER_SECOND
from tests.dashboard.support import WAIT_S, send_windows
from tests.history.support import diagnosis

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed: pip install 'rwa-monitor[foxglove]'")

pytestmark = pytest.mark.processes

MESSAGE_DATA = 1  # opcode of what the server sends for a subscription, before its id and the time
DATA_HEAD = struct.Struct("<BIQ")


@contextmanager
def foxglove_client(session: zenoh.Session, folder: Path) -> Iterator[ClientConnection]:
    """Connect to a dashboard that serves Foxglove."""
    lines: list[str] = []
    with serve(DashboardOptions(0, folder, foxglove=0), session, lines.append):
        (address,) = [line.split()[-1] for line in lines if line.startswith("Foxglove connects to ws://127.0.0.1:")]
        with connect(address, subprotocols=[Subprotocol("foxglove.sdk.v1")], open_timeout=WAIT_S) as client:
            yield client


def channels_of(client: ClientConnection, *topics: str) -> dict[str, dict[str, Any]]:
    """Wait until topics are advertised."""
    found: dict[str, dict[str, Any]] = {}
    while not found.keys() >= set(topics):
        content = client.recv(timeout=WAIT_S)
        if isinstance(content, str) and (told := json.loads(content))["op"] == "advertise":
            found |= {channel["topic"]: channel for channel in told["channels"]}
    return found


def subscribe(client: ClientConnection, *channels: dict[str, Any]) -> None:
    """Subscribe to channels, in this order."""
    wanted = [{"id": number, "channelId": channel["id"]} for number, channel in enumerate(channels)]
    client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


def heard(client: ClientConnection, number: int, time_ns: int) -> dict[str, Any]:
    """Return the content of the message of a subscription that has a time."""
    while True:
        content = client.recv(timeout=WAIT_S)
        if isinstance(content, bytes) and content[0] == MESSAGE_DATA:
            _, *which = DATA_HEAD.unpack_from(content)
            if which == [number, time_ns]:
                told: dict[str, Any] = json.loads(content[DATA_HEAD.size :])
                return told


def test_a_client_gets_the_latest_diagnosis_and_then_each_new_one_with_its_schema(
    session: zenoh.Session, tmp_path: Path
) -> None:
    key = "rwa/sat/wheel_1"
    with foxglove_client(session, tmp_path) as client:
        send_windows(session, "wheel_1", failing=False, windows=1)
        channels = channels_of(client, f"{key}/diagnosis", f"{key}/log")
        channel = channels[f"{key}/diagnosis"]
        assert (channel["encoding"], channel["schemaName"]) == ("json", "rwa.Diagnosis")
        assert json.loads(channel["schema"]) == schemas()["rwa.Diagnosis"]
        assert channels[f"{key}/log"]["schemaName"] == LOG_SCHEMA
        # The log first: once the diagnosis is heard, both are subscribed to.
        subscribe(client, channels[f"{key}/log"], channel)
        first, second = diagnosis(0, wheel="wheel_1"), diagnosis(1, severity=1.0, wheel="wheel_1")
        assert heard(client, 1, first.window_end_ns) == json.loads(first.to_json())
        session.put(f"{key}/diagnosis", second.to_json())
        assert heard(client, 1, second.window_end_ns) == json.loads(second.to_json())
        line = heard(client, 0, second.window_end_ns)
        assert (line["level"], line["message"], line["name"]) == (4, second.reason, "sat/wheel_1")
        assert line["timestamp"]["sec"] == second.window_end_ns // NANOSECONDS_PER_SECOND


def test_an_alarm_is_a_line_of_the_log(session: zenoh.Session, tmp_path: Path) -> None:
    key = "rwa/sat/wheel_1"
    with foxglove_client(session, tmp_path) as client:
        send_windows(session, "wheel_1", failing=False, windows=1)
        channels = channels_of(client, f"{key}/diagnosis", f"{key}/log")
        subscribe(client, channels[f"{key}/log"], channels[f"{key}/diagnosis"])
        heard(client, 1, diagnosis(0, wheel="wheel_1").window_end_ns)
        send_windows(session, "wheel_1", failing=True)
        last_ns = diagnosis(2, severity=1.0, wheel="wheel_1").window_end_ns
        while not (line := heard(client, 0, last_ns))["message"].startswith("Alarm "):
            assert line["message"]  # of the diagnosis, which comes before
        assert line["message"].endswith(": warning, active.")
        assert line["level"] == LogLevel.WARNING


def test_what_is_no_message_of_ours_stops_nothing(session: zenoh.Session, tmp_path: Path) -> None:
    with foxglove_client(session, tmp_path) as client:
        session.put("rwa/sat/wheel_1/diagnosis", b"{")
        session.put("rwa/sat/wheel_1/unknown", b"{}")
        send_windows(session, "wheel_1", failing=False, windows=1)
        found = channels_of(client, "rwa/sat/wheel_1/diagnosis")
    assert "rwa/sat/wheel_1/unknown" not in found


def test_it_is_on_loopback_only_and_takes_nothing(session: zenoh.Session, tmp_path: Path) -> None:
    with foxglove_client(session, tmp_path) as client:
        told = json.loads(client.recv(timeout=WAIT_S))
        assert (told["op"], told["capabilities"]) == ("serverInfo", [])
        # Another address of this machine: whoever listens on all addresses listens there too.
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.2", client.remote_address[1]), timeout=WAIT_S)


def test_a_port_that_is_taken_is_said(session: zenoh.Session, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with (
            pytest.raises(RwaMonitorError, match=f"port {port} cannot be used: .*; --foxglove names another"),
            serve(DashboardOptions(0, tmp_path, foxglove=port), session),
        ):
            pass


def test_a_missing_sdk_is_said(session: zenoh.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "rwa_monitor.dashboard.foxglove_server", raising=False)
    monkeypatch.setitem(sys.modules, "foxglove", None)  # as Python itself marks what cannot be imported
    with (
        pytest.raises(RwaMonitorError, match=r"foxglove is missing: pip install 'rwa-monitor\[foxglove\]'"),
        serve(DashboardOptions(0, tmp_path, foxglove=0), session),
    ):
        pass
