"""A finished search: all that reports, pictures and the extended wheel are drawn from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.gain import HeldOut
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.result import DiscrepancyResult
from rwa_monitor.discrepancy.terms import Model, SearchResult
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Effect
from rwa_monitor.wheel.wheel import Wheel


@dataclass(frozen=True, slots=True)
class Search:
    """Everything a report draws from: the data, the models tried, the answer."""

    wheel: Wheel
    problem: Problem
    mean: SearchResult
    scores: tuple[HeldOut, ...]  # of each nested model
    result: DiscrepancyResult
    taken_out: tuple[Effect, ...] = ()  # before the search, since the channels show them

    @property
    def base(self) -> Model:
        """The base model."""
        return self.mean.nested[0]

    @property
    def extended(self) -> Model:
        """The base model with all mean effects found."""
        return self.mean.nested[-1]


# ---- the nested models --------------------------------------------------------------------------------------------


NORMAL_95: Final = 1.96  # standard deviations


@dataclass(frozen=True, slots=True)
class NestedModel:
    """One nested model, judged on held-out data.

    Attributes
    ----------
    name
        The effect that it adds, by its catalogue name.
    rmse_Nm, excess_Nm
        Root mean square residual, and what of it is beyond the noise [N m].
    log_score
        Mean log density per sample [nats].
    gain, gain_low, gain_high
        Over the model before, with its 95 % interval from the spread over blocks [nats per sample]; None for the first.
    total, total_half
        Gain over the first model and half of its 95 % interval.
    jumps
        Jumps that the model needs for the searched recordings.
    """

    name: str
    rmse_Nm: float
    excess_Nm: float
    log_score: float
    gain: float | None
    gain_low: float | None
    gain_high: float | None
    total: float
    total_half: float | None
    jumps: int


def nested_models(search: Search) -> list[NestedModel]:
    """Return the nested models with held-out gains; intervals from the spread over held-out blocks."""
    nested: list[NestedModel] = []
    noise = search.problem.noise.std
    blocks = [score.block_log_scores for score in search.scores]
    for i, (model, score) in enumerate(zip(search.mean.nested, search.scores, strict=True)):
        excess = float(np.sqrt(max(score.rmse_Nm**2 - noise**2, 0.0)))
        name = "simulation as it is"
        of_gain: tuple[float | None, float | None, float | None] = None, None, None
        of_total: tuple[float, float | None] = 0.0, None
        if i > 0:
            gain, half = _with_interval(blocks[i] - blocks[i - 1])
            name, of_gain = f"+ {model.names[-1]}", (gain, gain - half, gain + half)
            of_total = _with_interval(blocks[i] - blocks[0])
        jumps = int(model.fit.jumps.size)
        nested.append(NestedModel(name, score.rmse_Nm, excess, score.log_score, *of_gain, *of_total, jumps))
    return nested


def _with_interval(per_block: FloatArray) -> tuple[float, float]:
    """Return a mean over blocks and half of its 95 % interval."""
    return float(per_block.mean()), NORMAL_95 * float(per_block.std(ddof=1)) / float(np.sqrt(per_block.size))
