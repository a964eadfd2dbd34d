"""Tasks for one recording, as values that are pickled to workers, and their execution for many.

Tasks are executed in this process, in several processes on this machine (joblib), or on a Dask cluster.
"""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar, get_args

from rwa_monitor.api import Monitor
from rwa_monitor.diagnosis.features import Features
from rwa_monitor.diagnosis.model import Model, built_in_model
from rwa_monitor.errors import InputError, RwaMonitorError, needs_extra
from rwa_monitor.messages import Diagnosis, Method
from rwa_monitor.monitor.core import WindowDiagnosed, diagnose_samples
from rwa_monitor.monitor.setup import read_wheel
from rwa_monitor.monitor.telemetry_files import NO_DECODING, read_telemetry
from rwa_monitor.samples import Samples
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.telemetry.files import companion_file, display_name
from rwa_monitor.telemetry.reader import Decoding, WheelTelemetry
from rwa_monitor.telemetry.table import read_table
from rwa_monitor.threads import cores
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel
from rwa_monitor.words import SOFTWARE

if TYPE_CHECKING:
    from distributed import Client


CarriedStates = dict[tuple[str, str], CarriedState]  # by spacecraft and wheel
# Words for samples that no window used, by attribute of `ingest.Counts`.
UNUSED_WORDS: Final = {
    "masked": "were masked",
    "rejected": "rejected",
    "late": "late",
    "duplicate": "double",
    "slots_missed": "slots had none",
}


@dataclass(frozen=True, slots=True)
class DiagnosedFile:
    """The diagnoses of one file's windows.

    Attributes
    ----------
    diagnoses
        One for each window.
    problems, notes
        Parts that could not be read, and remarks, such as samples that were not used, a sentence each.
    carried
        The state of its wheels for the next file.
    """

    diagnoses: list[Diagnosis]
    problems: tuple[str, ...] = ()
    notes: list[str] = field(default_factory=list)
    carried: CarriedStates = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Diagnose:
    """Diagnose a recording, window by window, through the same core as the live monitor.

    Attributes
    ----------
    wheel
        Its constants, for every file; None for those attached to a recording, or the built-in wheel.
    decoding
        Settings to read files that do not name their channels.
    model
        The one to use for every file; None for the one attached to a recording, or the built-in one.
    method
        As for `WheelCore`.
    """

    wheel: Wheel | None = None
    decoding: Decoding = NO_DECODING
    model: Model | None = None
    method: Method = "joint"

    def identity(self) -> str:
        """Return a hash of program and settings: results with the same hash are comparable."""
        settings = (self.wheel, self.decoding, self.model)
        hashed = [None if value is None else value.sha256() for value in settings]
        return hashlib.sha256(json.dumps([SOFTWARE, *hashed, self.method]).encode()).hexdigest()

    def __call__(self, file: Path, carried: CarriedStates | None = None) -> DiagnosedFile:
        """Diagnose a file's windows; its wheels start from their `carried` state where there is one.

        Raises
        ------
        InputError
            If the file cannot be used.
        """
        content = read_telemetry(file, self.decoding.of_wheel(self.wheel))
        wheels = [self.wheel or telemetry.constants or built_in_wheel() for telemetry in content.telemetry]
        model = self.model or content.model or built_in_model()
        missing = dict.fromkeys(f"{wheel.name}: {note}" for wheel in wheels for note in wheel.missing())  # each once
        found = DiagnosedFile([], tuple(content.problems), [*content.notes, *missing])
        for telemetry, wheel in zip(content.telemetry, wheels, strict=True):
            self._diagnose_wheel(telemetry, wheel, model, carried or {}, found)
        return found

    def _diagnose_wheel(
        self, telemetry: WheelTelemetry, wheel: Wheel, model: Model, carried: CarriedStates, found: DiagnosedFile
    ) -> None:
        name = telemetry.wheel or wheel.name
        key = (telemetry.spacecraft, name)
        try:
            monitor = Monitor(
                wheel,
                model,
                method=self.method,
                spacecraft=telemetry.spacecraft,
                name=name,
                source=telemetry.source,
                carried=carried.get(key),
            )
            for batch in telemetry.batches:
                found.diagnoses.extend(monitor.feed(batch.samples, batch.publisher, batch.batch, batch.data))
        except InputError as error:
            raise InputError(telemetry.source, f"{error.source}: {error.reason}", error.place) from error
        found.diagnoses.extend(monitor.finish())
        found.carried[key] = monitor.carried
        found.notes.extend(f"{telemetry.source}: {trouble}" for trouble in monitor.troubles)
        lost = [f"{monitor.counts[name]} {words}" for name, words in UNUSED_WORDS.items() if monitor.counts[name]]
        if monitor.counts["masked"] and monitor.why_masked:
            why = "; ".join(f"{count} {words}" for words, count in monitor.why_masked.items())
            lost[0] = f"{lost[0]} ({why})"
        if lost:
            found.notes.append(f"{telemetry.source}: of {monitor.counts['received']} samples {', '.join(lost)}")


