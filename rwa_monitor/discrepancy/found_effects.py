"""Reported form of an effect that was found: parameters with errors, indistinguishable effects, p-value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.alignment import Delay
from rwa_monitor.discrepancy.base_fit import with_noise_of
from rwa_monitor.discrepancy.fitting import EQUIVALENT_WITHIN
from rwa_monitor.discrepancy.hypotheses import describe
from rwa_monitor.discrepancy.jump_terms import DelayTerm
from rwa_monitor.discrepancy.own_jumps import OwnJumps
from rwa_monitor.discrepancy.p_values import built_in_null_distribution
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.result import INDISTINGUISHABLE, FoundEffect, ParameterValue
from rwa_monitor.discrepancy.score import Background, standard_deviations
from rwa_monitor.discrepancy.shape_profile import FEW_CHOICES, is_logarithmic, reach_between, shape_limits
from rwa_monitor.discrepancy.terms import Found, Model, Term, make_term
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Effect, Family
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, MEAN_EFFECTS, effect_class
from rwa_monitor.wheel.effects.formula import BLOCK, Formula
from rwa_monitor.wheel.effects.tachometer import SpeedDeadZone
from rwa_monitor.wheel.effects.torque_ripple import MAX_HARMONIC, TorqueRipple, angle_range_turns
from rwa_monitor.wheel.wheel import Wheel


def found_effect(problem: Problem, model: Model, found: Found) -> FoundEffect:
    """Return the reported form of one term of a model."""
    index = model.names.index(found.name)
    term = model.terms[index]
    if issubclass(term.effect, OwnJumps):
        parameters = term.effect.nearest(problem, model, index)
    else:
        parameters = described(problem, model, index)
    if found.name == TorqueRipple.name:
        parameters[ORDER] = with_other_orders(problem, model, index, parameters[ORDER])
    if term.effect.is_part_of_viscous and not problem.at_one_speed:
        parameters = _checked_against_viscous(float(model.fit.coefficients[0]), parameters)
    effect = replace(
        as_found(problem, term.effect, parameters, found.gain, "mean"),
        equivalent=tuple(name for name in found.equivalent if name in CATALOGUE or name.startswith(f"{BLOCK} ")),
        formula=describe(term, model.strengths(index)) if issubclass(term.effect, Formula) else "",
    )
    return _with_unmeasured_equivalent(problem, effect, term.effect.unmeasured_cause)


def as_found(
    problem: Problem, effect: type[Effect], parameters: dict[str, ParameterValue], gain: float, searched_with: Family
) -> FoundEffect:
    """Return the reported form of an effect, its p-value that of its gain among a family, with no equivalents."""
    derived = problem.friction_is_derived
    p_value = built_in_null_distribution().p_value(searched_with, gain, problem.log_size, derived=derived)
    return FoundEffect(effect.name, effect.family, (), effect.separate_by, parameters, p_value, gain)


def _checked_against_viscous(viscous: float, parameters: dict[str, ParameterValue]) -> dict[str, ParameterValue]:
    """Mark a temperature-dependent part of the viscous friction as not determined where it exceeds the whole.

    Also where the part has no error. Over a few kelvin only the product of strength and activation temperature is
    identifiable: the fitted strength may then exceed the whole coefficient [N m s/rad].
    """
    (strength, value), *others = parameters.items()
    if value.std is not None and value.value <= viscous + INDISTINGUISHABLE * value.std:
        return parameters
    note = f"more than the whole viscous friction, {viscous:.4g}: not determined, only its product with B is"
    noted = [(name, replace(other, std=None, note=other.note or "not determined")) for name, other in others]
    return {strength: replace(value, std=None, note=note), **dict(noted)}


def _with_unmeasured_equivalent(problem: Problem, effect: FoundEffect, cause: str) -> FoundEffect:
    """Add `cause` to an effect's equivalents where no channel that `cause` needs exists.

    Viscosity that falls as the bearing warms changes drag in proportion to speed, running-in changes it at any speed:
    at one speed the two are the same curve over time, and only there is the cause added.
    """
    other = MEAN_EFFECTS.get(cause)
    if other is None or (other.shows_at_one_speed and not problem.at_one_speed) or cause in effect.equivalent:
        return effect
    if any(getattr(record.channels, channel) is not None for record in problem.records for channel in other.needs):
        return effect
    separate_by = f"{effect.separate_by} {other.separate_by}"
    return replace(effect, equivalent=(*effect.equivalent, cause), separate_by=separate_by)


def found_delay(problem: Problem, delay: Delay) -> FoundEffect:
    """Return the reported form of a delay; the catalogue's delay is positive where the current is read early."""
    effect, period_s = CATALOGUE[DelayTerm.name], problem.records[0].channels.sample_period_s
    (parameter,) = effect.parameters
    value = ParameterValue(-delay.late_slots * period_s, delay.std_slots * period_s, parameter.unit)
    return as_found(problem, effect, {parameter.name: value}, delay.gain, "mean")


