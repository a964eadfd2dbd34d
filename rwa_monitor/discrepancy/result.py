"""Results of the search for discrepancies: plain and immutable, their parts as they stand in its message."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

from rwa_monitor.messages import Gain, SimulatedGain, Unexplained
from rwa_monitor.wheel.effects.base import Family

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
        """Return a fitted value [unit] as its standard deviation, NaN where there is none, and its bounds have it."""
        error = std if math.isfinite(std) else None
        for bound in (low, high):
            if _is_at(value, bound, low, high):
                return cls(value, None, unit, f"at its bound {bound:.4g}: not determined")
            # A strength beside zero is what its error implies; any other end is one of what was tried.
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
    """Return whether a value is at a bound: to a thousandth of the range, or of the bound if the range is decades."""
    if bound == 0.0 or not math.isfinite(bound):
        return value == bound  # small is not zero
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
        The manoeuvre or channel that would.
    parameters
        By name, in the order of wheel.toml.
    p_value
        Probability of as large a gain, over all effects tried, on a record without any.
    delta_deviance
        Gain of the score, twice the log likelihood less the price.
    formula
        Of a law that has no name: what it is, with its constants and units; "" of an effect of the catalogue.
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
        """Return the fields of the message `rwa.Discrepancy`; what has a formula has no name of the catalogue."""
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
    gain: Gain | None

    def to_json(self) -> dict[str, Any]:
        """Return the report with the fields of the message `rwa.Discrepancy`."""
        return {
            "verdict": self.verdict,
            "effects": [effect.to_json() for effect in self.effects],
            "unexplained": self.unexplained and self.unexplained.model_dump(),
            "untested": [{"effect": name, "missing": missing} for name, missing in self.untested],
            "gain": self.gain and self.gain.model_dump(),
        }
