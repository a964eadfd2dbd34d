"""Work side by side in processes: the same values, what is sent once, what goes wrong there, and how they end."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import psutil
import pytest
from numba.core.dispatcher import Dispatcher

from rwa_monitor import processes
from rwa_monitor.discrepancy.mapper import Mapper, SentOnce, in_turn
from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.processes import memory_left_bytes, on_processes, processes_of_a_search

PROCESSES = 2
END_S = 20.0  # for a process to end; a loaded machine takes its time


class Shelf(SentOnce):
    """Something that is sent once, and on which functions leave things."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = values
        self.left: list[int] = []
        self.each: Mapper = in_turn


def scaled(shelf: Shelf, item: int) -> tuple[np.ndarray, int]:
    return shelf.values * item, os.getpid()


def left_there(shelf: Shelf, item: int) -> tuple[int, list[int]]:
    shelf.left.append(item)
    return os.getpid(), list(shelf.left)


def same(shelf: Shelf, item: int) -> tuple[Shelf, int]:
    return shelf, item


def shelves_there(_: int) -> tuple[int, int]:
    gc.collect()
    return os.getpid(), sum(isinstance(one, Shelf) for one in gc.get_objects())


def itself(shelf: Shelf) -> Shelf:
    return shelf


def nested(shelf: Shelf, item: int) -> list[int]:
    return shelf.each(abs, [-item, item])


def instance_of(kind: type, item: int) -> tuple[type, int]:
    return kind, kind().value + item  # type: ignore[attr-defined]


def refused(item: int) -> int:
    if item == 2:
        raise InputError("file.csv", "no friction", "row 3")
    return item


def killed(item: int) -> int:
    if item == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return item


def loops_there(_: int) -> tuple[int, int]:
    """Return the process, and how many of our compiled loops it has, without asking for any."""
    ours = [one for one in gc.get_objects() if isinstance(one, Dispatcher) and one.py_func.__module__.startswith("rwa")]
    return os.getpid(), sum(bool(one.signatures) for one in ours)


@pytest.fixture(scope="module")
def each() -> Iterator[Mapper]:
    with on_processes(PROCESSES) as mapper:
        yield mapper


@pytest.mark.parametrize("count", [2, 3, 7, 40])
def test_values_are_those_of_one_after_the_other_in_the_order_of_the_items(each: Mapper, count: int) -> None:
    shelf = Shelf(np.linspace(0.0, 1.0, 100_000))
    apart = each(partial(scaled, shelf), range(count), apart=True)
    here = in_turn(partial(scaled, shelf), range(count))
    assert all(np.array_equal(one, other) for (one, _), (other, _) in zip(apart, here, strict=True))
    assert os.getpid() not in {process for _, process in apart}
    assert len({process for _, process in apart}) == PROCESSES


def test_what_is_not_said_to_be_work_apart_stays_here(each: Mapper) -> None:
    assert {process for _, process in each(partial(scaled, Shelf(np.ones(1))), range(4))} == {os.getpid()}


def test_what_is_sent_once_stays_with_what_was_left_on_it(each: Mapper) -> None:
    shelf = Shelf(np.zeros(1))
    first = each(partial(left_there, shelf), range(4), apart=True)
    again = each(partial(left_there, shelf), range(4), apart=True)
    for process in {process for process, _ in first}:
        before = max((left for of, left in first if of == process), key=len)
        after = min((left for of, left in again if of == process), key=len)
        assert after[: len(before)] == before
    assert shelf.left == []


def test_what_is_dropped_here_is_dropped_there(each: Mapper) -> None:
    shelf = Shelf(np.zeros(1))
    before = sum(dict(each(shelves_there, range(4), apart=True)).values())
    each(partial(left_there, shelf), range(4), apart=True)
    assert sum(dict(each(shelves_there, range(4), apart=True)).values()) == before + PROCESSES
    del shelf
    each(abs, range(4), apart=True)
    assert sum(dict(each(shelves_there, range(4), apart=True)).values()) == before


