"""Work side by side in processes, where threads would wait for one another's turn at the interpreter.

Processes begin empty, and all that they need travels. What many calls hold (`SentOnce`) goes to each process once and
is known by its number from then on, so that what a process has worked out for it stays there too.
"""

from __future__ import annotations

import io
import multiprocessing
import pickle
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from typing import Any, Final, TypeVar

import numpy as np

from rwa_monitor.discrepancy.mapper import Mapper, SentOnce, in_turn
from rwa_monitor.errors import RwaMonitorError
from rwa_monitor.threads import on_threads, one_thread_of_algebra

Item = TypeVar("Item")
Result = TypeVar("Result")

END_S: Final = 1.0  # for a process to end whose pipe was closed; it may be in the middle of a candidate
MAPPER: Final = -1  # the number of what applies functions: each process has its own
FUNCTION, ITEM, KEEP, VALUE, ERROR = "function", "item", "keep", "value", "error"  # kinds of messages


@contextmanager
def on_processes(processes: int) -> Iterator[Mapper]:
    """Give a way to apply a function to many items in so many processes, values in the order of the items.

    Each value depends on its item alone: the number of processes changes the time, never the answer. What is not said
    to be work `apart` stays here, on as many threads. The processes begin at once, take a second to be ready, and end
    with the block; they end too if this process is killed.

    Raises
    ------
    RwaMonitorError
        Where it is used: if a process has ended before its work, as when the system had no memory left for it.
    """
    workers = [_Worker() for _ in range(processes)]
    try:
        yield _OnProcesses(workers)
    finally:
        for worker in workers:
            worker.end()


class _OnProcesses:
    """Hands out items to workers: to each a stretch of them, and to who is done early the last of the longest left."""

    def __init__(self, workers: Sequence[_Worker]) -> None:
        self._workers = workers
        self._here = on_threads(len(workers))

    def __call__(
        self, function: Callable[[Item], Result], items: Iterable[Item], /, *, apart: bool = False
    ) -> list[Result]:
        items = list(items)
        if not apart or len(items) < 2:
            return self._here(function, items)
        try:
            return self._apart(function, items)
        except BaseException:
            for worker in self._workers:  # others may still work: their answers are nobody's
                worker.end()
            raise

    def _apart(self, function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        # Neighbours are alike, and the same ones come again: what a process worked out for them, it has kept.
        queues = [deque(stretch) for stretch in np.array_split(np.arange(len(items)), len(self._workers))]
        values: dict[int, Result] = {}
        busy: dict[Connection, int] = {}  # which worker is behind a pipe

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
            for connection in wait(list(busy)):
                number = busy.pop(connection)
                index, value = self._workers[number].take()
                values[index] = value
                go_on(number)
        return [values[index] for index in range(len(items))]


class _Worker:
    """A process that applies functions, and what it has been sent for good."""

    def __init__(self) -> None:
        # Forked from a server that has imported what is needed, once for all, and has no threads.
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload([__name__, "rwa_monitor.discrepancy.search"])
        self.connection, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other,), daemon=True)
        self._process.start()
        other.close()
        self._sent: dict[int, object] = {}  # by their identity, which is theirs while they are held here

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
            error, lines = value
            error.add_note(f"in another process:\n{lines}")
            raise error
        return index, value

    def end(self) -> None:
        """End the process, whatever it does."""
        self.connection.close()
        self._process.join(END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def _send(self, kind: str, number: int, content: object) -> None:
        try:
            self.connection.send_bytes(_written((kind, number, content), self._number))
        except (BrokenPipeError, ConnectionResetError) as error:
            raise self._ended() from error

    def _number(self, one: object) -> int:
        """Return the number of what is sent once; where it was not yet, it is sent now, before what holds it."""
        if id(one) not in self._sent:
            self._sent[id(one)] = one
            self._send(KEEP, id(one), one)
        return id(one)

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
    """Return a message in bytes, with numbers in place of what the other side has; None where it has it not."""
    data = io.BytesIO()
    _Writer(data, number, message[2]).dump(message)
    return data.getbuffer()


class _Writer(pickle.Pickler):
    """Writes numbers in place of what is sent once, where that is not the content itself."""

    def __init__(self, file: io.BytesIO, number: Callable[[object], int | None], content: object) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self._number_of = number
        self._content = content

    def persistent_id(self, one: object) -> int | None:
        """Return the number that stands for an object, or None."""
        if isinstance(one, _OnProcesses):
            return MAPPER
        if one is self._content or not (isinstance(one, SentOnce) or _is_made(one)):
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
