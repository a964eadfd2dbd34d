"""One browser and one embedded bus for the tests of the page."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from rwa_monitor.dashboard.server import DashboardOptions, Running, serve
from tests.dashboard.support import browser, opened, send_samples, send_windows, status
from tests.dashboard.test_recordings import RECORDING
from tests.dashboard.test_telemetry import with_friction
from tests.history.support import discrepancy


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser() as started:
        yield started


@pytest.fixture
def options() -> dict[str, Any]:
    """Further options of the dashboard, for a test to replace."""
    return {}


@pytest.fixture
def dashboard(session: zenoh.Session, tmp_path: Path, options: dict[str, Any]) -> Iterator[Running]:
    """A dashboard on an empty folder; no alarm on silent monitors, which a loaded machine would raise."""
    own = {"port": 0, "record": tmp_path, "token": "right", "silent_s": 0.0}
    with serve(DashboardOptions(**own | options), session) as running:
        yield running


@pytest.fixture
def failing_fleet(session: zenoh.Session, tmp_path: Path) -> Iterator[Running]:
    """A fleet of two wheels, of which one fails and has a discrepancy report, with samples; and a recording."""
    (tmp_path / RECORDING.name).write_bytes(RECORDING.read_bytes())
    with serve(DashboardOptions(0, tmp_path, token="right", silent_s=0.0), session) as running:
        for wheel, failing in (("wheel_1", False), ("wheel_2", True)):
            send_windows(session, wheel, failing=failing)
            session.put(f"rwa/sat/{wheel}/status", status(wheel))
        send_samples(session, "wheel_2", with_friction(4_000))
        session.put("rwa/sat/wheel_2/discrepancy", discrepancy(1, "wheel_2").to_json())
        yield running


@pytest.fixture
def complaint() -> str:
    """Text of the errors that a page may log (see `opened`); a test that allows all of them gives an empty one."""
    return "none"


@pytest.fixture
def look() -> dict[str, Any]:
    """Options of the page, for a test to replace."""
    return {}


@pytest.fixture
def page(chromium: Any, complaint: str, look: dict[str, Any]) -> Iterator[Any]:
    with opened(chromium, complaint=complaint, **look) as one:
        yield one
