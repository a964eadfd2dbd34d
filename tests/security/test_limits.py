"""Limits hold before anything is parsed: sizes, depths, what unpacks to more than it seems; each is one clear line."""

import json
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from rwa_monitor.messages import MAX_MESSAGE_BYTES, MAX_SAMPLES, MESSAGES, SamplesMessage
from rwa_monitor.monitor.bus import BusOptions, session_config
from rwa_monitor.monitor.recording import (
    MAX_CHUNK_BYTES,
    MAX_FILE_BYTES,
    MAX_FLEET_FILE_BYTES,
    MAX_WORK_BYTES,
    read_recording,
)
from rwa_monitor.monitor.setup import read_model, read_scenario, read_wheel
from rwa_monitor.telemetry.files import PIECE_BYTES
from rwa_monitor.telemetry.labels import MAX_LABELS_BYTES, read_labels
from rwa_monitor.telemetry.table import MAX_COLUMNS, MAX_ROWS, MAX_TABLE_BYTES, read_table
from rwa_monitor.wheel.file_content import MAX_CONTENT_BYTES
from tests.monitor.recordings import chunk, record
from tests.program import refused, run

DEEP = 100_000
READERS: dict[str, tuple[Callable[[Path], object], int]] = {
    "wheel.toml": (read_wheel, MAX_CONTENT_BYTES),
    "scenario.toml": (read_scenario, MAX_CONTENT_BYTES),
    "model.json": (read_model, MAX_CONTENT_BYTES),
    "labels.csv": (read_labels, MAX_LABELS_BYTES),
    "table.csv": (read_table, MAX_TABLE_BYTES),
    "table.parquet": (read_table, MAX_TABLE_BYTES),
    "recording.mcap": (read_recording, MAX_FILE_BYTES),
    "zenoh.json5": (lambda path: session_config(BusOptions(config=path)), MAX_CONTENT_BYTES),
}
MAGIC = {".parquet": b"PAR1", ".mcap": MCAP0_MAGIC}


@pytest.mark.parametrize("name", list(READERS))
def test_a_file_larger_than_its_limit_is_refused_unread(name: str, tmp_path: Path) -> None:
    read, limit = READERS[name]
    path = tmp_path / name
    with path.open("wb") as file:
        file.write(MAGIC.get(path.suffix, b""))
        file.truncate(limit + 1)  # of holes: it takes no room, and reading it would take seconds
    assert "larger than" in refused(lambda: read(path))


# ---- messages --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("message", MESSAGES)
def test_a_message_too_large_too_deep_or_too_long_is_refused(message: type[SamplesMessage]) -> None:
    assert "more than" in refused(lambda: message.parse(b" " * (MAX_MESSAGE_BYTES + 1), "key"))
    for bracket in (b"[", b'{"a":'):
        refused(lambda bracket=bracket: message.parse(bracket * DEEP, "key"))
        refused(lambda bracket=bracket: message.parse(b'{"time_ns":' + bracket * DEEP, "key"))
    refused(lambda: message.parse(b'{"time_ns":[' + b"9" * 1_000_000 + b"]}", "key"))


def test_a_message_of_too_many_samples_is_refused() -> None:
    payload = json.dumps({"time_ns": list(range(MAX_SAMPLES + 1)), "speed_rad_s": [0.0] * (MAX_SAMPLES + 1)})
    assert "100000" in refused(lambda: SamplesMessage.parse(payload.encode(), "key"))


