"""Runs the parts of the speed benchmark one after the other and compares them with the targets."""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from dataclasses import replace
from typing import Final

import numpy as np

from benchmarks.machine import describe_machine
from benchmarks.speed import detection, live
from benchmarks.speed.detection import detection_laps
from benchmarks.speed.peers import installed
from benchmarks.speed.race import Lap
from benchmarks.speed.report import MILLI, Section, SpeedReport
from benchmarks.speed.search import search_costs, search_section
from benchmarks.speed.windows import HardWindow, WindowTimes, time_hard_window, time_windows
from benchmarks.target import at_least, at_most
from benchmarks.window import window_of
from rwa_monitor.cli.options import track
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.simulation.datasets import generate
from rwa_monitor.wheel.wheel import built_in_wheel

WINDOWS: Final = 1_000
SEED: Final = 8_129
RECIPE: Final = "paper"
HELP_RUNS: Final = 7
LENGTHS: Final = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)  # samples
STREAM_WINDOWS: Final = 8  # of one simulated wheel, after which the stream of samples repeats
FIRST_LENGTH: Final = 100_000
FLAT: Final = 2.0  # largest ratio of costs per sample that counts as constant: a long run also diagnoses
STEP_SAMPLES: Final = 80_000
PIPE_MESSAGES: Final = 4_000
PIPE_ROUNDS: Final = 3
FLEET: Final = 4_096  # wheels
MEMORIES: Final = ((64, False), (512, False), (64, True))  # wheels, all channels
NANO: Final = 1e9
MEGA: Final = 1e6
FORBIDDEN_AT_HELP: Final = ("sklearn", "starlette", "uvicorn")


def run(windows: int = WINDOWS, seed: int = SEED) -> SpeedReport:
    """Run the benchmark.

    Parameters
    ----------
    windows
        Windows of recipe `paper` that are diagnosed.
    seed
        Seed of these windows, and of the hard window.
    """
    machine = describe_machine()
    missing: list[str] = []
    peers = installed(missing.append)
    fastest = next((peer for peer in peers if peer.name == "skchange FPOP"), None)
    first = window_of(next(iter(generate(RECIPE, 1, seed))))
    model = built_in_model()
    times = time_windows(track(generate(RECIPE, windows, seed), windows, "windows"), model, fastest)
    live_window = replace(first, wheel=built_in_wheel())  # the monitor's window, whatever the recipe's wheel is
    stream = live.stream_of(built_in_wheel(), STREAM_WINDOWS, np.random.default_rng(seed))
    sections = (
        detection_section(detection_laps(first, peers)),
        window_section(times, time_hard_window(built_in_wheel(), model, seed)),
        step_section(live.step_laps(live_window, model), live.cost_by_length(stream, model, LENGTHS)),
        pipe_section(*live.race_pipes(live_window, PIPE_MESSAGES, PIPE_ROUNDS)),
        memory_section([live.memory_of(live_window, count, all_channels=every) for count, every in MEMORIES]),
        search_section(search_costs()),
        help_section(),
    )
    return SpeedReport(machine, {"windows": windows, "seed": seed}, sections, tuple(missing))


def detection_section(laps: list[Lap]) -> Section:
    """Compare the kernels with limits and peers."""
    median = {lap.name: lap.median_s for lap in laps}
    one, seven = median[detection.OURS_ONE], median[detection.OURS_SEVEN]
    plain, limit = median[detection.PLAIN], median[detection.LIMIT]
    return Section(
        title="Changepoint detection, one window of 80,000 samples",
        text="Peers are given the viscous slope and the noise, which ours finds.",
        targets=(
            at_most(
                "wGLR at seven scales / plain numpy wGLR at one",
                seven / plain,
                1.0,
                f"{MILLI * seven:.2f} ms, {MILLI * plain:.1f} ms",
            ),
            at_most(
                "wGLR at one scale / five sequential running sums",
                one / limit,
                2.0,
                f"{MILLI * one:.2f} ms, {MILLI * limit:.2f} ms",
            ),
        ),
        laps=tuple(laps),
    )


