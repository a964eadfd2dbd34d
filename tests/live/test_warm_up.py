"""What the service and `doctor` compile beforehand is all that a file or the bus will ask for."""

from __future__ import annotations

import subprocess
import sys
from threading import Event

import psutil

from rwa_monitor.live.run_options import RunOptions
from rwa_monitor.live.warm_up import compile_in_child

CODE = """
import numpy as np
from numba.core.dispatcher import Dispatcher

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.live.core import diagnose_samples
from rwa_monitor.live.rebuild import Setup
from rwa_monitor.live.warm_up import prepare
from rwa_monitor.live.wheel_set import WheelSet
from rwa_monitor.physics.scenario import Scenario
from rwa_monitor.physics.telemetry import simulate
from rwa_monitor.physics.wheel import built_in_wheel
from rwa_monitor.samples import Samples
import gc
from threading import Event

def kernels():
    return [one for one in gc.get_objects() if isinstance(one, Dispatcher)]

def compiled():
    own = [one for one in kernels() if one.py_func.__module__.startswith("rwa_monitor.")]
    return {(one.py_func.__module__, one.py_func.__name__, str(kind)) for one in own for kind in one.signatures}

wheel, model = built_in_wheel(), built_in_model()
for friction_given in (True, False):
    scenario = Scenario(duration_s=2_000.0, friction_given=friction_given)
    channels = dict(simulate(scenario, wheel, np.random.default_rng(61)).samples.channels())
    if friction_given:
        prepare(Setup(WheelSet(wheel), model, "joint"), Event())
        before = compiled()
        # Another process has compiled where it was necessary: at most the first kernel was looked for in vain.
        assert sum(sum(one.stats.cache_misses.values()) for one in kernels()) <= 1
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


REFUSED = """
import threading
import numba
from numba.core import event

from rwa_monitor.cli import first_use
from rwa_monitor.live import warm_up

first_use.tell_of_compiling(noticeable_s=0.0)
new = numba.njit(lambda x: x + 1.0)
try:
    with event.install_listener(warm_up.COMPILING, warm_up._Refusal()):
        other = threading.Thread(target=new, args=(1,))
        other.start()
        other.join()
        assert len(new.signatures) == 1, "another thread may compile"
        new(1.0)
except warm_up._NotCompiledError:
    assert len(new.signatures) == 1
    assert new(1.0) == 2.0
    print("refused once")
"""


def test_the_compiler_is_kept_out_of_one_thread_for_as_long_as_is_asked() -> None:
    done = subprocess.run([sys.executable, "-c", REFUSED], check=True, capture_output=True, text=True)
    assert done.stdout == "refused once\n"


def test_the_process_that_compiles_ends_when_nobody_waits_for_it() -> None:
    stop = Event()
    stop.set()
    compile_in_child(RunOptions().setup(), stop)
    # Of processes that other tests have killed some may not be reaped yet: they have no command line any more.
    running = [child for child in psutil.Process().children() if child.status() != psutil.STATUS_ZOMBIE]
    assert not [child for child in running if "rwa_monitor.live.warm_up" in child.cmdline()]
