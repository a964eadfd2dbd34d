"""Viscous drag that follows the heat of the motion, where nobody measured the bearing's temperature.

Friction heats the bearing, and the lubricant thins: the slope of the drag over the speed then follows the power of the
friction through a thermal lag of some ten minutes. Without a temperature that is no effect of the catalogue, and its
slopes, which are others in each stretch of time, pass for jumps of the viscous friction. Here it is a candidate of the
search like any other, so that those names must do better than it does; where it wins it is told as unexplained, with
the channel that would tell.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import remove_levels, segment_starts
from rwa_monitor.discrepancy.channelling import DecayAfterReversal, may_channel
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.heat_term import FASTEST_S, LONGEST_SHARE, HeatOfMotion
from rwa_monitor.discrepancy.models import Found, Model, SearchResult
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.result import Unexplained
from rwa_monitor.discrepancy.terms import Term
from rwa_monitor.physics.effects.base import MeanEffect
from rwa_monitor.physics.effects.resolution import duration
from rwa_monitor.physics.effects.viscosity_temperature import ViscosityTemperature

BESIDE_SHARE: Final = 0.1  # of the gain of the heat that a name beside it must reach: no law of heat is exact


def outside_the_catalogue(problem: Problem) -> list[type[MeanEffect]]:
    """Return what no effect of the catalogue is and these records may show."""
    heat: list[type[MeanEffect]] = [HeatOfMotion] if may_be_warm(problem) else []
    return [*heat, DecayAfterReversal] if may_channel(problem) else heat


def may_be_warm(problem: Problem) -> bool:
    """Say whether heat of the motion may hide: no temperature, speeds that differ, and time to warm up."""
    channels = [record.channels for record in problem.records]
    unknown = all(one.bearing_temperature_degC is None for one in channels)
    return unknown and not problem.at_one_speed and LONGEST_SHARE * max(map(duration, channels)) > FASTEST_S


def told_as_unexplained(
    problem: Problem, found: SearchResult, left: Unexplained | None
) -> tuple[SearchResult, Unexplained | None]:
    """Take what is outside the catalogue out of what was named, and tell it as what no effect of that explains.

    Where the heat of the motion could stand for a named effect, the catalogue's `viscosity_temperature` is said to:
    without a temperature only as a possibility.
    """
    found = replace(found, found=tuple(_with_possible_cause(entry) for entry in found.found))
    for name, in_words in OUTSIDE.items():
        if name in found.ladder[-1].names:
            found, left = _told(problem, found, left, name, in_words)
    return found, left


def _told(
    problem: Problem, found: SearchResult, left: Unexplained | None, name: str, in_words: Callable[[Term], str]
) -> tuple[SearchResult, Unexplained | None]:
    model = found.ladder[-1]
    index = model.names.index(name)
    (entry,) = [entry for entry in found.found if entry.name == name]
    named = tuple(one for one in found.found if one is not entry and one.gain >= BESIDE_SHARE * entry.gain)
    terms = tuple(term for term in model.terms if term.effect.name in {one.name for one in named})
    reduced = Fitting(problem, jumps=True).refitted(terms, model) if terms else found.ladder[0]
    names = set(reduced.names)
    shorter = (m for m in found.ladder if set(m.names) <= names and len(m.terms) < len(terms))
    others = [name for name in entry.equivalent if name != ViscosityTemperature.name]
    told = Unexplained(
        in_words(model.terms[index])
        + "".join(f", or {name} as well as these data can tell" for name in others)
        + (f"; and {left.signature}" if left is not None else ""),
        float(np.hypot(_size(problem, model, index), left.size_Nm if left is not None else 0.0)),
    )
    return replace(found, ladder=(*shorter, reduced) if terms else (reduced,), found=named), told


def _heat_in_words(term: Term) -> str:
    return (
        f"{HeatOfMotion.signature} with a lag of about {term.shape['time_constant_s']:.2g} s, as"
        f" {ViscosityTemperature.name} would: record the bearing's temperature"
    )


def _decay_in_words(term: Term) -> str:
    turns = term.shape["angle_rad"] / (2.0 * np.pi)
    return f"{DecayAfterReversal.signature}, over about {turns:.2g} turns, as of grease that channels"


# What competes with the catalogue and is told as unexplained, by name.
OUTSIDE: Final[Mapping[str, Callable[[Term], str]]] = {
    HeatOfMotion.name: _heat_in_words,
    DecayAfterReversal.name: _decay_in_words,
}


def _with_possible_cause(entry: Found) -> Found:
    equivalent = (ViscosityTemperature.name if name == HeatOfMotion.name else name for name in entry.equivalent)
    return replace(entry, equivalent=tuple(dict.fromkeys(equivalent)))


def _size(problem: Problem, model: Model, index: int) -> float:
    """Return the RMS of a term's torque beyond levels and slope [N m]."""
    first = segment_starts(problem, model.fit.jumps)
    torque = remove_levels(model.terms[index].columns @ model.strengths(index), first)
    along = remove_levels(problem.speed, first)
    torque = torque - along * float(along @ torque) / max(float(along @ along), np.finfo(np.float64).tiny)
    return float(np.sqrt(np.mean(torque**2)))
