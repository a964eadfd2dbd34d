"""Work side by side on threads: the same values in their order, never more threads, and errors as they are."""

import threading

import pytest

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
