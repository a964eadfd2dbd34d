"""A wheel's friction, noise and switching laws learned from its recordings alone (an open question of the paper).

0. Where viscous friction follows the bearing's temperature, that law is learned first (`heat`).
1. The recordings are segmented with a shared viscous slope: segments of constant dry friction, and jumps between them.
2. The jumps are attributed to switching systems, as many as needed, by size, by duration, and by pairs of jumps that
   cancel (`jump_attribution`).
3. Each configuration's sojourns give its duration law (`duration_laws`), and their friction its range.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.discrepancy.base_fit import Fit, remove_levels, segment_starts
from rwa_monitor.discrepancy.bench import as_measured
from rwa_monitor.discrepancy.plausible import ImpliedValue, ask_speed_unit, first_slope
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import left_out_in_words, limits_of, make_record
from rwa_monitor.errors import InputError
from rwa_monitor.identification.duration_laws import LearnedLaw, learn_laws
from rwa_monitor.identification.heat import learn_heat
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, SECONDS_PER_HOUR, TINY, FloatArray, IntArray, Samples
from rwa_monitor.switching.jump_attribution import (
    TIERS,
    JumpAttribution,
    Segments,
    Visit,
    attribute_jumps,
    confused_pairs,
    ways_up,
)
from rwa_monitor.wheel.file_content import rounded
from rwa_monitor.wheel.wheel import FrictionRange, Noise, Nominal, SwitchingSystem, Wheel, Window
from rwa_monitor.words import counted

MIN_SOJOURNS: Final = 4  # of a configuration, whole or cut; fewer are no evidence of one
# Largest relative standard error of a mean duration. The predictive law includes this uncertainty, so that it misleads
# no diagnosis; but a less certain law is hardly informative.
LARGEST_LAW_ERROR: Final = 0.3
# A third of the spread of healthy base dry friction. As a share of the friction at rest, a smaller jump is not
# attributed to a switching system (a slope that differs between recordings makes such jumps), and a smaller drift is
# ignored; as a share of all friction, a smaller torque does not impair the result.
HARMLESS: Final = 0.02
TYPICAL_WITHIN: Final = 2.5  # standard deviations of a configuration's friction; a uniform law's reach 1.7


class Learned(NamedTuple):
    """A wheel learned from recordings.

    Attributes
    ----------
    wheel
        With nominal friction, noise, window and switching systems.
    notes
        The data behind the values, with uncertainties and warnings, one line each; for the head of wheel.toml.
    """

    wheel: Wheel
    notes: tuple[str, ...]


class _System(NamedTuple):
    """A learned system: per configuration, visits, friction above the lowest [N m], and which transitions went up."""

    visits: list[list[Visit]]
    friction: list[FloatArray]
    ups: list[list[bool]]


def bare_wheel(name: str, samples: Samples) -> Wheel:
    """Return a wheel of which only name and sample period [s] are known; raises InputError below two samples."""
    if len(samples) < 2:
        raise InputError(name, "holds too few samples to estimate the sample period")
    period_ns = float(np.median(np.diff(samples.time_ns)))
    return Wheel(name=name, sample_period_s=period_ns / NANOSECONDS_PER_SECOND)


def identify(recordings: Sequence[tuple[str, Samples]], start: Wheel, *, systems: bool = True) -> Learned:
    """Learn a wheel from its recordings.

    Parameters
    ----------
    recordings
        Name and samples of each recording of one wheel, healthy as far as is known.
    start
        The known wheel: name, sample period, motor constants, and effects, which are subtracted before anything is
        learned and kept. Its nominal friction, noise and switching systems are learned anew.
    systems
        Whether to learn switching systems; False for short recordings, nominal friction and noise only.

    Raises
    ------
    InputError
        If a recording cannot be used, or there is too little data to learn a law; reports how much more is needed.
    """
    bench = as_measured(recordings, start)
    recordings, start = bench.recordings, bench.wheel
    bare = start.model_copy(update={"nominal": None, "fss": (), "noise": Noise(), "effect": ()})
    heat = learn_heat([make_record(samples, bare, name) for name, samples in recordings], start, bare)
    problem, fitted, start = heat.problem, heat.fitted, heat.wheel
    viscous = float(fitted.coefficients[0])
    names = ", ".join(name for name, _ in recordings)
    slots = sum(record.used.size for record in problem.records)
    if viscous < 0:
        raise InputError(
            names, why_negative(problem, fitted, bare, f"viscous friction is negative ({viscous:.3g} N m s/rad)")
        )
    records = _segments(problem, fitted.jumps, fitted.level + fitted.residual)
    base, base_std = _lowest_level(records)
    drift = drift_in_words(problem, fitted.jumps, fitted.residual, base)
    found: list[tuple[_System, Sequence[LearnedLaw]]] = []
    if systems:
        hours = slots * start.sample_period_s / SECONDS_PER_HOUR
        try:
            seen, (base, base_std) = _systems(records, base, hours)
            found = [(system, _laws_of(number, system, hours)) for number, system in enumerate(seen, start=1)]
        except InputError as error:
            raise InputError(error.source, "; ".join(filter(None, (drift, error.reason))), error.place) from error
    if base <= 0:
        raise InputError(names, why_negative(problem, fitted, bare, f"dry friction is negative ({base:.3g} N m)"))
    nominal_speed = rounded(float(np.quantile(problem.motion, 0.95)), 2)
    cause = cause_of(problem, fitted, bare)
    dry_std, viscous_std = friction_errors(problem)
    errors = {"base dry": dry_std / base, "viscous": viscous_std / max(viscous, TINY)}
    check_enough(problem.size, errors, names, cause)
    blocks = [_block_of(f"fss_{number}", laws, system, base) for number, (system, laws) in enumerate(found, start=1)]
    notes = [_note(block.name, laws, system) for block, (system, laws) in zip(blocks, found, strict=True)]
    dry_std = float(np.hypot(dry_std, base_std))
    wheel = bare.model_copy(
        update={
            "nominal": Nominal(
                dry_torque_Nm=base,
                viscous_Nm_s_rad=viscous,
                nominal_speed_rad_s=nominal_speed,
                dry_torque_std_Nm=rounded(dry_std, 2) if np.isfinite(dry_std) else None,
                viscous_std_Nm_s_rad=rounded(viscous_std, 2) if np.isfinite(viscous_std) else None,
                viscous_spread=None if heat.spread is None else rounded(heat.spread, 3),
            ),
            "temperature": start.temperature,
            "noise": Noise(friction_std_Nm=problem.noise.std),
            "window": _window(start.window, problem),
            "fss": tuple(blocks),
            "effect": start.effect,
            "limits": limits_of(start, problem.records),
        }
    )
    left_out = left_out_in_words(problem.records)
    inflation = problem.noise.long_run_variance / problem.noise.std**2
    head = (
        f"learned from {len(recordings)} recording(s), {slots} slots, {problem.size} samples in motion"
        + (f" ({left_out})" if left_out else ""),
        f"viscous {viscous:.5g} ± {viscous_std:.2g} N m s/rad, base dry {base:.5g} ± {dry_std:.2g} N m",
        f"noise {problem.noise.std:.3g} N m; the variance of a long mean is {inflation:.1f} times that of white noise",
    )
    asked = start.nominal and ask_speed_unit(ImpliedValue(viscous, viscous_std), start.nominal.viscous_Nm_s_rad)
    warnings = [why for why in (*heat.notes, drift, unnamed_jumps(problem, fitted.jumps, blocks), cause, asked) if why]
    return Learned(Wheel.from_tables(wheel.to_tables(), "learned wheel"), (*head, *notes, *warnings))


def _window(known: Window, problem: Problem) -> Window:
    """Return the window: as known, but no longer than a recording."""
    longest = max(record.used.size for record in problem.records)
    samples = min(known.samples, max(longest, 16))
    return known.model_copy(update={"samples": samples, "hop": None if known.hop is None else min(known.hop, samples)})


def _segments(problem: Problem, jumps: IntArray, dry: FloatArray) -> list[Segments]:
    """Return the records as segments between jumps, `dry` being friction less its viscous part, float64 (n,) [N m]."""
    found: list[tuple[FloatArray, IntArray, list[int]]] = []
    for begin, end in pairwise(problem.starts.tolist()):
        if end > begin:
            inside = (jumps[(jumps > begin) & (jumps < end)] - begin).tolist()
            found.append((dry[begin:end], problem.slot[begin:end], inside))
    smallest = HARMLESS * abs(min(float(_levels(values, inside)[0].min()) for values, _, inside in found))
    variance = problem.noise.long_run_variance
    records = []
    for values, slot, inside in found:
        _leave_out_small(values, inside, smallest)
        level, count = _levels(values, inside)
        records.append(Segments(level, np.sqrt(variance / count), np.append(slot[[0, *inside]], slot[-1] + 1)))
    return records


def _levels(values: FloatArray, jumps: list[int]) -> tuple[FloatArray, IntArray]:
    """Return the mean of each segment [N m] and its number of samples."""
    count: IntArray = np.diff([0, *jumps, values.size])
    return np.add.reduceat(values, [0, *jumps]) / count, count


def _leave_out_small(values: FloatArray, jumps: list[int], smallest: float) -> None:
    """Remove jumps below a size [N m] from a record's, in place, the smallest first."""
    while jumps:
        size = np.abs(np.diff(_levels(values, jumps)[0]))
        least = int(np.argmin(size))
        if size[least] >= smallest:
            return
        del jumps[least]


