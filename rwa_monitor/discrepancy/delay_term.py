"""The current's delay as a column of the search: where its pulses fall, the record tells.

Friction jumps between two slots, and the current with it. To first order a current that is read d seconds later than
the speed adds a pulse there, of d/Δt times the jump: in the slot before the jump where it is read later, in the slot
after it where it is read earlier, and in equal parts where a sample averages over its slot.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.ndimage import correlate1d

from rwa_monitor.physics.effects.base import Channels, Memory, Parameter
from rwa_monitor.physics.effects.columns import known_or_nan, stack
from rwa_monitor.physics.effects.current_delay import CurrentDelay
from rwa_monitor.samples import FloatArray

LEAD: Final = "lead_slots"
SLOPE_REACH: Final = 6  # slots to each side
LONGEST_PULSE: Final = 3  # slots: a level that lasts no longer, between two others, is a pulse


class DelayTerm(CurrentDelay):
    """The catalogue's effect, with the side of a jump on which its pulse falls as a shape of the search alone."""

    parameters = (*CurrentDelay.parameters, Parameter(LEAD, "slot", -0.5, 0.5, 0.0, choices=(0.0, -0.5, 0.5)))

    @classmethod
    def columns(
        cls, channels: Channels, shape: Mapping[str, float], memory: Memory = None
    ) -> tuple[FloatArray, Memory]:
        """Return the pulses beside the jumps of the dry level and the slope of what else the torque is, over time."""
        del memory
        dry = channels.direction * known_or_nan(channels.dry_level_Nm, channels)
        step = np.nan_to_num(np.diff(dry))
        before, after = np.append(step, 0.0), np.append(0.0, step)
        pulses = (0.5 + shape[LEAD]) * before + (0.5 - shape[LEAD]) * after
        # The rest changes slowly and is known from a noisy speed: its slope is taken over several slots.
        reach = np.arange(-SLOPE_REACH, SLOPE_REACH + 1)
        smooth = np.nan_to_num(known_or_nan(channels.motor_torque_Nm, channels) - dry)
        slope = correlate1d(smooth, reach / float(reach @ reach), mode="nearest")
        return stack((pulses + slope) / channels.sample_period_s), None


def without_pulses(level: FloatArray, lead: float) -> FloatArray:
    """Return a level with its pulses taken out, float64 (n,): what comes before a jump belongs to the level before it.

    Parameters
    ----------
    level
        float64 (n,), piecewise constant.
    lead
        Above zero where pulses lie before a jump, below zero where they lie after it.
    """
    edges = np.concatenate([[0], np.flatnonzero(np.diff(level)) + 1, [level.size]])
    cleaned = level.copy()
    inner = range(1, edges.size - 2)
    for i in inner if lead >= 0 else reversed(inner):
        if edges[i + 1] - edges[i] <= LONGEST_PULSE:
            cleaned[edges[i] : edges[i + 1]] = cleaned[edges[i] - 1] if lead >= 0 else cleaned[edges[i + 1]]
    return cleaned
