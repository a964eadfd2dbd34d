"""The diagnosis of a window and its inputs: plain, immutable, in SI units; the monitor room turns it into a message.

Slots and indices count within the window; nothing here depends on the time of day, the spacecraft or the file.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from rwa_monitor.changepoints.stage_results import REJECTED, UNATTRIBUTED, Assignment, Evidence, Method
from rwa_monitor.diagnosis.adequacy import FITS, Adequacy
from rwa_monitor.diagnosis.classification import Judged, Judgement
from rwa_monitor.diagnosis.features import Features
from rwa_monitor.diagnosis.model import AnomalyModel, Levels, Model, models_for
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.wheel import Wheel

Verdict = Literal["nominal", "anomalous", "inconclusive"]
DRY_UNIT = "N m"
VISCOUS_UNIT = "N m s/rad"


@dataclass(frozen=True, slots=True)
class Value:
    """A value with its standard deviation; None where the window does not show it."""

    value: float | None
    std: float | None
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class AnomalyDiagnosis(Judged):
    """One possible anomaly: the judgement on it, and what it was judged by; filled in whatever the verdict.

    Attributes
    ----------
    severity, severity_std
        0 at the nominal bound (and below), 1 at the median of the learned anomaly; None without a nominal range.
    estimate
        The coefficient; for a switching system the mean friction of its highest visited configuration.
    nominal_low, nominal_high
        Range of the estimate on a healthy wheel; None where no model holds it.
    unit
        Of estimate and range.
    std
        Standard deviation of the estimate, in its unit; 0 where it is not finite.
    unmoved
        Whether it is that of a system without a jump in the window.
    """

    severity: float | None
    severity_std: float | None
    estimate: float | None
    nominal_low: float | None
    nominal_high: float | None
    unit: str
    std: float
    unmoved: bool


@dataclass(frozen=True, slots=True)
class SystemFriction:
    """The sojourns of one switching system: configuration, friction [N m] and first slot of each."""

    name: str
    configuration: tuple[int, ...]
    friction_Nm: tuple[float, ...]
    start_index: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Changepoint:
    """A jump of dry friction.

    Attributes
    ----------
    index
        First slot of the new level.
    jump_Nm, std_Nm
        Its size, positive up, and the standard deviation.
    fss
        The switching system that made it, or "rejected" or "unattributed".
    confidence
        Probability of this attribution.
    """

    index: int
    jump_Nm: float
    std_Nm: float
    fss: str
    confidence: float


@dataclass(frozen=True, slots=True)
class Fit:
    """How well the friction model fits the window [N m]; None with too few samples."""

    rmse_Nm: float | None
    excess_rmse_Nm: float | None
    noise_std_Nm: float | None


@dataclass(frozen=True, slots=True)
class WindowDiagnosis:
    """The diagnosis of one window.

    Attributes
    ----------
    slots, good, used
        Length of the window, slots with a good sample, and good slots outside the dead band.
    coverage
        good / slots.
    verdict, reason
        The judgement and, in one sentence, why.
    anomalies
        One entry per possible anomaly of the wheel, in the wheel's order: dry, viscous, switching systems.
    base_dry, viscous, fss
        The friction split into its parts.
    changepoints
        All candidates, in order, rejected ones included.
    fit
        Residuals.
    model_adequate, suspected_effect
        Whether the friction model fits, and if not, which effect of the catalogue may be missing.
    explanation
        Two or three plain sentences an operator can act on.
    method
        joint or paper.
    model_sha256
        Of the model used, "" without one.
    wheel_sha256, prior_sha256
        Of the wheel and of the carried state before this window.
    features
        What the classifiers saw, for training; it does not leave the program.
    """

    slots: int
    good: int
    used: int
    coverage: float
    verdict: Verdict
    reason: str
    anomalies: tuple[AnomalyDiagnosis, ...]
    fss: tuple[SystemFriction, ...]
    explanation: str
    method: Method
    model_sha256: str
    wheel_sha256: str
    prior_sha256: str
    features: Features
    base_dry: Value = Value(None, None, DRY_UNIT)
    viscous: Value = Value(None, None, VISCOUS_UNIT)
    changepoints: tuple[Changepoint, ...] = ()
    fit: Fit = Fit(None, None, None)
    model_adequate: bool = True
    suspected_effect: str | None = None


# ---- what it is a function of ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class DiagnosisInput:
    """What a diagnosis is a function of."""

    evidence: Evidence
    wheel: Wheel
    model: Model | None
    carried: CarriedState
    method: Method = "joint"

    @cached_property
    def models(self) -> list[AnomalyModel | None]:
        """What is known about each anomaly of the wheel, in the wheel's order; None where nothing is."""
        return models_for(self.wheel, self.model)

    def provenance(self) -> dict[str, Any]:
        """Return the fields of the diagnosis on what it was made from."""
        return {
            "slots": self.evidence.slots,
            "good": self.evidence.good,
            "used": self.evidence.used,
            "coverage": self.evidence.good / self.evidence.slots if self.evidence.slots else 0.0,
            "method": self.method,
            "model_sha256": self.model.sha256() if self.model else "",
            "wheel_sha256": self.wheel.sha256(),
            "prior_sha256": self.carried.sha256(),
        }