def _lowest_level(records: Sequence[Segments]) -> tuple[float, float]:
    """Return the mean of the lowest segments [N m], and its standard error from the spread between recordings.

    They are those less than half the smallest jump above the lowest of all: the base may differ slightly between
    recordings.
    """
    steps = np.concatenate([np.abs(np.diff(one.level)) for one in records])
    highest = min(float(one.level.min()) for one in records) + 0.5 * float(steps.min(initial=np.inf))
    bases = []
    for one in records:
        low = one.level < highest
        if low.any():
            slots = np.diff(one.at)[low]
            bases.append((float(np.average(one.level[low], weights=slots)), int(slots.sum())))
    return _mean_of_records(bases)


def _mean_of_records(bases: Sequence[tuple[float, int]]) -> tuple[float, float]:
    """Return the mean of records' levels [N m], weighted by their slots, and its standard error from their spread."""
    level, slots = np.array(bases).T
    spread = float(np.std(level, ddof=1) / np.sqrt(level.size)) if level.size > 1 else 0.0
    return float(np.average(level, weights=slots)), spread


def _systems(records: Sequence[Segments], lowest: float, hours: float) -> tuple[list[_System], tuple[float, float]]:
    """Return the switching systems, fast ones first, and friction with all at rest with its standard deviation [N m].

    Raises
    ------
    InputError
        If there are none, if they have too few sojourns, or if the jumps do not distinguish them.
    """
    if all(one.level.size == 1 for one in records):
        raise _too_little("a switching system", [[]], hours)
    attribution = attribute_jumps(records, lowest)
    found = [
        _system_of(count, visits) for count, visits in zip(attribution.chains.counts, attribution.visits, strict=True)
    ]
    for system in found:
        if min(map(len, system.visits)) < MIN_SOJOURNS or not all(map(_whole, system.visits)):
            raise _too_little("a switching system", system.visits, hours)
    check_distinguished(attribution, lowest, hours)
    at_rest = [(level, slots) for level, slots in attribution.base if slots > 0]
    found.sort(key=lambda system: min(float(np.median(_whole(seen))) for seen in system.visits[1:]))
    return found, _mean_of_records(at_rest or [(level, 1) for level, _ in attribution.base])


