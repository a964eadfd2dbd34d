"""A wheel's friction, noise and switching laws learned from its recordings alone (the paper's own open question).

The recordings are segmented with a shared viscous slope. Then switching systems are told apart by what a system is: a
chain over adjacent configurations whose friction is zero in the lowest one.

1. A *visit* is a jump up that is undone by one of the next jumps. Visits much shorter than the mean time between jumps
   are those of a two-configuration system; they are taken out, and the next time scale is looked at in the same way.
2. In what remains at the longest scale each jump up or down is a step to the adjacent configuration, so the sequence of
   signs is the sequence of configurations.
3. Each configuration's sojourns give its duration law (`duration_laws`), its friction a range.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import Problem, fit, make_problem
from rwa_monitor.discrepancy.duration_laws import LearnedLaw, Sojourns, learn_laws
from rwa_monitor.discrepancy.identification_doubts import (
    check_enough,
    drift_in_words,
    friction_errors,
    unnamed_jumps,
)
from rwa_monitor.discrepancy.negative_friction import at_one_speed, motion_in_friction, why_negative
from rwa_monitor.discrepancy.record import left_out_in_words, make_record
from rwa_monitor.discrepancy.unit_check import Shown, slope_in_question
from rwa_monitor.errors import InputError
from rwa_monitor.physics.wheel import FrictionRange, Noise, Nominal, SwitchingSystem, Wheel, Window
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, BoolArray, FloatArray, IntArray, Samples

MIN_SOJOURNS: Final = 4  # of a configuration, whole or cut; fewer do not show that there is one
# Of a mean duration, one standard deviation. The law written holds it, so that it misleads no diagnosis; but a law that
# is known less well hardly says anything.
LARGEST_LAW_ERROR: Final = 0.3
MAX_CONFIGURATIONS: Final = 5  # a chain that needs more is two systems taken for one
FAST_SHARE: Final = 0.25  # of the mean time between jumps: visits shorter than that are of a faster system
CLOSED_WITHIN: Final = 4.5  # standard deviations by which a visit's way back may miss its entry
JUMPS_INSIDE: Final = 1  # jumps of other systems that may fall into a visit
VISIBLE_AT: Final = 5.0  # standard deviations of a jump below which nothing is made of it
# Of the friction at rest, that of a jump below which it is none of a switching system: a third of what healthy base dry
# friction spreads by. A slope that differs between recordings makes such jumps.
SMALLEST_JUMP: Final = 0.02


@dataclass(frozen=True, slots=True)
class Learned:
    """A wheel learned from recordings.

    Attributes
    ----------
    wheel
        With nominal friction, noise, window and switching systems.
    notes
        What the values rest on, with uncertainties, one line each; for the head of wheel.toml.
    """

    wheel: Wheel
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Sojourn:
    """A stay at one level: slots, level and its standard deviation [N m]; whether it began and ended in the record."""

    slots: int
    level: float
    std: float
    began: bool
    ended: bool


@dataclass(slots=True)
class _Chain:
    """One record while systems are taken out of it.

    Attributes
    ----------
    rest
        float64 (n,), s·torque less viscous friction at the used samples [N m].
    slot
        int64 (n,), their slots.
    quiet
        bool (n,), samples that are in no visit taken out so far.
    jumps
        Sample indices of the jumps left.
    variance
        Long-run variance of the noise [N² m²].
    """

    rest: FloatArray
    slot: IntArray
    quiet: BoolArray
    jumps: list[int]
    variance: float

    def stays(self) -> list[_Sojourn]:
        """Return the stays between the jumps left, levels from the quiet samples only."""
        cuts = [0, *self.jumps, self.rest.size]
        stays = []
        for i, (a, b) in enumerate(pairwise(cuts)):
            values = self.rest[a:b][self.quiet[a:b]]
            if values.size == 0:
                values = self.rest[a:b]
            end = int(self.slot[b]) if b < self.slot.size else int(self.slot[-1]) + 1
            stays.append(
                _Sojourn(
                    end - int(self.slot[a]),
                    float(values.mean()),
                    float(np.sqrt(self.variance / values.size)),
                    began=i > 0,
                    ended=i < len(cuts) - 2,
                )
            )
        return stays


@dataclass(frozen=True, slots=True)
class _Visits:
    """What was learned of one system: per configuration, its sojourns and friction above the lowest [N m]."""

    sojourns: list[Sojourns]
    friction: list[list[float]]
    ups: list[tuple[int, int]]  # per configuration: transitions up, transitions in all


def bare_wheel(name: str, samples: Samples) -> Wheel:
    """Return a wheel of which only name and sample period [s] are known; raises InputError below two samples."""
    if len(samples) < 2:
        raise InputError(name, "holds too few samples to tell the sample period")
    period_ns = float(np.median(np.diff(samples.time_ns)))
    return Wheel(name=name, sample_period_s=period_ns / NANOSECONDS_PER_SECOND)


def identify(recordings: Sequence[tuple[str, Samples]], start: Wheel, *, systems: bool = True) -> Learned:
    """Learn a wheel from its recordings.

    Parameters
    ----------
    recordings
        Name and samples of each recording of one wheel, healthy as far as one knows.
    start
        What is known already: name, sample period, motor constants. Its nominal friction, noise and switching systems
        are learned anew.
    systems
        Whether to learn switching systems; False for short recordings, nominal friction and noise only.

    Raises
    ------
    InputError
        If a recording cannot be used, or there is too little to learn a law from; says how much more is needed.
    """
    bare = start.model_copy(update={"nominal": None, "fss": (), "noise": Noise(), "effect": ()})
    problem = make_problem([make_record(samples, bare, name) for name, samples in recordings], bare)
    fitted = fit(problem, np.zeros((problem.size, 0)))
    viscous = float(fitted.coefficients[0])
    names = ", ".join(name for name, _ in recordings)
    if viscous < 0:
        raise InputError(
            names, why_negative(problem, fitted, bare, f"viscous friction is negative ({viscous:.3g} N m s/rad)")
        )
    chains = _chains(problem, fitted.jumps, fitted.level + fitted.residual)
    lowest = _base_level(chains)[0]
    drift = drift_in_words(problem, fitted.jumps, fitted.residual, lowest)
    try:
        found = _tell_apart(chains) if systems else []
        if systems and not found:
            raise _too_little("a switching system", [Sojourns()])
        laws = [_laws_of(number, visits) for number, visits in enumerate(found, start=1)]
    except InputError as error:
        raise InputError(error.source, "; ".join((*drift, error.reason)), error.place) from error
    base, base_std = _base_level(chains)
    if base <= 0:
        raise InputError(names, why_negative(problem, fitted, bare, f"dry friction is negative ({base:.3g} N m)"))
    nominal_speed = _round_to_two_digits(float(np.quantile(problem.speed, 0.95)))
    motion = motion_in_friction(problem, fitted, bare)
    cause = at_one_speed(problem, fitted) if problem.at_one_speed else motion
    check_enough(problem, base, viscous, names, cause)
    blocks, notes = [], []
    for number, (of_one, visits) in enumerate(zip(laws, found, strict=True), start=1):
        blocks.append(_system(f"fss_{number}", of_one, visits, base))
        notes.append(_note(blocks[-1].name, of_one, visits))
    slots = sum(record.used.size for record in problem.records)
    dry_std, viscous_std = friction_errors(problem)
    dry_std = float(np.hypot(dry_std, base_std))
    wheel = bare.model_copy(
        update={
            "nominal": Nominal(dry_torque_Nm=base, viscous_Nm_s_rad=viscous, nominal_speed_rad_s=nominal_speed),
            "noise": Noise(friction_std_Nm=problem.noise.std),
            "window": _window(start.window, problem),
            "fss": tuple(blocks),
        }
    )
    left_out = left_out_in_words(problem.records)
    colour = problem.noise.long_run_variance / problem.noise.std**2
    head = (
        f"learned from {len(recordings)} recording(s), {slots} slots, {problem.size} samples in motion"
        + (f" ({left_out})" if left_out else ""),
        f"viscous {viscous:.5g} ± {viscous_std:.2g} N m s/rad, base dry {base:.5g} ± {dry_std:.2g} N m",
        f"noise {problem.noise.std:.3g} N m; the variance of a long mean is {colour:.1f} times that of white noise",
    )
    doubts = [*drift, *unnamed_jumps(problem, fitted.jumps, blocks), *([motion] if motion else [])]
    if start.nominal is not None:
        asked = slope_in_question(Shown(viscous, viscous_std), start.nominal.viscous_Nm_s_rad)
        doubts += [asked] if asked else []
    return Learned(Wheel.from_tables(wheel.to_tables(), "learned wheel"), (*head, *notes, *doubts))


def _window(known: Window, problem: Problem) -> Window:
    """Return the window: as known, but no longer than a recording."""
    longest = max(record.used.size for record in problem.records)
    samples = min(known.samples, max(longest, 16))
    return known.model_copy(update={"samples": samples, "hop": None if known.hop is None else min(known.hop, samples)})


def _chains(problem: Problem, jumps: IntArray, rest: FloatArray) -> list[_Chain]:
    """Return the records as chains of jumps."""
    chains = []
    for begin, end in pairwise(problem.starts.tolist()):
        if end > begin:
            inside = jumps[(jumps > begin) & (jumps < end)] - begin
            chains.append(
                _Chain(
                    rest[begin:end],
                    problem.slot[begin:end],
                    np.ones(end - begin, dtype=bool),
                    inside.tolist(),
                    problem.noise.long_run_variance,
                )
            )
    smallest = SMALLEST_JUMP * abs(min(stay.level for chain in chains for stay in chain.stays()))
    for chain in chains:
        _leave_out_small(chain, smallest)
    return chains


def _leave_out_small(chain: _Chain, smallest: float) -> None:
    """Take jumps below a size [N m] out of a chain, the smallest first."""
    while chain.jumps:
        size = np.abs(np.diff([stay.level for stay in chain.stays()]))
        least = int(np.argmin(size))
        if size[least] >= smallest:
            return
        del chain.jumps[least]


def _tell_apart(chains: list[_Chain]) -> list[_Visits]:
    """Return the switching systems, fast ones first."""
    systems = []
    while True:
        limit = _fast_limit(chains)
        pairs = [_visits_of(chain, limit) for chain in chains]
        if sum(len(of_one) for of_one in pairs) < MIN_SOJOURNS:
            break
        visits = _take_out(chains, pairs)
        if len(visits.sojourns[0].complete) < MIN_SOJOURNS:
            raise _too_little("a switching system of short visits", visits.sojourns)
        systems.append(visits)
    _take_out_halves(chains, max((slots for fast in systems for slots in fast.sojourns[1].complete), default=0))
    if any(chain.jumps for chain in chains):
        systems.append(_slow_system([chain.stays() for chain in chains]))
    return systems


def _fast_limit(chains: list[_Chain]) -> int:
    """Return the duration below which visits are of a system faster than the rest [slots]."""
    slots = sum(int(chain.slot[-1] - chain.slot[0]) + 1 for chain in chains)
    jumps = sum(len(chain.jumps) for chain in chains)
    return int(FAST_SHARE * slots / (jumps + 1))


def _visits_of(chain: _Chain, limit: int) -> list[tuple[int, int]]:
    """Return pairs of positions in `chain.jumps`: a jump up and the one that undoes it within `limit` slots."""
    stays = chain.stays()
    size = np.diff([stay.level for stay in stays])
    std = [float(np.hypot(a.std, b.std)) for a, b in pairwise(stays)]
    pairs, taken = [], set()
    for i in range(len(chain.jumps)):
        if i in taken or size[i] < VISIBLE_AT * std[i]:
            continue
        for j in range(i + 1, min(i + 2 + JUMPS_INSIDE, len(chain.jumps))):
            if j in taken or chain.slot[chain.jumps[j]] - chain.slot[chain.jumps[i]] > limit:
                continue
            if abs(size[i] + size[j]) < CLOSED_WITHIN * np.hypot(std[i], std[j]):
                pairs.append((i, j))
                taken |= {i, j}
                break
    return pairs


def _take_out(chains: list[_Chain], pairs: list[list[tuple[int, int]]]) -> _Visits:
    """Take visits out of the chains; return their durations and friction, and the rests between them."""
    active, rests = Sojourns(), Sojourns()
    heights: list[float] = []
    for chain, of_one in zip(chains, pairs, strict=True):
        level = [stay.level for stay in chain.stays()]
        for i, j in of_one:
            begin, end = chain.jumps[i], chain.jumps[j]
            active.add(int(chain.slot[end] - chain.slot[begin]), began=True, ended=True)
            heights.append(0.5 * (level[i + 1] - level[i] + level[j] - level[j + 1]))
            chain.quiet[begin:end] = False
        ends = [int(chain.slot[0]), *(int(chain.slot[chain.jumps[j]]) for _, j in of_one)]
        begins = [*(int(chain.slot[chain.jumps[i]]) for i, _ in of_one), int(chain.slot[-1]) + 1]
        for k, (end, begin) in enumerate(zip(ends, begins, strict=True)):
            rests.add(begin - end, began=k > 0, ended=k < len(of_one))
        gone = {position for pair in of_one for position in pair}
        chain.jumps = [jump for position, jump in enumerate(chain.jumps) if position not in gone]
    return _Visits([rests, active], [[0.0], heights], [(0, 0), (0, 0)])


def _take_out_halves(chains: list[_Chain], longest: int) -> None:
    """Take out visits that were not undone: one end in the very slot of a slower system's jump, or beyond the record.

    They leave two jumps of the chain, or a jump and an end of the record, close by each other: no further apart than
    the `longest` visit [slots].
    """
    for chain in chains:
        if chain.jumps and int(chain.slot[chain.jumps[0]] - chain.slot[0]) <= longest:
            chain.quiet[: chain.jumps.pop(0)] = False
        if chain.jumps and int(chain.slot[-1] - chain.slot[chain.jumps[-1]]) < longest:
            chain.quiet[chain.jumps.pop() :] = False
        for first, second in reversed(list(pairwise(chain.jumps))):
            if int(chain.slot[second] - chain.slot[first]) <= longest:
                chain.quiet[first:second] = False
                chain.jumps.remove(first)


def _slow_system(chains: list[list[_Sojourn]]) -> _Visits:
    """Read the one system that is left: each jump is a step to the adjacent configuration.

    Records are aligned by level: one that never comes down to the lowest level of all begins as many configurations up
    as typical steps fit in between.
    """
    steps = [np.diff([stay.level for stay in chain]) for chain in chains]
    typical = float(np.median(np.abs(np.concatenate(steps))))
    lowest = min(stay.level for chain in chains for stay in chain)
    paths = []
    for chain, step in zip(chains, steps, strict=True):
        path = np.concatenate([[0], np.cumsum(np.sign(step))]).astype(int)
        above = int(np.rint((min(stay.level for stay in chain) - lowest) / typical))
        paths.append(path - path.min() + above)
    count = max(int(path.max()) for path in paths) + 1
    if count > MAX_CONFIGURATIONS:
        raise InputError(
            "identify",
            f"the jumps left would need {count} configurations in one chain; they are of several systems that "
            "durations do not part. Give longer recordings, or a wheel file with the systems",
        )
    sojourns = [Sojourns() for _ in range(count)]
    friction: list[list[float]] = [[] for _ in range(count)]
    ups = [[0, 0] for _ in range(count)]
    for chain, path in zip(chains, paths, strict=True):
        for stay, q in zip(chain, path.tolist(), strict=True):
            friction[q].append(stay.level - lowest)
            sojourns[q].add(stay.slots, began=stay.began, ended=stay.ended)
        for q, following in pairwise(path.tolist()):
            ups[q][0] += int(following > q)
            ups[q][1] += 1
    if min(of_one.seen for of_one in sojourns) < MIN_SOJOURNS or not all(of_one.complete for of_one in sojourns):
        raise _too_little("the slow switching system", sojourns)
    rest = float(np.mean(friction[0]))
    friction = [[value - rest for value in of_one] for of_one in friction]
    return _Visits(sojourns, friction, [(up, total) for up, total in ups])


def _laws_of(number: int, visits: _Visits) -> Sequence[LearnedLaw]:
    """Return the laws of a system, one for each configuration; refuse those that are hardly known."""
    laws = learn_laws(visits.sojourns)
    if max(law.error for law in laws) > LARGEST_LAW_ERROR:
        raise _too_little(f"the laws of switching system {number}", visits.sojourns)
    return laws


def _too_little(what: str, sojourns: list[Sojourns]) -> InputError:
    """Say what was seen and how much more is needed, without claiming that there is such a system at all."""
    counts = ", ".join(f"q = {q}: {of_one.seen}" for q, of_one in enumerate(sojourns) if of_one.seen) or "none"
    fewest = min(of_one.seen if of_one.complete else 0 for of_one in sojourns)
    more = (
        f"about {max(int(np.ceil(2 * MIN_SOJOURNS / fewest)), 2)} times as many recordings"
        if fewest
        else "longer recordings, in which each of its configurations is seen from beginning to end"
    )
    return InputError(
        "identify",
        f"too little data to learn {what}: sojourns seen {counts}, at least {MIN_SOJOURNS} of each are needed, "
        f"and one of them from begin to end, so that its mean is known to {100.0 * LARGEST_LAW_ERROR:.0f} %. "
        "So few jumps of the friction do not show that the wheel has such a system; a missing effect makes "
        "jumps too. --no-systems (systems=False) learns nominal friction and noise without it; if the wheel has it, "
        f"give {more}",
    )


def _base_level(chains: list[_Chain]) -> tuple[float, float]:
    """Return the dry friction with all systems at rest [N m], and its std by how recordings differ in it.

    The mean of the stays at the lowest level, all that are less than half a jump above it: from one recording to
    another the base may differ by a little.
    """
    told = [chain.stays() for chain in chains]
    steps = [np.abs(np.diff([stay.level for stay in stays])) for stays in told]
    smallest = min((float(step.min()) for step in steps if step.size), default=np.inf)
    lowest = min(stay.level for stays in told for stay in stays)
    bases = []
    for stays in told:
        near = [(stay.level, stay.slots) for stay in stays if stay.level < lowest + 0.5 * smallest]
        if near:
            level, slots = np.array(near).T
            bases.append((float(np.average(level, weights=slots)), float(slots.sum())))
    level, slots = np.array(bases).T
    spread = float(np.std(level, ddof=1) / np.sqrt(level.size)) if level.size > 1 else 0.0
    return float(np.average(level, weights=slots)), spread


def _system(name: str, laws: Sequence[LearnedLaw], visits: _Visits, base_Nm: float) -> SwitchingSystem:
    """Return the wheel-file block of a system."""
    ranges = []
    for q, values in enumerate(visits.friction):
        relative = np.array(values) / base_Nm
        # A sample of n misses about 1/(n+1) of a range at each end.
        margin = 0.0 if q == 0 else float(np.ptp(relative)) / (relative.size + 1)
        low, high = (0.0, 0.0) if q == 0 else (float(relative.min()) - margin, float(relative.max()) + margin)
        ranges.append(FrictionRange(low=_four_digits(low), high=_four_digits(high)))
    count = len(laws)
    up = None
    if count > 2 and all(total > 0 for _, total in visits.ups[1:-1]):
        # Laplace's rule of succession: no transition is ruled out because it was not seen.
        middle = [_four_digits((ups + 1) / (total + 2)) for ups, total in visits.ups[1:-1]]
        up = (1.0, *middle, 0.0)
    return SwitchingSystem(
        name=name,
        durations=tuple(law.law for law in laws),
        friction=tuple(ranges),
        up=up,
    )


def _note(name: str, laws: Sequence[LearnedLaw], visits: _Visits) -> str:
    parts = [
        f"q = {q}: {law.family} ({100.0 * law.share:.0f} %), mean {law.mean:.4g} ± {law.error * law.mean:.2g} slots"
        f" from {seen.seen} sojourns{f', {len(seen.cut)} of them cut' if seen.cut else ''}"
        for q, (law, seen) in enumerate(zip(laws, visits.sojourns, strict=True))
    ]
    return f"{name}: {'; '.join(parts)}"


def _four_digits(value: float) -> float:
    return float(f"{value:.4g}")


def _round_to_two_digits(value: float) -> float:
    return float(f"{value:.2g}") if value > 0 else 1.0
