"""Does the friction model fit the window? A cheap check at every window close, from running sums alone.

The model is that between jumps friction is a level plus one viscous slope plus noise, and that jumps are as frequent
as the switching systems make them. An effect missing from it is detected by one of these tests:

* **slopes**: intervals at different speeds have different slopes;
* **sides**: friction changes with the direction of rotation;
* **near zero**: friction in the dead band, which no running sum holds, differs from that around it, or the speed reads
  zero while the wheel passes through;
* **ripple**: friction is periodic in the wheel's angle;
* **jumps**: a smooth effect is fitted by steps, so that there are too many jumps, or jumps that no system made;
* **persistence**: residuals of neighbouring blocks of samples are correlated over longer lags than the noise is.

The search in `rwa_monitor.discrepancy` identifies the cause from the samples; here only a suspicion is raised.

Where the friction model does not fit, its parameters are those of the wrong model: a drag that grows with the square of
speed is estimated as viscous friction, jumps that no system made as base dry friction. The estimates are not changed,
but their standard deviations must include the error that the effect may have caused, or a healthy wheel with an
incomplete model is diagnosed as anomalous with near certainty. `uncertainty_of` estimates two parts:

* **shapes**: each of a few shapes of missing effects is fitted to blocks of samples together with levels and slope. The
  largest change of slope and levels by a shape that the window supports counts.
* **split**: the sum of base and switching systems is measured, its split was inferred from the jumps. Systems add
  friction, so base dry friction is not above the lowest level; it does not lie far below the nominal one; and where
  steps of the missing effect are mistaken for sojourns of a system, the system may in truth never have rested.
"""

import functools
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy import special

from rwa_monitor.changepoints.estimation import Blocks, residual_blocks
from rwa_monitor.changepoints.noise import NORMAL_MEDIAN, ar_coefficient, median_size
from rwa_monitor.changepoints.stage_results import REJECTED, UNATTRIBUTED, Assignment, Components, Estimate, Evidence
from rwa_monitor.diagnosis.features import Features
from rwa_monitor.kernels.noise import lagged_products
from rwa_monitor.kernels.running_sums import BLOCK, STRIDE
from rwa_monitor.samples import TINY, FloatArray, IntArray
from rwa_monitor.wheel.switching_systems import jump_rate
from rwa_monitor.wheel.wheel import SwitchingSystem, Wheel

# Standard deviations from which an interval's slope disagrees with the common one, and at which a block's residual is
# clipped: 1 in 16,000 by chance.
DISAGREEING_SIGMAS: Final = 4.0
# A single missed jump or sojourn distorts one or two intervals, or lies in two crossings, and a healthy window may have
# an unattributed jump. Only this many or more are evidence against the model.
MIN_EVIDENCE: Final = 3
DISAGREEING_SHARE: Final = 0.25  # of the intervals, where that is more
MIN_INTERVAL: Final = 30.0  # samples: the slope of a shorter interval is not used
SMALLEST_SPREAD: Final = 1e-9  # centred over plain sum of squares: below, rounding dominates the centred one
# Healthy windows have at most 1.2 standard deviations more jumps than expected (their durations are more regular than a
# Poisson process, whose spread is used).
EXCESS_SIGMAS: Final = 3.0
CLEAR_TREND: Final = 0.6  # rank correlation of slope and speed from which its sign suggests an effect

PERSISTENCE_LAGS: Final = np.arange(2, 9)
FEWEST_BLOCKS: Final = 40  # with fewer, the statistic's asymptotic distribution does not hold
# Residuals of blocks are compared with those two to eight blocks later, so that at least one block lies in between.
# Noise with a memory shorter than a block gives χ² with seven degrees of freedom; AR(1) noise is corrected for.
# Least significance, and least size in standard deviations of the noise: friction derived from speed by a filter of 2 s
# retains up to 0.14 of a smooth motion in healthy windows, at a significance of 60 in blocks of STRIDE slots and 310 of
# BLOCK.
SHORT_PERSISTS: Final = (400.0, 0.10)
PERSISTS: Final = (60.0, 0.18)

