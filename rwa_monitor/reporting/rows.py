"""Results as rows of a table, for Parquet and for a pandas frame, with units in the names of the columns."""

from __future__ import annotations

from typing import Any, Final

from rwa_monitor.messages import Diagnosis

Row = dict[str, Any]
ANOMALY_FIELDS: Final = {"active", "probability", "severity", "estimate", "unit"}


def diagnosis_row(diagnosis: Diagnosis) -> Row:
    """Return one window as a row; `message` is the whole of it, as `diagnose --json` prints it.

    Columns of an anomaly begin with its name: `dry_probability`, `fss_1_active`, …
    """
    friction, fit = diagnosis.friction, diagnosis.fit
    row: Row = {
        name: value for name, value in diagnosis if value is None or isinstance(value, bool | float | int | str)
    }
    row |= {
        "base_dry_Nm": friction.base_dry.value,
        "base_dry_std_Nm": friction.base_dry.std,
        "viscous_Nm_s_rad": friction.viscous.value,
        "viscous_std_Nm_s_rad": friction.viscous.std,
        "changepoints": len(diagnosis.changepoints),
        "rmse_Nm": fit.rmse_Nm,
        "noise_std_Nm": fit.noise_std_Nm,
    }
    for name, anomaly in diagnosis.anomalies.items():
        row |= {f"{name}_{field}": value for field, value in anomaly.model_dump(include=ANOMALY_FIELDS).items()}
    return row | {"message": diagnosis.to_json().decode("utf-8")}
