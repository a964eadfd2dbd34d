"""The twenty-second set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.twentysecond_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifteenth_validation import even, smooth
from benchmarks.recordings.ninth_validation import RPM
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.twentieth_validation import less_inertia
from benchmarks.recordings.validation import convert, means, save, slope


def magnetic_rower(mirrors: Path, out: Path) -> None:
    """From Abasz/ESPRowingMonitor (GPL-3.0): flywheel of a rowing machine that magnets brake, between two pulls.

    Kettler Stroker; the file holds the times between pulses, four a turn, J = 0.0293 kg m². Speed over a whole turn (so
    that the spacing of the pulses cancels); from two turns after the fastest of a stroke to half a turn before the next
    pull, where it turns faster than 6 rad/s, friction = −J dω/dt, the slope of a parabola over five rows. Steady rowing
    (`stroker_row`, `stroker_row_later`: from the 100th and the 14,000th pulse on, 35 strokes each, every second pulse)
    and the two weakest settings of the magnets (`stroker_first`, `stroker_second`: from one second to another, every
    pulse).
    """
    for name, file, first, last, step in (
        ("row", "steady-averagelevel-408", 100, 13000, 2),
        ("row_later", "steady-averagelevel-408", 14000, 20000, 2),
        ("first", "5strokes-perlevel-36", 0.0, 23.0, 1),
        ("second", "5strokes-perlevel-36", 23.0, 44.5, 1),
    ):
        text = fetch(mirrors, "Abasz/ESPRowingMonitor", f"test/calibration/kettlerStroker/{file}-test.txt")
        pulse = np.cumsum(np.array(text.split(), dtype=float)[2:]) / 1e6
        pulse = pulse[first:last] if isinstance(first, int) else pulse[(pulse > first) & (pulse < last)]
        time, speed = (pulse[4:] + pulse[:-4])[::step] / 2, 2 * np.pi / (pulse[4:] - pulse[:-4])[::step]
        falls = (np.diff(speed, append=speed[-1]) < 0) & (speed > 6.0)
        turning = np.flatnonzero(np.diff(np.concatenate([[False], falls, [False]]).astype(int)))
        parts: list[np.ndarray] = []
        for begin, end in zip(turning[::2] + 8 // step, turning[1::2] - 2 // step, strict=True):
            if end - begin > 6 and len(parts) < 35:
                rows, rate = slope(time[begin:end], speed[begin:end], 2)
                parts.append(np.column_stack([time[begin + rows], speed[begin + rows], -0.0293 * rate]))
        t, v, f = np.concatenate(parts).T
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
        save(out, f"stroker_{name}", columns, {"inertia_kg_m2": 0.0293})


def still_joints(mirrors: Path, out: Path) -> None:
    """From igricart/FrictionIdentification (no licence): joints of a positioner under a torque too small to turn them.

    Joint position in steps of 2.4e-5 rad and torque, about 330 Hz; made even at 330 Hz, low-pass filtered,
    means, a dead band of a twentieth of the fastest; friction = torque (they hardly speed up). `still_yaw`: a growing
    sine to 0.4 N m, from 250 s on, 1 Hz and 33 rows (file of an earlier commit); `still_pitch`: a sine of 0.36 N m, 5
    Hz and 7 rows.
    """
    for file, joint, first, last, cut, count in (
        ("dyn-friction-sine-yaw.mat", "yaw", 250.0, 432.0, 1.0, 33),
        ("Digital_Filter/pitch_torque.mat", "pitch", 137.0, 169.0, 5.0, 7),
    ):
        commit = "1a8627caf72ac27a0f66d7e896d7d0271da0c9e6" if joint == "yaw" else "HEAD"
        data = io.BytesIO(fetch(mirrors, "igricart/FrictionIdentification", file, commit))
        joints = loadmat(data, simplify_cells=True)  # type: ignore[arg-type]
        log = joints[f"{joint}_motor_r"]["joints_state_samples"]
        rows = min(len(log[key]) for key in ("time", "position", "effort"))
        clock, place, torque = (np.asarray(log[key][:rows], dtype=float) for key in ("time", "position", "effort"))
        time, angle, drive = even(330.0, clock - clock[0], place, torque)
        angle, drive = smooth(330.0, cut, angle), smooth(330.0, cut, drive)
        on = (time > first) & (time < last)
        t, v, f, turned = means(count, *(x[on] for x in (time, np.gradient(angle, 1 / 330), drive, angle)))
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned - turned[0]}
        save(out, f"still_{joint}", columns, dead_band=float(f"{0.05 * np.abs(v).max():.3g}"))


def master_arm(mirrors: Path, out: Path) -> None:
    """From WPI-AIM/dvrk_dynamics_identification (no licence): the master's arm of a da Vinci research kit.

    Another arm than that of the seventh set (a hand moves this one); joints on an exciting path (mtm, one_results),
    `master_roll_other` on another (two_results); torque from the current, angle and speed, 200 Hz, low-pass filtered at
    5 Hz, means of 6 rows, 0.05 rad/s the dead band. Gravity (all but the last) is not taken off.
    """
    for name, file, joint in (
        ("platform", "one", 4),
        ("pitch", "one", 5),
        ("yaw", "one", 6),
        ("roll", "one", 7),
        ("roll_other", "two", 7),
    ):
        path = f"data/mtm/measured_trajectory/{file}_results.csv"
        log = git_table(mirrors, "WPI-AIM/dvrk_dynamics_identification", path, delimiter=",")
        v, f = (smooth(200.0, 5.0, log[:, k + joint]) for k in (6, 13))
        t, v, f, turned = means(6, *(x[40:-40] for x in (0.005 * np.arange(v.size), v, f, log[:, joint - 1])))
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned}
        save(out, f"master_{name}", columns, dead_band=0.05)


def tyres(mirrors: Path, out: Path) -> None:
    """From hpvdt/rolling_resistance_rig (no licence): bicycle tyres pressed on a drum that runs down with them.

    The development's set has the same drum alone. One row a turn of the drum, from three after the last of the fastest
    to 3 rad/s, those left out whose ratio to the wheel's rate is 2 % off the usual; J = 10 (arbitrary). In the names:
    which way it turns and the pressure of the tyre (psi); four tyres, the first two the same.
    """
    for name, file in (
        ("tyre_left_70", "Greenspeed Scorcher - Contact - Left - 70"),
        ("tyre_left_100", "Greenspeed Scorcher - Contact - Left - 100"),
        ("tyre_right_60", "Michelin 44-406 - Contact - Right - 60"),
        ("tyre_left_110", "Grandprix - Contact - Left - 110"),
        ("tyre_left_50", "Michelin 4575r16 - Contact - Left - 50"),
    ):
        data = fetch(mirrors, "hpvdt/rolling_resistance_rig", f"analysis/data/aero/{file} psi.csv")
        log = np.genfromtxt(io.BytesIO(data), delimiter=",", invalid_raise=False)
        log = log[np.isfinite(log).all(1)]
        counted = np.flatnonzero(np.diff(log[:, 2]) == 1) + 1
        counted = counted[np.diff(log[counted, 0], prepend=0.0) > 0.0]
        turn = log[counted, 0] / 1e6
        time, speed = (turn[1:] + turn[:-1]) / 2, 2 * np.pi / np.diff(turn)
        ratio = speed / np.maximum(log[counted[1:], 3], 0.1)
        fine = (np.abs(ratio / np.median(ratio) - 1.0) < 0.02) & (speed > 3.0)
        fine[: np.flatnonzero(fine & (speed > 0.995 * speed[fine].max()))[-1] + 3] = False
        columns = {"time_s": time[fine], "speed_rad_s": speed[fine]}
        save(out, name, columns, {"inertia_kg_m2": 10.0}, motor_off=True)


def gel(mirrors: Path, out: Path) -> None:
    """From krlennon/rheology-health-monitoring (GPL-3.0): a gel between two plates under three sines of torque at once.

    TA rheometer, 30.5 Hz; torque (µN m) and angle (mrad), from 70 s on, when what the start left has died down, to the
    end, low-pass filtered at 3 Hz, J of the rotor by least squares, means of six rows. `gel_weak`: 0.05 Pa,
    `gel_strong`: 0.1 Pa, `gel_strong_later`: the same half an hour later, the gel stiffer.
    """
    for name, file in (("weak", "005Pa_02rads_3"), ("strong", "01Pa_02rads_2"), ("strong_later", "01Pa_02rads_8")):
        path = f"data/maps/maps_{file}.csv"
        log = git_table(mirrors, "krlennon/rheology-health-monitoring", path, delimiter=",")
        time, angle, torque = even(30.5, log[:, 3], log[:, 0], log[:, 8])
        time, angle, torque = time[time > 65.0], angle[time > 65.0], torque[time > 65.0]
        v, f = less_inertia(30.5, torque, np.gradient(smooth(30.5, 3.0, angle), 1 / 30.5), 3.0, 0.0)
        t, v, f = means(6, *(x[150:-20] for x in (time, v, f)))
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
        save(out, f"gel_{name}", columns)


def bobs(mirrors: Path, out: Path) -> None:
    """From Mark-Pirner/PHY180-REPORTS-DATA (no licence) and YYZ-CR/PHY180 (MIT): bobs on threads that swing freely.

    Amplitudes with the time of each, filmed; as in the twenty-first set: speed = the mean over a swing of period T,
    4 √(2 (1 − cos a))/T, J = T²/16 (in terms of m g l). `bob_half`: from 0.5 rad, T = 1.555 s; `bob_short`: another
    thread than that of the eighth set, 212 mm, T = 0.934 s.
    """
    repo, path = "YYZ-CR/PHY180", "lab 2/212mm sorted_angle_vs_time.txt"
    half = git_table(mirrors, "Mark-Pirner/PHY180-REPORTS-DATA", "physlab2TvsTHETA.txt", skip_header=1)
    short = git_table(mirrors, repo, path, delimiter="\t", skip_header=1)
    for name, log, period in (("half", half, 1.555), ("short", short, 0.934)):
        time, angle = log[np.argsort(log[:, 0]), :2].T
        speed = 4.0 * np.sqrt(2.0 - 2.0 * np.cos(np.abs(angle))) / period
        columns = {"time_s": time, "speed_rad_s": speed}
        save(out, f"bob_{name}", columns, {"inertia_kg_m2": period**2 / 16}, motor_off=True)


def ruler_robot(mirrors: Path, out: Path) -> None:
    """From ryanGT/systemid (no licence): a motor that swings a steel ruler to and fro, which bends and springs back.

    500 Hz, drive (−255 to 255) and angle (counts of its encoder), low-pass filtered at 15 Hz; friction = drive −
    J dω/dt, J by least squares; means of four rows, a dead band of 20 counts/s. `ruler_sweep`, `ruler_sweep_again`: a
    sine of growing frequency; `ruler_sine`: one of 5 Hz.
    """
    for name, file in (("sweep", "swept1-0-10hz"), ("sweep_again", "swept5-0-10hz"), ("sine", "fixed1-5hz")):
        log = git_table(mirrors, "ryanGT/systemid", f"example/2009-04-21/{file}.txt", skip_header=2)
        angle = smooth(500.0, 15.0, log[:, 4])
        v, f = less_inertia(500.0, log[:, 3], np.gradient(angle, 1 / 500), 15.0, 20.0)
        t, v, f = means(4, *(x[50:-20] for x in (log[:, 0], v, f)))
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
        save(out, f"ruler_{name}", columns, dead_band=20.0)


def small_copter_motor(mirrors: Path, out: Path) -> None:
    """From alspitz/esc_test (MIT): another motor than in the second set with its propeller, levels of its duty.

    The controller (ESC32) tells current, voltage and speed; torque = power over speed (the motor's losses in it). Means
    of 20 rows of a level, its first 20 left out, above 1000 rpm.
    """
    text = fetch(mirrors, "alspitz/esc_test", "data/autoquad/f40_steps_5-2.csv").decode()
    log = [row for row in csv.reader(io.StringIO(text)) if row[0][:2] == "20"]
    clock = np.array([np.dot([3600, 60, 1, 1e-3], [int(x) for x in re.split("[ :]", row[0])[1:]]) for row in log])
    amperes, volts, turns, duty = (np.array([float(row[k]) for row in log]) for k in (1, 2, 4, 5))
    rows = [
        np.array(means(20, *(x[part[20:]] for x in (clock, RPM * turns, volts * amperes))))
        for part in np.split(np.arange(duty.size), np.flatnonzero(np.diff(duty)) + 1)
        if part.size > 60 and turns[part].min() > 1000.0
    ]
    t, v, power = np.concatenate(rows, axis=1)
    save(out, "small_copter", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": power / v})


ALL = (magnetic_rower, still_joints, master_arm, tyres, gel, bobs, ruler_robot, small_copter_motor)

if __name__ == "__main__":
    convert(ALL)
