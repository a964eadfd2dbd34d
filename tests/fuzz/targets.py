"""What is fuzzed: every reader of bytes from outside, each behind one function that takes bytes.

A target may refuse its input with a `RwaMonitorError` of one printable line, but not in any other way: no other
exception, no endless loop. Accepted input must be consistent: it is written and read again, or used by the program.
"""

import json
import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from mcap.writer import CompressionType

from rwa_monitor.dashboard.fleet import Fleet, Received
from rwa_monitor.dashboard.recordings import replay_json
from rwa_monitor.diagnosis.model import built_in_model, models_for
from rwa_monitor.errors import RwaMonitorError
from rwa_monitor.history.store import History
from rwa_monitor.messages import (
    MESSAGES,
    Changepoints,
    Diagnosis,
    Discrepancy,
    EncodedMessage,
    SamplesMessage,
    Status,
    dump_json,
    health_message,
    key_of,
    samples_json,
    split_key,
)
from rwa_monitor.monitor.bus import BusOptions, session_config
from rwa_monitor.monitor.core import WheelCore, outputs_of
from rwa_monitor.monitor.recorder import RecordingWriter, recover
from rwa_monitor.monitor.recording import read_recording
from rwa_monitor.monitor.replay import replay
from rwa_monitor.monitor.setup import read_model, read_scenario, read_wheel
from rwa_monitor.monitor.telemetry_files import read_telemetry
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.telemetry.ccsds_packets import PacketDecoder, read_packets
from rwa_monitor.telemetry.files import read_text
from rwa_monitor.telemetry.labels import JudgedAnomaly, JudgedWindow, match_labels, read_labels
from rwa_monitor.telemetry.reader import TelemetryFile, TextFile
from rwa_monitor.telemetry.ros2_bag import read_bag
from rwa_monitor.telemetry.scores import score
from rwa_monitor.telemetry.table import read_table, table_writer
from rwa_monitor.wheel.wheel import Wheel
from tests.dashboard.support import status
from tests.monitor.support import adds_up, telemetry, wheel
from tests.telemetry import bags
from tests.telemetry import packets as made

KEY: Final = "rwa/sat/wheel_1/samples"
WINDOW: Final = 64
ROWS: Final = 200


@dataclass(frozen=True)
class Target:
    """A reader of bytes.

    Attributes
    ----------
    read
        Takes bytes; raises RwaMonitorError to refuse them.
    seeds
        Initial inputs, valid or nearly so.
    """

    read: Callable[[bytes], None]
    seeds: Callable[[], Sequence[bytes]]


def run(target: Target, data: bytes) -> bool:
    """Let a target read bytes; True if it took them, False if it refused them in one line."""
    try:
        target.read(data)
    except RwaMonitorError as error:
        line = str(error)
        assert line.isprintable(), line
        assert len(line) < 5_000, line
        return False
    return True


@cache
def scratch() -> Path:
    """Return a folder in memory, where there is one."""
    memory = Path("/dev/shm")
    return Path(tempfile.mkdtemp(prefix="rwa-fuzz-", dir=memory if os.access(memory, os.W_OK) else None))


def kept(name: str, data: bytes) -> Path:
    path = scratch() / name
    path.write_bytes(data)
    return path


# ---- messages of the bus ---------------------------------------------------------------------------------------------


@cache
def small_wheel() -> Wheel:
    return wheel(WINDOW)


def small_samples() -> Samples:
    return telemetry(ROWS)


@cache
def said() -> tuple[tuple[str, bytes], ...]:
    """Return what a monitor reports of the samples, as (schema, payload)."""
    core = WheelCore(small_wheel(), built_in_model())
    outputs = outputs_of([*core.feed(small_samples(), "p", 0), *core.finish()], "sat", "wheel_1")
    return tuple((output.schema, output.payload) for output in outputs)


def read_message(data: bytes) -> None:
    """Read as each kind of message; samples go through a monitor, a diagnosis and a status to the page."""
    kind, payload = MESSAGES[data[0] % len(MESSAGES) if data else 0], data[1:]
    message = kind.parse(payload, KEY)
    if isinstance(message, SamplesMessage):
        core = WheelCore(small_wheel(), built_in_model())
        samples = message.samples()
        core.check(samples)
        events = core.feed(samples, message.publisher, message.batch, message.data)
        events += core.feed(samples, message.publisher, None)
        for output in outputs_of([*events, *core.finish()], "sat", "wheel_1"):
            json.loads(output.payload)
        assert adds_up(core.counts)
        assert core.counts.received == 2 * len(samples)
    else:
        assert kind.parse(message.to_json(), KEY).to_json() == message.to_json()
        show(message)


@cache
def history() -> History:
    return History(scratch() / "history.sqlite3")


