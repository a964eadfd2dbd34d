"""The name by which the benchmark commands know `console.log`; goes with them."""

from rwa_monitor.cli.console import log as say

__all__ = ["say"]
