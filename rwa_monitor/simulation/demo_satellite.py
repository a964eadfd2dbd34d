"""The satellite of the demo: four simulated wheels; one begins to fail, one has an effect that its wheel file lacks.

The monitor receives only the samples; the truth is printed at the end, so that the user can compare.

The wheel with the effect, drawn by the seed, is exercised in passes. A pass is one window of the monitor and holds a
whole "rich" manoeuvre (speeds in steps both ways, slow and fast crossings), since the search is given one window, which
must separate the effects. Between two passes there is no telemetry for `PAUSE_S`, in which the wheel moves to the start
of the next manoeuvre.

The effects are those identifiable from speed, acceleration and friction within a pass. Left out are effects that need a
temperature, which the demo does not send, and drifts over more than a pass. Without a voltage no record separates
`inertia_error` from `torque_constant_error`; either name is right.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.random import Generator

from rwa_monitor.messages import SamplesMessage, key_of
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, Samples, concatenate
from rwa_monitor.simulation.datasets import scaled_wheel
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Anomaly, Scenario
from rwa_monitor.wheel.wheel import EffectBlock, Wheel, Window, built_in_wheel

# The built-in wheel, with jumps five times as frequent, in windows a fifth as long: a window then holds as many jumps
# as one of the paper's, and is complete within seconds.
QUICKER: Final = 5
WINDOW_SECONDS: Final = 6.0  # wall-clock time in which a window fills
WHEELS: Final = ("wheel_1", "wheel_2", "wheel_3", "wheel_4")
FAILING: Final = "wheel_3"
ANOMALY: Final = "viscous"
FACTOR: Final = 1.25  # on the nominal viscous friction
ONSET_SHARE: Final = 0.3  # of the run
GROWTH_WINDOWS: Final = 0.5  # windows until the factor is reached
# The motion of each wheel, in the order of WHEELS.
PROFILES: Final = ("rich", "crossings", "rich", "orbit")
PAUSE_S: Final = 60.0  # simulated time; twice as long as the wheel takes from rest to its nominal speed
# Each has a residual of 1 to 2 σ of the noise (rms) after the fit of levels and slope to a pass; shapes are about the
# catalogue's typical values, within the speeds (10 … 300 rad/s) and times (dwells and moves of 30 … 200 s) of a pass.
EFFECTS: Final = tuple(
    EffectBlock(name=name, parameters=parameters)
    for name, parameters in (
        ("stribeck", {"strength_Nm": 2.5e-4, "stribeck_speed_rad_s": 15.0}),
        ("quadratic_drag", {"strength_Nm_s2_rad2": 9.0e-9}),
        ("sublinear_viscous", {"strength_Nm": 6.5e-5, "exponent": 0.5}),
        ("torque_bias", {"strength_Nm": 7.0e-5}),
        ("viscous_asymmetry", {"strength_Nm_s_rad": 5.5e-7}),
        ("inertia_error", {"strength_kg_m2": 2.0e-5}),
        ("lubricant_lag", {"strength_Nm_s_rad": 1.0e-6, "time_constant_s": 50.0}),
    )
)


class Hidden(NamedTuple):
    """A wheel with an effect that its wheel file lacks: name and parameters of the effect, and the wheel's samples."""

    effect: EffectBlock
    samples: Samples


class Satellite(NamedTuple):
    """The published telemetry and the truth.

    Attributes
    ----------
    wheel
        Constants of all four wheels, as given to the monitor.
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


def demo_wheel() -> Wheel:
    """Return the constants of the demo's wheels."""
    wheel = scaled_wheel(built_in_wheel(), 1.0 / QUICKER)
    slots = wheel.window.samples // QUICKER
    window = Window(samples=slots, hop=slots, dead_band_rad_s=wheel.window.dead_band_rad_s)
    return wheel.model_copy(update={"name": "demo", "window": window})


def simulate_satellite(spacecraft: str, duration_s: float, start_ns: int, seed: int) -> Satellite:
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
        Seed of all randomness.
    """
    wheel = demo_wheel()
    speed = wheel.window_s / WINDOW_SECONDS
    simulated_s = duration_s * speed
    onset_s = ONSET_SHARE * simulated_s
    failure = {ANOMALY: Anomaly(factor=FACTOR, onset_s=onset_s, growth_s=GROWTH_WINDOWS * wheel.window_s)}
    *streams, hidden_stream = np.random.default_rng(seed).spawn(len(WHEELS) + 1)
    hiding = str(hidden_stream.choice([name for name in WHEELS if name != FAILING]))
    hidden = hide(wheel, simulated_s, start_ns, hidden_stream)
    telemetry = {key_of(SamplesMessage, spacecraft, hiding): hidden.samples}
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
        telemetry[key_of(SamplesMessage, spacecraft, name)] = simulate(scenario, wheel, rng).samples
    return Satellite(wheel, telemetry, speed, start_ns, start_ns + round(onset_s * 1e9), hiding, hidden)


def hide(wheel: Wheel, duration_s: float, start_ns: int, rng: Generator) -> Hidden:
    """Draw an effect and simulate a wheel that has it.

    Parameters
    ----------
    wheel
        Its constants, without the effect.
    duration_s
        Length of the record [s].
    start_ns
        Time of the first sample [ns].
    rng
        Source of all randomness.
    """
    drawing, passing = rng.spawn(2)  # separate streams, so that a longer demo only adds passes of the same wheel
    seeds = passing.integers(2**63, size=max(1, int(np.ceil(duration_s / wheel.window_s))))
    block = EFFECTS[drawing.integers(len(EFFECTS))]
    period_ns = round(wheel.window_s * NANOSECONDS_PER_SECOND)
    parts = [_pass(wheel, start_ns + i * period_ns, np.random.default_rng(seed), block) for i, seed in enumerate(seeds)]
    samples = concatenate(parts)
    return Hidden(block, samples[samples.time_ns < start_ns + round(duration_s * NANOSECONDS_PER_SECOND)])


def _pass(wheel: Wheel, start_ns: int, rng: Generator, effect: EffectBlock) -> Samples:
    scenario = Scenario(
        duration_s=wheel.window_s - PAUSE_S,
        start_ns=start_ns,
        speed=SpeedProfile(kind="rich"),
        channels=("friction_torque_Nm", "motor_current_A"),
        effect=(effect,),
    )
    return simulate(scenario, wheel, rng).samples
