"""A monitor that does not report any more is an alarm: which are expected, how long is too long, and when it ends.

`test_faults.py` kills a real monitor, `tests/history` takes the alarm through its states; here statuses are sent as
monitors send them.
"""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from rwa_monitor.dashboard.feed import MonitorWatch
from rwa_monitor.dashboard.server import HISTORY_NAME, DashboardOptions, Running, serve
from rwa_monitor.history.alarms import MONITOR_ALARM
from rwa_monitor.history.database import MonitorState
from rwa_monitor.history.store import History
from rwa_monitor.messages import samples_json
from tests.dashboard.support import acknowledge, ask, expect, findings, press, reporting, send_windows
from tests.dashboard.test_telemetry import with_friction
from tests.history.support import START_NS
from tests.monitor.processes import wait_for

HEARD = MonitorState("sat", "wheel_1", silent=False, time_ns=START_NS)


def watch(expected: dict[tuple[str, str], bool], silent_s: float = 30.0) -> tuple[MonitorWatch, SimpleNamespace]:
    """Return a watch, and its clock."""
    clock = SimpleNamespace(s=1000.0)
    return MonitorWatch(silent_s, expected, lambda: clock.s, lambda: START_NS + int(clock.s * 1e9)), clock


def test_silence_is_news_once_and_so_is_a_status() -> None:
    monitors, clock = watch({})
    monitors.take_status("sat", "wheel_1", START_NS)
    assert monitors.changes((), "") == [HEARD]
    assert monitors.changes((), "") == [HEARD], "until it is written"
    monitors.mark_stored([HEARD])
    clock.s += 30.0
    assert monitors.changes((), "") == []
    clock.s += 0.5
    (silent,) = monitors.changes((), "The bus is gone.")
    assert silent.silent
    assert "No monitor has reported since 2026-11-18T" in silent.reason
    assert silent.reason.endswith(": 30 s and longer. The bus is gone.")
    monitors.mark_stored([silent])
    assert monitors.changes((), "") == []
    monitors.take_status("sat", "wheel_1", None)
    assert monitors.changes((), "") == [HEARD]


def test_no_monitor_is_expected_for_a_retired_wheel_nor_where_no_alarm_is_wanted() -> None:
    monitors, clock = watch({("sat", "wheel_1"): False})
    clock.s += 31.0
    assert monitors.changes({("sat", "wheel_1")}, "") == []
    assert monitors.changes((), "")
    monitors, clock = watch({("sat", "wheel_1"): False}, silent_s=0.0)
    clock.s += 31.0
    monitors.take_status("sat", "wheel_2", None)
    assert monitors.changes((), "") == []


@pytest.mark.processes
def test_a_monitor_that_died_while_no_dashboard_was_there_is_reported_and_a_later_status_ends_it(
    session: zenoh.Session, tmp_path: Path
) -> None:
    def alarms(address: str) -> list[dict[str, Any]]:
        found = ask(address, "api/alarms")[1]
        return [alarm for alarm in found if alarm["name"] == MONITOR_ALARM]

    with (
        serve(DashboardOptions(0, tmp_path), session),
        reporting(session, "wheel_1", last_sample_ns=START_NS),
        History(tmp_path / HISTORY_NAME) as history,
    ):
        wait_for(history.monitors, "the monitor that reports")
    options = DashboardOptions(0, tmp_path, token="right", silent_s=3.0)
    with serve(options, session) as running:
        (alarm,) = wait_for(lambda: alarms(running.address), "the alarm")
        assert (alarm["phase"], alarm["raised_ns"]) == ("active", START_NS)
        assert "since this dashboard was started" in alarm["reason"]
        assert acknowledge(running.address, alarm["id"]) == 200
        with reporting(session, "wheel_1", last_sample_ns=START_NS):
            wait_for(lambda: alarms(running.address)[0]["closed_ns"] == START_NS, "the end of the alarm")


@pytest.mark.browser
@pytest.mark.processes
@pytest.mark.parametrize("options", [{"silent_s": 1.0}])
def test_a_wheel_without_a_monitor_is_reported(session: zenoh.Session, dashboard: Running, page: Any) -> None:
    page.goto(dashboard.address)
    session.put("rwa/sat/wheel_9/samples", samples_json(with_friction(8), "satellite", 0))
    row = page.locator(".wheel")
    expect(row).to_contain_text("No monitor reports on this wheel: nothing of it is diagnosed.")
    expect(row).to_contain_text("◐ warning")
    page.reload()
    row.click()
    expect(page.locator(".stale-note")).to_have_text("◌ no monitor reports.")


@pytest.mark.browser
@pytest.mark.processes
# Longer than anybody who reports stands still on a busy machine: that would be an alarm more.
@pytest.mark.parametrize("options", [{"silent_s": 8.0}])
def test_wheels_of_one_monitor_are_one_card_that_is_acknowledged_once(
    session: zenoh.Session, dashboard: Running, page: Any
) -> None:
    wheels = ("wheel_1", "wheel_2", "wheel_3")
    page.goto(f"{dashboard.address_with_token}")
    with reporting(session, *wheels):
        for wheel in wheels:
            send_windows(session, wheel, failing=False)
        expect(page.get_by_text("3 of 3 wheels reporting")).to_be_visible()
    expect(page.locator(".wheel .alarm", has_text="◐ warning")).to_have_count(3)
    page.get_by_role("link", name="Alarms").click()
    card = page.get_by_role("region", name="Alarm monitor of 3 wheels")
    expect(card).to_contain_text("◐ warning 3 wheels · monitor")
    expect(card.get_by_role("link")).to_have_count(3)
    assert findings(page) == []
    press(card, "Acknowledge")
    expect(card).to_contain_text("Acknowledged by Ann")
    expect(page.get_by_role("region", name="Alarm monitor")).to_have_count(1)
    assert {alarm["phase"] for alarm in ask(dashboard.address, "api/alarms")[1]} == {"acknowledged"}
    with reporting(session, *wheels):
        expect(page.get_by_text("✓ cleared")).to_have_count(3)
