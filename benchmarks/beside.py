"""Measures the load of other processes on the machine during a benchmark, so that its page can state it."""

from __future__ import annotations

import time

import psutil


class Beside:
    """Counts the processor time spent by neither this process nor those that it started, since its creation."""

    def __init__(self) -> None:
        self._began_s, self._other_s = time.monotonic(), _other_s()

    def cores(self) -> float:
        """Return how many processors other processes have kept busy since then, on average."""
        return max(0.0, _other_s() - self._other_s) / (time.monotonic() - self._began_s)


def _other_s() -> float:
    this = psutil.Process()
    own = 0.0
    for process in (this, *this.children(recursive=True)):
        times = process.cpu_times()
        own += times.user + times.system + times.children_user + times.children_system
    of_all = psutil.cpu_times()
    return float(of_all.user + of_all.nice + of_all.system + of_all.irq + of_all.softirq + of_all.steal) - own
