"""Results as rows of a table, for Parquet and for a pandas frame, with units in the names of the columns."""

from __future__ import annotations

from typing import Any, Final

from rwa_monitor.messages import Diagnosis

Row = dict[str, Any]
ANOMALY_FIELDS: Final = ("active", "probability", "severity", "estimate", "unit")


def diagnosis_row(diagnosis: Diagnosis) -> Row:
    """Return one window as a row; `message` is the whole of it, as `diagnose --json` prints it.

    Columns of an anomaly begin with its name: `dry_probability`, `fss_1_active`, …
    """
    row: Row = {
        "source": diagnosis.source,
        "spacecraft": diagnosis.spacecraft,
        "wheel": diagnosis.wheel,
        "window_start_ns": diagnosis.window_start_ns,
        "window_end_ns": diagnosis.window_end_ns,
        "samples": diagnosis.samples,
        "coverage": diagnosis.coverage,
        "partial": diagnosis.partial,
        "verdict": diagnosis.verdict,
        "reason": diagnosis.reason,
        "base_dry_Nm": diagnosis.friction.base_dry.value,
        "base_dry_std_Nm": diagnosis.friction.base_dry.std,
        "viscous_Nm_s_rad": diagnosis.friction.viscous.value,
        "viscous_std_Nm_s_rad": diagnosis.friction.viscous.std,
        "changepoints": len(diagnosis.changepoints),
        "rmse_Nm": diagnosis.fit.rmse_Nm,
        "noise_std_Nm": diagnosis.fit.noise_std_Nm,
        "model_adequate": diagnosis.model_adequate,
        "suspected_effect": diagnosis.suspected_effect,
    }
    for name, anomaly in diagnosis.anomalies.items():
        row |= {f"{name}_{field}": getattr(anomaly, field) for field in ANOMALY_FIELDS}
    row["message"] = diagnosis.to_json().decode("utf-8")
    return row