def _system_of(count: int, visits: Sequence[Visit]) -> _System:
    """Return a system, its visits sorted by configuration."""
    by_configuration = [[visit for visit in visits if visit.configuration == q] for q in range(count)]
    friction = [_typical(seen) if seen else np.zeros(0) for seen in by_configuration]
    return _System(by_configuration, friction, [ways_up(visits, q) for q in range(count)])


def _whole(visits: Sequence[Visit]) -> list[int]:
    """Return the slots of the visits that no record cuts."""
    return [visit.slots for visit in visits if visit.whole]


def _typical(seen: Sequence[Visit]) -> FloatArray:
    """Return the friction of the visits that determine a configuration's range [N m].

    The friction of a short visit is too uncertain; and a visit far from the others may be another system's.
    """
    friction, std = np.array([(visit.friction, visit.std) for visit in seen]).T
    good = std <= np.median(std)
    good &= np.abs(friction - np.median(friction[good])) <= TYPICAL_WITHIN * np.std(friction[good])
    return np.asarray(friction[good])


def _laws_of(number: int, system: _System, hours: float) -> Sequence[LearnedLaw]:
    """Return the laws of a system, one for each configuration; raise InputError where one is too uncertain."""
    laws = learn_laws(system.visits)
    worst = max(law.error for law in laws)
    if worst > LARGEST_LAW_ERROR:
        times = (worst / LARGEST_LAW_ERROR) ** 2
        raise _too_little(f"the laws of switching system {number}", system.visits, hours, times)
    return laws


