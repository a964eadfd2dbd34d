"""How much the state carried over from earlier windows of a wheel improves its diagnosis.

Windows are diagnosed with and without the carried state by the built-in model, which was trained on none of these
wheels. Three courses of an anomaly: present from the first window, beginning with the last window (after ten healthy
ones), and the slow growth of the recipe `fleet`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import Final, Literal

import numpy as np

from benchmarks.accuracy.campaign import in_processes
from rwa_monitor.cli.options import track
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.messages import Diagnosis
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.simulation.datasets import FLEET_WINDOWS, RECIPES, Recipe, wheel_windows
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.wheel import Wheel

EARLIER: Final = 10  # windows before the one that is judged
CourseName = Literal["lasting", "sudden", "growing"]
LASTING: Final = 2 * EARLIER  # windows of a wheel whose anomaly lasts; those after at least EARLIER others are judged
COURSES: Final[dict[CourseName, str]] = {
    "lasting": f"`mild`, {LASTING} windows a wheel, the anomaly there from the first; the last {EARLIER} are judged",
    "sudden": f"`mild`, the anomaly begins with the last of {EARLIER + 1} windows, which is judged",
    "growing": f"`fleet`, all {FLEET_WINDOWS} windows of each wheel are judged",
}


@dataclass(frozen=True, slots=True)
class JudgedWindows:
    """Diagnoses of windows with and without the state of earlier ones.

    Attributes
    ----------
    anomalies
        Their names.
    truth
        bool (windows, anomalies).
    healthy
        bool (windows, anomalies), where the anomaly has not begun. While it grows to half of its final severity, it
        counts neither as present nor as absent.
    carried, alone
        bool (windows, anomalies), the anomalies diagnosed with and without the earlier windows.
    open_carried, open_alone
        bool (windows,), whether the verdict is inconclusive.
    """

    anomalies: tuple[str, ...]
    truth: BoolArray
    healthy: BoolArray
    carried: BoolArray
    alone: BoolArray
    open_carried: BoolArray
    open_alone: BoolArray

    def rates(self, diagnosed: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return the detection rate and the false-positive rate of each anomaly, float64 (anomalies,)."""
        return (
            (diagnosed & self.truth).sum(axis=0) / np.maximum(self.truth.sum(axis=0), 1),
            (diagnosed & self.healthy).sum(axis=0) / np.maximum(self.healthy.sum(axis=0), 1),
        )


@dataclass(frozen=True, slots=True)
class _Task:
    course: CourseName
    number: int
    seed: int

    def run(self) -> list[tuple[list[bool], list[bool], list[bool], list[bool], bool, bool]]:
        """Return one row per window: the fields of `JudgedWindows` after `anomalies`, in their order."""
        recipe = _recipe(self.course)
        windows = list(wheel_windows(recipe, self.number, self.seed))
        model, state, rows = built_in_model(), CarriedState.empty(), []
        for k, window in enumerate(windows):
            samples, wheel = window.telemetry.samples, window.wheel
            (with_state,) = diagnose_samples(samples, wheel, model, carried=state)
            state = with_state.carried
            if self.course != "growing" and k < EARLIER:
                continue
            (without,) = diagnose_samples(samples, wheel, model)
            rows.append(
                (
                    list(window.labels.values()),
                    [factor == 1.0 for factor in window.telemetry.truth.factors.values()],
                    _diagnosed(with_state.diagnosis, model.undecided[1]),
                    _diagnosed(without.diagnosis, model.undecided[1]),
                    with_state.diagnosis.verdict == "inconclusive",
                    without.diagnosis.verdict == "inconclusive",
                )
            )
        return rows


def _diagnosed(diagnosis: Diagnosis, least: float) -> list[bool]:
    return [anomaly.active and anomaly.probability >= least for anomaly in diagnosis.anomalies.values()]


def _recipe(course: CourseName) -> Recipe:
    if course == "growing":
        return RECIPES["fleet"]
    mild = RECIPES["mild"]
    if course == "lasting":
        return Recipe("lasting", mild.wheel, mild.scenario, windows=LASTING)

    def sudden(wheel: Wheel, number: int, windows: int, rng: np.random.Generator) -> Scenario:
        scenario = mild.scenario(wheel, number, windows, rng)
        onset = EARLIER * wheel.window.samples * wheel.sample_period_s
        late = {name: anomaly.model_copy(update={"onset_s": onset}) for name, anomaly in scenario.anomalies.items()}
        return scenario.model_copy(update={"anomalies": late})

    return Recipe("sudden", mild.wheel, sudden, windows=EARLIER + 1)


def judge_course(course: CourseName, wheels: int, seed: int, workers: int) -> JudgedWindows:
    """Judge the windows of a course.

    Parameters
    ----------
    course
        One of `COURSES`.
    wheels, seed
        How many wheels, and the seed of all randomness.
    workers
        Processes; 0 works in this one. The result does not depend on it.
    """
    tasks = [_Task(course, number, seed) for number in range(wheels)]
    rows = list(chain.from_iterable(track(in_processes(_Task.run, tasks, workers), wheels, f"course {course}")))
    columns = [np.array(column, dtype=np.bool_) for column in zip(*rows, strict=True)]
    return JudgedWindows(next(wheel_windows("mild", 0, seed)).wheel.anomalies, *columns)
