"""Mutual TLS and access control, as shipped: who does not belong gets nothing in, who belongs does.

Every process, socket and certificate is real; the router runs docker/router.json5. What an intruder does is done with
the same code that, with the right certificate on the right key, gets its message through (the control).
"""

import json
import signal
import stat
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml
import zenoh
from zenoh import ext

from rwa_monitor.errors import RwaMonitorError
from rwa_monitor.messages import SamplesMessage
from rwa_monitor.monitor.bus import BusOptions, SamplesPublisher, messages_publisher, open_session
from tests.monitor.processes import process, put_pieces, wait_for
from tests.monitor.support import WINDOW, batch_diagnoses, recorded, telemetry, wheel
from tests.program import done
from tests.security.rig import DOCKER, NAMES, certificates, issued, leaf, make_certificates, router

pytestmark = pytest.mark.processes

SAMPLES = "rwa/simulated/wheel_1/samples"
DIAGNOSIS = "rwa/simulated/wheel_1/diagnosis"


@pytest.fixture(scope="module")
def issued_by_us(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return certificates(tmp_path_factory.mktemp("ours") / "certificates")


class Bus:
    """A router, and what the monitor and the dashboard receive over it."""

    def __init__(self, port: int, own: Path, scratch: Path) -> None:
        self.port, self.own, self.scratch = port, own, scratch
        self.heard: list[tuple[str, bytes]] = []

    def join(self, name: str) -> zenoh.Session:
        return open_session(leaf(self.own / name, self.port, self.scratch))

    def hear(self, sample: zenoh.Sample) -> None:
        self.heard.append((str(sample.key_expr), sample.payload.to_bytes()))

    def of(self, key: str) -> list[bytes]:
        """Return what was heard on a key."""
        return [payload for heard, payload in self.heard if heard == key]

    def subscribe(self, session: zenoh.Session, keys: str) -> Any:
        late = ext.HistoryConfig(detect_late_publishers=True)
        return ext.declare_advanced_subscriber(session, keys, self.hear, history=late)

    def finish(self) -> None:
        """Let the right wheel send on its own key, and wait until both have received it."""
        with self.join("simulated.wheel_1") as right:
            send(right, SAMPLES, b"last")
            wait_for(lambda: self.of(SAMPLES).count(b"last") >= 2, "the right wheel")


@contextmanager
def secured(own: Path, scratch: Path) -> Iterator[Bus]:
    with router(own / "router", scratch) as port:
        bus = Bus(port, own, scratch)
        with bus.join("monitor") as monitor, bus.join("dashboard") as dashboard:
            subscribers = [bus.subscribe(monitor, "rwa/*/*/samples"), bus.subscribe(dashboard, "rwa/*/*/*")]
            for session in (monitor, dashboard):  # a question is answered only after all that it has declared is taken
                assert not list(session.get(f"{SAMPLES}/@adv/nobody"))
            yield bus
            for subscriber in subscribers:
                subscriber.undeclare()


def send(session: zenoh.Session, key: str, payload: bytes) -> None:
    """Publish in all ways there are: plainly, and with a history that late subscribers ask for."""
    session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)
    if "*" not in key:
        messages_publisher(session, key).put(payload)
    session.delete(key)


def arrived_after(bus: Bus, name: str, key: str) -> set[tuple[str, bytes]]:
    """Return what arrived when somebody sent on a key, and the right wheel on its own after that."""
    with bus.join(name) as session:
        send(session, key, b"sent")
        bus.finish()
    return set(bus.heard) - {(SAMPLES, b"last")}


@pytest.mark.parametrize(
    ("name", "key", "through"),
    [
        ("simulated.wheel_1", SAMPLES, True),
        ("simulated.wheel_2", "rwa/simulated/wheel_2/samples", True),
        ("monitor", DIAGNOSIS, True),
        ("monitor_2", DIAGNOSIS, True),
        ("monitor", "rwa/simulated/wheel_1/status", True),
        ("monitor", SAMPLES, False),
        ("simulated.wheel_1", "rwa/simulated/wheel_2/samples", False),
        ("simulated.wheel_2", SAMPLES, False),
        ("simulated.wheel_1", DIAGNOSIS, False),
        ("simulated.wheel_1", "rwa/simulated/wheel_1/health", False),
        ("simulated.wheel_1", "rwa/*/*/samples", False),
        ("simulated.wheel_1", "rwa/**", False),
        ("dashboard", SAMPLES, False),
        ("dashboard", DIAGNOSIS, False),
        ("somebody", SAMPLES, False),
        ("somebody", DIAGNOSIS, False),
    ],
)
def test_only_the_right_client_on_the_right_key_gets_through(
    name: str, key: str, through: bool, issued_by_us: Path, tmp_path: Path
) -> None:
    with secured(issued_by_us, tmp_path) as bus:
        assert arrived_after(bus, name, key) == ({(key, b"sent")} if through else set())