def _too_little(what: str, visits: Sequence[Sequence[Visit]], hours: float, times: float = 1.0) -> InputError:
    """Return an error that reports the sojourns seen and how much more data is needed, if there is such a system.

    Parameters
    ----------
    what
        The quantity that is not learned.
    visits
        By configuration.
    hours
        Length of the recordings.
    times
        Least factor on the number of sojourns that is needed.
    """
    counts = ", ".join(f"q = {q}: {len(seen)}" for q, seen in enumerate(visits) if seen) or "none"
    fewest = min(len(seen) if _whole(seen) else 0 for seen in visits)
    more = "longer recordings, in which each of its configurations is seen from beginning to end"
    if fewest:
        factor = max(int(np.ceil(max(times, 2 * MIN_SOJOURNS / fewest))), 2)
        more = (
            f"about {factor} times as many recordings, {factor * hours:.2g} h in all"
            f" (its rarest configuration is seen {fewest / hours:.2g} times an hour)"
        )
    return InputError(
        "identify",
        f"too little data to learn {what}: sojourns seen {counts}, at least {MIN_SOJOURNS} of each are needed, "
        f"one of them whole, so that its mean is known to {100.0 * LARGEST_LAW_ERROR:.0f} %. "
        "So few jumps do not show that the wheel has such a system; a missing effect makes "
        "jumps too. --no-systems (systems=False) learns nominal friction and noise without it; if the wheel has it, "
        f"give {more}",
    )


def _block_of(name: str, laws: Sequence[LearnedLaw], system: _System, base_Nm: float) -> SwitchingSystem:
    """Return the wheel-file block of a system."""
    ranges = [FrictionRange(low=0.0, high=0.0)]
    for values in system.friction[1:]:
        relative = values / base_Nm
        # The range of a sample of n falls short of the true one by about 1/(n+1) of it at each end.
        margin = float(np.ptp(relative)) / (relative.size + 1)
        low, high = float(relative.min()) - margin, float(relative.max()) + margin
        ranges.append(FrictionRange(low=rounded(low, 4), high=rounded(high, 4)))
    count = len(laws)
    up = None
    if count > 2 and all(system.ups[1:-1]):
        # Laplace's rule of succession: no transition is ruled out because it was not seen.
        middle = [rounded((sum(ways) + 1) / (len(ways) + 2), 4) for ways in system.ups[1:-1]]
        up = (1.0, *middle, 0.0)
    return SwitchingSystem(name=name, durations=tuple(law.law for law in laws), friction=tuple(ranges), up=up)


def _note(name: str, laws: Sequence[LearnedLaw], system: _System) -> str:
    parts = []
    for q, (law, seen) in enumerate(zip(laws, system.visits, strict=True)):
        cut = len(seen) - len(_whole(seen))
        parts.append(
            f"q = {q}: {law.family} ({100.0 * law.share:.0f} %), mean {law.mean:.4g} ± {law.error * law.mean:.2g} slots"
            f" from {len(seen)} sojourns{f', {cut} of them cut' if cut else ''}"
        )
    return f"{name}: {'; '.join(parts)}"


# ---- insufficient data, and warnings ---------------------------------------------------------------------------------


# A nominal value is useful while its standard deviation is at most about half of the half-width of the built-in model's
# bands of healthy wheels: 6 % for base dry friction, 4 % for viscous friction.
LARGEST_ERROR: Final = 0.025
DRIFT_VISIBLE_AT: Final = 6.0  # standard deviations, above which a drift is significant
MOST_SYSTEMS: Final = max(len(counts) for tier in TIERS for counts in tier)
MAX_UNEXPLAINED: Final = 0.1  # share of segments that fit no system; more are not due to chance
SURE_BY: Final = 3.0  # log-likelihood by which one description must exceed the next: odds of 20
MOST_TIMES: Final = 10  # largest factor on the recordings that is asked for, where two descriptions hardly differ


