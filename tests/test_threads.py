"""Work side by side on threads: the same values in their order, never more threads, and errors as they are."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from rwa_monitor import threads
from rwa_monitor.errors import InputError
from rwa_monitor.threads import on_threads

THREADS = 2


def name_of_thread(_: int) -> str:
    return threading.current_thread().name


@pytest.mark.parametrize("count", [0, 1, 3, 40])
@pytest.mark.parametrize("number", [1, THREADS])
def test_values_come_in_the_order_of_the_items(number: int, count: int) -> None:
    assert on_threads(number)(abs, range(-count, 0)) == list(range(count, 0, -1))


def test_work_within_work_is_done_in_turn() -> None:
    each = on_threads(THREADS)
    within = each(lambda _: (name_of_thread(0), set(each(name_of_thread, range(4)))), range(4))
    assert all(inner == {outer} for outer, inner in within)
    assert threading.current_thread().name not in {outer for outer, _ in within}


def test_an_error_is_raised_as_it_is() -> None:
    def refused(item: int) -> int:
        if item == 2:
            raise InputError("file.csv", "no friction", "row 3")
        return item

    with pytest.raises(InputError, match="no friction") as raised:
        on_threads(THREADS)(refused, range(4))
    assert (raised.value.source, raised.value.place) == ("file.csv", "row 3")


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
    monkeypatch.setattr(threads, "CGROUP", tmp_path)
    monkeypatch.setattr(threads.os, "sched_getaffinity", lambda _: set(range(8)))
    assert threads.cores() == (cores or 8)
