"""The service as a whole: real Zenoh, real files, real processes."""

import json
import math
import os
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest
import zenoh

from rwa_monitor import __version__
from rwa_monitor.errors import InputError
from rwa_monitor.messages import Diagnosis, SamplesMessage, health_message, samples_json
from rwa_monitor.monitor.backfill import Arrival, Inbox
from rwa_monitor.monitor.bus import BusOptions, SamplesPublisher, open_session
from rwa_monitor.monitor.recorder import locked
from rwa_monitor.monitor.recording import read_chain
from rwa_monitor.monitor.replay import replay
from rwa_monitor.monitor.service import Supervisor
from rwa_monitor.samples import Samples
from rwa_monitor.telemetry.table import read_table
from rwa_monitor.words import SOFTWARE
from tests.monitor.processes import (
    PATIENCE_S,
    Listener,
    monitor,
    options,
    process,
    put_pieces,
    wait_for,
)
from tests.monitor.support import (
    KEY,
    WINDOW,
    adds_up,
    batch_diagnoses,
    free_port,
    publish,
    recorded,
    spoiled,
    telemetry,
    wheel,
)
from tests.program import command, done

STOP_S = 2.0  # the promise
SLACK = 5.0


def statuses(listener: Listener) -> dict[str, dict[str, Any]]:
    """Return the last status of each wheel."""
    return {status["wheel"]: status for status in map(json.loads, listener.kind("status"))}


# ---- in one process, on an embedded bus ------------------------------------------------------------------------------


def test_an_embedded_monitor_gives_the_diagnoses_of_the_batch_and_its_recording_replays(
    session: zenoh.Session, listener: Listener, tmp_path: Path
) -> None:
    telemetries = {f"rwa/sat/wheel_{n}/samples": spoiled(telemetry(3 * WINDOW, n), n) for n in (1, 2)}
    with monitor(session, options(record=tmp_path)) as log_lines:
        sent = publish(telemetries, session, speed=math.inf, linger_s=0.0)
        wait_for(lambda: len(listener.kind("diagnosis")) >= 4, "four diagnoses")
        replies = {reply.ok.payload.to_bytes() for reply in session.get("rwa/**/health")}
        wait_for(lambda: sum(s["samples_received"] for s in statuses(listener).values()) == sent, "all samples")
    assert sent == sum(len(samples) for samples in telemetries.values())
    assert all(adds_up(status) for status in statuses(listener).values())
    published = [Diagnosis.parse(payload, "diagnosis") for payload in listener.kind("diagnosis")]
    assert listener.kind("health") == [health_message(one).to_json() for one in published]
    latest_of = {one.wheel: health_message(one).to_json() for one in published}
    assert (set(latest_of), replies) == ({"wheel_1", "wheel_2"}, set(latest_of.values()))
    first = [payload for payload in listener.kind("diagnosis") if b'"wheel":"wheel_1"' in payload]
    assert first == batch_diagnoses(telemetries[KEY], wheel())
    report = replay(tmp_path)
    assert report.equal, report.long()
    assert report.bytes_equal
    assert report.compared["rwa.Diagnosis"] == 4
    reported = [line for line in log_lines if line.startswith("sat/wheel_1: ")]
    verdicts = [json.loads(payload)["verdict"] for payload in first]
    assert len(reported) == 1 + sum(before != after for before, after in pairwise(verdicts))  # news only
    assert f": {verdicts[0]}: {json.loads(first[0])['reason']}" in reported[0]
    assert log_lines[-1] == "stopped: 4 windows of 2 wheels diagnosed"
    settings = [recording.settings() for recording in read_chain(tmp_path)]
    assert {(one["software"], one["build"]) for one in settings} == {(SOFTWARE, __version__)}


def test_a_bus_that_is_gone_is_reported_once_and_so_is_its_return() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    bus = BusOptions(connect=(endpoint,))
    with open_session(bus) as session, monitor(session, options(bus=bus)) as log_lines:
        wait_for(lambda: any("The bus is gone" in line for line in log_lines), "the line that the bus is gone")
        with open_session(BusOptions(listen=(endpoint,))):
            wait_for(lambda: "connected to the bus again" in log_lines, "the line that it is back")
            reported = list(log_lines)  # before it is gone once more
    assert sum(endpoint in line for line in reported) == 1


