"""Full discrepancy searches beside the monitor: in another process, at low priority, never delaying a diagnosis.

A wheel whose friction model does not fit for `PATIENCE` windows in a row is searched once: the samples of the last of
these windows go to a child process, its answer is published on …/discrepancy, recorded, and written as a report beside
the recordings. The wheel is searched again only after its model has fitted in between.
"""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from threading import Thread
from typing import Final

import numpy as np

from rwa_monitor.errors import RwaMonitorError
from rwa_monitor.messages import Discrepancy, SamplesMessage, key_of
from rwa_monitor.monitor.events import Output, output_of
from rwa_monitor.monitor.setup import WheelKey, WheelSet
from rwa_monitor.samples import concatenate
from rwa_monitor.telemetry.files import write_text
from rwa_monitor.wheel.wheel import Wheel

PATIENCE: Final = 2  # windows in a row whose model does not fit, before a search
NICENESS: Final = 10  # of the child process: it takes what diagnosis leaves
MAX_KEPT_BYTES: Final = 64_000_000  # of messages kept for searches, all wheels together
END_S: Final = 1.0  # for a process to end that was killed or has closed its pipe
HAND_OVER: Final = "rwa-search-job"  # name of the thread that brings a job to its process
MAX_WAITING: Final = 16  # searches that wait for the one that runs; a fleet gone wrong needs an engineer, not a queue


@dataclass(frozen=True, slots=True)
class SearchJob:
    """One search: the wheel, its constants as wheel.toml, and the messages that hold its samples."""

    spacecraft: str
    wheel: str
    wheel_toml: str
    payloads: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class SearchAnswer:
    """What a search gives: the message, and the files of its report; or what went wrong, in words."""

    job: SearchJob
    message: Discrepancy | None = None
    report: dict[str, str] = field(default_factory=dict)
    problem: str = ""


def search(job: SearchJob, *, with_report: bool = False) -> SearchAnswer:
    """Run a search; the same job always gives the same message, which a report may go with.

    Raises
    ------
    InputError
        If the samples cannot be searched.
    """
    from rwa_monitor.discrepancy.find import find_discrepancy  # noqa: PLC0415 - the monitor starts without the search

    name = f"{job.spacecraft}/{job.wheel}"
    samples = concatenate([SamplesMessage.parse(payload, job.wheel).samples() for payload in job.payloads])
    samples = samples[np.unique(samples.time_ns, return_index=True)[1]]
    found = find_discrepancy([(name, samples)], Wheel.from_toml(job.wheel_toml, job.wheel))
    content = {
        "spacecraft": job.spacecraft,
        "wheel": job.wheel,
        "start_ns": int(samples.time_ns[0]),
        "end_ns": int(samples.time_ns[-1]),
        **found.result.to_json(),
    }
    report = {}
    if with_report:
        from rwa_monitor.discrepancy.extended import extend  # noqa: PLC0415
        from rwa_monitor.reporting.discrepancy_report import html  # noqa: PLC0415

        report = {"report.html": html(found, [f"{name}, live"]), "extended_wheel.toml": extend(found).to_toml()}
    return SearchAnswer(job, Discrepancy.model_validate(content), report)


def _child(connection: Connection) -> None:
    """Run in the child process: take the job, search, send the answer, end."""
    os.nice(NICENESS)
    job: SearchJob = connection.recv()
    try:
        connection.send(search(job, with_report=True))
    except RwaMonitorError as error:
        connection.send(SearchAnswer(job, problem=str(error)))
    finally:
        connection.close()


def _hand_over(connection: Connection, job: SearchJob) -> None:
    """Send a job to the child, as it takes it; a poll shows whether the child has ended before."""
    with suppress(OSError):
        connection.send(job)


@dataclass(slots=True)
class _Watched:
    """One wheel: inadequate windows in a row, whether it was searched since, and its messages of this window."""

    inadequate: int = 0
    searched: bool = False
    payloads: list[bytes] = field(default_factory=list)
    size: int = 0


