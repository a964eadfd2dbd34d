"""Stage 2: friction of the intervals between changepoints, by least squares (paper, section IV-B).

z = level of the interval + f_v x + noise, one level for each interval, one slope for all. The matrix HᵀH of this
problem is an arrow (diagonal in the levels, one row for the slope), so the slope comes from the sums of all intervals
about their own means, and the levels follow: O(m) from the running sums, without a matrix (errata 6).
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.changepoints.noise import mean_variance_factor
from rwa_monitor.changepoints.stage_results import Estimate, Evidence
from rwa_monitor.kernels.running_sums import slope_within
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.wheel.wheel import Wheel


class SlopePrior(NamedTuple):
    """What is known of the viscous coefficient before the window: Gaussian, normalised.

    Attributes
    ----------
    mean, std
        Centre and standard deviation; NaN where nothing is known.
    """

    mean: float = math.nan
    std: float = math.nan


NOTHING_KNOWN: Final = SlopePrior()
# A viscous anomaly raises f_v by tens of per cent; the prior must not hide it from a window that can show it.
NOMINAL_SLOPE_SPREAD: Final = 0.3  # [of the nominal coefficient]


def nominal_viscous(wheel: Wheel) -> float | None:
    """Return the nominal viscous coefficient in normalised units (1 in the paper), None where it is not known."""
    if wheel.nominal is None:
        return None
    return wheel.nominal.viscous_Nm_s_rad * wheel.speed_unit_rad_s / wheel.torque_unit_Nm


def nominal_slope_prior(wheel: Wheel, spread: float = NOMINAL_SLOPE_SPREAD) -> SlopePrior:
    """Return the prior of f_v that the wheel's nominal values give; nothing is known where there are none."""
    nominal = nominal_viscous(wheel)
    # A wheel may have next to no viscous friction; the dry torque at nominal speed then sets the spread.
    return NOTHING_KNOWN if nominal is None else SlopePrior(nominal, spread * max(nominal, 0.1))


def estimate(evidence: Evidence, index: IntArray, prior: SlopePrior = NOTHING_KNOWN) -> Estimate:
    """Estimate the level of each interval and the shared slope.

    Parameters
    ----------
    evidence
        The window.
    index
        int64 (m,), changepoints, strictly ascending, within 1 … slots - 1.
    prior
        What is known of the slope. Needed where the window cannot show it (constant speed).

    Returns
    -------
    Estimate. An interval without any used sample takes the level of its left neighbour (the first: the right one's),
    with infinite standard deviation. Where neither the data nor a prior show anything of the slope, it is 0 with
    infinite standard deviation, and the levels' standard deviations are infinite wherever the speed is not zero.
    """
    index = np.asarray(index, dtype=np.int64)
    noise, whole = evidence.noise, np.zeros(index.size, dtype=np.int64)  # no slots are left out beside a changepoint
    variance = noise.std**2 * noise.long_run_factor
    slope, slope_std = slope_within(evidence.slots, index, whole, evidence.sums.arrays, variance, *prior)
    sums = evidence.sums.intervals(index)
    seen, n = sums.n > 0.0, np.maximum(sums.n, 1.0)
    mean_variance = mean_variance_factor(noise, n) / n
    x_mean, z_mean = sums.x / n, sums.z / n
    sxx, sxz = np.maximum(sums.xx - sums.x * x_mean, 0.0), sums.xz - sums.x * z_mean
    errors = np.maximum(sums.zz - sums.z * z_mean, 0.0) - 2.0 * slope * sxz + slope * slope * sxx
    level = np.where(seen, z_mean - slope * x_mean, np.nan)
    # An interval at zero speed does not feel the slope, however unknown.
    felt = np.where(x_mean != 0.0, slope_std, 0.0)
    step = np.diff(x_mean)
    shared = step * step * np.where(step != 0.0, slope_std, 0.0) ** 2
    jump_std = np.sqrt(noise.std**2 * (mean_variance[:-1] + mean_variance[1:]) + shared)
    # An interval without samples has the level of the last seen one before it, or of the first.
    place = np.maximum.accumulate(np.where(seen, np.arange(n.size), np.argmax(seen)))
    total = float(sums.n.sum())
    rmse = math.sqrt(max(float(np.cumsum(errors)[-1]), 0.0) / total) if total else 0.0
    return Estimate(
        index=index,
        level=level[place] if seen.any() else np.zeros(n.size),
        level_std=np.where(seen, np.sqrt(noise.std**2 * mean_variance + x_mean * x_mean * felt * felt), np.inf),
        jump_std=np.where(seen[:-1] & seen[1:], jump_std, np.inf),
        viscous=slope,
        viscous_std=slope_std,
        rmse=rmse,
        excess_rmse=rmse - noise.std if total else 0.0,
    )


# ---- residuals of short blocks, from running sums: no sample is read again -------------------------------------------


@dataclass(frozen=True, slots=True)
class Blocks:
    """Blocks of equal length, in order; arrays (blocks,).

    Attributes
    ----------
    size
        Slots of a block.
    n
        Used samples of each.
    x
        Their mean speed, normalised.
    friction
        Their mean friction less the viscous part, normalised.
    residual
        The same less the level of their interval.
    interval
        Number of the interval between changepoints that the block lies in.
    usable
        Whether it lies in one interval and at least half of its slots are used.
    intervals
        Number of intervals.
    """

    size: int
    n: FloatArray
    x: FloatArray
    friction: FloatArray
    residual: FloatArray
    interval: IntArray
    usable: BoolArray
    intervals: int


def residual_blocks(evidence: Evidence, estimate: Estimate, size: int) -> Blocks:
    """Cut a window into blocks and return what the friction model leaves of them.

    Parameters
    ----------
    evidence, estimate
        The window, and its levels and slope between the accepted changepoints.
    size
        Slots of a block; with a multiple of the running sums' stride no sample is read. The rest of the window that
        fills no block is left out.
    """
    index, count = estimate.index, estimate.index.size + 1
    edges = size * np.arange(evidence.slots // size + 1)
    sums = evidence.sums.between(edges[:-1], edges[1:])
    n = np.maximum(sums.n, 1.0)
    friction = (sums.z - estimate.viscous * sums.x) / n
    interval = np.searchsorted(index, edges[:-1], side="right")
    usable = (sums.n >= size // 2) & (interval == np.searchsorted(index, edges[1:]))
    # The level is the blocks' own: an estimate leaves out samples beside the jumps, and a difference would look alike
    # in all blocks.
    total, level = (np.bincount(interval, usable * n * values, count) for values in (np.ones(n.size), friction))
    residual = friction - (level / np.maximum(total, 1.0))[interval]
    return Blocks(size, n, sums.x / n, friction, residual, interval, usable, count)
