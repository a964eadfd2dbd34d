"""What is done with one recording: a value that travels to a worker, and the function it is there."""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar, Final

from rwa_monitor.api import Monitor
from rwa_monitor.changepoints.stage_results import Method
from rwa_monitor.diagnosis.features import Features
from rwa_monitor.diagnosis.model import Model, built_in_model
from rwa_monitor.discrepancy.bench import as_measured
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.errors import InputError
from rwa_monitor.identification.identify import bare_wheel, identify
from rwa_monitor.messages import Diagnosis
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.monitor.events import WindowDiagnosed
from rwa_monitor.monitor.telemetry_files import NO_DECODING, read_telemetry
from rwa_monitor.reporting.rows import Row, diagnosis_row, discrepancy_row, wheel_row
from rwa_monitor.samples import Samples
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.telemetry.configuration import read_wheel
from rwa_monitor.telemetry.files import beside, display_name
from rwa_monitor.telemetry.reader import Decoding, TelemetryFile, WheelTelemetry, joined, only_wheel
from rwa_monitor.telemetry.table import read_table
from rwa_monitor.version import SOFTWARE
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel

CarriedStates = dict[tuple[str, str], CarriedState]  # by spacecraft and wheel
# What is reported of samples that no window used, by name of `sequencer.Counts`.
NOT_USED: Final = {
    "masked": "were masked",
    "rejected": "rejected",
    "late": "late",
    "duplicate": "double",
    "slots_missed": "slots had none",
}


@dataclass(frozen=True, slots=True)
class Done:
    """What came of one recording.

    Attributes
    ----------
    rows
        One for each window, report or wheel.
    problems, notes
        What could not be read, and what was left out on purpose, a sentence each.
    """

    rows: list[Row]
    problems: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Task(ABC):
    """What to do with a recording, with all settings that the result depends on beside it.

    Attributes
    ----------
    wheel
        Its constants, for every file; None for those that a recording carries.
    decoding
        What files are read with that do not name their channels.
    """

    kind: ClassVar[str]

    wheel: Wheel | None = None
    decoding: Decoding = NO_DECODING

    @abstractmethod
    def __call__(self, file: Path) -> Done:
        """Do it; raises InputError if the recording cannot be used."""

    def identity(self) -> str:
        """Return a hash of kind, program and settings: results with the same one can stand beside each other."""
        settings = [getattr(self, field.name) for field in fields(self)]
        hashed = [value.sha256() if hasattr(value, "sha256") else value for value in settings]
        return hashlib.sha256(json.dumps([self.kind, SOFTWARE, *hashed]).encode()).hexdigest()

    def _read(self, file: Path) -> TelemetryFile:
        return read_telemetry(file, self.decoding.of_wheel(self.wheel))

    def _read_one_wheel(self, file: Path) -> tuple[TelemetryFile, Wheel | None, tuple[str, Samples]]:
        """Return a file of one wheel: its content, what is known of the wheel, and name and samples."""
        content = self._read(file)
        telemetry = only_wheel(content, display_name(file))
        return content, self.wheel or telemetry.constants, (str(file), joined(telemetry))


@dataclass(frozen=True, slots=True)
class DiagnosedFile:
    """The diagnoses of one file's windows, with what reading it reported and what its wheels carry on."""

    diagnoses: list[Diagnosis]
    problems: tuple[str, ...]
    notes: list[str]
    carried: CarriedStates


@dataclass(frozen=True, slots=True)
class Diagnose(Task):
    """Diagnose a recording, window by window, through the same core as the live monitor.

    Attributes
    ----------
    model
        The one to use for every file; None for what a recording carries, or the built-in one.
    method
        As for `WheelCore`.
    """

    kind: ClassVar[str] = "diagnosis"

    model: Model | None = None
    method: Method = "joint"

    def __call__(self, file: Path) -> Done:
        found = self.diagnose(file)
        return Done([diagnosis_row(diagnosis) for diagnosis in found.diagnoses], found.problems, tuple(found.notes))

    def diagnose(self, file: Path, carried: CarriedStates | None = None) -> DiagnosedFile:
        """Diagnose a file's windows; its wheels start with their `carried` state where there is one."""
        content = self._read(file)
        wheels = [self.wheel or telemetry.constants or built_in_wheel() for telemetry in content.telemetry]
        model = self.model or content.model or built_in_model()
        missing = dict.fromkeys(f"{wheel.name}: {note}" for wheel in wheels for note in wheel.missing())  # each once
        found = DiagnosedFile([], tuple(content.problems), [*content.notes, *missing], {})
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
                found.diagnoses.extend(monitor.feed(batch.samples, batch.publisher, batch.batch))
        except InputError as error:
            raise InputError(telemetry.source, f"{error.source}: {error.reason}", error.place) from error
        found.diagnoses.extend(monitor.finish())
        found.carried[key] = monitor.carried
        found.notes.extend(f"{telemetry.source}: {trouble}" for trouble in monitor.troubles)
        lost = [f"{monitor.counts[name]} {words}" for name, words in NOT_USED.items() if monitor.counts[name]]
        if monitor.counts["masked"] and monitor.why_masked:
            why = "; ".join(f"{count} {words}" for words, count in monitor.why_masked.items())
            lost[0] = f"{lost[0]} ({why})"
        if lost:
            found.notes.append(f"{telemetry.source}: of {monitor.counts['received']} samples {', '.join(lost)}")


