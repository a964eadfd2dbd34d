"""The live monitor: `run` subscribes to samples, diagnoses, publishes and records until it is stopped.

One thread does everything in order, so that the recording is always a prefix of what happened: take a message from the
inbox, record it, feed the wheel's core, record the core's outputs, flush a diagnosis to the disk, publish. Other
threads only fill the inbox (`bus.Inbox`): when it is full, reliable publishers are slowed down to the monitor's pace,
and messages that are dropped nevertheless are counted in `status`.

After a crash the state is recovered from the last recording, and later messages are taken from the publishers' history
(`backfill`). A diagnosis that had not reached the disk is reproduced, byte for byte, and written to the new recording;
those of the last recordings are published again in any case.
"""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from hashlib import blake2b
from pathlib import Path
from typing import Final, NamedTuple

import zenoh

from rwa_monitor import __version__, messages
from rwa_monitor.errors import InputError
from rwa_monitor.messages import REPLAY, Diagnosis, EncodedMessage, Health, SamplesMessage, Status
from rwa_monitor.monitor.backfill import Arrival
from rwa_monitor.monitor.bus import IDLE_WAIT_S, BusOptions, BusWatch, MonitorBus, check_wheels, open_session
from rwa_monitor.monitor.core import Carried, Event, WheelCore, WindowDiagnosed, outputs_of
from rwa_monitor.monitor.ingest import Counts, Trouble
from rwa_monitor.monitor.recorder import MAX_FILE_BYTES, Checkpoints, Predecessor, Recorder, locked
from rwa_monitor.monitor.replay import REPEATED_SCHEMAS, RecoveredState, recover_state
from rwa_monitor.monitor.searches import Searches
from rwa_monitor.monitor.setup import Setup, WheelKey
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, Timeliness
from rwa_monitor.telemetry.files import refusing
from rwa_monitor.words import SOFTWARE, Log, counted, time_text

SAMPLE_COUNTS: Final = ("received", "used", "masked", "late", "duplicate", "rejected", "queued")
# Samples older than this on arrival are not live: a message spans half a minute (256 samples at 8 Hz), a link and its
# ground segment add seconds to minutes, and a pass after which a satellite dumps stored samples lasts ten minutes.
STORED_AFTER_S: Final = 600.0


@dataclass(frozen=True, slots=True)
class RunOptions:
    """All settings of `run`; every one of them is in the recording.

    Attributes
    ----------
    wheels
        Key expression of the samples to subscribe to.
    setup
        What diagnoses depend on: constants of the wheels, and the model.
    record
        Folder of the recordings, or None to record nothing.
    max_file_bytes
        Size of a recording after which the next one is begun.
    max_record_bytes
        Of all recordings in the folder; the oldest are deleted to keep it. None keeps all.
    bus
        How to reach the bus.
    shard
        (I, N): this process serves share I of N, 1 ≤ I ≤ N.
    status_period_s
        Wall-clock time from one status message to the next [s].
    stored_after_s
        Age by this machine's clock above which samples count as stored [s], if their publisher does not state it and
        the wheel's clock agrees with this machine's; 0 for none. Only health and status depend on it, no diagnosis.
    log_verdicts
        Whether each change of a verdict is logged; False where another view shows the diagnoses.
    """

    wheels: str = "rwa/*/*/samples"
    setup: Setup = field(default_factory=Setup)
    record: Path | None = None
    max_file_bytes: int = MAX_FILE_BYTES
    max_record_bytes: int | None = None
    bus: BusOptions = field(default_factory=BusOptions)
    shard: tuple[int, int] = (1, 1)
    status_period_s: float = messages.PERIOD_S
    stored_after_s: float = STORED_AFTER_S
    log_verdicts: bool = True

    def recorder(
        self, folder: Path, predecessor: Predecessor | None, wall_ns: Callable[[], int], **more: str
    ) -> Recorder:
        """Return a recorder of a monitor with these settings, and more of them, which the recordings hold."""
        share, of = self.shard
        return Recorder(
            folder,
            attachments=self.setup.attachments(),
            settings={"wheels": self.wheels, "shard": f"{share}/{of}", **more},
            predecessor=predecessor,
            wall_ns=wall_ns,
            max_file_bytes=self.max_file_bytes,
            max_total_bytes=self.max_record_bytes,
        )


