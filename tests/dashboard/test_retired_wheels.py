"""A retired wheel stands in a list of its own, and reappears as soon as its telemetry arrives."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from rwa_monitor.dashboard import fleet
from rwa_monitor.dashboard.server import HISTORY_NAME, DashboardOptions, Running, serve
from rwa_monitor.history.store import History
from rwa_monitor.messages import samples_json
from tests.dashboard.support import (
    RIGHT,
    acknowledge,
    ask,
    expect,
    findings,
    metrics,
    press,
    reporting,
    send_windows,
    status,
)
from tests.dashboard.test_telemetry import with_friction
from tests.history.support import diagnosis
from tests.monitor.processes import wait_for


def retire(running: Running, wheel: str, *, back: bool = False, **changes: str) -> tuple[int, Any]:
    body = json.dumps({"name": "Ann", "retire": not back} | changes).encode()
    return ask(running.address, f"api/wheels/sat/{wheel}/retirement", headers=RIGHT, body=body)


def events(running: Running, wheel: str) -> list[str]:
    return [line["event"] for line in ask(running.address, f"api/wheels/sat/{wheel}/retirement")[1]]


@pytest.fixture
def past(tmp_path: Path) -> Path:
    """A history of a wheel that is well and one with an alarm."""
    with History(tmp_path / HISTORY_NAME) as history:
        history.add(*[diagnosis(n, wheel="wheel_1") for n in range(2)])
        history.add(*[diagnosis(n, severity=1.0, wheel="wheel_2") for n in range(2)])
    return tmp_path / HISTORY_NAME


@pytest.fixture
def past_fleet(session: zenoh.Session, past: Path) -> Iterator[Running]:
    """A fleet of which only that history is there."""
    with serve(DashboardOptions(0, past.parent, token="right"), session) as running:
        yield running


@pytest.mark.processes
def test_what_cannot_be_retired_is_refused_with_its_reason(session: zenoh.Session, past_fleet: Running) -> None:
    assert ask(past_fleet.address, "api/wheels/sat/wheel_1/retirement", body=b'{"name":"Ann","retire":true}')[0] == 401
    assert retire(past_fleet, "wheel_9")[0] == 404
    assert [retire(past_fleet, "wheel_1", name=name)[0] for name in ("", "  ", "n" * 101)] == [422] * 3
    assert b"acknowledge first: viscous" in retire(past_fleet, "wheel_2")[1]
    session.put("rwa/sat/wheel_1/samples", samples_json(with_friction(100), "satellite", 0))
    wait_for(lambda: ask(past_fleet.address, "api/wheels/sat/wheel_1")[1]["samples"], "the samples")
    assert b"telemetry is of now" in retire(past_fleet, "wheel_1")[1]
    assert retire(past_fleet, "wheel_1", back=True)[0] == 422


@pytest.mark.processes
@pytest.mark.parametrize("kind", ["samples", "status", "diagnosis"])
def test_a_wheel_is_back_with_its_telemetry_and_not_with_a_repetition(
    session: zenoh.Session, past: Path, kind: str
) -> None:
    with serve(DashboardOptions(0, past.parent, token="right"), session) as running:
        assert retire(running, "wheel_1", note="retired")[0] == 200
    with serve(DashboardOptions(0, past.parent, token="right"), session) as running:  # it outlives a restart
        send_windows(session, "wheel_1", failing=False, windows=2)  # published again after a restart
        for _ in range(2):  # a monitor that has the wheel from its recording, and gets no samples
            session.put("rwa/sat/wheel_1/status", status("wheel_1", last_sample_ns=7))
        session.put("rwa/sat/wheel_3/diagnosis", diagnosis(0, wheel="wheel_3").to_json())
        wait_for(lambda: ask(running.address, "api/wheels/sat/wheel_3")[0] == 200, "what was sent last")
        assert events(running, "wheel_1") == ["retired"]
        message = {
            "samples": samples_json(with_friction(100), "satellite", 0),
            "status": status("wheel_1", last_sample_ns=8),
            "diagnosis": diagnosis(2).to_json(),
        }
        session.put(f"rwa/sat/wheel_1/{kind}", message[kind])
        wait_for(lambda: events(running, "wheel_1") == ["retired", "telemetry_arrived"], "the wheel")


def test_a_wheel_is_back_also_while_the_history_cannot_be_written(tmp_path: Path) -> None:
    place = tmp_path / "history.sqlite3"
    with History(place) as history:
        history.add(diagnosis(0))
        retired = history.retired
        retired.change("sat", "wheel_1", "Ann", retire=True)
        assert retired.names() == {("sat", "wheel_1")}
        assert retired.telemetry_arrived("sat", "wheel_1", diagnosis(0).window_end_ns) is None
        event = retired.telemetry_arrived("sat", "wheel_1")
        assert event is not None
        assert retired.names() == set()
        assert retired.telemetry_arrived("sat", "wheel_1") is None  # reported once
        retired.record([event])  # as the listener does, as soon as it can
        with History(place) as another:
            assert another.retired.latest() == [event]


@pytest.mark.processes
def test_a_retired_wheel_has_no_metrics(session: zenoh.Session, past_fleet: Running) -> None:
    send_windows(session, "wheel_2", failing=True, windows=3)
    windows = "api/wheels/sat/wheel_2/windows"
    wait_for(lambda: len(ask(past_fleet.address, windows)[1]) == 3, "its windows")  # the last would bring it back
    assert 'wheel="wheel_2"' in metrics(past_fleet.address)
    assert acknowledge(past_fleet.address) == 200
    assert 'rwa_alarms{level="warning",phase="acknowledged"} 1.0' in metrics(past_fleet.address)
    assert retire(past_fleet, "wheel_2")[0] == 200
    assert 'wheel="wheel_2"' not in metrics(past_fleet.address)
    assert 'rwa_alarms{level="warning",phase="acknowledged"} 0.0' in metrics(past_fleet.address)


@pytest.mark.browser
@pytest.mark.parametrize("complaint", ["422"])
def test_an_operator_retires_a_wheel_and_sees_it_come_back(
    session: zenoh.Session, past_fleet: Running, page: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet, "LEAST_STALE_S", 1.0)
    with reporting(session, "wheel_3"):
        page.goto(past_fleet.address_with_token)
        expect(page.locator(".wheel")).to_have_count(3)
        for name in ("wheel_1", "wheel_2"):  # the list is sorted anew with each that becomes stale
            expect(page.locator(".wheel", has_text=name)).to_contain_text("◌ stale")
        page.locator(".wheel", has_text="wheel_1").click()
        card = page.get_by_role("region", name="On the list")
        card.get_by_label("Note").fill("<b>replaced</b>")
        press(card, "Retire")
        expect(card).to_contain_text("reappears when telemetry arrives")
        expect(card.get_by_text("Audit trail (1)")).to_be_visible()
        assert findings(page) == []

        page.keyboard.press("f")
        expect(page.locator(".wheel")).to_have_count(2)
        page.get_by_text("Retired (1)").click()
        expect(page.locator("main li")).to_contain_text("retired by Ann: “<b>replaced</b>”")
        assert findings(page) == []
        page.locator(".wheel", has_text="wheel_2").click()  # its alarm was not acknowledged
        press(card, "Retire")
        expect(card.get_by_role("alert")).to_contain_text("Not retired: sat/wheel_2: has alarms to acknowledge first")

        page.keyboard.press("a")
        alarm = page.get_by_role("region", name="Alarm viscous of sat / wheel_2")  # the view before has a name, too
        press(alarm, "Acknowledge")
        expect(page.get_by_text("Acknowledged by Ann")).to_be_visible()
        assert retire(past_fleet, "wheel_2")[0] == 200
        expect(page.locator("section h2")).to_contain_text("wheel retired")
        page.keyboard.press("f")
        expect(page.get_by_text("Retired (2)")).to_be_visible()
        expect(page.get_by_text("1 of 1 wheel reporting, 0 anomalous, 0 open alarms")).to_be_visible()

        session.put("rwa/sat/wheel_1/diagnosis", diagnosis(2).to_json())
        expect(page.locator(".wheel", has_text="wheel_1")).to_be_visible()
        page.get_by_text("Retired (1)").click()
        page.locator("main li a").click()
        expect(page.locator("h1")).to_have_text("sat / wheel_2")
        press(card, "Bring back", "Ben")
        expect(card.get_by_role("button", name="Retire")).to_be_visible()
        page.keyboard.press("f")
        expect(page.locator(".wheel")).to_have_count(3)
