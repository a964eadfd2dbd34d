"""The twenty-fifth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.twentyfifth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifteenth_validation import ramps, smooth
from benchmarks.recordings.ninth_validation import RPM
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.twentieth_validation import less_inertia
from benchmarks.recordings.validation import convert, means, save


def pulses(time: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times and speeds from one pulse a turn, over `least` seconds (or a turn) each.

    Some pulses are lost at speed: turns are counted backwards from the end, where none is, by the speed that follows.
    """
    turns, pace = np.zeros(time.size), time[-1] - time[-2]
    for k in range(time.size - 2, -1, -1):
        step = time[k + 1] - time[k]
        count = max(round(step / pace), 1)
        turns[k] = turns[k + 1] - count
        pace = 0.7 * pace + 0.3 * step / count if k < time.size - 4 else step / count
    rows = [0]
    for k in range(1, time.size):
        if time[k] - time[rows[-1]] >= least:
            rows.append(k)
    t, angle = time[rows], 2 * np.pi * turns[rows]
    return (t[1:] + t[:-1]) / 2, np.diff(angle) / np.diff(t)


def braked_discs(mirrors: Path, out: Path) -> None:
    """From T-02-Physics-Project/Magnetic-Braking-Project (no licence): discs between the poles of a magnet run down.

    A light barrier on an oscilloscope, one pulse a turn; speeds over 0.25 to 1 s at least (`least`), from 0.93 of the
    highest on. Discs of 0.15 m radius: aluminium (`disc`, the thick one `disc_thick`), brass and steel without a
    current in the magnet, which keeps some field, and aluminium with 0.47 and 0.98 A (in the names); `_other`: once
    more. J of data_process.py.
    """
    for name, file, least, inertia in (
        ("disc", "al01", 0.4, 2.24e-3),
        ("disc_other", "al02", 0.4, 2.24e-3),
        ("disc_47", "al047a", 0.25, 2.24e-3),
        ("disc_47_other", "al047b", 0.25, 2.24e-3),
        ("disc_98", "al098a", 0.25, 2.24e-3),
        ("disc_thick", "alth01", 0.6, 4.74e-3),
        ("disc_thick_other", "alth02", 0.6, 4.74e-3),
        ("disc_thick_47", "alth047a", 0.25, 4.74e-3),
        ("disc_thick_98", "alth098a", 0.25, 4.74e-3),
        ("disc_brass", "br01", 1.0, 6.13e-3),
        ("disc_brass_other", "br02", 1.0, 6.13e-3),
        ("disc_steel", "st01", 1.0, 6.58e-3),
    ):
        path = f"analysis/data/high_velocity/{file}.csv"
        repo = "T-02-Physics-Project/Magnetic-Braking-Project"
        log = git_table(mirrors, repo, path, delimiter=",", skip_header=2, usecols=(0, 1))
        log = log[np.isfinite(log[:, 1])]
        low = log[:, 1] < 20.0
        turn = log[1:, 0][low[1:] & ~low[:-1]]
        time, speed = pulses(turn[np.append(True, np.diff(turn) > 0.025)], least)
        first = int(np.flatnonzero(speed > 0.93 * speed.max())[-1]) + 1
        columns = {"time_s": time[first:], "speed_rad_s": speed[first:]}
        save(out, name, columns, {"inertia_kg_m2": inertia}, True, 0.1)


def dual_rotor(mirrors: Path, out: Path) -> None:
    """From finnferdinand/orbital-stabilization-quanser-aero (no licence): a body with two rotors on a gimbal (Quanser).

    500 Hz. `gimbal_yaw`: its vertical axis runs down after a push, `gimbal_yaw_short`: after one of its rotors, speeds,
    means of 25 and 10 rows; `rotor_front`, `rotor_side`: its rotors run down at 0 V, speeds, means of 4 rows to 3
    rad/s, J = 1. `gimbal_pitch`: its level axis swings, angle low-pass filtered at 4 Hz, J = 1, friction = −dω/dt − k
    sin angle + what it is at rest, both by least squares beside dry and viscous friction, means of 20 rows.
    """

    def log(path: str) -> np.ndarray:
        file = f"Chapter 4 - Control of Dual-Rotor Plant/{path}.mat"
        data = io.BytesIO(fetch(mirrors, "finnferdinand/orbital-stabilization-quanser-aero", file))
        scope = loadmat(data)  # type: ignore[arg-type]
        return np.asarray(next(v for k, v in scope.items() if not k.startswith("__")), dtype=float)

    for name, path, row, first, last, lowest, count in (
        ("gimbal_yaw", "Dynamic Coupling/data/locked_pitch/yaw_speed", 1, 5.6, 20.0, 0.1, 25),
        ("gimbal_yaw_short", "Yaw Coefficients/data/yaw_speed", 1, 2.9, 9.0, 0.05, 10),
        ("rotor_front", "Model Verification/data/motor_speeds", 1, 15.04, 20.0, 3.0, 4),
        ("rotor_side", "Model Verification/data/motor_speeds", 2, 25.04, 30.0, 3.0, 4),
    ):
        rows = log(path)
        time, speed = (x[(rows[0] >= first) & (rows[0] < last)] for x in (rows[0], rows[row]))
        end = int(np.flatnonzero(speed < lowest)[0])
        t, v = means(count, time[:end], speed[:end])
        save(out, name, {"time_s": t, "speed_rad_s": v}, {"inertia_kg_m2": 1.0}, True, lowest / 2)
    time, place = log("Pitch Coefficients/data/pitch")
    angle = smooth(500.0, 4.0, place)
    speed = np.gradient(angle, 1 / 500)
    on = (time >= 3.5) & (time < 21.5)
    t, turned, v, f = means(20, *(x[on] for x in (time, angle, speed, -np.gradient(speed, 1 / 500))))
    terms = np.column_stack([np.sin(turned), np.ones_like(v), v, np.sign(v)])
    f -= terms[:, :2] @ np.linalg.lstsq(terms, f, rcond=None)[0][:2]
    columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned - turned.mean()}
    save(out, "gimbal_pitch", columns, dead_band=0.02)