@dataclass(slots=True)
class _Served:
    """The monitor's state of one wheel; `core` is None until a message could be read."""

    key: WheelKey
    core: WheelCore | None = None
    messages_rejected: int = 0
    last_error: str | None = None
    last_sample_ns: int | None = None
    publisher: str = ""
    source: str = ""  # of a replay: its publisher in Zenoh
    data: Timeliness = "live"  # timeliness of the latest samples
    on_wall_clock: bool = False  # whether some samples were recent by this machine's clock
    health_ns: int = -messages.MAX_CLOCK_NS  # end of the window that the latest health is of
    verdicts: dict[Timeliness, tuple[str, ...]] = field(default_factory=dict)  # the last verdict and active anomalies
    windows: int = 0
    diagnosis_s: float | None = None
    reported: set[str] = field(default_factory=set)  # kinds of trouble logged since the last closed window
    status_due_s: float = 0.0
    status_recorded_s: float = float("-inf")

    @property
    def name(self) -> str:
        """Spacecraft and wheel, as in the log."""
        return "/".join(self.key)

    @property
    def is_replay(self) -> bool:
        """Whether its telemetry is a replay."""
        return self.key[1].endswith(REPLAY)


class Clock(NamedTuple):
    """The clocks of the machine: wall time [ns], and monotonic time [s]."""

    wall_ns: Callable[[], int] = time.time_ns
    monotonic_s: Callable[[], float] = time.monotonic


