"""What the processes of a search begin with: its modules, and its loops as they are compiled.

Imported by the process that they are forked from and by nobody else: importing it makes a short search, by which all
loops are loaded once, where each process would take half a second and 100 MB to load its own.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.physics.scenario import Scenario
from rwa_monitor.physics.speed import SpeedProfile
from rwa_monitor.physics.telemetry import simulate
from rwa_monitor.physics.wheel import built_in_wheel
from rwa_monitor.threads import one_thread_of_algebra

SAMPLES: Final = 400  # as few as a search takes


def _search() -> None:
    """Search a short record of a wheel."""
    wheel = built_in_wheel()
    scenario = Scenario(duration_s=SAMPLES * wheel.sample_period_s, speed=SpeedProfile(kind="rich"), anomalies={})
    record = simulate(scenario, wheel, np.random.default_rng(1)).samples
    with one_thread_of_algebra():  # a process that is forked must have no other thread
        find_discrepancy([("record", record)], wheel)


_search()
