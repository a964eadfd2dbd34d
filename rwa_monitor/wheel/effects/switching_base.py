"""Base of the switching effects: how they change simulated jumps, and how they are recognised in detected jumps.

An effect may change the law of a switching system, the clock on which it runs, or the level itself; and it may add a
torque that depends on the jumps, which is also a regression column once the jumps are known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final

import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.wheel.durations import Geometric
from rwa_monitor.wheel.effects.base import Channels, Effect, Family, Shape
from rwa_monitor.wheel.switching_systems import Realisation
from rwa_monitor.wheel.wheel import SwitchingSystem

# Share of the sojourns with an arbitrary duration: where a visit of a few slots is missed, two rests merge into one.
STRAY_SHARE: Final = 0.02
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

    def last(self, slots: int) -> FloatArray:
        """Return the size of the last jump at or before each slot, float64 (slots,) [N m]; 0 before the first."""
        return np.concatenate([[0.0], self.size_Nm])[self.segment(slots)]

    def since_s(self, slots: int, period_s: float) -> FloatArray:
        """Return the time since the last jump, or since the record's start, float64 (slots,) [s]."""
        begin = np.concatenate([[0], self.index])[self.segment(slots)]
        return np.asarray((np.arange(slots) - begin) * period_s)


@dataclass(frozen=True, slots=True)
class Sojourns:
    """Complete sojourns of one switching system in an assignment; arrays (k,).

    Attributes
    ----------
    start
        int64, first slot.
    configuration
        int64, its configuration.
    slots
        int64, its duration; sojourns cut by the record's ends are left out.
    """

    start: IntArray
    configuration: IntArray
    slots: IntArray

    def of(self, configurations: Sequence[int]) -> Sojourns:
        """Return the sojourns in some of the configurations."""
        at = np.isin(self.configuration, configurations)
        return Sojourns(self.start[at], self.configuration[at], self.slots[at])

    def log_likelihood(self, system: SwitchingSystem, slots: IntArray) -> float:
        """Return log P of given durations of these sojourns, int64 (k,), under the known laws, softened.

        A law with a hard edge gives durations beyond it no probability, so that one false jump would rule it out:
        each law is mixed with a small share of a memoryless law of the same mean.
        """
        total = 0.0
        for q, law in enumerate(system.durations):
            at = slots[self.configuration == q]
            stray = Geometric(mean_slots=max(law.mean(), 1.0)).pmf(at)
            total += float(np.sum(np.log((1.0 - STRAY_SHARE) * law.pmf(at) + STRAY_SHARE * stray + TINY)))
        return total


@dataclass(frozen=True, slots=True)
class SwitchingEvidence:
    """The data for a fit of the rate of jumps.

    Attributes
    ----------
    channels
        The measured motion.
    good
        bool (n,), slots to use.
    jumps
        The detected jumps.
    systems
        The known switching systems, by name.
    sojourns
        Their sojourns, by name; empty where jumps were not attributed.
    """

    channels: Channels
    good: BoolArray
    jumps: Jumps
    systems: Mapping[str, SwitchingSystem] = field(default_factory=dict)
    sojourns: Mapping[str, Sojourns] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class JumpClock:
    """A clock of the switching systems that runs faster or slower than the record's.

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
        """Length of the record in slots of the clock."""
        return int(self.slot_of[-1]) + 1

    def slot_in_record(self, slot: int) -> int:
        """Return the first slot of the record in which the clock has reached a slot of the clock."""
        return int(np.searchsorted(self.slot_of, slot))

    def read(self, realisation: Realisation) -> Realisation:
        """Return a realisation over the clock's slots, sampled at the slots of the record.

        A sojourn that begins and ends within one slot of the record is lost.
        """
        sojourn = np.searchsorted(realisation.jump_index, self.slot_of, side="right")
        return Realisation(
            configuration=realisation.configuration[self.slot_of],
            friction=realisation.friction[self.slot_of],
            jump_index=(np.flatnonzero(np.diff(sojourn)) + 1).astype(np.int64),
        )


class SwitchingEffect(Effect):
    """An effect that changes the jumps of the dry level. Each overrides the methods whose result it changes.

    A simulator calls in this order: `change_system` for each switching system, `clock` for the clock on which all run,
    `extra_level` for the level to be added, and, once the jumps are known, `torque`.
    """

    family: ClassVar[Family] = "switching"
    not_exported = "it changes when the dry level jumps, and the level is set by the caller"

    def change_system(self, system: SwitchingSystem) -> SwitchingSystem:
        """Return the switching system that is simulated in place of the one in wheel.toml."""
        return system

    def clock(self, channels: Channels) -> JumpClock | None:
        """Return the clock on which the switching systems run; None for the record's own."""
        return None

    def extra_level(self, channels: Channels, rng: np.random.Generator) -> FloatArray:
        """Return the level to be added to the dry level, float64 (n,) [N m]."""
        return np.zeros(len(channels))

    @classmethod
    def columns(cls, channels: Channels, jumps: Jumps, shape: Shape) -> FloatArray:
        """Return the regression columns at unit strength, float64 (n, number of strengths), given the jumps."""
        return np.zeros((len(channels), 0))

    def torque(self, channels: Channels, jumps: Jumps) -> FloatArray:
        """Return the torque that depends on the jumps [N m], float64 (n,)."""
        return self.weighted(self.columns(channels, jumps, self.shape))