def not_nominal(recordings: Sequence[tuple[str, Samples]], wheel: Wheel) -> str:
    """Report which windows of the recordings that a wheel was learned from are not nominal with it; "" if all are.

    Parameters
    ----------
    recordings
        Name and samples of each.
    wheel
        The wheel that `identify` learned from them.

    Raises
    ------
    InputError
        If one is anomalous: a wheel file must not report a failure in the data that it was learned from.
    """
    model = built_in_model()
    windows = [
        (name, window.diagnosis)
        for name, samples in recordings
        for window in _full_windows(diagnose_samples(samples, wheel, model))
    ]
    others = [(name, diagnosis) for name, diagnosis in windows if diagnosis.verdict != "nominal"]
    if not others:
        return ""
    anomalous = [other for other in others if other[1].verdict == "anomalous"]
    name, first = (anomalous or others)[0]
    if anomalous:
        raise InputError(
            name,
            f"the wheel learned calls {len(anomalous)} of {len(windows)} windows that it was learned from anomalous, so"
            " it is not written: leave recordings of a failing wheel out, or let rwa-monitor discrepancy name what the"
            f" wheel file lacks and give its extended_wheel.toml with --wheel ({first.reason})",
        )
    return (
        f"with this wheel file {len(others)} of {len(windows)} windows of these recordings are not nominal; {name},"
        f" {first.verdict}: {first.reason}"
    )


def _full_windows(windows: Iterable[WindowDiagnosed]) -> list[WindowDiagnosed]:
    """Return the windows without partial ones, if there are others."""
    found = list(windows)
    return [window for window in found if not window.diagnosis.partial] or found


@dataclass(frozen=True, slots=True)
class ReadFeatures:
    """Compute the classifiers' features of a recording's windows by both methods, for `train`.

    Attributes
    ----------
    wheel
        For recordings that have no wheel file of their own in their folder.
    """

    wheel: Wheel

    def __call__(self, file: Path) -> list[tuple[Features, Features]]:
        """Return the features of each window by the joint and the paper's method; of full windows if there are any."""
        wheel = self._wheel_of(file)
        samples = read_table(file).samples
        joint, paper = (
            _full_windows(diagnose_samples(samples, wheel, None, method=method)) for method in get_args(Method)
        )
        return [(by_joint.features, by_paper.features) for by_joint, by_paper in zip(joint, paper, strict=True)]

    def _wheel_of(self, file: Path) -> Wheel:
        own = companion_file(file, ".wheel.toml")
        if not own.exists():
            return self.wheel
        wheel = read_wheel(own)
        if wheel.anomalies != self.wheel.anomalies:
            raise InputError(display_name(own), f"has {wheel.anomalies}, not {self.wheel.anomalies}", "anomalies")
        return wheel


# ---- one task for many recordings ------------------------------------------------------------------------------------


Result = TypeVar("Result")
Task = Callable[[Path], Result]  # executed for each recording
BLOCK: Final = 64  # recordings for each process at a time: finished results wait in memory for those before them
# Recordings submitted to Dask together, at most: its overhead, some 7 ms, is a third of diagnosing one short recording.
DASK_CHUNK: Final = 8
# Parcels submitted at a time, per worker: no worker is idle while the first in order is processed, and memory does not
# grow with the number of recordings.
CHUNKS_PER_WORKER: Final = BLOCK // DASK_CHUNK
MIN_PER_PROCESS: Final = 4  # recordings for each process at least: starting one takes a second or two
IDLE_S: Final = 10  # after which an idle process ends, even if its parent was killed
CONNECT_TIMEOUT_S: Final = 5


