"""Parquet where it is installed: it belongs to an extra, and Arrow takes a third of a second to import."""

from __future__ import annotations

from types import ModuleType

from rwa_monitor.errors import MissingExtraError


def parquet() -> ModuleType:
    """Return `parquet_table`; raises MissingExtraError where what it needs is not installed."""
    try:
        from rwa_monitor.telemetry import parquet_table  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"{error.name} is missing: pip install 'rwa-monitor[parquet]'") from error
    return parquet_table
