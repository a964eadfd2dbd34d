"""What the service and `doctor` compile beforehand is all that a file or the bus will ask for."""

from __future__ import annotations

import subprocess
import sys

CODE = """
import numpy as np
from numba.core.dispatcher import Dispatcher

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.live.core import diagnose_samples
from rwa_monitor.live.rebuild import Setup
from rwa_monitor.live.warm_up import warm_up
from rwa_monitor.live.wheel_set import WheelSet
from rwa_monitor.physics.scenario import Scenario
from rwa_monitor.physics.telemetry import simulate
from rwa_monitor.physics.wheel import built_in_wheel
from rwa_monitor.samples import Samples
import gc

def compiled():
    kernels = [one for one in gc.get_objects() if isinstance(one, Dispatcher)]
    own = [one for one in kernels if one.py_func.__module__.startswith("rwa_monitor.")]
    return {(one.py_func.__module__, one.py_func.__name__, str(kind)) for one in own for kind in one.signatures}

wheel, model = built_in_wheel(), built_in_model()
for friction_given in (True, False):
    scenario = Scenario(duration_s=2_000.0, friction_given=friction_given)
    channels = dict(simulate(scenario, wheel, np.random.default_rng(61)).samples.channels())
    if friction_given:
        warm_up(Setup(WheelSet(wheel), model, "joint"))
        before = compiled()
        assert len(before) > 50, before
    channels["speed_rad_s"][100:103] = np.nan  # what is masked
    for writable in (True, False):  # as a message, as a file
        for values in channels.values():
            values.setflags(write=writable)
        assert list(diagnose_samples(Samples(**channels), wheel, model))
for new in sorted(compiled() - before):
    print(*new)
"""


def test_nothing_is_left_to_compile_when_samples_come() -> None:
    # In a process of its own: in this one other tests have compiled much already.
    done = subprocess.run([sys.executable, "-c", CODE], check=True, capture_output=True, text=True)
    assert done.stdout == ""
