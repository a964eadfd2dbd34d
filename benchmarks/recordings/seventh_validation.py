"""The seventh set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.seventh_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: most of it has no licence.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifth_validation import amplitudes, loss, numbers
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.validation import convert, means, save

RPM = np.pi / 30
SERVO = "giuliosavian/Control-Lab---0-Inertia-and-Friction-Estimation"


def eco_car(mirrors: Path, out: Path) -> None:
    """From Abaiquni/Finding-Rolling-Resistance-for-Electric-Car: an efficiency vehicle coasting on a flat road.

    Michelin tyres, there (`a`) and back (`b`, negative speed), twice each. Speed in km/h at 1 Hz (README), of 1 kg:
    friction = deceleration. From 2 s after the fastest row to the first below 2 km/h.
    """
    for name, file, way in (
        ("eco_car_a", "Michelin60A", 1.0),
        ("eco_car_a_again", "Michelin60A1", 1.0),
        ("eco_car_b", "Michelin60B", -1.0),
        ("eco_car_b_again", "Michelin60B1", -1.0),
    ):
        path = f"Data/{file}.csv"
        speed = git_table(mirrors, "Abaiquni/Finding-Rolling-Resistance-for-Electric-Car", path).ravel() / 3.6
        first = int(speed.argmax()) + 2
        speed = way * speed[first : first + int(np.flatnonzero(speed[first:] < 2.0 / 3.6)[0])]
        t, v = means(3, np.arange(float(speed.size)), speed)
        columns = {"time_s": t, "speed_rad_s": v}
        save(out, name, columns, {"inertia_kg_m2": 1.0}, True, 0.1)


def reaction_wheel(mirrors: Path, out: Path) -> None:
    """From ango6230/ASEN-3801-Lab-3: reaction wheel of a spin module (one more group of students; other years before).

    Torque set to 20 mN m, speed at 100 Hz, means of 6 rows, from 0.1 s after the wheel starts to its limit; no current
    was logged. J = 1.07e-4 kg m² as in the second set.
    """
    text = fetch(mirrors, "ango6230/ASEN-3801-Lab-3", "Lab 3 Data/RWHEEL_T20.csv")
    rows = numbers(text.replace(b"\t", b","), 4)
    time, speed = rows[:, 0] / 1e3, rows[:, 2] * RPM
    start, limit = np.flatnonzero(speed > 10.0)[0] + 10, np.flatnonzero(speed > 410.0)[0] - 10
    t, v, torque = means(6, *(column[start:limit] for column in (time, speed, rows[:, 1] / 1e3)))
    columns = {"time_s": t, "speed_rad_s": v, "motor_torque_Nm": torque}
    save(out, "wheel_d_20mNm", columns, {"inertia_kg_m2": 1.07e-4}, dead_band=3.0)


def surgical_arm(mirrors: Path, out: Path) -> None:
    """From WPI-AIM/dvrk_dynamics_identification: cable-driven patient-side arm of a da Vinci research kit.

    `surgical_roll`, `_wrist`, `_jaw`: joints 4, 5 and 7 on an exciting path (psm, two_results), `_jaw_other` on another
    (one_no_weight); torque from the current, speed, 200 Hz, means of 4 rows.
    """
    for name, file, joint in (
        ("surgical_roll", "two", 4),
        ("surgical_wrist", "two", 5),
        ("surgical_jaw", "two", 7),
        ("surgical_jaw_other", "one_no_weight", 7),
    ):
        path = f"data/psm/measured_trajectory/{file}_results.csv"
        rows = git_table(mirrors, "WPI-AIM/dvrk_dynamics_identification", path, delimiter=",")
        t, v, f = means(4, 0.005 * np.arange(len(rows)), rows[:, 6 + joint], rows[:, 13 + joint])
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=0.04)


def slide(mirrors: Path, out: Path) -> None:
    """From radiang/dvrk_parameter_identification: slide of another patient-side arm (its joint 3).

    Strokes of 0.21 m at 16 constant speeds (0.01–0.16 m/s) one way, at one speed back: `slide_out` (frtest) and
    `slide_in` (frtest_neg). Force in N from the current, speed in m/s, 0.01 s a row (positions over speeds), means of
    5.
    """
    for name, file in (("slide_out", "frtest"), ("slide_in", "frtest_neg")):
        path = f"dvrk_si/scripts/data/stribeck_3dof_svd/{file}_results.csv"
        rows = git_table(mirrors, "radiang/dvrk_parameter_identification", path, delimiter=",")
        t, v, f = means(5, 0.01 * np.arange(len(rows)), rows[:, 5], rows[:, 8])
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, dead_band=0.002)


def cobot(mirrors: Path, out: Path) -> None:
    """From FrankJIE09/Dynamics_identification_Frank: joints 5 to 7 of a Rokae AR5 on an exciting path, 50 Hz.

    Torque as logged (…_data_real.csv), speed of the joint; gravity as a sine and a cosine of the angle is taken off by
    least squares with dry and viscous friction.
    """
    path = "src/config/dynamics_identification_data_real.csv"
    rows = git_table(mirrors, "FrankJIE09/Dynamics_identification_Frank", path, delimiter=",", skip_header=1)
    for joint in (5, 6, 7):
        angle, speed, torque = rows[:, joint], rows[:, 7 + joint], rows[:, 21 + joint]
        base = np.column_stack([np.sin(angle), np.cos(angle), np.sign(speed), speed])
        torque = torque - base[:, :2] @ np.linalg.lstsq(base, torque, rcond=None)[0][:2]
        columns = {"time_s": rows[:, 0], "speed_rad_s": speed, "friction_torque_Nm": torque}
        save(out, f"cobot_joint{joint}", columns, dead_band=0.01)


def youbot(mirrors: Path, out: Path) -> None:
    """From jeyaprakashrajagopal/Dynamic-Robot-Model-Parameter-Identification-via-Domain-Specific-Optimization.

    Joints 1 (vertical axis) and 5 (the last) of a KUKA youBot on an exciting path; torque and speed as logged, 0.12 s a
    row (angles over speeds). The inertia is not taken off.
    """
    repo = "jeyaprakashrajagopal/Dynamic-Robot-Model-Parameter-Identification-via-Domain-Specific-Optimization"
    text = fetch(mirrors, repo, "joint_info.dat").decode()
    speed, torque = (
        np.array([[float(x) for x in row.split()] for row in re.findall(rf"{key} (.*)", text)])
        for key in ("Velocity", "Torque")
    )
    for joint in (1, 5):
        columns = {
            "time_s": 0.12 * np.arange(len(speed)),
            "speed_rad_s": speed[:, joint - 1],
            "friction_torque_Nm": torque[:, joint - 1],
        }
        save(out, f"youbot_joint{joint}", columns, dead_band=0.02)


def servo_ladder(mirrors: Path, out: Path) -> None:
    """From giuliosavian/Control-Lab---0-Inertia-and-Friction-Estimation: a geared servo unit (Quanser SRV-02).

    Nine speeds of 5 s, one way and the other (`_back`); current and speed of the load (gear of 14) at 1 kHz, from 0.5 s
    after each change on, means of 100 rows. `servo_unit_trapezoids`: up and down within 2 s, ten times, speed of the
    motor, means of 20 rows above 30 rad/s. In terms of the motor: K_T = 7.681e-3 N m/A, J = 5.64e-7 kg m² (from data
    sheets; all in DATA.mat).
    """
    content = io.BytesIO(fetch(mirrors, SERVO, "LAB0/Sim-Mat/Final_v/DATA.mat"))
    names = ("t1", "cur1", "wl1", "t2", "cur2", "wl2", "t3", "cur", "wm")
    data = {key: value.ravel() for key, value in loadmat(content, variable_names=names).items() if key in names}  # type: ignore[arg-type]
    wheel = {"inertia_kg_m2": 5.644e-7, "torque_constant_Nm_A": 7.681e-3}
    for name, end in (("servo_unit", "1"), ("servo_unit_back", "2")):
        time = data[f"t{end}"]
        keep = (time % 5.0 > 0.5) & (time < 45.0)
        t, i, v = means(100, time[keep], data[f"cur{end}"][keep], 14 * data[f"wl{end}"][keep])
        save(out, name, {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": 7.681e-3 * i})
    t, i, v = means(20, data["t3"], data["cur"], data["wm"])
    keep = (t > 0.5) & (v > 30.0)
    columns = {"time_s": t[keep], "speed_rad_s": v[keep], "motor_current_A": i[keep]}
    save(out, "servo_unit_trapezoids", columns, wheel)


def dyno(mirrors: Path, out: Path) -> None:
    """From thhsieh/U8-Kv100-Dyno-Data: a brushless motor (T-Motor U8) turned at no current against a torque transducer.

    100 to 1700 rpm at 24 and 36 V, two or three readings of torque and speed at each; rows in that order, 1 s apart.
    Friction = −torque (the dynamometer drives).
    """
    rows = []
    for volt, top in ((24, 1500), (36, 1700)):
        for speed in range(100, top + 1, 100):
            text = fetch(mirrors, "thhsieh/U8-Kv100-Dyno-Data", f"{volt}V Raw Data/{speed}RPM0A_trq.lvm")
            table = re.split(r"X_Value.*\n", text.decode("latin1").replace("\r", ""))[-1]
            rows += [[float(x) for x in line.split("\t")[1:3]] for line in table.splitlines() if line.strip()]
    data = np.array(rows)
    columns = {
        "time_s": np.arange(float(len(data))),
        "speed_rad_s": RPM * data[:, 0],
        "friction_torque_Nm": -data[:, 1],
    }
    save(out, "drag_ladder", columns)


def propellers(mirrors: Path, out: Path) -> None:
    """From aerostack2/thrust_map_estimation: rotors of a drone on a stand with a torque sensor.

    RCbenchmark logs at 8 Hz, torque as logged (it has the sign of the turning; not tared), speed from the electrical
    frequency: steps with one rotor to and fro and up, a ramp with four. Rows above 5 % of the fastest.
    """
    for name, file in (
        ("drone_steps", "single_rotor/xNova-SR-steps"),
        ("drone_steps_up", "single_rotor/xNova-SR-steps-up"),
        ("drone_ramp_four", "multirotor/xNova-MR-ramp"),
    ):
        text = fetch(mirrors, "aerostack2/thrust_map_estimation", f"thrust_stand/data/{file}.csv")
        rows = np.genfromtxt(io.BytesIO(text), delimiter=",", skip_header=1, usecols=(0, 8, 12))
        rows = rows[rows[:, 0] > np.maximum.accumulate(np.append(-1.0, rows[:-1, 0]))]
        rows = rows[rows[:, 2] > 0.05 * rows[:, 2].max()]
        columns = {"time_s": rows[:, 0], "speed_rad_s": RPM * rows[:, 2], "friction_torque_Nm": -rows[:, 1]}
        save(out, name, columns)


def pendulums(mirrors: Path, out: Path) -> None:
    """From jiarui-wen/PHY180-Pendulum-Project, tylertian123/phy180_lab (MIT), and two more repositories.

    Bobs on threads (a course at the University of Toronto), angles from films at 30 and 20 Hz; `_tracked`:
    satvick16/pendulum-lab, 15 Hz; `_fast`: HaysonC/PHY180-Pendulum, 240 Hz, angle around the centre of a circle through
    the points. The loss of 1 − cos a over the way, from windows of one or two periods, as in the fifth set. Friction in
    terms of m g l, which is not given.
    """
    for name, repo, file, periods, period, smallest in (
        ("thread_wide", "jiarui-wen/PHY180-Pendulum-Project", "report1/AAAtAmp3.txt", 2, 2.2, 0.07),
        ("thread_long", "jiarui-wen/PHY180-Pendulum-Project", "report2/8047.txt", 1, 2.4, 0.1),
        ("thread_short", "jiarui-wen/PHY180-Pendulum-Project", "report2/8055.txt", 2, 1.4, 0.1),
        ("thread_lab", "tylertian123/phy180_lab", "lab3/report/lab1_data.txt", 1, 1.6, 0.15),
        ("thread_tracked", "satvick16/pendulum-lab", "tracker_data.txt", 1, 1.46, 0.25),
        ("thread_fast", "HaysonC/PHY180-Pendulum", "runsArchive/run1.csv", 1, 0.8, 0.06),
    ):
        text = fetch(mirrors, repo, file).replace(b",", b" ")
        rows = np.genfromtxt(io.BytesIO(text), skip_header=2, invalid_raise=False)
        angle = rows[:, 1]
        if name in ("thread_wide", "thread_long", "thread_short"):
            angle = np.arctan2(rows[:, 1], -rows[:, 2])
        elif name == "thread_tracked":
            angle = np.radians(angle)
        elif name == "thread_fast":
            x, y = rows[:, 1], rows[:, 2]
            base = np.column_stack([2 * x, 2 * y, np.ones(x.size)])
            centre = np.linalg.lstsq(base, x**2 + y**2, rcond=None)[0]
            angle = np.arctan2(x - centre[0], y - centre[1])
        table = amplitudes(rows[:, 0], angle - np.median(angle), periods, period, smallest)
        table = table[table[:, 1] > smallest]
        save(out, name, loss(table, -np.cos(table[:, 1])))


ALL = (eco_car, reaction_wheel, surgical_arm, slide, cobot, youbot, servo_ladder, dyno, propellers, pendulums)

if __name__ == "__main__":
    convert(ALL)