@dataclass(frozen=True, slots=True)
class Outcome(Generic[Result]):
    """The outcome for one recording: its result, or why there is none.

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


def map_files(
    task: Task[Result], files: Sequence[Path], *, scheduler: str | None = None, workers: int | None = None
) -> Iterator[Outcome[Result]]:
    """Execute a task for each recording, and yield the outcomes in the order of `files`.

    A failure does not stop the others: neither bad input, nor a fault of the program, nor a worker that was killed.

    Parameters
    ----------
    task
        Called in the workers; it and its results are pickled.
    files
        Paths that are valid for the workers, also on another machine.
    scheduler
        Address of a Dask scheduler; None for this machine.
    workers
        Processes on this machine; 1 for this process; None for one per core, or fewer for few recordings.

    Raises
    ------
    RwaMonitorError
        If the scheduler cannot be reached, its workers run another release, or Dask is not installed.
    """
    if workers is None:
        workers = max(1, min(cores(), len(files) // MIN_PER_PROCESS))
    if scheduler is not None:
        with _client(scheduler) as client:
            yield from _on_cluster(client, task, files)
    elif workers == 1:
        yield from (_guarded(task, file) for file in files)
    else:
        yield from _in_processes(task, files, workers)


def _guarded(task: Task[Result], file: Path) -> Outcome[Result]:
    """Execute the task for one recording; any exception becomes its outcome."""
    try:
        return Outcome(file, task(file))
    except RwaMonitorError as error:
        return Outcome(file, None, str(error))
    # A fault of this program with one of thousands of recordings is reported for that one, and does not stop the rest.
    except Exception as error:  # noqa: BLE001
        return Outcome(
            file, None, f"{file}: fault of the program: {type(error).__name__}: {' '.join(str(error).split())}"
        )


# ---- on this machine -------------------------------------------------------------------------------------------------


def _in_processes(task: Task[Result], files: Sequence[Path], workers: int) -> Iterator[Outcome[Result]]:
    """Yield the outcomes in the order of `files`, from several processes."""
    from joblib import Parallel, delayed, parallel_config

    def outcomes(some: Iterable[Path]) -> Iterator[Outcome[Result]]:
        # A Parallel for each call: after a failed one it keeps recordings prepared, which the next call would process.
        # One thread for linear algebra, since the last bit depends on their number.
        with parallel_config("loky", inner_max_num_threads=1, idle_worker_timeout=IDLE_S):
            parallel = Parallel(workers, return_as="generator", max_nbytes=None)
        yield from parallel(delayed(_guarded)(task, file) for file in some)

    for first in range(0, len(files), BLOCK * workers):
        left = deque(files[first : first + BLOCK * workers])
        with suppress(BrokenProcessPool):
            for outcome in outcomes(tuple(left)):
                left.popleft()
                yield outcome
        # It is not known which one ended a process: the rest is processed one by one, so that only that one fails.
        for file in left:
            try:
                yield from outcomes([file])
            except BrokenProcessPool:
                reason = "the process that worked on it was terminated: is there memory left for it?"
                yield Outcome(file, None, f"{file}: {reason}")


# ---- on a Dask cluster -----------------------------------------------------------------------------------------------


@contextmanager
def _client(scheduler: str) -> Iterator[Client]:
    """Connect to a scheduler, whose workers must run this release: another one could give other results."""
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


def _on_cluster(client: Client, task: Task[Result], files: Sequence[Path]) -> Iterator[Outcome[Result]]:
    """Yield the outcomes in the order of `files`; a bounded number of recordings is submitted at a time."""
    from distributed import wait

    # As a Dask result, the task with its model is sent to each worker once and not with each recording, and is made
    # again if the worker that holds it dies.
    shared = client.submit(partial, _guarded, task, pure=False)
    workers = max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
    size = max(1, min(DASK_CHUNK, len(files) // (workers * CHUNKS_PER_WORKER)))
    waiting = deque(files[first : first + size] for first in range(0, len(files), size))
    on_the_way: deque[tuple[Sequence[Path], Any]] = deque()

    def submit(parcel: Sequence[Path]) -> Any:
        # Not pure: a recording named twice is processed twice, as without a cluster.
        return client.submit(_parcel, shared, parcel, pure=False)

    while waiting or on_the_way:
        while waiting and len(on_the_way) < workers * CHUNKS_PER_WORKER:
            on_the_way.append((waiting[0], submit(waiting.popleft())))
        parcel, future = on_the_way.popleft()
        if future.exception() is None:
            yield from future.result()
            continue
        # Dask gives up all recordings queued at a worker that ended. One by one, only the one that ends it is given up.
        wait([others for _, others in on_the_way])
        for file in parcel:
            alone = submit([file])
            error = alone.exception()
            yield Outcome(file, None, f"{file}: {error}") if error else alone.result()[0]


def _parcel(guarded: Callable[[Path], Outcome[Result]], files: Sequence[Path]) -> list[Outcome[Result]]:
    """Execute a task for several recordings, one after the other."""
    return [guarded(file) for file in files]
