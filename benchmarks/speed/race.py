"""Times several ways of doing one thing in turns, so that whatever else the machine does hits all of them alike."""

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
    """One way of doing the thing.

    Attributes
    ----------
    name, role
        What it is, and whether it is ours, a peer's, or a limit that nothing can beat.
    run
        Does it once.
    rounds
        In how many rounds it takes part at most; what takes seconds need not run often.
    """

    name: str
    role: Role
    run: Callable[[], object]
    rounds: int = ROUNDS


@dataclass(frozen=True, slots=True)
class Lap:
    """What a runner took: median, the quartiles around it, the least, in seconds, of so many runs."""

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
        """Return it as plain content."""
        return asdict(self)


def race(runners: Sequence[Runner], rounds: int = ROUNDS) -> dict[str, FloatArray]:
    """Run all of them in turns.

    Parameters
    ----------
    runners
        Each is run once before, uncounted: to compile, and to bring its data into the caches.
    rounds
        How often.

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
