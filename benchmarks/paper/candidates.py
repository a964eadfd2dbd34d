"""Candidates of stage 1 with many kinds of noise: recall, false candidates and times, and the paper's method in numpy.

    python -m benchmarks.paper.candidates [--windows N] [--seed N]

A jump is visible when an oracle would see it (`Truth.changepoints.visible`), and found when a candidate lies within 5
samples of it. Confirmed candidates were found before the window closed. Times are medians of one run on one core.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Final

import numpy as np
from scipy import signal

from benchmarks.page import page, put_out, table
from benchmarks.paper.peers import score
from benchmarks.window import Window, window_of
from rwa_monitor.changepoints.estimation import estimate, nominal_slope_prior
from rwa_monitor.changepoints.evidence import WindowAccumulator
from rwa_monitor.paper.detection import Signal, detect
from rwa_monitor.samples import FloatArray
from rwa_monitor.simulation.datasets import generate
from rwa_monitor.simulation.record import Changepoints

Noise = Callable[[np.random.Generator, int], FloatArray]
SETTLED: Final = 200  # samples after which an autoregression has forgotten its start


def autoregression(rng: np.random.Generator, count: int) -> FloatArray:
    """Return AR(1) noise of coefficient 0.5 and variance one, float64 (count,)."""
    noise = signal.lfilter([np.sqrt(0.75)], [1.0, -0.5], rng.standard_normal(count + SETTLED))
    return np.asarray(noise[SETTLED:], dtype=np.float64)


def student(rng: np.random.Generator, count: int) -> FloatArray:
    """Return noise of Student's t with three degrees of freedom and variance one, float64 (count,)."""
    return np.asarray(rng.standard_t(3, count) / np.sqrt(3.0), dtype=np.float64)


# Recipe, and the noise that replaces the recipe's own.
SOURCES: Final[dict[str, tuple[str, Noise | None]]] = {
    "paper": ("paper", None),
    "mild": ("mild", None),
    "paper, AR(0.5)": ("paper", autoregression),
    "paper, Student t (3)": ("paper", student),
    "derived friction": ("derived", None),
    "hard": ("hard", None),
}


def windows_of(source: str, count: int, seed: int) -> Iterator[tuple[Window, Changepoints]]:
    """Simulate the windows of a source, with the true jumps of each."""
    recipe, noise = SOURCES[source]
    rng = np.random.default_rng(seed)
    for labelled in generate(recipe, count, seed):
        window, truth = window_of(labelled), labelled.telemetry.truth
        if noise is not None:
            size = window.torque_Nm.size
            # Slots of a recording may precede its first window; here both have the same length.
            other = window.torque_Nm - truth.noise_Nm[:size] + truth.noise_std_Nm * noise(rng, size)
            window = replace(window, torque_Nm=other)
        yield window, truth.changepoints


def quality(windows: Iterable[tuple[Window, Changepoints]]) -> list[str]:
    """Return recall, confirmed recall, false candidates per window, and the times [ms] of append, close and fit."""
    counts, confirmed, laps = [], [], []
    for window, truth in windows:
        accumulator = WindowAccumulator(window.wheel)
        times = [time.perf_counter()]
        events = accumulator.append(window.speed_rad_s, window.torque_Nm, window.good)
        times.append(time.perf_counter())
        evidence = accumulator.close()
        times.append(time.perf_counter())
        candidates = evidence.candidates
        estimate(evidence, candidates.index, nominal_slope_prior(window.wheel))
        times.append(time.perf_counter())
        counts.append(score(candidates.index, truth))
        confirmed.append(score(np.array([event.index for event in events], dtype=np.int64), truth)[1])
        laps.append(np.diff(times))
    visible, found, false = np.sum(counts, axis=0)
    rates = [f"{found / visible:.3f}", f"{sum(confirmed) / visible:.3f}", f"{false / len(counts):.3f}"]
    return [*rates, *(f"{1e3 * float(lap):.2f}" for lap in np.median(laps, axis=0))]


def plain_quality(windows: Iterable[tuple[Window, Changepoints]]) -> list[str]:
    """Return the same for the paper's method, which has no confirmed candidates and is not timed."""
    counts = []
    for window, truth in windows:
        evidence = window.evidence()
        counts.append(score(detect(Signal.of(evidence), evidence.noise, window.wheel), truth))
    visible, right, false = np.sum(counts, axis=0)
    return [f"{right / visible:.3f}", "", f"{false / len(counts):.3f}", "", "", ""]


def main() -> int:
    """Print the table and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--windows", type=int, default=20)
    parser.add_argument("--seed", type=int, default=101)
    options = parser.parse_args()
    rows = [
        [source, method, *measured(windows_of(source, options.windows, options.seed))]
        for source in SOURCES
        for method, measured in (("joint", quality), ("paper", plain_quality))
    ]
    header = ["windows", "method", "recall", "confirmed", "false a window", "append [ms]", "close [ms]", "fit [ms]"]
    put_out(page("Candidates of stage 1", table(header, rows)), None)
    return 0


if __name__ == "__main__":
    sys.exit(main())
