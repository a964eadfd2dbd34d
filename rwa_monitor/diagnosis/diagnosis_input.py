"""What the diagnosis of a window is a function of, and how the diagnosis says so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rwa_monitor.changepoints.stage_results import Evidence
from rwa_monitor.diagnosis.model import Model
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.wheel import Wheel


@dataclass(frozen=True, slots=True)
class Case:
    """What a diagnosis is a function of."""

    evidence: Evidence
    wheel: Wheel
    model: Model | None
    carried: CarriedState
    doubting: bool = True

    def provenance(self) -> dict[str, Any]:
        """Return the fields of the diagnosis that say what it was made from."""
        return {
            "slots": self.evidence.slots,
            "good": self.evidence.good,
            "used": self.evidence.used,
            "coverage": self.evidence.good / self.evidence.slots if self.evidence.slots else 0.0,
            "method": "joint",
            "model_sha256": self.model.sha256() if self.model else "",
            "wheel_sha256": self.wheel.sha256(),
            "prior_sha256": self.carried.sha256(),
        }
