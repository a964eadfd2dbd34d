"""Live, stored and replayed telemetry through the whole monitor: a real bus, real recordings."""

import json
import math
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any

import pytest
import zenoh

from rwa_monitor.messages import Status, samples_json
from rwa_monitor.monitor.backfill import Arrival
from rwa_monitor.monitor.bus import MonitorBus, SamplesPublisher
from rwa_monitor.monitor.replay import replay, replay_to_bus
from rwa_monitor.monitor.service import Clock, Monitor
from rwa_monitor.monitor.telemetry_files import read_telemetry
from rwa_monitor.samples import Samples
from tests.monitor.processes import Listener, monitor, options, put_pieces, wait_for
from tests.monitor.support import KEY, WINDOW, adds_up, batch_diagnoses, publish, recorded, telemetry, wheel

PERIOD_NS = 125_000_000
REPLAY_KEY = "rwa/sat/wheel_1@replay/{}"
DAY = telemetry(5 * WINDOW)
LIVE = DAY[3 * WINDOW : 4 * WINDOW + 300]  # one window of a contact, and some more
DUMP = DAY[: 3 * WINDOW]


def of(listener: Listener, key: str, data: str | None = None) -> list[dict[str, Any]]:
    """Return what came on a key, of live or stored data."""
    found = [json.loads(payload) for at, payload in listener.received if at == key]
    return [one for one in found if one.get("data") == data]


