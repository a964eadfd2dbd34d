"""Stages 1 and 2 measured: time beside the paper's method in plain numpy, recall and false candidates on many noises.

Run it with ``python -m benchmarks.detection [--windows N] [--seed N]``. Times are medians of one run on one core; the
ratios are what counts. A jump is visible when an oracle would see it (`Truth.changepoints.visible`), found when a
candidate lies within 5 samples of it, and every candidate beyond is false, also one that found a jump inside a gap.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator

import numba
import numpy as np
from scipy import signal, stats

from rwa_monitor.diagnosis.estimation import default_exclusion, estimate, nominal_slope_prior
from rwa_monitor.diagnosis.evidence import JOINT_SCALES, WindowAccumulator
from rwa_monitor.diagnosis.results import Method
from rwa_monitor.diagnosis.wglr import wglr
from rwa_monitor.physics.datasets import LabelledWindow, generate
from rwa_monitor.physics.torque_balance import derive_friction

TOLERANCE = 5  # slots between a jump and the candidate that found it
PAPER_SCALE = 50
PAPER_WEIGHT = 1e-4


def paper_wglr(x, z, w=PAPER_SCALE, weight=PAPER_WEIGHT, slope=1.0):
    """Compute the paper's wGLR at one scale as one would write it in numpy: cumulative sums and two fits."""
    e = z - slope * x
    sums = [np.concatenate(([0.0], np.cumsum(v))) for v in (x, e, x * x, x * e, e * e)]
    k = np.arange(w, x.size - w + 1)

    def squared_error(parts):
        sxx, sxe, see = weight, 0.0, 0.0
        for a, b in parts:
            sx, se, xx, xe, ee = (s[b] - s[a] for s in sums)
            n = b - a
            sxx, sxe, see = sxx + xx - sx * sx / n, sxe + xe - sx * se / n, see + ee - se * se / n
        return see - sxe * sxe / sxx

    return squared_error([(k - w, k + w)]) - squared_error([(k - w, k), (k, k + w)])


def paper_changepoints(x, z, sigma):
    """Return the maxima of the contiguous runs above the paper's threshold, in plain numpy."""
    statistic = np.pad(paper_wglr(x, z) / sigma**2, (PAPER_SCALE, PAPER_SCALE - 1))
    above = np.concatenate(([False], statistic > stats.chi2(1).isf(1e-9), [False]))
    edges = np.flatnonzero(np.diff(above.astype(np.int8)))
    return np.array([a + np.argmax(statistic[a:b]) for a, b in edges.reshape(-1, 2)], dtype=np.int64)


@numba.njit(cache=True)
def _five_sums(x, z, out):
    sx = sz = sxx = sxz = szz = 0.0
    for k in range(x.size):
        sx += x[k]
        sz += z[k]
        sxx += x[k] * x[k]
        sxz += x[k] * z[k]
        szz += z[k] * z[k]
        out[0, k], out[1, k], out[2, k], out[3, k], out[4, k] = sx, sz, sxx, sxz, szz


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


def _best(run, repeats=9):
    times = []
    run()
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times))


def speed_table(seed):
    """Print the time for 80,000 samples of each piece."""
    window = next(generate("paper", 1, seed))
    speed, torque, good = gridded(window)
    x, z = np.abs(speed) / 300.0, np.sign(speed) * torque / 1.6e-3
    used, out = good & (np.abs(speed) > 1.0), np.empty((5, x.size))

    def gather(step):
        accumulator = WindowAccumulator(window.wheel)
        for start in range(0, x.size, step):
            part = slice(start, start + step)
            accumulator.append(speed[part], torque[part], good[part])
        return accumulator

    rows = [
        ("five sequential running sums, compiled (the limit)", _best(lambda: _five_sums(x, z, out))),
        ("the paper's wGLR, one scale, plain numpy", _best(lambda: paper_wglr(x, z))),
        ("ours, one scale w = 2, whole array", _best(lambda: wglr(x, z, used, 2, 1e-2, 1.0))),
        ("ours, one scale w = 128, whole array", _best(lambda: wglr(x, z, used, 128, 1e-2, 1.0))),
        (f"ours, {len(JOINT_SCALES)} scales with sums, noise, peaks: at once", _best(lambda: gather(x.size))),
        ("the same in batches of 256", _best(lambda: gather(256))),
        ("the same in batches of 64", _best(lambda: gather(64))),
        ("close of the window", _best(lambda: gather(x.size).close()) - _best(lambda: gather(x.size))),
    ]
    print(f"{'80,000 samples':58} {'ms':>8} {'ns/sample':>10}")
    for name, milliseconds in rows:
        print(f"{name:58} {milliseconds:8.2f} {milliseconds * 1e6 / x.size:10.1f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--windows", type=int, default=20)
    parser.add_argument("--seed", type=int, default=101)
    options = parser.parse_args()

    speed_table(options.seed)

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
