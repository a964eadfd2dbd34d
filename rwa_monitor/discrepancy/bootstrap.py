"""p-values by simulation: what the best of all effects gains on records made without the one in question.

For each effect found, records are made from the model without it: fitted levels, slope and other effects, plus the
residual resampled in blocks, which keeps its colour and its tails. The best candidate's gain on each is a draw from the
law of chance. Costs B searches for each effect.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.finished_search import Search
from rwa_monitor.discrepancy.fitting import Fitting, Progress
from rwa_monitor.physics.effects.catalogue import MEAN_EFFECTS
from rwa_monitor.samples import FloatArray

BLOCK_SLOTS: Final = 200  # longer than any correlation that the noise model allows
SEED: Final = 20260126  # fixed: the same record gives the same p-values


def with_bootstrap(search: Search, draws: int, progress: Progress) -> Search:
    """Return the search with the p-values of its mean effects from `draws` simulated records each.

    p = (1 + records that gain as much) / (1 + records): never zero, and honest about B.
    """
    rng = np.random.default_rng(SEED)
    found = {entry.name: entry.gain for entry in search.mean.found}
    effects = []
    for effect in search.result.effects:
        if effect.name not in found:
            effects.append(effect)
            continue
        gains = _null_gains(search, effect.name, draws, rng, progress)
        p_value = (1 + int(np.count_nonzero(gains >= found[effect.name]))) / (1 + draws)
        effects.append(replace(effect, p_value=p_value))
    return replace(search, result=replace(search.result, effects=tuple(effects)))


def _null_gains(search: Search, name: str, draws: int, rng: np.random.Generator, progress: Progress) -> FloatArray:
    """Return the best gain of any candidate on each of `draws` records without the effect `name`."""
    problem, model = search.problem, search.extended
    others = tuple(term for term in model.terms if term.effect.name != name)
    jumps = bool(model.fit.jumps.size)
    null = Fitting(problem, jumps=jumps).refitted(others, model, [model.fit.jumps])
    candidates = [effect for effect in MEAN_EFFECTS.values() if effect.name not in dict(search.mean.untestable)]
    fitted = problem.z - null.fit.residual
    gains = np.zeros(draws)
    for i in range(draws):
        progress(f"bootstrap of {name}: {i + 1} of {draws}")
        simulated = replace(problem.with_empty_caches(), z=fitted + _resampled(model.fit.residual, rng))
        fitting = Fitting(simulated, jumps=jumps)
        start = fitting.refitted(others, null, [null.fit.jumps])
        rivals = fitting.extensions(start, candidates)
        if rivals:
            gains[i] = start.score - rivals[0].score
    return gains


def _resampled(residual: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the residual put together anew from random blocks of itself."""
    length = min(BLOCK_SLOTS, residual.size)
    starts = rng.integers(0, residual.size - length + 1, size=residual.size // length + 1)
    return np.concatenate([residual[s : s + length] for s in starts])[: residual.size]
