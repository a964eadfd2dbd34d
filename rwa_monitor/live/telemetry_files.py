"""Telemetry from files, as the monitor core takes it: a table is one batch of one wheel, a recording many of many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rwa_monitor.diagnosis.model import Model
from rwa_monitor.errors import InputError
from rwa_monitor.formats.files import decode_utf8, display_name
from rwa_monitor.formats.table import file_format, read_table
from rwa_monitor.live.recording import Recording, read_recording
from rwa_monitor.messages import SamplesMessage, split_key
from rwa_monitor.physics.wheel import Wheel
from rwa_monitor.samples import Samples, concatenate


@dataclass(frozen=True, slots=True)
class SampleBatch:
    """Samples that came together; publisher and batch number where they came as a message."""

    samples: Samples
    publisher: str = ""
    batch: int | None = None


@dataclass(frozen=True, slots=True)
class WheelTelemetry:
    """All telemetry of one wheel in one file.

    Attributes
    ----------
    source
        The file, for messages.
    spacecraft, wheel
        From the bus key; "" and None for a table, which does not say.
    batches
        In the order in which they came.
    """

    source: str
    spacecraft: str
    wheel: str | None
    batches: Sequence[SampleBatch]


@dataclass(frozen=True, slots=True)
class TelemetryFile:
    """A file of telemetry.

    Attributes
    ----------
    telemetry
        One entry for each wheel in it.
    wheel, model
        What a recording carries; None for a table.
    problems
        What of the file could not be read, a sentence each.
    notes
        What was read and left out on purpose, a sentence each.
    """

    telemetry: Sequence[WheelTelemetry]
    wheel: Wheel | None = None
    model: Model | None = None
    problems: Sequence[str] = ()
    notes: Sequence[str] = ()


def read_telemetry(path: Path) -> TelemetryFile:
    """Read a CSV, Parquet or MCAP file whole.

    Raises
    ------
    InputError
        If the file cannot be used, or holds no samples.
    """
    source = display_name(path)
    if file_format(path) == "mcap":
        return _read_mcap(path, source)
    table = read_table(path)
    ignored = table.ignored_columns
    notes = [f"{source}: columns ignored: {', '.join(ignored)}"] if ignored else []
    return TelemetryFile([WheelTelemetry(source, "", None, [SampleBatch(table.samples)])], notes=notes)


def _read_mcap(path: Path, source: str) -> TelemetryFile:
    """Read a recording: the samples, and the wheel and model that it carries if it is one of ours."""
    recording = read_recording(path)
    wheel, model = (recording.attachments.get(name) for name in ("wheel.toml", "model.json"))
    telemetry, notes = _recorded(recording, source)
    return TelemetryFile(
        telemetry,
        Wheel.from_toml(decode_utf8(wheel, path), f"{source}: wheel.toml") if wheel else None,
        Model.from_json(model, f"{source}: model.json") if model else None,
        [f"{source}: {problem}" for problem in recording.problems],
        notes,
    )


def _recorded(recording: Recording, source: str) -> tuple[list[WheelTelemetry], list[str]]:
    """Return the samples of a recording, wheel by wheel, and a note on messages refused: the bus refused them too."""
    wheels: dict[str, list[SampleBatch]] = {}
    refused: list[InputError] = []
    for message in recording.messages:
        if message.schema != SamplesMessage.schema_name():
            continue
        batches = wheels.setdefault(message.topic, [])
        try:
            parsed = SamplesMessage.parse(message.data, message.topic)
        except InputError as error:
            refused.append(error)
            continue
        batches.append(SampleBatch(parsed.samples(), parsed.publisher, parsed.batch))
    notes = [f"{source}: {len(refused)} messages refused, the first: {refused[0]}"] if refused else []
    found = [_of_topic(source, topic, batches) for topic, batches in sorted(wheels.items()) if batches]
    if not found:
        raise InputError(source, f"holds no messages {SamplesMessage.schema_name()}")
    return found, notes


def _of_topic(source: str, topic: str, batches: list[SampleBatch]) -> WheelTelemetry:
    """Name the wheel as its topic does."""
    try:
        spacecraft, wheel, _ = split_key(topic)
    except InputError as error:
        raise InputError(source, error.reason, f"topic {topic}") from error
    return WheelTelemetry(source, spacecraft, wheel, batches)


def only_wheel(content: TelemetryFile, source: str) -> WheelTelemetry:
    """Return the telemetry of a file that must hold one wheel; raises InputError where it holds several."""
    if len(content.telemetry) != 1:
        wheels = ", ".join(f"{entry.spacecraft}/{entry.wheel}" for entry in content.telemetry)
        raise InputError(source, f"holds {len(content.telemetry)} wheels ({wheels}); one is wanted")
    return content.telemetry[0]


def joined(telemetry: WheelTelemetry) -> Samples:
    """Return all samples of a wheel as one table, in the order in which they came."""
    return concatenate([batch.samples for batch in telemetry.batches])