def friction_errors(problem: Problem) -> tuple[float, float]:
    """Return the standard deviations of base dry [N m] and of viscous friction [N m s/rad] due to noise."""
    variance, mean = problem.noise.long_run_variance, float(problem.speed.mean())
    inner = problem.speed - mean
    viscous_std = math.sqrt(variance / max(float(inner @ inner), TINY))
    return float(np.hypot(np.sqrt(variance / problem.size), mean * viscous_std)), viscous_std


def check_enough(samples: int, errors: Mapping[str, float], names: str, cause: str | None) -> None:
    """Raise InputError where the nominal friction is too uncertain to distinguish a healthy wheel from a failing one.

    `errors`: relative ones, by kind of friction. The error raised asks for more data than these samples, or reports
    `cause` where more data would not help.
    """
    worst, error = max(errors.items(), key=lambda one: one[1])
    if error > LARGEST_ERROR:
        if cause is not None:
            raise InputError(names, f"{worst} friction is uncertain by {100.0 * error:.2g} %: {cause}")
        raise InputError(
            names,
            f"too little data to learn a wheel: {samples} samples in motion leave {worst} friction uncertain by"
            f" {100.0 * error:.2g} % ({100.0 * LARGEST_ERROR:.2g} % at most); give about"
            f" {int(np.ceil((error / LARGEST_ERROR) ** 2))} times as many, or a wider range of speeds",
        )


