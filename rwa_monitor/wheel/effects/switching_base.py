"""Base of the switching effects: how they change simulated jumps, and how they are recognised in found ones.

An effect may change the law of a switching system, the clock on which it runs, or the level itself; and it may add a
torque that depends on the jumps, which is then a regression column too, once the jumps are known.
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

# Of the sojourns, that may be anything: a visit of a few slots is not seen, and the rests beside it pass for one.
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
        """Return the time since that jump, or since the record's start, float64 (slots,) [s]."""
        begin = np.concatenate([[0], self.index])[self.segment(slots)]
        return np.asarray((np.arange(slots) - begin) * period_s)


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
    """What a fit of the rate of jumps goes by.

    Attributes
    ----------
    channels
        The measured motion.
    good
        bool (n,), slots that count.
    jumps
        The jumps found.
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


class SwitchingEffect(Effect):
    """An effect that changes the jumps of the dry level. Each overrides what it changes; the rest stays.

    A simulator calls in this order: `change_system` for each switching system, `clock` for the clock on which all run,
    `extra_level` for what is added to the level, and, once the jumps are known, `torque`.
    """

    family: ClassVar[Family] = "switching"
    not_exported = "it changes when the dry level jumps, and the level is set by the caller"

    def change_system(self, system: SwitchingSystem) -> SwitchingSystem:
        """Return the switching system that is simulated in place of the one in wheel.toml."""
        return system

    def clock(self, channels: Channels) -> JumpClock | None:
        """Return the clock on which the switching systems run, None for the record's own."""
        return None

    def extra_level(self, channels: Channels, rng: np.random.Generator) -> FloatArray:
        """Return what is added to the dry level, float64 (n,) [N m]."""
        return np.zeros(len(channels))

    @classmethod
    def columns(cls, channels: Channels, jumps: Jumps, shape: Shape) -> FloatArray:
        """Return the regression columns at unit strength, float64 (n, number of strengths), given the jumps."""
        return np.zeros((len(channels), 0))

    def torque(self, channels: Channels, jumps: Jumps) -> FloatArray:
        """Return the torque that depends on the jumps [N m], float64 (n,)."""
        return self.weighted(self.columns(channels, jumps, self.shape))
