"""Base of the switching effects: how they change simulated jumps, and how they are recognised in found ones.

An effect may change the law of a switching system, the clock on which it runs, or the level itself; and it may add a
torque that depends on the jumps, which is then a regression column too, once the jumps are known.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final

import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.wheel.durations import Geometric
from rwa_monitor.wheel.effects.base import Channels, Effect, Family, LikelihoodFit, no_gain
from rwa_monitor.wheel.switching_systems import Realisation
from rwa_monitor.wheel.wheel import SwitchingSystem

STRAY_SHARE: Final = 0.02  # of the sojourns: one in fifty may be anything
TAKEN_UP: Final = 1e-12  # share of a column's square below which levels and slope hold it already
TINY: Final = float(np.finfo(np.float64).tiny)  # keeps a logarithm finite


@dataclass(frozen=True, slots=True)
class Jumps:
    """Jumps of the dry level, true or found; arrays (m,), sorted by slot.

    Attributes
    ----------
    index
        int64, first slot of the new level.
    size_Nm
        float64, level after less level before [N m].
    """

    index: IntArray
    size_Nm: FloatArray

    def __len__(self) -> int:
        """Count the jumps."""
        return int(self.index.size)

    def segment(self, slots: int) -> IntArray:
        """Return how many jumps lie at or before each slot, int64 (slots,): the number of its segment."""
        return np.searchsorted(self.index, np.arange(slots), side="right").astype(np.int64)

    def total(self, slots: int) -> FloatArray:
        """Return the level less the first level, float64 (slots,) [N m]."""
        # A running sum over the jumps, looked up: the same value in each slot of a segment.
        return np.concatenate([[0.0], np.cumsum(self.size_Nm)])[self.segment(slots)]


@dataclass(frozen=True, slots=True)
class Sojourns:
    """Complete sojourns of one switching system, as an assignment found them; arrays (k,).

    Attributes
    ----------
    start
        int64, first slot.
    configuration
        int64, which configuration.
    slots
        int64, how long it lasted; those cut by the record's ends are left out.
    """

    start: IntArray
    configuration: IntArray
    slots: IntArray

    def of(self, configurations: Sequence[int]) -> Sojourns:
        """Return the sojourns in some of the configurations."""
        at = np.isin(self.configuration, configurations)
        return Sojourns(self.start[at], self.configuration[at], self.slots[at])

    def log_likelihood(self, system: SwitchingSystem, slots: IntArray) -> float:
        """Return log P of other lengths of these sojourns, int64 (k,), under the known laws, softened.

        A law with a hard edge forbids what lies beyond it, so that one wrongly found jump would condemn it: a small
        share of the sojourns is granted to a memoryless law of the same mean.
        """
        total = 0.0
        for q, law in enumerate(system.durations):
            at = slots[self.configuration == q]
            stray = Geometric(mean_slots=max(law.mean(), 1.0)).pmf(at)
            total += float(np.sum(np.log((1.0 - STRAY_SHARE) * law.pmf(at) + STRAY_SHARE * stray + TINY)))
        return total


@dataclass(frozen=True, slots=True)
class SwitchingEvidence:
    """What a fit of a switching effect goes by.

    Attributes
    ----------
    residual_Nm
        float64 (n,), friction torque less base law, levels and mean effects [N m].
    channels
        The measured motion.
    good
        bool (n,), slots whose residual counts.
    jumps
        The jumps found.
    unattributed
        bool (m,), jumps that no known switching system explains; empty where jumps were not attributed.
    systems
        The known switching systems, by name.
    sojourns
        Their sojourns, by name; empty where jumps were not attributed.
    variance_factor
        Long-run variance of the noise over its variance; 1 for white noise.
    false_jumps
        How many false jumps the detection is expected to leave in a record of this length.
    """

    residual_Nm: FloatArray
    channels: Channels
    good: BoolArray
    jumps: Jumps
    unattributed: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    systems: Mapping[str, SwitchingSystem] = field(default_factory=dict)
    sojourns: Mapping[str, Sojourns] = field(default_factory=dict)
    variance_factor: float = 1.0
    false_jumps: float = 0.5


@dataclass(frozen=True, slots=True)
class JumpClock:
    """A clock on which switching systems run that is not the wheel's: a slot of the record is many or few of its own.

    Attributes
    ----------
    slot_of
        int64 (n,), never decreasing: the clock's slot in each slot of the record.
    """

    slot_of: IntArray

    @classmethod
    def from_rate(cls, rate: FloatArray) -> JumpClock:
        """Return the clock that advances by `rate` in each slot, float64 (n,), positive."""
        return cls(np.floor(np.cumsum(rate) - rate[0]).astype(np.int64))

    @property
    def slots(self) -> int:
        """How many slots of its own the record lasts."""
        return int(self.slot_of[-1]) + 1

    def slot_in_record(self, slot: int) -> int:
        """Return the first slot of the record at which the clock has reached a slot of its own."""
        return int(np.searchsorted(self.slot_of, slot))

    def read(self, realisation: Realisation) -> Realisation:
        """Return what a system simulated over the clock's own slots does over the record's.

        A sojourn that begins and ends within one slot of the record is not seen.
        """
        sojourn = np.searchsorted(realisation.jump_index, self.slot_of, side="right")
        return Realisation(
            configuration=realisation.configuration[self.slot_of],
            friction=realisation.friction[self.slot_of],
            jump_index=(np.flatnonzero(np.diff(sojourn)) + 1).astype(np.int64),
        )


class SwitchingEffect(Effect, ABC):
    """An effect that changes the jumps of the dry level. Each overrides what it changes; the rest stays.

    A simulator asks in this order: `change_system` for each switching system, `clock` for the clock on which all run,
    `extra_level` for what is added to the level, and, once the jumps are known, `torque`.
    """

    family: ClassVar[Family] = "switching"

    def change_system(self, system: SwitchingSystem) -> SwitchingSystem:
        """Return the switching system that is simulated in place of the one in wheel.toml."""
        return system

    def clock(self, channels: Channels) -> JumpClock | None:
        """Return the clock on which the switching systems run, None for the record's own."""
        del channels
        return None

    def extra_level(self, channels: Channels, rng: np.random.Generator) -> FloatArray:
        """Return what is added to the dry level, float64 (n,) [N m]."""
        del rng
        return np.zeros(len(channels))

    @classmethod
    def columns(cls, channels: Channels, jumps: Jumps, shape: Mapping[str, float]) -> FloatArray:
        """Return the regression columns at unit strength, float64 (n, number of strengths), given the jumps."""
        del jumps, shape
        return np.zeros((len(channels), 0))

    def torque(self, channels: Channels, jumps: Jumps) -> FloatArray:
        """Return the torque that depends on the jumps [N m], float64 (n,)."""
        shape = {parameter.name: self.values[parameter.name] for parameter in self.shape_parameters()}
        columns = self.columns(channels, jumps, shape)
        torque = np.zeros(len(channels))
        for parameter, column in zip(self.strength_parameters(), columns.T, strict=True):
            torque += self.values[parameter.name] * column
        return torque

    @classmethod
    @abstractmethod
    def fit(cls, evidence: SwitchingEvidence) -> LikelihoodFit:
        """Fit the effect; a gain of zero where the evidence cannot show it."""

    @classmethod
    def nothing_found(cls, samples: int = 0) -> LikelihoodFit:
        """Return the fit of evidence that cannot show the effect: typical values, no gain."""
        return no_gain(cls, samples)


