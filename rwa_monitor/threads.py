"""Work side by side on threads, where arrays and compiled loops leave the interpreter free for one another.

And linear algebra on one thread: our matrices are small, threads would only wait for each other, and the order of sums,
so the last bit, would depend on how many there are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar

from threadpoolctl import ThreadpoolController

if TYPE_CHECKING:
    from rwa_monitor.discrepancy.mapper import Mapper

Item = TypeVar("Item")
Result = TypeVar("Result")


def on_threads(threads: int) -> Mapper:
    """Return a way to apply a function to many items on so many threads, values in the order of the items.

    Each value depends on its item alone: the number of threads changes the time, never the answer. A function that is
    applied so must not apply another so: all threads might then wait for one another.
    """

    def apply(function: Callable[[Item], Result], items: Iterable[Item], /, *, apart: bool = False) -> list[Result]:
        del apart
        with ThreadPoolExecutor(threads) as pool:
            return list(pool.map(function, items))

    return apply


# ---- one thread of linear algebra ------------------------------------------------------------------------------------


@contextmanager
def one_thread_of_algebra() -> Iterator[None]:
    """Keep linear algebra (BLAS) to one thread in a block, or, as a decorator, in a function.

    The number of threads belongs to the process: other work of the process is held to one as well until the last such
    block ends; then it has as many as before. Costs some 10 µs.
    """
    _limit.enter()
    try:
        yield
    finally:
        _limit.leave()


class _Limit:
    """The limit of the process; blocks may nest, and overlap where several threads compute."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._blocks = 0
        self._set: Any = None

    def enter(self) -> None:
        with self._lock:
            if self._blocks == 0:
                self._set = _libraries().limit(limits=1, user_api="blas")
            self._blocks += 1

    def leave(self) -> None:
        with self._lock:
            self._blocks -= 1
            if self._blocks == 0:
                self._set.restore_original_limits()


_limit = _Limit()


@cache
def _libraries() -> ThreadpoolController:
    """Return the libraries of linear algebra that are loaded; looked for once, which takes 10 ms."""
    import scipy.linalg  # noqa: F401, PLC0415  (brings one beside numpy's)

    return ThreadpoolController()
