"""What a wheel file means for whoever waits for its diagnoses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from rwa_monitor.samples import SECONDS_PER_HOUR
from rwa_monitor.wheel.wheel import Wheel

SOON_H: Final = 1.0  # whoever starts a monitor waits so long without being told to


def first_verdict(wheels: Sequence[Wheel]) -> str:
    """Say after how much telemetry some wheels, at least one, have their first verdict; "" where that is soon.

    A window gives one when it is full.
    """
    hours = sorted({wheel.window.samples * wheel.sample_period_s / SECONDS_PER_HOUR for wheel in wheels})
    if hours[-1] <= SOON_H:
        return ""
    first, last = f"{hours[0]:.3g}", f"{hours[-1]:.3g}"
    spread = f"{first} to {last} h" if first != last else f"{first} h"
    return f"the first verdict comes after {spread} of telemetry: window samples × sample_period_s"