class BeyondBase:
    """What levels and slope leave of a torque along the motion: prepared once for many columns of one record.

    Parameters
    ----------
    evidence
        Gives residual, motion, jumps and which slots count.

    Attributes
    ----------
    used
        bool (n,), slots that enter: good, known, and with a direction.
    segment
        int64 (used slots,), number of the segment of each.
    speed, target
        float64 (used slots,), |ω| less its mean in each segment; residual along the motion without its base part.
    """

    def __init__(self, evidence: SwitchingEvidence) -> None:
        channels = evidence.channels
        known = np.isfinite(evidence.residual_Nm) & np.isfinite(channels.speed_rad_s)
        self.used: BoolArray = evidence.good & known & (channels.direction != 0)
        self._segment_of_slot = evidence.jumps.segment(len(channels))
        self.segment = self._segment_of_slot[self.used]
        self._count = np.maximum(np.bincount(self.segment), 1)
        self._direction = channels.direction[self.used]
        self._variance_factor = evidence.variance_factor
        self._speed = np.abs(channels.speed_rad_s[self.used])
        self._residual = evidence.residual_Nm[self.used] * self._direction
        self.speed = self.centred(self._speed)
        self._energy = float(np.sum(self.speed**2))
        self.along = self.centred(self._residual)
        self.target = self._without_slope(self.along)

    def centred(self, values: FloatArray) -> FloatArray:
        """Return values (used slots,) less their mean in each segment."""
        mean: FloatArray = np.bincount(self.segment, values) / self._count
        left: FloatArray = values - mean[self.segment]
        return left

    def left_of(self, torque_Nm: FloatArray) -> FloatArray:
        """Return what is left of a torque (n,) along the motion, float64 (used slots,)."""
        return self._without_slope(self.centred(torque_Nm[self.used] * self._direction))

    def _without_slope(self, along: FloatArray) -> FloatArray:
        if self._energy == 0.0:
            return along
        return along - self.speed * (float(np.sum(self.speed * along)) / self._energy)

    def level(self, torque_Nm: FloatArray) -> FloatArray:
        """Return the level in each slot, float64 (n,), when a torque (n,) is taken off the residual first."""
        left = self._residual - torque_Nm[self.used] * self._direction
        centred = self.centred(left)
        slope = float(np.sum(self.speed * centred)) / self._energy if self._energy > 0.0 else 0.0
        mean = np.bincount(self.segment, left - slope * self._speed) / self._count
        whole: FloatArray = mean[np.minimum(self._segment_of_slot, mean.size - 1)]
        return whole

    def gain(self, column: FloatArray, low: float, high: float) -> tuple[float, float, float]:
        """Return log-likelihood gain, strength and its standard deviation of one column beside levels and slope.

        Parameters
        ----------
        column
            float64 (n,), torque at unit strength.
        low, high
            Bounds of the strength.
        """
        regressor = self.left_of(column)
        energy, total = float(np.sum(regressor**2)), float(np.sum(self.target**2))
        if energy <= TAKEN_UP * float(np.sum(column[self.used] ** 2)) or total == 0.0:
            return 0.0, 0.0, float("nan")
        strength = float(np.clip(np.sum(regressor * self.target) / energy, low, high))
        left = float(np.sum((self.target - strength * regressor) ** 2))
        std = float(np.sqrt(left / self.target.size / energy * self._variance_factor))
        return self.gain_of(total, left), strength, std

    def gain_of(self, before: float, after: float) -> float:
        """Return the log-likelihood gain of a smaller sum of squares; coloured noise lowers it."""
        ratio = before / max(after, np.finfo(np.float64).eps * before)
        return max(0.5 * self.target.size * float(np.log(ratio)) / self._variance_factor, 0.0)
