"""Live, stored and replayed telemetry on the dashboard: which it is, and that only what is live is an alarm of now."""

from typing import Any

import numpy as np
import pytest
import zenoh

from rwa_monitor.dashboard.server import Running
from rwa_monitor.messages import Diagnosis, health_message
from rwa_monitor.monitor.bus import SamplesPublisher
from rwa_monitor.samples import Samples
from tests.dashboard.support import ask, expect, metrics, reporting, status
from tests.dashboard.test_health import asked
from tests.history.support import diagnosis
from tests.monitor.processes import wait_for

pytestmark = pytest.mark.processes


def stored(number: int, **changes: Any) -> Diagnosis:
    return diagnosis(number, **changes).model_copy(update={"data": "stored"})


def put(session: zenoh.Session, *windows: Diagnosis, wheel: str = "wheel_1") -> None:
    for window in windows:
        session.put(f"rwa/sat/{wheel}/diagnosis", window.to_json())


def alarms(address: str) -> dict[str, dict[str, Any]]:
    return {alarm["name"]: alarm for alarm in ask(address, "api/alarms")[1]}


def shown(address: str, key: str) -> dict[str, Any]:
    return next(entry["message"] for entry in ask(address, "api/fleet")[1] if entry["key"] == key)


def test_a_dump_of_bad_windows_raises_an_alarm_of_then_and_leaves_what_is_shown_of_now(
    session: zenoh.Session, dashboard: Running
) -> None:
    live = [diagnosis(n) for n in (8, 9)]
    put(session, *live)
    put(session, *(stored(n, severity=4.0) for n in (3, 1, 2)))
    found = wait_for(lambda: alarms(dashboard.address), "the alarm")
    assert set(found) == {"viscous (stored)"}
    assert found["viscous (stored)"]["raised_ns"] in {stored(n).window_end_ns for n in (1, 2, 3)}
    assert shown(dashboard.address, "rwa/sat/wheel_1/diagnosis")["window_end_ns"] == live[1].window_end_ns
    windows = ask(dashboard.address, "api/wheels/sat/wheel_1/windows")[1]
    assert [one.get("data") for one in windows] == ["stored"] * 3 + [None] * 2
    health = wait_for(lambda: asked(session).get("rwa/sat/wheel_1/health"), "the health")
    assert (health.verdict, health.alarms, health.alarm_states) == ("nominal", [], {})
    assert 'rwa_alarms{level="critical",phase="active"} 0.0' in metrics(dashboard.address)
    assert 'rwa_stored_alarms{level="critical"} 1.0' in metrics(dashboard.address)


def test_windows_whose_samples_were_old_by_the_clock_are_stored_ones(
    session: zenoh.Session, dashboard: Running
) -> None:
    for window in (diagnosis(n, severity=1.0) for n in range(3)):
        session.put("rwa/sat/wheel_1/health", health_message(window, "stored").to_json())
        put(session, window)
    assert set(wait_for(lambda: alarms(dashboard.address), "the alarm")) == {"viscous (stored)"}
    assert shown(dashboard.address, "rwa/sat/wheel_1/diagnosis")["data"] == "stored"


@pytest.mark.parametrize("options", [{"silent_s": 0.5}])
def test_a_replay_is_shown_apart_and_leaves_no_trace(session: zenoh.Session, dashboard: Running) -> None:
    key = "rwa/sat/wheel_1@replay/{}"
    put(session, diagnosis(0), diagnosis(1))
    put(session, *(diagnosis(n, severity=4.0) for n in range(4)), wheel="wheel_1@replay")
    session.put(key.format("status"), status("wheel_1@replay", data="replay"))
    replayed = wait_for(lambda: _shown_at_last(dashboard.address, key.format("diagnosis")), "the replay")
    assert replayed["verdict"] == "anomalous"
    assert shown(dashboard.address, "rwa/sat/wheel_1/diagnosis")["verdict"] == "nominal"
    windows = "api/wheels/sat/wheel_1/windows"
    wait_for(lambda: len(ask(dashboard.address, windows)[1]) == 2, "both windows in the history")
    # A wheel without a monitor falls silent later: by then the replay's silence would have shown.
    put(session, diagnosis(0), wheel="wheel_2")
    session.put("rwa/sat/wheel_2/status", status("wheel_2"))
    found = wait_for(lambda: ask(dashboard.address, "api/alarms")[1], "the alarm of the wheel that fell silent")
    assert [(alarm["wheel"], alarm["name"]) for alarm in found] == [("wheel_2", "monitor")]
    assert [one["verdict"] for one in ask(dashboard.address, windows)[1]] == ["nominal"] * 2
    assert "@replay" not in metrics(dashboard.address)


def test_a_replay_that_is_stated_is_shown_apart(session: zenoh.Session, dashboard: Running) -> None:
    publisher = SamplesPublisher(session, "rwa/sat/wheel_1/samples", "replay")
    publisher.put(Samples(np.arange(3) * 125_000_000, np.full(3, 300.0), np.full(3, 3e-3)))
    path = "api/wheels/sat/wheel_1"
    wait_for(lambda: ask(dashboard.address, f"{path}@replay")[0] == 200, "the replay", 20.0)
    publisher.close()
    assert len(ask(dashboard.address, f"{path}@replay")[1]["samples"]["time_ns"]) == 3
    assert ask(dashboard.address, path)[0] == 404


def _shown_at_last(address: str, key: str) -> dict[str, Any] | None:
    found = [entry["message"] for entry in ask(address, "api/fleet")[1] if entry["key"] == key]
    return found[0] if found and found[0]["window_end_ns"] == diagnosis(3).window_end_ns else None


def test_the_page_labels_what_is_not_live(session: zenoh.Session, dashboard: Running, page: Any) -> None:
    with (
        reporting(session, "wheel_1", data="stored"),
        reporting(session, "wheel_2"),
        reporting(session, "wheel_1@replay", data="replay"),
    ):
        put(session, *(stored(n, severity=1.0) for n in range(3)))
        put(session, diagnosis(0, wheel="wheel_2"), wheel="wheel_2")
        put(session, diagnosis(0, severity=1.0), wheel="wheel_1@replay")
        wait_for(lambda: alarms(dashboard.address), "the alarm")
        page.goto(dashboard.address)
        rows = page.locator("a.wheel")
        expect(rows.filter(has_text="stored data: measured earlier, not live")).to_have_count(1)
        expect(rows.filter(has_text="replay: a recording that is played again")).to_have_count(1)
        expect(rows).to_have_count(3)
        expect(page.get_by_text("0 open alarms")).to_be_visible()
        page.goto(f"{dashboard.address}#/wheel/sat/wheel_1")
        expect(page.get_by_text("◷ stored data: measured earlier, not live.")).to_be_visible()
        page.goto(f"{dashboard.address}#/wheel/sat/wheel_1@replay")
        expect(page.get_by_text("◷ replay: a recording that is played again.")).to_be_visible()
        page.goto(f"{dashboard.address}#/alarms")
        expect(page.get_by_text("‖ stored data")).to_be_visible()
