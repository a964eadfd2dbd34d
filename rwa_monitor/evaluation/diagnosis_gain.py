"""What an extension does to the diagnosis: the same labelled windows, diagnosed without it and with it.

The windows are simulated with the effects found in them, half nominal, half with one anomaly in turn, on a motion like
the recorded one. Seeds are fixed: the same extension gives the same rates.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from rwa_monitor.diagnosis.model import Model
from rwa_monitor.discrepancy.find import Search, extended_wheel
from rwa_monitor.discrepancy.result import DiagnosisGain, Rates
from rwa_monitor.live.core import diagnose_samples
from rwa_monitor.physics.scenario import Anomaly, Scenario
from rwa_monitor.physics.speed import SpeedProfile
from rwa_monitor.physics.telemetry import simulate
from rwa_monitor.physics.wheel import Wheel

SEED: Final = 41_000  # of the first window; no other part of the project uses 41,000 … 41,999
WINDOWS: Final = 16
# Clear anomalies, so that what is lost is lost to the missing effect: those of the data set recipe `mild`, doubled.
FACTORS: Final = {"dry": 1.6, "viscous": 1.3}
FACTOR_OF_SYSTEMS: Final = 2.0


def diagnosis_gain(
    search: Search, model: Model | None, progress: Callable[[str], None], windows: int = WINDOWS
) -> DiagnosisGain | None:
    """Return detection and false-positive rates before and after the extension.

    None where the wheel's file does not allow it to be simulated and classified, or nothing was added.

    Parameters
    ----------
    search
        A finished search.
    model
        The classifiers.
    progress
        Called with a word on each window.
    windows
        How many windows are simulated.
    """
    wheel, extended = search.wheel, extended_wheel(search)
    complete = None not in (wheel.nominal, wheel.inertia_kg_m2, wheel.torque_constant_Nm_A)
    if not search.extended.terms or model is None or not complete or not wheel.fss:
        return None
    if any(system.friction is None for system in wheel.fss):
        return None
    crosses = any(np.ptp(record.channels.direction[record.used]) > 0 for record in search.problem.records)
    speed = SpeedProfile(kind="rich" if crosses else "one_direction")
    statuses = [name for anomaly in wheel.anomalies for name in ("nominal", anomaly)]
    counts = {"before": np.zeros(4, dtype=np.int64), "after": np.zeros(4, dtype=np.int64)}
    for i in range(windows):
        progress(f"window {i + 1} of {windows}")
        status = statuses[i % len(statuses)]
        anomalies = {} if status == "nominal" else {status: Anomaly(factor=FACTORS.get(status, FACTOR_OF_SYSTEMS))}
        duration_s = wheel.window.samples * wheel.sample_period_s
        scenario = Scenario(duration_s=duration_s, speed=speed, anomalies=anomalies)
        samples = simulate(scenario, extended, np.random.default_rng(SEED + i)).samples
        for when, used in (("before", wheel), ("after", extended)):
            active = next(iter(diagnose_samples(samples, used, model))).diagnosis
            counts[when] += _count(used, {entry.name for entry in active.anomalies if entry.active}, status)
    return DiagnosisGain(_rates(counts["before"]), _rates(counts["after"]))


def _count(wheel: Wheel, active: set[str], status: str) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return anomalies present, those detected, anomalies absent, those named all the same."""
    present = {status} - {"nominal"}
    absent = set(wheel.anomalies) - present
    return np.array([len(present), len(present & active), len(absent), len(absent & active)])


def _rates(count: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Rates:
    return Rates(float(count[1] / max(count[0], 1)), float(count[3] / max(count[2], 1)))
