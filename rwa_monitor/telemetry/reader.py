"""Telemetry from files, as the monitor core takes it, and the one interface through which every format is read.

A table is one batch of one wheel, a recording many of many. A reader takes a path and what is needed to understand
telemetry that does not name its channels, and returns a `TelemetryFile`; `rwa_monitor.monitor.telemetry_files` chooses
it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.diagnosis.model import Model
from rwa_monitor.errors import InputError
from rwa_monitor.samples import Samples, Timeliness, concatenate
from rwa_monitor.telemetry.files import PathLike, display_name, read_text
from rwa_monitor.wheel.file_content import MAX_CONTENT_BYTES
from rwa_monitor.wheel.wheel import Wheel

MAX_XTCE_BYTES: Final = 4_000_000  # the telemetry of a whole satellite has some thousand parameters


class SampleBatch(NamedTuple):
    """Samples that came together; publisher, batch number and data as in the message, where they came as one."""

    samples: Samples
    publisher: str = ""
    batch: int | None = None
    data: Timeliness | None = None


class WheelTelemetry(NamedTuple):
    """All telemetry of one wheel in one file.

    Attributes
    ----------
    source
        The file, for messages.
    spacecraft, wheel
        From the bus key or the map; "" and None for a table, which names none.
    batches
        In the order in which they came.
    constants
        What a recording carries for this wheel; None for every other file.
    """

    source: str
    spacecraft: str
    wheel: str | None
    batches: Sequence[SampleBatch]
    constants: Wheel | None = None


class TelemetryFile(NamedTuple):
    """A file of telemetry.

    Attributes
    ----------
    telemetry
        One entry for each wheel in it.
    model
        What a recording carries; None for every other file.
    problems
        What of the file could not be read, a sentence each.
    notes
        What was read and left out on purpose, a sentence each.
    """

    telemetry: Sequence[WheelTelemetry]
    model: Model | None = None
    problems: Sequence[str] = ()
    notes: Sequence[str] = ()


class TextFile(NamedTuple):
    """A text and the file it came from, for messages."""

    source: str
    text: str


class Decoding(NamedTuple):
    """What it takes to understand telemetry that does not name its channels; texts, so that it travels to workers.

    Attributes
    ----------
    map
        Which parameter or topic is which channel of which wheel (`telemetry_map`).
    xtce
        What space packets look like.
    motor_off
        Whether a table of time and speed alone will do: with the motor off friction is the inertia's torque.
    pulses_per_turn
        Of a table of pulses; None where that is not known.
    """

    map: TextFile | None = None
    xtce: TextFile | None = None
    motor_off: bool = False
    pulses_per_turn: int | None = None

    def of_wheel(self, wheel: Wheel | None) -> Decoding:
        """Return what telemetry of a wheel is read with."""
        if wheel is None:
            return self
        return self._replace(motor_off=bool(wheel.friction.motor_off), pulses_per_turn=wheel.pulses_per_turn)

    def sha256(self) -> str | None:
        """Return a hash of both texts; None where there is none."""
        texts = [file.text if file else None for file in (self.map, self.xtce)]
        return hashlib.sha256(json.dumps(texts).encode()).hexdigest() if any(texts) else None


# A format: reads a file whole, or refuses it with an InputError that names file, place and reason.
Reader = Callable[[Path, Decoding], TelemetryFile]


def read_decoding(map_file: PathLike | None, xtce_file: PathLike | None) -> Decoding:
    """Read a map and an XTCE definition, where given; raises InputError where one cannot be read."""

    def text_of(path: PathLike | None, limit: int) -> TextFile | None:
        return None if path is None else TextFile(display_name(path), read_text(path, limit))

    return Decoding(text_of(map_file, MAX_CONTENT_BYTES), text_of(xtce_file, MAX_XTCE_BYTES))


def only_wheel(content: TelemetryFile, source: str) -> WheelTelemetry:
    """Return the telemetry of a file that must hold one wheel; raises InputError where it holds several."""
    if len(content.telemetry) != 1:
        wheels = ", ".join(f"{entry.spacecraft}/{entry.wheel}" for entry in content.telemetry)
        raise InputError(source, f"holds {len(content.telemetry)} wheels ({wheels}); one is wanted")
    return content.telemetry[0]


def joined(telemetry: WheelTelemetry) -> Samples:
    """Return all samples of a wheel as one table, in the order of their time, of two with one time the first."""
    samples = concatenate([batch.samples for batch in telemetry.batches])
    if (np.diff(samples.time_ns) > 0).all():
        return samples
    return samples[np.unique(samples.time_ns, return_index=True)[1]]
