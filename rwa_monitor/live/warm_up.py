"""Compiles what the core needs, before samples wait for it.

The kernels of the diagnosis are compiled when they are first called, and then kept on disk. On a new machine this takes
some seconds, in which a service would neither hear its stop signal nor take samples.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.live.core import WheelCore
from rwa_monitor.live.rebuild import Setup
from rwa_monitor.live.wheel_set import WheelSet
from rwa_monitor.physics.wheel import built_in_wheel
from rwa_monitor.samples import Samples

WINDOW_SLOTS: Final = 2_048
WINDOWS: Final = 2  # the second one has a state carried over from the first


def warm_up(setup: Setup) -> None:
    """Diagnose two short made-up windows with a jump in each, and forget about them."""
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
    core = WheelCore(short, setup.model, method=setup.method)
    core.feed(Samples(time_ns=slot * short.period_ns, speed_rad_s=speed, friction_torque_Nm=torque))
    core.finish()


if __name__ == "__main__":  # when an image is built
    warm_up(Setup(WheelSet(built_in_wheel()), built_in_model(), "joint"))
