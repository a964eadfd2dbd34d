"""Wheel files: wheel.toml in and out, with its size limited before it is parsed."""

from __future__ import annotations

from pathlib import Path

from rwa_monitor.formats.files import display_name, read_checked_text, write_text
from rwa_monitor.physics.wheel import MAX_WHEEL_FILE_BYTES, Wheel, built_in_wheel


def read_wheel(path: Path | None) -> Wheel:
    """Read a wheel.toml; without a path, return the built-in wheel.

    Raises
    ------
    InputError
        If the file cannot be used; names the file, the key and the reason.
    """
    if path is None:
        return built_in_wheel()
    return Wheel.from_toml(read_checked_text(path, MAX_WHEEL_FILE_BYTES), display_name(path))


def write_wheel(wheel: Wheel, path: Path) -> None:
    """Write a wheel.toml that `read_wheel` gives back."""
    write_text(path, wheel.to_toml())
