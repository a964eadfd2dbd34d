"""Records of friction without jumps for the tests of this room: four motions, and autocorrelated noise."""

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.signal import lfilter

from rwa_monitor.discrepancy.explanation import prepare
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.wheel import Wheel
from tests.discrepancy.simple import DRY_NM, NOISE_NM, VISCOUS, WHEEL, Array, sampled

COUNT: Final = 600


def coast_down(count: int = COUNT) -> Array:
    """Return the speed of a wheel that coasts down to an eighth of its speed by dry and viscous friction [rad/s]."""
    return np.asarray(330.0 * np.exp(-1.6 * np.arange(count) / count) - 25.0)


def reversals(count: int = COUNT) -> Array:
    """Return a sine about zero, two and a half times [rad/s]."""
    return np.asarray(250.0 * np.sin(2 * np.pi * 2.5 * np.arange(count) / count + 0.3))


def ladder(count: int = COUNT) -> Array:
    """Return ten dwells, up and down, with slews between [rad/s]."""
    heights = np.array([40.0, 90.0, 140.0, 200.0, 260.0, 230.0, 170.0, 110.0, 60.0, 25.0])
    place = np.arange(count) / count * heights.size - 0.5
    return np.asarray(
        np.interp(np.round(place) + np.clip(4.0 * (place - np.round(place)), -0.5, 0.5), range(10), heights)
    )


def two_sines(count: int = COUNT) -> Array:
    """Return two sines of no common period about a mean [rad/s]."""
    turn = 2 * np.pi * np.arange(count) / count
    return np.asarray(20.0 + 120.0 * np.sin(2.0 * turn) + 90.0 * np.sin(3.7 * turn + 1.0))


MOTIONS: Final[dict[str, Callable[[], Array]]] = {
    "coast-down": coast_down,
    "reversals": reversals,
    "ladder": ladder,
    "two sines": two_sines,
}
CORRELATIONS: Final = (0.0, 0.5, 0.9, 0.97, 0.99, 0.999)


def remembering(count: int, correlation: float, rng: np.random.Generator) -> Array:
    """Return stationary AR(1) noise of variance 1."""
    fresh = rng.normal(size=count)
    fresh[1:] *= np.sqrt(1.0 - correlation**2)
    return np.asarray(lfilter([1.0], [1.0, -correlation], fresh))


def smooth_record(
    speed: Array,
    effect: Array | float = 0.0,
    correlation: float = 0.0,
    seed: int = 0,
    noise_Nm: float = NOISE_NM,
) -> Samples:
    """Return samples of dry and viscous friction, one further effect, and noise that is half white and half AR(1)."""
    rng = np.random.default_rng(seed)
    noise = np.sqrt(0.5) * (remembering(speed.size, correlation, rng) + rng.normal(size=speed.size))
    friction = np.sign(speed) * DRY_NM + VISCOUS * speed + effect + noise_Nm * noise
    return sampled(speed + rng.normal(0.0, 0.01, speed.size), friction)


def null_record(motion: str, correlation: float, seed: int) -> Samples:
    """Return a record of the base model; its noise is AR(1) alone."""
    rng = np.random.default_rng([seed, list(MOTIONS).index(motion), round(1000 * correlation)])
    speed = MOTIONS[motion]()
    noise = NOISE_NM * remembering(speed.size, correlation, rng)
    return smooth_record(speed, noise, seed=seed, noise_Nm=0.0)


def problem_of(*samples: Samples, wheel: Wheel = WHEEL) -> Problem:
    """Join recordings to a problem."""
    return prepare([make_record(one, wheel, f"recording {i}") for i, one in enumerate(samples)], wheel)
