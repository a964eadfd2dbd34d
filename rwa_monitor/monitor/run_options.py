"""The settings of the live monitor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rwa_monitor.changepoints.stage_results import Method
from rwa_monitor.diagnosis.model import Model
from rwa_monitor.monitor.bus import BusOptions
from rwa_monitor.monitor.recording.recorder import MAX_FILE_BYTES
from rwa_monitor.monitor.state_recovery import Setup
from rwa_monitor.monitor.wheel_set import WheelKey, WheelSet
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel

STATUS_PERIOD_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class RunOptions:
    """All settings of `run`; every one of them is in the recording.

    Attributes
    ----------
    wheels
        Key expression of the samples to listen to.
    wheel
        Constants of the wheels that have none of their own.
    own_wheels
        Constants of single wheels, by spacecraft and wheel.
    model
        What was learned about nominal and anomalous friction; None leaves all verdicts open.
    method
        "joint" or "paper".
    record
        Folder of the recordings, or None to record nothing.
    max_file_bytes
        Of one recording; then the next one is begun.
    max_record_bytes
        Of all recordings in the folder; the oldest are deleted to keep it. None keeps all.
    bus
        How to reach the bus.
    shard
        (I, N): this process serves share I of N, 1 ≤ I ≤ N.
    status_period_s
        Wall-clock time from one status message to the next [s].
    tell_verdicts
        Whether each change of a verdict is said, too; where somebody else shows the diagnoses it would be said twice.
    """

    wheels: str = "rwa/*/*/samples"
    wheel: Wheel = field(default_factory=built_in_wheel)
    own_wheels: Mapping[WheelKey, Wheel] = field(default_factory=dict)
    model: Model | None = None
    method: Method = "joint"
    record: Path | None = None
    max_file_bytes: int = MAX_FILE_BYTES
    max_record_bytes: int | None = None
    bus: BusOptions = field(default_factory=BusOptions)
    shard: tuple[int, int] = (1, 1)
    status_period_s: float = STATUS_PERIOD_S
    tell_verdicts: bool = True

    def setup(self) -> Setup:
        """Return what diagnoses depend on."""
        return Setup(WheelSet(self.wheel, self.own_wheels), self.model, self.method)

    def settings(self) -> dict[str, Any]:
        """Return the settings as they are written into a recording."""
        share, of = self.shard
        return {"wheels": self.wheels, "method": self.method, "shard": f"{share}/{of}"}
