"""Diagnoses as the monitor would send them, of healthy and of anomalous wheels."""

from rwa_monitor.messages import Anomaly, Diagnosis, Discrepancy, Friction, Provenance, Quantity, Residuals

WINDOW_NS = 2_000_000_000_000
START_NS = 1_795_000_000_000_000_000


def diagnosis(number: int, *, severity: float | None = None, wheel: str = "wheel_1") -> Diagnosis:
    """Return the diagnosis of the n-th window; anomalous where a severity is given."""
    bad = severity is not None
    viscous = Anomaly(
        active=bad, probability=0.99 if bad else 0.01, severity=severity or 0.0, severity_std=0.1,
        estimate=6.6e-6 if bad else 5.3e-6, nominal_low=5.1e-6, nominal_high=5.5e-6, unit="N m s/rad",
    )  # fmt: skip
    start = START_NS + number * WINDOW_NS
    return Diagnosis(
        spacecraft="sat", wheel=wheel, window_start_ns=start, window_end_ns=start + WINDOW_NS, samples=16000,
        coverage=1.0, partial=False, verdict="anomalous" if bad else "nominal",
        reason="Viscous friction is too high." if bad else "All friction is nominal.",
        anomalies={"viscous": viscous},
        friction=Friction(
            base_dry=Quantity(value=1.6e-3, std=1e-5, unit="N m"),
            viscous=Quantity(value=viscous.estimate, std=1e-8, unit="N m s/rad"), fss={},
        ),
        changepoints=[], fit=Residuals(rmse_Nm=4e-5, excess_rmse_Nm=0.0, noise_std_Nm=3.9e-5),
        model_adequate=True, suspected_effect=None, explanation="Two sentences. For an operator.",
        provenance=Provenance(software="test", method="joint", model_sha256="", wheel_sha256="", prior_sha256=""),
    )  # fmt: skip


def discrepancy(number: int, wheel: str = "wheel_1") -> Discrepancy:
    """Return a report on the n-th window that names an effect."""
    start = START_NS + number * WINDOW_NS
    effect = {
        "name": "stribeck", "family": "mean", "equivalent": ["load_dependence"], "separate_by": "cross zero slowly",
        "parameters": {"strength_Nm": {"value": 5e-4, "std": 1e-5, "unit": "N m"}}, "p_value": 1e-9,
        "delta_deviance": 80.0,
    }  # fmt: skip
    return Discrepancy.model_validate(
        {
            "spacecraft": "sat", "wheel": wheel, "start_ns": start, "end_ns": start + WINDOW_NS,
            "verdict": "inadequate", "effects": [effect], "unexplained": {"signature": "ripple", "size_Nm": 2e-5},
            "untested": [{"effect": "torque_constant_temperature", "missing": "bearing_temperature_degC"}],
            "gain": None,
        }
    )  # fmt: skip
