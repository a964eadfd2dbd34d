"""The page in a real browser, from a real server on a real bus: what an operator sees and does."""

import re
from typing import Any

import pytest
import zenoh

from rwa_monitor.dashboard.server import Running
from tests.dashboard.support import RIGHT, acknowledge, ask, expect, findings, opened, press, reporting, send_samples
from tests.dashboard.test_recordings import RECORDING
from tests.dashboard.test_telemetry import current
from tests.history.support import diagnosis
from tests.monitor.processes import wait_for

VIEWS = ("#/", "#/alarms", "#/recordings", "#/wheel/sat/wheel_2", "#/wheel/sat/nobody", f"#/replay/{RECORDING.name}")


@pytest.mark.processes
def test_changes_need_the_token_and_no_other_origin_or_host_is_served(failing_fleet: Running) -> None:
    address, path = failing_fleet.address, "api/alarms/1/acknowledge"
    seen = b'{"name":"Ann"}'
    assert ask(address, path, body=seen)[0] == 401
    assert ask(address, path, body=seen, headers={"Authorization": "Bearer wrong"})[0] == 401
    assert ask(address, path, body=b"{}", headers=RIGHT)[0] == 422
    assert ask(address, path, body=b" " * 100_000, headers=RIGHT)[0] == 413
    assert ask(address, "api/fleet", headers={"Origin": "http://elsewhere.example"})[0] == 403
    assert ask(address, "api/fleet", headers={"Host": "elsewhere.example"})[0] == 400
    assert ask(address, "api/recordings/..%2Fsecret")[0] in {404, 422}
    assert ask(address, "api/wheels/sat/wheel_9")[0] == 404


@pytest.mark.browser
def test_a_recording_is_played_stepped_and_sought(failing_fleet: Running, page: Any) -> None:
    page.goto(f"{failing_fleet.address}#/recordings")
    page.get_by_label("Go to").fill("1e6")
    page.get_by_role("button", name="Go", exact=True).click()
    expect(page.get_by_text("No recording covers spacecraft clock 1000000.0 s.")).to_be_visible()
    page.get_by_label("Go to").fill("100.5")
    page.get_by_role("button", name="Go", exact=True).click()
    expect(page.get_by_role("heading", name=f"Replay of {RECORDING.name}")).to_be_visible()
    expect(page.get_by_text("spacecraft clock 100.5 s, UTC unknown").first).to_be_visible()
    page.keyboard.press("r")
    page.get_by_role("link", name=RECORDING.name).click()
    page.get_by_role("button", name="Next window").click()
    expect(page.locator(".wheel").first).to_contain_text(re.compile("nominal|anomalous|inconclusive"))
    page.locator(".wheel").first.click()
    expect(page.locator("tbody tr").first).to_contain_text("dry")
    clock = page.locator("section .soft", has_text="spacecraft clock").first
    at_window = clock.inner_text()
    page.get_by_label("Position").fill("0")
    wait_for(lambda: clock.inner_text() != at_window, "the replay to go back")
    expect(page.get_by_text("The first window is being filled.")).to_be_visible()
    begin = clock.inner_text()
    page.get_by_role("combobox", name="Speed").select_option("10")
    page.get_by_role("button", name="Play").click()
    wait_for(lambda: clock.inner_text() != begin, "the replay to go on")
    page.get_by_role("button", name="Pause").click()
    seconds = re.search(r"clock ([\d.]+) s, UTC unknown", begin)
    page.get_by_label("Go to").fill(seconds[1] if seconds else begin[:19])
    page.get_by_role("button", name="Go", exact=True).click()
    expect(page.get_by_text("The first window is being filled.")).to_be_visible()
    page.get_by_role("combobox", name="Speed").select_option("as fast as it goes")
    page.get_by_role("button", name="Play").click()
    expect(page.get_by_role("button", name="Play")).to_be_visible()  # it has come to the end
    expect(page.locator("tbody tr").first).to_contain_text("dry")


