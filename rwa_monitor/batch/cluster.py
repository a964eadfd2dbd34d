"""Spreads one task over many recordings: in this process, in several on this machine (joblib), or on a Dask cluster."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar

from rwa_monitor.errors import RwaMonitorError, needs_extra
from rwa_monitor.threads import cores
from rwa_monitor.version import SOFTWARE

if TYPE_CHECKING:
    from distributed import Client

Result = TypeVar("Result")
Task = Callable[[Path], Result]  # what is done for each recording
BLOCK: Final = 64  # recordings for each process at a time: what is finished waits in memory for those before it
# Dask's own work for a parcel, some 7 ms, is a third of diagnosing one short recording.
PARCEL: Final = 8  # recordings, where each worker has so many parcels as this:
# No worker is idle while the first in order is worked on, and memory does not grow with the number of recordings.
PARCELS_PER_WORKER: Final = BLOCK // PARCEL
FEW: Final = 4  # recordings for which starting one more process is not worth it: each takes a second or two to start
IDLE_S: Final = 10  # after which a process with nothing to do ends, also where the one that started it was killed
CONNECT_TIMEOUT_S: Final = 5


@dataclass(frozen=True, slots=True)
class Outcome(Generic[Result]):
    """What became of one recording: its result, or why there is none.

    Attributes
    ----------
    file
        The recording.
    result
        None where it failed.
    error
        One line; empty where all went well.
    """

    file: Path
    result: Result | None
    error: str = ""


def each(
    task: Task[Result], files: Sequence[Path], *, scheduler: str | None = None, workers: int | None = None
) -> Iterator[Outcome[Result]]:
    """Do a task for each recording, and yield what became of it in the order of `files`.

    One that fails stops nothing: not by bad input, not by a fault of the program, not by a worker that was killed.

    Parameters
    ----------
    task
        Called in the workers; it and its results are sent there and back.
    files
        As the workers see them: on another machine, below the same path.
    scheduler
        Address of a Dask scheduler. None: this machine.
    workers
        Processes on this machine; 1: this one. None: one for each core, and fewer where there are few recordings.

    Raises
    ------
    RwaMonitorError
        If the scheduler cannot be reached, its workers run another release, or Dask is not installed.
    """
    if workers is None:
        workers = max(1, min(cores(), len(files) // FEW))
    if scheduler is not None:
        with _client(scheduler) as client:
            yield from _on_cluster(client, task, files)
    elif workers == 1:
        yield from (_guarded(task, file) for file in files)
    else:
        for first in range(0, len(files), BLOCK * workers):
            yield from _in_processes(task, files[first : first + BLOCK * workers], workers)


def _guarded(task: Task[Result], file: Path) -> Outcome[Result]:
    """Do the task for one recording, and turn whatever goes wrong into its outcome."""
    try:
        return Outcome(file, task(file))
    except RwaMonitorError as error:
        return Outcome(file, None, str(error))
    # A fault of this program in one of thousands of recordings shall be listed beside it, and not end the others.
    except Exception as error:  # noqa: BLE001
        return Outcome(
            file, None, f"{file}: fault of the program: {type(error).__name__}: {' '.join(str(error).split())}"
        )


# ---- on this machine -------------------------------------------------------------------------------------------------


def _in_processes(task: Task[Result], files: Sequence[Path], workers: int) -> Iterator[Outcome[Result]]:
    """Yield the outcomes in the order of `files`, from so many processes."""
    given = 0
    try:
        for outcome in _parallel(task, files, workers):
            yield outcome
            given += 1
    except BrokenProcessPool:
        # Which one ended its process is not known: those that are left are done alone, and only that one ends its own.
        for file in files[given:]:
            try:
                yield from _parallel(task, [file], workers)
            except BrokenProcessPool:
                reason = "the process that worked on it was terminated: is there memory left for it?"
                yield Outcome(file, None, f"{file}: {reason}")


def _parallel(task: Task[Result], files: Sequence[Path], workers: int) -> Iterator[Outcome[Result]]:
    from joblib import Parallel, delayed, parallel_config

    # One thread of linear algebra, since the last bit depends on their number.
    with parallel_config("loky", inner_max_num_threads=1, idle_worker_timeout=IDLE_S):
        parallel = Parallel(workers, return_as="generator", max_nbytes=None)
    found: Iterator[Outcome[Result]] = parallel(delayed(_guarded)(task, file) for file in files)
    return found


# ---- on a Dask cluster -----------------------------------------------------------------------------------------------


@contextmanager
def _client(scheduler: str) -> Iterator[Client]:
    """Connect to a scheduler, whose workers must run this release: others would give other numbers."""
    with needs_extra("fleet"):
        from distributed import Client

    try:
        client = Client(scheduler, timeout=CONNECT_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise RwaMonitorError(f"{scheduler}: no Dask scheduler answers: {error}") from error
    with client:
        releases = client.run(_release)
        if set(releases.values()) != {SOFTWARE}:
            found = ", ".join(f"{address} runs {release}" for address, release in releases.items()) or "nobody works"
            raise RwaMonitorError(f"{scheduler}: this is {SOFTWARE}, but {found}")
        yield client


def _release() -> str:
    return SOFTWARE


def _itself(task: Task[Result]) -> Task[Result]:
    return task


def _on_cluster(client: Client, task: Task[Result], files: Sequence[Path]) -> Iterator[Outcome[Result]]:
    """Yield the outcomes in the order of `files`; a bounded number of recordings is on its way at a time."""
    from distributed import wait

    # The model goes once to each worker and not with each recording; as a result, which is made again where a worker
    # that held it dies.
    shared = client.submit(_itself, task, pure=False)
    workers = max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
    size = max(1, min(PARCEL, len(files) // (workers * PARCELS_PER_WORKER)))
    waiting = deque(files[first : first + size] for first in range(0, len(files), size))
    on_the_way: deque[tuple[Sequence[Path], Any]] = deque()

    def submit(parcel: Sequence[Path]) -> Any:
        # Not pure: the same recording named twice is done twice, as it is without a cluster.
        return client.submit(_parcel, shared, parcel, pure=False)

    while waiting or on_the_way:
        while waiting and len(on_the_way) < workers * PARCELS_PER_WORKER:
            on_the_way.append((waiting[0], submit(waiting.popleft())))
        parcel, future = on_the_way.popleft()
        if future.exception() is None:
            yield from future.result()
            continue
        # Dask gives up all recordings that waited at a worker that ended. Alone, only the one that ends it is given up.
        wait([others for _, others in on_the_way])
        for file in parcel:
            alone = submit([file])
            error = alone.exception()
            yield Outcome(file, None, f"{file}: {error}") if error else alone.result()[0]


def _parcel(task: Task[Result], files: Sequence[Path]) -> list[Outcome[Result]]:
    """Do the task for some recordings, one after the other."""
    return [_guarded(task, file) for file in files]
