"""Effect of an extension on the diagnosis: the same labelled windows, diagnosed without it and with it.

The windows are simulated with the effects found, half nominal, half with one anomaly each in turn, on a motion similar
to the recorded one. Seeds are fixed: the same extension gives the same rates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from rwa_monitor.discrepancy.extended import extended_wheel
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.messages import AttributedChangepoint, Diagnosis, DiagnosisGain, DiagnosisQuality
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import Changepoints, Telemetry, simulate
from rwa_monitor.simulation.scenario import Anomaly, Scenario
from rwa_monitor.wheel.wheel import Wheel

Diagnose = Callable[[Samples, Wheel], Diagnosis]
Counts = np.ndarray[Any, np.dtype[np.int64]]

SEED: Final = 41_000  # of the first window; no other part of the project uses 41,000 … 41,999
WINDOWS: Final = 16  # simulated, each diagnosed with and without the effects
PLACED_WITHIN: Final = 5  # samples between a true jump and a changepoint that reports it
# Clear anomalies, so that one is missed only because of the missing effect: those of the recipe `mild`, doubled.
FACTORS: Final = {"dry": 1.6, "viscous": 1.3}
FACTOR_OF_SYSTEMS: Final = 2.0  # the same for a switching system


def diagnosis_gain(search: Search, diagnose: Diagnose) -> DiagnosisGain | None:
    """Return detection, false-positive rate and false changepoints before and after the extension.

    None where the wheel file is too incomplete for simulation and classification, or nothing was added.

    Parameters
    ----------
    search
        A finished search.
    diagnose
        Diagnoses the samples of one window of a wheel, as the monitor does, whose package lies above this one.
    """
    wheel = search.wheel
    complete = None not in (wheel.nominal, wheel.inertia_kg_m2, wheel.torque_constant_Nm_A)
    complete &= bool(wheel.fss) and all(system.friction is not None for system in wheel.fss)
    if not search.extended.terms or not complete:
        return None
    crosses = any(np.ptp(record.channels.direction[record.used]) > 0 for record in search.problem.records)
    speed = SpeedProfile(kind="rich" if crosses else "one_direction")
    statuses = [name for anomaly in wheel.anomalies for name in ("nominal", anomaly)]
    tries = [(statuses[i % len(statuses)], SEED + i) for i in range(WINDOWS)]
    extended = extended_wheel(search)

    def diagnosed(one: tuple[str, int]) -> Counts:
        """Simulate a window with the effects in it and return the counts without and with them known, int64 (2, 5)."""
        status, seed = one
        anomalies = {} if status == "nominal" else {status: Anomaly(factor=FACTORS.get(status, FACTOR_OF_SYSTEMS))}
        scenario = Scenario(duration_s=wheel.window_s, speed=speed, anomalies=anomalies)
        made = simulate(scenario, extended, np.random.default_rng(seed))
        return np.array([_count(made, diagnose(made.samples, used), used, status) for used in (wheel, extended)])

    before, after = np.sum(search.problem.each(diagnosed, tries), axis=0)
    return DiagnosisGain(before=_rates(before), after=_rates(after))


def _count(telemetry: Telemetry, diagnosis: Diagnosis, wheel: Wheel, status: str) -> Counts:
    """Return the counts of anomalies present, those detected, anomalies absent, those reported, false changepoints."""
    active = {name for name, entry in diagnosis.anomalies.items() if entry.active}
    present = {status} - {"nominal"}
    absent = set(wheel.anomalies) - present
    false = false_changepoints(diagnosis.changepoints, telemetry.truth.changepoints)
    return np.array([len(present), len(present & active), len(absent), len(absent & active), false])


def false_changepoints(found: Sequence[AttributedChangepoint], truth: Changepoints) -> int:
    """Return how many of the changepoints that are not rejected have no true jump within `PLACED_WITHIN` samples."""
    index = np.array([changepoint.index for changepoint in found if changepoint.fss != "rejected"], dtype=np.int64)
    near = np.abs(index[:, None] - truth.index[None, :]) <= PLACED_WITHIN
    return int(index.size - near.any(axis=1).sum())


def _rates(count: Counts) -> DiagnosisQuality:
    return DiagnosisQuality(
        detection=float(count[1] / max(count[0], 1)),
        false_positive=float(count[3] / max(count[2], 1)),
        false_changepoints=float(count[4] / WINDOWS),
    )