def test_what_is_sent_once_comes_back_as_the_one_here(each: Mapper) -> None:
    shelf = Shelf(np.zeros(1))
    assert all(one is shelf for one, _ in each(partial(same, shelf), range(4), apart=True))
    assert all(one is shelf for one in each(itself, [shelf, shelf], apart=True))


def test_processes_begin_with_the_compiled_loops_of_a_search() -> None:
    with on_processes(PROCESSES) as each:  # new ones
        there = dict(each(loops_there, range(4), apart=True))
    assert len(there) == PROCESSES
    assert min(there.values()) >= 10  # 12 are called in all
    # What is forked from a process with several threads may stand still.
    server = psutil.Process(processes.forkserver._forkserver._forkserver_pid)
    assert server.num_threads() == 1


def test_a_process_has_its_own_way_to_apply_functions(each: Mapper) -> None:
    shelf = Shelf(np.zeros(1))
    shelf.each = each
    assert each(partial(nested, shelf), [1, 2, 3], apart=True) == [[1, 1], [2, 2], [3, 3]]


def test_a_class_made_on_the_way_is_made_there_too_and_comes_back_as_itself(each: Mapper) -> None:
    made = type("Made", (dict,), {"value": 5})
    assert each(partial(instance_of, made), [1, 2], apart=True) == [(made, 6), (made, 7)]


def test_an_error_there_is_raised_here_with_all_its_parts() -> None:
    with on_processes(PROCESSES) as each:
        with pytest.raises(InputError) as raised:
            each(refused, range(4), apart=True)
        assert (raised.value.source, raised.value.place) == ("file.csv", "row 3")
        assert any("in refused" in note for note in raised.value.__notes__)
        # Others were still at work: nobody takes their answers for those of another call. What comes is done here.
        assert {process for _, process in each(partial(scaled, Shelf(np.ones(1))), range(4), apart=True)} == {
            os.getpid()
        }


class TwoWordsError(Exception):
    """One that cannot be made anew from its arguments."""

    def __init__(self, one: str, other: str) -> None:
        super().__init__(f"{one} {other}")


def raise_two_words(_: int) -> None:
    raise TwoWordsError("no", "friction")


def test_an_error_that_cannot_travel_comes_in_its_words() -> None:
    with on_processes(PROCESSES) as each, pytest.raises(RwaMonitorError, match="TwoWordsError: no friction"):
        each(raise_two_words, range(4), apart=True)


def test_after_the_block_work_is_done_here() -> None:
    with on_processes(PROCESSES) as each:
        pass
    assert set(each(process_of, range(4), apart=True)) == {os.getpid()}


def test_a_process_that_is_killed_is_told() -> None:
    with on_processes(PROCESSES) as each, pytest.raises(RwaMonitorError, match=r"exit code -9.*memory"):
        each(killed, range(4), apart=True)


@pytest.mark.parametrize(
    ("samples", "cores", "memory_GB", "processes"),
    [(80_000, 4, 16.0, 4), (80_000, 2, 16.0, 2), (80_000, 64, 64.0, 4), (80_000, 4, 1.0, 1), (320_000, 4, 4.0, 2)],
)
def test_a_search_gets_the_processes_that_cores_and_memory_allow(
    samples: int, cores: int, memory_GB: float, processes: int
) -> None:
    assert processes_of_a_search(samples, cores, int(memory_GB * 1e9)) == processes


def test_the_memory_that_is_left_is_what_the_system_says() -> None:
    assert 0 < memory_left_bytes() <= psutil.virtual_memory().total