def test_a_dump_beside_live_telemetry_is_diagnosed_recorded_and_replays_and_leaves_the_live_windows(
    session: zenoh.Session, listener: Listener, tmp_path: Path
) -> None:
    def stored() -> list[dict[str, Any]]:
        return of(listener, "rwa/sat/wheel_1/diagnosis", "stored")

    with monitor(session, options(record=tmp_path)) as log_lines:
        live = put_pieces(SamplesPublisher(session, KEY, "live"), LIVE, 250)
        wait_for(lambda: of(listener, "rwa/sat/wheel_1/diagnosis"), "the live window")
        dump = put_pieces(SamplesPublisher(session, KEY, "stored"), DUMP[:-700], 250, backwards=True)
        wait_for(lambda: len({one["window_start_ns"] for one in stored()}) >= 2, "two windows of the dump")
    with monitor(session, options(record=tmp_path)):  # it goes on with what waits for the rest of the dump
        rest = put_pieces(SamplesPublisher(session, KEY, "stored"), DUMP[-700:], 250)

        wait_for(lambda: {0, WINDOW, 2 * WINDOW} <= {one["window_start_ns"] // PERIOD_NS for one in stored()}, "all")
        received = len(LIVE) + len(DUMP)
        wait_for(lambda: listener.status().get("samples_used", 0) >= received, "all samples")
        for publisher in (live, dump, rest):
            publisher.close()
    status = listener.status()
    assert adds_up(status)
    assert (status["samples_late"], status["samples_rejected"], status["messages_missed"]) == (0, 0, 0)
    assert status["last_error"] is None
    latest = {one["window_start_ns"]: one for one in stored()}
    whole = {one["window_start_ns"]: one for one in map(json.loads, batch_diagnoses(DAY, wheel()))}
    for start in range(3):
        found, expected = latest[start * WINDOW * PERIOD_NS], whole[start * WINDOW * PERIOD_NS]
        assert {**found, "data": None} == {**expected, "data": None}
    alone = [json.loads(payload) for payload in batch_diagnoses(LIVE, wheel())]
    assert of(listener, "rwa/sat/wheel_1/diagnosis")[:1] == alone
    ends = [one["window_end_ns"] for one in map(json.loads, listener.kind("health"))]
    assert ends == sorted(ends)  # a dump brings no wheel's health back to what it was
    assert any("stored data, window to" in line for line in log_lines)
    assert replay(tmp_path).bytes_equal
    first = min(tmp_path.glob("*.mcap"))
    assert {batch.data for batch in read_telemetry(first).telemetry[0].batches} == {"live", "stored"}


def test_a_replay_is_kept_apart_from_the_wheel_and_is_no_alarm(
    session: zenoh.Session, listener: Listener, tmp_path: Path
) -> None:
    before, now = tmp_path / "before", tmp_path / "now"
    samples = telemetry(2 * WINDOW + 1)
    with monitor(session, options(record=before)):
        publish({KEY: samples}, session, speed=math.inf, linger_s=0.0)
        wait_for(lambda: len(listener.kind("diagnosis")) >= 2, "both windows")
    first = listener.kind("diagnosis")
    with monitor(session, options(record=now)) as log_lines:
        live = put_pieces(SamplesPublisher(session, KEY, None), DAY[4 * WINDOW : 4 * WINDOW + 200], 250)
        key = REPLAY_KEY.format("diagnosis")
        for windows in (2, 4):  # twice: each begins with nothing known of the wheel
            assert replay_to_bus(before, session, speed=math.inf, stop=Event()) == math.ceil(len(samples) / 256)
            wait_for(lambda windows=windows: sum(at == key for at, _ in listener.received) >= windows, "both again")
        live.close()
    assert [payload for at, payload in listener.received if at == key] == first * 2
    health = of(listener, REPLAY_KEY.format("health"), "replay")
    assert len(health) == 4
    assert all(one["alarms"] == [] for one in health)
    assert {one["data"] for one in map(json.loads, listener.kind("status")) if one["wheel"].endswith("@replay")} == {
        "replay"
    }
    assert of(listener, "rwa/sat/wheel_1/status", "live")[-1]["samples_received"] == 200
    assert any("replay data, window to" in line for line in log_lines)
    assert recorded(now) == []
    assert len(recorded(now, "rwa.Samples")) == 1  # the live ones
    with monitor(session, options(record=now)) as log_lines:
        pass
    assert any("1 wheel," in line for line in log_lines)


def test_what_is_old_by_the_clock_is_stored_in_health_and_status_and_in_no_diagnosis(
    session: zenoh.Session, listener: Listener
) -> None:
    samples = telemetry(3 * WINDOW + 100)
    begin_ns = 1_795_000_000_000_000_000
    samples = Samples(samples.time_ns + begin_ns, samples.speed_rad_s, samples.friction_torque_Nm)
    now_ns = begin_ns + 60 * 10**9
    with closing(MonitorBus(session)) as bus:
        one = Monitor(options(), bus, None, lambda _: None, Clock(wall_ns=lambda: now_ns))
        for number, start in enumerate(range(0, len(samples), 256)):
            part = samples[start : start + 256]
            delay_s = 5 if start <= WINDOW else 700  # and then the link is lost for some minutes
            now_ns = int(part.time_ns[-1]) + delay_s * 10**9
            one.receive(Arrival(KEY, samples_json(part, "p", number)))
            one.tick()
        one.close()
    wait_for(lambda: all(len(listener.kind(kind)) >= 3 for kind in ("health", "diagnosis")), "three windows")
    health = [json.loads(payload).get("data") for payload in listener.kind("health")]
    assert health == [None, "stored", "stored"]
    assert listener.kind("diagnosis") == batch_diagnoses(samples, wheel())
    assert [Status.parse(payload, "").data for payload in listener.kind("status")][-1] == "stored"


@pytest.mark.parametrize(("offset_s", "limit_s"), [(10**8, 600.0), (0, 0.0)])
def test_a_clock_that_counts_from_another_day_shows_no_age(
    session: zenoh.Session, listener: Listener, offset_s: int, limit_s: float
) -> None:
    samples = telemetry(WINDOW + 100)
    with closing(MonitorBus(session)) as bus:
        clock = Clock(wall_ns=lambda: int(samples.time_ns[-1]) + offset_s * 10**9)
        one = Monitor(options(stored_after_s=limit_s), bus, None, lambda _: None, clock)
        one.receive(Arrival(KEY, samples_json(samples, "p", 0)))
        one.close()
    wait_for(lambda: listener.kind("health"), "the window")
    assert "data" not in json.loads(listener.kind("health")[0])


@pytest.mark.parametrize(("age_h", "data"), [(0.1, "stored"), (7, None)])
def test_a_dump_first_after_a_restart_is_stored_where_the_clocks_had_agreed(
    session: zenoh.Session, listener: Listener, tmp_path: Path, age_h: float, data: str | None
) -> None:
    def put(batch: int, samples: Samples, age_h: float) -> None:  # once: no history has the first samples again
        begin_ns = time.time_ns() - round(age_h * 3600e9) - int(samples.time_ns[-1])
        session.put(KEY, samples_json(replace(samples, time_ns=samples.time_ns + begin_ns), "p", batch))

    with monitor(session, options(record=tmp_path)):
        put(0, DAY[:20], age_h)
        wait_for(lambda: listener.status().get("samples_received") == 20, "the first samples")
    for start in range(3):  # the later ones repeat what the first found
        with monitor(session, options(record=tmp_path)):
            if start == 0:
                put(1, telemetry(WINDOW + 100), 6.0)
            # The clock's step closes the first samples' window, too.
            wait_for(lambda start=start: len(listener.kind("health")) >= 2 + start, "the health")
            wait_for(lambda start=start: listener.status().get("windows") == (0 if start else 2), "a status")
    assert [json.loads(payload).get("data") for payload in listener.kind("health")] == [data] * 4
    assert listener.status()["on_wall_clock"] == (data is not None)
    assert "data" not in json.loads(listener.kind("diagnosis")[0])


def test_a_replay_that_is_stated_on_the_wheels_own_key_is_kept_apart_too(
    session: zenoh.Session, listener: Listener, tmp_path: Path
) -> None:
    samples = telemetry(WINDOW + 100)
    key = REPLAY_KEY.format("diagnosis")
    with monitor(session, options(record=tmp_path)):
        live = put_pieces(SamplesPublisher(session, KEY, None), DAY[4 * WINDOW : 4 * WINDOW + 200], 250)
        wait_for(lambda: of(listener, "rwa/sat/wheel_1/status", "live"), "the live wheel")
        replayed = put_pieces(SamplesPublisher(session, KEY, "replay"), samples, 250)
        wait_for(lambda: of(listener, key), "the window")
        for publisher in (live, replayed):
            publisher.close()
    assert [payload for at, payload in listener.received if at == key] == batch_diagnoses(samples, wheel())
    (health,) = of(listener, REPLAY_KEY.format("health"), "replay")
    assert health["alarms"] == []
    status = of(listener, "rwa/sat/wheel_1/status", "live")[-1]
    assert (status["samples_received"], status["last_error"]) == (200, None)
    assert len(recorded(tmp_path, "rwa.Samples")) == 1
