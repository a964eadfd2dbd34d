"""The thirteenth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.thirteenth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: most of it has no licence.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.signal import butter, filtfilt

from benchmarks.recordings.fifth_validation import loss
from benchmarks.recordings.ninth_validation import RPM
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.validation import convert, means, save


def driven(out: Path, name: str, rate: float, cut: float, torque: np.ndarray, speed: np.ndarray, count: int) -> None:
    """Write friction = torque − J dω/dt, both low-pass filtered, means of `count` rows.

    J by least squares beside dry and viscous friction and an offset.
    """
    torque, speed = (filtfilt(*butter(2, 2.0 * cut / rate), x) for x in (torque, speed))
    slope, on = np.gradient(speed, 1 / rate), np.abs(speed) > 0.03 * np.abs(speed).max()
    base = np.column_stack([slope, np.sign(speed), speed, np.ones_like(speed)])
    inertia = float(np.linalg.lstsq(base[on], torque[on], rcond=None)[0][0])
    t, v, f, motor = means(count, np.arange(speed.size) / rate, speed, torque - inertia * slope, torque)
    columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "motor_torque_Nm": motor}
    wheel = {"inertia_kg_m2": float(f"{inertia:.4g}")}
    save(out, name, {key: x[5:-5] for key, x in columns.items()}, wheel, dead_band=0.02 * float(np.abs(v).max()))


def dampers(mirrors: Path, out: Path) -> None:
    """From LucasDudley/damper_characterization (no licence): dampers of a racing car on a crank, 38 mm of stroke.

    300 Hz, load cell and displacement (mm, both stand for torque and angle), speed from the displacement, both low-pass
    filtered at 25 Hz, means of 3, 9 (`slow`) and 10 rows (`heated`, by a heat gun and 100 strokes, with its
    temperature); whole strokes only, the force with the sign that it opposes the speed with. The gas pushes the rod
    out. In the names: clicks of the valves, or the pressure of the gas in psi.
    """
    repo, folder = "LucasDudley/damper_characterization", "Test_Data/Phase1_temp_sensitivity"
    for name, file, count in (
        ("damper_2_24", "t1_2_2_24_24_s5_n10_100psi", 3),
        ("damper_3_24", "t1_3_3_24_24_s5_n10_100psi", 3),
        ("damper_50psi", "pressure_testing/t1_1_1_18_18_s5_n10_50psi", 3),
        ("damper_150psi", "pressure_testing/t1_1_1_18_18_s5_n10_150psi", 3),
        ("damper_slow", "pressure_testing/t1_1_1_18_18_s1_n10_100psi", 9),
        ("damper_heated", "t1_3_3_24_24_s5_n100_100psi_with_heat_gun", 10),
    ):
        log = git_table(mirrors, repo, f"{folder}/{file}.csv", delimiter=",", skip_header=1, usecols=(2, 4, 6))
        low = butter(2, 25.0 / 150)
        force, place = (filtfilt(*low, log[:, k]) for k in (0, 1))
        speed = np.gradient(place, 1 / 300)
        force *= np.sign(force @ speed)
        heat = filtfilt(*butter(2, 0.1 / 150), log[:, 2])
        moving = np.flatnonzero(np.abs(speed) > 0.2 * np.abs(speed).max())
        t, v, f, heat = means(count, np.arange(speed.size) / 300, speed, force, heat)
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
        if name == "damper_heated":
            columns["bearing_temperature_degC"] = heat
        part = slice(moving[0] // count + 1, moving[-1] // count - 1)
        save(out, name, {key: x[part] for key, x in columns.items()}, dead_band=0.02 * float(np.abs(v).max()))


def rheometer_motor(mirrors: Path, out: Path) -> None:
    """From cbosoft/pi_rheo_proj (GPL-3): motor of a rheometer built at home, its cup empty or with water.

    Voltage in steps, down a little, then up; voltage in V stands for the torque (what the turning motor induces is its
    viscous part), speed by an optical sensor in rpm, 84 Hz, means over 0.24 s from 3 s on.
    """
    for name in ("empty", "water"):
        log = git_table(mirrors, "cbosoft/pi_rheo_proj", f"etc/{name}_vsweep.csv", delimiter=",", skip_header=1)
        t, turns, volts = means(20, log[:, 0] - log[0, 0], log[:, 2], log[:, 12])
        on = t > 4.0
        save(
            out, f"rheometer_{name}", {"time_s": t[on], "speed_rad_s": turns[on] * RPM, "friction_torque_Nm": volts[on]}
        )


def rotor(mirrors: Path, out: Path) -> None:
    """From Alex-Jagger/277_Assignments (no licence): a rotor on a small motor, duty of the voltage steps or swings.

    10 kHz; duty stands for the torque (what the turning motor induces is its viscous part), angle low-pass filtered at
    10 Hz. Friction = duty − J dω/dt, J in s²/rad by least squares over the three steps beside dry and viscous friction;
    means over 10 ms (steps, from rest, one after the other) and 40 ms (swing, whose mean was taken off: put back as an
    even swing has it).
    """
    runs = {}
    for name, file in (
        ("step_3", "step_rod_03_1"),
        ("step_5", "step_rod_05_1"),
        ("step_7", "step_rod_07_1"),
        ("swing", "chirp_rod_05_0001_01_1"),
    ):
        data = fetch(mirrors, "Alex-Jagger/277_Assignments", f"data/system_id_data/id_result_{file}.mat")
        log = loadmat(io.BytesIO(data), simplify_cells=True)["output"]["pos_iddata"]  # type: ignore[arg-type]
        duty = np.asarray(log["InputData"], dtype=float)
        duty -= (duty.max() + duty.min()) / 2 if name == "swing" else 0.0
        speed = np.gradient(filtfilt(*butter(2, 10.0 / 5000), log["OutputData"]), 1e-4)
        count = 400 if name == "swing" else 100
        run = means(count, 1e-4 * np.arange(duty.size), speed, np.gradient(speed, 1e-4), duty)
        runs[name] = [x[15:-15] for x in run]
    _, v, rate, duty = np.concatenate([runs[f"step_{k}"] for k in (3, 5, 7)], axis=1)
    inertia = float(np.linalg.lstsq(np.column_stack([rate, np.sign(v), v]), duty, rcond=None)[0][0])
    steps = [runs[f"step_{k}"] for k in (3, 5, 7)]
    steps = [[t + 5.0 * k, *rest] for k, (t, *rest) in enumerate(steps)]
    for name, (t, v, rate, duty) in (("steps", np.concatenate(steps, axis=1)), ("swing", runs["swing"])):
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": duty - inertia * rate, "motor_torque_Nm": duty}
        save(out, f"rotor_{name}", columns, {"inertia_kg_m2": round(inertia, 6)}, dead_band=2.0)


def soccer_motors(mirrors: Path, out: Path) -> None:
    """From vhsabino/MATLAB (no licence): motors of soccer robots, their speed over the duty of the voltage in per cent.

    Duty stands for the torque (what the turning motor induces is its viscous part). `small_1`, `small_2`: a small
    robot, steps of 1 from −97 to 99; `wheel_1`, `wheel_4`: another on the ground, steps of 0.1 up, means of 4;
    `dribbler`: its roller, steps of 0.1 from −95 to 95, means of 5, sign turned. Where they turn; as they have no times
    and one sweep, every other row up and the rest down again, a row a second.
    `steps_1`, `steps_2`: the small one in steps both ways, taken as 5 ms a row, low-pass filtered at 10 Hz. Friction =
    duty − J dω/dt, J by least squares beside dry and viscous friction and an offset; means of 5 rows.
    """
    repo = "vhsabino/MATLAB"
    small = git_table(mirrors, repo, "vss-2022/vss-motor-curve-24-09-2022.csv", delimiter=",")
    rows = {f"small_{k}": (1, small[:, 0], small[:, k]) for k in (1, 2)}
    for k in (1, 4):
        turns = git_table(mirrors, repo, f"MotorCurve/R0_M{k}_POS.csv")
        rows[f"wheel_{k}"] = (4, 95.0 - 0.1 * np.arange(turns.size, 0, -1), turns)
    duty, turns = (git_table(mirrors, repo, f"MotorCurve/Dribbler/{k}_DRIBBLER_30_08_19.csv") for k in ("INPUT", "M5"))
    rows["dribbler"] = (5, -duty, turns)
    for name, (count, duty, turns) in rows.items():
        good = np.isfinite(turns) & (np.abs(turns) > 1.0)
        f, v = means(count, duty[good], turns[good])
        order = np.append(np.arange(0, v.size, 2), np.arange(1, v.size, 2)[::-1])
        columns = {"time_s": np.arange(v.size, dtype=float), "speed_rad_s": v[order], "friction_torque_Nm": f[order]}
        save(out, f"soccer_{name}", columns, dead_band=1.0)
    log = git_table(mirrors, repo, "vss-2022/vss-24-09-2022.csv", delimiter=",")
    for k in (1, 2):
        driven(out, f"soccer_steps_{k}", 200.0, 10.0, log[:, 0], log[:, k], 5)


def robot_ramps(mirrors: Path, out: Path) -> None:
    """From walbermr/statistics-cin (no licence): wheels of soccer robots in the air, duty in stairs of one per cent.

    Ten sweeps of 70 up and 70 down the other way; duty stands for the torque (what the turning motor induces is its
    viscous part). No times: a row a second; the first four sweeps, where they turn.
    """
    for robot in (3, 5):
        log = git_table(mirrors, "walbermr/statistics-cin", f"csv/robot-{robot}.csv", delimiter=",", skip_header=1)[
            :560
        ]
        on = np.flatnonzero(np.abs(log[:, 1]) > 1.0)
        columns = {"time_s": on.astype(float), "speed_rad_s": log[on, 1], "friction_torque_Nm": log[on, 0]}
        save(out, f"ramps_{robot}", columns, dead_band=1.0)


def reversed_motors(mirrors: Path, out: Path) -> None:
    """From ersaraujo/motors-data-collect (no licence): motors of a soccer robot from rest to 15 % of duty, then to −15.

    Duty stands for the torque, speed in steps of 0.77 rad/s at 463 Hz, low-pass filtered at 15 Hz. Friction = duty
    − J dω/dt, J by least squares beside dry and viscous friction and an offset; means of 4 rows.
    """
    file = "results/logs/motor_logs_2023-12-18_19-16-13.csv"
    log = git_table(mirrors, "ersaraujo/motors-data-collect", file, delimiter=",")
    log = log[np.isfinite(log).all(1)]
    for motor in (1, 3):
        driven(out, f"reversed_motor_{motor}", 463.0, 15.0, log[:, motor + 3], log[:, motor - 1], 4)


def bob(mirrors: Path, out: Path) -> None:
    """From AG2048/Damped-Harmonic-Oscillator-Lab (no licence): turning points of a bob on a thread, filmed at 30 Hz.

    212 swings. Means of eight amplitudes; loss of 1 − cos a over the way, in terms of m g l.
    """
    folder = "Organized Data/Lab1-Q Factor Determination"
    file = f"{folder}/plotting_data_from_46.29_s.txt"
    log = git_table(mirrors, "AG2048/Damped-Harmonic-Oscillator-Lab", file, skip_header=1)
    t, a = means(8, log[:, 0], np.abs(log[:, 1]))
    period = np.full(t.size, log[-1, 0] * 2 / (len(log) - 1))
    save(out, "bob_turning", loss(np.column_stack([t, a, period]), 1 - np.cos(a)))


def seismometer(mirrors: Path, out: Path) -> None:
    """From caspar/PhysicsLab (no licence): a horizontal pendulum of a seismometer, a plate between magnets damps it.

    Deflection in V at 10 Hz stands for the angle, low-pass filtered at 0.2 Hz, from 18 s (where it was let go) to 90 s.
    Friction = −(dω/dt + w² x + c) in terms of its inertia, w² and c by least squares beside dry and viscous friction;
    means over 1 s. In the names: how far the plate is in, in mm.
    """
    for depth in (11, 75):
        file = f"14_Seismometer/data/{depth}mm damping.txt"
        text = fetch(mirrors, "caspar/PhysicsLab", file).decode("latin1").splitlines()[2:]
        log = np.array([[float(word) for word in line.split()] for line in text if line.strip()])[80:1000]
        place = filtfilt(*butter(2, 0.2 / 5), log[:, 1])[100:-100]
        speed = np.gradient(place, 0.1)
        rate = np.gradient(speed, 0.1)
        base = np.column_stack([place, np.ones_like(place), np.sign(speed), speed])
        fit = np.linalg.lstsq(base, -rate, rcond=None)[0]
        t, v, f = means(10, 0.1 * np.arange(speed.size), speed, -rate - base[:, :2] @ fit[:2])
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
        save(out, f"seismometer_{depth}", columns, {"inertia_kg_m2": 1.0})


def propellers(mirrors: Path, out: Path) -> None:
    """From StrawsonDesign/motor_propeller_testing (no licence): one propeller on 13 motors, 11 commands each.

    Torque = voltage · current / speed (the motor's losses in it), speed from the controller, one motor after the other,
    two cells and three.
    """
    for propeller in (5, 8):
        rows, clock = [], 0.0
        for motor in "abcdefghijklm":
            for cells in (7, 11):
                file = f"rawdata/{motor}{propeller}_{cells}.csv"
                log = git_table(
                    mirrors, "StrawsonDesign/motor_propeller_testing", file, delimiter=",", skip_header=1,
                    usecols=(0, 6, 7, 8), encoding="utf-8-sig",
                )  # fmt: skip
                log = log[np.isfinite(log).all(1) & (log[:, 3] > 2000.0)]
                rows.append(log + np.array([clock, 0.0, 0.0, 0.0]))
                clock = float(rows[-1][-1, 0]) + 10.0
        t, volts, current, turns = np.concatenate(rows).T
        v = turns * RPM
        save(out, f"propeller_{propeller}", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": volts * current / v})


ALL = (
    *(dampers, rheometer_motor, rotor, soccer_motors, robot_ramps, reversed_motors, bob, seismometer),
    propellers,
)

if __name__ == "__main__":
    convert(ALL)