NEAR_ZERO_RATIO: Final = 5.0  # mean squared deviation over the noise's from which a crossing disagrees
FEWEST_CROSSINGS: Final = 2  # that must disagree: a short sojourn may fall into one
FEWEST_NEAR_ZERO: Final = 4.0  # samples of a crossing

SIDE_BLOCKS: Final = 4  # on either side of a crossing
SIDE_SHARE: Final = 0.75  # of all crossings
EQUAL_FACTOR: Final = 2.0  # factor about their median within which the differences count as equal: jumps vary more
CLEAR_SIGMAS: Final = 5.0  # from which a difference of sides, or what a missing effect explains, counts at all
SMALLEST_SIDE: Final = 0.2  # standard deviations of the noise: a smaller difference is ignored

RIPPLE_CAP: Final = 40.0  # upper limit of the power in one segment: a jump in it has power at all frequencies
RIPPLE_CHANCE: Final = 1e-4  # false-alarm probability of all harmonics in a window, for white noise
# Least and largest allowance for autocorrelated noise, whose spectrum may peak at the very frequency of a harmonic;
# beyond the largest no ripple could be detected at all.
RIPPLE_NOISE_FACTORS: Final = (2.0, 8.0)


class Adequacy(NamedTuple):
    """Which effect of the catalogue may be missing, and the finding in words; "" where the friction model fits."""

    suspected_effect: str | None
    finding: str

    @property
    def adequate(self) -> bool:
        """Whether the friction model fits."""
        return not self.finding


FITS: Final = Adequacy(None, "")


def check(
    evidence: Evidence, estimate: Estimate, assignment: Assignment, systems: Sequence[SwitchingSystem]
) -> Adequacy:
    """Check the friction model on one window.

    Parameters
    ----------
    evidence, estimate, assignment
        Results of the stages.
    systems
        Switching systems of the wheel; without any, jumps cannot be attributed and are no evidence against the model.

    Returns
    -------
    Adequacy
        The first of the tests that fails names the finding: those that suspect an effect come first.
    """
    blocks = residual_blocks(evidence, estimate, BLOCK)
    return (
        slope_finding(evidence, estimate)
        or side_finding(evidence, blocks)
        or near_zero_finding(evidence, estimate)
        or ripple_finding(evidence)
        or jump_finding(evidence, assignment, systems)
        or persistence_finding(evidence, blocks, PERSISTS)
        or persistence_finding(evidence, residual_blocks(evidence, estimate, STRIDE), SHORT_PERSISTS)
        or FITS
    )


# ---- slopes ----------------------------------------------------------------------------------------------------------


def slope_finding(evidence: Evidence, estimate: Estimate) -> Adequacy | None:
    """Compare the slopes of the intervals."""
    deviation, speed = _slope_deviations(evidence, estimate)
    disagreeing = int((np.abs(deviation) > DISAGREEING_SIGMAS).sum())
    if disagreeing < max(MIN_EVIDENCE, DISAGREEING_SHARE * deviation.size):
        return None
    finding = f"the viscous slope differs between intervals ({disagreeing} of {deviation.size})"
    trend = _rank_correlation(speed, deviation) if np.ptp(speed) > 0 and np.ptp(deviation) > 0 else 0.0
    suspect = "sublinear_viscous" if trend < 0.0 else "quadratic_drag"
    return Adequacy(suspect if abs(trend) > CLEAR_TREND else None, finding)


def _rank_correlation(x: FloatArray, y: FloatArray) -> float:
    """Return Spearman's rank correlation, equal values sharing their mean rank."""
    ranks = []
    for values in (x, y):
        _, place, count = np.unique(values, return_inverse=True, return_counts=True)
        ranks.append((np.cumsum(count) - 0.5 * (count - 1))[place])
    return float(np.corrcoef(ranks)[1, 0])


