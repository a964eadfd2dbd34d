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
from rwa_monitor.telemetry.reader import Decoding, joined, only_wheel
from rwa_monitor.telemetry.table import FileFormat, file_format, write_csv, write_parquet
from tests.monitor.support import KEY, telemetry, wheel
from tests.telemetry import bags
from tests.telemetry.packet_writer import write_packets

ROWS = 2_300  # two windows of the test wheel, and a part of one


def write_recording(samples: Samples, path: Path) -> None:
    writer = RecordingWriter(path, (), lambda: 0)
    for number, start in enumerate(range(0, len(samples), 256)):
        payload = samples_json(samples[start : start + 256], "p", number)
        writer.write(EncodedMessage(KEY, SamplesMessage.schema_name(), payload, 0))
    writer.close()


def write_bag(samples: Samples, path: Path) -> Decoding:
    bags.write_bag(samples, path)
    return bags.decoding(bags.map_of(samples))


# A file, how to write it, and what is lost of a value by it, relative and absolute.
FORMATS: dict[FileFormat, tuple[str, Callable[[Samples, Path], Decoding | None], float, float]] = {
    "csv": ("t.csv", write_csv, 0, 0),
    "parquet": ("t.parquet", lambda samples, path: write_parquet(dict(samples.channels()), path), 0, 0),
    "mcap": ("t.mcap", write_recording, 0, 0),
    "packets": ("t.ccsds", write_packets, 2**-23, 0.0026),
    "ros2": ("t.mcap", write_bag, 1e-15, 0),  # mA and back
}


def written(name: FileFormat, samples: Samples, folder: Path) -> tuple[Path, Decoding]:
    file, write, _, _ = FORMATS[name]
    return folder / file, write(samples, folder / file) or Decoding()


def test_every_format_keeps_the_contract() -> None:
    assert set(READERS) == set(FORMATS) == set(get_args(FileFormat))


@pytest.mark.parametrize("name", FORMATS)
def test_what_was_written_comes_back(name: FileFormat, tmp_path: Path) -> None:
    samples = telemetry(ROWS)
    _, _, relative, absolute = FORMATS[name]
    path, decoding = written(name, samples, tmp_path)
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
    path, decoding = written(name, telemetry(ROWS), tmp_path)
    found = Diagnose(wheel(), decoding)(path)
    assert [diagnosis.partial for diagnosis in found.diagnoses] == [False, False, True]
    assert {diagnosis.source for diagnosis in found.diagnoses} == {str(path)}
    read = joined(only_wheel(read_telemetry(path, decoding), "test"))
    assert find_discrepancy([("test", read)], wheel()).result.verdict in ("adequate", "inadequate", "untestable")
    # It has read them all: what they lack for a wheel file is the same from every format.
    with pytest.raises(InputError, match=r"uncertain by 5.4 %: the speed hardly leaves 198.1 rad/s"):
        identify([("test", read)], wheel(), systems=False)


def test_without_its_extra_a_format_reports_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, decoding = written("packets", telemetry(20), tmp_path)
    definition_of.cache_clear()
    monkeypatch.setitem(sys.modules, "space_packet_parser", None)  # as if it were not installed
    with pytest.raises(RwaMonitorError, match=r"missing: pip install 'rwa-monitor\[ccsds\]'"):
        read_telemetry(path, decoding)


def test_a_file_without_a_known_suffix_is_of_packets_where_packets_are_described(tmp_path: Path) -> None:
    path, decoding = written("packets", telemetry(20), tmp_path)
    renamed = path.rename(tmp_path / "day.tlm")
    assert len(joined(only_wheel(read_telemetry(renamed, decoding), "test"))) == 20
    with pytest.raises(InputError, match="UTF-8"):
        read_telemetry(renamed)
