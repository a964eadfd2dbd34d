"""Fixtures of the monitor room."""

from pathlib import Path

import pytest
import zenoh

from tests.monitor.processes import Listener
from tests.monitor.recordings import write_file
from tests.monitor.support import wheel


@pytest.fixture
def wheel_file(tmp_path: Path) -> Path:
    path = tmp_path / "wheel.toml"
    path.write_text(wheel().to_toml())
    return path


@pytest.fixture
def whole(tmp_path: Path) -> tuple[Path, list[bytes]]:
    path = tmp_path / "whole.mcap"
    return path, write_file(path)


@pytest.fixture
def listener(session: zenoh.Session) -> Listener:
    return Listener(session)
