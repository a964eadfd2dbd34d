"""Diagnosis of reaction wheels from their bearing friction, live on a bus and from recordings.

The public names are those of `rwa_monitor.api`, and `rwa_monitor.plot` for pictures; everything else may change.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    __version__: str

    from rwa_monitor import plot
    from rwa_monitor.api import (
        CoefficientTrend,
        Diagnosis,
        Monitor,
        Samples,
        Scenario,
        Search,
        Telemetry,
        Wheel,
        diagnose,
        extended_wheel,
        find_discrepancy,
        frame,
        read,
        read_wheel,
        simulate,
        wheel_trends,
    )

__all__ = [
    "CoefficientTrend",
    "Diagnosis",
    "Monitor",
    "Samples",
    "Scenario",
    "Search",
    "Telemetry",
    "Wheel",
    "__version__",
    "diagnose",
    "extended_wheel",
    "find_discrepancy",
    "frame",
    "plot",
    "read",
    "read_wheel",
    "simulate",
    "wheel_trends",
]


def __getattr__(name: str) -> Any:
    """Import the public names when they are asked for: the command's --help needs none of what is behind them."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "__version__":
        return import_module("rwa_monitor.build").build()
    if name == "plot":
        return import_module("rwa_monitor.plot")
    return getattr(import_module("rwa_monitor.api"), name)


def __dir__() -> list[str]:
    """Name what there is."""
    return sorted([*globals(), *__all__])
