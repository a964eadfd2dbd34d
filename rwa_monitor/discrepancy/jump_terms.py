"""Switching effects that are also torques: once jumps are found, they have columns and compete with mean effects.

Otherwise smooth mean effects would be named in their place: exponential decays after jumps mimic a lag or a drift.
"""

from __future__ import annotations

from itertools import pairwise
from typing import ClassVar, Final

import numpy as np
from scipy.ndimage import correlate1d

from rwa_monitor.samples import TINY, FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, Shape, stack
from rwa_monitor.wheel.effects.jumps import DecayingJump, ViscousJump
from rwa_monitor.wheel.effects.switching_base import Jumps, SwitchingEffect
from rwa_monitor.wheel.effects.torque_balance_errors import CurrentDelay


class JumpTerm(MeanEffect):
    """A switching effect as columns; its jumps are those of the dry level.

    A subclass gives the effect that it `wraps`, and takes over its name, texts and parameters.
    """

    wraps: ClassVar[type[SwitchingEffect]]
    family = "switching"
    uses_level = True

    def __init_subclass__(cls, wraps: type[SwitchingEffect] | None = None) -> None:
        """Take the description of the effect; a subclass of a subclass has it already."""
        if wraps is None:
            return
        cls.wraps, cls.parameters = wraps, wraps.parameters
        for name in ("name", "title", "formula", "description", "signature", "confused_with", "separate_by", "source"):
            setattr(cls, name, getattr(wraps, name))

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        del memory
        level = channels.optional("dry_level_Nm")
        change = np.nan_to_num(np.diff(level))
        # Levels are computed as differences of sums: a change within rounding errors is no jump.
        index = np.flatnonzero(np.abs(change) > 1e-9 * np.max(np.abs(np.nan_to_num(level)), initial=TINY)) + 1
        return cls.wraps.columns(channels, Jumps(index.astype(np.int64), change[index - 1]), shape), None


class DecayingJumpTerm(JumpTerm, wraps=DecayingJump):
    """`decaying_jump` as a column."""


class ViscousJumpTerm(JumpTerm, wraps=ViscousJump):
    """`viscous_jump` as a column."""


JUMP_TERMS: Final = (DecayingJumpTerm, ViscousJumpTerm)


# ---- the delay of the current ----------------------------------------------------------------------------------------
# Friction jumps between two slots, and the current with it. To first order a current that is read d seconds later than
# the speed adds a pulse there, of d/Δt times the jump: in the slot before the jump where it is read later, in the slot
# after it where it is read earlier, and in equal parts where a sample averages over its slot. Where all samples are
# known to be averages, a jump falls anywhere in its slot, and the sample between both levels reveals no delay.


LEAD: Final = "lead_slots"
SLOPE_REACH: Final = 6  # slots to each side
LONGEST_PULSE: Final = 3  # slots: a level that lasts no longer, between two others, is a pulse


class DelayTerm(CurrentDelay):
    """The catalogue's effect, with the side of a jump on which its pulse falls as a shape of the search alone."""

    parameters = (*CurrentDelay.parameters, Parameter(LEAD, "slot", -0.5, 0.5, 0.0, choices=(0.0, -0.5, 0.5)))

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        """Return the pulses at the jumps of the dry level plus the time derivative of the rest of the torque."""
        del memory
        dry = channels.direction * channels.optional("dry_level_Nm")
        step = np.nan_to_num(np.diff(dry))
        before, after = np.append(step, 0.0), np.append(0.0, step)
        pulses = 0.0 if channels.averaged else (0.5 + shape[LEAD]) * before + (0.5 - shape[LEAD]) * after
        # The rest changes slowly and is known from a noisy speed: its slope is taken over several slots.
        reach = np.arange(-SLOPE_REACH, SLOPE_REACH + 1)
        smooth, at = channels.optional("motor_torque_Nm") - dry, np.arange(len(channels))
        known = np.isfinite(smooth)
        smooth = np.interp(at, at[known], smooth[known]) if known.any() else np.zeros(at.size)
        slope = correlate1d(smooth, reach / float(reach @ reach), mode="nearest")
        return stack((pulses + slope) / channels.sample_period_s), None


def without_pulses(level: FloatArray, lead: float) -> FloatArray:
    """Return a level without its pulses, float64 (n,): each takes the level before it, or after it where `lead` < 0.

    Parameters
    ----------
    level
        float64 (n,), piecewise constant.
    lead
        Above zero where pulses lie before a jump, below zero where they lie after it.
    """
    edges = np.concatenate([[0], np.flatnonzero(np.diff(level)) + 1, [level.size]])
    cleaned = level.copy()
    spans = list(pairwise(edges.tolist()))[1:-1]
    for begin, end in spans if lead >= 0 else reversed(spans):
        if end - begin <= LONGEST_PULSE:
            cleaned[begin:end] = cleaned[begin - 1] if lead >= 0 else cleaned[end]
    return cleaned
