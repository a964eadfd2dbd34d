"""One browser and one embedded bus for the tests of the page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import zenoh

from rwa_monitor.monitor.bus import BusOptions, open_session
from tests.dashboard.support import browser


@pytest.fixture
def session() -> Iterator[zenoh.Session]:
    with open_session(BusOptions()) as opened:
        yield opened


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser() as started:
        yield started
