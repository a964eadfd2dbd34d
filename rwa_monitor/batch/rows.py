"""Results as rows of a table, with units in the names of the columns."""

from __future__ import annotations

from rwa_monitor.discrepancy.result import DiscrepancyResult
from rwa_monitor.identification.identify import Learned
from rwa_monitor.reporting.diagnosis_rows import Row


def discrepancy_row(source: str, result: DiscrepancyResult, message: str) -> Row:
    """Return one report as a row; `message` is the whole of it, as `discrepancy --json` prints it."""
    first = result.effects[0] if result.effects else None
    gain = result.gain
    return {
        "source": source,
        "verdict": result.verdict,
        "first_effect": first.name if first else None,
        "first_p_value": first.p_value if first else None,
        "effects": ", ".join(effect.name for effect in result.effects),
        "unexplained": result.unexplained.signature if result.unexplained else None,
        "rmse_base_Nm": gain.rmse_base_Nm if gain else None,
        "rmse_extended_Nm": gain.rmse_extended_Nm if gain else None,
        "message": message,
    }


def wheel_row(source: str, learned: Learned) -> Row:
    """Return one learned wheel as a row; `message` is the wheel file."""
    wheel = learned.wheel
    nominal = wheel.nominal
    return {
        "source": source,
        "wheel": wheel.name,
        "sample_period_s": wheel.sample_period_s,
        "base_dry_Nm": nominal.dry_torque_Nm if nominal else None,
        "viscous_Nm_s_rad": nominal.viscous_Nm_s_rad if nominal else None,
        "noise_std_Nm": wheel.noise.friction_std_Nm,
        "systems": len(wheel.fss),
        "message": wheel.to_toml(),
    }
