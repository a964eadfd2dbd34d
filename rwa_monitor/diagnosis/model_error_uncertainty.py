"""How far a missing effect may have moved a window's estimates of its wheel's friction.

Where the friction model does not fit, its parameters are those of the wrong model: a drag that grows with the square of
speed reads as viscous friction, jumps that no system made as base dry friction. The estimates stay what they are, but
their standard deviations must hold what the effect can have done to them, or a healthy wheel with an incomplete model
is called failing with near certainty. Two things are estimated:

* **shapes**: with each of a few shapes that missing effects have, fitted beside levels and slope to blocks of samples,
  by how much do the slope and the levels move? The largest move by a shape that the window supports counts.
* **split**: the sum of base and switching systems is measured, what is whose was worked out from the jumps. Systems add
  friction, so base dry friction is not above the lowest level; it does not lie far below the nominal one; and where
  steps of the missing effect pass for sojourns of a system, the system may in truth never have rested.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rwa_monitor.changepoints.estimation import Blocks, residual_blocks
from rwa_monitor.changepoints.stage_results import Assignment, Components, Estimate, Evidence
from rwa_monitor.diagnosis.features import Features
from rwa_monitor.kernels.structure import BLOCK
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.wheel.wheel import SwitchingSystem, Wheel

SUPPORTED: Final = 25.0  # fall of the deviance with which a shape counts at all: five standard deviations
COMPARABLE: Final = 0.5  # share of the best shape's fall from which another counts beside it: none need be the true one
LONG_INTERVAL: Final = 0.01  # of the window: the lowest level is that of an interval at least as long
CREDIBLE_SIZE: Final = 0.5  # of the least friction of its configuration: a sojourn with less is none
SMALL_SHARE: Final = 0.3  # of a system's sojourns from which its rests do not count
LONGEST_AWAKE: Final = 4.0  # mean sojourns that a system may well go without a rest
STRIBECK_SPEEDS: Final = (0.03, 0.1, 0.3)  # of the nominal speed: the catalogue's 1 … 100 rad/s at 300 rad/s
# SKF's exponent, near Palmgren's 2/3, and the ends of the catalogue's range: the nearer to 1, the more of such a drag
# the viscous slope takes up, and the less of it shows.
SUBLINEAR: Final = (0.3, 0.6, 0.9)
LAGS_S: Final = (60.0, 300.0)  # s, within the 10 s … 30 min that lubricant takes to follow


@dataclass(frozen=True, slots=True)
class ModelErrorUncertainty:
    """By how much a missing effect may have moved each estimate, one standard deviation each, normalised.

    Attributes
    ----------
    base_dry, viscous
        Of the coefficients.
    systems
        Of the friction of each sojourn of the switching systems.
    """

    base_dry: float
    viscous: float
    systems: float

    def widen(self, features: Features, nominal_viscous: float) -> Features:
        """Return the features with standard deviations that hold this uncertainty.

        Parameters
        ----------
        features
            Of the window, without it.
        nominal_viscous
            The unit of their viscous friction, see `features.normalised_nominal_viscous`.
        """
        systems = []
        for system in features.systems:
            wide = np.where(system.configuration > 0, np.hypot(system.friction_std, self.systems), system.friction_std)
            systems.append(replace(system, friction_std=wide))
        return replace(
            features,
            base_dry_std=float(np.hypot(features.base_dry_std, self.base_dry)),
            viscous_std=float(np.hypot(features.viscous_std, self.viscous / nominal_viscous)),
            systems=tuple(systems),
            by_path=(),  # what a missing effect did to the samples must not decide between paths
        )


def uncertainty_of(
    evidence: Evidence, estimate: Estimate, assignment: Assignment, components: Components, wheel: Wheel
) -> ModelErrorUncertainty:
    """Return the uncertainty of a window whose friction model does not fit.

    Parameters
    ----------
    evidence, estimate, assignment, components
        The window, and what the stages made of it.
    wheel
        Its wheel; inertia and nominal speed scale the shapes.
    """
    blocks = residual_blocks(evidence, estimate, BLOCK)
    slope, level, spread = _moved_by_shapes(blocks, _shapes(blocks, evidence, estimate, wheel), evidence)
    length = np.bincount(blocks.interval, blocks.usable, blocks.intervals) * BLOCK
    long = (length >= LONG_INTERVAL * evidence.slots) & np.isfinite(estimate.level)
    above = max(components.base_dry - float(estimate.level[long].min()), 0.0) if long.any() else 0.0
    # Levels are in units of the nominal dry torque.
    below = max(1.0 - components.base_dry, 0.0) if wheel.nominal else 0.0
    hidden = sum(
        _hidden_friction(system, configurations, friction, evidence.slots)
        for system, configurations, friction in zip(
            wheel.fss, assignment.configurations, components.fss_friction, strict=True
        )
    )
    return ModelErrorUncertainty(
        base_dry=float(np.sqrt(level**2 + above**2 + hidden**2)),
        viscous=slope,
        systems=float(np.sqrt(spread**2 + above**2 + below**2 + hidden**2)),
    )


def _hidden_friction(system: SwitchingSystem, configurations: IntArray, friction: FloatArray, slots: int) -> float:
    """Return the friction that a system may have added all the time, its rests being steps of something else; or 0.

    A system whose rests are credible, by its duration laws or by the size of its sojourns, hides none.
    """
    active = configurations > 0
    awake = sum(law.mean() for law in system.durations[1:])
    if system.friction is None or not active.any() or LONGEST_AWAKE * awake < slots:
        return 0.0
    low = np.array([band.low for band in system.friction])[configurations[active]]
    small = friction[active] < CREDIBLE_SIZE * low
    if small.mean() < SMALL_SHARE:
        return 0.0
    first = system.friction[1]
    return 0.5 * (first.low + first.high)


def _shapes(blocks: Blocks, evidence: Evidence, estimate: Estimate, wheel: Wheel) -> FloatArray:
    """Return the shapes at the blocks, float64 (shapes, blocks), in friction along the motion."""
    x, slots = blocks.x, evidence.slots
    direction = evidence.structure.direction[: x.size]
    speed = direction * x
    acceleration = np.gradient(speed) if x.size > 1 else np.zeros(x.size)
    time = (np.arange(x.size) + 0.5) * BLOCK / slots
    # The motor torque without noise: friction by the model, and the inertia's part.
    inertia = (wheel.inertia_kg_m2 or 0.0) * wheel.speed_unit_rad_s / wheel.torque_unit_Nm
    block_s = BLOCK * wheel.sample_period_s
    level = blocks.friction - blocks.residual
    motor = direction * (level + estimate.viscous * x) + inertia / block_s * acceleration
    shapes = [
        x**2,
        *(x**exponent for exponent in SUBLINEAR),
        *(np.exp(-x / at) for at in STRIBECK_SPEEDS),
        direction,
        direction * x,
        direction * acceleration,
        np.abs(acceleration),
        np.abs(motor),
        *(x - direction * _lagged(speed, block_s / lag_s) for lag_s in LAGS_S),
        time,
        time**2,
        time * x,
        time**2 * x,
    ]
    return np.array(shapes)


def _lagged(speed: FloatArray, share: float) -> FloatArray:
    """Return a first-order lag of the speed, float64 (blocks,); `share` is a block over the time constant."""
    lagged = speed.copy()
    stay = np.exp(-share)
    for b in range(1, speed.size):
        lagged[b] = speed[b] + stay * (lagged[b - 1] - speed[b])
    return lagged


def _moved_by_shapes(blocks: Blocks, shapes: FloatArray, evidence: Evidence) -> tuple[float, float, float]:
    """Return by how much supported shapes move the slope, the levels together, and the levels against each other."""
    weight = np.where(blocks.usable, blocks.n, 0.0)
    total = np.bincount(blocks.interval, weight, blocks.intervals)
    variance = evidence.noise.long_variance
    whole = float(total.sum())
    if not (whole > 0.0 and variance > 0.0):
        return 0.0, 0.0, 0.0
    share = 1.0 / np.maximum(total, 1.0)

    def level_of(values: FloatArray) -> FloatArray:
        return np.bincount(blocks.interval, weight * values, blocks.intervals) * share

    x_level = level_of(blocks.x)
    x = blocks.x - x_level[blocks.interval]
    xx = float(weight @ x**2)
    if not xx > 0.0:
        return 0.0, 0.0, 0.0
    left = blocks.residual - x * (float(weight @ (x * blocks.residual)) / xx)
    found = []
    for shape in shapes:
        shape_level = level_of(shape)
        inside = shape - shape_level[blocks.interval]
        tilt = float(weight @ (x * inside)) / xx
        alone = inside - tilt * x
        energy = float(weight @ alone**2)
        if not energy > 1e-9 * float(weight @ shape**2):
            continue  # levels and slope take it up
        strength = float(weight @ (alone * left)) / energy
        moved = strength * (shape_level - tilt * x_level)
        mean = float(total @ moved) / whole
        together = float(np.sqrt(total @ moved**2 / whole))
        apart = float(np.sqrt(total @ (moved - mean) ** 2 / whole))
        found.append((strength**2 * energy / variance, abs(strength * tilt), together, apart))
    best = max((fall for fall, *_ in found), default=0.0)
    kept = np.array([moves for fall, *moves in found if fall >= max(SUPPORTED, COMPARABLE * best)])
    if kept.size == 0:
        return 0.0, 0.0, 0.0
    slope, level, spread = kept.max(axis=0).tolist()
    return slope, level, spread
