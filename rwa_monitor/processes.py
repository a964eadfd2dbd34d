"""Work side by side in processes, where threads would wait for one another's turn at the interpreter.

Processes begin empty, and all that they need travels. What many calls hold (`SentOnce`) goes to each process once and
is known by its number from then on, so that what a process has worked out for it stays there too, until it is dropped
here.
"""

from __future__ import annotations

import io
import multiprocessing
import os
import pickle
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from multiprocessing import forkserver
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Final, TypeVar
from weakref import WeakValueDictionary, finalize

import numpy as np

from rwa_monitor.discrepancy.mapper import Mapper, SentOnce, in_turn
from rwa_monitor.errors import RwaMonitorError
from rwa_monitor.threads import on_threads, one_thread_of_algebra

Item = TypeVar("Item")
Result = TypeVar("Result")

MOST_OF_A_SEARCH: Final = 4  # processes: with more the longest candidate decides
# Of each process of a search, as `benchmark speed` finds it: 0.4 GB at 80,000 samples, 1.2 GB at 320,000.
BYTES_OF_A_PROCESS: Final = 150_000_000
BYTES_OF_A_SAMPLE: Final = 3_300
CGROUP: Final = Path("/sys/fs/cgroup")  # of a container, as it sees its own
END_S: Final = 1.0  # for the system to say how a process ended that has closed its pipe
MAPPER: Final = -1  # the number of what applies functions: each process has its own
FUNCTION, ITEM, KEEP, FORGET, VALUE, ERROR = "function", "item", "keep", "forget", "value", "error"  # messages
PRELOAD: Final = [__name__, "rwa_monitor.discrepancy.search"]


@contextmanager
def on_processes(processes: int) -> Iterator[Mapper]:
    """Give a way to apply a function to many items in so many processes, values in the order of the items.

    Each value depends on its item alone: the number of processes changes the time, never the answer. What is not said
    to be work `apart` stays here, on as many threads, and all of it where the system lets no process be started. One
    process is this one. Others take a second to be ready, during which this one goes on; they end with the block, and
    if this process is killed.

    Raises
    ------
    RwaMonitorError
        Where it is used: if a process has ended before its work, as when the system had no memory left for it.
    """
    if processes == 1:
        yield in_turn
        return
    # They are forked from a server that has imported what is needed, once for all, and has no threads.
    multiprocessing.set_forkserver_preload(PRELOAD)
    try:
        forkserver.ensure_running()
    except OSError:  # no folder for its socket, as where all is read-only, or too many processes
        yield on_threads(processes)
        return
    mapper = _OnProcesses(processes)
    try:
        yield mapper
    finally:
        mapper.end()


def cores() -> int:
    """Return how many processes can run at once here; Linux only."""
    return len(os.sched_getaffinity(0))


def for_a_search(samples: int) -> int:
    """Return how many processes a search of so many samples is given here; Linux only."""
    return processes_of_a_search(samples, cores(), memory_left_bytes())


