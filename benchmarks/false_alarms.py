"""Online error rates: run length of provisional jumps, their delay compared with FOCuS, false alarms per year.

    python -m benchmarks.false_alarms [--seed N] [--quick] [-o FILE]

Run length: stage 1 as it runs live, on windows without a jump, with the run length that the wheel file asks for.
Delay: from a jump in the middle of a window to the sample after which it is reported. FOCuS (G. Romano, I. A. Eckley,
P. Fearnhead, G. Rigaill, Fast online changepoint detection via functional pruning CUSUM statistics, JMLR 24, 2023) has
its threshold set to the same run length by simulation. False alarms: histories of healthy wheels through diagnosis,
carried state and the alarms' policy.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from scipy import signal, stats

from benchmarks.accuracy.campaign import in_processes
from benchmarks.page import NONE, add_output_option, page, put_out, section, table
from benchmarks.target import Target, at_most, exit_code, target_table
from rwa_monitor.changepoints.evidence import WindowAccumulator
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.history.alarms import WINDOW_POLICY, Alarm, Policy, advance, observe
from rwa_monitor.messages import Diagnosis
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.samples import FloatArray
from rwa_monitor.simulation.datasets import RECIPES, Recipe, wheel_windows
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel

SEED: Final = 23011
ASKED: Final = (1e4, 1e5, 1e6)  # samples between false reports
EVENTS: Final = 120  # expected false reports in the measurement of a run length
WITHIN: Final = 1.5  # largest factor between the run length measured and the one asked for, either way
JUMPS: Final = (0.5, 1.0, 2.0)  # standard deviations of the noise
DELAYS_AT: Final = 1e5  # run length of the comparison [samples]
BEFORE: Final = 8192  # slots before the jump: two chunks, so that the noise is known
AFTER: Final = 2000  # slots after which a jump counts as missed
TRIALS: Final = 200
FOCUS_RUNS: Final = 16
FOCUS_LONGEST: Final = 4  # run lengths after which a run of FOCuS is ended
AR: Final = 0.5
FREEDOM: Final = 4.0

Noise = Callable[[np.random.Generator, int], FloatArray]


def _white(rng: np.random.Generator, count: int) -> FloatArray:
    return rng.standard_normal(count)


def _coloured(rng: np.random.Generator, count: int) -> FloatArray:
    """AR(1) of variance one."""
    settle = 100
    drive = rng.standard_normal(count + settle) * np.sqrt(1.0 - AR**2)
    return np.asarray(signal.lfilter([1.0], [1.0, -AR], drive)[settle:])


def _heavy(rng: np.random.Generator, count: int) -> FloatArray:
    """Student's t of variance one."""
    return np.asarray(rng.standard_t(FREEDOM, count) * np.sqrt((FREEDOM - 2.0) / FREEDOM))


NOISES: Final[dict[str, Noise]] = {"white": _white, f"AR({AR:g})": _coloured, f"t with {FREEDOM:g}": _heavy}


@dataclass(frozen=True, slots=True)
class RunLength:
    """Run length asked for [samples], number of false reports, and number of samples."""

    noise: str
    asked: float
    reports: int
    samples: int

    @property
    def measured(self) -> float:
        """Samples between false reports."""
        return self.samples / max(self.reports, 1)

    def interval(self) -> tuple[float, float]:
        """Return the exact 95 % interval of the run length, of a Poisson count."""
        low = stats.chi2.ppf(0.025, 2 * self.reports) / 2.0 if self.reports else 0.0
        return self.samples / float(stats.chi2.ppf(0.975, 2 * self.reports + 2) / 2.0), self.samples / max(low, 1e-9)


def _with_run_length(samples: float, slots: int | None = None) -> Wheel:
    wheel = built_in_wheel()
    window = {"run_length": samples} | ({} if slots is None else {"samples": slots, "hop": slots})
    return wheel.model_copy(update={"window": wheel.window.model_copy(update=window)})


