"""The list of hypotheses: effects with columns that a search tries, and which of them a motion can show, how strong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import linalg
from scipy.signal import savgol_filter

from rwa_monitor.discrepancy.jump_terms import JUMP_TERMS, DelayTerm
from rwa_monitor.discrepancy.likelihood import Series, asked_gain
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.result import FoundEffect
from rwa_monitor.discrepancy.score import Background
from rwa_monitor.discrepancy.shape_profile import middle_shape, shape_limits
from rwa_monitor.discrepancy.terms import Model, SearchResult, Term, available, depends_on_level, law_of, make_term
from rwa_monitor.samples import TINY, FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, MEAN_EFFECTS
from rwa_monitor.wheel.effects.drag_laws import LEAST_K
from rwa_monitor.wheel.effects.formula import FORMULAS, Formula
from rwa_monitor.wheel.effects.jumps import FEWEST_SOJOURNS
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


# ---- which effects a motion can show: by their columns, never by their names -----------------------------------------
# What the base law spans is not testable, nor what is no law of the speed but follows the speed in this motion, as
# time, acceleration and every lag do while a wheel runs down.


KNOTS: Final = 12  # of a free curve over the speed, of each kind
NEAREST_REST: Final = 0.002  # quantile of the speeds: the few that are slower show nothing by themselves
SPANNED: Final = 0.02  # of a column's energy beyond the base law: so little is left of what a curve of the speed spans
LEAST_BEYOND: Final = 1e-5  # of its energy: what is left of a column by the noise of the speed, and by smoothing
EXPLAINED_AWAY: Final = 1e-8  # of its energy: what is left of a column that the base law spans
SLOW_WINDOWS: Final = 50  # in a record: a motion smoothed over one of them has lost its noise
LONGER: Final = 0.75  # of the range of each shape parameter, which is tried where its middle shows nothing
NOT_COMMANDED: Final = "friction that is measured: here it is a ramp over time that was commanded"
FOLLOWS_THE_SPEED: Final = "a motion in which it does not follow the speed: several sweeps, or dwells"


def sort_out(
    problem: Problem, known: FloatArray, effects: Sequence[type[MeanEffect]], level: FloatArray
) -> tuple[list[type[MeanEffect]], list[tuple[str, str]]]:
    """Split the effects into those that the records can test and those they cannot, with what is missing.

    Parameters
    ----------
    problem
        The data.
    known
        float64 (p, n), regressors of the base law in the friction's own sign.
    effects
        Candidates.
    level
        float64 (n,), dry friction [N m], for columns that follow it.
    """
    series = Series.of(problem)
    known, curve = (linalg.orth(rows.T).T for rows in (known, np.vstack([known, speed_curve(series)])))
    calm = replace(problem, records=tuple(replace(r, channels=_calm(r.channels)) for r in problem.records))
    calm = calm.with_empty_caches()

    def missing(effect: type[MeanEffect]) -> str | None:
        """Return what an effect lacks: a channel, or a motion that sets it apart; None for nothing.

        A lag may be too short in the middle of its range to be seen, and a longer one not.
        """
        channel = available(problem, effect)
        if channel is not None:
            return channel
        discrete = [parameter for parameter in effect.shape_parameters() if parameter.choices]
        if not all(any(parameter.is_shown(one.channels) for one in problem.records) for parameter in discrete):
            return effect.separate_by
        shape = middle_shape(problem, effect)
        reason = missing_at(effect, shape)
        if reason is None or reason == NOT_COMMANDED or _is_law_of_speed(problem, effect, shape):
            return reason
        return reason if missing_at(effect, middle_shape(problem, effect, LONGER)) else None

    def missing_at(effect: type[MeanEffect], shape: dict[str, float]) -> str | None:
        """Return what of the motion an effect of one shape lacks; None for nothing."""
        rows = make_term(problem, effect, shape, level).columns.T * series.sign
        if _beyond(rows, known) <= EXPLAINED_AWAY * float(np.sum(rows**2)):
            # Dry friction is not negative: where it seems to be, what drives the wheel is no part of it.
            return None if effect.may_drive and not problem.at_one_speed and level.max() <= 0.0 else effect.separate_by
        if problem.is_command and _is_law_of_time(problem, effect, shape):
            return NOT_COMMANDED
        if _is_law_of_speed(problem, effect, shape):
            return None
        slow = make_term(calm, effect, shape, level).columns.T * series.sign
        beyond, least = _beyond(slow, known), LEAST_BEYOND * float(np.sum(slow**2))
        return FOLLOWS_THE_SPEED if _beyond(slow, curve) < max(SPANNED * beyond, least) else None

    reasons = list(zip(effects, problem.each(missing, effects), strict=True))
    testable = [effect for effect, reason in reasons if reason is None]
    return testable, [(effect.name, reason) for effect, reason in reasons if reason is not None]


def _beyond(rows: FloatArray, basis: FloatArray) -> float:
    """Return the energy of rows that orthonormal ones do not span."""
    return float(np.sum((rows - rows @ basis.T @ basis) ** 2))


def speed_curve(series: Series) -> FloatArray:
    """Return a free curve over |ω|, one for each direction: hats between knots, float64 (p, n).

    Between half of the knots lie as many samples each. The others are of equal ratios: what friction does near rest
    spans decades of the speed, in a part of the samples that no quantile parts.
    """
    speed = np.abs(series.speed)
    low, high = np.quantile(speed, (NEAREST_REST, 1.0))
    ratios = np.geomspace(low, high, KNOTS) if low > 0.0 else speed[:0]
    knots = np.unique(np.concatenate([np.quantile(speed, np.linspace(0.0, 1.0, KNOTS)), ratios]))
    hats = np.stack([np.interp(speed, knots, height) for height in np.eye(knots.size)])
    rows = np.vstack([hats * (series.sign > 0), hats * (series.sign < 0)])
    return rows[rows.any(axis=1)]


def _calm(channels: Channels) -> Channels:
    """Return the motion without its noise, smoothed over a small part of the record."""
    width = max(len(channels) // SLOW_WINDOWS, 3) | 1
    known = np.isfinite(channels.speed_rad_s)
    filled = np.interp(np.arange(known.size), np.flatnonzero(known), channels.speed_rad_s[known])
    speed, rate = (savgol_filter(filled, width, 2, deriv=order, delta=channels.sample_period_s) for order in (0, 1))
    return replace(channels, speed_rad_s=speed, acceleration_rad_s2=rate)


def _is_law_of_speed(problem: Problem, effect: type[MeanEffect], shape: dict[str, float]) -> bool:
    """Return whether an effect depends on speed, direction and level alone: its columns then move with the samples."""
    if effect.needs:
        return False
    channels = problem.records[0].channels
    channels = replace(channels, dry_level_Nm=np.ones(len(channels)))
    order = np.random.default_rng(0).permutation(len(channels))
    nothing = np.zeros(len(channels))
    moved = replace(
        channels,
        speed_rad_s=channels.speed_rad_s[order],
        direction=channels.direction[order],
        good=channels.good[order],
        acceleration_rad_s2=nothing,
        angle_rad=nothing,
    )
    here, there = effect.columns(channels, shape)[0], effect.columns(moved, shape)[0]
    return bool(np.array_equal(np.nan_to_num(here[order]), np.nan_to_num(there)))


def _is_law_of_time(problem: Problem, effect: type[MeanEffect], shape: dict[str, float]) -> bool:
    """Return whether an effect depends on the time itself."""
    channels = problem.records[0].channels
    later = replace(channels, time_s=channels.time_s[::-1])
    here, there = effect.columns(channels, shape)[0], effect.columns(later, shape)[0]
    return not np.array_equal(np.nan_to_num(here), np.nan_to_num(there))


# ---- formulas as candidates of the search, for what no effect of the catalogue explains, and how one is reported -----


def formulas(problem: Problem) -> list[type[MeanEffect]]:
    """Return the structures that the records can distinguish, in the order of the grammar.

    Left out are those whose channel is missing or constant, whose constants have no range to be found in, and those
    that equal another: no direction in records of one direction (the dry carrier), viscous at one speed (the dry one).
    """
    one_way = bool(np.all(problem.sign == problem.sign[0]))
    temperature = [record.channels.bearing_temperature_degC for record in problem.records]
    known = np.concatenate([one[np.isfinite(one)] for one in temperature if one is not None] or [np.zeros(0)])
    left_out = {
        "even": one_way,
        "viscous": problem.at_one_speed,
        "speed": problem.at_one_speed,
        "temperature": not known.size or float(np.ptp(known)) <= LEAST_K,
    }

    def is_shown(law: type[Formula]) -> bool:
        if left_out.get(law.carrier) or left_out.get(law.variable) or available(problem, law) is not None:
            return False
        limits = shape_limits(problem, law)
        return all(low < high for low, high in limits.values())

    return [law for law in FORMULAS.values() if is_shown(law)]


def describe(term: Term, strengths: FloatArray) -> str:
    """Return a formula with its constants, such as "a·tanh(|ω|/ω0)·sign ω, a = 0.000123 N m, ω0 = 8.5 rad/s".

    Parameters
    ----------
    term
        Of a formula.
    strengths
        float64 (p,), of its columns [N m or N m s/rad].
    """
    law = term.effect
    assert issubclass(law, Formula)
    names = [parameter.name for parameter in law.strength_parameters()]
    values = {**dict(zip(names, strengths.tolist(), strict=True)), **term.shape}
    constants = [f"{law.symbols[p.name]} = {values[p.name]:.3g} {p.unit}".removesuffix(" -") for p in law.parameters]
    return ", ".join([law.text, *constants])


# ---- what a record could not test ------------------------------------------------------------------------------------
# Effects that would show only beyond any likely strength, and jumps that are too few. A strength is detectable where it
# gains as much as the search asks for, by the score of the search: its column, less what levels, slope and the effects
# found hold of it, over the noise that the last model leaves. Part of an effect passes for colour of the noise until it
# is named, and up to about twice the strength may be needed; more where a jump or two could do the same, as at a single
# change of direction.


TOO_LARGE: Final = 0.3  # of the RMS of all friction: an effect that must be larger to show has not been tested
# Of the RMS of the friction where it acts: what acts in a few samples has a small RMS however large it is there, as
# drag near zero speed where the wheel hurries through. Static friction of twice the dry is the most that bearings show.
TOO_LARGE_AT_PEAK: Final = 1.0

VISIBLE: Final = 1e-12  # of a column's energy: what is left of it by rounding

FRICTION_NOT_DERIVED: Final = "motor_current_A instead of friction_torque_Nm"
NO_JUMPS: Final = "jumps of the friction: none is seen here"
NO_SYSTEMS: Final = "fss: the switching systems in the wheel file"


@dataclass(frozen=True, slots=True)
class Detectable:
    """The smallest strength at which an effect would have been found, its shape in the middle of what can show.

    Attributes
    ----------
    name
        Catalogue name.
    parameter, strength, unit
        The strength; NaN where no strength would show.
    share
        RMS of its torque over that of all friction [-].
    peak_share
        Its largest torque over the RMS of the friction where it acts [-].
    too_weak
        True where that is more than can be expected.
    """

    name: str
    parameter: str
    strength: float
    unit: str
    share: float
    peak_share: float
    too_weak: bool

    def in_words(self) -> str:
        """Return the strength with its unit, to the two digits that it is known to at most."""
        return f"{self.strength:.2g} {self.unit}".rstrip(" -")

    def would_show(self) -> str:
        """Return from which strength on it would show, and how much of friction that is."""
        there = f", {self.peak_share:.0%} of what there is where it acts" if self.share <= TOO_LARGE else ""
        strength = f"{self.parameter} = {self.in_words()}"
        return f"here it would show only from {strength} on, {self.share:.0%} of all friction{there}"


def detectable_strengths(problem: Problem, model: Model, effects: Sequence[type[MeanEffect]]) -> list[Detectable]:
    """Return for each effect that the data have the channels for, and the model lacks, what strength would show."""
    beside = Background.of(problem, model.terms, law_of(model), model.fit.jumps)
    without = beside.equations_with()
    variance = without.memory * without.rss(without.solve()[0]) / without.samples
    friction = float(np.sqrt(np.mean(problem.z**2)))
    found = []
    for effect in effects:
        if effect.name in model.names or available(problem, effect) is not None:
            continue
        term = make_term(problem, effect, middle_shape(problem, effect), model.fit.level)
        column, known = term.columns[:, 0], without.moment.size
        gram = beside.equations_with(term).gram
        across = gram[:known, known]
        energy = float(gram[known, known] - across @ np.linalg.lstsq(gram[:known, :known], across, rcond=1e-12)[0])
        asked = asked_gain(len(model.terms)) + term.parameters * problem.log_size
        visible = energy > VISIBLE * float(gram[known, known])
        strength = float(np.sqrt(asked * variance / energy)) if visible else float("nan")
        share = strength * float(np.sqrt(np.mean(column**2))) / friction
        beyond = not visible or strength > max(float(term.high[0]), -float(term.low[0]))
        parameter = effect.strength_parameters()[0]
        # A column that follows the level is in proportion to friction itself: its bounds are what is likely.
        # A strength in N m is what the effect reaches in a motion that shows it whole.
        peak = strength * max(float(np.max(np.abs(column))), 1.0 if parameter.unit == "N m" else 0.0)
        there = float(np.sqrt(column**2 @ problem.z**2 / max(float(column @ column), TINY)))
        peak = peak / there if there > 0 else np.inf
        large = (share > TOO_LARGE or peak > TOO_LARGE_AT_PEAK) and not depends_on_level(effect)
        found.append(Detectable(effect.name, parameter.name, strength, parameter.unit, share, peak, beyond or large))
    return found


def not_testable(
    problem: Problem, effects: Sequence[type[MeanEffect]], untested: Sequence[tuple[str, str]]
) -> set[str]:
    """Return which of the untested effects lack a channel or a part of the wheel file: no motion would show them.

    The others lack a motion, or jumps: these data do not excite them.
    """
    by_name = {effect.name: effect for effect in effects}
    return {
        name
        for name, missing in untested
        if (name in by_name and available(problem, by_name[name]) is not None)
        or missing in (FRICTION_NOT_DERIVED, NO_SYSTEMS)
    }


def as_a_part(sentence: str) -> str:
    """Return a sentence as a part of a longer one."""
    return sentence[:1].lower() + sentence[1:].rstrip(".")


def untested(
    problem: Problem,
    found: SearchResult,
    mean: Sequence[FoundEffect],
    wheel: Wheel,
    tried: Sequence[type[MeanEffect]],
    not_shown: Sequence[type[MeanEffect]],
) -> dict[str, str]:
    """Return what the records could not test, and what is missing, by name; none that was named or could stand for one.

    Parameters
    ----------
    problem, found, mean, wheel
        The data and the answer, its mean effects as they are reported.
    tried, not_shown
        Effects that the motion can show, and those that it cannot.
    """
    model = found.nested[-1]
    missing = [entry for entry in found.untestable if entry[0] in CATALOGUE]
    missing += [
        (entry.name, f"{as_a_part(CATALOGUE[entry.name].separate_by)}; {entry.would_show()}")
        for entry in detectable_strengths(problem, model, tried)
        if entry.too_weak and np.isfinite(entry.strength)
    ]
    if not all(record.friction_is_derived for record in problem.records):
        missing.append(("tachometer_quantisation", FRICTION_NOT_DERIVED))
    jumps = int(model.fit.jumps.size)
    few = f"a longer record: {jumps} jumps, and a law of durations asks for {FEWEST_SOJOURNS} sojourns or more"
    if not wheel.fss:
        missing.append(("wrong_duration_law", NO_SYSTEMS))
    elif jumps < FEWEST_SOJOURNS:
        missing.append(("wrong_duration_law", few))
    if jumps < FEWEST_SOJOURNS:
        missing.append(("speed_triggered_jumps", few))
    named = {name for effect in mean for name in (effect.name, *effect.equivalent)}
    listed: dict[str, str] = {}
    for name, what in missing:
        if name not in named:
            listed.setdefault(name, what)
    for effect in not_shown:
        listed.setdefault(effect.name, as_a_part(effect.separate_by))
    if not model.fit.jumps.size:
        listed |= {term.name: NO_JUMPS for term in JUMP_TERMS if term.name in listed}
    return listed
