"""What happens in the demo: a satellite with four wheels; one begins to fail, one hides an effect from its model.

Nothing here is shown to the monitor but the samples; the rest is told at the end, so that the user can compare.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from rwa_monitor.cli.demo_hidden import Hidden, hide
from rwa_monitor.physics.datasets import scaled_wheel
from rwa_monitor.physics.scenario import Anomaly, Scenario
from rwa_monitor.physics.speed import SpeedProfile
from rwa_monitor.physics.telemetry import simulate
from rwa_monitor.physics.wheel import Wheel, Window, built_in_wheel
from rwa_monitor.samples import Samples

# The built-in wheel, five times as lively, in windows a fifth as long: a window then holds as many jumps as one of the
# paper's, and fills up while a person watches.
QUICKER: Final = 5
WINDOW_SECONDS: Final = 6.0  # wall-clock time in which a window fills
WHEELS: Final = ("wheel_1", "wheel_2", "wheel_3", "wheel_4")
FAILING: Final = "wheel_3"
ANOMALY: Final = "viscous"
FACTOR: Final = 1.25  # on the nominal viscous friction
ONSET_SHARE: Final = 0.3  # of the run
GROWTH_WINDOWS: Final = 0.5
# What each wheel does, so that no two rows of the table look alike.
PROFILES: Final = ("rich", "crossings", "rich", "orbit")


@dataclass(frozen=True, slots=True)
class Story:
    """What is published, and what is true.

    Attributes
    ----------
    wheel
        Constants of all four wheels: what the monitor is told.
    telemetry
        Samples by bus key.
    speed
        Times faster than real time.
    start_ns, onset_ns
        Times of the first sample and of the anomaly's onset, on the wheels' clock [ns].
    hiding, hidden
        The wheel that has an effect which `wheel` lacks, and the effect.
    """

    wheel: Wheel
    telemetry: Mapping[str, Samples]
    speed: float
    start_ns: int
    onset_ns: int
    hiding: str
    hidden: Hidden


def samples_key(spacecraft: str, wheel: str) -> str:
    """Return the bus key of a wheel's samples."""
    return f"rwa/{spacecraft}/{wheel}/samples"


def demo_wheel() -> Wheel:
    """Return the constants of the demo's wheels."""
    wheel = scaled_wheel(built_in_wheel(), 1.0 / QUICKER)
    slots = wheel.window.samples // QUICKER
    window = Window(samples=slots, hop=slots, dead_band_rad_s=wheel.window.dead_band_rad_s)
    return wheel.model_copy(update={"name": "demo", "window": window})


def tell(spacecraft: str, duration_s: float, start_ns: int, seed: int) -> Story:
    """Simulate the satellite.

    Parameters
    ----------
    spacecraft
        Its name on the bus.
    duration_s
        Wall-clock length of the demo [s].
    start_ns
        Time of the first sample [ns].
    seed
        Of all randomness.
    """
    wheel = demo_wheel()
    window_s = wheel.window.samples * wheel.sample_period_s
    speed = window_s / WINDOW_SECONDS
    simulated_s = duration_s * speed
    onset_s = ONSET_SHARE * simulated_s
    failure = {ANOMALY: Anomaly(factor=FACTOR, onset_s=onset_s, growth_s=GROWTH_WINDOWS * window_s)}
    *streams, hidden_stream = np.random.default_rng(seed).spawn(len(WHEELS) + 1)
    hiding = str(hidden_stream.choice([name for name in WHEELS if name != FAILING]))
    hidden = hide(wheel, simulated_s, start_ns, hidden_stream)
    telemetry = {samples_key(spacecraft, hiding): hidden.samples}
    for name, profile, rng in zip(WHEELS, PROFILES, streams, strict=True):
        if name == hiding:
            continue
        scenario = Scenario(
            duration_s=simulated_s,
            start_ns=start_ns,
            speed=SpeedProfile(kind=profile),
            anomalies=failure if name == FAILING else {},
            channels=("friction_torque_Nm", "motor_current_A"),
        )
        telemetry[samples_key(spacecraft, name)] = simulate(scenario, wheel, rng).samples
    return Story(wheel, telemetry, speed, start_ns, start_ns + round(onset_s * 1e9), hiding, hidden)
