"""What the diagnosis of a window says: plain, immutable, in SI units; the monitor room turns it into a message.

Slots and indices count within the window; nothing here knows the time of day, the spacecraft or the file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rwa_monitor.changepoints.stage_results import Method
from rwa_monitor.diagnosis.features import Features

Verdict = Literal["nominal", "anomalous", "inconclusive"]
DRY_UNIT = "N m"
VISCOUS_UNIT = "N m s/rad"


@dataclass(frozen=True, slots=True)
class Value:
    """A value with its standard deviation; None where the window does not show it."""

    value: float | None
    std: float | None
    unit: str


@dataclass(frozen=True, slots=True)
class AnomalyDiagnosis:
    """One possible anomaly.

    Attributes
    ----------
    name
        dry, viscous, or the switching system's.
    active
        Whether it is diagnosed; filled in also when the verdict is inconclusive.
    probability
        That it is there, given this window and the carried state.
    severity, severity_std
        0 at the nominal bound (and below), 1 at the median of the learned anomaly; None without a nominal range.
    estimate
        The coefficient; for a switching system the mean friction of its highest visited configuration.
    nominal_low, nominal_high
        Range of the estimate on a healthy wheel; None where no model knows it.
    unit
        Of estimate and range.
    """

    name: str
    active: bool
    probability: float
    severity: float | None
    severity_std: float | None
    estimate: float | None
    nominal_low: float | None
    nominal_high: float | None
    unit: str


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
    """How well the friction model fits the window [N m]; None where too few samples tell."""

    rmse_Nm: float | None
    excess_rmse_Nm: float | None
    noise_std_Nm: float | None


@dataclass(frozen=True, slots=True)
class WindowDiagnosis:
    """Everything a diagnosis says about one window.

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
    base_dry: Value
    viscous: Value
    fss: tuple[SystemFriction, ...]
    changepoints: tuple[Changepoint, ...]
    fit: Fit
    model_adequate: bool
    suspected_effect: str | None
    explanation: str
    method: Method
    model_sha256: str
    wheel_sha256: str
    prior_sha256: str
    features: Features

    def anomaly(self, name: str) -> AnomalyDiagnosis:
        """Return the entry of one anomaly; KeyError if the wheel has none of that name."""
        for anomaly in self.anomalies:
            if anomaly.name == name:
                return anomaly
        raise KeyError(name)
