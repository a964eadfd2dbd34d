"""What is done with one recording: a value that travels to a worker, and the function it is there."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, get_args

from rwa_monitor.api import Monitor
from rwa_monitor.changepoints.stage_results import Method
from rwa_monitor.diagnosis.features import Features
from rwa_monitor.diagnosis.model import Model, built_in_model
from rwa_monitor.errors import InputError
from rwa_monitor.messages import Diagnosis
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.monitor.events import WindowDiagnosed
from rwa_monitor.monitor.telemetry_files import NO_DECODING, read_telemetry
from rwa_monitor.samples import Samples
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.telemetry.configuration import read_wheel
from rwa_monitor.telemetry.files import beside, display_name
from rwa_monitor.telemetry.reader import Decoding, WheelTelemetry
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
class DiagnosedFile:
    """The diagnoses of one file's windows.

    Attributes
    ----------
    diagnoses
        One for each window.
    problems, notes
        What could not be read, and what was left out on purpose, a sentence each.
    carried
        What its wheels hand on to the next file.
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
        Its constants, for every file; None for those that a recording carries.
    decoding
        What files are read with that do not name their channels.
    model
        The one to use for every file; None for what a recording carries, or the built-in one.
    method
        As for `WheelCore`.
    """

    wheel: Wheel | None = None
    decoding: Decoding = NO_DECODING
    model: Model | None = None
    method: Method = "joint"

    def identity(self) -> str:
        """Return a hash of program and settings: results with the same one can stand beside each other."""
        settings = (self.wheel, self.decoding, self.model)
        hashed = [None if value is None else value.sha256() for value in settings]
        return hashlib.sha256(json.dumps([SOFTWARE, *hashed, self.method]).encode()).hexdigest()

    def __call__(self, file: Path, carried: CarriedStates | None = None) -> DiagnosedFile:
        """Diagnose a file's windows; its wheels start with their `carried` state where there is one.

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
        lost = [f"{monitor.counts[name]} {words}" for name, words in NOT_USED.items() if monitor.counts[name]]
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
        joint, paper = (
            _full_ones(diagnose_samples(samples, wheel, None, method=method)) for method in get_args(Method)
        )
        return [
            (by_joint.diagnosis.features, by_paper.diagnosis.features)
            for by_joint, by_paper in zip(joint, paper, strict=True)
        ]

    def _wheel_of(self, file: Path) -> Wheel:
        own = beside(file, ".wheel.toml")
        if not own.exists():
            return self.wheel
        wheel = read_wheel(own)
        if wheel.anomalies != self.wheel.anomalies:
            raise InputError(display_name(own), f"has {wheel.anomalies}, not {self.wheel.anomalies}", "anomalies")
        return wheel
