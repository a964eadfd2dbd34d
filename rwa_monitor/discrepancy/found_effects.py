"""An effect that was found as it is reported: parameters with errors, look-alikes, p-value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.alignment import Delay
from rwa_monitor.discrepancy.fitting import EQUIVALENT_WITHIN
from rwa_monitor.discrepancy.hypotheses import describe
from rwa_monitor.discrepancy.jump_terms import DelayTerm
from rwa_monitor.discrepancy.own_jumps import OwnJumps
from rwa_monitor.discrepancy.p_values import built_in_null_distribution
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.result import INDISTINGUISHABLE, FoundEffect, ParameterValue
from rwa_monitor.discrepancy.score import Background
from rwa_monitor.discrepancy.shape_profile import reach_between, shape_limits
from rwa_monitor.discrepancy.terms import Found, Model, law_of, make_term
from rwa_monitor.discrepancy.uncertainty import ORDER, described, spread
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Effect, Family
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, effect_class
from rwa_monitor.wheel.effects.formula import BLOCK, Formula
from rwa_monitor.wheel.effects.speed_dead_zone import SpeedDeadZone
from rwa_monitor.wheel.effects.torque_ripple import MAX_HARMONIC, TorqueRipple, angle_range_turns
from rwa_monitor.wheel.wheel import Wheel


def found_effect(problem: Problem, model: Model, found: Found) -> FoundEffect:
    """Return what is reported of a term of a model."""
    index = model.names.index(found.name)
    term = model.terms[index]
    if issubclass(term.effect, OwnJumps):
        parameters = term.effect.nearest(problem, model, index)
    else:
        std = spread(problem, model).terms[index]
        parameters = described(problem, term, model.strengths(index), std, effect_class(found.name).parameters)
    if found.name == TorqueRipple.name:
        parameters[ORDER] = with_other_orders(problem, model, index, parameters[ORDER])
    if term.effect.is_part_of_viscous and not problem.at_one_speed:
        parameters = _as_a_part_of(float(model.fit.coefficients[0]), parameters)
    effect = replace(
        as_found(problem, term.effect, parameters, found.gain, "mean"),
        equivalent=tuple(name for name in found.equivalent if name in CATALOGUE or name.startswith(f"{BLOCK} ")),
        formula=describe(term, model.strengths(index)) if issubclass(term.effect, Formula) else "",
    )
    return _with_unmeasured_cause(problem, effect, term.effect.unmeasured_cause)


def as_found(
    problem: Problem, effect: type[Effect], parameters: dict[str, ParameterValue], gain: float, searched_with: Family
) -> FoundEffect:
    """Return what is reported of an effect that gains so much among all of a family, without look-alikes."""
    derived = problem.friction_is_derived
    p_value = built_in_null_distribution().p_value(searched_with, gain, problem.log_size, derived=derived)
    return FoundEffect(effect.name, effect.family, (), effect.separate_by, parameters, p_value, gain)


def _as_a_part_of(viscous: float, parameters: dict[str, ParameterValue]) -> dict[str, ParameterValue]:
    """Mark where the part of the viscous friction that follows the temperature is more than the whole [N m s/rad].

    Over a few kelvin only the product of strength and activation temperature shows: then the whole determines the
    strength, which in the fit need not be a part of it.
    """
    (strength, value), *others = parameters.items()
    if value.std is not None and value.value <= viscous + INDISTINGUISHABLE * value.std:
        return parameters
    note = f"more than the whole viscous friction, {viscous:.4g}: not determined, only its product with B is"
    noted = [(name, replace(other, std=None, note=other.note or "not determined")) for name, other in others]
    return {strength: replace(value, std=None, note=note), **dict(noted)}


def _with_unmeasured_cause(problem: Problem, effect: FoundEffect, cause: str) -> FoundEffect:
    """Name beside an effect another that is the same at one speed, where nobody measured what that one follows.

    Viscosity that falls as the bearing warms changes drag with the speed, a bearing that runs in changes it at any: at
    one speed the two are the same curve over time.
    """
    if not cause or not problem.at_one_speed or cause in effect.equivalent:
        return effect
    other = CATALOGUE[cause]
    if any(getattr(record.channels, channel) is not None for record in problem.records for channel in other.needs):
        return effect
    return replace(effect, equivalent=(*effect.equivalent, cause), separate_by=other.separate_by)


def found_delay(problem: Problem, delay: Delay) -> FoundEffect:
    """Return a delay of whole slots as it is reported; the catalogue's is positive where the current is read early."""
    effect, period_s = CATALOGUE[DelayTerm.name], problem.records[0].channels.sample_period_s
    (parameter,) = effect.parameters
    value = ParameterValue(-delay.slots * period_s, delay.std_slots * period_s, parameter.unit)
    return as_found(problem, effect, {parameter.name: value}, delay.gain, "mean")


