"""The sixteenth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.sixteenth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from benchmarks.recordings.fifteenth_validation import even, smooth
from benchmarks.recordings.fifth_validation import amplitudes, loss
from benchmarks.recordings.ninth_validation import RPM
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.third_validation import half_swings
from benchmarks.recordings.validation import convert, means, save


def geared_motor(mirrors: Path, out: Path) -> None:
    """From bgkatz/Dyno-Software (MIT): a geared motor on a dynamometer, 200 Hz.

    Torque cell (N m) and speed (rad/s) at its output, motor current in mA, 0.053 N m/A and a gear of 14
    (friction_parser.m); friction = 0.742 N m/A · current − what the cell reads, signs turned so that the speed is
    positive. `gear_drag`: without current, the absorber turns it, 0.5 rad/s more every few seconds from 0.5 to 29
    (means of 40 rows). `gear_ramp_05`, `gear_ramp_10`, `gear_ramp_11`, `gear_ramp_11_long`: 0.5, 1.0 and 1.1 A from 1
    to 23 rad/s, beyond which the voltage is used up; what the motor's own inertia takes is in it (means of ten rows).
    `gear_load_a`, `gear_load_b`: at 4 rad/s under −4 to 4 A, with the motor's temperature (means of 20 rows).
    `gear_free`: the motor turns itself in steps up to 28 rad/s and stays there, for 59 s (means of 20 rows).
    """
    repo = "bgkatz/Dyno-Software"
    log = git_table(mirrors, repo, "Logs/vs_noload_drag.csv", delimiter=",")
    t, f, v = means(40, log[:, 0], -log[:, 1], log[:, 2])
    on = v > 0.5
    save(out, "gear_drag", {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]})
    for name, file, count, current, between in (
        ("gear_ramp_05", "vs_spinup_1", 10, 8, (1.0, 23.0)),
        ("gear_ramp_10", "vs_spinup_2", 10, 8, (1.0, 23.0)),
        ("gear_ramp_11", "vs_spinup_3", 10, 8, (1.0, 23.0)),
        ("gear_ramp_11_long", "vs_spinup_4", 10, 8, (1.0, 23.0)),
        ("gear_load_a", "vs_gearbox_loss", 20, 8, (3.0, 5.0)),
        ("gear_load_b", "vs_gearbox_loss_3", 20, 9, (3.0, 5.0)),
        ("gear_free", "vs_prelim", 20, 8, (0.3, 40.0)),
    ):
        log = git_table(mirrors, repo, f"Logs/{file}.csv", delimiter=",")
        t, cell, v, motor, heat = means(count, log[:, 0], log[:, 1], -log[:, 2], 0.742e-3 * log[:, current], log[:, -1])
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": motor + cell, "motor_torque_Nm": motor}
        on = (v > between[0]) & (v < between[1])
        if "load" in name:
            columns["bearing_temperature_degC"] = heat
        if name == "gear_free":
            on &= t < 163.0
        save(out, name, {key: x[on] for key, x in columns.items()})


def running_down(mirrors: Path, out: Path) -> None:
    """From bgkatz/Dyno-Software (MIT): motors without current as the dynamometer runs down with them, 200 Hz.

    What the torque cell reads (N m) against the speed (rad/s). `down_010`, `down_025`, `down_040`: a motor from 8.5 to
    0.3 rad/s within 6, 14 and 27 s; `down_fast`: one from 84 to 58 rad/s within 11 s (means of 20 rows).
    """
    for name, file, highest, lowest in (
        ("down_010", "2.5V_.01", 8.5, 0.3),
        ("down_025", "2.5V_.025", 8.5, 0.3),
        ("down_040", "2.5V_.04", 8.5, 0.3),
        ("down_fast", "spin_up_v2", 84.0, 58.0),
    ):
        log = git_table(mirrors, "bgkatz/Dyno-Software", f"Logs/{file}.csv", delimiter=",")
        t, cell, v = means(20, *even(200.0, *log[:, :3].T))
        first = int(np.flatnonzero(np.abs(v) > highest)[-1]) + 1
        last = first + int(np.flatnonzero(np.abs(v[first:]) < lowest)[0])
        f = -cell * np.sign(v)
        columns = {"time_s": t, "speed_rad_s": np.abs(v), "friction_torque_Nm": f}
        save(out, name, {key: x[first:last] for key, x in columns.items()})


def joint_motor(mirrors: Path, out: Path) -> None:
    """From priest-yang/Motor-testing (unitree/ under BSD, no other licence): the motor of a robot's joint on a bench.

    Files of earlier commits: motor torque (N m, from its current) and speed (rad/s) as the motor tells them, held by
    another one, its temperature, and a torque cell in volts; friction = motor torque − k · cell, k by least squares
    beside dry and viscous friction. Levels of torque within levels of speed (`joint_slow`: 6 to 30 rad/s, `joint_warm`:
    6 to 65 rad/s) or the other way round (`joint_fast`: to 120 rad/s). The rows have no times: a row a second.
    """
    for name, commit, file in (
        ("joint_slow", "d3a46715f392624371fcb0b804bf28bcf73e692e", "sweep1_DC"),
        ("joint_warm", "81f43a2404f86bb1018aeb4e4abead0966941b2e", "sweep2_DC"),
        ("joint_fast", "e57f48950889fa34d3ddb00a50b0472833c8059e", "sweep5_torque"),
    ):
        text = fetch(mirrors, "priest-yang/Motor-testing", f"unitree/data/{file}.csv", commit).decode()
        rows = [row[1:7] for row in csv.reader(io.StringIO(text)) if len(row) == 7][1:]
        log = np.abs(np.array(rows, dtype=float))
        log = log[(log[:, 3] > 3.0) & (log[:, 3] < 120.0)]
        cell, v, motor, heat = log[:, 2:].T
        k = float(np.linalg.lstsq(np.column_stack([cell, np.ones_like(v), v]), motor, rcond=None)[0][0])
        columns = {
            "time_s": np.arange(v.size, dtype=float),
            "speed_rad_s": v,
            "friction_torque_Nm": motor - k * cell,
            "motor_torque_Nm": motor,
            "bearing_temperature_degC": heat,
        }
        save(out, name, columns)


def swings(mirrors: Path, out: Path) -> None:
    """From macstepien/furuta_pendulum (GPL-3) and 1WorthIte/PHY180-Pendulum-Lab-2025 (no licence): pendulums.

    `furuta_first`, `furuta_second`: the free joint of a pendulum on an arm, which rests, from upright down, 500 Hz,
    encoder in radians; half swings as in `third_validation`, friction in terms of m g l, two runs eight months apart.
    `bob_long`: a filmed one, 60 Hz, from 31 degrees; windows of three swings as in `fifth_validation`.
    """
    for name, file in (("furuta_first", "oscillations"), ("furuta_second", "hardware_pure_joint1_oscillations")):
        path = f"furuta_pendulum_model/data/{file}.csv"
        log = git_table(mirrors, "macstepien/furuta_pendulum", path, delimiter=",", skip_header=1)
        time, angle = even(500.0, log[:, 1], log[:, 6])
        angle = angle - np.median(angle[-1000:])
        first = int(np.flatnonzero(np.diff(np.sign(angle)) != 0)[0])
        save(out, name, half_swings(time[first:], angle[first:], 1.0, 25, 0.03), dead_band=0.05)
    log = git_table(mirrors, "1WorthIte/PHY180-Pendulum-Lab-2025", "pendulum_extended.txt")
    angle = np.deg2rad(log[:, 1] - np.median(log[:, 1]))
    middles = log[np.flatnonzero(np.diff(np.sign(angle)) > 0), 0]
    table = amplitudes(log[:, 0], angle, 3, float(np.median(np.diff(middles))), 0.02)
    save(out, "bob_long", loss(table, 1 - np.cos(table[:, 1])))


def duty_steps(mirrors: Path, out: Path) -> None:
    """From rnd-southerniot/actuator-lab (no licence): a small geared motor under a few levels of the duty, 100 Hz.

    A kick of 0.2, then 0.035, 0.045 or 0.06; duty stands for the torque (what the turning motor induces is its viscous
    part), speed of the encoder in rpm, both low-pass filtered at 5 Hz. Friction = duty − J dω/dt, J by least squares
    beside dry and viscous friction; means of five rows from 2 rad/s, three rows at both ends left out.
    """
    path = "actuators/mg513-gmr-nucleo-f401/docs/sysid/vellow_baseline_20260707_204658.csv"
    log = git_table(mirrors, "rnd-southerniot/actuator-lab", path, delimiter=",", skip_header=1)
    time, turns, duty = even(100.0, log[:, 2] / 1e3, RPM * log[:, 3], log[:, 4])
    speed, duty = smooth(100.0, 5.0, turns), smooth(100.0, 5.0, duty)
    t, v, slope, duty = means(5, time, speed, np.gradient(speed, 0.01), duty)
    on = v > 2.0
    base = np.column_stack([slope, np.ones_like(v), v])
    inertia = float(f"{np.linalg.lstsq(base[on], duty[on], rcond=None)[0][0]:.4g}")
    columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": duty - inertia * slope, "motor_torque_Nm": duty}
    wheel = {"inertia_kg_m2": inertia}
    save(out, "duty_steps", {key: x[on][3:-3] for key, x in columns.items()}, wheel)


ALL = (geared_motor, running_down, joint_motor, swings, duty_steps)

if __name__ == "__main__":
    convert(ALL)
