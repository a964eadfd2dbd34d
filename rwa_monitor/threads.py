"""Work side by side on threads, where arrays and compiled loops leave the interpreter free for one another."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rwa_monitor.discrepancy.mapper import Mapper

Item = TypeVar("Item")
Result = TypeVar("Result")


def on_threads(threads: int) -> Mapper:
    """Return a way to apply a function to many items on so many threads, values in the order of the items.

    Each value depends on its item alone: the number of threads changes the time, never the answer. A function that is
    applied so must not apply another so: all threads might then wait for one another.
    """

    def apply(function: Callable[[Item], Result], items: Iterable[Item], /) -> list[Result]:
        with ThreadPoolExecutor(threads) as pool:
            return list(pool.map(function, items))

    return apply