def test_a_wheel_receives_nothing_of_others(issued_by_us: Path, tmp_path: Path) -> None:
    overheard: list[Any] = []
    with secured(issued_by_us, tmp_path) as bus, bus.join("somebody") as somebody, bus.join("monitor") as monitor:
        subscribers = [somebody.declare_subscriber("**", overheard.append)]
        with bus.join("simulated.wheel_1") as curious:
            subscribers.append(curious.declare_subscriber("rwa/*/*/diagnosis", overheard.append))
            queryable = monitor.declare_queryable("rwa/**/health", lambda query: query.reply(query.key_expr, b"well"))
            send(monitor, DIAGNOSIS, b"sent")
            wait_for(lambda: (DIAGNOSIS, b"sent") in bus.heard, "the diagnosis at the dashboard")
            answers = [reply for reply in curious.get("rwa/**/health", timeout=1.0) if reply.ok is not None]
            queryable.undeclare()
    assert (overheard, answers) == ([], [])


# ---- who does not even get a connection ------------------------------------------------------------------------------


def strangers(own: Path, port: int, scratch: Path) -> dict[str, BusOptions]:
    """Return who has no certificate, or a wrong one; all trust our authority, so that it is the router that refuses."""
    foreign = certificates(scratch / "foreign")
    for folder in foreign.glob("simulated.*"):
        (folder / "ca.pem").write_bytes((own / "router" / "ca.pem").read_bytes())
    now, day, ours = datetime.now(UTC), timedelta(days=1), own / "authority"
    expired = issued(ours, scratch / "expired", "simulated.wheel_1", not_before=now - 2 * day, not_after=now - day)
    early = issued(ours, scratch / "early", "simulated.wheel_1", not_before=now + day)
    unknown = leaf(own / "somebody", port, scratch)
    text = unknown.config.read_text(encoding="utf-8")
    bare = scratch / "bare.json5"
    bare.write_text("\n".join(line for line in text.splitlines() if "own." not in line and "enable_mtls" not in line))
    return {
        "no TLS": BusOptions(mode="client", connect=(f"tcp/localhost:{port}",)),
        "no certificate": BusOptions(config=bare, connect=(f"tls/localhost:{port}",)),
        "another authority": leaf(foreign / "simulated.wheel_1", port, scratch),
        "expired": leaf(expired, port, scratch),
        "not valid yet": leaf(early, port, scratch),
    }


def test_strangers_get_no_connection(issued_by_us: Path, tmp_path: Path) -> None:
    with secured(issued_by_us, tmp_path) as bus:
        for name, options in strangers(issued_by_us, bus.port, tmp_path).items():
            with pytest.raises(RwaMonitorError, match="cannot be opened"), open_session(options) as session:
                session.put(SAMPLES, name.encode())
        again = issued(issued_by_us / "authority", tmp_path / "valid", "simulated.wheel_1")  # the control
        with open_session(leaf(again, bus.port, tmp_path)) as session:
            send(session, SAMPLES, b"last")
            wait_for(lambda: len(bus.heard) >= 2, "the right wheel")
    assert set(bus.heard) == {(SAMPLES, b"last")}


def short_lived_session(stack: ExitStack, bus: Bus, own: Path) -> tuple[zenoh.Session, datetime]:
    """Join with a certificate that soon ends; returns its end. Where joining takes long, the certificate lives long."""
    asked = time.monotonic()
    bus.join("simulated.wheel_1").close()  # type: ignore[no-untyped-call]
    life = timedelta(seconds=3.0 + 10.0 * (time.monotonic() - asked))
    end = datetime.now(UTC) + life
    short = issued(own / "authority", bus.scratch / "short", "simulated.wheel_1", not_after=end)
    return stack.enter_context(open_session(leaf(short, bus.port, bus.scratch))), end


def test_a_connection_ends_when_its_certificate_does(issued_by_us: Path, tmp_path: Path) -> None:
    with secured(issued_by_us, tmp_path) as bus, ExitStack() as short_lived:
        session, end = short_lived_session(short_lived, bus, issued_by_us)
        session.put(SAMPLES, b"in time", congestion_control=zenoh.CongestionControl.BLOCK)
        wait_for(lambda: len(bus.heard) >= 2, "what was sent in time")
        wait_for(lambda: not list(session.info.routers_zid()), "the end of the connection")
        assert datetime.now(UTC) >= end - timedelta(seconds=1)
        session.put(SAMPLES, b"too late")
        bus.finish()
    assert {payload for _, payload in bus.heard} == {b"in time", b"last"}