def found_zone(problem: Problem, wheel: Wheel) -> FoundEffect | None:
    """Return the dead zone that readings of the speed show, as it is reported; None without one that is not known."""
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
    """Return effects, each once: what the search finds of one that was taken out before is added to it."""
    of_name: dict[str, FoundEffect] = {}
    for effect in effects:
        before = of_name.get(effect.name)
        if before is not None:
            values = dict(effect.parameters)
            for strength in effect_class(effect.name).strength_parameters():
                at = values[strength.name]
                values[strength.name] = replace(at, value=before.parameters[strength.name].value + at.value)
            gain = before.delta_deviance + effect.delta_deviance
            effect = replace(effect, parameters=values, delta_deviance=gain)
        of_name[effect.name] = effect
    return list(of_name.values())


# ---- Orders that a record of few turns cannot distinguish from the order of a ripple that was found ------------------
# Over an angle of a few turns, or one that is travelled to and fro, a line has neighbours that fit nearly as well. An
# order is only a name where it has none; else all that fit are reported.


WIDTHS: Final = 4.0  # of a line, each way, that are looked at closely
PER_WIDTH: Final = 4  # orders


def with_other_orders(problem: Problem, model: Model, index: int, order: ParameterValue) -> ParameterValue:
    """Add the orders that fit about as well, where there are any: then the order is not determined.

    Parameters
    ----------
    problem, model, index
        The data, the model, and which of its terms the ripple is.
    order
        As it was fitted.
    """
    reach = reach_between(problem, TorqueRipple).get(ORDER)
    if reach is None:
        return order  # so many turns distinguish an order from its neighbours
    low, high = shape_limits(problem, TorqueRipple)[ORDER]
    # Where most of the way is within a part of a turn, peaks are as narrow as the order is known, and not as a line.
    step = reach / PER_WIDTH if order.std is None else min(reach / PER_WIDTH, 0.5 * order.std)
    near = order.value + np.arange(-WIDTHS * reach, WIDTHS * reach + 0.5 * step, step)
    tried = np.unique(np.concatenate([near, np.arange(1.0, MAX_HARMONIC + 1.0)]))
    tried = tried[(tried >= low) & (tried <= high)]
    others = tuple(term for i, term in enumerate(model.terms) if i != index)
    beside = Background.of(problem, others, law_of(model), model.fit.jumps)

    def deviance(at: float) -> float:
        term = make_term(problem, TorqueRipple, {ORDER: at}, None)
        return beside.criterion_with(term) - term.parameters * problem.log_size

    most = deviance(order.value) + EQUIVALENT_WITHIN
    fitting = tried[[deviance(float(at)) < most for at in tried]]
    far = np.abs(fitting - order.value) > reach
    far &= np.abs(2.0 * fitting - order.value) > reach  # a half is the same by its double
    if not far.any():
        return order
    turns = max(angle_range_turns(record.undrifted) for record in problem.records)
    fitting = np.union1d(fitting[far], order.value)
    note = f"not determined: {_in_words(fitting, reach)} fit about as well over {turns:.2g} turns"
    return replace(order, std=None, note=note)


def _in_words(orders: FloatArray, reach: float) -> str:
    """Return ranges of orders, those nearer than a line's width joined."""
    parts = np.split(orders, np.flatnonzero(np.diff(orders) > reach) + 1)
    return ", ".join(f"{part[0]:.3g}" if part.size == 1 else f"{part[0]:.3g} to {part[-1]:.3g}" for part in parts)
