"""What the four stages hand to each other: plain, immutable results, in the order in which they arise.

Inside the diagnosis everything is normalised (errata 1, 2): with s = sign(ω), the pair

    x = |ω| g / nominal speed,      z = s · friction torque / nominal dry torque

follows z = level + f_v · x + noise in both directions of rotation. g is 1, or the factor by which the wheel's effects
scale viscous friction, such as ν(T)/ν(T₀) (`wheel.effects.catalogue.effect_torque`). Samples in the dead band or
without a good value are *unused*: they hold a slot but enter no sum. Slots are counted within the window; a
changepoint's index is the first slot of the new level.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.changepoints.running_sums import RunningSums, Structure
from rwa_monitor.kernels import assignment
from rwa_monitor.samples import FloatArray, IntArray

REJECTED: Final = assignment.REJECTED  # in Assignment.system: a candidate that is no changepoint
UNATTRIBUTED: Final = assignment.UNATTRIBUTED  # in Assignment.system: a changepoint that no switching system explains


class NoiseEstimate(NamedTuple):
    """The noise of z, in normalised units.

    Attributes
    ----------
    std
        Standard deviation of a single sample.
    autocovariance
        float64 (L,), at lags 0 … L-1; entry 0 is std².
    long_run_factor
        Variance of a long mean, times its length, over std²; 1 for white noise, (1+φ)/(1-φ) for AR(1).
    """

    std: float
    autocovariance: FloatArray
    long_run_factor: float

    @property
    def long_variance(self) -> float:
        """Variance of a mean of many samples, times their number; no less than that of a single sample."""
        return self.std**2 * max(self.long_run_factor, 1.0)


@dataclass(frozen=True, slots=True)
class Candidates:
    """Stage 1: where the level may have jumped; arrays (m,), sorted by index, one entry per index.

    Attributes
    ----------
    index
        First slot of the new level.
    scale
        Half-width w of the wGLR that found it [slots].
    statistic
        The wGLR divided by the variance of its own contrast: χ² with one degree of freedom where nothing jumps.
    jump
        The contrast: level after less level before, normalised.
    """

    index: IntArray
    scale: IntArray
    statistic: FloatArray
    jump: FloatArray

    def __len__(self) -> int:
        """Count the candidates."""
        return int(self.index.size)

    def __getitem__(self, kept: IntArray) -> Candidates:
        """Return some of the candidates."""
        return Candidates(self.index[kept], self.scale[kept], self.statistic[kept], self.jump[kept])


class Temperature(NamedTuple):
    """The bearing temperature in a window, as used for its viscous friction.

    Attributes
    ----------
    mean_degC, low_degC, high_degC
        Over the used samples [°C].
    error_K
        Its mean uncertainty [K].
    unknown
        Share of these samples for which it counts as unknown: missing or stuck for long.
    """

    mean_degC: float
    low_degC: float
    high_degC: float
    error_K: float
    unknown: float


class Evidence(NamedTuple):
    """All that later stages see of a window: candidates, sums and noise, never the samples.

    Attributes
    ----------
    slots
        Length of the window [slots].
    good
        Slots that hold a good sample.
    used
        Good slots outside the dead band.
    candidates, sums, noise
        See their classes.
    structure
        What the running sums do not hold of the window.
    heat
        Temperature of the bearing; None where the wheel's viscous friction does not follow it.
    """

    slots: int
    good: int
    used: int
    candidates: Candidates
    sums: RunningSums
    noise: NoiseEstimate
    structure: Structure
    heat: Temperature | None = None


@dataclass(frozen=True, slots=True)
class Estimate:
    """Stage 2: friction of the intervals between m changepoints, by least squares.

    Attributes
    ----------
    index
        int64 (m,), the changepoints used.
    level, level_std
        float64 (m + 1,), dry friction of each interval and its standard deviation, normalised.
    jump_std
        float64 (m,), standard deviation of each jump: the slope's share is common to both levels.
    viscous, viscous_std
        Shared viscous coefficient, normalised.
    rmse
        Root mean square residual, normalised.
    """

    index: IntArray
    level: FloatArray
    level_std: FloatArray
    jump_std: FloatArray
    viscous: float
    viscous_std: float
    rmse: float


class SwitchingPath(NamedTuple):
    """Which system jumped at which slot: all that the friction model needs of an assignment, as kernels take it.

    Attributes
    ----------
    configurations, starts
        int64 (all sojourns,), configuration and first slot of each sojourn, system after system; the first of each
        system starts at 0.
    sojourns
        int64 (systems,), how many of these each has.
    unattributed
        int64, slots of the jumps that no system made.
    """

    configurations: IntArray
    starts: IntArray
    sojourns: IntArray
    unattributed: IntArray

    @classmethod
    def of(
        cls, configurations: tuple[IntArray, ...], starts: tuple[IntArray, ...], unattributed: IntArray
    ) -> SwitchingPath:
        """Return the path made of each system's sojourns."""
        none = np.zeros(0, dtype=np.int64)  # a wheel may have no system
        sojourns = np.array([one.size for one in starts], dtype=np.int64)
        return cls(np.concatenate((none, *configurations)), np.concatenate((none, *starts)), sojourns, unattributed)

    def visited(self) -> bytes:
        """Return a key of the configurations and the unattributed jumps, without the times at which systems jumped."""
        return b"|".join(part.tobytes() for part in (self.configurations, self.sojourns, self.unattributed))

    def split(self, values: IntArray) -> tuple[IntArray, ...]:
        """Return values (all sojourns,) system by system."""
        ends = itertools.accumulate(self.sojourns.tolist(), initial=0)
        return tuple(values[begin:end] for begin, end in itertools.pairwise(ends))