@pytest.mark.parametrize("impostor", ["a wheel", "another authority"])
def test_nobody_else_can_pose_as_the_router(impostor: str, issued_by_us: Path, tmp_path: Path) -> None:
    own = issued_by_us / "simulated.wheel_1" if impostor == "a wheel" else certificates(tmp_path / "foreign") / "router"
    with router(own, tmp_path) as port, pytest.raises(RwaMonitorError, match="cannot be opened"):
        open_session(leaf(issued_by_us / "simulated.wheel_1", port, tmp_path)).close()


# ---- the program itself ----------------------------------------------------------------------------------------------


def test_run_simulate_and_a_dashboard_work_over_the_secured_bus(issued_by_us: Path, tmp_path: Path) -> None:
    samples = telemetry(2 * WINDOW + 1)
    (tmp_path / "wheel.toml").write_text(wheel().to_toml())
    with router(issued_by_us / "router", tmp_path) as port:
        bus = Bus(port, issued_by_us, tmp_path)

        def joined(name: str) -> tuple[str | Path, ...]:
            options = leaf(issued_by_us / name, port, tmp_path)
            return ("-c", options.config, "-e", options.connect[0])

        monitor = ("run", "--wheel", tmp_path / "wheel.toml", "--record", tmp_path / "rec", *joined("monitor"))
        with (
            bus.join("dashboard") as dashboard,
            bus.join("simulated.wheel_1") as satellite,
            process(*monitor) as said,
        ):
            subscriber = bus.subscribe(dashboard, "rwa/*/*/*")
            offered = put_pieces(SamplesPublisher(satellite, SAMPLES), samples, 256)
            intruder = done("simulate", "publish", "--speed", "inf", "--key", SAMPLES, *joined("somebody"))
            assert "published" in intruder.stderr  # it receives nothing
            wait_for(lambda: len(bus.of(DIAGNOSIS)) >= 2, "both diagnoses")
            health = {str(reply.ok.key_expr) for reply in dashboard.get("rwa/**/health") if reply.ok is not None}
            said.send_signal(signal.SIGTERM)
            talk = said.communicate(timeout=60)[1]
            offered.close()
            subscriber.undeclare()
    assert said.returncode == 0, talk
    assert health == {"rwa/simulated/wheel_1/health"}
    expected = [json.loads(line) for line in batch_diagnoses(samples, wheel())]
    heard = [json.loads(payload) for payload in bus.of(DIAGNOSIS)]
    for field in ("verdict", "changepoints"):
        assert [d[field] for d in heard] == [d[field] for d in expected]
    taken = recorded(tmp_path / "rec", SamplesMessage.schema_name())
    assert sum(len(SamplesMessage.parse(payload, SAMPLES).time_ns) for payload in taken) == len(samples)
    assert recorded(tmp_path / "rec", "rwa.Refused") == []


def test_each_container_has_its_own_certificate_and_no_other() -> None:
    services = yaml.safe_load((DOCKER / "compose.yaml").read_text(encoding="utf-8"))["services"]
    tls = "/etc/rwa-monitor/tls"
    mounted = {
        name: [volume for volume in service["volumes"] if "certificates" in volume or tls in volume]
        for name, service in services.items()
    }
    own = {name: name.replace("wheel", "simulated.wheel") for name in services if name != "database"}
    assert mounted == {name: [f"./certificates/{folder}:{tls}:ro"] for name, folder in own.items()} | {"database": []}
    assert own.keys() == {"router", "wheel_1", "wheel_2", "monitor_1", "monitor_2", "dashboard"}
    for words in (services[name]["command"] for name in own if name != "router"):
        assert words[words.index("--config") + 1] == "/etc/rwa-monitor/client.json5"
        assert not {"-e", "--connect", "-l", "--listen", "-m", "--mode"} & set(words)


# ---- the script ------------------------------------------------------------------------------------------------------


def test_private_keys_are_for_their_owner_only_and_nothing_is_overwritten(issued_by_us: Path) -> None:
    keys = sorted(issued_by_us.rglob("*.key"))
    assert len(keys) == len(NAMES) + 2  # the router and the authority
    assert {stat.S_IMODE(key.stat().st_mode) for key in keys} == {0o600}
    assert stat.S_IMODE((issued_by_us / "authority").stat().st_mode) == 0o700
    before = {path: path.read_bytes() for path in issued_by_us.rglob("*") if path.is_file()}
    again = make_certificates(issued_by_us, "monitor")
    assert (again.returncode, again.stderr.count("\n")) == (2, 1)
    assert "exists already" in again.stderr
    assert {path: path.read_bytes() for path in issued_by_us.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("name", ["../out", "a/b", "authority", ".", "-x", "a\nb", "CN=x"])
def test_a_name_that_is_none_is_refused_and_nothing_is_made(name: str, tmp_path: Path) -> None:
    assert make_certificates(tmp_path / "new", name).returncode == 2
    assert list(tmp_path.iterdir()) == []
