"""Whether samples fit the wheel file at all: the sample period, the unit of speed.

Either mistake leaves diagnoses like any other, of half the samples or fewer; each is reported once. A window
that cannot be judged because samples come too rarely for the wheel file gives that as its reason.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.diagnosis.window_diagnosis import WindowDiagnosis
from rwa_monitor.kernels.order_statistics import median
from rwa_monitor.monitor.events import Event, SamplePeriodDiffers, SpeedsBeyondLimit
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray, Samples
from rwa_monitor.wheel.wheel import Wheel

STEPS: Final = 64  # steps of time from which the period of the samples is taken
PERIOD_DIFFERS: Final = 1.25  # ratio of the periods: jitter and single missing samples make less of the quantile
SLOW_QUANTILE: Final = 0.1  # nearly all steps are longer: the samples come slowly, not just with gaps
REGULAR: Final = 1.5  # ratio of the median step to short ones: 2 and 3 slots in turn, and no few samples by chance
MANY_BEYOND: Final = 64  # samples beyond the limit that are no single wild readings
SHARE_BEYOND: Final = 0.1  # of all samples


class SettingsCheck:
    """Checks a wheel's samples as they arrive.

    Parameters
    ----------
    wheel
        What the samples should fit.
    """

    def __init__(self, wheel: Wheel) -> None:
        self._expected_s = wheel.sample_period_s
        limit = wheel.limits.max_speed_rad_s
        self._limit = float("inf") if limit is None else limit
        self._times: IntArray | None = np.zeros(0, dtype=np.int64)  # the first ones; None when all is reported
        self._seen = self._beyond = 0
        self._largest = 0.0
        self._speed_reported = False

    def check(self, samples: Samples, *, clean: bool = False) -> list[Event]:
        """Return what these samples show for the first time; `clean` where their speeds are known to be in range."""
        events = [] if self._times is None else self._check_period(self._times, samples.time_ns)
        if clean:
            self._seen += samples.time_ns.size
        elif not self._speed_reported:
            events += self._check_speed(samples)
        return events

    def _check_period(self, before_ns: IntArray, time_ns: IntArray) -> list[Event]:
        self._times = np.concatenate([before_ns, time_ns[: STEPS + 1 - before_ns.size]])
        if self._times.size <= STEPS:
            return []
        steps = np.diff(self._times)
        self._times = None
        steps = steps[steps > 0] / NANOSECONDS_PER_SECOND  # repeated messages and clock steps back show no period
        if steps.size < STEPS // 2:
            return []
        period_s = float(median(steps))
        fast = period_s * PERIOD_DIFFERS < self._expected_s
        slow = _come_slowly(steps, self._expected_s)
        return [SamplePeriodDiffers(period_s, self._expected_s)] if fast or slow else []

    def _check_speed(self, samples: Samples) -> list[Event]:
        sizes = np.abs(samples.speed_rad_s)
        beyond = sizes[(sizes > self._limit) & np.isfinite(sizes)]
        self._seen += len(samples)
        self._beyond += beyond.size
        self._largest = float(beyond.max(initial=self._largest))
        if self._beyond < max(MANY_BEYOND, SHARE_BEYOND * self._seen):
            return []
        self._speed_reported = True
        return [SpeedsBeyondLimit(self._limit, self._largest)]


def with_sample_period(diagnosis: WindowDiagnosis, good: BoolArray, sample_period_s: float) -> WindowDiagnosis:
    """Return a diagnosis of a window with too few samples that asks for the sample period where that explains it.

    Parameters
    ----------
    diagnosis
        Of a window that could not be judged for want of samples.
    good
        bool (n,), slots of the window that hold a good sample. Gaps, however many, leave samples in neighbouring slots,
        or at distances by chance; samples that all keep the same distance come at another period.
    sample_period_s
        Of the wheel file [s].
    """
    steps_s = sample_period_s * np.diff(np.flatnonzero(good))
    if steps_s.size < STEPS or not _come_slowly(steps_s, sample_period_s):
        return diagnosis
    if float(np.median(steps_s)) > REGULAR * _short_step(steps_s):
        return diagnosis
    reason = (
        f"{diagnosis.reason.removesuffix('.')}; its samples come every {float(np.median(steps_s)):.3g} s: is"
        f" sample_period_s = {sample_period_s:.6g} of the wheel file right?"
    )
    remedy = "Give a wheel file with the sample period of this telemetry: until then no window can be judged."
    return replace(diagnosis, reason=reason, explanation=f"{reason} {remedy}")


def _come_slowly(steps_s: FloatArray, expected_s: float) -> bool:
    """Return whether nearly all steps of time are longer than the wheel file's, float64 (n,) [s], not just some."""
    return _short_step(steps_s) > expected_s * PERIOD_DIFFERS


def _short_step(steps_s: FloatArray) -> float:
    """Return the step that SLOW_QUANTILE of them do not exceed [s]; they are too few to interpolate between."""
    return float(np.sort(steps_s)[int(SLOW_QUANTILE * (steps_s.size - 1))])
