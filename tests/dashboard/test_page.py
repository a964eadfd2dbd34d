"""The page in a real browser, from a real server on a real bus: what an operator sees and does."""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import zenoh

from rwa_monitor.dashboard.server import DashboardOptions, Running, serve
from rwa_monitor.live.bus import BusOptions, open_session
from rwa_monitor.messages import Status
from tests.history.support import diagnosis

CHROMIUM = Path("/usr/bin/chromium")
WAIT_MS = 15_000


def status(wheel: str) -> bytes:
    counted = ("samples_", "slots_", "messages_")
    return Status.model_validate(
        {name: 0 for name in Status.model_fields if name.startswith(counted)}
        | {"spacecraft": "sat", "wheel": wheel, "queue_depth": 0, "window_fill": 0.5, "last_error": None}
        | {"recording": None, "software": "test", "model_sha256": "", "publisher": "p", "windows": 3}
        | {"last_sample_ns": None, "diagnosis_s": None, "now_wall_ns": 1}
    ).to_json()


@pytest.fixture
def session() -> Iterator[zenoh.Session]:
    with open_session(BusOptions()) as opened:
        yield opened


@pytest.fixture
def server(session: zenoh.Session, tmp_path: Path) -> Iterator[Running]:
    with serve(DashboardOptions(0, tmp_path, token="right"), session) as running:
        for number in range(3):
            session.put("rwa/sat/wheel_1/diagnosis", diagnosis(number).to_json())
            failing = diagnosis(number, severity=1.0 if number else None, wheel="wheel_2")
            session.put("rwa/sat/wheel_2/diagnosis", failing.to_json())
        for wheel in ("wheel_1", "wheel_2"):
            session.put(f"rwa/sat/{wheel}/status", status(wheel))
        yield running


def ask(
    address: str, path: str, *, headers: dict[str, str] | None = None, body: bytes | None = None
) -> tuple[int, Any]:
    request = urllib.request.Request(address + path, data=body, headers=headers or {})
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read()


@pytest.mark.processes
def test_changes_need_the_token_and_no_other_origin_or_host_is_served(server: Running) -> None:
    seen = json.dumps({"name": "Ann"}).encode()
    assert ask(server.address, "api/alarms/1/acknowledge", body=seen)[0] == 401
    assert (
        ask(server.address, "api/alarms/1/acknowledge", body=seen, headers={"Authorization": "Bearer wrong"})[0] == 401
    )
    right = {"Authorization": "Bearer right"}
    assert ask(server.address, "api/alarms/1/acknowledge", body=b"{}", headers=right)[0] == 422
    assert ask(server.address, "api/alarms/1/acknowledge", body=b" " * 100_000, headers=right)[0] == 413
    assert ask(server.address, "api/fleet", headers={"Origin": "http://elsewhere.example"})[0] == 403
    assert ask(server.address, "api/fleet", headers={"Host": "elsewhere.example"})[0] == 400
    assert ask(server.address, "api/recordings/..%2Fsecret")[0] in {404, 422}
    assert ask(server.address, "api/wheels/sat/wheel_9")[0] == 404
    status_code, document = ask(server.address, "api/openapi.json")
    assert status_code == 200
    assert "/api/fleet" in document["paths"]


@pytest.mark.browser
def test_an_operator_finds_the_failing_wheel_and_acknowledges(session: zenoh.Session, tmp_path: Path) -> None:
    if not CHROMIUM.exists():
        pytest.skip(f"no browser: {CHROMIUM} is missing (Debian's package chromium)")
    from playwright.sync_api import expect, sync_playwright

    with ExitStack() as stack:
        served = ExitStack()
        stack.callback(served.close)
        running = served.enter_context(serve(DashboardOptions(0, tmp_path, token="right"), session))
        for wheel, severity in (("wheel_1", None), ("wheel_2", 1.0)):
            for number in range(3):
                message = diagnosis(number, severity=severity if number else None, wheel=wheel)
                session.put(f"rwa/sat/{wheel}/diagnosis", message.to_json())
            session.put(f"rwa/sat/{wheel}/status", status(wheel))
        playwright = stack.enter_context(sync_playwright())
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        stack.callback(browser.close)
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(WAIT_MS)
        expect.set_options(timeout=WAIT_MS)
        complaints: list[str] = []
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)

        page.goto(running.address_with_token)
        assert "token" not in page.url
        expect(page.locator(".wheel").first).to_contain_text("anomalous")  # the worst comes first
        expect(page.locator(".wheel").first).to_contain_text("Viscous friction is too high.")
        page.locator(".wheel").first.click()
        expect(page.locator("h1")).to_have_text("sat / wheel_2")
        expect(page.locator("tbody tr")).to_contain_text("▲ active")
        expect(page.locator("canvas").first).to_be_visible()

        page.get_by_role("link", name="Alarms").click()
        page.get_by_label("Your name").fill("Ann")
        page.get_by_label("Note").fill("<b>seen</b>")
        page.get_by_role("button", name="Acknowledge").click()
        expect(page.get_by_text("Acknowledged by Ann")).to_be_visible()
        page.reload()
        expect(page.get_by_text("Acknowledged by Ann")).to_be_visible()
        expect(page.get_by_role("button", name="Acknowledge")).to_have_count(0)

        page.set_viewport_size({"width": 390, "height": 800})
        for view in ("#/", "#/alarms", "#/recordings", "#/wheel/sat/wheel_2"):
            page.goto(running.address + view)
            expect(page.locator("h1")).to_be_visible()
            assert page.evaluate("document.documentElement.scrollWidth") <= 390, view

        page.goto(running.address + "#/")
        expect(page.locator(".wheel").first).to_contain_text("stale")  # the monitor has been silent for some seconds
        assert complaints == []
        served.close()
        expect(page.locator("#banner")).to_contain_text("Disconnected")