@dataclass(frozen=True, slots=True)
class Alternative:
    """A switching path that the samples do not rule out in favour of the best one.

    Attributes
    ----------
    path
        Which system jumped at which slot.
    index
        int64, slots of all its jumps, without repeats.
    log_durations
        Log-likelihood of the path by durations, transitions and rare events, together with all paths in which the
        systems go through the same configurations.
    log_score
        Its log-likelihood under broad friction laws, on the scale of `Assignment.log_score`.
    """

    path: SwitchingPath
    index: IntArray
    log_durations: float
    log_score: float


@dataclass(frozen=True, slots=True)
class Assignment:
    """Stage 3: which switching system made which jump.

    Attributes
    ----------
    index, system, direction
        int64 (j,): slot, index of the switching system (or REJECTED, UNATTRIBUTED) and +1/-1 for up and down in
        configuration (0 when rejected). Two systems that jump at once are two entries with one index.
    jump, jump_std
        float64 (j,), size of each jump, normalised.
    confidence
        float64 (j,), probability of this attribution among the alternatives kept, 0 … 1.
    configurations
        For each system: int64 (sojourns,), the configurations visited, in order.
    starts
        For each system: int64 (sojourns,), the slot at which each sojourn begins; 0 for the first.
    log_score
        Log-likelihood of the best path, up to a constant.
    states, pruned
        Work done: states expanded, and whether the state budget cut the search.
    alternatives
        Paths that the samples do not rule out, the best first.
    """

    index: IntArray
    system: IntArray
    direction: IntArray
    jump: FloatArray
    jump_std: FloatArray
    confidence: FloatArray
    configurations: tuple[IntArray, ...]
    starts: tuple[IntArray, ...]
    log_score: float
    states: int
    pruned: bool
    alternatives: tuple[Alternative, ...] = ()


class Components(NamedTuple):
    """Friction split into its parts, normalised.

    Attributes
    ----------
    base_dry, base_dry_std
        Dry friction with all switching systems at rest (q = 0).
    viscous, viscous_std
        Viscous coefficient.
    fss_friction, fss_friction_std
        For each system: float64 (sojourns,), friction of each sojourn (0 in configuration 0).
    by_path
        The same by all paths that the samples do not rule out, where there is more than one.
    """

    base_dry: float
    base_dry_std: float
    viscous: float
    viscous_std: float
    fss_friction: tuple[FloatArray, ...]
    fss_friction_std: tuple[FloatArray, ...]
    by_path: tuple[ConditionalEstimate, ...] = ()


class ConditionalEstimate(NamedTuple):
    """The estimate of friction given one path.

    Attributes
    ----------
    path
        Who jumped when.
    log_weight
        Log-probability of path and samples, base and friction of the sojourns integrated out; in `by_path` over flat
        priors, friction laws left aside.
    components
        The parts. Where a system never rests, one split of many between it and the base.
    """

    path: SwitchingPath
    log_weight: float
    components: Components
