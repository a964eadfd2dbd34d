"""What a benchmark ran on."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path
from typing import Final

from rwa_monitor.version import SOFTWARE

PACKAGES: Final = (
    "numpy",
    "numba",
    "scipy",
    "scikit-learn",
    "eclipse-zenoh",
    "mcap",
    "pydantic",
    "skchange",
    "ruptures",
    "river",
)
CPU_INFO: Final = Path("/proc/cpuinfo")


def describe_machine() -> dict[str, str]:
    """Return processor, load and versions, by name."""
    described = {"processor": f"{_processor()}, {os.cpu_count()} cores"}
    if hasattr(os, "getloadavg"):
        described["load"] = f"{os.getloadavg()[0]:.1f} at the start"
    described["system"] = platform.system()
    described["Python"] = platform.python_version()
    described["software"] = SOFTWARE
    for name in PACKAGES:
        try:
            described[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue  # the page says what is missing
    return described


def _processor() -> str:
    if CPU_INFO.exists():
        for line in CPU_INFO.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