def drift_in_words(problem: Problem, jumps: IntArray, residual: FloatArray, base: float) -> str:
    """Report a drift of friction between jumps, where a healthy wheel's is constant; "" if there is none.

    The drift is the common slope in time of the residual of levels and viscous friction, within the intervals between
    jumps. A large drift is also fitted by jumps, which take most of it out of that residual.
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
    certain = abs(per_slot) > DRIFT_VISIBLE_AT * math.sqrt(problem.noise.long_run_variance / spread)
    if not certain or abs(over_all) < HARMLESS * base:
        return ""
    return (
        f"friction drifts within these recordings (between jumps by {1e3 * over_all:+.2g} mN m in all,"
        f" {100.0 * over_all / base:+.2g} % of base dry friction): is the wheel healthy? A wheel file learned from a"
        " failing wheel calls the failure nominal"
    )


def unnamed_jumps(problem: Problem, jumps: IntArray, systems: Sequence[SwitchingSystem]) -> str:
    """Return a warning of what base dry friction may include where no system is learned; "" where one is."""
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
    """Raise InputError where the jumps do not distinguish the systems, and report whether more data would.

    Parameters
    ----------
    attribution
        The systems found.
    base
        Friction with all at rest [N m].
    hours
        Length of the recordings.

    Raises
    ------
    InputError
        If many segments fit no system, if other numbers of configurations fit nearly as well, or if two systems of two
        configurations have jumps of about the same size and duration.
    """
    if attribution.unexplained > MAX_UNEXPLAINED:
        raise InputError(
            "identify",
            f"{100.0 * attribution.unexplained:.0f} % of the segments between jumps fit no sum of up to {MOST_SYSTEMS}"
            " switching systems: is an effect missing, or does the wheel have more of them? Look at it with"
            " `discrepancy`, or write the systems into the wheel file",
        )
    counts = attribution.chains.counts
    for i, j, share in confused_pairs(attribution.chains, attribution.visits):
        sizes = " and ".join(f"{attribution.chains.size[k, 1] / base:.2g}" for k in (i, j))
        raise InputError(
            "identify",
            "two switching systems are seen, of two configurations each, but not which jump is of which:"
            f" their jumps are of nearly the same size ({sizes} of base dry friction) and last alike, so that"
            f" {100.0 * share:.0f} % of the visits may be of the other. More recordings would not help: write the"
            " systems with their duration laws into the wheel file ([[fss]])",
        )
    for alternative, worse in attribution.alternatives:
        # An alternative that only adds systems is none: their gain is below the penalty of their parameters.
        if worse < SURE_BY and Counter(counts) - Counter(alternative):
            times = min(int(np.ceil(SURE_BY / max(worse, TINY))), MOST_TIMES)
            raise InputError(
                "identify",
                f"the jumps may be of {_in_words(counts)}, or nearly as well of {_in_words(alternative)}"
                f" (log-likelihoods differ by {worse:.1f} of the {SURE_BY:.0f} needed): give about {times} times as"
                f" many recordings, {times * hours:.2g} h in all, or write the systems into the wheel file ([[fss]])",
            )


def _in_words(counts: tuple[int, ...]) -> str:
    """Return in words the number of systems with each number of configurations."""
    return " and ".join(
        f"{counted(counts.count(count), 'system')} of {count} configurations" for count in sorted(set(counts))
    )


# ---- friction that comes out negative --------------------------------------------------------------------------------


VISIBLE_AT: Final = 10.0  # standard deviations, above which a torque in the friction is significant, for white noise


def why_negative(problem: Problem, fitted: Fit, wheel: Wheel, finding: str) -> str:
    """Report why the estimated friction is negative, or ask for likely reasons.

    Torque that drives the rotation has the wrong sign; else see `cause_of`.

    Parameters
    ----------
    problem, fitted
        The records and the base law fitted to them.
    wheel
        Constants with which friction was derived.
    finding
        The negative quantity, in words.
    """
    if problem.at_one_speed:
        return at_one_speed(problem, fitted)
    if float(np.mean(problem.z)) < 0:
        return f"{finding}, and torque drives the rotation on the average: is the sign of speed or torque right?"
    falls = "drag falls with the speed; is the range of speeds small, or the bearing warmer while the wheel is fast?"
    return f"{finding}, and {cause_of(problem, fitted, wheel) or falls}"


def cause_of(problem: Problem, fitted: Fit, wheel: Wheel) -> str | None:
    """Report why dry and viscous friction cannot be learned; None where nothing prevents it.

    In this order: at one speed only their sum is identifiable; drag that grows faster than the speed makes the dry
    friction negative, and while a wheel runs down it mimics an inertia; friction that follows the acceleration includes
    a part of the inertia's torque.

    Parameters
    ----------
    problem, fitted, wheel
        As for `why_negative`.
    """
    if problem.at_one_speed:
        return at_one_speed(problem, fitted)
    return missing_law(problem, fitted) or motion_in_friction(problem, fitted, wheel)


def _share_of(problem: Problem, fitted: Fit, column: FloatArray, size: float) -> tuple[float, float, bool]:
    """Return the coefficient of a column given levels and slope, its standard deviation, and whether it is harmful.

    `size` is the size of the column: the coefficient times it is compared with all friction.
    """
    first = segment_starts(problem, fitted.jumps)
    design = remove_levels(np.column_stack([column, problem.speed]), first)
    value, std = first_slope(design, remove_levels(problem.z, first))
    large = abs(value) * size >= HARMLESS * math.sqrt(np.mean(problem.z**2))
    return value, std, large and abs(value) >= VISIBLE_AT * std


def missing_law(problem: Problem, fitted: Fit) -> str | None:
    """Report that friction is not linear in the speed; None where it is, within noise or nearly."""
    # At the middle of a range a parabola c·x² is off its chord by c·range²/8.
    value, _, bent = _share_of(problem, fitted, problem.speed**2, float(np.ptp(problem.speed)) ** 2 / 8.0)
    if not bent:
        return None
    how = "upwards over the speed, as windage or a rise towards rest does" if value > 0 else "downwards over the speed"
    return (
        f"drag bends {how}: a law is missing, which rwa-monitor discrepancy names; its extended_wheel.toml, given with"
        " --wheel, lets the rest be learned"
    )


def at_one_speed(problem: Problem, fitted: Fit) -> str:
    """Report that dry and viscous friction are not separately identifiable, and their sum."""
    speed = float(problem.speed.mean())
    together = float(fitted.level.mean()) + float(fitted.coefficients[0]) * speed
    return (
        f"the speed hardly leaves {speed:.4g} rad/s: there friction is {together:.4g} N m, and these data do"
        " not show how much of that is dry and how much viscous; give recordings at several speeds"
    )


def motion_in_friction(problem: Problem, fitted: Fit, wheel: Wheel) -> str | None:
    """Return a question where a harmful part of friction follows the acceleration; None where none does."""
    if wheel.friction.motor_off:  # friction is the inertia's torque
        return None
    along = problem.sign * problem.gather([record.channels.acceleration_rad_s2 for record in problem.records])
    value, std, follows = _share_of(problem, fitted, along, float(np.std(along)))
    if not follows:
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
