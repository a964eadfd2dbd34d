"""What the dashboard knows, for Prometheus: the text exposition format, version 0.0.4.

https://prometheus.io/docs/instrumenting/exposition_formats/. Base units, names that end in their unit, counters that
end in _total. What is not known is left out, rather than given as a number.
"""

from __future__ import annotations

import time
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

from rwa_monitor.build import build
from rwa_monitor.dashboard.fleet import Fleet, Wheel
from rwa_monitor.history.records import AlarmRecord
from rwa_monitor.messages import Diagnosis, Status
from rwa_monitor.samples import NANOSECONDS_PER_SECOND
from rwa_monitor.version import SOFTWARE

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"
VERDICTS: Final = ("nominal", "anomalous", "inconclusive")
LEVELS: Final = ("normal", "watch", "warning", "distress", "critical")
SAMPLES: Final = ("used", "masked", "late", "duplicate", "rejected")
MESSAGES: Final = ("missed", "dropped", "rejected")


@dataclass(slots=True)
class Family:
    """One metric: name, type, help, and its samples with their labels."""

    name: str
    kind: str
    text: str
    samples: list[tuple[dict[str, str], float]] = field(default_factory=list)

    def add(self, value: float | None, **labels: str) -> None:
        """Add a sample; None adds none."""
        if value is not None:
            self.samples.append((labels, float(value)))

    def lines(self) -> Iterable[str]:
        """Yield the lines of the text format."""
        yield f"# HELP {self.name} {self.text}"
        yield f"# TYPE {self.name} {self.kind}"
        for labels, value in self.samples:
            inside = ",".join(f'{name}="{_escaped(text)}"' for name, text in labels.items())
            yield f"{self.name}{{{inside}}} {value!r}" if inside else f"{self.name} {value!r}"


def metrics(fleet: Fleet, alarms: Sequence[AlarmRecord], clients: int, aside: Container[tuple[str, str]] = ()) -> str:
    """Return all metrics as text.

    Parameters
    ----------
    fleet
        All wheels that are heard.
    alarms
        All that are not closed.
    clients
        Pages that are open.
    aside
        Spacecraft and wheel of what somebody has put aside: of these there are no metrics, for nobody waits for them.
    """
    of_wheels = _Families()
    with fleet.lock:
        for spacecraft, wheel, known in fleet.wheels():
            if (spacecraft, wheel) not in aside:
                _add_wheel(of_wheels, known, {"spacecraft": spacecraft, "wheel": wheel})
    alarms = [alarm for alarm in alarms if (alarm.spacecraft, alarm.wheel) not in aside]
    raised = Family("rwa_alarms", "gauge", "Open alarms by level, and whether somebody has acknowledged them.")
    for level in LEVELS:
        for phase in ("active", "acknowledged", "returned"):
            count = sum(alarm.level == level and alarm.phase == phase for alarm in alarms)
            raised.add(count, level=level, phase=phase)
    pages = Family("rwa_dashboard_pages", "gauge", "Pages that are open.")
    pages.add(clients)
    info = Family("rwa_dashboard_info", "gauge", "Always 1; the labels say what runs.")
    info.add(1, software=SOFTWARE, build=build())
    families = [*of_wheels.all(), raised, pages, info]
    return "\n".join(line for family in families for line in family.lines()) + "\n"


class _Families:
    """The metrics of wheels."""

    def __init__(self) -> None:
        self.verdict = Family("rwa_wheel_verdict", "gauge", "1 for the verdict of the latest window, 0 for the others.")
        self.adequate = Family("rwa_wheel_model_adequate", "gauge", "1 where the friction model fits the wheel.")
        self.coverage = Family("rwa_wheel_coverage_ratio", "gauge", "Share of the latest window with a good sample.")
        self.end = Family("rwa_wheel_window_end_seconds", "gauge", "End of the latest window on the wheel's own clock.")
        self.probability = Family("rwa_wheel_anomaly_probability", "gauge", "Probability that a part is anomalous.")
        self.severity = Family(
            "rwa_wheel_severity", "gauge", "0 at the nominal bound, 1 at the median of the learned anomaly."
        )
        self.estimate = Family("rwa_wheel_estimate", "gauge", "Estimate of a part, in the unit that is its label.")
        self.bound = Family("rwa_wheel_nominal_high", "gauge", "Upper nominal bound of a part, in its unit.")
        self.age = Family("rwa_wheel_telemetry_age_seconds", "gauge", "Time since samples of the wheel came last.")
        self.late = Family("rwa_wheel_telemetry_stale_after_seconds", "gauge", "Age at which its samples are stale.")
        self.heard = Family("rwa_monitor_status_age_seconds", "gauge", "Time since the wheel's monitor was heard last.")
        self.fill = Family("rwa_monitor_window_fill_ratio", "gauge", "Share of the running window that has passed.")
        self.queue = Family("rwa_monitor_queue_messages", "gauge", "Messages that wait in the wheel's monitor.")
        self.samples = Family("rwa_monitor_samples_total", "counter", "Samples of the wheel by what became of them.")
        self.slots = Family("rwa_monitor_slots_missed_total", "counter", "Slots of the wheel that no sample came for.")
        self.messages = Family("rwa_monitor_messages_total", "counter", "Messages that were of no use, and why.")
        self.windows = Family("rwa_monitor_windows_total", "counter", "Windows of the wheel that were diagnosed.")

    def all(self) -> list[Family]:
        return list(vars(self).values())


def _add_wheel(families: _Families, known: Wheel, labels: dict[str, str]) -> None:
    now_ns = time.time_ns()
    if known.diagnosis is not None:
        _add_diagnosis(families, known.diagnosis, labels)
    if known.rhythm.wall_ns is not None:
        families.age.add((now_ns - known.rhythm.wall_ns) / NANOSECONDS_PER_SECOND, **labels)
        families.late.add(known.rhythm.stale_after_s, **labels)
    if known.status is not None:
        heard_ns = known.latest[Status.kind].wall_ns
        families.heard.add(None if heard_ns is None else (now_ns - heard_ns) / NANOSECONDS_PER_SECOND, **labels)
        _add_status(families, known.status, labels)


def _add_diagnosis(families: _Families, window: Diagnosis, labels: dict[str, str]) -> None:
    for verdict in VERDICTS:
        families.verdict.add(window.verdict == verdict, **labels, verdict=verdict)
    families.adequate.add(window.model_adequate, **labels)
    families.coverage.add(window.coverage, **labels)
    families.end.add(window.window_end_ns / NANOSECONDS_PER_SECOND, **labels)
    for part, one in window.anomalies.items():
        families.probability.add(one.probability, **labels, part=part)
        families.severity.add(one.severity, **labels, part=part)
        families.estimate.add(one.estimate, **labels, part=part, unit=one.unit)
        families.bound.add(one.nominal_high, **labels, part=part, unit=one.unit)


def _add_status(families: _Families, status: Status, labels: dict[str, str]) -> None:
    families.fill.add(status.window_fill, **labels)
    families.queue.add(status.queue_depth, **labels)
    families.slots.add(status.slots_missed, **labels)
    families.windows.add(status.windows, **labels)
    for outcome in SAMPLES:
        families.samples.add(getattr(status, f"samples_{outcome}"), **labels, outcome=outcome)
    for outcome in MESSAGES:
        families.messages.add(getattr(status, f"messages_{outcome}"), **labels, outcome=outcome)


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("\n", "\\n").replace('"', '\\"')
