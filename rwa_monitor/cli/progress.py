"""The name by which the benchmark commands know `console.track`; goes with them."""

from rwa_monitor.cli.console import track

__all__ = ["track"]
