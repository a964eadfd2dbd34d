"""What diagnoses depend on: the constants of the wheels of a fleet, and the model; read from files or a recording.

There is one wheel file for all wheels, and some wheels may have one of their own. In a recording they are attachments,
`wheel.toml` and `wheels/{spacecraft}/{wheel}.toml`, with model and settings, so that a replay needs nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from rwa_monitor.diagnosis.model import Model, built_in_model
from rwa_monitor.errors import InputError
from rwa_monitor.messages import KEY_PREFIX, REPLAY, SamplesMessage, split_key
from rwa_monitor.monitor.core import WheelCore
from rwa_monitor.monitor.recording import Recording
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.telemetry.files import PathLike, display_name, read_text
from rwa_monitor.wheel.effects.catalogue import build
from rwa_monitor.wheel.file_content import MAX_CONTENT_BYTES
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel

WheelKey = tuple[str, str]  # spacecraft and wheel
COMMON: Final = "wheel.toml"
MODEL: Final = "model.json"
OWN_PREFIX: Final = "wheels/"
SUFFIX: Final = ".toml"


@dataclass(frozen=True, slots=True)
class Setup:
    """What diagnoses depend on: the constants of all wheels of a fleet, and the learned model.

    Attributes
    ----------
    common
        Constants of every wheel that has none of its own.
    own
        Constants of single wheels, by spacecraft and wheel.
    model
        The learned classifiers of nominal and anomalous friction; None leaves anomalies undecided.
    """

    common: Wheel = field(default_factory=built_in_wheel)
    own: Mapping[WheelKey, Wheel] = field(default_factory=dict)
    model: Model | None = None

    def wheel(self, spacecraft: str, wheel: str) -> Wheel:
        """Return the constants of a wheel, which its replay shares."""
        return self.own.get((spacecraft, wheel.removesuffix(REPLAY)), self.common)

    def attachments(self) -> dict[str, bytes]:
        """Return the setup as attachments of a recording, by name, for `of` to read."""
        own = {f"{OWN_PREFIX}{'/'.join(key)}{SUFFIX}": wheel for key, wheel in sorted(self.own.items())}
        wheels = {name: wheel.to_toml().encode() for name, wheel in {COMMON: self.common, **own}.items()}
        return {**wheels, MODEL: self.model.to_json().encode() if self.model else b""}

    @classmethod
    def of(cls, recording: Recording) -> Setup:
        """Read the setup from a recording's attachments; raises InputError where one is missing or damaged."""

        def read(name: str) -> Wheel:
            return Wheel.from_toml(recording.text(name), f"{recording.path}: {name}")

        own = [name for name in recording.attachments if name.startswith(OWN_PREFIX)]
        wheels = {key_of_name(name.removeprefix(OWN_PREFIX)): read(name) for name in own}
        model = recording.text(MODEL)
        return cls(read(COMMON), wheels, Model.from_json(model, f"{recording.path}: {MODEL}") if model else None)

    @classmethod
    def found_in(cls, recording: Recording) -> Setup | None:
        """Read the setup as `of` does; return None for a recording that was not made by a monitor."""
        return cls.of(recording) if COMMON in recording.attachments else None

    def new_core(self, spacecraft: str, wheel: str) -> WheelCore:
        """Return a core in its initial state."""
        return WheelCore(self.wheel(spacecraft, wheel), self.model)

    def identity_of(self, spacecraft: str, wheel: str) -> tuple[str, str]:
        """Return what the diagnoses of a wheel depend on: the hashes of its constants and the model."""
        return self.wheel(spacecraft, wheel).sha256(), self.model.sha256() if self.model else ""


def key_of_name(name: str) -> WheelKey:
    """Return the wheel that a name `{spacecraft}/{wheel}.toml` denotes; raises InputError where it denotes none."""
    spacecraft, wheel, _ = split_key(f"{KEY_PREFIX}/{name.removesuffix(SUFFIX)}/{SamplesMessage.kind}")
    return spacecraft, wheel


# ---- from files, whose sizes are limited before they are parsed ------------------------------------------------------


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


def read_wheel_folder(folder: Path) -> dict[WheelKey, Wheel]:
    """Read the wheel files of single wheels, `{spacecraft}/{wheel}.toml` in a folder.

    Returns
    -------
    dict
        Wheels by spacecraft and name, sorted. Other files are ignored.

    Raises
    ------
    InputError
        If there is no such file, one cannot be used, or its name is not valid on the bus.
    """
    files = sorted(folder.glob("*/*.toml"))
    if not files:
        raise InputError(display_name(folder), "holds no SPACECRAFT/WHEEL.toml")
    found = {}
    for file in files:
        try:
            key = key_of_name(f"{file.parent.name}/{file.name}")
        except InputError as error:
            reason = "is named after no wheel: names are letters, digits and _.@+~-"
            raise InputError(display_name(file), reason) from error
        found[key] = read_wheel(file)
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
