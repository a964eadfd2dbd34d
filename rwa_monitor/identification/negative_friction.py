"""What may be wrong where friction comes out negative: a question that the data themselves suggest."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import Fit, remove_levels, segment_starts
from rwa_monitor.discrepancy.plausible import first_slope
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.wheel.wheel import Wheel

MOTION_VISIBLE_AT: Final = 10.0  # standard deviations of an inertia left in friction, its noise taken to be white
BENT_VISIBLE_AT: Final = 10.0  # standard deviations of drag with the square of the speed, its noise taken to be white
BENT_SHARE: Final = 0.02  # of all friction (rms): less does no harm to what is learned
MOTION_SHARE: Final = 0.02  # of all friction (rms): less does no harm to what is learned


def why_negative(problem: Problem, fitted: Fit, wheel: Wheel, finding: str) -> str:
    """Say why friction comes out negative, or ask.

    In this order: at one speed dry and viscous friction are one number, of which each may be anything; torque that
    drives the rotation has the wrong sign; drag that grows faster than the speed leaves less than nothing for the dry
    friction, and while a wheel runs down it would pass for an inertia; friction that follows the acceleration holds a
    part of the inertia's torque.

    Parameters
    ----------
    problem, fitted
        The records and the base law fitted to them.
    wheel
        Constants with which friction was derived.
    finding
        What came out negative, in words.
    """
    if problem.at_one_speed:
        return at_one_speed(problem, fitted)
    if float(np.mean(problem.z)) < 0:
        return f"{finding}, and torque drives the rotation on the average: is the sign of speed or torque right?"
    law = missing_law(problem, fitted)
    if law is not None:
        return f"{finding}, and {law}"
    motion = motion_in_friction(problem, fitted, wheel)
    if motion is not None:
        return f"{finding}, and {motion}"
    return (
        f"{finding}: drag falls with the speed; is the range of speeds small, or the bearing warmer while the wheel is"
        " fast?"
    )


def missing_law(problem: Problem, fitted: Fit) -> str | None:
    """Say that friction is no straight line over the speed; None where it is, within its noise or nearly.

    Parameters
    ----------
    problem, fitted
        As for `why_negative`.
    """
    first = segment_starts(problem, fitted.jumps)
    design = remove_levels(np.column_stack([problem.speed**2, problem.speed]), first)
    value, std = first_slope(design, remove_levels(problem.z, first))
    off_a_line = abs(value) * float(np.ptp(problem.speed)) ** 2 / 8.0  # of the parabola from its chord, in the middle
    if abs(value) < BENT_VISIBLE_AT * std or off_a_line < BENT_SHARE * float(np.sqrt(np.mean(problem.z**2))):
        return None
    how = "upwards over the speed, as windage or a rise towards rest does" if value > 0 else "downwards over the speed"
    return (
        f"drag bends {how}: a law is missing, which rwa-monitor discrepancy names; its extended_wheel.toml, given with"
        " --wheel, lets the rest be learned"
    )


def at_one_speed(problem: Problem, fitted: Fit) -> str:
    """Say that dry and viscous friction cannot be told apart, and what is known instead: their sum."""
    speed = float(problem.speed.mean())
    together = float(fitted.level.mean()) + float(fitted.coefficients[0]) * speed
    return (
        f"the speed hardly leaves {speed:.4g} rad/s: there friction is {together:.4g} N m, and these data cannot"
        " tell how much of that is dry and how much viscous; give recordings at several speeds"
    )


def motion_in_friction(problem: Problem, fitted: Fit, wheel: Wheel) -> str | None:
    """Ask where friction follows the acceleration more than an acceptable part of it; None where it does not.

    Parameters
    ----------
    problem, fitted, wheel
        As for `why_negative`.
    """
    if wheel.friction.motor_off:  # friction is the inertia's torque
        return None
    along = problem.sign * problem.gather([record.channels.acceleration_rad_s2 for record in problem.records])
    first = segment_starts(problem, fitted.jumps)
    design = remove_levels(np.column_stack([along, problem.speed]), first)
    value, std = first_slope(design, remove_levels(problem.z, first))
    share = abs(value) * float(np.std(along)) / float(np.sqrt(np.mean(problem.z**2)))
    if abs(value) < MOTION_VISIBLE_AT * std or share < MOTION_SHARE:
        return None
    inertia = wheel.inertia_kg_m2 if problem.friction_is_derived else None
    asked = (
        "was the acceleration taken out with the right inertia"
        if inertia is None
        else f"are inertia_kg_m2 = {inertia:.4g} and the units of speed and torque right"
    )
    return (
        f"friction follows the acceleration as {value:.3g} ± {std:.1g} kg m² of inertia would: {asked}, and have both"
        " channels the same time?"
    )
