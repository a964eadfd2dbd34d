"""What one of the demo's healthy wheels hides: an effect that the monitor's wheel file lacks, drawn by the seed.

The wheel is exercised in passes. A pass is one window of the monitor and holds a whole "rich" manoeuvre (a ladder of
speeds both ways, slow and fast crossings), for the search is given one window and must see in it what tells the effects
apart. Between two passes no telemetry comes for `PAUSE_S`, in which the wheel goes on to the next manoeuvre.

The effects are those that speed, acceleration and friction show within a pass. Not among them: what needs a temperature
that the demo does not send, and what drifts over more than a pass. `inertia_error` cannot be told from
`torque_constant_error` by any record without a voltage; either name is right.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from rwa_monitor.physics.effects.base import MeanEffect
from rwa_monitor.physics.effects.catalogue import CATALOGUE, to_block
from rwa_monitor.physics.effects.strength import level_columns, strength_for
from rwa_monitor.physics.scenario import Scenario
from rwa_monitor.physics.speed import SpeedProfile
from rwa_monitor.physics.telemetry import Telemetry, simulate
from rwa_monitor.physics.truth import true_channels
from rwa_monitor.physics.wheel import EffectBlock, Wheel
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, Samples, concatenate

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
# Names that no record of current, speed and friction tells apart (tests/blind/equivalence.py has the whole table).
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
    effect, sigmas = draw_effect(wheel, plain, drawing)
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


def draw_effect(wheel: Wheel, plain: Telemetry, rng: np.random.Generator) -> tuple[MeanEffect, float]:
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
    """Say whether two names are one answer in the demo."""
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
