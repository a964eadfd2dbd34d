"""A fit by maximum likelihood: what noise and switching effects hand to the search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rwa_monitor.wheel.effects.base import Effect


@dataclass(frozen=True, slots=True)
class LikelihoodFit:
    """An effect fitted by maximum likelihood, compared with the record's law without it.

    Attributes
    ----------
    values
        The parameters, by name.
    std
        Their standard deviations; NaN where the likelihood has no curvature or none was derived.
    log_likelihood_gain
        log L with the effect less log L without it, each at its maximum; natural logarithm, ≥ 0.
    parameters
        Free parameters beyond those of the law without the effect.
    samples
        How many values entered: residuals, or jumps.
    undetermined
        Parameters that this fit does not estimate; their values are placeholders.
    """

    values: dict[str, float]
    std: dict[str, float]
    log_likelihood_gain: float
    parameters: int
    samples: int
    undetermined: frozenset[str] = frozenset()

    @property
    def penalised_gain(self) -> float:
        """2·gain less log n for each parameter (BIC); above zero where the effect is worth its parameters."""
        return 2.0 * self.log_likelihood_gain - self.parameters * float(np.log(max(self.samples, 1)))


def no_gain(effect: type[Effect], samples: int = 0) -> LikelihoodFit:
    """Return the fit of a record that cannot show an effect: typical values, no gain."""
    return LikelihoodFit(
        values={parameter.name: parameter.typical for parameter in effect.parameters},
        std={parameter.name: float("nan") for parameter in effect.parameters},
        log_likelihood_gain=0.0,
        parameters=len(effect.parameters),
        samples=samples,
    )


def curvature_std(log_likelihood: Callable[[float], float], at: float, step: float) -> float:
    """Return the standard deviation that the curvature of a log-likelihood gives a parameter; NaN where it has none."""
    second = (log_likelihood(at + step) - 2.0 * log_likelihood(at) + log_likelihood(at - step)) / step**2
    return float(1.0 / np.sqrt(-second)) if second < 0 else float("nan")
