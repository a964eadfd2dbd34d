"""The twenty-third set of public recordings to friction tables, judged by physics and least squares before any search.

    python -m benchmarks.recordings.twentythird_validation MIRRORS OUT [NAME …]

MIRRORS is a folder of bare clones, each called OWNER+NAME.git, OUT a folder; NAME is one of the functions below, all
where none is given. Each recording becomes OUT/*.csv and OUT/*.toml (wheel file). Friction is positive where it opposes
positive speed. None of the data is part of the project: much of it has no licence.
"""

from __future__ import annotations

import csv
import io
from datetime import datetime
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from benchmarks.recordings.fifteenth_validation import even, smooth
from benchmarks.recordings.ninth_validation import RPM
from benchmarks.recordings.second_validation import fetch, git_table
from benchmarks.recordings.third_validation import DUKE, run_down
from benchmarks.recordings.twentieth_validation import less_inertia
from benchmarks.recordings.validation import convert, means, save


def course_motor(mirrors: Path, out: Path) -> None:
    """From lyDevper/ControlSyst_Lab01_Motor_Ident (no licence): a geared motor of a student's course.

    Another one than those of FRA233 in earlier sets; 1 kHz, volts (stand for the torque, what the turning motor induces
    is its viscous part) and speed (in its encoder's steps). `course_ramp`: 0 to 12 V in 5 s, low-pass filtered at 2 Hz,
    means of 50 rows, from 10 rad/s on; `course_sine`: 12 V, 0.7 Hz, `course_chirp`: faster and faster to 3 Hz, both
    filtered at 15 Hz, means of 20 rows, the dead band 30 rad/s (the filter smears what turns with the sign); friction =
    volts − J dω/dt, J by least squares.
    """
    path = "FRA233_67_LAB1_system_identification/Test_Dataframe.mat"
    data = io.BytesIO(fetch(mirrors, "lyDevper/ControlSyst_Lab01_Motor_Ident", path))
    log = loadmat(data, simplify_cells=True)  # type: ignore[arg-type]
    clock = np.asarray(log["TimeArr"], dtype=float)
    for name, cut, count, lowest, first, last in (
        ("ramp", 2.0, 50, 10.0, 0.9, 4.7),
        ("sine", 15.0, 20, 30.0, 0.1, 9.9),
        ("chirp", 15.0, 20, 30.0, 0.1, 9.9),
    ):
        on = (clock > first) & (clock < last)
        drive, turns = (np.asarray(log[f"{key}_{name}"], dtype=float)[on] for key in ("Inp", "Measure"))
        v, f = less_inertia(1000.0, drive * (12.0 if name == "chirp" else 1.0), turns, cut, lowest)
        t, v, f = means(count, *(x[100:-100] for x in (clock[on], v, f)))
        fast = v > lowest if name == "ramp" else np.full(v.size, True)
        columns = {"time_s": t[fast], "speed_rad_s": v[fast], "friction_torque_Nm": f[fast]}
        save(out, f"course_{name}", columns, dead_band=lowest)


def endless_servo(mirrors: Path, out: Path) -> None:
    """From amantiwary10/Servo-Motor-System-Identification (no licence): a servo that turns endlessly, in stairs.

    The width of its pulse beyond 1500 µs (stands for the torque) up and down in steps, and speed (whole turns a minute,
    an optical probe; RCbenchmark), a row about every 5 s, means of three, between 2 and 46 turns a minute (a longer
    pulse hardly turns it faster) from 20 µs on. One way (`endless`) or back (`endless_back`), the file for training
    (`_first`) or that for testing.
    """
    for name, file in (
        ("endless_first", "Clock/Training/StepsTest_2022-09-23_092153"),
        ("endless", "Clock/Testing/StepsTest_2022-09-25_075743"),
        ("endless_back_first", "Anti-Clock/Training/StepsTest_2022-09-26_095734"),
        ("endless_back", "Anti-Clock/Testing/StepsTest_2022-09-26_121304"),
    ):
        repo = "amantiwary10/Servo-Motor-System-Identification"
        log = git_table(mirrors, repo, f"Data/Optical Probe/{file}.csv", delimiter=",", skip_header=1)
        t, pulse, turns = log[:, 0], np.abs(log[:, 4] - 1500.0), log[:, 13]
        on = (turns > 2.0) & (turns < 46.0) & (pulse > 20.0)
        t, v, f = means(3, t[on], RPM * turns[on], pulse[on])
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}
        save(out, name, columns)


