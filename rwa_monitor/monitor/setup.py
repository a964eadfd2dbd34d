"""What diagnoses depend on: the constants of the wheels of a fleet, and the model.

One wheel file is for all wheels, and some wheels may have one of their own. In a recording they are attachments,
`wheel.toml` and `wheels/{spacecraft}/{wheel}.toml`, beside model and settings, so that a replay needs nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from rwa_monitor.diagnosis.model import Model
from rwa_monitor.messages import KEY_PREFIX, REPLAY, SamplesMessage, split_key
from rwa_monitor.monitor.core import WheelCore
from rwa_monitor.monitor.recording.reader import Recording
from rwa_monitor.wheel.wheel import Wheel

WheelKey = tuple[str, str]  # spacecraft and wheel
COMMON: Final = "wheel.toml"
MODEL: Final = "model.json"
OWN_PREFIX: Final = "wheels/"
SUFFIX: Final = ".toml"


@dataclass(frozen=True, slots=True)
class WheelSet:
    """The constants of all wheels of a fleet.

    Attributes
    ----------
    common
        Of every wheel that has none of its own.
    own
        Of single wheels, by spacecraft and wheel.
    """

    common: Wheel
    own: Mapping[WheelKey, Wheel] = field(default_factory=dict)

    def of(self, spacecraft: str, wheel: str) -> Wheel:
        """Return the constants of a wheel, which are those of its replay, too."""
        return self.own.get((spacecraft, wheel.removesuffix(REPLAY)), self.common)

    def attachments(self) -> dict[str, bytes]:
        """Return all constants as attachments of a recording, by name."""
        return {COMMON: self.common.to_toml().encode()} | {
            f"{OWN_PREFIX}{spacecraft}/{name}{SUFFIX}": wheel.to_toml().encode()
            for (spacecraft, name), wheel in sorted(self.own.items())
        }

    @classmethod
    def of_recording(cls, recording: Recording) -> WheelSet:
        """Read a set from the attachments of a recording; raises InputError if one is missing or cannot be used."""

        def read(name: str) -> Wheel:
            return Wheel.from_toml(recording.text(name), f"{recording.path}: {name}")

        own = [name for name in recording.attachments if name.startswith(OWN_PREFIX)]
        return cls(read(COMMON), {key_of_name(name.removeprefix(OWN_PREFIX)): read(name) for name in own})


def key_of_name(name: str) -> WheelKey:
    """Return the wheel that a file `{spacecraft}/{wheel}.toml` is of; raises InputError where it names none."""
    spacecraft, wheel, _ = split_key(f"{KEY_PREFIX}/{name.removesuffix(SUFFIX)}/{SamplesMessage.kind}")
    return spacecraft, wheel


@dataclass(frozen=True, slots=True)
class Setup:
    """What a recording was made with: the constants of its wheels, and what was learned."""

    wheels: WheelSet
    model: Model | None

    @classmethod
    def of(cls, recording: Recording) -> Setup:
        """Read the setup from a recording's attachments; raises InputError where one is missing or damaged."""
        source = str(recording.path)
        wheels = WheelSet.of_recording(recording)
        model_text = recording.text(MODEL)
        model = Model.from_json(model_text, f"{source}: {MODEL}") if model_text else None
        return cls(wheels, model)

    def attachments(self) -> dict[str, bytes]:
        """Return the setup as attachments of a recording, by name, as `of` reads them."""
        return {**self.wheels.attachments(), MODEL: self.model.to_json().encode() if self.model else b""}

    def new_core(self, spacecraft: str, wheel: str) -> WheelCore:
        """Return the core of a wheel of which nothing is known yet."""
        return WheelCore(self.wheels.of(spacecraft, wheel), self.model)

    def identity_of(self, spacecraft: str, wheel: str) -> tuple[str, str]:
        """Return what the diagnoses of a wheel depend on: the hashes of its constants and the model."""
        return self.wheels.of(spacecraft, wheel).sha256(), self.model.sha256() if self.model else ""