class Findings(NamedTuple):
    """What a verdict is drawn from, and explained by.

    Attributes
    ----------
    inputs
        What the diagnosis is a function of.
    anomalies
        One entry per possible anomaly, in the wheel's order.
    base_known
        Whether the window itself distinguishes base dry friction from the switching systems'.
    fits
        Whether the friction model fits.
    unnamed_jumps
        Whether friction jumps and the wheel file names no switching system.
    temperature_uncertainty
        What the bearing's temperature leaves open of viscous friction; "" where nothing.
    """

    inputs: DiagnosisInput
    anomalies: tuple[AnomalyDiagnosis, ...]
    base_known: bool
    fits: Adequacy = FITS
    unnamed_jumps: bool = False
    temperature_uncertainty: str = ""

    def because_of_temperature(self, names: Sequence[str]) -> str:
        """Return the end of a reason on what keeps these anomalies from being judged; "" where `lacking` has it."""
        why = self.temperature_uncertainty if self.fits.adequate and "viscous" in names else ""
        return f": {why}" if why else ""

    @property
    def lacking(self) -> str:
        """The part of a reason on what the friction model or the wheel file lacks; "" where nothing."""
        if not self.fits.adequate:
            parts = [part for part in (self.fits.finding, self.temperature_uncertainty) if part]
            return f" while the friction model lacks something ({'; '.join(parts)})"
        if self.unnamed_jumps:
            return " while friction jumps and the wheel file names no switching system ([[fss]])"
        return ""


# ---- from normalised values to SI units ------------------------------------------------------------------------------


def viscous_unit(wheel: Wheel) -> float:
    """Return what one normalised unit of viscous friction is [N m s/rad]."""
    return wheel.torque_unit_Nm / wheel.speed_unit_rad_s


def scaled(value: float, unit: float) -> float | None:
    """Return a value in another unit; None where it is not finite."""
    return float(value * unit) if math.isfinite(value * unit) else None


def value_of(value: float, std: float, unit: float, name: str) -> Value:
    """Return a value with its standard deviation in another unit, of that name."""
    return Value(scaled(value, unit), scaled(std, unit), name)


def anomalies_of(inputs: DiagnosisInput, judgement: Judgement) -> tuple[AnomalyDiagnosis, ...]:
    """Return the entry of each anomaly: its judgement, and estimate, nominal range and severity in SI units."""
    return tuple(
        _anomaly_of(inputs, judged, learned, judgement.features, a)
        for a, (judged, learned) in enumerate(zip(judgement.anomalies, inputs.models, strict=True))
    )


def _anomaly_of(
    inputs: DiagnosisInput, judged: Judged, model: AnomalyModel | None, features: Features, a: int
) -> AnomalyDiagnosis:
    wheel, unit, name = inputs.wheel, inputs.wheel.torque_unit_Nm, DRY_UNIT
    q, value, std = features.measured(a)
    if a == 1:
        nominal = wheel.nominal.viscous_Nm_s_rad if wheel.nominal else 0.0
        unit, name = nominal if nominal > 0 else viscous_unit(wheel), VISCOUS_UNIT
    levels: Levels | None = model.levels[q] if model else None
    severity, severity_std, low, high = None, None, None, None
    if a > 1 and q == 0 and model is not None:
        # At rest a system has no friction, healthy or not; its severity could be anything up to the learned one.
        severity, severity_std, low, high = 0.0, 1.0, 0.0, 0.0
    elif levels is not None:
        low, high = levels.nominal_low * unit, levels.nominal_high * unit
        if (width := levels.severity_unit) is not None:
            severity = scaled(max(0.0, (value - levels.nominal_high) / width), 1.0)
            severity_std = scaled(std / width, 1.0)
    return AnomalyDiagnosis(
        **asdict(judged),
        severity=severity,
        severity_std=severity_std,
        estimate=scaled(value, unit),
        nominal_low=low,
        nominal_high=high,
        unit=name,
        std=std * unit if math.isfinite(std * unit) else 0.0,
        unmoved=a > 1 and features.systems[a - 2].unmoved,
    )


def changepoints_of(assignment: Assignment, wheel: Wheel) -> tuple[Changepoint, ...]:
    """Return all candidates of an assignment in SI units, sorted by slot."""
    names = {REJECTED: "rejected", UNATTRIBUTED: "unattributed"}
    names |= {s: system.name for s, system in enumerate(wheel.fss)}
    torque = wheel.torque_unit_Nm
    order = np.argsort(assignment.index, kind="stable")
    # Of two jumps with no usable sample between them only the sum is known: either may be all of it.
    std, open_ended = assignment.jump_std, ~np.isfinite(assignment.jump_std)
    if open_ended.any():
        std = np.where(open_ended, np.abs(assignment.jump[open_ended]).sum(), std)
    columns = (assignment.index, assignment.jump * torque, std * torque, assignment.system, assignment.confidence)
    return tuple(
        Changepoint(index, jump_Nm, std_Nm, names[system], confidence)
        for index, jump_Nm, std_Nm, system, confidence in zip(*(c[order].tolist() for c in columns), strict=True)
    )
