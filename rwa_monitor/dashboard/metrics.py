"""The metrics of the dashboard for Prometheus: the text exposition format, version 0.0.4.

https://prometheus.io/docs/instrumenting/exposition_formats/. Base units, names that end in their unit, counters that
end in _total. What is not known is left out, rather than given as a number.
"""

from __future__ import annotations

import time
from collections.abc import Container, Iterable, Sequence
from typing import Final, get_args

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from prometheus_client.registry import Collector

from rwa_monitor.build import build
from rwa_monitor.dashboard.fleet import Fleet, Wheel
from rwa_monitor.history.records import AlarmRecord
from rwa_monitor.messages import AlarmLevel, Diagnosis, Status, Verdict
from rwa_monitor.samples import NANOSECONDS_PER_SECOND
from rwa_monitor.version import SOFTWARE

CONTENT_TYPE: Final = CONTENT_TYPE_PLAIN_0_0_4
SAMPLES: Final = ("used", "masked", "late", "duplicate", "rejected")
MESSAGES: Final = ("missed", "dropped", "rejected")
WHEEL: Final = ("spacecraft", "wheel")

Family = GaugeMetricFamily | CounterMetricFamily
Labels = tuple[str, ...]


def metrics(fleet: Fleet, alarms: Sequence[AlarmRecord], clients: int, retired: Container[tuple[str, str]] = ()) -> str:
    """Return all metrics as text.

    Parameters
    ----------
    fleet
        All live wheels.
    alarms
        All that are not closed.
    clients
        Pages that are open.
    retired
        Spacecraft and wheel of retired wheels: of these there are no metrics.
    """
    found = _Metrics()
    with fleet.lock:
        for spacecraft, wheel, known in fleet.wheels():
            if (spacecraft, wheel) not in retired:
                _add_wheel(found, known, (spacecraft, wheel))
    alarms = [alarm for alarm in alarms if (alarm.spacecraft, alarm.wheel) not in retired]
    for level in get_args(AlarmLevel):
        for phase in ("active", "acknowledged", "returned"):
            count = sum(alarm.level == level and alarm.phase == phase for alarm in alarms)
            found.alarms.add_metric((level, phase), count)
    found.pages.add_metric((), clients)
    found.info.add_metric((SOFTWARE, build()), 1)
    return generate_latest(found).decode()


def _gauge(name: str, about: str, *labels: str) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, about, labels=(*WHEEL, *labels))


def _counter(name: str, about: str, *labels: str) -> CounterMetricFamily:
    return CounterMetricFamily(name, about, labels=(*WHEEL, *labels))


def _add(family: Family, labels: Labels, value: float | None) -> None:
    """Add a sample; None adds none."""
    if value is not None:
        family.add_metric(labels, value)


class _Metrics(Collector):
    """All metrics, in the order in which they are written."""

    def __init__(self) -> None:
        self.verdict = _gauge(
            "rwa_wheel_verdict", "1 for the verdict of the latest window, 0 for the others.", "verdict"
        )
        self.adequate = _gauge("rwa_wheel_model_adequate", "1 where the friction model fits the wheel.")
        self.coverage = _gauge("rwa_wheel_coverage_ratio", "Share of the latest window with a good sample.")
        self.end = _gauge("rwa_wheel_window_end_seconds", "End of the latest window on the wheel's own clock.")
        self.probability = _gauge("rwa_wheel_anomaly_probability", "Probability that a part is anomalous.", "part")
        self.severity = _gauge(
            "rwa_wheel_severity", "0 at the nominal bound, 1 at the median of the learned anomaly.", "part"
        )
        self.estimate = _gauge(
            "rwa_wheel_estimate", "Estimate of a part, in the unit that is its label.", "part", "unit"
        )
        self.bound = _gauge("rwa_wheel_nominal_high", "Upper nominal bound of a part, in its unit.", "part", "unit")
        self.age = _gauge("rwa_wheel_telemetry_age_seconds", "Time since samples of the wheel came last.")
        self.late = _gauge("rwa_wheel_telemetry_stale_after_seconds", "Age at which its samples are stale.")
        self.reported = _gauge("rwa_monitor_status_age_seconds", "Time since the wheel's monitor reported last.")
        self.fill = _gauge("rwa_monitor_window_fill_ratio", "Share of the running window that has passed.")
        self.queue = _gauge("rwa_monitor_queue_messages", "Messages that wait in the wheel's monitor.")
        self.samples = _counter("rwa_monitor_samples_total", "Samples of the wheel by what became of them.", "outcome")
        self.slots = _counter("rwa_monitor_slots_missed_total", "Slots of the wheel that no sample came for.")
        self.messages = _counter("rwa_monitor_messages_total", "Messages that were of no use, and why.", "outcome")
        self.windows = _counter("rwa_monitor_windows_total", "Windows of the wheel that were diagnosed.")
        about = "Open alarms by level, and whether they are acknowledged."
        self.alarms = GaugeMetricFamily("rwa_alarms", about, labels=("level", "phase"))
        self.pages = GaugeMetricFamily("rwa_dashboard_pages", "Pages that are open.")
        about = "Always 1; the labels name what runs."
        self.info = GaugeMetricFamily("rwa_dashboard_info", about, labels=("software", "build"))

    def collect(self) -> Iterable[Metric]:
        return vars(self).values()


def _add_wheel(families: _Metrics, known: Wheel, wheel: Labels) -> None:
    now_ns = time.time_ns()
    if known.diagnosis is not None:
        _add_diagnosis(families, known.diagnosis, wheel)
    if known.rhythm.wall_ns is not None:
        _add(families.age, wheel, (now_ns - known.rhythm.wall_ns) / NANOSECONDS_PER_SECOND)
        _add(families.late, wheel, known.rhythm.stale_after_s)
    if known.status is not None:
        last_ns = known.latest[Status.kind].wall_ns
        _add(families.reported, wheel, None if last_ns is None else (now_ns - last_ns) / NANOSECONDS_PER_SECOND)
        _add_status(families, known.status, wheel)


def _add_diagnosis(families: _Metrics, window: Diagnosis, wheel: Labels) -> None:
    for verdict in get_args(Verdict):
        _add(families.verdict, (*wheel, verdict), window.verdict == verdict)
    _add(families.adequate, wheel, window.model_adequate)
    _add(families.coverage, wheel, window.coverage)
    _add(families.end, wheel, window.window_end_ns / NANOSECONDS_PER_SECOND)
    for part, one in window.anomalies.items():
        _add(families.probability, (*wheel, part), one.probability)
        _add(families.severity, (*wheel, part), one.severity)
        _add(families.estimate, (*wheel, part, one.unit), one.estimate)
        _add(families.bound, (*wheel, part, one.unit), one.nominal_high)


def _add_status(families: _Metrics, status: Status, wheel: Labels) -> None:
    _add(families.fill, wheel, status.window_fill)
    _add(families.queue, wheel, status.queue_depth)
    _add(families.slots, wheel, status.slots_missed)
    _add(families.windows, wheel, status.windows)
    for outcome in SAMPLES:
        _add(families.samples, (*wheel, outcome), getattr(status, f"samples_{outcome}"))
    for outcome in MESSAGES:
        _add(families.messages, (*wheel, outcome), getattr(status, f"messages_{outcome}"))
