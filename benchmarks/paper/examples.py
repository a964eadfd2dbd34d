"""Jumps placed and attributed on windows of the paper's Examples 1 and 2: both methods in one table.

    python -m benchmarks.paper.examples [--windows N] [--seed N] [-o FILE]

80,000 samples, σ = 0.024, the built-in wheel, half of the windows in one direction of rotation (either sign), half
crossing zero both ways. Exit code 1 where `joint` misses a target.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

import numpy as np

from benchmarks.accuracy.outcome import JumpScore, only_window, score_jumps
from benchmarks.page import add_output_option, counted, page, put_out, table
from benchmarks.target import at_least, at_most, exit_code
from rwa_monitor.messages import Method
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import Telemetry, simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.wheel import built_in_wheel

WANTED_RIGHT, WANTED_FALSE = 0.99, 0.1
METHODS: tuple[Method, ...] = ("paper", "joint")


def windows(count: int, seed: int) -> Iterator[Telemetry]:
    """Simulate the windows."""
    for i in range(count):
        scenario = Scenario(speed=SpeedProfile(kind=("orbit", "one_direction")[i % 2]))
        yield simulate(scenario, built_in_wheel(), np.random.default_rng((seed, i)))


def main() -> int:
    """Run both methods, write the page, return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--windows", type=int, default=100)
    parser.add_argument("--seed", type=int, default=40)
    add_output_option(parser)
    options = parser.parse_args()
    wheel = built_in_wheel()
    scores = dict.fromkeys(METHODS, JumpScore())
    for telemetry in windows(options.windows, options.seed):
        for method in METHODS:
            diagnosis = only_window(telemetry.samples, wheel, method, "examples").diagnosis
            scores[method] += score_jumps(diagnosis.changepoints, telemetry.truth.changepoints, wheel)
    rows = [
        [
            f"`{method}`",
            f"{score.placed} of {score.visible}",
            counted(score.attributed, score.visible, 2),
            f"{score.false / options.windows:.2f}",
        ]
        for method, score in scores.items()
    ]
    introduction = (
        f"Made by `python -m benchmarks.paper.examples --windows {options.windows} --seed {options.seed}`: windows of "
        "80,000 samples, σ = 0.024,\nhalf in one direction of rotation, half crossing zero both ways. A visible jump "
        "counts as placed within 5 samples, and\nas right on its switching system besides. 95 % interval in brackets."
    )
    results = table(["method", "placed", "right in place and system", "false per window"], rows)
    put_out(page("Jumps on the paper's Examples 1 and 2", introduction, results), options.output)
    joint = scores["joint"]
    right = at_least("jumps right in place and system", joint.attributed / joint.visible, WANTED_RIGHT)
    return exit_code([right, at_most("false changepoints per window", joint.false / options.windows, WANTED_FALSE)])


if __name__ == "__main__":
    sys.exit(main())