def other_despinner(mirrors: Path, out: Path) -> None:
    """From i-Abdullah/ASEN2003-Lab-5-Yo-Yo-Despinner (no licence): turntable of a yo-yo despinner runs down.

    Another group and day than in the ninth set; speed at 100 Hz in rpm (its clock starts anew when it is let go), means
    of 20 rows, from 0.5 s after that to 4 rpm. J as there.
    """
    repo = "i-Abdullah/ASEN2003-Lab-5-Yo-Yo-Despinner"
    log = git_table(mirrors, repo, "YoYo_noweight", comments="%")
    log = log[int(np.flatnonzero(np.diff(log[:, 0]) < 0.0)[-1]) + 51 :]
    log = log[: int(np.flatnonzero(log[:, 1] < 4.0)[0])]
    t, v = means(20, log[:, 0] / 1e3, RPM * log[:, 1])
    save(out, "despinner_later", {"time_s": t, "speed_rad_s": v}, {"inertia_kg_m2": 0.0483}, True, 0.1)


def lab_arm(mirrors: Path, out: Path) -> None:
    """From mjoel00/ASEN-2003 (no licence), lab 5: a rigid arm on a geared motor, to and fro between two angles.

    Another group and year than in the ninth set; 1 kHz, volts of its motor (stand for the torque, what it induces is
    its viscous part) and angle of the hub, of which the speed, both low-pass filtered at 20 Hz, friction = volts − J
    dω/dt, J by least squares beside dry and viscous friction and an offset, means of 5 rows where it moves.
    """
    log = git_table(mirrors, "mjoel00/ASEN-2003", "2003 Lab 5/test_1", comments="%")
    v, f = less_inertia(1000.0, log[:, 6], np.gradient(log[:, 1], 1e-3), 20.0, 0.2)
    near = np.convolve(np.abs(v) > 0.1, np.ones(41), "same") > 0
    t, v, f = means(5, *(x[near] for x in (log[:, 0] / 1e3, v, f)))
    save(out, "lab_arm", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=0.2)


def cubli_frame(mirrors: Path, out: Path) -> None:
    """From AodhAnd/p6-cubli-main (no licence): frame of a cube that balances on an edge, hanging and swinging.

    400 Hz, angle (potentiometer, 3.282 rad/V; ParameterEstimationNewtonCubli.m), low-pass filtered at 4 Hz, J = 1,
    friction = −dω/dt − k angle + what it is at rest, both by least squares beside dry and viscous friction, for 2.6 s
    from 0.3 s on, means of four rows.
    """
    path = "Matlab/ParameterEstimationNewtonCubli/PRINT_03.CSV"
    time, volts = git_table(mirrors, "AodhAnd/p6-cubli-main", path, delimiter=",").T
    angle = smooth(400.0, 4.0, 3.282 * volts)
    speed = np.gradient(angle, 1 / 400)
    on = (time >= -4.7) & (time < -2.1)
    t, turned, v, f = means(4, *(x[on] for x in (time, angle, speed, -np.gradient(speed, 1 / 400))))
    terms = np.column_stack([turned, np.ones_like(v), v, np.sign(v)])
    f -= terms[:, :2] @ np.linalg.lstsq(terms, f, rcond=None)[0][:2]
    columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned - turned.mean()}
    save(out, "cubli_frame", columns, dead_band=0.05)


def more_shooters(mirrors: Path, out: Path) -> None:
    """From two teams of robots (no licence): flywheels of ball shooters under a voltage in slow ramps, 200 Hz.

    As in `fifteenth_validation`: volts stand for the torque (what the turning motor induces is its viscous part),
    speed in turns/s, low-pass filtered at 5 Hz, friction = volts − J dω/dt, J by least squares beside dry and viscous
    friction and an offset, means of 20 rows, the first and last three of each ramp left out. `flywheel`,
    `flywheel_next`: STMARobotics/frc-7028-2022 on two days, `flywheel_other`: AEMBOT/FRC_2022 (two of its runs are
    called by other names).
    """
    stma, slow = "STMARobotics/frc-7028-2022", ("slow-forward", "slow-backward")
    for name, repo, file, runs, lowest in (
        ("flywheel", stma, "sysid/ShooterData/sysid_data20220309-190419.json", slow, 3.0),
        ("flywheel_next", stma, "sysid/ShooterData/sysid_data20220310-162111.json", slow, 3.0),
        ("flywheel_other", "AEMBOT/FRC_2022", "sysid/shooter.json", ("slow-backward", "fast-forward"), 3.0),
    ):
        logs = json.loads(fetch(mirrors, repo, file))
        save(out, name, ramps([logs[run] for run in runs], (1, 3), 1.0, 5.0, 20, lowest), dead_band=lowest)


ALL = (braked_discs, dual_rotor, other_despinner, lab_arm, cubli_frame, more_shooters)

if __name__ == "__main__":
    convert(ALL)
