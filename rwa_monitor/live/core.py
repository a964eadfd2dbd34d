"""The monitor core of one wheel: samples in, events out. Pure: no clock, no network, no file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from rwa_monitor.diagnosis.results import Method
from rwa_monitor.physics.wheel import Wheel
from rwa_monitor.samples import Samples


@dataclass(frozen=True, slots=True)
class WindowDiagnosed:
    """A window was closed and diagnosed; `start_ns` and `end_ns` bound it, [start, end)."""

    start_ns: int
    end_ns: int
    slots: int
    partial: bool
    prior_sha256: str
    diagnosis: Any  # rwa_monitor.diagnosis.window.WindowDiagnosis


class WheelCore:
    """One wheel's monitor: `feed` samples in any cut, get events; `finish` closes the partial last window."""

    def __init__(self, wheel: Wheel, model: Any, *, method: Method = "joint", carried: Any = None) -> None:
        raise NotImplementedError

    def feed(self, samples: Samples, publisher: str = "", batch: int | None = None) -> list[Any]:
        """Take samples and return what happened, in order."""
        raise NotImplementedError

    def finish(self) -> list[Any]:
        """Close the open windows as they are and return what happened."""
        raise NotImplementedError


def diagnose_samples(
    samples: Samples, wheel: Wheel, model: Any, *, method: Method = "joint", carried: Any = None
) -> Iterator[WindowDiagnosed]:
    """Diagnose a whole table, window by window, through the same core as the live monitor."""
    raise NotImplementedError
