"""Work side by side in processes, where threads would wait for one another's turn at the interpreter.

Processes begin empty, and all that they need travels. What many calls hold (`SentOnce`) goes to each process once and
is known by its number from then on, so that what a process has worked out for it stays there too, until it is dropped
here.
"""

from __future__ import annotations

import io
import multiprocessing
import os
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from threading import Thread
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
LIMIT_BEFORE: Final = "memory/memory.limit_in_bytes", "memory/memory.stat"  # where cgroups are of version 1
CPU_LIMIT_BEFORE: Final = "cpu/cpu.cfs_quota_us", "cpu/cpu.cfs_period_us"
NO_LIMIT: Final = "max", "-1"
END_S: Final = 1.0  # for the system to say how a process ended that has closed its pipe
PROTOCOL: Final = 5  # of what is sent: arrays in one piece
FUNCTION, ITEM, KEEP, FORGET, VALUE, ERROR = "function", "item", "keep", "forget", "value", "error"  # messages
PRELOAD: Final = [__name__, "rwa_monitor.preloaded"]


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
        Where it is used: if a process has ended before its work, as when the system had no memory left for it. An error
        of the function is raised as it is; of several, whichever is known first.
    """
    with one_thread_of_algebra():  # as in the processes: the last bit would depend on it
        if processes == 1:
            yield in_turn
            return
        mapper = _OnProcesses(processes)
        if not _start_server():
            mapper.end()
        try:
            yield mapper
        finally:
            mapper.end()


def _start_server() -> bool:
    """Start the process that the others are forked from; False where the system does not let it.

    It imports and loads what is needed, once for all, and has no threads. A signal of the whole terminal is this
    process's alone.
    """
    multiprocessing.set_forkserver_preload(PRELOAD)
    try:
        resource_tracker.ensure_running()  # it would be started with the other, and let the signal through
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            forkserver.ensure_running()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    except OSError:  # no folder for its socket, as where all is read-only, or too many processes
        return False
    return True


def cores() -> int:
    """Return how many processes can run at once here, by the system and the limit of a container; Linux only."""
    allowed = len(os.sched_getaffinity(0))
    for files in (("cpu.max",), CPU_LIMIT_BEFORE):  # the time that is given [µs], and in which one
        if all((CGROUP / file).exists() for file in files):
            given, of = " ".join((CGROUP / file).read_text(encoding="ascii") for file in files).split()
            if given not in NO_LIMIT:
                allowed = min(allowed, -(-int(given) // int(of)))
    return allowed


def for_a_search(samples: int, held_out: int = 0) -> int:
    """Return how many processes a search of so many samples is given here, with others held out; Linux only."""
    # What is held out is this process's alone.
    return processes_of_a_search(samples, cores(), memory_left_bytes() - BYTES_OF_A_SAMPLE * held_out)


def processes_of_a_search(samples: int, cores: int, memory_bytes: int) -> int:
    """Return how many processes a search of so many samples is given, with these cores and this memory."""
    each_bytes = BYTES_OF_A_PROCESS + BYTES_OF_A_SAMPLE * samples
    return max(1, min(cores, MOST_OF_A_SEARCH, memory_bytes // each_bytes - 1))  # this one takes as much itself


def memory_left_bytes() -> int:
    """Return how much memory is left for processes, by the system and the limit of a container [bytes]; Linux only."""
    left = _sizes_of(Path("/proc/meminfo"))["MemAvailable:"] * 1024
    for limit, used, name in (("memory.max", "memory.stat", "anon"), (*LIMIT_BEFORE, "total_rss")):
        if (CGROUP / limit).exists() and (most := (CGROUP / limit).read_text(encoding="ascii").strip()) != "max":
            left = min(left, int(most) - _sizes_of(CGROUP / used)[name])
    return left


def _sizes_of(file: Path) -> dict[str, int]:
    """Return the sizes that a file of the system lists, a name and a number a line."""
    return {name: int(size) for name, size, *_ in map(str.split, file.read_text(encoding="ascii").splitlines())}


class _OnProcesses:
    """Hands out items to workers: to each a stretch of them, and to who is done early the last of the longest left."""

    def __init__(self, processes: int) -> None:
        self._processes = processes  # 0 after the end: all work is done here
        self._here = on_threads(processes)
        self._workers: list[_Worker] = []  # started when they are wanted

    def __call__(
        self, function: Callable[[Item], Result], items: Iterable[Item], /, *, apart: bool = False
    ) -> list[Result]:
        items = list(items)
        if not apart or len(items) < 2 or not self._are_there():
            return self._here(function, items)
        try:
            return self._apart(function, items)
        except BaseException:
            self.end()  # others may still work: their answers are nobody's
            raise

    def end(self) -> None:
        """End all processes, whatever they do; what comes after is done here."""
        for worker in self._workers:
            worker.end()
        self._workers.clear()
        self._processes = 0

    def _are_there(self) -> bool:
        """Start the workers that are still to be started, as many as the system lets; say whether there are any."""
        try:
            while len(self._workers) < self._processes:
                self._workers.append(_Worker())
        except (OSError, EOFError):  # too many processes, or no memory for one more
            self._processes = len(self._workers)
        return bool(self._workers)

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
        try:
            self._process.start()
        except BaseException:
            self.connection.close()
            raise
        finally:
            other.close()
        self._numbers: dict[int, int] = {}  # of what was sent once, by its identity, which is its own while it is held
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
            kind, index, value = self.connection.recv()
        except (EOFError, ConnectionResetError) as error:
            raise self._ended() from error
        if kind == ERROR:
            raised, lines = value
            raised.add_note(f"in another process:\n{lines}")
            raise raised
        return index, value

    def end(self) -> None:
        """End the process, whatever it does."""
        self.connection.close()
        if self._process.is_alive():
            self._process.kill()
        self._process.join()

    def _send(self, kind: str, number: int, content: object) -> None:
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
            number = self._numbers[id(one)] = next(_count)
            _known[number] = one
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
        why = ": is there memory left for it?" if code == -signal.SIGKILL else ""
        return RwaMonitorError(f"a process beside this one has ended (exit code {code}){why}")


# ---- in the other process --------------------------------------------------------------------------------------------


def _serve(connection: Connection) -> None:
    """Apply the function to the items that come, until the pipe is closed."""
    Thread(target=_end_with_parent, daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the whole terminal; who asked closes the pipe
    kept: dict[int, object] = {}
    numbers: dict[int, int] = {}  # of what is kept, by its identity here
    function: Callable[[Any], Any] | None = None
    with one_thread_of_algebra(), suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            kind, number, content = connection.recv()
            if kind == KEEP:
                kept[number] = _known[number] = content
                numbers[id(content)] = number
            elif kind == FORGET:
                for gone in content:
                    del numbers[id(kept.pop(gone))]
            elif kind == FUNCTION:
                function = content
            else:
                assert function is not None
                connection.send_bytes(_answer(function, number, content, numbers))


def _end_with_parent() -> None:
    """End this process as soon as the one that asked has ended, in the middle of an item too."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _answer(function: Callable[[Any], Any], index: int, item: object, numbers: Mapping[int, int]) -> memoryview:
    """Apply a function and return the value as it is sent, or the error that it raised."""
    try:
        return _written((VALUE, index, function(item)), lambda one: numbers.get(id(one)))
    except Exception as error:  # noqa: BLE001 - raised again where the value was wanted
        return _written((ERROR, index, (_that_travels(error), traceback.format_exc())), lambda _: None)


