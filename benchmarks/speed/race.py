"""Times several ways of doing the same work in turns, so that other load on the machine affects all of them alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

import numpy as np

from rwa_monitor.samples import FloatArray

Role = Literal["ours", "peer", "limit"]
ROUNDS: Final = 15


@dataclass(frozen=True, slots=True)
class Runner:
    """One way of doing the work.

    Attributes
    ----------
    name, role
        Its name, and whether it is ours, a peer's, or a lower limit of the time.
    run
        Does the work once.
    rounds
        Largest number of rounds in which it takes part: slow runners need fewer.
    """

    name: str
    role: Role
    run: Callable[[], object]
    rounds: int = ROUNDS


@dataclass(frozen=True, slots=True)
class Lap:
    """Times of a runner: median, quartiles and minimum [s], and number of runs."""

    name: str
    role: Role
    median_s: float
    low_s: float
    high_s: float
    least_s: float
    runs: int

    @classmethod
    def of(cls, name: str, role: Role, seconds: Sequence[float] | FloatArray) -> Lap:
        """Summarise the times of one runner."""
        low, median, high = (float(value) for value in np.percentile(seconds, (25, 50, 75)))
        return cls(name, role, median, low, high, float(np.min(seconds)), len(seconds))

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON content."""
        return asdict(self)


def race(runners: Sequence[Runner], rounds: int = ROUNDS) -> dict[str, FloatArray]:
    """Run all of them in turns.

    Parameters
    ----------
    runners
        Each is run once before, untimed: to compile, and to load its data into the caches.
    rounds
        Number of rounds.

    Returns
    -------
    dict
        For each runner its times [s], float64 (runs,), in the order of the rounds.
    """
    seconds: dict[str, list[float]] = {runner.name: [] for runner in runners}
    for runner in runners:
        runner.run()
    for turn in range(rounds):
        for runner in runners:
            if turn < runner.rounds:
                begin = time.thread_time()
                runner.run()
                seconds[runner.name].append(time.thread_time() - begin)
    return {name: np.array(times) for name, times in seconds.items()}


def laps(runners: Sequence[Runner], rounds: int = ROUNDS) -> list[Lap]:
    """Run all of them in turns and summarise each."""
    seconds = race(runners, rounds)
    return [Lap.of(runner.name, runner.role, seconds[runner.name]) for runner in runners]
