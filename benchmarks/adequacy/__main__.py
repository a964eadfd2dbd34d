"""The model check at a window's close: how often it detects an effect that the model lacks, and its false alarms.

    python -m benchmarks.adequacy [--seed N] [--seeds N] [--nominal N] [--processes N] [-o FILE]

Hides each mean effect of the catalogue at 0.5 σ in windows of each motion, runs nominal windows of four recipes, and
measures how an incomplete model changes the diagnosis of healthy and of failing wheels. The thresholds of the check
were set on seeds 100 to 1307. Prints the page; exit code 1 where a target is missed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import multiprocessing.pool
import statistics
import sys
import time
from collections.abc import Sequence

import numpy as np

from benchmarks.adequacy.trials import (
    MEAN_EFFECTS,
    MOTIONS,
    Diagnosed,
    Job,
    Trial,
    judged,
    lacking_nothing,
    plain_and_short,
    seen,
    seen_in_short,
)
from benchmarks.page import NONE, add_output_option, counted, page, put_out, section, table
from benchmarks.target import Target, at_least, at_most, exit_code
from benchmarks.window import Window
from rwa_monitor.diagnosis import adequacy
from rwa_monitor.simulation.datasets import MILD_SEVERITIES
from rwa_monitor.simulation.motion import ProfileKind
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.switching.assignment import assign
from rwa_monitor.wheel.wheel import built_in_wheel

RECIPE_NAMES = ("paper", "mild", "hard", "derived")
WANTED_SEEN, WANTED_FALSE = 0.9, 0.01
STRENGTHS = (0.5, 1.5)
SURE = 0.9  # probability of an anomaly that counts as near-certain
TIMED = 50
SHORT = (20_000, 8_000, 2_000)  # slots of shorter windows
SHORT_NOMINAL = 50  # windows of each motion and length

Case = tuple[str, ProfileKind]  # effect and motion

MADE = """\
Made by `python -m benchmarks.adequacy --seed {seed} --seeds {seeds} --nominal {nominal}`. Thresholds were set on
other seeds (100 to 1307). Two runs before this one met the targets, too (seeds 20,000 and 30,000: each 123 of 123 seen
within three windows, 0 and 1 false alarms in 400 windows); after them the check was made blind to wheels at rest and to
slow crossings that read zero by chance. 95 % intervals in brackets."""
SEEN = """\
Each mean effect of the catalogue is hidden in windows of 80,000 samples of wheels of recipe `paper`. Its strength, the
RMS of the part orthogonal to sign, speed and true levels, is half the noise's standard deviation. Shape parameters are
drawn within a factor of two of their typical values. A cell gives the trials in which the first window, and any of the
first three, is called inadequate; "–" where the motion cannot show the effect at this strength at all."""
FALSE_ALARMS = """\
Windows that lack nothing. Nominal ones are drawn like the recipe's, without its anomalies."""
SHORTER = """\
The thresholds are those of windows of 80,000 samples. A shorter window has fewer intervals between jumps, fewer
crossings of zero and fewer blocks to compare, so that the check detects less and reports nothing. One window a trial,
all effects and motions that can show them, wheels of recipe `paper`."""
SHORTER_REMARK = """\
`model_adequate` of a short window is no finding that nothing is missing. The search (`rwa-monitor discrepancy`) reads
the samples and detects more: it names effects in measured records of 1,760 samples in which this check has none
([measured.md](measured.md))."""
MISSING = """\
One window, one effect on one motion, all 17 × 4 that can be shown. The standard deviations hold what the missing effect
can have moved (`diagnosis/adequacy.py`). The anomalies are those of recipe `mild`; *near-certain* is a
probability above 0.9; *so called*: of the windows near-certain of what is not there, those whose verdict is
`anomalous`, too; *open*: the verdict is `inconclusive`. A failing wheel that is not detected is mostly inconclusive,
with a reason that names what the model lacks; its search is started, and once the wheel file is extended nothing is
uncertain for that reason. Windows without a missing effect are adequate and are not touched."""
COST = """\
The check takes {check_ms:.1f} ms at the close of a window of 80,000 samples (median of 50), the assignment of the same
windows {assignment_ms:.1f} ms. It reads running sums only; what they do not hold (direction, the dead band, the wheel's
angle) is gathered as the samples come in, in about 80 kB."""


def detection_table(trials: Sequence[Trial]) -> tuple[str, Target]:
    """Return the table of detections by effect and motion, with its total, and the target."""
    rows = []
    for name in MEAN_EFFECTS:
        cells = []
        for motion in MOTIONS:
            shown = [t for t in trials if (t.effect, t.motion) == (name, motion) and t.windows]
            first, three = (sum(t.seen_within(count) for t in shown) for count in (1, 3))
            cells.append(f"{first}, {three} of {len(shown)}" if shown else NONE)
        rows.append([f"`{name}`", *cells])
    shown = [trial for trial in trials if trial.windows]
    first, three = (sum(trial.seen_within(count) for trial in shown) for count in (1, 3))
    total = (
        f"All: in the first window {counted(first, len(shown))}; within three {counted(three, len(shown))} "
        "(target 90 %)."
    )
    seen_share = at_least("seen within three windows", three / len(shown), WANTED_SEEN)
    return f"{table(['effect', *MOTIONS], rows)}\n\n{total}", seen_share


