"""Formulas as candidates of the search, for what no effect of the catalogue explains, and how one is reported."""

from __future__ import annotations

import numpy as np

from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.shape_profile import shape_limits
from rwa_monitor.discrepancy.terms import Term, available
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import MeanEffect
from rwa_monitor.wheel.effects.formula import FORMULAS, Formula
from rwa_monitor.wheel.effects.sublinear_viscous import LEAST_K


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
