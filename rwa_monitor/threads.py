"""Usable processors, and parallel work on threads, for arrays and kernels that release the interpreter lock.

Linear algebra runs on one thread: the matrices here are small, threads would only wait for each other, and the order of
sums, so the last bit, would depend on their number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from threading import Lock, local
from typing import TYPE_CHECKING, Any, Final, TypeVar

from threadpoolctl import ThreadpoolController

if TYPE_CHECKING:
    from rwa_monitor.discrepancy.problem import Mapper

Item = TypeVar("Item")
Result = TypeVar("Result")


def cores() -> int:
    """Return how many processors can be used at once, by the system and the limit of a container."""
    from joblib import cpu_count  # noqa: PLC0415 - not installed on board, where nothing runs in parallel

    return int(cpu_count())


def on_threads(threads: int) -> Mapper:
    """Return a function that applies a function to many items on so many threads, values in the order of the items.

    Each value depends on its item alone: the number of threads changes the time, never the answer. Nested calls run
    serially within their thread, so that there are never more threads than these.
    """
    thread = local()

    def apply(function: Callable[[Item], Result], items: Iterable[Item], /) -> list[Result]:
        if threads == 1 or hasattr(thread, "working"):
            return [function(item) for item in items]
        with ThreadPoolExecutor(threads, initializer=setattr, initargs=(thread, "working", True)) as pool:
            return list(pool.map(function, items))

    return apply


# ---- one thread of linear algebra ------------------------------------------------------------------------------------


@contextmanager
def one_thread_of_algebra() -> Iterator[None]:
    """Limit linear algebra (BLAS) to one thread in a block, or, as a decorator, in a function.

    The number of threads is a setting of the process: its other work is limited to one as well until the last such
    block ends; then the number is restored. Takes some 10 µs.
    """
    with _lock:
        _blocks.append(None if _blocks else _libraries().limit(limits=1, user_api="blas"))
    try:
        yield
    finally:
        with _lock:
            limit = _blocks[0]
            _blocks.pop()
            if not _blocks:
                limit.restore_original_limits()


# State of the process, an entry per running block: the first holds the limit that was set, the others None.
_blocks: Final[list[Any]] = []
_lock: Final = Lock()


@cache
def _libraries() -> ThreadpoolController:
    """Return the libraries of linear algebra that are loaded; searched once, which takes 10 ms."""
    import scipy.linalg  # noqa: F401, PLC0415  (loads one in addition to numpy's)

    return ThreadpoolController()