def found_zone(problem: Problem, wheel: Wheel) -> FoundEffect | None:
    """Return the reported form of the dead zone seen in speed readings; None without one or if the file has it."""
    zones = [record.zone for record in problem.records if record.zone is not None]
    if not zones or any(block.name == SpeedDeadZone.name for block in wheel.effect):
        return None
    width, std, *_ = min(zones, key=lambda zone: zone.std_rad_s)
    strength, edge = SpeedDeadZone.parameters
    parameters = {
        strength.name: ParameterValue(0.0, None, strength.unit, "no friction is used where the speed reading rests"),
        edge.name: ParameterValue(width, std, edge.unit),
    }
    return as_found(problem, SpeedDeadZone, parameters, sum(zone.deviance for zone in zones), "mean")


def joined(effects: Sequence[FoundEffect]) -> list[FoundEffect]:
    """Return each effect once: strengths and gain found by the search are added to those taken out before it."""
    of_name: dict[str, FoundEffect] = {}
    for effect in effects:
        before = of_name.get(effect.name)
        if before is not None:
            values = dict(effect.parameters)
            for strength in effect_class(effect.name).strength_parameters():
                at, taken_out = values[strength.name], before.parameters[strength.name]
                std = at.std if at.std is None or taken_out.std is None else float(np.hypot(at.std, taken_out.std))
                values[strength.name] = replace(at, value=taken_out.value + at.value, std=std)
            gain = before.delta_deviance + effect.delta_deviance
            effect = replace(effect, parameters=values, delta_deviance=gain)
        of_name[effect.name] = effect
    return list(of_name.values())


# ---- Orders that a record of few turns cannot distinguish from the order of a torque ripple that was found -----------
# Over an angle of a few turns, or one that is travelled to and fro, neighbours of a spectral line fit nearly as well. A
# single order is reported only where none does; otherwise all orders that fit are listed.


WIDTHS: Final = 4  # of a spectral line, on each side, that are searched, with as many orders tried in each


def with_other_orders(problem: Problem, model: Model, index: int, order: ParameterValue) -> ParameterValue:
    """Note the other orders that fit about as well, where there are any: the order is then not determined.

    Parameters
    ----------
    problem, model, index
        The data, the model, and which of its terms the ripple is.
    order
        The fitted order.
    """
    reach = reach_between(problem, TorqueRipple).get(ORDER)
    if reach is None:
        return order  # enough turns to distinguish an order from its neighbours
    low, high = shape_limits(problem, TorqueRipple)[ORDER]
    # Where most of the motion stays within a part of a turn, peaks are as narrow as the order's error, not a line.
    step = reach / WIDTHS if order.std is None else min(reach / WIDTHS, 0.5 * order.std)
    near = order.value + np.arange(-WIDTHS * reach, WIDTHS * reach + 0.5 * step, step)
    tried = np.unique(np.concatenate([near, np.arange(1.0, MAX_HARMONIC + 1.0)]))
    tried = tried[(tried >= low) & (tried <= high)]
    background = _without(problem, model, index)

    def deviance(at: float) -> float:
        term = make_term(problem, TorqueRipple, {ORDER: at}, None)
        return background.criterion_with(term) - term.parameters * problem.log_size

    highest = deviance(order.value) + EQUIVALENT_WITHIN
    fitting = tried[[deviance(float(at)) < highest for at in tried]]
    far = np.abs(fitting - order.value) > reach
    far &= np.abs(2.0 * fitting - order.value) > reach  # half the order has the order as its second harmonic
    if not far.any():
        return order
    turns = max(angle_range_turns(record.undrifted) for record in problem.records)
    fitting = np.union1d(fitting[far], order.value)
    note = f"not determined: {_in_words(fitting, reach)} fit about as well over {turns:.2g} turns"
    return replace(order, std=None, note=note)


