"""A wheel that is retired is put aside, is seen nowhere but where it was put, and is back as soon as it speaks."""

from __future__ import annotations

import json
import urllib.request
from pathlib import Path
from typing import Any

import pytest
import zenoh

from rwa_monitor.dashboard import telemetry
from rwa_monitor.dashboard.server import DashboardOptions, Running, serve
from rwa_monitor.history.records import WheelLine
from rwa_monitor.history.retired_wheels import Aside
from rwa_monitor.history.store import History
from rwa_monitor.messages import samples_json
from tests.dashboard.support import (
    RIGHT,
    acknowledge,
    ask,
    expect,
    opened,
    reporting,
    send_windows,
    serious,
    status,
)
from tests.dashboard.test_telemetry import with_friction
from tests.history.support import diagnosis
from tests.monitor.processes import wait_for


def put_aside(running: Running, wheel: str, *, aside: bool = True, **changes: str) -> tuple[int, Any]:
    body = json.dumps({"name": "Ann", "aside": aside} | changes).encode()
    return ask(running.address, f"api/wheels/sat/{wheel}/aside", headers=RIGHT, body=body)


def deeds(running: Running, wheel: str) -> list[str]:
    return [line["event"] for line in ask(running.address, f"api/wheels/sat/{wheel}/aside")[1]]


def serve_past(record: Path, session: zenoh.Session) -> Any:
    """Serve a fleet that only the history knows: of the past, a wheel that is well and one with an alarm."""
    with History(record / "history.sqlite3") as history:
        history.add_all([diagnosis(n, wheel="wheel_1") for n in range(2)])
        history.add_all([diagnosis(n, severity=1.0, wheel="wheel_2") for n in range(2)])
    return serve(DashboardOptions(0, record, token="right"), session)


@pytest.mark.processes
def test_what_cannot_be_put_aside_is_refused_with_its_reason(session: zenoh.Session, tmp_path: Path) -> None:
    with serve_past(tmp_path, session) as running:
        assert ask(running.address, "api/wheels/sat/wheel_1/aside", body=b'{"name":"Ann","aside":true}')[0] == 401
        assert put_aside(running, "wheel_9")[0] == 404
        assert put_aside(running, "wheel_1", name="")[0] == 422
        assert b"acknowledge first: viscous" in put_aside(running, "wheel_2")[1]
        session.put("rwa/sat/wheel_1/samples", samples_json(with_friction(100), "satellite", 0))
        wait_for(lambda: ask(running.address, "api/wheels/sat/wheel_1")[1]["samples"], "the samples")
        assert b"telemetry is of now" in put_aside(running, "wheel_1")[1]
        assert put_aside(running, "wheel_1", aside=False)[0] == 422


@pytest.mark.processes
@pytest.mark.parametrize("voice", ["samples", "status", "diagnosis"])
def test_a_wheel_is_back_when_it_speaks_and_a_repetition_is_no_word(
    session: zenoh.Session, tmp_path: Path, voice: str
) -> None:
    with serve_past(tmp_path, session) as running:
        assert put_aside(running, "wheel_1", note="retired")[0] == 200
    with serve(DashboardOptions(0, tmp_path, token="right"), session) as running:  # it outlives a restart
        send_windows(session, "wheel_1", failing=False, windows=2)  # what a monitor says again after its own restart
        for _ in range(2):  # a monitor that has the wheel from its recording, and gets no samples
            session.put("rwa/sat/wheel_1/status", status("wheel_1", last_sample_ns=7))
        session.put("rwa/sat/wheel_3/diagnosis", diagnosis(0, wheel="wheel_3").to_json())
        wait_for(lambda: ask(running.address, "api/wheels/sat/wheel_3")[0] == 200, "what was sent last")
        assert deeds(running, "wheel_1") == ["put_aside"]
        message = {
            "samples": samples_json(with_friction(100), "satellite", 0),
            "status": status("wheel_1", last_sample_ns=8),
            "diagnosis": diagnosis(2).to_json(),
        }
        session.put(f"rwa/sat/wheel_1/{voice}", message[voice])
        wait_for(lambda: deeds(running, "wheel_1") == ["put_aside", "spoke_again"], "the wheel")


def test_a_wheel_is_back_also_while_the_history_cannot_be_written() -> None:
    with History(None) as history:
        history.add(diagnosis(0))
        aside = Aside(history.wheel_list)
        aside.put("sat", "wheel_1", "Ann", "")
        assert aside.names() == {("sat", "wheel_1")}
        assert aside.hear("sat", "wheel_1", diagnosis(0).window_end_ns) is None
        line = aside.hear("sat", "wheel_1")
        assert line is not None
        assert aside.names() == set()
        assert aside.hear("sat", "wheel_1") is None  # told once
        history.wheel_list.spoke_again([line])  # as the listener does, as soon as it can
        assert Aside(history.wheel_list).lines() == [line]