def test_where_no_server_can_be_started_the_work_stays_here(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused() -> None:
        raise OSError("AF_UNIX path too long")

    monkeypatch.setattr(processes.forkserver, "ensure_running", refused)
    with on_processes(PROCESSES) as each:
        assert set(each(process_of, range(4), apart=True)) == {os.getpid()}


@pytest.mark.parametrize("started", [0, 1])
def test_where_fewer_processes_can_be_started_they_do_the_work(started: int, monkeypatch: pytest.MonkeyPatch) -> None:
    worker, made = processes._Worker, []

    def limited() -> object:
        if len(made) == started:
            raise EOFError("unexpected EOF")
        made.append(worker())
        return made[-1]

    monkeypatch.setattr(processes, "_Worker", limited)
    with on_processes(PROCESSES) as each:
        found = set(each(process_of, range(4), apart=True))
    assert len(found) == 1
    assert (os.getpid() in found) == (started == 0)


@pytest.mark.parametrize(
    ("limit", "text", "used", "left"),
    [
        ("memory.max", "1000000000", "anon 400000000", 600_000_000),
        ("memory.max", "max", "anon 400000000", None),
        ("memory/memory.limit_in_bytes", "1000000000", "total_rss 300000000", 700_000_000),
    ],
)
def test_the_limit_of_a_container_counts(
    limit: str, text: str, used: str, left: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / limit).parent.mkdir(exist_ok=True)
    (tmp_path / limit).write_text(f"{text}\n")
    (tmp_path / limit).with_name("memory.stat").write_text(f"{used}\nfile 5\n")
    monkeypatch.setattr(processes, "CGROUP", tmp_path)
    assert memory_left_bytes() == left if left else memory_left_bytes() > 1e9


@pytest.mark.parametrize(
    ("files", "cores"),
    [
        ({"cpu.max": "200000 100000"}, 2),
        ({"cpu.max": "150000 100000"}, 2),  # one would leave half a core idle
        ({"cpu.max": "50000 100000"}, 1),
        ({"cpu.max": "max 100000"}, None),
        ({"cpu/cpu.cfs_quota_us": "200000", "cpu/cpu.cfs_period_us": "100000"}, 2),
        ({"cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"}, None),
    ],
)
def test_the_processor_time_of_a_container_counts(
    files: dict[str, str], cores: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(f"{text}\n")
    monkeypatch.setattr(processes, "CGROUP", tmp_path)
    monkeypatch.setattr(processes.os, "sched_getaffinity", lambda _: set(range(8)))
    assert processes.cores() == (cores or 8)


def test_what_is_held_out_leaves_less_memory_to_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "cores", lambda: 4)
    monkeypatch.setattr(processes, "memory_left_bytes", lambda: 2_500_000_000)
    assert processes.for_a_search(80_000) == 4
    assert processes.for_a_search(80_000, held_out=400_000) == 1


def test_processes_end_with_the_block() -> None:
    with on_processes(PROCESSES) as each:
        assert each(abs, [-1, -2], apart=True) == [1, 2]
        workers = set(each(process_of, range(4), apart=True))
        assert len(workers) == PROCESSES
        assert os.getpid() not in workers
    assert not any(psutil.pid_exists(worker) for worker in workers)


def asleep(_: int) -> None:
    time.sleep(600)


def process_of(_: int) -> int:
    return os.getpid()


def test_processes_end_when_the_one_that_asked_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "asks.py"
    script.write_text(
        textwrap.dedent("""
            from tests.test_processes import asleep, process_of
            from rwa_monitor.processes import on_processes

            if __name__ == "__main__":
                with on_processes(2) as each:
                    print(*each(process_of, range(4), apart=True), flush=True)
                    each(asleep, range(4), apart=True)
        """),
        encoding="utf-8",
    )
    root = Path(__file__).parents[1]
    environment = os.environ | {"PYTHONPATH": str(root)}
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True, env=environment) as asking:
        assert asking.stdout is not None
        workers = {int(word) for word in asking.stdout.readline().split()}
        assert workers
        asking.kill()
    end = time.monotonic() + END_S
    while any(map(psutil.pid_exists, workers)) and time.monotonic() < end:
        time.sleep(0.05)
    assert not [worker for worker in workers if psutil.pid_exists(worker)]
