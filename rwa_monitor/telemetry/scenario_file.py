"""Scenario files: what happens to a simulated wheel, as TOML, with its size limited before it is parsed."""

from __future__ import annotations

from pathlib import Path

from rwa_monitor.simulation.scenario import MAX_SCENARIO_BYTES, Scenario
from rwa_monitor.telemetry.files import display_name, read_checked_text


def read_scenario(path: Path | None) -> Scenario:
    """Read a scenario; without a path, return the default one: a healthy wheel in orbit.

    Raises
    ------
    InputError
        If the file cannot be used; names the file, the key and the reason.
    """
    if path is None:
        return Scenario()
    return Scenario.from_toml(read_checked_text(path, MAX_SCENARIO_BYTES), display_name(path))