def window_section(times: WindowTimes, hard: HardWindow) -> Section:
    """Compare whole windows with the plain method and the fastest peer."""
    median = float(np.median(times.close))
    tail = float(np.percentile(times.close, 99))
    allowed = 0.25 * float(np.median(times.kernel)) + 0.003
    both = np.isfinite(times.plain)
    whole, plain = times.whole[both], times.plain[both]
    peer = times.fastest_peer[np.isfinite(times.fastest_peer)]
    peer_median = float(np.median(peer)) if peer.size else np.nan
    return Section(
        title="Whole windows",
        text=(
            f"{times.close.size} windows of recipe `{RECIPE}`; every fifth also by the paper's method in plain numpy "
            "and Python, and by skchange's FPOP, which finds changepoints only. The hard window has "
            f"{hard.candidates} candidates and {hard.systems} switching systems that nothing distinguishes: the search "
            + ("reports that it pruned." if hard.pruned else "is exact.")
        ),
        targets=(
            at_most(
                "window close → diagnosis, median / (¼ seven-scale wGLR + 3 ms)",
                median / allowed,
                1.0,
                f"{MILLI * median:.2f} ms, {MILLI * allowed:.2f} ms",
            ),
            at_most(
                "window close → diagnosis, 99th percentile / median",
                tail / median,
                4.0,
                f"{MILLI * tail:.2f} ms, most {MILLI * times.close.max():.1f} ms",
            ),
            at_most(
                f"{hard.candidates} candidates, {hard.systems} systems / median window",
                hard.seconds / median,
                100.0,
                f"{MILLI * hard.seconds:.0f} ms, {hard.states} states, "
                + ("pruned and reports it" if hard.pruned else "exact"),
            ),
            at_most(
                "whole window / changepoints alone by skchange FPOP",
                float(np.median(times.whole)) / peer_median,
                1.0,
                f"{MILLI * float(np.median(times.whole)):.2f} ms, {MILLI * peer_median:.2f} ms",
            ),
        ),
        figures={
            "stage 1 while samples come in, median [ms]": MILLI * float(np.median(times.gather)),
            "close → diagnosis, median [ms]": MILLI * median,
            "close → diagnosis, 90th percentile [ms]": MILLI * float(np.percentile(times.close, 90)),
            "plain paper method, median [ms]": MILLI * float(np.median(plain)),
            "the same with its wGLR by our kernel, median [ms]": MILLI * float(np.median(times.compiled[both])),
            "the same with its wGLR by our kernel, mean [ms]": MILLI * float(times.compiled[both].mean()),
            "plain paper method, mean [ms]": MILLI * float(plain.mean()),
            "plain paper method, 99th percentile [ms]": MILLI * float(np.percentile(plain, 99)),
            "plain paper method / ours, whole window, ratio of medians": float(np.median(plain) / np.median(whole)),
            "plain paper method / ours, whole window, ratio of means": float(plain.mean() / whole.mean()),
        },
    )


def step_section(laps: list[Lap], cost: dict[int, float]) -> Section:
    """Compare the incremental step with the same work at once, and its cost over the number of samples."""
    median = {lap.name: lap.median_s for lap in laps}
    step, at_once = median[live.STEP_BATCH], median[live.STEP_AT_ONCE]
    # The first window mostly learns and contains no close; from 100,000 samples on the mean includes both.
    long = [seconds for length, seconds in cost.items() if length >= FIRST_LENGTH]
    return Section(
        title=f"The incremental step, batches of {live.BATCH}",
        text=(
            "A window that stays open: what of a batch is Python around the kernels shows as the difference between "
            "the lines. The figures below are of one core from its first sample, windows closed and diagnosed, fed "
            f"with {STREAM_WINDOWS} windows of one simulated wheel again and again; of the two shortest the least of "
            f"{live.REPEATED} new cores. All that these windows need is loaded before."
        ),
        targets=(
            at_most(
                f"incremental step at batches of {live.BATCH} / the same core at once, per sample",
                step / at_once,
                4.0,
                f"{step / STEP_SAMPLES * NANO:.0f} ns, {at_once / STEP_SAMPLES * NANO:.0f} ns a sample; "
                f"stage 1 alone {median[live.STEP_STAGE] / STEP_SAMPLES * NANO:.0f} ns, "
                f"seven-scale kernel alone {median[live.STEP_KERNEL] / STEP_SAMPLES * NANO:.0f} ns",
            ),
            at_most(
                "cost per sample from 10³ to 10⁷ samples, most / least",
                max(cost.values()) / min(cost.values()),
                FLAT,
                ", ".join(f"{length:.0e}: {seconds * NANO:.0f} ns" for length, seconds in cost.items()),
            ),
        ),
        laps=tuple(laps),
        figures={"most / least from 10⁵ samples on": max(long) / min(long)},
    )


