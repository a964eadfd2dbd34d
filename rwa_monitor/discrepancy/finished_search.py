"""A finished search: all that reports, pictures and the extended wheel are drawn from."""

from __future__ import annotations

from dataclasses import dataclass

from rwa_monitor.discrepancy.gain import HeldOut
from rwa_monitor.discrepancy.models import Model, SearchResult
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.result import DiscrepancyResult
from rwa_monitor.physics.wheel import Wheel


@dataclass(frozen=True, slots=True)
class Search:
    """Everything a report draws from: the data, the models tried, the answer."""

    wheel: Wheel
    problem: Problem
    mean: SearchResult
    scores: tuple[HeldOut, ...]  # of each model of the ladder
    result: DiscrepancyResult
    delay_s: float | None = None  # of the current, where that was found and taken out before the search, as a strength

    @property
    def base(self) -> Model:
        """The base model."""
        return self.mean.ladder[0]

    @property
    def extended(self) -> Model:
        """The base model with all mean effects found."""
        return self.mean.ladder[-1]
