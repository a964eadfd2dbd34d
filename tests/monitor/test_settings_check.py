"""Samples that do not fit the wheel file: reported once, whatever the cut into messages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.api import Monitor
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.monitor.core import WheelCore
from rwa_monitor.monitor.ingest import Trouble
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.wheel import built_in_wheel


def ramp(count: int, period_s: float, seed: int = 1) -> Samples:
    """A wheel that spins up; times jitter by a tenth of the step."""
    rng = np.random.default_rng(seed)
    time_s = (np.arange(count) + rng.uniform(-0.05, 0.05, count)) * period_s
    speed = np.linspace(50.0, 300.0, count)
    return Samples(np.rint(time_s * 1e9).astype(np.int64), speed, 1.6e-3 + 5.3e-6 * speed)


def looked(samples: Samples, cut: int) -> list[str]:
    """Return what is reported of samples in messages of this size."""
    core = WheelCore(built_in_wheel(), built_in_model())
    events = [event for i in range(0, len(samples), cut) for event in core.feed(samples[i : i + cut])]
    return [e.text for e in events if isinstance(e, Trouble) and e.kind in {"sample period", "limits"}]


@pytest.mark.parametrize("cut", [1, 7, 1000])
@pytest.mark.parametrize("period_s", [0.05, 0.25])
def test_another_sample_period_is_reported_once(period_s: float, cut: int) -> None:
    (text,) = looked(ramp(1000, period_s), cut)
    assert float(text.split()[-2]) == pytest.approx(period_s, rel=0.1)


def test_gaps_and_repetition_are_no_other_period() -> None:
    samples = ramp(1000, 0.125)
    kept = np.flatnonzero(np.random.default_rng(2).random(1000) > 0.3)
    assert looked(samples[kept], 10) == []
    assert looked(samples[np.repeat(np.arange(1000), 2)], 10) == []


@pytest.mark.parametrize("cut", [10, 1000])
def test_speeds_in_rpm_are_asked_about(cut: int) -> None:
    samples = ramp(1000, 0.125)
    rpm = replace(samples, speed_rad_s=samples.speed_rad_s * 30.0 / np.pi)
    assert len(looked(rpm, cut)) == 1
    wild = samples.speed_rad_s.copy()
    wild[::50] = 1e4
    assert looked(replace(samples, speed_rad_s=wild), cut) == []


def test_the_monitor_s_troubles_hold_both() -> None:
    samples = ramp(1000, 0.05)
    monitor = Monitor(built_in_wheel(), built_in_model())
    monitor.feed(replace(samples, speed_rad_s=samples.speed_rad_s * 30.0 / np.pi))
    text = " ".join(monitor.troubles)
    assert "is sample_period_s = 0.125 of the wheel file right? The samples come every 0.05" in text
    assert "samples are beyond the wheel's limits and rejected: is the speed in rpm" in text
