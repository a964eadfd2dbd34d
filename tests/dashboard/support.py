"""A dashboard and a browser for tests: real ones, on a real bus."""

import json
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from threading import Event
from typing import Any

import pytest
import zenoh

from rwa_monitor.messages import Status, samples_json
from rwa_monitor.samples import Samples
from tests.history.support import diagnosis

CHROMIUM = Path("/usr/bin/chromium")
RIGHT = {"Authorization": "Bearer right"}
WAIT_MS = 20_000  # for elements that should appear at once: generous for a loaded machine
WAIT_S = WAIT_MS / 1000
START_S = 120.0  # for a monitor to start and diagnose on a loaded machine


def status(wheel: str, **changes: Any) -> bytes:
    """Return the status of a healthy monitor, with these changes."""
    counted = ("samples_", "slots_", "messages_")
    return Status.model_validate(
        {name: 0 for name in Status.model_fields if name.startswith(counted)}
        | {"spacecraft": "sat", "wheel": wheel, "queue_depth": 0, "window_fill": 0.5, "last_error": None}
        | {"recording": None, "software": "test", "model_sha256": "", "publisher": "p", "windows": 3}
        | {"last_sample_ns": None, "diagnosis_s": None, "now_wall_ns": 1}
        | changes
    ).to_json()


def send_windows(session: zenoh.Session, wheel: str, *, failing: bool, windows: int = 3, first: int = 0) -> None:
    """Send diagnoses of a wheel, which fails from its second window on."""
    for number in range(first, first + windows):
        message = diagnosis(number, severity=1.0 if failing and number else None, wheel=wheel)
        session.put(f"rwa/sat/{wheel}/diagnosis", message.to_json())


def send_samples(session: zenoh.Session, wheel: str, samples: Samples) -> None:
    """Send samples of a wheel as a satellite does, in messages of 250."""
    for begin in range(0, len(samples), 250):
        session.put(f"rwa/sat/{wheel}/samples", samples_json(samples[begin : begin + 250], "satellite", begin))


def ask(
    address: str, path: str, *, headers: dict[str, str] | None = None, body: bytes | None = None
) -> tuple[int, Any]:
    """Send a request to the API; return status and content."""
    request = urllib.request.Request(address + path, body, {"Content-Type": "application/json"} | (headers or {}))
    try:
        with urllib.request.urlopen(request, timeout=WAIT_S) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read()


def metrics(address: str) -> str:
    """Return the metrics that Prometheus would read."""
    with urllib.request.urlopen(f"{address}metrics", timeout=WAIT_S) as answer:
        assert answer.headers["Content-Type"].startswith("text/plain; version=0.0.4")
        return str(answer.read().decode())


def acknowledge(address: str, alarm: int = 1) -> int:
    """Acknowledge an alarm as Ann; returns the status."""
    return ask(address, f"api/alarms/{alarm}/acknowledge", headers=RIGHT, body=b'{"name":"Ann"}')[0]


@contextmanager
def repeated(act: Callable[[], object]) -> Iterator[None]:
    """Do something several times a second, in a thread of its own."""
    stop = Event()

    def run() -> None:
        while not stop.wait(0.3):
            act()

    with ThreadPoolExecutor(1) as thread:
        thread.submit(run)
        try:
            yield
        finally:
            stop.set()


def reporting(session: zenoh.Session, *wheels: str, **changes: Any) -> AbstractContextManager[None]:
    """Publish a status of each wheel several times a second, as monitors do."""
    statuses = {f"rwa/sat/{wheel}/status": status(wheel, **changes) for wheel in wheels}
    return repeated(lambda: [session.put(*one) for one in statuses.items()])


@contextmanager
def browser() -> Iterator[Any]:
    """Start Debian's Chromium; skips where there is none."""
    if not CHROMIUM.exists():
        pytest.skip(f"no browser at {CHROMIUM}: apt-get install chromium")
    from playwright.sync_api import expect, sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox", "--disable-gpu"])
        expect.set_options(timeout=WAIT_MS)
        try:
            yield started
        finally:
            started.close()


@contextmanager
def opened(started: Any, width: int = 1280, complaint: str = "none", **options: Any) -> Iterator[Any]:
    """Open a page; only errors that contain `complaint` are allowed: by default none, with an empty text all."""
    page = started.new_page(viewport={"width": width, "height": 900}, **options)
    page.set_default_timeout(WAIT_MS)
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    yield page
    assert [one for one in complaints if complaint not in one] == []
    page.close()


PIXELS = """(canvas, [colour, within]) => {
  const of = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let count = 0;
  for (let i = 0; i < of.length; i += 4) {
    count += of[i + 3] > 0 && [0, 1, 2].reduce((sum, k) => sum + Math.abs(of[i + k] - colour[k]), 0) < within;
  }
  return count;
}"""


def pixels(canvas: Any, colour: tuple[int, int, int], within: int = 1) -> int:
    """Count the pixels of a canvas whose red, green and blue are together less than `within` off a colour's."""
    return int(canvas.evaluate(PIXELS, [colour, within]))


def press(form: Any, button: str, name: str = "Ann") -> None:
    """Press a button of a form on the page, as a person of this name."""
    form.get_by_label("Your name").fill(name)
    form.get_by_role("button", name=button).click()


def findings(page: Any) -> list[Any]:
    """Return the accessibility violations that axe finds in a view, of any severity."""
    from axe_playwright_python.sync_playwright import Axe

    found: list[Any] = Axe().run(page).response["violations"]
    return found


def expect(locator: Any) -> Any:
    """Return Playwright's expectation of an element, which waits."""
    from playwright.sync_api import expect as playwright_expect

    return playwright_expect(locator)
