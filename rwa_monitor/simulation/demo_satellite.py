"""The satellite of the demo: four simulated wheels; one begins to fail, one has an effect that its wheel file lacks.

The monitor gets nothing of this but the samples; the rest is printed at the end, so that the user can compare.

The wheel with the effect, drawn by the seed, is exercised in passes. A pass is one window of the monitor and holds a
whole "rich" manoeuvre (speeds in steps both ways, slow and fast crossings), for the search is given one window and must
see in it what separates the effects. Between two passes no telemetry comes for `PAUSE_S`, in which the wheel goes on to
the next manoeuvre.

The effects are those that speed, acceleration and friction show within a pass. Not among them: what needs a temperature
that the demo does not send, and what drifts over more than a pass. No record without a voltage separates
`inertia_error` from `torque_constant_error`; either name is right.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from rwa_monitor.samples import NANOSECONDS_PER_SECOND, Samples, concatenate
from rwa_monitor.simulation.datasets import scaled_wheel
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import Telemetry, simulate
from rwa_monitor.simulation.scenario import Anomaly, Scenario
from rwa_monitor.simulation.truth import true_channels
from rwa_monitor.wheel.effects.base import MeanEffect
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, to_block
from rwa_monitor.wheel.effects.strength import level_columns, strength_for
from rwa_monitor.wheel.wheel import EffectBlock, Wheel, Window, built_in_wheel

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
PAUSE_S: Final = 60.0  # simulated time; twice as long as the wheel takes from rest to its nominal speed
STRENGTH_SIGMAS: Final = (1.0, 2.0)  # RMS of the part orthogonal to sign, speed and levels, in σ of the noise
# By effect, the ranges of its shape parameters, drawn log-uniformly: about the catalogue's typical values, and such
# that the shape lies within the speeds (10 … 300 rad/s) and times (dwells and moves of 30 … 200 s) of a pass.
EFFECTS: Final[dict[str, dict[str, tuple[float, float]]]] = {
    "stribeck": {"stribeck_speed_rad_s": (6.0, 30.0)},
    "quadratic_drag": {},
    "sublinear_viscous": {"exponent": (0.4, 0.7)},
    "torque_bias": {},
    "viscous_asymmetry": {},
    "inertia_error": {},
    "lubricant_lag": {"time_constant_s": (20.0, 100.0)},
}
# Names that no record of current, speed and friction separates (tests/blind/equivalence.py has the whole table).
SAME: Final = (frozenset({"inertia_error", "torque_constant_error"}),)


@dataclass(frozen=True, slots=True)
class Hidden:
    """A wheel with an effect that its wheel file lacks.

    Attributes
    ----------
    effect
        Its name and parameters.
    sigmas
        RMS of what base law and levels cannot take up of it, in standard deviations of the noise.
    samples
        What the wheel sends.
    """

    effect: EffectBlock
    sigmas: float
    samples: Samples


@dataclass(frozen=True, slots=True)
class Satellite:
    """What is published, and what is true.

    Attributes
    ----------
    wheel
        Constants of all four wheels: what the monitor gets.
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
    return Satellite(wheel, telemetry, speed, start_ns, start_ns + round(onset_s * 1e9), hiding, hidden)


def hide(wheel: Wheel, duration_s: float, start_ns: int, rng: np.random.Generator) -> Hidden:
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
    drawing, passing = rng.spawn(2)  # a longer demo has more passes of the same wheel
    seeds = passing.integers(2**63, size=max(1, int(np.ceil(duration_s / pass_s(wheel)))))
    # The strength is measured on the first pass as it would be without the effect.
    plain = _pass(wheel, start_ns, np.random.default_rng(seeds[0]))
    effect, sigmas = _draw_effect(wheel, plain, drawing)
    block = to_block(effect)
    period_ns = round(pass_s(wheel) * NANOSECONDS_PER_SECOND)
    parts = [
        _pass(wheel, start_ns + i * period_ns, np.random.default_rng(seed), block).samples
        for i, seed in enumerate(seeds)
    ]
    samples = concatenate(parts)
    return Hidden(block, sigmas, samples[samples.time_ns < start_ns + round(duration_s * NANOSECONDS_PER_SECOND)])


def pass_s(wheel: Wheel) -> float:
    """Return the time from one pass to the next [s]: a window of the monitor."""
    return wheel.window.samples * wheel.sample_period_s


def _draw_effect(wheel: Wheel, plain: Telemetry, rng: np.random.Generator) -> tuple[MeanEffect, float]:
    """Draw effect, shape and strength; the strength from what the base law cannot take up on a motion.

    Parameters
    ----------
    wheel
        The wheel.
    plain
        A record of it without the effect: its motion, its jumps, its noise.
    rng
        Source of all randomness.

    Returns
    -------
    MeanEffect, float
        The effect, and its strength in standard deviations of the noise.
    """
    name = str(rng.choice(list(EFFECTS)))
    effect = CATALOGUE[name]
    assert issubclass(effect, MeanEffect)
    drawn = {key: float(np.exp(rng.uniform(*np.log(bounds)))) for key, bounds in EFFECTS[name].items()}
    fixed = {p.name: p.typical for p in effect.shape_parameters() if p.name not in drawn}
    shape = {**drawn, **fixed}
    sigmas = float(rng.uniform(*STRENGTH_SIGMAS))
    channels = true_channels(plain.truth, wheel, plain.truth.used)
    levels = level_columns(channels.direction, np.unique(plain.truth.changepoints.index))
    strengths = strength_for(effect, shape, channels, levels, sigmas * plain.truth.noise_std_Nm, rng)
    return effect(**shape, **strengths), sigmas


def same(name: str, other: str) -> bool:
    """Return whether two names are one answer in the demo."""
    return name == other or any({name, other} <= group for group in SAME)


def _pass(wheel: Wheel, start_ns: int, rng: np.random.Generator, *effects: EffectBlock) -> Telemetry:
    scenario = Scenario(
        duration_s=pass_s(wheel) - PAUSE_S,
        start_ns=start_ns,
        speed=SpeedProfile(kind="rich"),
        channels=("friction_torque_Nm", "motor_current_A"),
        effect=effects,
    )
    return simulate(scenario, wheel, rng)