@dataclass(eq=False)
class Monitor:
    """Serves all wheels of a bus, one message at a time.

    Parameters
    ----------
    options
        Settings.
    bus
        Source of samples and sink of messages.
    recorder
        None to record nothing.
    log
        Called with each line of the log.
    clock
        For flushing, status and measuring durations; never for a diagnosis.
    """

    options: RunOptions
    bus: MonitorBus
    recorder: Recorder | None
    log: Log
    clock: Clock

    def __post_init__(self) -> None:
        """Begin without wheels."""
        self._served: dict[WheelKey, _Served] = {}
        self._setup = self.options.setup
        self.searches = Searches(self._setup, self.options.record, self.log)
        self._tick_due_s = 0.0
        self._logged = ""

    def begin(self, recovered: RecoveredState) -> None:
        """Continue from the state of an earlier run, and begin the recording."""
        for key, core in recovered.cores.items():
            self._served[key] = served = _Served(key, core)
            with suppress(KeyError, InputError):  # there is no status, or it is of another release
                status = recovered.statuses[messages.key_of(Status, *key)]
                served.on_wall_clock = Status.parse(status.payload, status.topic).on_wall_clock
        if self.recorder is not None:
            self.recorder.begin(self._checkpoints(), self.clock.monotonic_s(), recovered.unrecorded)
        health: dict[WheelKey, Health] = {}
        for output in (*recovered.diagnoses, *recovered.unrecorded):
            if output.schema != Health.schema_name():  # health is published once, below
                self._publish(output)
            if output.schema not in REPEATED_SCHEMAS:
                continue
            with suppress(InputError):  # of another release
                found = _health_of(output)
                key = found.spacecraft, found.wheel
                if not found.data or key not in health or found.window_end_ns >= health[key].window_end_ns:
                    health[key] = found
        for key, found in health.items():
            self._publish(found.encoded(*key, found.window_end_ns))
            if key in self._served:
                self._served[key].health_ns = found.window_end_ns

    def step(self) -> None:
        """Process one message, or wait up to `IDLE_WAIT_S` for one; do what is due."""
        self.bus.inbox.wake.clear()
        message = self.bus.take()
        if message is None:
            self.bus.inbox.wake.wait(IDLE_WAIT_S)
        else:
            self.receive(message)
        self.tick()

    def tick(self) -> None:
        """Do what is due by the clock: flush and rotate the recording, publish status."""
        now_s = self.clock.monotonic_s()
        if now_s < self._tick_due_s:
            return
        self._tick_due_s = now_s + IDLE_WAIT_S
        if self.recorder is not None:
            self.recorder.maintain(now_s, self._checkpoints)
            if self.recorder.error:
                self._log_once(self.recorder.error)
        for found in self.searches.poll():
            self._record(found)
            self._publish(found)
        for served in self._served.values():
            if now_s >= served.status_due_s:
                served.status_due_s = now_s + self.options.status_period_s
                # Every status is published; one per `LOG_PERIOD_S` is recorded.
                record = now_s - served.status_recorded_s >= messages.LOG_PERIOD_S
                if record:
                    served.status_recorded_s = now_s
                self._status(served, record=record)

    def close(self) -> None:
        """Write the last status of each wheel and the end of the recording."""
        windows = sum(served.windows for served in self._served.values())
        self.log(f"stopped: {counted(windows, 'window')} of {counted(len(self._served), 'wheel')} diagnosed")
        with_samples = {key for key, served in self._served.items() if served.core is not None}
        if unused := ["/".join(key) for key in self._setup.own if self._is_in_shard(*key) and key not in with_samples]:
            self.log(f"wheel files that no wheel used: {', '.join(unused)}; are these the names on the bus?")
        self.searches.close()
        for served in self._served.values():
            self._status(served, record=True)
        if self.recorder is not None:
            self.recorder.close(self.clock.monotonic_s())

    # ---- in ------------------------------------------------------------------------------------------------------

    def receive(self, arrival: Arrival) -> bool:
        """Process one message from beginning to end: record, diagnose, record, publish.

        A replay is not recorded, as it is from a recording, and each replay starts with a new core.

        Returns
        -------
        bool
            Whether the message was processed or refused; False where it was requested again, as it is no JSON and may
            have been damaged in transit.
        """
        key, payload = arrival.key, arrival.payload
        try:
            if not self._is_in_shard(*messages.split_key(key)[:2]):
                return True
            message = SamplesMessage.parse(payload, key)
            if message.data == "replay":
                key = messages.replay_key(key)
            samples = message.samples()
            served = self._serve(key)
            if served.is_replay and served.source != arrival.source:
                self._served[served.key] = served = _Served(served.key, source=arrival.source)
            core = served.core or self._setup.new_core(*served.key)
            core.check(samples)
        except InputError as error:
            if not messages.is_json(payload) and self.bus.backfill.ask_again(arrival):
                return False
            self._refuse(key, payload, error)
            return True
        if served.core is None and self._setup.own and served.key not in self._setup.own:
            self.log(f"{served.name}: has no wheel file of its own; it goes by {core.wheel.name}")
        served.core = core
        self._record(EncodedMessage(key, SamplesMessage.schema_name(), payload, message.time_ns[-1]))
        served.data = self._data_of(served, message)
        if message.data != "stored":
            served.publisher = message.publisher
            if served.data != "replay":
                self.searches.take_input(served.key, payload)
        begin_s = self.clock.monotonic_s()
        events = core.feed(samples, message.publisher, message.batch, message.data)
        served.last_sample_ns = core.assignment.last_ns
        if any(isinstance(event, WindowDiagnosed) for event in events):
            served.diagnosis_s = self.clock.monotonic_s() - begin_s
        self._handle(served, events)
        return True

    def _data_of(self, served: _Served, message: SamplesMessage) -> Timeliness:
        """Return the timeliness of samples: as their publisher states it, or else by this machine's clock."""
        if served.is_replay:
            return "replay"
        if message.data is not None:
            return message.data
        age_s = (self.clock.wall_ns() - message.time_ns[-1]) / NANOSECONDS_PER_SECOND
        limit_s = self.options.stored_after_s
        served.on_wall_clock |= abs(age_s) <= limit_s  # a clock with another epoch gives no age
        return "stored" if served.on_wall_clock and 0 < limit_s < age_s else "live"

    def _handle(self, served: _Served, events: list[Event]) -> None:
        """Record the core's outputs, flush a diagnosis to the disk, then publish."""
        for event in events:
            if not isinstance(event, Trouble):
                continue
            served.last_error = event.text
            if event.kind not in served.reported:  # a broken sensor may cause thousands in a window
                served.reported.add(event.kind)
                self.log(f"{served.name}: {event.text}")
        outputs = outputs_of(events, *served.key, None if served.data == "live" else served.data)
        closed = [event for event in events if isinstance(event, WindowDiagnosed)]
        for output in outputs:
            self._record(output)
        if closed and self.recorder is not None:
            self.recorder.sync(self.clock.monotonic_s())
        dumped = {event.diagnosis.window_end_ns for event in closed if event.diagnosis.data}
        # The health is published first: it states what data the window of the diagnosis is of.
        for output in sorted(outputs, key=lambda output: output.schema != Health.schema_name()):
            if output.schema == Health.schema_name():
                if output.time_ns in dumped and output.time_ns < served.health_ns:
                    continue  # the wheel's health is that of its latest window
                served.health_ns = output.time_ns
            self._publish(output)
        if closed:
            served.reported.clear()
            served.windows += len(closed)
            self._status(served, record=True)
        for event in closed:
            self._log_verdict(served, event)
            window = event.diagnosis
            if not window.partial and window.data is None and served.data != "replay":
                self.searches.take_diagnosis(served.key, adequate=window.model_adequate)

    def _log_verdict(self, served: _Served, event: WindowDiagnosed) -> None:
        """Log a window's verdict if it has changed: among lines for all windows of a fleet it would be overlooked."""
        diagnosis = event.diagnosis
        verdict = (diagnosis.verdict, *(name for name, anomaly in diagnosis.anomalies.items() if anomaly.active))
        data = diagnosis.data or served.data
        if verdict != served.verdicts.get(data) and self.options.log_verdicts:
            window = "window to" if data == "live" else f"{data} data, window to"
            until = time_text(diagnosis.window_end_ns)
            self.log(f"{served.name}: {window} {until}: {diagnosis.verdict}: {diagnosis.reason}")
        served.verdicts[data] = verdict

    def _refuse(self, key: str, payload: bytes, error: InputError) -> None:
        """Count, record and log a message that cannot be used; it changes nothing else."""
        if self.recorder is not None:
            self.recorder.refused(key, payload)
        try:
            served = self._serve(key)
        except InputError:
            self._log_once(f"a message was refused: {error}")
            return
        served.messages_rejected += 1
        text = ": ".join(part for part in (error.place, error.reason) if part)
        if served.last_error != text:
            self.log(f"{served.name}: a message was refused: {text}")
        served.last_error = text

    def _is_in_shard(self, spacecraft: str, wheel: str) -> bool:
        share, of = self.options.shard
        # The same in every process and release; a checksum would spread names that differ by a digit unevenly.
        digest = blake2b(f"{spacecraft}/{wheel}".encode(), digest_size=8).digest()
        return int.from_bytes(digest, "big") % of == share - 1

    def _serve(self, topic: str) -> _Served:
        key = messages.split_key(topic)[:2]
        if key not in self._served:
            if len(self._served) >= messages.MAX_WHEELS:
                raise InputError("/".join(key), f"is one wheel more than the {messages.MAX_WHEELS} of a process")
            self._served[key] = _Served(key)
        return self._served[key]

    # ---- out -----------------------------------------------------------------------------------------------------

    def _record(self, output: EncodedMessage) -> None:
        if self.recorder is not None and f"{REPLAY}/" not in output.topic:
            self.recorder.write(output)

    def _publish(self, output: EncodedMessage) -> None:
        if output.schema == Carried.schema_name():  # for the recording alone
            return
        try:
            self.bus.publish(output)
        except zenoh.ZError as error:
            self._log_once(f"cannot publish: {error}")

    def _status(self, served: _Served, *, record: bool) -> None:
        """Publish the status of a wheel's monitor."""
        spacecraft, wheel = served.key
        core = served.core
        recording = self.recorder.path if self.recorder else None
        last_error = served.last_error
        if self.recorder is not None and self.recorder.error:
            last_error = self.recorder.error
        elif self.bus.inbox.dropped and last_error is None:
            last_error = f"dropped {counted(self.bus.inbox.dropped, 'message')}: they come faster than can be diagnosed"
        counts = core.counts if core else Counts()
        # The core counts gaps of publishers that number their messages; those of others only the bus counts.
        missed_by_bus = self.bus.backfill.missed.get(messages.key_of(SamplesMessage, spacecraft, wheel), 0)
        if missed_by_bus and last_error is None:
            last_error = f"the bus lost {counted(missed_by_bus, 'message')}, which their publisher no longer has"
        status = Status(
            spacecraft=spacecraft,
            wheel=wheel,
            **{f"samples_{name}": getattr(counts, name) for name in SAMPLE_COUNTS},
            slots_missed=counts.slots_missed,
            messages_rejected=served.messages_rejected,
            messages_dropped=self.bus.inbox.dropped,
            messages_missed=max(counts.messages_missed, missed_by_bus),
            queue_depth=self.bus.waiting(),
            window_fill=core.windows.fill if core else 0.0,
            last_error=last_error,
            recording=recording.name if recording else None,
            software=SOFTWARE,
            model_sha256=self._setup.identity_of(*served.key)[1],
            publisher=served.publisher,
            windows=served.windows,
            last_sample_ns=served.last_sample_ns,
            diagnosis_s=served.diagnosis_s,
            now_wall_ns=self.clock.wall_ns(),
            data=served.data,
            on_wall_clock=served.on_wall_clock,
        ).encoded(spacecraft, wheel)
        if record:
            self._record(status)
        self._publish(status)

    def _checkpoints(self) -> Checkpoints:
        """Return functions that make the checkpoint of each recorded wheel when called."""
        return {one.name: one.core.checkpoint for one in self._served.values() if one.core and not one.is_replay}

    def _log_once(self, text: str) -> None:
        """Log a text unless it was the last one logged here."""
        if text != self._logged:
            self.log(text)
        self._logged = text


