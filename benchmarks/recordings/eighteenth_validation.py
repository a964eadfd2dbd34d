"""The eighteenth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.eighteenth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifteenth_validation import even, smooth
from benchmarks.recordings.ninth_validation import RPM, sheet
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.validation import convert, means, save


def arm_joints(mirrors: Path, out: Path) -> None:
    """From zubair-irshad/manipulator_parameter_identification (no licence): geared joints of an arm, all moving.

    Two runs of 48 and 33 s along a sum of sines under a current that a controller sets: angle (rad) and measured
    current (A) about every 10 ms, made even at 100 Hz, low-pass filtered at 3 Hz. Current stands for the torque;
    inertia and weight, of a few per cent, are left in. Joints 3, 5, 6 and 7; means of ten rows, half a second left out
    at both ends.
    """
    repo, folder = "zubair-irshad/manipulator_parameter_identification", "29-ArmDataCollection"
    for name, run in (("first", "trainData"), ("second", "testData")):
        keys = ("dataTimeStamp", "dataQ", "dataCur")
        clock, angles, currents = (git_table(mirrors, repo, f"{folder}/{run}/{key}.txt") for key in keys)
        for joint in (3, 5, 6, 7):
            time, angle, current = even(100.0, clock, angles[:, joint - 1], currents[:, joint - 1])
            angle, current = smooth(100.0, 3.0, angle), smooth(100.0, 3.0, current)
            t, v, f, turned = (x[5:-5] for x in means(10, time, np.gradient(angle, 0.01), current, angle))
            columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned}
            save(out, f"arm_{joint}_{name}", columns, dead_band=0.02)


def toy_motors(mirrors: Path, out: Path) -> None:
    """From decadeos/ITMO (no licence): geared motors of a toy (EV3) that turn freely, a duty (%) after the other.

    About 160 Hz: duty, time, speed (degrees/s, the brick's own). Duty stands for the torque (what the turning motor
    induces is its viscous part); from 0.4 s after a duty is set, five seconds from one to the next. `toy_ladder`: −50
    to −10 % (lab2.5), 3 s each, means of 20 rows; `toy_steps`: ±20 to ±100 % (lab1/data…), 1 s each, means of five,
    without 20 %, which is a copy of −20 %; `toy_fast`: ±20 to ±100 % of a faster motor (lab1/lab2), means of eight.
    """
    repo, folder = "decadeos/ITMO", "1_course/VPD/2/LABS"
    steps = [f"lab1/data{duty}" for duty in (-100, -80, -60, -40, -20, 40, 60, 80, 100)]
    for name, files, count in (("ladder", ["lab2/lab2.5"], 20), ("steps", steps, 5), ("fast", ["lab1/lab2"], 8)):
        clock, rows = 0.0, []
        for file in files:
            text = fetch(mirrors, repo, f"{folder}/{file}.csv").decode().replace(";", ",").replace('"', "")
            log = np.genfromtxt(io.StringIO(text), delimiter=",")[:, :3]
            for part in np.split(log, np.flatnonzero(np.diff(log[:, 0]) != 0.0) + 1):
                duty, t, v = means(count, *part[(part[:, 1] > 0.4) & (part[:, 0] != 0.0)].T)
                rows.append(np.column_stack([clock + t, np.radians(v), duty]))
                clock += 5.0
        t, v, f = np.concatenate(rows).T
        save(out, f"toy_{name}", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f})


def driven_pendulum(mirrors: Path, out: Path) -> None:
    """From chewy441014/mae277_assign2 (no licence): a hanging pendulum that a small motor pushes by a swinging duty.

    1 kHz, 10 s: duty (of 1) and angle in steps of 0.016 rad, both low-pass filtered at 10 Hz. Duty stands for the
    torque (what the turning motor induces is its viscous part). Friction = duty − J dω/dt − weight · sin θ − offset, J
    and weight the same in all, offsets their own, by least squares beside dry and viscous friction; means of ten rows,
    0.3 s left out at both ends. `driven_even`: at 1 Hz; `driven_sweep`, `driven_sweep_again`: from 0.1 to 2 Hz at half
    that duty.
    """
    sweep = "0.1~2Hz, amp 0.1, 10sec"
    names = {"even": "sine_1", "sweep": sweep, "sweep_again": f"{sweep} (2)"}
    runs = []
    for number, file in enumerate(names.values()):
        text = fetch(mirrors, "chewy441014/mae277_assign2", f"data/stb_pend_id/{file}.txt").decode().replace(",", " ")
        time, duty, angle = np.genfromtxt(io.StringIO(text))[:, :3].T
        duty, angle = smooth(1000.0, 10.0, duty), smooth(1000.0, 10.0, angle)
        speed = np.gradient(angle, 1e-3)
        slope = np.gradient(speed, 1e-3)
        own = np.eye(len(names))[np.full(time.size, number)]
        base = np.column_stack([slope, np.sin(angle), own, np.sign(speed), speed])
        runs.append([x[300:-300] for x in (time, speed, duty, angle, base)])
    part = np.linalg.lstsq(np.concatenate([run[4] for run in runs]), np.concatenate([run[2] for run in runs]))[0]
    for name, (time, speed, duty, angle, base) in zip(names, runs, strict=True):
        t, v, f, turned = means(10, time, speed, duty - base[:, :-2] @ part[:-2], angle)
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned}
        save(out, f"driven_{name}", columns, {"inertia_kg_m2": float(f"{part[0]:.4g}")}, dead_band=0.2)


def pin_on_disc(mirrors: Path, out: Path) -> None:
    """From kyembot/pin-on-disk-data-analysis (MIT): a plastic pin (PPS, with PTFE) on a turning disc, a row a second.

    Speed of the disc (rpm), friction (N) of the pin, which stands for the torque, from the first turn on. `pin_60`,
    `pin_100`: the plain plastic under 60 and 100 N, half an hour, means of four rows; `pin_ptfe`, `pin_ptfe_again`:
    with 45 % of PTFE under 60 N, an hour, means of six.
    """
    names = {"60": "PPS_60N_1", "100": "PPS_100N_1"}
    names |= {f"ptfe{end}": f"PPS+45PTFE_60N_200RPM_30MINS_{k}" for end, k in (("", 1), ("_again", 2))}
    for name, file in names.items():
        text = fetch(mirrors, "kyembot/pin-on-disk-data-analysis", f"pod_data/{file}.tsv").decode("latin1")
        cells = [line.replace(",", ".").split("\t") for line in text.splitlines()]
        rows = (row for row in cells if len(row) > 14 and row[2].strip().isdigit())
        log = np.array([[float(row[k].strip(" .")) for k in (4, 6, 14)] for row in rows])
        log = log[int(np.flatnonzero(log[:, 1] > 0.0)[0]) + 2 :]
        t, v, f = means(6 if "ptfe" in name else 4, *log.T)
        save(out, f"pin_{name}", {"time_s": t, "speed_rad_s": RPM * v, "friction_torque_Nm": f})


def propellers(mirrors: Path, out: Path) -> None:
    """From Colomyers/MotorCharacterization (no licence): small propellers on a stand, under a slowly growing command.

    A row every 1.8 or 1.2 s: thrust (g), current (mA), voltage (V), speed (rpm, a moving mean), from 1000 rpm on.
    `thrust_small`, `thrust_large`: M1_1507 and M3_12-6V, thrust, to which a propeller's torque is proportional;
    `power_large`: electrical power of the second over its speed stands for the torque, with the losses of the motor.
    """
    repo = "Colomyers/MotorCharacterization"
    small = sheet(fetch(mirrors, repo, "Results/Tartari/M1_1507.xlsx"), 1, "A C F")
    large = sheet(fetch(mirrors, repo, "Results/Tartari/M3_12-6V.xlsm"), 1, "A D H E F")
    for name, log in (("small", small[small[:, 2] > 1000.0]), ("large", large[large[:, 2] > 1000.0])):
        time, thrust, turns = log[:, :3].T
        columns = {"time_s": time, "speed_rad_s": RPM * turns, "friction_torque_Nm": thrust}
        save(out, f"thrust_{name}", columns)
        if name == "large":
            power = 1e-3 * log[:, 3] * log[:, 4]
            save(out, "power_large", {**columns, "friction_torque_Nm": power / columns["speed_rad_s"]})


def braked_motor(mirrors: Path, out: Path) -> None:
    """From gkret123/DC-Motor-Data-Analysis (no licence): a geared motor at several voltages under a brake.

    Rows by hand without times, here ten seconds apart: current (A), speed behind the gear (rpm), torque of the brake, a
    lever on a scale, as its authors have it (reading less weight of the lever, times its length). Friction = k ·
    current − brake, k by least squares beside dry and viscous friction; without the rows at 10.5 V, which its authors
    leave out.
    """
    data = fetch(mirrors, "gkret123/DC-Motor-Data-Analysis", "GK_Data_M1.xlsx")
    scale, turns, current, lever, length, volts = sheet(data, 1, "B C D J K L").T
    keep = volts != 10.5
    brake, speed, current = (9.81e-5 * (scale - lever) * length)[keep], RPM * turns[keep], current[keep]
    base = np.column_stack([current, -np.ones_like(speed), -speed])
    motor = float(np.linalg.lstsq(base, brake, rcond=None)[0][0]) * current
    columns = {"time_s": 10.0 * np.arange(speed.size), "speed_rad_s": speed, "friction_torque_Nm": motor - brake}
    save(out, "braked_motor", {**columns, "motor_torque_Nm": motor})


def sprung_beam(mirrors: Path, out: Path) -> None:
    """From giuliosavian's third control laboratory (no licence): a beam on an elastic joint (Quanser) swings freely.

    1 kHz, 2.75 s, potentiometer (degrees), low-pass filtered at 12 Hz. Friction = −J dω/dt − k (θ − θ₀), k = 0.808 N
    m/rad as its authors found, J and θ₀ by least squares beside dry and viscous friction; means of five rows, from
    0.2 s on, when it has been let go, to 50 ms before the end.
    """
    repo = "giuliosavian/Control-Lab---3-Position-control-of-a-DC-servomotor-with-a-resonant-load"
    data = io.BytesIO(fetch(mirrors, repo, "LAB3/REALTEST/data3_v1.mat"))
    log = loadmat(data, simplify_cells=True)["data"]["estimation"]  # type: ignore[arg-type]
    angle = smooth(1000.0, 12.0, np.radians(log["thb"][1:]))
    speed = np.gradient(angle, 1e-3)
    slope = np.gradient(speed, 1e-3)
    within = slice(200, -50)
    base = np.column_stack([slope, np.ones_like(speed), np.sign(speed), speed])[within]
    inertia, offset = np.linalg.lstsq(base, -log["k"] * angle[within], rcond=None)[0][:2]
    friction = -inertia * slope - log["k"] * angle - offset
    t, v, f = means(5, *(x[within] for x in (log["t"][1:], speed, friction)))
    columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
    save(out, "sprung_beam", columns, {"inertia_kg_m2": float(f"{inertia:.4g}")}, dead_band=0.02)


ALL = (arm_joints, toy_motors, driven_pendulum, pin_on_disc, propellers, braked_motor, sprung_beam)

if __name__ == "__main__":
    convert(ALL)