def _in_words(orders: FloatArray, reach: float) -> str:
    """Return ranges of orders in words; orders closer than a line's width are joined."""
    parts = np.split(orders, np.flatnonzero(np.diff(orders) > reach) + 1)
    return ", ".join(f"{part[0]:.3g}" if part.size == 1 else f"{part[0]:.3g} to {part[-1]:.3g}" for part in parts)


# ---- how well the parameters of a fitted model are known -------------------------------------------------------------
# A strength at a given shape is known far better than one whose shape is fitted too: the two are correlated. So the
# derivatives of the model by its shape parameters enter the design together with the columns (Gauss–Newton; Seber &
# Wild, Nonlinear Regression, 1989, chapter 5), with levels eliminated and the autocorrelation of the noise as fitted. A
# model that lacks an effect leaves a residual that does not follow this noise law: errors are then estimated from the
# residual itself (Newey & West, Econometrica 55, 1987). A parameter whose interval of two standard deviations reaches
# the end of the range that the record can identify is not determined.


ORDER: Final = "harmonic"
STEP: Final = 1e-3  # of a shape parameter's range, for the derivative
# Rise of -2 log likelihood at the ends of a 95 % interval of a step: 0.95 = (1 - exp(-x/2))² (Y.-C. Yao, Annals of
# Statistics 15, 1987; D. Siegmund, International Statistical Review 56, 1988).
STEP_RISE: Final = 7.35


def spread(problem: Problem, model: Model) -> tuple[float, list[dict[str, float]]]:
    """Return the standard deviations of the slope and of all strengths and shapes, each with all others free.

    Except shapes at a value that physics expects: those are fixed in the standard deviations of all others.

    Returns
    -------
    viscous, terms
        Of the viscous coefficient [N m s/rad], its bound disregarded; for each term, of its parameters by name, without
        those that are discrete.
    """
    problem = with_noise_of(problem, model.fit.residual)  # the base model's residual still contains the effects
    # The slope counts as free even at its bound: a shape that only this bound determines counts as not determined.
    columns: list[FloatArray] = [problem.speed]
    owners: list[tuple[int, str]] = [(-1, "")]
    at_expected: dict[tuple[int, str], FloatArray] = {}
    for index, term in enumerate(model.terms):
        for j, parameter in enumerate(term.effect.strength_parameters()):
            columns.append(term.columns[:, j])
            owners.append((index, parameter.name))
        for name, limits in _limits(problem, term).items():
            slope = _derivative(problem, model, index, name, limits)
            if name in _at_expected_value(term):
                at_expected[index, name] = slope
            else:
                columns.append(slope)
                owners.append((index, name))
    std = standard_deviations(problem, model, np.column_stack(columns))
    known = dict(zip(owners, std.tolist(), strict=True))
    for index, term in enumerate(model.terms):
        if term.effect.threshold:
            known[index, term.effect.threshold] = _threshold_std(problem, model, index)
    for owner, slope in at_expected.items():
        known[owner] = float(standard_deviations(problem, model, np.column_stack([*columns, slope]))[-1])
    of_terms = [{name: one for (of, name), one in known.items() if of == index} for index in range(len(model.terms))]
    return known[-1, ""], of_terms


def _threshold_std(problem: Problem, model: Model, index: int) -> float:
    """Return the standard deviation of a speed threshold [rad/s]: its likelihood is a step at each sample's speed.

    The root sum of squares of a quarter of the range of speeds over which -2 log likelihood rises by less than
    `STEP_RISE`, and of the speed's noise, by which each sample may lie on the other side.
    """
    term = model.terms[index]
    name = term.effect.threshold
    low, high = shape_limits(problem, term.effect)[name]
    background = _without(problem, model, index)

    def criterion(at: float) -> float:
        return background.criterion_with(make_term(problem, term.effect, {**term.shape, name: at}, None))

    speeds = np.unique(problem.speed)
    above = int(np.searchsorted(speeds, term.shape[name]))  # the first speed not below the threshold
    highest = criterion(float(term.shape[name])) + STEP_RISE
    first, last = above, above
    while first > 1 and speeds[first - 1] > low and criterion(float(speeds[first - 1])) < highest:
        first -= 1
    while last + 1 < speeds.size and speeds[last] < high and criterion(float(speeds[last + 1])) < highest:
        last += 1
    lower = float(speeds[first - 1]) if first > 0 else 0.0
    upper = float(speeds[min(last, speeds.size - 1)])
    noise = max(record.speed_noise_rad_s for record in problem.records)
    return float(np.hypot((upper - lower) / (2.0 * INDISTINGUISHABLE), noise))