class Searches:
    """Watches diagnoses for wheels whose model does not fit, and has them searched.

    Parameters
    ----------
    wheels
        Constants of all wheels.
    folder
        Where reports are written, `discrepancy/{spacecraft}/{wheel}/` below it; None for nowhere.
    log
        Takes lines of the log.
    """

    def __init__(self, wheels: WheelSet, folder: Path | None, log: Callable[[str], None]) -> None:
        self.wheels = wheels
        self.folder = folder
        self.log = log
        self._watched: dict[WheelKey, _Watched] = {}
        self._kept_bytes = 0
        self._waiting: deque[SearchJob] = deque()
        self._process: SpawnProcess | None = None
        self._connection: Connection | None = None
        self._handing_over: Thread | None = None

    def take_input(self, spacecraft: str, wheel: str, payload: bytes) -> None:
        """Keep a message of a wheel that may have to be searched."""
        watched = self._watched.get((spacecraft, wheel))
        if watched is None or not watched.inadequate or watched.searched:
            return
        if self._kept_bytes + len(payload) > MAX_KEPT_BYTES:
            self.log(f"{spacecraft}/{wheel}: no room to keep its samples for a discrepancy search")
            self._forget(watched)
            watched.searched = True
            return
        watched.payloads.append(payload)
        watched.size += len(payload)
        self._kept_bytes += len(payload)

    def take_diagnosis(self, spacecraft: str, wheel: str, *, adequate: bool) -> None:
        """Take note of a closed window."""
        watched = self._watched.setdefault((spacecraft, wheel), _Watched())
        if adequate:
            self._forget(watched)
            watched.inadequate, watched.searched = 0, False
            return
        watched.inadequate += 1
        if watched.inadequate >= PATIENCE and not watched.searched and watched.payloads:
            if len(self._waiting) < MAX_WAITING:
                constants = self.wheels.of(spacecraft, wheel).to_toml()
                self._waiting.append(SearchJob(spacecraft, wheel, constants, tuple(watched.payloads)))
                self.log(f"{spacecraft}/{wheel}: its friction model does not fit; searching for the cause")
            else:
                self.log(f"{spacecraft}/{wheel}: its friction model does not fit; too many wheels wait for a search")
            watched.searched = True
        self._forget(watched)

    def poll(self) -> list[Output]:
        """Start the next search where none runs, and return what the last one found, ready to be published."""
        if self._process is None:
            self._start_next()
            return []
        assert self._connection is not None
        if not self._connection.poll():  # true also when the process has ended, whatever it has sent before
            return []
        try:
            answer: SearchAnswer = self._connection.recv()
        except (EOFError, OSError):  # it ended before its answer, or within it
            self._process.join(END_S)
            self.log(f"a discrepancy search ended without an answer (exit code {self._process.exitcode})")
            self._end_process()
            return []
        self._end_process()
        return self._outputs(answer)

    def close(self) -> None:
        """Stop the search that runs; nothing of it is lost that a replay could not find again."""
        if self._process is not None:
            self._process.kill()
            self._end_process()

    def _start_next(self) -> None:
        if not self._waiting:
            return
        context = multiprocessing.get_context("spawn")  # after a fork the child's Zenoh session would be dead
        job = self._waiting.popleft()
        connection, childs_end = context.Pipe()
        process = context.Process(target=_child, args=(childs_end,), daemon=True)
        try:
            process.start()
        except OSError as error:
            connection.close()
            self.log(f"{job.spacecraft}/{job.wheel}: no process for a discrepancy search: {error.strerror or error}")
            return
        finally:
            childs_end.close()
        self._process, self._connection = process, connection
        # A window of samples is more than a pipe holds, and the child takes a second until it reads: a thread waits.
        self._handing_over = Thread(target=_hand_over, args=(connection, job), name=HAND_OVER, daemon=True)
        self._handing_over.start()

    def _end_process(self) -> None:
        if self._process is not None:
            self._process.join(END_S)
            self._process = None
        if self._handing_over is not None:  # the child takes nothing any more
            self._handing_over.join(END_S)
            self._handing_over = None
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _outputs(self, answer: SearchAnswer) -> list[Output]:
        job = answer.job
        name = f"{job.spacecraft}/{job.wheel}"
        if answer.message is None:
            self.log(f"{name}: the discrepancy search could not be made: {answer.problem}")
            return []
        if self.folder is not None:
            self._write_report(self.folder / "discrepancy" / job.spacecraft / job.wheel, answer.report)
        return [output_of(answer.message, answer.message.end_ns, job.spacecraft, job.wheel)]

    def _write_report(self, folder: Path, report: dict[str, str]) -> None:
        """Write the report's files; a disk that refuses costs the report, not the monitor."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for name, text in report.items():
                write_text(folder / name, text)
        except (OSError, RwaMonitorError) as error:
            self.log(f"the discrepancy report could not be written: {error}")
        else:
            self.log(f"discrepancy report in {folder}")

    def _forget(self, watched: _Watched) -> None:
        self._kept_bytes -= watched.size
        watched.payloads, watched.size = [], 0


def jobs_of(messages: Sequence[Discrepancy], inputs: Iterable[tuple[str, bytes]], wheels: WheelSet) -> list[SearchJob]:
    """Return the searches that recorded reports came from, for a replay.

    Parameters
    ----------
    messages
        The recorded reports.
    inputs
        Topic and payload of samples recorded, in order; gone through once.
    wheels
        The recording's constants.
    """
    of_topic: dict[str, list[tuple[Discrepancy, list[bytes]]]] = {}
    found: list[list[bytes]] = []
    for message in messages:
        found.append([])
        topic = key_of(SamplesMessage, message.spacecraft, message.wheel)
        of_topic.setdefault(topic, []).append((message, found[-1]))
    for topic, payload in inputs:
        if topic not in of_topic:
            continue
        time_ns = SamplesMessage.parse(payload, topic).time_ns
        for message, payloads in of_topic[topic]:
            if time_ns and min(time_ns) >= message.start_ns and max(time_ns) <= message.end_ns:
                payloads.append(payload)
    return [
        SearchJob(
            message.spacecraft, message.wheel, wheels.of(message.spacecraft, message.wheel).to_toml(), tuple(payloads)
        )
        for message, payloads in zip(messages, found, strict=True)
    ]
