"""Compiles what the core needs, before samples wait for it.

The kernels of the diagnosis are compiled when they are first called, and then kept on disk: once for each kind of array
that they are called with. On a new machine this takes some seconds, in which a service would neither hear its stop
signal nor take samples.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.live.core import WheelCore
from rwa_monitor.live.rebuild import Setup
from rwa_monitor.live.wheel_set import WheelSet
from rwa_monitor.physics.wheel import Wheel, built_in_wheel
from rwa_monitor.samples import Samples

WINDOW_SLOTS: Final = 2_048
WINDOWS: Final = 2  # the second one has a state carried over from the first


def warm_up(setup: Setup) -> None:
    """Diagnose short made-up windows with a jump in each, and forget about them.

    The arrays of a message may be written to, those of a file may not, which makes them another kind for the compiler:
    the second window's are such. Both windows come in two parts, one clean and one with something to mask. Where the
    wheel's constants allow it, friction is derived, too.
    """
    wheel = setup.wheels.common
    short = wheel.model_copy(
        update={"window": wheel.window.model_copy(update={"samples": WINDOW_SLOTS, "hop": WINDOW_SLOTS})}
    )
    slot = np.arange(WINDOWS * WINDOW_SLOTS + 1)
    # Any smooth speed will do, and anything uneven for noise: 2 % of the dry torque, and a jump of half of it.
    speed = wheel.speed_unit_rad_s * (0.5 + 0.1 * np.sin(slot / 300.0))
    uneven = np.sin(slot * slot % 997.0)
    level = np.where(slot % WINDOW_SLOTS < WINDOW_SLOTS // 2, 1.0, 1.5)
    torque = wheel.torque_unit_Nm * (level + speed / wheel.speed_unit_rad_s + 0.02 * uneven)
    speed[WINDOW_SLOTS - 20 :: WINDOW_SLOTS] = np.nan
    speed[WINDOW_SLOTS - 10 :: WINDOW_SLOTS] = 1e9
    samples = Samples(time_ns=slot * short.period_ns, speed_rad_s=speed, friction_torque_Nm=torque)
    _diagnose(short, setup, samples)
    if short.inertia_kg_m2 is not None and short.torque_constant_Nm_A is not None:
        derived = replace(samples, friction_torque_Nm=None, motor_current_A=torque / short.torque_constant_Nm_A)
        _diagnose(short, setup, derived)


def _diagnose(wheel: Wheel, setup: Setup, samples: Samples) -> None:
    core = WheelCore(wheel, setup.model, method=setup.method)
    for first in range(0, len(samples), WINDOW_SLOTS // 2):
        part = samples[first : first + WINDOW_SLOTS // 2]
        core.feed(part if first < WINDOW_SLOTS else _read_only(part))
    core.finish()


def _read_only(samples: Samples) -> Samples:
    """Return a copy that cannot be written to."""
    copy = samples[np.arange(len(samples))]
    for _, values in copy.channels():
        values.setflags(write=False)
    return copy


if __name__ == "__main__":  # when an image is built
    warm_up(Setup(WheelSet(built_in_wheel()), built_in_model(), "joint"))
