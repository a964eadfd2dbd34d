"""Results of the search for discrepancies: plain and immutable; the command and the monitor room turn it into JSON."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

from rwa_monitor.wheel.effects.base import Family

Verdict = Literal["adequate", "inadequate", "untestable"]

AT_A_BOUND: Final = 1e-3  # of a parameter's range: where a bounded fit stops
INDISTINGUISHABLE: Final = 2.0  # standard deviations from a bound: 95 %
TOLERATED_RISE: Final = 0.01  # of the held-out RMSE: a base model's false jumps may take so much of the noise with them


def _with_lists(fields: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the fields of a dataclass as JSON has them."""
    return {name: list(value) if isinstance(value, tuple) else value for name, value in fields}


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
        name = "formula" if self.formula else self.name
        fields = asdict(self, dict_factory=_with_lists)
        return fields | {"name": name, "parameters": parameters, "formula": self.formula or None}


@dataclass(frozen=True, slots=True)
class Unexplained:
    """Something that no known effect explains: where it shows, and its RMS beside levels and slope [N m]."""

    signature: str
    size_Nm: float

    def beside(self, signature: str, size_Nm: float) -> Unexplained:
        """Return this and something else, which is named first."""
        return Unexplained(f"{signature}; and {self.signature}", math.hypot(size_Nm, self.size_Nm))


@dataclass(frozen=True, slots=True)
class Rates:
    """Detection and false-positive rate of the diagnosis, and false changepoints per window."""

    detection: float
    false_positive: float
    false_changepoints: float


@dataclass(frozen=True, slots=True)
class DiagnosisGain:
    """Rates of the diagnosis on labelled windows without and with the extension."""

    before: Rates
    after: Rates
    windows: int


@dataclass(frozen=True, slots=True)
class SimulatedGain:
    """RMSE [N m] of the wheel file simulated on the searched records, without the effects found and with them."""

    rmse_base_Nm: float
    rmse_extended_Nm: float

    @property
    def is_a_loss(self) -> bool:
        """Return whether the simulation is worse with the effects."""
        return self.rmse_extended_Nm > (1.0 + TOLERATED_RISE) * self.rmse_base_Nm

    def in_words(self) -> str:
        """Return in words what does not hold, in plain words; nothing where it does."""
        if not self.is_a_loss:
            return ""
        return (
            f"does not hold when simulated: on these records the RMSE of the wheel file goes from"
            f" {self.rmse_base_Nm:.4g} to {self.rmse_extended_Nm:.4g} N m with it; do not extend the wheel file by it"
        )


@dataclass(frozen=True, slots=True)
class SearchedAgain:
    """What a search of a part of the data finds, and gains on the rest, of which it saw nothing.

    `effects` are the mean effects of that search, `held_out` what it did not see.
    """

    effects: tuple[str, ...]
    held_out: tuple[str, ...]
    rmse_base_Nm: float
    rmse_extended_Nm: float
    log_score_base: float
    log_score_extended: float

    def in_words(self) -> str:
        """Return both in one sentence."""
        return (
            f"searched again without {', '.join(self.held_out)}: {' + '.join(self.effects) or 'nothing'} found; there"
            f" RMSE {self.rmse_base_Nm:.4g} → {self.rmse_extended_Nm:.4g} N m, log score {self.log_score_base:.4f} →"
            f" {self.log_score_extended:.4f} per sample"
        )


@dataclass(frozen=True, slots=True)
class Gain:
    """What the extension gains; RMSE and log score on held-out data, equal where the base model is adequate.

    `held_out` names the recordings that RMSE and log score are of; where it is empty, held-out blocks of the searched
    recordings. `simulated` is of the wheel file with the effects, simulated on the searched records; None without any.
    `searched_again` is what the search finds and gains without the data that it is judged on, other recordings or
    stretches of time, and `searched_again_by_speed` the same without ranges of speed; None where not asked for.
    """

    rmse_base_Nm: float
    rmse_extended_Nm: float
    log_score_base: float
    log_score_extended: float
    noise_std_Nm: float
    changepoints_base: int
    changepoints_extended: int
    diagnosis: DiagnosisGain | None = None
    simulated: SimulatedGain | None = None
    held_out: tuple[str, ...] = ()
    searched_again: SearchedAgain | None = None
    searched_again_by_speed: SearchedAgain | None = None

    @property
    def is_a_loss(self) -> bool:
        """Return whether the extension does worse than the base model on held-out data, by either figure."""
        worse = self.rmse_extended_Nm > (1.0 + TOLERATED_RISE) * self.rmse_base_Nm
        return worse or self.log_score_extended < self.log_score_base

    @property
    def only_by_fewer_jumps(self) -> bool:
        """Return whether all that it gains there are jumps: it leaves no less error."""
        return not self.is_a_loss and self.rmse_extended_Nm > self.rmse_base_Nm


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
        report = asdict(self, dict_factory=_with_lists)
        report["effects"] = [effect.to_json() for effect in self.effects]
        report["untested"] = [{"effect": name, "missing": missing} for name, missing in self.untested]
        if self.gain is not None and self.gain.simulated is not None:
            report["gain"]["simulated"]["note"] = self.gain.simulated.in_words()
        if self.gain is not None and self.gain.diagnosis is not None:
            del report["gain"]["diagnosis"]["windows"]
        return report
