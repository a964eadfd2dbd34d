"""The hypotheses of a search: effects with columns, which of them the records can test, and from which strength on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import linalg
from scipy.signal import savgol_filter

from rwa_monitor.discrepancy.jump_terms import JUMP_TERMS, DelayTerm
from rwa_monitor.discrepancy.likelihood import Series, least_gain
from rwa_monitor.discrepancy.problem import Problem, rms
from rwa_monitor.discrepancy.result import FoundEffect
from rwa_monitor.discrepancy.score import Background
from rwa_monitor.discrepancy.shape_profile import middle_shape, shape_limits
from rwa_monitor.discrepancy.terms import Model, SearchResult, Term, available, depends_on_level, make_term
from rwa_monitor.samples import TINY, FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, MEAN_EFFECTS
from rwa_monitor.wheel.effects.drag_laws import LEAST_K
from rwa_monitor.wheel.effects.formula import FORMULAS, Formula
from rwa_monitor.wheel.effects.jumps import FEWEST_SOJOURNS
from rwa_monitor.wheel.wheel import Wheel

# All effects with columns: mean effects, and switching effects that are torques too; some with their own columns.
CANDIDATES: Final = tuple({**MEAN_EFFECTS, **{term.name: term for term in (DelayTerm, *JUMP_TERMS)}}.values())


def candidates(wheel: Wheel, problem: Problem) -> list[type[MeanEffect]]:
    """Return the effects with columns that the search tries, without those in the wheel file and superseded ones."""
    known = {block.name for block in wheel.effect}
    known |= {
        effect.name
        for effect in CANDIDATES
        if any(getattr(record.channels, one) is not None for record in problem.records for one in effect.superseded_by)
    }
    return [effect for effect in CANDIDATES if effect.name not in known]


def is_observable(problem: Problem, effect: type[MeanEffect]) -> bool:
    """Return whether an effect is observable: derived friction at constant speed does not show effects of motion.

    There the speed varies by its noise alone, which derived friction contains, too: it would mimic such an effect.
    """
    at_rest = problem.friction_is_derived and speed_is_constant(problem)
    return not at_rest or effect.shows_at_one_speed


def speed_is_constant(problem: Problem) -> bool:
    """Return whether the speed varies by hardly more than its noise."""
    noise = max(record.speed_noise_rad_s for record in problem.records)
    return float(np.std(problem.speed)) < max(1e-3 * float(np.max(problem.speed)), 3 * noise)


# ---- which effects are identifiable in a motion: by their columns, never by their names ------------------------------
# Not testable is an effect whose columns the base law spans, or one that is no law of the speed but a function of the
# speed in this motion, as time, acceleration and every lag are while a wheel runs down.


KNOTS: Final = 12  # of a piecewise linear curve over the speed, of each kind
SLOWEST_QUANTILE: Final = 0.002  # quantile of the speeds: the slower ones are too few to identify anything
SPANNED: Final = 0.02  # of a column's energy outside the base law: below it, a curve over the speed spans the column
LEAST_BEYOND: Final = 1e-5  # of its energy: noise of the speed and smoothing leave so much of a column that is spanned
SPANNED_EXACTLY: Final = 1e-8  # of its energy: rounding leaves so much of a column that the base law spans
SLOW_WINDOWS: Final = 50  # in a record: smoothing the motion over one of them removes its noise
UPPER_SHAPE: Final = 0.75  # of the range of each shape parameter: tried where its middle is not testable
NOT_COMMANDED: Final = "friction that is measured: here it is a ramp over time that was commanded"
FOLLOWS_THE_SPEED: Final = "a motion in which it does not follow the speed: several sweeps, or dwells"


def split_testable(
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
    smooth = replace(problem, records=tuple(replace(r, channels=_smoothed(r.channels)) for r in problem.records))
    smooth = smooth.with_empty_caches()

    def missing(effect: type[MeanEffect]) -> str | None:
        """Return what an effect lacks: a channel, or a motion that distinguishes it; None where it is testable.

        A lag in the middle of its range may be too short to be identified although a longer one can be: both are tried.
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
        return reason if missing_at(effect, middle_shape(problem, effect, UPPER_SHAPE)) else None

    def missing_at(effect: type[MeanEffect], shape: dict[str, float]) -> str | None:
        """Return what the motion lacks to test an effect with a given shape; None where it is testable."""
        rows = make_term(problem, effect, shape, level).columns.T * series.sign
        if _unspanned_energy(rows, known) <= SPANNED_EXACTLY * float(np.sum(rows**2)):
            # Dry friction is not negative: where its estimate is, an effect that drives the wheel is identifiable.
            return None if effect.may_drive and not problem.at_one_speed and level.max() <= 0.0 else effect.separate_by
        if problem.is_command and _is_law_of_time(problem, effect, shape):
            return NOT_COMMANDED
        if _is_law_of_speed(problem, effect, shape):
            return None
        slow = make_term(smooth, effect, shape, level).columns.T * series.sign
        beyond, least = _unspanned_energy(slow, known), LEAST_BEYOND * float(np.sum(slow**2))
        return FOLLOWS_THE_SPEED if _unspanned_energy(slow, curve) < max(SPANNED * beyond, least) else None

    reasons = list(zip(effects, problem.each(missing, effects), strict=True))
    testable = [effect for effect, reason in reasons if reason is None]
    return testable, [(effect.name, reason) for effect, reason in reasons if reason is not None]


