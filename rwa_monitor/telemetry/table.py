"""The sample table: telemetry of one wheel as CSV or Parquet, with fixed column names and units.

A table is read whole or refused: with its file, row, column and reason. Columns that are not known are left out and
returned by name, to be reported. Values that are not finite stay as they are: they are masked
later, where they are also counted.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Final, Literal

from rwa_monitor.errors import InputError, needs_extra
from rwa_monitor.samples import Samples
from rwa_monitor.telemetry.ccsds_packets import write_packets
from rwa_monitor.telemetry.columns import SampleTable
from rwa_monitor.telemetry.csv_table import read_csv, write_csv
from rwa_monitor.telemetry.files import display_name, unreadable
from rwa_monitor.telemetry.pulses import speed_of_pulses

PARQUET_MAGIC: Final = b"PAR1"
MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
# The record that follows: its opcode, its length, and as its first field the profile, a text after its length.
ROS2_PROFILE: Final = b"\x04\x00\x00\x00ros2"
_PROFILE_AT: Final = len(MCAP_MAGIC) + 1 + 8

PACKET_SUFFIXES: Final = (".ccsds", ".bin")  # space packets have no first bytes of their own either

FileFormat = Literal["csv", "parquet", "mcap", "packets", "ros2"]


def parquet() -> ModuleType:
    """Return `parquet_table`, which belongs to an extra and whose Arrow takes a third of a second to import.

    Raises
    ------
    MissingExtraError
        If what it needs is not installed.
    """
    with needs_extra("parquet"):
        from rwa_monitor.telemetry import parquet_table  # noqa: PLC0415
    return parquet_table


def _write_parquet(samples: Samples, path: Path) -> None:
    parquet().write_parquet(samples, path)


WRITERS: Final[dict[str, Callable[[Samples, Path], None]]] = {
    ".csv": write_csv,
    ".parquet": _write_parquet,
    ".ccsds": write_packets,
}


def file_format(path: Path) -> FileFormat:
    """Return a file's format: by its first bytes, and where it has none of its own, by its suffix; else it is CSV.

    Raises
    ------
    InputError
        If the file cannot be read, is empty, or has another format than its suffix.
    """
    try:
        with path.open("rb") as file:
            head = file.read(_PROFILE_AT + len(ROS2_PROFILE))
    except OSError as error:
        raise unreadable(path, error) from error
    if not head:
        raise InputError(display_name(path), "is empty")
    if head.startswith(PARQUET_MAGIC):
        return "parquet"
    if head.startswith(MCAP_MAGIC):
        return "ros2" if head[_PROFILE_AT:] == ROS2_PROFILE else "mcap"
    suffix = path.suffix.lower()
    if suffix in (".parquet", ".mcap"):
        raise InputError(display_name(path), f"is no {suffix[1:]} file (its first bytes are {head[:8]!r})")
    return "packets" if suffix in PACKET_SUFFIXES else "csv"


def read_table(path: Path, pulses_per_turn: int | None = None) -> SampleTable:
    """Read a sample table, CSV or Parquet, or a table of pulses, of which the speed is worked out.

    Parameters
    ----------
    path
        The table.
    pulses_per_turn
        Of the wheel; None where that is not known.

    Raises
    ------
    InputError
        If the table cannot be used; names the file, the row, the column and the reason.
    MissingExtraError
        If what it takes to read Parquet is not installed.
    """
    table: SampleTable = parquet().read_parquet(path) if file_format(path) == "parquet" else read_csv(path)
    if not table.are_pulses:
        return table
    source = display_name(path)
    if pulses_per_turn is None:
        raise InputError(
            source, "holds pulses: how many make a turn is pulses_per_turn, under [wheel] in the wheel file"
        )
    turning = speed_of_pulses(table.samples, pulses_per_turn, source)
    note = f"{source}: {turning.in_words(len(table.samples), pulses_per_turn)}"
    return SampleTable(turning.samples, table.ignored_columns, notes=(note,))


def table_writer(path: Path) -> Callable[[Samples, Path], None]:
    """Return the function that writes samples in the format that the file's suffix names.

    Raises
    ------
    InputError
        If no format has the suffix.
    """
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        *others, last = WRITERS
        suffixes = f"{', '.join(others)} or {last}"
        raise InputError(display_name(path), f"must end in {suffixes}: the suffix chooses the format")
    return writer
