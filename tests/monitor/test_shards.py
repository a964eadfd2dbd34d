"""Several monitors share a fleet: each wheel has one, and a shard that is killed loses no window."""

from __future__ import annotations

import signal
import subprocess
from contextlib import ExitStack
from pathlib import Path

import pytest

from rwa_monitor.api import Monitor
from rwa_monitor.monitor.bus import BusOptions, SamplesPublisher, open_session
from rwa_monitor.monitor.replay import replay
from rwa_monitor.samples import Samples
from rwa_monitor.telemetry.table import read_table
from tests.monitor.processes import PATIENCE_S, Listener, process, wait_for, wait_until_it_monitors
from tests.monitor.support import WINDOW, free_port, model, telemetry, wheel
from tests.program import command

WHEELS = 4  # of which two belong to each shard of two
WINDOWS = 4


def whole_windows(samples: Samples, spacecraft: str, name: str) -> list[bytes]:
    """Return what `diagnose` gives for the windows that are full."""
    monitor = Monitor(wheel(), model(), spacecraft=spacecraft, name=name)
    return [diagnosis.to_json() for diagnosis in monitor.feed(samples)]


@pytest.mark.processes
def test_a_shard_that_is_killed_loses_no_window_and_the_other_does_not_notice(tmp_path: Path, wheel_file: Path) -> None:
    names = [f"wheel_{number}" for number in range(1, WHEELS + 1)]
    sent = {name: telemetry(WINDOWS * WINDOW + 50, seed) for seed, name in enumerate(names, start=31)}
    expected = {payload for name in names for payload in whole_windows(sent[name], "sat", name)}
    assert len(expected) == WHEELS * WINDOWS
    endpoint = f"tcp/127.0.0.1:{free_port()}"

    def shard(number: int) -> tuple[str | Path, ...]:
        folder = tmp_path / f"shard_{number}"
        return ("run", "--wheel", wheel_file, "--record", folder, "--shard", f"{number}/2", "-e", endpoint)

    with open_session(BusOptions(listen=(endpoint,))) as session, ExitStack() as running:
        listener = Listener(session)
        publishers = {name: SamplesPublisher(session, f"rwa/sat/{name}/samples") for name in names}

        def publish(first: int, stop: int) -> None:
            for start in range(first, stop, 64):
                for name, publisher in publishers.items():
                    publisher.put(sent[name][start : min(start + 64, stop)])

        other = running.enter_context(process(*shard(2)))
        wait_until_it_monitors(other)
        with process(*shard(1)) as killed:
            wait_until_it_monitors(killed)
            publish(0, 2 * WINDOW)
            killed.kill()
        publish(2 * WINDOW, 3 * WINDOW)
        again = running.enter_context(process(*shard(1)))
        wait_until_it_monitors(again)
        publish(3 * WINDOW, WINDOWS * WINDOW + 50)
        wait_for(lambda: set(listener.kind("diagnosis")) == expected, "all windows of all wheels")
        for child in (other, again):
            child.send_signal(signal.SIGTERM)
            assert child.wait(PATIENCE_S) == 0
        for publisher in publishers.values():
            publisher.close()
    reports = [replay(tmp_path / f"shard_{number}") for number in (1, 2)]
    assert all(report.bytes_equal for report in reports)
    assert [report.compared["rwa.Diagnosis"] for report in reports] == [WHEELS // 2 * WINDOWS] * 2


@pytest.mark.slow
@pytest.mark.processes
def test_a_fleet_of_publishers_has_the_samples_of_recordings_with_the_same_seeds(
    tmp_path: Path, wheel_file: Path
) -> None:
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(f"[scenario]\nduration_s = {(WINDOW + 300) * 0.125}\n")
    same = ("--scenario", scenario, "--wheel", wheel_file)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with process("run", "--wheel", wheel_file, "--record", tmp_path / "recordings", "-l", endpoint) as child:
        wait_until_it_monitors(child)
        with open_session(BusOptions(mode="client", connect=(endpoint,))) as session:
            listener = Listener(session)
            sending = ("simulate", "publish", *same, "--seed", "7", "--count", "3", "--speed", "inf", "-e", endpoint)
            done = subprocess.run(command(*sending), check=True, timeout=PATIENCE_S, capture_output=True, text=True)
            wait_for(lambda: len(set(listener.kind("diagnosis"))) == 3, "a window of each wheel")
    assert "on rwa/simulated/wheel_1/samples … rwa/simulated/wheel_3/samples" in done.stderr
    for number in range(3):
        table = tmp_path / f"{number}.parquet"
        subprocess.run(command("simulate", "recording", *same, "--seed", 7 + number, "-o", table), check=True)
        (payload,) = whole_windows(read_table(table).samples, "simulated", f"wheel_{number + 1}")
        assert payload in listener.kind("diagnosis")
