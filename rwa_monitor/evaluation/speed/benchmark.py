"""Runs the parts of the speed benchmark one after the other and holds them against the targets."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from itertools import islice
from typing import Final

import numpy as np

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.evaluation.speed import detection
from rwa_monitor.evaluation.speed.detection import detection_laps
from rwa_monitor.evaluation.speed.machine import describe_machine
from rwa_monitor.evaluation.speed.peers import installed
from rwa_monitor.evaluation.speed.race import Lap
from rwa_monitor.evaluation.speed.report import MILLI, Section, SpeedReport, Target
from rwa_monitor.evaluation.speed.windows import HardWindow, WindowTimes, time_hard_window, time_windows, window_of
from rwa_monitor.physics.datasets import LabelledWindow, generate
from rwa_monitor.physics.wheel import built_in_wheel

WINDOWS: Final = 1_000
SEED: Final = 8_129
RECIPE: Final = "paper"
HELP_RUNS: Final = 7
FORBIDDEN_AT_HELP: Final = ("numba", "sklearn", "starlette", "uvicorn")

Progress = Callable[[Iterable[LabelledWindow], int], Iterable[LabelledWindow]]


def _untracked(windows: Iterable[LabelledWindow], count: int) -> Iterable[LabelledWindow]:
    del count
    return windows


def run(windows: int = WINDOWS, seed: int = SEED, progress: Progress = _untracked) -> SpeedReport:
    """Run the benchmark.

    Parameters
    ----------
    windows
        Windows of recipe `paper` that are diagnosed.
    seed
        Of these, and of the hard window.
    progress
        Called with the windows as they come and their number; passes them on.
    """
    machine = describe_machine()
    missing: list[str] = []
    peers = installed(missing.append)
    fastest = next((peer for peer in peers if peer.name == "skchange FPOP"), None)
    first = window_of(next(iter(generate(RECIPE, 1, seed))))
    model = built_in_model()
    times = time_windows(progress(islice(generate(RECIPE, windows, seed), windows), windows), model, fastest)
    sections = (
        detection_section(detection_laps(first, peers)),
        window_section(times, time_hard_window(built_in_wheel(), model, seed)),
        help_section(),
    )
    return SpeedReport(machine, {"windows": windows, "seed": seed}, sections, tuple(missing))


def detection_section(laps: list[Lap]) -> Section:
    """Hold the kernels against limits and peers."""
    median = {lap.name: lap.median_s for lap in laps}
    one, seven = median[detection.OURS_ONE], median[detection.OURS_SEVEN]
    plain, limit = median[detection.PLAIN], median[detection.LIMIT]
    return Section(
        title="Changepoint detection, one window of 80,000 samples",
        text="Peers are given the viscous slope and the noise, which ours finds.",
        targets=(
            Target(
                "wGLR at seven scales / plain numpy wGLR at one",
                seven / plain,
                1.0,
                least=False,
                absolute=f"{MILLI * seven:.2f} ms, {MILLI * plain:.1f} ms",
            ),
            Target(
                "wGLR at one scale / five sequential running sums",
                one / limit,
                6.0,
                least=False,
                absolute=f"{MILLI * one:.2f} ms, {MILLI * limit:.2f} ms",
            ),
        ),
        laps=tuple(laps),
    )


def window_section(times: WindowTimes, hard: HardWindow) -> Section:
    """Hold whole windows against the plain method and the fastest peer."""
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
            f"{hard.candidates} candidates and {hard.systems} switching systems that nothing tells apart: the search "
            + ("says that it pruned." if hard.pruned else "is exact.")
        ),
        targets=(
            Target(
                "window close → diagnosis, median / (¼ seven-scale wGLR + 3 ms)",
                median / allowed,
                1.0,
                least=False,
                absolute=f"{MILLI * median:.2f} ms, {MILLI * allowed:.2f} ms",
            ),
            Target(
                "window close → diagnosis, 99th percentile / median",
                tail / median,
                4.0,
                least=False,
                absolute=f"{MILLI * tail:.2f} ms, most {MILLI * times.close.max():.1f} ms",
            ),
            Target(
                f"{hard.candidates} candidates, {hard.systems} systems / median window",
                hard.seconds / median,
                100.0,
                least=False,
                absolute=f"{MILLI * hard.seconds:.0f} ms, {hard.states} states, "
                + ("pruned and says so" if hard.pruned else "exact"),
            ),
            Target(
                "plain paper method / ours, whole window, mean of each",
                float(plain.mean() / whole.mean()),
                10.0,
                least=True,
                absolute=f"mean {MILLI * plain.mean():.1f} ms, ours {MILLI * whole.mean():.2f} ms; "
                f"ratio of medians {np.median(plain) / np.median(whole):.1f}",
            ),
            Target(
                "whole window / changepoints alone by skchange FPOP",
                float(np.median(times.whole)) / peer_median,
                1.0,
                least=False,
                absolute=f"{MILLI * float(np.median(times.whole)):.2f} ms, {MILLI * peer_median:.2f} ms",
            ),
        ),
        figures={
            "stage 1 while samples come in, median [ms]": MILLI * float(np.median(times.gather)),
            "close → diagnosis, median [ms]": MILLI * median,
            "close → diagnosis, 90th percentile [ms]": MILLI * float(np.percentile(times.close, 90)),
            "plain paper method, median [ms]": MILLI * float(np.median(plain)),
            "plain paper method, 99th percentile [ms]": MILLI * float(np.percentile(plain, 99)),
        },
    )


def help_section() -> Section:
    """Time `--help` in processes of their own, and look what it imports."""
    seconds = []
    for _ in range(HELP_RUNS):
        begin = time.perf_counter()
        subprocess.run([sys.executable, "-m", "rwa_monitor.cli", "--help"], check=True, capture_output=True)
        seconds.append(time.perf_counter() - begin)
    heavy = imported_at_help()
    return Section(
        title="`--help`",
        text="Imports on that way of "
        + ", ".join(FORBIDDEN_AT_HELP)
        + (": none." if not heavy else f": {', '.join(heavy)}."),
        targets=(
            Target(
                "`--help` [s]",
                float(np.median(seconds)),
                0.3,
                least=False,
                absolute=f"least {min(seconds):.3f} s, most {max(seconds):.3f} s",
            ),
            Target(
                "heavy packages imported by `--help`",
                float(len(heavy)),
                0.0,
                least=False,
                absolute=", ".join(heavy) or "none",
            ),
        ),
    )


def imported_at_help() -> list[str]:
    """Return which of the heavy packages are imported when the help is shown, in a process of its own."""
    code = (
        "import sys\n"
        "from rwa_monitor.cli.main import main\n"
        "main(['--help'], standalone_mode=False)\n"
        f"print([name for name in {FORBIDDEN_AT_HELP!r} if name in sys.modules], file=sys.stderr)\n"
    )
    found = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)  # noqa: S603 - our own words
    return [name for name in FORBIDDEN_AT_HELP if repr(name) in found.stderr]
