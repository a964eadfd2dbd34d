"""Diagnosis of reaction wheels from their bearing friction, live on a bus and from recordings.

Public are the names below (`rwa_monitor.api`, which each comes from when it is asked for), those in `__all__` of
`rwa_monitor.plot` for pictures, `read_results` of `rwa_monitor.batch.store`, and, to write an effect of one's own,
`rwa_monitor.wheel.effects.base` and `register` of `rwa_monitor.wheel.effects.catalogue`. They change with a line in
the changelog; everything else may change at any time.
"""

# What `__all__` names is in that of the api, which only type checkers import from here.
# ruff: noqa: F403, F405

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    __version__: str

    from rwa_monitor import plot
    from rwa_monitor.api import *

__all__ = [
    "CarriedState",
    "CoefficientTrend",
    "Diagnosis",
    "InputError",
    "Learned",
    "Model",
    "Monitor",
    "Report",
    "RwaMonitorError",
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
    "identify",
    "plot",
    "read",
    "read_model",
    "read_wheel",
    "replay",
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
