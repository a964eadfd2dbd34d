"""What a record could not test: effects that would show only beyond any likely strength, and jumps that are too few.

A strength is detectable where it gains as much as the search asks for, by the score of the search: its column, less
what levels, slope and the effects found hold of it, over the noise that the last model leaves. Part of an effect passes
for colour of the noise until it is named, and up to about twice the strength may be needed; more where a jump or two
could do the same, as at a single change of direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.jump_terms import JUMP_TERMS
from rwa_monitor.discrepancy.likelihood import asked_gain
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.result import FoundEffect
from rwa_monitor.discrepancy.score import Background
from rwa_monitor.discrepancy.shape_profile import middle_shape
from rwa_monitor.discrepancy.terms import Model, SearchResult, available, depends_on_level, law_of, make_term
from rwa_monitor.wheel.effects.base import MeanEffect
from rwa_monitor.wheel.effects.catalogue import CATALOGUE
from rwa_monitor.wheel.effects.jump_times import FEWEST_SOJOURNS
from rwa_monitor.wheel.wheel import Wheel

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
        there = float(np.sqrt(column**2 @ problem.z**2 / max(float(column @ column), np.finfo(np.float64).tiny)))
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
