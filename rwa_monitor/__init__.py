"""Diagnosis of reaction wheels from their bearing friction, live on a bus and from recordings.

Public are `__version__` and the names in `__all__` of `rwa_monitor.api`, which each comes from when it is asked for,
those in `__all__` of `rwa_monitor.plot` for pictures, `read_results` of `rwa_monitor.batch.store`, and, to write an
effect of one's own, `rwa_monitor.wheel.effects.base` and `register` of `rwa_monitor.wheel.effects.catalogue`. They
change with a line in the changelog; everything else may change at any time.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    __version__: str

    from rwa_monitor import plot as plot
    from rwa_monitor.api import *  # noqa: F403


def __getattr__(name: str) -> Any:
    """Import the public names when they are asked for: the command's --help needs none of what is behind them."""
    if name == "__version__":
        return import_module("rwa_monitor.build").build()
    if name == "plot":
        return import_module("rwa_monitor.plot")
    if name == "__all__":
        return [*import_module("rwa_monitor.api").__all__, "__version__", "plot"]
    if not name.startswith("_") and name in (api := import_module("rwa_monitor.api")).__all__:
        return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Name what there is."""
    return sorted([*globals(), *__getattr__("__all__")])