def _without(problem: Problem, model: Model, index: int) -> Background:
    """Return a model without one of its terms, its jumps and noise kept."""
    others = (*model.terms[:index], *model.terms[index + 1 :])
    return Background.of(problem, others, model.law, model.fit.jumps)


def described(problem: Problem, model: Model, index: int) -> dict[str, ParameterValue]:
    """Return the parameters of a fitted term by name, in the effect's order, those not determined marked as such."""
    term, strengths, std = model.terms[index], model.strengths(index), spread(problem, model)[1][index]
    limits = shape_limits(problem, term.effect)
    names = [parameter.name for parameter in term.effect.strength_parameters()]
    fitted = dict(zip(names, zip(strengths.tolist(), term.low.tolist(), term.high.tolist(), strict=True), strict=True))
    values = {}
    for parameter in effect_class(term.effect.name).parameters:
        name, error = parameter.name, std.get(parameter.name, float("nan"))
        if parameter.default is not None and parameter.choices == (term.shape.get(name),):
            continue  # fixed at its only choice, not fitted
        if parameter.linear:
            value, low, high = fitted[name]
            if low < value < high:  # tighter bounds of the fit count only where they are active
                low, high = parameter.low, parameter.high
            values[name] = ParameterValue.of(value, error, parameter.unit, low, high)
        elif parameter.choices and not np.isfinite(error):
            tried = f"one of {len(parameter.choices)} values tried"
            values[name] = ParameterValue(float(term.shape[name]), None, parameter.unit, tried)
        else:
            values[name] = _shape_value(float(term.shape[name]), error, parameter.unit, limits[name])
    return values


def _shape_value(value: float, std: float, unit: str, limits: tuple[float, float]) -> ParameterValue:
    low, high = limits
    if not low < high:
        return ParameterValue(value, None, unit, "not determined by these data")
    known = ParameterValue.of(value, np.nan, unit, low, high)
    if not np.isfinite(std):
        return known if known.note else replace(known, note="not determined by these data")
    if is_logarithmic(low, high):
        factor = np.exp(min(INDISTINGUISHABLE * std / value, 50.0))
        interval = value / factor, value * factor
    else:
        interval = value - INDISTINGUISHABLE * std, value + INDISTINGUISHABLE * std
    if interval[0] > low and interval[1] < high:
        return ParameterValue(value, std, unit)
    as_well = f"{max(interval[0], low):.3g} to {min(interval[1], high):.3g} fit about as well"
    return replace(known, note=f"{known.note or 'not determined'}: {as_well}".replace("determined: ", "determined, "))


def _limits(problem: Problem, term: Term) -> dict[str, tuple[float, float]]:
    """Return the range in which the records can identify each shape parameter; of an order, that of its peak.

    Without those that have no range, as where only choices are tried.
    """
    limits = shape_limits(problem, term.effect)
    continuous = {p.name for p in term.effect.shape_parameters() if p.between or not p.choices}
    identifiable = {name: (low, high) for name, (low, high) in limits.items() if name in continuous and low < high}
    if issubclass(term.effect, TorqueRipple):
        half = 0.5 / max(angle_range_turns(record.undrifted) for record in problem.records)
        identifiable[ORDER] = term.shape[ORDER] - half, term.shape[ORDER] + half
    return identifiable


def _at_expected_value(term: Term) -> frozenset[str]:
    """Return the shape parameters that are at a value which physics expects, not at one of a few: none is certain."""
    parameters = CATALOGUE[term.effect.name].parameters if term.effect.name in CATALOGUE else term.effect.parameters
    certain = (p for p in parameters if len(p.choices) == 1 or len(p.choices) > FEW_CHOICES)
    return frozenset(p.name for p in certain if term.shape[p.name] in p.choices)


def _derivative(problem: Problem, model: Model, index: int, name: str, limits: tuple[float, float]) -> FloatArray:
    """Return the derivative of a term's s·torque by a shape parameter, of which a range is given."""
    term, (low, high) = model.terms[index], limits
    value = float(term.shape[name])
    step = STEP * (value if is_logarithmic(low, high) else high - low)
    ends = max(value - step, low), min(value + step, high)
    before, after = (
        make_term(problem, term.effect, {**term.shape, name: end}, model.fit.level).columns @ model.strengths(index)
        for end in ends
    )
    return np.asarray((after - before) / (ends[1] - ends[0]))
