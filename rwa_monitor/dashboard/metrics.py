"""The metrics of the dashboard for Prometheus: the text exposition format, version 0.0.4.

https://prometheus.io/docs/instrumenting/exposition_formats/. Base units, names that end in their unit, counters that
end in _total. What is not known is left out, rather than given as a number.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Iterable, Sequence
from functools import partial
from typing import Final, get_args

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from prometheus_client.registry import Collector

from rwa_monitor.build import build
from rwa_monitor.dashboard.fleet import Fleet, Wheel
from rwa_monitor.history.alarms import STORED_ALARM
from rwa_monitor.history.records import AlarmRecord
from rwa_monitor.messages import REPLAY, AlarmLevel, Diagnosis, Status, Verdict
from rwa_monitor.samples import NANOSECONDS_PER_SECOND
from rwa_monitor.version import SOFTWARE

CONTENT_TYPE: Final = CONTENT_TYPE_PLAIN_0_0_4
SAMPLES: Final = ("used", "masked", "late", "duplicate", "rejected")
MESSAGES: Final = ("missed", "dropped", "rejected")


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
            if (spacecraft, wheel) not in retired and not wheel.endswith(REPLAY):
                _add_wheel(partial(found.add, spacecraft=spacecraft, wheel=wheel), known)
    alarms = [alarm for alarm in alarms if (alarm.spacecraft, alarm.wheel) not in retired]
    stored = [alarm for alarm in alarms if alarm.name.endswith(STORED_ALARM)]
    for level in get_args(AlarmLevel):
        for phase in ("active", "acknowledged", "returned"):
            count = sum(alarm.level == level and alarm.phase == phase for alarm in alarms if alarm not in stored)
            about = "Open alarms by level, and whether they are acknowledged."
            found.add("rwa_alarms", about, count, level=level, phase=phase)
        about = "Alarms of stored telemetry, with times of then, that nobody has acknowledged, by level."
        found.add("rwa_stored_alarms", about, sum(alarm.level == level for alarm in stored), level=level)
    found.add("rwa_dashboard_pages", "Pages that are open.", clients)
    found.add("rwa_dashboard_info", "Always 1; the labels name what runs.", 1, software=SOFTWARE, build=build())
    return generate_latest(found).decode()


class _Metrics(Collector):
    """All metrics, in the order in which they are added first."""

    def __init__(self) -> None:
        self._families: dict[str, GaugeMetricFamily | CounterMetricFamily] = {}

    def add(self, name: str, about: str, value: float | None, **labels: str) -> None:
        """Add a sample to the metric of a name, which is a counter where that ends in "_total"; None adds none."""
        if value is None:
            return
        if name not in self._families:
            family = CounterMetricFamily if name.endswith("_total") else GaugeMetricFamily
            self._families[name] = family(name, about, labels=list(labels))
        self._families[name].add_metric(list(labels.values()), value)

    def collect(self) -> Iterable[Metric]:
        return self._families.values()


def _add_wheel(add: Callable[..., None], known: Wheel) -> None:
    """Add the metrics of a wheel; `add` gives each its name."""
    if known.diagnosis is not None:
        _add_diagnosis(add, known.diagnosis)
    if known.rhythm.wall_ns is not None:
        add(
            "rwa_wheel_telemetry_age_seconds",
            "Time since samples of the wheel came last.",
            _age_s(known.rhythm.wall_ns),
        )
        about = "Age at which its samples are stale."
        add("rwa_wheel_telemetry_stale_after_seconds", about, known.rhythm.stale_after_s)
    if known.status is not None:
        about = "Time since the wheel's monitor reported last."
        add("rwa_monitor_status_age_seconds", about, _age_s(known.latest[Status.kind].wall_ns))
        _add_status(add, known.status)


def _age_s(wall_ns: int | None) -> float | None:
    return None if wall_ns is None else (time.time_ns() - wall_ns) / NANOSECONDS_PER_SECOND


def _add_diagnosis(add: Callable[..., None], window: Diagnosis) -> None:
    for verdict in get_args(Verdict):
        about = "1 for the verdict of the latest window, 0 for the others."
        add("rwa_wheel_verdict", about, window.verdict == verdict, verdict=verdict)
    add("rwa_wheel_model_adequate", "1 where the friction model fits the wheel.", window.model_adequate)
    add("rwa_wheel_coverage_ratio", "Share of the latest window with a good sample.", window.coverage)
    end_s = window.window_end_ns / NANOSECONDS_PER_SECOND
    add("rwa_wheel_window_end_seconds", "End of the latest window on the wheel's own clock.", end_s)
    for part, one in window.anomalies.items():
        add("rwa_wheel_anomaly_probability", "Probability that a part is anomalous.", one.probability, part=part)
        about = "0 at the nominal bound, 1 at the median of the learned anomaly."
        add("rwa_wheel_severity", about, one.severity, part=part)
        about = "Estimate of a part, in the unit that is its label."
        add("rwa_wheel_estimate", about, one.estimate, part=part, unit=one.unit)
        about = "Upper nominal bound of a part, in its unit."
        add("rwa_wheel_nominal_high", about, one.nominal_high, part=part, unit=one.unit)


def _add_status(add: Callable[..., None], status: Status) -> None:
    add("rwa_monitor_window_fill_ratio", "Share of the running window that has passed.", status.window_fill)
    add("rwa_monitor_queue_messages", "Messages that wait in the wheel's monitor.", status.queue_depth)
    add("rwa_monitor_slots_missed_total", "Slots of the wheel that no sample came for.", status.slots_missed)
    add("rwa_monitor_windows_total", "Windows of the wheel that were diagnosed.", status.windows)
    for what, about, outcomes in (
        ("samples", "Samples of the wheel by what became of them.", SAMPLES),
        ("messages", "Messages that were of no use, and why.", MESSAGES),
    ):
        for outcome in outcomes:
            add(f"rwa_monitor_{what}_total", about, getattr(status, f"{what}_{outcome}"), outcome=outcome)
