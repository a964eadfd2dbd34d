"""Fixtures of the live room."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.live.support import wheel


@pytest.fixture
def wheel_file(tmp_path: Path) -> Path:
    path = tmp_path / "wheel.toml"
    path.write_text(wheel().to_toml())
    return path
