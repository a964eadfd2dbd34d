"""Data-quality warnings on a learned wheel: too little data, friction that drifts, jumps that are left."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import combinations
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import Fit, criterion, fit, remove_levels, segment_starts
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN
from rwa_monitor.discrepancy.plausible import first_slope
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.errors import InputError
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.switching.jump_attribution import MOST_CONFUSED, TIERS, JumpAttribution, confused_share
from rwa_monitor.wheel.wheel import SwitchingSystem, Wheel
from rwa_monitor.words import counted

# A nominal value is good for something while its standard deviation is about half of what the built-in model's bands of
# healthy wheels reach to either side: 6 % for base dry friction, 4 % for viscous friction.
LARGEST_ERROR: Final = 0.025
DRIFT_VISIBLE_AT: Final = 6.0  # standard deviations of a drift below which nothing is made of it
# Of the base dry friction, over the recordings: a third of that band. Drift that is large also makes jumps, which take
# most of it away from what is seen between jumps.
LARGEST_DRIFT: Final = 0.02
# Of the base dry friction, the standard deviation of what temperature adds, below which it is let be.
SMALLEST_SWING: Final = 0.005
MOST_SYSTEMS: Final = max(len(counts) for tier in TIERS for counts in tier)
MOST_ODD: Final = 0.1  # of the segments, that fit no system: more are no accident
SURE_BY: Final = 3.0  # log-likelihood by which one description must beat the next: odds of 20
MOST_TIMES: Final = 10.0  # as many recordings, where two descriptions hardly differ


def friction_errors(problem: Problem) -> tuple[float, float]:
    """Return the standard deviations of base dry [N m] and of viscous friction [N m s/rad] that noise leaves."""
    variance, mean = problem.noise.long_run_variance, float(problem.speed.mean())
    inner = problem.speed - mean
    viscous_std = float(np.sqrt(variance / max(float(inner @ inner), 1e-300)))
    return float(np.hypot(np.sqrt(variance / problem.size), mean * viscous_std)), viscous_std


def check_enough(problem: Problem, base: float, viscous: float, names: str, cause: str | None) -> None:
    """Refuse records that leave the nominal friction too uncertain to distinguish a healthy wheel from a failing one.

    More data would not help where there is another `cause`.
    """
    errors = dict(
        zip(("base dry", "viscous"), np.array(friction_errors(problem)) / (base, max(viscous, 1e-300)), strict=True)
    )
    worst = max(errors, key=lambda name: errors[name])
    if errors[worst] > LARGEST_ERROR:
        if cause is not None:
            raise InputError(names, f"{worst} friction is uncertain by {100.0 * errors[worst]:.2g} %: {cause}")
        raise InputError(
            names,
            f"too little data to learn a wheel: {problem.size} samples in motion leave {worst} friction uncertain by"
            f" {100.0 * errors[worst]:.2g} % ({100.0 * LARGEST_ERROR:.2g} % at most); give about"
            f" {int(np.ceil((errors[worst] / LARGEST_ERROR) ** 2))} times as many, or a wider range of speeds",
        )


def with_temperature(problem: Problem, fitted: Fit, base: float) -> str:
    """Report whether viscous friction follows the bearing's temperature, where that was recorded: "" if not.

    What it changes from one moment to the next makes jumps that are no system's.
    """
    recorded = [record.channels.bearing_temperature_degC for record in problem.records]
    known = [temperature for temperature in recorded if temperature is not None]
    if len(known) < len(recorded):
        return ""
    temperature = problem.gather(known)
    temperature = np.nan_to_num(temperature - np.nanmean(temperature))
    follows = fit(problem, (problem.speed * temperature)[:, None])
    viscous, slope = follows.coefficients.tolist()
    # Lubricants get thinner when they get warmer.
    falls = -slope * float(np.std(problem.speed * temperature))
    if criterion(problem, fitted) - criterion(problem, follows) < ACCEPT_GAIN or falls < SMALLEST_SWING * base:
        return ""
    share = 100.0 * slope / max(viscous, 1e-300)
    return (
        f"viscous friction follows the bearing's temperature ({share:+.2g} % a kelvin), which makes jumps that are no"
        " switching system's: name the effect with `rwa-monitor discrepancy`, and learn once more from the wheel file"
        " that it writes (`identify --wheel extended_wheel.toml`)"
    )


def drift_in_words(problem: Problem, jumps: IntArray, residual: FloatArray, base: float) -> str:
    """Report whether friction drifts between jumps, where a healthy wheel's stays: "" if not.

    The common slope in time of what levels and viscous friction leave, each interval taken by itself.
    """
    cuts = np.unique(np.concatenate([problem.starts, jumps])).astype(np.int64)
    interval = np.repeat(np.arange(cuts.size - 1), np.diff(cuts))
    count = np.maximum(np.diff(cuts), 1)
    time = problem.slot.astype(np.float64)
    time -= (np.bincount(interval, time) / count)[interval]
    spread = float(time @ time)
    if not spread > 0.0:
        return ""
    per_slot = float(time @ residual) / spread
    over_all = per_slot * sum(record.used.size for record in problem.records)
    certain = abs(per_slot) > DRIFT_VISIBLE_AT * float(np.sqrt(problem.noise.long_run_variance / spread))
    if not certain or abs(over_all) < LARGEST_DRIFT * base:
        return ""
    return (
        f"friction drifts within these recordings (between jumps by {1e3 * over_all:+.2g} mN m in all,"
        f" {100.0 * over_all / base:+.2g} % of base dry friction): is the wheel healthy? A wheel file learned from a"
        " failing wheel calls the failure nominal"
    )


def unnamed_jumps(problem: Problem, jumps: IntArray, systems: Sequence[SwitchingSystem]) -> str:
    """Return what base dry friction may hold where no system is learned; "" where one is."""
    if systems:
        return ""
    inside = np.setdiff1d(jumps, problem.starts).size
    if not inside:
        return "no jumps are seen: if the wheel has switching systems, what friction they add is in base dry friction"
    return (
        f"{inside} jumps are left without a switching system: base dry friction is learned from the lowest level and"
        " not judged in windows that hold such jumps"
    )


def check_distinguished(attribution: JumpAttribution, base: float, hours: float) -> None:
    """Refuse systems that the jumps do not distinguish, and report whether more of them would.

    Parameters
    ----------
    attribution
        The systems found.
    base
        Friction with all at rest [N m].
    hours
        Of recordings.

    Raises
    ------
    InputError
        If many segments fit no system, if another number of systems fits nearly as well, or if two systems of two
        configurations have jumps of the same size that last alike.
    """
    if attribution.odd > MOST_ODD:
        raise InputError(
            "identify",
            f"{100.0 * attribution.odd:.0f} % of the segments between jumps fit no sum of up to {MOST_SYSTEMS}"
            " switching systems: is an effect missing, or does the wheel have more of them? Look at it with"
            " `discrepancy`, or write the systems into the wheel file",
        )
    counts = attribution.chains.counts
    for i, j in combinations(range(len(counts)), 2):
        if (
            counts[i] == counts[j] == 2
            and (share := confused_share(attribution.chains, attribution.visits, i, j)) > MOST_CONFUSED
        ):
            sizes = " and ".join(f"{attribution.chains.size[k, 1] / base:.2g}" for k in (i, j))
            raise InputError(
                "identify",
                "two switching systems are seen, of two configurations each, but not which jump is of which:"
                f" their jumps are of nearly the same size ({sizes} of base dry friction) and last alike, so that"
                f" {100.0 * share:.0f} % of the visits may be of the other. More recordings would not help: write the"
                " systems with their duration laws into the wheel file ([[fss]])",
            )
    for alternative, worse in attribution.alternatives:
        # A system more that is not worth its parameters is no alternative.
        if worse < SURE_BY and Counter(counts) - Counter(alternative):
            times = int(np.ceil(SURE_BY / max(worse, SURE_BY / MOST_TIMES)))
            raise InputError(
                "identify",
                f"the jumps may be of {_in_words(counts)}, or nearly as well of {_in_words(alternative)}"
                f" (log-likelihoods differ by {worse:.1f} of the {SURE_BY:.0f} needed): give about {times} times as"
                f" many recordings, {times * hours:.2g} h in all, or write the systems into the wheel file ([[fss]])",
            )


def _in_words(counts: tuple[int, ...]) -> str:
    """Return in words how many systems of how many configurations."""
    return " and ".join(
        f"{counted(counts.count(count), 'system')} of {count} configurations" for count in sorted(set(counts))
    )


# ---- friction that comes out negative --------------------------------------------------------------------------------


MOTION_VISIBLE_AT: Final = 10.0  # standard deviations of an inertia left in friction, its noise taken to be white
BENT_VISIBLE_AT: Final = 10.0  # standard deviations of drag with the square of the speed, its noise taken to be white
BENT_SHARE: Final = 0.02  # of all friction (rms): less does no harm to what is learned
MOTION_SHARE: Final = 0.02  # of all friction (rms): less does no harm to what is learned


def why_negative(problem: Problem, fitted: Fit, wheel: Wheel, finding: str) -> str:
    """Report why friction comes out negative, or ask.

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
    """Report that friction is no straight line over the speed; None where it is, within its noise or nearly.

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
    """Report that dry and viscous friction are not distinguished, and what is known instead: their sum."""
    speed = float(problem.speed.mean())
    together = float(fitted.level.mean()) + float(fitted.coefficients[0]) * speed
    return (
        f"the speed hardly leaves {speed:.4g} rad/s: there friction is {together:.4g} N m, and these data do"
        " not show how much of that is dry and how much viscous; give recordings at several speeds"
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