@pytest.mark.browser
def test_the_wheel_view_shows_all_that_is_known(session: zenoh.Session, failing_fleet: Running, page: Any) -> None:
    with reporting(session, "wheel_2", last_sample_ns=5):
        page.goto(failing_fleet.address)
        expect(page.locator(".wheel").first).to_contain_text("Viscous friction is too high.")
        expect(page.locator(".wheel").first).to_contain_text("probability 99 %, severity 1; anomalous for 2 windows")
        page.locator(".wheel").first.click()
        expect(page.get_by_role("row", name="viscous")).to_contain_text("6.6 µN m s/rad")
        for chart in ("speed [rad/s]", "friction [mN m]", "residual [mN m]", "viscous [µN m s/rad]"):
            expect(page.get_by_role("img", name=f"{chart} over time").first.locator("canvas")).to_be_visible()
        report = page.locator("section", has=page.get_by_role("heading", name="Discrepancy report"))
        expect(report).to_contain_text("stribeck")
        expect(report).to_contain_text("0.5 mN m ± 0.01 mN m")
        expect(report).to_contain_text("Unexplained: ripple")
        quality = page.locator("section", has=page.get_by_role("heading", name="Data quality"))
        for fact in ("✓ reporting", "100 %", "0 slots missed", "spacecraft clock 0.0 s", "1 jumps so far"):
            expect(quality).to_contain_text(fact.replace("1 jumps", "0 jumps"))
        # At the cursor stand the time on both clocks, and the values.
        page.get_by_role("img", name="speed [rad/s] over time").hover()
        expect(page.locator(".reading").first).to_contain_text(re.compile(r"UTC \(spacecraft clock .* s\): speed 100"))


@pytest.mark.browser
@pytest.mark.parametrize("complaint", [""])
def test_friction_that_is_derived_from_current_is_drawn(session: zenoh.Session, dashboard: Running, page: Any) -> None:
    session.put("rwa/sat/wheel_1/diagnosis", diagnosis(0).to_json())
    send_samples(session, "wheel_1", current(1_000))

    def derived() -> bool:
        status, content = ask(dashboard.address, "api/wheels/sat/wheel_1")
        shown = content["samples"] if status == 200 else None
        return bool(shown) and sum(value is not None for value in shown["friction_torque_Nm"]) > 900

    wait_for(derived, "friction of all samples but those at the ends")
    page.goto(f"{dashboard.address}#/wheel/sat/wheel_1")
    expect(page.get_by_role("img", name="friction [mN m] over time").first.locator("canvas")).to_be_visible()
    expect(page.get_by_text("none can be derived")).to_have_count(0)


@pytest.mark.browser
def test_every_view_fits_and_is_accessible_at_any_width(
    session: zenoh.Session, failing_fleet: Running, chromium: Any
) -> None:
    with reporting(session, "wheel_2"):
        for width in (1920, 1280, 390):
            # The only complaint is about the unknown wheel.
            with opened(chromium, width, complaint="404", color_scheme="light") as page:
                page.goto(failing_fleet.address_with_token)
                expect(page.locator(".wheel").first).to_contain_text("anomalous")
                for view in VIEWS:
                    show(page, failing_fleet, view)
                    wide = page.evaluate("document.documentElement.scrollWidth")
                    assert wide <= width, f"{view} is {wide} pixels wide"
                    assert findings(page) == [], view


def show(page: Any, fleet: Running, view: str) -> None:
    """Go to a view of the failing fleet, and wait until all of it is there."""
    page.goto(fleet.address + view)
    expect(page.locator("h1, h2").first).to_be_visible()
    if "replay" in view:
        page.get_by_role("button", name="Next window").click()
    if "wheel_2" in view:
        expect(page.get_by_role("heading", name="Discrepancy report")).to_be_visible()


@pytest.mark.browser
def test_an_alarm_that_came_and_went_twice_is_two_cards_of_which_none_is_taken_for_the_other(
    session: zenoh.Session, dashboard: Running, page: Any
) -> None:
    for time in range(2):
        for number in range(6 * time, 6 * time + 6):
            severity = 1.0 if number % 6 < 3 else None
            session.put("rwa/sat/wheel_1/diagnosis", diagnosis(number, severity=severity).to_json())
            if number % 6 == 2:
                wait_for(lambda time=time: acknowledge(dashboard.address, time + 1) == 200, "the alarm")
    page.goto(f"{dashboard.address}#/alarms")
    expect(page.get_by_text("✓ cleared")).to_have_count(2)
    assert findings(page) == []


