"""The list of hypotheses: effects with columns that a search tries, and which of them a motion can show at all."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.discrepancy.jump_terms import JUMP_TERMS, DelayTerm
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.wheel.effects.base import MeanEffect
from rwa_monitor.wheel.effects.catalogue import MEAN_EFFECTS
from rwa_monitor.wheel.wheel import Wheel

# All that has columns: mean effects, and effects of jumps that are torques too; some with columns of their own here.
CANDIDATES: Final = tuple({**MEAN_EFFECTS, **{term.name: term for term in (DelayTerm, *JUMP_TERMS)}}.values())


def candidates(wheel: Wheel) -> list[type[MeanEffect]]:
    """Return the effects with columns that the search tries: all that the wheel does not have already."""
    known = {block.name for block in wheel.effect}
    return [effect for effect in CANDIDATES if effect.name not in known]


def can_show(problem: Problem, effect: type[MeanEffect]) -> bool:
    """Return whether the motion can show an effect: at constant speed, friction that is derived shows none of motion.

    All that moves the speed is its noise, which is in the friction, too: it would pass for an effect of motion.
    """
    at_rest = problem.friction_is_derived and speed_is_constant(problem)
    return not at_rest or effect.shows_at_one_speed


def speed_is_constant(problem: Problem) -> bool:
    """Return whether the speed varies by hardly more than its noise."""
    noise = max(record.speed_noise_rad_s for record in problem.records)
    return float(np.std(problem.speed)) < max(1e-3 * float(np.max(problem.speed)), 3 * noise)