def card_hinge(mirrors: Path, out: Path) -> None:
    """From pranaypalem/mujoco-parameter-identification (no licence): a weight swings on a strip of card, filmed.

    Place of the weight about the end of the card (x, y), thus its angle, 30 Hz, low-pass filtered at 6 Hz; J = 1,
    friction = −dω/dt − k angle + what it is at rest, both by least squares beside dry and viscous friction.
    `card_long`: a long strip, from 2.8 s (a swing after its let-go) to 14 s; `card_short`: another, 0.25 to 5.75 s.
    """
    for name, file, first, last in (
        ("long", "Experiment_long_data_0_594", 2.8, 14.0),
        ("short", "Experiment_short_data", 0.25, 5.75),
    ):
        path = f"data/Project/{file}.csv"
        log = git_table(mirrors, "pranaypalem/mujoco-parameter-identification", path, delimiter=",", skip_header=1)
        time, x, y = even(30.0, *log.T)
        angle = smooth(30.0, 6.0, np.unwrap(np.arctan2(y, x)))
        speed = np.gradient(angle, 1 / 30)
        on = (time >= first) & (time < last)
        t, turned, v, f = time[on], angle[on], speed[on], -np.gradient(speed, 1 / 30)[on]
        base = np.column_stack([turned, np.ones_like(v), v, np.sign(v)])
        f -= base[:, :2] @ np.linalg.lstsq(base, f, rcond=None)[0][:2]
        columns = {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f, "angle_rad": turned - turned.mean()}
        save(out, f"card_{name}", columns)


def egg_hoist(mirrors: Path, out: Path) -> None:
    """From EliasWR/CyberneticsEggdrop (no licence): a geared motor lifts an egg on a thread and lets it down again.

    Duty (70 up, −30 down; stands for the torque) and counts of its encoder, about every 16 ms, made even at 60 Hz;
    low-pass filtered at 5 Hz, friction = duty − J dω/dt, J by least squares; means of three rows, the dead band 300
    counts/s, ten times up and down.
    """
    path = "Eggdrop/Matlab/serial_data copy.csv"
    log = git_table(mirrors, "EliasWR/CyberneticsEggdrop", path, delimiter=",", skip_header=1)
    time, drive, place = even(60.0, log[:, 0] / 1e3, log[:, 2], log[:, 3])
    v, f = less_inertia(60.0, drive, np.gradient(place, 1 / 60), 5.0, 300.0)
    t, v, f = means(3, time, v, f)
    on = np.abs(v) > 100.0
    save(out, "egg_hoist", {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]}, dead_band=300.0)


def motor_pair(mirrors: Path, out: Path) -> None:
    """From dan17229/V-Dyno (MIT): a motor of a skateboard turns another one, which has no current, at 200 to 400 rpm.

    A row a tenth of a second (no times); the torque that its reaction on a lever gives (less what it reads at rest
    afterwards, 0.0544 N m) or its current (A), means of three rows within 10 rpm of a level.
    """
    path = "data_output/results/2025-04-16_13-48-06.csv"
    log = git_table(mirrors, "dan17229/V-Dyno", path, delimiter=",", skip_header=1)[:230]
    on = (np.abs(log[:, 3] - np.round(log[:, 3], -2)) < 10.0) & (log[:, 3] > 150.0)
    rows = (0.1 * np.arange(len(log)), RPM * log[:, 3], log[:, 6] - 0.0544, log[:, 4])
    t, v, torque, amperes = means(3, *(x[on] for x in rows))
    for name, f in (("torque", torque), ("current", amperes)):
        save(out, f"pair_{name}", {"time_s": t, "speed_rad_s": v, "friction_torque_Nm": f}, period=0.3)