# ---- start and stop --------------------------------------------------------------------------------------------------


def _health_of(recorded: EncodedMessage) -> Health:
    """Return the recorded health, or that of a recorded diagnosis; InputError if it is of another release."""
    if recorded.schema == Health.schema_name():  # only health states that samples were old by the clock
        return Health.parse(recorded.payload, recorded.topic)
    return messages.health_message(Diagnosis.parse(recorded.payload, recorded.topic))


def run(
    options: RunOptions,
    stop: threading.Event,
    *,
    session: zenoh.Session | None = None,
    log: Log = print,
    supervisor: Supervisor | None = None,
) -> None:
    """Monitor until `stop` is set; returns within two seconds of that.

    Parameters
    ----------
    options
        See `RunOptions`.
    stop
        Set it from a signal handler or another thread.
    session
        An open Zenoh session to use (the demo's embedded one); it is left open. None: opens and closes its own.
    log
        Called with each line of the log (stderr on the command line).
    supervisor
        Notified when the monitor is ready, alive and stopping; None: there is none.

    Raises
    ------
    InputError
        If an option, a wheel or the model cannot be used, or the folder of the recordings.
    RwaMonitorError
        If the bus cannot be reached.
    """
    log = _fail_safe_log(log)
    supervisor = supervisor or Supervisor({})
    check_wheels(options.wheels)
    setup = options.setup
    for key in ("", ""), *setup.own:
        setup.new_core(*key)  # a wheel that cannot be served is refused at once
    with ExitStack() as stack:
        clock = Clock()
        recorder: Recorder | None = None
        recovered = RecoveredState()
        if options.record is not None:
            stack.enter_context(locked(options.record))
            recovered = recover_state(options.record, setup, stop, log)
            if stop.is_set():
                return
            recorder = options.recorder(options.record, recovered.predecessor, clock.wall_ns, build=__version__)
        if session is None:
            session = stack.enter_context(open_session(options.bus))
        bus = stack.enter_context(closing(MonitorBus(session)))
        monitor = Monitor(options, bus, recorder, log, clock)
        stack.callback(monitor.close)
        monitor.begin(recovered)
        del recovered  # frees the memory of the messages that were published again
        bus.subscribe(options.wheels)
        bus.show_alive()
        log(doing := f"monitoring {options.wheels}" + (f", recording in {options.record}" if options.record else ""))
        supervisor.ready(doing)
        watch = BusWatch(session, options.bus)
        while not stop.is_set():
            supervisor.alive(clock.monotonic_s())
            watch.log_changes(clock.monotonic_s(), log)
            monitor.step()
        supervisor.stopping()


