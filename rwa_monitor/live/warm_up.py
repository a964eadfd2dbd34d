"""Compiles what the core needs, before samples wait for it.

The kernels of the diagnosis are compiled when they are first called, and then kept on disk: once for each kind of array
that they are called with. On a new machine this takes a minute or two, in which a service would neither hear its stop
signal nor take samples, and the compiler some 500 MB, which a process does not give back. So a service has it done by
another one (`prepare`) and loads from the disk what that has compiled, which takes a second and 100 MB.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numba.core import event

from rwa_monitor.diagnosis.model import Model, built_in_model
from rwa_monitor.live.core import WheelCore
from rwa_monitor.live.rebuild import Setup
from rwa_monitor.live.wheel_set import WheelSet
from rwa_monitor.physics.wheel import Wheel, built_in_wheel
from rwa_monitor.samples import Samples

WINDOW_SLOTS: Final = 2_048
WINDOWS: Final = 2  # the second one has a state carried over from the first
COMPILING: Final = "numba:compile"  # numba's event around each compilation; there is none for what it loads
STOP_HEARD_S: Final = 0.1  # how soon the compiling process is ended when nobody waits for it any more
SETUP_ON_STDIN: Final = "-"


def prepare(setup: Setup, stop: threading.Event) -> None:
    """Warm up as `warm_up` does; what is not compiled yet is compiled by a process whose memory ends with it.

    Parameters
    ----------
    setup
        What samples will be diagnosed with.
    stop
        Ends it early when set.
    """
    try:
        with event.install_listener(COMPILING, _Refusal()):
            warm_up(setup)
    except _NotCompiledError:
        compile_in_child(setup, stop)
        if not stop.is_set():
            # All is on the disk now. If not (no process may be started, or it had too little memory), it is compiled
            # here after all.
            warm_up(setup)


class _NotCompiledError(Exception):
    """A kernel is not on the disk."""


class _Refusal(event.Listener):
    """Lets no kernel be compiled in the thread that made it; others may."""

    def __init__(self) -> None:
        self.thread = threading.get_ident()

    def on_start(self, compilation: Any) -> None:
        """Stop before the compiler begins."""
        if threading.get_ident() == self.thread:
            raise _NotCompiledError(compilation.data)

    def on_end(self, compilation: Any) -> None:
        """Nothing was compiled."""


def compile_in_child(setup: Setup, stop: threading.Event) -> None:
    """Warm up in a process of its own, which leaves the kernels on the disk; ended early where `stop` is set."""
    text = json.dumps(
        {
            "wheel": setup.wheels.common.to_toml(),
            "model": setup.model.to_json() if setup.model else "",
            "method": setup.method,
        }
    )
    # The same packages as here, and none out of the working folder that are not found here either (-P).
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path or str(Path.cwd()) for path in sys.path)}
    command = [sys.executable, "-P", "-m", "rwa_monitor.live.warm_up", SETUP_ON_STDIN]
    quiet = subprocess.DEVNULL
    with (
        suppress(OSError),  # no process can be started, or it ended at once
        # Nothing in the command comes from outside.
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=quiet, stderr=quiet, env=environment) as child,  # noqa: S603
    ):
        try:
            assert child.stdin is not None
            with child.stdin as pipe:
                pipe.write(text.encode())
            while child.poll() is None:
                # Who listens for compilations, to tell of them, hears of this one too.
                with event.trigger_event(COMPILING):
                    stopped = stop.wait(STOP_HEARD_S)
                if stopped:
                    return
        finally:
            child.kill()  # nothing where it has ended


def warm_up(setup: Setup) -> None:
    """Diagnose short made-up windows with a jump in each, and forget about them.

    The arrays of a message may be written to, those of a file may not, which makes them another kind for the compiler:
    the second window's are such. Both windows come in two parts, one clean and one with something to mask. Where the
    wheel's constants allow it, friction is derived, too.
    """
    wheel = setup.wheels.common
    short = wheel.model_copy(
        update={"window": wheel.window.model_copy(update={"samples": WINDOW_SLOTS, "hop": WINDOW_SLOTS})}
    )
    slot = np.arange(WINDOWS * WINDOW_SLOTS + 1)
    # Any smooth speed will do, and anything uneven for noise: 2 % of the dry torque, and a jump of half of it.
    speed = wheel.speed_unit_rad_s * (0.5 + 0.1 * np.sin(slot / 300.0))
    uneven = np.sin(slot * slot % 997.0)
    level = np.where(slot % WINDOW_SLOTS < WINDOW_SLOTS // 2, 1.0, 1.5)
    torque = wheel.torque_unit_Nm * (level + speed / wheel.speed_unit_rad_s + 0.02 * uneven)
    speed[WINDOW_SLOTS - 20 :: WINDOW_SLOTS] = np.nan
    speed[WINDOW_SLOTS - 10 :: WINDOW_SLOTS] = 1e9
    samples = Samples(time_ns=slot * short.period_ns, speed_rad_s=speed, friction_torque_Nm=torque)
    _diagnose(short, setup, samples)
    if short.inertia_kg_m2 is not None and short.torque_constant_Nm_A is not None:
        derived = replace(samples, friction_torque_Nm=None, motor_current_A=torque / short.torque_constant_Nm_A)
        _diagnose(short, setup, derived)


def _diagnose(wheel: Wheel, setup: Setup, samples: Samples) -> None:
    core = WheelCore(wheel, setup.model, method=setup.method)
    for first in range(0, len(samples), WINDOW_SLOTS // 2):
        part = samples[first : first + WINDOW_SLOTS // 2]
        core.feed(part if first < WINDOW_SLOTS else _read_only(part))
    core.finish()


def _read_only(samples: Samples) -> Samples:
    """Return a copy that cannot be written to."""
    copy = samples[np.arange(len(samples))]
    for _, values in copy.channels():
        values.setflags(write=False)
    return copy


def _main(arguments: list[str]) -> None:
    """Compile what the built-in wheel and model need, or what the setup on the standard input does (`prepare`)."""
    if SETUP_ON_STDIN not in arguments:
        warm_up(Setup(WheelSet(built_in_wheel()), built_in_model(), "joint"))
        return
    given = json.load(sys.stdin)
    wheel = Wheel.from_toml(given["wheel"], "wheel")
    model = Model.from_json(given["model"], "model") if given["model"] else None
    warm_up(Setup(WheelSet(wheel), model, given["method"]))


if __name__ == "__main__":  # when an image is built, and as the child of a service
    _main(sys.argv[1:])