BAD = (b"", b"\x00\xff", b"[]", b'{"time_ns":[1],"speed_rad_s":["fast"],"friction_torque_Nm":[1.0]}')


def test_bad_messages_are_counted_recorded_and_change_nothing(
    session: zenoh.Session, listener: Listener, tmp_path: Path
) -> None:
    samples = telemetry(2 * WINDOW + 1)
    with monitor(session, options(record=tmp_path)):
        publisher = SamplesPublisher(session, KEY)
        for start in range(0, len(samples), 100):
            publisher.put(samples[start : start + 100])
            session.put(KEY, BAD[start // 100 % len(BAD)], congestion_control=zenoh.CongestionControl.BLOCK)
        wait_for(lambda: len(listener.kind("diagnosis")) >= 2, "both windows")
        wait_for(lambda: listener.status().get("messages_rejected") == 21, "all bad messages")
        publisher.close()
    assert listener.status()["last_error"]
    assert listener.kind("diagnosis") == batch_diagnoses(samples, wheel())
    refused = recorded(tmp_path, "rwa.Refused")
    assert sorted(refused) == sorted(BAD[number % len(BAD)] for number in range(21))
    assert replay(tmp_path).bytes_equal


def test_what_is_damaged_on_its_way_is_asked_for_again(
    session: zenoh.Session, listener: Listener, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    samples, damaged = telemetry(2 * WINDOW + 1), {1, 4, 5, 9}

    put = Inbox.put

    def arrives(inbox: Inbox, arrival: Arrival) -> None:
        """Give a message the beginning of another one for its end, as Zenoh 1.10 does now and then."""
        if arrival.number in damaged:
            arrival = arrival._replace(payload=arrival.payload[:-300] + b"\x91" + arrival.payload[:299])
        put(inbox, arrival)

    monkeypatch.setattr(Inbox, "put", arrives)
    with monitor(session, options(record=tmp_path)):
        publisher = put_pieces(SamplesPublisher(session, KEY), samples, 100)
        wait_for(lambda: len(listener.kind("diagnosis")) >= 2, "both windows")
        wait_for(lambda: listener.status().get("samples_received") == len(samples), "all samples")
        publisher.close()
    status = listener.status()
    assert (status["samples_used"], status["messages_rejected"], status["messages_missed"]) == (len(samples), 0, 0)
    assert status["last_error"] is None
    assert listener.kind("diagnosis") == batch_diagnoses(samples, wheel())
    assert replay(tmp_path).bytes_equal


def test_a_sensor_that_jumps_again_and_again_is_reported_once_a_window(
    session: zenoh.Session, listener: Listener
) -> None:
    samples = telemetry(2 * WINDOW + 100)
    friction = samples.friction_torque_Nm.copy()
    friction[40::20] *= 40.0
    with monitor(session, options()) as log_lines:
        publish({KEY: replace(samples, friction_torque_Nm=friction)}, session, speed=math.inf, linger_s=0.0)
        wait_for(lambda: len(listener.kind("diagnosis")) == 2, "two diagnoses")
        wait_for(lambda: listener.status().get("samples_masked", 0) > 2 * WINDOW // 20 - 10, "the masked samples")
        assert "stands out" in listener.status()["last_error"]
    assert adds_up(listener.status())
    assert 2 <= sum("stands out" in line for line in log_lines) <= 3


def test_a_wheel_that_cannot_be_served_is_reported_in_its_status(session: zenoh.Session, listener: Listener) -> None:
    samples = Samples(np.arange(50) * 125_000_000, np.ones(50))
    with monitor(session, options()) as log_lines:
        publish({KEY: samples}, session, speed=math.inf, batch_samples=10, linger_s=0.0)
        wait_for(lambda: listener.status().get("messages_rejected") == 5, "five refusals")
    assert sum("friction_torque_Nm is missing" in line for line in log_lines) == 1  # once


BY_KEYS = [{"wheels": key} for key in ("rwa/one/*/samples", "rwa/two/*/samples", "rwa/three/w1/samples")]
BY_SHARDS = [{"shard": (1, 2)}, {"shard": (2, 2)}]


@pytest.mark.parametrize(("parts", "left_out"), [(BY_KEYS, {"three/w2"}), (BY_SHARDS, set())], ids=["keys", "shards"])
def test_monitors_apart_by_keys_or_shards_serve_each_wheel_once_and_no_other(
    parts: list[dict[str, Any]], left_out: set[str], session: zenoh.Session, listener: Listener
) -> None:
    samples = telemetry(WINDOW + 20)
    names = {f"{spacecraft}/{wheel}" for spacecraft in ("one", "two", "three") for wheel in ("w1", "w2")}
    with ExitStack() as monitors:
        logs = [monitors.enter_context(monitor(session, options(**part))) for part in parts]
        publish({f"rwa/{name}/samples": samples for name in names}, session, speed=math.inf, linger_s=0.0)
        served = sorted(f"rwa/{name}/diagnosis" for name in names - left_out)
        wait_for(lambda: len(listener.kind("diagnosis")) >= len(served), "a window of each wheel")
    assert sorted(key for key, _ in listener.received if key.endswith("/diagnosis")) == served
    assert not any(f"{name}/status" in key for name in left_out for key, _ in listener.received)
    assert [log for log in logs if log[-1].startswith("stopped: 0 ")] == []  # each has its part


# ---- in processes of their own, over TCP on loopback -----------------------------------------------------------------


@pytest.mark.processes
def test_two_processes_over_tcp_give_the_diagnoses_of_the_batch(tmp_path: Path, wheel_file: Path) -> None:
    """Of two wheels that are published at once, the second one with the next seed."""
    scenario, folder = tmp_path / "scenario.toml", tmp_path / "recordings"
    scenario.write_text(f"[scenario]\nduration_s = {(2 * WINDOW + 300) * 0.125}\n")
    same = ("--scenario", scenario, "--wheel", wheel_file)
    endpoint, pair = f"tcp/127.0.0.1:{free_port()}", ("--key", "rwa/sat/wheel_{n}/samples", "--count", 2)
    running = ("run", "--wheel", wheel_file, "--record", folder, "--shard", "1/1", "-l", endpoint)
    with process(*running, until="monitoring") as child:
        sent = done("simulate", "publish", *same, "--seed", 5, *pair, "--speed", "inf", "-e", endpoint)
        assert "on rwa/sat/wheel_1/samples … rwa/sat/wheel_2/samples" in sent.stderr
        with open_session(BusOptions(mode="client", connect=(endpoint,))) as session:
            wait_for(lambda: _windows_told(session) == 4, "both windows of each wheel")
        child.send_signal(signal.SIGTERM)
        assert child.wait(PATIENCE_S) == 0
    (recording,) = read_chain(folder)
    assert recording.finished
    for seed, name in ((5, "wheel_1"), (6, "wheel_2")):
        table = tmp_path / f"{name}.parquet"
        assert done("simulate", "recording", *same, "--seed", seed, "-o", table).returncode == 0
        assert recorded(folder, name=name) == batch_diagnoses(read_table(table).samples, wheel(), name=name)
    assert replay(folder).bytes_equal


def _windows_told(session: zenoh.Session) -> int:
    answers = [reply.ok for reply in session.get("rwa/**/health") if reply.ok is not None]
    ends = [json.loads(answer.payload.to_bytes())["window_end_ns"] for answer in answers]
    return sum(ends) // (WINDOW * 125_000_000)


@pytest.mark.processes
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_stops_at_once_while_data_flows(tmp_path: Path, wheel_file: Path, number: signal.Signals) -> None:
    endpoint, folder = f"tcp/127.0.0.1:{free_port()}", tmp_path / "recordings"
    samples = telemetry(400 * 256)
    payloads = [samples_json(samples[256 * batch : 256 * (batch + 1)], "load", batch) for batch in range(400)]
    with (
        open_session(BusOptions(listen=(endpoint,))) as session,
        process("run", "--wheel", wheel_file, "--record", folder, "-e", endpoint, until="monitoring") as child,
    ):
        done = Event()

        def load() -> None:
            flood = session.declare_publisher(KEY, encoding=SamplesMessage.encoding())
            while not done.is_set():
                for payload in payloads:
                    flood.put(payload)
                    if done.is_set():
                        break
            flood.undeclare()

        listener = Listener(session)
        thread = Thread(target=load)
        thread.start()
        try:
            wait_for(lambda: len(listener.kind("diagnosis")) >= 1, "a diagnosis under load")
            begin_s = time.monotonic()
            child.send_signal(number)
            status = child.wait(PATIENCE_S)
            took_s = time.monotonic() - begin_s
        finally:
            done.set()
            thread.join()
    assert status == 0
    assert took_s < SLACK * STOP_S
    assert replay(folder).bytes_equal


# ---- what a supervisor receives from the monitor ---------------------------------------------------------------------


SILENCE_S = 0.9  # WATCHDOG_USEC of these tests; a sign of life comes every third of it
QUIET_S = 1.5


class Ear:
    """A datagram socket as systemd has one."""

    def __init__(self, path: Path) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(path))
        self.socket.settimeout(0.05)
        self.environment = {"NOTIFY_SOCKET": str(path), "WATCHDOG_USEC": str(round(SILENCE_S * 1e6))}
        self.received: list[str] = []

    def listen(self) -> list[str]:
        """Take what has arrived, and return all that did so far."""
        with suppress(TimeoutError):
            while True:
                self.received.append(self.socket.recv(4_096).decode())
        return self.received

    def signs(self) -> int:
        """Count the signs of life so far."""
        return self.listen().count("WATCHDOG=1")

    def signs_during(self, seconds: float) -> int:
        """Count signs of life from now on, for a while."""
        before = self.signs()
        Event().wait(seconds)
        return self.signs() - before


@contextmanager
def standing_still(child: subprocess.Popen[str]) -> Iterator[None]:
    """Stop all threads of a process for a while; what it sent before has arrived by then."""
    child.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, child.pid, os.WSTOPPED | os.WNOWAIT)
    try:
        yield
    finally:
        child.send_signal(signal.SIGCONT)


@pytest.fixture
def ear(tmp_path: Path) -> Iterator[Ear]:
    made = Ear(tmp_path / "notify")
    yield made
    made.socket.close()


@pytest.mark.processes
def test_a_supervisor_gets_notice_of_a_start_a_standstill_and_a_stop(
    ear: Ear, wheel_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in ear.environment.items():
        monkeypatch.setenv(name, value)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with process("run", "--wheel", wheel_file, "-l", endpoint, until="monitoring") as child:
        wait_for(ear.signs, "a sign of life")
        assert ear.received[0].startswith("READY=1\nSTATUS=monitoring")
        with standing_still(child):
            assert ear.signs_during(QUIET_S) == 0
            before = len(ear.received)
        wait_for(lambda: len(ear.listen()) > before, "a sign of life after the standstill")
        with standing_still(child):
            child.send_signal(signal.SIGTERM)
            ear.listen()  # a socket holds ten words: there is room for the last one
        assert child.wait(60.0) == 0
    assert ear.listen()[-1] == "STOPPING=1"


def test_signs_of_life_stop_when_the_core_stalls_although_the_process_lives(
    ear: Ear, session: zenoh.Session, listener: Listener
) -> None:
    stalls, goes_on = Event(), Event()

    def log(line: str) -> None:
        """Stall as a terminal does whose reader has stopped reading."""
        if "missing: 1 message of 'p'" in line:
            stalls.set()
            goes_on.wait(60.0)

    with monitor(session, options(), log, supervisor=Supervisor(ear.environment)):
        wait_for(ear.signs, "a sign of life")
        samples = telemetry(900)
        for number in (0, 2, 3, 4, 5, 6, 7):  # number 1 is given up
            session.put(KEY, samples_json(samples[100 * number : 100 * number + 100], "p", number))
        assert stalls.wait(60.0)
        session.put("rwa/test/stalled/mark", b"")  # by then all has arrived that was published before it
        wait_for(lambda: bool(listener.kind("mark")), "what was published before")
        statuses = len(listener.kind("status"))
        assert ear.signs_during(QUIET_S) == 0
        assert len(listener.kind("status")) == statuses
        assert _tokens(session) == 1  # the process is there
        goes_on.set()
        wait_for(lambda: len(listener.kind("status")) > statuses, "a status")
        signs = ear.signs()
        wait_for(lambda: ear.signs() > signs, "a sign of life")
    assert _tokens(session) == 0


def _tokens(session: zenoh.Session) -> int:
    return sum(reply.ok is not None for reply in session.liveliness().get("rwa/@monitor/*/alive"))


@pytest.mark.processes
def test_the_token_of_a_killed_monitor_goes(wheel_file: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_session(BusOptions(listen=(endpoint,))) as session:
        received: list[zenoh.SampleKind] = []
        _subscriber = session.liveliness().declare_subscriber(
            "rwa/@monitor/*/alive", lambda sample: received.append(sample.kind)
        )
        with process("run", "--wheel", wheel_file, "-e", endpoint, until="monitoring") as child:
            wait_for(lambda: received == [zenoh.SampleKind.PUT], "the token")
            child.kill()
            wait_for(lambda: len(received) == 2, "the token to go")
    assert received == [zenoh.SampleKind.PUT, zenoh.SampleKind.DELETE]


def test_no_supervisor_is_no_error(tmp_path: Path) -> None:
    for environment in (
        {},
        {"NOTIFY_SOCKET": str(tmp_path / "nobody"), "WATCHDOG_USEC": "1000000"},
        {"NOTIFY_SOCKET": "@rwa-monitor-nobody", "WATCHDOG_USEC": "soon"},
    ):
        supervisor = Supervisor(environment)
        supervisor.ready("test")
        supervisor.alive(0.0)
        supervisor.stopping()
    assert Supervisor({"NOTIFY_SOCKET": "/x", "WATCHDOG_USEC": "9000000"}).period_s == 3.0
    assert Supervisor({"NOTIFY_SOCKET": "/x", "WATCHDOG_USEC": "9", "WATCHDOG_PID": "1"}).period_s is None


def test_a_file_is_touched_by_each_sign_of_life_and_by_nothing_else(tmp_path: Path) -> None:
    file = tmp_path / "alive"
    supervisor = Supervisor({}, file)
    assert not file.exists()  # a monitor that still starts is not alive yet
    supervisor.ready("test")
    for now_s, touched in ((0.0, True), (0.9, False), (1.0, True), (60.0, True)):
        os.utime(file, (0.0, 0.0))
        supervisor.alive(now_s)
        assert (file.stat().st_mtime > 0.0) == touched
    with pytest.raises(InputError, match="cannot be touched: No such file"):
        Supervisor({}, tmp_path / "nowhere" / "alive").ready("test")


# ---- exit codes ------------------------------------------------------------------------------------------------------


@pytest.mark.processes
def test_a_supervisor_can_distinguish_what_to_repeat_from_what_to_mend(tmp_path: Path) -> None:
    """Exit code 1: the world may be better next time. 2: somebody must change a file or an option first."""
    broken = tmp_path / "broken.toml"
    broken.write_text("[wheel]\nname = 1\n")
    with socket.create_server(("127.0.0.1", 0)) as listening, locked(tmp_path / "taken"):
        taken_port = listening.getsockname()[1]
        cases = {
            ("-m", "client", "-e", f"tcp/127.0.0.1:{free_port()}"): 1,  # nobody there
            ("-l", f"tcp/127.0.0.1:{taken_port}"): 1,  # the address is taken
            ("--wheel", broken): 2,
            ("--record", tmp_path / "taken"): 2,
            ("--wheels", "rwa/**/**/"): 2,
        }
        children = {
            arguments: subprocess.Popen(
                command("run", *arguments), stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
            )
            for arguments in cases
        }
        for arguments, child in children.items():
            _, log_lines = child.communicate(timeout=100.0)
            assert child.returncode == cases[arguments], (arguments, log_lines)
            assert "Traceback" not in log_lines
