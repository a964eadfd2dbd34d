"""The contract of every format: the same telemetry comes back, and what is no such file is refused in one line.

A format is in `READERS`, and here with a function that writes telemetry as somebody else would.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from rwa_monitor.batch.tasks import Diagnose
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.identification.identify import identify
from rwa_monitor.messages import EncodedMessage, SamplesMessage, samples_json
from rwa_monitor.monitor.recorder import RecordingWriter
from rwa_monitor.monitor.telemetry_files import READERS, read_telemetry
from rwa_monitor.samples import Samples
from rwa_monitor.telemetry.ccsds_packets import definition_of
from rwa_monitor.telemetry.reader import Decoding, joined, only_wheel, read_decoding
from rwa_monitor.telemetry.table import FileFormat, file_format, write_csv, write_parquet
from tests.monitor.support import KEY, telemetry, wheel
from tests.telemetry import bags
from tests.telemetry.packet_writer import write_packets

ROWS = 2_300  # two windows of the test wheel, and a part of one


def written_csv(samples: Samples, folder: Path) -> tuple[Path, Decoding]:
    write_csv(samples, folder / "t.csv")
    return folder / "t.csv", Decoding()


def written_parquet(samples: Samples, folder: Path) -> tuple[Path, Decoding]:
    write_parquet(dict(samples.channels()), folder / "t.parquet")
    return folder / "t.parquet", Decoding()


def written_mcap(samples: Samples, folder: Path) -> tuple[Path, Decoding]:
    writer = RecordingWriter(folder / "t.mcap", (), lambda: 0)
    for number, start in enumerate(range(0, len(samples), 256)):
        payload = samples_json(samples[start : start + 256], "p", number)
        writer.write(EncodedMessage(KEY, SamplesMessage.schema_name(), payload, 0))
    writer.close()
    return folder / "t.mcap", Decoding()


def written_packets(samples: Samples, folder: Path) -> tuple[Path, Decoding]:
    path = folder / "t.ccsds"
    write_packets(samples, path)
    return path, read_decoding(Path(f"{path}.map.toml"), Path(f"{path}.xtce.xml"))


def written_bag(samples: Samples, folder: Path) -> tuple[Path, Decoding]:
    return bags.write_bag(samples, folder / "bag.mcap"), bags.decoding(bags.map_of(samples))


# How to write each format, and what is lost of a value by it, relative and absolute.
FORMATS: dict[FileFormat, tuple[Callable[[Samples, Path], tuple[Path, Decoding]], float, float]] = {
    "csv": (written_csv, 0, 0),
    "parquet": (written_parquet, 0, 0),
    "mcap": (written_mcap, 0, 0),
    "packets": (written_packets, 2**-23, 0.0026),
    "ros2": (written_bag, 1e-15, 0),  # mA and back
}


def test_every_format_keeps_the_contract() -> None:
    assert set(READERS) == set(FORMATS) == set(get_args(FileFormat))


@pytest.mark.parametrize("name", FORMATS)
def test_what_was_written_comes_back(name: FileFormat, tmp_path: Path) -> None:
    samples = telemetry(ROWS)
    write, relative, absolute = FORMATS[name]
    path, decoding = write(samples, tmp_path)
    assert file_format(path) == name
    content = read_telemetry(path, decoding)
    assert (list(content.problems), list(content.notes)) == ([], [])
    entry = only_wheel(content, "test")
    assert entry.source == str(path)
    read = joined(entry)
    assert read.time_ns.tolist() == samples.time_ns.tolist()
    assert [channel for channel, _ in read.channels()] == [channel for channel, _ in samples.channels()]
    for (_, one), (channel, two) in zip(read.channels(), samples.channels(), strict=True):
        # The absolute loss is that of a temperature; the other channels lose a thousandth of their own at most.
        limit = absolute if channel == "bearing_temperature_degC" else min(absolute, 1e-3 * np.abs(two).max())
        np.testing.assert_allclose(one, two, rtol=relative, atol=limit, err_msg=channel)
    path.unlink()
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_telemetry(path, decoding)


@pytest.mark.parametrize("name", FORMATS)
def test_every_work_on_recordings_takes_it(name: FileFormat, tmp_path: Path) -> None:
    samples = telemetry(ROWS)
    path, decoding = FORMATS[name][0](samples, tmp_path)
    found = Diagnose(wheel(), decoding)(path)
    assert [diagnosis.partial for diagnosis in found.diagnoses] == [False, False, True]
    assert {diagnosis.source for diagnosis in found.diagnoses} == {str(path)}
    read = joined(only_wheel(read_telemetry(path, decoding), "test"))
    assert find_discrepancy([("test", read)], wheel()).result.verdict in ("adequate", "inadequate", "untestable")
    # It has read them all: what they lack for a wheel file is the same from every format.
    with pytest.raises(InputError, match=r"uncertain by 5.4 %: the speed hardly leaves 198.1 rad/s"):
        identify([("test", read)], wheel(), systems=False)


def test_without_its_extra_a_format_reports_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, decoding = written_packets(telemetry(ROWS)[:20], tmp_path)
    definition_of.cache_clear()
    monkeypatch.setitem(sys.modules, "space_packet_parser", None)  # as if it were not installed
    with pytest.raises(RwaMonitorError, match=r"missing: pip install 'rwa-monitor\[ccsds\]'"):
        read_telemetry(path, decoding)


def test_a_file_without_a_known_suffix_is_of_packets_where_packets_are_described(tmp_path: Path) -> None:
    path, decoding = written_packets(telemetry(ROWS)[:20], tmp_path)
    renamed = path.rename(tmp_path / "day.tlm")
    assert len(joined(only_wheel(read_telemetry(renamed, decoding), "test"))) == 20
    with pytest.raises(InputError, match="UTF-8"):
        read_telemetry(renamed)
