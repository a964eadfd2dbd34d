"""A wheel's page from the history alone, friction over speed and temperature, siblings; themes, keys and paper."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from rwa_monitor.dashboard.recordings import import_recordings
from rwa_monitor.dashboard.server import DashboardOptions, Running, serve
from rwa_monitor.history.store import History
from rwa_monitor.messages import Sojourns
from rwa_monitor.samples import Samples
from tests.dashboard.support import ask, expect, findings, opened, pixels, reporting, send_samples
from tests.dashboard.test_page import VIEWS, show
from tests.dashboard.test_recordings import RECORDING
from tests.history.support import START_NS, WINDOW_NS, diagnosis
from tests.monitor.processes import wait_for

SIMULATED = (213, 94, 0)  # the line that is simulated
PER_KELVIN_NM = 2e-5  # of friction, in the samples that are sent

pytestmark = pytest.mark.browser


def chart(page: Any, name: str) -> Any:
    return page.get_by_role("img", name=name).first.locator("canvas")


def drawn(page: Any, name: str) -> None:
    """Wait until the line by the diagnosis is drawn."""
    expect(chart(page, name)).to_be_visible()
    wait_for(lambda: pixels(chart(page, name), SIMULATED, within=30) > 200, f"the line in {name}")


def test_the_latest_window_is_drawn_from_history_and_recording(
    chromium: Any, session: zenoh.Session, tmp_path: Path
) -> None:
    (tmp_path / RECORDING.name).write_bytes(RECORDING.read_bytes())
    with History(tmp_path / "history.sqlite3") as history:
        import_recordings(history, tmp_path)
    with serve(DashboardOptions(0, tmp_path, silent_s=0.0), session) as running, opened(chromium) as page:
        name = next(iter(ask(running.address, "api/verdicts")[1]))
        window = ask(running.address, f"api/wheels/{name}/windows?limit=1")[1][0]
        samples = ask(running.address, f"api/wheels/{name}/samples")[1]
        assert window["window_start_ns"] <= samples["time_ns"][0]
        assert samples["time_ns"][-1] < window["window_end_ns"]
        assert len(samples["time_ns"]) > 1_000
        page.goto(f"{running.address}#/wheel/{name}")
        expect(page.get_by_text("stale, from the history")).to_be_visible()
        for label in ("friction [mN m] over time", "friction [mN m] over speed"):
            drawn(page, label)
        expect(chart(page, "speed [rad/s] over time")).to_be_visible()
        expect(chart(page, "residual [mN m] over time")).to_be_visible()
        expect(page.get_by_text("No samples")).to_have_count(0)


def test_without_a_recording_the_friction_of_the_diagnosis_is_drawn_with_its_jumps(
    chromium: Any, session: zenoh.Session, tmp_path: Path
) -> None:
    message = diagnosis(0)
    steps = Sojourns(configuration=[0, 1, 0], friction_Nm=[0.0, 8e-4, 0.0], start_index=[0, 5_000, 9_000])
    message = message.model_copy(update={"friction": message.friction.model_copy(update={"fss": {"fss_1": steps}})})
    with History(tmp_path / "history.sqlite3") as history:
        history.add(message)
    with serve(DashboardOptions(0, tmp_path, silent_s=0.0), session) as running, opened(chromium) as page:
        page.goto(f"{running.address}#/wheel/sat/wheel_1")
        expect(page.get_by_text("No samples of this window are kept.")).to_be_visible()
        drawn(page, "friction [mN m] over time")
        expect(page.get_by_role("img", name="speed [rad/s] over time")).to_have_count(0)
        expect(page.get_by_role("img", name="friction [mN m] over speed")).to_have_count(0)
        page.get_by_role("img", name="friction [mN m] over time").first.hover(position={"x": 600, "y": 100})
        expect(page.locator(".reading", has_text="simulated")).to_have_text(re.compile(r"simulated (2\.4|1\.6) mN m"))


def test_friction_over_speed_and_temperature_has_the_law_and_the_slope(
    session: zenoh.Session, dashboard: Running, page: Any
) -> None:
    message = diagnosis(0)
    session.put("rwa/sat/wheel_1/diagnosis", message.to_json())
    session.put("rwa/sat/wheel_2/diagnosis", diagnosis(0, severity=1.0, wheel="wheel_2").to_json())
    time_ns = START_NS + np.arange(0, WINDOW_NS, WINDOW_NS // 1_000, dtype=np.int64)[:1_000]
    speed = 200.0 * np.sin(np.linspace(0.1, 6.0, 1_000))
    warmth = 20.0 + 5.0 * np.sin(np.linspace(0.0, 40.0, 1_000))
    against = 1.6e-3 + 5.3e-6 * np.abs(speed) + PER_KELVIN_NM * (warmth - 20.0)
    samples = Samples(time_ns, speed, np.sign(speed) * against, bearing_temperature_degC=warmth)
    send_samples(session, "wheel_1", samples)

    def received() -> bool:
        status, content = ask(dashboard.address, "api/wheels/sat/wheel_1")
        return status == 200 and bool(content["samples"]) and len(content["samples"]["time_ns"]) == 1_000

    wait_for(received, "the samples")
    page.goto(f"{dashboard.address}#/wheel/sat/wheel_1")
    drawn(page, "friction [mN m] over speed")
    drawn(page, "friction [mN m] over bearing temperature")
    expect(page.get_by_text("Over 15 to 25 °C friction changes by 0.02 mN m per K.")).to_be_visible()
    # 95 % is 1.96 standard deviations: of 10 µN m in base dry, of 0.01 µN m s/rad in viscous friction.
    beside = page.locator("section", has=page.get_by_role("heading", name="beside the siblings"))
    expect(beside).to_contain_text("wheel_1 (this)")
    for text in ("1.600 ± 0.020", "5.300 ± 0.020", "6.600 ± 0.020", "nominal 5.1 µN m s/rad to 5.5 µN m s/rad"):
        expect(beside).to_contain_text(text)
    beside.get_by_role("link", name="wheel_2").first.click()
    expect(page.locator("h1")).to_have_text("sat / wheel_2")
    expect(page.get_by_text("wheel_2 (this)").first).to_be_visible()


def test_a_chosen_theme_stays_and_no_view_has_a_finding(
    chromium: Any, session: zenoh.Session, failing_fleet: Running
) -> None:
    with (
        reporting(session, "wheel_2"),
        opened(chromium, complaint="404", color_scheme="light") as page,
    ):
        page.goto(failing_fleet.address)
        switch = page.get_by_role("button", name="Theme")
        theme = page.locator("html")
        expect(theme).to_have_attribute("data-theme", "light")
        page.emulate_media(color_scheme="dark")
        expect(theme).to_have_attribute("data-theme", "dark")
        for chosen in ("light", "dark"):
            switch.click()
            expect(switch).to_have_text(f"Theme: {chosen}")
            page.emulate_media(color_scheme="light" if chosen == "dark" else "dark")
            page.reload()
            expect(theme).to_have_attribute("data-theme", chosen)
            for view in VIEWS:
                show(page, failing_fleet, view)
                page.wait_for_timeout(300)
                assert findings(page) == [], view
        page.keyboard.press("d")
        expect(switch).to_have_text("Theme: system")


def test_a_key_opens_the_list_of_keys(dashboard: Running, page: Any) -> None:
    page.goto(dashboard.address)
    expect(page.locator("#connection")).to_have_text("● connected")
    page.keyboard.press("?")
    keys = page.get_by_role("dialog", name="Keys")
    expect(keys).to_contain_text("search wheels")
    page.keyboard.press("a")  # belongs to the list now
    expect(page.locator("h1")).to_have_text("Fleet")
    page.keyboard.press("Escape")
    expect(keys).to_be_hidden()
    page.get_by_role("button", name="Keys").click()
    keys.get_by_role("button", name="Close").click()
    expect(keys).to_be_hidden()


@pytest.mark.parametrize("look", [{"width": 700, "color_scheme": "dark"}])
def test_paper_is_light_and_has_nothing_to_press(page: Any, failing_fleet: Running) -> None:
    page.goto(f"{failing_fleet.address}#/wheel/sat/wheel_2")
    expect(chart(page, "friction [mN m] over time")).to_be_visible()
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print", color_scheme="dark")
    expect(page.locator("html")).to_have_attribute("data-theme", "light")
    expect(page.get_by_role("heading", name="sat / wheel_2")).to_be_visible()
    expect(chart(page, "friction [mN m] over time")).to_be_visible()
    assert page.locator("button:visible, input:visible, nav:visible").count() == 0
    assert page.evaluate("document.documentElement.scrollWidth") <= 700
    assert page.pdf().startswith(b"%PDF")
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    expect(page.locator("html")).to_have_attribute("data-theme", "dark")
