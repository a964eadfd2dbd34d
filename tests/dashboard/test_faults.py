"""What can go wrong around the page, for real: it shows what, recovers by itself, and nothing acknowledged is lost."""

import json
import signal
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import zenoh

from rwa_monitor.dashboard import fleet
from rwa_monitor.dashboard.server import HISTORY_NAME, DashboardOptions, Running, serve
from rwa_monitor.history.alarms import MONITOR_ALARM
from rwa_monitor.messages import samples_json
from rwa_monitor.monitor.bus import BusOptions, open_session
from tests.dashboard.support import START_S, ask, expect, press, reporting, send_windows
from tests.dashboard.test_recordings import RECORDING
from tests.dashboard.test_telemetry import with_friction
from tests.monitor.processes import ROUTER, Listener, process, script, wait_for
from tests.monitor.support import free_port

pytestmark = [pytest.mark.browser, pytest.mark.processes]

LOCK = """
import sqlite3, sys
connection = sqlite3.connect(sys.argv[1], isolation_level=None)
connection.execute("BEGIN IMMEDIATE")
print("locked", flush=True)
sys.stdin.read()
"""


def test_a_monitor_that_is_killed_leaves_stale_wheels_and_an_alarm_until_it_is_back(page: Any, tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    options = DashboardOptions(free_port(), tmp_path, token="right", silent_s=8.0)
    batch = samples_json(with_friction(40), "satellite", 0)
    with ExitStack() as stack:
        session = stack.enter_context(open_session(BusOptions(listen=(endpoint,))))

        listener = Listener(session)

        # The monitor is there some seconds after its start; what is sent without a history before that is lost.
        def reports() -> bool:
            session.put("rwa/sat/wheel_1/samples", batch)
            return bool(listener.kind("status"))

        def send_until_reported() -> None:
            def known() -> bool:
                session.put("rwa/sat/wheel_1/samples", batch)
                return "1 of 1 wheel reporting" in page.get_by_role("status").all_inner_texts()[-1]

            wait_for(known, "the monitor", START_S)

        def monitor_alarm(address: str) -> dict[str, Any] | None:
            found = [alarm for alarm in ask(address, "api/alarms")[1] if alarm["name"] == MONITOR_ALARM]
            return found[0] if found else None

        child = stack.enter_context(process("run", "-e", endpoint))
        wait_for(reports, "the monitor", START_S)  # its start may take longer than it may then be silent
        with serve(options, session) as running:
            page.goto(running.address_with_token)
            send_until_reported()
            page.locator(".wheel").click()
            expect(page.get_by_text("✓ reporting")).to_be_visible()
            assert monitor_alarm(running.address) is None
            child.send_signal(signal.SIGKILL)
            expect(page.locator(".stale-note")).to_contain_text("stale: monitor reported")
            expect(page.get_by_text("✓ reporting")).to_have_count(0)
            page.goto(f"{running.address}#/")
            expect(page.locator(".wheel")).to_contain_text("◌ stale")
            expect(page.locator(".wheel")).to_contain_text("◐ warning")
            page.get_by_role("link", name="Alarms (1)").click()
            expect(page.get_by_text("No monitor has reported since")).to_be_visible()
            expect(page.get_by_text("look whether rwa-monitor run still runs")).to_be_visible()
            press(page, "Acknowledge")
            expect(page.get_by_text("Acknowledged by Ann")).to_be_visible()
            page.goto("about:blank")  # else it complains of a server that is not there, if it tries in between
        with serve(options, session) as running:  # what was raised outlives the dashboard
            alarm = monitor_alarm(running.address)
            assert (alarm["phase"], alarm["closed_ns"]) == ("acknowledged", None)
            page.goto(f"{running.address}#/")
            with process("run", "-e", endpoint):
                send_until_reported()
                expect(page.locator(".wheel")).not_to_contain_text("stale")
                expect(page.locator(".wheel")).not_to_contain_text("warning")
                wait_for(lambda: (monitor_alarm(running.address) or {})["closed_ns"], "the end of the alarm")
                page.get_by_role("link", name="Alarms").click()
                expect(page.get_by_text("✓ cleared")).to_be_visible()


@pytest.mark.parametrize("complaint", [""])
def test_telemetry_of_one_wheel_that_stops_is_not_shown_as_current(
    session: zenoh.Session, dashboard: Running, page: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet, "LEAST_STALE_S", 1.0)
    samples, batch = with_friction(4_000), 0

    def send(wheel: str) -> None:
        nonlocal batch
        session.put(f"rwa/sat/{wheel}/samples", samples_json(samples[batch : batch + 8], "satellite", batch))
        batch += 8

    with reporting(session, "wheel_1", "wheel_2"):
        for wheel in ("wheel_1", "wheel_2"):
            send_windows(session, wheel, failing=False)
        page.goto(dashboard.address)
        rows = {wheel: page.locator(".wheel", has_text=wheel) for wheel in ("wheel_1", "wheel_2")}
        for _ in range(10):
            send("wheel_1")
            send("wheel_2")
            page.wait_for_timeout(100)

        def starved() -> bool:
            send("wheel_1")
            # Should all of this stand still for a second, so does the other one's telemetry.
            return "No telemetry now" in rows["wheel_2"].inner_text() and "stale" not in rows["wheel_1"].inner_text()

        wait_for(starved, "the wheel whose telemetry stopped, while that of the other one goes on")
        expect(rows["wheel_2"]).to_contain_text("stale: no telemetry for")
        rows["wheel_2"].click()
        expect(page.locator(".stale-note")).to_contain_text("This is the last known state, not the present one.")

        def back() -> bool:
            send("wheel_2")
            return page.locator(".stale-note").count() == 0

        wait_for(back, "the telemetry that is back")


@pytest.mark.parametrize("complaint", [""])
def test_a_bus_that_is_gone_is_reported_until_it_is_back(page: Any, tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    alone = {"multicast": {"enabled": False}}
    router = json.dumps({"mode": "router", "listen": {"endpoints": [endpoint]}, "scouting": alone})
    with ExitStack() as stack:
        first = stack.enter_context(script(ROUTER, router))
        bus = BusOptions(mode="client", connect=(endpoint,))
        session = stack.enter_context(open_session(bus))
        running = stack.enter_context(serve(DashboardOptions(0, tmp_path, bus=bus), session))
        page.goto(running.address)
        expect(page.locator("#connection")).to_contain_text("connected")
        expect(page.locator("#banner")).to_be_hidden()
        first.kill()
        expect(page.locator("#banner")).to_contain_text(f"The bus is gone: there is no connection to {endpoint}")
        with script(ROUTER, router):
            expect(page.locator("#banner")).to_be_hidden()


@pytest.mark.parametrize("complaint", [""])
def test_a_locked_database_is_reported_and_what_came_meanwhile_is_stored(
    session: zenoh.Session, dashboard: Running, page: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rwa_monitor.history.database.BUSY_TIMEOUT_S", 0.2)
    send_windows(session, "wheel_1", failing=True)
    page.goto(dashboard.address_with_token)
    page.get_by_role("link", name="Alarms").click()
    expect(page.get_by_role("button", name="Acknowledge")).to_be_visible()
    with script(LOCK, str(tmp_path / HISTORY_NAME)):
        press(page, "Acknowledge")
        expect(page.get_by_text("Not acknowledged: the history")).to_contain_text("database is locked")
        send_windows(session, "wheel_1", failing=True, windows=2, first=3)
        expect(page.locator("#banner")).to_contain_text("2 windows wait to be stored")
    expect(page.locator("#banner")).to_be_hidden()
    press(page, "Acknowledge")
    expect(page.get_by_text("Acknowledged by Ann")).to_be_visible()
    wait_for(lambda: len(ask(dashboard.address, "api/wheels/sat/wheel_1/windows")[1]) == 5, "all windows")


@pytest.mark.parametrize("complaint", [""])
def test_a_server_that_is_gone_is_reported_and_found_again(session: zenoh.Session, page: Any, tmp_path: Path) -> None:
    options = DashboardOptions(free_port(), tmp_path, token="right")
    with serve(options, session) as running:
        send_windows(session, "wheel_1", failing=True)
        page.goto(f"{running.address}#/wheel/sat/wheel_1")
        expect(page.get_by_role("row", name="viscous")).to_contain_text("▲ active")
    expect(page.locator("#banner")).to_contain_text("Disconnected from the dashboard's server")
    expect(page.locator("#connection")).to_contain_text("○ disconnected")
    assert "disconnected" in page.locator("body").get_attribute("class")
    with serve(options, session):
        expect(page.locator("#banner")).to_be_hidden()
        expect(page.locator("#connection")).to_contain_text("● connected")
        expect(page.get_by_role("row", name="viscous")).to_contain_text("▲ active")
        expect(page.locator(".stale-note")).to_contain_text("stale, from the history")


@pytest.mark.parametrize("complaint", [""])
def test_a_wrong_token_is_reported_and_can_be_mended_on_the_page(
    session: zenoh.Session, dashboard: Running, page: Any
) -> None:
    send_windows(session, "wheel_1", failing=True)
    page.goto(f"{dashboard.address}#token=wrong")
    page.get_by_role("link", name="Alarms").click()
    press(page, "Acknowledge")
    expect(page.get_by_text("Not acknowledged: the token is missing or wrong")).to_be_visible()
    page.get_by_label("Token").fill("right")
    press(page, "Acknowledge")
    expect(page.get_by_text("Acknowledged by Ann")).to_be_visible()


@pytest.mark.parametrize("complaint", [""])
def test_a_recording_that_is_cut_off_shows_what_is_left_and_why(dashboard: Running, page: Any, tmp_path: Path) -> None:
    data = RECORDING.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 2 // 3])
    (tmp_path / "none.mcap").write_bytes(b"no recording")
    page.goto(f"{dashboard.address}#/recordings")
    page.get_by_role("link", name="cut.mcap").click()
    expect(page.get_by_text("Not all could be read")).to_contain_text("cannot be read")
    page.get_by_role("button", name="Next window").click()  # there is none: it goes to the end
    expect(page.locator(".wheel").first).to_be_visible()
    page.goto(f"{dashboard.address}#/replay/none.mcap")
    expect(page.get_by_role("alert").filter(has_text="cannot be opened")).to_contain_text("is no MCAP file")