def _that_travels(error: Exception) -> Exception:
    """Return an error that arrives as it is, or its words in one that does."""
    try:
        ForkingPickler.loads(ForkingPickler.dumps(error))
    except Exception:  # noqa: BLE001 - whatever its class does when it is made anew
        return RwaMonitorError(f"{type(error).__name__}: {error}")
    return error


# ---- on the way ------------------------------------------------------------------------------------------------------

_count = count()  # numbers of what this process sends once
_known: WeakValueDictionary[int, Any] = WeakValueDictionary()  # what was sent once, here or there, by number


def _written(message: tuple[str, int, object], number: Callable[[object], int | None]) -> memoryview:
    """Return a message in bytes, with numbers in place of what is sent once; all of it where that is sent just now.

    `number` gives them; None for what the other side has not.
    """
    kind, _, content = message
    data = io.BytesIO()
    _Writer(data, number, content if kind == KEEP else None).dump(message)
    return data.getbuffer()


class _Writer(ForkingPickler):
    """Writes numbers in place of what is sent once, but for what is `whole`."""

    def __init__(self, file: io.BytesIO, number: Callable[[object], int | None], whole: object) -> None:
        super().__init__(file, PROTOCOL)
        self._number_of = number
        self._whole = whole

    def reducer_override(self, one: object) -> Any:
        """Return how something is made there that is not written as it is."""
        if isinstance(one, _OnProcesses):
            return _mapper_there, ()
        made = _is_made(one)
        if one is not self._whole and (made or isinstance(one, SentOnce)):
            number = self._number_of(one)
            if number is not None:
                return _known_as, (number,)
        if made:
            assert isinstance(one, type)
            return type, (one.__name__, one.__bases__, {k: v for k, v in vars(one).items() if not k.startswith("_")})
        return NotImplemented


def _mapper_there() -> Mapper:
    """Return what applies functions in a process that was started: there is no other beside it."""
    return in_turn


def _known_as(number: int) -> object:
    """Return what was sent once under a number."""
    return _known[number]


def _is_made(one: object) -> bool:
    """Say whether something is a class that was made on the way: not one that another process can import."""
    if not isinstance(one, type):
        return False
    found: object = sys.modules.get(one.__module__)
    for name in one.__qualname__.split("."):
        found = getattr(found, name, None)
    return found is not one
