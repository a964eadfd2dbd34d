"""Full discrepancy searches of a running monitor, in a child process of low priority that delays no diagnosis.

A wheel whose friction model does not fit in `PATIENCE` windows in a row is searched once: the samples of the last of
these windows go to a child process, its result is published on …/discrepancy, recorded, and written as a report to the
folder of the recordings. The wheel is searched again only after its model has fitted in between.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import active_children, get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from rwa_monitor.errors import RwaMonitorError
from rwa_monitor.messages import Discrepancy, EncodedMessage, SamplesMessage, key_of
from rwa_monitor.monitor.setup import Setup, WheelKey
from rwa_monitor.samples import concatenate
from rwa_monitor.telemetry.files import write_files
from rwa_monitor.wheel.wheel import Wheel
from rwa_monitor.words import Log

if TYPE_CHECKING:
    from rwa_monitor.discrepancy.result import Search

PATIENCE: Final = 2  # windows in a row whose model does not fit, before a search
NICENESS: Final = 10  # of the child process: it uses the processor time that diagnosis leaves
MAX_KEPT_BYTES: Final = 64_000_000  # of messages kept for possible and waiting searches, all wheels together


class SearchJob(NamedTuple):
    """One search: spacecraft and wheel, its constants, and the messages that hold its samples."""

    key: WheelKey
    constants: Wheel
    payloads: tuple[bytes, ...]

    @property
    def name(self) -> str:
        """Spacecraft and wheel, as in the log."""
        return "/".join(self.key)


def search(job: SearchJob) -> tuple[Discrepancy, Search]:
    """Run a search; equal jobs give equal messages. Raises InputError if the samples cannot be searched."""
    from rwa_monitor.discrepancy.find import find_discrepancy  # noqa: PLC0415 - the monitor starts without the search

    samples = concatenate([SamplesMessage.parse(payload, job.name).samples() for payload in job.payloads])
    samples = samples[np.unique(samples.time_ns, return_index=True)[1]]
    found = find_discrepancy([(job.name, samples)], job.constants)
    content = {
        "spacecraft": job.key[0],
        "wheel": job.key[1],
        "start_ns": int(samples.time_ns[0]),
        "end_ns": int(samples.time_ns[-1]),
        **found.result.to_json(),
    }
    return Discrepancy.model_validate(content), found


def _search_and_report(job: SearchJob) -> tuple[Discrepancy, dict[str, str]]:
    """Run a search, in the child process; return the message and the files of its report."""
    from rwa_monitor.discrepancy.extended import extend  # noqa: PLC0415
    from rwa_monitor.reporting.discrepancy_report import html  # noqa: PLC0415

    message, found = search(job)
    return message, {"report.html": html(found, [f"{job.name}, live"]), "extended_wheel.toml": extend(found).to_toml()}


@dataclass(slots=True)
class _Watched:
    """One wheel: inadequate windows in a row, whether it was searched for them, and its messages of this window."""

    inadequate: int = 0
    searched: bool = False
    payloads: list[bytes] = field(default_factory=list)


class Searches:
    """Watches diagnoses for wheels whose model does not fit, and runs searches for them.

    Parameters
    ----------
    setup
        Has the constants of all wheels.
    folder
        Reports are written to `discrepancy/{spacecraft}/{wheel}/` in this folder; None for no reports.
    log
        Called with each line of the log.
    """

    def __init__(self, setup: Setup, folder: Path | None, log: Log) -> None:
        self.setup = setup
        self.folder = folder
        self.log = log
        self._watched: dict[WheelKey, _Watched] = {}
        self._kept_bytes = 0
        self._waiting: deque[SearchJob] = deque()
        self._running: tuple[SearchJob, Future[tuple[Discrepancy, dict[str, str]]]] | None = None
        self._children: set[BaseProcess] = set()

    def take_input(self, key: WheelKey, payload: bytes) -> None:
        """Keep a message if its wheel may need a search: its last window was inadequate, and not searched yet."""
        watched = self._watched.get(key)
        if watched is None or not watched.inadequate or watched.searched:
            return
        if self._kept_bytes + len(payload) > MAX_KEPT_BYTES:
            self.log(f"{'/'.join(key)}: no room to keep its samples for a discrepancy search")
            self._forget(watched)
            watched.searched = True
            return
        watched.payloads.append(payload)
        self._kept_bytes += len(payload)

    def take_diagnosis(self, key: WheelKey, *, adequate: bool) -> None:
        """Take a closed window into account; a search is requested when enough in a row are inadequate."""
        watched = self._watched.setdefault(key, _Watched())
        if adequate:
            self._forget(watched)
            watched.inadequate, watched.searched = 0, False
            return
        watched.inadequate += 1
        if watched.inadequate >= PATIENCE and not watched.searched and watched.payloads:
            job = SearchJob(key, self.setup.wheel(*key), tuple(watched.payloads))
            self._waiting.append(job)
            self.log(f"{job.name}: its friction model does not fit; searching for the cause")
            watched.searched, watched.payloads = True, []  # the job keeps the messages until the search begins
        self._forget(watched)

    def poll(self) -> list[EncodedMessage]:
        """Start the next search if none runs, and return the message of one that has finished."""
        if self._running is None:
            if self._waiting:
                self._start(self._waiting.popleft())
            return []
        job, future = self._running
        if not future.done():
            return []
        self._running = None
        try:
            message, report = future.result()
        except Exception as error:  # noqa: BLE001 - neither bad samples nor a fault of the search end the monitor
            self.log(f"{job.name}: the discrepancy search could not be made: {error}")
            return []
        if self.folder is not None:
            self._write_report(self.folder / "discrepancy" / job.name, report)
        return [message.encoded(*job.key, message.end_ns)]

    def close(self) -> None:
        """Kill the running search."""
        for child in self._children:
            child.kill()

    def _start(self, job: SearchJob) -> None:
        # Not a fork: in the child the Zenoh session would be dead. A new process for each search frees its memory.
        pool = ProcessPoolExecutor(1, get_context("spawn"), initializer=os.nice, initargs=(NICENESS,))
        self._kept_bytes -= sum(map(len, job.payloads))
        before = set(active_children())
        try:
            self._running = job, pool.submit(_search_and_report, job)
        except OSError as error:
            self.log(f"{job.name}: no process for a discrepancy search: {error.strerror or error}")
        self._children = set(active_children()) - before
        pool.shutdown(wait=False)

    def _write_report(self, folder: Path, report: dict[str, str]) -> None:
        """Write the report's files; if that fails, the monitor continues without the report."""
        try:
            write_files(folder, {name: text.encode() for name, text in report.items()})
        except RwaMonitorError as error:
            self.log(f"the discrepancy report could not be written: {error}")
        else:
            self.log(f"discrepancy report in {folder}")

    def _forget(self, watched: _Watched) -> None:
        self._kept_bytes -= sum(map(len, watched.payloads))
        watched.payloads = []


def job_of(report: Discrepancy, inputs: Iterable[EncodedMessage], setup: Setup) -> SearchJob:
    """Return the search that gave a recorded report, for a replay.

    Parameters
    ----------
    report
        The recorded report.
    inputs
        Recorded messages of samples, in order.
    setup
        Of the recording.
    """
    key, payloads = (report.spacecraft, report.wheel), list[bytes]()
    for message in inputs:
        if message.topic == key_of(SamplesMessage, *key):
            time_ns = SamplesMessage.parse(message.payload, message.topic).time_ns
            if min(time_ns) >= report.start_ns and max(time_ns) <= report.end_ns:
                payloads.append(message.payload)
    return SearchJob(key, setup.wheel(*key), tuple(payloads))