def _slope_deviations(evidence: Evidence, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
    """Return each interval's slope less the common one in standard deviations, and its mean speed; (intervals,)."""
    count, x, z, xx, xz, _ = evidence.sums.intervals(estimate.index)
    variance = evidence.noise.long_variance
    n = np.maximum(count, 1.0)
    spread, cross = xx - x * x / n, xz - x * z / n
    # The speed must vary within the interval by more than rounding, or rounding is taken for a slope.
    valid = (count >= MIN_INTERVAL) & (spread > SMALLEST_SPREAD * np.maximum(xx, TINY))
    if np.count_nonzero(valid) < 2 or not variance > 0.0:
        return np.zeros(0), np.zeros(0)
    spread, cross = spread[valid], cross[valid]
    deviation = (cross / spread - cross.sum() / spread.sum()) * np.sqrt(spread / variance)
    return np.asarray(deviation), np.asarray((x / n)[valid])


# ---- sides -----------------------------------------------------------------------------------------------------------


def side_finding(evidence: Evidence, blocks: Blocks) -> Adequacy | None:
    """Test whether friction differs between the directions of rotation, from the levels just before and after zero."""
    half = half_differences(evidence, blocks)
    if half.size < MIN_EVIDENCE:
        return None
    same = half if np.median(half) > 0.0 else -half
    same = same[same > CLEAR_SIGMAS]
    middle = np.median(same) if same.size else 0.0
    alike = same[(same < EQUAL_FACTOR * middle) & (same > middle / EQUAL_FACTOR)]
    if alike.size < max(MIN_EVIDENCE, SIDE_SHARE * half.size):
        return None
    finding = f"friction differs between the directions of rotation ({alike.size} of {half.size} crossings)"
    return Adequacy("torque_bias", finding)


def half_differences(evidence: Evidence, blocks: Blocks) -> FloatArray:
    """Return half the difference of friction between forward and backward at each crossing, in standard deviations.

    float64 (crossings,). From four blocks on either side, up to the next changepoint: only jumps in the crossing itself
    enter, and their sign does not depend on the direction.
    """
    variance = evidence.noise.long_variance
    smallest = SMALLEST_SIDE * evidence.noise.std / CLEAR_SIGMAS
    direction = evidence.structure.direction[: blocks.n.size]
    one_way = np.flatnonzero(blocks.usable & (np.abs(direction) == 1.0))
    turns = np.flatnonzero(np.diff(direction[one_way]))
    found = []
    for left, right in zip(one_way[turns].tolist(), one_way[turns + 1].tolist(), strict=True):
        before, before_n = _mean_near(blocks, direction, slice(max(left - SIDE_BLOCKS + 1, 0), left + 1), left)
        after, after_n = _mean_near(blocks, direction, slice(right, right + SIDE_BLOCKS), right)
        std = 0.5 * math.sqrt(variance * (1.0 / before_n + 1.0 / after_n))
        found.append(0.5 * (after - before) * direction[right] / max(std, smallest))
    return np.array(found)


def _mean_near(blocks: Blocks, direction: FloatArray, near: slice, own: int) -> tuple[float, float]:
    """Return the mean friction of the near blocks of one interval and direction with block `own`, and its samples."""
    alike = blocks.usable[near] & (blocks.interval[near] == blocks.interval[own])
    n = np.where(alike & (direction[near] == direction[own]), blocks.n[near], 0.0)
    return float(n @ blocks.friction[near] / n.sum()), float(n.sum())


# ---- near zero -------------------------------------------------------------------------------------------------------


def near_zero_finding(evidence: Evidence, estimate: Estimate) -> Adequacy | None:
    """Compare the friction in the dead band with the levels around it, crossing by crossing."""
    structure = evidence.structure
    if structure.plateaus and 2 * structure.plateaus >= structure.zero_runs:
        finding = f"the speed reads zero while the wheel passes through it ({structure.plateaus} times)"
        return Adequacy("speed_dead_zone", finding)
    ratio, excess = near_zero_deviations(evidence, estimate)
    disagreeing = int((ratio > NEAR_ZERO_RATIO).sum())
    if disagreeing < FEWEST_CROSSINGS or 2 * disagreeing < ratio.size:
        return None
    # Drag that lags the sign is missing just after a reversal; boundary lubrication adds drag on both sides of it.
    suspect = "presliding" if excess[ratio > NEAR_ZERO_RATIO].sum() < 0.0 else "stribeck"
    finding = f"friction near zero speed differs from the levels around it ({disagreeing} of {ratio.size} crossings)"
    return Adequacy(suspect, finding)


def near_zero_deviations(evidence: Evidence, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
    """Return how friction in the dead band deviates from the levels around it, crossing by crossing; (crossings,).

    Only where the wheel reverses: at rest, friction balances whatever torque is applied.

    Returns
    -------
    ratio, excess
        Mean squared deviation over the noise's variance; mean deviation, normalised.
    """
    structure = evidence.structure
    n, direction = structure.near_zero[0], structure.direction
    edges = np.flatnonzero(np.diff(np.concatenate(([False], n != 0.0, [False])).astype(np.int8)))
    squares, deviations = [], []
    for first, stop in edges.reshape(-1, 2).tolist():
        if first == 0 or stop == n.size or not direction[first - 1] * direction[stop] < 0.0:
            continue
        low, high = np.searchsorted(estimate.index, [(first - 1) * BLOCK, (stop + 1) * BLOCK]).tolist()
        count, x, z, zz = structure.near_zero[:, first:stop]
        # Each block is compared with the best fitting of the adjacent levels: (levels, blocks).
        expected = estimate.level[low : high + 1, None] + estimate.viscous * x / count
        square = np.maximum(zz - 2.0 * expected * z + count * expected**2, 0.0)
        best = np.argmin(square, axis=0), np.arange(count.size)
        counted = np.ones(count.size)
        if high > low:  # a jump lies in or next to the crossing: the worst block holds it
            counted[np.argmax(square[best])] = 0.0
        samples = float(counted @ count)
        if samples >= FEWEST_NEAR_ZERO:
            squares.append(float(counted @ square[best]) / samples)
            deviations.append(float(counted @ (z - count * expected[best])) / samples)
    return np.array(squares) / evidence.noise.std**2, np.array(deviations)


# ---- ripple ----------------------------------------------------------------------------------------------------------


def ripple_finding(evidence: Evidence) -> Adequacy | None:
    """Test whether friction is periodic in the wheel's angle."""
    ripple = evidence.structure.ripple
    if len(ripple) == 0:
        return None
    valid = np.isfinite(ripple)
    power = np.where(valid, np.minimum(ripple, RIPPLE_CAP), 0.0).sum(axis=0)
    over_chance = power / _ripple_by_chance(*ripple.shape)[np.count_nonzero(valid, axis=0)]
    strongest = int(np.argmax(over_chance))
    # The least allowance is tested first: it nearly always decides, and the spectrum need not be computed.
    found, (least, most) = over_chance[strongest], RIPPLE_NOISE_FACTORS
    if found < least or found < min(_spectral_peak(evidence.noise.autocovariance), most):
        return None
    return Adequacy("torque_ripple", f"friction repeats with the wheel's angle, {strongest + 1} times in a turn")


@functools.lru_cache(maxsize=256)
def _ripple_by_chance(segments: int, harmonics: int) -> FloatArray:
    """Return the power, summed over 0 … segments, that white noise exceeds in any harmonic with `RIPPLE_CHANCE`."""
    valid = np.arange(segments + 1)
    return np.asarray(special.chdtri(2.0 * np.maximum(valid, 1), RIPPLE_CHANCE / harmonics))


def _spectral_peak(autocovariance: FloatArray) -> float:
    """Return the largest value of the noise's spectrum over its mean, from its autocovariance."""
    two_sided = np.concatenate([autocovariance, np.zeros(autocovariance.size), autocovariance[:0:-1]])
    return float(np.fft.rfft(two_sided).real.max() / autocovariance[0])


# ---- jumps -----------------------------------------------------------------------------------------------------------


def jump_finding(evidence: Evidence, assignment: Assignment, systems: Sequence[SwitchingSystem]) -> Adequacy | None:
    """Compare the jumps with what the switching systems make."""
    unattributed = int((assignment.system == UNATTRIBUTED).sum())
    jumps = int((assignment.system != REJECTED).sum())
    expected = evidence.slots * sum(map(jump_rate, systems))
    if systems and unattributed >= MIN_EVIDENCE:
        finding = f"{unattributed} of {jumps} jumps fit no switching system"
    elif systems and jumps - expected > EXCESS_SIGMAS * np.sqrt(expected) + MIN_EVIDENCE:
        finding = f"there are {jumps} jumps where the switching systems make about {expected:.0f}"
    else:
        return None
    # Most jumps are unattributed though all slopes agree: a further system, if not an effect in a narrow speed range.
    return Adequacy("extra_switching_system" if 2 * unattributed > jumps else None, finding)


# ---- persistence -----------------------------------------------------------------------------------------------------


def persistence_finding(evidence: Evidence, blocks: Blocks, least: tuple[float, float]) -> Adequacy | None:
    """Test whether residuals of blocks are correlated with later ones; `least` as in PERSISTS."""
    significance, size = persistence(blocks, ar_coefficient(evidence.noise))
    if significance > least[0] and size > least[1] * evidence.noise.std:
        return Adequacy(None, "what friction is left beside levels and slope goes on for longer than noise")
    return None


def persistence(blocks: Blocks, correlation: float) -> tuple[float, float]:
    """Return how far the residuals of blocks are from independent of later ones of their interval.

    A portmanteau statistic: the sum of squares of the correlations at PERSISTENCE_LAGS, each in standard deviations,
    so that oscillation counts like persistence. The interval that contributes most is left out, where there are three
    or more: a single missed sojourn causes one.

    Parameters
    ----------
    blocks
        Residuals of blocks.
    correlation
        φ of AR(1) noise, 0 for any other.

    Returns
    -------
    significance, size
        χ² with one degree of freedom for each lag, for noise with a shorter memory; and the root mean square of the
        persistent part, normalised. Both 0 with too few blocks.
    """
    value, interval, intervals = blocks.residual * np.sqrt(blocks.n), blocks.interval, blocks.intervals
    known = value[blocks.usable]
    scale = median_size(known) / NORMAL_MEDIAN if known.size >= FEWEST_BLOCKS else 0.0
    if not scale > 0.0:
        return 0.0, 0.0
    usable = blocks.usable.astype(np.float64)
    capped = np.clip(value / scale, -DISAGREEING_SIGMAS, DISAGREEING_SIGMAS) * usable
    pairs = lagged_products(usable, interval, intervals, PERSISTENCE_LAGS)
    # Subtracting the level of an interval of m blocks correlates any two of them by -1/m.
    expected = np.array([_ar_block_correlation(correlation, blocks.size, lag) for lag in PERSISTENCE_LAGS.tolist()])
    level = 1.0 / np.maximum(np.bincount(interval, usable, intervals), 1.0)
    products = lagged_products(capped, interval, intervals, PERSISTENCE_LAGS) - pairs * (expected - level[:, None])
    if np.count_nonzero(pairs[:, 0]) >= MIN_EVIDENCE:
        worst = np.argmax(np.square(products).sum(axis=1))
        products[worst] = pairs[worst] = 0.0
    total, count = products.sum(axis=0), np.maximum(pairs.sum(axis=0), 1.0)
    mean_product = scale * scale * float(np.abs(total / count).max())
    return float((total * total / count).sum()), math.sqrt(mean_product / blocks.size)


def _ar_block_correlation(phi: float, size: int, lag: int) -> float:
    """Return the correlation of the means of two blocks of AR(1) noise, `lag` blocks apart; 0 unless φ is positive."""
    if phi <= 0.0:
        return 0.0
    apart = phi ** ((lag - 1) * size + 1) * ((1.0 - phi**size) / (1.0 - phi)) ** 2
    within = (size * (1.0 - phi**2) - 2.0 * phi * (1.0 - phi**size)) / (1.0 - phi) ** 2
    return float(apart / within)


# ---- how far a missing effect may have moved the estimates -----------------------------------------------------------


COMPARABLE_SHARE: Final = 0.5  # share of the best shape's decrease of χ² from which another shape counts too
LONG_INTERVAL: Final = 0.01  # of the window: the lowest level is that of an interval at least as long
MIN_CREDIBLE_RATIO: Final = 0.5  # of the least friction of its configuration: a sojourn with less is not credible
IMPLAUSIBLE_SHARE: Final = 0.3  # of a system's sojourns: if this share is not credible, its rests are not either
MAX_ACTIVE_FACTOR: Final = 4.0  # multiple of the mean time above q = 0 for which a system may well not rest
STRIBECK_SPEEDS: Final = (0.03, 0.1, 0.3)  # of the nominal speed: the catalogue's 1 … 100 rad/s at 300 rad/s
# SKF's exponent, near Palmgren's 2/3, and the ends of the catalogue's range: the nearer to 1, the more of such a drag
# the viscous slope absorbs, and the less of it is detectable.
SUBLINEAR: Final = (0.3, 0.6, 0.9)
LAGS_S: Final = (60.0, 300.0)  # s, within the 10 s … 30 min of the lubricant's time constant


class ModelErrorUncertainty(NamedTuple):
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

    def widen(self, features: Features) -> Features:
        """Return the features of the window with standard deviations that include this uncertainty."""
        systems = []
        for system in features.systems:
            wide = np.where(system.configuration > 0, np.hypot(system.friction_std, self.systems), system.friction_std)
            systems.append(system._replace(friction_std=wide))
        return features._replace(
            base_dry_std=float(np.hypot(features.base_dry_std, self.base_dry)),
            viscous_std=float(np.hypot(features.viscous_std, self.viscous / features.viscous_unit)),
            systems=tuple(systems),
            by_path=(),  # the error by a missing effect must not decide between paths
        )


def uncertainty_of(
    evidence: Evidence, estimate: Estimate, assignment: Assignment, components: Components, wheel: Wheel
) -> ModelErrorUncertainty:
    """Return the uncertainty of a window whose friction model does not fit.

    Parameters
    ----------
    evidence, estimate, assignment, components
        The window, and the results of its stages.
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
        base_dry=math.sqrt(level**2 + above**2 + hidden**2),
        viscous=slope,
        systems=math.sqrt(spread**2 + above**2 + below**2 + hidden**2),
    )


def _hidden_friction(system: SwitchingSystem, configurations: IntArray, friction: FloatArray, slots: int) -> float:
    """Return the friction that a system may have added throughout, if its rests are steps of another effect; else 0.

    It is 0 where the rests are credible, by the system's duration laws or by the size of its sojourns.
    """
    active = configurations > 0
    awake = sum(law.mean() for law in system.durations[1:])
    if system.friction is None or not active.any() or MAX_ACTIVE_FACTOR * awake < slots:
        return 0.0
    low = np.array([band.low for band in system.friction])[configurations[active]]
    small = friction[active] < MIN_CREDIBLE_RATIO * low
    return 0.0 if small.mean() < IMPLAUSIBLE_SHARE else system.friction[1].middle


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
        lagged[b] += stay * (lagged[b - 1] - speed[b])
    return lagged


def _moved_by_shapes(blocks: Blocks, shapes: FloatArray, evidence: Evidence) -> tuple[float, float, float]:
    """Return the largest change by a supported shape: of the slope, the levels, and the levels about their mean."""
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
        if not energy > SMALLEST_SPREAD * float(weight @ shape**2):
            continue  # levels and slope absorb it
        strength = float(weight @ (alone * left)) / energy
        moved = strength * (shape_level - tilt * x_level)
        mean = float(total @ moved) / whole
        together = math.sqrt(total @ moved**2 / whole)
        apart = math.sqrt(total @ (moved - mean) ** 2 / whole)
        found.append((strength**2 * energy / variance, abs(strength * tilt), together, apart))
    best = max((fall for fall, *_ in found), default=0.0)
    kept = [moves for fall, *moves in found if fall >= max(CLEAR_SIGMAS**2, COMPARABLE_SHARE * best)]
    slope, level, spread = np.max([[0.0, 0.0, 0.0], *kept], axis=0).tolist()
    return slope, level, spread
