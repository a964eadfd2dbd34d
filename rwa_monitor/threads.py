"""How much of the machine is ours, and work side by side on threads, where arrays and kernels release the interpreter.

And linear algebra on one thread: our matrices are small, threads would only wait for each other, and the order of sums,
so the last bit, would depend on how many there are.
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
    """Return how many processors can work at once here, by the system and the limit of a container."""
    from joblib import cpu_count  # noqa: PLC0415 - not on board, where nothing is done side by side

    return int(cpu_count())


def on_threads(threads: int) -> Mapper:
    """Return a way to apply a function to many items on so many threads, values in the order of the items.

    Each value depends on its item alone: the number of threads changes the time, never the answer. Where a function
    that is applied so applies another, that one is applied in turn: there are never more threads than these.
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
    """Keep linear algebra (BLAS) to one thread in a block, or, as a decorator, in a function.

    The number of threads belongs to the process: other work of the process is held to one as well until the last such
    block ends; then it has as many as before. Costs some 10 µs.
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


# Of the process: the limit that the first block set, and an entry for each that began while it, or another, runs.
_blocks: Final[list[Any]] = []
_lock: Final = Lock()


@cache
def _libraries() -> ThreadpoolController:
    """Return the libraries of linear algebra that are loaded; looked for once, which takes 10 ms."""
    import scipy.linalg  # noqa: F401, PLC0415  (brings one beside numpy's)

    return ThreadpoolController()