def processes_of_a_search(samples: int, cores: int, memory_bytes: int) -> int:
    """Return how many processes a search of so many samples is given, with these cores and this memory."""
    each_bytes = BYTES_OF_A_PROCESS + BYTES_OF_A_SAMPLE * samples
    return max(1, min(cores, MOST_OF_A_SEARCH, memory_bytes // each_bytes - 1))  # this one takes as much itself


def memory_left_bytes() -> int:
    """Return how much memory is left for processes, by the system and the limit of a container [bytes]; Linux only."""
    left = _sizes_of(Path("/proc/meminfo"))["MemAvailable:"] * 1024
    limit, used = CGROUP / "memory.max", CGROUP / "memory.stat"
    if limit.exists() and (most := limit.read_text(encoding="ascii").strip()) != "max":
        left = min(left, int(most) - _sizes_of(used)["anon"])
    return left


def _sizes_of(file: Path) -> dict[str, int]:
    """Return the sizes that a file of the system lists, a name and a number a line."""
    return {name: int(size) for name, size, *_ in map(str.split, file.read_text(encoding="ascii").splitlines())}


class _OnProcesses:
    """Hands out items to workers: to each a stretch of them, and to who is done early the last of the longest left."""

    def __init__(self, processes: int) -> None:
        self._processes = processes
        self._here = on_threads(processes)
        self._workers: list[_Worker] = []  # started when they are wanted

    def __call__(
        self, function: Callable[[Item], Result], items: Iterable[Item], /, *, apart: bool = False
    ) -> list[Result]:
        items = list(items)
        if not apart or len(items) < 2:
            return self._here(function, items)
        if not self._workers:
            self._workers = [_Worker() for _ in range(self._processes)]
        try:
            return self._apart(function, items)
        except BaseException:
            self.end()  # others may still work: their answers are nobody's
            raise

    def end(self) -> None:
        """End all processes, whatever they do."""
        for worker in self._workers:
            worker.end()

    def _apart(self, function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        # Neighbours are alike, and the same ones come again: what a process worked out for them, it has kept.
        queues = [deque(stretch) for stretch in np.array_split(np.arange(len(items)), len(self._workers))]
        values: dict[int, Result] = {}
        busy: dict[object, int] = {}  # which worker is behind a pipe

        def go_on(number: int) -> None:
            if any(queues):
                index = int(queues[number].popleft() if queues[number] else max(queues, key=len).pop())
                self._workers[number].give(index, items[index])
                busy[self._workers[number].connection] = number

        for number, worker in enumerate(self._workers):
            if any(queues):
                worker.give_function(function)
                go_on(number)
        while busy:
            for connection in wait([self._workers[number].connection for number in busy.values()]):
                number = busy.pop(connection)
                index, value = self._workers[number].take()
                values[index] = value
                go_on(number)
        return [values[index] for index in range(len(items))]


class _Worker:
    """A process that applies functions, and what it has been sent for good."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("forkserver")
        self.connection, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other,), daemon=True)
        self._process.start()
        other.close()
        self._count = count()
        self._numbers: dict[int, int] = {}  # of what was sent once, by its identity, which is its own while it is held
        self._sent: WeakValueDictionary[int, Any] = WeakValueDictionary()  # by number
        self._dropped: list[int] = []

    def give_function(self, function: Callable[[Any], Any]) -> None:
        """Send the function that is applied from now on."""
        self._send(FUNCTION, 0, function)

    def give(self, index: int, item: Any) -> None:
        """Send an item to apply the function to."""
        self._send(ITEM, index, item)

    def take(self) -> tuple[int, Any]:
        """Return the value that has arrived, and which item's it is."""
        try:
            data = self.connection.recv_bytes()
        except (EOFError, ConnectionResetError) as error:
            raise self._ended() from error
        kind, index, value = _Reader(data, self._sent).load()
        if kind == ERROR:
            raised, lines = value
            raised.add_note(f"in another process:\n{lines}")
            raise raised
        return index, value

    def end(self) -> None:
        """End the process, whatever it does."""
        self.connection.close()
        self._process.kill()
        self._process.join()

    def _send(self, kind: str, number: int, content: object) -> None:
        if self.connection.closed:
            raise self._ended()
        try:
            if self._dropped:
                dropped, self._dropped = self._dropped, []
                self.connection.send_bytes(_written((FORGET, 0, dropped), self._number))
            self.connection.send_bytes(_written((kind, number, content), self._number))
        except (BrokenPipeError, ConnectionResetError) as error:
            raise self._ended() from error

    def _number(self, one: object) -> int:
        """Return the number of what is sent once; where it was not yet, it is sent now, before what holds it."""
        if id(one) not in self._numbers:
            number = self._numbers[id(one)] = next(self._count)
            self._sent[number] = one
            finalize(one, self._drop, id(one), number).atexit = False
            self._send(KEEP, number, one)
        return self._numbers[id(one)]

    def _drop(self, identity: int, number: int) -> None:
        """Note that what was sent once is held here no more."""
        del self._numbers[identity]
        self._dropped.append(number)

    def _ended(self) -> RwaMonitorError:
        self._process.join(END_S)
        code = self._process.exitcode
        return RwaMonitorError(f"a process beside this one has ended (exit code {code}): is there memory left for it?")


# ---- in the other process --------------------------------------------------------------------------------------------


def _serve(connection: Connection) -> None:
    """Apply the function to the items that come, until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the whole terminal; who asked closes the pipe
    kept: dict[int, object] = {}
    numbers: dict[int, int] = {}  # of what is kept, by its identity here
    function: Callable[[Any], Any] | None = None
    with one_thread_of_algebra(), suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            kind, number, content = _Reader(connection.recv_bytes(), kept).load()
            if kind == KEEP:
                kept[number] = content
                numbers[id(content)] = number
            elif kind == FORGET:
                for gone in content:
                    del numbers[id(kept.pop(gone))]
            elif kind == FUNCTION:
                function = content
            else:
                assert function is not None
                connection.send_bytes(_answer(function, number, content, numbers))


def _answer(function: Callable[[Any], Any], index: int, item: object, numbers: Mapping[int, int]) -> memoryview:
    """Apply a function and return the value as it is sent, or the error that it raised."""
    try:
        return _written((VALUE, index, function(item)), lambda one: numbers.get(id(one)))
    except Exception as error:  # noqa: BLE001 - raised again where the value was wanted
        return _written((ERROR, index, (error, traceback.format_exc())), lambda _: None)


# ---- on the way ------------------------------------------------------------------------------------------------------


def _written(message: tuple[str, int, object], number: Callable[[object], int | None]) -> memoryview:
    """Return a message in bytes, with numbers in place of what is sent once; all of it where that is sent just now.

    `number` gives them; None for what the other side has not.
    """
    kind, _, content = message
    data = io.BytesIO()
    _Writer(data, number, content if kind == KEEP else None).dump(message)
    return data.getbuffer()


class _Writer(pickle.Pickler):
    """Writes numbers in place of what is sent once, but for what is `whole`."""

    def __init__(self, file: io.BytesIO, number: Callable[[object], int | None], whole: object) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self._number_of = number
        self._whole = whole

    def persistent_id(self, one: object) -> int | None:
        """Return the number that stands for an object, or None."""
        if isinstance(one, _OnProcesses):
            return MAPPER
        if one is self._whole or not (isinstance(one, SentOnce) or _is_made(one)):
            return None
        return self._number_of(one)

    def reducer_override(self, one: object) -> Any:
        """Return how a class is made that has no name to import it by."""
        if not _is_made(one):
            return NotImplemented
        assert isinstance(one, type)
        return type, (one.__name__, one.__bases__, {k: v for k, v in vars(one).items() if not k.startswith("_")})


def _is_made(one: object) -> bool:
    """Say whether something is a class that was made on the way: not one that another process can import."""
    return isinstance(one, type) and getattr(sys.modules[one.__module__], one.__name__, None) is not one


class _Reader(pickle.Unpickler):
    """Puts back what numbers stand for."""

    def __init__(self, data: bytes, kept: Mapping[int, object]) -> None:
        super().__init__(io.BytesIO(data))
        self._kept = kept

    def persistent_load(self, number: int) -> object:
        """Return what a number stands for."""
        return in_turn if number == MAPPER else self._kept[number]