@dataclass(frozen=True, slots=True)
class FindDiscrepancy(Task):
    """Find what the simulation of the one wheel in a recording gets wrong; each recording is judged by itself."""

    kind: ClassVar[str] = "discrepancy"

    def __call__(self, file: Path) -> Done:
        content, known, samples = self._read_one_wheel(file)
        wheel = known or built_in_wheel()
        search = find_discrepancy([samples], wheel, lambda _: None)
        message = json.dumps(search.result.to_json(), ensure_ascii=False, allow_nan=False)
        notes = (*content.notes, *as_measured([samples], wheel).notes)
        return Done([discrepancy_row(str(file), search.result, message)], tuple(content.problems), notes)


@dataclass(frozen=True, slots=True)
class Identify(Task):
    """Learn a wheel from each recording by itself; `wheel` is what is known already.

    Attributes
    ----------
    systems
        Whether the laws of the switching systems are learned too.
    """

    kind: ClassVar[str] = "wheel"

    systems: bool = True

    def __call__(self, file: Path) -> Done:
        content, known, samples = self._read_one_wheel(file)
        start = known or bare_wheel(file.stem, samples[1])
        name = display_name(file)
        try:
            bench = as_measured([samples], start)
            learned = identify(bench.recordings, bench.wheel, systems=self.systems)
            warning = not_nominal(bench.recordings, learned.wheel)
        except InputError as error:  # of one of many recordings: which of them must be named
            source = "" if error.source in {name, "identify"} else f"{error.source}: "
            raise InputError(name, f"{source}{error.reason}", error.place) from error
        own = [f"{name}: {note}" for note in (*learned.notes, *((warning,) if warning else ()))]
        return Done([wheel_row(str(file), learned)], tuple(content.problems), (*content.notes, *bench.notes, *own))


def not_nominal(recordings: Sequence[tuple[str, Samples]], wheel: Wheel) -> str:
    """Report which windows of the recordings that a wheel was learned from are not nominal with it; "" if all are.

    Parameters
    ----------
    recordings
        Name and samples of each.
    wheel
        What `identify` made of them.

    Raises
    ------
    InputError
        If one is anomalous: nothing that calls what it was learned from a failure is a wheel file.
    """
    model = built_in_model()
    windows = [
        (name, window.diagnosis)
        for name, samples in recordings
        for window in _full_ones(diagnose_samples(samples, wheel, model))
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


def _full_ones(windows: Iterable[WindowDiagnosed]) -> list[WindowDiagnosed]:
    """Return the windows without the partial one at the end, if there are others."""
    found = list(windows)
    return [window for window in found if not window.partial] or found


@dataclass(frozen=True, slots=True)
class ReadFeatures:
    """What the classifiers see of a recording's windows, by both methods; for `train`, which keeps it in memory.

    Attributes
    ----------
    wheel
        For recordings that have no wheel file of their own beside them.
    """

    wheel: Wheel

    def __call__(self, file: Path) -> list[tuple[Features, Features]]:
        """Return the features of each window by the joint and the paper's method; of full ones where there are any."""
        wheel = self._wheel_of(file)
        samples = read_table(file).samples
        joint = list(diagnose_samples(samples, wheel, None, method="joint"))
        paper = list(diagnose_samples(samples, wheel, None, method="paper"))
        any_full = any(not window.partial for window in joint)
        return [
            (by_joint.diagnosis.features, by_paper.diagnosis.features)
            for by_joint, by_paper in zip(joint, paper, strict=True)
            if not (by_joint.partial and any_full)
        ]

    def _wheel_of(self, file: Path) -> Wheel:
        own = beside(file, ".wheel.toml")
        if not own.exists():
            return self.wheel
        wheel = read_wheel(own)
        if wheel.anomalies != self.wheel.anomalies:
            raise InputError(display_name(own), f"has {wheel.anomalies}, not {self.wheel.anomalies}", "anomalies")
        return wheel
