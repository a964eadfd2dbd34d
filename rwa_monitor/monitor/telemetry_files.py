"""Telemetry from files of every format: selection of the reader, and the readers of tables and bus recordings."""

from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from rwa_monitor.errors import InputError
from rwa_monitor.messages import SamplesMessage, split_key
from rwa_monitor.monitor.recording import read_recording
from rwa_monitor.monitor.setup import Setup
from rwa_monitor.telemetry.ccsds_packets import read_packets
from rwa_monitor.telemetry.files import display_name
from rwa_monitor.telemetry.reader import Decoding, Reader, SampleBatch, TelemetryFile, WheelTelemetry
from rwa_monitor.telemetry.ros2_bag import read_bag
from rwa_monitor.telemetry.table import FileFormat, file_format, read_table
from rwa_monitor.wheel.torque_balance import FRICTION_CHANNELS
from rwa_monitor.words import counted

NO_DECODING: Final = Decoding()


def read_telemetry(path: Path, decoding: Decoding = NO_DECODING) -> TelemetryFile:
    """Read all of a file of telemetry.

    Parameters
    ----------
    path
        A file of any format in `READERS`, recognised by its first bytes, else by its suffix.
    decoding
        Settings to decode space packets and ROS 2 bags.

    Raises
    ------
    InputError
        If the file cannot be used, or holds no samples.
    """
    kind = file_format(path)
    if kind == "csv" and decoding.xtce is not None and path.suffix.lower() != ".csv":
        kind = "packets"  # neither first bytes nor suffix identify the format, but a definition of packets is given
    content, source = READERS[kind](path, decoding), display_name(path)
    problems, notes = ([f"{source}: {line}" for line in lines] for lines in (content.problems, content.notes))
    return content._replace(problems=problems, notes=notes)


def _read_table(path: Path, decoding: Decoding) -> TelemetryFile:
    """Read a sample table, CSV or Parquet: its columns have names with units."""
    source, table = display_name(path), read_table(path, decoding.pulses_per_turn)
    if not decoding.motor_off and all(getattr(table.samples, name) is None for name in FRICTION_CHANNELS):
        reason = (
            f"friction cannot be derived: the table has none of {', '.join(FRICTION_CHANNELS)}; of a wheel that runs"
            " down with its motor off, --motor-off or motor_off = true in the wheel file's [friction] will do"
        )
        raise InputError(source, "; ".join([reason, *table.notes]))
    return TelemetryFile([WheelTelemetry(source, "", None, [SampleBatch(table.samples)])], notes=table.notes)


def _read_mcap(path: Path, decoding: Decoding) -> TelemetryFile:
    """Read a recording: the samples by wheel, and the attached wheel and model if a monitor made it.

    Messages that cannot be parsed are counted in a note: the monitor refused them, too.
    """
    del decoding
    source, recording = display_name(path), read_recording(path)
    setup = Setup.found_in(recording)
    wheels: defaultdict[str, list[SampleBatch]] = defaultdict(list)
    refused: list[InputError] = []
    for message in recording.messages:
        if message.schema == SamplesMessage.schema_name():
            try:
                parsed = SamplesMessage.parse(message.payload, message.topic)
            except InputError as error:
                refused.append(error)
                continue
            batch = SampleBatch(parsed.samples(), parsed.publisher, parsed.batch, parsed.data)
            wheels[message.topic].append(batch)
    telemetry = []
    for topic, batches in sorted(wheels.items()):
        try:
            spacecraft, wheel, _ = split_key(topic)
        except InputError as error:
            raise InputError(source, error.reason, f"topic {topic}") from error
        constants = setup.wheel(spacecraft, wheel) if setup else None
        telemetry.append(WheelTelemetry(source, spacecraft, wheel, batches, constants))
    if not telemetry:
        raise InputError(source, f"holds no messages {SamplesMessage.schema_name()}")
    return TelemetryFile(
        telemetry,
        setup.model if setup else None,
        recording.problems,
        [f"{counted(len(refused), 'message')} refused, the first: {refused[0]}"] if refused else [],
    )


READERS: Final[Mapping[FileFormat, Reader]] = {
    "csv": _read_table,
    "parquet": _read_table,
    "mcap": _read_mcap,
    "packets": read_packets,
    "ros2": read_bag,
}