def false_alarm_table(nominal: Sequence[Diagnosed], failing: Sequence[Diagnosed]) -> tuple[str, Target]:
    """Return the table of false alarms by recipe, with its total, and the target."""
    rows = []
    for recipe in RECIPE_NAMES:
        cells = []
        for windows in (nominal, failing):
            adequate = [diagnosis.model_adequate for name, diagnosis, _ in windows if name == recipe]
            cells.append(counted(adequate.count(False), len(adequate)))
        rows.append([f"`{recipe}`", *cells])
    false = sum(not diagnosis.model_adequate for _, diagnosis, _ in nominal)
    total = f"All nominal windows: {counted(false, len(nominal))} (target 1 %)."
    false_share = at_most("false alarms", false / len(nominal), WANTED_FALSE)
    return f"{table(['recipe', 'nominal windows', 'windows with anomalies'], rows)}\n\n{total}", false_share


def short_table(pool: multiprocessing.pool.Pool, seed: int, seeds: int) -> str:
    """Run shorter windows and return the table by length: detected effects and false alarms."""
    rows = []
    for slots in SHORT:
        cells = []
        for sigmas in STRENGTHS:
            jobs = [(*case, seed + 30 + i, sigmas, slots) for case in _cases() for i in range(seeds)]
            shown = [trial for trial in pool.map(seen_in_short, jobs, chunksize=8) if trial.windows]
            cells.append(counted(sum(trial.seen_within(1) for trial in shown), len(shown)))
        plain = [(motion, seed + 40 + i, slots) for motion in MOTIONS for i in range(SHORT_NOMINAL)]
        adequate = pool.map(plain_and_short, plain, chunksize=25)
        rows.append([f"{slots:,}", *cells, counted(adequate.count(False), len(adequate))])
    return table(["samples", *(f"seen at {s:g} σ" for s in STRENGTHS), "false alarms"], rows)


def diagnosis_table(jobs: Sequence[Job], trials: Sequence[Trial]) -> str:
    """Return the table of diagnoses by the wheel's anomaly."""
    header = ["wheel", "effect", "detected", "near-certain", "near-certain of what is not there"]
    rows = []
    for anomaly in ("", *MILD_SEVERITIES):
        for sigmas in STRENGTHS:
            windows = [
                trial.windows[0]
                for job, trial in zip(jobs, trials, strict=True)
                if job[3:] == (sigmas, anomaly) and trial.windows
            ]
            there = [w.anomalies[anomaly].probability for w in windows if anomaly in w.anomalies]
            wrong = [
                w for w in windows if any(a.probability > SURE for name, a in w.anomalies.items() if name != anomaly)
            ]
            rows.append(
                [
                    anomaly or "healthy",
                    f"{sigmas:g} σ",
                    f"{sum(p > 0.5 for p in there)} of {len(windows)}" if anomaly else NONE,
                    f"{sum(p > SURE for p in there)}" if anomaly else NONE,
                    counted(len(wrong), len(windows)),
                    f"{sum(w.verdict == 'anomalous' for w in wrong)}",
                    f"{sum(w.verdict == 'inconclusive' for w in windows)}",
                ]
            )
    return table([*header, "so called", "open"], rows)


def time_check() -> tuple[float, float]:
    """Return the median times of the check and of assignment [ms] on windows of 80,000 samples."""
    wheel, times, others = built_in_wheel(), [], []
    for seed in range(TIMED):
        samples = simulate(Scenario(), wheel, np.random.default_rng(seed % 5)).samples
        evidence = Window.of(samples, wheel).evidence()
        began = time.perf_counter()
        assignment, estimate = assign(evidence, wheel)
        middle = time.perf_counter()
        adequacy.check(evidence, estimate, assignment, wheel.fss)
        times.append(time.perf_counter() - middle)
        others.append(middle - began)
    return 1e3 * statistics.median(times), 1e3 * statistics.median(others)


def _cases() -> list[Case]:
    return [(name, motion) for name in MEAN_EFFECTS for motion in MOTIONS]


def main() -> int:
    """Run everything, write the page, return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=41_000)
    parser.add_argument("--seeds", type=int, default=2, help="trials of each effect on each motion")
    parser.add_argument("--nominal", type=int, default=100, help="nominal windows of each recipe")
    parser.add_argument("--processes", type=int, default=2)
    add_output_option(parser)
    options = parser.parse_args()
    hidden = [(*case, options.seed + i) for case in _cases() for i in range(options.seeds)]
    recipes = [(name, i, options.seed + 10 + n) for n, name in enumerate(RECIPE_NAMES) for i in range(options.nominal)]
    jobs: list[Job] = [
        (*case, options.seed + 20, sigmas, anomaly)
        for case in _cases()
        for sigmas in STRENGTHS
        for anomaly in ("", *MILD_SEVERITIES)
    ]
    check_ms, assignment_ms = time_check()
    with multiprocessing.get_context("spawn").Pool(options.processes) as pool:
        trials = pool.map(seen, hidden, chunksize=4)
        nominal = pool.map(lacking_nothing, [(*job, True) for job in recipes], chunksize=10)
        failing = pool.map(lacking_nothing, [(*job, False) for job in recipes], chunksize=10)
        diagnosed = pool.map(judged, jobs, chunksize=10)
        short = short_table(pool, options.seed, options.seeds)
    detection, seen_share = detection_table(trials)
    alarms, false_share = false_alarm_table(nominal, [window for window in failing if window[2]])
    text = page(
        "Does the friction model fit? The check at every window close",
        MADE.format(seed=options.seed, seeds=options.seeds, nominal=options.nominal),
        section("What it detects", SEEN, detection),
        section("False alarms", FALSE_ALARMS, alarms),
        section("Shorter windows", SHORTER, short, SHORTER_REMARK),
        section("What a missing effect does to the diagnosis", MISSING, diagnosis_table(jobs, diagnosed)),
        section("Cost", COST.format(check_ms=check_ms, assignment_ms=assignment_ms)),
    )
    put_out(text, options.output)
    return exit_code([seen_share, false_share])


if __name__ == "__main__":
    sys.exit(main())