@pytest.mark.browser
def test_all_can_be_done_by_keyboard(failing_fleet: Running, page: Any) -> None:
    page.goto(failing_fleet.address_with_token)
    expect(page.locator(".wheel")).to_have_count(2)
    assert "token" not in page.url
    page.keyboard.press("/")
    page.keyboard.type("wheel_2")
    expect(page.locator(".wheel")).to_have_count(1)
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    expect(page.locator("h1")).to_have_text("sat / wheel_2")
    page.keyboard.press("a")
    expect(page.locator("h1")).to_have_text("Alarms")
    page.get_by_label("Your name").focus()
    page.keyboard.type("Ann, far from the mouse")  # letters that are keys elsewhere
    page.keyboard.press("Enter")
    expect(page.get_by_text("Acknowledged by Ann, far from the mouse")).to_be_visible()
    page.keyboard.press("f")
    expect(page.locator("h1")).to_have_text("Fleet")


@pytest.mark.browser
def test_an_alarm_is_shelved_and_brought_back(failing_fleet: Running, page: Any) -> None:
    page.goto(failing_fleet.address_with_token)
    expect(page.locator("#alarm-count")).to_have_text("(1)")
    page.keyboard.press("a")
    page.get_by_role("combobox", name="Shelve for").select_option("8 h")
    press(page, "Shelve for")
    expect(page.get_by_text("Shelved by Ann until")).to_be_visible()
    expect(page.locator("#alarm-count")).to_have_text("")
    press(page, "Bring back", "Ben")
    expect(page.locator("#alarm-count")).to_have_text("(1)")
    expect(page.get_by_text("Audit trail (3)")).to_be_visible()


@pytest.mark.browser
def test_what_is_written_and_pressed_stays_while_the_alarm_changes(
    session: zenoh.Session, failing_fleet: Running, page: Any
) -> None:
    page.goto(failing_fleet.address_with_token)
    expect(page.locator("#alarm-count")).to_have_text("(1)")
    page.keyboard.press("a")
    expect(page.get_by_text("probability 99 %, severity 1 ± 0.1.")).to_be_visible()
    page.get_by_label("Your name").fill("Ann")
    page.get_by_role("button", name="Acknowledge").hover()
    page.mouse.down()
    session.put("rwa/sat/wheel_2/diagnosis", diagnosis(4, severity=1.2, wheel="wheel_2").to_json())
    clock = page.locator("#clock")
    for _ in range(3):  # whatever redraws the page shows the time
        before = clock.inner_text()
        wait_for(lambda before=before: clock.inner_text() != before, "the page to be drawn")  # type: ignore[misc]
    page.mouse.up()
    expect(page.get_by_text("Acknowledged by Ann")).to_be_visible()
    expect(page.get_by_text("probability 99 %, severity 1.2 ± 0.1.")).to_be_visible()


@pytest.mark.browser
def test_a_wheel_of_which_all_messages_are_refused_shows_why(
    session: zenoh.Session, dashboard: Running, page: Any
) -> None:
    why = "time_ns: Field required"
    with reporting(session, "wheel_7", messages_rejected=4, window_fill=0.0, last_error=why):
        page.goto(dashboard.address)
        row = page.locator(".wheel", has_text="wheel_7")
        expect(row).to_contain_text(f"No message of this wheel can be used: {why}.")
        expect(row).to_contain_text("messages refused")
        expect(row).not_to_contain_text("% full")
        row.click()
        expect(page.locator(".strong")).to_contain_text(why)
        expect(page.get_by_text("0 missed, 0 dropped, 4 rejected")).to_be_visible()


@pytest.mark.browser
@pytest.mark.parametrize("complaint", [""])
def test_empty_and_loading_states_are_drawn(dashboard: Running, page: Any) -> None:
    page.route("**/api/recordings", lambda route: (page.wait_for_timeout(300), route.continue_()))
    page.goto(dashboard.address)
    expect(page.get_by_text("No wheel has reported yet.")).to_be_visible()
    page.goto(f"{dashboard.address}#/alarms")
    expect(page.get_by_text("No alarm so far.")).to_be_visible()
    page.goto(f"{dashboard.address}#/recordings")
    expect(page.get_by_text("No recording in this folder yet.")).to_be_visible()
    page.goto(f"{dashboard.address}#/replay/missing.mcap")
    expect(page.get_by_role("alert").filter(has_text="cannot be opened")).to_be_visible()
