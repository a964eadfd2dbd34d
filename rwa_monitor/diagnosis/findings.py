"""The inputs of a window's diagnosis, and its parts in SI units: the diagnosis is the message on the bus.

Slots and indices count within the window; nothing here depends on the time of day, the spacecraft or the file.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rwa_monitor.changepoints.stage_results import REJECTED, UNATTRIBUTED, Assignment, Evidence
from rwa_monitor.diagnosis.adequacy import Adequacy
from rwa_monitor.diagnosis.classification import Judged, Judgement
from rwa_monitor.diagnosis.features import Features
from rwa_monitor.diagnosis.model import AnomalyModel, Levels, Model, models_for
from rwa_monitor.messages import AttributedChangepoint, Method, Provenance, Quantity
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.wheel import Wheel
from rwa_monitor.words import SOFTWARE

DRY_UNIT = "N m"
VISCOUS_UNIT = "N m s/rad"


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


# ---- inputs ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class DiagnosisInput:
    """All inputs of a diagnosis; `start_ns` is the time of the window's first slot."""

    evidence: Evidence
    wheel: Wheel
    model: Model | None
    carried: CarriedState
    method: Method = "joint"
    start_ns: int = 0

    @cached_property
    def models(self) -> list[AnomalyModel | None]:
        """The model of each anomaly of the wheel, in the wheel's order; None where there is none."""
        return models_for(self.wheel, self.model)

    def stated(self) -> dict[str, Any]:
        """Return the fields of the diagnosis on window and provenance; spacecraft and wheel are left empty."""
        evidence = self.evidence
        provenance = Provenance(
            software=SOFTWARE,
            method=self.method,
            model_sha256=self.model.sha256() if self.model else "",
            wheel_sha256=self.wheel.sha256(),
            prior_sha256=self.carried.sha256(),
        )
        return {
            "spacecraft": "",
            "wheel": "",
            "window_start_ns": self.start_ns,
            "window_end_ns": self.start_ns + evidence.slots * self.wheel.period_ns,
            "samples": evidence.slots,
            "coverage": evidence.good / evidence.slots if evidence.slots else 0.0,
            "partial": evidence.slots < self.wheel.window.samples,
            "provenance": provenance,
        }


class Findings(NamedTuple):
    """The results from which a verdict and its explanation follow.

    Attributes
    ----------
    inputs
        The inputs of the diagnosis.
    anomalies
        One entry per possible anomaly, in the wheel's order.
    base_known
        Whether the window itself separates base dry friction from the switching systems'.
    fits
        Whether the friction model fits.
    unnamed_jumps
        Whether friction jumps and the wheel file names no switching system.
    temperature_uncertainty
        Why the bearing's temperature makes viscous friction uncertain; "" where it does not.
    """

    inputs: DiagnosisInput
    anomalies: tuple[AnomalyDiagnosis, ...]
    base_known: bool
    fits: Adequacy
    unnamed_jumps: bool
    temperature_uncertainty: str

    def because_of_temperature(self, names: Sequence[str]) -> str:
        """Return the end of a reason, on temperature, why these anomalies are not judged; "" where `lacking` has it."""
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


def value_of(value: float, std: float, unit: float, name: str) -> Quantity:
    """Return a value with its standard deviation in another unit, of that name."""
    return Quantity(value=scaled(value, unit), std=scaled(std, unit), unit=name)


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


def changepoints_of(assignment: Assignment, wheel: Wheel, start_ns: int = 0) -> list[AttributedChangepoint]:
    """Return all candidates of an assignment in SI units, sorted by slot."""
    names = {REJECTED: "rejected", UNATTRIBUTED: "unattributed"}
    names |= {s: system.name for s, system in enumerate(wheel.fss)}
    torque = wheel.torque_unit_Nm
    order = np.argsort(assignment.index, kind="stable")
    # Of two jumps with no usable sample between them only the sum is known: either may be all of it.
    open_ended = ~np.isfinite(assignment.jump_std)
    std = np.where(open_ended, np.abs(assignment.jump[open_ended]).sum(), assignment.jump_std)
    columns = (assignment.index, assignment.jump * torque, std * torque, assignment.system, assignment.confidence)
    return [
        AttributedChangepoint(
            index=index,
            time_ns=start_ns + index * wheel.period_ns,
            jump_Nm=jump_Nm,
            std_Nm=std_Nm,
            fss=names[system],
            confidence=confidence,
        )
        for index, jump_Nm, std_Nm, system, confidence in zip(*(c[order].tolist() for c in columns), strict=True)
    ]
