"""Verdicts and alarms as space packets: by the definition that goes with them, read by what others wrote."""

import json
import math
import shutil
import signal
import socket
import subprocess
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import space_packet_parser.xtce
import zenoh
from lxml import etree
from spacepackets.ccsds.spacepacket import SpacePacketHeader

from rwa_monitor.dashboard.server import DashboardOptions, Running, serve
from rwa_monitor.dashboard.space_packets import PacketSender, PacketWriter, UdpAddress
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.errors import InputError
from rwa_monitor.messages import Diagnosis, HealthAlarm, health_message
from rwa_monitor.monitor.bus import BusOptions, open_session
from rwa_monitor.monitor.recording import read_chain
from rwa_monitor.telemetry.ccsds_packets import definition_of
from rwa_monitor.telemetry.reader import TextFile
from rwa_monitor.wheel.wheel import built_in_wheel
from tests.dashboard.support import acknowledge, send_windows
from tests.docs.test_commands import ROOT, blocks_of
from tests.history.support import diagnosis
from tests.monitor.processes import free_udp, process, told_before, wait_for
from tests.monitor.support import free_port
from tests.program import run

WHEELS = ("sat/wheel_1", "sat/wheel_2")
DIAGNOSIS, HEALTH = (f"rwa/sat/wheel_2/{kind}" for kind in ("diagnosis", "health"))
NAMESPACE = {"x": "http://www.omg.org/spec/XTCE/20180204"}
YAMCS = ROOT / "build" / "yamcs"


def writer(*wheels: str) -> PacketWriter:
    return PacketWriter(wheels or WHEELS, 1000, built_in_wheel(), built_in_model())


def health(level: str = "warning", phase: str = "active", **others: str) -> bytes:
    levels = {"viscous": (level, phase)} | {name: (one, "active") for name, one in others.items()}
    states = {name: HealthAlarm(level=one, phase=two, acknowledged_by=None) for name, (one, two) in levels.items()}
    message = health_message(diagnosis(3, severity=1.0, wheel="wheel_2"))
    return message.model_copy(update={"alarm_states": states}).to_json()


def parsed(packet: bytes, xtce: str | None = None) -> dict[str, Any]:
    return dict(definition_of(TextFile("wheels.xml", xtce or writer().definition())).parse_bytes(packet))


# ---- the definition --------------------------------------------------------------------------------------------------


def test_the_definition_is_valid_by_the_schema_of_xtce_1_2() -> None:
    # As space-packet-parser brings it along; it refers to xml:base, and to nowhere that this is defined.
    schema = etree.parse(Path(space_packet_parser.xtce.__file__).parent / "schemas" / "SpaceSystem.xsd")
    for one in schema.xpath("//*[@ref='xml:base'] | //*[@namespace='http://www.w3.org/XML/1998/namespace']"):
        one.getparent().remove(one)
    etree.XMLSchema(schema).assertValid(etree.fromstring(writer("sat-1/rw.1", "sat-1/rw@replay").definition().encode()))


