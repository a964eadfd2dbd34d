"""Noise and switching effects: scored on their own likelihoods, after the mean effects (effects.md, step 5)."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from scipy import stats

from rwa_monitor.discrepancy.base_fit import Problem
from rwa_monitor.discrepancy.result import FoundEffect, ParameterValue
from rwa_monitor.discrepancy.search import ACCEPT_GAIN, Model
from rwa_monitor.physics.effects.base import Effect
from rwa_monitor.physics.effects.catalogue import CATALOGUE
from rwa_monitor.physics.effects.likelihood import LikelihoodFit
from rwa_monitor.physics.effects.noise_base import NoiseEffect
from rwa_monitor.physics.effects.switching_base import Jumps, SwitchingEffect, SwitchingEvidence
from rwa_monitor.physics.wheel import Wheel
from rwa_monitor.samples import BoolArray, FloatArray

TESTS: Final = 10.0  # noise and switching effects in the catalogue
OUTLIER_AT: Final = 7.0  # standard deviations
FEW_OUTLIERS: Final = 12
AROUND_JUMPS: Final = 3  # slots on each side of a jump whose residual depends on where exactly it was put


def noise_effects(problem: Problem, model: Model) -> list[FoundEffect]:
    """Return the noise effects that the residual shows, strongest first."""
    fits: dict[str, list[LikelihoodFit]] = {}
    for index, record in enumerate(problem.records):
        residual, good = residual_on_slots(problem, model, index)
        for name, effect in CATALOGUE.items():
            if issubclass(effect, NoiseEffect):
                if name == "coloured_noise" and record.friction_is_derived:
                    continue  # the derivative filter colours the noise: that is in the model already
                fits.setdefault(name, []).append(effect.fit(residual, record.channels, good))
    return _accepted(fits)


def switching_effects(problem: Problem, model: Model, wheel: Wheel) -> list[FoundEffect]:
    """Return the switching effects that the jumps found show, strongest first."""
    fits: dict[str, list[LikelihoodFit]] = {}
    for index, record in enumerate(problem.records):
        residual, good = residual_on_slots(problem, model, index, keep_jumps=True)
        begin, end = int(problem.starts[index]), int(problem.starts[index + 1])
        jumps = model.fit.jumps[(model.fit.jumps > begin) & (model.fit.jumps < end)]
        size = model.fit.level[jumps] - model.fit.level[jumps - 1]
        evidence = SwitchingEvidence(
            residual,
            replace(record.channels, dry_level_Nm=problem.spread(model.fit.level)[index]),
            good,
            Jumps(problem.slot[jumps], size),
            systems={system.name: system for system in wheel.fss},
            variance_factor=problem.noise.long_run_variance / problem.noise.std**2,
        )
        for name, effect in CATALOGUE.items():
            if issubclass(effect, SwitchingEffect):
                fits.setdefault(name, []).append(effect.fit(evidence))
    return _accepted(fits)


def residual_on_slots(
    problem: Problem, model: Model, index: int, keep_jumps: bool = False
) -> tuple[FloatArray, BoolArray]:
    """Return a record's residual along the rotation on its slots [N m], NaN elsewhere, and which slots count."""
    record = problem.records[index]
    begin, end = int(problem.starts[index]), int(problem.starts[index + 1])
    slots = problem.slot[begin:end]
    residual = np.full(record.used.size, np.nan)
    measured = model.fit.residual[begin:end] + (problem.z_measured - problem.z)[begin:end]
    residual[slots] = measured * problem.sign[begin:end]
    good = record.used.copy()
    if not keep_jumps:
        # A few far outliers are sojourns too short to be segmented; many are heavy tails.
        outlier = good & (np.abs(np.nan_to_num(residual)) > OUTLIER_AT * problem.noise.std)
        if np.count_nonzero(outlier) <= FEW_OUTLIERS:
            good &= ~outlier
        for jump in model.fit.jumps[(model.fit.jumps >= begin) & (model.fit.jumps < end)]:
            at = int(problem.slot[jump])
            good[max(at - AROUND_JUMPS, 0) : at + AROUND_JUMPS] = False
    return residual, good


def _accepted(fits: dict[str, list[LikelihoodFit]]) -> list[FoundEffect]:
    found = []
    for name, of_records in fits.items():
        gain = float(sum(fit.penalised_gain for fit in of_records))
        if gain < ACCEPT_GAIN:
            continue
        effect = CATALOGUE[name]
        best = max(of_records, key=lambda fit: fit.penalised_gain)
        found.append(_describe(effect, best, gain))
    return sorted(found, key=lambda entry: -entry.delta_deviance)


def _describe(effect: type[Effect], fit: LikelihoodFit, gain: float) -> FoundEffect:
    parameters = {
        parameter.name: ParameterValue(
            float(fit.values[parameter.name]),
            float(fit.std[parameter.name]) if np.isfinite(fit.std[parameter.name]) else None,
            parameter.unit,
        )
        for parameter in effect.parameters
    }
    deviance = gain + fit.parameters * float(np.log(max(fit.samples, 1)))
    p_value = float(
        -np.expm1(TESTS * np.log1p(-min(float(stats.chi2.sf(deviance, max(fit.parameters, 1))), 1 - 1e-16)))
    )
    return FoundEffect(effect.name, effect.family, (), effect.separate_by, parameters, p_value, gain)
