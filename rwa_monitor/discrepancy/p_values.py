"""p-values from a table of null distributions: the largest gain over all candidates on records without any effect.

For each family (mean effects with the jump terms, noise effects, switching effects) the table holds the largest gain
over all its candidates on simulated records without any effect, so that a p-value accounts for the whole search and not
only for the test that won. `make nulls` makes the table; `benchmarks/nulls.py` defines the records.

A gain is a deviance less log N for each parameter. With one log N added back the distribution of the largest gain
hardly depends on N; the remaining dependence is interpolated in log N. Up to the largest simulated gain p-values are
shares of the table. Beyond it the tail is exponential, its mean estimated from the excesses of the upper tenth: the
distribution of the largest of many χ² (a Gumbel tail; Knijnenburg, Wessels, Reinders, Shmulevich, Bioinformatics 25,
2009, on p-values below the reciprocal number of permutations). It is trusted for two decades: no p-value is smaller.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Final, get_args

import numpy as np

from rwa_monitor.discrepancy.fitting import Fitting, Progress
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Family
from rwa_monitor.wheel.effects.catalogue import MEAN_EFFECTS
from rwa_monitor.wheel.file_content import packaged

TABLE_FILE: Final = "nulls.json"
TAIL: Final = 0.1  # upper share of the nulls to which the exponential is fitted
MAX_EXTRAPOLATION: Final = 100.0  # times rarer than one of all simulated records: as far as the tail is trusted
CHI_SQUARE_TAIL: Final = 2.0  # mean excess far in the tail of a χ²: no distribution of gains falls faster
FAMILIES: Final = len(get_args(Family))  # that are searched one after the other: each may give a false positive


@dataclass(frozen=True, slots=True)
class Nulls:
    """Largest gains of a family on null records of one length.

    Attributes
    ----------
    log_size
        Mean log N of the records.
    statistics
        float64 (n,), ascending: largest penalised gain plus log N; a value below every real one where no candidate was
        promising enough for a full fit.
    """

    log_size: float
    statistics: FloatArray

    @property
    def floor(self) -> float:
        """Return the smallest p-value that these records can support."""
        return 1.0 / (MAX_EXTRAPOLATION * (self.statistics.size + 1))

    @property
    def scale(self) -> float:
        """Return the mean of the exponential fitted to the upper tenth of the nulls, from their median excess."""
        inside = int(self.statistics.size * TAIL)
        excess = self.statistics[-inside:] - self.statistics[-inside - 1]
        return max(float(np.median(excess)) / float(np.log(2)), CHI_SQUARE_TAIL)

    def p_value(self, statistic: float) -> float:
        """Return the share of nulls that reach a statistic, the observed one included; extrapolated beyond all."""
        n = self.statistics.size
        reached = n - int(np.searchsorted(self.statistics, statistic, side="left"))
        if reached:
            return (1 + reached) / (n + 1)
        beyond = statistic - float(self.statistics[-1])
        return max(2 / (n + 1) * float(np.exp(-beyond / self.scale)), self.floor)


@dataclass(frozen=True, slots=True)
class NullTable:
    """Nulls by family and by whether friction was derived, at increasing lengths.

    Derived friction has noise of its own and model errors of its own, where the acceleration changes faster than the
    derivative's filter follows.
    """

    families: Mapping[tuple[Family, bool], tuple[Nulls, ...]]

    def p_value(self, family: Family, gain: float, log_size: float, *, derived: bool) -> float:
        """Return the probability of as large a gain, over all candidates of all families, on a record without effects.

        Parameters
        ----------
        family
            Of the effect found.
        gain
            Deviance less log N for each parameter.
        log_size
            log N of the record; beyond the lengths of the table its nearest length counts.
        derived
            Whether friction was derived from current and speed.
        """
        of_family = self.families[family, derived]
        sizes = [nulls.log_size for nulls in of_family]
        logs = [np.log(nulls.p_value(gain + log_size)) for nulls in of_family]
        return _of_any_family(float(np.exp(np.interp(log_size, sizes, logs))))

    def floor(self, family: Family, *, derived: bool) -> float:
        """Return the smallest p-value that the table gives: such a p-value is an upper limit."""
        return _of_any_family(max(nulls.floor for nulls in self.families[family, derived]))


def _of_any_family(p_value: float) -> float:
    """Return the probability that any of the families gives as small a p-value."""
    return float(-np.expm1(FAMILIES * np.log1p(-min(p_value, 1 - 1e-16))))


@cache
def built_in_null_distribution() -> NullTable:
    """Return the table that ships with the package.

    Raises
    ------
    InputError
        If the file is missing from the installed package.
    """
    text = packaged("rwa_monitor.discrepancy", TABLE_FILE)
    families: dict[tuple[Family, bool], tuple[Nulls, ...]] = {}
    for row in sorted(json.loads(text)["nulls"], key=lambda row: float(row["log_size"])):
        nulls = Nulls(float(row["log_size"]), np.sort(np.asarray(row["statistics"], dtype=np.float64)))
        key = row["family"], bool(row["derived"])
        families[key] = (*families.get(key, ()), nulls)
    return NullTable(families)


# ---- p-values by simulation ------------------------------------------------------------------------------------------
# For each effect found, records are simulated from the model without it: fitted levels, slope and other effects, plus
# the residual resampled in blocks, which keeps its autocorrelation and its tails. The best candidate's gain on each is
# a draw from the null distribution. Costs B searches for each effect.


BLOCK_SLOTS: Final = 200  # longer than any correlation that the noise model allows
SEED: Final = 20260126  # fixed: the same record gives the same p-values


def with_bootstrap(search: Search, draws: int, progress: Progress) -> Search:
    """Return the search with the p-values of its mean effects from `draws` simulated records each.

    p = (1 + draws that gain as much) / (1 + draws): never zero.
    """
    rng = np.random.default_rng(SEED)
    found = {entry.name: entry.gain for entry in search.mean.found}
    effects = list(search.result.effects)
    for i, effect in enumerate(effects):
        if effect.name in found:
            gains = _null_gains(search, effect.name, draws, rng, progress)
            reached = int(np.count_nonzero(gains >= found[effect.name]))
            effects[i] = replace(effect, p_value=(1 + reached) / (1 + draws))
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
        alternatives = fitting.extensions(start, candidates)
        if alternatives:
            gains[i] = start.score - alternatives[0].score
    return gains


def _resampled(residual: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the residual reassembled from random blocks of itself (block bootstrap)."""
    length = min(BLOCK_SLOTS, residual.size)
    starts = rng.integers(0, residual.size - length + 1, size=residual.size // length + 1)
    return np.concatenate([residual[s : s + length] for s in starts])[: residual.size]
