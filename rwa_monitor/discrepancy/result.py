"""Results of the search for discrepancies: plain and immutable, with parts as in its message."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

import numpy as np

from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.score import HeldOut
from rwa_monitor.discrepancy.terms import Model, SearchResult
from rwa_monitor.messages import Gain, SimulatedGain, Unexplained
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Effect, Family
from rwa_monitor.wheel.wheel import Wheel

Verdict = Literal["adequate", "inadequate", "untestable"]

AT_A_BOUND: Final = 1e-3  # of a parameter's range: where a bounded fit stops
INDISTINGUISHABLE: Final = 2.0  # standard deviations from a bound: 95 %


@dataclass(frozen=True, slots=True)
class ParameterValue:
    """A fitted parameter; `std` is None where the data do not determine it, and `note` then states that."""

    value: float
    std: float | None
    unit: str
    note: str = ""

    @classmethod
    def of(cls, value: float, std: float, unit: str, low: float, high: float) -> ParameterValue:
        """Return a fitted value [unit]; without error where that is NaN or the value may be at a bound."""
        error = std if math.isfinite(std) else None
        for bound in (low, high):
            if _is_at(value, bound, low, high):
                return cls(value, None, unit, f"at its bound {bound:.4g}: not determined")
            # A strength near zero is described by its error; any other bound is only the end of what was tried.
            if bound != 0.0 and error is not None and abs(value - bound) < INDISTINGUISHABLE * error:
                return cls(value, None, unit, f"not distinguishable from its bound {bound:.4g}: not determined")
        return cls(value, error, unit)

    def in_words(self) -> str:
        """Return value, uncertainty and unit, or that it is not determined."""
        unit = "" if self.unit == "-" else f" {self.unit}"
        error = "" if self.std is None else f" ± {self.std:.2g}"
        return f"{self.value:.4g}{error}{unit}" + (f" ({self.note})" if self.note else "")

    def to_json(self) -> dict[str, float | str | None]:
        """Return value, error and unit, and the note where there is one."""
        plain: dict[str, float | str | None] = {"value": self.value, "std": self.std, "unit": self.unit}
        return {**plain, "note": self.note} if self.note else plain


def _is_at(value: float, bound: float, low: float, high: float) -> bool:
    """Return whether a value is at a bound, to a thousandth of the range; of the bound if that is less and low > 0."""
    if bound == 0.0 or not math.isfinite(bound):
        return value == bound  # a small value is not at zero
    width = high - low if math.isfinite(high - low) else abs(bound)
    return abs(value - bound) <= AT_A_BOUND * (min(width, abs(bound)) if low > 0 else width)


@dataclass(frozen=True, slots=True)
class FoundEffect:
    """One effect that the data show and the model lacks.

    Attributes
    ----------
    name, family
        From the catalogue.
    equivalent
        Names that the data cannot distinguish from it.
    separate_by
        The manoeuvre or channel that would distinguish them.
    parameters
        By name, in the order of wheel.toml.
    p_value
        Probability of as large a gain, over all effects tried, on a record without any.
    delta_deviance
        Gain: twice the increase of the log likelihood, less the penalty of the parameters.
    formula
        Of a law that has no name: its terms, with their constants and units; "" for an effect of the catalogue.
    """

    name: str
    family: Family
    equivalent: tuple[str, ...]
    separate_by: str
    parameters: dict[str, ParameterValue]
    p_value: float
    delta_deviance: float
    formula: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the fields of the message `rwa.Discrepancy`; an effect with a formula is named "formula"."""
        parameters = {name: value.to_json() for name, value in self.parameters.items()}
        changed = {"equivalent": list(self.equivalent), "parameters": parameters, "formula": self.formula or None}
        return asdict(self) | changed | {"name": "formula" if self.formula else self.name}


def simulated_gain(base_Nm: float, extended_Nm: float) -> SimulatedGain:
    """Return the RMSE [N m] of a simulated wheel file without the effects found and with them, noted if it is worse."""
    gain = SimulatedGain(rmse_base_Nm=base_Nm, rmse_extended_Nm=extended_Nm)
    note = (
        f"does not hold when simulated: on these records the RMSE of the wheel file goes from {base_Nm:.4g} to"
        f" {extended_Nm:.4g} N m with it; do not extend the wheel file by it"
    )
    return gain.model_copy(update={"note": note}) if gain.is_a_loss else gain


@dataclass(frozen=True, slots=True)
class DiscrepancyResult:
    """The answer of the search; its fields are described in schemas/rwa.Discrepancy.json."""

    verdict: Verdict
    effects: tuple[FoundEffect, ...]
    unexplained: Unexplained | None
    untested: tuple[tuple[str, str], ...]  # effect, what is missing
    gain: Gain

    def to_json(self) -> dict[str, Any]:
        """Return the report with the fields of the message `rwa.Discrepancy`."""
        return {
            "verdict": self.verdict,
            "effects": [effect.to_json() for effect in self.effects],
            "unexplained": self.unexplained and self.unexplained.model_dump(),
            "untested": [{"effect": name, "missing": missing} for name, missing in self.untested],
            "gain": self.gain.model_dump(),
        }


# ---- a finished search: the source of reports, figures and the extended wheel ----------------------------------------


@dataclass(frozen=True, slots=True)
class Search:
    """Everything that a report uses: the data, the nested models, the answer."""

    wheel: Wheel
    problem: Problem
    mean: SearchResult
    scores: tuple[HeldOut, ...]  # of each nested model
    result: DiscrepancyResult
    taken_out: tuple[Effect, ...] = ()  # before the search, since channels determine them

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
        "+ " and the catalogue name of the effect that it adds; "simulation as it is" for the first.
    rmse_Nm, excess_Nm
        Root mean square residual, and its part in excess of the noise [N m].
    log_score
        Mean log density per sample [nats].
    gain, gain_half
        Gain over the model before, and half of its 95 % interval by the spread over blocks [nats per sample]; zero for
        the first.
    total, total_half
        The same over the first model.
    jumps
        Jumps that the model needs for the searched recordings.
    """

    name: str
    rmse_Nm: float
    excess_Nm: float
    log_score: float
    gain: float
    gain_half: float
    total: float
    total_half: float
    jumps: int


def nested_models(search: Search) -> list[NestedModel]:
    """Return the nested models with held-out gains; intervals from the spread over held-out blocks."""
    nested: list[NestedModel] = []
    blocks = [score.block_log_scores for score in search.scores]
    for i, (model, score) in enumerate(zip(search.mean.nested, search.scores, strict=True)):
        excess = float(np.sqrt(max(score.rmse_Nm**2 - search.problem.noise.std**2, 0.0)))
        name = f"+ {model.names[-1]}" if i else "simulation as it is"
        gain, total = (_with_interval(blocks[i] - before) for before in (blocks[max(i - 1, 0)], blocks[0]))
        jumps = int(model.fit.jumps.size)
        nested.append(NestedModel(name, score.rmse_Nm, excess, score.log_score, *gain, *total, jumps))
    return nested


def _with_interval(per_block: FloatArray) -> tuple[float, float]:
    """Return a mean over blocks and half of its 95 % interval."""
    return float(per_block.mean()), NORMAL_95 * float(per_block.std(ddof=1)) / float(np.sqrt(per_block.size))