def bus_servos(mirrors: Path, out: Path) -> None:
    """From roboninecom/Backlash-Compensation-in-STS3215-Servo-Actuators (MIT): servos that turn a lever to and fro.

    About 10 Hz, as the servo (Feetech STS3215) reports them: load (a thousandth of its duty; stands for the torque,
    sign turned) and speed (4096 steps a turn and second), the rows where it moves, 20 steps/s the dead band.
    `bus_servo`, `bus_servo_other`: two that turn by themselves; `bus_lever`: one of two that share a lever.
    """
    repo = "roboninecom/Backlash-Compensation-in-STS3215-Servo-Actuators"
    for name, file, servo in (
        ("bus_servo", "comp2", 4),
        ("bus_servo_later", "pgain_zero_db", 4),
        ("bus_servo_other", "comp2", 3),
        ("bus_lever", "single_3250", 1),
    ):
        log = csv.DictReader(io.StringIO(fetch(mirrors, repo, f"logs/motor_telemetry_{file}.csv").decode()))
        rows = [
            (
                datetime.fromisoformat(row["timestamp"]).timestamp(),
                *(int(row[f"{key} ({servo})"]) for key in ("speed", "load")),
            )
            for row in log
            if row[f"speed ({servo})"]
        ]
        t, speed, load = np.array(rows, dtype=float).T
        v = np.where(speed >= 32768, 32768 - speed, speed) * 2 * np.pi / 4096
        f = -np.where(load >= 1024, 1024 - load, load) / 1000
        on = np.abs(v) > 0.0
        columns = {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]}
        save(out, name, columns, dead_band=0.03, period=0.1)


def more_front_wheels(mirrors: Path, out: Path) -> None:
    """From DukeElectricVehicles/DEV_data (no licence): front wheels as in the third set, others of that day.

    As there, to 0.4 m/s: `front_loose`: its bearings pressed together less, `front_cleaned`: cleaned before,
    `front_old`: called 2018.
    """
    radius, inertia = 0.2375, 0.570 * 0.227**2 + 0.020 * 0.23**2 + 0.380 * 0.20**2 + 0.170 * 0.13**2
    for name, file in (("loose", "michLessPreload"), ("cleaned", "michCleaned"), ("old", "2018")):
        rows = git_table(mirrors, DUKE, f"WheelSpindown/6_12_2019/{file}.txt", invalid_raise=False)
        part = run_down(rows[:, 9], rows[:, 3], 0.4, 20)
        time, speed = means(10, rows[part, 9] / 1e3, rows[part, 3] / radius)
        save(out, f"front_{name}", {"time_s": time, "speed_rad_s": speed}, {"inertia_kg_m2": inertia}, True, 1.0)


def aircraft_propeller(mirrors: Path, out: Path) -> None:
    """From Brojowski/uas (no licence): a propeller of an aircraft on a rig with a torque cell (RCbenchmark), in stairs.

    Another motor (TM15d) and year than in the eleventh set, 41 Hz; torque (lbf ft) less what the cell reads before the
    start, optical speed (rad/s), means of 25 rows above 100 rad/s; two of the stairs of a day, one of a later day.
    """
    for name, file in (
        ("stairs", "20180715_MultipleTests/STv4_TM15d_20180715_1"),
        ("stairs_other", "20180715_MultipleTests/STv5_TM15d_20180715_1"),
        ("stairs_later", "20180731_testrun/STv4_TM15d_20180731_1"),
    ):
        text = fetch(mirrors, "Brojowski/uas", f"data_2018_2019/{file}.csv").decode("utf-8-sig")
        rows = [line.split(",") for line in text.splitlines()[1:]]
        log = np.array([[float(row[k] or "nan") for k in (0, 7, 3)] for row in rows])
        log = log[np.isfinite(log).all(1)]
        start = int(np.flatnonzero(log[:, 1] > 30.0)[0])
        t, v, f = means(25, log[:, 0], log[:, 1], 1.35582 * (log[:, 2] - np.median(log[: start - 10, 2])))
        on = v > 100.0
        save(out, f"rig_{name}", {"time_s": t[on], "speed_rad_s": v[on], "friction_torque_Nm": f[on]})


ALL = (
    course_motor,
    endless_servo,
    card_hinge,
    egg_hoist,
    motor_pair,
    bus_servos,
    more_front_wheels,
    aircraft_propeller,
)

if __name__ == "__main__":
    convert(ALL)
