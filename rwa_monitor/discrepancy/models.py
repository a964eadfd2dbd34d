"""What a search hands on: models with their fits, how they grew, and what was found; plain values.

How they are made is in `search`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from rwa_monitor.discrepancy.base_fit import Fit
from rwa_monitor.discrepancy.likelihood import NoiseLaw
from rwa_monitor.discrepancy.terms import Term
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import MeanEffect

INEXACT: Final = 0.1  # of the torque of a law: what a real machine may differ from it by, a working assumption


@dataclass(frozen=True, slots=True)
class Model:
    """A set of effects and its fit.

    Attributes
    ----------
    terms
        The effects.
    fit
        Jumps, coefficients, and what is left; its criterion only screens, see `base_fit`.
    law
        The noise's law that was fitted with it; None before it is scored.
    score
        See `score`; lower is better. Infinite before it is scored.
    """

    terms: tuple[Term, ...]
    fit: Fit
    law: NoiseLaw | None = None
    score: float = float("inf")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(term.effect.name for term in self.terms)

    def strengths(self, index: int) -> FloatArray:
        """Return the fitted strengths of term `index`."""
        begin = 1 + sum(term.columns.shape[1] for term in self.terms[:index])
        return self.fit.coefficients[begin : begin + self.terms[index].columns.shape[1]]

    def is_minor(self, index: int, sign: FloatArray) -> bool:
        """Return whether a term's torque is, where it acts, within what the largest of the others is not exact by.

        Parameters
        ----------
        index
            Which of the terms.
        sign
            float64 (n,), direction of rotation. A torque that is constant has no form that could be inexact.
        """
        torques = [sign * (term.columns @ self.strengths(i)) for i, term in enumerate(self.terms)]
        own = torques.pop(index) ** 2
        largest = max((float(own @ (other - other.mean()) ** 2) for other in torques), default=0.0)
        return float(own @ own) < INEXACT**2 * largest


def law_of(model: Model) -> NoiseLaw:
    """Return the noise's law of a model that is scored."""
    assert model.law is not None, "the model is scored"
    return model.law


@dataclass(frozen=True, slots=True)
class Found:
    """One effect that the search accepted.

    Attributes
    ----------
    name
        Catalogue name.
    gain
        By how much the criterion gets worse when the effect is left out and all else refitted.
    equivalent
        Other names that are as good in its place (difference below `search.EQUIVALENT_WITHIN`).
    """

    name: str
    gain: float
    equivalent: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SearchResult:
    """What the search over mean effects found.

    Attributes
    ----------
    nested
        Models from the base upwards, one effect more at each step.
    found
        The effects of the last model, strongest first.
    untestable
        Effects that this data cannot test, with what is missing.
    best_rejected, rejected
        Gain of the best candidate that was not accepted, and its name; -inf and "" where none came near.
    """

    nested: tuple[Model, ...]
    found: tuple[Found, ...]
    untestable: tuple[tuple[str, str], ...]
    best_rejected: float
    rejected: str


@dataclass(frozen=True, slots=True)
class Growth:
    """Models grown effect by effect, before the last one is judged.

    Attributes
    ----------
    nested, untestable, best_rejected, rejected
        As in `SearchResult`.
    testable
        The candidates that the data can test.
    alternatives
        For each effect of the last model, that model with another in its place, best first; None where not yet known.
    """

    nested: tuple[Model, ...]
    testable: tuple[type[MeanEffect], ...]
    untestable: tuple[tuple[str, str], ...]
    best_rejected: float
    rejected: str
    alternatives: tuple[tuple[Model, ...], ...] | None