def _fail_safe_log(log: Log) -> Log:
    """Return a log that does not end the monitor when its pipe is closed or its disk is full."""

    def logged(line: str) -> None:
        with suppress(OSError):  # important lines are in `status`, too
            log(line)

    return logged


# ---- the supervisor of the process -----------------------------------------------------------------------------------


class Supervisor:
    """The supervisor of this process, by the protocol of systemd (sd_notify(3)); does nothing where there is none.

    A supervisor names a datagram socket in NOTIFY_SOCKET and the watchdog timeout in WATCHDOG_USEC. The keep-alive is
    sent by the thread that diagnoses, between two messages: it stops when that thread stalls, even if the rest of the
    process continues, and the supervisor then restarts the service, which continues from its recording.

    A container's supervisor has no such socket but runs a command inside, the health check, which reads the time of
    the last keep-alive from the modification time of a file.

    Parameters
    ----------
    environment
        May have NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID; empty for no supervisor.
    alive
        A file that each keep-alive touches, for a health check; None for no file.

    Attributes
    ----------
    period_s
        Between two keep-alives; None where none are expected.
    """

    def __init__(self, environment: Mapping[str, str], alive: Path | None = None) -> None:
        self._address = environment.get("NOTIFY_SOCKET", "")
        if self._address.startswith("@"):  # an abstract socket of Linux
            self._address = "\0" + self._address[1:]
        silence = environment.get("WATCHDOG_USEC", "")
        ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self.period_s: float | None = None
        if self._address and ours and silence.isdecimal() and int(silence) > 0:
            self.period_s = int(silence) * 1e-6 / messages.INTERVALS_TILL_LATE  # stated in µs
        elif alive is not None:
            self.period_s = messages.PERIOD_S
        self._alive = alive
        self._due_s = float("-inf")

    def ready(self, status: str) -> None:
        """Report that the service is ready, and what it does; raises InputError if the file cannot be made."""
        if self._alive is not None:
            with refusing(self._alive, "cannot be touched"):
                self._alive.touch()
        self._send(f"READY=1\nSTATUS={status}")

    def alive(self, now_s: float) -> None:
        """Send a keep-alive if one is due; call it often, from the thread that must not stall."""
        if self.period_s is not None and now_s >= self._due_s:
            self._due_s = now_s + self.period_s
            self._send("WATCHDOG=1")
            if self._alive is not None:
                with suppress(OSError):  # then the file grows old, and the health check fails
                    self._alive.touch()

    def stopping(self) -> None:
        """Report that the service stops on purpose."""
        self._send("STOPPING=1")

    def _send(self, text: str) -> None:
        if not self._address:
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as end:
            end.setblocking(False)
            # A supervisor that does not listen must not stop the monitor; its own watchdog handles what it misses.
            with suppress(OSError):
                end.sendto(text.encode(), self._address)
