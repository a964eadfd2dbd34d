"""Describes the machine that a benchmark ran on, and measures the peak memory of a process."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Final

from rwa_monitor.words import SOFTWARE

PACKAGES: Final = (
    "numpy",
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
BYTES_PER_KIB: Final = 1024


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
            continue  # the page states what is missing
    return described


def machine_in_words() -> str:
    """Return `describe_machine` in one line."""
    return in_words(describe_machine())


def in_words(named: Mapping[str, object]) -> str:
    """Return names and values in one line."""
    return ", ".join(f"{name} {value}" for name, value in named.items())


def peak_memory_bytes(process: int | str = "self") -> int:
    """Return the largest resident memory that a process, by its number, has had so far; Linux only.

    The `ru_maxrss` of `getrusage` differs: a child process inherits the largest memory of its parent
    (`setmax_mm_hiwater_rss` at the exec of Linux).
    """
    for line in Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines():
        name, _, size = line.partition(":")
        if name == "VmHWM":
            return int(size.split()[0]) * BYTES_PER_KIB
    raise ProcessLookupError(f"process {process} has ended")


def _processor() -> str:
    if CPU_INFO.exists():
        for line in CPU_INFO.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