def test_a_deed_that_is_not_written_yet_goes_before_what_is_written() -> None:
    with History(None) as history:
        history.add(diagnosis(0))
        here, there = Aside(history.wheel_list), Aside(history.wheel_list)
        line = there.put("sat", "wheel_1", "Ann", "")
        assert here.refresh() == [line]
        assert here.refresh() == []

        class Slow:
            """A history in which a wheel is brought back while it is read."""

            def latest(self) -> list[WheelLine]:
                before = history.wheel_list.latest()
                late.bring_back("sat", "wheel_1", "Ben", "")
                return before

            def bring_back(self, *deed: str) -> WheelLine:
                return history.wheel_list.bring_back(*deed)

        late = Aside(history.wheel_list)
        late._list = Slow()  # type: ignore[assignment]
        assert late.names() == {("sat", "wheel_1")}
        assert late.refresh() == []
        assert late.names() == set()


@pytest.mark.processes
def test_nobody_is_alarmed_by_the_metrics_of_a_wheel_that_is_put_aside(session: zenoh.Session, tmp_path: Path) -> None:
    def text() -> str:
        with urllib.request.urlopen(running.address + "metrics") as answer:
            return str(answer.read().decode())

    with serve_past(tmp_path, session) as running:
        send_windows(session, "wheel_2", failing=True, windows=3)
        windows = "api/wheels/sat/wheel_2/windows"
        wait_for(lambda: len(ask(running.address, windows)[1]) == 3, "its windows")  # the last would bring it back
        assert 'wheel="wheel_2"' in text()
        assert acknowledge(running.address) == 200
        assert 'rwa_alarms{level="warning",phase="acknowledged"} 1.0' in text()
        assert put_aside(running, "wheel_2")[0] == 200
        assert 'wheel="wheel_2"' not in text()
        assert 'rwa_alarms{level="warning",phase="acknowledged"} 0.0' in text()


@pytest.mark.browser
def test_an_operator_puts_a_retired_wheel_aside_and_sees_it_come_back(
    chromium: Any, session: zenoh.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(telemetry, "LEAST_STALE_S", 1.0)
    with (
        serve_past(tmp_path, session) as running,
        reporting(session, "wheel_3"),
        opened(chromium, complaint="422") as page,
    ):
        page.goto(running.address_with_token)
        expect(page.locator(".wheel")).to_have_count(3)
        page.locator(".wheel", has_text="wheel_1").click()
        card = page.get_by_role("region", name="On the list")
        card.get_by_label("Your name").fill("Ann")
        card.get_by_label("Note").fill("<b>replaced</b>")
        card.get_by_role("button", name="Put aside").click()
        expect(card).to_contain_text("comes back by itself when it speaks again")
        expect(card.get_by_text("Audit trail (1)")).to_be_visible()
        assert serious(page) == []

        page.keyboard.press("f")
        expect(page.locator(".wheel")).to_have_count(2)
        page.get_by_text("Put aside (1)").click()
        expect(page.locator("main li")).to_contain_text("put aside by Ann: “<b>replaced</b>”")
        assert serious(page) == []
        page.locator(".wheel", has_text="wheel_2").click()  # its alarm was not acknowledged
        card.get_by_label("Your name").fill("Ann")
        card.get_by_role("button", name="Put aside").click()
        expect(card.get_by_role("alert")).to_contain_text("Not put aside: sat/wheel_2: has alarms to acknowledge first")

        page.keyboard.press("a")
        alarm = page.get_by_role("region", name="Alarm viscous of wheel_2")  # the view before has a name, too
        alarm.get_by_label("Your name").fill("Ann")
        alarm.get_by_role("button", name="Acknowledge").click()
        expect(page.get_by_text("Acknowledged by Ann")).to_be_visible()
        assert put_aside(running, "wheel_2")[0] == 200
        expect(page.locator("section h2")).to_contain_text("wheel put aside")
        page.keyboard.press("f")
        expect(page.get_by_text("Put aside (2)")).to_be_visible()
        expect(page.get_by_text("1 of 1 wheel reporting, 0 anomalous, 0 open alarms")).to_be_visible()

        session.put("rwa/sat/wheel_1/diagnosis", diagnosis(2).to_json())
        expect(page.locator(".wheel", has_text="wheel_1")).to_be_visible()
        page.get_by_text("Put aside (1)").click()
        page.locator("main li a").click()
        expect(page.locator("h1")).to_have_text("sat / wheel_2")
        card.get_by_label("Your name").fill("Ben")
        card.get_by_role("button", name="Bring back").click()
        expect(card.get_by_role("button", name="Put aside")).to_be_visible()
        page.keyboard.press("f")
        expect(page.locator(".wheel")).to_have_count(3)