def pipe_section(bare: list[live.PipeRate], ours: list[live.PipeRate]) -> Section:
    """Compare the path from the bus to the recording with a pipe that computes nothing."""
    # The best of each: a run is slower only by other load on the machine.
    rates = [max(one.rate for one in found) for found in (bare, ours)]
    by_the_clock = [max(one.recorded / one.seconds for one in found) for found in (bare, ours)]
    lost = sum(one.sent - one.recorded for one in (*bare, *ours))
    account = "; ".join(one.account for one in ours if one.account)
    return Section(
        title="From the bus to the recording",
        text=(
            f"{PIPE_MESSAGES} messages of {live.BATCH} samples over TCP from a process of its own, {PIPE_ROUNDS} times "
            "in turns, the best of each, by the serving thread's processor time. The bare pipe reads each message's "
            "JSON with Python's parser and writes it to an MCAP file with the writer's defaults; the monitor checks, "
            "records, guards, detects, diagnoses, records and publishes."
        ),
        targets=(
            at_least(
                "bus → recording / bare Zenoh → JSON → MCAP pipe, samples a second",
                rates[1] / rates[0],
                0.5,
                f"{rates[1]:,.0f} a second, {rates[0]:,.0f} a second",
            ),
            at_least(
                "the same by the clock",
                by_the_clock[1] / by_the_clock[0],
                0.5,
                f"{by_the_clock[1]:,.0f} a second, {by_the_clock[0]:,.0f} a second",
            ),
            at_most(
                "samples lost on the way",
                float(lost),
                0.0,
                f"{lost} of {len(ours)} runs{account and f' ({account})'}",
            ),
        ),
        figures={
            "bus → recording, samples a second": rates[1],
            "bare pipe, samples a second": rates[0],
        },
    )


def memory_section(found: list[live.Memory | None]) -> Section:
    """Compare the memory of a wheel with the targets."""
    measured = [one for one in found if one is not None]
    by_channels = {every: [one for one in measured if one.all_channels is every] for every in (False, True)}
    targets = []
    for every, bound in ((False, 3.0), (True, 6.0)):
        name = "all channels" if every else "the required channels"
        most = max((one.of_a_wheel for one in by_channels[every]), default=np.nan) / MEGA
        targets.append(
            at_most(
                f"memory of one wheel with {name} [MB]",
                most,
                bound,
                ", ".join(f"{one.wheels} wheels: {one.of_a_wheel / MEGA:.2f} MB" for one in by_channels[every])
                or "resident memory cannot be read here",
            )
        )
    few, many = (by_channels[False] + [None, None])[:2]
    if few is not None and many is not None:
        whole = (many.empty + FLEET * many.of_a_wheel) / MEGA / 1e3
        targets += [
            at_most(
                f"memory of {FLEET} wheels in one process [GB], from {many.wheels}",
                whole,
                13.0,
                f"{many.empty / MEGA:.0f} MB and {many.of_a_wheel / MEGA:.2f} MB a wheel",
            ),
            at_most(
                f"memory of a wheel, {many.wheels} / {few.wheels} wheels (linear)",
                many.of_a_wheel / few.of_a_wheel,
                1.1,
                f"{many.of_a_wheel / MEGA:.2f} MB, {few.of_a_wheel / MEGA:.2f} MB",
            ),
        ]
    return Section(
        title="Memory",
        text=(
            "Resident memory of a process with so many cores, each with an 80,000 window nearly full, less that of the "
            f"same process before, over their number. {FLEET} wheels are extrapolated from the largest number measured."
        ),
        targets=tuple(targets),
    )


def help_section() -> Section:
    """Time `--help` in separate processes, and list the heavy packages that it imports."""
    seconds, busy_s = [], []
    for _ in range(HELP_RUNS):
        begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-m", "rwa_monitor", "--help"], check=True, capture_output=True)
        seconds.append(time.perf_counter() - begin)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        busy_s.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    heavy = imported_at_help()
    return Section(
        title="`--help`",
        text="Imports on that way of "
        + ", ".join(FORBIDDEN_AT_HELP)
        + (": none." if not heavy else f": {', '.join(heavy)}."),
        targets=(
            at_most(
                f"`--help`, processor time, median of {HELP_RUNS} [s]",
                float(np.median(busy_s)),
                0.3,
                f"by the clock {min(seconds):.2f} to {max(seconds):.2f} s",
            ),
            at_most(
                "heavy packages imported by `--help`",
                float(len(heavy)),
                0.0,
                ", ".join(heavy) or "none",
            ),
        ),
    )


def imported_at_help() -> list[str]:
    """Return which of the heavy packages are imported when the help is shown, in a separate process."""
    code = (
        "import sys\n"
        "from rwa_monitor.cli.main import main\n"
        "main(['--help'], standalone_mode=False)\n"
        f"print([name for name in {FORBIDDEN_AT_HELP!r} if name in sys.modules], file=sys.stderr)\n"
    )
    found = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return [name for name in FORBIDDEN_AT_HELP if repr(name) in found.stderr]
