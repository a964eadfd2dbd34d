"""Where no folder for compiled kernels can be written, one is made for the run."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rwa_monitor.cli import kernel_cache

NOWHERE = "/proc/rwa-monitor"  # nobody may make it, root included


@pytest.fixture
def nowhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Let nothing be written; returns where folders for a while are made."""
    monkeypatch.setattr(kernel_cache, "PACKAGE", Path(NOWHERE))
    monkeypatch.setenv("XDG_CACHE_HOME", NOWHERE)
    monkeypatch.setenv(kernel_cache.VARIABLE, NOWHERE)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def test_kernels_go_where_they_can_be_kept(nowhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kernel_cache.provide_kernel_cache()
    (folder,) = nowhere.iterdir()
    assert os.environ[kernel_cache.VARIABLE] == str(folder)
    assert folder.stat().st_mode & 0o777 == 0o700
    assert "each start compiles them" in capsys.readouterr().err


@pytest.mark.parametrize("way", ["variable", "package", "user"])
def test_a_folder_that_can_be_written_is_left_to_numba(
    nowhere: Path, way: str, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp(way)
    if way == "variable":
        monkeypatch.setenv(kernel_cache.VARIABLE, str(folder))
    elif way == "package":
        monkeypatch.setattr(kernel_cache, "PACKAGE", folder)
    else:
        monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    before = os.environ[kernel_cache.VARIABLE]
    kernel_cache.provide_kernel_cache()
    assert list(nowhere.iterdir()) == []
    assert os.environ[kernel_cache.VARIABLE] == before
