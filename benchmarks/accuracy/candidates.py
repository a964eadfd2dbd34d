"""Stages 1 and 2 measured: recall and false candidates on many noises, beside the paper's method in plain numpy.

Run it with ``python -m benchmarks.detection [--windows N] [--seed N]``. Times are medians of one run on one core; the
ratios are what counts. A jump is visible when an oracle would see it (`Truth.changepoints.visible`), found when a
candidate lies within 5 samples of it, and every candidate beyond is false, also one that found a jump inside a gap.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator

import numpy as np
from scipy import signal

from benchmarks.speed.plain_paper import changepoints as paper_changepoints
from rwa_monitor.diagnosis.estimation import default_exclusion, estimate, nominal_slope_prior
from rwa_monitor.diagnosis.evidence import WindowAccumulator
from rwa_monitor.diagnosis.results import Method
from rwa_monitor.physics.datasets import LabelledWindow, generate
from rwa_monitor.physics.torque_balance import derive_friction

TOLERANCE = 5  # slots between a jump and the candidate that found it


def gridded(window: LabelledWindow):
    """Return speed, friction and goodness on the window's slots, friction derived where it is not measured."""
    samples, wheel = window.telemetry.samples, window.wheel
    slots = wheel.window.samples
    slot = np.rint((samples.time_ns - samples.time_ns[0]) / wheel.period_ns).astype(np.int64)
    here = slot < slots
    speed = np.full(slots, np.nan)
    speed[slot[here]] = samples.speed_rad_s[here]
    torque = np.full(slots, np.nan)
    if samples.friction_torque_Nm is not None:
        torque[slot[here]] = samples.friction_torque_Nm[here]
    else:
        motor = np.full(slots, np.nan)
        motor[slot[here]] = wheel.torque_constant_Nm_A * samples.motor_current_A[here]
        torque = derive_friction(speed, motor, wheel)
    return speed, torque, np.isfinite(speed) & np.isfinite(torque)


def _with_noise(windows: Iterator[LabelledWindow], noise: Callable, seed: int):
    """Replace the noise of given friction by another of the same standard deviation."""
    rng = np.random.default_rng(seed)
    for window in windows:
        speed, torque, good = gridded(window)
        truth = window.telemetry.truth
        # A recording may begin before its first window slot counts; both grids have one length here.
        torque = torque - truth.noise_Nm[: torque.size] + truth.noise_std_Nm * noise(rng, torque.size)
        yield window, speed, torque, good


def _plain(windows):
    for window in windows:
        yield window, *gridded(window)


def _ar(rng, n):
    return signal.lfilter([np.sqrt(0.75)], [1, -0.5], rng.standard_normal(n + 200))[200:]


def _student(rng, n):
    return rng.standard_t(3, n) / np.sqrt(3)


def score(found, window):
    """Return how many visible jumps were found, how many there are, and how many candidates are false."""
    truth = window.telemetry.truth.changepoints
    jumps = np.unique(truth.index[truth.visible])
    free = list(found)
    hits = 0
    for jump in jumps:
        near = [k for k in free if abs(k - jump) <= TOLERANCE]
        if near:
            free.remove(min(near, key=lambda k: abs(k - jump)))
            hits += 1
    return hits, jumps.size, len(free)


def quality(windows, method: Method):
    """Return one row: recall, false candidates and times over the windows."""
    hits = jumps = false = confirmed = 0
    count = 0
    appends, closes, fits = [], [], []
    for window, speed, torque, good in windows:
        accumulator = WindowAccumulator(window.wheel, method)
        t0 = time.perf_counter()
        events = accumulator.append(speed, torque, good)
        t1 = time.perf_counter()
        evidence = accumulator.close()
        t2 = time.perf_counter()
        candidates = evidence.candidates
        prior = nominal_slope_prior(window.wheel)
        estimate(evidence, candidates.index, default_exclusion(candidates.scale), prior)
        t3 = time.perf_counter()
        appends.append(t1 - t0)
        closes.append(t2 - t1)
        fits.append(t3 - t2)
        h, j, f = score(candidates.index, window)
        hits, jumps, false = hits + h, jumps + j, false + f
        confirmed += score([event.index for event in events], window)[0]
        count += 1
    milliseconds = [1e3 * float(np.median(t)) for t in (appends, closes, fits)]
    return [hits / max(jumps, 1), confirmed / max(jumps, 1), false / count, *milliseconds]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--windows", type=int, default=20)
    parser.add_argument("--seed", type=int, default=101)
    options = parser.parse_args()

    count, seed = options.windows, options.seed
    columns = ("recall", "confirmed", "false/win", "append ms", "close ms", "fit ms")
    print(f"\n{'window':22} {'method':6}" + "".join(f" {name:>10}" for name in columns))
    sources = {
        "paper": lambda: _plain(generate("paper", count, seed)),
        "mild": lambda: _plain(generate("mild", count, seed)),
        "paper, AR(0.5)": lambda: _with_noise(generate("paper", count, seed), _ar, seed),
        "paper, Student t (3)": lambda: _with_noise(generate("paper", count, seed), _student, seed),
        "derived friction": lambda: _plain(generate("derived", count, seed)),
        "hard": lambda: _plain(generate("hard", count, seed)),
    }
    for name, source in sources.items():
        for method in ("joint", "paper"):
            row = quality(source(), method)
            print(f"{name:22} {method:6}" + "".join(f" {value:10.3f}" for value in row))
    hits = jumps = false = 0
    for window, speed, torque, good in sources["paper"]():
        x, z = np.abs(speed) / 300.0, np.sign(speed) * torque / 1.6e-3
        used = good & (np.abs(speed) > 1.0)
        place = np.flatnonzero(used)
        found = place[paper_changepoints(x[used], z[used], 3.9e-5 / 1.6e-3)]
        h, j, f = score(found, window)
        hits, jumps, false = hits + h, jumps + j, false + f
    print(f"{'paper':22} {'numpy':6} {hits / jumps:10.3f} {'':10} {false / count:10.3f}")


if __name__ == "__main__":
    main()
