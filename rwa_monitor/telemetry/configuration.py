"""The files that configure the program: wheel, scenario and model, their sizes limited before they are parsed."""

from __future__ import annotations

from pathlib import Path

from rwa_monitor.diagnosis.model import Model, built_in_model
from rwa_monitor.errors import InputError
from rwa_monitor.messages import KEY_PREFIX, SamplesMessage, split_key
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.telemetry.files import PathLike, display_name, read_text
from rwa_monitor.wheel.effects.catalogue import build
from rwa_monitor.wheel.file_content import MAX_CONTENT_BYTES
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel


def read_wheel(path: PathLike | None = None) -> Wheel:
    """Read a wheel file (wheel.toml); None gives the built-in wheel of the paper's examples.

    Raises
    ------
    InputError
        If the file cannot be read or describes no wheel; names the file, the key and the reason.
    """
    if path is None:
        return built_in_wheel()
    text, source = _content(path)
    wheel = Wheel.from_toml(text, source)
    for block in wheel.effect:
        try:
            build(block)
        except InputError as error:
            raise InputError(f"{source}: effect {block.name}", error.reason, error.place) from error
    return wheel


def read_wheel_folder(folder: Path) -> dict[tuple[str, str], Wheel]:
    """Read the wheel files of single wheels, `{spacecraft}/{wheel}.toml` in a folder.

    Returns
    -------
    dict
        Wheels by spacecraft and name, sorted. Other files are left alone.

    Raises
    ------
    InputError
        If there is no such file, one cannot be used, or the bus has no such names.
    """
    files = sorted(folder.glob("*/*.toml"))
    if not files:
        raise InputError(display_name(folder), "holds no SPACECRAFT/WHEEL.toml")
    found = {}
    for file in files:
        try:
            spacecraft, wheel, _ = split_key(f"{KEY_PREFIX}/{file.parent.name}/{file.stem}/{SamplesMessage.kind}")
        except InputError as error:
            raise InputError(
                display_name(file), "is named after no wheel: names are letters, digits and _.@+~-"
            ) from error
        found[spacecraft, wheel] = read_wheel(file)
    return found


def read_scenario(path: PathLike | None = None) -> Scenario:
    """Read a scenario; without a path, return the default one: a healthy wheel in orbit.

    Raises
    ------
    InputError
        If the file cannot be used; names the file, the key and the reason.
    """
    return Scenario() if path is None else Scenario.from_toml(*_content(path))


def read_model(path: PathLike | None = None) -> Model:
    """Read a model (MODEL.json, from `rwa-monitor train`); None gives the built-in one.

    Raises
    ------
    InputError
        If the file cannot be used; names the file, the field and the reason.
    """
    return built_in_model() if path is None else Model.from_json(*_content(path))


def _content(path: PathLike) -> tuple[str, str]:
    """Return the text of a file, and its name for messages."""
    return read_text(path, MAX_CONTENT_BYTES), display_name(path)
