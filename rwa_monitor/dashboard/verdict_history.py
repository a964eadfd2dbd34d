"""The course of a wheel over its windows in brief: since when it is as it is, and whether it gets worse."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

from rwa_monitor.messages import Diagnosis, dump_json

NOTICEABLE: Final = 0.1  # change of the severity from one window to the next that is worth an arrow
ERRORS: Final = 2.0  # and in standard deviations of the change: less is scatter of the estimates
REMEMBERED: Final = 50  # windows that a course is begun with

Change = Literal["worse", "better", "steady"]


@dataclass(slots=True)
class Course:
    """What earlier windows of a wheel say beside the latest one.

    Attributes
    ----------
    since_ns
        Beginning of the first of the windows in a row with the present verdict [ns, wheel's clock].
    windows
        How many these are.
    change
        Where the worst severity goes, steady where its errors allow that; None unless the last two windows are
        anomalous.
    """

    since_ns: int | None = None
    windows: int = 0
    change: Change | None = None
    _last: Diagnosis | None = None

    def extend(self, diagnoses: Iterable[Diagnosis]) -> None:
        """Take in windows, the oldest first; one that is not later than the last one changes nothing."""
        for window in diagnoses:
            before = self._last
            if before is not None and window.window_end_ns <= before.window_end_ns:
                continue
            same = before is not None and before.verdict == window.verdict
            if not same:
                self.since_ns, self.windows = window.window_start_ns, 0
            self.windows += 1
            self.change = None
            if same and before is not None and window.verdict == "anomalous":
                self.change = _change(before, window)
            self._last = window

    def to_json(self) -> bytes:
        """Return it as it goes with a diagnosis in the feed."""
        return dump_json({"since_ns": self.since_ns, "windows": self.windows, "change": self.change})


def _change(before: Diagnosis, after: Diagnosis) -> Change:
    """Return where the worst severity goes from one anomalous window to the next."""
    (was, was_std), (now, now_std) = _worst(before), _worst(after)
    step = now - was
    if abs(step) <= max(NOTICEABLE, ERRORS * math.hypot(was_std, now_std)):
        return "steady"
    return "worse" if step > 0.0 else "better"


def _worst(window: Diagnosis) -> tuple[float, float]:
    """Return the largest severity of a window's active anomalies and its standard deviation; 0 where none is known."""
    found = [(one.severity, one.severity_std or 0.0) for one in window.anomalies.values() if one.active]
    return max(((severity, std) for severity, std in found if severity is not None), default=(0.0, 0.0))