def _unspanned_energy(rows: FloatArray, basis: FloatArray) -> float:
    """Return the energy of rows outside the span of an orthonormal basis, both float64 (p, n)."""
    return float(np.sum((rows - rows @ basis.T @ basis) ** 2))


def speed_curve(series: Series) -> FloatArray:
    """Return the hat functions of a piecewise linear curve over |ω| for each direction, float64 (p, n).

    Half of the knots are quantiles of |ω|, the others a geometric sequence: near rest, friction changes over decades of
    the speed within fewer samples than lie between two quantiles.
    """
    speed = np.abs(series.speed)
    low, high = np.quantile(speed, (SLOWEST_QUANTILE, 1.0))
    ratios = np.geomspace(low, high, KNOTS) if low > 0.0 else speed[:0]
    knots = np.unique(np.concatenate([np.quantile(speed, np.linspace(0.0, 1.0, KNOTS)), ratios]))
    hats = np.stack([np.interp(speed, knots, height) for height in np.eye(knots.size)])
    rows = np.vstack([hats * (series.sign > 0), hats * (series.sign < 0)])
    return rows[rows.any(axis=1)]


def _smoothed(channels: Channels) -> Channels:
    """Return channels whose speed and acceleration are smoothed by parabolas over a small part of the record."""
    width = max(len(channels) // SLOW_WINDOWS, 3) | 1
    known = np.isfinite(channels.speed_rad_s)
    filled = np.interp(np.arange(known.size), np.flatnonzero(known), channels.speed_rad_s[known])
    speed, rate, bend = (
        savgol_filter(filled, width, 2, deriv=order, delta=channels.sample_period_s) for order in (0, 1, 2)
    )
    return replace(channels, speed_rad_s=speed, acceleration_rad_s2=rate, acceleration_rate_rad_s3=bend)


def _is_law_of_speed(problem: Problem, effect: type[MeanEffect], shape: dict[str, float]) -> bool:
    """Return whether an effect depends on speed, direction and level alone: columns are then permuted with samples."""
    if effect.needs:
        return False
    channels = problem.records[0].channels
    channels = replace(channels, dry_level_Nm=np.ones(len(channels)))
    order, nothing = np.random.default_rng(0).permutation(len(channels)), np.zeros(len(channels))
    permuted = {name: getattr(channels, name)[order] for name in ("speed_rad_s", "direction", "good")}
    moved = replace(channels, **permuted, acceleration_rad_s2=nothing, angle_rad=nothing)
    here, there = (np.nan_to_num(effect.columns(one, shape)[0]) for one in (channels, moved))
    return bool(np.array_equal(here[order], there))


def _is_law_of_time(problem: Problem, effect: type[MeanEffect], shape: dict[str, float]) -> bool:
    """Return whether an effect depends on the time itself."""
    channels = problem.records[0].channels
    later = replace(channels, time_s=channels.time_s[::-1])
    here, there = (np.nan_to_num(effect.columns(one, shape)[0]) for one in (channels, later))
    return not np.array_equal(here, there)


# ---- formulas as candidates of the search, for what no effect of the catalogue explains, and how one is reported -----


def formulas(problem: Problem) -> list[type[MeanEffect]]:
    """Return the structures that the records can distinguish, in the order of the grammar.

    Left out are those whose channel is missing or constant, whose constants have an empty range, and those that equal
    the dry carrier: the even carrier in records of one direction, the viscous one at one speed.
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
        return all(low < high for low, high in shape_limits(problem, law).values())

    return [law for law in FORMULAS.values() if is_shown(law)]


def describe(term: Term, strengths: FloatArray) -> str:
    """Return a formula with its constants, such as "a·tanh(|ω|/ω0)·sign ω, a = 0.000123 N m, ω0 = 8.5 rad/s".

    Parameters
    ----------
    term
        The formula.
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
# Effects that are detectable only above any likely strength, and jumps that are too few. A strength is detectable where
# its gain is what the search asks for, by the same score: from the part of its column that levels, slope and effects
# found do not span, in the noise of the last model. Until an effect is named, autocorrelation of the noise absorbs a
# part of it, so that up to about twice the strength may be needed; more where a jump or two could fit as well, as at a
# single change of direction.


TOO_LARGE: Final = 0.3  # of the RMS of all friction: an effect detectable only above it has not been tested
# Of the RMS of the friction where the effect acts: an effect in few samples, as drag near zero speed that is crossed
# fast, has a small RMS however large it is there. Static friction is twice the dry in bearings, at most.
TOO_LARGE_AT_PEAK: Final = 1.0

VISIBLE: Final = 1e-12  # of a column's energy: less is rounding

FRICTION_NOT_DERIVED: Final = "motor_current_A instead of friction_torque_Nm"
NO_JUMPS: Final = "jumps of the friction: none is seen here"
NO_SYSTEMS: Final = "fss: the switching systems in the wheel file"


@dataclass(frozen=True, slots=True)
class Detectable:
    """The smallest strength at which an effect would have been found, at a shape in the middle of the testable range.

    Attributes
    ----------
    name
        Catalogue name.
    parameter, strength, unit
        The strength; NaN where none is detectable.
    share
        RMS of its torque over that of all friction [-].
    peak_share
        Its largest torque over the RMS of the friction where it acts [-].
    too_weak
        True where that is more than can be expected: the effect was not tested.
    """

    name: str
    parameter: str
    strength: float
    unit: str
    share: float
    peak_share: float
    too_weak: bool

    def in_words(self) -> str:
        """Return the strength with its unit, to two digits: it is not known to more."""
        return f"{self.strength:.2g} {self.unit}".rstrip(" -")

    def would_show(self) -> str:
        """Return in words the smallest detectable strength and its share of the friction."""
        there = f", {self.peak_share:.0%} of what there is where it acts" if self.share <= TOO_LARGE else ""
        strength = f"{self.parameter} = {self.in_words()}"
        return f"here it would show only from {strength} on, {self.share:.0%} of all friction{there}"


def detectable_strengths(problem: Problem, model: Model, effects: Sequence[type[MeanEffect]]) -> list[Detectable]:
    """Return the smallest detectable strength of each effect that the model lacks and whose channels are there."""
    beside = Background.of(problem, model.terms, model.law, model.fit.jumps)
    without = beside.equations_with()
    variance = without.memory * without.rss(without.solve()[0]) / without.samples
    friction = rms(problem.z)
    found = []
    for effect in effects:
        if effect.name in model.names or available(problem, effect) is not None:
            continue
        term = make_term(problem, effect, middle_shape(problem, effect), model.fit.level)
        column, known = term.columns[:, 0], without.moment.size
        gram = beside.equations_with(term).gram
        across = gram[:known, known]
        energy = float(gram[known, known] - across @ np.linalg.lstsq(gram[:known, :known], across, rcond=1e-12)[0])
        asked = least_gain(problem, len(model.terms)) + term.parameters * problem.log_size
        visible = energy > VISIBLE * float(gram[known, known])
        strength = float(np.sqrt(asked * variance / energy)) if visible else float("nan")
        share = strength * rms(column) / friction
        beyond = not visible or strength > max(float(term.high[0]), -float(term.low[0]))
        parameter = effect.strength_parameters()[0]
        # A column that follows the level scales with friction itself: there its bounds alone say what is likely.
        # A strength in N m is the torque that the effect reaches in a motion that excites it fully.
        peak = strength * max(float(np.max(np.abs(column))), 1.0 if parameter.unit == "N m" else 0.0)
        there = float(np.sqrt(column**2 @ problem.z**2 / max(float(column @ column), TINY)))
        peak = peak / there if there > 0 else np.inf
        large = (share > TOO_LARGE or peak > TOO_LARGE_AT_PEAK) and not depends_on_level(effect)
        found.append(Detectable(effect.name, parameter.name, strength, parameter.unit, share, peak, beyond or large))
    return found


def not_testable(problem: Problem, untested: Sequence[tuple[str, str]]) -> set[str]:
    """Return the untested effects that lack a channel or a part of the wheel file: no motion makes them observable.

    The others lack a motion, or jumps: these data do not excite them.
    """
    lacking = {effect.name for effect in CANDIDATES if available(problem, effect) is not None}
    return {name for name, missing in untested if name in lacking or missing in (FRICTION_NOT_DERIVED, NO_SYSTEMS)}


def as_clause(sentence: str) -> str:
    """Return a sentence as a part of a longer one: with a small first letter and without its full stop."""
    return sentence[:1].lower() + sentence[1:].rstrip(".")


def untested(
    problem: Problem,
    found: SearchResult,
    mean: Sequence[FoundEffect],
    wheel: Wheel,
    tried: Sequence[type[MeanEffect]],
    not_shown: Sequence[type[MeanEffect]],
) -> dict[str, str]:
    """Return what is missing for each effect that was not testable, by name; without those named, or equivalent to one.

    Parameters
    ----------
    problem, found, mean, wheel
        The data and the answer, its mean effects as they are reported.
    tried, not_shown
        Effects that are observable in the motion, and those that are not.
    """
    model = found.nested[-1]
    missing = [entry for entry in found.untestable if entry[0] in CATALOGUE]
    missing += [
        (entry.name, f"{as_clause(CATALOGUE[entry.name].separate_by)}; {entry.would_show()}")
        for entry in detectable_strengths(problem, model, tried)
        if entry.too_weak and np.isfinite(entry.strength)
    ]
    if not all(record.friction_is_derived for record in problem.records):
        missing.append(("tachometer_quantisation", FRICTION_NOT_DERIVED))
    jumps = int(model.fit.jumps.size)
    few = f"a longer record: {jumps} jumps, and a law of durations asks for {FEWEST_SOJOURNS} sojourns or more"
    if not wheel.fss:
        missing.append(("wrong_duration_law", NO_SYSTEMS))
    if jumps < FEWEST_SOJOURNS:  # of each effect, what is listed first counts
        missing += [("wrong_duration_law", few), ("speed_triggered_jumps", few)]
    named = {name for effect in mean for name in (effect.name, *effect.equivalent)}
    listed: dict[str, str] = {}
    for name, what in missing:
        if name not in named:
            listed.setdefault(name, what)
    for effect in not_shown:
        listed.setdefault(effect.name, as_clause(effect.separate_by))
    if not model.fit.jumps.size:
        listed |= {term.name: NO_JUMPS for term in JUMP_TERMS if term.name in listed}
    return listed
