"""Foxglove live: a real WebSocket client subscribes, as the app does, and receives what the bus carries."""

import json
import re
import socket
import struct
import sys
from collections import deque
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
from rwa_monitor.reporting.foxglove import LOG_SCHEMA, LogLevel, schemas
from rwa_monitor.samples import NANOSECONDS_PER_SECOND
from tests.dashboard.support import WAIT_S, send_windows, status
from tests.history.support import diagnosis

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed: pip install 'rwa-monitor[foxglove]'")

pytestmark = pytest.mark.processes

MESSAGE_DATA = 1  # opcode of what the server sends for a subscription, before its id and the time
DATA_HEAD = struct.Struct("<BIQ")


class FoxgloveClient:
    """A client of Foxglove's protocol, on an open connection."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self._unread: deque[str | bytes] = deque()

    def channels_of(self, *topics: str) -> dict[str, dict[str, Any]]:
        """Wait until topics are advertised."""
        found: dict[str, dict[str, Any]] = {}
        while not found.keys() >= set(topics):
            content = self.connection.recv(timeout=WAIT_S)
            if isinstance(content, str) and (answer := json.loads(content))["op"] == "advertise":
                found |= {channel["topic"]: channel for channel in answer["channels"]}
        return found

    def subscribe(self, *channels: dict[str, Any]) -> None:
        """Subscribe to channels, in this order, and wait until the server has taken it.

        foxglove-sdk 0.30 announces a channel before it takes subscriptions to it (`advertise_channels` in its
        connected_client.rs), so who answers at once may be refused. It reports nothing of a subscription that it took,
        but warns of the second one to a channel: each is asked for until that warning comes.
        """
        for number, channel in enumerate(channels):
            wanted = json.dumps({"op": "subscribe", "subscriptions": [{"id": number, "channelId": channel["id"]}]})
            self.connection.send(wanted)
            status = ""
            while "already subscribed" not in status:
                self.connection.send(wanted)
                status = self._status_of(channel["id"])

    def received(self, number: int, time_ns: int) -> dict[str, Any]:
        """Return the content of the message of a subscription that has a time."""
        while True:
            content = self._unread.popleft() if self._unread else self.connection.recv(timeout=WAIT_S)
            if isinstance(content, bytes) and content[0] == MESSAGE_DATA:
                _, *which = DATA_HEAD.unpack_from(content)
                if which == [number, time_ns]:
                    answer: dict[str, Any] = json.loads(content[DATA_HEAD.size :])
                    return answer

    def _status_of(self, channel_id: int) -> str:
        """Return what the server next reports of a subscription to a channel; what else comes is kept for later."""
        while True:
            content = self.connection.recv(timeout=WAIT_S)
            answer = json.loads(content) if isinstance(content, str) else {}
            if answer.get("op") == "status" and re.search(rf"channel(?: ID)?: {channel_id}\b", answer["message"]):
                return str(answer["message"])
            self._unread.append(content)


@contextmanager
def foxglove_client(session: zenoh.Session, folder: Path, **options: Any) -> Iterator[FoxgloveClient]:
    """Connect to a dashboard that serves Foxglove."""
    lines: list[str] = []
    with serve(DashboardOptions(0, folder, foxglove=0, **options), session, lines.append):
        (address,) = [line.split()[-1] for line in lines if line.startswith("Foxglove connects to ws://127.0.0.1:")]
        with connect(address, subprotocols=[Subprotocol("foxglove.sdk.v1")], open_timeout=WAIT_S) as connection:
            yield FoxgloveClient(connection)


def test_a_client_gets_the_latest_diagnosis_and_then_each_new_one_with_its_schema(
    session: zenoh.Session, tmp_path: Path
) -> None:
    key = "rwa/sat/wheel_1"
    with foxglove_client(session, tmp_path) as client:
        send_windows(session, "wheel_1", failing=False, windows=1)
        channels = client.channels_of(f"{key}/diagnosis", f"{key}/log")
        channel = channels[f"{key}/diagnosis"]
        assert (channel["encoding"], channel["schemaName"]) == ("json", "rwa.Diagnosis")
        assert json.loads(channel["schema"]) == schemas()["rwa.Diagnosis"]
        assert channels[f"{key}/log"]["schemaName"] == LOG_SCHEMA
        client.subscribe(channels[f"{key}/log"], channel)
        first, second = diagnosis(0, wheel="wheel_1"), diagnosis(1, severity=1.0, wheel="wheel_1")
        assert client.received(1, first.window_end_ns) == json.loads(first.to_json())
        session.put(f"{key}/diagnosis", second.to_json())
        assert client.received(1, second.window_end_ns) == json.loads(second.to_json())
        line = client.received(0, second.window_end_ns)
        assert (line["level"], line["message"], line["name"]) == (4, second.reason, "sat/wheel_1")
        assert line["timestamp"]["sec"] == second.window_end_ns // NANOSECONDS_PER_SECOND


def test_a_monitor_that_does_not_report_is_a_line_of_the_log(session: zenoh.Session, tmp_path: Path) -> None:
    with foxglove_client(session, tmp_path, silent_s=1.0) as client:
        send_windows(session, "wheel_1", failing=False, windows=1)
        log = client.channels_of("rwa/sat/wheel_1/log")["rwa/sat/wheel_1/log"]
        client.subscribe(log)
        session.put("rwa/sat/wheel_1/status", status("wheel_1"))
        while not (line := client.received(0, diagnosis(0).window_end_ns))["message"].startswith("Alarm "):
            assert line["message"]  # of the diagnosis
        assert (line["message"], line["level"]) == ("Alarm monitor: warning, active.", LogLevel.WARNING)


def test_what_is_no_message_of_ours_stops_nothing(session: zenoh.Session, tmp_path: Path) -> None:
    with foxglove_client(session, tmp_path) as client:
        session.put("rwa/sat/wheel_1/diagnosis", b"{")
        session.put("rwa/sat/wheel_1/unknown", b"{}")
        send_windows(session, "wheel_1", failing=False, windows=1)
        found = client.channels_of("rwa/sat/wheel_1/diagnosis")
    assert "rwa/sat/wheel_1/unknown" not in found


def test_it_is_on_loopback_only_and_takes_nothing(session: zenoh.Session, tmp_path: Path) -> None:
    with foxglove_client(session, tmp_path) as client:
        answer = json.loads(client.connection.recv(timeout=WAIT_S))
        assert (answer["op"], answer["capabilities"]) == ("serverInfo", [])
        # Another address of this machine: whoever listens on all addresses listens there too.
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.2", client.connection.remote_address[1]), timeout=WAIT_S)


def test_a_port_that_is_taken_is_reported(session: zenoh.Session, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with (
            pytest.raises(RwaMonitorError, match=f"port {port} cannot be used: .*; --foxglove names another"),
            serve(DashboardOptions(0, tmp_path, foxglove=port), session),
        ):
            pass


def test_a_missing_sdk_is_reported(session: zenoh.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "rwa_monitor.dashboard.foxglove_server", raising=False)
    monkeypatch.setitem(sys.modules, "foxglove", None)  # as Python itself marks what cannot be imported
    with (
        pytest.raises(RwaMonitorError, match=r"foxglove is missing: pip install 'rwa-monitor\[foxglove\]'"),
        serve(DashboardOptions(0, tmp_path, foxglove=0), session),
    ):
        pass