def show(message: object) -> None:
    """Bring a message onto the page, as the dashboard's listener does."""
    if not isinstance(message, (Diagnosis, Changepoints, Status, Discrepancy)):
        return
    split_key(key_of(type(message), message.spacecraft, message.wheel))
    fleet = Fleet()
    known = fleet.begin(message.spacecraft, message.wheel, [])
    fleet.take(known, message, Received(KEY, message.to_json(), 0))
    if isinstance(message, Diagnosis):
        health_message(message).to_json()
        history().add(message)


def message_seeds() -> list[bytes]:
    names = [message.schema_name() for message in MESSAGES]
    own = [("rwa.Samples", samples_json(small_samples()[:20], "p", 0, data)) for data in (None, "stored", "replay")]
    own.append(("rwa.Status", status("w", data="live", on_wall_clock=False)))
    found = [schema_payload for schema_payload in (*said(), *own) if schema_payload[0] in names]
    return [bytes([names.index(schema)]) + payload for schema, payload in found]


# ---- files -----------------------------------------------------------------------------------------------------------


def read_any_table(suffix: str) -> Callable[[bytes], None]:
    def read(data: bytes) -> None:
        samples = read_table(kept(f"table{suffix}", data)).samples
        again = scratch() / f"again{suffix}"
        table_writer(again)(samples, again)
        for (name, one), (_, two) in zip(samples.channels(), read_table(again).samples.channels(), strict=True):
            assert np.array_equal(one, two, equal_nan=True), name

    return read


def table_seeds(suffix: str) -> list[bytes]:
    path = scratch() / f"seed{suffix}"
    table_writer(path)(small_samples()[:20], path)
    return [path.read_bytes()]


CSV_SEEDS: Final = (
    b"time_s,speed_rad_s,friction_torque_Nm\r\n0.125,1e3,\r\n1.5e0,nan,-0.1\r\n2,inf,1\r\n",
    b'\xef\xbb\xbftime_ns,"speed_rad_s",motor_current_A,x\n1,2,3,"a,b"\n+5,-2.5E-3,.5,\n',
)


def read_a_wheel(data: bytes) -> None:
    read = read_wheel(kept("wheel.toml", data))
    assert Wheel.from_toml(read.to_toml(), "again") == read
    models_for(read, built_in_model())
    if read.window.samples <= 10_000:  # what a window of ten million slots takes is the owner's business
        core = WheelCore(read, built_in_model())
        core.feed(small_samples()[:40])
        core.finish()


def read_a_scenario(data: bytes) -> None:
    read = read_scenario(kept("scenario.toml", data))
    assert Scenario.from_toml(read.to_toml(), "again") == read


def read_a_model(data: bytes) -> None:
    read = read_model(kept("model.json", data))
    assert read.from_json(read.to_json(), "again").sha256() == read.sha256()
    models_for(small_wheel(), read)


def read_some_labels(data: bytes) -> None:
    for entry in read_labels(kept("labels.csv", data)):
        assert entry.path.parent == scratch()


def label_seeds() -> list[bytes]:
    kept("table.csv", b"")
    return [b"file,dry,viscous,fss_1\ntable.csv,0,1,0\n", b'file,dry,viscous\n"table.csv",1,0\n\n']


def read_some_events(data: bytes) -> None:
    anomalies = {name: JudgedAnomaly(active=True) for name in ("dry", "viscous")}
    place = {"wheel": "w", "source": "table.csv", "window_start_ns": 0, "window_end_ns": 100}
    window = JudgedWindow(**place, verdict="anomalous", anomalies=anomalies)
    kinds, overall = match_labels([window], kept("events.csv", data))
    for timelines in (*kinds.values(), overall):
        shares = [share for share in asdict(score(timelines)).values() if isinstance(share, float)]
        assert all(-1e-9 <= share <= 1 + 1e-9 for share in shares)


def read_a_configuration(data: bytes) -> None:
    session_config(BusOptions(config=kept("zenoh.json5", data)))


def configuration_seeds() -> list[bytes]:
    docker = Path(__file__).parents[2] / "docker"
    return [(docker / name).read_bytes() for name in ("router.json5", "client.json5")]


# ---- space packets and ROS 2 bags ------------------------------------------------------------------------------------


def read_some_packets(data: bytes) -> None:
    """Read as a file, and each piece of it as a datagram would come: what gives samples must be counted so."""
    decoder = PacketDecoder(made.decoding(), "test")
    for start in range(0, len(data), 36):
        decoder.take(data[start : start + 36])
    counts = decoder.counts
    assert counts.packets == counts.decoded + counts.bad + counts.unknown + counts.idle + counts.other
    use_all(read_packets(kept("packets.ccsds", data), made.decoding()))


def read_a_bag(data: bytes) -> None:
    use_all(read_bag(kept("bag.mcap", data), bags.decoding(bags.map_of(small_samples()))))


def use_all(file: TelemetryFile) -> None:
    for batch in (batch for of_wheel in file.telemetry for batch in of_wheel.batches):
        core = WheelCore(small_wheel(), built_in_model())
        core.feed(batch.samples)
        core.finish()


