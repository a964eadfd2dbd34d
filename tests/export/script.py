"""The script on which exported models are compared with the package's own simulation, and how C is run on it."""

import ctypes
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from rwa_monitor.export import FORMATS
from rwa_monitor.export.model import friction_model
from rwa_monitor.samples import FloatArray
from rwa_monitor.simulation import record
from rwa_monitor.simulation.motion import Motion, wheel_angle
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.wheel import EffectBlock, Wheel, built_in_wheel

WARNINGS = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wdouble-promotion"]
STRICT = ["-std=c99", *WARNINGS, "-O2", "-ffp-contract=off"]
DURATION_S = 10_000.0
# Speed [rad/s] at times [s]: from rest, both ways, slow and fast crossings, rests within, to the nominal speed.
NODES_S = [0, 300, 700, 1500, 1900, 2200, 2300, 2900, 3000, 3600, 4200, 4230, 5200, 6000, 6600, 7400, 8200, 9000, 10000]
NODES_RAD_S = [0, 0, 40, 300, 300, -120, -120, 0, 0, 5, -5, 60, -60, -300, -300, 0, 0, 150, -20]
HARNESS = """
#include "rwa_friction.h"
void run(long rows, const double *in, double dt_s, double *out)
{
    rwa_friction_state state;
    long i;
    rwa_friction_init(&state);
    for (i = 0; i < rows; ++i, in += 5) {
        state.dry_level_Nm = in[4];
        out[i] = rwa_friction_torque(&state, in[0], in[1], in[2], in[3], dt_s);
    }
}
"""


@dataclass(frozen=True)
class Script:
    """What the package simulates: the model's inputs and the dry level, float64 (n, 5), and the torque."""

    inputs: FloatArray
    torque_Nm: FloatArray
    period_s: float


def wheel_with(*effects: EffectBlock) -> Wheel:
    """Return the built-in wheel with effects, and jumps as often as the script can hold."""
    wheel = built_in_wheel()
    tables = wheel.to_tables()
    for system in tables["fss"]:
        system["durations"] = [{"law": "geometric", "mean": 3000.0} for _ in system["durations"]]
    return Wheel.from_tables(tables, "test").model_copy(update={"effect": effects})


@cache
def motion(period_s: float) -> Motion:
    """Return the script's motion."""
    time = np.arange(round(DURATION_S / period_s)) * period_s
    speed = np.interp(time, NODES_S, NODES_RAD_S)
    return Motion(speed, np.gradient(speed, period_s))


def simulated(wheel: Wheel) -> Script:
    """Return the script as the package simulates the wheel on it."""
    moved = motion(wheel.sample_period_s)
    streams = record._Streams(*np.random.default_rng(7).spawn(len(record._Streams._fields)))
    scenario = Scenario(duration_s=DURATION_S)
    parts = record._friction_parts(scenario, wheel, moved, streams)
    unit = wheel.torque_unit_Nm
    level = parts.base_dry + sum(unit * system.friction for system in parts.systems.values())
    assert np.count_nonzero(np.diff(level)) > 20
    speed, rate = moved.speed_rad_s, moved.acceleration_rad_s2
    assert np.count_nonzero(np.diff(np.sign(speed))) > 8
    assert np.ptp(parts.temperature) > 1.0
    columns = [speed, rate, wheel_angle(speed, wheel.sample_period_s), parts.temperature, level]
    return Script(np.column_stack(columns), parts.friction, wheel.sample_period_s)


def compiled(wheel: Wheel, folder: Path) -> ctypes.CDLL:
    """Write the wheel's C, compile it as strictly as it is promised, and load it with the harness."""
    for name, content in FORMATS["c"](friction_model(wheel, "wheel.toml")).items():
        (folder / name).write_bytes(content)
    (folder / "harness.c").write_text(HARNESS, encoding="utf-8")
    run = ["gcc", *STRICT, "-fPIC", "-shared", "rwa_friction.c", "harness.c", "-lm", "-o", "model.so"]
    done = subprocess.run(run, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(folder / "model.so"))


def run_c(wheel: Wheel, script: Script, folder: Path) -> FloatArray:
    """Return the torque [N m] that the C model gives on the script, float64 (n,)."""
    library = compiled(wheel, folder)
    inputs, out = np.ascontiguousarray(script.inputs), np.empty(len(script.inputs))
    pointer = ctypes.POINTER(ctypes.c_double)
    library.run.argtypes = [ctypes.c_long, pointer, ctypes.c_double, pointer]
    library.run(len(out), inputs.ctypes.data_as(pointer), script.period_s, out.ctypes.data_as(pointer))
    return out


def largest_difference(one: FloatArray, other: FloatArray) -> float:
    """Return the largest relative difference of a sample [-]; what differs by no more than 1e-18 N m is equal."""
    apart = np.abs(one - other)
    return float(np.max(np.where(apart > 1e-18, apart / np.maximum(np.abs(other), 1e-300), 0.0)))
