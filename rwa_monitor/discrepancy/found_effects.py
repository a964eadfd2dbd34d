"""An effect that was found as it is reported: parameters with errors, look-alikes, p-value."""

from __future__ import annotations

from dataclasses import replace

from rwa_monitor.discrepancy.alignment import Delay
from rwa_monitor.discrepancy.formulas import describe
from rwa_monitor.discrepancy.jump_terms import DelayTerm
from rwa_monitor.discrepancy.models import Found, Model
from rwa_monitor.discrepancy.other_orders import with_other_orders
from rwa_monitor.discrepancy.p_values import built_in_nulls
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.result import INDISTINGUISHABLE, FoundEffect, ParameterValue
from rwa_monitor.discrepancy.slope_jumps import SlopeJumps, shared_strength
from rwa_monitor.discrepancy.uncertainty import ORDER, described, spread
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, effect_class
from rwa_monitor.wheel.effects.formula import BLOCK, Formula
from rwa_monitor.wheel.effects.torque_ripple import TorqueRipple


def found_effect(problem: Problem, model: Model, found: Found) -> FoundEffect:
    """Return what is reported of a term of a model."""
    index = model.names.index(found.name)
    term = model.terms[index]
    if issubclass(term.effect, SlopeJumps):
        parameters = dict([shared_strength(problem, model, index)])
    else:
        std = spread(problem, model).terms[index]
        parameters = described(problem, term, model.strengths(index), std, effect_class(found.name).parameters)
    if found.name == TorqueRipple.name:
        parameters[ORDER] = with_other_orders(problem, model, index, parameters[ORDER])
    if term.effect.is_part_of_viscous and not problem.at_one_speed:
        parameters = _as_a_part_of(float(model.fit.coefficients[0]), parameters)
    described_effect = FoundEffect(
        found.name,
        term.effect.family,
        tuple(name for name in found.equivalent if name in CATALOGUE or name.startswith(f"{BLOCK} ")),
        term.effect.separate_by,
        parameters,
        built_in_nulls().p_value("mean", found.gain, problem.log_size, derived=problem.friction_is_derived),
        found.gain,
        describe(term, model.strengths(index)) if issubclass(term.effect, Formula) else "",
    )
    return _with_unmeasured_cause(problem, described_effect, term.effect.unmeasured_cause)


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
    return FoundEffect(
        effect.name,
        effect.family,
        (),
        effect.separate_by,
        {parameter.name: value},
        built_in_nulls().p_value("mean", delay.gain, problem.log_size, derived=problem.friction_is_derived),
        delay.gain,
    )
