"""Makes docs/screenshots from a running demo: `python -m tools.screenshots`. Needs Debian's chromium."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, expect, sync_playwright

from rwa_monitor.simulation.demo_satellite import FAILING

CHROMIUM = "/usr/bin/chromium"
FOLDER = Path("docs/screenshots")
REPORT_ROUNDS = 20  # of four seconds
ALARM_MS = 120_000  # the wheel fails some 25 s into the demo; a slow machine compiles first


def main() -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as record:
        demo = subprocess.Popen(
            [sys.executable, "-m", "rwa_monitor", "demo", "--no-browser", "--duration", "150", "--port", "0",
             "--record", record],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            assert demo.stderr is not None
            address = next(match[1] for line in demo.stderr if (match := re.search(r"the page is at (\S+)", line)))
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
                _shoot(browser.new_page(viewport={"width": 1280, "height": 800}), address)
                browser.close()
            for picture in FOLDER.glob("*.png"):  # a palette reduces a picture of a page to a third
                with Image.open(picture) as image:
                    image.convert("RGB").quantize(128).save(picture, optimize=True)
        finally:
            demo.terminate()
            demo.communicate()


def _shoot(page: Page, address: str) -> None:
    page.goto(address)
    failing = page.locator(".wheel", has_text=FAILING)
    expect(failing).to_contain_text("anomalous", timeout=ALARM_MS)
    page.wait_for_timeout(9_000)  # one more window, so that the page has content
    page.screenshot(path=FOLDER / "fleet.png")
    page.set_viewport_size({"width": 1920, "height": 1080})
    page.wait_for_timeout(1_000)
    page.screenshot(path=FOLDER / "fleet_wide.png")
    page.set_viewport_size({"width": 1280, "height": 800})
    failing.click()
    expect(page.get_by_role("heading", name="Speed, friction and jumps")).to_be_visible()
    page.wait_for_timeout(2_000)
    page.screenshot(path=FOLDER / "wheel.png", full_page=True)
    page.emulate_media(color_scheme="dark")
    page.get_by_role("link", name="Alarms").click()
    page.wait_for_timeout(1_000)
    page.screenshot(path=FOLDER / "alarms_dark.png")
    page.set_viewport_size({"width": 390, "height": 800})
    page.get_by_role("link", name="Fleet", exact=True).click()
    page.wait_for_timeout(1_000)
    page.screenshot(path=FOLDER / "fleet_phone.png")
    page.emulate_media(color_scheme="light")
    page.set_viewport_size({"width": 1280, "height": 800})
    _shoot_report(page)


def _shoot_report(page: Page) -> None:
    """Take the discrepancy report of the wheel that hides an effect, once the monitor has found it."""
    wheels = [link.get_attribute("href") for link in page.locator(".wheel").all()]
    report = page.locator("section", has=page.get_by_role("heading", name="Discrepancy report"))
    for _ in range(REPORT_ROUNDS):
        for href in wheels:
            page.goto(page.url.split("#")[0] + str(href))
            page.wait_for_timeout(1_000)
            if report.is_visible():
                report.screenshot(path=FOLDER / "discrepancy.png")
                return
    raise SystemExit("no wheel had a discrepancy report before the end of the demo")


if __name__ == "__main__":
    main()
