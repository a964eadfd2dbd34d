"""What a supervisor receives from the monitor: readiness, signs of life that stop when the core stalls, exit codes."""

import os
import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any

import pytest
import zenoh

from rwa_monitor.errors import InputError
from rwa_monitor.messages import samples_json
from rwa_monitor.monitor.bus import BusOptions, open_session
from rwa_monitor.monitor.recorder import locked
from rwa_monitor.monitor.service import Supervisor, run
from tests.monitor.processes import Listener, options, process, wait_for, wait_until_it_monitors
from tests.monitor.support import KEY, free_port, telemetry
from tests.program import command

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
        try:
            while True:
                self.received.append(self.socket.recv(4_096).decode())
        except TimeoutError:
            return self.received

    def signs_during(self, seconds: float) -> int:
        """Count signs of life from now on, for a while."""
        self.listen()
        before = self.received.count("WATCHDOG=1")
        Event().wait(seconds)
        return self.listen().count("WATCHDOG=1") - before


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
    with process("run", "--wheel", wheel_file, "-l", endpoint) as child:
        wait_until_it_monitors(child)
        wait_for(lambda: "WATCHDOG=1" in ear.listen(), "a sign of life")
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


def test_signs_of_life_stop_when_the_core_stalls_although_the_process_lives(ear: Ear) -> None:
    stop, stalls, goes_on = Event(), Event(), Event()

    def log(line: str) -> None:
        """Stall as a terminal does whose reader has stopped reading."""
        if "missing: 1 message of 'p'" in line:
            stalls.set()
            goes_on.wait(60.0)

    with open_session(BusOptions()) as session:
        listener = Listener(session)
        arguments: dict[str, Any] = {"session": session, "log": log, "supervisor": Supervisor(ear.environment)}
        thread = Thread(target=run, args=(options(), stop), kwargs=arguments)
        thread.start()
        try:
            wait_for(lambda: "WATCHDOG=1" in ear.listen(), "a sign of life")
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
            signs = ear.listen().count("WATCHDOG=1")
            wait_for(lambda: ear.listen().count("WATCHDOG=1") > signs, "a sign of life")
        finally:
            goes_on.set()
            stop.set()
            thread.join(60.0)
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
        with process("run", "--wheel", wheel_file, "-e", endpoint) as child:
            wait_until_it_monitors(child)
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
