"""How much accuracy is lost where a wheel's laws are learned by `identify` instead of given.

For each wheel, healthy recordings are simulated, from which its switching systems are identified; then windows of the
recipe `mild`, which are diagnosed twice by the built-in model: with the true laws and with the identified ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.accuracy.campaign import in_processes
from benchmarks.accuracy.outcome import JumpScore, score_jumps
from rwa_monitor.cli.options import track
from rwa_monitor.diagnosis.model import Model, built_in_model
from rwa_monitor.errors import InputError
from rwa_monitor.identification.identify import identify
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.samples import BoolArray, Samples
from rwa_monitor.simulation.datasets import RECIPES, LabelledWindow, Recipe, wheel_windows
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.wheel import FrictionRange, Wheel

RECORDINGS: Final = 8  # healthy windows from which a wheel is identified
WINDOWS: Final = 25  # windows of each wheel that are diagnosed: each status five times


@dataclass(frozen=True, slots=True)
class LawsResult:
    """Diagnoses of the same windows with true and with identified laws.

    Attributes
    ----------
    anomalies
        Their names.
    wheels, refused, misread
        Number of wheels; of those for which `identify` reports too little data; of those whose systems are identified
        with another number of configurations. Windows of the last two groups are not diagnosed.
    truth, with_true, with_identified
        bool (windows, anomalies).
    jumps_true, jumps_identified
        Changepoints, summed over the windows.
    """

    anomalies: tuple[str, ...]
    wheels: int
    refused: int
    misread: int
    truth: BoolArray
    with_true: BoolArray
    with_identified: BoolArray
    jumps_true: JumpScore
    jumps_identified: JumpScore


@dataclass(frozen=True, slots=True)
class _Wheel:
    """Results on one wheel; `failed` states why there are none, else it is empty."""

    failed: str
    rows: list[tuple[list[bool], list[bool], list[bool]]]
    jumps_true: JumpScore
    jumps_identified: JumpScore


@dataclass(frozen=True, slots=True)
class _Task:
    number: int
    seed: int

    def run(self) -> _Wheel:
        """Identify the laws of one wheel, and diagnose its windows with the true and the identified ones."""
        model = built_in_model()
        mild = RECIPES["mild"]
        # The same seed and number draw the same wheel; its recordings and windows then differ by their length.
        healthy = Recipe("healthy", mild.wheel, _healthy, windows=RECORDINGS)
        recordings = list(wheel_windows(healthy, self.number, self.seed))
        wheel = recordings[0].wheel
        none = JumpScore()
        try:
            found = identify([(one.name, one.telemetry.samples) for one in recordings], wheel)
        except InputError:
            return _Wheel("refused", [], none, none)
        learned = _with_laws(wheel, found.wheel)
        if learned is None:
            return _Wheel("misread", [], none, none)
        rows, jumps_true, jumps_identified = [], none, none
        for k in range(WINDOWS):
            window = self._window(wheel, k)
            truth = window.telemetry.truth
            seen = []
            for laws in (wheel, learned):
                active, jumps = _diagnose(window.telemetry.samples, laws, model, window)
                seen.append(active)
                if laws is wheel:
                    jumps_true += jumps
                else:
                    jumps_identified += jumps
            rows.append((list(truth.labels.values()), seen[0], seen[1]))
        return _Wheel("", rows, jumps_true, jumps_identified)

    def _window(self, wheel: Wheel, k: int) -> LabelledWindow:
        """Simulate the k-th window of a wheel; statuses alternate with k."""
        mild = RECIPES["mild"]
        fixed = Recipe("window", lambda _: wheel, mild.scenario)
        return next(wheel_windows(fixed, k, self.seed + 1 + self.number))


def _healthy(wheel: Wheel, number: int, windows: int, rng: np.random.Generator) -> Scenario:
    """Return the scenario of a wheel of `mild` without its anomalies."""
    return RECIPES["mild"].scenario(wheel, number, windows, rng).model_copy(update={"anomalies": {}})


def _with_laws(wheel: Wheel, found: Wheel) -> Wheel | None:
    """Return the wheel with the switching systems found, matched by their number of configurations; None if unlike."""
    assert wheel.nominal is not None
    assert found.nominal is not None
    scale = found.nominal.dry_torque_Nm / wheel.nominal.dry_torque_Nm
    by_size = {system.configurations: system for system in found.fss}
    if len(by_size) != len(wheel.fss) or {system.configurations for system in wheel.fss} != set(by_size):
        return None
    systems = []
    for system in wheel.fss:
        learned = by_size[system.configurations]
        assert learned.friction is not None
        friction = tuple(FrictionRange(low=scale * band.low, high=scale * band.high) for band in learned.friction)
        systems.append(learned.model_copy(update={"name": system.name, "friction": friction}))
    return wheel.model_copy(update={"fss": tuple(systems)})


def _diagnose(samples: Samples, wheel: Wheel, model: Model, window: LabelledWindow) -> tuple[list[bool], JumpScore]:
    (event,) = diagnose_samples(samples, wheel, model)
    truth = window.telemetry.truth
    diagnosed = [one.active and one.probability >= model.undecided[1] for one in event.diagnosis.anomalies.values()]
    return diagnosed, score_jumps(event.diagnosis.changepoints, truth.changepoints, window.wheel, truth.used)


def compare_laws(wheels: int, seed: int, workers: int) -> LawsResult:
    """Diagnose with true and with identified laws.

    Parameters
    ----------
    wheels, seed
        How many wheels, and the seed of all randomness.
    workers
        Processes; 0 works in this one. The result does not depend on it.
    """
    tasks = [_Task(number, seed) for number in range(wheels)]
    found = list(track(in_processes(_Task.run, tasks, workers), wheels, "identified laws"))
    rows = [row for one in found for row in one.rows]
    truth, with_true, with_identified = (np.array(column, dtype=np.bool_) for column in zip(*rows, strict=True))
    return LawsResult(
        next(wheel_windows("mild", 0, seed)).wheel.anomalies,
        wheels,
        sum(one.failed == "refused" for one in found),
        sum(one.failed == "misread" for one in found),
        truth,
        with_true,
        with_identified,
        sum((one.jumps_true for one in found), JumpScore()),
        sum((one.jumps_identified for one in found), JumpScore()),
    )