def _quiet(wheel: Wheel, noise: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return speed [rad/s] and friction [N m] of slots without a jump; `noise` is in standard deviations."""
    assert wheel.nominal is not None
    assert wheel.noise.friction_std_Nm is not None
    speed = wheel.nominal.nominal_speed_rad_s * (0.7 + 0.3 * np.sin(np.arange(noise.size) / 9000.0))
    friction = wheel.nominal.dry_torque_Nm + wheel.nominal.viscous_Nm_s_rad * speed
    return speed, friction + wheel.noise.friction_std_Nm * noise


def run_length(name: str, asked: float, rng: np.random.Generator, events: int) -> RunLength:
    """Count false reports in as many windows as are expected to contain `events` of them."""
    wheel = _with_run_length(asked)
    slots = wheel.window.samples
    windows, reports = int(np.ceil(events * asked / slots)), 0
    for _ in range(windows):
        window = WindowAccumulator(wheel)
        speed, friction = _quiet(wheel, NOISES[name](rng, slots))
        reports += len(window.append(speed, friction, np.ones(slots, dtype=np.bool_)))
    return RunLength(name, asked, reports, windows * slots)


# ---- delay -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Delays:
    """Samples from a jump to its report, float64 (trials,), infinite where it is missed."""

    jump: float
    ours: FloatArray
    focus: FloatArray


def _our_delay(wheel: Wheel, noise: FloatArray, jump: float) -> float:
    assert wheel.noise.friction_std_Nm is not None
    speed, friction = _quiet(wheel, noise)
    friction[BEFORE:] += jump * wheel.noise.friction_std_Nm
    window, good = WindowAccumulator(wheel), np.ones(noise.size, dtype=np.bool_)
    window.append(speed[:BEFORE], friction[:BEFORE], good[:BEFORE])
    for k in range(BEFORE, noise.size):
        if window.append(speed[k : k + 1], friction[k : k + 1], good[k : k + 1]):
            return k + 1.0 - BEFORE
    return np.inf


def _focus_delay(noise: FloatArray, jump: float, threshold: float) -> float:
    from changepoint_online import Focus, Gaussian

    detector = Focus(Gaussian())
    for value in noise[:BEFORE].tolist():
        detector.update(value)
    for k, value in enumerate((noise[BEFORE:] + jump).tolist(), start=1):
        detector.update(value)
        if detector.statistic() >= threshold:
            return float(k)
    return np.inf


def focus_threshold(asked: float, rng: np.random.Generator, runs: int = FOCUS_RUNS) -> float:
    """Return FOCuS's threshold for a run length, from the largest statistics of runs of white noise.

    Of runs that end at `FOCUS_LONGEST` run lengths, the rate of first passages is their number over the time at risk.
    """
    from changepoint_online import Focus, Gaussian

    length = int(FOCUS_LONGEST * asked)
    largest = np.empty((runs, length))
    for run in range(runs):
        detector, most = Focus(Gaussian()), 0.0
        for k, value in enumerate(rng.standard_normal(length).tolist()):
            detector.update(value)
            most = max(most, detector.statistic())
            largest[run, k] = most
    for threshold in np.arange(5.0, 40.0, 0.1):
        below = (largest < threshold).sum(axis=1)
        passed = int(np.count_nonzero(below < length))
        if below.sum() >= asked * max(passed, 1):
            return float(threshold)
    raise AssertionError("no threshold up to 40 has that run length")


def delays(rng: np.random.Generator, trials: int, asked: float) -> list[Delays]:
    """Measure the delays of both detectors on the same samples with white noise."""
    wheel, threshold = _with_run_length(asked, BEFORE + AFTER), focus_threshold(asked, rng)
    found = []
    for jump in JUMPS:
        noises = [rng.standard_normal(BEFORE + AFTER) for _ in range(trials)]
        ours = np.array([_our_delay(wheel, noise, jump) for noise in noises])
        focus = np.array([_focus_delay(noise, jump, threshold) for noise in noises])
        found.append(Delays(jump, ours, focus))
    return found


# ---- false alarms of a year ------------------------------------------------------------------------------------------

YEAR_S: Final = 365.25 * 86_400.0
POLICIES: Final = {"each window": Policy(k=1, n=1), "2 of the last 3 windows": WINDOW_POLICY}
FLEETS: Final = (64, 1000)  # wheels


@dataclass(frozen=True, slots=True)
class FalseAlarms:
    """Alarms raised by each policy on healthy wheels, and the time of observation [wheel-years]."""

    raised: dict[str, int]
    windows: int
    years: float

    def a_year(self, policy: str) -> tuple[float, float, float]:
        """Return alarms per wheel and year, with the exact 95 % interval of a Poisson count."""
        count = self.raised[policy]
        low = float(stats.chi2.ppf(0.025, 2 * count)) / 2.0 if count else 0.0
        high = float(stats.chi2.ppf(0.975, 2 * count + 2)) / 2.0
        return count / self.years, low / self.years, high / self.years


def _healthy(wheel: Wheel, number: int, windows: int, rng: np.random.Generator) -> Scenario:
    return RECIPES["mild"].scenario(wheel, number, windows, rng).model_copy(update={"anomalies": {}})


def raised_by(policy: Policy, diagnoses: Iterable[Diagnosis]) -> list[str]:
    """Return what a policy raises alarms of in the diagnoses of one wheel, in order."""
    alarms: dict[str, Alarm] = {}
    raised = []
    for diagnosis in diagnoses:
        for name, level in observe(diagnosis).items():
            alarm, events = advance(alarms.get(name, Alarm()), level, diagnosis.window_end_ns, policy)
            alarms[name] = alarm._replace(phase="quiet") if alarm.phase == "returned" else alarm
            raised += [name for event in events if event.event in {"raised", "relapsed"}]
    return raised


def _history(seed: int, windows: int, number: int) -> dict[str, int]:
    """Return the number of alarms in the history of one healthy wheel, by policy."""
    recipe = Recipe("healthy", RECIPES["mild"].wheel, _healthy, windows)
    state, diagnoses = CarriedState.empty(), []
    for window in wheel_windows(recipe, number, seed):
        (closed,) = diagnose_samples(window.telemetry.samples, window.wheel, built_in_model(), carried=state)
        state = closed.carried
        diagnoses.append(closed.message("", window.wheel.name))
    return {name: len(raised_by(policy, diagnoses)) for name, policy in POLICIES.items()}


def false_alarms(wheels: int, windows: int, seed: int, workers: int) -> FalseAlarms:
    """Count alarms in the histories of healthy wheels, each of `windows` windows, with the state carried over."""
    lives = list(in_processes(partial(_history, seed, windows), range(wheels), workers))
    wheel = built_in_wheel()
    years = wheels * windows * wheel.window.samples * wheel.sample_period_s / YEAR_S
    return FalseAlarms({name: sum(life[name] for life in lives) for name in POLICIES}, wheels * windows, years)


# ---- the page --------------------------------------------------------------------------------------------------------


def _targets(lengths: list[RunLength]) -> list[Target]:
    return [
        at_most(
            f"run length in noise {one.noise}, {one.asked:.0e} asked for: times off",
            max(one.measured / one.asked, one.asked / one.measured),
            WITHIN,
            f"{one.measured:.3g} measured",
        )
        for one in lengths
    ]


def to_markdown(
    lengths: list[RunLength], found: list[Delays], alarms: FalseAlarms, targets: list[Target], seed: int, asked: float
) -> str:
    """Write the page."""
    rows = [
        (
            one.noise,
            f"{one.asked:.0e}",
            f"{one.measured:.3g} ({one.interval()[0]:.3g}–{one.interval()[1]:.3g})",
            f"{one.measured / one.asked:.2f}",
            str(one.reports),
        )
        for one in lengths
    ]
    delay_rows = [
        (f"{one.jump:g} σ", name, f"{100 * np.mean(np.isfinite(of)):.1f} %", _quantiles(of))
        for one in found
        for name, of in (("rwa-monitor", one.ours), ("FOCuS", one.focus))
    ]
    alarm_rows = []
    for policy in POLICIES:
        rate, low, high = alarms.a_year(policy)
        fleets = (f"{rate * wheels:.3g} (at most {high * wheels:.3g})" for wheels in FLEETS)
        alarm_rows.append((policy, str(alarms.raised[policy]), f"{rate:.3g} ({low:.2g}–{high:.2g})", *fleets))
    return page(
        "False alarms",
        f"Seed {seed}. What is reported while a window is open (`changepoints` on the bus), and what becomes an alarm.",
        target_table(targets),
        section(
            "Samples between false reports",
            "`run_length` under `[window]` of the wheel file asks for it. Windows of 80,000 slots without a jump, "
            "noise and slope estimated as in any window; 95 % interval of a Poisson count.",
            table(("noise", "asked for", "measured", "measured / asked", "reports"), rows),
        ),
        section(
            "Delay of a report",
            f"White noise, run length {asked:.0e} of both, {BEFORE} samples before the jump, {AFTER} after it. The "
            "monitor looks at halves of up to 128 samples, FOCuS at every past sample: a jump that shows only in more "
            "is left to the close of the window.",
            table(("jump", "detector", "reported", "delay [samples], median (5 to 95 %)"), delay_rows),
        ),
        section(
            "False alarms of a year",
            f"{alarms.windows} windows of healthy wheels of recipe `mild`, {alarms.years:.2f} wheel-years, each "
            "wheel's windows in turn with what one shows the next. The guarantee is patience: two of the last three "
            "windows raise an alarm, one does not. Of a fleet: that many wheels alike, independent.",
            table(
                ("an alarm by", "raised", "a wheel-year", *(f"{wheels} wheels, a year" for wheels in FLEETS)),
                alarm_rows,
            ),
        ),
    )


def _quantiles(delay: FloatArray) -> str:
    if not np.isfinite(delay).any():
        return NONE
    low, middle, high = np.quantile(delay, (0.05, 0.5, 0.95), method="inverted_cdf")
    return f"{middle:g} ({low:g} to {high:g})".replace("inf", "missed")


def main() -> int:
    """Measure, write the page, return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--wheels", type=int, default=64, help="healthy wheels (default %(default)s)")
    parser.add_argument("--windows", type=int, default=200, help="of each (default %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default %(default)s)")
    parser.add_argument("--quick", action="store_true", help="a tenth of everything")
    add_output_option(parser)
    options = parser.parse_args()
    share = 10 if options.quick else 1
    rng = np.random.default_rng(options.seed)
    lengths = [run_length(name, asked, rng, EVENTS // share) for name in NOISES for asked in ASKED]
    asked = DELAYS_AT / share
    found = delays(rng, TRIALS // share, asked)
    alarms = false_alarms(options.wheels, options.windows // share, options.seed, options.jobs)
    targets = _targets(lengths)
    put_out(to_markdown(lengths, found, alarms, targets, options.seed, asked), options.output)
    return exit_code(targets)


if __name__ == "__main__":
    sys.exit(main())
