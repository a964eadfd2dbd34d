"""The tenth set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.tenth_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: most of it has no licence.
"""

from __future__ import annotations

import io
import json
import re
import zipfile
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.signal import butter, filtfilt

from benchmarks.recordings.fifth_validation import amplitudes, loss
from benchmarks.recordings.ninth_validation import RPM, rows_of
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.third_validation import half_swings
from benchmarks.recordings.validation import convert, means, save, slope

STEFFEN, UNITS = "Jared-Steffen/ASEN-3801", "Jkillelea/ASEN3200-AttitudeLab1"
WHEEL, BASE = "Lab 3/2023_10_13_002_RWHEEL_INERTIA_", "Data Files/2026_02_10_002_04_RW_"


def spin_module(mirrors: Path, repo: str, file: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time [s], speed [rad/s] and current [A] of a spin module; every second row, for it sends each twice."""
    rows = rows_of(fetch(mirrors, repo, file))[1::2]
    return rows[:, 0] / 1e3, rows[:, 2] * RPM, rows[:, 3]


def reaction_wheels(mirrors: Path, out: Path) -> None:
    """From Jared-Steffen/ASEN-3801 and Jkillelea/ASEN3200-AttitudeLab1 (no licence): reaction wheels of spin modules.

    Other units and years than in the sets before: a current for five seconds, then none, K_T 33.5 mN m/A. J = K_T ΔI /
    Δ(dω/dt) where the current ends, median of the runs of a unit: 1.09e-4 (six, 1.04–1.24) and 1.15e-4 kg m² (three,
    1.12–1.26). `coast_*`: the second after the end of the current.
    """
    for name, repo, file, inertia in (
        ("wheel_e_6mNm", STEFFEN, f"{WHEEL}6", 1.09e-4),
        ("wheel_e_10mNm", STEFFEN, f"{WHEEL}10", 1.09e-4),
        ("wheel_e_12mNm", STEFFEN, f"{WHEEL}12", 1.09e-4),
        ("wheel_f_10mNm", UNITS, "data/AM_UNIT07_RWHEEL_COMP_RUN21", 1.15e-4),
        ("wheel_f_10mNm_again", UNITS, "data/AM_UNIT07_RWHEEL_COMP_RUN23", 1.15e-4),
    ):
        time, speed, current = spin_module(mirrors, repo, file)
        good = (time > 1.2) & (speed > 3.0)
        columns = {"time_s": time[good], "speed_rad_s": speed[good], "motor_current_A": current[good]}
        save(out, name, columns, {"inertia_kg_m2": inertia, "torque_constant_Nm_A": 0.0335}, dead_band=3.0)
    for level in (6, 8, 10, 12, 14):
        time, speed, current = spin_module(mirrors, STEFFEN, f"{WHEEL}{level}")
        part = slice(int(np.flatnonzero(current > 0.1)[-1]) + 3, None)
        columns = {"time_s": time[part], "speed_rad_s": speed[part]}
        save(out, f"coast_{level}", columns, {"inertia_kg_m2": 1.09e-4}, True, 3.0)


def bases(mirrors: Path, out: Path) -> None:
    """From adarshb235/ASEN3801Lab3, quinlan-lewis/ASEN-3200 and Jkillelea/ASEN3200-AttitudeLab3 (no licence).

    Spin modules turned by the motor of their base, a current for 5 to 30 s, then none; rate gyro, sign turned. K_T 25.5
    mN m/A; J = K_T ΔI / Δ(dω/dt) where the current ends, median of the runs of a unit: 5.3e-3, 4.75e-3, 4.6e-3 kg m².
    """
    for name, repo, file, inertia in (
        ("base_b_5mNm", "adarshb235/ASEN3801Lab3", f"{BASE}T5t30", 5.3e-3),
        ("base_b_10mNm", "adarshb235/ASEN3801Lab3", f"{BASE}T10t10", 5.3e-3),
        ("base_c_20mNm", "quinlan-lewis/ASEN-3200", "Lab_3/Torque_20nM_Pt1", 4.75e-3),
        ("base_d_10mNm", "Jkillelea/ASEN3200-AttitudeLab3", "MOI Data/T10", 4.6e-3),
    ):
        time, speed, current = spin_module(mirrors, repo, file)
        good = time > 1.3
        columns = {"time_s": time[good], "speed_rad_s": -speed[good], "motor_current_A": current[good]}
        save(out, name, columns, {"inertia_kg_m2": inertia, "torque_constant_Nm_A": 0.0255}, dead_band=0.05)


def sprung_module(mirrors: Path, out: Path) -> None:
    """From Jared-Steffen/ASEN-3801 (no licence): spin module that its reaction wheel holds as a spring does.

    Torque of the wheel = −K θ, 80 mN m/rad (current over angle, 33.5 mN m/A), angle in steps of 0.01 rad at 33 Hz; from
    14 s, when it no longer grows. Loss of K θ²/2 between two turning points over the way, means of two half swings.
    """
    rows = rows_of(fetch(mirrors, STEFFEN, "Lab 3/2023_10_13_002_K1_100"))[1:]
    rows = rows[np.append(True, np.diff(rows[:, 0]) > 0.0)]
    time, angle = (rows[:, 0] - rows[0, 0]) / 1e3, filtfilt(*butter(2, 0.2), rows[:, 2])
    keep = time > 14.0
    swings = half_swings(time[keep], 0.1 * angle[keep], 8.0, 6, 0.004)  # a tenth of the angle, where 1 − cos is a²/2
    swings["speed_rad_s"], swings["friction_torque_Nm"] = 10 * swings["speed_rad_s"], swings["friction_torque_Nm"] / 10
    save(out, "sprung_module", {key: (np.abs(x[1:]) + np.abs(x[:-1])) / 2 for key, x in swings.items()})


def turntable(mirrors: Path, out: Path) -> None:
    """From quinlan-lewis/ASEN-2003 (no licence): turntable of a yo-yo despinner running down without masses.

    100 Hz in rpm, means of 10 rows, from 120 to 4 rpm. A machine as in the ninth set, two years before; J = 0.0483.
    """
    time, speed = rows_of(fetch(mirrors, "quinlan-lewis/ASEN-2003", "Lab_5/no_masses1"))[1:].T
    part = slice(int(np.flatnonzero(speed > 120.0)[-1]) + 20, int(np.flatnonzero(speed > 4.0)[-1]))
    t, v = means(10, time[part] / 1e3, speed[part] * RPM)
    save(out, "turntable", {"time_s": t, "speed_rad_s": v}, {"inertia_kg_m2": 0.0483}, True, 0.1)


def gel(mirrors: Path, out: Path) -> None:
    """From bsaintmichel/read-rheol (no licence): rheometers turning in a gel (Carbopol), speed in steps.

    Down and up. Malvern: torque and angle, speed = shear rate × 0.0951 (angle over strain); Anton Paar (other): torque
    in mN m, the shear rate stands for the speed. One row a step of 4 or 5 s, 10 to a decade, from 0.01 /s on.
    """
    repo = "bsaintmichel/read-rheol"
    text = fetch(mirrors, repo, "sample_Malvern.csv").decode("utf8", "replace").replace(",", ".")
    for name in ("Down", "Up"):
        lines = [line.split(";") for line in text.splitlines() if line.startswith(f"Flow Curve {name}")]
        rows = np.array([[float(line[k]) for k in (2, 4, 13)] for line in lines])
        t, v, f = rows[rows[:, 1] > 0.01].T
        save(out, f"gel_{name.lower()}", {"time_s": t, "speed_rad_s": 0.0951 * v, "friction_torque_Nm": f})
    parts = fetch(mirrors, repo, "sample_AntonPaar.csv").decode("utf16").split("points de données:\t")
    for part, name in ((parts[3], "down"), (parts[4], "up")):
        lines = [line.replace(",", ".").split("\t") for line in part.splitlines() if "Dy_auto" in line]
        rows = np.array([[float(line[k]) for k in (2, 5, 11)] for line in lines])
        t, v, f = rows[rows[:, 1] > 0.01].T
        save(out, f"gel_other_{name}", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f / 1e3})


def cement(mirrors: Path, out: Path) -> None:
    """From Mareike-99/rheocem2024_public (MIT): a vane or a plate turning in cement paste, its speed falling in steps.

    2 to 10 Hz, means of several runs: torque in mN m over rpm; the plate: stress in Pa over the shear rate.
    """
    for name, file in (("vane_thick", "Vane_0.45-250"), ("vane_thin", "Vane_0.55-250"), ("plate", "PPdyn_0.45-250")):
        data = fetch(mirrors, "Mareike-99/rheocem2024_public", f"{file}.xlsx")
        text = zipfile.ZipFile(io.BytesIO(data)).read("xl/worksheets/sheet1.xml").decode()
        cells = [re.findall(r'<c r="[BCD]\d+"[^>]*><v>([^<]*)</v>', row) for row in text.split("<row ")[2:]]
        t, v, f = np.array([row for row in cells if len(row) == 3], dtype=float).T
        unit = (1.0, 1.0) if name == "plate" else (RPM, 1e-3)
        save(out, name, {"time_s": t, "speed_rad_s": unit[0] * v, "friction_torque_Nm": unit[1] * f})


def scooter(mirrors: Path, out: Path) -> None:
    """From dsoto/ev (no licence): a light electric vehicle at full throttle to 50 km/h and braked by its motor again.

    Log of the motor's controller at 18 Hz. Force = 3/2 · 0.0277 V s · electric speed × current q / speed = 3.07 N/A
    (0.0277: voltage q over speed), friction = force − m dv/dt in N, m by least squares beside dry, viscous and
    quadratic friction (111 kg); slope of a parabola through 11 rows, means of 3, above 1 m/s.
    """
    lines = fetch(mirrors, "dsoto/ev", "data.csv").decode().splitlines()
    names = lines[0].split(";")
    table = np.array([[float(word or "nan") for word in line.split(";")[: len(names)]] for line in lines[1:]])
    raw, turns, current = (table[:, names.index(key)] for key in ("ms_today", "erpm", "q_axis_current"))
    time, speed = (raw - raw[0]) / 1e3, turns * 13.5 / 9740.0
    rows, rate = slope(time, speed, 5)
    rows, rate = rows[speed[rows] > 1.0], rate[speed[rows] > 1.0]
    force, v = 3.07 * np.convolve(current, np.ones(5) / 5, "same")[rows], speed[rows]
    mass = float(np.linalg.lstsq(np.column_stack([rate, np.ones_like(v), v, v**2]), force, rcond=None)[0][0])
    t, v, motor, f = means(3, time[rows], v, force, force - mass * rate)
    columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "motor_torque_Nm": motor}
    save(out, "scooter", columns, {"inertia_kg_m2": round(mass, 1)})


def bare_motor(mirrors: Path, out: Path) -> None:
    """From rravenel/furuta_pendulum (MIT): a bare motor (ODrive) turning on a constant current of 0.304 A.

    Forth and back. Angle of 8192 steps a turn at 470 Hz, put on an even grid and low-pass filtered at 60 Hz, a row each
    4 ms. Neither inertia nor torque constant is given: 1e-5 kg m² and 8.3 mN m/A (1000 rpm/V).
    """
    laps = json.loads(fetch(mirrors, "rravenel/furuta_pendulum", "bldc/odrive/data/const_cur_pos_3_full_raw.json"))
    for name, key, way in (("bare_motor_forth", "f", 1.0), ("bare_motor_back", "r", -1.0)):
        rows = np.array(laps[key])
        time, angle = rows[:, 0] - rows[0, 0], np.unwrap(rows[:, 1], period=8192) * 2 * np.pi / 8192
        even = np.arange(time[0], time[-1], 0.002)
        speed = np.gradient(filtfilt(*butter(2, 60.0 / 250), np.interp(even, time, angle)), even)[3000:23000:2]
        columns = {"time_s": 0.004 * np.arange(speed.size), "speed_rad_s": speed}
        columns["motor_current_A"] = np.full(speed.size, way * 0.304)
        save(out, name, columns, {"inertia_kg_m2": 1e-5, "torque_constant_Nm_A": 8.3e-3})


def actuator(mirrors: Path, out: Path) -> None:
    """From dfki-ric-underactuated-lab/torque_limited_simple_pendulum (BSD-3): a pendulum on a geared motor (AK80-6).

    Swing-ups along two trajectories, torque from the motor's current, 500 and 333 Hz, low-pass filtered at 8 Hz.
    Friction = torque − J dω/dt − m g l sin θ, J and m g l by least squares beside dry and viscous friction and an
    offset where it turns by more than 0.3 rad/s (0.175 kg m², 3.5 N m); means over 20 ms.
    """
    repo = "dfki-ric-underactuated-lab/torque_limited_simple_pendulum"
    for name, file in (("actuator_ddp", "ddp"), ("actuator_collocation", "direct_collocation")):
        file = f"results/control_method_{file}/data_measured.csv"
        rows = git_table(mirrors, repo, file, delimiter=",", skip_header=1)
        step = float(np.median(np.diff(rows[:, 0])))
        low = butter(2, 8.0 * 2 * step)
        angle, torque = (filtfilt(*low, rows[:, k]) for k in (1, 3))
        speed = np.gradient(angle, step)
        rate, on = np.gradient(speed, step), np.abs(speed) > 0.3
        base = np.column_stack([rate, np.sin(angle), np.sign(speed), speed, np.ones_like(speed)])
        inertia, weight = np.linalg.lstsq(base[on], torque[on], rcond=None)[0][:2]
        f = torque - inertia * rate - weight * np.sin(angle)
        t, speed, f, torque = means(round(0.02 / step), rows[:, 0], speed, f, torque)
        columns = {"time_s": t, "speed_rad_s": speed, "friction_torque_Nm": f, "motor_torque_Nm": torque}
        save(out, name, columns, {"inertia_kg_m2": round(float(inertia), 5)}, dead_band=0.1)


def back_driven(mirrors: Path, out: Path) -> None:
    """From robotology-playground/torque-control-params-estimation (no licence): joints of an iCub pushed by hand.

    Motor idle (commit 046faa2), 100 Hz: angle, and torque in the joint from force sensors and the model of the leg, its
    sign turned, which is the friction (the rotor's inertia is not taken off). Low-pass filtered at 5 Hz, means of 5.
    """
    repo = "robotology-playground/torque-control-params-estimation"
    for name, file in (("hip", "left/hip/roll/idle"), ("knee", "right/knee/idle"), ("ankle", "right/ankle/roll/Idle")):
        path = f"20141120/iCubGenova03/leg/{file}.mat"
        data = loadmat(io.BytesIO(fetch(mirrors, repo, path, "046faa2b")))["out"]  # type: ignore[arg-type]
        angle, torque = (filtfilt(*butter(2, 0.1), data[:, k]) for k in (0, 2))
        speed = np.gradient(np.radians(angle), 0.01)
        t, v, f = means(5, 0.01 * np.arange(speed.size), speed, -torque)
        t, v, f = (column[20:-20] for column in (t, v, f))
        save(out, f"back_driven_{name}", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=0.02)


def exoskeleton(mirrors: Path, out: Path) -> None:
    """From yunzhewong/ALEX-Capstone-2024 (no licence; commit 2430992): an actuator of an exoskeleton to and fro.

    Current, speed and angle at 63 Hz on ramps of the angle; speed from the angle, both low-pass filtered at 5 Hz.
    Friction = current − J dω/dt in A, J by least squares beside dry and viscous friction and an offset; means of 2.
    """
    repo = "yunzhewong/ALEX-Capstone-2024"
    rows = git_table(mirrors, repo, "jerk_motor.csv", "24309927", delimiter=",", skip_header=1)
    even = np.arange(rows[1, 0], rows[-1, 0], 0.016)
    current, angle = (filtfilt(*butter(2, 5.0 * 0.032), np.interp(even, rows[:, 0], rows[:, k])) for k in (1, 3))
    speed = np.gradient(angle, even)
    rate, on = np.gradient(speed, even), np.abs(speed) > 0.1
    base = np.column_stack([rate, np.sign(speed), speed, np.ones_like(speed)])
    inertia = float(np.linalg.lstsq(base[on], current[on], rcond=None)[0][0])
    t, v, f = means(2, even, speed, current - inertia * rate)
    save(out, "exoskeleton", {"time_s": t[30:], "speed_rad_s": v[30:], "friction_torque_Nm": f[30:]}, dead_band=0.03)


def tunnel(mirrors: Path, out: Path) -> None:
    """From tudelft/propeller_airspeed_sensor (CC-BY-4.0): a drone's propeller in a wind tunnel at 10, 15 and 18 m/s.

    Commands in stairs, 500 Hz. Torque = voltage · current / speed (losses of the motor in it), means of 250 rows, above
    2500 rpm.
    """
    raw = io.BytesIO(fetch(mirrors, "tudelft/propeller_airspeed_sensor", "data/input/wt.mat"))
    data = loadmat(raw, simplify_cells=True)["data"]  # type: ignore[arg-type]
    time, turns, volt, current, wind = (np.asarray(data[k]) for k in ("t", "rpm", "voltage", "current", "airspeed"))
    for level in (10, 15, 18):
        part = np.abs(wind - level) < 1.0
        t, v, power = means(250, time[part], turns[part] * RPM, (volt * current)[part])
        on = v > 2500 * RPM
        save(out, f"tunnel_{level}", {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": power[on] / v[on]})


def bob(mirrors: Path, out: Path) -> None:
    """From jadontsai/phy180pendulumproject (no licence): a bob on a thread in air, filmed at 30 Hz.

    Windows of two periods. Loss of 1 − cos a over the way, in terms of m g l.
    """
    track = rows_of(fetch(mirrors, "jadontsai/phy180pendulumproject", "pendulum_lab_1_data.txt"))
    time, angle = track[:, 0], np.arctan2(track[:, 1], -track[:, 2])
    angle -= np.median(angle)
    up = time[1:][(angle[1:] > 0) & (angle[:-1] <= 0)][:20]
    table = amplitudes(time, angle, 2, float(np.median(np.diff(up))), 0.03)
    save(out, "bob_short", loss(table, 1 - np.cos(table[:, 1])))


ALL = (
    *(reaction_wheels, bases, sprung_module, turntable, gel, cement, scooter),
    *(bare_motor, actuator, back_driven, exoskeleton, tunnel, bob),
)

if __name__ == "__main__":
    convert(ALL)