def bag_seeds() -> list[bytes]:
    """Return bags in chunks, whose checksum the reader uses only when it is there, and without chunks."""
    samples, path = small_samples()[:40], scratch() / "seed.mcap"
    chunked = [bags.write_bag(samples, path, how).read_bytes() for how in CompressionType]
    return [*chunked, bags.write_bag(samples, path, chunk_size=0).read_bytes()]


def read_a_decoding(field: str) -> Callable[[bytes], None]:
    """Read bytes as a map or an XTCE definition, as a file of one would come, and packets by it."""

    def read(data: bytes) -> None:
        text = read_text(kept("x.txt", data), 100_000)
        decoder = PacketDecoder(made.decoding()._replace(**{field: TextFile("x.txt", text)}), "test")
        for packet in made.packets(4):
            decoder.take(packet)

    return read


# ---- recordings ------------------------------------------------------------------------------------------------------


def read_bytes_of_a_recording(data: bytes) -> None:
    """Read, recover, and read what was recovered: it must hold the same, and be whole."""
    path, out = kept("recording.mcap", data), scratch() / "recovered.mcap"
    out.unlink(missing_ok=True)
    recording = read_recording(path)
    recover(path, out)
    again = read_recording(out)
    assert again.finished
    assert not again.problems
    assert [m.payload for m in again.messages] == [m.payload for m in recording.messages]


@cache
def parts() -> tuple[tuple[str, str, bytes], ...]:
    """Return the parts of a small recording: attachments ("", name, content), messages (topic, schema, payload)."""
    samples = small_samples()
    core = WheelCore(small_wheel(), built_in_model())
    core.feed(samples[:100], "p", 0)
    found = [
        ("", "wheel.toml", small_wheel().to_toml().encode()),
        ("", "model.json", built_in_model().to_json().encode()),
        ("", "settings.json", dump_json({"predecessor": None})),
        ("", "checkpoint/sat/wheel_1.json", core.checkpoint()),
    ]
    for number, start in enumerate((100, 150), start=1):
        piece = samples[start : start + 50]
        found.append((KEY, SamplesMessage.schema_name(), samples_json(piece, "p", number)))
        said_of_it = outputs_of(core.feed(piece, "p", number), "sat", "wheel_1")
        found += [(output.topic, output.schema, output.payload) for output in said_of_it]
    return tuple(found)


def with_part(place: int, content: bytes) -> Path:
    """Write the small recording with another content of one part, and every checksum right."""
    path = scratch() / "rwa-000001.mcap"
    (scratch() / "rwa-000001.mcap.part").unlink(missing_ok=True)
    changed = [(*part[:2], content if at == place else part[2]) for at, part in enumerate(parts())]
    writer = RecordingWriter(path, [(name, data) for topic, name, data in changed if not topic], lambda: 0)
    for topic, schema, payload in changed:
        if topic:
            writer.write(EncodedMessage(topic, schema, payload, 0))
    writer.close()
    return path


def read_a_part(data: bytes) -> None:
    """Put bytes in the place of one part of a recording, and use the recording in all ways."""
    path = with_part(data[0] % len(parts()) if data else 0, data[1:])
    refused = []
    for use in (replay, read_telemetry, lambda path: json.loads(replay_json(scratch(), path.name))):
        try:
            use(path)
        except RwaMonitorError as error:
            refused.append(error)
    if refused:
        raise refused[-1]


TARGETS: Final[dict[str, Target]] = {
    "messages": Target(read_message, message_seeds),
    "csv": Target(read_any_table(".csv"), lambda: [*table_seeds(".csv"), *CSV_SEEDS]),
    "parquet": Target(read_any_table(".parquet"), lambda: table_seeds(".parquet")),
    "wheel": Target(
        read_a_wheel, lambda: [small_wheel().to_toml().encode(), wheel(WINDOW, 16, True).to_toml().encode()]
    ),
    "scenario": Target(
        read_a_scenario, lambda: [(Path(__file__).parents[2] / "docker" / "scenario.toml").read_bytes()]
    ),
    "model": Target(read_a_model, lambda: [built_in_model().to_json().encode()]),
    "labels": Target(read_some_labels, label_seeds),
    "events": Target(
        read_some_events,
        lambda: [b"wheel,kind,start_ns,end_ns\nw,dry,10,50\n", b"file,dry,viscous\ntable.csv,1,0\n"],
    ),
    "configuration": Target(read_a_configuration, configuration_seeds),
    "packets": Target(read_some_packets, lambda: [b"".join(made.packets(20))]),
    "ros2": Target(read_a_bag, bag_seeds),
    "xtce": Target(read_a_decoding("xtce"), lambda: [made.decoding().xtce.text.encode()]),
    "map": Target(read_a_decoding("map"), lambda: [made.decoding().map.text.encode()]),
    "mcap": Target(read_bytes_of_a_recording, lambda: [with_part(-1, b"").read_bytes()]),
    "replay": Target(read_a_part, lambda: [bytes([at]) + part[2] for at, part in enumerate(parts())]),
}