def test_verdict_parts_and_alarms_are_enumerated_with_alarm_levels_and_friction_has_units_and_ranges() -> None:
    root = etree.fromstring(writer().definition().encode())
    types = {one.get("name"): one.get("parameterTypeRef") for one in root.iterfind(".//x:Parameter", NAMESPACE)}

    def levels(name: str) -> dict[str, str]:
        alarms = root.xpath(
            f"//x:EnumeratedParameterType[@name='{types[name]}']//x:EnumerationAlarm", namespaces=NAMESPACE
        )
        return {one.get("enumerationLabel"): one.get("alarmLevel") for one in alarms}

    assert levels("sat_wheel_1_VERDICT") == {"anomalous": "watch"}
    assert levels("sat_wheel_2_fss_2_STATE") == {"active": "watch"}
    concerns = {one: one for one in ("watch", "warning", "distress", "critical")}
    assert levels("sat_wheel_2_ALARM_viscous_LEVEL") == concerns
    viscous = root.find(f".//x:FloatParameterType[@name='{types['sat_wheel_1_viscous_ESTIMATE']}']", NAMESPACE)
    assert viscous.findtext(".//x:Unit", namespaces=NAMESPACE) == "N m s/rad"
    bounds = [float(one.get("maxInclusive")) for one in viscous.find(".//x:StaticAlarmRanges", NAMESPACE)]
    assert len(bounds) == 4
    assert bounds == sorted(bounds)
    low, high = (float(viscous.find(".//x:WatchRange", NAMESPACE).get(f"{end}Inclusive")) for end in ("min", "max"))
    assert low < built_in_wheel().nominal.viscous_Nm_s_rad < high == bounds[0]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ("sat/w", "nothing to do: give --to [HOST:]PORT, --xtce X.xml, or both"),
        ("sat --xtce x.xml", "rwa/sat/diagnosis: is no key of the form rwa/{spacecraft}/{wheel}/{kind}"),
        ("sat/w --to here", "--to: 'here' is no [HOST:]PORT"),
        ("sat/w.1 sat/w_1 --xtce x.xml", "would name two parameters: give each wheel once"),
        ("sat/w sat/w --xtce x.xml", "would name two parameters: give each wheel once"),
        ("sat/w sat/v --apid 2046 --xtce x.xml", "--apid: 2 wheels from 2046 on need APIDs above 2046, the last one"),
        ("sat/w --xtce none/x.xml", "none/x.xml"),
        ("sat/w --to 300.1.2.3:5 -l tcp/127.0.0.1:0", "300.1.2.3: there is no such address"),
    ],
)
def test_what_cannot_be_done_is_reported_in_one_line(
    arguments: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("packets", *arguments.split())
    assert result.exit_code == (1 if "300." in arguments else 2)
    assert line in result.stderr.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


# ---- packets ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("folder", ["heat", "two_anomalies"])
def test_what_a_monitor_diagnosed_is_read_back(folder: str) -> None:
    packets = writer("sat/other", "reference/wheel_1")
    (recording,) = read_chain(ROOT / "replay" / folder)
    for number, one in enumerate(recording.parsed(Diagnosis)):
        packet = packets.take("rwa/reference/wheel_1/diagnosis", one.to_json())
        header = SpacePacketHeader.unpack(packet)
        assert (header.apid, header.seq_count, header.packet_len) == (1001, number, len(packet))
        assert header.sec_header_flag
        found = parsed(packet, packets.definition())
        own = {name.removeprefix("reference_wheel_1_"): value for name, value in found.items()}
        assert (own["WHEEL"], own["TIME"]) == ("reference/wheel_1", one.window_end_ns / 1e9)
        assert (own["VERDICT"], own["REASON"], own["COVERAGE"]) == (one.verdict, one.reason, one.coverage)
        assert (own["MODEL"], own["DATA"]) == ("fits", "live")
        for name, part in one.anomalies.items():
            values = [own.get(f"{name}_{what}") for what in ("PROBABILITY", "SEVERITY", "ESTIMATE")]
            assert values == [part.probability, part.severity, part.estimate]
            assert (own[f"{name}_STATE"] == "active") == part.active
        if folder == "two_anomalies":  # of the built-in wheel, as the definition: the same limits
            for part in (one.anomalies["dry"], one.anomalies["viscous"]):
                assert f'minInclusive="{part.nominal_low}" maxInclusive="{part.nominal_high}"' in packets.definition()


@pytest.mark.parametrize(
    ("verdict", "fits", "active", "state"),
    [
        ("nominal", True, False, "none"),
        ("nominal", False, False, "open"),
        ("inconclusive", True, False, "open"),
        ("inconclusive", True, True, "may_be_active"),
        ("anomalous", True, True, "active"),
    ],
)
def test_the_state_of_a_part_is_that_of_the_page(verdict: str, fits: bool, active: bool, state: str) -> None:
    plain = diagnosis(0, wheel="wheel_2")
    part = plain.anomalies["viscous"].model_copy(update={"active": active})
    message = plain.model_copy(update={"verdict": verdict, "model_adequate": fits, "anomalies": {"viscous": part}})
    found = parsed(writer().take(DIAGNOSIS, message.to_json()))
    assert found["sat_wheel_2_viscous_STATE"] == state
    assert found["sat_wheel_2_dry_STATE"] == "not_judged"  # this message has no such part
    assert math.isnan(found["sat_wheel_2_dry_ESTIMATE"])


def test_alarms_are_all_there_and_what_has_no_name_stands_under_other() -> None:
    packet = writer().take(HEALTH, health("distress", "acknowledged", unknown="critical", **{"x (stored)": "watch"}))
    found = parsed(packet)
    alarms = {name.removeprefix("sat_wheel_2_ALARM_"): value for name, value in found.items() if "ALARM" in name}
    assert (alarms["viscous_LEVEL"], alarms["viscous_PHASE"]) == ("distress", "acknowledged")
    assert (alarms["other_LEVEL"], alarms["other_PHASE"]) == ("critical", "active")
    assert (alarms["model_LEVEL"], alarms["monitor_PHASE"]) == ("normal", "quiet")


def test_what_is_repeated_is_sent_once_and_the_sequence_counts() -> None:
    packets = writer()
    windows = [diagnosis(number, wheel="wheel_2").to_json() for number in (0, 1)]
    assert packets.take(DIAGNOSIS, windows[0])
    assert packets.take(DIAGNOSIS, windows[1])
    assert packets.take(DIAGNOSIS, windows[0]) is None
    sent = [packets.take(HEALTH, health(phase=phase)) for phase in ("active", "active", "acknowledged", "active")]
    assert [packet is None for packet in sent] == [False, True, False, False]  # back to what it was is a change
    assert [SpacePacketHeader.unpack(packet).seq_count for packet in sent if packet] == [2, 3, 4]
    assert packets.take("rwa/sat/wheel_9/diagnosis", windows[0]) is None
    assert packets.take(HEALTH, health_message(diagnosis(0, wheel="wheel_2")).to_json()) is None  # of a monitor


def test_a_long_text_is_cut_between_characters_and_a_time_that_no_packet_has_is_refused() -> None:
    message = diagnosis(0, wheel="wheel_2").model_copy(update={"reason": "a" + "µ" * 300})
    assert parsed(writer().take(DIAGNOSIS, message.to_json()))["sat_wheel_2_REASON"] == "a" + "µ" * 127
    late = message.model_copy(update={"window_end_ns": -1})
    with pytest.raises(InputError, match="window_end_ns: is -1 s; the time of a packet is 0 to 4294967295 s"):
        writer().take(DIAGNOSIS, late.to_json())
    with pytest.raises(InputError, match=DIAGNOSIS):
        writer().take(DIAGNOSIS, b"{}")


# ---- the program -----------------------------------------------------------------------------------------------------


@pytest.fixture
def receiver() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        one.settimeout(0.0)
        yield one


def received(receiver: socket.socket, packets: list[bytes]) -> list[bytes]:
    """Return all packets so far."""
    while True:
        try:
            packets.append(receiver.recv(65_535))
        except BlockingIOError:
            return packets


@pytest.mark.processes
def test_diagnoses_and_alarms_go_from_the_bus_over_udp(receiver: socket.socket, tmp_path: Path) -> None:
    """A monitor's windows → a dashboard's alarm → `packets` → a socket → space-packet-parser."""
    endpoint, xtce = f"tcp/127.0.0.1:{free_port()}", tmp_path / "wheels.xtce.xml"
    address = f"127.0.0.1:{receiver.getsockname()[1]}"
    with (
        open_session(BusOptions(listen=(endpoint,))) as session,
        serve(DashboardOptions(0, tmp_path, token="right", silent_s=0.0), session) as running,
        process("packets", *WHEELS, "--to", address, "--xtce", xtce, "-e", endpoint) as child,
    ):
        wait_for(lambda: "sending to UDP" in child.stderr.readline(), "the sender")
        packets: list[bytes] = []

        def kinds() -> list[str]:
            return [parsed(one, xtce.read_text())["KIND"] for one in received(receiver, packets)]

        def windows_there() -> bool:
            send_windows(session, "wheel_2", failing=True)  # again: what is put before it has subscribed is lost
            return kinds().count("diagnosis") == 3 and "alarms" in kinds()

        wait_for(windows_there, "three windows and an alarm")
        alarms = kinds().count("alarms")
        assert acknowledge(running.address) == 200
        wait_for(lambda: kinds().count("alarms") > alarms, "the alarm as it was acknowledged")
        child.send_signal(signal.SIGTERM)
        _, log = child.communicate(timeout=60)
    found = [parsed(one, xtce.read_text()) for one in packets]
    windows = [one for one in found if one["KIND"] == "diagnosis"]
    assert [one["sat_wheel_2_VERDICT"] for one in windows] == ["nominal", "anomalous", "anomalous"]
    last = [one for one in found if one["KIND"] == "alarms"][-1]
    assert [last[f"sat_wheel_2_ALARM_viscous_{what}"] for what in ("LEVEL", "PHASE")] == ["warning", "acknowledged"]
    assert [one["SEQ_COUNT"] for one in found] == [*range(len(found))]
    assert (child.returncode, f"packets sent: {len(found)}" in log) == (0, True)


def test_a_sender_that_comes_later_gets_the_alarms_as_they_are(
    session: zenoh.Session, receiver: socket.socket, dashboard: Running
) -> None:
    send_windows(session, "wheel_2", failing=True)
    wait_for(lambda: acknowledge(dashboard.address) == 200, "the alarm")
    with PacketSender(session, writer(), UdpAddress(*receiver.getsockname()), print):
        packets = wait_for(lambda: received(receiver, []), "the alarms")
    assert parsed(packets[0])["sat_wheel_2_ALARM_viscous_PHASE"] == "acknowledged"


def test_what_cannot_be_sent_is_logged_once(session: zenoh.Session, receiver: socket.socket) -> None:
    lines: list[str] = []
    with PacketSender(session, writer(), UdpAddress(*receiver.getsockname()), lines.append) as sender:
        for _ in range(2):
            sender.receive(DIAGNOSIS, b"{}")
    assert len(lines) == 1
    assert lines[0].startswith(f"a packet is not sent: {DIAGNOSIS}")


@pytest.mark.processes
def test_only_what_leaves_the_machine_is_warned_of() -> None:
    for host, warned in (("192.0.2.1:", True), ("", False)):  # an address of documentation, which nobody has
        lines = told_before("sending to UDP", "packets", *WHEELS, "--to", f"{host}9")
        assert any("UDP neither encrypts nor identifies the sender" in line for line in lines) == warned


# ---- Yamcs -----------------------------------------------------------------------------------------------------------


@contextmanager
def yamcs(folder: Path, port: int, udp: int) -> Iterator[str]:
    """Run Yamcs with the definition, configured as the page shows; yields its address."""
    if not list(YAMCS.glob("*/lib/yamcs-core-*.jar")):
        pytest.skip("no Yamcs in build/yamcs: make yamcs, which runs on java (apt-get install openjdk-17-jre-headless)")
    if shutil.which("java") is None:
        pytest.skip("no java, which Yamcs runs on: apt-get install openjdk-17-jre-headless")
    (shown,) = (one.text for one in blocks_of(ROOT / "docs/integrations.md") if one.mark == "file yamcs.wheels.yaml")
    etc = folder / "etc"
    etc.mkdir()
    (etc / "wheels.xtce.xml").write_text(writer().definition())
    (etc / "yamcs.wheels.yaml").write_text(shown.replace("10015", str(udp)))
    http = {"class": "org.yamcs.http.HttpServer", "args": {"port": port, "address": "127.0.0.1"}}
    (etc / "yamcs.yaml").write_text(json.dumps({"services": [http], "instances": ["wheels"], "dataDir": "data"}))
    alarm = {"parameterCheck": True, "parameterServer": "enabled"}
    provider = {"class": "org.yamcs.StreamTmPacketProvider"}
    processor = {"services": [provider], "config": {"subscribeAll": True, "alarm": alarm}}
    (etc / "processor.yaml").write_text(json.dumps({"realtime": processor}))
    jars = ":".join(str(one) for one in YAMCS.glob("*/lib/*.jar"))
    words = ["java", "-Xmx256m", "-cp", jars, "org.yamcs.YamcsServer", "--etc-dir", "etc", "--data-dir", "data"]
    log = folder / "log"
    with log.open("w") as out, subprocess.Popen(words, cwd=folder, stdout=out, stderr=out) as server:
        try:
            address = f"http://127.0.0.1:{port}/api"
            wheels = f"{address}/instances/wheels"
            wait_for(lambda: server.poll() is not None or answer(wheels).get("state") == "RUNNING", "Yamcs")
            assert server.poll() is None, log.read_text()
            yield address
        finally:
            server.kill()


def answer(address: str) -> dict[str, Any]:
    try:
        with urllib.request.urlopen(address, timeout=10) as found:
            content: dict[str, Any] = json.load(found)
            return content
    except (urllib.error.URLError, ConnectionError):
        return {}


@pytest.mark.processes
def test_yamcs_loads_the_definition_and_takes_the_packets(tmp_path: Path) -> None:
    packets, udp = writer(), free_udp().port
    with yamcs(tmp_path, free_port(), udp) as address, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sent = [packets.take(DIAGNOSIS, diagnosis(n, severity=1.0, wheel="wheel_2").to_json()) for n in (1, 2)]
        for packet in (*sent, packets.take(HEALTH, health())):
            sender.sendto(packet, ("127.0.0.1", udp))

        def value(name: str) -> dict[str, Any]:
            place = f"{address}/processors/wheels/realtime/parameters/ReactionWheels/sat_wheel_2_{name}"
            return wait_for(lambda: answer(place) if "engValue" in answer(place) else None, name)  # type: ignore[no-any-return]

        assert value("ALARM_viscous_LEVEL")["engValue"]["stringValue"] == "warning"
        assert value("ALARM_viscous_LEVEL")["monitoringResult"] == "WARNING"
        assert value("VERDICT")["engValue"]["stringValue"] == "anomalous"
        assert value("VERDICT")["generationTime"] == "2026-11-18T12:46:40Z"
        assert value("VERDICT")["monitoringResult"] == "WATCH"
        assert value("REASON")["engValue"]["stringValue"] == "Viscous friction is too high."
        estimate = value("viscous_ESTIMATE")
        assert (estimate["engValue"]["doubleValue"], estimate["monitoringResult"]) == (6.6e-6, "DISTRESS")
        alarms = answer(f"{address}/processors/wheels/realtime/alarms")["alarms"]
    assert {"sat_wheel_2_VERDICT", "sat_wheel_2_ALARM_viscous_LEVEL"} <= {one["id"]["name"] for one in alarms}
