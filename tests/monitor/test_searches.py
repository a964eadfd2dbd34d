"""A wheel whose model does not fit is searched in another process; the report is published, recorded and replayed."""

import errno
import json
import signal
from collections.abc import Iterator
from multiprocessing import active_children
from multiprocessing.context import SpawnProcess
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np
import pytest
import zenoh

from rwa_monitor.messages import Discrepancy, samples_json
from rwa_monitor.monitor.replay import replay
from rwa_monitor.monitor.searches import Searches
from rwa_monitor.monitor.service import RunOptions
from rwa_monitor.monitor.setup import Setup
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.datasets import scaled_wheel
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.wheel import EffectBlock, Wheel, Window, built_in_wheel
from tests.monitor.processes import Listener, monitor, wait_for
from tests.monitor.support import model, publish, recorded

SLOTS = 8_000
KEY = ("sat", "a")
# A search of 8,000 slots takes about 5 s on an idle machine, and where all cores are busy ten times its share of them:
# it lets others go before it (searches.NICENESS). This catches a hang.
LIMIT_S = 500.0


def small_wheel() -> Wheel:
    """Return the built-in wheel with windows a tenth as long and systems ten times as lively."""
    window = Window(samples=SLOTS, hop=SLOTS, dead_band_rad_s=1.0)
    return scaled_wheel(built_in_wheel(), 0.1).model_copy(update={"window": window})


def telemetry(windows: int) -> Samples:
    """Simulate a wheel with windage, as if its housing leaked, that its constants do not know."""
    effect = EffectBlock(name="quadratic_drag", parameters={"strength_Nm_s2_rad2": 3.0e-8})
    scenario = Scenario(duration_s=windows * SLOTS * 0.125 + 20.0, speed=SpeedProfile(kind="rich"), effect=(effect,))
    return simulate(scenario, small_wheel(), np.random.default_rng(12)).samples


def batches(samples: Samples) -> list[bytes]:
    """Cut samples into messages of 250."""
    return [samples_json(samples[i : i + 250], "p", n) for n, i in enumerate(range(0, len(samples), 250))]


@pytest.fixture
def log_lines() -> list[str]:
    return []


@pytest.fixture
def searches(tmp_path: Path, log_lines: list[str]) -> Iterator[Searches]:
    made = Searches(Setup(small_wheel()), tmp_path, log_lines.append)
    yield made
    made.close()


def test_an_adequate_window_in_between_starts_again(searches: Searches) -> None:
    for adequate in (False, True, False):
        searches.take_diagnosis(KEY, adequate=adequate)
        searches.take_input(KEY, b"{}")
    assert searches.poll() == []


def test_samples_that_cannot_be_searched_are_reported_and_nothing_is_published(
    searches: Searches, log_lines: list[str]
) -> None:
    searches.take_diagnosis(KEY, adequate=False)
    few = Samples(np.arange(5) * 125_000_000, np.full(5, 100.0), np.full(5, 1e-3))
    searches.take_input(KEY, samples_json(few, "p", 0))
    searches.take_diagnosis(KEY, adequate=False)
    wait_for(
        lambda: searches.poll() != [] or any("could not be made" in line for line in log_lines), "the line", LIMIT_S
    )
    assert "only 5 good samples" in log_lines[-1]


def begun(searches: Searches, copies: int = 1) -> BaseProcess:
    """Begin a search of a window that came so many times; returns its process."""
    searches.take_diagnosis(KEY, adequate=False)
    for payload in copies * batches(telemetry(1)):
        searches.take_input(KEY, payload)
    searches.take_diagnosis(KEY, adequate=False)
    before = set(active_children())
    assert searches.poll() == []
    (child,) = set(active_children()) - before
    return child


def test_where_no_process_can_be_started_that_is_reported_and_the_next_one_is_tried(
    searches: Searches, log_lines: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(_: object) -> None:
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    with monkeypatch.context() as patched:
        patched.setattr(SpawnProcess, "start", refused)
        for _ in range(2):
            searches.take_diagnosis(KEY, adequate=False)
            searches.take_input(KEY, b"{}")
        assert searches.poll() == []
        assert log_lines[-1] == "sat/a: no process for a discrepancy search: Resource temporarily unavailable"
    searches.take_diagnosis(KEY, adequate=True)
    begun(searches)


def test_a_wheel_is_searched_once_and_close_ends_a_running_search_at_once(
    searches: Searches, log_lines: list[str]
) -> None:
    child = begun(searches, copies=20)  # more than a pipe holds: its process takes them when it has imported all
    searches.take_input(KEY, b"{}")
    searches.take_diagnosis(KEY, adequate=False)
    assert sum("searching for the cause" in line for line in log_lines) == 1
    searches.close()
    wait_for(lambda: child.exitcode is not None, "its end", LIMIT_S)  # its pool's thread may be the one that reaps it
    assert child.exitcode == -signal.SIGKILL  # it was not waited for until it had its answer


def test_a_search_whose_process_is_killed_is_reported(searches: Searches, log_lines: list[str]) -> None:
    begun(searches).kill()  # as the system does where memory is short
    wait_for(lambda: searches.poll() == [] and "could not be made" in log_lines[-1], "the line that it has ended")
    assert "terminated abruptly" in log_lines[-1]


def test_live_search_is_published_recorded_and_verified(tmp_path: Path, session: zenoh.Session) -> None:
    """From samples on a bus to a named cause: three windows of a wheel that its model does not fit."""
    listener = Listener(session)
    with monitor(session, RunOptions(setup=Setup(small_wheel(), model=model()), record=tmp_path)):
        publish({"rwa/sat/a/samples": telemetry(3)}, session, speed=float("inf"), batch_samples=250, linger_s=0.0)
        wait_for(lambda: listener.kind("discrepancy"), "the report", LIMIT_S)
    received = listener.kind("discrepancy")
    assert json.loads(received[0])["effects"][0]["name"] == "quadratic_drag"
    assert recorded(tmp_path, Discrepancy.schema_name()) == received
    report = replay(tmp_path)
    assert report.compared[Discrepancy.schema_name()] == 1
    assert report.equal