# ---- text files ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("wheel.toml", "a = " + "[" * DEEP),
        ("wheel.toml", ".".join("a" * 20_000) + " = 1"),
        ("wheel.toml", "[" + ".".join("a" * 20_000) + "]"),
        ("wheel.toml", "[wheel]\nname = 'x'\nsample_period_s = 1e999999"),
        ("wheel.toml", f"[wheel]\n{'k' * 900_000} = 1\nname = 'x'\nsample_period_s = 1"),
        ("scenario.toml", "a = " + "{a = " * DEEP),
        ("model.json", "[" * DEEP),
        ("model.json", '{"anomalies":' + "[" * DEEP),
        ("model.json", json.dumps({"x" * 900_000: 1})),
        ("table.csv", "x" * (PIECE_BYTES + 1)),
        ("table.csv", ",".join("a" * (MAX_COLUMNS + 1)) + "\n1"),
        ("table.csv", "time_ns,speed_rad_s,friction_torque_Nm\n" + ",,\n" * 10),
        ("table.csv", "time_ns,speed_rad_s,friction_torque_Nm\n" + "1" * 1_000_000 + ",1,1\n"),
        ("labels.csv", "file,dry,viscous\n" + '"' * 100_001),
    ],
)
def test_text_that_is_deep_or_long_where_it_should_not_be_is_refused(name: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(text)
    assert name in refused(lambda: READERS[name][0](path))


# ---- tables ----------------------------------------------------------------------------------------------------------


def test_rows_are_counted_before_a_table_is_parsed(tmp_path: Path) -> None:
    path = tmp_path / "many.csv"
    path.write_bytes(b"time_ns,speed_rad_s\n" + b"," * 7 + b",\n" * (MAX_ROWS + 1))
    assert "rows" in refused(lambda: read_table(path))


def test_rows_that_a_small_parquet_promises_are_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "many.parquet"
    many = pa.nulls(MAX_ROWS + 1)
    pq.write_table(pa.table({"time_ns": many, "speed_rad_s": many, "friction_torque_Nm": many}), path)
    assert path.stat().st_size < 200_000
    assert "20,000,001 rows" in refused(lambda: read_table(path))


def test_a_column_of_texts_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "texts.parquet"
    texts = pa.DictionaryArray.from_arrays(np.zeros(1_000, np.int32), ["x" * 1_000_000])
    pq.write_table(pa.table({"time_ns": np.arange(1_000), "speed_rad_s": texts}), path)
    before = pa.total_allocated_bytes()
    assert "not numbers" in refused(lambda: read_table(path))
    assert pa.total_allocated_bytes() <= before


# ---- recordings ------------------------------------------------------------------------------------------------------


def packed(unpacked: bytes, *, size: int | None = None, crc: int | None = None) -> bytes:
    stated = len(unpacked) if size is None else size
    return chunk(zstandard.compress(unpacked), stated, crc=zlib.crc32(unpacked) if crc is None else crc)


def written(path: Path, *records: bytes) -> Path:
    path.write_bytes(MCAP0_MAGIC + b"".join(records))
    return path


def test_a_chunk_that_unpacks_to_too_much_is_passed_over_unpacked(tmp_path: Path) -> None:
    bomb = packed(bytes(MAX_CHUNK_BYTES + 1))
    assert len(bomb) < 10_000
    liar = packed(bytes(MAX_CHUNK_BYTES + 1), size=1_000)
    for name, harmful in (("bomb", bomb), ("liar", liar)):
        recording = read_recording(written(tmp_path / f"{name}.mcap", harmful))
        assert recording.messages == []
        assert len(recording.problems) == 1


def test_many_chunks_that_unpack_to_too_much_together_are_refused(tmp_path: Path) -> None:
    bomb = packed(bytes(MAX_CHUNK_BYTES), crc=1)  # none passes its checksum, and none is kept
    path = written(tmp_path / "bombs.mcap", *[bomb] * (MAX_WORK_BYTES // MAX_CHUNK_BYTES + 1))
    assert path.stat().st_size < 1_000_000
    assert "copied and unpacked" in refused(lambda: read_recording(path))


def test_many_small_records_are_refused(tmp_path: Path) -> None:
    empty = packed(bytes(MAX_CHUNK_BYTES))  # seven million records of nine zero bytes
    assert "records" in refused(lambda: read_recording(written(tmp_path / "many.mcap", empty, empty)))


def test_what_only_looks_like_a_chunk_is_not_copied(tmp_path: Path) -> None:
    head = struct.pack("<BQQQQI", Opcode.CHUNK, 6_000_000, 0, 0, 100, 1) + b"\x04\x00\x00\x00zstd"
    # 150,000 beginnings that promise 6 MB each: first with another length inside, then with one that agrees.
    length = struct.pack("<Q", 6_000_000 + 9 - len(head) - 8)
    path = written(tmp_path / "false.mcap", b"\xff" * 9, (head + bytes(8)) * 150_000)
    assert read_recording(path).messages == []
    path = written(tmp_path / "agree.mcap", b"\xff" * 9, (head + length) * 150_000)
    assert "copied and unpacked" in refused(lambda: read_recording(path))


def test_records_that_promise_to_be_long_are_not_copied_again_and_again(tmp_path: Path) -> None:
    whole = packed(record(Opcode.MESSAGE, bytes(22)))
    path = written(tmp_path / "long.mcap", (whole + struct.pack("<BQ", Opcode.ATTACHMENT, 4_000_000)) * 60_000)
    assert "copied and unpacked" in refused(lambda: read_recording(path))


@pytest.mark.parametrize(
    "content", [b"[" * DEEP, b'{"1":' * DEEP, b"{}" + b" " * 17_000_000, b"\xff", b"[]", b'{"x":[]}']
)
def test_attached_json_is_limited_too(content: bytes, tmp_path: Path) -> None:
    for name in ("channels.json", "settings.json"):
        head = struct.pack("<QQI", 0, 0, len(name)) + name.encode() + struct.pack("<I", 0)
        attachment = head + struct.pack("<Q", len(content)) + content
        crc = struct.pack("<I", zlib.crc32(attachment))
        recording = read_recording(written(tmp_path / name, record(Opcode.ATTACHMENT, attachment + crc)))
        if name == "channels.json":
            assert recording.problems
        elif content != b'{"x":[]}':
            refused(recording.settings)


@pytest.mark.parametrize("command", ["diagnose", "replay", "recover"])
def test_the_program_reports_a_limit_in_one_line_and_exits_with_2(command: str, tmp_path: Path) -> None:
    path = written(tmp_path / "large.mcap")
    with path.open("ab") as file:
        file.truncate((MAX_FILE_BYTES if command == "diagnose" else MAX_FLEET_FILE_BYTES) + 1)
    words: list[Any] = [command, path, *(["-o", tmp_path / "out.mcap"] if command == "recover" else [])]
    result = run(*words)
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert "limit" in result.stderr
    assert not (tmp_path / "out.mcap").exists()
