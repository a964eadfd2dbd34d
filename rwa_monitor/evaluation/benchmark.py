"""The accuracy benchmark: both methods and two oracles on labelled windows, beside the paper's figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final

import numpy as np

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.diagnosis.results import Method
from rwa_monitor.evaluation.accuracy import SPLITS, Accuracy, measure
from rwa_monitor.evaluation.campaign import StageTimes, outcomes, time_stages
from rwa_monitor.evaluation.outcome import JumpScore, Outcome
from rwa_monitor.physics.datasets import generate
from rwa_monitor.physics.wheel import built_in_wheel

RECIPES: Final = ("paper", "mild")
WINDOWS: Final = 300
SEED: Final = 8_128
TIMED_WINDOWS: Final = 20
# What is compared: the features and the classifier on them.
COMPARED: Final[dict[str, tuple[str, Method]]] = {
    "paper": ("paper", "paper"),
    "joint": ("joint", "joint"),
    "oracle B": ("oracle B", "joint"),
    "oracle A": ("oracle A", "joint"),
}

Progress = Callable[[Iterable[Outcome], int, str], Iterable[Outcome]]


@dataclass(frozen=True, slots=True)
class RecipeResult:
    """What came of one recipe.

    Attributes
    ----------
    recipe, windows, seed, splits
        The data set and the number of random splits.
    accuracy
        By the names of `COMPARED`.
    jumps
        By method, summed over all windows.
    rejected
        By method: for each window the number of rejected candidates.
    """

    recipe: str
    windows: int
    seed: int
    splits: int
    accuracy: dict[str, Accuracy]
    jumps: dict[str, JumpScore]
    rejected: dict[str, tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class Benchmark:
    """All results: one entry per recipe, and the time of each stage by method."""

    recipes: tuple[RecipeResult, ...]
    times: tuple[StageTimes, ...]

    def recipe(self, name: str) -> RecipeResult:
        """Return the result of one recipe; KeyError without it."""
        for result in self.recipes:
            if result.recipe == name:
                return result
        raise KeyError(name)


def _untracked(items: Iterable[Outcome], total: int, description: str) -> Iterable[Outcome]:
    del total, description
    return items


def run(
    recipes: Sequence[str] = RECIPES,
    windows: int = WINDOWS,
    seed: int = SEED,
    workers: int = 2,
    splits: int = SPLITS,
    progress: Progress = _untracked,
) -> Benchmark:
    """Run the benchmark.

    Parameters
    ----------
    recipes, windows, seed
        Data sets, windows of each, seed of each.
    workers
        Processes that evaluate windows; the accuracy does not depend on it, the times are taken in this one.
    splits
        Random splits of the paper's protocol.
    progress
        Called with the outcomes as they come, their number and a description; passes them on.
    """
    results = []
    for recipe in recipes:
        found = list(progress(outcomes(recipe, windows, seed, workers), windows, f"recipe {recipe}"))
        results.append(summarise(recipe, found, seed, splits))
    timed = list(islice(generate(recipes[0], TIMED_WINDOWS, seed), TIMED_WINDOWS))
    model = built_in_model()
    return Benchmark(tuple(results), (time_stages(timed, model, "paper"), time_stages(timed, model, "joint")))


def summarise(recipe: str, found: Sequence[Outcome], seed: int, splits: int) -> RecipeResult:
    """Return the result of one recipe from the outcomes of its windows."""
    # All wheels of a recipe have the same systems; their names are all that is needed here.
    wheel = built_in_wheel()
    if tuple(found[0].labels) != wheel.anomalies:
        wheel = next(iter(generate(recipe, 1, seed))).wheel
    return RecipeResult(
        recipe=recipe,
        windows=len(found),
        seed=seed,
        splits=splits,
        accuracy={
            name: measure(found, features, method, wheel, seed, splits) for name, (features, method) in COMPARED.items()
        },
        jumps={method: sum((one.jumps[method] for one in found), JumpScore()) for method in ("paper", "joint")},
        rejected={method: tuple(one.jumps[method].rejected for one in found) for method in ("paper", "joint")},
    )


# ---- targets ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Target:
    """One figure that the method `joint` is to reach; `least` says whether it is a lower bound."""

    name: str
    wanted: float
    reached: float
    least: bool

    @property
    def met(self) -> bool:
        """Whether it is reached."""
        return self.reached >= self.wanted if self.least else self.reached <= self.wanted


def targets(benchmark: Benchmark) -> list[Target]:
    """Return the project's targets for the recipes that were run, with what was reached."""
    found = []
    for result in benchmark.recipes:
        joint, oracle = result.accuracy["joint"], result.accuracy["oracle B"]
        jumps = result.jumps["joint"]
        name = result.recipe
        found.append(
            Target(f"{name}: visible jumps right in place and system", 0.995, jumps.attributed / jumps.visible, True)
        )
        found.append(Target(f"{name}: false changepoints per window", 0.05, jumps.false / result.windows, False))
        for anomaly in joint.anomalies:
            detected, best = detection(joint, anomaly), detection(oracle, anomaly)
            alarmed, least = false_positives(joint, anomaly), false_positives(oracle, anomaly)
            wanted = 0.985 if name == "paper" else best - 0.01
            allowed = 0.005 if name == "paper" else least + 0.005
            found.append(Target(f"{name}: detection of {anomaly}", wanted, detected, True))
            found.append(Target(f"{name}: false positives of {anomaly}", allowed, alarmed, False))
        found.append(Target(f"{name}: undecided windows", 0.02, float(joint.undecided.mean()), False))
    return found


def detection(accuracy: Accuracy, anomaly: str) -> float:
    """Return the share of windows with the anomaly in which it is diagnosed, over all statuses that contain it."""
    return _rate(accuracy, anomaly, present=True)


def false_positives(accuracy: Accuracy, anomaly: str) -> float:
    """Return the share of windows without the anomaly in which it is diagnosed."""
    return _rate(accuracy, anomaly, present=False)


def _rate(accuracy: Accuracy, anomaly: str, *, present: bool) -> float:
    a = accuracy.anomalies.index(anomaly)
    rows = [i for i, status in enumerate(accuracy.statuses) if (anomaly in status.split("+")) == present]
    shares = np.nanmean(accuracy.matrix[:, rows, a], axis=0)
    weights = accuracy.windows[rows]
    return float(np.average(shares, weights=weights))
