"""False reports while a window is open come as often as the wheel file asks for, whatever the noise."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.false_alarms import NOISES, WITHIN, run_length
from rwa_monitor.changepoints.candidates import threshold_of_run_length
from rwa_monitor.changepoints.evidence import SCALES
from rwa_monitor.errors import InputError
from rwa_monitor.wheel.wheel import BUILT_IN_WHEEL_TOML, Wheel


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("asked", [1e4, 1e5])
def test_run_length_is_what_is_asked_for(noise: str, asked: float) -> None:
    measured = run_length(noise, asked, np.random.default_rng(3), events=150).measured
    assert asked / WITHIN <= measured <= asked * WITHIN


def test_threshold_rises_with_the_run_length() -> None:
    thresholds = [threshold_of_run_length(asked, SCALES) for asked in (1e4, 1e6, 1e12)]
    assert np.all(np.diff(thresholds) > 0)
    # As many tests a slot as there are scales, each at every slot, would need at most this.
    assert thresholds[1] < 2.0 * np.log(1e6 * len(SCALES))


def test_a_run_length_that_was_not_measured_is_refused() -> None:
    text = BUILT_IN_WHEEL_TOML.replace("hop = 80000", "hop = 80000\nrun_length = 100")
    with pytest.raises(InputError, match="run_length"):
        Wheel.from_toml(text, "wheel.toml")
