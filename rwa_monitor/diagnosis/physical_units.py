"""What a diagnosis says of friction, from the stages' normalised values into SI units."""

from __future__ import annotations

import math

import numpy as np

from rwa_monitor.changepoints.stage_results import REJECTED, UNATTRIBUTED, Assignment
from rwa_monitor.diagnosis.classification import Judged
from rwa_monitor.diagnosis.features import Features
from rwa_monitor.diagnosis.model import AnomalyModel, Levels
from rwa_monitor.diagnosis.window_diagnosis import DRY_UNIT, VISCOUS_UNIT, AnomalyDiagnosis, Changepoint, Value
from rwa_monitor.wheel.wheel import Wheel


def viscous_unit(wheel: Wheel) -> float:
    """Return what one normalised unit of viscous friction is [N m s/rad]."""
    return wheel.torque_unit_Nm / wheel.speed_unit_rad_s


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def scaled(value: float, unit: float) -> float | None:
    """Return a value in another unit; None where it is not finite."""
    return _finite(value * unit)


def value_of(value: float, std: float, unit: float, name: str) -> Value:
    """Return a value with its standard deviation in another unit, of that name."""
    return Value(scaled(value, unit), scaled(std, unit), name)


def anomaly_of(
    wheel: Wheel, judged: Judged, model: AnomalyModel | None, features: Features, a: int
) -> AnomalyDiagnosis:
    """Return one entry of the diagnosis: estimate, nominal range and severity in SI units."""
    levels: Levels | None
    if a == 0:
        value, std, unit, name = features.base_dry, features.base_dry_std, wheel.torque_unit_Nm, DRY_UNIT
        levels = model.levels[0] if model else None
    elif a == 1:
        nominal = wheel.nominal.viscous_Nm_s_rad if wheel.nominal else 0.0
        value, std, name = features.viscous, features.viscous_std, VISCOUS_UNIT
        unit = nominal if nominal > 0 else viscous_unit(wheel)
        levels = model.levels[0] if model else None
    else:
        q, value, std = features.systems[a - 2].highest()
        unit, name = wheel.torque_unit_Nm, DRY_UNIT
        if q == 0 and model is not None:
            # At rest a system has no friction, healthy or not; its severity could be anything up to the learned one.
            return AnomalyDiagnosis(judged.name, judged.active, judged.probability, 0.0, 1.0, 0.0, 0.0, 0.0, name)
        levels = model.levels[q] if model else None
    severity = severity_std = None
    width = None if levels is None else levels.severity_unit
    if levels is not None and width is not None:
        severity = _finite(max(0.0, (value - levels.nominal_high) / width))
        severity_std = _finite(std / width)
    return AnomalyDiagnosis(
        name=judged.name,
        active=judged.active,
        probability=judged.probability,
        severity=severity,
        severity_std=severity_std,
        estimate=scaled(value, unit),
        nominal_low=levels.nominal_low * unit if levels else None,
        nominal_high=levels.nominal_high * unit if levels else None,
        unit=name,
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
